"""Fixed steps: order, stability, energy, drives, failures."""

import os
import signal
import threading

import flexarm as fa
import numpy as np
import pytest
from arms import SCENES, paper_link, reference
from messages import refuses

STEEL = fa.Material(7850, 209e9, 0.3)


def spatial_arm(shear: int = 0, damping: float = 0.02) -> fa.Arm:
    """Two flexible links in space, the first on a universal joint."""

    def beam() -> fa.Beam:
        modes = {"bending_y": 1, "bending_z": 1, "torsion": 0, "shear_y": shear, "shear_z": 0}
        return fa.Beam(0.5, fa.Rectangle(0.004, 0.01), STEEL, modes, "legendre", 2, damping_ratio=damping)

    body = fa.RigidBody(0.3, inertia=(1e-3, 1e-3, 1e-3), end=(0.075, 0, 0))
    links = [fa.Link(fa.Universal(damping=0.01), body, beam(), fa.RigidBody(0.2))]
    links.append(fa.Link(fa.Revolute("y", stiffness=0.5), body, beam(), fa.RigidBody(0.1)))
    return fa.Arm(links, (0, 0, -9.81))


def floating_arm() -> fa.Arm:
    """A free rigid body that carries a beam on a ball."""
    body = fa.RigidBody(0.5, (0.01, 0.02, 0), (1e-3, 2e-3, 2.5e-3), (0.1, 0, 0))
    beam = fa.Beam(0.4, fa.Rectangle(0.003, 0.006), STEEL, {"bending_y": 1, "bending_z": 1}, "legendre", 2)
    return fa.Arm([fa.Link(fa.Free(), body), fa.Link(fa.Spherical(damping=0.01), body, beam)], (0, 0, -9.81))


def slider(stiffness: float, **force: float) -> fa.Arm:
    return fa.Arm([fa.Link(fa.Prismatic("x", stiffness=stiffness, **force), fa.RigidBody(1.0))])


def paper_case() -> tuple[fa.Arm, dict, dict]:
    return paper_link(), {"drive": {0: fa.Motion.spin_up(7.6, 0.5)}}, {}


def spatial_case() -> tuple[fa.Arm, dict, dict]:
    arm = spatial_arm()
    drive = {(0, 0): fa.Torque(lambda t: 0.3 * np.sin(9 * t)), 1: fa.Torque(lambda t: -0.2 * t)}
    load = fa.Load(link=1, force=(0.3, -0.2, 0.1))
    return arm, {"drive": drive, "loads": [load]}, {"v0": 0.5 * np.cos(np.arange(arm.nv)) * (np.arange(arm.nv) < 2)}


def floating_case() -> tuple[fa.Arm, dict, dict]:
    arm = floating_arm()
    v0 = np.zeros(arm.nv)
    v0[:9] = (0.1, -0.2, 0.3, 2.0, -3.0, 1.0, 1.0, 2.0, -1.5)
    return arm, {}, {"v0": v0}


CASES = {
    "paper": (paper_case, 1.0, 2.5e-3),
    "spatial": (spatial_case, 0.2, 1e-3),
    "floating": (floating_case, 0.2, 1e-3),
}


@pytest.mark.parametrize(("integrator", "order"), [("implicit", 2), ("implicit 0.5", 2), ("rk4", 4)])
@pytest.mark.parametrize("case", CASES)
def test_order_of_convergence(case: str, integrator: str, order: int) -> None:
    make, end, step = CASES[case]
    arm, laws, start = make()
    name, *radius = integrator.split()
    options = {"spectral_radius": float(radius[0])} if radius else {}
    t = np.array([0.0, 0.5 * end, end])
    truth = fa.simulate(arm, t, **start, **laws, rtol=1e-12, atol=1e-14)
    scale = np.abs(truth.v).max()
    errors = []
    for h in (step, step / 2, step / 4):
        r = fa.simulate(arm, t, **start, **laws, integrator=name, step=h, **options)
        errors.append(max(np.abs(r.q - truth.q).max(), np.abs(r.v - truth.v).max() / scale))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert rates[-1] == pytest.approx(order, abs=0.25), (errors, rates)


