"""Numbers of a model that are probably mistakes: wrong units, bodies that cannot be, strains that a beam lacks."""

from collections.abc import Iterator

import numpy as np

from ..model.parts.beam import STRAINS, Beam, RigidBody, inertia_matrix
from ..model.parts.chain import Chain
from ..model.parts.joints import Fixed
from ..model.parts.sections import GeneralSection, SectionMatrix
from .findings import Finding

# Each is past anything that is built; a finding is no error, for who means it.
_SOFTEST, _LIGHT = 1e3, 100.0  # Pa; gels have 1e3 to 1e5. kg/m^3; lighter models have no units: E = density = 1
#: kg/m^3, Pa; nothing as dense as metal is softer than rubber, nothing as dense as fibres or magnesium than silicone
_DENSE = ((5e3, 1e6), (1.5e3, 2e5))
_DENSEST = 3e4  # kg/m^3; osmium has 2.3e4
_IN_GRAMS, _FASTEST = (0.5, 25.0), 1e9  # g/cm^3 of bodies with mass; (m/s)^2 of E / density: diamond has 3.4e8
_GRAMS, _GIGA = (1.1, 25.0), (1.0, 1300.0)  # g/cm^3 and GPa of solids; 1 is the density of a model without units
_LONG, _THIN = 100.0, 1e4  # m; and lengths over thickness: the longest blades have 120 m and 1e2
_HEAVY = 1e6  # kg; of a beam
_THICK, _BROAD = 1.5, 5.0  # thickness and breadth over the length
_FAR, _FAR_AWAY = 20.0, 2.0  # a place on a body, over the beam's length, and m
_WIDE, _WIDE_SPREAD = 40.0, 20.0  # a radius of gyration, the same; hubs may have a rotor's inertia through its gear,
_ALL_WIDE, _ALL_SPREAD = 25.0, 12.0  # but about one axis only: the least one
_STATION = 1e5  # kg; a space station is as wide as that
_STIFFEST_SHEAR, _SOFTEST_SHEAR = 2.0, 1e-3  # shear modulus over Young's
_SHEAR = 0.05  # of the static tip deflection; shear's share: a beam a quarter as thick as long
_COUPLED = 0.01  # of a strain's stiffness, by another that is held


def _places(where: str, body: RigidBody, length: float) -> Iterator[Finding]:
    for name, place in (("com", body.com), ("end", body.end)):
        far, most = float(np.linalg.norm(place)), max(_FAR * length, _FAR_AWAY)
        if far > most:
            numbers = ", ".join(f"{x:g}" for x in place)
            what = f"({numbers}) m, on a beam of {length:g} m"
            yield Finding(f"{where}.{name}", what, far, most, "m", "is it in mm?")


def _inertia(where: str, body: RigidBody, length: float, on: str) -> Iterator[Finding]:
    """`length`: of its beam or rigid link (m)."""
    least, _, most = np.linalg.eigvalsh(inertia_matrix(body.inertia)).tolist()
    limits = ((most, _WIDE, _WIDE_SPREAD), (least, _ALL_WIDE, _ALL_SPREAD))
    for value, wide, spread in limits:
        limit = body.mass * max(wide * length, spread) ** 2
        if 0 < body.mass < _STATION and value > limit:
            what = (
                f"{most:g} kg m^2 of {body.mass:g} kg would be {(most / body.mass) ** 0.5:.3g} m away, on a {on} of "
                f"{length:g} m"
            )
            yield Finding(f"{where}.inertia", what, value, limit, "kg m^2", "is it in g mm^2 or kg mm^2?")
            return


def _thickness(beam: Beam, axis: str) -> tuple[float, float, float]:
    """At the clamp: area (m^2), second moment (m^4) against bending along an axis, area that bears shear along it."""
    section = beam.section.at(0.0)._core
    second = section.second_moment_z if axis == "y" else section.second_moment_y
    return section.area, second, section.area * section.shear_correction["yz".index(axis)]


