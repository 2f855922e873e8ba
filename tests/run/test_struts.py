"""Struts and tendons in runs: drives, scene files, compiled ones, results, derivatives, pictures, other programs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import flexarm as fa
import numpy as np
import pytest
from arms import STEEL
from flexarm.choose.models import Models
from messages import refuses, warns

T = np.linspace(0.0, 0.4, 21)
LIFT = fa.Strut((0.3, -0.4, 0), ("boom", 0.6), stiffness=4e3, damping=50.0, name="lift")
ROPE = fa.Tendon(
    [(0, 0.5, 0), "boom", fa.Point("jib", offset=(0, 0.05, 0))], stiffness=2e3, damping=20.0, tension=15.0, name="rope"
)
PUSH = {"lift": fa.Torque(T, 80 * np.sin(9 * T)), "rope": fa.Torque(10.0)}


def crane(*struts: fa.Strut | fa.Tendon) -> fa.Arm:
    beam = fa.Beam(1.0, fa.Rectangle(0.02, 0.03), STEEL, {"bending_y": 2}, "legendre")
    jib = fa.RigidBody(2.0, (0.3, 0, 0), (0.01, 0.02, 0.02), (0.6, 0, 0))
    links = [
        fa.Link(fa.Revolute("z", name="hinge", damping=0.5), beam=beam, name="boom"),
        fa.Link(fa.Revolute("z", name="knee", stiffness=20.0, damping=1.0), jib, name="jib"),
    ]
    return fa.Arm(links, (0, -9.81, 0), struts or (LIFT, ROPE))


def scene(**more: object) -> fa.Scene:
    return fa.Scene(crane(), dict(PUSH), t=T, options={"integrator": "gauss", "step": 2e-3}, **more)


FILE = """
gravity = [0, -9.81, 0]
[[link]]
name = "boom"
joint = { type = "revolute", axis = "z" }
hub = { mass = 3.0, com = [0.5, 0, 0], inertia = [0.1, 0.3, 0.3], end = [1, 0, 0] }
[[link]]
name = "jib"
joint = { type = "revolute", axis = "z" }
hub = { mass = 1.0, com = [0.2, 0, 0], inertia = [0.01, 0.02, 0.02], end = [0.5, 0, 0] }
[[tendon]]
name = "rope"
points = [[0, 0.5, 0], "boom", { link = "jib", offset = [0, 0.05, 0] }]
stiffness = 2e3
[[strut]]
name = "lift"
a = [0.3, -0.4, 0]
b = { link = "boom", at = "end", offset = [-0.3, 0, 0] }
stiffness = 4e3
damping = 50
[[drive]]
strut = "lift"
torque = { t = [0, 0.1, 0.2], tau = [0, 50, 0] }
[[drive]]
strut = "rope"
torque = 12
[simulation]
duration = 0.2
interval = 0.05
"""


def test_a_scene_file_with_struts(tmp_path: Path) -> None:
    (tmp_path / "crane.toml").write_text(FILE)
    made = fa.load(tmp_path / "crane.toml")
    assert made.arm.strut_names == ("lift", "rope") and list(made.drive) == ["lift", "rope"]
    assert made.arm.struts[1].points == (fa.Point("world", offset=(0, 0.5, 0)), fa.Point("boom"), ROPE.points[2])
    made.save(tmp_path / "again.toml")
    again = fa.load(tmp_path / "again.toml")
    assert again.arm == made.arm
    first, second = made.run(), again.run()
    assert np.array_equal(first.q, second.q) and first.driven[:, 1].tolist() == [12.0] * 5
    assert first.driven[:, 0] == pytest.approx([0, 25, 50, 25, 0], abs=1e-12)
    for old, new, *named in (
        ('strut = "lift"', 'strut = "lft"', "drive[0].strut = 'lft'", "lift", "rope"),
        ('b = { link', 'b = { limb', "strut[0].b", "limb", "link"),
        ('"boom", {', '"bom", {', "link = 'bom'"),
        ("damping = 50", "dumping = 50", "strut[0]", "dumping", "damping"),
    ):
        (tmp_path / "bad.toml").write_text(FILE.replace(old, new))
        with refuses(*named):
            fa.load(tmp_path / "bad.toml")


def test_a_compiled_scene_has_the_struts(tmp_path: Path) -> None:
    scene().compile(tmp_path / "arm.json")
    file = json.loads((tmp_path / "arm.json").read_text())
    lift, rope = file["arm"]["struts"]
    assert [p["link"] for p in rope["points"]] == [-1, 0, 1] and [p["on"] for p in lift["points"]] == ["end", "slice"]
    assert (lift["length"], rope["tension_only"], rope["force"]) == (pytest.approx(0.5), True, -15.0)
    assert [x["strut"] for x in file["loads"]] == [0, 1]
    assert file["loads"][1]["wrench"][0]["coefficients"] == [[-10.0]]


@pytest.mark.parametrize(
    "options",
    [
        {"integrator": "ida", "rtol": 1e-8, "atol": 1e-9}, {"integrator": "implicit", "step": 2e-4},
        {"integrator": "rk4", "step": 2e-4}, {"integrator": "gauss"},
    ],
    ids=lambda x: x["integrator"],
)  # fmt: skip
def test_all_integrators_drive_a_strut(options: dict[str, object]) -> None:
    arm, best = crane(), scene().run()
    found = fa.simulate(arm, T, drive=PUSH, **options)
    np.testing.assert_allclose(found.q, best.q, atol=2e-4 * np.abs(best.q).max())


@pytest.mark.parametrize("callables", [False, True])
def test_a_driven_force_adds_to_that_of_the_strut(callables: bool) -> None:
    """Constant drives against the same forces as the parts' own; and the force in the result."""
    own = crane(replace(LIFT, force=60.0), replace(ROPE, tension=40.0))
    drive = {"lift": 60.0, "rope": 25.0}
    laws = {k: fa.Torque((lambda t, f=f: f) if callables else f) for k, f in drive.items()}
    options = {"integrator": "implicit", "step": 1e-3}
    driven, plain = fa.simulate(crane(), T, drive=laws, **options), fa.simulate(own, T, **options)
    np.testing.assert_allclose(driven.q, plain.q, atol=1e-12)
    for name in drive:
        ours, theirs = driven.strut(name), plain.strut(name)
        np.testing.assert_allclose(ours.force, theirs.force, atol=1e-7)
        assert np.array_equal(ours.tension, -ours.force)
    for k, name in enumerate(own.strut_names):
        length, rate, force = (x[:, k] for x in own.strut_motion(plain.q, plain.v))
        found = plain.strut(name)
        np.testing.assert_allclose((found.length, found.rate, found.force), (length, rate, force), atol=1e-9)
    assert plain.driven is None and driven.driven.shape == (len(T), 2)
    joint = driven.joint_reaction("boom", "inboard")
    np.testing.assert_allclose(joint, plain.joint_reaction("boom", "inboard"), atol=1e-6 * np.abs(joint).max())
    sensor = fa.sensors.ForceTorque("jib")
    np.testing.assert_allclose(sensor.read(driven).y, sensor.read(plain).y, atol=1e-6)


