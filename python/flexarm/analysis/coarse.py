"""Shape functions that are too few, or of the wrong basis, for the load of a beam."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import flexarm._core as _core

from .._check import Array
from ..model.acting.drive import split_drives
from ..model.parts.beam import STRAINS, Beam
from ..model.parts.chain import Chain
from ..model.parts.joints import Axes
from ..model.parts.link import Link
from ..model.parts.sections import SectionMatrix
from .findings import Finding

_MISSING = {"bending_y": 0.01, "bending_z": 0.01, "torsion": 0.15}  # share of the static compliance
_TIP_ERROR = 1e-3  # of a beam's length
_LOAD = "the load there"
_INSTANTS = 5  # at a load, in a run
_MODAL_MASS = 0.236  # of a beam's mass, that moves with its end in its first mode: 3 / 3.516^2


@dataclass(frozen=True)
class _Stiffened:
    """The compliance of a loaded beam that the shape functions of one strain leave out."""

    link: int
    strain: str
    share: float  #: of the end's static compliance to the inertia of the load, in the first mode
    weight: float  #: the load's part of the deflection, beside that of the beam's own inertia
    heavy: bool  #: whether that is heavier than the beam
    carried: Array  #: displacement (m) of the load by a unit of each of the strain's coordinates, (n,)
    first: int  #: where these stand in the arm's v
    under: str = "what it carries"  #: the load, in words


#: of each strain: the components of the end that it moves, of x y z and the rotations about them; the second's sign by
#: the first; and the section's integral
_MOVES = {
    "bending_y": ([1, 5], 1.0, "second_moment_z"),
    "bending_z": ([2, 4], -1.0, "second_moment_y"),
    "torsion": ([3], 1.0, "torsion_constant"),
}


def _held_rates(arm: Chain, drive: Any, control: Any, tau: Any) -> frozenset[int]:
    """The rates of joints that something drives or holds, struts, contacts and loops too. Others pass no force on."""
    if control:
        return frozenset(range(arm.nv))
    held = set(arm.by_rate("drive", split_drives(arm, drive)[0]))
    held |= set(np.flatnonzero(tau).tolist()) if tau is not None and np.shape(tau) == (arm.nv,) else set()
    for k in arm.movable:
        if np.any(arm.links[k].joint.stiffness) or np.any(arm.links[k].joint.coulomb):
            held |= set(arm.joint_rates(k))
    if arm.struts:
        held |= set(np.flatnonzero(arm.strut_jacobian(arm.zero).any(axis=0)).tolist())
    if arm.contacts:
        held |= set(np.flatnonzero(arm.contact_jacobian(arm.zero).any(axis=0)).tolist())
    if arm.loops:
        held |= set(np.flatnonzero(arm.loop_jacobian(arm.zero).any(axis=0)).tolist())
    return frozenset(held)


def _carried(arm: Chain, k: int, beam: Beam, held: frozenset[int]) -> Array:
    """Inertia (6, 6), in the axes of a beam's end, of all that sits there when it stands straight and stiff; joints
    that nothing holds give way."""
    on_end = {j for i in _on_end(arm, k) for j in (i, *arm.carried(i))}
    at = {j: n for n, j in enumerate([k, *sorted(on_end)])}
    mass = sum(arm.links[j].mass for j in at)
    own = mass * np.repeat([1.0, beam.length**2], 3)  # that the joint may move a body without inertia
    joint = Axes(axes=("tx", "ty", "tz", "rx", "ry", "rz"), reflected_inertia=own.tolist())
    links = [Link(joint, arm.links[k].tip)]
    for j, n in list(at.items())[1:]:
        link, parent = arm.links[j], at[arm.parents[j]]
        links.append(link if link.parent is None and parent == n - 1 else replace(link, parent=parent))
    rest = arm._alike(links, struts=(), contacts=(), loops=())
    M = rest._core.mass_matrix(rest.zero)
    A = np.asarray(M[:6, :6]) - np.diag(own)
    free = [
        own
        for j in arm.movable
        if j != k and j in at
        for own, i in zip(rest.joint_rates(at[j]), arm.joint_rates(j), strict=True)
        if i not in held
    ]
    if free:
        A -= M[:6, free] @ np.linalg.pinv(M[np.ix_(free, free)]) @ M[free, :6]
    return A


def _on_end(arm: Chain, k: int) -> list[int]:
    """The links that sit on the end of link k."""
    return [j for j in arm.children(k) if arm.seats[j][1] is None]


def _end_loads(arm: Chain, loads: Any, run: tuple[Array, Array, Array]) -> dict[int, tuple[float, float]]:
    """The sizes of force (N) and moment (N m) that loads of time, and contacts, put on the end of a link's beam, by
    link."""
    out: dict[int, tuple[float, float]] = {}
    t, q, v = run
    if arm.contacts and len(q):
        for sides, most in zip(arm._touching, arm.contact_motion(q, v)[2].max(axis=0).tolist(), strict=True):
            for k, on, x, _ in sides:
                beam = arm.links[k].beam if k >= 0 else None
                if beam is not None and (on == "end" or (on == "slice" and x == beam.length)):
                    out[k] = out.get(k, (0.0, 0.0))[0] + most, 0.0
    for load in loads or ():
        k = arm._link(load.link)
        beam = arm.links[k].beam
        if beam is not None and not load.by_state and load.along is None and load.x in (None, beam.length):
            most = np.abs([load(float(x)) for x in np.linspace(t[0], t[-1], _INSTANTS)]).max(axis=0)
            force, moment = out.get(k, (0.0, 0.0))
            out[k] = force + float(np.linalg.norm(most[:3])), moment + float(np.linalg.norm(most[3:]))
    return out


def _stiffened(k: int, beam: Beam, where: slice, A: Array, pull: tuple[float, float]) -> Iterator[_Stiffened]:
    """Of each strain of a beam that carries the inertia A, and of bending under a force and a moment at the end."""
    x, w = np.polynomial.legendre.leggauss(16)
    x, w = 0.5 * beam.length * (1 + x), 0.5 * beam.length * w
    sections: list[Any] = [beam.section.at(float(s)) for s in x]
    K, first = np.asarray(beam._core.stiffness), 0
    turns = np.asarray(beam._core.turns(np.array([*x, beam.length]))).reshape(-1, 3, K.shape[0])
    for strain, n in beam.counts.items():
        at, first = slice(first, first + n), first + n
        moved, sign, integral = _MOVES.get(strain, ([], 0.0, ""))
        if not moved or not all(isinstance(x, SectionMatrix) or hasattr(x, integral) for x in sections):
            continue  # neither shear nor extension
        if beam.material is None:
            rigidity = np.array([s.rigidity(strain) for s in sections])
        else:
            modulus = beam.material.youngs_modulus if len(moved) == 2 else beam.material._core.shear_modulus
            rigidity = modulus * np.array([getattr(s, integral) for s in sections])
        # displacement and rotation of the end, by the strain at x and by the coordinates
        rotation = turns[:, _core.STRAIN_FIELDS[STRAINS.index(strain)].rotation, at] * sign
        lever = np.array([beam.length - x, np.ones_like(x)])[-len(moved) :]
        reach = np.array([w @ rotation[:-1], rotation[-1]])[-len(moved) :]
        exact = (lever * (w / rigidity)) @ lever.T
        missing = exact - reach @ np.linalg.solve(K[at, at], reach.T)
        carried = A[np.ix_(moved, moved)]
        mass = max(float(A[0, 0]), 1e-9 * float(A.diagonal()[3:].max()) / beam.length**2, 1e-300)
        towards = np.sqrt(np.maximum(A[3:4, 3], 0.0) / mass)
        whole = carried.copy()
        if len(moved) == 2:
            carried = carried * np.array([[1.0, sign], [sign, 1.0]])
            whole = carried + np.diag([_MODAL_MASS * beam.mass, 0.0])
            towards = np.array([1.0, carried[0, 1] / mass])
        u = np.eye(len(moved))[0]
        for _ in range(3):  # to the first mode
            u = exact @ whole @ u
            u /= max(float(np.abs(u).max()), 1e-300)
        f, g = carried @ u, whole @ u
        given, total = float(f @ exact @ f), float(g @ exact @ g)
        share, weight = float(f @ missing @ f) / max(given, 1e-300), given / max(total, 1e-300)
        start = where.start + at.start
        yield _Stiffened(k, strain, share, weight, mass > beam.mass, towards @ reach, start)
        if any(pull) and len(moved) == 2:
            share = float(np.abs(missing[0]) @ pull / (np.abs(exact[0]) @ pull))
            yield _Stiffened(k, strain, share, 1.0, False, reach[0], start, _LOAD)


def _tip_error(s: _Stiffened, away: float, rate: float, time: float) -> float:
    """Displacement (m) that is wrong of one up to `away` (m), at rates up to `rate` (m/s): at once, and because half
    as much is wrong of the frequency, at which it gets out of phase."""
    time = 0.0 if s.under == _LOAD else time  # which has no inertia
    return min(2 * away, s.share * s.weight * (away + 0.5 * time * rate))


def coarse(
    arm: Chain,
    drive: Any,
    control: Any,
    tau: Any = None,
    loads: Any = None,
    run: tuple[Array, Array, Array] | None = None,
) -> Iterator[Finding]:
    """Beams whose shape functions are too few for their load, or of the wrong basis.

    Clamped-free modes have no curvature at the end. Under a force there, one leaves out 3 % of the deflection, two
    0.5 %, three 0.2 %; under a moment, of a body driven beyond the next joint, they converge as 1 / n. A finding each
    where more is left out than in `_MISSING` under a load heavier than the beam, and, of a run (t, q, v), where that,
    or the part left out under a force on the end, is more than `_TIP_ERROR` of the beam's length. A strain that stays
    zero while the arm moves is right.
    """
    pulls = _end_loads(arm, loads, run) if run is not None and (loads or arm.contacts) else {}
    with suppress(ValueError):  # their loads are beyond rounding
        for s in _all_stiffened(arm, _held_rates(arm, drive, control, tau), pulls):
            yield from _findings(arm, s, run)


def _all_stiffened(arm: Chain, held: frozenset[int], pulls: dict[int, tuple[float, float]]) -> Iterator[_Stiffened]:
    """Of an arm's beams, but for those with patches and those that are curved."""
    for k, beam, _, at in arm.beams():
        tip = arm.links[k].tip
        carries = bool(_on_end(arm, k)) or bool(tip is not None and tip.mass)
        if beam.mass and not (beam.patches or beam.curvature) and (carries or k in pulls):
            A = _carried(arm, k, beam, held) if carries else np.zeros((6, 6))
            yield from _stiffened(k, beam, at, A, pulls.get(k, (0.0, 0.0)))


