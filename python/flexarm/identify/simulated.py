"""Runs with values of parameters, and their derivatives."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .._check import Array
from ..arm.variation import Setup, Variation
from ..many.batch.simulate import simulate_batch
from ..run.result import Result
from ..run.sensitivity import ROWS, RunStopped, Sensitivities
from ..run.simulation import source
from ..run.start import state


def scenarios(
    setup: Setup, parameters: Mapping[str, Array], t: Array, q0: Array | str | None, v0: Array | None
) -> list[tuple[Setup, Array, Array]]:
    """Setups and initial states of runs with values (B,) of parameters."""
    variation = Variation(setup, parameters)
    setups = [variation.scenario(i) for i in range(max((len(x) for x in parameters.values()), default=1))]
    states = [state(s.arm, q0, v0, s.drive, s.loads, float(t[0])) for s in setups]
    q, v = (np.array(x) for x in zip(*states, strict=True))
    return list(zip(setups, variation.initial("q0", q), variation.initial("v0", v), strict=True))


def runs(
    setup: Setup, parameters: Mapping[str, Array], t: Array, q0: Array | str | None, v0: Array | None, **options: Any
) -> list[tuple[Setup, Array, Array, Result | RunStopped]]:
    """Setups, initial states and runs with values (B,) of parameters."""
    made = scenarios(setup, parameters, t, q0, v0)
    _, q, v = zip(*made, strict=True)
    moving = {k: x for k, x in parameters.items() if not k.startswith("sensor.")}
    batch = simulate_batch(
        setup.arm, t, np.array(q), np.array(v), parameters=moving, drive=setup.drive, loads=setup.loads,
        control=setup.control, outputs=ROWS, **options,
    )  # fmt: skip
    failed = {f.index: RunStopped(f.reason, f.time) for f in batch.failures}
    return [(*x, failed.get(i) or batch[i]) for i, x in enumerate(made)]


def sensitivities(
    setup: Setup, parameters: Mapping[str, float], t: Array, q0: Array | str | None, v0: Array | None, *,
    workers: int = 1, progress: Any = None, **options: Any,
) -> Sensitivities:  # fmt: skip
    """A run and its derivatives.

    Args:
        setup: of the run. parameters: values by path, of a sensor's too. t, q0, v0: as of `simulate`.
        workers: threads. progress: called with the time reached (s).
        options: of `simulate`.

    Raises:
        RunStopped: the run failed.
    """
    values = {k: np.array([x]) for k, x in parameters.items()}
    made, q, v = scenarios(setup, values, t, q0, v0)[0]
    of = setup, {k: x for k, x in values.items() if not k.startswith(("q0", "v0"))}
    first = q0 if isinstance(q0, str) else q
    return source(made, t, first, v, **options, alive=progress, of=of).sensitivities(list(parameters), workers)