def test_a_strut_is_held_in_balance_by_its_drive() -> None:
    """The moment about the hinge of a rigid boom: force times its lever, against its weight."""
    boom = fa.Link(fa.Revolute("z"), fa.RigidBody(10.0, (0.8, 0, 0), (0.1, 1, 1), (1.5, 0, 0)), name="boom")
    ram = fa.Strut((0.2, -0.6, 0), fa.Point("boom", "origin", (0.9, 0, 0)), damping=100.0, name="ram")
    arm = fa.Arm([boom], (0, -9.81, 0), [ram])
    lever = 0.9 * 0.6 / np.hypot(0.7, 0.6)
    force = 10.0 * 9.81 * 0.8 / lever
    run = fa.simulate(arm, T, drive={"ram": fa.Torque(force)}, integrator="gauss", step=5e-3)
    assert np.abs(run.q).max() < 1e-9 and run.strut("ram").force == pytest.approx(force)
    at_rest = fa.simulate(arm, T, "equilibrium", drive={"ram": fa.Torque(1.1 * force)}, integrator="gauss", step=5e-3)
    assert abs(at_rest.q[0, 0]) > 0.01 and np.ptp(at_rest.q) < 1e-8


def test_what_cannot_drive_a_strut_is_refused_by_name() -> None:
    arm = crane()
    with refuses("drive of 'lift'", "Motion", "Torque"):
        fa.simulate(arm, T, drive={"lift": fa.Motion.spin_up(1.0, 0.1)})
    with refuses("drive of 'lift'", "0.2"):
        fa.simulate(arm, T, drive={"lift": fa.Torque([0, 0.2], [0, 1])})
    with refuses("'left'", "no link and no joint"):
        fa.simulate(arm, T, drive={"left": fa.Torque(1.0)})
    with refuses("'lift'", "strut"):
        fa.simulate(arm, T, control=fa.PD(1.0, 1.0, "lift"))
    with refuses("strut = 'knee'", "lift"):
        scene().run().strut("knee")
    with refuses("'lft'", "lift"):
        arm.linearize(arm.zero, inputs=[("strut", "lft")])