@pytest.mark.parametrize("order", [1, 2, "exact"])
def test_spin_up_of_the_independent_reference(order: int) -> None:
    case = reference(f"spinup_order_{order}")
    arm = fa.Arm.from_dict(case["scene"])
    drive = {0: fa.Motion.spin_up(7.6, 0.5)}
    for options, limit in (
        ({"integrator": "implicit", "step": 5e-4}, 2e-5),
        ({"integrator": "implicit", "step": 5e-4, "spectral_radius": 0.8}, 2e-5),
        ({"integrator": "rk4", "step": 1e-3}, 2e-8),
    ):
        r = fa.simulate(arm, case["t"], drive=drive, **options)
        assert np.abs(r.tip_deflection()[:, 1] - case["tip_deflection_y"]).max() < limit
        assert r.stats["steps"] >= case["t"][-1] / options["step"] - 1


def test_motions_are_met_and_their_reactions_follow() -> None:
    arm, t = paper_link(), np.linspace(0, 1, 101)
    law = fa.Motion.spin_up(7.6, 0.5)
    ida = fa.simulate(arm, t, drive={0: law}, rtol=1e-9, atol=1e-11)
    r = fa.simulate(arm, t, drive={0: law}, integrator="implicit", step=2.5e-4)
    np.testing.assert_array_equal(r.q[:, 0], [law(x)[0] for x in t])
    np.testing.assert_array_equal(r.v[:, 0], [law(x)[1] for x in t])
    assert np.abs(r.tau[:, 0] - ida.tau[:, 0]).max() < 1e-4 * np.abs(ida.tau).max()
    everything = fa.Arm([fa.Link(fa.Prismatic("x"), fa.RigidBody(2.0))])
    for integrator in ("implicit", "rk4"):
        all_given = fa.simulate(
            everything, t, drive={0: fa.Motion(lambda x: (x**2, 2 * x, 2.0))}, integrator=integrator, step=0.1
        )
        np.testing.assert_allclose(all_given.tau, 4.0)


def test_samples_are_met_exactly() -> None:
    """A pulse far shorter than the step gives its full impulse."""
    arm = slider(0.0)
    pulse = fa.Torque([0, 0.5, 0.5001, 0.5003, 0.5004, 1], [0, 0, 50, 50, 0, 0])
    for integrator, radius, rel in (("implicit", 1.0, 1e-9), ("implicit", 0.9, 0.03), ("rk4", None, 1e-9)):
        r = fa.simulate(arm, [0, 1], drive={0: pulse}, integrator=integrator, step=0.1, spectral_radius=radius)
        assert r.v[-1, 0] == pytest.approx(50 * 3e-4, rel=rel)
        assert r.stats["steps"] == 5 + 3 + 5


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9, 1.0])
def test_order_two_with_steps_that_change(rho: float) -> None:
    """Outputs at uneven times change the step all the time."""
    t = np.cumsum(np.concatenate([[0.0], np.tile([0.01, 0.013, 0.008, 0.02], 25)]))
    w, errors = 5.0, []
    for h in (0.01, 0.005, 0.0025, 0.00125):
        r = fa.simulate(slider(w * w), t, [1.0], integrator="implicit", step=h, spectral_radius=rho)
        errors.append(np.abs(r.q[:, 0] - np.cos(w * t)).max())
    assert np.log2(errors[1] / errors[3]) / 2 == pytest.approx(2, abs=0.25), errors


def amplification(rho: float, x: float) -> np.ndarray:
    """Chung & Hulbert's method on q'' = -w^2 q with h = 1, x = h w, as a map of (q, v, a); eq. 11-15 of their paper."""
    am, af = (2 * rho - 1) / (rho + 1), rho / (rho + 1)
    gamma = 0.5 - am + af
    beta = 0.25 * (1 - am + af) ** 2
    left = np.array([[1, 0, -beta], [0, 1, -gamma], [(1 - af) * x * x, 0, 1 - am]])
    right = np.array([[1, 1, 0.5 - beta], [0, 1, 1 - gamma], [-af * x * x, 0, -am]])
    return np.linalg.solve(left, right)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9, 1.0])
