"""Derivatives of a run by parameters, by central differences over runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from .._check import Array
from ..acting.drive import Motion
from ..acting.voltage import split_drives
from ..batch.simulate import simulate_batch
from ..batch.variation import Setup, Variation
from ..run.result import Result

_PART, _LEAST = 3e-5, 1e-3  # of a parameter, and of one that is smaller than that, the change that a difference takes
_KINDS = ("q", "v", "a", "tau")

Output = Callable[[Result, Setup], Array]  #: what is read of a run and of what it was made of


class RunFailed(Exception):
    """A run that could not go on: why, and the time reached (s)."""

    def __init__(self, reason: str, time: float) -> None:
        super().__init__(reason)
        self.time = time


class _Side(NamedTuple):
    """One side of a difference: how far the parameter is changed, and what the run is made of then."""

    by: float
    setup: Setup


@dataclass
class Sensitivities:
    """A run, and its derivatives by parameters.

    Attributes:
        result: the run. parameters: np paths.
        q, v, a, tau: derivatives of those of the run, (np, nt, nq) or (np, nt, nv).
    """

    result: Result
    parameters: tuple[str, ...]
    q: Array
    v: Array
    a: Array
    tau: Array
    sides: list[tuple[_Side, _Side]]

    def of(self, output: Output) -> Array:
        """Derivatives of what `output` reads of the run and of what it is made of, (np, *shape of the output)."""
        found = []
        for k, sides in enumerate(self.sides):
            ends = []
            for by, setup in sides:
                state = {x: getattr(self.result, x) + by * getattr(self, x)[k] for x in _KINDS}
                ends.append(output(Result(setup.arm, self.result.t, **state, loads=setup.loads), setup))
            found.append((ends[1] - ends[0]) / (sides[1].by - sides[0].by))
        return np.array(found)


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
    setup: Setup, parameters: Mapping[str, float], t: Array, q0: Array | None, v0: Array | None, **options: Any
) -> Sensitivities:
    """A run and its derivatives.

    Args:
        setup: what it is made of. parameters: values by path, of a sensor's too. t, q0, v0: as of `simulate`.
        options: of `simulate_batch`.

    Raises:
        RunFailed: the run, or those on both sides of it, could not go on.
    """
    moving = [path for path in parameters if not path.startswith("sensor.")]
    changes = {path: _PART * max(abs(x), _LEAST) for path, x in parameters.items()}
    rows = [dict(parameters)]
    for path, x in parameters.items():
        rows += [{**parameters, path: x - changes[path]}, {**parameters, path: x + changes[path]}]
    variation = Variation(setup, {path: np.array([row[path] for row in rows]) for path in parameters})
    base = variation.scenario(0)
    all_sides = {path: _sides(variation, base, 1 + 2 * k, changes[path]) for k, path in enumerate(parameters)}
    rows = [dict(parameters)]
    for path in moving:
        rows += [{**parameters, path: parameters[path] + side.by} for side in all_sides[path]]
    values = {path: np.array([row[path] for row in rows]) for path in parameters}
    found = [x for _, x in runs(setup, values, t, q0, v0, **options)]
    middle = found[0]
    if isinstance(middle, RunFailed):
        raise middle
    shapes = {k: getattr(middle, k).shape for k in _KINDS}
    out = {k: np.zeros((len(parameters), *shape)) for k, shape in shapes.items()}
    sides = []
    for k, path in enumerate(parameters):
        low, high = all_sides[path]
        if path in moving:
            j = 1 + 2 * moving.index(path)
            (low, before), (high, after) = (
                (_Side(0.0, base), middle) if isinstance(x, RunFailed) else (side, x)
                for side, x in zip((low, high), found[j : j + 2], strict=True)
            )
            if low.by == high.by:
                raise found[j]  # type: ignore[misc]
            for kind in _KINDS:
                out[kind][k] = (getattr(after, kind) - getattr(before, kind)) / (high.by - low.by)
        sides.append((low, high))
    return Sensitivities(middle, tuple(parameters), **out, sides=sides)


def _sides(variation: Variation, base: Setup, i: int, by: float) -> tuple[_Side, _Side]:
    """Both sides of a parameter, scenarios i and i + 1; where it cannot be smaller (or larger), itself is one."""
    found = []
    for k, change in ((i, -by), (i + 1, by)):
        try:
            found.append(_Side(change, variation.scenario(k)))
        except ValueError:
            found.append(_Side(0.0, base))
    return found[0], found[1]
