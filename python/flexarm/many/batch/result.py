"""The result of a batch."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._check import Array, named
from ...arm.arm import Arm
from ...arm.variation import OF_ARM, Setup, Variation
from ...data.store.files import Refused, readable, sealed, write_whole
from ...model.acting.load import driven_forces
from ...run.outputs import row_shapes
from ...run.result import Result
from ...run.simulation import source
from .job import ENDED, FAILED, OUTPUTS, Job, width
from .problems import NOT_DONE, Failure
from .storage import REASON_BYTES, about, failures_in, in_bytes, kept_events, read, write_file


def one_result(setup: Setup, t: Array, held: Mapping[str, Any], i: int, keeps_loads: bool = True) -> Result:
    """Scenario i of a batch's arrays: its rows up to its end, at the times t."""
    n = int((t <= held["reached"][i] + 1e-9 * (t[-1] - t[0])).sum())
    arm, loads = setup.arm, setup.loads if keeps_loads else None
    arrays: dict[str, Any] = {}
    for name, shape in row_shapes(arm).items():
        if held.get(name) is not None:
            arrays[name] = np.array(held[name][i, :n]).reshape(n, *shape)
        elif name in ("q", "v", "a", "tau"):
            arrays[name] = np.full((n, *shape), np.nan)
    driven = driven_forces(arm, setup.drive, t[:n])
    if arm.struts and not keeps_loads:
        driven = np.full((n, len(arm.struts)), np.nan)
    result = Result(arm, t[:n], **arrays, loads=loads, driven=driven)
    result.status, events = int(held["status"][i] == ENDED), held.get("events")
    if events is not None and events[i] is not None:
        result.t_events, result.q_events, result.v_events = events[i]
    if held.get("wrong") is not None:
        result._wrong = list(held["wrong"][i] or ())
    return result


