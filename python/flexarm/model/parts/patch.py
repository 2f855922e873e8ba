"""Piezoelectric patches bonded to beams: actuators, driven by a voltage, and sensors (paper Eq. 54-61)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
from numpy.polynomial import legendre

import flexarm._core as _core

from ..._check import array, known_keys
from .part import Finite, NotNegative, Part, one_of
from .shapes import coefficients


@dataclass(frozen=True)
class Piezo(Part):
    """Piezoelectric material; its elasticity is isotropic.

    Args:
        youngs_modulus: Pa, at constant field. poisson_ratio: 1.
        density: kg/m^3.
        d31: free strain along the actuation axis, per field through the thickness (m/V); d33 for a patch with
            interdigitated electrodes (its thickness is then the distance between their fingers).
        d15: free shear in the plane of the actuation axis and the thickness, per field (m/V).
        permittivity: F/m through the thickness at constant stress; needed for voltages that a patch senses.
        d32: as d31, across the actuation axis. Where it is equal to d31, as in poled ceramic plates, the patch's angle
            changes nothing and it cannot twist; zero is a patch that acts along its axis alone.
    """

    youngs_modulus: float
    poisson_ratio: float
    density: float
    d31: float
    _: KW_ONLY
    d15: float = 0.0
    permittivity: float = 0.0
    d32: float = 0.0
    _core: _core.Piezo = field(init=False, repr=False, compare=False)

    def _made(self) -> Any:
        names = ("youngs_modulus", "poisson_ratio", "density", "d31", "d32", "d15", "permittivity")
        return _core.Piezo(*(getattr(self, name) for name in names))


@dataclass(frozen=True)
class Patch(Part):
    """Piezoelectric patch on a face of a beam, or a pair on opposite faces.

    It adds stiffness (Eq. 58, first term, exact over its thickness) and mass, and per volt a moment (N m/V) over its
    length: with free strains e = d V / thickness, its stresses are E (strain - e) along x and G (shear - e) in its
    plane, none across (Eq. 54). A voltage is positive along the polarisation, so that a patch with d31 < 0 shrinks: on
    +y it bends the beam towards +y (K3 > 0), on +z towards +z (K2 < 0), on the other faces the other way. A pair "y" at
    V has V on +y and -V on -y, and has twice the effect of the one on +y; wired in series, each gets half the voltage.

    In torsion the faces of a rectangle shear as Saint-Venant has it, in a thin strip twice as much as in sections that
    stay plane (the paper's Eq. 18), and so twist twice as much; those of a box as Bredt's flow has it, a flange as a
    strip. On a beam with `extension` a patch pulls along the axis too, and a single one couples bending to it; without,
    the axis does not stretch. A patch's mass counts as if it were on the axis, but for rotary inertia.

    Args:
        start, end: metres from the clamp.
        width, thickness: m; the thickness of one layer. The width is in the middle of the face.
        material: a Piezo.
        face: "+y", "-y", "+z", "-z", or "y", "z" for a pair.
        angle: of the actuation axis, from x towards the face's other axis, z or y (rad).
        profile: width of the electrode as a share of the width, from -1 to 1, negative where the polarity is reversed:
            a smooth callable of x (m from the clamp), samples at equal steps from start to end, linear in between, or
            {"x": ..., "share": ...}. Shaped like a mode's curvature, it drives and senses that mode alone. None: 1.
        offset: from the neutral axis to the layer's inner face (m); None: the section's surface. 0 is a beam whose
            own layers are piezoelectric (then stiffness and mass may be in it already).
        pair: "opposed": the second face has -V, at the same angle: bends, and twists too at other angles than 0 and
            pi/2; "same": both have V, the second at -angle, which does not bend: at pi/4 it twists, at 0 it stretches
            a beam with `extension`, and d15 shears.
        stiffness, mass: whether the patch adds its own.

    Raises:
        ValueError: naming the field and the value; the beam checks that the patch fits it.
    """

    start: NotNegative
    end: Finite
    width: Finite
    thickness: Finite
    material: Piezo
    face: Annotated[str, one_of("y", "+y", "-y", "z", "+z", "-z")] = "y"
    _: KW_ONLY
    angle: Finite = 0.0
    profile: Any = None
    offset: Finite | None = None
    pair: Annotated[str, one_of("opposed", "same")] = "opposed"
    stiffness: bool = True
    mass: bool = True

    def _made(self) -> None:
        if not self.end > self.start:
            raise ValueError(f"end = {self.end}: must be beyond the start, {self.start}")
        if self.pair == "same" and len(self.face) == 2:
            raise ValueError(f"pair = 'same': needs two faces, 'y' or 'z', not {self.face!r}")
        if self.profile is not None:
            self._set("profile", _profile(self.profile, self.start, self.end))
        self._layer(0.0 if self.offset is None else self.offset, 1.0, 1.0)  # checks width, thickness, permittivity

    def _layer(self, inner: float, share: float, twist: float) -> _core.PatchSection:
        plus, minus = self.face[0] != "-", self.face[0] != "+"
        sides = (1 if self.face[-1] == "y" else 2, plus, minus, self.pair == "opposed")
        sizes = (self.angle, self.width, self.thickness, inner, share, twist)
        return _core.PatchSection(self.material._core, *sides, *sizes)

    def share(self, x: float) -> float:
        """Width of the electrode at x metres from the clamp, as a share of the patch's."""
        if self.profile is None:
            return 1.0
        if "legendre" in self.profile:
            s = 2 * (x - self.start) / (self.end - self.start) - 1
            return float(np.clip(legendre.legval(s, self.profile["legendre"]), -1.0, 1.0))
        return float(np.interp(x, self.profile["x"], self.profile["share"]))

    def on(self, section: Any, length: float) -> _core.Patch:
        """The core's patch, on a beam of that section and length (m)."""
        at = getattr(section, "at", lambda x: section)
        axis, varies = self.face[-1], hasattr(section, "at")

        def seat(x: float) -> tuple[float, float]:
            face = at(x)._face(axis)
            if face is None:
                if self.offset is None:
                    raise ValueError(
                        "offset = None: a section without such a face needs it, from the neutral axis to the patch (m)"
                    )
                return self.offset, 1.0
            if self.width > face.breadth * (1 + 1e-9):
                raise ValueError(f"width = {self.width}: must be at most the face's, {face.breadth} m")
            twist = face.twist
            if twist is None:
                twist = _core.surface_twist(2 * face.distance, face.breadth, min(self.width, face.breadth))
            return face.distance if self.offset is None else self.offset, twist

        fixed = seat(self.start)
        kinks = [*getattr(section, "x", ()), *((self.profile or {}).get("x", ()))]
        breaks = sorted({float(x) for x in kinks if self.start < x < self.end})
        if self.profile is None and not varies:
            same = self._layer(fixed[0], 1.0, fixed[1])
            return _core.Patch(self.start, self.end, lambda x: same, breaks, self.stiffness, self.mass)

        def layer(x: float) -> _core.PatchSection:
            inner, twist = seat(x) if varies else fixed
            return self._layer(inner, self.share(x), twist)

        return _core.Patch(self.start, self.end, layer, breaks, self.stiffness, self.mass)


def _profile(profile: Any, start: float, end: float) -> Mapping[str, tuple[float, ...]]:
    """{"x", "share"} of a profile that is linear in between, or {"legendre"} of a smooth one."""
    if isinstance(profile, Mapping) and "legendre" not in profile:
        known_keys("profile", profile, ("x", "share"))
        if set(profile) != {"x", "share"}:
            raise ValueError(f"profile = {profile!r}: must have x and share")
        x, share = array("profile.x", profile["x"]), array("profile.share", profile["share"])
        slack = 1e-9 * (end - start)
        if x.ndim != 1 or x.size < 2 or share.shape != x.shape:
            raise ValueError(f"profile has shapes x {x.shape}, share {share.shape}: must be two or more of each")
        if not (np.diff(x) > 0).all() or abs(x[0] - start) > slack or abs(x[-1] - end) > slack:
            raise ValueError(f"profile.x = {profile['x']!r}: must increase from start to end, {start} to {end} m")
        values, out = share, {"x": x, "share": share}
    elif callable(profile) or isinstance(profile, Mapping):
        moved = (lambda s: profile(start + s)) if callable(profile) else profile
        try:
            c = np.array(coefficients("profile", moved, end - start))
        except ValueError as e:
            raise ValueError(
                f"profile: a callable must be smooth and not zero throughout; give one with corners as samples ({e})"
            ) from None
        values, out = legendre.legval(np.linspace(-1, 1, 401), c), {"legendre": c}
    else:
        values = array("profile", profile)
        if values.ndim != 1 or values.size < 2:
            raise ValueError(f"profile has shape {values.shape}: must be a callable, or two samples or more")
        out = {"x": np.linspace(start, end, values.size), "share": values}
    worst = float(values[np.abs(values).argmax()])
    if abs(worst) > 1 + 1e-9:
        raise ValueError(f"profile: reaches {worst:.6g}: must stay from -1 to 1, a share of the width")
    return MappingProxyType({k: tuple(v.tolist()) for k, v in out.items()})


def core_patches(patches: Sequence[Patch], section: Any, length: float) -> list[_core.Patch]:
    """The patches as the core's beam takes them; errors name the patch."""
    out = []
    for k, patch in enumerate(patches):
        try:
            if patch.end > length * (1 + 1e-12):
                raise ValueError(f"end = {patch.end}: must be at most the beam's length, {length} m")
            out.append(patch.on(section, length))
        except ValueError as e:
            raise ValueError(f"patches[{k}].{e}") from None
    return out
