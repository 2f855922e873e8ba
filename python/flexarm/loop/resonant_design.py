"""Positive position feedback and integral resonant control of one mode, chosen by the arm's linear model."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .._check import between, instance, whole
from ..analysis.equilibrium import balanced
from ..analysis.modes import small_motions
from ..model.acting.compensators import IRC, PPF
from ..model.acting.control import force_columns, listed, measured_rows
from ..model.acting.motor import Motor
from ..model.parts.chain import Chain

_OPPOSITE = 1e-3  # parts of the largest share that one of the other sign may be


class _Seen(NamedTuple):
    """A mode as one actuator and one measurement see it: its frequency (rad/s), its part of the loop's static gain, the
    static y by u, and y at rest."""

    frequency: float
    own: float
    static: float
    y: float


def _seen(
    arm: Chain, q: ArrayLike | None, measure: Sequence[Any], actuate: Sequence[Any], lock: Iterable[Any] | None,
    mode: int | None, share: float,
) -> _Seen:  # fmt: skip
    """Raises ValueError where no gain is known to be stable, or the mode is not there."""
    instance("arm", arm, Chain, "an Arm").refuse_loops("ppf, irc: arm", rigid=True)
    between("share", share, 0, 1, ", where the loop is unstable")
    for name, value in (("measure", measure), ("actuate", actuate)):
        if len(listed(name, value)) != 1:
            raise ValueError(f"{name} = {value!r}: must be a list of one entry")
    at = balanced(arm, q, None, arm.movable)
    column = force_columns(arm, actuate)[0]
    row, by_v = (x[0] for x in measured_rows(arm, measure))
    if by_v.any():
        raise ValueError(f"measure = {measure!r}: must be a place, a strain, a charge or a patch voltage, no rate")
    held = [k for k in arm.movable if not column[arm.joint_rates(k)].any()] if lock is None else lock
    found = small_motions(arm, at, None, held)
    modes = found.undamped()
    shapes = modes.shapes / np.sqrt(np.einsum("ik,ij,jk->k", modes.shapes, found.mass, modes.shapes))
    y = row @ arm._core.rates(at, np.zeros(arm.nv))[2] @ shapes
    w2, residues = modes.frequencies**2, y * (column @ shapes)
    loose = w2 == 0.0
    if np.abs(residues[loose]).max(initial=0.0) > 1e-9 * np.abs(residues).max():
        raise ValueError("lock: measure and actuate share a motion that nothing holds; lock its joint")
    shares = np.where(loose, 0.0, residues / np.where(loose, 1.0, w2))
    static = float(shares.sum())
    largest = float(np.abs(shares).max())
    if largest == 0.0:
        raise ValueError("measure, actuate: share no mode: no mode that one moves is seen by the other")
    if (np.sign(static) * shares).min() < -_OPPOSITE * largest:
        raise ValueError(
            "measure, actuate: are not collocated: modes answer with both signs, and no gain is sure to be stable; "
            "give LinearController.ppf or .irc one, and look at its closed loop"
        )
    order = np.flatnonzero(~loose)
    chosen = int(np.abs(shares).argmax()) if mode is None else -1
    if mode is not None:
        if not 0 <= whole("mode", mode) < order.size:
            raise ValueError(f"mode = {mode}: must be from 0 to {order.size - 1}")
        chosen = int(order[mode])
    if abs(shares[chosen]) < 1e-9 * largest:
        raise ValueError(f"mode = {mode}: is not reached by actuate, or not seen by measure")
    return _Seen(float(w2[chosen]) ** 0.5, share * float(shares[chosen]) / static, static, float(row @ at))


def ppf(
    arm: Chain, q: ArrayLike | None = None, *, measure: Sequence[Any], actuate: Sequence[Any] = (-1,),
    mode: int | None = None, share: float = 0.3, lock: Iterable[Any] | None = None, rate: float | None = None,
    delay: float = 0.0, limit: float | None = None, motor: Motor | None = None,
) -> PPF:  # fmt: skip
    """Positive position feedback for one mode of an arm at rest: see `LinearController.ppf`. Stable for all modes,
    because its static gain is `share` of the stability limit (Fanson & Caughey, AIAA Journal 28, 1990). Of the mode
    alone, with its part a of that share, frequency w / sqrt(1 - a) and damping ratio sqrt(a) give both pairs of poles
    the damping ratio sqrt(a / (1 - a)) / 2, the most there is.

    Args:
        arm: the arm.
        q: where its joints are (nq,), `arm.zero` if None; elastic coordinates are put into static balance.
        measure, actuate: lists of one entry, collocated, as of LinearController; of a joint, a strain, a charge or a
            patch voltage.
        mode: which, from 0, of those with `lock` held; None: the one with the largest share of the static y by u.
        share: of the static gain at which the loop is unstable, above 0, below 1.
        lock: joints that are held; None: all that `actuate` does not move.
        rate, delay, limit, motor: as of LinearController; they are not part of the design.

    Raises:
        ValueError: measure and actuate that are not collocated, a mode that is not seen, a motion that nothing holds.
    """
    seen = _seen(arm, q, measure, actuate, lock, mode, share)
    gain = share / seen.static / (1.0 if motor is None else motor.gain)
    return PPF(seen.frequency / (1.0 - seen.own) ** 0.5, seen.own**0.5, gain, measure=measure, actuate=actuate,
               rate=rate, reference=seen.y, delay=delay, limit=limit, motor=motor)  # fmt: skip


def irc(
    arm: Chain, q: ArrayLike | None = None, *, measure: Sequence[Any], actuate: Sequence[Any] = (-1,),
    mode: int | None = None, share: float = 0.5, lock: Iterable[Any] | None = None, rate: float | None = None,
    delay: float = 0.0, limit: float | None = None, motor: Motor | None = None,
) -> IRC:  # fmt: skip
    """Integral resonant control that damps modes of an arm at rest: see `LinearController.irc`.

    Its feedthrough is the static y by u over `share`, so that it is stable for all modes (Aphale, Fleming & Moheimani,
    Smart Materials and Structures 16, 2007); its gain damps one mode most. Of that alone, at w and with its part a of
    that share, the zero is at z = w sqrt(1 - a) and the damping ratio (w / z - 1) / 2 (A. Preumont, Vibration Control
    of Active Structures, 2011, ch. 6: the locus of integral force feedback is the same).

    Args:
        arm, q, measure, actuate, mode, share, lock, rate, delay, limit, motor: as of `fa.ppf`.

    Raises:
        ValueError: as of `fa.ppf`.
    """
    seen = _seen(arm, q, measure, actuate, lock, mode, share)
    feedthrough = seen.static / share
    gain = seen.frequency / (1.0 - seen.own) ** 0.25 / feedthrough
    per = 1.0 if motor is None else motor.gain
    return IRC(gain / per, feedthrough * per, measure=measure, actuate=actuate, rate=rate, reference=seen.y,
               delay=delay, limit=limit, motor=motor)  # fmt: skip
