"""Contacts in runs: scene files, compiled ones, events, results, sensors, batches, derivatives, pictures, other
programs, and what refuses friction by name."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from arms import STEEL
from flexarm.choose.models import Models
from messages import refuses, warns

G, UP = 9.81, np.array([0.0, 1.0, 0.0])
T = np.linspace(0.0, 0.4, 41)
STEP = {"integrator": "gauss", "step": 1e-3}
TOE = fa.Contact("jib", fa.Plane((0, -0.2, 0), (0, 1, 0)), radius=0.03, stiffness=2e4, damping=0.4, name="toe")
STOP = fa.Contact(("boom", 0.6), fa.Sphere((0.6, -0.3, 0), 0.25), stiffness=3e5, exponent=1.5, name="stop")
RUBS = replace(TOE, coulomb=0.4)


def crane(*contacts: fa.Contact) -> fa.Arm:
    beam = fa.Beam(1.0, fa.Rectangle(0.02, 0.03), STEEL, {"bending_y": 2}, "legendre", damping_ratio=0.02)
    jib = fa.RigidBody(2.0, (0.3, 0, 0), (0.01, 0.02, 0.02), (0.6, 0, 0))
    links = [
        fa.Link(fa.Revolute("z", name="hinge", damping=0.5), beam=beam, name="boom"),
        fa.Link(fa.Revolute("z", name="knee", stiffness=20.0, damping=1.0), jib, name="jib"),
    ]
    return fa.Arm(links, (0, -G, 0), contacts=contacts or (TOE, STOP))


def scene(**more: Any) -> fa.Scene:
    return fa.Scene(crane(), t=T, options=dict(STEP), **more)


def mass_on_rails(contact: fa.Contact, mass: float = 2.0, height: float = 0.1, joint: Any = None) -> fa.Arm:
    """A mass that falls along y, `height` above the floor."""
    link = fa.Link(joint or fa.Axes(axes=("tx", "ty")), fa.RigidBody(mass), name="mass")
    return fa.Arm([link], (0, -G, 0), contacts=[replace(contact, point="mass")])


PAD = fa.Contact("mass", fa.Plane((0, -0.1, 0), (0, 1, 0)), stiffness=1e5, name="pad")

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
[[contact]]
name = "toe"
point = "jib"
radius = 0.02
against = { type = "plane", point = [0, -0.1, 0], normal = [0, 1, 0] }
stiffness = 2e4
coulomb = 0.3
[[contact]]
point = { link = "jib", at = "origin", offset = [0, 0.1, 0] }
against = { type = "box", center = ["boom", "end"], size = [0.1, 0.2, 0.3], rotation = [0, 0, 0.2] }
stiffness = 1e5
exponent = 1.5
[[contact]]
name = "ball"
point = "boom"
against = { type = "sphere", center = [1, -0.4, 0], radius = 0.2 }
stiffness = 1e4
damping = 0.1
[[sensor]]
type = "contact_force"
contact = "toe"
[simulation]
duration = 0.2
interval = 0.01
integrator = "implicit"
step = 1e-3
"""


def test_a_scene_file_with_contacts(tmp_path: Path) -> None:
    (tmp_path / "toe.toml").write_text(FILE)
    made = fa.load(tmp_path / "toe.toml")
    assert made.arm.contact_names == ("toe", "contact 1", "ball")
    assert made.arm.contacts[1].against == fa.Box("boom", (0.1, 0.2, 0.3), (0, 0, 0.2))
    assert made.arm.contacts[2].against == fa.Sphere((1, -0.4, 0), 0.2)
    made.save(tmp_path / "again.toml")
    again = fa.load(tmp_path / "again.toml")
    assert again.arm == made.arm
    first, second = made.run(), again.run()
    assert np.array_equal(first.q, second.q) and first.contact("toe").touching.any()
    (reading,) = made.readings(first).values()
    np.testing.assert_allclose(reading.y[:, 0], first.contact("toe").normal, rtol=1e-12)
    for old, new, *named in (
        ('type = "plane"', 'type = "plain"', "contact[0].against.type = 'plain'", "plane"),
        ("normal = [0, 1, 0]", "normel = [0, 1, 0]", "contact[0].against", "normel", "normal"),
        ("exponent = 1.5", "exponent = 3", "contact[1].exponent = 3", "1.5"),
        ('point = "jib"', 'point = "jab"', "contacts[0]: point.link = 'jab'", "jib"),
        ("radius = 0.2 }", "radius = -0.2 }", "contact[2].against.radius = -0.2"),
        ("damping = 0.1", "dumping = 0.1", "contact[2]", "dumping", "damping"),
        ('contact = "toe"', 'contact = "tow"', "sensor[0]", "contact = 'tow'", "toe"),
    ):
        (tmp_path / "bad.toml").write_text(FILE.replace(old, new))
        with refuses(*named):
            fa.load(tmp_path / "bad.toml")


