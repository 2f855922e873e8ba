"""Every bad input is a ValueError that names the field and the value."""

import copy
import pickle

import flexarm as fa
import numpy as np
import pytest
from arms import paper_link, random_arm, reference
from messages import refuses

steel = fa.Material(7850, 209e9, 0.3)
strip = fa.Rectangle(0.001, 0.02)


def beam(**change) -> fa.Beam:
    return fa.Beam(**({"length": 0.5, "section": strip, "material": steel, "modes": {"bending_y": 2}} | change))


def hinged(*bodies: fa.RigidBody) -> fa.Arm:
    return fa.Arm([fa.Link(fa.Revolute("z"), body) for body in bodies])


PARTS = [
    (lambda: beam(length=-0.5), "length = -0.5"),
    (lambda: fa.Scene(paper_link(), np.linspace(0, 1, 3)), "drive = array"),
    (lambda: beam(length=0), "length = 0"),
    (lambda: beam(length=float("nan")), "length = nan"),
    (lambda: beam(length="long"), "length = 'long'"),
    (lambda: beam(modes={"bending": 2}), ("key 'bending'", "'bending_y'", "'bending_z'")),
    (lambda: beam(modes={"bending_yy": 2}), ("modes", "key 'bending_yy'", "'bending_y'")),
    (lambda: beam(modes={"bending_y": -1}), "modes.bending_y = -1"),
    (lambda: beam(modes={"bending_y": 1.5}), "modes.bending_y = 1.5"),
    (lambda: beam(order=4), ("order = 4", '"exact"')),
    (lambda: beam(order="exakt"), "order = 'exakt'"),
    (lambda: beam(basis="legendr"), ("basis = 'legendr'", "'legendre'")),
    (lambda: beam(damping_ratio=-0.1), "damping_ratio = -0.1"),
    (lambda: beam(damping_ratio=2), ("damping_ratio = 2", "0.02")),
    (lambda: beam(damping=1.0), ("damping has shape ()", "matrix")),
    (lambda: beam(damping=[1.0, 2.0]), ("damping has shape (2,)", "matrix")),
    (lambda: beam(curvature=(0, 0, 1e9), order="exact"), ("curvature =", "folds", "beam")),
    (lambda: beam(curvature=(1e6, 0, 0), order="exact"), ("curvature =", "500000 rad", "turns", "beam", "sections")),
    (lambda: beam(gauss_points=0), "gauss_points = 0"),
    (lambda: beam(section=0.001), ("section = 0.001", "Section", "Taper")),
    (lambda: beam(material=fa.Material(7850, 209e9), modes={"torsion": 1}), "shear_modulus"),
    (lambda: fa.Rectangle(0.001, -0.02), "z = -0.02"),
    (lambda: fa.Circle(0.01, 0.02), "inner_radius = 0.02"),
    (lambda: fa.sections.GeneralSection(1.0, 1.0, 0.0, 1.0), "second_moment_z = 0"),
    (lambda: fa.Material(-1.0, 209e9), "density = -1"),
    (lambda: fa.Material(7850, 0.0), "youngs_modulus = 0"),
    (lambda: fa.Material(7850, 209e9, 0.6), "poisson_ratio = 0.6"),
    (lambda: fa.Material(7850, 209e9, 0.3, 80e9), "shear_modulus = 8e+10"),
    (lambda: fa.RigidBody(-1.0), "mass = -1"),
    (lambda: fa.RigidBody(1.0, (0, 0)), ("com has shape (2,)", "3", "numbers")),
    (lambda: fa.RigidBody(1.0, (0, 0, np.inf)), ("com =", "finite")),
    (lambda: fa.RigidBody(1.0, inertia=(1, 1, -1)), ("inertia =", "negative")),
    (lambda: fa.RigidBody(1.0, inertia=np.arange(9).reshape(3, 3)), ("inertia =", "symmetric")),
    (lambda: fa.RigidBody(1.0, inertia=(1, 1, 1, 9, 0, 0)), ("inertia =", "negative")),
    (lambda: fa.RigidBody(0.01, inertia=(1, 1, 5)), ("inertia =", "1 1 5 kg m^2")),
    (lambda: fa.RigidBody(0.01, inertia=(2, 2, 2, 0, 0, 1.5)), ("inertia =", "mass")),
    (lambda: fa.RigidBody(1.0, inertia=(1, 2)), "inertia has shape (2,)"),
    (lambda: fa.Revolute("w"), "axis = 'w'"),
    (lambda: fa.Revolute((0, 0, 0)), "axis = 0 0 0"),
    (lambda: fa.Link("revolute"), "joint = 'revolute'"),
    (lambda: fa.Link(fa.Fixed(), beam=fa.RigidBody(1.0)), ("beam = RigidBody", "Beam", "None")),
    (lambda: fa.Arm([]), "links = []"),
    (lambda: fa.Arm([fa.Fixed()]), ("links[0] = Fixed", "Link")),
    (lambda: hinged(fa.RigidBody()), ("coordinate 'link 0 revolute' = 0", "inertia")),
    (lambda: hinged(fa.RigidBody(1.0)), ("coordinate 'link 0 revolute' = 0", "inertia")),
    (lambda: hinged(fa.RigidBody(), fa.RigidBody(1.0, inertia=(1, 1, 1))), ("coordinate 'link 0 revolute'", "inertia")),
    (
        lambda: fa.Arm([fa.Link(fa.Fixed(), beam=beam(modes={"torsion": 1}, rotary_inertia=False))]),
        ("coordinate 'link 0 torsion 1' = 0", "inertia"),
    ),
    (lambda: fa.Arm([fa.Link(fa.Fixed(), fa.RigidBody(1.0))], gravity=(0, 0)), "gravity has shape (2,)"),
]


