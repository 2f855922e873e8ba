"""Controllers in the loop, continuous and sampled."""

from __future__ import annotations

import flexarm as fa
import numpy as np
import pytest
from arms import paper_link
from messages import refuses

INTEGRATORS = (
    {"rtol": 1e-9, "atol": 1e-12},
    {"integrator": "implicit", "step": 2.5e-4},
    {"integrator": "gauss", "step": 0.02},
    {"integrator": "rk4", "step": 1e-3},
)
names = pytest.mark.parametrize("options", INTEGRATORS, ids=lambda o: o.get("integrator", "ida"))


def mass(m: float = 2.0, **joint) -> fa.Arm:
    return fa.Arm([fa.Link(fa.Prismatic("x", **joint), fa.RigidBody(m))])


def hub_arm(order: int = 2, **joint) -> fa.Arm:
    """The paper's link on a hub of its own inertia."""
    hub = fa.RigidBody(0.5, inertia=(1e-3, 1e-3, 2e-3), end=(0.075, 0, 0))
    return fa.Arm([fa.Link(fa.Revolute("z", **joint), hub, paper_link(order=order).links[0].beam)])


@names
def test_pd_on_a_mass(options: dict) -> None:
    """m q'' = kp (r - q) - kv q': closed form, and tau is the controller's force."""
    m, kp, kv, r = 2.0, 50.0, 4.0, 0.3
    t = np.linspace(0, 2, 101)
    out = fa.simulate(mass(m), t, control=fa.PD(kp, kv, reference=r), **options)
    s, w = kv / (2 * m), np.sqrt(kp / m - (kv / (2 * m)) ** 2)
    q = r * (1 - np.exp(-s * t) * (np.cos(w * t) + s / w * np.sin(w * t)))
    np.testing.assert_allclose(out.q[:, 0], q, atol=2e-7)
    np.testing.assert_allclose(out.tau[:, 0], kp * (r - out.q[:, 0]) - kv * out.v[:, 0], atol=1e-12)
    np.testing.assert_allclose(out.a[:, 0], out.tau[:, 0] / m, atol=1e-12)


@names
def test_reference_in_samples_and_callables(options: dict) -> None:
    """A ramp, as samples and as a callable; a stiff loop follows it with the lag kv/kp."""
    t = np.linspace(0, 1, 51)
    runs = [
        fa.simulate(mass(), t, control=fa.PD(800.0, 80.0, reference=r), **options)
        for r in (([0, 1], [0, 0.5]), fa.Torque([0, 1], [0, 0.5]), lambda t: 0.5 * t)
    ]
    for run in runs[1:]:
        np.testing.assert_allclose(run.q, runs[0].q, atol=1e-8)
    assert runs[0].q[-1, 0] == pytest.approx(0.5 - 0.5 * 80 / 800, abs=1e-6)


@names
def test_strain_feedback_decays_as_its_linear_model_says(options: dict) -> None:
    """Eq. 97 on the paper's link: closed-loop eigenvalues of A - B K, and the simulated ringing between two times."""
    arm = hub_arm()
    kp, kv, ks = 0.8, 0.08, -0.05
    model = arm.linearize(np.zeros(4), outputs=[("joint", 0), ("rate", 0), ("strain", 0, 0.0, "K3")])
    closed = model.A - model.B @ (np.array([[kp, kv, ks]]) @ model.C)
    w = np.linalg.eigvals(closed)
    assert w.real.max() < 0
    import scipy.linalg as la

    q0 = np.array([0.0, 1e-4, 0.0, 0.0])
    t = np.linspace(0, 0.5, 26)
    law = fa.StrainFeedback(kp, kv, ks, x=0.0)
    r = fa.simulate(arm, t, q0, control=law, **options)
    x0 = np.concatenate([q0, np.zeros(4)])
    expected = np.array([la.expm(closed * s) @ x0 for s in t])
    np.testing.assert_allclose(r.q[:, 0], expected[:, 0], atol=2e-3 * np.abs(expected[:, 0]).max())
    np.testing.assert_allclose(r.q[:, 1], expected[:, 1], atol=2e-3 * 1e-4)
    strain = r.strain(0, 0.0)[:, 2]
    np.testing.assert_allclose(r.tau[:, 0], -kp * r.q[:, 0] - kv * r.v[:, 0] - ks * strain, atol=1e-12)