def test_a_compiled_scene_has_the_contacts(tmp_path: Path) -> None:
    (tmp_path / "toe.toml").write_text(FILE)
    fa.load(tmp_path / "toe.toml").compile(tmp_path / "arm.json")
    file = json.loads((tmp_path / "arm.json").read_text())
    toe, box, ball = file["arm"]["contacts"]
    assert [x["kind"] for x in (toe, box, ball)] == ["plane", "box", "sphere"]
    assert (toe["radius"], toe["coulomb"], toe["tangential_stiffness"], box["exponent"]) == (0.02, 0.3, 2e4, 1.5)
    assert ball["size"] == [0.2, 0, 0] and box["size"] == [0.1, 0.2, 0.3] and ball["damping"] == 0.1
    assert [x["at"]["link"] for x in (toe, box, ball)] == [-1, 0, -1] and box["point"]["on"] == "origin"
    axes = np.reshape(box["axes"], (3, 3))
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)


@pytest.mark.parametrize(
    "options",
    [
        {"integrator": "ida", "rtol": 1e-9, "atol": 1e-10}, {"integrator": "implicit", "step": 2e-5},
        {"integrator": "rk4", "step": 2e-5}, {"integrator": "gauss"}, {"integrator": "gauss", "step": 1e-4},
    ],
    ids=str,
)  # fmt: skip
def test_touch_and_release_are_events(options: dict[str, Any]) -> None:
    """Of a mass that falls 0.1 m onto a spring without a damper: half a period of the spring's about its sag, and up
    again."""
    fall, w = np.sqrt(2 * 0.1 / G), np.sqrt(1e5 / 2.0)
    speed, sag = G * fall, G / w**2
    stay = 2 * (np.pi - np.arctan(speed / w / sag)) / w
    events = [fa.Touch("pad"), fa.Release(0)]
    run = fa.simulate(mass_on_rails(PAD), np.linspace(0, 0.45, 46), events=events, **options)
    (touch, again), (release,) = run.t_events
    assert touch == pytest.approx(fall, abs=2e-5) and release - touch == pytest.approx(stay, abs=3e-5)
    assert again - release == pytest.approx(2 * fall, abs=1e-3)
    assert run.v_events[1][0, 1] == pytest.approx(speed, rel=1e-3)
    leaves = fa.Release("pad", terminal=True)
    ended = fa.simulate(mass_on_rails(PAD), np.linspace(0, 0.45, 46), events=leaves, **options)
    assert ended.status == 1 and ended.t_events[0] == pytest.approx([release], abs=1e-9)
    with refuses("Touch", "contact = 'pod'", "pad"):
        fa.simulate(mass_on_rails(PAD), T, events=fa.Touch("pod"))
    with refuses("events[0].terminal = -1"):
        fa.simulate(mass_on_rails(PAD), T, events=fa.Touch(terminal=-1))


def test_events_of_a_batch_are_those_of_each_arm() -> None:
    lower = {"contact.pad.against.point.offset.1": [-0.1, -0.05, -0.2]}
    options = {"integrator": "rk4", "step": 1e-3, "events": [fa.Touch("pad")]}
    batch = fa.simulate_batch(mass_on_rails(PAD), T, parameters=lower, **options)
    for k, height in enumerate((0.1, 0.05, 0.2)):
        assert batch.events[k][0][0][0] == pytest.approx(np.sqrt(2 * height / G), abs=1e-6)
    arms = [batch.arm(k) for k in range(3)]
    rolled = fa.rollout(arms, arms[0].zero, nstep=300, step=1e-3, integrator="rk4", events=fa.Touch("pad"))
    for k in range(3):
        assert rolled.events[k][0][0][0] == pytest.approx(batch.events[k][0][0][0], abs=1e-9)


