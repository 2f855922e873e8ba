"""The mechanisms of bench/run/loops.py as flexarm's arms."""

from __future__ import annotations

from typing import Any

import flexarm as fa
import numpy as np
from loops_cases import MISALIGNED, NU, RHO, E, Held, Planar
from loops_truth import (
    ANDREWS,
    DELTA_TORQUES,
    FOURBAR,
    GRAVITY,
    WORLD,
    Array,
    Bodies,
    Hold,
    Rod,
    bricard,
    delta,
)

KINDS = {"fixed": fa.Fixed, "revolute": fa.Revolute, "prismatic": fa.Prismatic, "cylindrical": fa.Cylindrical,
         "universal": fa.Universal, "planar": fa.Planar, "spherical": fa.Spherical}  # fmt: skip
STEEL = fa.Material(RHO, E, NU)


def bodies(whole: Bodies, tree: list[int]) -> fa.Arm:
    """Links with their centres as frames; the joints of `tree` carry them, by their bodies in turn, the others close
    loops. Zero is the position in which the bodies are given, where their axes are the world's."""

    def joint(hold: Hold) -> fa.Joint:
        (p, R), (end, out) = hold.on_a, hold.on_b
        return KINDS[hold.kind](inboard=fa.Placement(tuple(p), R), outboard=fa.Placement(tuple(-out.T @ end), out.T))

    def name(body: int) -> str:
        return "world" if body == WORLD else f"body{body}"

    links = []
    for k in tree:
        hold = whole.holds[k]
        body = fa.RigidBody(whole.mass[hold.b], inertia=whole.inertia[hold.b])
        links.append(fa.Link(joint(hold), body, name=name(hold.b), parent=name(hold.a)))
    loops = [fa.Loop(name(x.a), name(x.b), joint(x)) for k, x in enumerate(whole.holds) if k not in tree]
    return fa.Arm(links, whole.gravity, loops=loops)


def bar(length: float, mass: float, name: str, at: float | None = None) -> fa.Link:
    """A thin bar on a hinge about z; at a place on the world's x axis, or on the end of the last one."""
    joint = fa.Revolute("z", inboard=None if at is None else fa.Placement((at, 0, 0)))
    body = fa.RigidBody(mass, (length / 2, 0, 0), (0, 0, mass * length**2 / 12), (length, 0, 0))
    return fa.Link(joint, body, name=name, parent=None if at is None else "world")


def pin(a: Any, b: Any) -> fa.Loop:
    return fa.Loop(a, b, fa.Revolute("z"))


def four_bar() -> fa.Arm:
    of = FOURBAR
    links = [bar(of.crank, of.density * of.crank, "crank"), bar(of.coupler, of.density * of.coupler, "coupler"),
             bar(of.rocker, of.density * of.rocker, "rocker", of.base)]  # fmt: skip
    return fa.Arm(links, (0, -of.gravity, 0), loops=[pin("coupler", "rocker")])


def double_four_bar() -> fa.Arm:
    links = [bar(1, 1, "crank 0"), bar(1, 1, "coupler 1"), bar(1, 1, "crank 1", 1.0), bar(1, 1, "coupler 2"),
             bar(1, 1, "crank 2", 2.0)]  # fmt: skip
    return fa.Arm(links, (0, -GRAVITY, 0), loops=[pin(f"coupler {k}", f"crank {k}") for k in (1, 2)])


def squeezer() -> fa.Arm:
    of = ANDREWS

    def link(k: int, com: tuple[float, float], end: tuple[float, float], at: Array | None = None) -> fa.Link:
        joint = fa.Revolute("z", inboard=None if at is None else fa.Placement((*at, 0)))
        body = fa.RigidBody(of.m[k - 1], (*com, 0), (0, 0, of.I[k - 1]), (*end, 0))
        return fa.Link(joint, body, name=f"K{k}", parent=None if at is None else "world")

    links = [
        link(1, (of.ra, 0), (of.rr, 0)), link(2, (-of.da, 0), (-of.d, 0)),
        link(3, (of.sa, of.sb), (0, -of.ss), of.B),
        link(5, (of.ta, of.tb), (of.zt, 0), of.A), link(4, (0, of.ea - of.e), (0, -of.e)),
        link(7, (-of.ub, -of.ua), (0, -of.u), of.A), link(6, (of.zf - of.fa, 0), (of.zf, 0)),
    ]  # fmt: skip
    spring = fa.Strut((*of.C, 0), fa.Point("K3", "origin", (of.sd, -of.sc, 0)), stiffness=of.spring, length=of.rest)
    return fa.Arm(links, struts=[spring], loops=[pin("K2", k) for k in ("K3", "K4", "K6")])


SQUEEZER_ORDER = [0, 1, 2, 4, 3, 6, 5]  # its joints are those of these angles


