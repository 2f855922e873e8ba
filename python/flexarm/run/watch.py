"""Findings about a run that is done: quantities that left their range, motors asked for too much, and parts of its
model that are probably a mistake or too coarse."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from .._check import Array, instance
from ..analysis.coarse import coarse
from ..analysis.findings import Finding, Findings, RangeWarning
from ..analysis.mistakes import mistakes
from ..analysis.modes import locked_modes
from ..analysis.validity import range_warning, rotation, worst_range
from ..arm.arm import Arm
from ..model.acting.drive import Motion
from ..model.acting.motor import torque_limits
from ..model.parts.contact import Box
from .outputs import Rows
from .steps import short_steps

#: Of every beam: unit, words and remedy of a quantity.
_RICHER = "take a richer model, or economize this scene again"
KINDS = MappingProxyType(
    {
        "rotation": ("rad", "turns its sections against its base by {:.3g} rad", _RICHER),
        "strain": ("1/m", "has a curvature of {:.3g} 1/m at its clamp", _RICHER),
        "top": ("", "has {:.2g} of its elastic energy in the highest mode of a strain", "take more modes"),
        "spin": ("", "turns at {:.3g} of the arm's first frequency", "take order = 2"),
    }
)
_GRAVITY, _CRUSHED = 9.81, 20.0  # m/s^2; weights of the arm, by which nothing begins to be pushed
_FOLLOWED = 1.0  # step times frequency of a contact, above which steps do not follow it
_DEFAULTS = {"top": 0.01, "spin": 0.5}  # of a beam with modes to spare; where order 1 has lost a tenth of its frequency


def _beyond_motor(arm: Arm, result: Rows, prescribed: Sequence[int]) -> Iterator[Finding]:
    """The prescribed motion that passes the limit of its joint's motor by most."""
    most = torque_limits(arm) if prescribed else np.zeros(0)
    over = [(float(np.abs(result.tau[:, i]).max(initial=0.0)) / most[i], i) for i in prescribed]
    share, i = max(over, default=(0.0, -1))
    if share > 1.0 + 1e-9:
        size = np.abs(result.tau[:, i])
        k = int(size.argmax())
        what = (
            f"takes up to {size[k]:.4g} (N m, N), at t = {result.t[k]:.4g} s; its motor gives {most[i]:.4g} "
            "(torque_limit)"
        )
        remedy = "move more slowly, or command the joint by a controller"
        where = f"the motion of '{arm.coordinates[i]}'"
        yield Finding(where, what, float(size[k]), float(most[i]), "N m, N", remedy)


def _in_contacts(result: Rows, step: float) -> Iterator[Finding]:
    """Contacts that begin far inside a surface, as deep as half the size of the touching bodies, or that bounce faster
    than steps follow (s; 0: they are chosen)."""
    arm, t = result.arm, result.t
    gaps, rates, normals = arm.contact_motion(result.q, result.v)
    weight = _GRAVITY * sum(link.mass for link in arm.links)
    for k, (c, gap, rate, normal) in enumerate(zip(arm.contacts, gaps.T, rates.T, normals.T, strict=True)):
        where, sizes = f"contact[{k}]", [c.radius, getattr(c.against, "radius", 0.0)]
        sizes += [0.5 * min(c.against.size)] if isinstance(c.against, Box) else []
        thin, row = 0.5 * min([x for x in sizes if x] or [np.inf]), int(gap.argmin())
        if normal[0] > _CRUSHED * weight:
            what = f"begins {-gap[0]:.3g} m inside its surface, which pushes with {normal[0]:.3g} N"
            yield Finding(where, what, float(normal[0]), _CRUSHED * weight, "N", "on which side of it is the arm?")
        elif -gap[row] > thin:
            what = f"gets {-gap[row]:.3g} m deep, at t = {t[row]:.4g} s: more than half of the touching bodies"
            remedy = "is its unit N/m? Take a stiffer one"
            yield Finding(f"{where}.stiffness", what, float(-gap[row]), thin, "m", remedy)
        speed = np.maximum(-rate, 0.0)
        hits = np.flatnonzero((gap < 0.0) | (gap < np.diff(t, append=t[-1]) * speed))  # now, or before the next row
        if not hits.size or not step:
            continue
        row = int(hits[speed[hits].argmax()])
        J = arm.contact_jacobian(result.q[row])[k]
        give = float(J @ np.linalg.lstsq(arm.mass_matrix(result.q[row]), J)[0])  # 1/kg, of the bodies that hit
        if not give > 0.0:
            continue
        deep = ((c.exponent + 1.0) / 2.0 * speed[row] ** 2 / (c.stiffness * give)) ** (1.0 / (c.exponent + 1.0))
        w = float(np.sqrt(c.exponent * c.stiffness * max(deep, -gap[row]) ** (c.exponent - 1.0) * give))
        if w * step > _FOLLOWED:
            what = f"bounces within {np.pi / w:.2g} s (half a period of {w:.3g} rad/s), in steps of {step:g} s"
            remedy = f"take steps below {_FOLLOWED / w:.2g} s, or chosen ones"
            yield Finding(where, what, w * step, _FOLLOWED, "", remedy)


def first_frequency(arm: Arm) -> float:
    """The lowest (rad/s) with all joints locked, without gravity; nan if there is none."""
    try:
        return float(locked_modes(arm).frequencies[0])
    except (ValueError, IndexError):
        return np.nan


