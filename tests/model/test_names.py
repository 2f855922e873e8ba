"""Names of links and joints: they mean the same as numbers, everywhere."""

from __future__ import annotations

import pickle
from pathlib import Path

import flexarm as fa
import numpy as np
import pytest
from flexarm.cli import main
from messages import refuses

MATERIAL = fa.Material(density=2700.0, youngs_modulus=70e9)


def links(*names: str | None) -> list[fa.Link]:
    beam = fa.Beam(0.5, fa.Rectangle(0.003, 0.03), MATERIAL, modes={"bending_y": 2}, order=1, kelvin_voigt=1e-3)
    upper = fa.Link(fa.Revolute(damping=0.1, name=names[2]), beam=beam, tip=fa.RigidBody(mass=0.2), name=names[0])
    lower = fa.Link(fa.Revolute(), beam=beam, tip=fa.RigidBody(mass=0.1), name=names[1])
    return [upper, lower]


NAMED = fa.Arm(links("upper arm", "torsion_bar", "shoulder"))  # a strain's name in a link's is no strain
PLAIN = fa.Arm(links(None, None, None))
T = np.linspace(0.0, 0.1, 11)


def test_which_link() -> None:
    assert NAMED["shoulder"] is NAMED["upper arm"] is NAMED[0] and NAMED["torsion_bar"] is NAMED[-1]
    assert NAMED.names == ("upper arm", "torsion_bar") and PLAIN.names == ("link 0", "link 1")
    assert list(NAMED) == list(NAMED.links)
    assert NAMED.coordinates[:2] == ("shoulder", "upper arm bending_y 1")
    assert "0 upper arm" in str(NAMED)
    assert NAMED != PLAIN and pickle.loads(pickle.dumps(NAMED)) == NAMED


def test_link_takes_the_name_of_its_joint() -> None:
    arm = fa.Arm(links(None, "bar", "shoulder"))
    assert arm.names == ("shoulder", "bar") and arm.coordinates[0] == "shoulder" and "0 shoulder" in str(arm)


def test_joints_keep_their_names(tmp_path: Path) -> None:
    """Wherever a joint is meant: its name, not that of its link with its type."""
    axes = fa.Axes(axes=("tx", "rz"), name="cart")
    solid, more = fa.RigidBody(1.0, inertia=(1, 1, 1)), fa.RigidBody(2.0, inertia=(1, 1, 1), end=(1, 0, 0))
    bodies = [fa.Link(axes, more), fa.Link(fa.Spherical(name="wrist"), solid, name="hand")]
    arm = fa.Arm([*bodies, *links("upper arm", "forearm", "shoulder")])
    joints = ("cart tx", "cart rz", "wrist wx", "wrist wy", "wrist wz", "shoulder")
    assert arm.coordinates[:6] == joints and arm.coordinates[8:10] == ("forearm revolute", "forearm bending_y 1")
    assert arm.q_names[2:7] == (*(f"wrist quaternion {c}" for c in "wxyz"), "shoulder")
    assert arm.joint_names == ("cart", "wrist", "shoulder", "forearm revolute")
    own = (fa.Arm(links("upper arm", "torsion_bar", "shoulder")).linearize(np.zeros(6)))
    assert own.inputs[0] == "force shoulder" and own.outputs[0] == "joint shoulder"
    run = fa.simulate(NAMED, T, drive={"shoulder": fa.Torque(0.1)}, control=fa.PD(1.0, 0.1, "torsion_bar"))
    assert {"q shoulder", "v shoulder", "tau shoulder", "q upper arm bending_y 1"} <= set(run.to_data())
    assert any("shoulder" in text.get_text() for ax in run.plot().axes for text in ax.get_legend().get_texts())
    assert fa.sensors.Encoder("upper arm").title(NAMED) == "encoder, shoulder"
    assert fa.sensors.ForceTorque("upper arm").title(NAMED).endswith("joint shoulder")
    assert "shoulder: revolute z" in str(NAMED)
    at = {text.get_text() for text in NAMED.modes(lock=[0, 1]).plot().axes[0].texts}
    assert at == {"shoulder", "torsion_bar"}


