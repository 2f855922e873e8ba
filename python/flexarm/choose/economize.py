"""The cheapest model of a scene whose error stays below a tolerance: `economize`, `flexarm economize`."""

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from .._check import between, outside, positive
from .._console import aligned, progress_bar, seconds
from ..analysis.findings import RangeWarning, RunWarning
from ..arm.arm import Arm
from ..data.draw.style import Figure
from ..data.draw.tradeoff import Point, Trial, plot_trials
from ..model.acting.load import driven_forces
from ..model.acting.sampled import Sampled
from ..run.integrators import named
from ..run.result import Result
from ..run.scene.scene import Scene
from ..run.watch import Watch
from .choices import Choice, choices_of, speed_of
from .economize_search import EconomizeSearch
from .measures import Measure
from .models import Model, read_scene
from .states import embed, restated
from .trials import Budget, OutOfTime, Run, setting_words, silent


@dataclass(repr=False)
class ModelPlan:
    """The cheapest model of a scene within a tolerance, and the choices that led to it. `print(plan)` shows the table.

    Attributes:
        given: the scene as given. scene: the same with the lean model and its integrator. arm: that model.
        rich: the scene with the model that the plan was checked against.
        quantity: "tip", "joint", "strain", or the name of the callable.
        tolerance: the tolerance, over the quantity's span, or (absolute) in its unit. span: by unit, the quantity's
            range.
        certified: whether the check agreed: the lean run is within `tolerance` of the enriched model, and the
            reference, against which the choices were made, within a third of it, and motions that symmetry excludes do
            not grow within the run. reasons: why not.
        error: largest distance of the lean run from the check's, in the unit of `tolerance`.
        time: wall time of the lean run (s). seconds, runs: wall time and simulations used for deciding.
        choices: every choice; see Choice.
        watch: limits for `result.check(plan.watch)`: the range of the lean run, and half as much beyond.
    """

    given: Scene
    scene: Scene
    rich: Scene
    quantity: str
    tolerance: float
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
    _search: EconomizeSearch

    @property
    def arm(self) -> Arm:
        """The lean arm, with only the coordinates that the scene needs."""
        return self.scene.arm

    @property
    def model(self) -> str:
        """The lean model in words."""
        return self._search.models.label(self._search.lean.model)

    def __repr__(self) -> str:
        word = "certified" if self.certified else "not certified"
        return f"ModelPlan({self.given.name!r}, {self.quantity}, tolerance={self.tolerance:g}, {word}: {self.model})"

    def __str__(self) -> str:
        return self.table()

    def table(self) -> str:
        """The model, the check, and every choice with the error without it and the time of including it."""
        rows = [["", "choice", "", "error without", "from", "time", ""]]
        last = ""
        for c in self.choices:
            where, last = ("" if c.where == last else c.where), c.where
            rows.append([where, c.what, c.chosen, _number(c.without), c.how, _share(c), "in" if c.inside else ""])
        table = aligned(rows, {3, 5})
        return "\n".join([*_head(self), "", *_speed(self), "", *table, _NOTE, "", *_indicators(self)])

    def plot(self) -> Figure:
        """Error against wall time of all runs made, of the scene as given (run now), and of the chosen model."""
        evidence, trials = self._search, self._search.trials
        given = self._given_run()

        def point(run: Run) -> Point:
            return run.time, max(trials.distance(run, evidence.rich), 1e-4 * self.tolerance)

        ran = [r for r in trials.runs.values() if r.values is not None and r is not evidence.rich]
        models = [Trial(*point(r), _order(r.model)) for r in ran if not r.whole]
        settings = [point(r) for r in evidence.settings if r in ran]
        spans = ", ".join(f"{s:.3g} {u}".rstrip() for u, s in self.span.items())
        unit = " ".join(self.span) if self.absolute else f"share of its span, {spans}"
        return plot_trials(
            models, settings, None if given is None else point(given), point(evidence.lean), self.tolerance,
            self.absolute,
            ylabel=f"Largest error of the {self.quantity} ({unit})",
            title=self.given.name,
            under=f"chosen: {self.model}",
            notes=[] if self.certified else [f"NOT CERTIFIED: {reason}" for reason in self.reasons],
        )  # fmt: skip

    def _given_run(self) -> Run | None:
        """A run of the scene as given: its own model, integrator and output times; None if it cannot be run."""
        options = {"integrator": named(self.given, None, self.given.options), **self.given.options}
        try:
            given = self._search.trials.run(self._search.models.given, options, whole=True)
        except (OutOfTime, ValueError):
            return None
        return None if given.values is None else given

    def save(self, path: str | Path) -> None:
        """Writes the lean scene as a scene file that `load` reads back. Functions of time are sampled.

        Raises:
            ValueError: a part that no scene file can hold; see Scene.save.
        """
        word = "certified" if self.certified else f"NOT CERTIFIED: {'; '.join(self.reasons)}"
        self.scene.save(path, f"Made by flexarm economize: {self.quantity} within {_tolerance(self)}, {word}.")

    def run(self, adapt: bool = False, t: Any = None, progress: bool = False) -> Result:
        """Simulates the lean scene with the monitors of `watch`.

        Args:
            adapt: if a monitor reports, continue with a richer arm from the output time before. The result is then in
                the richer arm's coordinates throughout; those that the lean arm lacks are zero until then. Scenes with
                controllers that have a memory, or sample, begin anew with the richer arm.
            t: other output times (s), say a longer run. None: the scene's.

        Warns:
            RangeWarning: the run left the range that the model was chosen for, and adapt is False.
        """
        scene = self.scene if t is None else replace(self.scene, t=np.asarray(t, dtype=float))
        if not adapt:
            return watched(scene, self.watch, progress)
        # the change to a richer arm is a jump that excites its fast modes: the integrator must damp them
        step = min(float(np.median(np.diff(scene.t))), self.rich.options.get("step", np.inf)) / 2
        options = {"integrator": "implicit", "step": step, "spectral_radius": 0.9}
        richer = self._search.models.arm(self._search.richer(self._search.lean.model))
        return adapted(scene, richer, options, self.watch, progress)

    def to_dict(self) -> dict[str, Any]:
        """Everything but the trajectories, ready for JSON."""
        keep = "quantity tolerance absolute span certified reasons error time seconds runs model".split()
        about = {k: getattr(self, k) for k in keep}
        return {
            "scene": self.given.name,
            **about,
            "coordinates": {"given": self.given.arm.nv, "lean": self.arm.nv, "rich": self.rich.arm.nv},
            "options": self.scene.options,
            "evaluation": speed_of(self._search),
            "choices": [vars(c) for c in self.choices],
        }


