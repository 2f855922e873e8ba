"""Models of a scene's arm as data: the model of each beam, richer and poorer neighbours, the scene with a model."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..arm.arm import Arm
from ..model.acting.control import control_laws
from ..model.acting.sampled import Sampled
from ..model.parts.beam import STRAINS, Beam, RigidBody
from ..model.parts.link import Link
from ..model.parts.sections import SectionMatrix
from ..model.parts.taper import Taper
from ..run.scene.scene import Scene, load
from .pieces import Pieces, jumps
from .states import Start, nearest

ORDERS: tuple[int | str, ...] = (0, 1, 2, 3, "exact")  # from poor to rich
_MANY = 4  # with more beams than this, equal ones get equal models


def read_scene(scene: Scene | str | Path) -> Scene:
    """The given scene, or the one of a scene file or of a shipped scene's name."""
    if isinstance(scene, (str, Path)):
        return load(scene)
    if not isinstance(scene, Scene):
        raise ValueError(f"scene = {scene!r}: must be a Scene, or the path of a scene file")
    scene.check_goes_on("a choice of models")
    return scene


@dataclass(frozen=True)
class BeamModel:
    """The model of one beam."""

    counts: tuple[int, ...]  #: shape functions of each of STRAINS; all zero: rigid
    order: int | str  #: of the rotation of its sections
    rotary: bool  #: whether its slices have rotary inertia
    gauss: int | None = None  #: its Gauss points; None: as many as its basis asks for
    basis: str | None = None  #: of its shape functions; None: the scene's

    def __post_init__(self) -> None:
        if self.rigid:  # all orders of a rigid beam are the same
            object.__setattr__(self, "order", 1)
            object.__setattr__(self, "gauss", None)
            object.__setattr__(self, "basis", None)

    @property
    def rigid(self) -> bool:
        return not any(self.counts)

    @property
    def label(self) -> str:
        """The model in words, such as "order 2, bending_y 3, torsion 1"."""
        used = ", ".join(f"{s} {n}" for s, n in zip(STRAINS, self.counts, strict=True) if n)
        rest = ("", ", no rotary inertia")[not self.rotary] + (f", {self.gauss} Gauss points" if self.gauss else "")
        used += f" ({self.basis})" if self.basis else ""
        return f"order {self.order}, {used}{rest}" if used else f"rigid{rest}"

    def with_count(self, strain: int, n: int) -> BeamModel:
        return replace(self, counts=(*self.counts[:strain], n, *self.counts[strain + 1 :]))


