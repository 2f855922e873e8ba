"""Derivatives of a run against complex steps of a program written apart, and against differences of runs."""

from __future__ import annotations

import pickle
import warnings
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from arms import derivative, paper_link, run_derivatives
from messages import refuses

STEEL = fa.Material(7850.0, 209e9, 0.3)


def pendulum(mass: Any, damping: Any, gravity: Any, q0: Any, torque: Any, step: float, count: int) -> Any:
    """Angle and rate after each step of the classical Runge-Kutta method: (2, count + 1), of any type of number."""
    arm, own = 0.3, 0.02

    def rate(x: Any, t: float) -> Any:
        force = torque * (1 + t) - damping * x[1] - mass * gravity * arm * np.cos(x[0])
        return np.array([x[1], force / (own + mass * arm**2)])

    x = np.array([q0, 0 * q0])
    out = [x]
    for n in range(count):
        t = n * step
        a = rate(x, t)
        b = rate(x + step / 2 * a, t + step / 2)
        c = rate(x + step / 2 * b, t + step / 2)
        d = rate(x + step * c, t + step)
        x = x + step / 6 * (a + 2 * b + 2 * c + d)
        out.append(x)
    return np.array(out).T


def test_a_pendulum_equals_complex_steps_of_another_program() -> None:
    given = {"mass": 0.7, "damping": 0.05, "gravity": 9.81, "q0": 0.4, "torque": 0.3}
    step, count = 0.01, 200
    t = step * np.arange(count + 1)
    body = fa.RigidBody(given["mass"], com=(0.3, 0, 0), inertia=(0.02, 0.02, 0.02))
    arm = fa.Arm([fa.Link(fa.Revolute("z", damping=given["damping"]), body)], gravity=(0, -given["gravity"], 0))
    torque = fa.Torque([0.0, 2.0], [given["torque"], 3 * given["torque"]])
    run = fa.simulate(arm, t, [given["q0"]], drive={0: torque}, integrator="rk4", step=step)
    np.testing.assert_allclose(run.q[:, 0], pendulum(**given, step=step, count=count)[0], atol=1e-13)

    paths = {"mass": "link.0.hub.mass", "damping": "link.0.joint.damping", "gravity": "gravity.1", "q0": "q0.0",
             "torque": "drive.0.scale"}  # fmt: skip
    found = run.sensitivities(list(paths.values()))
    for k, name in enumerate(paths):
        moved = {**given, name: given[name] + 1e-30j}
        expected = pendulum(**moved, step=step, count=count).imag / 1e-30
        expected *= {"gravity": -1.0, "torque": given["torque"]}.get(name, 1.0)
        size = np.abs(expected).max(axis=1)
        assert np.abs(found.q[k, :, 0] - expected[0]).max() < 1e-11 * size[0], name
        assert np.abs(found.v[k, :, 0] - expected[1]).max() < 1e-11 * size[1], name


def flexible(**given: Any) -> dict[str, Any]:
    """What a run of two flexible links in space is made of."""
    at = {"mass": 0.1, "length": 0.5, "damping": 0.01, "kp": 2.0, "ratio": 0.01, "start": 0.2, "peak": 0.3}
    at |= {"end": 0.1, **given}
    beams = [fa.Beam(x, fa.Rectangle(0.004, 0.01), STEEL, {"bending_y": 2, "bending_z": 1}, "legendre", "exact",
                     damping_ratio=r) for x, r in ((at["length"], at["ratio"]), (0.4, 0.01))]  # fmt: skip
    links = [fa.Link(fa.Revolute("z", damping=at["damping"]), fa.RigidBody(0.2, inertia=(1e-3,) * 3), beams[0])]
    links += [fa.Link(fa.Revolute("y"), None, beams[1], fa.RigidBody(at["mass"], inertia=(1e-4,) * 3))]
    arm = fa.Arm(links, gravity=(0, 0, -9.81))
    return {
        "arm": arm,
        "t": np.linspace(0, at["end"], 21),
        "q0": [at["start"], *[0.0] * 7],
        "drive": {0: fa.Torque([0, 0.05, 0.1], [0.0, at["peak"], 0.1])},
        "control": fa.PD(at["kp"], 0.1, 1, reference=0.3),
        "loads": [fa.Load(-1, force=(0.1, 0.2, 0.3))],
    }


PATHS = {
    "mass": "link.1.tip.mass", "length": "link.0.beam.length", "damping": "link.0.joint.damping",
    "kp": "control.0.kp", "ratio": "link.0.beam.damping_ratio", "start": "q0.0",
}  # fmt: skip