def _softest(E: float, density: float) -> float:
    """The least modulus (Pa) of such a material, where E is below it; else 0."""
    limits = [_SOFTEST, *(softest for dense, softest in _DENSE if density > dense)]
    return max((x for x in limits if E < x), default=0.0)


def _too_thick(thin: float, broad: float, length: float) -> bool:
    return thin > _THICK * length or broad > _BROAD * length


def _in_mm(where: str, thin: float, broad: float, length: float) -> Finding:
    what = f"is {thin:.3g} m by {broad:.3g} m, of a beam of length {length:g} m"
    return Finding(f"{where}.section", what, thin, _THICK * length, "m", "is it in mm?")


def _wholes(arm: Chain) -> list[float]:
    """Of each link, the length (m) of its beam and of those that go on from it, rigidly joined, as `split` leaves them;
    where two go on from one, of the longer one."""
    own = [link.beam.length if link.beam is not None else 0.0 for link in arm.links]
    goes_on = []
    for link, (parent, x) in zip(arm.links, arm.seats, strict=True):
        below = arm.links[parent] if parent >= 0 else link
        joined = parent >= 0 and x is None and link.joint == Fixed() and not (below.tip or link.hub)
        goes_on.append(joined and bool(link.beam and below.beam))
    back, on = list(own), list(own)
    for k, parent in enumerate(arm.parents):
        back[k] += back[parent] if goes_on[k] else 0.0
    for k in reversed(range(len(own))):
        if goes_on[k]:
            on[arm.parents[k]] = max(on[arm.parents[k]], own[arm.parents[k]] + on[k])
    return [a + b - c for a, b, c in zip(back, on, own, strict=True)]


def _beam(where: str, beam: Beam, whole: float) -> Iterator[Finding]:
    """`whole`: the length (m) that bends."""
    material, L = beam.material, beam.length
    if material is None:
        yield from _matrices(where, beam)
        return
    E, density = material.youngs_modulus, material.density
    general = isinstance(beam.section, GeneralSection)  # its integrals may be but numbers
    dense, stiff = f"{where}.material.density", f"{where}.material.youngs_modulus"
    if _IN_GRAMS[0] < density < min(_IN_GRAMS[1], E / _FASTEST) and not general:
        what = f"{density:g} kg/m^3: no solid so stiff is so light"
        yield Finding(dense, what, density, E / _FASTEST, "kg/m^3", "is it in g/cm^3?")
    if density < _LIGHT:
        if _GRAMS[0] < density < _GRAMS[1] and _GIGA[0] <= E <= _GIGA[1] and not general:
            what = f"density {density:g} kg/m^3, youngs_modulus {E:g} Pa"
            yield Finding(f"{where}.material", what, density, _LIGHT, "kg/m^3", "in g/cm^3 and GPa?")
        return
    if softest := _softest(E, density):
        yield Finding(stiff, f"{E:g} Pa is softer than any such material", E, softest, "Pa", "is it in GPa or MPa?")
    G = material.shear_modulus
    odd = G is not None and not _SOFTEST_SHEAR * E <= G <= _STIFFEST_SHEAR * E
    if odd and G is not None:
        limit = E * (_STIFFEST_SHEAR if G > E else _SOFTEST_SHEAR)
        what = f"{G:g} Pa, of a Young's modulus of {E:g} Pa"
        yield Finding(f"{where}.material.shear_modulus", what, G, limit, "Pa", "is its unit Pa?")
    if density > _DENSEST:
        what = f"{density:g} kg/m^3: no solid is so dense"
        yield Finding(dense, what, density, _DENSEST, "kg/m^3", "what is its unit?")
    radii = [(i / a) ** 0.5 for a, i, _ in (_thickness(beam, axis) for axis in "yz")]
    if (L > _LONG and L > _THIN * min(radii)) or beam.mass > _HEAVY:
        what = f"{L:g} m, of a beam of {beam.mass:.3g} kg, {min(radii):.3g} m thin"
        yield Finding(f"{where}.length", what, L, _LONG, "m", "are they in mm?")
    thin, broad = (12**0.5 * f(radii) for f in (min, max))  # sides, of a rectangle
    if not general and _too_thick(thin, broad, whole):
        yield _in_mm(where, thin, broad, L)
        return
    for axis in "" if general or odd else "yz":
        if beam.counts.get(f"bending_{axis}") and not beam.counts.get(f"shear_{axis}"):
            _, second, shear = _thickness(beam, axis)
            ratio = 2 * (1 + (0.3 if material.poisson_ratio is None else material.poisson_ratio))
            if material.shear_modulus is not None:
                ratio = E / material.shear_modulus
            share = 3 * ratio * second / (shear * whole * whole)
            if share > _SHEAR:
                what = f"is so short for its thickness that shear adds {100 * share:.2g} % to the deflection of its tip"
                remedy = f"give it modes shear_{axis}, which it lacks"
                yield Finding(where, what, 100 * share, 100 * _SHEAR, "%", remedy)


