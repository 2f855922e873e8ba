"""Whether a run grew because of a control loop: the linear loop at the start of the run, looked at when a run fails, or
has grown."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import flexarm._core as _core

from .._check import Array
from ..acting.control import Feedback, Run, gain_of, measured_rows, padded
from ..acting.load import at_time
from ..acting.sampled import Asked, LinearController, Sampled
from ..parts.chain import Chain
from .linear import solve_mass

_MOST = 400  # states of a linear model that is looked at
_GROWN = 2.0  # logarithm of what a loop must grow by in the time of a run, to be named
_SMALL = 1e-6  # rad, m, and per second: what sensors are moved by to see how they read


class LoopWarning(UserWarning):
    """A control loop is unstable where the run begins, and the run has grown.

    Attributes:
        control: index of the controller. growth: of its fastest growing motion (1/s), for small deviations.
    """

    def __init__(self, message: str, control: int, growth: float) -> None:
        super().__init__(message)
        self.control, self.growth = control, growth

    def __reduce__(self) -> Any:
        return type(self), (str(self), self.control, self.growth)

    def of(self, whom: str) -> LoopWarning:
        """The same, said of one of many."""
        return LoopWarning(f"{whom}: {self}", self.control, self.growth)


def _reads(arm: Chain, c: Any, k: int, q: Array) -> tuple[Array, Array, list[Any], float, float] | None:
    """The derivatives of what a sampled controller reads, about a state at rest: by q and by v; the low pass of each,
    or None; how late it reads (s); and up to where its sensors tell. None where no such linear reading exists: a sensor
    feels accelerations, is slower than the controller, or has a delay of its own."""
    if c.measure is None:
        n = arm.nv
        return np.eye(arm.nq + n, arm.nq), np.eye(arm.nq + n, n, -arm.nq), [None] * (arm.nq + n), 0.0, np.inf
    rows, filters, delays, most = [], [], [], np.inf
    for i, e in enumerate(c.measure):
        if not hasattr(e, "sampler"):
            rows.append(measured_rows(arm, [e], i))
            filters += [None] * len(rows[-1][0])
            delays.append(0.0)
            continue
        if e.needs_a or e.feels_loads or (e.rate is not None and e.rate < c.rate):
            return None
        at = np.concatenate([q, np.zeros(arm.nv)])
        ends = at + _SMALL * np.vstack([np.eye(at.size), -np.eye(at.size)])
        y = e.measure(arm, np.zeros(len(ends)), ends[:, : arm.nq], ends[:, arm.nq :])
        by = (y[: at.size] - y[at.size :]).T / (2.0 * _SMALL)
        rows.append((by[:, : arm.nq], by[:, arm.nq :]))
        filters += [e.filter] * len(by)
        delays.append(e.delay)
        most = most if e.range is None else 0.0  # it may hold the loop
    if len(set(delays)) > 1:
        return None
    by_q, by_v = (np.vstack(x) for x in zip(*rows, strict=True))
    return by_q, by_v, filters, delays[0] if delays else 0.0, most


@dataclass
class _Loop:
    """A sampled linear law of controller `control`: x+ = A x - B y, u = C x - D y, y = rows [theta; v], each behind its
    low pass, if it has one, and `columns` u is its force."""

    control: int
    A: Array
    B: Array
    C: Array
    D: Array
    rows: Array
    filters: list[Any]
    columns: Array
    period: float
    delay: float
    limit: float


@dataclass
class Plant:
    """The arm about a state at rest, without control: its free rates, and [theta; v]' = F [theta; v] + G tau."""

    arm: Chain
    q: Array
    free: Array
    E: Array
    K: Array
    C: Array
    M: Array

    @staticmethod
    def of(arm: Chain, q: Array, prescribed: Sequence[int], loads: Any = ()) -> Plant | None:
        free = np.setdiff1d(np.arange(arm.nv), prescribed)
        if not free.size or 2 * free.size > _MOST:
            return None
        zero = np.zeros(arm.nv)
        by_q, by_v = arm._core.inverse_derivatives(q, zero, zero, *loads)
        E = arm._core.rates(q, zero)[2]
        return Plant(arm, q, free, E, by_q @ E, by_v, arm.mass_matrix(q))

    def matrix(self, feedback: Iterable[Feedback], factor: float = 1.0) -> tuple[Array, Array]:
        """F and G with these continuous laws, their forces `factor` times as large."""
        K, C, n = self.K.copy(), self.C.copy(), self.free.size
        for column, by_q, by_v, *_ in feedback:
            K += factor * np.outer(column, by_q @ self.E)
            C += factor * np.outer(column, by_v)
        at = np.ix_(self.free, self.free)
        by_all = solve_mass(self.M[at], np.hstack([-K[at], -C[at], np.eye(n)]))
        F = np.vstack([np.hstack([np.zeros((n, n)), np.eye(n)]), by_all[:, : 2 * n]])
        return F, np.vstack([np.zeros((n, n)), by_all[:, 2 * n :]])


