"""Every bad input is a ValueError that names the field and the value."""

import copy
import pickle

import flexarm as fa
import numpy as np
import pytest
from arms import paper_link, random_arm, reference

steel = fa.Material(7850, 209e9, 0.3)
strip = fa.Rectangle(0.001, 0.02)


def beam(**change) -> fa.Beam:
    return fa.Beam(**({"length": 0.5, "section": strip, "material": steel, "modes": {"bending_y": 2}} | change))


def hinged(*bodies: fa.RigidBody) -> fa.Arm:
    return fa.Arm([fa.Link(fa.Revolute("z"), body) for body in bodies])


PARTS = [
    (lambda: beam(length=-0.5), r"length = -0.5: must be positive"),
    (lambda: fa.Scene(paper_link(), np.linspace(0, 1, 3)), r"drive = array.*: must be a dictionary"),
    (lambda: beam(length=0), r"length = 0: must be positive"),
    (lambda: beam(length=float("nan")), r"length = nan"),
    (lambda: beam(length="long"), r"length = 'long': must be a number"),
    (lambda: beam(modes={"bending": 2}), r"unknown key 'bending'; did you mean 'bending_y' or 'bending_z'\?"),
    (lambda: beam(modes={"bending_yy": 2}), r"modes: unknown key 'bending_yy'; did you mean 'bending_y'\?"),
    (lambda: beam(modes={"bending_y": -1}), r"modes.bending_y = -1"),
    (lambda: beam(modes={"bending_y": 1.5}), r"modes.bending_y = 1.5: must be a whole number"),
    (lambda: beam(order=4), r"order = 4: must be 0, 1, 2, 3 or \"exact\""),
    (lambda: beam(order="exakt"), r"order = 'exakt'"),
    (lambda: beam(basis="legendr"), r"basis = 'legendr': must be one of .* did you mean 'legendre'"),
    (lambda: beam(damping_ratio=-0.1), r"damping_ratio = -0.1"),
    (lambda: beam(damping_ratio=2), r"damping_ratio = 2: 2 % is 0.02; is it in per cent\?"),
    (lambda: beam(damping=1.0), r"damping has shape \(\): must be a matrix"),
    (lambda: beam(damping=[1.0, 2.0]), r"damping has shape \(2,\): must be a matrix"),
    (lambda: beam(curvature=(0, 0, 1e9), order="exact"), r"curvature = .* folds the beam"),
    (lambda: beam(curvature=(1e6, 0, 0), order="exact"), r"curvature = .* turns the beam's sections by 500000 rad"),
    (lambda: beam(gauss_points=0), r"gauss_points = 0"),
    (lambda: beam(section=0.001), r"section = 0.001: must be a Section or a Taper"),
    (lambda: beam(material=fa.Material(7850, 209e9), modes={"torsion": 1}), r"shear_modulus = not given"),
    (lambda: fa.Rectangle(0.001, -0.02), r"z = -0.02: must be positive"),
    (lambda: fa.Circle(0.01, 0.02), r"inner_radius = 0.02: must be smaller than the radius"),
    (lambda: fa.sections.GeneralSection(1.0, 1.0, 0.0, 1.0), r"second_moment_z = 0"),
    (lambda: fa.Material(-1.0, 209e9), r"density = -1"),
    (lambda: fa.Material(7850, 0.0), r"youngs_modulus = 0"),
    (lambda: fa.Material(7850, 209e9, 0.6), r"poisson_ratio = 0.6"),
    (lambda: fa.Material(7850, 209e9, 0.3, 80e9), r"shear_modulus = 8e\+10: give either"),
    (lambda: fa.RigidBody(-1.0), r"mass = -1"),
    (lambda: fa.RigidBody(1.0, (0, 0)), r"com has shape \(2,\): must be 3 numbers"),
    (lambda: fa.RigidBody(1.0, (0, 0, np.inf)), r"com = .*must be finite"),
    (lambda: fa.RigidBody(1.0, inertia=(1, 1, -1)), r"inertia = .*must not have a negative principal moment"),
    (lambda: fa.RigidBody(1.0, inertia=np.arange(9).reshape(3, 3)), r"inertia = .*must be symmetric"),
    (lambda: fa.RigidBody(1.0, inertia=(1, 1, 1, 9, 0, 0)), r"inertia = .*negative principal moment"),
    (lambda: fa.RigidBody(0.01, inertia=(1, 1, 5)), r"inertia = .*no body has the principal moments 1 1 5 kg m\^2"),
    (lambda: fa.RigidBody(0.01, inertia=(2, 2, 2, 0, 0, 1.5)), r"inertia = .*are they about the centre of mass\?"),
    (lambda: fa.RigidBody(1.0, inertia=(1, 2)), r"inertia has shape \(2,\)"),
    (lambda: fa.Revolute("w"), r"axis = 'w'"),
    (lambda: fa.Revolute((0, 0, 0)), r"axis = 0 0 0: must not be zero"),
    (lambda: fa.Link("revolute"), r"joint = 'revolute'"),
    (lambda: fa.Link(fa.Fixed(), beam=fa.RigidBody(1.0)), r"beam = RigidBody.*must be a Beam or None"),
    (lambda: fa.Arm([]), r"links = \[\]"),
    (lambda: fa.Arm([fa.Fixed()]), r"links\[0\] = Fixed\(\): must be a Link"),
    (lambda: hinged(fa.RigidBody()), r"inertia of coordinate 'link 0 revolute' = 0: must be positive"),
    (lambda: hinged(fa.RigidBody(1.0)), r"inertia of coordinate 'link 0 revolute' = 0"),
    (lambda: hinged(fa.RigidBody(), fa.RigidBody(1.0, inertia=(1, 1, 1))), r"inertia of coordinate 'link 0 revolute'"),
    (
        lambda: fa.Arm([fa.Link(fa.Fixed(), beam=beam(modes={"torsion": 1}, rotary_inertia=False))]),
        r"inertia of coordinate 'link 0 torsion 1' = 0",
    ),
    (lambda: fa.Arm([fa.Link(fa.Fixed(), fa.RigidBody(1.0))], gravity=(0, 0)), r"gravity has shape \(2,\)"),
]


