"""Forces and moments on slices."""

import flexarm as fa
import numpy as np
import pytest
from arms import paper_link, random_arm, random_state
from messages import refuses

G = 9.81


def test_a_load_is_its_jacobian_transposed() -> None:
    """J^T F for every slice, in world and section axes, by AB, CI and inverse dynamics alike."""
    for seed in range(8):
        rng = np.random.default_rng(seed)
        arm = random_arm(rng, 3, orders=(1, 2, 3, "exact"))
        q, v, tau = random_state(rng, arm)
        f, m = rng.normal(size=3), rng.normal(size=3)
        for link in range(3):
            beam = arm.links[link].beam
            for x in (None,) if beam is None else (None, 0.0, 0.6 * beam.length):
                J = arm.jacobian(q, link, x)
                R = arm.frame(q, link, x)[1]
                for axes, W in (("world", np.concatenate([f, m])), ("section", np.concatenate([R @ f, R @ m]))):
                    load = fa.Load(link, x, force=f, moment=m, axes=axes)
                    bare, loaded = arm.bias(q, v), arm.inverse_dynamics(q, v, np.zeros(arm.nv), loads=[load])
                    np.testing.assert_allclose(bare - loaded, J.T @ W, atol=1e-11 * np.abs(bare).max() + 1e-11)
                    for method in ("ab", "ci"):
                        a = arm.forward_dynamics(q, v, tau, method, loads=[load])
                        b = arm.forward_dynamics(q, v, tau + J.T @ W, method)
                        np.testing.assert_allclose(a, b, atol=1e-8 * np.abs(b).max())


def test_jacobians_hold_the_loads() -> None:
    rng = np.random.default_rng(1)
    arm = random_arm(rng, 3, orders=(2, 3, "exact"))
    q, v, a = random_state(rng, arm)
    loads = [fa.Load(1, None, force=(1, 2, 3), moment=(3, -1, 2), axes=axes) for axes in ("world", "section")]
    bare, full = (arm.inverse_derivatives(q, v, a, loads=x)[0] for x in ((), loads))
    h = 1e-5
    for i in range(arm.nq):
        step = h * np.eye(arm.nq)[i]
        up, down = (
            arm.inverse_dynamics(q + k * step, v, a, loads=loads) - arm.inverse_dynamics(q + k * step, v, a)
            for k in (1, -1)
        )
        np.testing.assert_allclose((full - bare)[:, i], (up - down) / (2 * h), atol=1e-4)


def test_a_line_load_of_the_beams_weight_is_gravity() -> None:
    beam = paper_link(2, basis="legendre").links[0].beam
    w = beam.mass / beam.length * G
    weight = fa.Load(0, along=(0.0, beam.length), force=(0, -w, 0))
    heavy = fa.Arm(paper_link(2, basis="legendre").links, gravity=(0, -G, 0))
    light = paper_link(2, basis="legendre")
    rng = np.random.default_rng(2)
    for _ in range(5):
        q, v = 0.5 * rng.normal(size=4), rng.normal(size=4)
        a, b = light.forward_dynamics(q, v, loads=[weight]), heavy.forward_dynamics(q, v)
        np.testing.assert_allclose(a, b, atol=1e-10 * np.abs(b).max())


def test_a_tip_force_in_time() -> None:
    """A slow ramp leaves the static deflection P L^3 / 3 EI; samples and a callable agree."""
    arm = fa.Arm([fa.Link(fa.Fixed(), beam=paper_link(1, basis="legendre", damping_ratio=0.5).links[0].beam)])
    EI, P, t = 209e9 * 0.02 * 0.001**3 / 12, 0.05, np.linspace(0, 6, 61)
    ramp = fa.Load(force=[(0, 0, 0), (0, P, 0), (0, P, 0)], t=[0, 2, 6])
    called = fa.Load(force=lambda x: (0, P * min(x / 2, 1), 0))
    runs = [fa.simulate(arm, t, loads=[load], max_order=2) for load in (ramp, called)]
    for r in runs:
        assert r.tip_deflection()[-1, 1] == pytest.approx(P * 0.5**3 / (3 * EI), rel=1e-5)
    np.testing.assert_allclose(runs[0].q, runs[1].q, atol=1e-4)