def bricard_arm() -> fa.Arm:
    return bodies(bricard()[0], [0, 1, 2, 3, 4])


def delta_arm() -> tuple[fa.Arm, Array]:
    """And its constant torques."""
    arm = bodies(delta()[0], [0, 5, 10, 1, 3, 6, 8, 11, 13, 2])
    tau = np.zeros(arm.nv)
    tau[:3] = DELTA_TORQUES
    return arm, tau


def planar(case: Planar, shapes: tuple[int, int, int] = (4, 5, 5), fine: int = 2, order: Any = "exact") -> fa.Arm:
    """Beams of a crank, a coupler, and a rocker or a block; so many shapes of bending each, `fine` of shear and of
    stretch."""

    def beam(length: float, bending: int) -> fa.Beam:
        of = {"bending_y": bending, "shear_y": fine, "extension": fine}
        section = fa.Rectangle(case.thick, case.wide)
        return fa.Beam(length, section, STEEL, of, "legendre", order, kelvin_voigt=case.retardation)

    crank = fa.Revolute("z", reflected_inertia=case.hub)
    links = [fa.Link(crank, beam=beam(case.crank, shapes[0]), name="crank"),
             fa.Link(fa.Revolute("z"), beam=beam(case.coupler, shapes[1]), name="coupler")]  # fmt: skip
    if case.base is None:
        links.append(fa.Link(fa.Prismatic("x"), fa.RigidBody(case.block), name="last", parent="world"))
    else:
        foot = fa.Revolute("z", inboard=fa.Placement((case.base, 0, 0)))
        links.append(fa.Link(foot, beam=beam(case.rocker, shapes[2]), name="last", parent="world"))
    return fa.Arm(links, (0, -case.gravity, 0), loops=[pin("coupler", "last")])


def start(arm: fa.Arm, case: Planar) -> Array:
    up, back = case.angles()
    last = case.crank * np.cos(case.angle) + case.coupler * np.cos(up) if case.base is None else back
    pose = arm.pose({"crank": case.angle, "coupler": up - case.angle, "last": last})
    return np.asarray(arm.assemble(pose, hold=["crank"]))


def drives(case: Planar) -> dict[str, Any]:
    if case.turn:
        return {"crank": fa.Motion([0, case.end], [case.angle, case.angle + case.turn], [0, 0], [0, 0])}
    return {"crank": fa.Torque(case.knots, case.torques)}


def held(case: Held, shapes: tuple[int, int, int] = (4, 4, 6), fine: int = 2) -> fa.Arm:
    """Two arms that hold a bar; the left one carries it, and the right one's hand closes the loop."""

    def beam(length: float, bending: int) -> fa.Beam:
        of = {"bending_y": bending, "shear_y": fine, "extension": fine}
        section = fa.Rectangle(case.thick, case.wide)
        return fa.Beam(length, section, STEEL, of, "legendre", "exact", kelvin_voigt=case.retardation)

    def shoulder(at: float) -> fa.Revolute:
        return fa.Revolute("z", inboard=fa.Placement((at, 0, 0)), reflected_inertia=case.hub)

    grip = fa.Fixed(inboard=fa.Placement(rotation=(0, 0, -case.fore)))
    links = [fa.Link(shoulder(0), beam=beam(case.crank, shapes[0]), name="left upper"),
             fa.Link(fa.Revolute("z"), beam=beam(case.coupler, shapes[1]), name="left fore"),
             fa.Link(grip, beam=beam(case.bar, shapes[2]), name="bar"),
             fa.Link(shoulder(case.base or 0), beam=beam(case.crank, shapes[0]), name="right upper", parent="world"),
             fa.Link(fa.Revolute("z"), beam=beam(case.coupler, shapes[1]), name="right fore")]  # fmt: skip
    turn = fa.Placement(rotation=(0, 0, np.pi - case.fore))  # the right fore arm, as seen from the bar
    return fa.Arm(links, (0, -case.gravity, 0), loops=[fa.Loop("bar", "right fore", fa.Fixed(outboard=turn))])


def held_start(arm: fa.Arm, case: Held) -> Array:
    a, b = case.angle, case.fore
    pose = {"left upper": a, "left fore": b - a, "right upper": np.pi - a, "right fore": a - b}
    return np.asarray(arm.assemble(arm.pose(pose)))


def held_drives(case: Held) -> dict[str, Any]:
    return {"left upper": fa.Torque(case.knots, case.torques),
            "right upper": fa.Torque(case.knots, [0.5 * x for x in case.torques])}  # fmt: skip


