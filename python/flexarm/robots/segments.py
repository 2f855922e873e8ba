"""An arm with its beams cut into rigid segments on springs, for programs without beams."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .._check import Array, whole
from ..analysis.modes import modes, small_motions
from ..model.parts.beam import STRAINS, Beam, RigidBody, inertia_matrix
from ..model.parts.chain import Chain
from ..model.parts.joints import Axes, Fixed, Placement
from ..model.parts.link import Link
from ..model.parts.split import piece
from .chain import seated
from .tree import Mass, Pose, merged, realisable

#: a hinge for each strain, in the order of its rotations: about z, then the moved y, then the moved x
HINGES = {"bending_y": "rz", "bending_z": "ry", "torsion": "rx"}
_OTHERS = tuple(s for s in STRAINS if s not in HINGES)
_COUNT, _TERMS = 3, 3  # fitted frequencies; Legendre polynomials of the springs' factor along a beam


@dataclass(frozen=True)
class Segmented:
    """An arm of rigid links, and its comparison with the arm that it approximates."""

    arm: Chain  #: its links; those of a beam's segments follow the link itself
    of: tuple[int, ...]  #: for each of its links, the link of the first arm that it belongs to
    frequencies: Array  #: the lowest (rad/s), all joints locked, without gravity
    wanted: Array  #: those of the first arm
    ends: tuple[int, ...]  #: its links that carry no other on their end, where a beam's last segment is
    left_out: tuple[str, ...] = ()  #: features of the first arm that this one does not have

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its links: those of the first arm, and "NAME segment 1" and so on for a beam's segments."""
        own = self.arm.links
        return tuple(own[i].name or f"link {k}" for i, k in enumerate(self.of))

    @property
    def tips(self) -> dict[int, str]:
        """A name for the end of each of its links that carries no other: "tip", or, of several, "NAME tip"."""
        several = len(self.ends) > 1
        return {i: f"{self.names[self.of.index(self.of[i])]} tip" if several else "tip" for i in self.ends}

    @property
    def hinges(self) -> frozenset[int]:
        """Indices of its links that are a beam's segments on their hinges."""
        return _hinges(self.of)

    @property
    def error(self) -> float:
        """The largest of the frequencies' relative errors."""
        return float(np.abs(self.frequencies / self.wanted - 1).max(initial=0.0))


def segmented(arm: Chain, segments: int = 10, fit: bool = True) -> Segmented:
    """Each beam as `segments` + 1 rigid rods on as many hinges as `segments`, in the middles of equal pieces; without
    struts, tendons, contacts and loops.

    A hinge's spring is the piece's rigidity over its length, and, with `fit`, times a factor that changes smoothly
    along the beam, as near to one as the arm's lowest three frequencies allow (joints locked, no gravity). This is the
    pseudo-rigid-body model (Howell, Compliant Mechanisms, 2001) with equal pieces; it bends and twists, and does not
    shear nor stretch.

    Raises:
        ValueError: too few segments, or a beam that is curved at rest.
    """
    if not 2 <= whole("segments", segments) <= 200:
        raise ValueError(f"segments = {segments}: must be from 2 to 200")
    arm, left_out = arm._alike(arm.links, arm.gravity, (), (), ()), list[str]()
    for name, link in zip(arm.names, arm.links, strict=True):
        if link.beam is not None:
            if link.beam.curvature is not None:
                raise ValueError(f"{name}: curvature: a beam that is curved at rest is not cut into segments")
            if not link.beam.mass and any(s in HINGES for s in link.beam.counts):
                raise ValueError(f"{name}: density = 0: a beam without mass is not cut into segments; give it one")
            if not link.beam.rotary_inertia and "torsion" in link.beam.counts:
                raise ValueError(
                    f"{name}: rotary_inertia = False: leaves segments without inertia in torsion; take rotary_inertia "
                    "= True, or leave torsion out"
                )
            left_out += _left_out(name, link.beam)
    links, of, raised = _links(arm, segments)
    left_out += [f"moments of inertia of '{name}', which no body in space has: they are raised" for name in raised]
    wanted = locked_frequencies(arm, frozenset())[:_COUNT]
    if fit and len(wanted):
        links = _fitted(arm._alike(links), of, wanted)
    near = arm._alike(links, arm.gravity)
    ends = tuple(len(of) - 1 - of[::-1].index(k) for k in arm.ends)
    return Segmented(near, of, locked_frequencies(near, _hinges(of))[: len(wanted)], wanted, ends, tuple(left_out))