def _matrices(where: str, beam: Beam) -> Iterator[Finding]:
    """Of a beam of SectionMatrix: units, as if it were a rectangle of one material; strains that it lacks, and others
    pull at."""
    section = beam.section.at(0.0)
    assert isinstance(section, SectionMatrix)
    EA, *EI = (section.rigidity(s) for s in ("extension", "bending_y", "bending_z"))
    thin, broad = sorted((12 * x / EA) ** 0.5 if EA else 0.0 for x in EI)
    density = section.mass / (thin * broad) if thin else 0.0
    if density >= _LIGHT:
        E = EA / (thin * broad)
        if softest := _softest(E, density):
            what = (
                f"stiffness {EA:g} N and {section.mass:g} kg/m, of about {thin:.3g} m by {broad:.3g} m, are of a "
                f"Young's modulus of {E:.3g} Pa, softer than any such material"
            )
            yield Finding(f"{where}.section", what, E, softest, "Pa", "is it in GPa or MPa?")
        if _too_thick(thin, broad, beam.length):
            yield _in_mm(where, thin, broad, beam.length)
    given = list(beam.counts)
    for strain in (s for s in STRAINS if s not in given and section.rigidity(s) > 0):
        pulled = max(given, key=lambda s: section.coupling(s, strain), default="")
        if pulled and section.coupling(pulled, strain) > _COUPLED:
            share = 100 * section.coupling(pulled, strain)
            what = (
                f"{strain} has none and is held at zero, while the section's stiffness couples it to {pulled}, "
                f"{share:.2g} % of whose stiffness is due to that"
            )
            yield Finding(f"{where}.modes", what, share, 100 * _COUPLED, "%", f"give {strain} modes")


def mistakes(arm: Chain) -> Iterator[Finding]:
    """The numbers of an arm that are probably mistakes."""
    wholes = _wholes(arm)
    for k, link in enumerate(arm.links):
        at, beam = f"link[{k}]", link.beam
        bodies = {f"{at}.{name}": x for name, x in (("hub", link.hub), ("tip", link.tip)) if x is not None}
        reach = max((float(np.linalg.norm(place)) for x in bodies.values() for place in (x.com, x.end)), default=0.0)
        for where, body in bodies.items():
            if beam is not None:
                yield from _places(where, body, beam.length)
            yield from _inertia(where, body, *((reach, "rigid link") if beam is None else (beam.length, "beam")))
        if beam is None:
            continue
        yield from _beam(f"{at}.beam", beam, wholes[k])
        if link.tip is not None and link.tip.mass > 0 and beam.basis == "loaded" and beam.basis_tip is None:
            what = (
                "is missing, so that basis = 'loaded' has the modes of the bare beam, while the link's tip has "
                f"{link.tip.mass:g} kg"
            )
            yield Finding(f"{at}.beam.basis_tip", what, link.tip.mass, 0.0, "kg", "give basis_tip that tip")