@pytest.mark.parametrize(("make", "message"), PARTS)
def test_parts(make, message: str) -> None:
    with refuses(message):
        make()


CALLS = [
    (lambda a: a.forward_dynamics([0, 0, 0], np.zeros(4)), ("q has shape (3,)", "4")),
    (lambda a: a.forward_dynamics(np.zeros(4), [0, np.nan, 0, 0]), ("v =", "finite")),
    (lambda a: a.forward_dynamics(np.zeros(4), np.zeros(4), method="abc"), "method = 'abc'"),
    (lambda a: a.forward_dynamics(np.zeros((2, 4)), np.zeros((3, 4))), ("q (2, 4)", "v (3, 4)")),
    (lambda a: a.forward_dynamics(np.zeros(4), np.zeros(4), prescribed={1: 0.0}), ("prescribed", "link = 1")),
    (lambda a: a.mass_matrix("abcd"), "q = 'abcd'"),
    (lambda a: a.frame(np.zeros(4), link=1), ("link = 1", "-1 to 0")),
    (lambda a: a.frame(np.zeros(4), x=0.6), ("x = 0.6", "beam")),
    (lambda a: a.strain(np.zeros(4), x=-0.1), "x = -0.1"),
    (lambda a: a.modes(speed={0: np.inf}), "speed = inf"),
    (lambda a: a.modes(lock=[3]), ("lock", "link = 3", "-1 to 0")),
    (lambda a: fa.simulate(a, [0, 1, 1]), "t[2] = 1"),
    (lambda a: fa.simulate(a, [0.0]), ("t has shape (1,)", "list")),
    (lambda a: fa.simulate(a, [0, np.nan]), ("t =", "finite")),
    (lambda a: fa.simulate(a, [0, 1], [0, 0]), ("q0 has shape (2,)", "4", "numbers")),
    (lambda a: fa.simulate(a, [0, 1], rtol=0), "rtol = 0"),
    (lambda a: fa.simulate(a, [0, 1], atol=-1e-9), "atol = -1e-09"),
    (lambda a: fa.simulate(a, [0, 1], max_order=6), ("max_order = 6", "1 to 5")),
    (lambda a: fa.simulate(a, [0, 1], integrator="euler"), "integrator = 'euler'"),
    (
        lambda a: fa.simulate(a, [0, 1], drive={0: 1.0}),
        ("'link 0 revolute' = 1.0", "Motion", "Torque"),
    ),
    (lambda a: fa.simulate(a, [0, 1], drive={2: fa.Torque(1.0)}), ("drive", "link = 2")),
    (
        lambda a: fa.simulate(a, [0, 1], drive={0: fa.Torque([0, 0.5], [0, 1])}),
        ("'link 0 revolute'", "samples", "t = 0"),
    ),
    (
        lambda a: fa.simulate(a, [0, 1], [1, 0, 0, 0], drive={0: fa.Motion.spin_up(1, 1)}),
        ("q0[0] = 1.0", "'link 0 revolute'", "0.0"),
    ),
    (lambda a: fa.Motion([0, 1, 1], [0, 0, 0]), "t[2] = 1.0"),
    (lambda a: fa.Motion([0, 1], [0, 0, 0]), ("q has shape (3,)", "2", "numbers")),
    (lambda a: fa.Motion([0, 1], [0, 0], v=[0, 0]), "a = None"),
    (lambda a: fa.Torque([0, 1], [0, np.nan]), ("tau =", "finite")),
]