def _order(model: Model) -> int | str:
    """The order of its elastic beams, for the picture; "mixed" if they differ."""
    orders = {beam.order for beam in model.elastic}
    return "mixed" if len(orders) > 1 else model.order


def _tolerance(plan: ModelPlan) -> str:
    unit = " ".join(plan.span) if plan.absolute else "of its span"
    return f"{plan.tolerance:g} {unit}".rstrip()


# -- runs that are watched --------------------------------------------------------------------------------------------


def watched(scene: Scene, watch: Watch, progress: bool = False) -> Result:
    """A run, which warns of the first quantity that leaves its range, too."""
    result = silent(scene, progress)
    return _told(result, *watch.left(result)[:1])


def _told(result: Result, *more: RunWarning) -> Result:
    """The result, of whose wrong numbers it warns."""
    for warning in [*result._wrong, *more]:
        warnings.warn(warning, stacklevel=outside())
    return result


def adapted(lean: Scene, arm: Arm, options: dict[str, Any], watch: Watch, progress: bool = False) -> Result:
    """Runs the lean scene; from the last output time before a monitor reports, continues with a richer arm.

    Args:
        arm: the richer arm, with all coordinates of the lean one. options: of its simulation.
    """
    first = silent(lean, progress)
    left = watch.left(first)
    if not left:
        return _told(first)
    q0 = lean.q0 if lean.q0 is None or isinstance(lean.q0, str) else restated(lean.q0, lean.arm, arm)
    v0 = None if lean.v0 is None else restated(lean.v0, lean.arm, arm, rates=True)
    rich = replace(lean, arm=arm, options=options, q0=q0, v0=v0)
    cut = max(0, int(np.searchsorted(first.t, left[0].time)) - 1)
    if cut == 0 or any(isinstance(c, Sampled) for c in lean.control):
        return _told(silent(rich, progress))
    begin = embed(first, rich.arm, slice(cut, cut + 1))
    rest = silent(replace(rich, t=lean.t[cut:], q0=begin.q[0], v0=begin.v[0]), progress)
    before = embed(first, rich.arm, slice(0, cut))
    stats = {k: first.stats.get(k, 0) + v if isinstance(v, (int, float)) else v for k, v in rest.stats.items()}
    names = ("t", "q", "v", "a", "tau")
    rows: dict[str, Any] = {name: np.concatenate([getattr(before, name), getattr(rest, name)]) for name in names}
    joined = Result(rich.arm, **rows, stats=stats, loads=rest.loads, status=rest.status)
    joined.driven = driven_forces(rich.arm, rich.drive, joined.t)
    ranges = [x for x in first._wrong if isinstance(x, RangeWarning) and x.time < rest.t[0]]
    others = [x for x in first._wrong if not isinstance(x, (RangeWarning, *map(type, rest._wrong)))]
    joined._wrong = [*ranges, *others, *rest._wrong]
    return _told(joined)