def test_a_result_tells_its_contacts() -> None:
    """Of a mass that is dragged along the floor: what its motion takes is the contact's force."""
    tau = np.array([6.0, 0.0])  # N, above 0.2 m g
    arm = mass_on_rails(replace(PAD, coulomb=0.2, damping=5.0, against=fa.Plane((0, -0.001, 0), (0, 1, 0))))
    run = fa.simulate(arm, T, tau=tau, **STEP)
    pad = run.contact("pad")
    gap, rate, normal = (x[:, 0] for x in arm.contact_motion(run.q, run.v))
    assert np.array_equal(pad.gap, gap) and np.array_equal(pad.rate, rate) and np.array_equal(pad.normal, normal)
    assert np.array_equal(pad.touching, gap < 0) and pad.touching[-1] and not pad.touching[0]
    needed = np.column_stack([2.0 * run.a - tau + [0, 2.0 * G], np.zeros(len(T))])
    np.testing.assert_allclose(pad.force, needed, atol=1e-6 * np.abs(needed).max())
    np.testing.assert_allclose(pad.friction, np.abs(needed[:, 0]), atol=1e-6 * np.abs(needed).max())
    assert (pad.friction <= 0.2 * normal * (1 + 1e-9) + 1e-9).all()
    assert pad.friction[-1] == pytest.approx(0.2 * 2.0 * G, rel=0.02)
    assert run.contacts.shape == (len(T), 1, 3) and np.array_equal(run.contact(0).force, run.contacts[:, 0])
    smooth = fa.simulate(mass_on_rails(PAD), T, **STEP)
    np.testing.assert_allclose(smooth.contact().force, smooth.contact().normal[:, None] * [0, 1, 0], atol=1e-9)
    with refuses("contact = 'mass'", "pad"):
        run.contact("mass")


def test_a_result_keeps_its_contacts_in_files(tmp_path: Path) -> None:
    arm = crane(RUBS, STOP)
    run = fa.simulate(arm, T, integrator="implicit", step=1e-3)
    for name in ("run.npz", "run.h5"):
        run.save(tmp_path / name)
        back = fa.Result.load(tmp_path / name)
        assert back.arm == arm and np.array_equal(back.contacts, run.contacts)
        assert np.array_equal(back.contact("toe").friction, run.contact("toe").friction)
        assert fa.Data.load(tmp_path / name)["toe normal"] == pytest.approx(run.contact("toe").normal)
    data = run.to_data()
    assert [data.units[f"toe {x}"] for x in ("gap", "rate", "normal", "force z")] == ["m", "m/s", "N", "N"]
    assert np.array_equal(data["toe force x"], run.contacts[:, 0, 0]) and data["toe force x"].any()
    assert np.array_equal(data["stop gap"], run.contact(1).gap)
    assert "Normal force (N)" in [ax.get_ylabel() for ax in run.plot().axes]
    unknown = replace(run, contacts=None)
    assert np.isnan(unknown.contact("toe").force).all() and np.isfinite(unknown.contact("stop").force).all()
    assert "toe normal" in unknown.to_data() and "toe force x" not in unknown.to_data()


def table_and_foot() -> fa.Arm:
    """A foot on rails (its wrist is rigid), which is pressed onto a table on a sensor and dragged along it."""
    foot = fa.RigidBody(0.8, (0.05, 0.02, 0), (0.01, 0.01, 0.01), (0.1, -0.05, 0))
    links = [
        fa.Link(fa.Fixed(), fa.RigidBody(3.0, (0.2, -0.1, 0), end=(0.3, 0.1, 0)), name="table"),
        fa.Link(fa.Axes(axes=("tx", "ty", "tz"), damping=5.0), fa.RigidBody(1.2), parent="world", name="rails"),
        fa.Link(fa.Fixed(), foot, name="foot"),
    ]
    top = fa.Plane(fa.Point("table", offset=(0, -0.16, 0)), (0, 1, 0))
    sole = fa.Contact("foot", top, radius=0.01, stiffness=5e4, damping=0.5, coulomb=0.5, name="sole")
    return fa.Arm(links, (0, -G, 0), contacts=[sole])