def softened(arm: Arm, result: Rows) -> str:
    """Names a beam of order 1 that turns faster than its first frequency at the end of a run, where it diverges; else
    it returns "", also of a run that failed before its first row."""
    for k, beam, *_ in arm.beams() if len(result.q) else ():
        if beam.order != 1:
            continue
        spin = float(np.linalg.norm(arm.velocity(result.q[-1], result.v[-1], k, 0.0)[3:]))
        frequency = first_frequency(arm)
        if spin > frequency:
            return (
                f"{arm.names[k]}: at order 1 a beam softens as it turns, and diverges above its first frequency: this "
                f"one turns at {spin:.3g} rad/s, the frequency is {frequency:.3g}; take order = 2"
            )
    return ""


def readings(arm: Arm, result: Rows, frequency: float = np.nan) -> dict[tuple[str, int], Array]:
    """Each monitor along a run, (nt,), by (quantity, link). It costs some microseconds a row and beam.

    Args:
        frequency: the arm's first one (rad/s); nan: its spin is not read.
    """
    out: dict[tuple[str, int], Array] = {}
    for k, link in enumerate(arm.links):
        if link.beam is not None and np.isfinite(frequency) and frequency > 0:
            w = arm.velocity(result.q, result.v, k, 0.0)[:, 3:]
            out["spin", k] = np.linalg.norm(w, axis=1) / frequency
    for k, beam, place, _ in arm.beams():
        qe = result.q[:, place]
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
    """Limits for `Result.check(watch)`, at the output times.

    Attributes:
        limits: by (quantity, link), such as ("rotation", 0), the largest value that is still in range: "rotation"
            (rad), "strain" (1/m), "top" (share of the energy in the highest modes), "spin" (over the first frequency).
        frequency: the arm's first one with joints locked (rad/s).
    """

    limits: Mapping[tuple[str, int], float]
    frequency: float = field(default=np.nan)

    @staticmethod
    def usual(arm: Arm) -> Watch:
        """Limits of an arm that no plan was made for: energy in the highest modes, and the speed of turning where a
        beam has order 0 or 1, which know nothing of stiffening."""
        limits = {}
        for k, beam, *_ in arm.beams():
            if beam.basis != "legendre":  # whose polynomials are no modes
                limits["top", k] = _DEFAULTS["top"]
            if beam.order in (0, 1):
                limits["spin", k] = _DEFAULTS["spin"]
        return Watch(limits, first_frequency(arm))

    @staticmethod
    def around(result: Rows, margin: float = 1.5) -> Watch:
        """Limits `margin` times the largest values of a run; below a hundredth of a radian, of a first frequency and of
        the energy, and where the run is but at rest, nothing is said."""
        w = first_frequency(result.arm)
        limits = {}
        for (name, k), values in readings(result.arm, result, w).items():
            least = 0.0 if name == "strain" else 0.01
            limits[name, k] = max(least, margin * float(values.max(initial=0.0)))
        return Watch({key: x for key, x in limits.items() if x > 0.0}, w)

    def left(self, result: Rows) -> list[RangeWarning]:
        """A warning for each quantity that has left its range, in the order of time."""
        found = []
        limits = {(name, result.arm._link(k)): limit for (name, k), limit in self.limits.items()}
        for (name, k), values in readings(result.arm, result, self.frequency).items():
            limit = limits.get((name, k), np.inf)
            past = np.flatnonzero(~(values <= limit))
            if past.size:
                value, time = float(values.max()), float(result.t[past[0]])
                unit, said, remedy = KINDS[name]
                what = f"{said.format(value)}, beyond its limit of {limit:.3g}, from t = {time:.6g} s on"
                finding = Finding(result.arm.names[k], what, value, limit, unit, remedy)
                found.append(RangeWarning(finding, link=k, time=time))
        return sorted(found, key=lambda x: x.time)


def check(result: Rows, watch: Watch | None = None) -> Findings:
    """Possible improvements: a list of findings, which prints one on a line, the warnings of the run first. Then
    numbers of the arm that are probably mistakes; too few shape functions; energy in the highest modes; turning
    too fast for orders 0 and 1; motions beyond the `torque_limit` of a joint; steps of "ida" that follow modes
    which hardly move the arm; an estimated error above 1 % of the span of the quantity, and its remedy. A
    result of a file does not know its drives and loads.

    Args:
        watch: limits of your own, such as `economize(...).watch`, in place of those of energy and turning.
    """
    if watch is not None:
        instance("watch", watch, Watch)
    arm, source, wrong = result.arm, result._source, [x.finding for x in result._wrong]
    rows = result.t, result.q, result.v
    drive, control, tau = ({}, (), None) if source is None else (source.setup.drive, source.setup.control, source.tau)
    if not len(result.q) or not all(np.isfinite(x).all() for x in rows):  # a run that failed, or kept no states
        return Findings([*wrong, *mistakes(arm), *coarse(arm, drive, control, tau)])
    if not any(isinstance(x, RangeWarning) for x in result._wrong) and (beyond := worst_range(arm, *rows[:2])):
        wrong.append(range_warning(arm, beyond).finding)
    left = (watch or Watch.usual(arm)).left(result)
    found = [*wrong, *mistakes(arm), *coarse(arm, drive, control, tau, result.loads, rows), *(x.finding for x in left)]
    if result._error is not None:
        estimate = result._error[1]
        refused = isinstance(estimate, ValueError)
        found += [Finding("error", f"is not known: {estimate}")] if refused else estimate.findings()
    if source is not None:
        moved = [arm.joint_rate(key) for key, law in drive.items() if isinstance(law, Motion)]
        found += _beyond_motor(arm, result, moved)
        if arm.contacts:
            found += _in_contacts(result, getattr(source.integrator, "step", None) or 0.0)
        if source.integrator.name == "ida":
            found += short_steps(arm, int(result.stats.get("steps", 0)), float(np.ptp(result.t)))
    return Findings(found)