# -- the table ---------------------------------------------------------------------------------------------------------

_NOTE = """\
error without: a choice that is in: the error without its last mode, or at the next poorer order.
               A choice that is out: the error that leaving it out costs now.
               An integrator: the whole error of the run.
time:          share of the time of an evaluation of the dynamics (of integrators: of the run)."""


def _number(x: float | None) -> str:
    return "" if x is None else "0" if x == 0 else f"{x:.1e}" if math.isfinite(x) else "fails"


def _share(choice: Choice) -> str:
    """Share of the time of an evaluation: taken by an included choice, or added by another."""
    if choice.time is None or (choice.time == 0.0 and choice.inside):
        return ""
    return f"{100 * choice.time:+.0f} %"


def _head(plan: ModelPlan) -> list[str]:
    spans = ", ".join(f"{s:.4g} {u}".rstrip() for u, s in plan.span.items())
    tolerance = _tolerance(plan) if plan.absolute else f"{plan.tolerance:g} of it"
    check = plan._search.models.label(plan._search.rich.model)
    lines = [f"{plan.given.name}: {plan.quantity}, span {spans}, to {tolerance}", ""]
    lines.append(f"Take   {plan.model}; {setting_words(plan.scene.options)}")
    if plan.certified:
        lines.append(f"CERTIFIED: error {plan.error:.1e} against {check}, richer than all on the path")
    else:
        lines.append(f"NOT CERTIFIED: {'; '.join(plan.reasons)}")
    lines += [f"Note: {note}" for note in plan._search.notes]
    lines.append(f"A run takes {seconds(plan.time)}; deciding took {seconds(plan.seconds)} and {plan.runs} runs")
    return lines


def _speed(plan: ModelPlan) -> list[str]:
    rows = [["model", "coordinates", "an evaluation", "operations"]]
    for name, of in speed_of(plan._search).items():
        time = f"{1e6 * of['time']:.2f} µs"
        word = {"given": "the scene's own", "lean": "lean", "rich": "of the check"}[name]
        rows.append([word, str(of["coordinates"]), time, str(of["operations"])])
    return aligned(rows, {1, 2, 3})


