"""Derivatives by parameters of the time and the state of an event, where its value g(t, q, v) is zero."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._check import Array
from .problem import Problem
from .result import Result

EVENTS = ("t_events", "q_events", "v_events")
_STEP = 1e-5  # of the differences of an event's value, in parts of its argument, if that is above 1


@dataclass
class Occurrence:
    """Of event number `event` at t, q and v, which go on at the rates dq and dv."""

    run: Problem
    event: int
    t: float
    q: Array
    v: Array
    dq: Array
    dv: Array

    def slopes(self) -> tuple[Array, Array, float]:
        """Derivatives of the event's value by q and v, and by time along the run."""
        g, n = self.run.events[self.event].value, len(self.q)
        at = np.concatenate([[self.t], self.q, self.v])
        by = np.zeros(at.size)
        for k, x in enumerate(at):
            h = _STEP * max(1.0, abs(x))
            ends = []
            for end in (x + h, x - h):
                moved = at.copy()
                moved[k] = end
                ends.append(float(g(float(moved[0]), moved[1 : n + 1], moved[n + 1 :])))
            by[k] = (ends[0] - ends[1]) / (2 * h)
        by_q, by_v = by[1 : n + 1], by[n + 1 :]
        return by_q, by_v, float(by[0] + by_q @ self.dq + by_v @ self.dv)

    def moved(self, q: Array, v: Array, value: Array) -> tuple[int, Array, Array, Array]:
        """The event's number, and derivatives of its time (np), coordinates and rates (np, nv), from those of the state
        at its time, and of the event's value in one state (np)."""
        by_q, by_v, rate = self.slopes()
        with np.errstate(divide="ignore", invalid="ignore"):  # a value that only touches zero
            t = -(q @ by_q + v @ by_v + value) / rate
        return self.event, t, q + np.outer(t, self.dq), v + np.outer(t, self.dv)


@dataclass
class Cubic(Occurrence):
    """One on the cubics through the rows `before` and `after` of a tape, `number` being that of the occurrence. Factors
    of (q0, v0, q1, v1) in q, and of (v0, a0, v1, a1) in v."""

    number: int
    before: int
    after: int
    factors: Array
    prescribed: list[int]

    def through(self, rows: Mapping[str, Array]) -> tuple[Array, Array]:
        """q and v there of rows (..., rows, nv)."""

        def at(x: Array, slope: Array) -> Array:
            ends = np.array([of[..., row, :] for row in (self.before, self.after) for of in (x, slope)])
            found: Array = np.tensordot(self.factors, ends, 1)
            return found

        return at(rows["q"], rows["v"]), at(rows["v"], rows["a"])

    def weighed(self, weights: Mapping[str, Any]) -> tuple[Cubic, Array, Array, float]:
        """This, and derivatives of a number by the state at its time and by the event's value, from those by events."""
        zero: list[Any] = [0.0, np.zeros(self.q.size), np.zeros(self.v.size)]
        t, q, v = [weights[name][self.event][self.number] if name in weights else nothing
                   for name, nothing in zip(EVENTS, zero, strict=True)]  # fmt: skip
        by_q, by_v, rate = self.slopes()
        along = (t + q @ self.dq + v @ self.dv) / rate
        return self, q - along * by_q, v - along * by_v, -float(along)

    def share(self, q: Array, v: Array, rows: Mapping[str, Array]) -> None:
        """Adds derivatives by the state there to those by rows."""
        q, v, n = q.copy(), v.copy(), len(q)
        q[self.prescribed] = v[self.prescribed] = 0.0  # their motion is not in the rows
        for state, slope, by in (("q", "v", q), ("v", "a", v)):
            for k, row in enumerate((self.before, self.after)):
                rows[state][row, :n] += self.factors[2 * k] * by
                rows[slope][row, :n] += self.factors[2 * k + 1] * by


def cubics(run: Problem, tape: Any, result: Result) -> Iterator[Cubic]:
    """The occurrences of a run with a tape, as they came."""
    nv, counts = run.arm.nv, [0] * len(run.events)
    if tape.occurrences and run.arm.nq != nv:
        raise ValueError('events: of an arm with a ball they have derivatives with "ida" alone')
    state = {"q": tape.q, "v": tape.v, "a": tape.a}
    for event, t, before, after in tape.occurrences:
        i, j = tape.points[before], tape.points[after]
        h = tape.t[j] - tape.t[i]
        x = (t - tape.t[i]) / h
        y = 1.0 - x
        factors = np.array([y * y * (1 + 2 * x), y * y * x * h, x * x * (1 + 2 * y), -x * x * y * h])
        rates = np.array([-6 * x * y / h, y * (y - 2 * x), 6 * x * y / h, x * (x - 2 * y)])
        number = counts[event]
        counts[event] += 1
        q, v = (getattr(result, name)[event][number] for name in EVENTS[1:])
        at = Cubic(run, event, t, q, v, v, v, number, i, j, rates, run.prescribed)
        dq, dv = (d[:nv] for d in at.through(state))
        for drive in run.drives:
            if drive.moves:
                _, dq[drive.rate], dv[drive.rate] = drive.law(t)
        yield Cubic(run, event, t, q, v, dq, dv, number, before, after, factors, run.prescribed)


def rows_of(tape: Any) -> Array:
    """Numbers of the rows of a tape that are the result's."""
    others = [row for _, _, *rows in tape.occurrences for row in rows]
    return np.setdiff1d(np.arange(len(tape.points)), others)


def by_event(occurred: Sequence[tuple[int, Array, Array, Array]], result: Result, count: int) -> dict[str, list[Array]]:
    """Derivatives of t_events, q_events and v_events by `count` parameters, (count, n, ...)."""
    out: dict[str, list[Array]] = {name: [] for name in EVENTS}
    for k in range(len(result.t_events or ())):
        mine = [parts for event, *parts in occurred if event == k]
        for part, name in enumerate(EVENTS):
            like = getattr(result, name)[k]
            found = np.zeros((count, *like.shape))
            for n, parts in enumerate(mine):
                found[:, n] = parts[part]
            out[name].append(found)
    return out