@pytest.mark.parametrize(("call", "message"), CALLS)
def test_calls(call, message: str) -> None:
    with refuses(message):
        call(paper_link())


def scene() -> dict:
    return copy.deepcopy(reference("two_link_order2")["scene"])


SCENES = [
    (lambda d: d.update(gravty=1), ("scene", "key 'gravty'", "'gravity'")),
    (lambda d: d.pop("link"), "link = None"),
    (lambda d: d["link"][1].update(bean={}), ("link[1]", "key 'bean'", "'beam'")),
    (lambda d: d["link"][1]["beam"].update(lenght=1), ("link[1].beam", "key 'lenght'", "'length'")),
    (lambda d: d["link"][0]["beam"].update(length=-1), "link[0].beam.length = -1"),
    (lambda d: d["link"][0]["beam"].pop("length"), ("link[0].beam", "missing", "length")),
    (lambda d: d["link"][0]["beam"]["section"].update(type="rectangel"), ("section.type =", "'rectangle'")),
    (
        lambda d: d["link"][0]["beam"]["material"].update(densty=1),
        ("material", "'densty'"),
    ),
    (lambda d: d["link"][0]["hub"].update(mass=-2), "link[0].hub.mass = -2"),
    (lambda d: d["link"][0]["hub"].update(inertia=[1, 1, 5]), ("link[0].hub.inertia =", "1 1 5")),
    (lambda d: d["link"][1]["beam"].update(damping_ratio=2), "link[1].beam.damping_ratio = 2"),
    (lambda d: d["link"][0]["joint"].update(type="revolution"), ("link[0].joint.type =", "'revolute'")),
    (lambda d: d["link"][0]["joint"].update(axis="q"), "link[0].joint.axis = 'q'"),
    (lambda d: d["link"][0].pop("joint"), ("link[0]", "missing")),
    (lambda d: d["link"].__setitem__(0, 7), "link[0] = 7"),
]


@pytest.mark.parametrize(("spoil", "message"), SCENES)
def test_scenes(spoil, message: str) -> None:
    d = scene()
    spoil(d)
    with refuses(message):
        fa.Arm.from_dict(d)


def test_scene_files(tmp_path) -> None:
    path = tmp_path / "arm.toml"
    with refuses("No such file"):
        fa.load(tmp_path / "none.toml")
    path.write_text("gravity = [0, 0")
    with refuses("arm.toml", "array"):
        fa.load(path)
    text = """
        [[link]]
        joint = { type = "revolute" }
        hub = { inertia = [0, 0, 1] }
        [simulation]
        duration = 0.5
        interval = 0.01
        rtol = 1e-8
        [[drive]]
        link = 0
        """
    path.write_text(text + 'torque = { file = "torque.csv" }')
    with refuses("drive[0].torque.file =", "No such file"):
        fa.load(path)
    (tmp_path / "torque.csv").write_text("t,tau\n0,0\n1,2\n")
    run = fa.load(path).run()
    np.testing.assert_allclose(run.q[:, 0], run.t**3 / 3, atol=1e-7)
    path.write_text(text + "spin_up = { speed = 2.0, tim = 1.0 }")
    with refuses("drive[0].spin_up", "key 'tim'", "'time'"):
        fa.load(path)
    path.write_text(text + "torque = 1.0\n[[drive]]\nlink = 0\ntorque = 2.0")
    with refuses("drive[1].link = 0", "twice"):
        fa.load(path)
    path.write_text(text.replace("0.01", "0.3") + "torque = 1.0")
    with refuses("simulation.interval = 0.3"):
        fa.load(path)


def test_arms_survive_dictionaries_and_pickles() -> None:
    for seed in range(5):
        arm = random_arm(np.random.default_rng(seed), 3)
        for twin in (fa.Arm.from_dict(arm.to_dict()), pickle.loads(pickle.dumps(arm))):
            assert twin == arm and twin.coordinates == arm.coordinates
            q = np.full(arm.nq, 0.01)
            np.testing.assert_array_equal(twin.mass_matrix(q), arm.mass_matrix(q))


def ball() -> fa.Arm:
    return fa.Arm([fa.Link(fa.Spherical(), fa.RigidBody(1.0, inertia=(1, 1, 1)))])


def wheel() -> fa.Arm:
    return hinged(fa.RigidBody(1.0, inertia=(1, 1, 1)))


