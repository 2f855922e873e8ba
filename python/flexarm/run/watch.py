"""Monitors of a run: whether it stays in the range that its model was chosen for."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np

from .._check import Array, outside
from ..acting.motor import torque_limits
from ..analysis.validity import rotation
from ..arm import Arm
from .result import Result

#: What is watched, of every beam, and in which words.
KINDS = MappingProxyType(
    {
        "rotation": "turns its sections against its base by {value:.3g} rad",
        "strain": "has a curvature of {value:.3g} 1/m at its clamp",
        "top": "has {value:.2g} of its elastic energy in the highest mode of a strain",
        "spin": "turns at {value:.3g} of the arm's first frequency",
    }
)
_DEFAULTS = {"top": 0.01, "spin": 0.5}  # of a beam with modes to spare; where order 1 has lost a tenth of its frequency


class WatchWarning(UserWarning):
    """A run has left the range that its model was chosen for.

    Attributes:
        what: "rotation" (rad), "strain" (1/m), "top" (share of the energy), "spin" (over the first frequency), or
            "torque" (N m, N) that a prescribed motion takes beyond the `torque_limit` of its joint.
        link: the link.
        time: of the first output row past the limit (s).
        value, limit: the largest in the run, and what it should have stayed below.
    """

    def __init__(self, message: str, what: str, link: int, time: float, value: float, limit: float) -> None:
        super().__init__(message)
        self.what, self.link, self.time, self.value, self.limit = what, link, time, value, limit

    def __reduce__(self) -> Any:
        return type(self), (str(self), self.what, self.link, self.time, self.value, self.limit)


def beyond_motor(arm: Arm, result: Result, prescribed: Sequence[int]) -> WatchWarning | None:
    """The prescribed motion that takes most beyond what the motor of its joint gives."""
    most = torque_limits(arm) if prescribed else np.zeros(0)
    over = [(float(np.abs(result.tau[:, i]).max(initial=0.0)) / most[i], i) for i in prescribed]
    share, i = max(over, default=(0.0, -1))
    if not share > 1.0 + 1e-9:
        return None
    size = np.abs(result.tau[:, i])
    k, first = int(size.argmax()), int((size > most[i]).argmax())
    link = next(n for n, part in enumerate(arm.links) if part.joint.nv and i in arm.joint_rates(n))
    return WatchWarning(
        f"the motion of '{arm.coordinates[i]}' takes up to {size[k]:.4g} (N m, N), at t = {result.t[k]:.4g} s; its "
        f"motor gives {most[i]:.4g} (torque_limit): move more slowly, or command the joint by a controller",
        "torque", link, float(result.t[first]), float(size[k]), float(most[i]),
    )  # fmt: skip


def first_frequency(arm: Arm) -> float:
    """The lowest (rad/s) with all joints locked, without gravity; nan if there is none."""
    try:
        locked = [k for k, link in enumerate(arm.links) if link.joint.nv]
        return float(arm._made(arm.links).modes(lock=locked).frequencies[0])
    except (ValueError, IndexError):
        return np.nan


def softened(arm: Arm, result: Result) -> str:
    """Names a beam of order 1 that turns faster than its first frequency at the end of a run, where it diverges; else
    it returns "", also of a run that failed before its first row."""
    for k, link in enumerate(arm.links):
        if link.beam is None or link.beam.order != 1 or not link.beam.ne or not len(result.q):
            continue
        spin = float(np.linalg.norm(arm.velocity(result.q[-1], result.v[-1], k, 0.0)[3:]))
        frequency = first_frequency(arm)
        if spin > frequency:
            return (
                f"{arm.names[k]}: at order 1 a beam softens as it turns, and diverges above its first frequency: this "
                f"one turns at {spin:.3g} rad/s, the frequency is {frequency:.3g}; take order = 2"
            )
    return ""


def readings(arm: Arm, result: Result, frequency: float = np.nan) -> dict[tuple[str, int], Array]:
    """Each monitor along a run, (nt,), by (what, link). It costs some microseconds a row and beam.

    Args:
        frequency: the arm's first one (rad/s); nan: its spin is not read.
    """
    out: dict[tuple[str, int], Array] = {}
    for k, link in enumerate(arm.links):
        beam = link.beam
        if beam is None:
            continue
        if np.isfinite(frequency) and frequency > 0:
            w = arm.velocity(result.q, result.v, k, 0.0)[:, 3:]
            out["spin", k] = np.linalg.norm(w, axis=1) / frequency
        if not beam.ne:
            continue
        first = arm._core.first_q(k) + link.joint.nq
        qe = result.q[:, first : first + beam.ne]
        out["rotation", k] = rotation(beam, qe)
        out["strain", k] = np.linalg.norm(arm.strain(result.q, k, 0.0)[:, :3], axis=1)
        energy = 0.5 * np.asarray(beam._core.stiffness).diagonal() * qe**2
        most, at = float(energy.sum(axis=1).max(initial=0.0)), -1
        top = np.zeros(len(qe))
        for n in beam.counts.values():
            at += n
            if n > 1:  # where there is one, it is the lowest too
                top = np.maximum(top, energy[:, at])
        out["top", k] = top / (most or 1.0)
    return out


@dataclass(frozen=True)
class Watch:
    """What `simulate(..., watch=...)` looks at, at the output times.

    Attributes:
        limits: by (what, link), such as ("rotation", 0), the largest value that is still in range; `WatchWarning` says
            what there is.
        frequency: the arm's first one with joints locked (rad/s).
    """

    limits: Mapping[tuple[str, int], float]
    frequency: float = field(default=np.nan)

    @staticmethod
    def usual(arm: Arm) -> Watch:
        """Limits of an arm that no plan was made for: energy in the highest modes, and the speed of turning where a
        beam has order 0 or 1, which know nothing of stiffening."""
        limits = {}
        for k, link in enumerate(arm.links):
            if link.beam is not None and link.beam.ne:
                limits["top", k] = _DEFAULTS["top"]
                if link.beam.order in (0, 1):
                    limits["spin", k] = _DEFAULTS["spin"]
        return Watch(limits, first_frequency(arm))

    @staticmethod
    def around(result: Result, margin: float = 1.5) -> Watch:
        """Limits `margin` times what a run has reached; below a hundredth of a radian, of a first frequency and of the
        energy, and where the run is but at rest, nothing is said."""
        w = first_frequency(result.arm)
        limits = {}
        for (what, k), values in readings(result.arm, result, w).items():
            least = 0.0 if what == "strain" else 0.01
            limits[what, k] = max(least, margin * float(values.max(initial=0.0)))
        return Watch({key: x for key, x in limits.items() if x > 0.0}, w)

    def look(self, result: Result) -> WatchWarning | None:
        """The warning that a run deserves, of what it has left first; or None."""
        found: list[tuple[float, str, int, float, float]] = []
        limits = {(what, result.arm._link(k)): limit for (what, k), limit in self.limits.items()}
        for (what, k), values in readings(result.arm, result, self.frequency).items():
            limit = limits.get((what, k), np.inf)
            past = np.flatnonzero(~(values <= limit))
            if past.size:
                found.append((float(result.t[past[0]]), what, k, float(values.max()), limit))
        if not found:
            return None
        time, what, k, value, limit = min(found)
        others = f", and {len(found) - 1} more" if len(found) > 1 else ""
        said, name = KINDS[what].format(value=value), result.arm.names[k]
        return WatchWarning(
            f"{name}{others}: {said}, beyond the {limit:.3g} that its model was chosen for, from t = {time:.6g} s "
            "on; take a richer model, or economize this scene again",
            what, k, time, value, limit,
        )  # fmt: skip

    def warn(self, result: Result) -> None:
        warning = self.look(result)
        if warning is not None:
            warnings.warn(warning, stacklevel=outside())
