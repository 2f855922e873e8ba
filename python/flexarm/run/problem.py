"""The arguments of a run, checked, as the core takes them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import flexarm._core as _core

from .._check import Array, array, increasing, number, whole
from ..analysis.assembly import closed_start
from ..analysis.findings import LoopWarning, RunWarning
from ..arm.arm import Arm
from ..arm.variation import Setup
from ..loop import loops
from ..model.acting.acts import Acts
from ..model.acting.control import PD, controllers
from ..model.acting.load import driven_forces
from ..model.parts.labels import joint_rates
from .held import held
from .result import Result
from .start import start
from .steps import missed
from .touch import OfContact, bound

_LOOKS = 201  # at a command


class Problem(Acts):
    """A run before it begins: its arguments, checked, as the core takes them. Where it `starts`, loops are closed; if
    not, its caller says where a run begins.

    Args:
        of: a Setup or a Scene: an arm, and its drives, loads and controllers.
        t, q0, v0, tau, events: as of `simulate`. remembered: see Acts.

    Attributes:
        setup, controls: as given. start: q0, v0 and tau, of the arm alone. events, asked_events: as the core takes
            them, and as given. Others: see Acts.
        tell: called during the run with the warning that it is very slow; None: that is not looked for.
    """

    tell: Callable[[RunWarning], None] | None = None

    def __init__(
        self, of: Any, t: ArrayLike, q0: Any = None, v0: Any = None, tau: Any = None, events: Any = None,
        remembered: dict[int, _core.Remembered] | None = None, *, starts: bool = True,
    ) -> None:  # fmt: skip
        arm, times, acting = of.arm, increasing("t", t), of.control
        if isinstance(q0, str) and q0 == "held":
            q, setup = held(of, float(times[0]), tau)
            acting = setup.control
        else:
            q = start(arm, q0, of.drive, of.loads, float(times[0]), tau) if isinstance(q0, str) else arm._posed(q0)
        self.start = _initial_state(arm, q, v0, tau)
        super().__init__(arm, times, of.drive, of.loads, acting, remembered)
        said = {"q0": [] if q is None else list(range(arm.nv)), "v0": [] if v0 is None else list(range(arm.nv))}
        follow = arm.constrained and (q0 is None or isinstance(q0, Mapping))  # joints that are not named close loops
        if follow:
            said["q0"] = [i for key in q0 or () for i in arm.joint_rates(key)]
        self._start_motions(said)
        if starts:
            self.start["q0"], self.start["v0"] = closed_start(
                arm, self.start["q0"], self.start["v0"], (not follow, v0 is not None), self.motions, said["q0"]
            )
        self.setup = Setup(arm, dict(of.drive or {}), self.loads, controllers(of.control))
        self.controls = list(self.setup.control)
        found = read_events(events)
        self.asked_events = [f for f, *_ in found]
        self.events = [_core.Event(self._of_arm(f), *rest) for f, *rest in found]

    def _start_motions(self, given: Mapping[str, Sequence[int]]) -> None:
        """Prescribed joints start where their motion does; a q0 or v0 that was `given` for these rates and says
        otherwise is an error."""
        begin = float(self.times[0])
        for i, motion in self.motions.items():
            where = f"drive of '{self.arm.coordinates[i]}'"
            at = array(f"{where} at t = {begin}", motion(begin), (3,))
            for name, k, value in (("q0", self.arm.coordinate_of(i), at[0]), ("v0", i, at[1])):
                state = self.start[name]
                if i in given[name] and abs(state[k] - value) > 1e-9 * max(1.0, abs(value)):
                    raise ValueError(f"{name}[{k}] = {state[k]}: {where} prescribes {value} at t = {begin}")
                state[k] = value

    @cached_property
    def core(self) -> _core.Problem:
        """It, with the states of its controllers, for one run: it notes where its callables were asked."""
        return self.core_problem(self.start, self.events)

    def __getstate__(self) -> dict[str, Any]:
        return {k: x for k, x in vars(self).items() if k != "core"}

    def _of_arm(self, event: Callable[..., Any]) -> Callable[..., Any]:
        """The event, of the arm's part of q and v."""
        nq, nv, event = self.arm.nq, self.arm.nv, bound(event, self.arm)
        return lambda t, q, v: event(t, q[:nq], v[:nv])

    def unstable(self, time: float, failed: bool) -> LoopWarning | None:
        """The loop of control that has made the run grow in `time` (s), if one has."""
        if not self.controls:
            return None
        return loops.unstable(
            self.arm, self.start["q0"], self.prescribed, self.times, self.forces, self.controls, time, failed,
            self.sampled,
        )  # fmt: skip

    def in_degrees(self) -> str:
        """The joint that starts at, or is commanded to, an angle above a turn, and the question whether that is in
        degrees; "" if there is none. A motion that still turns at its end is a spin, which is not asked about."""
        commands = {d.rate: d.law for d in self.drives if d.moves}
        commands |= {law._rate(self.arm): law.reference for law in self.controls if isinstance(law, PD)}
        for i, name, unit in joint_rates(self.arm):
            at = self.arm.coordinate_of(i)
            if unit != "rad" or at < 0:  # a ball has no angle
                continue
            told = [("starts at", float(self.start["q0"][at]))]
            if i in commands:
                told.append(("is commanded to", _farthest(commands[i], self.times)))
            for words, angle in told:
                if abs(angle) > 2 * np.pi:
                    return f"'{name}' {words} {angle:.4g} rad: was that meant in degrees? Angles are in radians"
        return ""

    def result(self, out: dict[str, Any]) -> Result:
        """Makes a Result of the core's output, and leaves the controllers' states out."""
        arm, done = self.arm, len(out["q"])
        sizes = {"q": arm.nq, "v": arm.nv, "a": arm.nv, "tau": arm.nv, "friction": arm.nv}
        kept: dict[str, Any] = {k: out[k] for k in sizes}
        if self.both is not arm:
            kept = {k: None if x is None else np.ascontiguousarray(x[:, : sizes[k]]) for k, x in kept.items()}
        status = int(out["terminated"])
        found = Result(arm, self.times[:done], stats=out["stats"], loads=self.loads, status=status, **kept)
        found.driven = driven_forces(arm, self.strut_drives, found.t)
        if arm.contacts:
            found.contacts = np.reshape(out["contacts"], (done, len(arm.contacts), 3))
        if arm.loops:
            found.loops = np.reshape(out["loops"], (done, len(arm.loops), 6))
        if self.events:
            found.t_events, q, v = out["events"]
            found.q_events, found.v_events = [x[:, : arm.nq] for x in q], [x[:, : arm.nv] for x in v]
        return found

    def missed(self) -> Iterator[RunWarning | None]:
        """Warnings of pulses of callables that no step has seen: of drives, loads and references of control."""
        if all(calls is None for calls in self.core.asked):
            return
        names = ["voltage" if len(d.column) else f"drive of '{self.arm.coordinates[d.rate]}'" for d in self.drives]
        names += self.force_names
        callables = [d.law for d in self.drives] + [x.law for x in self.forces]
        references = [f.reference for f in self.feedback if f.reference is not None]
        names += ["reference of control"] * len(references)
        for name, law, calls in zip(names, callables + references, self.core.asked, strict=True):
            if calls is not None:
                yield missed(name, law, calls, float(self.times[0]), float(self.times[-1]))