def test_strain_feedback_to_the_rate_damps_every_mode_alike() -> None:
    """The hub moved so that its rate is k times the curvature at the root (direct strain feedback: Luo, IEEE Trans.
    Automatic Control 38, 1993): Re(s) = -2k/L of every mode, to first order. For k = 0.05, an independent computation
    gave -0.2000 + 20.9479j and -0.2000 + 131.2830j."""
    beam = fa.Beam(0.5, *(getattr(paper_link().links[0].beam, n) for n in ("section", "material")), {"bending_y": 8},
                   basis="legendre", rotary_inertia=False)  # fmt: skip
    arm = fa.Arm([fa.Link(fa.Revolute("z"), beam=beam)])
    model = arm.linearize(np.zeros(9), inputs=[("acceleration", 0)], outputs=[("strain", 0, 0.0, "K3")])
    rate = np.hstack([np.zeros((1, 9)), model.C[:, :9]])  # of the strain: by the rates
    s = np.linalg.eigvals(model.A + 0.05 * model.B @ rate)
    s = s[s.imag > 1][np.argsort(s[s.imag > 1].imag)]
    np.testing.assert_allclose(s[:2], [-0.2 + 20.9479j, -0.2 + 131.283j], atol=6e-5)


@names
def test_passive_loop_never_gains_energy(options: dict) -> None:
    arm = hub_arm()
    t = np.linspace(0, 1, 401)
    r = fa.simulate(arm, t, np.array([0.5, 0.02, 0, 0]), control=fa.PD(1.0, 0.01), **options)
    energy = np.sum(r.energy(), axis=0) + 0.5 * r.q[:, 0] ** 2
    assert np.diff(energy).max() < 1e-4 * energy[0] and energy[-1] < 0.9 * energy[0]


@names
@pytest.mark.parametrize("delay", [0.0, 0.02, 0.05, 0.08])
def test_sampled_loop_by_hand(options: dict, delay: float) -> None:
    """A mass under a sampled, delayed and saturated law: between its jumps the force is constant, so that the motion
    is a parabola. Sampled every 50 ms, here for one second."""
    m, period = 2.0, 0.05
    seen: list[tuple[float, float]] = []

    def law(t: float, y: np.ndarray) -> float:
        seen.append((t, float(y[0])))
        return 40.0 * (1.0 - y[0]) - 8.0 * y[1]

    control = fa.Sampled(law, 20.0, [("joint", 0), ("rate", 0)], delay=delay, limit=15.0)
    times = np.arange(21) * period
    r = fa.simulate(mass(m), times, control=control, **options)
    q, v, u, coming = 0.0, 0.0, 0.0, []
    for k in range(20):
        assert r.q[k, 0] == pytest.approx(q, abs=1e-7) and seen[k] == pytest.approx((k * period, q), abs=1e-7)
        coming.append((k * period + delay, np.clip(40 * (1 - q) - 8 * v, -15, 15)))
        at = k * period
        for change, force in [*(c for c in coming if at - 1e-9 <= c[0] < at + period - 1e-9), (at + period, None)]:
            dt = change - at if change > at else 0.0
            at = max(at, change)
            q, v = q + v * dt + u / m * dt**2 / 2, v + u / m * dt
            u = u if force is None else float(force)
    if delay == 0.0:
        assert r.tau[0, 0] == 15.0  # what is held from the first sample on
    assert len(seen) == 21


def test_samples_do_not_cost_the_fixed_step_a_restart() -> None:
    """A 1 kHz loop takes one implicit step a sample; IDA begins anew a thousand times."""
    arm = hub_arm()
    t = np.linspace(0, 0.2, 21)
    control = fa.Sampled(lambda t, y: 0.8 * (0.2 - y[0]) - 0.08 * y[1], 1000.0, [("joint", 0), ("rate", 0)])
    implicit = fa.simulate(arm, t, control=control, integrator="implicit", step=1e-3)
    assert implicit.stats["steps"] == 200 and implicit.stats["evaluations"] < 1500
    ida = fa.simulate(arm, t, control=control, integrator="ida")
    assert ida.stats["steps"] > 1000
    gauss = fa.simulate(arm, t, control=control, integrator="gauss", step=1e-3)
    assert gauss.stats["steps"] == 200
    np.testing.assert_allclose(gauss.q[:, 0], ida.q[:, 0], atol=2e-6)
    np.testing.assert_allclose(implicit.q[:, 0], ida.q[:, 0], atol=2e-4)