def test_a_wrist_sensor_feels_normal_forces_and_friction() -> None:
    """Both sides of the contact, by the momentum of the foot; friction sticks at first, then slides."""
    arm = table_and_foot()
    tau = fa.Torque(T, 80 * T)
    run = fa.simulate(arm, T, drive={("rails", 0): tau, ("rails", 2): tau.scaled(0.5)}, tau=[0, -10.0, 0], **STEP)
    sole = run.contact("sole")
    along = 80 * T[:, None] * [1, 0, 0.5] + [0, -10.0, 0] - 5.0 * run.v
    contact = 2.0 * run.a - along + 2.0 * G * UP  # on the whole foot
    np.testing.assert_allclose(sole.force, contact, atol=1e-6 * np.abs(contact).max())
    assert sole.friction.max() > 5 and np.hypot(run.v[:, 0], run.v[:, 2]).max() > 0.1
    lifted, foot = run.a + G * UP, 0.8
    wrist = fa.sensors.ForceTorque("foot").read(run).y
    np.testing.assert_allclose(wrist[:, :3], foot * lifted - contact, atol=1e-6 * np.abs(contact).max())
    at = arm.contact_places(run.q)[0][:, 0]
    origin = run.frame("foot")[0] - [0.1, -0.05, 0]
    swing = foot * np.cross([0.05, 0.02, 0], lifted) - np.cross(at - origin, contact)
    np.testing.assert_allclose(wrist[:, 3:], swing, atol=1e-6 * np.abs(contact).max())
    under = run.joint_reaction("table")
    np.testing.assert_allclose(under[:, :3], contact + 3.0 * G * UP, atol=1e-6 * np.abs(contact).max())
    turn = 3.0 * np.cross([0.2, -0.1, 0], [0, G, 0]) + np.cross(at, contact)
    np.testing.assert_allclose(under[:, 3:], turn, atol=1e-6 * np.abs(contact).max())
    with refuses("contacts", "sole"):
        fa.sensors.ForceTorque("foot").read(replace(run, contacts=None))


def test_a_sensor_of_contact_force_reads_runs_and_loops() -> None:
    arm = crane(RUBS, STOP)
    run = fa.simulate(arm, T, **STEP)
    sensor = fa.sensors.ContactForce("toe", gain=2.0, rate=100)
    np.testing.assert_allclose(sensor.read(run).y[:, 0], 2.0 * run.contact("toe").normal, rtol=1e-9, atol=1e-9)
    sampler = sensor.sampler(arm)
    loop = [sampler.sample(*row)[0] for row in zip(run.t, run.q, run.v, strict=True)]
    np.testing.assert_allclose(loop, sensor.read(run).y[:, 0], rtol=1e-9, atol=1e-9)
    assert sensor.title(arm) == "contact force, toe" and fa.sensors.ContactForce().title(arm).endswith("stop")
    one, other = (fa.sensors.ContactForce(x, noise=1.0).read(run).y for x in ("stop", -1))
    assert np.array_equal(one, other)
    with refuses("force torque", "toe", "coulomb = 0.4"):
        fa.sensors.ForceTorque("jib").sampler(arm)
    smooth = fa.simulate(crane(), T, **STEP)
    feel = fa.sensors.ForceTorque("jib")
    rows = zip(smooth.t, smooth.q, smooth.v, smooth.a, strict=True)
    sampler = feel.sampler(smooth.arm)
    np.testing.assert_allclose([sampler.sample(*row) for row in rows], feel.read(smooth).y, atol=1e-7)
    with refuses("contact = 'tow'", "toe"):
        fa.sensors.ContactForce("tow").read(run)


def test_a_controller_may_read_a_contact() -> None:
    """Integral action presses it on a pad until that feels 50 N."""
    pad = replace(PAD, damping=2.0, against=fa.Plane((0, 0, 0), (0, 1, 0)))
    arm = mass_on_rails(pad, joint=fa.Prismatic("y", damping=200.0))
    summed = [0.0]

    def press(t: float, felt: np.ndarray) -> float:
        summed[0] += 0.02 * (50.0 - felt[0])
        return -summed[0]

    law = fa.Sampled(press, rate=500, measure=[fa.sensors.ContactForce("pad")])
    run = fa.simulate(arm, np.linspace(0, 1.0, 101), "equilibrium", control=law, **STEP)
    assert run.contact("pad").normal[0] == pytest.approx(2.0 * G, rel=1e-6)
    assert run.contact("pad").normal[-1] == pytest.approx(50.0, rel=0.01)


