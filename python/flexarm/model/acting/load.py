"""Loads: forces and moments on the slices of an arm."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from inspect import signature
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import flexarm._core as _core

from ..._check import Array, array, choice, increasing, instances, number
from ..parts.chain import Chain
from .drive import Law, Torque, split_drives, weak_law

Value = ArrayLike | Callable[[float], Any]


class Load(Law):
    """A force and a moment on a slice, or spread along a beam. (Eq. 52, 53)

    Args:
        link: the link; -1 is the last.
        x: the slice at x metres along that link's beam; None is the link's end (the end effector).
        force, moment: N and N m: three numbers; with `t`, samples (nt, 3), linear in between; a callable t -> three; or
            one of the state, (t, pose, velocity) -> three, of that slice: `pose.p` (3,) is its place and `pose.R`
            (3, 3) its axes (columns), `velocity` (6,) is [v; w], all in the world. Implicit steps and derivatives take
            its slopes by central differences (1e-6 m and rad, 1e-5 m/s and rad/s): it must be smooth over these.
        t: times of the samples (s).
        along: (a, b) metres, instead of x: force (N/m) and moment (N) per length from a to b.
        axes: "world", or "section" for axes that rotate with the slice (a follower force).
    """

    def __init__(
        self,
        link: int | str = -1,
        x: float | None = None,
        *,
        force: Value | None = None,
        moment: Value | None = None,
        t: ArrayLike | None = None,
        along: Sequence[float] | None = None,
        axes: str = "world",
    ) -> None:
        self.link, self.x = link, None if x is None else number("x", x)
        self.axes = choice("axes", axes, ("world", "section"))
        self.along: tuple[float, float] | None = None
        if along is not None:
            a, b = array("along", along, (2,)).tolist()
            self.along = (a, b)
        if x is not None and along is not None:
            raise ValueError(f"along = {along!r}: give x or along, not both")
        if force is None and moment is None:
            raise ValueError("force = None: give a force, a moment, or both")
        self._steady: Array | None = None  # the constant part
        #: the arguments it was made of
        self.given: dict[str, Any] = {
            "link": link, "x": self.x, "force": _argument("force", force), "moment": _argument("moment", moment),
            "t": t, "along": along, "axes": axes,
        }  # fmt: skip
        self.by_state = any(callable(value) and _takes_state(value) for value in (force, moment))
        if self.by_state:
            if t is not None or along is not None:
                raise ValueError("force, moment: a callable of the state acts on one slice, without t and along")
            self.law: Any = _Wrench(force=force, moment=moment)
            return
        if any(callable(value) for value in (force, moment)):
            if t is not None:
                raise ValueError("t: goes with samples, not with a callable")
            self.law = _Wrench(force=force, moment=moment)
            return
        times = np.array([0.0, 1.0]) if t is None else increasing("t", t)
        self.constant = t is None
        shape = (3,) if t is None else (len(times), 3)
        given: dict[str, Any] = {"force": force, "moment": moment}
        columns = [array(name, np.zeros(shape) if value is None else value, shape) for name, value in given.items()]
        wrench = np.broadcast_to(np.concatenate(columns, axis=-1), (len(times), 6))
        self._steady = wrench[0].copy() if self.constant else None
        slope = np.diff(wrench, axis=0) / np.diff(times)[:, None]
        self.law = tuple(_core.PiecewisePolynomial(times, [slope[:, k], wrench[:-1, k]]) for k in range(6))

    def __call__(self, t: float) -> Array:
        """[force; moment] at time t (s), (6,). ValueError if they follow from the state, too."""
        if self.by_state:
            raise ValueError(f"{self}: follows from the state; its law(t, p, R, velocity) tells it")
        if self._steady is not None:
            return self._steady.copy()
        if isinstance(self.law, tuple):
            return np.array([part(t)[0] for part in self.law])
        return np.asarray(self.law(t))

    def _asked(self) -> _core.StateForce:
        """The law as the core takes it, the same one each time. The core does not hold the law: this does."""
        known = self.__dict__.get("_known")
        if known is None or known[0] is not self.law:
            known = self._known = self.law, _core.StateForce(weak_law(self.law))
        return known[1]

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_known"}

    def numbers(self, t: float) -> Array:
        """The numbers for the core at time t: [force; moment], or the time alone if they follow from the state."""
        return np.array([t, *[0.0] * 5]) if self.by_state else self(t)

    def __repr__(self) -> str:
        where = f"along={self.along}" if self.along else f"x={self.x}"
        return f"Load(link={self.link}, {where}, axes={self.axes!r})"

    def place(self, arm: Chain) -> _core.Load:
        """The place on an arm where it acts. ValueError if the arm has no such link or slice."""
        n, world = arm._link(self.link, "load: link"), self.axes == "world"
        if self.along is not None:
            return _along(arm._core, n, *self.along, world)
        if self.by_state:
            return _core.Load.by_state(arm._core, n, self.x, world, self._asked())
        if self.x is not None:
            return _core.Load.at_slice(arm._core, n, self.x, world)
        return _core.Load.at_end(arm._core, n, world)


class Push(Load):
    """The driven force of a strut (N), or tension of a tendon, as a load: the first of its six numbers pushes.

    Args:
        strut: its name.
    """

    def __init__(self, arm: Chain, strut: str, law: Any) -> None:
        self.strut, where = arm._strut(strut), f"drive of '{strut}'"
        if not isinstance(law, Torque):
            raise ValueError(
                f"{where} = {law!r}: must be a Torque, which adds to its force or tension; a Motion "
                "is for a strut with a mass, fa.Strut(..., mass=...)"
            )
        sense = arm.struts[self.strut].sense
        self.where, self.constant, self.by_state = where, law.constant, False
        self._steady = np.array([sense * law(0.0), *[0.0] * 5]) if law.constant else None
        if isinstance(law.law, _core.PiecewisePolynomial):
            self.law = tuple(law.scaled(factor).law for factor in (sense, *[0.0] * 5))
        else:
            self.law = _Pushing(where, law.law, sense)

    def __repr__(self) -> str:
        return self.where

    def place(self, arm: Chain) -> _core.Load:
        return _core.Load.on_strut(arm._core, self.strut)


@dataclass(frozen=True)
class _Pushing:
    """The six numbers of a callable force."""

    where: str
    law: Callable[[float], float]
    sense: float

    def __call__(self, t: float) -> list[float]:
        return [self.sense * array(f"{self.where} at t = {t}", self.law(t), ()).item(), *[0.0] * 5]


def pushes(arm: Chain, drive: Any) -> list[Push]:
    """The driven forces of struts, of the drives of a run."""
    return [Push(arm, name, law) for name, law in split_drives(arm, drive)[2].items()]


def driven_forces(arm: Chain, drive: Any, t: Array) -> Array | None:
    """The forces that the drives of a run add to each Strut, and tensions to each Tendon (N), at times t (nt,):
    (nt, n); None where none is driven."""
    struts = split_drives(arm, drive)[2]
    if not struts:
        return None
    out = np.zeros((len(t), len(arm.struts)))
    for name, law in struts.items():
        out[:, arm._strut(name)] = law(t)
    return out


@lru_cache(maxsize=64)
def _along(arm: _core.Arm, link: int, a: float, b: float, world: bool) -> _core.Load:
    """The place of a load that is spread: its slices take 0.2 ms."""
    return _core.Load.along(arm, link, a, b, world)


class Pose(NamedTuple):
    """Where a slice is in the world, and how it stands there."""

    p: Array
    R: Array


class _Wrench:
    """Force and moment: callables of time or of the state, or constant."""

    def __init__(self, **parts: Any) -> None:
        still = np.zeros(3)
        self.parts = {k: x if callable(x) else array(k, still if x is None else x, (3,)) for k, x in parts.items()}
        self.of_state = {k: callable(x) and _takes_state(x) for k, x in self.parts.items()}

    def __call__(self, t: float, *state: Array) -> list[float]:
        """Of the time, and where one is of the state, of p, R and velocity."""
        given = (t, Pose(*state[:2]), state[2]) if state else (t,)
        found: list[float] = []
        for k, x in self.parts.items():
            if callable(x):
                x = array(f"Load {k} at t = {t}", x(*(given if self.of_state[k] else (t,))), (3,))
            found.extend(float(value) for value in x)
        return found


def _takes_state(value: Callable[..., Any]) -> bool:
    """Whether a callable takes t, pose and velocity, and not t alone."""
    try:
        signature(value).bind(0.0)
    except TypeError:
        return True
    except ValueError:  # one without a signature, as of C
        pass
    return False


def _argument(name: str, value: Any) -> Any:
    return value if value is None or callable(value) else array(name, value)


_NONE = np.zeros((0, 6))


def at_time(arm: Chain, loads: Sequence[Load] | None, t: float) -> tuple[list[_core.Load], Array]:
    """Places and wrenches (n, 6) of loads at time t."""
    if loads is None:
        return [], _NONE
    instances("loads", loads, Load, "Load")
    return [load.place(arm) for load in loads], np.array([load.numbers(t) for load in loads]).reshape(-1, 6)