def test_a_follower_force_turns_with_the_link() -> None:
    """Thrust across a rigid arm, in its own axes: a constant moment about the joint."""
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, inertia=(0, 0, 2.0), end=(0.5, 0, 0)))])
    t = np.linspace(0, 5, 11)
    r = fa.simulate(arm, t, loads=[fa.Load(force=(0, 4.0, 0), axes="section")])
    np.testing.assert_allclose(r.q[:, 0], 0.5 * t**2, atol=1e-5)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda a: fa.Load(0), "force = None"),
        (lambda a: fa.Load(0, force=(1, 2)), ("force has shape (2,)", "3", "numbers")),
        (lambda a: fa.Load(0, x=0.1, along=(0, 1), force=(1, 2, 3)), ("x", "along")),
        (lambda a: fa.Load(0, force=(1, 2, 3), axes="body"), "axes = 'body'"),
        (lambda a: fa.simulate(a, [0, 1], loads=[fa.Load(3, force=(1, 2, 3))]), ("load", "link = 3")),
        (lambda a: fa.simulate(a, [0, 1], loads=[fa.Load(0, 0.7, force=(1, 2, 3))]), ("x = 0.7", "beam")),
        (lambda a: fa.simulate(a, [0, 1], loads=[fa.Load(0, along=(0.2, 0.1), force=(1, 2, 3))]), "along = 0.2"),
        (lambda a: fa.simulate(a, [0, 1], loads=[1.0]), ("loads[0] = 1.0", "Load")),
        (lambda a: fa.simulate(a, [0, 1], loads=[fa.Load(force=lambda t: (t, 0))]), ("Load", "t = 0.0", "force")),
        (
            lambda a: fa.simulate(a, [0, 1], loads=[fa.Load(force=np.ones((2, 3)), t=[0, 0.5])]),
            ("loads[0]", "t = 0.0", "0.5", "samples"),
        ),
    ],
)
def test_bad_loads(make, message: str) -> None:
    with refuses(message):
        make(paper_link())


def test_loads_in_scene_files_and_results(tmp_path) -> None:
    path = tmp_path / "arm.toml"
    text = """
        [[link]]
        joint = { type = "revolute" }
        hub = { mass = 1.0, inertia = [0, 0, 2.0], end = [0.5, 0, 0] }
        [[load]]
        force = [0.0, 4.0, 0.0]
        axes = "section"
        """
    path.write_text(text)
    r = fa.load(path).run()
    np.testing.assert_allclose(r.q[:, 0], 0.5 * r.t**2, atol=1e-6)
    reaction = r.joint_reaction()  # the bearing holds the thrust; the hinge itself passes on no moment
    np.testing.assert_allclose(reaction, np.tile([0, -4.0, 0, 0, 0, 0], (len(r.t), 1)), atol=1e-9)
    r.save(tmp_path / "run.npz")
    with refuses("loads = None"):
        fa.Result.load(tmp_path / "run.npz").joint_reaction()
    path.write_text(text + "link = 3\n")
    with refuses("load[0]", "link = 3"):
        fa.load(path)
    path.write_text(text + "forse = [1, 2, 3]\n")
    with refuses("load[0]", "key 'forse'", "'force'"):
        fa.load(path)


def test_equilibrium_under_a_tip_force_is_the_elastica() -> None:
    """P L^2/EI = 1: w/L 0.30172077, u/L 0.05643324, slope 0.46135195 [elastica]."""
    section = fa.sections.GeneralSection(1.0, 1.0, 1.0, 1.0)
    beam = fa.Beam(1.0, section, fa.Material(1.0, 1.0), {"bending_y": 6}, "legendre", "exact", rotary_inertia=False)
    arm = fa.Arm([fa.Link(fa.Fixed(), beam=beam)])
    q = arm.equilibrium(loads=[fa.Load(force=(0, 1.0, 0))])
    p, R = arm.frame(q)
    np.testing.assert_allclose(
        [p[1], 1 - p[0], np.arctan2(R[1, 0], R[0, 0])], [0.30172077, 0.05643324, 0.46135195], atol=2e-8
    )


def test_what_a_load_gives_is_a_copy() -> None:
    load = fa.Load(0, None, force=(1, 2, 3))
    load(0.0)[:] = 7.0
    np.testing.assert_array_equal(load(0.0), [1, 2, 3, 0, 0, 0])