@pytest.mark.parametrize(
    "options",
    [
        {"integrator": "gauss", "step": 4e-3, "rtol": 1e-14},
        {"integrator": "rk4", "step": 2e-5},
        {"integrator": "implicit", "step": 5e-4, "rtol": 1e-13},
        {"integrator": "implicit", "step": 5e-4, "rtol": 1e-13, "spectral_radius": 0.8},
    ],
)
def test_flexible_links_equal_differences(options: dict[str, Any]) -> None:
    end = 0.02 if options["integrator"] == "rk4" else 0.1
    run = fa.simulate(**flexible(end=end), **options)
    found = run.sensitivities(list(PATHS.values()))
    np.testing.assert_array_equal(found.result.q, run.q)
    # what the runs' own iteration leaves of differences
    rough = {"q": 1e-6, "v": 1e-6, "a": 1e-4, "tau": 1e-6}
    few = ("start", "mass") if options["integrator"] == "rk4" else ("start", "mass", "length", "damping", "kp", "ratio")
    size = {"start": 0.2, "mass": 0.1, "length": 0.5, "damping": 0.01, "kp": 2.0, "ratio": 0.01}
    for name in few:
        expected = run_derivatives(lambda x, n=name: fa.simulate(**flexible(**{n: x}, end=end), **options), size[name],
                               1e-3 * size[name], ("q", "v", "a", "tau"))  # fmt: skip
        for rows, x in expected.items():
            mine = getattr(found, rows)[list(PATHS).index(name)]
            assert np.abs(mine - x).max() < rough[rows] * max(np.abs(x).max(), 1e-9), (name, rows)


@pytest.mark.parametrize("options", [{"integrator": "gauss", "step": 4e-3}, {"integrator": "rk4", "step": 5e-5},
                                     {"integrator": "implicit", "step": 5e-4, "spectral_radius": 0.9}])  # fmt: skip
def test_the_adjoint_is_the_transpose(options: dict[str, Any]) -> None:
    end = 0.02 if options["integrator"] == "rk4" else 0.1
    run = fa.simulate(**flexible(end=end), **options)
    rng = np.random.default_rng(1)
    weights = {name: rng.normal(size=getattr(run, name).shape) for name in ("q", "v", "a", "tau")}
    found = run.sensitivities(list(PATHS.values()))
    gradient = run.gradient(weights, [*PATHS.values(), "q0", "gravity", "load.0.force", "tau", "drive.0.samples"])
    for k, path in enumerate(PATHS.values()):
        parts = [(w * getattr(found, name)[k]).sum() for name, w in weights.items()]
        assert abs(gradient[path] - sum(parts)) < 5e-8 * max(np.abs(parts)), path
    assert gradient["q0"][0] == pytest.approx(gradient["q0.0"], rel=1e-9)
    assert gradient["gravity"].shape == gradient["load.0.force"].shape == (3,) and gradient["tau"].shape == (8,)

    def loss(result: fa.Result) -> tuple[float, dict[str, Any]]:
        return (weights["q"] * result.q).sum(), {"q": weights["q"]}

    by_peak = run_derivatives(lambda x: fa.simulate(**flexible(peak=x, end=end), **options), 0.3, 1e-3)["q"]
    samples = run.gradient(loss, ["drive.0.samples"])["drive.0.samples"]
    assert samples.shape == (3,) and samples[1] == pytest.approx((weights["q"] * by_peak).sum(), rel=1e-6)