@names
def test_pid_holds_a_weight(options: dict) -> None:
    """The integral carries the weight: no error is left; PD alone sags by m g / kp."""
    arm = fa.Arm([fa.Link(fa.Prismatic("z"), fa.RigidBody(1.5))], gravity=(0, 0, -9.81))
    options = options | ({"integrator": "implicit", "step": 2e-3} if options.get("integrator") == "implicit" else {})
    t = np.linspace(0, 4, 41)
    pd = fa.simulate(arm, t, control=fa.PD(200.0, 30.0), **options)
    assert pd.q[-1, 0] == pytest.approx(-1.5 * 9.81 / 200, rel=1e-3)
    law = fa.LinearController.pid(200.0, 400.0, 30.0, rate=250.0, reference=0.1)
    r = fa.simulate(arm, t, control=law, **options)
    assert r.q[-1, 0] == pytest.approx(0.1, abs=2e-4)
    assert r.tau[-1, 0] == pytest.approx(1.5 * 9.81, rel=1e-2)


def test_lqr_of_the_linear_model_on_the_nonlinear_arm() -> None:
    """LQR by python-control on `linearize`, run on the nonlinear arm as continuous state feedback, and the same with an
    observer from angle and strain, sampled."""
    control = pytest.importorskip("control")
    arm = hub_arm()
    measured = [("joint", 0), ("strain", 0, 0.0, "K3")]
    model = arm.linearize(np.zeros(4), outputs=measured)
    Q = np.diag([50.0, 10, 10, 10, 1e-3, 1e-2, 1e-3, 1e-3])
    K, _, poles = control.lqr(model.A, model.B, Q, np.array([[1.0]]))
    t = np.linspace(0, 3, 301)
    q0 = np.array([-0.1, 0, 0, 0])
    r = fa.simulate(arm, t, q0, control=fa.StateFeedback(K), integrator="gauss", step=0.01)
    assert np.abs(r.q[-1]).max() < 1e-3 and np.abs(r.q[150, 0]) < 0.02
    L, _, _ = control.lqe(model.A, np.eye(8), model.C, 10.0 * np.eye(8), np.diag([1e-6, 1e-4]))
    observer = (model.A - model.B @ K - L @ model.C, L, K, np.zeros((1, 2)))  # e = reference - y, so u = K x^ of -y
    law = fa.LinearController(observer, rate=1000.0, measure=measured, method="zoh")
    s = fa.simulate(arm, t, q0, control=law, integrator="implicit", step=1e-3)
    assert np.abs(s.q[-1, 0]) < 4e-3 and np.abs(s.q[-1, 1]) < 4e-4
    assert poles.real.max() < 0


def test_linear_controller_is_its_difference_equation() -> None:
    """x+ = A x + B e, u = C x + D e, written out in Python as a Sampled law: the same run to the last digit; also with
    a reference that moves, and the state read by a sensor."""
    A, B, C, D = [[0.9, 0.1], [-0.05, 0.8]], [[0.1, 0.0], [0.0, 0.2]], [[3.0, -1.0]], [[30.0, 6.0]]
    measured = [("joint", 0), ("rate", 0)]

    def reference(t: float) -> np.ndarray:
        return np.array([0.1 * t, 0.1])

    x = np.zeros(2)

    def by_hand(t: float, y: np.ndarray) -> float:
        nonlocal x
        e = reference(t) - y
        u = np.clip(np.array(C) @ x + np.array(D) @ e, -2.0, 2.0)
        x = np.array(A) @ x + np.array(B) @ e
        return float(u[0])

    law = fa.LinearController(A, B, C, D, rate=100.0, measure=measured, reference=reference, limit=2.0, delay=3e-3)
    t = np.linspace(0, 1, 11)
    options = {"integrator": "gauss", "step": 5e-3}
    one = fa.simulate(mass(), t, control=law, **options)
    other = fa.simulate(mass(), t, control=fa.Sampled(by_hand, 100.0, measured, limit=2.0, delay=3e-3), **options)
    np.testing.assert_allclose(one.q, other.q, atol=1e-12)
    again = fa.simulate(mass(), t, control=law, **options)
    np.testing.assert_array_equal(again.q, one.q)  # nothing is left of the run before
    seen = fa.LinearController(
        A, B, C, D, rate=100.0, measure=[fa.sensors.Encoder(0, pulses=10**9), fa.sensors.Tachometer(0)],
        reference=reference, limit=2.0, delay=3e-3,
    )  # fmt: skip
    np.testing.assert_allclose(fa.simulate(arm_that_turns(), t, control=seen, **options).v.max(), 0.1, rtol=0.5)