def test_names_in_what_the_core_says() -> None:
    with refuses("coordinate 'elbow'", "inertia"):
        fa.Arm([fa.Link(fa.Revolute(name="elbow"), name="forearm")])
    with refuses("coordinate 'wrist y'", "inertia"):
        fa.Arm([fa.Link(fa.Universal(name="wrist"), fa.RigidBody(1.0, inertia=(1, 0, 0)), name="hand")])
    solid = fa.RigidBody(1.0, inertia=(1, 1, 1))
    smooth = fa.Arm([fa.Link(fa.Revolute(name="elbow"), solid, name="forearm")])
    with refuses("'elbow'", "moves", error=fa.SimulationError):
        fa.simulate(smooth, [0, 1, 2], drive={"elbow": fa.Torque(1e13)}, integrator="rk4", step=1e-2)
    with refuses("upper arm", "bent", error=fa.SimulationError):
        fa.simulate(NAMED, T, drive={"shoulder": fa.Torque(1e6)}, integrator="rk4", step=1e-5)


def test_messages_name_joints() -> None:
    solid = fa.RigidBody(1.0, inertia=(1, 1, 1))
    arm = fa.Arm([fa.Link(fa.Spherical(name="wrist"), solid, name="hand")])
    for call in (lambda q: arm.frame(q), lambda q: fa.rollout(arm, q, step=1e-2, nstep=2)):
        with refuses("quaternion", "wrist"):
            call(np.zeros(4))
    with refuses("ball of wrist", "together"):
        arm.linearize(arm.zero, lock=[("hand", 0)])
    with refuses("wrist", "a ball"):
        fa.invert(arm, {"x": fa.Motion([0, 1, 2], [0, 0.1, 0.2], ends="rest")})


def test_labels_are_of_one_coordinate() -> None:
    with refuses("'a revolute'", "link 0"):
        fa.Arm([links("a", "b", None)[0], fa.Link(fa.Revolute(name="a revolute"), fa.RigidBody(1.0, (1, 0, 0)))])
    other = fa.Arm([*links("a", "elbow", None), fa.Link(fa.Revolute(name="elbow"), fa.RigidBody(1.0, (1, 0, 0)))])
    assert other.coordinates[-1] == "link 2 revolute"  # a name of two is none


def test_methods() -> None:
    q = np.linspace(0.01, 0.06, 6)
    for a, b in (("upper arm", 0), ("shoulder", 0), ("torsion_bar", 1)):
        np.testing.assert_array_equal(NAMED.frame(q, a, 0.2)[0], PLAIN.frame(q, b, 0.2)[0])
        np.testing.assert_array_equal(NAMED.jacobian(q, a), PLAIN.jacobian(q, b))
        np.testing.assert_array_equal(NAMED.strain(q, a, 0.1), PLAIN.strain(q, b, 0.1))
        np.testing.assert_array_equal(NAMED.joint_reaction(q, q, q, a), PLAIN.joint_reaction(q, q, q, b))
        named, plain = NAMED.modes(lock=[a], speed={"torsion_bar": 0.0}), PLAIN.modes(lock=[b])
        np.testing.assert_array_equal(named.frequencies, plain.frequencies)
        zero = np.zeros(6)
        named_model = NAMED.linearize(zero, inputs=[(a, 0), ("load", a)], outputs=[("tip", a), ("joint", (a, 0))])
        plain_model = PLAIN.linearize(zero, inputs=[b, ("load", b)], outputs=[("tip", b), ("joint", b)])
        np.testing.assert_array_equal(named_model.B, plain_model.B)
        np.testing.assert_array_equal(named_model.C, plain_model.C)
        assert named_model.outputs[0] == f"tip {NAMED.names[b]} x"
    given = NAMED.forward_dynamics(q, q, prescribed={("shoulder", 0): 1.0})
    np.testing.assert_array_equal(given, PLAIN.forward_dynamics(q, q, prescribed={0: 1.0}))


def test_runs_and_sensors() -> None:
    def run(arm: fa.Arm, upper: int | str, lower: int | str) -> fa.Result:
        control = [fa.PD(5.0, 0.5, lower, reference=0.1), fa.StrainFeedback(1.0, 0.1, 0.2, upper)]
        load = fa.Load(lower, force=(0, 1, 0))
        return fa.simulate(arm, T, drive={upper: fa.Torque(0.1)}, loads=[load], control=control)

    named, plain = run(NAMED, "shoulder", "torsion_bar"), run(PLAIN, 0, 1)
    np.testing.assert_array_equal(named.q, plain.q)
    np.testing.assert_array_equal(named.tip_deflection("torsion_bar"), plain.tip_deflection(1))
    for sensor in (fa.sensors.Encoder, fa.sensors.StrainGauge, fa.sensors.Accelerometer, fa.sensors.ForceTorque):
        ours, theirs = sensor(link="upper arm", noise=0.1).read(named), sensor(link=0, noise=0.1).read(plain)
        np.testing.assert_array_equal(ours.y, theirs.y)
        of_joint = sensor in (fa.sensors.Encoder, fa.sensors.ForceTorque)
        assert ("shoulder" if of_joint else "upper arm") in sensor(link="upper arm").title(NAMED)
    with refuses("named", "twice"):
        fa.simulate(NAMED, T, drive={"shoulder": fa.Torque(0.1), 0: fa.Torque(0.1)})