def _farthest(law: Any, times: Array) -> float:
    """Of all angles that a command reaches, the farthest from zero; 0 of one that still turns at its end."""
    found = [np.ravel(law(float(t))) for t in np.linspace(times[0], times[-1], _LOOKS)]
    q = np.array([x[0] for x in found])
    rates = np.gradient(q, times[-1] - times[0]) * (_LOOKS - 1)  # per s
    spins = abs(rates[-1]) > 0.1 * np.abs(rates).max()
    return 0.0 if spins else float(q[np.argmax(np.abs(q))])


def _initial_state(arm: Arm, q0: Any, v0: Any, tau: Any) -> dict[str, Array]:
    """q0, v0 and tau, zero where they are None."""
    state = {}
    for name, value, zero in (("q0", q0, arm.zero), ("v0", v0, np.zeros(arm.nv)), ("tau", tau, np.zeros(arm.nv))):
        if name == "tau" and value is not None and np.ndim(value) > 1:
            raise ValueError("tau: must be constant here; give drive=Torque(t, tau) for one that changes with time")
        if value is None:
            state[name] = zero
            continue
        with arm._pointing_to_pose("q0"):
            state[name] = array(name, value, zero.shape)
    arm.check_balls("q0", state["q0"])
    return state


def read_events(events: Any) -> list[tuple[Any, int, int]]:
    """(callable or event of a contact, occurrence that ends the run or 0, direction) of each event."""
    given = [] if events is None else [events] if callable(events) or isinstance(events, OfContact) else events
    must = "must be a callable (t, q, v) -> float, a Touch or a Release"
    if not isinstance(given, (list, tuple)):
        raise ValueError(f"events = {events!r}: {must}, or a list of them")
    out = []
    for k, f in enumerate(given):
        if not callable(f) and not isinstance(f, OfContact):
            raise ValueError(f"events[{k}] = {f!r}: {must}")
        terminal, direction = getattr(f, "terminal", False), getattr(f, "direction", 0)
        count = int(terminal) if isinstance(terminal, (bool, np.bool_)) else whole(f"events[{k}].terminal", terminal)
        if count < 0:
            raise ValueError(f"events[{k}].terminal = {terminal}: must be True, False or a number of occurrences")
        if number(f"events[{k}].direction", direction) not in (-1, 0, 1):
            raise ValueError(f"events[{k}].direction = {direction}: must be -1, 0 or 1")
        out.append((f, count, int(direction)))
    return out