def test_a_simulation_step_by_step_takes_forces_of_struts() -> None:
    one = fa.Simulation(crane(), fa.Implicit(1e-3), drive={"lift": fa.Torque(0.0), "rope": fa.Torque(0.0)})
    one.set_drive("lift", 60.0)
    one.set_drive("rope", 25.0)
    one.step(0.4)
    own = crane(replace(LIFT, force=60.0), replace(ROPE, tension=40.0))
    np.testing.assert_allclose(one.q, fa.simulate(own, T, integrator="implicit", step=1e-3).q[-1], atol=1e-10)
    with refuses("key = 'rope'", "drive"):
        fa.Simulation(crane(), fa.Implicit(1e-3)).set_drive("rope", 1.0)


@pytest.mark.parametrize("scales", [[1.0, 0.5, 2.0], None], ids=["scaled", "as it is"])
def test_batches_vary_and_drive_struts(scales: list[float] | None) -> None:
    values = {"strut.lift.stiffness": [3e3, 4e3, 5e3]} | ({"drive.lift.scale": scales} if scales else {})
    batch = fa.simulate_batch(crane(), T, parameters=values, drive=PUSH, integrator="implicit", step=1e-3)
    for k, (stiffness, scale) in enumerate(zip(values["strut.lift.stiffness"], scales or [1.0] * 3, strict=True)):
        arm = crane(replace(LIFT, stiffness=stiffness), ROPE)
        drive = {**PUSH, "lift": PUSH["lift"].scaled(scale)}
        alone = fa.simulate(arm, T, drive=drive, integrator="implicit", step=1e-3)
        np.testing.assert_allclose(batch.q[k], alone.q, atol=1e-10)
        assert np.array_equal(batch[k].driven, alone.driven) and batch[k].arm == arm


def test_a_result_keeps_its_struts_in_files(tmp_path: Path) -> None:
    run = scene().run()
    run.save(tmp_path / "run.npz")
    back = fa.Result.load(tmp_path / "run.npz")
    assert back.arm == run.arm and np.array_equal(back.driven, run.driven)
    assert np.array_equal(back.strut("rope").force, run.strut("rope").force)
    data = run.to_data()
    assert [data.units[f"lift {x}"] for x in ("length", "rate", "force")] == ["m", "m/s", "N"]
    assert np.array_equal(data["rope force"], run.strut(1).force)
    assert np.array_equal(data["lift rate"], run.strut(0).rate)
    assert fa.Data.load(tmp_path / "run.npz")["lift length"] == pytest.approx(run.strut("lift").length)
    assert "Strut force (N)" in [ax.get_ylabel() for ax in run.plot().axes]


