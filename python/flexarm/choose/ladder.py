"""The models and settings that `flexarm chart` tries on a scene: what can be varied, and one timed run of each."""

from __future__ import annotations

import time
import warnings
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from .._check import Array
from ..acting.drive import Motion
from ..acting.voltage import split_drives
from ..analysis.doubts import ModelWarning
from ..analysis.validity import RangeWarning
from ..arm import Arm
from ..parts.beam import Beam
from ..parts.link import Link
from ..run.result import Result
from ..run.simulation import INTEGRATORS, OPTION_OF, SimulationError, simulate
from ..scene.scene import Scene

ORDERS: tuple[int | str, ...] = (0, 1, 2, 3, "exact")  # from poor to rich
QUANTITIES = ("tip", "joint", "strain")

#: The integrators that choose their own steps for a tolerance; every other one takes `step`.
BY_TOLERANCE = frozenset({"ida"})

#: The fixed-step integrators that step over output times.
OVER_OUTPUTS = frozenset({"gauss"})

#: What the chart draws a line for, by name: arguments of `simulate`. A new integrator joins by itself.
CHOICES: dict[str, dict[str, Any]] = {
    **{name: {"integrator": name} for name in INTEGRATORS},
    "ida, BDF 2": {"integrator": "ida", "max_order": 2},
}

_SAMPLES = 501  # times at which trajectories are compared
_REPEATS, _LONG = 3, 0.3  # a run is repeated until it was run so often, or so long (s)


class OutOfTime(Exception):
    """The budget, or a run's share of it, is used up."""


@dataclass(frozen=True, eq=False)
class Model:
    """A scene's arm at another order or with other numbers of modes.

    Attributes:
        order: of the rotation of all beams' sections; "as given" if the arm has no elastic coordinates.
        shift: how many modes each strain has above (below) the scene's.
        arm: the arm.
        basis: of its shape functions; "": the scene's.
    """

    order: int | str
    shift: int
    arm: Arm
    basis: str = ""

    @property
    def modes(self) -> str:
        """Modes of each strain in use, link by link, such as "3" or "3+2+1"."""
        counts = [n for link in self.arm.links if link.beam for n in link.beam.counts.values()]
        return "+".join(map(str, counts)) if len(counts) <= 6 else f"{sum(counts)} in all"

    @property
    def label(self) -> str:
        if not self.modes:
            return "the rigid arm"
        basis = f" ({self.basis})" if self.basis else ""
        return f"order {self.order}, {self.modes} mode{'' if self.modes == '1' else 's'}{basis}"


@dataclass(eq=False)
class Row:
    """One run, or one that failed, was skipped or was cut off.

    Attributes:
        model: the model; `order`, `modes` and `shift` are its.
        choice: the integrator's line in the chart, a key of CHOICES.
        value: its rtol, or its step (s).
        method: "ab" or "ci", for the accelerations at the output times.
        status: "ok", "failed", "skipped" (not begun) or "cut" (given up for the budget); `reason` says why.
        time: wall time of the integration (s), best of `runs`; predicted if skipped, spent if cut.
        error: largest distance from the truth over the quantity's span; None if not known.
        absolute: the same by unit, such as {"m": 1e-5}.
        steps, evaluations: of the integrator.
        warning: what RangeWarning said, if a beam bent further than its order is good for.
    """

    model: Model
    choice: str
    value: float
    method: str = "ab"
    status: str = "ok"
    reason: str = ""
    time: float = 0.0
    runs: int = 0
    error: float | None = None
    absolute: dict[str, float] = field(default_factory=dict)
    steps: int = 0
    evaluations: int = 0
    warning: str = ""
    values: dict[str, Array] | None = field(default=None, repr=False)

    @property
    def setting(self) -> str:
        return "rtol" if CHOICES[self.choice]["integrator"] in BY_TOLERANCE else "step"

    @property
    def label(self) -> str:
        method = "" if self.method == "ab" else f", {self.method}"
        unit = " s" if self.setting == "step" else ""
        return f"{self.model.label}, {self.choice}{method}, {self.setting} {self.value:.4g}{unit}"

    def options(self, scene: Scene) -> dict[str, Any]:
        """Arguments of `simulate`: the scene's, with this row's choice."""
        integrator = CHOICES[self.choice]["integrator"]
        out = {k: v for k, v in scene.options.items() if OPTION_OF.get(k) == integrator}
        out |= {**CHOICES[self.choice], "method": self.method, self.setting: self.value}
        if self.setting == "rtol":
            out["atol"] = self.value * scene.options.get("atol", 1e-9) / scene.options.get("rtol", 1e-6)
        return out

    def to_dict(self) -> dict[str, Any]:
        keep = ("choice", "setting", "value", "method", "status", "reason", "time", "runs", "error", "absolute")
        about = {k: getattr(self.model, k) for k in ("order", "modes", "shift", "basis")}
        return {**about, **{k: getattr(self, k) for k in (*keep, "steps", "evaluations", "warning")}}


