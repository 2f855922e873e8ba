"""Parameters of a run's derivatives, and the neighbours of a problem: the same with one parameter a little larger or
smaller. The derivative of the equations of motion by a parameter, at a given state, is a difference of these."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import flexarm._core as _core

from .._check import Array, instances
from ..analysis.assembly import OpenLoops
from ..arm.arm import Arm
from ..arm.variation import Setup, Variation, can_vary, drive_name, numbered, value_at
from .problem import Problem
from .start import moved, start


class Neighbour(NamedTuple):
    """The problem with the parameter changed by `offset`; `weight` times its values, summed over all neighbours, is
    the derivative by the parameter. `setup` is that of the problem."""

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

    @property
    def start_only(self) -> bool:
        """Whether it does not change the equations of motion."""
        return self.path.partition(".")[0] in ("q0", "v0", "sensor")

    @property
    def core(self) -> _core.Parameter:
        near = [_core.Neighbour(n.weight, n.offset, n.problem.core) for n in self.neighbours]
        return _core.Parameter(self.scale, self.forces_only, self.start_only, near)


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
    return [p.core for p in parameters]


class Difference(NamedTuple):
    """A difference quotient. step: in parts of the parameter's scale. ways: places in steps, and weights: central and,
    at a bound of the parameter, on one side."""

    step: float
    ways: tuple[tuple[tuple[int, ...], tuple[float, ...]], ...]

    @staticmethod
    def of(step: float, central: tuple[Any, Any], ahead: tuple[float, ...]) -> Difference:
        places = tuple(range(len(ahead)))
        behind = tuple(-k for k in places), tuple(-w for w in ahead)
        return Difference(step, (central, (places, ahead), behind))


#: of fourth order; and of second order, with half the neighbours: to about 1e-9
FOURTH = Difference.of(3e-4, ((-2, -1, 1, 2), (1 / 12, -2 / 3, 2 / 3, -1 / 12)), (-25 / 12, 4.0, -3.0, 4 / 3, -1 / 4))
SECOND = Difference.of(3e-5, ((-1, 1), (-0.5, 0.5)), (-1.5, 2.0, -0.5))
_RELATIVE = {"drive": "drive", "load": "loads"}  # fields with parameters that are 1 or 0 in their objects
_LEAST = 1e-3  # scale of a value that is nearly zero, as a fit may make it: a smaller step would be lost in rounding
_BESIDE_KINKS = 1e-6  # largest step where forces set in at a place: a larger one reaches over it from far
_SMALLER = (1.0, 1e-2, 1e-4, 1e-6)  # that step again, where the larger one passes a bound


def problems(
    setup: Setup, parameters: Sequence[str], t: ArrayLike, q0: Any, v0: Array | None, tau: Array | None,
    by: Difference = FOURTH, of: tuple[Setup, Mapping[str, Array]] | None = None, starts: bool = True,
) -> list[Parameter]:  # fmt: skip
    """The neighbours of a problem by each parameter.

    Args:
        setup: the arm, and the actions on it.
        parameters: paths of single numbers, as of `simulate_batch`: "link.0.tip.mass", "control.0.kp", "q0.1".
        t, q0, v0, tau: as of `simulate`. Prescribed coordinates start where their motion does.
        by: the differences.
        of: the setup that `setup` was made of, and by which values (1, ...) of parameters: these are the values then,
            such as the scale of a drive, which is 1 in `setup` itself.
        starts: as of Problem.

    Raises:
        ValueError: naming the parameter: nothing that can vary, no single number, or no room to vary in.
    """
    check_paths(parameters)
    first, still = float(np.ravel(t)[0]), {"q0": setup.arm.zero, "v0": np.zeros(setup.arm.nv)}
    begin = start_of(setup, first, q0, v0, tau) if starts else still
    ties = starts and setup.arm.constrained
    follows = isinstance(q0, str) or (ties and (q0 is None or isinstance(q0, Mapping))), ties and v0 is None

    def problem(near: Variation, i: int, alike: Problem | None = None) -> tuple[Problem, Setup]:
        made = near.scenario(i)
        return (alike, made) if alike else (_begun(near, i, t, begin, q0, follows, tau, starts), made)

    return [_parameter(setup, path, begin, by, of, problem) for path in parameters]


def check_paths(parameters: Sequence[str], least: int = 0) -> None:
    words = "different paths, such as ['link.0.tip.mass']"
    paths = instances("parameters", parameters, object, words, least)
    if not all(isinstance(p, str) for p in paths) or len(set(paths)) != len(paths):
        raise ValueError(f"parameters = {parameters!r}: must be a list of {words}")


def start_of(setup: Setup, t: float, q0: Any, v0: Array | None, tau: Array | None) -> dict[str, Array]:
    """q0 and v0 in numbers, at time t (s)."""
    arm = setup.arm
    q = start(arm, q0, setup.drive, setup.loads, t, tau, setup.control)
    return {"q0": q, "v0": np.zeros(arm.nv) if v0 is None else v0}


def _has_kinks(arm: Arm) -> bool:
    """Whether forces set in at places that parameters may move: of contacts, ropes and stops."""
    stops = [x for link in arm.links for x in (link.joint.lower, link.joint.upper) if x is not None]
    ropes = any(s.tension_only for s in arm.struts)
    return bool(arm.contacts) or ropes or bool(np.isfinite(np.hstack([np.inf, *stops])).any())


def _parameter(
    setup: Setup, path: str, begin: dict[str, Array], by: Difference, of: tuple[Setup, Mapping[str, Array]] | None,
    problem: Callable[..., tuple[Problem, Setup]],
) -> Parameter:  # fmt: skip
    value, scale = _value(setup, path, begin)
    others: dict[str, Array] = {}
    if of is not None and path in of[1]:
        value, root = float(of[1][path][0]), path.partition(".")[0]
        scale = max(abs(value), _LEAST) if value else scale
        if root in _RELATIVE:
            setup = replace(setup, **{_RELATIVE[root]: getattr(of[0], _RELATIVE[root])})
            others = {p: x for p, x in of[1].items() if p != path and p.startswith(root + ".")}
    why: ValueError | None = None
    step = min(by.step, _BESIDE_KINKS) if _has_kinks(setup.arm) else by.step
    for smaller in _SMALLER:
        h = step * scale * smaller
        for steps, weights in by.ways:
            offsets = h * np.array(steps)
            try:
                near = Variation(setup, {**others, path: value + offsets}, once=True)
                found = [problem(near, 0)]
                alike = found[0][0] if path.startswith("sensor.") else None  # sensors take no part in a run
                found += [problem(near, i, alike) for i in range(1, len(steps))]
            except OpenLoops as e:
                raise ValueError(
                    f"parameters: '{path}' = {value} moves constraints of loops, which a start in numbers does not "
                    f"follow (leave q0 and v0 out, or name joints, as in q0 = {{'crank': 0.5}}): {e}"
                ) from None
            except ValueError as e:
                why = why or e
                continue
            near_by = [Neighbour(w / h, float(d), p, s)
                       for w, d, (p, s) in zip(weights, offsets, found, strict=True)]  # fmt: skip
            return Parameter(path, value, scale, near_by)
    raise ValueError(f"parameters: '{path}' = {value} cannot be varied: {why}") from None


def _begun(
    near: Variation, i: int, t: ArrayLike, begin: dict[str, Array], q0: Any, follows: tuple[bool, bool],
    tau: Array | None, starts: bool,
) -> Problem:  # fmt: skip
    """A neighbour. `begin`: the start of the run in numbers; `follows`: whether its q0 and its v0 are its own, of the
    balance or the closed loops that it has."""
    made, v0 = near.scenario(i), None
    if starts and made.arm.constrained:  # numbers that are given must leave the loops closed
        q, v, _ = moved(made.arm, begin["q0"], begin["v0"], made.drive, float(np.ravel(t)[0]))
        q0, v0 = q0 if follows[0] else q, None if follows[1] else v
    elif not follows[0]:
        q0 = None
    out = Problem(made, t, q0, v0, tau, starts=starts)
    given = {"q0": [made.arm.coordinate_of(k) for k in out.prescribed], "v0": out.prescribed}
    for (name, value), own in zip(begin.items(), follows, strict=True):
        rows = near.initial(name, (out.start[name].copy() if own else value)[None])
        free = np.ones(value.size, dtype=bool)
        free[given[name]] = False
        out.start[name][free] = rows[i % len(rows)][free]
    return out


def drive_of(setup: Setup, path: str) -> tuple[Any, Any]:
    """The key of a drive, and the drive, by its name in a path."""
    for key, law in setup.drive.items():
        if drive_name(key) == path:
            return key, law
    known = ", ".join(drive_name(key) for key in setup.drive) or "none"
    raise ValueError(f"parameters: there is no drive '{path}'; drives are {known}")


def components(setup: Setup, path: str, start: dict[str, Array]) -> list[str]:
    """The paths of the single numbers at a path: itself, or one for each of its components."""
    here, _ = value_at(setup, path, start)
    if isinstance(here, (tuple, list, np.ndarray)) and np.ndim(here) == 1 and all(np.isreal(x) for x in here):
        return [f"{path}.{k}" for k in range(len(here))]
    return [path]


def _value(setup: Setup, path: str, start: dict[str, Array]) -> tuple[float, float]:
    """The number at a path, and its size."""
    here, like = value_at(setup, path, start)
    if not isinstance(here, (int, float, np.floating)) or isinstance(here, bool) or not np.isfinite(here):
        if not can_vary(numbered(setup, path), setup.known):
            Variation(setup, {path: [1.0]})  # whose message has a path that is like it
        raise ValueError(f"parameters: '{path}' is no single number that can vary")
    size = abs(float(here))
    if size == 0.0 and isinstance(like, (np.ndarray, tuple, list)):
        size = float(np.max(np.abs(np.asarray(like, dtype=float))))
    return float(here), max(size, _LEAST) if size else 1.0