PATHS = ["strut.lift.stiffness", "strut.0.a.offset.1", "strut.rope.tension", "drive.lift.scale"]


def test_derivatives_by_numbers_of_struts() -> None:
    """Forward and by the adjoint, against differences of runs; a length that is left out moves with the points."""
    made = scene().run()
    found, by = made.sensitivities(PATHS), made.gradient({"q": np.ones_like(made.q)}, PATHS)

    def run(path: str, value: float) -> np.ndarray:
        return fa.simulate_batch(crane(), T, parameters={path: [value]}, drive=PUSH, **scene().options).q[0]

    for k, (path, value) in enumerate(zip(PATHS, (4e3, -0.4, 15.0, 1.0), strict=True)):
        h = 1e-4 * abs(value)
        slope = (run(path, value + h) - run(path, value - h)) / (2 * h)
        np.testing.assert_allclose(found.q[k], slope, atol=1e-5 * np.abs(slope).max())
        assert by[path] == pytest.approx(found.q[k].sum(), rel=1e-6, abs=1e-7 * np.abs(found.q[k]).sum())
    with refuses("drive.lift.samples", "strut"):
        made.gradient({"q": np.ones_like(made.q)}, ["drive.lift.samples"])


def test_derivatives_by_a_number_at_its_bound() -> None:
    """Its neighbours lie on one side, and the run itself is one of them, in another pack than theirs."""
    path = "link.1.joint.damping"
    bare = crane()
    free = replace(bare.links[1], joint=fa.Revolute("z", name="knee"))
    arm = fa.Arm([bare.links[0], free], bare.gravity, bare.struts)
    pull = fa.Load(0, 0.5, force=lambda t, pose, velocity: [0.0, -3.0 * velocity[1], 0.0])
    options = {"drive": PUSH, "loads": [pull], "integrator": "gauss", "step": 2e-3}
    found = fa.simulate(arm, T, **options).sensitivities([path])

    def run(value: float) -> np.ndarray:
        return fa.simulate_batch(arm, T, parameters={path: [value]}, **options).q[0]

    h = 1e-4
    slope = (4 * run(h) - 3 * run(0.0) - run(2 * h)) / (2 * h)
    np.testing.assert_allclose(found.q[0], slope, atol=1e-4 * np.abs(slope).max())


def test_the_payload_of_a_filter_moves_with_the_struts() -> None:
    arm, step = crane(), 1e-3
    known = {"force_noise": 1.0, "q_std": 0.01, "v_std": 0.01, "estimate": {"payload": (2.0, 0.1)}}
    filter = fa.KalmanFilter(arm, [fa.sensors.Encoder(0)], step, **known)
    carried = fa.Link(fa.Fixed(), fa.RigidBody(2.0))
    truth = fa.Simulation(fa.Arm([*arm.links, carried], arm.gravity, arm.struts), fa.Implicit(step / 20))
    for _ in range(20):
        filter.predict(np.zeros(arm.nv))
        for _ in range(20):
            truth.step()
    np.testing.assert_allclose(filter.q, truth.q, atol=1e-5)


def test_a_spring_is_identified_from_a_run() -> None:
    made = scene()
    data = made.run().to_data()
    guess = replace(made, arm=crane(replace(LIFT, stiffness=2.5e3), ROPE))
    fit = fa.identify(guess, data, parameters=["strut.lift.stiffness"], outputs=["q hinge"], noise={"q hinge": 1e-4})
    assert fit.values["strut.lift.stiffness"] == pytest.approx(4e3, rel=1e-3)


def test_a_linear_model_has_forces_of_struts_as_inputs() -> None:
    """Its input matrix against differences of the dynamics with other constant forces."""
    q = crane().equilibrium()

    def a(lift: float, rope: float) -> np.ndarray:
        arm = crane(replace(LIFT, force=lift), replace(ROPE, tension=15.0 + rope))
        return arm.forward_dynamics(q, np.zeros(arm.nv))

    model = crane().linearize(q, inputs=[("strut", "lift"), ("strut", 1)])
    slopes = np.column_stack([a(1, 0) - a(-1, 0), a(0, 1) - a(0, -1)]) / 2
    np.testing.assert_allclose(model.B[4:], slopes, atol=1e-6 * np.abs(slopes).max())