def _growth(F: Array) -> tuple[float, complex]:
    """The growth of the fastest growing motion of x' = F x (1/s), and its pole."""
    poles = np.linalg.eigvals(F)
    pole = complex(poles[np.argmax(poles.real)])
    return pole.real, pole


def _with_filters(F: Array, G: Array, rows: Array, filters: Sequence[Any]) -> tuple[Array, Array, Array]:
    """x' = F x + G u and y = rows x, with the states of the low passes that parts of y go through behind x."""
    rows = rows.copy()
    for k, f in enumerate(filters):
        if f is not None:
            (A, B), n = f.matrices(), F.shape[0]
            F = np.block([[F, np.zeros((n, len(A)))], [np.outer(B, rows[k]), A]])
            G, rows = np.pad(G, ((0, len(A)), (0, 0))), np.pad(rows, ((0, 0), (0, len(A))))
            rows[k] = np.eye(F.shape[0])[n]
    return F, G, rows


class _Sampling:
    """The arm (x' = F x + G tau) between the samples of laws with one period and delay, each with forces held."""

    def __init__(self, F: Array, G: Array, loops: Sequence[_Loop]) -> None:
        import scipy.linalg as la  # slow to import

        self.period = loops[0].period
        self.A, self.B, self.C, self.D = (la.block_diag(*(getattr(loop, name) for loop in loops)) for name in "ABCD")
        rows, columns = np.vstack([x.rows for x in loops]), G @ np.hstack([x.columns for x in loops])
        F, columns, self.rows = _with_filters(F, columns, rows, [f for x in loops for f in x.filters])
        n = F.shape[0]
        late, rest = divmod(loops[0].delay / self.period, 1.0)
        self.late, nu = int(late), columns.shape[1]
        halves = []
        for span in (rest * self.period, (1.0 - rest) * self.period):
            whole = la.expm(span * np.block([[F, columns], [np.zeros((nu, n + nu))]]))
            halves.append((whole[:n, :n], whole[:n, n:]))
        (first, before), (last, self.after) = halves
        self.free, self.before = last @ first, last @ before

    def growth(self, factor: float = 1.0) -> tuple[float, complex]:
        """The growth of the fastest growing motion (1/s) with forces `factor` times as large, and its pole from sample
        to sample."""
        n, nx, nu = len(self.free), len(self.A), self.after.shape[1]
        # state: the arm's, the laws', and the outputs of the last late + 1 samples, the newest first
        count = self.late + 1
        Z = np.zeros((n + nx + count * nu,) * 2)
        y, x = slice(0, n), slice(n, n + nx)
        u = [slice(n + nx + k * nu, n + nx + (k + 1) * nu) for k in range(count)]
        by_y = -self.D @ self.rows  # of the output of this sample
        Z[y, y] = self.free
        if self.late == 0:
            Z[y, y] += factor * self.after @ by_y
            Z[y, x] += factor * self.after @ self.C
        else:
            Z[y, u[self.late - 1]] += factor * self.after
        Z[y, u[self.late]] += factor * self.before
        Z[x, y], Z[x, x], Z[u[0], y], Z[u[0], x] = -self.B @ self.rows, self.A, by_y, self.C
        for k in range(1, count):
            Z[u[k], u[k - 1]] = np.eye(nu)
        poles = np.linalg.eigvals(Z)
        pole = complex(poles[np.argmax(np.abs(poles))])
        return float(np.log(max(abs(pole), 1e-300))) / self.period, pole


