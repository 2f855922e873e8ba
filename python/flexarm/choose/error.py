"""The error of one run, and what it comes from: `Result.error`.

Three runs tell it, however many sources there are: one of the same model in steps of a negligible error, one of a
richer model, and one backwards through that. The first two less the run are its error over time. The backward run, the
adjoint method, gives the derivatives of the quantity, at the time of its largest error, by forces at all times; with
these the forces that the run lacks (`lacking`) become parts of that error.
"""

from __future__ import annotations

import itertools
import time
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import flexarm._core as _core

from .._check import Array, positive
from .._console import progress_bar
from ..arm.variation import Setup, value_at
from ..model.acting.drive import Motion, Torque, moved_rates, split_drives
from ..model.parts.beam import STRAINS
from ..run.integrators import Gauss
from ..run.perturbed import start_of
from ..run.result import Result
from ..run.scene.scene import Scene
from ..run.sensitivity import ByForces, RunStopped
from ..run.simulation import SimulationError, simulated, source
from .enrich import enriched, moving_strains, relevant
from .error_estimate import ErrorEstimate, ErrorSource
from .indicators import elastic
from .lacking import BASIS, START, Between, static_weights
from .measures import Measure
from .models import BeamModel, Model, Models
from .pieces import leaps
from .states import embed, keys, some_rows

_SMALL = 0.05  # of the estimated error: shapes that change less together are not in the richer model
_FAST = tuple(s for s, name in enumerate(STRAINS) if name.startswith("shear") or name == "extension")
_LOOSE, _TIGHT, _LEAST = 1e-3, 1e-7, 1e-10  # bounds of the tolerances of steps
_MISSED = 0.25  # of their tolerance: what steps miss at most of places; usually a tenth of that
_FINER, _SHARE = 0.1, 0.1  # of the run's own tolerance, of the error: the tolerance of its finer steps
_DETUNED = 0.01  # of a frequency: what polynomials may miss of it
_SWINGS = 0.3  # of the estimated error: what a missed frequency may change
_LOOKS = 41  # rows at which that is looked for
_ABOVE = 3.0  # times what the steps of its runs may miss: smaller errors cannot be told
_AGREE = 0.5  # of the largest error: how far the sum of its sources may be off
_TAIL = 0.3  # of the largest error: part of the last shape function of a strain; more may be missing beyond it
_PATIENCE = (100.0, 5.0)  # of the richer run, in processor times of the other one, and in s


class _TooLong(Exception):
    """The richer run takes more time than it may."""


class _TooLoose(Exception):
    """The steps of the richer run may miss as much as it is off the run. `tolerance`: that of its next ones."""

    def __init__(self, tolerance: float) -> None:
        super().__init__(tolerance)
        self.tolerance = tolerance


def _scene_of(result: Result) -> Scene:
    """The scene that a result was made of."""
    of = result._made()
    if len(result.t) < 2:
        raise ValueError(f"t: the result has {len(result.t)} times; an error is found of two or more")
    s = of.setup
    s.arm.refuse_rubbing("the error of a run")
    s.arm.refuse_loops("the error of a run", rigid=True)
    drive = _driven(s, of.tau)
    return Scene(s.arm, drive, tuple(s.loads), result.t, of.q0, of.v0, {}, "run", (), tuple(s.control))


def _driven(setup: Setup, tau: Array | None) -> dict[Any, Any]:
    """The drives of a run, with its constant forces."""
    arm, drive = setup.arm, dict(setup.drive)
    keys = {arm.joint_rate(key): key for key in split_drives(arm, drive)[0]}
    owner = {arm._core.first(k) + j: (k, j) for k, link in enumerate(arm.links) for j in range(link.joint.nv)}
    for i, force in enumerate([] if tau is None else tau.tolist()):
        if not force:
            continue
        if i not in owner or arm.coordinate_of(i) < 0:
            what = "elastic coordinates by their numbers" if i not in owner else "a ball"
            raise ValueError(f"tau[{i}] = {force:g}: no error is found under constant forces on {what}; give a load")
        law = drive.get(key := keys.get(i, owner[i]))
        if not isinstance(law, Motion):
            drive[key] = Torque(force) if law is None else law.moved(force)
    return drive


@dataclass
class _Off:
    """The place and the time of the largest error."""

    unit: str
    row: int
    place: int
    direction: Array
    values: dict[str, Array]  #: of the richer run

    def of(self, values: Mapping[str, Array], row: int | None = None) -> float:
        """The quantity there, along the direction of the error."""
        return float(self.direction @ values[self.unit][self.row if row is None else row, self.place])