def _indicators(plan: ModelPlan) -> list[str]:
    search = plan._search
    orders = ", ".join(f"{o}: {e:.1e}" for o, e in search.by_order().items())
    lines = [f"Error by order, estimated: {orders}"] if orders else []
    turn = ", ".join(f"{x:.2g}" for x in search.rotation.values())
    spin = ", ".join(f"{x:.2g}" for x in search.spin.values())
    lines += [f"Largest rotation of sections by link (rad): {turn}"] if turn else []
    first = f"{search.first_frequency:.4g} rad/s"
    return [*lines, f"Speed of turning over the first frequency, {first}, by link: {spin}"] if spin else lines


# -- deciding ----------------------------------------------------------------------------------------------------------


def economize(
    scene: Scene | str | Path,
    tolerance: float = 1e-3,
    quantity: str | Callable[[Result], Any] = "tip",
    budget: float | None = None,
    *,
    atol: float | None = None,
    progress: bool = False,
) -> ModelPlan:
    """The cheapest model of a scene whose error over the scene's run is below a tolerance.

    One run of a rich model tells what each part of it is worth: each shape, the order of each beam, rotary inertia. The
        cheapest model by these estimates is run, up to three times where they are off, then with other integrators, and
        checked by one run of an independent, enriched model: more modes, every strain that moves, exact rotation, finer
        steps.

    Args:
        scene: a Scene, a scene file, or the name of a shipped scene.
        tolerance: over the quantity's span, the largest range of any one component, between 0 and 1.
        quantity: "tip", the position of the arm's end, of a tree of all its ends; "joint", the coordinates of
            those joints that are not prescribed; "strain", the curvatures of every beam at its clamp (and shear angles
            and stretches, where the scene's own beams have them); or a callable of a Result that returns an array
            (nt,) or (nt, k).
        budget: seconds for deciding; None: no limit. A plan that the limit cuts short is not certified.
        atol: an absolute tolerance in the quantity's SI unit, in place of tolerance: atol=1e-3 is a millimetre of the
            tip.
        progress: shows the present activity on stderr: a bar, or lines if that is no terminal.

    Returns:
        ModelPlan: `.arm`, `.scene`, `.certified`, `.choices`, `.save("lean.toml")`, `.plot()`.

    Raises:
        ValueError: bad arguments, a scene that cannot be run, or a quantity that does not move in it.
    """
    if budget is not None:
        positive("budget", budget, "s; None: no limit")
    if atol is not None:
        limit = positive("atol", atol, "in the quantity's unit")
    else:
        limit = between("tolerance", tolerance, 0, 1, ", as a share of the quantity's span; absolute: atol=")
    scene = read_scene(scene)
    scene.arm.refuse_rubbing("economize: scene.arm")
    scene.arm.refuse_loops("economize: scene.arm")
    measure = Measure(scene, quantity, atol)
    allowed = Budget(math.inf if budget is None else budget)
    with progress_bar(progress, "deciding", None) as bar:
        tell = (lambda doing: bar(0, doing)) if bar else _quiet
        search = EconomizeSearch(scene, measure, limit, allowed, tell)
        search()
        choices = choices_of(search)
        search.tell = _quiet  # the plan keeps the search, and its bar is gone
    lean, check = search.lean, search.check
    assert lean.result is not None
    certified = check is not None and not search.reasons
    error = search.off if check is not None else math.inf
    mine, theirs = (search.models.at(run.model, run.options) for run in (lean, search.rich))
    if isinstance(scene.q0, str):
        mine, theirs = (replace(x, q0=scene.q0) for x in (mine, theirs))
    return ModelPlan(
        scene, mine, theirs,
        measure.name, limit, atol is not None, measure.ranges, certified, search.reasons, error,
        lean.time, allowed.used, len(search.trials.runs), choices, Watch.around(lean.result), search,
    )  # fmt: skip


def _quiet(doing: str) -> None:
    """Shows nothing."""
