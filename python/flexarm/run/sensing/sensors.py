"""The sensors: encoder, tachometer, force/torque; contact force; strain gauge, accelerometer, camera (paper Sec. 5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..._check import Array, array, at_least, choice, positive
from ...arm.arm import Arm
from ...model.parts.beam import STRAIN_NAMES, Beam, Vector, as_floats
from ...model.parts.joints import UNIT
from .sensor import Component, Sensor

# -- on a joint ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _OnFreedom(Sensor):
    link: int | str = -1
    freedom: int = 0

    def _rate(self, arm: Arm) -> int:
        return arm.joint_rate((self.link, self.freedom))

    def _unit(self, arm: Arm) -> str:
        self._rate(arm)
        return arm[self.link].joint.units[self.freedom]

    def _where(self, arm: Arm) -> str:
        return arm.coordinates[self._rate(arm)]


@dataclass(frozen=True)
class Encoder(_OnFreedom):
    """Incremental encoder: the coordinate of a joint (rad; m), in steps.

    Args:
        link, freedom: the joint's link (-1 is the last), and its freedom.
        pulses: per revolution (per metre of a prismatic joint); None: no steps.
        quadrature: four counts a pulse, from both edges of both tracks.
        gear_ratio: turns of the encoder for one of the joint, where it sits on the motor.
    """

    pulses: int | None = 2000
    quadrature: bool = False
    gear_ratio: float = 1.0
    type: ClassVar[str] = "encoder"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.resolution is not None:
            raise ValueError(f"resolution = {self.resolution}: an encoder's follows from pulses")
        if self.pulses is not None:
            at_least("pulses", self.pulses, 1, ", or None for no steps")
        positive("gear_ratio", self.gear_ratio)

    def components(self, arm: Arm) -> list[Component]:
        return [("position", self._unit(arm))]

    def steps(self, arm: Arm) -> Array:
        """One count, at the joint (rad; m), (1,); 0: no steps."""
        if self.pulses is None:
            return np.zeros(1)
        turn = 2 * np.pi if self._unit(arm) == "rad" else 1.0
        return np.array([turn / (self.pulses * (4 if self.quadrature else 1) * self.gear_ratio)])

    def _at(self, arm: Arm) -> int:
        at = arm.coordinate_of(self._rate(arm))
        if at < 0:
            raise ValueError(f"freedom = {self.freedom}: is one of a ball, which has no angle to count")
        return at

    def _rows(self, arm: Arm) -> tuple[Array, Array]:
        return np.eye(arm.nq)[[self._at(arm)]], np.zeros((1, arm.nv))

    def _measure(self, arm: Arm, t: Array, q: Array, v: Array, a: Any, loads: Any) -> Array:
        return q[..., self._at(arm), None]


@dataclass(frozen=True)
class Tachometer(_OnFreedom):
    """Tachometer: the rate of a joint (rad/s; m/s).

    Args:
        link, freedom: the joint's link (-1 is the last), and its freedom.
    """

    type: ClassVar[str] = "tachometer"

    def components(self, arm: Arm) -> list[Component]:
        return [("rate", f"{self._unit(arm)}/s")]

    def _rows(self, arm: Arm) -> tuple[Array, Array]:
        return np.zeros((1, arm.nq)), np.eye(arm.nv)[[self._rate(arm)]]

    def _measure(self, arm: Arm, t: Array, q: Array, v: Array, a: Any, loads: Any) -> Array:
        return v[..., self._rate(arm), None]


@dataclass(frozen=True)
class ForceTorque(Sensor):
    """Six-component force/torque sensor in a joint: the wrench on its link, as `Arm.joint_reaction`.

    Of contacts it feels the normal forces, and, where it reads a result, friction too. That is known only there: in a
    loop of control it refuses an arm with contacts that have friction.

    Args:
        link: the joint's link; -1 is the last.
        side: "outboard": at the link's origin, in its axes; "inboard": at the end of its parent, in its axes.
    """

    link: int | str = -1
    side: str = "outboard"
    type: ClassVar[str] = "force_torque"
    needs_a: ClassVar[bool] = True
    feels_loads: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        choice("side", self.side, ("outboard", "inboard"))

    def components(self, arm: Arm) -> list[Component]:
        return [(f"force {c}", "N") for c in "xyz"] + [(f"moment {c}", "N m") for c in "xyz"]

    def _where(self, arm: Arm) -> str:
        return f"joint {arm.joint_names[arm._link(self.link)]}"

    def _measure(self, arm: Arm, t: Array, q: Array, v: Array, a: Any, loads: Any) -> Array:
        if not loads or t.ndim == 0:
            return arm.joint_reaction(q, v, a, self.link, self.side, loads=loads, t=float(t) if t.ndim == 0 else 0.0)
        rows = zip(t, q, v, array("a", a), strict=True)
        place = (self.link, self.side)
        return np.array([arm.joint_reaction(x, y, z, *place, loads=loads, t=float(s)) for s, x, y, z in rows])


# -- of a contact --------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ContactForce(Sensor):
    """Sensor of the normal force of a contact (N): a pressure pad, a load cell under a toe.

    Args:
        contact: its name or its number in `arm.contacts`; -1 is the last.
    """

    contact: str | int = -1
    type: ClassVar[str] = "contact_force"

    def components(self, arm: Arm) -> list[Component]:
        return [("normal force", "N")]

    def _where(self, arm: Arm) -> str:
        return arm.contact_names[arm._contact(self.contact)]

    def _measure(self, arm: Arm, t: Array, q: Array, v: Array, a: Any, loads: Any) -> Array:
        return arm.contact_motion(q, v)[2][..., arm._contact(self.contact), None]


# -- on a slice ----------------------------------------------------------------------------------------------------

#: face of a section: (component of the strain, sign) such that the face's strain is sign * distance * K
_EPS = STRAIN_NAMES.index("eps")
_FACES = {"+y": (2, -1.0), "-y": (2, 1.0), "+z": (1, 1.0), "-z": (1, -1.0)}


def half_thickness(section: Any, along: str, x: float) -> float | None:
    """The distance from the neutral axis to a face (m); None if it is not known."""
    reach = section.at(x)._reach(along)
    return None if reach is None else float(reach)


@dataclass(frozen=True)
class StrainGauge(Sensor):
    """Strain gauge along a beam, on one of its faces.

    A fibre at (y, z) of the section is strained by eps + z K2 - y K3, with eps the extension. So a beam bent towards
    +y (K3 > 0: its tip goes to +y) is compressed on its +y face, where the gauge reads -y K3; +z reads +z K2,
    and -y and -z the opposite. Curvature, as of Eq. 97, is K3 = -strain / y.

    Args:
        link: the beam's link; -1 is the last. x: place along it (m).
        face: "+y", "-y", "+z" or "-z".
        gauge_factor: None: the reading is the strain; else the relative change of resistance, gauge_factor * strain.
            A full bridge of four gauges in bending, two on each face, gives this share of its supply voltage.
        distance: from the neutral axis to the gauge (m); None: to the face, which is known for all sections but those
            given by their integrals.
    """

    link: int | str = -1
    x: float = 0.0
    face: str = "+y"
    gauge_factor: float | None = None
    distance: float | None = None
    type: ClassVar[str] = "strain_gauge"

    def __post_init__(self) -> None:
        super().__post_init__()
        choice("face", self.face, _FACES)
        for name in ("gauge_factor", "distance"):
            if getattr(self, name) is not None:
                positive(name, getattr(self, name))

    def _kind(self) -> str:
        return f"strain gauge {self.face}"

    def components(self, arm: Arm) -> list[Component]:
        return [("strain", "1")] if self.gauge_factor is None else [("dR/R", "1")]

    def _distance(self, arm: Arm) -> float:
        beam = arm[self.link].beam
        if not isinstance(beam, Beam):
            raise ValueError(f"link = {self.link}: has no beam to bond a strain gauge on")
        found = half_thickness(beam.section, self.face[1], self.x) if self.distance is None else self.distance
        if found is None:
            raise ValueError("distance = None: this section does not tell how far its faces are; give it in m")
        return found

    def _rows(self, arm: Arm) -> tuple[Array, Array]:
        return self._measure(arm, np.zeros(arm.nq), np.eye(arm.nq), np.zeros(0), None, None).T, np.zeros((1, arm.nv))

    def _measure(self, arm: Arm, t: Array, q: Array, v: Array, a: Any, loads: Any) -> Array:
        component, sign = _FACES[self.face]
        distance, scale = sign * self._distance(arm), 1.0 if self.gauge_factor is None else self.gauge_factor
        strain = arm.strain(q, self.link, self.x)
        return np.asarray(scale * (distance * strain[..., component, None] + strain[..., _EPS, None]))


@dataclass(frozen=True)
class Accelerometer(Sensor):
    """Accelerometer on a slice, in the slice's own axes (m/s^2).

    Args:
        link: the slice's link; -1 is the last. x: place along its beam (m); None: the link's end.
        axis: "x", "y", "z", a direction of three numbers, or "xyz" for all three axes.
        gravity: True: specific force, R^T (a - g), as real instruments read: at rest, 9.81 upwards. False: R^T a.
    """

    link: int | str = -1
    x: float | None = None
    axis: str | Vector = "y"
    gravity: bool = True
    type: ClassVar[str] = "accelerometer"
    needs_a: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.axis, str):
            choice("axis", self.axis, (*UNIT, "xyz"))
        else:
            self._set("axis", as_floats(array("axis", self.axis, (3,))))
            if not np.any(self.axis):
                raise ValueError(f"axis = {self.axis}: must not be zero")

    def _kind(self) -> str:
        return f"accelerometer {self.axis}"

    def components(self, arm: Arm) -> list[Component]:
        names = list(self.axis) if isinstance(self.axis, str) else [f"along {self.axis}"]
        return [(f"acceleration {name}", "m/s^2") for name in names]

    def _measure(self, arm: Arm, t: Array, q: Array, v: Array, a: Any, loads: Any) -> Array:
        felt = arm.acceleration(q, v, a, self.link, self.x)[..., :3] - np.array(arm.gravity) * self.gravity
        own: Array = np.einsum("...ij,...i->...j", arm.frame(q, self.link, self.x)[1], felt)  # R^T
        if self.axis == "xyz":
            return own
        along = np.array(UNIT[self.axis] if isinstance(self.axis, str) else self.axis)
        return np.asarray((own @ (along / np.linalg.norm(along)))[..., None])


@dataclass(frozen=True)
class Camera(Sensor):
    """Camera, or another tracker, of the place of a slice (m, three components).

    Args:
        link: the slice's link; -1 is the last. x: place along its beam (m); None: the link's end.
        axes: "world": a fixed camera: the place in the world; "link": one that turns with the link's hub: the
            displacement of the slice from its undeformed place, in the axes of the hub (needs a beam).
    """

    link: int | str = -1
    x: float | None = None
    axes: str = "world"
    type: ClassVar[str] = "camera"

    def __post_init__(self) -> None:
        super().__post_init__()
        choice("axes", self.axes, ("world", "link"))

    def components(self, arm: Arm) -> list[Component]:
        return [(("position " if self.axes == "world" else "displacement ") + c, "m") for c in "xyz"]

    def _from_clamp(self, arm: Arm, q: Array) -> Array:
        place, (clamp, R) = arm.frame(q, self.link, self.x)[0], arm.frame(q, self.link, 0.0)
        return np.asarray(np.einsum("...ij,...i->...j", R, place - clamp))

    def _measure(self, arm: Arm, t: Array, q: Array, v: Array, a: Any, loads: Any) -> Array:
        if self.axes == "world":
            return np.asarray(arm.frame(q, self.link, self.x)[0])
        return self._from_clamp(arm, q) - self._from_clamp(arm, arm.zero)