def place_in(cut: Segmented, arm: Chain, link: int, on: str, x: float) -> tuple[int, Array]:
    """A place of a link of the first arm, its "origin", its "end" or a "slice" at x metres along its beam: the link of
    the cut arm that has it, and where in its frame (m). Its axes are those of that frame."""
    own = [i for i, k in enumerate(cut.of) if k == link]
    if on == "origin":
        return own[0], np.zeros(3)
    if on == "end":
        return own[-1], _end(cut.arm.links[own[-1]].hub)
    beam, start = arm.links[link].beam, _end(arm.links[link].hub)
    assert beam is not None
    step = beam.length / max(len(own) - 1, 1)
    k = int(x / step + 0.5) if len(own) > 1 else 0
    if k:
        x, start = x - (k - 0.5) * step, np.zeros(3)
    return own[k], start + np.array([x, 0.0, 0.0])


def _left_out(name: str, beam: Beam) -> list[str]:
    stiff = [s for s in beam.counts if s not in HINGES]
    out = [f"{', '.join(stiff)} of '{name}'"] if stiff else []
    out += [f"patches of '{name}', but for their mass and stiffness"] if beam.patches else []
    hinges = {s: 1 for s in beam.counts if s in HINGES}
    K = np.asarray(piece(_plain(beam), 0.0, beam.length, hinges)._core.stiffness) if hinges else np.zeros((0, 0))
    if (np.abs(K - np.diag(np.diag(K))) > 1e-9 * np.sqrt(np.outer(np.diag(K), np.diag(K)))).any():
        out.append(f"the coupling of strains of '{name}'")
    if beam.damping_ratio and any(beam.counts[s] > 1 for s in hinges):
        out.append(f"the damping ratio of '{name}' in modes above the lowest: there it grows with the frequency")
    return out + ([f"the damping matrix of '{name}'"] if beam.damping else [])


def _plain(beam: Beam) -> Beam:
    """The beam without the kinds of damping that hold for a whole beam."""
    return replace(beam, damping_ratio=0.0, damping=())


def _hinges(of: tuple[int, ...]) -> frozenset[int]:
    return frozenset(i for i in range(1, len(of)) if of[i] == of[i - 1])


def locked_frequencies(arm: Chain, hinges: frozenset[int]) -> Array:
    """Frequencies above zero (rad/s), increasing, all other joints locked, without gravity; for an arm with beams those
    of its modes that bend and twist more than they shear and stretch."""
    if not hinges and not any(link.beam is not None and link.beam.ne for link in arm.links):
        return np.zeros(0)
    locked = [k for k, link in enumerate(arm.links) if link.joint.nv and k not in hinges]
    found = small_motions(arm._alike(arm.links), None, None, locked).undamped()
    bends = [not any(f" {s} " in label for s in _OTHERS) for label in arm._core.coordinates]
    return np.asarray(found.frequencies[(found.frequencies > 0) & (found.participation[bends].sum(axis=0) > 0.5)])