@dataclass(frozen=True)
class Model:
    """The model of a scene's arm."""

    beams: tuple[BeamModel | None, ...]  #: the model of each link's beam; None if it has no beam
    pieces: bool = False  #: whether its beams are cut where their strains jump, each piece with a few modes more
    shift: int = field(default=0, compare=False)  #: modes of each strain above the scene's, if all beams are alike

    def each(self, change: Callable[[int, BeamModel], BeamModel]) -> Model:
        """The model with each beam changed by `change`: (link, beam model) -> beam model."""
        return replace(self, beams=tuple(b and change(k, b) for k, b in enumerate(self.beams)))

    def but(self, links: list[int] | None = None, **change: Any) -> Model:
        """The model with changed fields of BeamModel for these links' beams (None: for all)."""
        return self.each(lambda k, b: replace(b, **change) if links is None or k in links else b)

    def with_count(self, links: list[int], strain: int, n: int) -> Model:
        return self.each(lambda k, b: b.with_count(strain, n) if k in links else b)

    def beam(self, link: int) -> BeamModel:
        """The beam model of a link that has a beam."""
        beam = self.beams[link]
        assert beam is not None
        return beam

    def counts(self, link: int) -> tuple[int, ...]:
        beam = self.beams[link]
        return (0,) * len(STRAINS) if beam is None else beam.counts

    @property
    def elastic(self) -> list[BeamModel]:
        return [b for b in self.beams if b is not None and not b.rigid]

    @property
    def size(self) -> int:
        """The number of its elastic coordinates."""
        return sum(sum(b.counts) for b in self.elastic)

    def less(self, other: Model) -> bool:
        """Whether it has fewer elastic coordinates than another model, or fewer beams with rotary inertia."""
        mine, theirs = (sum(b.rotary for b in model.beams if b) for model in (self, other))
        return self.size < other.size or (self.size == other.size and mine < theirs)

    # for models whose beams are changed alike:

    @property
    def order(self) -> int | str:
        """Order of the rotation of the beams' sections; "as given" if the arm has no elastic coordinates."""
        return next((b.order for b in self.elastic), "as given")

    @property
    def basis(self) -> str:
        """Basis of the shape functions; "": the scene's."""
        return next((b.basis for b in self.elastic if b.basis), "")

    @property
    def modes(self) -> str:
        """Modes of each strain in use, link by link, such as "3" or "3+2+1"."""
        counts = [n for b in self.elastic for n in b.counts if n]
        return "+".join(map(str, counts)) if len(counts) <= 6 else f"{sum(counts)} in all"

    @property
    def label(self) -> str:
        """The model in words, such as "order 2, 3 modes (legendre)"."""
        if not self.modes:
            return "the rigid arm"
        basis = f" ({self.basis})" if self.basis else ""
        cut = ", in pieces" if self.pieces else ""
        count, *rest = self.modes.split(" ", 1)
        modes = " ".join([count, "mode" if count == "1" else "modes", *rest])
        return f"order {self.order}, {modes}{basis}{cut}"


def lowest_order(beam: Beam) -> int | str:
    """The lowest order a beam may have: curved beams need "exact", since series are about a straight beam; sections
    with centres of mass off the axis need 3."""
    if beam.curvature is not None:
        return "exact"
    sections = beam.section.sections if isinstance(beam.section, Taper) else [beam.section]
    return 3 if any(isinstance(s, SectionMatrix) and s.off_axis for s in sections) else 0


def resists(beam: Beam, strain: str) -> bool:
    """Whether the stiffness of a beam against a strain is known."""
    if beam.material is not None:
        sheared = beam.material.poisson_ratio is not None or beam.material.shear_modulus is not None
        return sheared or not strain.startswith(("torsion", "shear"))
    section = beam.section.at(0.0)
    return not isinstance(section, SectionMatrix) or section.rigidity(strain) > 0.0


def model_of(beam: Beam | None) -> BeamModel | None:
    if beam is None:
        return None
    return BeamModel(tuple(beam.counts.get(s, 0) for s in STRAINS), beam.order, beam.rotary_inertia, beam.gauss_points)


def beam_at(beam: Beam, model: BeamModel, tip: RigidBody | None = None) -> Beam:
    """The beam with this model, at least of the lowest order it may have. The user's own strain shapes are removed from
    the last on, never added to. Modes of the loaded basis are those with this tip."""
    modes: dict[str, Any] = {}
    for strain, n in zip(STRAINS, model.counts, strict=True):
        own = beam.modes.get(strain)
        if n:
            modes[strain] = list(own[:n]) if isinstance(own, tuple) else n
    given = {f.name: getattr(beam, f.name) for f in fields(beam) if f.init}
    basis = {} if model.basis is None else {"basis": model.basis, "basis_tip": tip if model.basis == "loaded" else None}
    order = max(model.order, lowest_order(beam), key=ORDERS.index)
    choice = {"modes": modes, "order": order, "rotary_inertia": model.rotary, "gauss_points": model.gauss}
    made = Beam(**{**given, **choice, **basis, "damping": ()})
    return replace(made, damping=damping_in(made, beam)) if beam.damping and made.ne else made


