"""The mechanisms of bench/run/loops.py as flexarm's arms."""

from __future__ import annotations

from typing import Any

import flexarm as fa
import numpy as np
from loops_cases import MISALIGNED, NU, RHO, E, Misaligned, Planar
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
from scipy.spatial.transform import Rotation

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


def planar(case: Planar, modes: int = 4, along: int = 2, order: Any = "exact") -> fa.Arm:
    """Beams of a crank, a coupler, and a rocker or a block."""

    def beam(length: float) -> fa.Beam:
        of = {"bending_y": modes, "shear_y": max(1, modes - 2), "extension": along}
        section = fa.Rectangle(case.thick, case.wide)
        return fa.Beam(length, section, STEEL, of, "legendre", order, kelvin_voigt=case.retardation)

    crank = fa.Revolute("z", reflected_inertia=case.hub)
    links = [fa.Link(crank, beam=beam(case.crank), name="crank"),
             fa.Link(fa.Revolute("z"), beam=beam(case.coupler), name="coupler")]  # fmt: skip
    if case.base is None:
        block = fa.RigidBody(case.block, inertia=(0, 0, 0))
        links.append(fa.Link(fa.Prismatic("x"), block, name="block", parent="world"))
        return fa.Arm(links, (0, -case.gravity, 0), loops=[pin("coupler", "block")])
    foot = fa.Revolute("z", inboard=fa.Placement((case.base, 0, 0)))
    links.append(fa.Link(foot, beam=beam(case.rocker), name="rocker", parent="world"))
    return fa.Arm(links, (0, -case.gravity, 0), loops=[pin("coupler", "rocker")])


def start(arm: fa.Arm, case: Planar) -> Array:
    up, back = case.angles()
    q = arm.zero.copy()
    at = {name: k for k, name in enumerate(arm.q_labels)} if hasattr(arm, "q_labels") else {}
    del at
    last = case.crank * np.cos(case.angle) + case.coupler * np.cos(up) if case.base is None else back
    pose = {"crank": case.angle, "coupler": up - case.angle, "block" if case.base is None else "rocker": last}
    q = arm.pose(pose)
    return arm.assemble(q, hold=["crank"])


def drives(case: Planar) -> dict[str, Any]:
    if case.turn:
        return {"crank": fa.Motion([0, case.end], [case.angle, case.angle + case.turn], [0, 0], [0, 0])}
    return {"crank": fa.Torque(case.knots, case.torques)}