def _sampled_loops(arm: Chain, controls: Sequence[Any], samplers: Sequence[Any], plant: Plant) -> list[_Loop]:
    """The loops of those sampled controllers that are linear, or have been so in this run."""
    found, laws = [], (s for s in samplers if isinstance(s[3], (Asked, _core.LinearLaw)))
    n, total = arm.nv, plant.arm.nv
    for k, c in enumerate(controls):
        if not isinstance(c, Sampled) or c.memory or getattr(c, "continuous", False):
            continue
        _, period, delay, law = next(laws)
        reads = _reads(arm, c, k, plant.q[: arm.nq])
        seen = (c.A, c.B, c.C, c.D) if isinstance(c, LinearController) else law.seen.law()
        if reads is None or seen is None:
            continue
        by_q, by_v, filters, late, most = reads
        A, B, C, D = seen
        E = plant.E[: arm.nq, :n]
        rows = np.zeros((len(by_q), 2 * total))
        rows[:, :n], rows[:, total : total + n] = by_q @ E, by_v
        columns = np.zeros((total, len(C)))
        columns[:n] = gain_of(c.motor) * np.array(c._columns(arm)).T
        keep = np.concatenate([plant.free, total + plant.free])
        found.append(_Loop(k, A, B, C, D, rows[:, keep], filters, columns[plant.free], period, delay + late,
                           c.limit if most else 0.0))  # fmt: skip
    return found


def _continuous(
    arm: Chain, both: Chain, controls: Sequence[Any], times: Array, loads: Any
) -> list[tuple[int, Feedback]]:
    """Laws without samples, each with the index of its controller."""
    found: list[tuple[int, Feedback]] = []
    first, total = 0, both.nv - arm.nv
    for k, c in enumerate(controls):
        for column, by_q, by_v, *rest in c._laws(arm, Run(times, loads, first, total))[0]:
            found.append((k, (padded(column, both.nv), padded(by_q, both.nq), padded(by_v, both.nv), *rest)))
        first += c.memory
    return found


def _remedy(growth: Any, limit: float) -> str:
    """growth(factor) of the gains: what factor makes it stable, in words."""
    for share in np.geomspace(1.0, 1e-3, 19)[1:]:
        if growth(share) > limit:
            continue
        low, high = share, share * 1.468
        for _ in range(8):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if growth(middle) <= limit else (low, middle)
        return f"it is stable with its gains below {low:.2g} of what they are"
    if growth(-1.0) <= limit:
        return "with the other sign of its gains it is stable"
    return "no share of its gains down to 0.001 makes it stable"


def unstable(
    arm: Chain, both: Chain, q: Array, prescribed: Sequence[int], times: Array, loads: Any, controls: Sequence[Any],
    samplers: Sequence[Any], time: float, failed: bool,
) -> LoopWarning | None:  # fmt: skip
    """The warning that the loops of a run deserve which has grown in `time` (s); None where they are stable at its
    start, or are not linear. A loop that a limit may hold is not named unless the run has `failed`.

    Args:
        both: the arm with the states of continuous controllers; q: the start, of both.
        times, loads: of the run. samplers: its sampled laws.
    """
    try:
        with np.errstate(all="ignore"):
            return _unstable(arm, both, q, prescribed, times, loads, controls, samplers, time, failed)
    except (ValueError, np.linalg.LinAlgError):  # a state that has no linear model: the run's own words must do
        return None


