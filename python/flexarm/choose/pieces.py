"""A scene with its beams cut into pieces where strains jump or have corners. Smooth shape functions converge slowly
there: two models with them agree before either is accurate. Each piece is smooth and converges fast."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .._check import Array
from ..arm.arm import Arm
from ..model.acting.computed import ComputedTorque, FeedForward
from ..model.acting.control import PD, Controller, StateFeedback, StrainFeedback
from ..model.acting.drive import is_patch, is_strut
from ..model.acting.load import Load
from ..model.acting.sampled import Sampled
from ..model.parts.beam import STRAINS, Beam
from ..model.parts.contact import Contact
from ..model.parts.joints import Fixed
from ..model.parts.link import Link
from ..model.parts.sections import SectionMatrix
from ..model.parts.split import piece, split
from ..model.parts.strut import WORLD, Point, Strut, Tendon
from ..model.parts.taper import Taper
from ..run.scene.scene import Scene
from .states import nearest

_NEAR = 1e-9  # of a beam's length: closer places count as one
_SIZES = ("area", "second_moment_y", "second_moment_z", "torsion_constant")
_LEAST = {s: 3 if s.startswith("bending") else 2 for s in STRAINS}  # shape functions of a piece


def jumps(scene: Scene) -> dict[int, list[float]]:
    """By link, places along its beam (m) where a strain jumps or has a corner: ends of patches that stiffen the beam or
    are driven, corners of a taper, loads, ends of struts, contacts, and links on slices. Beams with the user's own
    shapes are not cut."""
    arm, out = scene.arm, {}
    loads = [(arm._link(load.link), load.along or (load.x,)) for load in scene.loads]
    loads += [(k, (x,)) for points in (*arm._fastened, *arm._touching) for k, on, x, _ in points if on == "slice"]
    loads += [(k, (x,)) for k, x in arm.seats if x is not None]
    for k, link in enumerate(arm.links):
        beam = link.beam
        if beam is None or not beam.ne or any(isinstance(m, tuple) for m in beam.modes.values()):
            continue
        places = [x for at, ends in loads if at == k for x in ends if x is not None]
        places += [x for p in beam.patches if p.stiffness or p.material.d31 or p.material.d15 for x in (p.start, p.end)]
        places += _corners(beam.section) if isinstance(beam.section, Taper) else ()
        found = [0.0]
        for x in sorted(places):
            if found[-1] + _NEAR * beam.length < x < (1 - _NEAR) * beam.length:
                found.append(float(x))
        if found[1:]:
            out[k] = found[1:]
    return out


def leaps(scene: Scene) -> dict[int, str]:
    """By link whose beam's strains jump, and do not only have a corner: what makes them jump."""
    arm, out = scene.arm, {}
    for parent, x in arm.seats:
        if x is not None:
            out[parent] = "a link on a slice"
    for load in scene.loads:
        if (load.x is not None or load.along) and load.given.get("moment") is not None:
            out[arm._link(load.link)] = "a moment along it"
    for k, link in enumerate(arm.links):
        beam = link.beam
        if beam is None or not beam.ne:
            out.pop(k, None)
            continue
        if any(p.stiffness or p.material.d31 or p.material.d15 for p in beam.patches):
            out[k] = "patches"
        elif isinstance(beam.section, Taper) and _corners(beam.section):
            out[k] = "corners of its taper"
    return out


def _corners(taper: Taper) -> list[float]:
    """Places where the slope of a rigidity's logarithm changes by more than one per length."""
    rows = []
    for section in taper.sections:
        if isinstance(section, SectionMatrix):
            rows.append([max(section.rigidity(s), 1e-300) for s in STRAINS])
        else:
            rows.append([getattr(section._core, name) for name in _SIZES])
    slopes = np.diff(np.log(rows), axis=0) / np.diff(taper.x)[:, None]
    sharp = np.abs(np.diff(slopes, axis=0)).max(axis=1, initial=0.0) * taper.x[-1] > 1.0
    return [x for x, cut in zip(taper.x[1:-1], sharp, strict=True) if cut]


def _piece_at(starts: Sequence[float], x: float) -> int:
    """The number of the piece that has a place on a beam, of pieces that begin there."""
    return max(0, int(np.searchsorted(starts, x)) - 1)