@pytest.mark.parametrize("options", [{"integrator": "gauss"}, {"integrator": "implicit", "step": 1e-3}])
@pytest.mark.parametrize("last", [0, 3, 11])
def test_rows_behind_the_last_that_counts_change_nothing(options: dict[str, Any], last: int) -> None:
    run = fa.simulate(**flexible(), **options)
    weights = np.zeros(run.q.shape)
    weights[: last + 1] = np.random.default_rng(3).normal(size=(last + 1, run.q.shape[1]))
    paths = ["link.1.tip.mass", "control.0.kp", "drive.0.scale", "q0.0"]
    found, forward = run.gradient({"q": weights}, paths), run.sensitivities(paths)
    for path, by in zip(paths, (forward.q * weights).sum(axis=(1, 2)), strict=True):
        np.testing.assert_allclose(found[path], by, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("options", [{"integrator": "gauss", "step": 4e-3}, {"integrator": "implicit", "step": 1e-3}])
def test_a_prescribed_motion(options: dict[str, Any]) -> None:
    """By its scale, and by a mass: the reaction is in tau."""
    t = np.linspace(0, 0.2, 41)

    def run(scale: float, mass: float = 0.1) -> fa.Result:
        given = flexible(mass=mass)
        drive = {0: fa.Motion(t, 0.3 * np.sin(10 * t)).scaled(scale), 1: fa.Torque(0.1)}
        return fa.simulate(given["arm"], t, drive=drive, rtol=1e-14, **options)

    found = run(1.0).sensitivities(["drive.0.scale", "link.1.tip.mass"])
    weights = {name: np.random.default_rng(2).normal(size=getattr(found, name)[0].shape) for name in ("q", "v", "tau")}
    gradient = run(1.0).gradient(weights, list(found.parameters))
    for k, way in enumerate((lambda x: run(x), lambda x: run(1.0, x))):
        expected = run_derivatives(way, (1.0, 0.1)[k], (1e-3, 1e-4)[k], ("q", "v", "a", "tau"))
        for rows, x in expected.items():
            rough = {"q": 1e-6, "v": 1e-6, "a": 1e-4, "tau": 1e-6}[rows]
            assert np.abs(getattr(found, rows)[k] - x).max() < rough * np.abs(x).max(), (k, rows)
        total = [(w * getattr(found, name)[k]).sum() for name, w in weights.items()]
        assert abs(gradient[found.parameters[k]] - sum(total)) < 1e-9 * max(np.abs(total))


def test_a_controller_with_memory() -> None:
    given = {**flexible(), "control": [fa.LinearController.pid(3.0, 5.0, 0.2, 1, reference=0.3, filter_time=0.01)]}
    options = {"integrator": "gauss", "step": 4e-3}
    found = fa.simulate(**given, **options).sensitivities(["link.1.tip.mass"])

    def run(mass: float) -> fa.Result:
        return fa.simulate(**{**given, "arm": flexible(mass=mass)["arm"]}, **options)

    expected = run_derivatives(run, 0.1, 1e-4)["q"]
    assert np.abs(found.q[0] - expected).max() < 3e-8 * np.abs(expected).max()


def sticking(*by: Any, **given: float) -> fa.Result:
    """By "implicit", or an integrator and what else it is given."""
    at = {"mass": 0.1, "coulomb": 0.15, "stiction": 0.2, "scale": 1.0, "damping": 0.01, "start": 0.0, **given}
    beam = fa.Beam(0.5, fa.Rectangle(0.002, 0.02), STEEL, {"bending_y": 2}, "clamped-free", damping_ratio=0.01)
    joint = fa.Revolute("z", damping=at["damping"], coulomb=at["coulomb"], stiction=at["stiction"])
    tip = fa.RigidBody(at["mass"], inertia=(1e-4,) * 3)
    arm = fa.Arm([fa.Link(joint, fa.RigidBody(0.2, inertia=(1e-3,) * 3), beam, tip)])
    t = np.linspace(0, 1.0, 101)
    torque = fa.Torque(t, at["scale"] * 0.5 * np.sin(4 * np.pi * t))
    name, options = by or ("implicit", {"step": 1e-3, "rtol": 1e-13})
    return fa.simulate(arm, t, [at["start"], 0, 0], drive={0: torque}, integrator=name, **options)


def test_through_sticking_and_sliding() -> None:
    paths = {"mass": "link.0.tip.mass", "coulomb": "link.0.joint.coulomb", "stiction": "link.0.joint.stiction",
             "scale": "drive.0.scale", "damping": "link.0.joint.damping", "start": "q0.0"}  # fmt: skip
    run = sticking()
    assert run.stats["switches"] >= 6
    found = run.sensitivities(list(paths.values()))
    rng = np.random.default_rng(3)
    weights = {name: rng.normal(size=getattr(run, name).shape) for name in ("q", "v")}
    gradient = run.gradient(weights, list(paths.values()))
    sizes = {"mass": 0.1, "coulomb": 0.15, "stiction": 0.2, "scale": 1.0, "damping": 0.01, "start": 0.0}
    for k, (name, path) in enumerate(paths.items()):
        h = 1e-6 * (sizes[name] or 1.0)
        less, more = (sticking(**{name: sizes[name] + x}) for x in (-h, h))
        assert less.stats["switches"] == more.stats["switches"] == run.stats["switches"]
        for rows in ("q", "v"):
            expected = (getattr(more, rows) - getattr(less, rows)) / (2 * h)
            assert np.abs(getattr(found, rows)[k] - expected).max() <= 3e-6 * np.abs(expected).max(), (name, rows)
        parts = [(w * getattr(found, rows)[k]).sum() for rows, w in weights.items()]
        assert abs(gradient[path] - sum(parts)) < 5e-8 * max(np.abs(parts)), path


def test_steps_that_end_at_switches_have_the_derivatives_of_ida() -> None:
    """By differences of IDA's runs, and by its own tangents. The first switch tears the joint loose from its start, and
    the samples of the torque act until switches whose times they move."""
    paths = ["link.0.tip.mass", "link.0.joint.coulomb", "link.0.joint.stiction", "drive.0.scale", "q0.0", "v0.0"]
    exact = "ida", {"rtol": 1e-10, "atol": 1e-13}
    ida = sticking(*exact)
    tangents = ida.sensitivities(paths)
    less, more = (sticking(*exact, stiction=0.2 + x) for x in (-1e-5, 1e-5))
    by_stiction = (more.q - less.q) / 2e-5
    rng = np.random.default_rng(3)
    weights = {name: rng.normal(size=getattr(ida, name).shape) for name in ("q", "v", "a", "tau")}
    for by in (("gauss", {"step": 2e-3}), ("rk4", {"step": 2e-4})):
        run = sticking(*by)
        assert run.stats["switches"] == ida.stats["switches"] >= 6
        found = run.sensitivities(paths)
        assert np.abs(found.q[2] - by_stiction).max() < 1e-5 * np.abs(by_stiction).max()
        gradient = run.gradient(weights, [*paths, "drive.0.samples", "v0"])
        for k, path in enumerate(paths):
            for rows in ("q", "v"):
                expected, mine = (getattr(x, rows)[k][1:] for x in (tangents, found))
                assert np.abs(mine - expected).max() <= 1e-5 * np.abs(expected).max() + 1e-9, (by, path)
            parts = [(w * getattr(found, rows)[k]).sum() for rows, w in weights.items()]
            assert abs(gradient[path] - sum(parts)) <= 1e-9 * max(*np.abs(parts), 1.0), path
        scaled = gradient["drive.0.samples"] @ (0.5 * np.sin(4 * np.pi * run.t))
        assert scaled == pytest.approx(gradient["drive.0.scale"], rel=1e-9)


def turning(at: float, by: str = "gauss") -> fa.Result:
    """Two joints under friction, a law that samples and tears loose, and an event."""
    links = []
    for c in (0.1, at):
        hub = fa.RigidBody(0.3, com=(0.03, 0, 0), inertia=(1e-3, 1e-3, 2e-3), end=(0.3, 0, 0))
        links.append(fa.Link(fa.Revolute("z", coulomb=c, stiction=1.3 * c), hub))
    arm = fa.Arm(links, gravity=(0, -9.81, 0))
    law = fa.LinearController.pid(3.0, 0.0, 0.2, 0, rate=100, reference=0.3)

    def passes(t: float, q: Any, v: Any) -> float:
        return float(q[1] - v[0])

    step = {"step": 1e-3} if by != "ida" else {"rtol": 1e-10, "atol": 1e-13}
    t = np.linspace(0, 0.6, 31)
    return fa.simulate(arm, t, [-1.2, -0.2], control=law, events=passes, integrator=by, **step)


@pytest.mark.parametrize("by", ["gauss", "rk4"])
def test_switches_between_samples_and_events(by: str) -> None:
    run = turning(0.15, by)
    assert run.stats["switches"] >= 4 and len(run.t_events[0])
    found = run.sensitivities(["link.1.joint.coulomb", "link.1.joint.stiction"])
    less, more = (turning(0.15 + x, "ida") for x in (-1e-6, 1e-6))
    expected = (more.q - less.q) / 2e-6
    both = found.q[0] + 1.3 * found.q[1]
    assert np.abs(both - expected).max() < 1e-4 * np.abs(expected).max()
    times = (more.t_events[0] - less.t_events[0]) / 2e-6
    assert found.t_events[0][0] + 1.3 * found.t_events[0][1] == pytest.approx(times, rel=1e-4, abs=1e-6)
    number = {"q": np.ones(run.q.shape), "t_events": [np.ones(len(run.t_events[0]))]}
    gradient = run.gradient(number, ["link.1.joint.coulomb"])["link.1.joint.coulomb"]
    assert gradient == pytest.approx(found.q[0].sum() + found.t_events[0][0].sum(), rel=1e-9)


def test_what_is_read_of_a_run() -> None:
    """The place of the end depends on the length itself, too."""
    options = {"integrator": "gauss", "step": 4e-3}
    found = fa.simulate(**flexible(), **options).sensitivities(["link.0.beam.length"])
    mine = found.of(lambda result, _: result.frame()[0])
    expected = derivative(lambda x: fa.simulate(**flexible(length=x), **options).frame()[0], 0.5, 1e-4)
    assert mine.shape == (1, 21, 3) and np.abs(mine[0] - expected).max() < 1e-7 * np.abs(expected).max()


def test_ida_agrees_with_gauss() -> None:
    parameters = ["link.1.tip.mass", "control.0.kp", "q0.0"]
    by_gauss = fa.simulate(**flexible(), integrator="gauss", step=2e-3).sensitivities(parameters)
    run = fa.simulate(**flexible(), rtol=1e-9, atol=1e-12)
    by_ida = run.sensitivities(parameters)
    for k in range(3):
        size = np.abs(by_gauss.q[k]).max()
        assert np.abs(by_ida.q[k] - by_gauss.q[k]).max() < 1e-5 * size
    gradient = run.gradient({"q": np.ones(run.q.shape)}, parameters)
    assert gradient["q0.0"] == pytest.approx(by_ida.q[2].sum(), rel=1e-9)


def one_joint(joint: fa.Joint) -> fa.Arm:
    return fa.Arm([fa.Link(joint, fa.RigidBody(1.0, (0.1, 0, 0), (1, 1, 1)))])


@pytest.mark.parametrize(
    ("change", "parameters", "says"),
    [
        ({}, [], "parameters ="),
        ({}, "link.0.tip.mass", "parameters = 'link.0.tip.mass'"),
        ({}, ["link.0.hub.mas"], "'link.0.hub.mass'"),
        ({}, ["link.0.hub.mass", "link.0.hub.mass"], "different"),
        ({}, ["drive.7.samples"], ("7", "drive")),
        ({"arm": one_joint(fa.Spherical()), "tau": [0.1, 0, 0]}, ["tau.7"], "tau.7"),
        ({"arm": fa.Arm([one_joint(fa.Spherical()).links[0], one_joint(fa.Revolute("z", coulomb=0.1)).links[0]]),
          "integrator": "rk4"}, ["link.0.hub.mass"], "friction"),
        ({"control": fa.LinearController.pid(1.0, 0.0, 0.1, 0, rate=100)}, ["control.0.rate"], "control.0.rate"),
    ],
)
def test_what_has_no_derivative_says_so(change: dict[str, Any], parameters: Any, says: str) -> None:
    given = {"arm": one_joint(fa.Revolute("z")), "integrator": "implicit", "step": 1e-3, **change}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = fa.simulate(t=np.linspace(0, 0.1, 11), **given)
    for way in (lambda: run.sensitivities(parameters), lambda: run.gradient({"q": np.ones(run.q.shape)}, parameters)):
        with refuses(says):
            way()


@pytest.mark.parametrize(
    ("loss", "says"),
    [
        ({"q": np.ones(3)}, "loss['q'] has shape (3,)"),
        ({"x": np.ones((11, 1))}, "'x'"),
        ({}, "loss"),
        (lambda r: 1.0, "must give"),
        ({"q": np.full((11, 1), np.nan)}, "finite"),
    ],
)
def test_a_loss_of_wrong_shape(loss: Any, says: str) -> None:
    run = fa.simulate(one_joint(fa.Revolute("z")), np.linspace(0, 0.1, 11), integrator="implicit", step=1e-3)
    with refuses(says):
        run.gradient(loss, ["link.0.hub.mass"])


def test_a_result_from_a_file_has_none() -> None:
    run = fa.simulate(one_joint(fa.Revolute("z")), np.linspace(0, 0.1, 11), integrator="implicit", step=1e-3)
    with refuses("simulate"):
        pickle.loads(pickle.dumps(run)).sensitivities(["link.0.hub.mass"])


EVERY = ({"rtol": 1e-10, "atol": 1e-13}, {"integrator": "gauss", "step": 4e-3}, {"integrator": "rk4", "step": 2e-5},
         {"integrator": "implicit", "step": 5e-4, "rtol": 1e-13})  # fmt: skip
names = pytest.mark.parametrize("options", EVERY, ids=lambda o: o.get("integrator", "ida"))


def coarse(options: dict[str, Any]) -> dict[str, Any]:
    """These options for what has no fast modes."""
    return {**options, "step": 2e-3} if "step" in options else options


def event(value: Any, terminal: bool) -> Any:
    value.terminal = terminal
    return value


@names
def test_a_push_that_ends_at_a_place_has_the_closed_form(options: dict[str, Any]) -> None:
    """x = F t^2 / 2 m: T = sqrt(2 m L / F) and v(T) = sqrt(2 L F / m) depend on m, x(T) does not."""
    mass, force, place = 2.0, 3.0, 0.1
    arm = fa.Arm([fa.Link(fa.Prismatic("x"), fa.RigidBody(mass))])
    t = np.linspace(0, 1, 101)
    ends = event(lambda t, q, v: q[0] - place, True)
    found = fa.simulate(arm, t, tau=[force], events=ends, **coarse(options)).sensitivities(["link.0.hub.mass"])
    time, speed = np.sqrt(2 * mass * place / force), np.sqrt(2 * place * force / mass)
    rows = t[t < time]
    np.testing.assert_array_equal(found.result.t, rows)
    np.testing.assert_allclose(found.q[0, :, 0], -force * rows**2 / (2 * mass**2), atol=1e-8)
    np.testing.assert_allclose(found.t_events[0], [[time / (2 * mass)]], rtol=1e-6)
    np.testing.assert_allclose(found.v_events[0], [[[-speed / (2 * mass)]]], rtol=1e-6)
    np.testing.assert_allclose(found.q_events[0], 0.0, atol=1e-8)
    np.testing.assert_allclose(found.of(lambda r, _: 2.0 * r.t_events[0]), [[time / mass]], rtol=1e-6)


def watched(**given: Any) -> dict[str, Any]:
    """Two events of the flexible links: the first goes on, the second ends the run."""
    goes_on = event(lambda t, q, v: v[0] + 0.5 * np.sin(q[3]) - 0.15 - t, False)
    return {**flexible(**given), "events": [goes_on, event(lambda t, q, v: q[0] ** 2 - 0.207**2, True)]}


def stacked(result: fa.Result) -> np.ndarray:
    events = [x.ravel() for name in ("t_events", "q_events", "v_events") for x in getattr(result, name)]
    return np.concatenate([result.q.ravel(), result.tau.ravel(), *events])


@pytest.mark.parametrize("options", [EVERY[0], EVERY[1], EVERY[3]], ids=["ida", "gauss", "implicit"])
def test_rows_and_events_of_a_run_that_an_event_ended_equal_differences(options: dict[str, Any]) -> None:
    run = fa.simulate(**watched(), **options)
    assert run.status == 1 and 2 < len(run.t) < 20 and len(run.t_events[0]) > 0
    few = ("start", "mass", "kp")
    found = run.sensitivities([PATHS[name] for name in few])
    assert found.q.shape == (3, *run.q.shape) and found.result.status == 1
    rng = np.random.default_rng(2)
    weights: dict[str, Any] = {name: rng.normal(size=getattr(run, name).shape) for name in ("q", "v", "a", "tau")}
    for name in ("t_events", "q_events", "v_events"):
        weights[name] = [rng.normal(size=x.shape) for x in getattr(run, name)]
    gradient = run.gradient(weights, found.parameters)
    size = {"start": 0.2, "mass": 0.1, "kp": 2.0}
    for k, name in enumerate(few):
        expected = derivative(lambda x, n=name: stacked(fa.simulate(**watched(**{n: x}), **options)), size[name],
                              (2e-5 if "integrator" in options else 1e-4) * size[name])  # fmt: skip
        events = [x[k].ravel() for of in ("t_events", "q_events", "v_events") for x in getattr(found, of)]
        mine = np.concatenate([found.q[k].ravel(), found.tau[k].ravel(), *events])
        tail = sum(x.size for x in events)
        for part, ida in ((slice(-tail), 1e-3), (slice(-tail, None), 1e-5)):  # rows, and events
            off = np.abs(mine - expected)[part].max()
            assert off < (2e-6 if "integrator" in options else ida) * np.abs(expected[part]).max(), name
        parts = [(w * getattr(found, of)[k]).sum() for of, w in weights.items() if of in ("q", "v", "a", "tau")]
        parts += [(w * x[k]).sum() for of in ("t_events", "q_events", "v_events")
                  for w, x in zip(weights[of], getattr(found, of), strict=True)]  # fmt: skip
        assert abs(gradient[found.parameters[k]] - sum(parts)) < 5e-8 * max(np.abs(parts)), name


@names
def test_an_event_of_a_prescribed_motion(options: dict[str, Any]) -> None:
    """A motion s t^2 passes 0.1 at T = sqrt(0.1 / s), with its tip mass swinging along."""
    swings = fa.RigidBody(0.2, com=(0.2, 0, 0), inertia=(1e-3,) * 3)
    links = [fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, end=(0.3, 0, 0)))]
    arm = fa.Arm([*links, fa.Link(fa.Revolute("z", stiffness=0.1), swings)])
    drive = {0: fa.Motion(lambda t: (t**2, 2 * t, 2.0))}
    ends = event(lambda t, q, v: q[0] - 0.1, True)
    given = {"t": np.linspace(0, 0.5, 11), "events": ends, **coarse(options)}
    run = fa.simulate(arm, drive=drive, **given)
    found = run.sensitivities(["drive.0.scale"])
    time = np.sqrt(0.1)
    np.testing.assert_allclose(found.t_events[0], [[-time / 2]], rtol=1e-6)
    np.testing.assert_allclose(found.q_events[0][0, 0, 0], 0.0, atol=1e-8)
    np.testing.assert_allclose(found.v_events[0][0, 0, 0], time, rtol=1e-6)
    expected = derivative(lambda s: fa.simulate(arm, drive={0: drive[0].scaled(s)}, **given).q_events[0][0], 1.0, 1e-3)
    np.testing.assert_allclose(found.q_events[0][0, 0], expected, atol=1e-5 * np.abs(expected).max())
    if "integrator" in options:
        weights = {"q_events": [np.array([[1.0, 2.0]])], "t_events": [np.array([3.0])]}
        value = run.gradient(weights, ["drive.0.scale"])["drive.0.scale"]
        assert value == pytest.approx(found.q_events[0][0, 0] @ [1, 2] + 3 * found.t_events[0][0, 0], rel=1e-9)


