"""Whether "ida" crawls, and after what; and whether "rk4" takes steps that are too long."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from .._check import Array, outside
from ..analysis.modes import motions_about, small_motions
from ..arm import Arm
from ..parts.beam import STRAINS

_HASTY = 20  # so many switches of one joint within a step of another may be: it turns, or is torn loose again
_FEW, _OFTEN = 30, 0.1  # so many steps, and that part of all, may be halved: a pulse or a start costs some
_BLOWN = 20.0  # logarithm of a growth that makes rounding errors felt
_TURNED = 0.3  # step times rate of a joint: less of it changes the limit of rk4's steps by less than a hundredth
_AS_FAST = 0.9  # of a run's largest rate: rates that are like it
_UNRESOLVED = 3.0  # step times frequency: a step is half a period
_LOUD = 1e-6  # of the energy of what steps follow: what they do not follow, and is louder, stops an iteration
_MANY = 2e5  # steps of a whole run, from which on it is looked at what they follow
_ENDLESS = 2e7  # steps that are too many, whatever they follow
_APART = 300.0  # parts of the lowest frequency: modes beyond are hardly what a run is about
_FOLLOWED = (0.003, 20.0)  # step times frequency of a mode that holds the steps down


class SlowWarning(UserWarning):
    """"ida" takes very many steps.

    Attributes:
        time: reached (s). steps: taken so far. expected: steps of the whole run, if it goes on so.
        frequency: the highest that it follows (rad/s); nan where no vibration explains the steps.
        step: that "implicit" may take instead (s); nan where no mode can be stepped over.
    """

    def __init__(
        self, message: str, time: float, steps: int, expected: float, frequency: float = np.nan, step: float = np.nan
    ) -> None:
        super().__init__(message)
        self.time, self.steps, self.expected, self.frequency, self.step = time, steps, expected, frequency, step

    def __reduce__(self) -> Any:
        return type(self), (str(self), self.time, self.steps, self.expected, self.frequency, self.step)


class StepWarning(UserWarning):
    """Steps are too long: those of "rk4" are above its limit, and what oscillates fast has grown, and may be all that
    is left of the motion; or dry friction switches again and again within a step; or many steps of "gauss" had to be
    halved.

    Attributes:
        step: the one given (s). growth: of the fastest motion, by one step of "rk4"; else nan.
    """

    def __init__(self, message: str, step: float, growth: float) -> None:
        super().__init__(message)
        self.step, self.growth = step, growth

    def __reduce__(self) -> Any:
        return type(self), (str(self), self.step, self.growth)


def explicit_limit(
    arm: Arm, step: float, q: Array, held: Sequence[int], v: Array | None = None
) -> tuple[str, float]:
    """Words the limit of rk4's steps, of small motions of all rates but those `held`, about rest with the joints as in
    q, or about a motion at rates v; stuck joints are free to slide. And how much the fastest grows by one step. "" and
    1.0 if these steps are below it."""
    free = ~np.isin(np.arange(arm.nv), held)
    if not free.any():
        return "", 1.0
    q = np.array(q)
    try:
        if v is None:
            q[[arm.coordinate_of(i) for i in _elastic(arm)]] = 0.0
            motions = small_motions(arm._made(arm.links), q)
        else:
            motions = motions_about(arm._made(arm.links), q, v)
        M, G, K = (X[np.ix_(free, free)] for X in (motions.M, motions.G, motions.K))
        modes = replace(motions, free=free, M=M, G=G, K=K).solve()
    except ValueError:
        return "", 1.0
    bound = modes.frequencies > 0.0  # all else is not pulled back
    s, shapes = modes.eigenvalues[bound], modes.shapes[free][:, bound]
    if not s.size:
        return "", 1.0
    s, w = np.minimum(s.real, 0.0) + 1j * s.imag, np.abs(s)
    low, high = np.full(s.size, 2.0), np.full(s.size, 4.0)  # of step times |s|: between them rk4 begins to amplify
    for _ in range(40):
        middle = (low + high) / 2.0
        grows = _growth(middle * s / w) > 1.0
        low, high = np.where(grows, low, middle), np.where(grows, middle, high)
    k = int((low / w).argmin())
    if step * w[k] <= low[k]:
        return "", 1.0
    pull = (np.abs(np.diag(K)) + w[k] * np.abs(np.diag(G))) * np.abs(shapes[:, k]) ** 2
    most = arm.coordinates[np.flatnonzero(free)[pull.argmax()]]
    return f", here {w[k]:.3g} rad/s of {most}: below {low[k] / w[k]:.3g} s", float(_growth(step * s).max())


def _growth(z: Any) -> Array:
    """Of a motion e^(s t), by a step of rk4 with z = s step."""
    grown: Array = np.abs(1.0 + z * (1.0 + z / 2.0 * (1.0 + z / 3.0 * (1.0 + z / 4.0))))
    return grown


def beyond_explicit(
    arm: Arm, step: float, span: float, q: Array, held: Sequence[int], rows: tuple[Array, Array, Array] | None = None
) -> StepWarning | None:
    """Warns where steps of rk4 above their limit (see explicit_limit) have made rounding errors felt in a run of `span`
    (s): the limit about rest, or in rows (t, q, v) of the run that of the row at which its joints move fastest."""
    limit, growth = explicit_limit(arm, step, q, held)
    when = ""
    if rows is not None and len(rows[0]) > 1 and not np.log(growth) * span / step >= _BLOWN:
        t, qs, v = rows
        joints = np.setdiff1d(np.arange(arm.nv), _elastic(arm))
        speed = np.abs(v[:, joints]).max(axis=1, initial=0.0)
        k = int(speed.argmax())
        if step * speed[k] > _TURNED:
            limit, growth = explicit_limit(arm, step, qs[k], held, v[k])
            span = float(np.gradient(t)[speed > _AS_FAST * speed[k]].sum())
            when = f" at t = {t[k]:.4g} s, where the joints move at up to {speed[k]:.3g} rad/s or m/s,"
    if np.log(growth) * span / step < _BLOWN:
        return None
    return StepWarning(
        f'integrator = "rk4", step = {step:g}: is{when} above 2.83 over the highest frequency{limit}; what moves so '
        f"fast grows {growth:.3g} times in every step",
        step, growth,
    )  # fmt: skip


def hasty(integrator: str, step: float, switches: int, count: int) -> StepWarning | None:
    """Warns where `count` of the switches of dry friction came within a step (three of "rk4") behind one of the same
    joint: the joint follows a vibration that the steps do not resolve."""
    if count <= _HASTY:
        return None
    return StepWarning(
        f'integrator = "{integrator}", step = {step:g}: dry friction switched {switches} times, {count} of them within '
        f"{'three steps' if integrator == 'rk4' else 'a step'} behind another of the same joint: the joint follows a "
        'vibration too fast for the step, and the motion may be wrong; take a smaller step, or integrator="implicit"',
        step, np.nan,
    )  # fmt: skip


def halved(integrator: str, step: float, stats: Mapping[str, int]) -> StepWarning | None:
    """Warns where steps were halved so often, mostly because their equations could not be solved, that those which
    were not may be too long as well."""
    count, steps = stats["failed_steps"], stats["steps"]
    if not count > max(_FEW, _OFTEN * steps):
        return None
    return StepWarning(
        f'integrator = "{integrator}", step = {step:g}: steps had to be halved {count} times, in {steps} steps: '
        "those that were not may be too long as well, and the motion wrong; compare it with a run of a smaller step",
        step, np.nan,
    )  # fmt: skip


def unbalanced(arm: Arm, prescribed: Sequence[int], a: Array, step: float) -> str:
    """What a message goes on with where a run begins with accelerations a (nv,) out of balance: what rings, too fast
    for the steps; else ""."""
    joints = {k: arm.joint_rates(k, "link") for k, link in enumerate(arm.links) if link.joint.nv}
    try:
        modes = arm._made(arm.links).modes(lock=[k for k, rates in joints.items() if np.isin(rates, prescribed).all()])
    except ValueError:
        return ""
    moving = np.setdiff1d(np.arange(arm.nv), prescribed)
    M, shapes = arm.mass_matrix(arm.zero), np.real(modes.shapes)
    shapes = shapes / np.sqrt(np.einsum("ik,ij,jk->k", shapes, M, shapes))
    w = modes.frequencies
    pushed = shapes[moving].T @ M[np.ix_(moving, moving)] @ a[moving]
    energy = (pushed / np.maximum(w, 1.0 / step)) ** 2  # that a mode rings with, or gains in a step
    fast = np.where(step * w > _UNRESOLVED, energy, 0.0)
    k = int(fast.argmax())
    if not fast[k] > _LOUD * energy[step * w <= _UNRESOLVED].sum(initial=0.0):
        return ""
    most = arm.coordinates[int((np.diag(M) * shapes[:, k] ** 2).argmax())]
    return (
        f"; the start is not in balance: '{most}' begins to ring at {w[k]:.3g} rad/s, which these steps do not follow; "
        'start in balance (q0=arm.equilibrium(...)), or take integrator="gauss"'
    )


def _fast_modes(arm: Arm) -> tuple[Array, Array, str] | None:
    """Frequencies with the joints locked (rad/s), increasing, their damping ratios, and which coordinate moves most in
    the highest mode; None where there are none, or they cannot be told."""
    if arm._fast_modes == ():
        arm._fast_modes = _find_fast_modes(arm)
    found: tuple[Array, Array, str] | None = arm._fast_modes
    return found


def _elastic(arm: Arm) -> list[int]:
    """The rates of the beams."""
    return [i for i, name in enumerate(arm._core.coordinates) if any(s in name for s in STRAINS)]


def _find_fast_modes(arm: Arm) -> tuple[Array, Array, str] | None:
    elastic = _elastic(arm)
    if not elastic:
        return None
    try:
        modes = arm._made(arm.links).modes(lock=[k for k, link in enumerate(arm.links) if link.joint.nv])
    except ValueError:
        return None
    order = np.argsort(modes.frequencies)
    if not modes.frequencies[order[0]] > 0.0:
        return None
    frequencies, shape = modes.frequencies[order], np.abs(modes.shapes[:, order[-1]])
    inertia = np.diag(arm.mass_matrix(arm.zero))  # what of the motion is whose
    most = max(elastic, key=lambda i: inertia[i] * shape[i] ** 2)
    return frequencies, modes.damping[order], arm.coordinates[most]


class Pace:
    """Told now and then how many steps "ida" has taken; warns once.

    Args:
        grown: what to say of control loops, told the time since the start; a warning or None.
    """

    def __init__(self, arm: Arm, times: Array, grown: Callable[[float], Warning | None]) -> None:
        self.arm, self.begin, self.end, self.grown = arm, float(times[0]), float(times[-1]), grown
        self.last, self.warned, self.started = (self.begin, 0), False, time.perf_counter()

    def __call__(self, now: float, steps: int) -> None:
        since, before = self.last
        self.last = now, steps
        if self.warned or steps <= before or now <= since:  # dry friction begins anew, and counts from there
            return
        span, step = self.end - self.begin, (now - since) / (steps - before)
        expected = steps + (self.end - now) / step
        found = self.judge(now, steps, step, expected, span) if expected >= _MANY else None
        if found is not None:
            self.warned = True
            warnings.warn(found, stacklevel=outside())

    def left(self, steps: int, to_come: float) -> str:
        """The time to compute these steps, in words."""
        minutes = (time.perf_counter() - self.started) * to_come / steps / 60.0
        return f"{minutes:.2g} minutes" if minutes < 100.0 else f"{minutes / 60.0:.2g} hours"

    def judge(self, now: float, steps: int, step: float, expected: float, span: float) -> Warning | None:
        loop = self.grown(now - self.begin)
        if loop is not None:
            return loop
        so_far = f'integrator = "ida" has taken {steps} steps for {now - self.begin:.3g} s of {span:.3g} s, '
        modes = _fast_modes(self.arm)
        if modes is not None:
            w, _, name = modes
            slow = w[w < _APART * w[0]]
            fast = w[slow.size :]
            if fast.size and fast[-1] * step > _FOLLOWED[0] and fast[0] * step < _FOLLOWED[1]:
                other = float(f"{0.2 / slow[-1]:.0e}")
                return SlowWarning(
                    f"{so_far}now {step:.2g} s each: they follow modes at {fast[0]:.2g} to {fast[-1]:.2g} rad/s "
                    f"({name}), which hardly move the arm (the first is at {w[0]:.3g}); "
                    f'integrator = "implicit", step = {other:g} steps over them',
                    now, steps, expected, float(fast[-1]), other,
                )  # fmt: skip
        if expected < _ENDLESS:
            return None
        to_come = expected - steps
        if modes is not None and modes[0][-1] * step > _FOLLOWED[0] and modes[0][0] * step < _FOLLOWED[1]:
            fastest = float(modes[0][-1])
            what = (
                f"they follow the vibration of the beams, whose modes reach up to {fastest:.3g} rad/s; a larger "
                f'rtol, or integrator = "gauss" or "implicit" with a step of your choice, takes fewer'
            )
        else:
            fastest, what = np.nan, "look for what changes so fast"
        return SlowWarning(
            f"{so_far}now {step:.2g} s each: {to_come:.1e} steps are to come, {self.left(steps, to_come)} at this "
            f"pace; {what}",
            now, steps, expected, fastest,
        )  # fmt: skip