@names
def test_continuous_controllers_with_memory(options: dict) -> None:
    """A lead-lag and an integrator around a mass: the matrix exponential of the closed loop. The controller's states do
    not show in the result."""
    import scipy.linalg as la

    m, t = 2.0, np.linspace(0, 1, 21)
    A, B, C, D = (
        np.array([[0.0, 0], [0, -20]]),
        np.array([[1.0, 0], [0, 5]]),
        np.array([[40.0, 8]]),
        np.array([[90.0, 30]]),
    )
    law = fa.LinearController(A, B, C, D, measure=[("joint", 0), ("rate", 0)], reference=[0.2, 0.0])
    hits = lambda t, q, v: q[0] - 0.1 + 0 * q.size  # noqa: E731
    r = fa.simulate(mass(m), t, control=law, events=hits, **options)
    # x = [q, v, x1, x2], e = r - [q, v]
    F = np.zeros((4, 4))
    F[0, 1] = 1.0
    F[1] = np.concatenate([-D[0], C[0]]) / m
    F[2:, :2], F[2:, 2:] = -B, A
    g = np.concatenate([[0.0], D @ [0.2, 0] / m, B @ [0.2, 0]])
    rest = np.linalg.solve(F, -g)
    x = np.array([rest + la.expm(F * s) @ -rest for s in t])
    np.testing.assert_allclose(r.q[:, 0], x[:, 0], atol=3e-7)
    np.testing.assert_allclose(r.v[:, 0], x[:, 1], atol=3e-6)
    np.testing.assert_allclose(r.tau[:, 0], D @ [0.2, 0] + x @ (np.concatenate([-D[0], C[0]])), atol=3e-4)
    assert r.q.shape == (21, 1) and r.a.shape == (21, 1) and r.q_events[0].shape[1] == 1 and r.arm.nv == 1
    again = fa.simulate(mass(m), t, control=[law, fa.PD(0.0, 0.0)], **options)
    np.testing.assert_array_equal(again.q, r.q)


def test_continuous_observer_and_reference_on_the_flexible_arm() -> None:
    """Beside a sampled law, with friction, loads at the last link and a moving reference; continuous and sampled at
    10 kHz agree."""
    arm = hub_arm(coulomb=1e-3)
    measured = [("joint", 0), ("strain", 0, 0.0, "K3")]
    model = arm.linearize(np.zeros(4), outputs=measured)
    import scipy.linalg as la

    weights = np.diag([50.0, 10, 10, 10, 1e-3, 1e-2, 1e-3, 1e-3])
    K = model.B.T @ la.solve_continuous_are(model.A, model.B, weights, np.eye(1))
    noise = np.diag([1e-6, 1e-4])
    P = la.solve_continuous_are(model.A.T, model.C.T, 10.0 * np.eye(8), noise)
    L = P @ model.C.T @ np.linalg.inv(noise)
    observer = (model.A - model.B @ K - L @ model.C, L, K, np.zeros((1, 2)))
    t = np.linspace(0, 1.0, 101)
    given = {
        "loads": [fa.Load(force=(0, 0.01, 0))],
        "drive": {0: fa.Torque(1e-3)},
        "q0": [-0.05, 0, 0, 0],
    }
    kick = fa.Sampled(lambda t, y: 1e-3 * np.sin(20 * t), 100.0, [fa.sensors.Encoder(0), ("rate", 0)])

    def reference(t: float) -> np.ndarray:
        return np.array([0.05 * t, 0.0])

    law = fa.LinearController(observer, measure=measured, reference=reference)
    r = fa.simulate(arm, t, control=[kick, law], integrator="gauss", step=2e-3, **given)
    fast = fa.LinearController(observer, rate=1e4, measure=measured, reference=reference)
    other = fa.simulate(arm, t, control=[kick, fast], integrator="implicit", step=1e-4, **given)
    np.testing.assert_allclose(r.q[:, 0], other.q[:, 0], atol=2e-4)
    assert r.stats["switches"] > 0 and np.ptp(r.q[:, 0]) > 0.03


def arm_that_turns() -> fa.Arm:
    return fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, inertia=(2.0, 2.0, 2.0)))])


