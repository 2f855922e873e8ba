"""Scenarios of a batch by the core's steps, all at once."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._check import Array
from ..acting.control import Controller
from ..acting.drive import Motion, Torque
from ..acting.load import Load
from ..acting.voltage import Voltage, split_drives
from ..arm import Arm
from ..run.variation import Setup
from .arguments import check_balls
from .job import FAILED, Job
from .rollout import Failure, failures_of, grown_loop, out_of_range, take_steps
from .schedule import Schedule, feedback_tables, sampled, stacked, wrench_table


def run_steps(
    job: Job, setups: Sequence[Setup], indices: NDArray[np.int64], blocks: Mapping[str, Any], workers: int, alive: Any
) -> tuple[list[Failure], dict[str, Any]]:
    """Runs these scenarios, made of these setups, into their `Job.blocks`.

    Returns:
        What failed, and counts; counts["interrupted"] after Ctrl-C.
    """
    schedule, arms = job.schedule(), [s.arm for s in setups]
    one = arms[0]
    for k, arm in enumerate(arms):
        if arm is not one and arm.coordinates != one.coordinates:
            raise ValueError(f"scenario {indices[k]}: its arm must have the same coordinates as the others")
    q0 = one.zero[None] if job.q0 is None else _taken(job.q0, indices)
    v0 = np.zeros((1, one.nv)) if job.v0 is None else _taken(job.v0, indices)
    tau = np.zeros((1, 1, one.nv)) if job.tau is None else _taken(job.tau, indices)
    check_balls(one, q0)
    motions, pushes = _drives(job, setups, schedule)
    for i, table in motions:
        start = table[:, 0, :2]
        for name, given, at, value in (("q0", job.q0 is not None, q0[:, one.coordinate_of(i)], start[:, 0]),
                                       ("v0", job.v0 is not None, v0[:, i], start[:, 1])):  # fmt: skip
            if given and (np.abs(at - value) > 1e-9 * np.maximum(1.0, np.abs(value))).any():
                raise ValueError(f"{name}: disagrees with the motion of '{one.coordinates[i]}' at t = {job.t[0]}")
    loads = _loads(job, setups, schedule)
    laws = feedback_tables(arms, [s.control for s in setups], schedule, [i for i, _ in motions])
    if len(arms) > 1 and all(arm is one for arm in arms):
        arms = arms[:1]
    stats = take_steps(
        arms, len(indices), schedule, q0, v0, tau, motions, pushes, loads, laws, job.integrator,
        job.options.get("spectral_radius"), job.options.get("rtol"),
        {k: blocks[k] for k in (*job.outputs, "status", "reached")}, workers, alive, whole=job.whole,
    )  # fmt: skip
    if "q" in blocks:
        blocks["out_of_range"][:] = out_of_range(arms, job.t[:: job.every], blocks["q"])

    def scenario(k: int) -> tuple[Arm, Array, Any, Sequence[Controller]]:
        s = setups[k % len(setups)]
        return s.arm, q0[k % len(q0)], s.loads, list(s.control)

    prescribed = [i for i, _ in motions]
    found = failures_of(blocks, scenario, prescribed, job.t)
    blocks["status"][[f.index for f in found]] = FAILED
    if "v" in blocks and any(s.control for s in setups):
        grown = grown_loop(scenario, prescribed, job.t, blocks["v"], blocks["status"])
        if grown is not None:
            warnings.warn(grown[1].of(f"scenario {indices[grown[0]]}"), stacklevel=2)
    return [replace(f, index=int(indices[f.index])) for f in found], stats


def _drives(job: Job, setups: Sequence[Setup], schedule: Schedule) -> tuple[list[Any], list[Any]]:
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
                law.check_span(where, job.t)
                table[id(law)] = sampled(where, law.law, schedule.halves, width)
        return stacked([table[id(law)] for law in laws])

    for key, law in joints.items():
        i = one.arm.joint_rate(key, "drive: link")
        where = f"drive of '{one.arm.coordinates[i]}'"
        if isinstance(law, Motion):
            if one.arm.coordinate_of(i) < 0:
                raise ValueError(f"{where}: the motion of a ball cannot be prescribed; use three rotations (Axes)")
            law.check_rates(where, job.t)
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


def _loads(job: Job, setups: Sequence[Setup], schedule: Schedule) -> list[Any]:
    """(places, wrenches) of each load."""
    out = []
    alike = all(s.arm is setups[0].arm for s in setups)
    for k, first in enumerate(setups[0].loads):
        if not isinstance(first, Load):
            raise ValueError(f"loads[{k}] = {first!r}: must be a Load")
        mine = [s.loads[k] for s in setups]
        for load in mine:
            load.check_span(f"loads[{k}]", job.t)
        same = alike and all((x.link, x.x, x.along) == (first.link, first.x, first.along) for x in mine)
        places = [s.loads[k].place(s.arm) for s in (setups[:1] if same else setups)]
        tables = {id(load): wrench_table(f"loads[{k}]", load, schedule.halves) for load in dict.fromkeys(mine)}
        out.append((places, stacked([tables[id(load)] for load in mine])))
    return out


def _taken(x: Array, indices: NDArray[np.int64]) -> Array:
    """Those rows; not copied where they follow each other."""
    if len(x) == 1:
        return x
    first, last = int(indices[0]), int(indices[-1])
    return x[first : last + 1] if last - first + 1 == len(indices) else np.ascontiguousarray(x[indices])
