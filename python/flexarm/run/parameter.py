"""What the derivatives of a run are by: a parameter, and the problems that it makes when it is a little different."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from .._check import Array
from ..acting.control import padded
from .problem import Problem
from .variation import Setup


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


def core_start(run: Problem) -> tuple[Array, Array, Array]:
    """q0, v0 and tau of a problem, as the core takes them: with the states of its controllers."""
    start, both = run.start, run.both
    return padded(start["q0"], both.nq), padded(start["v0"], both.nv), padded(start["tau"], both.nv)


def core_laws(run: Problem) -> list[tuple[int, bool, Any, Any]]:
    """Its drives, as the core takes them."""
    nv = run.both.nv
    return [(i, moves, law, padded(column, nv) if column.size else column) for i, moves, law, column in run.laws]


def core_parameters(run: Problem, parameters: Sequence[Parameter]) -> list[Any]:
    """Parameters, as the core takes them.

    Raises:
        ValueError: where the derivatives of a run do not go through a controller.
    """
    return [(p.scale, p.forces_only, [_core_neighbour(run, p.path, n) for n in p.neighbours]) for p in parameters]


def _core_neighbour(run: Problem, path: str, near: Neighbour) -> Any:
    its = near.problem
    if [law[:3] for law in its.sampled] != [law[:3] for law in run.sampled]:
        raise ValueError(f"parameters: '{path}' changes when a controller samples, by which a run has no derivative")
    q0, v0, tau = core_start(its)
    laws = (core_laws(its), its.wrenches, tau, its.feedback, its.sampled)
    return near.weight, near.offset, its.both._core, *laws, q0, v0