def test_motor() -> None:
    """Current mode: k_t n a ampere, limited. Voltage mode: it runs up to V/(k_t n) with the time constant of its
    back-EMF."""
    current = fa.Motor(0.05, 100.0, limit=2.0, rotor_inertia=1e-5)
    assert current.gain == pytest.approx(5.0) and current.reflected_inertia == pytest.approx(0.1)
    arm = fa.Arm([fa.Link(fa.Revolute("z", reflected_inertia=current.reflected_inertia))])
    t = np.linspace(0, 1, 11)
    r = fa.simulate(arm, t, control=fa.Sampled(lambda t, y: 50.0, 10.0, motor=current), rtol=1e-9)
    np.testing.assert_allclose(r.tau[:, 0], 10.0)
    volts = fa.Motor(0.05, 100.0, limit=12.0, resistance=1.5)
    for law in (fa.Sampled(lambda t, y: 50.0, 10.0, motor=volts), fa.PD(1e6, 0.0, reference=1e3, motor=volts)):
        r = fa.simulate(arm, t, control=law, integrator="gauss", step=0.01)
        free, rate = 12 / 5.0, (5.0**2 / 1.5) / 0.1
        np.testing.assert_allclose(r.v[:, 0], free * (1 - np.exp(-rate * t)), atol=1e-6)


def test_friction_and_controller() -> None:
    """Dry friction holds a controlled joint off its reference; friction and force are told apart."""
    arm = mass(1.0, coulomb=2.0)
    t = np.linspace(0, 3, 301)
    for control in (
        fa.PD(20.0, 4.0, reference=1.0),
        fa.Sampled(lambda t, y: 20 * (1 - y[0]) - 4 * y[1], 500.0, [("joint", 0), ("rate", 0)]),
    ):
        for options in ({"integrator": "gauss", "step": 0.02}, {"integrator": "implicit", "step": 1e-3}, {}):
            r = fa.simulate(arm, t, control=control, **options)
            assert r.v[-1, 0] == 0.0 and 0.0 < abs(1 - r.q[-1, 0]) <= 0.1
            assert r.tau[-1, 0] == pytest.approx(20 * (1 - r.q[-1, 0]), abs=1e-6)
            assert r.friction[-1, 0] == pytest.approx(-r.tau[-1, 0], abs=1e-6)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: fa.PD("a", 1.0), "kp = 'a'"),
        (lambda: fa.PD(np.nan, 1.0), "kp = nan"),
        (lambda: fa.PD(1.0, 1.0, reference=np.nan), "reference = nan"),
        (
            lambda: fa.PD(1.0, 1.0, reference=fa.Motion([0, 1], [0, 1]), reference_rate=1.0),
            ("reference_rate", "Motion", "reference"),
        ),
        (lambda: fa.StrainFeedback(1.0, 1.0, 1.0, strain="K9"), "strain = 'K9'"),
        (lambda: fa.Motor(1.0, np.nan), "gear_ratio = nan"),
        (lambda: fa.LinearController.pid(1.0, np.nan, 1.0, rate=10.0), "ki = nan"),
        (lambda: fa.Sampled(lambda t, y: 0.0, 10.0, actuate=[]), "actuate = []"),
        (lambda: fa.Sampled(lambda t, y: 0.0, 10.0, measure=[]), "measure = []"),
        (lambda: fa.StateFeedback([[1.0, 1.0]], actuate=0), "actuate = 0"),
        (
            lambda: fa.simulate(mass(), [0, 1], control=fa.Sampled(lambda t, y: 0.0, 1e9)),
            "rate = 1000000000.0",
        ),
        (
            lambda: fa.simulate(mass(), [0, 1], control=fa.PD(1, 1), drive={0: fa.Motion([0, 1], [0, 1])}),
            ("control[0]", "'link 0 prismatic'", "motion", "prescribed"),
        ),
        (
            lambda: fa.simulate(
                fa.Arm([fa.Link(fa.Universal(), fa.RigidBody(1, inertia=(1, 1, 1)))]), [0, 1], control=fa.PD(1, 1)
            ),
            "2 freedoms",
        ),
        (lambda: fa.PD(1.0, 1.0, limit=-1.0), "limit = -1.0"),
        (lambda: fa.simulate(mass(), [0, 1], control=fa.PD(1.0, 1.0, link=3)), "link = 3"),
        (lambda: fa.simulate(mass(), [0, 1], control=lambda t: 0), ("control =", "controller")),
        (lambda: fa.Sampled(1.0, 10.0), "law = 1.0"),
        (lambda: fa.Sampled(lambda t, y: 0.0, 0.0), "rate = 0.0"),
        (lambda: fa.Sampled(lambda t, y: 0.0, 10.0, delay=-1.0), "delay = -1.0"),
        (
            lambda: fa.simulate(mass(), [0, 1], control=fa.Sampled(lambda t, y: np.nan, 10.0)),
            ("control[0]", "t = 0.0", "[nan]"),
        ),
        (
            lambda: fa.simulate(mass(), [0, 1], control=fa.Sampled(lambda t, y: 0.0, 10.0, ["joint"])),
            "measure[0] = 'joint'",
        ),
        (lambda: fa.simulate(mass(), [0, 1], control=fa.StateFeedback([[1.0]])), "K has shape (1, 1)"),
        (
            lambda: fa.LinearController([[1.0]], [[1.0]], [[1.0]], [[1.0, 2.0]], rate=1.0, measure=[("joint", 0)]),
            "do not fit",
        ),
        (
            lambda: fa.LinearController(*[[[1.0]]] * 4, measure=[fa.sensors.Encoder(0)]),
            ("measure", "sensors", "sampled", "rate"),
        ),
        (lambda: fa.LinearController(*[[[1.0]]] * 4, measure=[("joint", 0)], delay=1.0), "delay = 1.0"),
        (lambda: fa.LinearController.pid(1.0, 1.0, 1.0), "filter_time = None"),
        (lambda: fa.Motor(0.0), "torque_constant = 0.0"),
        (lambda: fa.PD(1.0, 1.0, motor=3), "motor = 3"),
        (
            lambda: fa.simulate(
                fa.Arm([fa.Link(fa.Spherical(), fa.RigidBody(1, inertia=(1, 1, 1)))]),
                [0, 1],
                control=fa.PD(1.0, 1.0, link=(0, 1)),
            ),
            ("a ball", "angle"),
        ),
    ],
)
def test_bad_controllers(make, message: str) -> None:
    with refuses(message):
        make()


