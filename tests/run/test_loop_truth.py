"""Closed loops beside solutions that are not flexarm's (tests/data/loops.json, by bench/run/loops_truth.py), and beside
published numbers."""

from __future__ import annotations

import json
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from arms import DATA, G

TRUTH = json.loads((DATA / "loops.json").read_text(encoding="utf-8"))
KINDS = {"fixed": fa.Fixed, "revolute": fa.Revolute, "prismatic": fa.Prismatic, "cylindrical": fa.Cylindrical,
         "universal": fa.Universal, "planar": fa.Planar, "spherical": fa.Spherical}  # fmt: skip
RUNS = [
    {},
    {"integrator": "gauss", "step": 2e-3},
    {"integrator": "implicit", "step": 1e-3},
    {"integrator": "rk4", "step": 1e-3},
    {"integrator": "ida", "rtol": 1e-8, "atol": 1e-10},
]
every_run = pytest.mark.parametrize("options", RUNS, ids=lambda x: x.get("integrator", "default"))
FAR = {"": 3e-4, "gauss": 1e-7, "implicit": 3e-4, "rk4": 1e-7, "ida": 1e-5}


def far(options: dict[str, Any]) -> float:
    return FAR[options.get("integrator", "")]


def closed(arm: fa.Arm, run: fa.Result, tolerance: float = 1e-12) -> None:
    """Of all output times the loops are closed, and their rates are zero."""
    g, rate = arm.loop_motion(run.q, run.v)
    assert np.abs(g).max() < tolerance
    assert np.abs(rate).max() < tolerance * max(1.0, np.abs(run.v).max())


# -- chains closed by each joint ---------------------------------------------------------------------------------------


def ring(case: dict[str, Any]) -> fa.Arm:
    links = [
        fa.Link(
            fa.Revolute(x["axis"], inboard=fa.Placement(x["position"], x["rotation"])),
            fa.RigidBody(x["mass"], x["com"], x["inertia"]),
        )
        for x in case["links"]
    ]
    joint = case["joint"]
    kind = KINDS[joint["kind"]]
    axis = {"axis": joint["axis"]} if joint["kind"] in ("revolute", "prismatic", "cylindrical") else {}
    made = kind(inboard=fa.Placement(*joint["inboard"]), outboard=fa.Placement(*joint["outboard"]), **axis)
    a, b = ((fa.Point(link, "origin", offset) if link is not None else fa.Point("world", offset=offset))
            for link, offset in (case["a"], case["b"]))  # fmt: skip
    soft = {}
    if case["soft"]:
        soft = dict(zip(("stiffness", "angular_stiffness", "damping", "angular_damping"), case["soft"], strict=True))
        if joint["kind"] == "spherical":
            soft = {k: v for k, v in soft.items() if not k.startswith("angular")}
    return fa.Arm(links, case["gravity"], loops=[fa.Loop(a, b, made, name="ring", **soft)])


def name_of(case: dict[str, Any]) -> str:
    ends = "to the world" if case["a"][0] is None else "to a link"
    return f"{case['joint']['kind']} {ends}{', soft' if case['soft'] else ''}"


@pytest.mark.parametrize("case", TRUTH["rings"], ids=name_of)
def test_accelerations_and_reactions_of_a_chain_closed_by_each_joint(case: dict[str, Any]) -> None:
    """Seven hinges about axes by chance. A fixed joint on five hinges is redundant: its reactions are not unique."""
    arm = ring(case)
    q, v, tau = (np.array(case[k]) for k in ("q", "v", "tau"))
    g, rate = arm.loop_motion(q, v)
    if not case["soft"]:
        assert max(np.abs(g).max(), np.abs(rate).max()) < 1e-13
    np.testing.assert_allclose(arm.forward_dynamics(q, v, tau), case["acceleration"], rtol=1e-9, atol=1e-8)
    run = fa.simulate(arm, [0, 1e-6], q, v, tau=tau, integrator="rk4", step=1e-6)
    loop = run.loop("ring")
    if case["joint"]["kind"] != "fixed" or case["a"][0] is None:
        np.testing.assert_allclose(loop.force[0], case["force"], rtol=1e-8, atol=1e-7)
        np.testing.assert_allclose(loop.moment[0], case["moment"], rtol=1e-8, atol=1e-7)


# -- known mechanisms --------------------------------------------------------------------------------------------------