class _Estimating:
    """The runs for one estimate."""

    def __init__(self, result: Result, quantity: Any, tell: Callable[[str], None]) -> None:
        self.result, self.tell, self.runs = result, tell, 0
        self.scene = _scene_of(result)
        self.measure = Measure(self.scene, quantity)
        self.own = self.measure.values(result)
        try:
            self.measure.set_span(self.own)
        except ValueError:  # it rests; errors are then in its unit
            if not self.own:
                raise
            self.measure.ranges, self.measure.span = dict.fromkeys(self.own, 0.0), dict.fromkeys(self.own, 1.0)
        self.models = Models(self.scene)
        self.reasons: list[str] = []

    def __call__(self, parameters: Mapping[str, float] | None = None) -> ErrorEstimate:
        asked = {path: positive(f"parameters['{path}']", x, "relative") for path, x in (parameters or {}).items()}
        self.tell("the richer model")
        rich, size = self.richer()
        by = self.result._source.integrator
        own = by.tolerance if isinstance(by, Gauss) and not by.fixed else None
        if rich == self.models.given:
            fine = _TIGHT if own is None else max(own * _FINER, _LEAST)
            found = self.finely(self.result.t, fine)
            return self.told(rich, self.worst(self.measure.values(found)), found, {}, fine, asked)
        # a wrong estimate of the error costs shorter steps than are needed, or a second run
        scale = min(1.0, *(span / self.length(unit) for unit, span in self.measure.span.items()))
        back, off, rich, coarse = self.richest(rich, float(np.clip(0.5 * size * scale, _TIGHT, _LOOSE)))
        fine = max(_SHARE * coarse, _TIGHT if own is None else own * _FINER)
        fine = min(fine, coarse / 3, own or fine)
        used = np.flatnonzero(back.tau.any(axis=1))
        times, at = np.unique(np.concatenate([self.result.t, back.t[used]]), return_inverse=True)
        self.tell("the same model in finer steps")
        both = self.finely(times, fine)
        n = len(self.result.t)
        found, places = _rows(both, at[:n]), _rows(both, at[n:])
        self.tell("sources")
        between, richer = Between(self.models, rich), self.models.at(rich, {})
        parts = self.parts(between, richer, back, off, found, places, back.tau[used])
        return self.told(rich, off, found, parts, fine + coarse, asked)

    # -- the richer model --------------------------------------------------------------------------------------------

    def richer(self) -> tuple[Model, float]:
        """The richer model: of strains that matter, no poorer than the run's; and the estimated error over the span."""
        models = self.models
        try:
            reached = moving_strains(models)
        except ValueError:  # a load that follows from the state
            reached = None

        def more(k: int, b: BeamModel) -> BeamModel:
            return replace(b, counts=tuple(map(max, b.counts, models.given.counts(k))))

        rich = models.rebased(enriched(models, 0, reached)).each(more)
        least = self.without(rich, itertools.product(range(len(rich.beams)), range(len(STRAINS))))
        kept, _, size = relevant(models, rich, least, self.result, self.measure, _SMALL)
        moving = {key for key, share in self.vibration().items() if share > _SWINGS * size}

        def finer(k: int, b: BeamModel) -> BeamModel:
            """All shapes of these strains, and one more in another basis than the scene's: n + 2 polynomials are too
            few to have the frequencies of n clamped-free modes."""
            counts = enumerate(zip(b.counts, rich.counts(k), strict=True))
            return replace(
                b, counts=tuple(m + (b.basis is not None) if (k, s) in moving else n for s, (n, m) in counts)
            )

        return kept.each(finer), size

    def vibration(self) -> dict[tuple[int, int], float]:
        """By link and strain of several shapes: what a frequency of the last of them that is a little off would change
        the quantity over the run, over the span. Its rate tells its vibration apart from what it bears."""
        run, arm = self.result, self.scene.arm
        M, (K, D) = np.diag(arm._core.mass_matrix(run.q[0])), map(np.diag, elastic(arm))
        size = self.measure.sense(self.scene, run.q[(rows := some_rows(len(run.t), _LOOKS))])
        out: dict[tuple[int, int], float] = {}
        for i, (k, s, number) in enumerate(keys(arm)):
            if number > 1 and number == self.models.given.counts(k)[s]:
                w, rate = np.sqrt(K[i] / M[i]), 0.5 * D[i] / M[i]
                lasts = min(float(np.ptp(run.t)), 1.0 / rate if rate > 0.0 else np.inf)
                away = np.zeros((len(rows), arm.nv))
                away[:, i] = np.abs(run.v[:, i]).max() / w
                out[k, s] = size(away) * min(1.0, _DETUNED * w * lasts)
        return out

    def without(self, rich: Model, strains: Iterable[tuple[int, int]]) -> Model:
        """The model without further strains (link, strain) that the scene's own has none of, and with one more shape
        than that of the others, of bending three, which are enough for a frequency."""
        out, given = set(strains), self.models.given

        def change(k: int, b: BeamModel) -> BeamModel:
            own = zip(given.counts(k), _core.STRAIN_FIELDS, strict=True)
            few = (m and max(m + 1, 3 * field.bending) for m, field in own)
            kept = (min(n, m) if (k, s) in out else n for s, (n, m) in enumerate(zip(b.counts, few, strict=True)))
            return replace(b, counts=tuple(kept))

        return rich.each(change)

    # -- runs --------------------------------------------------------------------------------------------------------

    def backwards(self, at: Scene, tolerance: float, seconds: float) -> tuple[ByForces, _Off]:
        """The run of the richer model, and the derivatives of its largest distance from the run by forces."""
        found: list[_Off] = []
        started = time.thread_time()

        def look(*_: Any) -> None:
            if time.thread_time() - started > seconds:
                raise _TooLong

        def loss(run: Result) -> tuple[float, dict[str, Array]]:
            off = self.worst(self.measure.values(run))
            size = abs(off.of(off.values) - off.of(self.own)) / self.length(off.unit)
            if size < tolerance and tolerance > _TIGHT:
                raise _TooLoose(max(0.5 * size, _TIGHT))
            found.append(off)
            return 0.0, {"q": self.weights(at, run, off)}

        setup = Setup(at.arm, dict(at.drive), tuple(at.loads), tuple(at.control))
        of = source(setup, at.t, at.q0, at.v0, None, integrator=Gauss(tolerance=tolerance))
        return of.by_forces(loss, look=look), found[0]

    def worst(self, values: dict[str, Array]) -> _Off:
        """Where another run is farthest from the run, over the span."""
        found = []
        for unit, span in self.measure.span.items():
            off = values[unit] - self.own[unit]
            size = np.linalg.norm(off, axis=-1)
            row, place = np.unravel_index(int(np.argmax(size)), size.shape)
            most = float(size[row, place])
            direction = off[row, place] / most if most > 0.0 else np.eye(off.shape[-1])[0]
            found.append((most / span, _Off(unit, int(row), int(place), direction, values)))
        return max(found, key=lambda x: x[0])[1]

    def weights(self, at: Scene, run: Result, off: _Off) -> Array:
        """Derivatives of the quantity there, along the direction of the error, by the coordinates, (nt, nq)."""
        out = np.zeros(run.q.shape)
        slope = off.direction @ self.slope(at, run, off)
        E = np.asarray(run.arm._core.rates(run.q[off.row], run.v[off.row])[2])
        out[off.row] = np.linalg.lstsq(E.T, slope, rcond=None)[0]
        return out

    def slope(self, at: Scene, run: Result, off: _Off) -> Array:
        """Derivatives of the quantity there by small motions of the rates, (components, nv)."""
        if not callable(self.measure.quantity):
            units = list(self.measure.span)
            slopes = self.measure._slopes(at, run.q[[off.row]])[units.index(off.unit)][0, off.place]
            return np.asarray(slopes * self.measure.span[off.unit])
        columns = []
        E = np.asarray(run.arm._core.rates(run.q[off.row], run.v[off.row])[2])
        for step in E.T:
            ends = []
            for h in (1e-6, -1e-6):
                q = run.q.copy()
                q[off.row] += h * step
                ends.append(self.measure.values(replace(run, q=q))[off.unit][off.row, off.place])
            columns.append((ends[0] - ends[1]) / 2e-6)
        return np.array(columns).T

    def richest(self, rich: Model, tolerance: float) -> tuple[ByForces, _Off, Model, float]:
        """The backward run of the richer model, or of one without the fastest strains, where that takes very long; and
        the tolerance of its steps, which may become smaller than is asked for."""
        seconds = max(_PATIENCE[0] * float(self.result.stats.get("wall_time", 0.0)), _PATIENCE[1])
        slow = self.without(rich, {(k, s) for k in range(len(rich.beams)) for s in _FAST})
        why = ""
        models = list(dict.fromkeys((rich, slow)))
        while models:
            model = models[0]
            self.tell("the richer model, and back")
            self.runs += 1
            try:
                out = *self.backwards(self.models.at(model, {}), tolerance, seconds), model, tolerance
                self.runs += 1
                return out
            except _TooLoose as e:
                tolerance = e.tolerance
                continue
            except _TooLong:
                why = f"was given up after {seconds:.2g} s"
            except RunStopped as e:
                why = f"cannot be run: {e}"
            self.reasons.append(f"the richer model, {self.models.label(model)}, {why}")
            models.pop(0)
        raise ValueError(f"no error is found: {self.reasons[-1]}")

    def finely(self, times: Array, tolerance: float) -> Result:
        """The run of the same model in steps of a negligible error."""
        s = self.scene
        self.runs += 1
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                return simulated(s.arm, times, s.q0, s.v0, **s.given(), integrator=Gauss(tolerance=tolerance))
            except SimulationError as e:
                raise ValueError(f"no error is found: the run in finer steps cannot be made: {e}") from None

    # -- the split ---------------------------------------------------------------------------------------------------

    def parts(
        self, between: Between, at: Scene, by: ByForces, off: _Off, fine: Result, places: Result, weights: Array
    ) -> dict[tuple[str, str, int], float]:  # fmt: skip
        """What each source makes of the largest error, by (where, what, number).

        Args:
            fine: the finely stepped run, at the times of the result. places: the same where the `weights` are.
        """
        first = _rows(fine, [0])
        start = embed(first, at.arm)
        E = np.asarray(at.arm._core.rates(by.result.q[0], by.result.v[0])[2])
        dq = np.linalg.lstsq(E, start.q[0] - by.result.q[0], rcond=None)[0]
        begun = -float(by.q0 @ dq + by.v0 @ (start.v[0] - by.result.v[0]))
        prescribed = moved_rates(at.arm, at.drive)
        weights = weights.copy()
        weights[:, prescribed] = 0.0
        static = self.models.start.balanced and bool(dq.any())
        if static:  # the richer model begins in another balance: what lacks there does so by the stiffness
            joints = [] if self.models.start.free else [i for i, key in enumerate(keys(at.arm)) if key[0] < 0]
            places = _joined(Result(first.arm, first.t, first.q, first.v, np.zeros_like(first.a), first.tau), places)
            weights = np.vstack([static_weights(at, {*joints, *prescribed}, by.q0), weights])
        out: dict[tuple[str, str, int], float] = {}
        for lack in between.lacks(places):
            if lack.forces.any():
                out[lack[:3]] = -float((weights * lack.forces).sum())
                begun += float(weights[0] @ lack.forces[0]) if static else 0.0
        if begun:
            out["arm", START, 0] = begun
        # the quantity at the same coordinates, from model to model
        row = fine if callable(self.measure.quantity) else _rows(fine, [off.row])
        at_row = off.row if callable(self.measure.quantity) else 0
        before = off.of(self.measure.values(row), at_row)
        row = embed(row, self.models.arm(between.first))
        for where, what, model in [("arm", BASIS, between.first), *between.steps]:
            now = off.of(self.measure.values(replace(row, arm=self.models.arm(model))), at_row)
            if now != before:
                out[where, what, 0] = out.get((where, what, 0), 0.0) + now - before
            before = now
        return out

    # -- what is told ------------------------------------------------------------------------------------------------

    def told(
        self, rich: Model, off: _Off, fine: Result, parts: Mapping[tuple[str, str, int], float], missed: float,
        asked: Mapping[str, float],
    ) -> ErrorEstimate:  # fmt: skip
        """The estimate. `missed`: the tolerance of the steps of its runs, of the arm's length or an angle."""
        unit, place, own, finer = off.unit, off.place, self.own, self.measure.values(fine)

        def over_time(a: Mapping[str, Array], b: Mapping[str, Array]) -> Array:
            return np.asarray(np.linalg.norm(a[unit][:, place] - b[unit][:, place], axis=-1))

        total = over_time(off.values, own)
        largest = float(total[off.row])
        steps = off.of(finer) - off.of(own)
        merged: dict[tuple[str, str], float] = {("arm", "steps"): steps}
        for (where, what, _), part in parts.items():
            merged[where, what] = merged.get((where, what), 0.0) + part
        least = _ABOVE * _MISSED * missed * self.length(unit)
        self.judge(largest, sum(merged.values()), parts, least)
        sources = [ErrorSource(*key, x, x / largest if largest else 0.0) for key, x in merged.items()]
        return ErrorEstimate(
            self.measure.name, unit, self.result.t, total, over_time(finer, own), over_time(off.values, finer),
            largest, float(self.result.t[off.row]), self.measure.ranges[unit],
            sorted(sources, key=lambda x: -abs(x.error)), self.numbers(asked, unit, largest),
            not self.reasons, "; ".join(self.reasons), self.models.label(rich), self.runs, own[unit][:, place],
        )  # fmt: skip

    def length(self, unit: str) -> float:
        """The size of the arm, which a tolerance of steps is a part of."""
        if unit == "m":
            places = [self.scene.arm.frame(self.result.q[0], link=k)[0] for k in range(len(self.scene.arm.links))]
            return float(np.linalg.norm(np.diff(places, axis=0, prepend=np.zeros((1, 3))), axis=1).sum())
        return 1.0 if unit == "rad" else self.measure.ranges[unit] or 1.0

    def judge(
        self, largest: float, added: float, parts: Mapping[tuple[str, str, int], float], least: float
    ) -> None:  # fmt: skip
        """Finds why the estimate cannot be relied on."""
        say = self.reasons.append
        if largest < least:
            say(f"an error below about {least:.1g} is not told from that of the estimate's own steps")
        elif abs(added - largest) > _AGREE * largest:
            say(f"the sources add up to {added:.2g}, so that small causes do not have proportional effects here")
        tails: dict[tuple[str, str], tuple[int, float]] = {}
        for (where, what, number), part in parts.items():
            tails[where, what] = max(tails.get((where, what), (0, 0.0)), (number, part))
        for (where, what), (number, part) in tails.items():
            if number > 1 and abs(part) > _TAIL * largest:
                say(f"{where}: shape function {number} of {what} still makes {abs(part):.2g}, further ones may, too")
        for k, link in enumerate(self.scene.arm.links):
            if link.beam is not None and any(isinstance(x, tuple) for x in link.beam.modes.values()):
                say(f"{self.scene.arm.names[k]} has shapes of the user's own, to which none are added")
        for k, what in leaps(self.scene).items():
            where = self.scene.arm.names[k]
            say(f"strains of {where} jump ({what}), which smooth shapes follow slowly: cut its beam there, by fa.split")
        if self.models.pinned:
            say(f"the shapes are taken as they are, since {self.models.pinned}")

    def numbers(self, asked: Mapping[str, float], unit: str, largest: float) -> list[ErrorSource]:
        """What uncertain numbers of the scene change at most."""
        if not asked:
            return []
        s = self.scene
        setup = Setup(s.arm, dict(s.drive), tuple(s.loads), tuple(s.control))
        of = source(setup, s.t, s.q0, s.v0, None, integrator=Gauss())
        self.runs += 2
        found = of.sensitivities(list(asked))
        slopes = found.of(lambda result, _: self.measure.values(result)[unit])
        begin = start_of(setup, float(s.t[0]), of.q0, of.v0, None)
        out = []
        for path, part in asked.items():
            changed = []
            for own, slope in zip(found.parameters, slopes, strict=True):
                if own == path or own.startswith(f"{path}."):
                    changed.append(part * float(value_at(setup, own, begin)[0]) * slope)
            size = float(np.sqrt(sum(np.square(x).sum(axis=-1) for x in changed)).max())
            if not any(np.any(x) for x in changed):
                raise ValueError(f"parameters: '{path}' is zero, or changes nothing: a part of it is no uncertainty")
            out.append(ErrorSource("number", path, size, size / largest if largest else 0.0))
        return sorted(out, key=lambda x: -x.error)


def _estimate(result: Result, quantity: Any, parameters: Mapping[str, float] | None, progress: Any) -> ErrorEstimate:
    """`Result.error`."""
    with progress_bar(progress, "estimating", None) as bar:
        return _Estimating(result, quantity, (lambda doing: bar(0, doing)) if bar else lambda doing: None)(parameters)


Result._estimate = _estimate


def _rows(run: Result, at: Any) -> Result:
    return Result(run.arm, run.t[at], run.q[at], run.v[at], run.a[at], run.tau[at])


def _joined(a: Result, b: Result) -> Result:
    t, q, v, acc, tau = (np.concatenate([getattr(a, k), getattr(b, k)]) for k in ("t", "q", "v", "a", "tau"))
    return Result(a.arm, t, q, v, acc, tau)
