"""What batches of fixed steps are given: times of steps, and laws of time sampled at half steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import flexarm._core as _core

from .._check import Array, array, number, whole
from ..acting.control import control_laws
from ..acting.drive import Motion
from ..acting.following import kinks_of
from ..acting.load import Load
from ..arm import Arm
from ..run.pulses import tell_missed

_SAME = 1e-6  # parts of a step by which two times are still one, as the integrators have it
_MOST = 100_000_000  # steps
STEP_BYTES = 100  # of a step's times, here and in the core


@dataclass
class Schedule:
    """The steps of a batch.

    Attributes:
        lengths: (n,), s. ends: times at which they end, and before them the start's, (n + 1,).
        hold: (n,), which row of forces is held over each step.
        rows: steps behind which a row is written.
        halves: times at the start, in the middle and at the end of each step, (2 n + 1,).
    """

    lengths: Array
    ends: Array
    hold: NDArray[np.int64]
    rows: NDArray[np.int64]
    halves: Array

    @staticmethod
    def uniform(step: float, nstep: int, every: int, held: bool) -> Schedule:
        """Equal steps, from t = 0."""
        step, every = number("step", step), whole("every", every)
        if not 0.0 < step < np.inf:
            raise ValueError(f"step = {step}: must be positive and finite, in seconds")
        check_every(every, nstep)
        hold = np.arange(nstep) if held else np.zeros(nstep, int)
        return Schedule(
            np.full(nstep, step), step * np.arange(nstep + 1, dtype=float), hold, np.arange(0, nstep + 1, every),
            0.5 * step * np.arange(2 * nstep + 1, dtype=float),
        )  # fmt: skip

    @staticmethod
    def between(t: Array, step: float, every: int, held: bool) -> Schedule:
        """Steps of at most `step` that meet every time of t; what lies between two is divided equally."""
        check_every(every, t.size - 1)
        spans = np.diff(t)
        if spans.sum() / step > _MOST:
            raise ValueError(f"step = {step}: asks for {spans.sum() / step:.3g} steps; at most {_MOST:g}")
        counts = np.maximum(1, np.ceil(spans / step - _SAME)).astype(int)
        total = int(counts.sum())
        interval = np.repeat(np.arange(spans.size), counts)
        within = np.arange(total) - np.repeat(np.cumsum(counts) - counts, counts)
        lengths = (spans / counts)[interval]
        begin = t[interval] + within * lengths
        ends = np.append(t[0], begin + lengths)
        stops = np.cumsum(counts)
        ends[stops] = t[1:]
        halves = np.empty(2 * total + 1)
        halves[0::2], halves[1::2] = ends, begin + 0.5 * lengths
        rows = np.append(0, stops)[::every]
        return Schedule(lengths, ends, interval if held else 0 * interval, rows, halves)

    def meets(self, breaks: Array) -> bool:
        """Whether steps end at all these times that lie between the first and the last."""
        inside = breaks[(breaks > self.ends[0]) & (breaks < self.ends[-1])]
        k = np.clip(np.searchsorted(self.ends, inside), 1, self.ends.size - 1)
        off = np.minimum(np.abs(self.ends[k] - inside), np.abs(self.ends[k - 1] - inside))
        return bool((off <= _SAME * self.lengths.min()).all())


def check_every(every: int, nstep: int) -> None:
    if not 1 <= every <= nstep:
        raise ValueError(f"every = {every}: must be from 1 to the number of steps, {nstep}")


def _pieces(law: _core.PiecewisePolynomial, t: Array) -> Array:
    """Value and two derivatives (n, 3), by the scheme of the core."""
    breaks, c = law.breaks, law.coefficients
    k = np.clip(np.searchsorted(breaks, t, side="right") - 1, 0, c.shape[1] - 1)
    x = t - breaks[k]
    q, v, a = np.zeros_like(t), np.zeros_like(t), np.zeros_like(t)
    for row in c:  # Horner, with both derivatives
        a = a * x + 2.0 * v
        v = v * x + q
        q = q * x + row[k]
    return np.stack([q, v, a], axis=1)


def sampled(where: str, law: Any, t: Array, width: int) -> Array:
    """(n, width) values of a law at the times t; (1, width) of one that is constant."""
    if isinstance(law, _core.PiecewisePolynomial):
        if law.coefficients.shape == (1, 1):
            t = t[:1]
        return np.ascontiguousarray(_pieces(law, t)[:, :width])
    values = [array(f"{where} at t = {x}", law(x), (3,) if width == 3 else ()) for x in t.tolist()]
    table = np.array(values).reshape(-1, width)
    tell_missed(where, law, t, table)
    return table


def wrench_table(where: str, load: Load, t: Array) -> Array:
    """(n, 6) values of a load at the times t; (1, 6) of one that is constant."""
    t = t[:1] if load.constant else t
    if isinstance(load.law, tuple):
        return np.stack([_pieces(part, t)[:, 0] for part in load.law], axis=1)
    table = np.array([array(f"{where} at t = {x}", load.law(x), (6,)) for x in t.tolist()])
    tell_missed(where, load.law, t, table)
    return table


def breaks_of(law: Any) -> Array:
    """Times that no step may pass over."""
    if isinstance(law, Load):
        return np.zeros(0) if law.constant or not isinstance(law.law, tuple) else law.law[0].breaks
    if isinstance(law, _core.PiecewisePolynomial):
        return np.zeros(0) if law.coefficients.shape == (1, 1) else kinks_of(law)
    return np.zeros(0)


def motion_table(where: str, value: Motion | ArrayLike, schedule: Schedule) -> Array:
    """(B or 1, 2 n + 1, 3)."""
    n = schedule.halves.size
    if isinstance(value, Motion):
        value.check_span(where, schedule.ends)
        return sampled(where, value.law, schedule.halves, 3)[None]
    a = array(where, value, batch_ndim=3)
    if a.ndim not in (2, 3) or a.shape[-2:] != (n, 3) or not len(a):
        raise ValueError(f"{where} has shape {a.shape}: must be a Motion, or q, v, a at half steps: ({n}, 3)")
    return a if a.ndim == 3 else a[None]


def stacked(tables: Sequence[Array]) -> Array:
    """(B or 1, times, n) of the tables (times or 1, n) of all scenarios, or of one where they are all alike."""
    if all(x is tables[0] or np.array_equal(x, tables[0]) for x in tables):
        return tables[0][None]
    times = max(len(x) for x in tables)
    return np.ascontiguousarray(np.stack([np.broadcast_to(x, (times, x.shape[1])) for x in tables]))


def feedback_tables(
    arms: Sequence[Arm], controls: Sequence[Any], schedule: Schedule, prescribed: list[int]
) -> list[Any]:
    """(column, by_q, by_v, reference, limit) tables of each continuous law, for arms and controls of all scenarios."""
    if all(c is None or (isinstance(c, (list, tuple)) and not c) for c in controls):
        return []
    count = max(len(arms), len(controls))
    made: dict[tuple[int, int], list[list[Array]]] = {}
    references: dict[Any, list[Array]] = {}  # of each control, whatever the arm, where it may be
    found = []
    for i in range(count):
        arm, control = arms[i % len(arms)], controls[i % len(controls)]
        key = (id(arm), id(control))
        if key not in made:
            made[key] = _law_tables(arm, control, schedule, prescribed, references)
        found.append(made[key])
        if len(found[i]) != len(found[0]):
            raise ValueError(f"control of scenario {i}: has {len(found[i])} laws; must have {len(found[0])}, as others")
    return [tuple(stacked([f[k][j] for f in found]) for j in range(5)) for k in range(len(found[0]))]


def _law_tables(
    arm: Arm, control: Any, schedule: Schedule, prescribed: list[int], references: dict[Any, list[Array]]
) -> list[list[Array]]:
    feedback, samplers, memory = control_laws(arm, control, schedule.ends, (), prescribed)
    if samplers or memory:
        raise ValueError(
            "control: must be continuous and without memory (PD, StrainFeedback, StateFeedback, FeedForward)"
        )
    all_of = control if isinstance(control, (list, tuple)) else [control]
    key = (id(control), id(arm) if any(c.of_arm for c in all_of) else 0)
    if key not in references:
        laws = [f.reference for f in feedback]
        references[key] = [
            np.zeros((1, 1)) if law is None else sampled("reference", law, schedule.halves, 1) for law in laws
        ]
    return [
        [f.column[None], f.by_q[None], f.by_v[None], reference, np.array([[f.limit]])]
        for f, reference in zip(feedback, references[key], strict=True)
    ]