def _fitted(cut: Chain, of: tuple[int, ...], wanted: Array) -> list[Link]:
    """The links, with their hinges' springs multiplied by factors as near to 1 as these frequencies allow."""
    from scipy.linalg import eigh  # slow to import
    from scipy.optimize import least_squares

    hinges = sorted(_hinges(of))
    joints = [cut.links[i].joint for i in hinges]
    rates = [i for k in hinges for i in cut.joint_rates(k)]
    M = cut.mass_matrix(cut.zero)[np.ix_(rates, rates)]
    springs = np.concatenate([joint._per_freedom("stiffness", joint.nv) for joint in joints])
    kinds = [(of[i], label) for i, joint in zip(hinges, joints, strict=True) for label in joint.labels]
    rows = [np.flatnonzero([k == kind for k in kinds]) for kind in dict.fromkeys(kinds)]
    by = np.zeros((len(rates), _TERMS * len(rows)))  # logarithms of the factors, by the Legendre terms
    for i, row in enumerate(rows):
        x = np.linspace(-1, 1, len(row) + 1)
        by[row, _TERMS * i : _TERMS * (i + 1)] = np.polynomial.legendre.legvander((x[1:] + x[:-1]) / 2, _TERMS - 1)

    def misses(terms: Array) -> Array:
        squares = eigh(np.diag(springs * np.exp(by @ terms)), M, eigvals_only=True)[: len(wanted)]
        return np.concatenate([np.log(squares / wanted**2) / 2, 1e-3 * terms])

    factors = iter(np.exp(by @ least_squares(misses, np.zeros(by.shape[1]), method="lm").x).tolist())
    links = list(cut.links)
    for i, joint in zip(hinges, joints, strict=True):
        own = np.array([next(factors) for _ in joint.labels])
        values = {f: (own * joint._per_freedom(f, joint.nv)).tolist() for f in ("stiffness", "damping")}
        links[i] = replace(links[i], joint=replace(joint, **values))
    return links


def _links(arm: Chain, n: int) -> tuple[list[Link], tuple[int, ...], list[str]]:
    """The arm in pieces, the link of each piece, and the links whose moments of inertia were raised."""
    links: list[Link] = []
    of: list[int] = []
    parents: list[int] = []
    first, last = list[int](), {-1: -1}  # pieces of each link
    raised: list[str] = []
    for k, link in enumerate(arm.links):
        corrected: list[bool] = []
        parent, x = arm.seats[k]
        sits = last[parent]
        if x is not None:
            along, off = _segment_at(arm.links[parent], last[parent] - first[parent], x)
            sits, link = first[parent] + along, _moved(link, off)
        if link.beam is not None:
            parts = _cut(arm.names[k], link, link.beam, n, corrected)
        else:
            end = _end(link.hub)
            body = _rigid([mass_of(link.hub), mass_of(link.tip).placed(Pose(end))], end + _end(link.tip), corrected)
            parts = [replace(link, hub=body, tip=None) if link.tip or any(corrected) else link]
        parents += [sits, *range(len(links), len(links) + len(parts) - 1)]
        first.append(len(links))
        links += parts
        last[k] = len(links) - 1
        of += [k] * len(parts)
        raised += [arm.names[k]] if any(corrected) else []
    return seated(links, parents), tuple(of), raised


def _segment_at(link: Link, n: int, x: float) -> tuple[int, Array]:
    """The segment that has the place x on a beam of n hinges, and where that is from the segment's end, in its axes."""
    assert link.beam is not None
    step = link.beam.length / max(n, 1)
    k = min(int(x / step + 0.5), n) if n else 0
    end = link.beam.length if k == n else (k + 0.5) * step
    return k, np.array([x - end, 0.0, 0.0]) - (_end(link.tip) if k == n else 0.0)


def _moved(link: Link, off: Array) -> Link:
    """The link with its joint moved on its parent, at whose end it sits."""
    inboard = link.joint.inboard or Placement()
    place = replace(inboard, position=(np.array(inboard.position) + off).tolist())
    return replace(link, joint=replace(link.joint, inboard=place), at=None)


def mass_of(body: RigidBody | None) -> Mass:
    """A part's inertia."""
    return Mass() if body is None else Mass(body.mass, np.array(body.com), inertia_matrix(body.inertia))


def _rigid(bodies: Sequence[Mass], end: Array, corrected: list[bool]) -> RigidBody:
    """The bodies as one; appends to `corrected` whether its moments of inertia were raised."""
    own = merged(bodies)
    one = realisable(own)
    corrected.append(one is not own)
    return RigidBody(one.mass, one.com.tolist(), one.inertia.tolist(), end.tolist())


