"""Trees in runs: scene files, compiled ones, tables, figures, sensors, momentum and energy."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import flexarm as fa
import numpy as np
import pytest
from arms import masts, satellite, side_by_side, two_arms
from messages import refuses

T = np.linspace(0.0, 0.5, 26)
DRIVE = {"left shoulder": fa.Torque(0.4), "right elbow": fa.Torque(-0.1)}


def scene(**more: object) -> fa.Scene:
    return fa.Scene(two_arms(), t=T, drive=dict(DRIVE), options={"integrator": "implicit", "step": 2e-3}, **more)


TREE = """
gravity = [0, 0, -9.81]
[[link]]
joint = { type = "revolute", axis = "z", stiffness = 5 }
hub = { mass = 1.0, inertia = [0.1, 0.1, 0.1], end = [0.2, 0, 0] }
name = "torso"
[[link]]
joint = { type = "revolute", axis = "y", stiffness = 5 }
tip = { mass = 0.2, com = [0.3, 0, 0] }
[[link]]
joint = { type = "revolute", axis = "x", stiffness = 5 }
tip = { mass = 0.3, com = [0, 0.2, 0] }
parent = "torso"
[[link]]
joint = { type = "prismatic", axis = "x", stiffness = 50 }
tip = { mass = 0.3 }
parent = 1
[[link]]
joint = { type = "prismatic", axis = "z", stiffness = 50 }
tip = { mass = 0.3 }
parent = "world"
[simulation]
duration = 0.1
interval = 0.05
"""


def test_a_scene_file_of_a_tree(tmp_path: Path) -> None:
    (tmp_path / "tree.toml").write_text(TREE)
    made = fa.load(tmp_path / "tree.toml")
    assert made.arm.parents == (-1, 0, 0, 1, -1) and made.arm.links[3].parent == 1
    made.save(tmp_path / "again.toml")
    again = fa.load(tmp_path / "again.toml")
    assert again.arm == made.arm and again.arm.parents == made.arm.parents
    assert np.array_equal(again.run().q, made.run().q)
    for wrong in ('"fore"', "4", "-1", "true", "1.5"):
        (tmp_path / "bad.toml").write_text(TREE.replace("parent = 1", f"parent = {wrong}"))
        with refuses("parent"):
            fa.load(tmp_path / "bad.toml")


def test_a_scene_file_with_links_on_slices(tmp_path: Path) -> None:
    made = fa.Scene(masts(), t=T[:3], options={"integrator": "implicit", "step": 2e-3})
    made.save(tmp_path / "masts.toml")
    assert "at = 0.5" in (tmp_path / "masts.toml").read_text()
    again = fa.load(tmp_path / "masts.toml")
    assert again.arm == made.arm and again.arm.seats == made.arm.seats
    assert np.array_equal(again.run().q, made.run().q)
    (tmp_path / "masts.toml").write_text((tmp_path / "masts.toml").read_text().replace("at = 0.5", "at = 5.0"))
    with refuses("at = 5", "0.8 m"):
        fa.load(tmp_path / "masts.toml")


def test_a_compiled_scene_has_the_parents(tmp_path: Path) -> None:
    on_slices = fa.Scene(masts(), t=T), [-1, 0, 0, 0, 0, 3], [None, None, 0.5, 0.2, 0.5, 0.1]
    for one, parents, at in ((scene(), [-1, 0, 1, 0, 3], [None] * 5), on_slices):
        one.compile(tmp_path / "arm.json")
        written = json.loads((tmp_path / "arm.json").read_text())["arm"]
        assert (written["parents"], written["at"]) == (parents, at)


def test_tables_and_figures_have_every_end() -> None:
    run = scene().run()
    data = run.to_data()
    for k, name in ((2, "left fore"), (4, "right fore")):
        assert np.array_equal(np.column_stack([data[f"end of {name} {x}"] for x in "xyz"]), run.frame(k)[0])
    assert "end x" not in data and np.array_equal(run.frame()[0], run.frame("right fore")[0])


def test_momentum_and_energy_of_a_free_satellite() -> None:
    arm = satellite()
    rng = np.random.default_rng(1)
    v = 0.2 * rng.normal(size=arm.nv)
    run = fa.simulate(arm, np.linspace(0.0, 0.5, 11), v0=v, integrator="gauss", step=2e-3)
    p, E = arm.momentum(run.q, run.v), sum(run.energy())
    assert np.abs(p - p[0]).max() < 1e-9 * np.abs(p[0]).max() and np.ptp(E) < 1e-9 * E[0]


@pytest.mark.parametrize(
    "options",
    [{}, {"integrator": "ida"}, {"integrator": "implicit", "step": 2e-3}, {"integrator": "rk4", "step": 1e-4}],
)
def test_arms_side_by_side_run_as_alone(options: dict[str, object]) -> None:
    """Controllers, loads, sensors, friction and prescribed motions of one do nothing to the other."""
    one = two_arms()
    arm = fa.Arm([replace(one.links[1], parent=None), one.links[2]])
    arm = fa.Arm([replace(x, joint=replace(x.joint, coulomb=0.02)) for x in arm.links])
    bare = fa.Arm([replace(x, name=None, joint=replace(x.joint, name=None)) for x in arm.links])
    pair = side_by_side(bare, bare)
    t = np.linspace(0.0, 0.3, 7)
    given = {
        "q0": {1: 0.4},
        "drive": {0: fa.Motion(lambda t: (t**3, 3 * t**2, 6 * t))},
        "control": [fa.PD(2.0, 0.1, 1)],
    }
    both = {"q0": {3: 0.4}, "drive": {2: given["drive"][0]}, "control": [fa.PD(2.0, 0.1, 3)]}
    force = {"force": (0, 0.3, 0)}
    alone = fa.simulate(bare, t, loads=[fa.Load(1, **force)], **given, **options)
    found = fa.simulate(pair, t, loads=[fa.Load(3, **force)], **both, **options)
    tolerance = 2e-4 if not options or options["integrator"] == "ida" else 1e-9
    assert np.allclose(found.q[:, bare.nq :], alone.q, atol=tolerance) and not found.q[:, : bare.nq].any()
    sensors = [fa.sensors.Accelerometer, fa.sensors.ForceTorque]
    for kind in sensors:
        ours, theirs = (kind(link=k).read(r).y for k, r in ((3, found), (1, alone)))
        assert np.allclose(ours, theirs, atol=50 * tolerance * max(1.0, float(np.abs(theirs).max())))


@pytest.mark.parametrize("order", [2, 3, "exact"])
def test_links_on_slices_run_alike_in_all_ways(order: int | str) -> None:
    """Against Gauss collocation at a short step: a falling boom with all that it carries."""
    arm, t = masts(order, 1), np.linspace(0.0, 0.1, 6)
    load = fa.Load("boom", force=(0, 3.0, 0), x=0.4)
    given = {"q0": {"slew": 0.3}, "drive": {"jib": fa.Torque(0.5)}, "loads": [load]}
    truth = fa.simulate(arm, t, **given, integrator="gauss", step=5e-4).q
    span = np.abs(truth - truth[0]).max(axis=0)
    ways = [({}, 1e-3), ({"integrator": "ida", "rtol": 1e-8}, 1e-4), ({"integrator": "implicit", "step": 2e-4}, 2e-3)]
    for options, tolerance in (*ways, ({"integrator": "rk4", "step": 5e-6}, 1e-5)):
        found = fa.simulate(arm, t, **given, **options).q
        assert (np.abs(found - truth).max(axis=0) < tolerance * np.maximum(span, 0.05 * span.max())).all(), options


def test_sensitivities_by_the_place_on_a_beam() -> None:
    """Of a hoist, by where it sits: central differences of runs."""

    def run(at: float) -> fa.Result:
        arm = masts(n=1)
        links = [replace(x, at=at) if x.name == "hoist" else x for x in arm.links]
        return fa.simulate(fa.Arm(links, arm.gravity), np.linspace(0.0, 0.1, 6), integrator="implicit", step=2e-3)

    found = run(0.45).sensitivities(["link.hoist.at"])
    h = 1e-4
    numeric = (run(0.45 + h).q - run(0.45 - h).q) / (2 * h)
    assert np.allclose(found.q[0], numeric, atol=1e-5 * np.abs(numeric).max())


def test_sensitivities_of_a_branch() -> None:
    """By the mass of the left hand: central differences of runs."""

    def run(mass: float) -> fa.Result:
        s = scene()
        links = [replace(x, hub=replace(x.hub, mass=mass)) if x.name == "left fore" else x for x in s.arm.links]
        return replace(s, arm=fa.Arm(links)).run()

    found = scene().run().sensitivities(["link.left fore.hub.mass"])
    h = 1e-4
    numeric = (run(0.4 + h).q - run(0.4 - h).q) / (2 * h)
    assert np.allclose(found.q[0], numeric, atol=1e-6 * np.abs(numeric).max())