def test_a_scenario_of_a_batch_that_an_event_ended_has_its_own_rows() -> None:
    arm = fa.Arm([fa.Link(fa.Prismatic("x"), fa.RigidBody(1.0))])
    ends = event(lambda t, q, v: q[0] - 0.1, True)
    masses = {"link.0.hub.mass": [1.0, 2.0]}
    runs = fa.simulate_batch(arm, np.linspace(0, 1, 101), parameters=masses, tau=[[3.0]], events=ends,
                             integrator="gauss", step=0.01)  # fmt: skip
    for run, mass in zip((runs[0], runs[1]), masses["link.0.hub.mass"], strict=True):
        found = run.sensitivities(["link.0.hub.mass"])
        assert found.q.shape == (1, *run.q.shape) and len(run.t) < 101
        np.testing.assert_allclose(found.t_events[0], [[np.sqrt(0.2 * mass / 3.0) / (2 * mass)]], rtol=1e-6)


@pytest.mark.parametrize("late", [1e-8, 1e-7, -1e-7, -1e-8])
def test_a_block_torn_loose_beside_the_end_of_a_step(late: float) -> None:
    """Just before it, or just behind it: small changes go over to another way of the friction, and made derivatives 6
    to 23 % wrong; differences of runs that do not are the truth, of the scale of the force and of the stiction."""
    step, stiction, mass, count = 0.01, 3.0, 2.0, 20
    end = 2 * count * step
    rate = stiction / (count * step * (1 + late))

    def run(scale: float, hold: float) -> fa.Result:
        arm = fa.Arm([fa.Link(fa.Prismatic("x", coulomb=1.0, stiction=hold), fa.RigidBody(mass))])
        drive = {0: fa.Torque([0.0, end], [0.0, end * rate * scale])}
        t = np.linspace(0, end, 2 * count + 1)
        return fa.simulate(arm, t, drive=drive, integrator="implicit", step=step, rtol=1e-13)

    base, h = run(1.0, stiction), 0.05 * abs(late)
    weights = np.zeros(base.q.shape)
    weights[-1] = 1.0
    paths = ["drive.0.scale", "link.0.joint.stiction"]
    found, gradient = base.sensitivities(paths), base.gradient({"q": weights}, paths)
    expected = [(run(1 + h, stiction).q - run(1 - h, stiction).q) / (2 * h),
                (run(1.0, stiction + h).q - run(1.0, stiction - h).q) / (2 * h)]  # fmt: skip
    for path, mine, theirs in zip(paths, found.q, expected, strict=True):
        assert np.abs(mine - theirs).max() < 1e-5 * np.abs(theirs).max(), path
        assert gradient[path] == pytest.approx(mine[-1, 0], rel=1e-6), path