@pytest.mark.parametrize("x", [0.1, 2.0, 1e3])
def test_a_linear_mode_is_amplified_by_the_formula(rho: float, x: float) -> None:
    h, n = 0.01, 60
    w = x / h
    r = fa.simulate(slider(w**2), np.arange(n + 1) * h, [1.0], integrator="implicit", step=h, spectral_radius=rho)
    A = amplification(rho, x)
    expected = [np.array([1.0, 0.0, -x * x])]
    for _ in range(n):
        expected.append(A @ expected[-1])
    size = np.abs(expected).max(axis=0)
    np.testing.assert_allclose(r.q[:, 0] / size[0], np.array(expected)[:, 0] / size[0], atol=1e-9)
    np.testing.assert_allclose(r.v[:, 0] * h / size[1], np.array(expected)[:, 1] / size[1], atol=1e-9)
    radius = np.abs(np.linalg.eigvals(A)).max()
    if x == 1e3:
        assert radius == pytest.approx(rho, abs=0.02)  # fast modes: what was asked for
        if rho < 1:
            assert np.abs(r.q[-1, 0]) < 1.5 * n**2 * max(rho, 0.1) ** n + 1e-12
    elif x == 0.1:
        assert radius > 1 - 2e-4  # slow modes: hardly damped


def test_energy_of_a_free_arm_does_not_drift() -> None:
    """1e5 steps, undamped, spectral radius 1: the energy swings with the step's square, and has no slope."""
    arm = fa.Arm.from_dict(reference("ist_order2")["scene"])
    q0, v0 = np.zeros(arm.nq), np.zeros(arm.nv)
    q0[1], v0[0] = 0.05, 2.0
    swings = []
    for h in (1e-3, 2.5e-4):
        t = np.arange(1001) * 100 * h
        r = fa.simulate(arm, t, q0, v0, integrator="implicit", step=1.001 * h, spectral_radius=1.0)
        assert r.stats["steps"] == 100_000
        kinetic, potential = r.energy()
        error = (kinetic + potential) / (kinetic[0] + potential[0]) - 1
        swings.append(np.ptp(error))
        slope = np.polyfit(np.linspace(0, 1, len(t)), error, 1)[0]
        assert abs(slope) < 0.1 * swings[-1]
        assert np.ptp(error[-200:]) < 1.3 * np.ptp(error[:200])
    assert swings[0] < 1e-3
    assert swings[1] < swings[0] / 8


def test_spectral_radius_below_one_damps_what_is_too_fast() -> None:
    """Shear that rings after a jump of the torque: kept at 1, gone at 0.9; the tip hardly feels it."""
    beam = fa.Beam(0.5, fa.Rectangle(0.001, 0.02), STEEL, {"bending_y": 2, "shear_y": 1}, order=2)
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(inertia=(0, 0, 1e-3), end=(0.075, 0, 0)), beam)])
    t = np.linspace(0, 1, 501)
    jump = {0: fa.Torque(lambda x: 0.05 if x >= 0.1005 else 0.0)}
    kept, gone = (
        fa.simulate(arm, t, drive=jump, integrator="implicit", step=1e-3, **o) for o in ({}, {"spectral_radius": 0.9})
    )
    assert np.abs(np.diff(gone.a[250:, 3])).max() < 0.02 * np.abs(np.diff(kept.a[250:, 3])).max()
    tip = kept.tip_deflection()
    assert np.abs(gone.tip_deflection() - tip).max() < 0.02 * np.abs(tip).max()


@pytest.mark.parametrize("rho", [1.0, 0.5])
def test_stiff_shear_at_a_millisecond(rho: float) -> None:
    """Shear modes at 6e4 rad/s do not care about steps of 1e-3 s; rk4 overflows there and says so."""
    arm = spatial_arm(shear=1, damping=0.0)
    fast = np.sqrt(np.abs(np.linalg.eigvals(np.linalg.solve(arm.mass_matrix(arm.zero), _stiffness(arm)))).max())
    assert fast * 1e-3 > 50
    v0 = np.zeros(arm.nv)
    v0[0] = 2.0
    t = np.linspace(0, 1, 51)
    r = fa.simulate(arm, t, v0=v0, integrator="implicit", step=1e-3, spectral_radius=rho)
    plain = spatial_arm(damping=0.0)
    truth = fa.simulate(plain, t, v0=v0[: plain.nv], rtol=1e-8, atol=1e-10)  # without shear, which hardly bends these
    assert np.abs(r.frame()[0] - truth.frame()[0]).max() < 5e-3
    said = ("t =", "0.001 s", "05 s", "ran away", "steps", "link")
    with refuses(said, error=fa.SimulationError) as caught:
        fa.simulate(arm, t, v0=v0, integrator="rk4", step=1e-3)
    error = caught.value
    assert 0 <= error.time < 1
    assert len(error.result.t) == len(error.result.q) >= 1
    assert error.result.t[-1] <= error.time
    for x in (error.result.q, error.result.v, error.result.a, error.result.tau):
        assert np.isfinite(x).all()


