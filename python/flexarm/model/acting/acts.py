"""The actions on an arm (drives, loads, controllers) as the core takes them, for a run or for a model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import flexarm._core as _core
from flexarm._core import Feedback

from ..._check import Array
from ..parts.chain import Chain
from .control import control_laws, controllers, extended, padded
from .drive import KNOWN, Motion, Torque, patch_laws, split_drives, standing, weak_law
from .load import Load, at_time, pushes


class Acts:
    """Drives, loads and controllers over the times of a run, checked.

    Attributes:
        arm, times, loads: as given. forces: the loads, and the driven forces of struts as loads, with
            `force_names` in errors. strut_drives: of struts, by name.
        drives, feedback, sampled: as the core takes them.
        motions: prescribed motions by rate; prescribed: these rates.
        both: the arm, extended by a link for each state of a controller, which the core integrates.
        remembered: callables of time that several runs share, by their id; each is called once for a time.
    """

    def __init__(
        self, arm: Any, times: Array, drive: Any, loads: Any, control: Any,
        remembered: dict[int, _core.Remembered] | None = None,
    ) -> None:  # fmt: skip
        self.arm, self.times, self.remembered = arm, times, remembered
        joints, patches, self.strut_drives = split_drives(arm, drive)
        self.drives = patch_laws(arm, patches, times)
        self.motions: dict[int, Motion] = {}
        for i, law in arm.by_rate("drive", joints).items():
            self._drive(i, law)
        self.prescribed = [d.rate for d in self.drives if d.moves]
        driven, start = pushes(arm, drive), float(times[0])
        self._places = [*at_time(arm, loads, start)[0], *at_time(arm, driven, start)[0]]
        self.loads: tuple[Load, ...] = tuple(loads or ())
        self.forces: tuple[Load, ...] = (*self.loads, *driven)
        self.force_names = [f"loads[{k}]" for k in range(len(self.loads))]
        self.force_names += [f"drive of '{name}'" for name in self.strut_drives]
        for name, force in zip(self.force_names, self.forces, strict=True):
            force.check_span(name, times)
        self.feedback, self.sampled, memory = control_laws(arm, control, times, self.forces, self.prescribed)
        self.both = extended(arm, memory) if memory else arm

    def _drive(self, i: int, law: Any) -> None:
        where = f"drive of '{self.arm.coordinates[i]}'"
        if not isinstance(law, (Motion, Torque)):
            raise ValueError(f"{where} = {law!r}: must be a Motion or a Torque")
        law.check_span(where, self.times)
        self.drives.append(_core.Drive(i, isinstance(law, Motion), law.law))
        if isinstance(law, Torque):
            return
        law.check_rates(where, self.times)
        if self.arm.coordinate_of(i) < 0:
            raise ValueError(f"{where}: the motion of a ball cannot be prescribed; use three rotations (Axes)")
        self.motions[i] = law

    def core_problem(
        self, start: Mapping[str, Array], events: Sequence[_core.Event] = (), onward: bool = False, weak: bool = False
    ) -> _core.Problem:
        """The core's problem of one run from `start` (q0, v0, tau). `onward`: sampled laws are constant outside their
        samples. `weak`: it holds no function of these acts, which live as long as it."""
        both, nv = self.both, self.both.nv

        def law(x: Any) -> Any:
            taken = standing(x) if onward else self._law(x)
            return weak_law(taken) if weak else taken

        drives = [_core.Drive(d.rate, d.moves, law(d.law), padded(d.column, nv) if d.column.size else d.column)
                  for d in self.drives]  # fmt: skip
        loads = [_core.LoadLaw(place, law(load.law)) for place, load in zip(self._places, self.forces, strict=True)]
        feedback = [Feedback(f.column, f.by_q, f.by_v, law(f.reference), f.limit) for f in self.feedback]
        return _core.Problem(
            arm=both._core, t=self.times, q0=padded(start["q0"], both.nq), v0=padded(start["v0"], nv),
            tau=padded(start["tau"], nv), drives=drives, loads=loads, feedback=feedback,
            events=[_core.Event(weak_law(e.value), e.terminal, e.direction) for e in events] if weak else list(events),
            samplers=[_core.Sampler(s.first, s.period, s.delay, weak_law(s.law)) for s in self.sampled] if weak
            else self.sampled,
        )  # fmt: skip

    def _law(self, law: Any) -> Any:
        """A law of time, as the core takes it."""
        if self.remembered is None or isinstance(law, KNOWN):
            return law
        return self.remembered.setdefault(id(law), _core.Remembered(law))

    @property
    def shares(self) -> bool:
        """Whether several runs may share this: its sampled laws have no memory, or are the core's, which every run
        copies."""
        return all(isinstance(s.law, _core.ComputedTorque) or (isinstance(s.law, _core.LinearLaw) and not s.law.reads)
                   for s in self.sampled)  # fmt: skip


def acts_from(arm: Chain, t: float, step: float, drive: Any, loads: Any, control: Any) -> Acts:
    """Actions from time t on, without an end."""
    if any(c.of_arm for c in controllers(control)):
        raise ValueError("control: a FeedForward is fitted to the times of a run, and there are none; give its torques")
    return Acts(arm, np.array([t, t + step]), drive, loads, control)


def predictable(acts: Acts) -> Acts:
    """The same actions; raises ValueError unless all sampled laws are linear."""
    for k, law in enumerate(x.law for x in acts.sampled):
        if not isinstance(law, _core.LinearLaw) or law.reads:
            raise ValueError(
                f"control: sampled law {k} is not linear, or reads sensors, and cannot be predicted: give a "
                "LinearController without sensors"
            )
    return acts


def at_rest(arm: Chain) -> dict[str, Array]:
    """The initial state of an arm at rest: q0, v0, tau."""
    return {"q0": arm.zero, "v0": np.zeros(arm.nv), "tau": np.zeros(arm.nv)}