@dataclass(repr=False)
class BatchResult:
    """The result of a batch: B scenarios, nt rows each.

    Attributes:
        t: times (s), (nt,). q: (B, nt, nq). v, a, tau: (B, nt, nv). Those that were not requested are None; rows after
            a failure or a terminal event are nan. With a file they are mapped from it, not read.
        contacts: likewise, forces of the contacts on their links (N), three numbers each, (B, nt, 3 n).
        loops: likewise, force (N) and moment (N m) of the loops, six numbers each, as in Result, (B, nt, 6 n).
        status: (B,): 0 where the scenario was done; 1 where a terminal event ended it, as in Result; 4 where Ctrl-C
            came first; 5 where it failed.
        reached: (B,), time reached (s): the last of t, or that of the event, of Ctrl-C, of the failure.
        failures: index, time and reason of each scenario that failed.
        parameters: values (B, ...) by path. variation: the setups of the scenarios.
        events: (B,): (t_events, q_events, v_events) of each scenario, as Result has them, or None where it was not
            done; None without events. A file keeps as many occurrences of each event as there are rows; where there
            are more, the scenario counts as failed.
        stats: lanes (scenarios side by side; 0: each a `simulate`), workers, steps,
            resumed (scenarios that the file held already), damaged (that it held damaged, and which were computed
            again), out_of_range (that deserve a RangeWarning, of those resumed too), wall_time (s).
        keeps_loads: whether `self[k].loads` are those of the run; not of a batch read from a file.
    """

    t: Array
    q: Array | None
    v: Array | None
    a: Array | None
    tau: Array | None
    status: NDArray[np.int32]
    reached: Array
    variation: Variation
    failures: list[Failure] = field(default_factory=list)
    stats: dict[str, Any] = field(default_factory=dict)
    keeps_loads: bool = True  #: a file keeps none
    events: NDArray[Any] | None = None
    contacts: Array | None = None
    loops: Array | None = None
    _job: Job | None = field(default=None, repr=False, compare=False)
    _wrong: NDArray[Any] | None = field(default=None, compare=False)

    def __len__(self) -> int:
        return len(self.status)

    def __repr__(self) -> str:
        return f"BatchResult({len(self)} scenarios, {len(self.t)} rows, {len(self.failures)} failed)"

    @property
    def parameters(self) -> dict[str, Array]:
        return self.variation.values

    def arm(self, index: int) -> Arm:
        """The arm of a scenario, with its parameters."""
        return self.variation.scenario(range(len(self))[index]).arm

    def __getitem__(self, i: int) -> Result:
        """Scenario i, with its own arm: its rows up to its end; arrays that were not requested are nan. It has
        derivatives (`Result.gradient`), unless it is from a file, or its forces `tau` change with time."""
        i = range(len(self))[i]
        held = {k: getattr(self, k) for k in (*OUTPUTS, "status", "reached", "events")} | {"wrong": self._wrong}
        setup = self.variation.scenario(i)
        found = one_result(setup, self.t, held, i, self.keeps_loads)
        job = self._job
        if job is not None and (job.tau is None or job.tau.shape[1] == 1):
            q0, v0 = (None if x is None else x[i % len(x)] for x in (job.q0, job.v0))
            q0 = job.balance or q0
            tau = None if job.tau is None else job.tau[i % len(job.tau), 0]
            of = self.variation.setup, {k: x[i % len(x)][None] for k, x in self.variation.values.items()}
            found._source = source(setup, self.t, q0, v0, tau, integrator=job.integrator, of=of, events=job.events)
        return found

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_job": None}

    def map(self, f: Callable[[Result], Any]) -> Array:
        """f(result) of every scenario, such as `lambda r: r.tip_deflection()[-1]`, (B, ...)."""
        return np.array([f(self[i]) for i in range(len(self))])

    def save(self, path: str | Path) -> None:
        """Writes times, arrays, failures, parameters and the arm to one file that `BatchResult.load` reads: .npz (or
        no suffix), .h5 or .hdf5. `fa.Data` and tables are of one run: `batch[k].save("x.csv")`.

        Raises:
            ValueError: another suffix, or where nothing can be written.
        """
        file = named(path, ".npz", ".h5", ".hdf5")
        kept: dict[str, Any] = {k: getattr(self, k) for k in OUTPUTS if getattr(self, k) is not None}
        reason = np.zeros(len(self), f"S{REASON_BYTES}")
        for f in self.failures:
            reason[f.index] = in_bytes(f.reason)
        if self.events is not None:
            kept |= kept_events(self.events)
        kept |= {"status": self.status, "reached": self.reached, "reason": reason}
        told = {**about(self.variation), **({} if self.keeps_loads else {"loads": 1})}
        if file.suffix.lower() in (".h5", ".hdf5"):
            write_file(file, self.t, self.variation, kept, told)
        else:
            arrays = {**kept, "t": self.t, **{f"parameters/{k}": v for k, v in self.variation.values.items()}}
            arrays["about"] = np.array(sealed(told, arrays))
            write_whole(file, lambda out: np.savez_compressed(out, **arrays), "batch")

    @staticmethod
    def load(path: str | Path, verify: bool = True) -> BatchResult:
        """Reads a file of `save` or of simulate_batch(out="sweep.h5"), finished or not. Parameters of the arm make the
        arms; the file has no drives, loads and controllers.

        Args:
            path: the file.
            verify: whether to look through all of a file "sweep.h5" for damage, by its checksums (1 GB a second or
                so). (One of `save` always is.)

        Raises:
            ValueError: no such file, another kind of file, or a damaged one.
        """
        with readable("batch", Path(path), "a file of a batch"):
            held = read(Path(path), verify)
            values, loads = held["parameters"], held["about"]["loads"]
            ours = {k: v for k, v in values.items() if k.split(".")[0] in (*OF_ARM, "q0", "v0")}
            variation = Variation(Setup(Arm.from_dict(held["about"]["arm"])), ours)
            variation.values.update(values)
            _check_shapes(held, variation.setup.arm)
            known = held["status"] != NOT_DONE
            held["status"][known & (held["reason"] != b"")] = FAILED  # an older flexarm gave other numbers
            beyond = int(np.isfinite(held.get("out_of_range", np.empty((0, 4)))[:, 0]).sum())
            arrays: dict[str, Any] = {k: held.get(k) for k in OUTPUTS}
            return BatchResult(
                held["t"], **arrays, status=held["status"], reached=held["reached"], variation=variation,
                failures=failures_in(held), keeps_loads=not loads, stats={"out_of_range": beyond} if beyond else {},
                events=held.get("events"),
            )  # fmt: skip


def _check_shapes(held: dict[str, Any], arm: Arm) -> None:
    """Raises Refused for arrays that do not fit each other or the arm."""
    t, count = held["t"], len(held["status"])
    if t.dtype != np.float64 or t.ndim != 1 or not (np.diff(t) > 0).all() or not np.isfinite(t).all():
        raise Refused("its times do not increase")
    shapes: dict[str, tuple[int, ...]] = {k: (count, len(t), width(arm, k)) for k in OUTPUTS}
    for k, shape in {**shapes, "status": (count,), "reached": (count,), "reason": (count,)}.items():
        kind = {"status": "i", "reason": "S"}.get(k, "f")
        if k in held and (held[k].shape != shape or held[k].dtype.kind != kind):
            raise Refused(f"{k!r} is {held[k].dtype} {held[k].shape}, and not {shape}")
    for path, x in held["parameters"].items():
        if x.dtype.kind != "f" or not x.ndim or len(x) not in (1, count):
            raise Refused(f"parameters['{path}'] is {x.dtype} {x.shape}, and not of {count} scenarios")