def _stiffness(arm: fa.Arm) -> np.ndarray:
    zero = np.zeros(arm.nv)
    return arm.inverse_derivatives(arm.zero, zero, zero)[0]


def test_rk4_just_under_and_over_its_limit() -> None:
    """The classical method is stable on undamped vibration up to h w = 2 sqrt 2."""
    w = 100.0
    for x, stable, n in ((2.82, True, 2000), (2.84, False, 600)):
        h = x / w
        r = fa.simulate(slider(w * w), np.array([0, n * h]), [1e-3], integrator="rk4", step=1.0001 * h)
        assert r.stats["steps"] == n
        assert (np.abs(r.q[-1, 0]) < 1e-3) == stable
        if not stable:
            assert np.abs(r.q[-1, 0]) > 1.0


@pytest.mark.parametrize("integrator", ["implicit", "rk4"])
def test_quaternions_stay_of_unit_length(integrator: str) -> None:
    arm, laws, start = floating_case()
    r = fa.simulate(arm, np.linspace(0, 2, 21), **start, **laws, integrator=integrator, step=1e-3)
    for ball in (slice(3, 7), slice(7, 11)):
        np.testing.assert_allclose(np.linalg.norm(r.q[:, ball], axis=1), 1.0, atol=1e-14)


def test_stops_throw_back() -> None:
    """A mass thrown against a stop, 0.3 = step times the frequency in the stop: it comes back as fast as it came."""
    arm = slider(0.0, lower=-1.0, upper=0.1, limit_stiffness=1e5)
    for rho in (1.0, 0.5):
        r = fa.simulate(arm, np.linspace(0, 0.3, 31), v0=[1.0], integrator="implicit", step=1e-3, spectral_radius=rho)
        assert -1.05 < r.v[-1, 0] < -0.9
        assert r.stats["newton_iterations"] < 3 * r.stats["steps"]


def in_balance(case: str) -> tuple[fa.Arm, dict]:
    """An arm without gravity whose springs and beams hold loads or patches; no torque acts."""
    pzt = fa.Piezo(62e9, 0.3, 7800, d31=-1.8e-10)
    patch = fa.Patch(0.02, 0.1, 0.02, 5e-4, pzt)
    beam = fa.Beam(0.4, fa.Rectangle(0.003, 0.02), STEEL, {"bending_y": 2}, "legendre", patches=[patch])
    rested = {"stiffness": 60.0, "rest": 0.3, "upper": 0.1, "limit_stiffness": 500.0}
    joint = {"clamped": fa.Fixed(), "sprung": fa.Revolute("z", stiffness=50.0), "stopped": fa.Revolute("z", **rested)}
    pushed = {} if case in ("voltage", "stopped") else {"loads": [fa.Load(force=(0.3, 1.5, 0))]}
    volts = {"drive": {("patch", 0, 0): fa.Voltage(100.0)}} if case == "voltage" else {}
    hub = fa.RigidBody(0.3, inertia=(0.005, 0.005, 0.005))
    return fa.Arm([fa.Link(joint.get(case, fa.Fixed()), hub, beam, fa.RigidBody(0.1))]), pushed | volts


@pytest.mark.parametrize("case", ["clamped", "sprung", "stopped", "voltage"])
@pytest.mark.parametrize("step", [1e-3, 1e-4])
@pytest.mark.parametrize("integrator", ["implicit", "gauss"])
def test_what_begins_in_balance_stands_still(integrator: str, step: float, case: str) -> None:
    """There is no motion there that the error of an iteration could be a part of."""
    arm, acting = in_balance(case)
    r = fa.simulate(arm, [0.0, 0.02, 0.04], "equilibrium", integrator=integrator, step=step, **acting)
    assert np.abs(r.q - r.q[0]).max() < 1e-12 * np.abs(r.q[0]).max()
    assert np.abs(r.v).max() < 1e-9 * np.abs(r.q[0]).max()


def test_scenarios_that_begin_in_balance_stand_still() -> None:
    arm, acting = in_balance("sprung")
    q0 = np.repeat(arm.equilibrium(loads=acting["loads"])[None], 8, axis=0)
    runs = fa.simulate_batch(arm, np.linspace(0, 0.04, 41), q0, **acting)
    assert runs.stats["lanes"] > 0 and not runs.failures
    assert np.abs(runs.q - q0[:, None]).max() < 1e-12 * np.abs(q0).max()