def test_the_arm_in_pieces_has_the_same_struts() -> None:
    """Economize cuts a beam where a strut pushes it."""
    arm = crane(LIFT, fa.Strut(("boom", "origin"), "jib", stiffness=10.0), fa.Strut(("boom", 0.9), (0, 1, 0)), ROPE)
    models = Models(fa.Scene(arm, t=T))
    assert models.jumps == {0: [0.6, 0.9]}
    cut = models.arm(replace(models.given, pieces=True))
    assert len(cut.links) == 4
    lengths = [a.strut_motion(a.pose({"knee": 0.4}))[0] for a in (arm, cut)]
    np.testing.assert_allclose(lengths[1], lengths[0], rtol=1e-12)
    assert cut.rest_lengths == pytest.approx(arm.rest_lengths) and cut.strut_names == arm.strut_names


def test_pictures_show_them() -> None:
    arm = crane()
    q = arm.pose({"hinge": 0.3, "knee": -0.5})
    (track,) = arm.show(q, open=False).tracks
    bars = [b for b in track.body.bars if b["part"] != "rod"]
    assert [b["part"] for b in bars] == ["strut", "tendon", "tendon"]
    p, R, *_ = track.at(0.0)
    ends = np.array([[p[node] + R[node] @ np.asarray(at) for node, at in bar["ends"]] for bar in bars])
    pieces = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    np.testing.assert_allclose([pieces[0], pieces[1:].sum()], arm.strut_motion(q)[0], rtol=1e-4)


def test_mujoco_has_them_as_tendons(tmp_path: Path) -> None:
    """Of a rigid arm: lengths, and accelerations with driven forces, against MuJoCo's."""
    mujoco = pytest.importorskip("mujoco")
    boom = fa.RigidBody(3.0, (0.5, 0, 0), (0.1, 0.3, 0.3), (1, 0, 0))
    links = [fa.Link(fa.Revolute("z", name="hinge"), boom, name="boom"), crane().links[1]]
    lift = replace(LIFT, b=fa.Point("boom", "end", (-0.4, 0, 0)), force=20.0)
    arm = fa.Arm(links, (0, -9.81, 0), [lift, replace(ROPE, damping=0.0)])
    model = mujoco.MjModel.from_xml_string(arm.to_mjcf())
    data = mujoco.MjData(model)
    for q in ([0.2, 0.1], [-0.3, -0.4]):
        data.qpos[:], data.qvel[:] = q, (0.3, -0.2)
        data.ctrl[[model.actuator("lift").id, model.actuator("rope").id]] = 30.0, 7.0
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.ten_length, arm.strut_motion(q)[0], rtol=1e-9)
        driven = fa.Arm(links, arm.gravity, [replace(lift, force=50.0, length=arm.rest_lengths[0]),
                                             replace(arm.struts[1], tension=22.0)])  # fmt: skip
        np.testing.assert_allclose(data.qacc, driven.forward_dynamics(q, (0.3, -0.2)), rtol=1e-6)
    with pytest.warns(fa.errors.RobotWarning) as told:
        arm.to_urdf()
    assert "struts and tendons: lift, rope" in str(told[0].message)


def test_sites_on_the_segments_of_a_beam(tmp_path: Path) -> None:
    """The straight arm's lengths in MuJoCo; a rope's damping does not end there."""
    mujoco = pytest.importorskip("mujoco")
    arm = crane()
    with warns(fa.errors.RobotWarning, "slack", "rope"):
        model = mujoco.MjModel.from_xml_string(arm.to_mjcf(segments=7))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.ten_length, arm.rest_lengths, rtol=1e-9)