def _findings(arm: Chain, s: _Stiffened, run: tuple[Array, Array, Array] | None) -> Iterator[Finding]:
    if (beam := arm.links[s.link].beam) is not None:
        n, off, still = len(s.carried), 0.0, False
        if run is not None and len(run[1]):
            t, q, v = run
            at = arm.coordinate_of(s.first)
            away, rate = (float(np.abs(x @ s.carried).max()) for x in (q[:, at : at + n], v[:, s.first : s.first + n]))
            still = not (away or rate) and bool(np.any(v))
            off = _tip_error(s, away, rate, float(t[len(q) - 1] - t[0])) / beam.length
        limit = _MISSING[s.strain]
        if (s.heavy and s.share > limit and not still) or off > _TIP_ERROR:
            wrong = f"; here that is about {off:.1g} of the beam's length" if off > _TIP_ERROR else ""
            few = "three or more" if s.strain != "torsion" and n < 3 else "as many"
            better = f'{few} of basis "legendre"' if beam.basis != "legendre" else "more of them"
            what = f"{n} of {s.strain} leave out {100 * s.share:.2g} % of how far the end gives way under {s.under}"
            yield Finding(f"link[{s.link}].beam.modes", what + wrong, 100 * s.share, 100 * limit, "%", f"take {better}")