@pytest.mark.parametrize(("make", "message"), PARTS)
def test_parts(make, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


CALLS = [
    (lambda a: a.forward_dynamics([0, 0, 0], np.zeros(4)), r"q has shape \(3,\): the last axis must be 4 long"),
    (lambda a: a.forward_dynamics(np.zeros(4), [0, np.nan, 0, 0]), r"v = .*must be finite"),
    (lambda a: a.forward_dynamics(np.zeros(4), np.zeros(4), method="abc"), r"method = 'abc': must be one of ab, ci"),
    (lambda a: a.forward_dynamics(np.zeros((2, 4)), np.zeros((3, 4))), r"leading axes do not fit"),
    (lambda a: a.forward_dynamics(np.zeros(4), np.zeros(4), prescribed={1: 0.0}), r"prescribed: link = 1"),
    (lambda a: a.mass_matrix("abcd"), r"q = 'abcd': must be numbers"),
    (lambda a: a.frame(np.zeros(4), link=1), r"link = 1: must be from -1 to 0"),
    (lambda a: a.frame(np.zeros(4), x=0.6), r"x = 0.6: must be on the beam"),
    (lambda a: a.strain(np.zeros(4), x=-0.1), r"x = -0.1"),
    (lambda a: a.modes(speed={0: np.inf}), r"speed = inf"),
    (lambda a: a.modes(lock=[3]), r"lock: link = 3: must be from -1 to 0"),
    (lambda a: fa.simulate(a, [0, 1, 1]), r"t\[2\] = 1: t must increase"),
    (lambda a: fa.simulate(a, [0.0]), r"t has shape \(1,\): must be one list of at least two"),
    (lambda a: fa.simulate(a, [0, np.nan]), r"t = .*must be finite"),
    (lambda a: fa.simulate(a, [0, 1], [0, 0]), r"q0 has shape \(2,\): must be 4 numbers"),
    (lambda a: fa.simulate(a, [0, 1], rtol=0), r"rtol = 0: must be positive"),
    (lambda a: fa.simulate(a, [0, 1], atol=-1e-9), r"atol = -1e-09: must be positive"),
    (lambda a: fa.simulate(a, [0, 1], max_order=6), r"max_order = 6: must be from 1 to 5"),
    (lambda a: fa.simulate(a, [0, 1], integrator="euler"), r"integrator = 'euler': must be one of ida"),
    (
        lambda a: fa.simulate(a, [0, 1], drive={0: 1.0}),
        r"drive of .link 0 revolute. = 1.0: must be a Motion or a Torque",
    ),
    (lambda a: fa.simulate(a, [0, 1], drive={2: fa.Torque(1.0)}), r"drive: link = 2"),
    (
        lambda a: fa.simulate(a, [0, 1], drive={0: fa.Torque([0, 0.5], [0, 1])}),
        r"drive of .link 0 revolute.: samples cover t = 0",
    ),
    (
        lambda a: fa.simulate(a, [0, 1], [1, 0, 0, 0], drive={0: fa.Motion.spin_up(1, 1)}),
        r"q0\[0\] = 1.0: drive of .link 0 revolute. prescribes 0.0",
    ),
    (lambda a: fa.Motion([0, 1, 1], [0, 0, 0]), r"t\[2\] = 1.0: t must increase"),
    (lambda a: fa.Motion([0, 1], [0, 0, 0]), r"q has shape \(3,\): must be 2 numbers"),
    (lambda a: fa.Motion([0, 1], [0, 0], v=[0, 0]), r"a = None: give both v and a"),
    (lambda a: fa.Torque([0, 1], [0, np.nan]), r"tau = .*must be finite"),
]


@pytest.mark.parametrize(("call", "message"), CALLS)
def test_calls(call, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        call(paper_link())


def scene() -> dict:
    return copy.deepcopy(reference("two_link_order2")["scene"])


SCENES = [
    (lambda d: d.update(gravty=1), r"scene: unknown key 'gravty'; did you mean 'gravity'\?"),
    (lambda d: d.pop("link"), r"link = None: must be a list"),
    (lambda d: d["link"][1].update(bean={}), r"link\[1\]: unknown key 'bean'; did you mean 'beam'\?"),
    (lambda d: d["link"][1]["beam"].update(lenght=1), r"link\[1\].beam: unknown key 'lenght'; did you mean 'length'\?"),
    (lambda d: d["link"][0]["beam"].update(length=-1), r"link\[0\].beam.length = -1: must be positive"),
    (lambda d: d["link"][0]["beam"].pop("length"), r"link\[0\].beam: missing length"),
    (lambda d: d["link"][0]["beam"]["section"].update(type="rectangel"), r"section.type = .*did you mean 'rectangle'"),
    (
        lambda d: d["link"][0]["beam"]["material"].update(densty=1),
        r"material: unknown key 'densty'; did you mean 'dens",
    ),
    (lambda d: d["link"][0]["hub"].update(mass=-2), r"link\[0\].hub.mass = -2"),
    (lambda d: d["link"][0]["hub"].update(inertia=[1, 1, 5]), r"link\[0\].hub.inertia = .*principal moments 1 1 5"),
    (lambda d: d["link"][1]["beam"].update(damping_ratio=2), r"link\[1\].beam.damping_ratio = 2: .*in per cent\?"),
    (lambda d: d["link"][0]["joint"].update(type="revolution"), r"link\[0\].joint.type = .*did you mean 'revolute'"),
    (lambda d: d["link"][0]["joint"].update(axis="q"), r"link\[0\].joint.axis = 'q'"),
    (lambda d: d["link"][0].pop("joint"), r"link\[0\]: missing joint"),
    (lambda d: d["link"].__setitem__(0, 7), r"link\[0\] = 7: must be a table"),
]


@pytest.mark.parametrize(("spoil", "message"), SCENES)
def test_scenes(spoil, message: str) -> None:
    d = scene()
    spoil(d)
    with pytest.raises(ValueError, match=message):
        fa.Arm.from_dict(d)


def test_scene_files(tmp_path) -> None:
    path = tmp_path / "arm.toml"
    with pytest.raises(ValueError, match=r"No such file.*shipped scenes are ist"):
        fa.load(tmp_path / "none.toml")
    path.write_text("gravity = [0, 0")
    with pytest.raises(ValueError, match=r"arm.toml.*[Uu]nclosed array"):
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
    with pytest.raises(ValueError, match=r"drive\[0\].torque.file = .*No such file"):
        fa.load(path)
    (tmp_path / "torque.csv").write_text("t,tau\n0,0\n1,2\n")
    run = fa.load(path).run()
    np.testing.assert_allclose(run.q[:, 0], run.t**3 / 3, atol=1e-7)
    path.write_text(text + "spin_up = { speed = 2.0, tim = 1.0 }")
    with pytest.raises(ValueError, match=r"drive\[0\].spin_up: unknown key 'tim'; did you mean 'time'"):
        fa.load(path)
    path.write_text(text + "torque = 1.0\n[[drive]]\nlink = 0\ntorque = 2.0")
    with pytest.raises(ValueError, match=r"drive\[1\].link = 0: is driven twice"):
        fa.load(path)
    path.write_text(text.replace("0.01", "0.3") + "torque = 1.0")
    with pytest.raises(ValueError, match=r"simulation.interval = 0.3: must divide the duration"):
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
    (lambda: fa.Material(7850, None), r"youngs_modulus = None: must be a number"),
    (lambda: beam(basis=np.zeros(3)), r"basis = \(0.0, 0.0, 0.0\): must be one of"),
    (lambda: fa.Arm.from_dict({"link": [{"joint": {"type": np.zeros(3)}}]}), r"joint.type = .*must be one of"),
    (lambda: fa.Axes(axes=5), r"axes = 5: must be a list of motions"),
    (lambda: fa.Axes(axes=None), r"axes = None: must be a list of motions"),
    (lambda: fa.Universal(stiffness=[[1, 2], [3]]), r"stiffness = .*must be numbers"),
    (lambda: fa.Universal(stiffness=np.zeros((2, 2))), r"stiffness has shape \(2, 2\)"),
    (lambda: fa.sensors.Encoder(noise=[[1, 2], [3]]), r"noise = .*must be numbers"),
    (lambda: fa.RigidBody(HUGE), r"mass = 1000.*is too large"),
    (lambda: fa.Load(force={}), r"force = {}: must be numbers"),
    (lambda: fa.Load(force="abc"), r"force = 'abc': must be numbers"),
    (lambda: fa.Load(force=[[1, 2], [3]]), r"force = \[\[1, 2\], \[3\]\]: must be numbers"),
    (lambda: fa.Load(moment=[HUGE, 0, 0]), r"moment = .*must be numbers"),
    (lambda: fa.PD(1, 1, reference=[[1, 2], [3]]), r"reference: r has shape \(1,\): must be 2"),
    (lambda: run(control=fa.PD(1, 1, reference=lambda t: "a")), r"reference at t = 0.*must be numbers"),
    (lambda: run(control=fa.LinearController.pid(1, 1, 1, rate=10, reference=lambda t: "a")), r"reference at t = 0"),
    (lambda: run(control=fa.Sampled(lambda t, y: None, 100)), r"the law gave None; must be one finite number"),
    (lambda: run(drive={0: fa.Motion(lambda t: None)}), r"at t = .* = None: must be 3 numbers; does its func"),
    (lambda: run(loads=[fa.Load(force=lambda t: None)]), r"force at t = .* = None: must be 3 numbers; does"),
    (lambda: run(control=fa.PD(1, 1, reference=lambda t: None)), r"reference at t = .* = None: must be "),
    (lambda: fa.Data([0, 1], {"t": [1, 2]}), r"'t' is the name of the times, the first argument; rename"),
    (lambda: run(control=fa.Sampled(lambda t, y: "a", 100)), r"the law gave 'a'; must be one finite number"),
    (lambda: run(control=fa.Sampled(lambda t, y: [[1], [2, 3]], 100)), r"the law gave \[\[1\], \[2, 3\]\]"),
    (lambda: fa.simulate_batch(wheel(), [0, 0.1], drive=5), r"drive = 5: must be a dictionary"),
    (lambda: fa.simulate_batch(wheel(), [0, 0.1], drive=[fa.Torque(1)]), r"drive = .*must be a dictionary"),
    (lambda: fa.simulate_batch(wheel(), [0, 0.1], drive={0: 5}), r"drive\[0\] = 5: must be a Motion"),
    (lambda: fa.simulate_batch(wheel(), [0, 0.1], loads=5), r"loads = 5: must be a list"),
    (lambda: fa.simulate_batch(wheel(), [0, 0.1], control=5), r"control = 5: must be a list"),
    (lambda: ball().modes(q=np.zeros(4)), r"q\[0:4\] = 0 0 0 0: the quaternion of link 0"),
    (lambda: ball().linearize(np.zeros(4)), r"q\[0:4\] = 0 0 0 0: the quaternion of link 0"),
    (lambda: ball().equilibrium(np.zeros(4)), r"q\[0:4\] = 0 0 0 0: the quaternion of link 0"),
    (lambda: ball().forward_derivatives(np.zeros(4), np.zeros(3)), r"q\[0:4\] = 0 0 0 0: the quaternion of link 0"),
    (lambda: paper_link().modes(speed={0: 1e200}), r"speed, q: are too large"),
    (lambda: paper_link().modes(q=[1e300] * 4), r"speed, q: are too large"),
    (lambda: wheel().modes(lock="all"), r"lock = 'all': must be a list of link numbers"),
    (lambda: wheel().equilibrium(lock="0"), r"lock = '0': must be a list of link numbers"),
    (lambda: wheel().linearize([0], lock="all"), r"lock = 'all': must be a list of link numbers"),
    (lambda: fa.Arm.from_dict({"link": NESTED}), r"nested too deeply"),
    (lambda: fa.load("a" * 5000), r"File name too long"),
]


@pytest.mark.parametrize(("call", "message"), WRONG_KINDS)
def test_wrong_kinds_are_named(call, message: str) -> None:
    with pytest.raises(ValueError, match=message) as caught:
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
    with pytest.raises(ValueError, match="sweep: is nested too deeply"):
        fa.SweepPlan.load(tmp_path / "sweep.toml")
    with pytest.raises(ValueError, match="File name too long"):
        fa.SweepPlan.load("a" * 5000)
