"""What the derivatives of a run are by: a parameter, and the problems that it makes when it is a little different."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import flexarm._core as _core

from ..arm.variation import Setup
from .problem import Problem


class Neighbour(NamedTuple):
    """The problem with the parameter changed by `offset`; `weight` times what it gives, summed over all neighbours, is
    the derivative by the parameter. `setup` is what the problem is made of."""

    weight: float
    offset: float
    problem: Problem
    setup: Setup


class Parameter(NamedTuple):
    """A number that a problem depends on: its dotted path, its value, its size (where it is zero, that of its like),
    and the problem's neighbours."""

    path: str
    value: float
    scale: float
    neighbours: list[Neighbour]

    @property
    def forces_only(self) -> bool:
        """Whether it changes no more than controllers and the start."""
        return self.path.partition(".")[0] in ("control", "q0", "v0")


def core_parameters(run: Problem, parameters: Sequence[Parameter]) -> list[_core.Parameter]:
    """Parameters, as the core takes them.

    Raises:
        ValueError: one changes when a controller samples.
    """
    when = [(s.first, s.period, s.delay) for s in run.sampled]
    for p in parameters:
        if any(when != [(s.first, s.period, s.delay) for s in n.problem.sampled] for n in p.neighbours):
            raise ValueError(
                f"parameters: '{p.path}' changes when a controller samples, by which a run has no derivative"
            )
    return [_core.Parameter(p.scale, p.forces_only, [_core.Neighbour(n.weight, n.offset, n.problem.core)
            for n in p.neighbours]) for p in parameters]  # fmt: skip
