"""A plain table that describes an arm."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from .._console import aligned
from ..model.parts.beam import Beam
from ..model.parts.chain import Chain
from ..model.parts.contact import Box, Plane, Sphere
from ..model.parts.joints import Fixed, Joint
from ..model.parts.sections import Box as BoxSection
from ..model.parts.sections import Circle, Ellipse, IBeam, Rectangle, SectionMatrix, Tube
from ..model.parts.shapes import curvature_at
from ..model.parts.strut import WORLD, Tendon
from ..model.parts.taper import Taper
from .assembly import assemble, mobility
from .modes import locked_modes

_HEADS = ("link", "joint", "beam (m)", "modes", "order", "hub (kg)", "beam (kg)", "tip (kg)", "clamped (rad/s)")
_STRUT_HEADS = ("strut", "kind", "between", "at zero (m)", "unstressed (m)", "N/m", "N s/m", "force (N)")
_LOOP_HEADS = ("loop", "joint", "from", "to", "N/m", "N s/m", "N m/rad", "N m s/rad")
_CONTACT_HEADS = (
    "contact", "point", "radius (m)", "against", "gap at zero (m)", "stiffness", "damping (s/m)", "coulomb",
)  # fmt: skip


def _size(beam: Beam) -> str:
    shape = _section(beam)
    if beam.curvature is None:
        return shape
    x, w = np.polynomial.legendre.leggauss(64)
    K = np.array([curvature_at(beam.curvature, beam.length, beam.length * (1 + s) / 2) for s in x])
    turns = beam.length / 2 * (w @ np.column_stack([np.linalg.norm(K[:, 1:], axis=1), np.abs(K[:, 0])]))
    words = (f"{word} {turn:.3g} rad" for word, turn in zip(("bent", "twisted"), turns, strict=True) if turn)
    return f"{shape}, " + ", ".join(words)


def _section(beam: Beam) -> str:
    section = beam.section
    if isinstance(section, Taper):
        words = f"taper of {len(section.x)}"
    elif isinstance(section, (Rectangle, Ellipse, BoxSection, IBeam)):
        name = "" if isinstance(section, Rectangle) else section.type.replace("i_beam", "I-beam") + " "
        words = f"{name}{section.y:.4g} x {section.z:.4g}"
    elif isinstance(section, (Circle, Tube)):
        inner = section.radius - section.thickness if isinstance(section, Tube) else section.inner_radius
        words = f"round {2 * section.radius:.4g}" + (f" bore {2 * inner:.4g}" if inner else "")
    elif isinstance(section, SectionMatrix):
        words = f"matrices, {section.mass:.4g} kg/m"
    else:
        words = f"area {section._core.area:.4g} m^2"
    return f"{beam.length:.4g}, {words}"


def lowest_frequencies(arm: Chain, n: int) -> tuple[str, str]:
    """The lowest n frequencies (rad/s) at zero, all joints locked, without gravity, and their damping ratios; why there
    are none otherwise."""
    if not any(link.beam is not None and link.beam.ne for link in arm.links):
        return "none, the arm is rigid", ""
    try:
        found = locked_modes(arm)
    except ValueError as e:
        return f"none: {e}", ""
    return " ".join(f"{f:.4g}" for f in found.frequencies[:n]), " ".join(f"{z:.4g}" for z in found.damping[:n])


def _row(k: int, arm: Chain) -> list[str]:
    link = arm.links[k]
    called = link.name or link.joint.name
    name = f"{k} {called or ''}".rstrip()
    joint = "" if link.joint.name in (None, called) else f"{link.joint.name}: "
    joint += f"{link.joint.type} {_along(link.joint)}"
    masses = [f"{body.mass:.4g}" if body is not None else "-" for body in (link.hub, link.beam, link.tip)]
    if link.beam is None:
        return [name, joint.strip(), "-", "-", "-", *masses, "-"]
    counts = ", ".join(f"{s} {n}" for s, n in link.beam.counts.items()) or "rigid"
    try:  # the beam alone, clamped: K x = omega^2 M x of this link without its tip
        alone = arm._alike([type(link)(Fixed(), link.hub, link.beam)], struts=(), contacts=(), loops=())
        clamped = lowest_frequencies(alone, 2)[0] if link.beam.ne else "-"
    except ValueError:  # it has no inertia of its own
        clamped = "-"
    return [name, joint.strip(), _size(link.beam), counts, str(link.beam.order), *masses, clamped]


def _strut_rows(arm: Chain) -> list[Sequence[str]]:
    lengths = arm.strut_motion(arm.zero)[0]
    rows: list[Sequence[str]] = [_STRUT_HEADS]
    for k, s in enumerate(arm.struts):
        kind, force = ("tendon", s.tension) if isinstance(s, Tendon) else ("strut", s.force)
        numbers = (lengths[k], arm.rest_lengths[k], s.stiffness, s.damping, force)
        given: Sequence[Any] = s.points
        points = " - ".join(_point(p, arm) for p in given)
        rows.append([f"{k} {s.name or ''}".rstrip(), kind, points, *(f"{x:.4g}" for x in numbers)])
    return rows


def _contact_rows(arm: Chain) -> list[Sequence[str]]:
    gaps = arm.contact_motion(arm.zero)[0]
    rows: list[Sequence[str]] = [_CONTACT_HEADS]
    for k, c in enumerate(arm.contacts):
        unit = "N/m" if c.exponent == 1.0 else f"N/m^{c.exponent:g}"
        rows.append(
            [f"{k} {c.name or ''}".rstrip(), _point(c.point, arm), f"{c.radius:.4g}", _surface(c.against, arm),
             f"{gaps[k]:.4g}", f"{c.stiffness:.4g} {unit}", f"{c.damping:.4g}", f"{c.coulomb:.4g}"]
        )  # fmt: skip
    return rows


def _loop_rows(arm: Chain) -> list[Sequence[str]]:
    rows: list[Sequence[str]] = [_LOOP_HEADS]
    for k, x in enumerate(arm.loops):
        joint = f"{x.joint.type} {_along(x.joint)}".strip()
        springs = (x.stiffness, x.damping), (x.angular_stiffness, x.angular_damping)
        numbers = [s for k, c in springs for s in (("rigid", "-") if k is None else (f"{k:.4g}", f"{c:.4g}"))]
        rows.append([f"{k} {x.name or ''}".rstrip(), joint, _point(x.a, arm), _point(x.b, arm), *numbers])
    return rows


def _closed(arm: Chain) -> str:
    """The motions that rigid loops leave, where they are closed near zero."""
    try:
        found = mobility(arm, assemble(arm))
    except ValueError as e:
        return f"{str(e).partition('; begin')[0]} (from zero)"
    redundant = f", {found.redundant} of them redundant" if found.redundant else ""
    return f"{found.rows} rigid conditions{redundant}; free motions: {found.freedoms}"


def _along(joint: Joint) -> str:
    axis = getattr(joint, "axis", "")
    return axis if isinstance(axis, str) else _triple(axis)


def _surface(surface: Plane | Sphere | Box, arm: Chain) -> str:
    where = f"{surface.type}, {_point(surface.at, arm)}"
    if isinstance(surface, Plane):
        return f"{where}, normal {_triple(surface.normal)}"
    if isinstance(surface, Sphere):
        return f"{where}, radius {surface.radius:.4g}"
    return f"{where}, {' x '.join(f'{x:.4g}' for x in surface.size)}"


def _triple(numbers: Sequence[float]) -> str:
    return f"({', '.join(f'{x:.3g}' for x in numbers)})"


def _point(point: Any, arm: Chain) -> str:
    offset = _triple(point.offset)
    if point.link == WORLD:
        return f"world {offset}"
    at = point.at if isinstance(point.at, str) else f"{point.at:.4g} m"
    return f"{arm.names[arm._link(point.link)]} {at}" + (f" + {offset}" if any(point.offset) else "")


def describe(arm: Chain) -> str:
    """A plain table, which `print(arm)` shows: of each link the joint, sizes, modes, masses and the lowest
    frequencies of its clamped beam without the tip; of the arm its mass, and its lowest frequencies and damping
    ratios with all joints locked at zero, without gravity; of each strut and tendon its points, length, spring,
    damper and constant force; of each contact its point, its surface, its gap at zero and the numbers of its
    forces; of each loop its joint, its places and its springs and dampers, and how many freedoms the loops leave,
    near zero."""
    rows: list[Sequence[str]] = [_HEADS, *(_row(k, arm) for k in range(len(arm.links)))]
    if not arm.is_chain:
        sits = ["on"]
        for k, x in arm.seats:
            on = "world" if k < 0 else arm.names[k].removeprefix("link ")
            sits.append(on if x is None else f"{on} at {x:g} m")
        rows = [(row[0], on, *row[1:]) for row, on in zip(rows, sits, strict=True)]
    mass = sum(link.mass for link in arm.links)
    gravity = ", ".join(f"{g:.4g}" for g in arm.gravity)
    elastic = sum(link.beam.ne for link in arm.links if link.beam is not None)
    reaches = np.linalg.norm(arm.end_places(arm.zero), axis=1)
    whose = [""] if len(reaches) == 1 else [f", that of {arm.names[k]}" for k in arm.ends]
    frequencies, damping = lowest_frequencies(arm, 4)
    lines = [
        *aligned(rows),
        "",
        *([*aligned(_strut_rows(arm)), ""] if arm.struts else []),
        *([*aligned(_contact_rows(arm)), ""] if arm.contacts else []),
        *([*aligned(_loop_rows(arm)), ""] if arm.loops else []),
        f"coordinates     {arm.nv}: {arm.nv - elastic} of joints, {elastic} elastic"
        + (f"; q has {arm.nq} entries" if arm.nq != arm.nv else ""),
        *([f"loops           {_closed(arm)}"] if arm.constrained else []),
        f"mass            {mass:.6g} kg",
        *(f"end at zero     {x:.4g} m from the base{of}" for x, of in zip(reaches, whose, strict=True)),
        f"gravity         ({gravity}) m/s^2",
        f"frequencies     {frequencies} (rad/s; joints locked, {'loops open, ' if arm.loops else ''}no gravity)",
        *([f"damping ratios  {damping}"] if damping else []),
    ]
    return "\n".join(lines)