def misaligned(bending: int = 3, rest: int = 2) -> fa.Arm:
    """Bauchau's four bars; at zero the bars stand as they are at first."""
    case = MISALIGNED

    def beam(k: int) -> fa.Beam:
        K, mass, J = case.section(case.sides[k])
        inertia = np.diag([mass] * 3 + list(np.diag(J)))
        of = {"bending_y": bending, "bending_z": bending, "torsion": rest, "shear_y": rest, "shear_z": rest,
              "extension": rest}  # fmt: skip
        length = float(np.hypot(*np.subtract(case.corners[k + 1], case.corners[k])))
        return fa.Beam(length, fa.SectionMatrix(K, inertia), None, of, "legendre", "exact",
                       kelvin_voigt=case.retardation)  # fmt: skip

    def hinge(turn: float, at: tuple[float, float] = (0, 0)) -> fa.Revolute:
        return fa.Revolute("z", inboard=fa.Placement((*at, 0), (0, 0, turn)))

    links = [fa.Link(hinge(np.pi / 2), beam=beam(0), name="crank"),
             fa.Link(hinge(-np.pi / 2), beam=beam(1), name="coupler"),
             fa.Link(hinge(np.pi / 2, case.corners[3]), beam=beam(2), name="rocker", parent="world")]  # fmt: skip
    axis = (np.sin(case.tilt), 0, np.cos(case.tilt))
    tilted = fa.Revolute(axis, outboard=fa.Placement(rotation=(0, 0, np.pi / 2)))
    return fa.Arm(links, loops=[fa.Loop("coupler", "rocker", tilted, name="C")])


def misaligned_drive() -> dict[str, Any]:
    """Of degree 5 between 61 samples of the start, and on to the end."""
    case = MISALIGNED
    t = np.unique(np.concatenate([np.linspace(0, case.start, 61), [case.end]]))
    x = np.minimum(t / case.start, 1)
    rate = case.speed * x**3 * (10 - 15 * x + 6 * x * x)
    more = case.speed / case.start * 30 * x**2 * (1 - x) ** 2
    return {"crank": fa.Motion(t, [case.angle(now) for now in t], rate, more)}


def rod_crank(of: Rod, bending: int = 5, along: int = 3) -> fa.Arm:
    """The slider crank of the IVP test set: a crank without mass that is driven, an elastic rod, a block."""
    material = fa.Material(of.density, of.E, 0.3)
    beam = fa.Beam(of.length, fa.Rectangle(of.side, of.side), material, {"bending_y": bending, "extension": along},
                   "legendre", "exact", kelvin_voigt=of.damping)  # fmt: skip
    body = fa.RigidBody(0.36, (of.crank / 2, 0, 0), (0, 0, 1e-3), (of.crank, 0, 0))
    links = [fa.Link(fa.Revolute("z"), body, name="crank"), fa.Link(fa.Revolute("z"), beam=beam, name="rod"),
             fa.Link(fa.Prismatic("x"), fa.RigidBody(of.block), name="block", parent="world")]  # fmt: skip
    return fa.Arm(links, loops=[pin("rod", "block")])


def five_bar(bending: int = 3) -> fa.Arm:
    """Two cranks and two couplers of beams in a plane, 0.3 m apart, whose couplers meet: two freedoms."""
    def beam(length: float) -> fa.Beam:
        return fa.Beam(length, fa.Rectangle(0.004, 0.02), STEEL, {"bending_y": bending}, "legendre", kelvin_voigt=1e-4)

    links = []
    for side, at in (("left", -0.15), ("right", 0.15)):
        foot = fa.Revolute("z", inboard=fa.Placement((at, 0, 0)), reflected_inertia=0.02)
        links += [fa.Link(foot, beam=beam(0.3), name=f"{side} crank", parent="world"),
                  fa.Link(fa.Revolute("z"), beam=beam(0.4), name=f"{side} coupler")]  # fmt: skip
    return fa.Arm(links, (0, -GRAVITY, 0), loops=[pin("left coupler", "right coupler")])


def closed_ring(links: int, bending: int = 0) -> tuple[fa.Arm, Array]:
    """A regular polygon of so many bars in a plane, that swings on a hinge of the world and is closed there; springs
    and dampers in its hinges. And its start."""
    long = 2 * np.pi / links * 0.5
    made = []
    for k in range(links):
        spring = {"stiffness": 50.0, "damping": 1.0, "rest": 2 * np.pi / links} if k else {}
        hinge = fa.Revolute("z", **spring)
        body = fa.RigidBody(0.2, (long / 2, 0, 0), (0, 0, 0.2 * long**2 / 12), (long, 0, 0))
        beam = fa.Beam(long, fa.Rectangle(0.004, 0.02), STEEL, {"bending_y": bending}, "legendre") if bending else None
        made.append(fa.Link(hinge, None if beam else body, beam=beam, name=f"bar{k}"))
    arm = fa.Arm(made, (0, -GRAVITY, 0), loops=[pin("world", f"bar{links - 1}")])
    q = arm.pose({f"bar{k}": 0.1 if k == 0 else 2 * np.pi / links for k in range(links)})
    return arm, np.asarray(arm.assemble(q))