@pytest.mark.parametrize("integrator", [fa.Implicit(1e-4), fa.Gauss(5e-4), fa.Ida(rtol=1e-9)])
def test_long_derivatives_tell_how_far_they_are(integrator: fa.Integrator) -> None:
    told: list[tuple[float, str]] = []
    paths = ["link.0.beam.length", "link.0.beam.material.youngs_modulus", "link.0.beam.material.density"]
    run = fa.simulate(paper_link(), np.linspace(0, 2, 21), v0=[1.0, 0.3, 0.0, 0.0], integrator=integrator)
    found = run.sensitivities(paths, progress=lambda *x: told.append(x))
    shares = [share for share, _ in told]
    assert shares == sorted(shares) and 0 < shares[0] and shares[-1] < 1
    if integrator.fixed:
        assert told[-1][1] == "by parameters"
        told.clear()
        gradient = run.gradient({"q": np.ones_like(run.q)}, paths, progress=lambda *x: told.append(x))
        assert [x for x in told if x[0] >= 1 / 3] == [(1 / 3, "backwards through the run"), (2 / 3, "by parameters")]
        np.testing.assert_allclose(list(gradient.values()), found.q.sum(axis=(1, 2)), rtol=1e-6)


@pytest.mark.parametrize("order", [0, 2, "exact"])
def test_each_of_many_parameters_has_the_derivative_that_it_has_alone(order: Any) -> None:
    """They share the beams that they do not touch, and the run itself where it is one of their neighbours."""
    modes = {"bending_y": 1, "bending_z": 2}
    beam = fa.Beam(0.4, fa.Circle(0.006), STEEL, modes, "legendre", order, damping_ratio=0.01)
    links = [fa.Link(fa.Revolute("zyz"[k]), fa.RigidBody(0.2, (0.1, 0, 0), (1e-3,) * 3), beam) for k in range(3)]
    arm = fa.Arm(links, gravity=(0, 0, -9.81))
    v0 = np.zeros(arm.nv)
    v0[0] = 1.0
    loads = [fa.Load(1, force=(0.1, 0.2, 0.3))]
    run = fa.simulate(arm, np.linspace(0, 0.05, 11), None, v0, loads=loads, integrator="implicit", step=1e-3)
    names = ("hub.mass", "joint.stiffness", "beam.length", "beam.material.youngs_modulus", "joint.damping", "hub.com.0")
    paths = [f"link.{k}.{name}" for name in names for k in range(3)]
    paths += ["gravity.2", "load.0.scale", "v0.0"]
    weights = {"q": np.random.default_rng(0).normal(size=run.q.shape)}
    all_rows, gradient = run.sensitivities(paths).q, run.gradient(weights, paths)
    for k, path in enumerate(paths):
        alone = run.sensitivities([path]).q[0]
        size = np.abs(alone).max()
        assert size > 0.0
        assert np.abs(all_rows[k] - alone).max() < 1e-8 * size, path
        expected = (weights["q"] * alone).sum()
        assert abs(gradient[path] - expected) < 1e-8 * np.abs(weights["q"] * alone).sum(), path