def test_batches_vary_contacts(tmp_path: Path) -> None:
    values = {"contact.toe.stiffness": [1e4, 2e4, 4e4], "contact.stop.against.center.offset.1": [-0.3, -0.25, -0.28]}
    for options in ({"integrator": "implicit", "step": 1e-3}, {"integrator": "rk4", "step": 2e-4}):
        kept = ("q", "v", "contacts")
        batch = fa.simulate_batch(crane(RUBS, STOP), T, parameters=values, outputs=kept, **options)
        batch.save(tmp_path / "batch.h5")
        back = fa.BatchResult.load(tmp_path / "batch.h5")
        assert np.array_equal(back.contacts, batch.contacts) and back[1].arm == batch[1].arm
        for k, (stiffness, low) in enumerate(zip(*values.values(), strict=True)):
            stop = replace(STOP, against=fa.Sphere((0.6, low, 0), 0.25))
            alone = fa.simulate(crane(replace(RUBS, stiffness=stiffness), stop), T, **options)
            np.testing.assert_allclose(batch.q[k], alone.q, atol=1e-8)
            assert batch[k].arm == alone.arm
            np.testing.assert_allclose(batch[k].contacts, alone.contacts, atol=1e-5 * np.abs(alone.contacts).max())
            np.testing.assert_allclose(batch[k].contact("toe").friction, alone.contact("toe").friction, atol=1e-3)
        assert np.ptp(batch.q[:, -1], axis=0).max() > 1e-4 and batch[0].contact("toe").friction.any()
    with refuses("outputs", "contacts"):
        fa.simulate_batch(fa.Arm(crane().links), T, outputs=kept, **options)


PATHS = ["contact.toe.stiffness", "contact.0.against.point.offset.1", "contact.stop.against.radius",
         "contact.toe.radius"]  # fmt: skip


@pytest.mark.parametrize("integrator", ["gauss", "implicit", "rk4"])
def test_derivatives_by_numbers_of_contacts(integrator: str) -> None:
    """Forward and by the adjoint, against differences of runs in which they touch: also of what moves a place, though
    a contact begins to push there within a step."""
    t, options = np.linspace(0, 0.35, 36), {"integrator": integrator, "step": 5e-4}
    made = fa.simulate(crane(), t, **options)
    assert made.contact("toe").touching.any()
    found, by = made.sensitivities(PATHS), made.gradient({"q": np.ones_like(made.q)}, PATHS)

    def run(path: str, value: float) -> np.ndarray:
        return fa.simulate_batch(crane(), t, parameters={path: [value]}, **options).q[0]

    for k, (path, value) in enumerate(zip(PATHS, (2e4, -0.2, 0.25, 0.03), strict=True)):
        h = 1e-6 * abs(value)
        slope = (run(path, value + h) - run(path, value - h)) / (2 * h)
        np.testing.assert_allclose(found.q[k], slope, atol=1e-6 * np.abs(slope).max())
        assert by[path] == pytest.approx(found.q[k].sum(), rel=1e-5, abs=1e-6 * np.abs(found.q[k]).sum())


@pytest.mark.parametrize(
    "options", [{"integrator": "gauss", "step": 5e-4}, {"integrator": "ida", "rtol": 1e-10, "atol": 1e-13}], ids=str
)
def test_events_move_with_the_surface_itself(options: dict[str, Any]) -> None:
    """Their value depends on what a parameter moves: the times of two touches by the floor's height, beside differences
    of runs."""
    t, events, path = np.linspace(0, 0.35, 36), [fa.Touch("toe")], "contact.toe.against.point.offset.1"
    made = fa.simulate(crane(), t, events=events, **options)

    def times(move: float) -> np.ndarray:
        floor = fa.Plane((0, -0.2 + move, 0), (0, 1, 0))
        return fa.simulate(crane(replace(TOE, against=floor), STOP), t, events=events, **options).t_events[0]

    slope = (times(1e-6) - times(-1e-6)) / 2e-6
    assert len(slope) == 2 and (slope < -0.2).all()
    np.testing.assert_allclose(made.sensitivities([path]).t_events[0][0], slope, rtol=1e-4)
    by = made.gradient({"t_events": [np.array([1.0, 2.0])]}, [path])[path]
    assert by == pytest.approx(slope @ [1.0, 2.0], rel=1e-4)


