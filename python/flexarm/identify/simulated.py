"""Runs with values of parameters, and their derivatives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from .._check import Array
from ..acting.drive import Motion
from ..acting.voltage import split_drives
from ..batch.simulate import simulate_batch
from ..run.result import Result
from ..run.sensitivity import RunStopped, Sensitivities
from ..run.simulation import source
from ..run.variation import Setup, Variation

_KINDS = ("q", "v", "a", "tau")

Output = Callable[[Result, Setup], Array]  #: what is read of a run and of what it was made of


class RunFailed(Exception):
    """A run that could not go on: why, and the time reached (s)."""

    def __init__(self, reason: str, time: float) -> None:
        super().__init__(reason)
        self.time = time


def start(setup: Setup, t0: float, q0: Array | None, v0: Array | None) -> tuple[Array, Array]:
    """The initial state; joints whose motion is prescribed start where that does."""
    arm = setup.arm
    q = np.array(arm.zero if q0 is None else q0, dtype=float)
    v = np.zeros(arm.nv) if v0 is None else np.array(v0, dtype=float)
    joints, _ = split_drives(setup.drive)
    for i, law in arm.by_rate("drive", joints).items():
        if isinstance(law, Motion):
            q[arm.coordinate_of(i)], v[i] = law(t0)[:2]
    return q, v


def runs(
    setup: Setup, parameters: Mapping[str, Array], t: Array, q0: Array | None, v0: Array | None, **options: Any
) -> list[tuple[Setup, Result | RunFailed]]:
    """Runs of a setup for values (B,) of its parameters, and what each was made of."""
    count = max((len(x) for x in parameters.values()), default=1)
    states = {k: x for k, x in parameters.items() if k.split(".")[0] in ("q0", "v0")}
    own = {k: x for k, x in parameters.items() if k not in states}
    variation = Variation(setup, own)
    setups = [variation.scenario(i) for i in range(count)]
    q, v = (np.array(x) for x in zip(*(start(s, float(t[0]), q0, v0) for s in setups), strict=True))
    for path, values in states.items():
        (q if path[0] == "q" else v)[:, int(path.split(".")[1])] = values
    moving = {k: x for k, x in own.items() if not k.startswith("sensor.")}
    batch = simulate_batch(
        setup.arm, t, q, v, parameters=moving, drive=setup.drive, loads=setup.loads, control=setup.control,
        outputs=_KINDS, **options,
    )  # fmt: skip
    failed = {f.index: RunFailed(f.reason, f.time) for f in batch.failures}
    return [(s, failed.get(i) or batch[i]) for i, s in enumerate(setups)]


def sensitivities(
    setup: Setup, parameters: Mapping[str, float], t: Array, q0: Array | None, v0: Array | None, *, workers: int = 1,
    progress: Any = None, **options: Any,
) -> Sensitivities:  # fmt: skip
    """A run and its derivatives.

    Args:
        setup: what it is made of. parameters: values by path, of a sensor's too. t, q0, v0: as of `simulate`.
        workers: threads. progress: called with the time reached (s).
        options: of `simulate`.

    Raises:
        RunFailed: the run could not go on.
    """
    values = {k: np.array([x]) for k, x in parameters.items()}
    made, q, v = scenario(setup, values, t, q0, v0)
    of = setup, {k: x for k, x in values.items() if k.split(".")[0] not in ("q0", "v0")}
    del workers  # the derivatives' threads are as many as there are cores
    try:
        return source(made, t, q, v, **options, alive=progress, of=of).sensitivities(list(parameters))
    except RunStopped as e:
        raise RunFailed(str(e), e.time) from None


def scenario(
    setup: Setup, parameters: Mapping[str, Array], t: Array, q0: Array | None, v0: Array | None
) -> tuple[Setup, Array, Array]:
    """What a run with these values (1,) is made of, and where it begins."""
    states = {k: x for k, x in parameters.items() if k.split(".")[0] in ("q0", "v0")}
    made = Variation(setup, {k: x for k, x in parameters.items() if k not in states}).scenario(0)
    q, v = start(made, float(t[0]), q0, v0)
    for path, x in states.items():
        (q if path[0] == "q" else v)[int(path.split(".")[1])] = x[0]
    return made, q, v