def test_paths() -> None:
    masses = np.array([0.1, 0.4])
    parameters = {"link.torsion_bar.tip.mass": masses, "drive.upper arm.scale": [1.0, 2.0]}
    named = fa.simulate_batch(NAMED, T, drive={"shoulder": fa.Torque(0.1)}, parameters=parameters)
    parameters = {"link.1.tip.mass": masses, "drive.0.scale": [1.0, 2.0]}
    plain = fa.simulate_batch(PLAIN, T, drive={0: fa.Torque(0.1)}, parameters=parameters)
    np.testing.assert_array_equal(named.q, plain.q)
    assert not np.allclose(named.q[0], named.q[1])
    with refuses("'link.0.tip.mass'"):
        fa.simulate_batch(NAMED, T, parameters={"link.upper arm.tip.mass": masses, "link.0.tip.mass": masses})
    with refuses("nothing", "vary"):
        fa.simulate_batch(NAMED, T, parameters={"link.wrist.tip.mass": masses})


def test_scenes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scene = fa.Scene(
        NAMED, drive={"shoulder": fa.Torque(0.1)}, loads=(fa.Load("torsion_bar", force=(0, 1, 0)),), t=T,
        control=(fa.PD(5.0, 0.5, "torsion_bar"),), sensors=(fa.sensors.Encoder("upper arm"),),
    )  # fmt: skip
    scene.save(tmp_path / "scene.toml")
    text = (tmp_path / "scene.toml").read_text()
    assert 'name = "upper arm"' in text and 'link = "shoulder"' in text and 'link = "torsion_bar"' in text
    back = fa.load(tmp_path / "scene.toml")
    assert back.arm == NAMED and back.arm.names == NAMED.names
    np.testing.assert_allclose(back.run().q, scene.run().q, rtol=0, atol=1e-12)
    scene_file = str(tmp_path / "scene.toml")
    assert main(["modes", scene_file, "--lock", "shoulder", "--speed", "torsion_bar=1"]) == 0
    assert "torsion_bar bending_y 1" in capsys.readouterr().out
    assert main(["modes", scene_file, "--lock", "elbow"]) != 0
    assert "--lock elbow: link = 'elbow'" in capsys.readouterr().err


def test_bad_names() -> None:
    for name in ("", " elbow", "a.b", "3", "-1", "link 2", "patch", "load", "a\nb", 4):
        with refuses("name ="):
            fa.Link(fa.Revolute(), name=name)  # type: ignore[arg-type]
        with refuses("name ="):
            fa.Revolute(name=name)  # type: ignore[arg-type]
    with refuses("'a'", "link 0", "link"):
        fa.Arm(links("a", "a", None))
    with refuses("link = 'torsion'", "'torsion_bar'"):
        NAMED.frame(NAMED.zero, "torsion")
    with refuses("link = 'elbow'"):
        PLAIN.frame(PLAIN.zero, "elbow")
    both = fa.Arm(links("b", "a", "a"))
    with refuses("link = 'a'", "link 1", "link 0"):
        both.frame(both.zero, "a")
    assert fa.Arm(links("a", "b", "a")).names == ("a", "b")  # one name for a link and its own joint


def test_the_pieces_of_a_link() -> None:
    pieces = fa.split(NAMED["upper arm"], places=[0.1, 0.3])
    assert [p.name for p in pieces] == ["upper arm", "upper arm 2", "upper arm 3"]
    assert fa.Arm(pieces)["shoulder"] is pieces[0]


def test_a_joint_lends_its_name_to_its_link() -> None:
    arm = fa.Arm(links(None, None, "shoulder"))
    assert arm.names == ("shoulder", "link 1") and arm.coordinates[0] == "shoulder"
    twice = fa.Arm(links(None, "shoulder", "shoulder"))  # a name of two is none
    assert twice.names == ("link 0", "shoulder")