def test_what_does_not_know_the_past_refuses_friction_by_name() -> None:
    arm, named = crane(RUBS, STOP), ("'toe'", "coulomb = 0.4")
    run = fa.simulate(arm, T, integrator="implicit", step=1e-3)
    q, v, tau = np.zeros((1, 2, arm.nq)), np.zeros((1, 2, arm.nv)), np.zeros((1, 1, arm.nv))
    for what, make in {
        "derivatives": lambda: run.sensitivities(["contact.toe.stiffness"]),
        "KalmanFilter": lambda: fa.KalmanFilter(
            arm, [fa.sensors.Encoder(0)], 1e-3, force_noise=1.0, q_std=0.01, v_std=0.01
        ),
        "MPC": lambda: fa.simulate(arm, T, control=fa.MPC(horizon=0.1, stages=5, blocks=3), **STEP),
        "step_derivatives": lambda: fa.step_derivatives(arm, q[0, 0], v[0, 0], tau[0, 0], step=1e-3),
        "rollout_gradient": lambda: fa.rollout_gradient(arm, q, v, tau, step=1e-3),
        "plan_move": lambda: fa.plan_move(arm, [0, 0], [1, 0], limits={"torque": 100.0}),
        "invert": lambda: fa.invert(arm, {"x": 1.0, "y": fa.Motion([0, 1], [0.5, 0.6], [0, 0], [0, 0])}),
        "economize": lambda: fa.economize(fa.Scene(arm, t=T)),
    }.items():
        with refuses(what, *named):
            make()
    with refuses(*named):
        run.gradient({"q": np.ones_like(run.q)}, ["contact.toe.stiffness"])


def test_a_contact_that_rubs_is_identified_by_differences() -> None:
    made = fa.Scene(crane(RUBS, STOP), t=T, options={"integrator": "implicit", "step": 1e-3})
    guess = replace(made, arm=crane(replace(RUBS, stiffness=0.8 * RUBS.stiffness), STOP))
    data = made.run().to_data()
    fit = fa.identify(guess, data, parameters=["contact.toe.stiffness"], outputs=["q hinge"], noise={"q hinge": 1e-3})
    assert fit.values["contact.toe.stiffness"] == pytest.approx(RUBS.stiffness, rel=0.01)
    assert fit.derivatives[0] == "differences" and "coulomb = 0.4" in fit.derivatives[1]


def test_a_contact_is_identified_from_a_run() -> None:
    made = fa.Scene(crane(), t=T, options={"integrator": "implicit", "step": 1e-3})
    data = made.run().to_data()
    guess = replace(made, arm=crane(replace(TOE, stiffness=1.6e4), STOP))
    fit = fa.identify(guess, data, parameters=["contact.toe.stiffness"], outputs=["q hinge"], noise={"q hinge": 1e-3})
    assert fit.values["contact.toe.stiffness"] == pytest.approx(2e4, rel=1e-3)


def test_a_filter_knows_contacts_without_friction() -> None:
    arm, step = crane(), 1e-3
    filter = fa.KalmanFilter(arm, [fa.sensors.Encoder(0)], step, force_noise=1.0, q_std=0.01, v_std=0.01)
    truth = fa.Simulation(arm, fa.Implicit(step))
    touched = 0.0
    for _ in range(400):
        filter.predict(np.zeros(arm.nv))
        truth.step()
        touched = max(touched, arm.contact_motion(truth.q)[2][0])
    assert touched > 10
    np.testing.assert_allclose(filter.q, truth.q, atol=1e-3)  # its steps begin anew
    assert np.abs(truth.q - fa.simulate(fa.Arm(arm.links, arm.gravity), T, **STEP).q[-1]).max() > 0.1


def test_the_arm_in_pieces_has_the_same_contacts() -> None:
    """Economize cuts a beam where a contact pushes it, and where a surface sits on it."""
    knob = fa.Contact(("jib", "origin"), fa.Sphere(("boom", 0.3), 0.1), stiffness=1e4)
    arm = crane(TOE, STOP, knob)
    models = Models(fa.Scene(arm, t=T))
    assert models.jumps == {0: [0.3, 0.6]}
    cut = models.arm(replace(models.given, pieces=True))
    assert len(cut.links) == 4 and cut.contact_names == arm.contact_names
    gaps = [a.contact_motion(a.pose({"hinge": -0.2, "knee": 0.4}))[0] for a in (arm, cut)]
    np.testing.assert_allclose(gaps[1], gaps[0], rtol=1e-12)