def test_a_torque_that_runs_away_is_reported() -> None:
    """The time reached and what was computed, all finite."""
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(inertia=(0, 0, 1.0)))])
    runaway = fa.Torque(lambda t: np.exp(min(1e3 * t, 709.0)) ** 2)
    for integrator in ("implicit", "rk4"):
        with refuses("t =", error=fa.SimulationError) as caught:
            fa.simulate(arm, np.linspace(0, 2, 201), drive={0: runaway}, integrator=integrator, step=1e-3)
        assert 0 < caught.value.time < 2
        assert np.isfinite(caught.value.result.v).all() and len(caught.value.result.t) > 1


def test_large_steps_that_newton_cannot_solve_are_reported() -> None:
    arm = spatial_arm(shear=1, damping=0.0)
    v0 = np.zeros(arm.nv)
    v0[:3] = 60.0
    with refuses("0.1 s", "step", "smaller step", error=fa.SimulationError) as caught:
        fa.simulate(arm, np.linspace(0, 10, 101), v0=v0, integrator="implicit", step=0.1)
    assert np.isfinite(caught.value.result.q).all()


def test_arguments() -> None:
    arm, t = paper_link(), [0, 0.5, 1]
    for options, message in (
        ({"integrator": "implicit"}, 'step: integrator="implicit" needs it, in seconds, such as step=1e-3'),
        ({"integrator": "rk4"}, 'step: integrator="rk4" needs it'),
        ({"integrator": "rk4", "step": 0}, "step = 0: must be positive and finite"),
        ({"integrator": "implicit", "step": -1e-3}, "step = -0.001: must be positive"),
        ({"integrator": "implicit", "step": float("nan")}, "step = nan: must be positive"),
        ({"integrator": "implicit", "step": "fast"}, "step = 'fast': must be a number"),
        ({"integrator": "implicit", "step": 1.5}, "step = 1.5: must be at most the time simulated"),
        ({"integrator": "implicit", "step": 1e-15}, "step = 1e-15: is too small"),
        (
            {"integrator": "implicit", "step": 1e-3, "spectral_radius": 1.1},
            "spectral_radius = 1.1: must be from 0 to 1",
        ),
        ({"integrator": "ida", "step": 1e-3}, 'step = 0.001: is for integrator="implicit"'),
        ({"integrator": "ida", "stages": 3}, 'stages = 3: is for integrator="gauss", not for "ida"'),
        ({"integrator": "rk4", "step": 1e-3, "max_order": 2}, 'max_order = 2: is for integrator="ida", not for "rk4"'),
        ({"integrator": "gauss", "step": 1e-2, "rtol": 0.0}, "rtol = 0.0: must be"),
        ({"integrator": "euler"}, "integrator = 'euler'"),
    ):
        with pytest.raises(ValueError) as caught:
            fa.simulate(arm, t, **options)
        assert message in str(caught.value)


def test_ctrl_c_and_stats() -> None:
    arm = paper_link()
    killer = threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT))
    killer.start()
    with pytest.raises(fa.errors.SimulationInterrupted) as caught:
        fa.simulate(arm, np.linspace(0, 1e5, 100_001), [0, 0.1, 0, 0], integrator="implicit", step=1e-3)
    killer.join()
    kept = caught.value.result
    assert len(kept.t) > 1 and kept.t[-1] <= caught.value.time and np.isfinite(kept.q).all()
    assert kept.stats["steps"] == pytest.approx(caught.value.time / 1e-3, abs=1)
    assert kept.stats["evaluations"] >= kept.stats["steps"] > 0
    assert kept.stats["newton_iterations"] == kept.stats["evaluations"] and kept.stats["wall_time"] > 0


def test_scene_files_and_command_line(tmp_path) -> None:
    from flexarm import cli

    text = (SCENES / "ist.toml").read_text()
    at = text.index("[simulation]") + len("[simulation]")
    path = tmp_path / "fixed.toml"
    path.write_text(text[:at] + '\nintegrator = "implicit"\nstep = 1e-3\nspectral_radius = 0.8' + text[at:])
    scene = fa.load(path)
    assert scene.options == {"integrator": "implicit", "step": 1e-3, "spectral_radius": 0.8}
    assert cli.main(["run", str(path), "-o", str(tmp_path / "out"), "--json"]) == 0
    path.write_text(text[:at] + '\nintegrator = "implicit"' + text[at:])
    with refuses("step", "integrator=", '"implicit"'):
        fa.load(path).run()