def test_piezo_patches_in_the_loop() -> None:
    """One pair of patches senses, another, by it, is driven by the rate of its charge: the first mode's decay is that
    of the linear model; the joint is held."""
    steel, pzt = fa.Material(7850, 209e9, 0.3), fa.Piezo(60.6e9, 0.3, 7500, -274e-12, permittivity=1.5e-8)
    patches = [fa.Patch(0.02, 0.07, 0.02, 2e-4, pzt, face="y"), fa.Patch(0.08, 0.1, 0.02, 2e-4, pzt, face="y")]
    beam = fa.Beam(0.5, fa.Rectangle(0.001, 0.02), steel, {"bending_y": 2}, patches=patches)
    arm = fa.Arm([fa.Link(fa.Fixed(), beam=beam)])
    model = arm.linearize(np.zeros(2), inputs=[("patch", 0, 0)], outputs=[("charge", 0, 1)])
    rate = 2000.0
    gain = 1e6  # V per A
    h = 1 / rate
    law = fa.LinearController([[0.0]], [[1.0]], [[-gain / h]], [[gain / h]], rate=rate, actuate=[("patch", 0, 0)],
                              measure=[("charge", 0, 1)])  # fmt: skip
    t = np.linspace(0, 1, 2001)
    q0 = np.array([1e-3, 0])
    r = fa.simulate(arm, t, q0, control=law, integrator="implicit", step=h)
    closed = model.A - gain * model.B @ np.hstack([np.zeros((1, 2)), model.C[:, :2]])
    slow = np.linalg.eigvals(closed)
    slow = slow[np.argmin(np.abs(slow.imag - 21.0))]
    assert slow.real < -0.3
    size = np.hypot(r.q[:, 0], r.v[:, 0] / slow.imag)
    assert np.log(size[1900] / size[800]) / (t[1900] - t[800]) == pytest.approx(slow.real, rel=0.03)
    column = fa.LinearController([[0.0]], [[1.0]], [[-gain / h]], [[gain / h]], rate=rate,
                                 actuate=[arm.patch_matrix[:, 0]], measure=[("charge", 0, 1)])  # fmt: skip
    again = fa.simulate(arm, t, q0, control=column, integrator="implicit", step=h)
    np.testing.assert_array_equal(again.q, r.q)