def is_elastic(arm: Arm) -> bool:
    return any(link.beam is not None and link.beam.ne for link in arm.links)


def other_basis(scene: Scene, link: int) -> str | None:
    """A basis that may stand in for that of a link's beam: Legendre polynomials meet the conditions at a loaded tip,
    and what a patch does, with fewer functions than modes of a free beam. None where nothing else may stand in: strains
    of the user's own."""
    beam = scene.arm.links[link].beam
    if beam is None or beam.basis == "legendre" or any(isinstance(m, tuple) for m in beam.modes.values()):
        return None
    return "legendre"


def _beam(beam: Beam, order: int | str, shift: int, basis: str | None = None) -> Beam:
    modes: dict[str, Any] = {}
    for strain, value in beam.modes.items():
        own = isinstance(value, tuple)
        n = max(1, (len(value) if own else value) + shift)
        modes[strain] = list(value[:n]) if own else n
    given = {f.name: getattr(beam, f.name) for f in fields(beam) if f.init}
    other = {} if basis is None else {"basis": basis, "basis_tip": None}
    return Beam(**{**given, "modes": modes, "order": order, **other})


def models(arm: Arm) -> tuple[list[int], list[int | str]]:
    """Shifts of the mode counts, from poor to rich, and orders, that give different models of this arm."""
    if not is_elastic(arm):
        return [0], ["as given"]
    counts = [n for link in arm.links if link.beam for n in link.beam.counts.values()]
    own = [isinstance(v, tuple) for link in arm.links if link.beam for v in link.beam.modes.values()]
    return list(range(1 - max(counts), 1 if all(own) else 3)), list(ORDERS)


def build(arm: Arm, order: int | str, shift: int) -> Model:
    """The arm with this order and these many modes more for each strain in use (at least one)."""
    if order == "as given":
        return Model(order, shift, arm)
    links = [replace_beam(link, order, shift) for link in arm.links]
    return Model(order, shift, Arm._made(links, arm.gravity))


def rebuilt(scene: Scene, order: int | str, shift: int) -> Model | None:
    """The same as `build`, in another basis wherever one may stand in; None where it may nowhere."""
    bases = [other_basis(scene, k) if link.beam is not None and link.beam.ne else None
             for k, link in enumerate(scene.arm.links)]  # fmt: skip
    if not any(bases):
        return None
    links = [replace_beam(link, order, shift, basis) for link, basis in zip(scene.arm.links, bases, strict=True)]
    return Model(order, shift, Arm._made(links, scene.arm.gravity), next(b for b in bases if b))


def replace_beam(link: Link, order: int | str, shift: int, basis: str | None = None) -> Link:
    if link.beam is None or not link.beam.ne:
        return link
    return Link(link.joint, link.hub, _beam(link.beam, order, shift, basis), link.tip)


def _carried(value: Array | None, zero: Array, names: tuple[str, ...], given: tuple[str, ...]) -> Array | None:
    """An initial state for other mode counts: coordinates of the same name keep their value, new ones are zero."""
    if value is None:
        return None
    out, at = np.array(zero), {name: k for k, name in enumerate(given)}
    for k, name in enumerate(names):
        if name in at:
            out[k] = value[at[name]]
    return out


def initial_state(scene: Scene, arm: Arm) -> tuple[Array | None, Array | None]:
    """q0 and v0 of the scene for another model of its arm. Elastic coordinates keep their values by name, new ones
    start at zero; in another basis they are those whose strains along the beam are nearest to the given ones."""
    q0 = _carried(scene.q0, arm.zero, arm.q_names, scene.arm.q_names)
    v0 = _carried(scene.v0, np.zeros(arm.nv), arm.coordinates, scene.arm.coordinates)
    for k, (link, given) in enumerate(zip(arm.links, scene.arm.links, strict=True)):
        beam, old = link.beam, given.beam
        if beam is None or old is None or not beam.ne or not old.ne or beam.basis == old.basis:
            continue
        new_q, old_q = (a._core.first_q(k) + link.joint.nq for a in (arm, scene.arm))
        new_v, old_v = (a._core.first(k) + link.joint.nv for a in (arm, scene.arm))
        for out, value, at, of in ((q0, scene.q0, new_q, old_q), (v0, scene.v0, new_v, old_v)):
            if out is None or value is None:
                continue
            shapes, start = np.zeros((beam.ne, arm.nq)) + arm.zero, np.array(scene.arm.zero)
            shapes[:, new_q : new_q + beam.ne] = np.eye(beam.ne)
            start[old_q : old_q + old.ne] = value[of : of + old.ne]
            x, weights = np.polynomial.legendre.leggauss(40)
            places = beam.length * (x + 1) / 2
            S = [w * arm.strain(shapes, k, float(p)) for w, p in zip(np.sqrt(weights), places, strict=True)]
            y = [w * scene.arm.strain(start, k, float(p)) for w, p in zip(np.sqrt(weights), places, strict=True)]
            A = np.hstack(S)  # (ne, places and strains)
            out[at : at + beam.ne] = np.linalg.lstsq(A.T, np.ravel(y), rcond=None)[0]
    return q0, v0