def run(**given) -> fa.Result:
    return fa.simulate(wheel(), [0, 0.1], **given)


HUGE, NESTED = 10**400, []
for _ in range(100_000):
    NESTED = [NESTED]

WRONG_KINDS = [
    (lambda: fa.Material(7850, None), "youngs_modulus = None"),
    (lambda: beam(basis=np.zeros(3)), "basis = (0.0, 0.0, 0.0)"),
    (lambda: fa.Arm.from_dict({"link": [{"joint": {"type": np.zeros(3)}}]}), "joint.type ="),
    (lambda: fa.Axes(axes=5), "axes = 5"),
    (lambda: fa.Axes(axes=None), "axes = None"),
    (lambda: fa.Universal(stiffness=[[1, 2], [3]]), ("stiffness =", "numbers")),
    (lambda: fa.Universal(stiffness=np.zeros((2, 2))), "stiffness has shape (2, 2)"),
    (lambda: fa.sensors.Encoder(noise=[[1, 2], [3]]), ("noise =", "numbers")),
    (lambda: fa.RigidBody(HUGE), ("mass =", "too large")),
    (lambda: fa.Load(force={}), "force = {}"),
    (lambda: fa.Load(force="abc"), "force = 'abc'"),
    (lambda: fa.Load(force=[[1, 2], [3]]), "force = [[1, 2], [3]]"),
    (lambda: fa.Load(moment=[HUGE, 0, 0]), ("moment =", "numbers")),
    (lambda: fa.PD(1, 1, reference=[[1, 2], [3]]), ("reference", "r has shape (1,)", "2")),
    (lambda: run(control=fa.PD(1, 1, reference=lambda t: "a")), ("t = 0", "reference", "numbers")),
    (lambda: run(control=fa.LinearController.pid(1, 1, 1, rate=10, reference=lambda t: "a")), ("t = 0", "reference")),
    (lambda: run(control=fa.Sampled(lambda t, y: None, 100)), ("law", "None")),
    (lambda: run(drive={0: fa.Motion(lambda t: None)}), ("at t =", "None", "3 numbers")),
    (lambda: run(loads=[fa.Load(force=lambda t: None)]), ("force at t =", "None", "3 numbers")),
    (lambda: run(control=fa.PD(1, 1, reference=lambda t: None)), ("reference at t =", "None")),
    (lambda: fa.Data([0, 1], {"t": [1, 2]}), ("'t'", "times")),
    (lambda: run(control=fa.Sampled(lambda t, y: "a", 100)), ("law", "'a'")),
    (lambda: run(control=fa.Sampled(lambda t, y: [[1], [2, 3]], 100)), ("law", "[[1], [2, 3]]")),
    (lambda: fa.simulate_batch(wheel(), [0, 0.1], drive=5), "drive = 5"),
    (lambda: fa.simulate_batch(wheel(), [0, 0.1], drive=[fa.Torque(1)]), "drive ="),
    (lambda: fa.simulate_batch(wheel(), [0, 0.1], drive={0: 5}), ("drive[0] = 5", "Motion")),
    (lambda: fa.simulate_batch(wheel(), [0, 0.1], loads=5), "loads = 5"),
    (lambda: fa.simulate_batch(wheel(), [0, 0.1], control=5), "control = 5"),
    (lambda: ball().modes(q=np.zeros(4)), ("q[0:4] = 0 0 0 0", "quaternion", "link 0")),
    (lambda: ball().linearize(np.zeros(4)), ("q[0:4] = 0 0 0 0", "quaternion", "link 0")),
    (lambda: ball().equilibrium(np.zeros(4)), ("q[0:4] = 0 0 0 0", "quaternion", "link 0")),
    (lambda: ball().forward_derivatives(np.zeros(4), np.zeros(3)), ("q[0:4] = 0 0 0 0", "quaternion", "link 0")),
    (lambda: paper_link().modes(speed={0: 1e200}), ("speed, q", "too large")),
    (lambda: paper_link().modes(q=[1e300] * 4), ("speed, q", "too large")),
    (lambda: wheel().modes(lock="all"), "lock = 'all'"),
    (lambda: wheel().equilibrium(lock="0"), "lock = '0'"),
    (lambda: wheel().linearize([0], lock="all"), "lock = 'all'"),
    (lambda: fa.Arm.from_dict({"link": NESTED}), "deeply"),
    (lambda: fa.load("a" * 5000), "File name too long"),
]