@names
def test_sensors_in_the_loop_see_now(options: dict) -> None:
    """An accelerometer and a force sensor, sampled while the arm moves under gravity, a load and friction: what they
    read of the result at the same times."""
    rod = fa.RigidBody(1.0, com=(0.3, 0, 0), inertia=(0, 0.03, 0.03), end=(0.6, 0, 0))
    arm = fa.Arm([fa.Link(fa.Revolute("z", coulomb=8.0), rod)], gravity=(0, -9.81, 0))
    sensors = [fa.sensors.Accelerometer(0, axis="y"), fa.sensors.ForceTorque(0)]
    seen: list[tuple[float, np.ndarray]] = []

    def law(t: float, y: np.ndarray) -> float:
        seen.append((t, y))
        return 12.0 * np.sin(5 * t)

    t = np.linspace(0, 1, 101)
    load = [fa.Load(force=(0.0, -1.0, 0.0))]
    r = fa.simulate(arm, t, control=fa.Sampled(law, 100.0, sensors), loads=load, **options)
    assert r.stats["switches"] >= 1
    y = np.array([s[1] for s in seen])
    held = np.concatenate([[0.0], 12.0 * np.sin(5 * t[:-1])])  # what acts when the sample is taken
    for k in range(1, len(t)):  # the result's row has the new force, the sample the old one
        a = arm.forward_dynamics(r.q[k], r.v[k], held[k : k + 1] + r.friction[k])
        if r.v[k, 0] == 0.0:
            continue
        expected = np.concatenate([
            np.atleast_1d(sensors[0].measure(arm, t[k], r.q[k], r.v[k], a)),
            sensors[1].measure(arm, t[k], r.q[k], r.v[k], a, loads=load),
        ])  # fmt: skip
        if np.sign(r.v[k]) == -np.sign(r.friction[k]):
            J = arm.jacobian(r.q[k])[:3].T @ [0.0, -1.0, 0.0]
            a = arm.forward_dynamics(r.q[k], r.v[k], held[k : k + 1] + r.friction[k] + J)
            expected = np.concatenate([
                np.atleast_1d(sensors[0].measure(arm, t[k], r.q[k], r.v[k], a)),
                sensors[1].measure(arm, t[k], r.q[k], r.v[k], a, loads=load),
            ])  # fmt: skip
        np.testing.assert_allclose(y[k], expected, atol=1e-6 * np.abs(y).max())
    assert y[0, 0] == pytest.approx(9.81)  # at rest, held by friction


def test_implicit_solves_strong_continuous_feedback() -> None:
    """LQR whose fastest pole is well beyond the step, and that couples the joint to every coordinate."""
    control = pytest.importorskip("control")
    arm = hub_arm()
    model = arm.linearize(np.zeros(4))
    K, _, poles = control.lqr(model.A, model.B, np.diag([1e4, 1e3, 1e3, 1e3, 1, 1, 1, 1]), np.array([[1.0]]))
    t = np.linspace(0, 0.5, 51)
    runs = [
        fa.simulate(arm, t, [-0.01, 0, 0, 0], control=fa.StateFeedback(K), integrator=i, step=1e-3)
        for i in ("implicit", "gauss")
    ]
    assert poles.real.min() < -500
    assert np.abs(runs[0].q[-1] - runs[1].q[-1]).max() < 1e-4
    assert runs[0].stats["newton_iterations"] < 8 * runs[0].stats["steps"]


def test_interrupted_inside_a_law() -> None:
    """Ctrl-C in a sampled law, in what a linear one reads, and in its reference: the result so far is kept."""

    def interrupted(t: float, y: object = None) -> float:
        if t > 0.5:
            raise KeyboardInterrupt
        return 0.0

    class Broken(fa.sensors.Tachometer):
        def sampler(self, arm, *, loads=None):
            inside = super().sampler(arm, loads=loads)

            class Late:
                def sample(self, t, q, v, a):
                    interrupted(t)
                    return inside.sample(t, q, v, a)

            return Late()

    one = [[1.0]]
    for law in (
        fa.Sampled(interrupted, 100.0),
        fa.LinearController(one, one, one, one, rate=100.0, measure=[("joint", 0)], reference=interrupted),
        fa.LinearController(one, one, one, one, rate=100.0, measure=[Broken(0)]),
        fa.LinearController([[-1.0]], one, one, one, measure=[("joint", 0)], reference=interrupted),
    ):
        for options in ({"integrator": "implicit", "step": 1e-2}, {}):
            with pytest.raises(fa.errors.SimulationInterrupted) as caught:
                fa.simulate(arm_that_turns(), np.linspace(0, 1, 11), control=law, **options)
            assert len(caught.value.result.t) >= 5