def scene_of(scene: Scene, row: Row) -> Scene:
    """The scene with a row's model, integrator and setting."""
    arm = row.model.arm
    q0, v0 = initial_state(scene, arm)
    return replace(scene, arm=arm, q0=q0, v0=v0, options=row.options(scene))


def quantity_of(scene: Scene, result: Result, quantity: str) -> dict[str, Array]:
    """By unit, (times, places, components) of what is compared, at up to 501 of the output times."""
    arm = result.arm
    q = result.q[np.unique(np.linspace(0, len(result.t) - 1, _SAMPLES).astype(int))]
    if quantity == "tip":
        return {"m": arm.frame(q)[0][:, None, :]}
    if quantity == "joint":
        joints = split_drives(scene.drive)[0]
        held = {i for i, law in arm.by_rate("drive", joints).items() if isinstance(law, Motion)}
        prescribed = {arm.coordinate_of(i) for i in held}
        units: dict[str, list[int]] = {}
        for k, link in enumerate(arm.links):
            first, joint = arm._core.first_q(k), link.joint
            names = joint.units[:-3] + ("1",) * 4 if joint.ball else joint.units
            for i, unit in enumerate(names):
                if first + i not in prescribed:
                    units.setdefault(unit, []).append(first + i)
        return {unit: q[:, columns, None] for unit, columns in units.items()}
    strains = [arm.strain(q, k, 0.0) for k, link in enumerate(arm.links) if link.beam is not None and link.beam.ne]
    if not strains:
        return {}
    both = np.stack(strains, axis=1)
    return {"1/m": both[:, :, :3], "rad": both[:, :, 3:]}


def spans(values: dict[str, Array]) -> dict[str, float]:
    """By unit, the largest range of any one component; units in which nothing moves are left out."""
    ranges = {unit: float(np.ptp(x, axis=0).max(initial=0.0)) for unit, x in values.items()}
    return {unit: r for unit, r in ranges.items() if r > 1e-12 * max(1.0, float(np.abs(values[unit]).max()))}


def distance(a: dict[str, Array], b: dict[str, Array], span: dict[str, float]) -> tuple[float, dict[str, float]]:
    """Largest distance over all times and places: over the span (the largest of the units'), and by unit."""
    by_unit = {u: float(np.linalg.norm(a[u] - b[u], axis=-1).max()) for u in span}
    return max(by_unit[u] / span[u] for u in span), by_unit


def timed(scene: Scene, row: Row, quantity: str, deadline: float, tell: Any) -> None:
    """Runs a row and fills in its status, time and values.

    Args:
        deadline: time.perf_counter() at which a run is given up.
        tell: called now and then, to keep a progress bar alive.

    Raises:
        KeyboardInterrupt: Ctrl-C.
    """

    def look(_: float) -> None:
        tell()
        if time.perf_counter() > deadline:
            raise OutOfTime

    s = scene_of(scene, row)
    started = time.perf_counter()
    spent, best, result = 0.0, np.inf, None
    try:
        while row.runs < _REPEATS and spent < _LONG and (result is None or time.perf_counter() + best < deadline):
            with warnings.catch_warnings(record=True) as said:
                warnings.simplefilter("always")
                warnings.simplefilter("ignore", ModelWarning)  # the distance from the truth tells
                result = simulate(
                    s.arm, s.t, s.q0, s.v0, drive=s.drive, loads=s.loads, control=s.control, progress=look, **s.options
                )  # fmt: skip
            row.warning = "; ".join(str(w.message) for w in said if issubclass(w.category, RangeWarning))
            row.runs += 1
            spent += result.stats["wall_time"]
            best = min(best, result.stats["wall_time"])
        assert result is not None
        with np.errstate(all="ignore"):
            row.values = quantity_of(scene, result, quantity)
    except OutOfTime:
        row.status, row.time = "cut", time.perf_counter() - started
        row.reason = f"given up after {row.time:.2g} s, its share of the budget"
        return
    except (SimulationError, ValueError) as e:
        row.status, row.reason = "failed", str(e)
        return
    row.time = best
    row.steps, row.evaluations = result.stats["steps"], result.stats["evaluations"]
