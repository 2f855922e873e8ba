"""The cheapest model of a scene whose error stays below a tolerance: `economize`, `flexarm economize`."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._check import number
from .._console import progress_bar
from ..arm import Arm
from ..run.result import Result
from ..run.watch import Watch
from ..scene.scene import Scene, load
from .choices import Choice, choices_of, speed_of
from .economy import Economy, Findings, decide
from .measure import Quantity
from .rung import Model

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(repr=False)
class Plan:
    """What `economize` decided. `print(plan)` shows the table.

    Attributes:
        given: the scene as it was. scene: the same with the lean model and its integrator. arm: that model.
        rich: the scene with the model that the plan was checked against.
        quantity: "tip", "joint", "strain", or the name of the callable.
        tol: the tolerance, over the quantity's span, or (absolute) in its unit. span: by unit, how far it moves.
        certified: whether the check agreed: the lean run is within `tol` of the enriched model, and the reference,
            against which the choices were made, within a third of it, and what symmetry leaves out does not grow
            within the run. reasons: why not.
        error: largest distance of the lean run from the check's, in the terms of `tol`.
        time: wall time of the lean run (s). seconds: that deciding took. runs: simulations that it took.
        choices: every choice; see Choice.
        watch: monitors for `simulate(..., watch=plan.watch)`: the range that the lean run has used, and half as much.
    """

    given: Scene
    scene: Scene
    rich: Scene
    quantity: str
    tol: float
    absolute: bool
    span: dict[str, float]
    certified: bool
    reasons: list[str]
    error: float
    time: float
    seconds: float
    runs: int
    choices: list[Choice]
    watch: Watch
    _walk: Economy
    _found: Findings

    @property
    def arm(self) -> Arm:
        """The lean arm: no coordinate that the scene does not need."""
        return self.scene.arm

    @property
    def model(self) -> str:
        """The lean model in words."""
        return self._walk.rungs.label(self._found.lean.model)

    def __repr__(self) -> str:
        word = "certified" if self.certified else "not certified"
        return f"Plan({self.given.name!r}, {self.quantity}, tol={self.tol:g}, {word}: {self.model})"

    def __str__(self) -> str:
        return self.table()

    def table(self) -> str:
        """The model, the check, and every choice with the error of leaving it out and the time of putting it in."""
        from .economize_text import table

        return table(self)

    def plot(self) -> Figure:
        """Error against wall time of all runs that deciding took, the chosen one marked."""
        from .economize_figure import plot_plan

        return plot_plan(self)

    def save(self, path: str | Path) -> None:
        """Writes the lean scene as a scene file that `load` reads back. Functions of time are sampled.

        Raises:
            ValueError: what no scene file can hold; see Scene.save.
        """
        word = "certified" if self.certified else f"NOT CERTIFIED: {'; '.join(self.reasons)}"
        self.scene.save(path, f"Made by flexarm economize: {self.quantity} within {_tolerance(self)}, {word}.")

    def run(self, adapt: bool = False, t: Any = None, progress: bool = False) -> Result:
        """Simulates the lean scene, watched.

        Args:
            adapt: where a monitor speaks up, goes on with a richer arm from the output time before. The
                result is then in the richer arm's coordinates throughout, those that the lean arm lacks zero until
                then. Scenes whose controllers have a memory, or sample, begin anew with the richer arm.
            t: other output times (s), say a longer run. None: the scene's.

        Warns:
            WatchWarning: the run left the range that the model was chosen for, and adapt is False.
        """
        from .adapt import adapted, watched

        scene = self.scene if t is None else replace(self.scene, t=np.asarray(t, dtype=float))
        if not adapt:
            return watched(scene, self.watch, progress)
        rungs = self._walk.rungs
        # a richer arm takes over with a jump, as it has what the lean one never bent: fast modes must bear that and die
        step = min(float(np.median(np.diff(scene.t))), self.rich.options.get("step", np.inf)) / 2
        options = {"integrator": "implicit", "step": step, "spectral_radius": 0.9}
        richer = rungs.at(self._walk.richer(self._found.lean.model), options)
        return adapted(scene, richer.arm, options, self.watch, progress)

    @property
    def _rich_model(self) -> Model:
        return (self._found.check or self._found.reference).model

    def to_dict(self) -> dict[str, Any]:
        """Everything but the trajectories, ready for JSON."""
        keep = (
            "quantity",
            "tol",
            "absolute",
            "span",
            "certified",
            "reasons",
            "error",
            "time",
            "seconds",
            "runs",
            "model",
        )
        about = {k: getattr(self, k) for k in keep}
        count = speed_of(self._walk, self._found)
        return {
            "scene": self.given.name,
            **about,
            "coordinates": {"given": self.given.arm.nv, "lean": self.arm.nv, "rich": self.rich.arm.nv},
            "options": self.scene.options,
            "evaluation": count,
            "choices": [c.to_dict() for c in self.choices],
        }


def _tolerance(plan: Plan) -> str:
    unit = " ".join(plan.span) if plan.absolute else "of its span"
    return f"{plan.tol:g} {unit}".rstrip()


def _checked(tol: float, atol: float | None, time_budget: float | None) -> float:
    if atol is not None:
        if not 0 < number("atol", atol) < math.inf:
            raise ValueError(f"atol = {atol}: must be positive and finite, in the quantity's unit")
    elif not 0 < number("tol", tol) < 1:
        raise ValueError(f"tol = {tol}: must be between 0 and 1, as a share of the quantity's span; absolute: atol=")
    if time_budget is not None and not 0 < number("time_budget", time_budget) < math.inf:
        raise ValueError(f"time_budget = {time_budget}: must be positive and finite, in seconds, or None")
    return tol if atol is None else atol


def economize(
    scene: Scene | str | Path,
    tol: float = 1e-3,
    quantity: str | Callable[[Result], Any] = "tip",
    time_budget: float | None = None,
    *,
    atol: float | None = None,
    progress: bool = False,
) -> Plan:
    """The cheapest model of a scene whose error over the scene's run is below a tolerance.

    First indicators: what symmetry rules out, and what a run of the scene's own model leaves unbalanced in a richer
    one. Then a walk down from what these say may matter, each step verified by simulation. Then one check against an
    enriched model, not on the path: more modes, every strain that moves at all, exact rotation, finer steps.

    Args:
        scene: a Scene, a scene file, or the name of a shipped scene.
        tol: over the quantity's span, the largest range of any one component, between 0 and 1.
        quantity: "tip", the position of the arm's end; "joint", the coordinates of those joints that are not
            prescribed; "strain", the curvatures of every beam at its clamp (and shear angles, where the scene's own
            beams have them); or a callable of a Result that returns an array (nt,) or (nt, k).
        time_budget: seconds for deciding; None: as many as it takes. What is found until then is not certified.
        atol: an absolute tolerance in the quantity's SI unit, in place of tol: atol=1e-3 is a millimetre of the tip.
        progress: shows what is being done on stderr, where that is a terminal.

    Returns:
        Plan: `.arm`, `.scene`, `.certified`, `.choices`, `.save("lean.toml")`, `.plot()`.

    Raises:
        ValueError: bad arguments, a scene that cannot be run, or a quantity that does not move in it.
    """
    limit = _checked(tol, atol, time_budget)
    if isinstance(scene, (str, Path)):
        scene = load(scene)
    if not isinstance(scene, Scene):
        raise ValueError(f"scene = {scene!r}: must be a Scene, or the path of a scene file")
    what = Quantity(scene, quantity, atol)
    started = time.perf_counter()
    with progress_bar(progress, "deciding", None) as bar:
        tell = (lambda doing: bar(0, doing)) if bar else lambda doing: None
        walk, found = decide(scene, what, limit, time_budget, tell)
        choices = choices_of(walk, found)
    lean = found.lean
    assert lean.result is not None
    rich = found.check or found.reference
    certified = found.check is not None and not found.reasons
    error = found.error if found.check is not None else math.inf
    return Plan(
        scene,
        walk.trials.scene(lean.model, {**_kept(scene), **lean.options}),
        walk.trials.scene(rich.model, {**_kept(scene), **rich.options}),
        what.name, limit, atol is not None, what.ranges, certified, found.reasons, error,
        lean.time, time.perf_counter() - started, len(walk.trials.runs), choices,
        Watch.around(lean.result), walk, found,
    )  # fmt: skip


def _kept(scene: Scene) -> dict[str, Any]:
    return {k: v for k, v in scene.options.items() if k == "method"}