def mechanism(case: dict[str, Any]) -> fa.Arm:
    """Bodies with their centres as frames; zero is the position in which they are given."""
    links = []

    def inward(of: list[list[float]]) -> fa.Placement:
        place = fa.Placement(*of)
        p, R = place._core
        return fa.Placement(tuple(-R.T @ p), R.T)

    for joint in case["tree"]:
        made = KINDS[joint["kind"]](inboard=fa.Placement(*joint["on a"]), outboard=inward(joint["on b"]))
        body = fa.RigidBody(case["mass"][joint["b"]], inertia=case["inertia"][joint["b"]])
        parent = "world" if joint["a"] < 0 else f"body{joint['a']}"
        links.append(fa.Link(made, body, name=f"body{joint['b']}", parent=parent))

    def of(body: int) -> str:
        return "world" if body < 0 else f"body{body}"

    loops = [
        fa.Loop(of(x["a"]), of(x["b"]), KINDS[x["kind"]](inboard=fa.Placement(*x["on a"]), outboard=inward(x["on b"])))
        for x in case["loops"]
    ]
    return fa.Arm(links, case["gravity"], loops=loops)


def bar(length: float, mass: float, name: str, **more: Any) -> fa.Link:
    """A thin one on a hinge about z; `at` is where that is, on the world."""
    at = more.pop("at", None)
    joint = fa.Revolute("z", inboard=fa.Placement(at) if at else None)
    body = fa.RigidBody(mass, (length / 2, 0, 0), (0, 0, mass * length**2 / 12), (length, 0, 0))
    return fa.Link(joint, body, name=name, **more)


def four_bar(**forces: Any) -> fa.Arm:
    """As FOURBAR in bench/run/loops_truth.py; the forces are at the rocker's foot."""
    foot = fa.Revolute("z", inboard=fa.Placement((0.45, 0, 0)), **forces)
    rocker = fa.RigidBody(0.8, (0.2, 0, 0), (0, 0, 0.8 * 0.16 / 12), (0.4, 0, 0))
    links = [bar(0.2, 0.4, "crank"), bar(0.5, 1.0, "coupler"),
             fa.Link(foot, rocker, name="rocker", parent="world")]  # fmt: skip
    return fa.Arm(links, (0, -G, 0), loops=[fa.Loop("coupler", "rocker", fa.Revolute("z"))])


@every_run
def test_four_bars_beside_their_one_coordinate(options: dict[str, Any]) -> None:
    case, arm = TRUTH["four bar"], four_bar()
    y = np.array(case["y"])
    crank, coupler, rocker = y[0, :3]
    q, v = arm.assemble([crank, coupler - crank, rocker], [case["start"][1], 0, 0], hold=[0])
    assert v[0] == case["start"][1]
    run = fa.simulate(arm, case["t"], q, v, **options)
    closed(arm, run)
    found = np.column_stack([run.q[:, 0], run.q[:, :2].sum(1), run.q[:, 2]])
    np.testing.assert_allclose(np.exp(1j * found), np.exp(1j * y[:, :3]), atol=far(options))
    np.testing.assert_allclose(run.v[:, 0], y[:, 3], atol=50 * far(options))


@pytest.mark.parametrize("options", RUNS[:-1], ids=lambda x: x.get("integrator", "default"))
def test_dry_friction_of_a_joint_in_a_loop(options: dict[str, Any]) -> None:
    """The rocker turns back wherever crank and coupler are in one line, and cannot stick there."""
    case, arm = TRUTH["friction"], four_bar(coulomb=TRUTH["friction"]["coulomb"])
    q = arm.assemble([0.5, 0.2, 1.5], hold=[0])
    run = fa.simulate(arm, np.linspace(0, case["end"], 31), q, **options)
    closed(arm, run, 1e-11)
    assert run.q[-1, 0] == pytest.approx(case["crank"], abs={"implicit": 1e-4, "": 1e-5}.get(
        options.get("integrator", ""), 1e-7))  # fmt: skip


