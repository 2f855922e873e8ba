"""How the scenarios of a batch are run: by the core's steps, all at once, or by `simulate`, in threads."""

from __future__ import annotations

import re
import threading
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from .._check import Array
from .._threads import each
from ..acting.control import Controller, Run, _Feedback, _Sampler, control_laws, padded
from ..acting.drive import Motion, Torque
from ..acting.load import Load
from ..acting.voltage import Voltage, split_drives
from ..analysis.validity import SILENT, worst_range
from ..arm import Arm
from ..parts.chain import Chain
from ..run.result import Result
from ..run.simulation import SimulationError, SimulationInterrupted, _events, simulate
from .rollout import NOT_DONE, STEPPERS, Failure, check_balls, explained, failures_of, grown_loop, take_steps
from .tables import Schedule, breaks_of, feedback_tables, sampled, stacked, wrench_table
from .variation import Setup, Variation

ENDED = 1  #: by a terminal event, as `Result.status` has it
FAILED = 5


class _Held(Controller):
    """Forces given as rows, each held from one output time to the next."""

    def __init__(self, rows: Array) -> None:
        self.rows = rows

    def _columns(self, arm: Chain) -> list[Array]:
        return []

    def _laws(self, arm: Chain, run: Run) -> tuple[list[_Feedback], list[_Sampler]]:
        first, period = float(run.times[0]), float(run.times[-1] - run.times[0]) / (run.times.size - 1)
        last, rows = run.times.size - 2, self.rows

        def force(t: float, q: Array, v: Array, a: Array) -> Array:
            return padded(rows[min(round((t - first) / period), last)], arm.nv + run.total)

        return [], [(first, period, 0.0, force)]


def _friction(arm: Arm) -> bool:
    return any(np.any(x) for link in arm.links for x in (link.joint.coulomb, link.joint.stiction) if x is not None)


class Summary(Protocol):
    """What is kept of each scenario in place of its rows; its attributes are part of what a file knows a batch by.

    Attributes:
        every: how many of the job's rows between two that are kept.
    """

    @property
    def every(self) -> int: ...

    def kept(self, arm: Arm, rows: int) -> dict[str, tuple[int, ...]]:
        """By name, the shape of what is kept of a scenario with so many rows."""

    def __call__(self, arm: Arm, blocks: Mapping[str, Any], result: Callable[[int], Result]) -> dict[str, Any]:
        """The same of all scenarios in `Job.blocks`, nan where one failed; `result` gives each as a Result."""


def renamed(message: str, names: Any) -> str:
    """A message about a scenario of a share, with the number (of `names`) that it has in the whole batch."""
    return re.sub(r"^((?:parameters of )?scenario) (\d+):", lambda m: f"{m[1]} {names[int(m[2])]}:", message)


