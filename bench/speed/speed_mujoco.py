"""Worker of bench/speed/speed_batch.py: MuJoCo on two links of ten rigid segments each, in steps and in rollouts.

The model and its tip are those of bench/speed/peer_mujoco.py. Times are CPU seconds of the process, all its
threads together.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from mujoco import rollout
from peer_common import CASES
from peer_mujoco import controls, tip, xml

CASE = CASES["c"]
SEGMENTS = 10
# integrator: steps between two output times, from long to short
SWEEP = {
    "Euler": (10, 25, 50),
    "implicitfast": (10, 25, 50),
    "RK4": (40,),
    "discrete": (1, 2, 5, 10, 20, 50),
}
REFINED = ((10, 80), (20, 160))  # segments, steps between outputs, of RK4: to see where the segments converge
STEPS = 80000  # of all scenarios of a batch together, about


def clocks(run: Callable[[], Any]) -> tuple[float, float, Any]:
    """CPU and wall seconds of the faster of two runs, and the last one's answer."""
    best = (np.inf, np.inf)
    for _ in range(2):
        cpu, wall = time.process_time(), time.perf_counter()
        answer = run()
        best = min(best, (time.process_time() - cpu, time.perf_counter() - wall))
    return *best, answer


def model_of(segments: int, integrator: str, every: int) -> tuple[mujoco.MjModel, np.ndarray]:
    """The model and its controls (steps, joints)."""
    steps = every * CASE.outputs
    model = mujoco.MjModel.from_xml_string(xml(CASE, segments, integrator, CASE.end / steps))
    return model, controls(CASE, steps, integrator)


def start(model: mujoco.MjModel, count: int) -> np.ndarray:
    """Initial states (count, size): at rest, each but the first a little turned."""
    states = np.zeros((count, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    states[:, 1] = 1e-3 * np.arange(count)
    return states


def path(segments: int, states: np.ndarray, every: int, nq: int) -> np.ndarray:
    """The tip (outputs + 1, 2) of one rollout's states."""
    return tip(CASE, segments, np.vstack([np.zeros(nq), states[every - 1 :: every, 1 : 1 + nq]]))


def unstable(model: mujoco.MjModel, data: mujoco.MjData, control: np.ndarray) -> bool:
    """Whether a run ran away; MuJoCo then starts it anew, and says so on stderr."""
    stepped(model, data, control)
    bad = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
    return any(data.warning[w].number for w in bad)


def stepped(model: mujoco.MjModel, data: mujoco.MjData, control: np.ndarray) -> None:
    """One run by mj_step, from Python."""
    mujoco.mj_resetData(model, data)
    for u in control:
        data.ctrl[:] = u
        mujoco.mj_step(model, data)


def report(**line: Any) -> None:
    print(json.dumps(line), flush=True)


def run(integrator: str, every: int) -> None:
    """One integrator with one step: by rollouts of one thread and of two, and by mj_step."""
    model, control = model_of(SEGMENTS, integrator, every)
    line = {"kind": "run", "method": f"MuJoCo {integrator}", "setting": f"step {CASE.end / len(control):.3g} s"}
    data = [mujoco.MjData(model) for _ in range(2)]
    if unstable(model, data[0], control):
        report(**line, path=None)
        return
    count = max(2, min(16, STEPS // len(control)))
    states = start(model, count)
    cpu, _, (out, _) = clocks(lambda: rollout.rollout(model, data[:1], states, control[None]))
    _, wall, _ = clocks(lambda: rollout.rollout(model, data, states, control[None]))
    loop, _, _ = clocks(lambda: stepped(model, data[0], control))
    line["path"] = path(SEGMENTS, out[0], every, model.nq).tolist()
    seconds = count * CASE.end
    report(**line, batch=seconds / cpu, scalar=CASE.end / loop, two=seconds / wall)


def sweep() -> None:
    for integrator, choices in SWEEP.items():
        for every in choices:
            run(integrator, every)


def refined() -> None:
    for segments, every in REFINED:
        model, control = model_of(segments, "RK4", every)
        states, _ = rollout.rollout(model, mujoco.MjData(model), start(model, 1), control[None])
        report(kind="refined", segments=segments, path=path(segments, states[0], every, model.nq).tolist())


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--refined", action="store_true")
    if parser.parse_args().refined:
        report(kind="versions", MuJoCo=mujoco.__version__)
        refined()
    else:
        sweep()