@every_run
def test_the_squeezer_of_the_test_set(options: dict[str, Any]) -> None:
    """Andrews' seven bodies and three loops: published angles and rates after 0.03 s, in which the crank turns by 16
    rad (Test set for IVP solvers, problem II-10)."""
    I3 = (0.0, 0.0)

    def body(mass: float, com: tuple[float, float], inertia: float, end: tuple[float, float]) -> fa.RigidBody:
        return fa.RigidBody(mass, (*com, 0), (*I3, inertia), (*end, 0))

    A, B = (-0.06934, -0.00227, 0), (-0.03635, 0.03273, 0)
    links = [
        fa.Link(fa.Revolute("z"), body(0.04325, (0.00092, 0), 2.194e-6, (0.007, 0)), name="K1"),
        fa.Link(fa.Revolute("z"), body(0.00365, (-0.0115, 0), 4.41e-7, (-0.028, 0)), name="K2"),
        fa.Link(fa.Revolute("z", inboard=fa.Placement(B)), body(0.02373, (0.01874, 0.01043), 5.255e-6, (0, -0.035)),
                name="K3", parent="world"),
        fa.Link(fa.Revolute("z", inboard=fa.Placement(A)), body(0.0705, (0.02308, 0.00916), 1.169e-5, (0.04, 0)),
                name="K5", parent="world"),
        fa.Link(fa.Revolute("z"), body(0.00706, (0, -(0.02 - 0.01421)), 5.667e-7, (0, -0.02)), name="K4"),
        fa.Link(fa.Revolute("z", inboard=fa.Placement(A)), body(0.05498, (-0.00449, -0.01228), 1.912e-5, (0, -0.04)),
                name="K7", parent="world"),
        fa.Link(fa.Revolute("z"), body(0.00706, (0.02 - 0.01421, 0), 5.667e-7, (0.02, 0)), name="K6"),
    ]  # fmt: skip
    spring = fa.Strut((0.014, 0.072, 0), fa.Point("K3", "origin", (0.02, -0.018, 0)), stiffness=4530, length=0.07785)
    loops = [fa.Loop("K2", name, fa.Revolute("z")) for name in ("K3", "K4", "K6")]
    arm = fa.Arm(links, struts=[spring], loops=loops)
    beta, theta, gamma, phi, delta, omega, epsilon = (
        -0.0617138900142764, 0.0, 0.455279819163070, 0.222668390165886, 0.487364979543843, -0.222668390165886,
        1.23054744454982)  # fmt: skip
    q = arm.assemble([beta, theta, gamma, delta, phi, epsilon, omega])
    tau = np.zeros(7)
    tau[0] = 0.033
    small = {k: v * 1e-2 for k, v in options.items() if k == "step"}
    run = fa.simulate(arm, np.linspace(0, 0.03, 4), q, tau=tau, **(options | small))
    closed(arm, run)
    order = [0, 1, 2, 4, 3, 6, 5]
    np.testing.assert_allclose(run.q[-1][order], TRUTH["andrews"]["q"], atol=300 * far(options))
    np.testing.assert_allclose(run.v[-1][order], TRUTH["andrews"]["v"], atol=1e5 * far(options))


@pytest.mark.parametrize("options", [x for x in RUNS if x.get("integrator") != "ida" or "rtol" in x], ids=str)
def test_two_windows_go_through_their_singular_positions(options: dict[str, Any]) -> None:
    """The double four-bar of the IFToMM library: in 10 s its bars are in one line ten times, and have two more
    freedoms there; beside an integral of the energy."""
    case = TRUTH["double four bar"]
    links = [bar(1, 1, "crank 0"), bar(1, 1, "coupler 1"), bar(1, 1, "crank 1", parent="world", at=(1, 0, 0)),
             bar(1, 1, "coupler 2"), bar(1, 1, "crank 2", parent="world", at=(2, 0, 0))]  # fmt: skip
    loops = [fa.Loop(f"coupler {k}", f"crank {k}", fa.Revolute("z")) for k in (1, 2)]
    arm = fa.Arm(links, (0, -G, 0), loops=loops)
    up = np.array([1, -1, 1, -1, 1])
    run = fa.simulate(arm, case["t"], np.pi / 2 * up, -1.0 * up, **options)
    closed(arm, run, 1e-11)
    off = 2e-4 if options.get("integrator") == "ida" else far(options)  # Newton's matrix is singular there
    np.testing.assert_allclose(np.pi / 2 - run.q[:, 0], case["angle"], atol=off + 1e-5)


@every_run
def test_bricards_six_hinges(options: dict[str, Any]) -> None:
    """Over-constrained: five hinges move though the sixth holds five rows."""
    case = TRUTH["bricard"]
    arm = mechanism(case)
    assert np.linalg.matrix_rank(arm.loop_jacobian(arm.zero), tol=1e-9) == 4
    run = fa.simulate(arm, case["t"], **options)
    closed(arm, run)
    np.testing.assert_allclose(run.q, np.array(case["angle"])[:, :5], atol=far(options))
    np.testing.assert_allclose(run.v, np.array(case["rate"])[:, :5], atol=30 * far(options))


@every_run
def test_a_robot_of_three_arms(options: dict[str, Any]) -> None:
    """Ten bodies; three torques."""
    case = TRUTH["delta"]
    arm = mechanism(case)
    tau = np.zeros(arm.nv)
    tau[:3] = case["torques"]
    accelerations = arm.forward_dynamics(arm.zero, np.zeros(arm.nv), tau)
    np.testing.assert_allclose(accelerations[:3], case["accelerations"], rtol=1e-9)
    run = fa.simulate(arm, case["t"], tau=tau, **options)
    closed(arm, run)
    np.testing.assert_allclose(run.frame("body9")[0], case["plate"], atol=far(options))