def damping_in(beam: Beam, other: Beam) -> list[list[float]]:
    """The damping matrix of another beam in the coordinates of this one, by the nearest strains."""
    P = nearest([(0.0, beam)], [(0.0, other)])
    D = P.T @ np.array(other.damping) @ P
    return [[float(v) for v in row] for row in 0.5 * (D + D.T)]


class Models:
    """The models of a scene's arm.

    Attributes:
        given: the scene's own model.
        groups: lists of links whose beams get equal models: one link each, or, of many beams, all with equal ones.
        pinned: why the modes must stay: something reads the elastic coordinates by number; else "".
        jumps: by link, places along its beam (m) where strains jump or have corners. start: of the scene.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.given = Model(tuple(model_of(link.beam) for link in scene.arm.links))
        beams = [k for k, beam in enumerate(self.given.beams) if beam is not None]
        self.groups: list[list[int]] = []
        for k in beams:
            alike = [g for g in self.groups if scene.arm.links[g[0]].beam == scene.arm.links[k].beam]
            if len(beams) > _MANY and alike:
                alike[0].append(k)
            else:
                self.groups.append([k])
        self._arms: dict[Model, Arm] = {}
        self._links: dict[Any, Link] = {}
        self._pieces: dict[Model, Pieces] = {}
        self._states: dict[Model, tuple[Any, Any]] = {}
        self.pinned = self._pinned()
        self.jumps, self.start = jumps(scene), Start(scene)

    def _pinned(self) -> str:
        for k, c in enumerate(self.scene.control):
            if isinstance(c, Sampled) and c.measure is None:
                return f"control[{k}] reads the whole state"
            if hasattr(c, "K"):
                return f"control[{k}] has a gain for every coordinate"
            if any(isinstance(e, (np.ndarray, list)) for e in getattr(c, "actuate", ())):
                return f"control[{k}] acts on coordinates by number"
        return ""

    def own_shapes(self, link: int, strain: int) -> bool:
        """Whether the shapes of a strain are the user's own; none are ever added to these."""
        beam = self.scene.arm.links[link].beam
        return beam is not None and isinstance(beam.modes.get(STRAINS[strain]), tuple)

    def most(self, link: int) -> tuple[int | None, ...]:
        """The largest possible number of shapes of each strain; None: no limit."""
        beam = self.scene.arm.links[link].beam
        assert beam is not None
        free = (resists(beam, s) for s in STRAINS)
        return tuple(
            beam.counts[s] if self.own_shapes(link, i) else None if some else 0
            for i, (s, some) in enumerate(zip(STRAINS, free, strict=True))
        )

    # -- neighbours --------------------------------------------------------------------------------------------------

    @property
    def orders(self) -> list[int | str]:
        """Orders that give different models, from poor to rich."""
        if not self.given.elastic:
            return ["as given"]
        beams = [link.beam for link in self.scene.arm.links if link.beam is not None and link.beam.ne]
        return list(ORDERS[min(ORDERS.index(lowest_order(beam)) for beam in beams) :])

    @property
    def shifts(self) -> list[int]:
        """Shifts of the numbers of modes that give different models, from poor to rich."""
        used = [(k, s, n) for k, b in enumerate(self.given.beams) if b for s, n in enumerate(b.counts) if n]
        if not used:
            return [0]
        own = all(self.own_shapes(k, s) for k, s, _ in used)
        return list(range(1 - max(n for *_, n in used), 1 if own else 3))

    def uniform(self, order: int | str, shift: int, basis: str = "") -> Model:
        """The scene's own model with this order for all beams, `shift` modes more (at least 1) of each strain in use,
        and this basis if possible; "": the scene's."""

        def change(k: int, beam: BeamModel) -> BeamModel:
            wanted = [n and max(1, n + shift) for n in beam.counts]
            counts = (n if most is None else min(n, most) for n, most in zip(wanted, self.most(k), strict=True))
            return beam if beam.rigid else replace(beam, order=order, counts=tuple(counts))

        model = replace(self.given.each(change), shift=shift)
        return self.rebased(model, basis) if basis else model

    def rebased(self, model: Model, basis: str = "legendre") -> Model:
        """The model in another basis if possible: "legendre", "clamped-free", or, of links at an end with their tips,
        "loaded"."""
        if self.pinned:
            return model
        links = self.scene.arm.links

        def change(k: int, b: BeamModel) -> BeamModel:
            beam, tip = links[k].beam, links[k].tip
            if b.basis is not None or beam is None or beam.basis == basis:
                return b
            if any(isinstance(m, tuple) for m in beam.modes.values()):  # strains of the user's own
                return b
            if basis == "loaded" and not (k not in self.scene.arm.parents and tip is not None and tip.mass):
                return b
            return replace(b, basis=basis)

        return model.each(change)

    def items(self, model: Model) -> Iterator[tuple[list[int], int, int]]:
        """(group, strain, count) of every strain that the model has."""
        for group in self.groups:
            for strain, n in enumerate(model.counts(group[0])):
                if n:
                    yield group, strain, n

    # -- the scene with a model --------------------------------------------------------------------------------------

    def arm(self, model: Model) -> Arm:
        """The arm with this model. ValueError if such an arm is impossible."""
        if model.pieces:
            return self._in_pieces(model).arm
        if model not in self._arms:
            links = []
            for k, (link, beam) in enumerate(zip(self.scene.arm.links, model.beams, strict=True)):
                if (key := (id(link), beam)) not in self._links:
                    self._links[key] = link
                    if link.beam is not None and beam is not None and beam != self.given.beams[k]:
                        self._links[key] = replace(link, beam=beam_at(link.beam, beam, link.tip))
                links.append(self._links[key])
            whole = self.scene.arm
            self._arms[model] = Arm(links, whole.gravity, whole.struts, whole.contacts, whole.loops)
        return self._arms[model]

    def _in_pieces(self, model: Model) -> Pieces:
        if model not in self._pieces:
            self._pieces[model] = Pieces.of(self.arm(replace(model, pieces=False)), self.jumps)
        return self._pieces[model]

    def first(self, model: Model) -> list[int]:
        """For each link of the scene's arm, the link of the model's arm that has its joint."""
        return self._in_pieces(model).first if model.pieces else list(range(len(self.scene.arm.links)))

    def at(self, model: Model, options: dict[str, Any]) -> Scene:
        """The scene with this model, its initial state, and these arguments of `simulate`."""
        if model.pieces:
            cut = self._in_pieces(model)
            scene, parts = cut.scene(self.scene), cut.parts
        else:
            scene = replace(self.scene, arm=self.arm(model))
            parts = [[(k, 0.0)] for k in range(len(scene.arm.links))]
        if model not in self._states:
            self._states[model] = self.start.of(scene, parts)
        q0, v0 = self._states[model]
        return replace(scene, q0=q0, v0=v0, options=options)

    def check(self, model: Model) -> None:
        """ValueError if the scene's controllers or sensors cannot work with this model."""
        scene = self.scene
        if scene.control:
            control_laws(self.arm(model), scene.control, scene.t, scene.loads)
        for sensor in scene.sensors:
            sensor.check(self.arm(model), scene.t)

    def label(self, model: Model) -> str:
        """The model in words, link by link."""
        parts = []
        for group in self.groups:
            name = self.scene.arm.names[group[0]] + (f" and {len(group) - 1} like it" if len(group) > 1 else "")
            parts.append((f"{name}: " if len(self.given.beams) > 1 else "") + model.beam(group[0]).label)
        if model.pieces:
            parts.append(f"in pieces, cut at {self.cuts}")
        return "; ".join(parts) or "the rigid arm"

    @property
    def cuts(self) -> str:
        """Where strains jump, in words."""
        return " and ".join(f"{', '.join(f'{x:.4g}' for x in places)} m of {self.scene.arm.names[k]}"
                            for k, places in self.jumps.items())  # fmt: skip