def test_derivatives_by_the_place_where_a_force_sets_in() -> None:
    """A stop that a joint strikes, and a rope that gets tight: in a step of a run, a force begins near that place."""
    body, t = fa.RigidBody(1.0, (0.5, 0, 0), 0.01 * np.eye(3), (1.0, 0, 0)), np.linspace(0, 0.6, 31)

    def stopped(upper: float) -> fa.Arm:
        return fa.Arm([fa.Link(fa.Revolute("z", upper=upper, limit_stiffness=5e3, limit_damping=1.0), body)])

    def roped(length: float) -> fa.Arm:
        rope = fa.Tendon([(0.3, 1, 0), 0], stiffness=2e4, length=length, name="rope")
        return fa.Arm([fa.Link(fa.Revolute("z"), body)], (0, -9.81, 0), [rope])

    for made, path, at in ((stopped, "link.0.joint.upper", 0.2), (roped, "strut.rope.length", 1.32)):
        def run(x: float, made: Any = made) -> fa.Result:
            return fa.simulate(made(x), t, v0=[2.0 if made is stopped else 0.0], integrator="gauss", step=1e-3)

        slope = (run(at + 1e-7).q - run(at - 1e-7).q) / 2e-7
        found, by = run(at).sensitivities([path]).q[0], run(at).gradient({"q": np.ones((31, 1))}, [path])[path]
        np.testing.assert_allclose(found, slope, atol=1e-5 * np.abs(slope).max())
        assert by == pytest.approx(slope.sum(), rel=1e-4)