SCENE = """
[[link]]
[link.joint]
type = "revolute"
coulomb = 0.01
reflected_inertia = 1e-3
[link.hub]
mass = 0.5
inertia = [1e-3, 1e-3, 2e-3]
end = [0.075, 0, 0]
[link.beam]
length = 0.5
section = { type = "rectangle", y = 0.001, z = 0.02 }
material = { density = 7850, youngs_modulus = 209e9, poisson_ratio = 0.3 }
modes = { bending_y = 2 }

[[control]]
type = "strain_feedback"
kp = 0.8
kv = 0.08
ks = -0.05
reference = { t = [0, 0.1, 1], r = [0, 0.3, 0.3] }
motor = { torque_constant = 0.5, limit = 3.0 }

[simulation]
duration = 1.0
integrator = "gauss"
step = 0.02
"""


def test_control_in_scene_files(tmp_path) -> None:
    path = tmp_path / "s.toml"
    path.write_text(SCENE)
    scene = fa.load(path)
    motor = fa.Motor(0.5, limit=3.0)
    law = fa.StrainFeedback(0.8, 0.08, -0.05, reference=([0, 0.1, 1], [0, 0.3, 0.3]), motor=motor)
    expected = fa.simulate(scene.arm, scene.t, control=law, integrator="gauss", step=0.02)
    np.testing.assert_array_equal(scene.run().q, expected.q)
    for old, new, message in (
        ("strain_feedback", "strain_feedbak", ("control[0].type = 'strain_feedbak'", "'strain_feedback'")),
        ("kv = 0.08", "kw = 0.08", ("control[0]", "key 'kw'")),
        ("kv = 0.08", "", ("control[0]", "missing")),
        ("kv = 0.08", "kv = 0.08\nlink = 3", ("control[0]", "link")),
        ("r = [0, 0.3, 0.3]", "s = [0, 0.3, 0.3]", "control[0].reference"),
        ("limit = 3.0", "limit = -3.0", "control[0].motor.limit = -3.0"),
    ):
        path.write_text(SCENE.replace(old, new))
        with refuses(message):
            fa.load(path)


@pytest.mark.parametrize("rate", [200.0, None])
def test_pid_follows_samples_as_the_callable_through_them(rate: float | None, tmp_path) -> None:
    """docs/control.md promises them; a list of a table and its file are the same."""
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, inertia=(0.1, 0.1, 0.1)))])
    times, values = [0.0, 0.3, 0.5, 1.0], [0.0, 0.3, 0.1, 0.2]
    given = {"rate": rate, "filter_time": 0.02}

    def run(reference) -> fa.Result:
        law = fa.LinearController.pid(5.0, 1.0, 1.0, **given, reference=reference)
        return fa.simulate(arm, np.linspace(0, 1, 51), control=law)

    expected = run(lambda t: np.interp(t, times, values))
    for reference in ((times, values), (np.array(times), np.array(values)), [times, values]):
        np.testing.assert_allclose(run(reference).q, expected.q, atol=2e-6)
    law = fa.LinearController.pid(5.0, 1.0, 1.0, **given, reference=(times, values))
    scene = fa.Scene(arm, t=np.linspace(0, 1, 51), control=(law,))
    scene.save(tmp_path / "scene.toml")
    np.testing.assert_array_equal(fa.load(tmp_path / "scene.toml").run().q, scene.run().q)
    for reference, message in (
        (([0, 1], [0, 1, 2]), "reference"),
        (([0, 0], [0, 1]), "t[1] = 0.0"),
        (([0, 0.5], [0, 1]), ("reference", "t = 0.0", "0.5", "samples")),
    ):
        with refuses(message):
            run(reference)


def test_samples_in_one_array_are_a_pair_of_rows(tmp_path) -> None:
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, (0.2, 0, 0), (0.01, 0.01, 0.01)))])
    t = np.linspace(0, 0.2, 21)
    rows = (t, 0.1 * np.sin(20 * t))
    laws = [fa.LinearController.pid(20, 5, 2, link=0, rate=200, reference=r) for r in (rows, np.array(rows))]
    fa.Scene(arm, t=t, control=(laws[1],)).save(tmp_path / "s.toml")
    pair, array = (fa.simulate(arm, t, control=law, integrator="implicit", step=1e-3) for law in laws)
    assert abs(pair.q).max() > 1e-3 and (pair.q == array.q).all()
    assert (fa.load(tmp_path / "s.toml").control[0].reference[1] == rows[1]).all()