@dataclass(eq=False)
class Pieces:
    """The links of an arm cut into pieces, with the map from each link to its pieces."""

    whole: Arm  #: the arm with whole beams
    arm: Arm  #: the same in pieces
    first: list[int]  #: by link of the whole arm, its first piece
    starts: list[list[float]]  #: by link, where its pieces begin (m)

    @classmethod
    def of(cls, whole: Arm, places: Mapping[int, Sequence[float]]) -> Pieces:
        """The arm with its beams cut at these places (m), by link. Each piece has a few more shape functions than its
        beam has over that length."""
        links: list[Link] = []
        first, starts, last = list[int](), list[list[float]](), {-1: -1}  # last: piece of each link
        for k, link in enumerate(whole.links):
            first.append(len(links))
            starts.append([0.0, *places.get(k, ())])
            parent, x = whole.seats[k]
            if x is not None:
                n = _piece_at(starts[parent], x)
                link = replace(link, parent=first[parent] + n, at=x - starts[parent][n])
            elif link.parent is not None and parent >= 0:
                link = replace(link, parent=last[parent])
            links += [link] if len(starts[k]) == 1 else _cut(link, starts[k])
            last[k] = len(links) - 1
        out = cls(whole, Arm(links, whole.gravity), first, starts)
        struts, contacts = [out._strut(s) for s in whole.struts], [out._contact(c) for c in whole.contacts]
        return replace(out, arm=Arm(links, whole.gravity, struts, contacts))

    @property
    def parts(self) -> list[list[tuple[int, float]]]:
        return [list(zip(self._pieces(k), starts, strict=True)) for k, starts in enumerate(self.starts)]

    def _pieces(self, link: int) -> range:
        return range(self.first[link], self.first[link] + len(self.starts[link]))

    def joint(self, key: Any) -> Any:
        """The key of a joint, a link or (link, freedom), for the arm in pieces."""
        return (self.joint(key[0]), *key[1:]) if isinstance(key, tuple) else self.first[self.whole._link(key)]

    def place(self, link: Any, x: float | None) -> tuple[int, float | None]:
        """A place on a link for the arm in pieces; x = None is its end."""
        k = self.whole._link(link)
        if x is None:
            return self._pieces(k)[-1], None
        n = _piece_at(self.starts[k], x)
        return self.first[k] + n, x - self.starts[k][n]

    def _strut(self, strut: Strut | Tendon) -> Strut | Tendon:
        """A strut or tendon between the pieces."""
        given: Sequence[Any] = strut.points
        points = [self._point(p) for p in given]
        return replace(strut, a=points[0], b=points[1]) if isinstance(strut, Strut) else replace(strut, points=points)

    def _contact(self, contact: Contact) -> Contact:
        """A contact of the pieces."""
        surface: Any = contact.against
        moved = replace(surface, **{surface.on: self._point(surface.at)})
        return replace(contact, point=self._point(contact.point), against=moved)  # type: ignore[arg-type]

    def _point(self, point: Point) -> Point:
        if point.link == WORLD:
            return point
        if point.at == "origin":
            return replace(point, link=self.joint(point.link))
        link, x = self.place(point.link, None if point.at == "end" else point.at)  # type: ignore[arg-type]
        return replace(point, link=link, at="end" if x is None else x)

    def patches(self, link: Any, patch: int) -> list[tuple[str, int, int]]:
        """The patches of pieces that represent a patch of a link."""
        k = self.whole._link(link)
        beam, out = self.whole.links[k].beam, []
        assert beam is not None
        patch = self.whole.patches[self.whole.patch_column(k, patch)][1]
        for piece_of, a, b in zip(self._pieces(k), self.starts[k], [*self.starts[k][1:], beam.length], strict=True):
            inside = [j for j, p in enumerate(beam.patches) if min(p.end, b) - max(p.start, a) > _NEAR * beam.length]
            out += [("patch", piece_of, inside.index(patch))] if patch in inside else []
        return out

    # -- a scene -----------------------------------------------------------------------------------------------------

    def scene(self, scene: Scene) -> Scene:
        """The scene on this arm, without its sensors; `Start` sets the initial state.

        Raises:
            ValueError: a part of the scene has no equivalent on pieces.
        """
        drive: dict[Any, Any] = {}
        for key, law in scene.drive.items():
            own = self.patches(*key[1:]) if is_patch(key) else [key] if is_strut(self.whole, key) else [self.joint(key)]
            drive |= dict.fromkeys(own, law)
        loads = tuple(part for load in scene.loads for part in self._load(load))
        control = tuple(self._control(k, law) for k, law in enumerate(scene.control))
        D = self._damping()
        if D.any():
            moved = np.flatnonzero(D.any(axis=1))
            gains = np.hstack([np.zeros((len(moved), self.arm.nv)), D[moved]])
            control += (StateFeedback(gains, list(np.eye(self.arm.nv)[moved])),)
        return replace(scene, arm=self.arm, drive=drive, loads=loads, control=control, sensors=(), q0=None, v0=None)

    def _load(self, load: Load) -> list[Load]:
        if load.along is None:
            link, x = self.place(load.link, load.x)
            return [Load(**{**load.given, "link": link, "x": x})]
        k, (a, b) = self.whole._link(load.link), load.along
        beam, out = self.whole.links[k].beam, []
        assert beam is not None
        for n, start, end in zip(self._pieces(k), self.starts[k], [*self.starts[k][1:], beam.length], strict=True):
            if min(b, end) - max(a, start) > _NEAR * beam.length:
                part = max(a, start) - start, min(b, end) - start
                out.append(Load(**{**load.given, "link": n, "along": part}))
        return out

    def _control(self, k: int, law: Controller) -> Controller:
        made, where = copy.copy(law), f"control[{k}] = {law!r}"
        if isinstance(made, StrainFeedback):
            made.beam, made.x = self.place(made.link if made.beam is None else made.beam, made.x)  # type: ignore[assignment]
            made.pose = None if made.pose is None else self._pose(made.pose)
        if isinstance(made, PD):
            made.link = self.joint(made.link)
        elif isinstance(made, Sampled):
            if made.measure is None:
                raise ValueError(f"{where}: reads the whole state")
            made.measure = [self._measured(where, entry) for entry in made.measure]
            made.actuate = [self._actuated(where, entry) for entry in made.actuate]
        elif not isinstance(made, (FeedForward, ComputedTorque)):
            raise ValueError(f"{where}: acts on coordinates by number")
        return made

    def _pose(self, pose: Array) -> Array:
        """The pose with the same joint positions, for the arm in pieces."""
        out = self.arm.zero
        for k, link in enumerate(self.whole.links):
            old, new = self.whole._core.first_q(k), self.arm._core.first_q(self.first[k])
            out[new : new + link.joint.nq] = pose[old : old + link.joint.nq]
        return out

    def _measured(self, where: str, entry: Any) -> Any:
        kind = entry[0] if isinstance(entry, tuple) and entry else None
        if kind in ("joint", "rate"):
            return kind, self.joint(entry[1])
        if kind == "strain":
            return kind, *self.place(entry[1], entry[2]), entry[3]
        parts = self.patches(*entry[1:]) if kind in ("charge", "patch_voltage") else []
        if len(parts) != 1:
            raise ValueError(f"{where}: has no equivalent on beams in pieces, got {entry!r}")
        return kind, *parts[0][1:]

    def _actuated(self, where: str, entry: Any) -> Any:
        if is_patch(entry):
            columns = [self.arm.patch_column(*part[1:]) for part in self.patches(*entry[1:])]
            return self.arm.patch_matrix[:, columns].sum(axis=1)
        if isinstance(entry, (np.ndarray, list)):
            raise ValueError(f"{where}: acts on coordinates by number")
        return self.joint(entry)

    def _damping(self) -> Array:
        """Damping matrix for beams whose damping no single piece can have: a damping ratio of modes, or a matrix of
        elastic coordinates."""
        D = np.zeros((self.arm.nv, self.arm.nv))
        for k, link in enumerate(self.whole.links):
            beam, cut = link.beam, self._pieces(k)
            if beam is None or len(cut) == 1:
                continue
            parts, rates = zip(*((part, at) for n, part, _, at in self.arm.beams() if n in cut), strict=True)
            at = np.concatenate([np.arange(arm_rates.start, arm_rates.stop) for arm_rates in rates])
            own = np.zeros((len(at), len(at)))
            if beam.damping_ratio:
                own += _modal(parts, beam.damping_ratio)
            if beam.damping:
                P = nearest(list(zip(self.starts[k], parts, strict=True)), [(0.0, beam)])
                own += P.T @ np.array(beam.damping) @ P
            D[np.ix_(at, at)] = own
        return D


def _cut(link: Link, starts: Sequence[float]) -> list[Link]:
    beam = link.beam
    assert beam is not None
    undamped = replace(link, beam=replace(beam, damping_ratio=0.0, damping=()))
    out = []
    for part, a, b in zip(split(undamped, 1, starts[1:]), starts, [*starts[1:], beam.length], strict=True):
        counts = {s: _LEAST[s] + int(np.ceil(n * (b - a) / beam.length)) for s, n in beam.counts.items()}
        out.append(replace(part, beam=piece(undamped.beam, a, b, counts)))  # type: ignore[arg-type]
    return out


def _modal(parts: Sequence[Beam], ratio: float) -> Array:
    """Damping matrix of the clamped beam of these parts, with this ratio in each mode."""
    from scipy.linalg import block_diag, eigh  # slow to import

    clamped = Arm([Link(Fixed(), None, part) for part in parts])
    M = clamped.mass_matrix(clamped.zero)
    squares, shapes = eigh(block_diag(*(part._core.stiffness for part in parts)), M)
    return np.asarray((M @ shapes) * (2 * ratio * np.sqrt(np.maximum(squares, 0.0))) @ (M @ shapes).T)
