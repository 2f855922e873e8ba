"""Scenes that start in a pose, or in balance."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import flexarm as fa
import numpy as np
import pytest
from arms import toml
from messages import refuses, warns

BEAM = {
    "length": 1.0,
    "section": {"type": "rectangle", "y": 0.01, "z": 0.01},
    "material": {"density": 2700, "youngs_modulus": 70e9, "poisson_ratio": 0.33},
    "modes": {"bending_y": 2},
}


def loaded(table):
    with TemporaryDirectory() as folder:
        return fa.load(toml(Path(folder), table))


def scene(q0, **more):
    links = [{"joint": {"type": "revolute", "axis": "z", "name": f"joint{k}"}, "beam": BEAM} for k in range(2)]
    simulation = {"duration": 0.5, "interval": 0.01, "q0": q0}
    return loaded({"gravity": [0, -9.81, 0], "link": links, "simulation": simulation} | more)


def test_joints_by_name() -> None:
    made = scene({"joint1": 0.3})
    np.testing.assert_array_equal(made.q0, made.arm.pose({1: 0.3}))


def test_at_equilibrium_it_stays() -> None:
    """One joint moved (held where its motion starts), the other under a torque that gravity answers."""
    drive = [
        {"link": 0, "motion": {"t": [0, 1], "q": [0.4, 0.4]}},
        {"link": "joint1", "torque": {"t": [0, 1], "tau": [0.5, 0.5]}},
    ]
    made = scene("equilibrium", drive=drive)
    run = made.run()
    assert made.start()[0] == 0.4 and abs(made.start()[1]) > 1e-3  # the beam sags
    assert abs(run.q - run.q[0]).max() < 1e-5
    mass, arm_of = 2700 * 1e-4, 0.5  # the second link turns until m g L/2 cos(angle) is the torque
    angle = np.arctan2(*made.arm.frame(made.start(), 1, 0.0)[1][[1, 0], 0])
    assert np.cos(angle) * mass * 9.81 * arm_of == pytest.approx(0.5, rel=1e-2)
    assert loaded(made.arm.to_dict() | {"simulation": {"q0": "equilibrium"}}).start().shape == (made.arm.nq,)


def test_trim_holds_the_joints() -> None:
    made = scene("trim")
    assert made.start()[[0, 3]] == pytest.approx([0, 0], abs=1e-15)
    np.testing.assert_array_equal(made.start(), made.arm.trim().q)


@pytest.mark.parametrize(
    ("q0", "message"),
    [("equilibrum", ("simulation.q0 =", "'equilibrium'")), ({"joint7": 1}, "'joint7'")],
)
def test_wrong_starts(q0, message: str) -> None:
    with refuses(message):
        scene(q0)


def test_a_scene_made_in_python_may_start_in_balance() -> None:
    arm = scene("trim").arm
    made = fa.Scene(arm, t=np.linspace(0, 0.2, 21), q0="trim", control=(fa.PD(1e3, 10, 0), fa.PD(1e3, 10, 1)))
    np.testing.assert_allclose(made.run().q[0], arm.trim().q, atol=1e-12)
    with refuses("q0 = 'trimm'", "'trim'"):
        fa.Scene(arm, q0="trimm")


def test_the_balance_of_each_scenario_is_its_own() -> None:
    """Whatever varies the weight: a scenario begins at rest, and its derivatives know of its start."""
    made = replace(scene("trim"), t=np.linspace(0, 0.02, 21))
    batch = fa.simulate_batch(made.arm, made.t, "trim", parameters={"gravity": np.array([[0, -9.81, 0], [0, -4.0, 0]])})
    light = fa.Arm(made.arm.links, gravity=(0, -4.0, 0))
    np.testing.assert_allclose(batch[1].q[0], light.trim().q, atol=1e-12)
    run = fa.simulate(made.arm, made.t, "trim", integrator="implicit", step=1e-3)
    by = run.sensitivities(["gravity.1"])
    ends = [fa.simulate(fa.Arm(made.arm.links, gravity=(0, g, 0)), made.t, "trim", integrator="implicit", step=1e-3).q
            for g in (-9.82, -9.80)]  # fmt: skip
    np.testing.assert_allclose(by.q[0], (ends[1] - ends[0]) / 0.02, rtol=1e-4, atol=1e-8)


def test_a_fit_starts_in_the_balance_of_its_numbers() -> None:
    """The payload that a fit looks for is also that which the beams sag under at the start."""
    beam = fa.Beam(0.5, fa.Rectangle(0.002, 0.02), fa.Material(2700, 70e9), {"bending_y": 2}, damping_ratio=0.02)
    arms = [fa.Arm([fa.Link(fa.Fixed(), None, beam, fa.RigidBody(m))], gravity=(0, -9.81, 0)) for m in (0.03, 0.02)]
    push = fa.Load(force=[[0, 0, 0], [0, 0.02, 0], [0, 0, 0]], t=[0, 0.1, 0.2])
    options = {"integrator": "implicit", "step": 5e-3}
    made = [fa.Scene(arm, loads=(push,), q0="trim", t=np.linspace(0, 0.2, 41), options=options) for arm in arms]
    measured = made[0].run().to_data()
    name = next(n for n in measured.names if n.startswith("end y"))
    with warns(fa.errors.FitWarning, "step = 0.005", "link.0.tip.mass"):  # its error alone: there is no noise
        found = fa.identify(made[1], measured, ["link.0.tip.mass"], outputs=[name])
    assert found.values["link.0.tip.mass"] == pytest.approx(0.03, rel=1e-5)
    with refuses("'q0.0'", "q0 = 'trim'"):
        fa.identify(made[1], measured, ["link.0.tip.mass", "q0.0"], outputs=[name])
    held = replace(made[1], q0=made[1].start())  # the balance with one payload, for all that are tried
    with (
        pytest.warns(fa.errors.FitWarning),
        warns(fa.errors.StateWarning, 'q0 = "trim"'),
    ):
        fa.identify(held, measured, ["link.0.tip.mass"], outputs=[name])


def test_a_scene_prints_in_a_screenful() -> None:
    made = scene("trim", drive=[{"link": 0, "torque": 0.5}])
    assert "\n" not in repr(made) and len(repr(made)) < 100
    lines = str(made).splitlines()
    assert len(lines) < 25 and max(map(len, lines)) <= 120 and "0 to 0.5 s" in str(made) and "trim" in str(made)
