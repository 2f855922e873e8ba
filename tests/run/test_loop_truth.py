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