@pytest.mark.parametrize(("call", "message"), WRONG_KINDS)
def test_wrong_kinds_are_named(call, message: str) -> None:
    with refuses(message) as caught:
        call()
    assert type(caught.value) is ValueError  # no LinAlgError, whose words are LAPACK's


def test_a_spin_up_of_any_length_is_smooth() -> None:
    """Its short beginning is computed without loss: q = speed (2 pi)^2 / 24 t^4 / time^3 there."""
    for time in (1.0, 1e6, 1e300):
        q, v, a = fa.Motion.spin_up(2.0, time)(1e-4 * time)
        s = 1e-4
        assert q == pytest.approx(2.0 * time * (2 * np.pi) ** 2 * s**4 / 24, rel=1e-6)
        assert v == pytest.approx(2.0 * (2 * np.pi) ** 2 * s**3 / 6, rel=1e-6)
        assert a == pytest.approx(2.0 / time * (2 * np.pi * s) ** 2 / 2, rel=1e-6)
    for s in (0.0795, 0.0797, 0.5, 1.0):  # about where the series begins
        q, v, _ = fa.Motion.spin_up(2.0, 3.0)(3.0 * s)
        w = 2 * np.pi / 3.0
        assert q == pytest.approx(2 / 3 * ((3 * s) ** 2 / 2 + (np.cos(w * 3 * s) - 1) / w**2), rel=1e-12)
        assert v == pytest.approx(2 / 3 * (3 * s - np.sin(w * 3 * s) / w), rel=1e-12)
    assert fa.simulate(wheel(), [0, 0.1], drive={0: fa.Motion.spin_up(1, 1e300)}).q[-1, 0] < 1e-300


def test_deep_sweep_files_are_refused(tmp_path) -> None:
    (tmp_path / "sweep.toml").write_text("title = " + "[" * 5000 + "]" * 5000)
    with refuses("sweep", "deeply"):
        fa.SweepPlan.load(tmp_path / "sweep.toml")
    with refuses("File name too long"):
        fa.SweepPlan.load("a" * 5000)


def test_what_is_no_list_or_dictionary_is_told_in_words() -> None:
    arm, t = hinged(fa.RigidBody(1.0, inertia=(0.1, 0.1, 0.1))), np.linspace(0, 0.01, 3)
    run = fa.simulate(arm, t, drive={0: fa.Torque(0.01)}, integrator="implicit", step=5e-3)
    loop = fa.closed_loop(arm, fa.PD(1.0, 0.1, 0))
    mass, push = "link.0.hub.mass", fa.Load(force=(0, 1, 0))
    batch = {"parameters": {"gravity": np.zeros((2, 3))}, "integrator": "implicit", "step": 5e-3}
    for named, ask in [
        (("parameters = ['link.0.hub.mass']", "dictionary"), lambda: run.error(parameters=[mass])),
        (("parameters = 'link.0.hub.mass'", "dictionary"), lambda: run.error(parameters=mass)),
        (("parameters = None", "list", "paths"), lambda: run.sensitivities(None)),
        (("parameters = [1]", "list", "paths"), lambda: run.gradient({"q": np.zeros(run.q.shape)}, [1])),
        (("parameters = 1", "list", "paths"), lambda: run.gradient({"q": np.zeros(run.q.shape)}, 1)),
        (("loads = Load", "list", "Load"), lambda: fa.rollout(arm, [0.0], step=1e-3, nstep=3, loads=push)),
        (("loads[0] = 5", "Load"), lambda: fa.rollout(arm, [0.0], step=1e-3, nstep=3, loads=[5])),
        (("lanes = 'x'", "true", "false"), lambda: fa.rollout(arm, [0.0], step=1e-3, nstep=3, lanes="x")),
        (("outputs = 1", "list", "tau"), lambda: fa.simulate_batch(arm, t, outputs=1, **batch)),
        (("outputs = 'q'", "list", "tau"), lambda: fa.simulate_batch(arm, t, outputs="q", **batch)),
        (("over = (1, 2)", "two", "control.0.kp"), lambda: loop.stability_map([1, 2.0], [1, 2.0], over=(1, 2))),
        (("over = 5", "two", "control.0.kp"), lambda: loop.stability_map([1, 2.0], [1, 2.0], over=5)),
        (("looks = None", "list", "Look"), lambda: fa.Link(fa.Revolute("z"), looks=None)),
        (("looks = 5", "list", "Look"), lambda: fa.Link(fa.Revolute("z"), looks=5)),
    ]:
        with refuses(*named):
            ask()