def test_what_a_contact_may_push_is_kept_by_economize() -> None:
    """Of an arm that falls onto a floor: symmetry leaves sideways bending out, unless the floor is tilted."""
    modes = {"bending_y": 2, "bending_z": 2}
    beam = fa.Beam(1.0, fa.Rectangle(0.02, 0.03), STEEL, modes, "legendre", damping_ratio=0.05)
    links = [fa.Link(fa.Revolute("z", name="hinge", damping=2.0), beam=beam, tip=fa.RigidBody(1.0))]
    found = []
    for normal in ((0, 1, 0), (0, 1, 0.2)):
        floor = fa.Contact(0, fa.Plane((0, -0.5, 0), normal), stiffness=5e3, damping=0.5)
        plan = fa.economize(fa.Scene(fa.Arm(links, (0, -G, 0), contacts=[floor]), t=np.linspace(0, 0.6, 61)), 0.02)
        found.append("symmetry" in {c.how for c in plan.choices if c.what == "bending_z"})
    assert found == [True, False]


def test_pictures_show_them(tmp_path: Path) -> None:
    guard = fa.Contact(("jib", "origin"), fa.Box(("boom", 0.5), (0.1, 0.1, 0.2), (0, 0, 0.3)), stiffness=1.0)
    arm = crane(TOE, STOP, guard)
    q = arm.pose({"hinge": 0.3, "knee": -0.5})
    view = arm.show(q, open=False)
    (track,) = view.tracks
    found = [s for s in track.body.solids if s["part"] in ("surface", "toucher")]
    assert [(s["part"], s["kind"]) for s in found] == [
        ("surface", "box"), ("toucher", "ball"), ("surface", "ball"), ("toucher", "ball"), ("surface", "box"),
        ("toucher", "ball"),
    ]  # fmt: skip
    p, R, *_ = track.at(0.0)
    place = [p[s["node"]] + R[s["node"]] @ np.asarray(s["at"]) for s in found]
    assert place[0][1] == pytest.approx(-0.2 - found[0]["size"][2] / 2) and found[1]["size"] == [0.03]
    top = R[0] @ np.asarray(found[0]["axes"])[:, 2]
    np.testing.assert_allclose(top, [0, 1, 0], atol=1e-12)
    gaps = arm.contact_motion(q)[0]
    assert np.linalg.norm(place[3] - place[2]) - 0.25 == pytest.approx(gaps[1], abs=1e-6)
    np.testing.assert_allclose(place[4], arm.frame(q, "boom", 0.5)[0], atol=1e-6)
    np.testing.assert_allclose(place[5], arm.frame(q, "boom")[0], atol=1e-6)
    view.save(tmp_path / "arm.png")
    assert (tmp_path / "arm.png").stat().st_size > 10_000


def test_other_programs_do_not_get_them(tmp_path: Path) -> None:
    for write in (fa.Arm.to_mjcf, fa.Arm.to_urdf):
        with warns(fa.errors.RobotWarning, "contacts", "toe, stop"):
            write(crane(), segments=3)


def test_check_tells_probable_mistakes_of_contacts() -> None:
    wrong = crane(replace(TOE, against=fa.Plane((0, -0.2, 0), (0, -1, 0))), STOP)  # its normal points away
    run = fa.simulate(wrong, T[:3], integrator="implicit", step=1e-4)
    assert any(f.where == "contact[0]" and "begins 0." in f.what for f in run.check())
    soft = fa.simulate(crane(replace(TOE, stiffness=20.0), replace(STOP, stiffness=1.0)), T, **STEP)
    assert "contact[0].stiffness" in [f.where for f in soft.check()]
    quick = fa.simulate(mass_on_rails(replace(PAD, stiffness=1e8)), T, integrator="implicit", step=1e-3)
    (found,) = [f for f in quick.check() if f.where == "contact[0]"]
    assert found.value == pytest.approx(np.sqrt(1e8 / 2.0) * 1e-3) and "rad/s" in found.what
    good = fa.simulate(crane(), T, **STEP).check()
    assert not [f for f in good if "contact" in f.where]