def _unstable(
    arm: Chain, both: Chain, q: Array, prescribed: Sequence[int], times: Array, loads: Any, controls: Sequence[Any],
    samplers: Sequence[Any], time: float, failed: bool,
) -> LoopWarning | None:  # fmt: skip
    plant = Plant.of(both, q, prescribed, at_time(arm, loads, float(times[0])))
    if plant is None:
        return None
    continuous = _continuous(arm, both, controls, times, loads)
    counted = [(k, law) for k, law in continuous if failed or not np.isfinite(law[4])]
    loops = [x for x in _sampled_loops(arm, controls, samplers, plant) if failed or not np.isfinite(x.limit)]
    bare, _ = _growth(plant.matrix([])[0])
    least = max(bare, 0.0) * 1.05 + _GROWN / max(time, 1e-300)
    quiet = max(bare, 0.0) * 1.05 + 0.05 * _GROWN / max(time, float(times[-1] - times[0]))
    laws = [law for _, law in counted]
    F, G = plant.matrix(laws)
    grows, pole = _growth(F)
    if grows > least:
        for k in dict.fromkeys(k for k, _ in counted):
            mine = [law for i, law in counted if i == k]
            if _growth(plant.matrix(mine)[0])[0] > least or len({i for i, _ in counted}) == 1:
                break
        how = _remedy(lambda f: _growth(plant.matrix(laws, f)[0])[0], quiet) if not controls[k].memory else ""
        return LoopWarning(
            f"the loop of control[{k}] feeds energy in: about the start its fastest pole is {_text(pole)} 1/s"
            + (f"; {how}" if how else ""),
            k, grows,
        )  # fmt: skip
    alike: dict[tuple[float, float], list[_Loop]] = {}
    for loop in loops:
        alike.setdefault((loop.period, loop.delay), []).append(loop)
    for chosen in [[x] for x in loops] + [x for x in alike.values() if len(x) > 1]:
        sampling = _Sampling(F, G, chosen)
        grows, pole = sampling.growth()
        if grows <= least:
            continue
        names = " and ".join(f"control[{x.control}]" for x in chosen)
        how = _remedy(lambda f, s=sampling: s.growth(f)[0], quiet)
        if not sampling.A.size:
            for parts in (2, 4, 8, 16, 32, 64):
                finer = [replace(x, period=x.period / parts) for x in chosen]
                if _Sampling(F, G, finer).growth()[0] <= quiet:
                    often = f"sampled every {finer[0].period:g} s"
                    how = f"{often} it is stable, while {how}" if how.startswith("no") else f"{how}, or {often}"
                    break
        late = f" with a delay of {chosen[0].delay:g} s" if chosen[0].delay else ""
        return LoopWarning(
            f"the loop of {names}, sampled every {chosen[0].period:g} s{late}, is unstable: about the start its "
            f"fastest pole is z = {_text(pole)}; {how}",
            chosen[0].control, grows,
        )  # fmt: skip
    return None


def _text(pole: complex) -> str:
    if abs(pole.imag) <= 1e-9 * abs(pole):
        return f"{pole.real:.3g}"
    return f"{pole.real:.3g} +- {abs(pole.imag):.3g}i"


def has_grown(v: Array) -> bool:
    """Whether rates (nt, n) are in the last fifth of the rows far above those of the first tenth, and near the largest
    of all: what settles is not growing."""
    parts = v[: max(2, len(v) // 10)], v[-max(2, len(v) // 5) :]
    first, last = (np.abs(part).max(axis=0, initial=0.0) for part in parts)
    grown = last > 3.0 * first
    return bool(grown.any() and (grown & (last >= 0.5 * np.abs(v).max(axis=0, initial=0.0))).any())