def _end(body: RigidBody | None) -> Array:
    return np.zeros(3) if body is None else np.array(body.end)


def _cut(name: str, link: Link, beam: Beam, n: int, corrected: list[bool]) -> list[Link]:
    """The link up to the middle of its beam's first piece, and a link for each hinge; `corrected`: see `_rigid`."""
    plain = _plain(beam)
    strains = [s for s in beam.counts if s in HINGES]
    if not strains:  # it neither bends nor twists
        at = _end(link.hub)
        tip = at + np.array([beam.length, 0.0, 0.0])
        rigid = [mass_of(link.hub), _rod(plain, 0.0, beam.length).placed(Pose(at)), mass_of(link.tip).placed(Pose(tip))]
        return [replace(link, hub=_rigid(rigid, tip + _end(link.tip), corrected), beam=None, tip=None)]
    step = beam.length / n
    times = np.array([_retardation(beam, plain, strain) for strain in strains])
    halves = [_rod(plain, k * step / 2, min((k + 1) * step / 2, beam.length)) for k in range(2 * n)]
    ahead, half, end = _end(link.hub), np.array([step / 2, 0.0, 0.0]), _end(link.tip)
    first = _rigid([mass_of(link.hub), halves[0].placed(Pose(ahead))], ahead + half, corrected)
    out = [replace(link, hub=first, beam=None, tip=None)]
    for k in range(n):
        stiffness, damping = _springs(plain, k * step, (k + 1) * step, strains, times)
        axes = [HINGES[s] for s in strains]
        hinge = Axes(axes=axes, stiffness=stiffness, damping=damping, name=f"{name} segment {k + 1} hinge")
        rods = [halves[2 * k + 1], *([halves[2 * k + 2].placed(Pose(half))] if k + 1 < n else [])]
        rods += [mass_of(link.tip).placed(Pose(half))] if k + 1 == n else []
        body = _rigid(rods, half + (half if k + 1 < n else end), corrected)
        out.append(Link(hinge, body, name=f"{name} segment {k + 1}"))
    return out


def _rod(beam: Beam, a: float, b: float) -> Mass:
    """The inertia of a rigid piece of a beam, about its own start."""
    rod = piece(beam, a, b, {})
    mass = rod.mass
    if not mass:
        return Mass()
    own = mass * np.repeat([1.0, (b - a) ** 2], 3)  # added inertia, so that a thin rod has a regular mass matrix
    afloat = Axes(axes=("tx", "ty", "tz", "rx", "ry", "rz"), reflected_inertia=own.tolist())
    M = Chain([Link(afloat, beam=rod)]).mass_matrix(np.zeros(6)) - np.diag(own)
    com = np.array([M[1, 5], M[2, 3], M[0, 4]]) / mass
    r = np.array(com)
    return Mass(mass, com, M[3:, 3:] - mass * (r @ r * np.eye(3) - np.outer(r, r)))


def _springs(
    beam: Beam, a: float, b: float, strains: Sequence[str], times: Array
) -> tuple[list[float], list[float]]:
    """For each strain, a hinge's spring (its piece's rigidity over its length) and damper: the material's retardation
    time plus `times` (s)."""
    own = piece(beam, a, b, dict.fromkeys(strains, 1))
    K, D = np.diag(own._core.stiffness), np.diag(own._core.damping)
    stiffness = K / (b - a) ** 2
    return stiffness.tolist(), (stiffness * (D / K + times)).tolist()


def _retardation(beam: Beam, plain: Beam, strain: str) -> float:
    """The retardation time that gives a strain's lowest mode of the clamped beam the beam's damping ratio."""
    if not beam.damping_ratio:
        return 0.0
    alone = Chain([Link(Fixed(), beam=replace(plain, modes={strain: beam.modes[strain]}))])
    return 2 * beam.damping_ratio / float(modes(alone).frequencies[0])