@dataclass
class Job:
    """A batch: everything that its scenarios are made of, and how they are run. It pickles, where its laws do.

    Attributes:
        variation: the scenarios' arms, drives, loads and controllers.
        t: output times (s). every: how many of them between two rows of the result.
        q0, v0: (B or 1, n); None where nothing is given. tau: (B or 1, nt or 1, nv), held; None: zero.
        outputs: of "q", "v", "a", "tau".
        integrator, step, options: of `simulate`.
        summary: what is kept of each scenario; None: the outputs.
    """

    variation: Variation
    t: Array
    q0: Array | None
    v0: Array | None
    tau: Array | None
    outputs: tuple[str, ...]
    every: int
    integrator: str
    step: float | None
    options: dict[str, Any] = field(default_factory=dict)
    summary: Summary | None = None

    def taken(self, indices: NDArray[np.int64]) -> Job:
        """The batch of these scenarios alone."""

        def part(x: Array | None) -> Array | None:
            return x if x is None or len(x) == 1 else np.ascontiguousarray(x[indices])

        values = {path: part(v) for path, v in self.variation.values.items()}
        try:
            variation = Variation(self.variation.setup, values)  # type: ignore[arg-type]
        except ValueError as e:
            raise ValueError(renamed(str(e), indices)) from None
        return replace(self, variation=variation, q0=part(self.q0), v0=part(self.v0), tau=part(self.tau))

    @property
    def rows(self) -> int:
        return len(self.t[:: self.every])

    @property
    def row_bytes(self) -> int:
        """Bytes of a scenario's result."""
        return max(1, 8 * self.rows * sum(self.sizes().values()))

    @property
    def events(self) -> int:
        """How many are looked for."""
        return len(_events(self.options.get("events")))

    def sizes(self) -> dict[str, int]:
        """Numbers in a row of each output."""
        arm = self.variation.setup.arm
        return {k: arm.nq if k == "q" else arm.nv for k in self.outputs}

    def kept(self) -> dict[str, tuple[int, ...]]:
        """By name, the shape of what is kept of a scenario."""
        if self.summary is not None:
            return self.summary.kept(self.variation.setup.arm, self.rows)
        return {k: (self.rows, size) for k, size in self.sizes().items()}

    @property
    def kept_times(self) -> Array:
        """Of the rows that are kept."""
        return self.t[:: self.every][:: self.summary.every if self.summary is not None else 1]

    @property
    def keeps_events(self) -> bool:
        return bool(self.events) and self.summary is None

    def event_sizes(self) -> tuple[int, int, int, int]:
        """How many events, how many occurrences of each a file keeps, nq and nv."""
        arm = self.variation.setup.arm
        return self.events, self.rows, arm.nq, arm.nv

    def blocks(self, count: int) -> dict[str, Any]:
        """Arrays for so many scenarios, to be run into."""
        out: dict[str, Any] = {k: np.empty((count, self.rows, size)) for k, size in self.sizes().items()}
        out |= {"status": np.empty(count, np.int32), "reached": np.empty(count)}
        out |= {"events": np.full(count, None)} if self.events else {}
        return {**out, "out_of_range": np.full((count, 4), np.nan)}

    def schedule(self) -> Schedule:
        assert self.step is not None
        return Schedule.between(self.t, self.step, self.every, self.tau is not None and self.tau.shape[1] > 1)

    def engine(self) -> str:
        """ "steps": all in the core; "simulate": one call of `simulate` each."""
        setup = self.variation.setup
        known = all(k in ("rtol", "spectral_radius") for k in self.options)
        if self.integrator not in STEPPERS or not known:
            return "simulate"
        if self.integrator == "rk4" and (_friction(setup.arm) or self._varies_friction()):
            return "simulate"
        feedback, samplers, memory = control_laws(setup.arm, setup.control, self.t)
        if samplers or memory:
            return "simulate"
        laws = [law.law for law in setup.drive.values()] + [law for _, _, _, law, _ in feedback] + [*setup.loads]
        schedule = self.schedule()
        return "steps" if all(schedule.meets(breaks_of(law)) for law in laws) else "simulate"

    def _varies_friction(self) -> bool:
        return any(path.rpartition(".")[2] in ("coulomb", "stiction") for path in self.variation.values)

    def run(
        self,
        engine: str,
        setups: Sequence[Setup],
        indices: NDArray[np.int64],
        blocks: Mapping[str, Any],
        workers: int,
        alive: Any,
    ) -> tuple[list[Failure], dict[str, Any]]:
        """Runs these scenarios, made of these setups, into their `blocks`.

        Returns:
            What failed, and counts; counts["interrupted"] after Ctrl-C.
        """
        run = self._steps if engine == "steps" else self._simulations
        found, stats = run(setups, indices, blocks, workers, alive)
        return [Failure(int(indices[f.index]), f.time, f.reason) for f in found], stats

    def _check_range(self, setups: Sequence[Setup], blocks: Mapping[str, Any]) -> None:
        """Looks for beams bent beyond their order's range."""
        t, q = self.t[:: self.every], blocks["q"]
        if not self.variation.varies_arm:  # a look at all at once, which mostly is enough
            flat = np.nan_to_num(q).reshape(-1, q.shape[2])
            if worst_range(self.variation.setup.arm, np.zeros(len(flat)), flat) is None:
                return
        for k, rows in enumerate(q):
            here = ~np.isnan(rows[:, 0])
            blocks["out_of_range"][k] = worst_range(setups[k % len(setups)].arm, t[here], rows[here]) or np.nan

    def _steps(
        self, setups: Sequence[Setup], indices: NDArray[np.int64], blocks: Mapping[str, Any], workers: int, alive: Any
    ) -> tuple[list[Failure], dict[str, Any]]:
        schedule, arms = self.schedule(), [s.arm for s in setups]
        one = arms[0]
        for k, arm in enumerate(arms):
            if arm is not one and arm.coordinates != one.coordinates:
                raise ValueError(f"scenario {indices[k]}: its arm must have the same coordinates as the others")
        q0 = one.zero[None] if self.q0 is None else _taken(self.q0, indices)
        v0 = np.zeros((1, one.nv)) if self.v0 is None else _taken(self.v0, indices)
        tau = np.zeros((1, 1, one.nv)) if self.tau is None else _taken(self.tau, indices)
        check_balls(one, q0)
        motions, pushes = self._drives(setups, schedule)
        for i, table in motions:
            start = table[:, 0, :2]
            for name, given, at, value in (("q0", self.q0 is not None, q0[:, one.coordinate_of(i)], start[:, 0]),
                                           ("v0", self.v0 is not None, v0[:, i], start[:, 1])):  # fmt: skip
                if given and (np.abs(at - value) > 1e-9 * np.maximum(1.0, np.abs(value))).any():
                    raise ValueError(f"{name}: disagrees with the motion of '{one.coordinates[i]}' at t = {self.t[0]}")
        loads = self._loads(setups, schedule)
        laws = feedback_tables(arms, [s.control for s in setups], schedule, [i for i, _ in motions])
        if len(arms) > 1 and all(arm is one for arm in arms):
            arms = arms[:1]
        stats = take_steps(
            arms, len(indices), schedule, q0, v0, tau, motions, pushes, loads, laws, self.integrator,
            self.options.get("spectral_radius"), self.options.get("rtol"),
            {k: blocks[k] for k in (*self.outputs, "status", "reached")}, workers, alive,
        )  # fmt: skip
        if "q" in blocks:
            self._check_range(setups, blocks)
        found = [
            explained(f, s.arm, q0[f.index % len(q0)], [i for i, _ in motions], self.t, s.loads, s.control)
            for f in failures_of(arms, blocks)
            for s in [setups[f.index % len(setups)]]
        ]
        blocks["status"][[f.index for f in found]] = FAILED
        if "v" in blocks and any(s.control for s in setups):

            def scenario(k: int) -> tuple[Any, ...]:
                s = setups[k % len(setups)]
                return s.arm, q0[k % len(q0)], s.loads, s.control

            grown = grown_loop(scenario, [i for i, _ in motions], self.t, blocks["v"], blocks["status"])
            if grown is not None:
                warnings.warn(grown[1].of(f"scenario {indices[grown[0]]}"), stacklevel=2)
        return found, stats

    def _drives(self, setups: Sequence[Setup], schedule: Schedule) -> tuple[list[Any], list[Any]]:
        """(coordinate, values) of motions; (column, values) of torques and voltages."""
        one = setups[0]
        joints, patches = split_drives(one.drive)
        motions: list[Any] = []
        pushes: list[Any] = []
        table: dict[int, Array] = {}

        def values(key: Any, where: str, width: int) -> Array:
            laws = [s.drive[key] for s in setups]
            for law in laws:
                if id(law) not in table:
                    law.check_span(where, self.t)
                    table[id(law)] = sampled(where, law.law, schedule.halves, width)
            return stacked([table[id(law)] for law in laws])

        for key, law in joints.items():
            i = one.arm.joint_rate(key, "drive: link")
            where = f"drive of '{one.arm.coordinates[i]}'"
            if isinstance(law, Motion):
                if one.arm.coordinate_of(i) < 0:
                    raise ValueError(f"{where}: the motion of a ball cannot be prescribed; use three rotations (Axes)")
                law.check_rates(where, self.t)
                motions.append((i, values(key, where, 3)))
            elif isinstance(law, Torque):
                pushes.append((np.eye(one.arm.nv)[None, i : i + 1], values(key, where, 1)))
            else:
                raise ValueError(f"{where} = {law!r}: must be a Motion or a Torque")
        for key, law in patches.items():
            if not isinstance(law, Voltage) or len(key) != 3:
                raise ValueError(f'drive {key!r} = {law!r}: must be a Voltage, of ("patch", link, patch)')
            columns = [s.arm.patch_matrix[None, :, s.arm.patch_column(key[1], key[2], "drive: ")] for s in setups]
            pushes.append((stacked(columns), values(key, f"drive {key!r}", 1)))
        return motions, pushes

    def _loads(self, setups: Sequence[Setup], schedule: Schedule) -> list[Any]:
        """(places, wrenches) of each load."""
        out = []
        alike = all(s.arm is setups[0].arm for s in setups)
        for k, first in enumerate(setups[0].loads):
            if not isinstance(first, Load):
                raise ValueError(f"loads[{k}] = {first!r}: must be a Load")
            mine = [s.loads[k] for s in setups]
            for load in mine:
                load.check_span(f"loads[{k}]", self.t)
            same = alike and all((x.link, x.x, x.along) == (first.link, first.x, first.along) for x in mine)
            places = [s.loads[k].place(s.arm) for s in (setups[:1] if same else setups)]
            tables = {id(load): wrench_table(f"loads[{k}]", load, schedule.halves) for load in dict.fromkeys(mine)}
            out.append((places, stacked([tables[id(load)] for load in mine])))
        return out

    def _simulations(
        self, setups: Sequence[Setup], indices: NDArray[np.int64], blocks: Mapping[str, Any], workers: int, alive: Any
    ) -> tuple[list[Failure], dict[str, Any]]:
        if self.tau is not None and self.tau.shape[1] > 1:
            steps = np.diff(self.t)
            if np.ptp(steps) > 1e-9 * steps.max():
                raise ValueError("tau: forces that are held, in scenarios that run one by one, need equal steps of t")
        stop, begun = threading.Event(), float(self.t[0])
        shares, beyond = np.zeros(len(indices)), blocks["out_of_range"]
        blocks["status"][:] = NOT_DONE
        blocks["reached"][:] = begun
        for name in self.outputs:
            blocks[name][:] = np.nan
        failures: list[Failure] = []
        steps = np.zeros(len(indices), np.int64)

        def one(k: int) -> None:
            def look(now: float) -> None:
                shares[k] = (now - begun) / (self.t[-1] - begun)
                if stop.is_set():
                    raise KeyboardInterrupt

            SILENT.set(True)  # of this thread
            setup = setups[k % len(setups)]
            result, status, failure = self._one(setup, int(indices[k]), look)
            if status != NOT_DONE:
                beyond[k] = worst_range(setup.arm, result.t, result.q) or np.nan
            for name in self.outputs:
                part = getattr(result, name)[:: self.every]
                blocks[name][k, : len(part)] = part
            times = [x[-1] for x in result.t_events or () if len(x)]
            if status == ENDED:
                blocks["reached"][k] = max(times)
            else:
                blocks["reached"][k] = self.t[-1] if status == 0 else failure.time if failure else result.t[-1]
            blocks["status"][k] = status
            if self.events:
                blocks["events"][k] = (result.t_events, result.q_events, result.v_events)
            shares[k], steps[k] = 1.0, result.stats["steps"]
            if failure:
                failures.append(replace(failure, index=k))
            if status == NOT_DONE:
                raise KeyboardInterrupt

        def show() -> None:
            if alive:
                alive(float(shares.mean()))

        interrupted = False
        try:
            each(one, len(indices), workers, show, stop.set)
        except KeyboardInterrupt:
            interrupted = True
        failures.sort(key=lambda f: f.index)
        return failures, {"steps": int(steps.sum()), "workers": workers, "interrupted": interrupted}

    def _one(self, setup: Setup, i: int, look: Callable[[float], None]) -> tuple[Any, int, Failure | None]:
        """Result, status and failure of a scenario."""
        start = {k: x[i % len(x)] for k, x in (("q0", self.q0), ("v0", self.v0)) if x is not None}
        control, options = list(setup.control), dict(self.options)
        if self.tau is not None and self.tau.shape[1] > 1:
            control.append(_Held(self.tau[i % len(self.tau)]))
        elif self.tau is not None:
            options["tau"] = self.tau[i % len(self.tau), 0]
        try:
            result = simulate(
                setup.arm, self.t, **start, drive=setup.drive, loads=setup.loads, control=control,
                integrator=self.integrator, step=self.step, progress=look, **options,
            )  # fmt: skip
            return result, result.status, None
        except SimulationError as e:
            return e.result, FAILED, Failure(i, e.time, str(e))
        except SimulationInterrupted as e:
            return e.result, NOT_DONE, None
        except ValueError as e:
            raise ValueError(f"scenario {i}: {e}") from None


def _taken(x: Array, indices: NDArray[np.int64]) -> Array:
    """Those rows; not copied where they follow each other."""
    if len(x) == 1:
        return x
    first, last = int(indices[0]), int(indices[-1])
    return x[first : last + 1] if last - first + 1 == len(indices) else np.ascontiguousarray(x[indices])
