"""LQR, LQG, positive position feedback and integral resonant control from the linear model, against closed forms,
Riccati equations solved apart, and poles put together by hand."""

from __future__ import annotations

import flexarm as fa
import numpy as np
import pytest
import scipy.linalg as la
from messages import refuses

Y, U = 0.02, 3.0


def mass(m: float = 2.0, **joint) -> fa.Arm:
    return fa.Arm([fa.Link(fa.Prismatic("x", **joint), fa.RigidBody(m))])


def planar(links: int = 2, gravity: float = 9.81, **beam) -> fa.Arm:
    """Flexible links in a vertical plane."""
    given = {"damping_ratio": 0.01, "basis": "legendre", **beam}
    one = fa.Beam(0.5, fa.Rectangle(0.006, 0.02), fa.Material(2700, 70e9, 0.3), {"bending_y": 2}, **given)
    joint = fa.Revolute("z", reflected_inertia=0.05)
    link = fa.Link(joint, fa.RigidBody(0.3, inertia=(1e-3, 1e-3, 1e-3)), one, fa.RigidBody(0.1))
    return fa.Arm([link] * links, gravity=(0, -gravity, 0))


def spatial() -> fa.Arm:
    """Three links in space that bend both ways, undamped, one of them rigid."""
    beam = fa.Beam(0.4, fa.Rectangle(0.008, 0.01), fa.Material(2700, 70e9, 0.3), {"bending_y": 1, "bending_z": 1})
    hub = fa.RigidBody(0.5, inertia=(2e-3, 2e-3, 2e-3), end=(0.05, 0, 0))
    return fa.Arm(
        [
            fa.Link(fa.Revolute("z", reflected_inertia=0.05), hub),
            fa.Link(fa.Revolute("y", reflected_inertia=0.05), hub, beam),
            fa.Link(fa.Revolute("y", reflected_inertia=0.02), hub, beam, fa.RigidBody(0.2)),
        ],
        gravity=(0, 0, -9.81),
    )


def patched(gravity: float = 0.0) -> fa.Arm:
    """A clamped beam with a patch that acts and one on the other face that senses."""
    pzt = fa.Piezo(62e9, 0.3, 7800.0, d31=-1.8e-10, permittivity=1.5e-8)
    patches = [fa.Patch(0.01, 0.06, 0.02, 2e-4, pzt, face=face) for face in ("+y", "-y")]
    beam = fa.Beam(0.3, fa.Rectangle(0.002, 0.02), fa.Material(2700, 70e9, 0.3), {"bending_y": 3}, patches=patches,
                   damping_ratio=1e-3)  # fmt: skip
    return fa.Arm([fa.Link(fa.Fixed(), beam=beam)], gravity=(0, -gravity, 0))


# -- LQR -------------------------------------------------------------------------------------------------------------


def test_lqr_of_a_mass_is_its_closed_form() -> None:
    """min of (q/Y)² + (u/U)²: K = [U/Y, sqrt(2 m U/Y)]."""
    law = fa.lqr(mass(2.0), weights={("joint", 0): Y}, effort=U)
    np.testing.assert_allclose(law.K, [[U / Y, np.sqrt(2 * 2.0 * U / Y)]], rtol=1e-9)
    assert isinstance(law, fa.StateFeedback)


@pytest.mark.parametrize("place", [[0, 0, 0, 0, 0, 0], [0.4, 0, 0, -0.8, 0, 0]])
def test_lqr_solves_the_riccati_equation_of_the_linear_model(place: list[float]) -> None:
    """With gravity: u0 holds the arm, and K is SciPy's for the model of `linearize`."""
    arm = planar()
    law = fa.lqr(arm, place, weights={("joint", 0): 0.1, ("tip", -1): 0.02}, effort=[5.0, 2.0])
    q = arm.equilibrium(place, lock=[0, 1])
    tau = arm.inverse_dynamics(q, np.zeros(6), np.zeros(6))
    np.testing.assert_allclose(law.q0, q, atol=1e-12)
    np.testing.assert_allclose(law.u0, tau[[0, 3]], atol=1e-9)
    model = arm.linearize(q, tau=tau, outputs=[("joint", 0), ("tip", -1)])
    Q = model.C.T @ np.diag([100.0, 2500, 2500, 2500]) @ model.C
    P = la.solve_continuous_are(model.A, model.B, Q, np.diag([1 / 25, 1 / 4]))
    expected = np.diag([25, 4]) @ model.B.T @ P
    np.testing.assert_allclose(law.K, expected, atol=1e-6 * np.abs(expected).max())
    run = fa.simulate(arm, np.linspace(0, 0.1, 3), q, control=law, integrator="implicit", step=1e-3)
    assert np.abs(run.q - q).max() < 1e-9


def by_hand(A: np.ndarray, B: np.ndarray, W: np.ndarray, h: float, delay: float) -> tuple[np.ndarray, ...]:
    """The delayed plant from sample to sample, and its cost, by many short steps: state [x; outputs on their way]."""
    n, nu = B.shape
    count = int(np.ceil(delay / h - 1e-9))
    steps = 4000
    E = la.expm(h / steps * np.block([[A, B], [np.zeros((nu, n + nu))]]))
    size = n + (count + 1) * nu
    x, cost = np.eye(n, size), np.zeros((size, size))
    before = None
    for k in range(steps + 1):
        ago = max(0, int(np.ceil((delay - k * h / steps) / h - 1e-9)))  # which sample acts now
        u = np.zeros((nu, size))
        first = n + count * nu if ago == 0 else n + (ago - 1) * nu
        u[:, first : first + nu] = np.eye(nu)
        now = np.vstack([x, u])
        if before is not None:  # trapezium, on the step that has just been made
            end = np.vstack([x, before[n:]])
            cost += 0.5 / steps * (before.T @ W @ before + end.T @ W @ end)
        if k < steps:
            x = (E @ now)[:n]
        before = now
    shift, enter = np.eye(count * nu, k=-nu), np.eye(count * nu, nu)
    F = np.block([[x[:, : n + count * nu]], [np.zeros((count * nu, n)), shift]])
    return F, np.vstack([x[:, n + count * nu :], enter]), cost


@pytest.mark.parametrize("delay", [0.0, 0.004, 0.01, 0.023])
def test_sampled_lqr_knows_its_delay(delay: float) -> None:
    """A mass at 100 Hz, held inputs, none, some or several samples late: the discrete Riccati equation of a plant and a
    cost that are summed up in 4000 short steps."""
    m, h = 2.0, 0.01
    law = fa.lqr(mass(m), weights={("joint", 0): Y}, effort=U, rate=1 / h, delay=delay)
    A, B = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1 / m]])
    F, G, W = by_hand(A, B, np.diag([1 / Y**2, 0.0, 1 / U**2]), h, delay)
    n = len(F)
    P = la.solve_discrete_are(F, G, W[:n, :n], W[n:, n:], s=W[:n, n:])
    K = np.linalg.solve(W[n:, n:] + G.T @ P @ G, G.T @ P @ F + W[n:, :n])
    np.testing.assert_allclose(law.D, K[:, :2], rtol=2e-5)
    np.testing.assert_allclose(-law.C / U, K[:, 2:], rtol=1e-4, atol=1e-6)
    t = np.linspace(0, 1, 11)
    run = fa.simulate(mass(m), t, [0.01], control=law, integrator="rk4", step=1e-3)
    assert abs(run.q[-1, 0]) < 1e-4
    if delay > 0.02:  # which one who does not know of it cannot hold
        deaf = fa.lqr(mass(m), weights={("joint", 0): 1e-3}, effort=U, rate=1 / h)
        deaf.delay = delay
        knows = fa.lqr(mass(m), weights={("joint", 0): 1e-3}, effort=U, rate=1 / h, delay=delay)
        with pytest.warns(fa.errors.LoopWarning):
            grown = fa.simulate(mass(m), t, [1e-4], control=deaf, integrator="rk4", step=1e-3).q[-1, 0]
        held = fa.simulate(mass(m), t, [1e-4], control=knows, integrator="rk4", step=1e-3).q[-1, 0]
        assert abs(grown) > 1e-3 and abs(held) < 1e-5


def test_lqr_of_what_it_does_not_reach() -> None:
    """Undamped bending out of the plane of the joints is left alone; the rest decays."""
    arm = spatial()
    law = fa.lqr(arm, [0.2, 0.3, 0, 0, -0.6, 0, 0])
    q = arm.equilibrium([0.2, 0.3, 0, 0, -0.6, 0, 0], lock=[0, 1, 2])
    tau = np.where(np.isin(np.arange(7), [0, 1, 4]), arm.inverse_dynamics(q, np.zeros(7), np.zeros(7)), 0.0)
    model = arm.linearize(q, tau=tau)
    poles = np.linalg.eigvals(model.A - model.B @ law.K)
    assert poles.real.max() < 1e-6 * np.abs(poles).max()
    flat = fa.Beam(0.5, fa.Rectangle(0.006, 0.01), fa.Material(2700, 70e9, 0.3), {"bending_y": 1, "bending_z": 1})
    one = fa.Arm([fa.Link(fa.Revolute("z", reflected_inertia=0.02), beam=flat)])
    K = fa.lqr(one, weights={("joint", 0): 0.1}).K
    assert np.abs(K[0, [2, 5]]).max() < 1e-9 * np.abs(K).max() or np.abs(K[0, [1, 4]]).max() < 1e-9 * np.abs(K).max()
    slides = fa.Arm([fa.Link(fa.Prismatic("z"), fa.RigidBody(1.0)), fa.Link(fa.Prismatic("x"), fa.RigidBody(1.0))],
                    gravity=(0, 0, -9.81))  # fmt: skip
    law = fa.lqr(slides, effort=10.0)
    np.testing.assert_allclose(law.u0, [2 * 9.81, 0.0], atol=1e-9)
    np.testing.assert_allclose(law.K[0], [100, 0, np.sqrt(2 * 2.0 * 100), 0], atol=1e-6)


# -- LQG -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rate", [None, 200.0])
@pytest.mark.parametrize("delay", [0.0, 0.003, 0.005, 0.012])
def test_lqg_has_the_poles_of_regulator_and_filter(rate: float | None, delay: float) -> None:
    """The separation principle, in a loop that is put together here; the filter's poles by a Riccati equation solved
    apart."""
    if rate is None and delay:
        return
    arm, place = planar(), [0.4, 0, 0, -0.8, 0, 0]
    measured = [("joint", 0), ("joint", 1), ("strain", 0, 0.0, "K3")]
    common = {"weights": {("joint", 0): 0.1, ("joint", 1): 0.1, ("tip", -1): 0.05}, "effort": [5.0, 2.0]}
    law = fa.lqg(arm, place, measure=measured, noise=[1e-4, 1e-4, 1e-3], disturbance=[0.5, 0.2], rate=rate, delay=delay,
                 **common)  # fmt: skip
    state = fa.lqr(arm, place, rate=rate, delay=delay, **common)
    q = arm.equilibrium(place, lock=[0, 1])
    model = arm.linearize(q, tau=arm.inverse_dynamics(q, np.zeros(6), np.zeros(6)), outputs=measured)
    A, B, C, n = model.A, model.B, model.C, 12
    T = np.diag(np.r_[np.full(6, 1e-2), np.ones(6)])  # scaled, or the Riccati equation loses its digits
    A, B, C = np.linalg.solve(T, A @ T), np.linalg.solve(T, B), C @ T
    N, R = 1e-3 * B @ np.diag([0.25, 0.04]) @ B.T, np.diag([1e-8, 1e-8, 1e-6])
    if rate is None:
        P = la.solve_continuous_are(A.T, C.T, N, 1e-3 * R)
        filtering = np.linalg.eigvals(A - P @ C.T @ np.linalg.inv(1e-3 * R) @ C)
        regulating = np.linalg.eigvals(model.A - model.B @ state.K)
        closed = np.block([[A, B @ law.C], [-law.B @ C, law.A]])
    else:
        h = 1 / rate
        s, w = np.polynomial.legendre.leggauss(40)
        parts = [la.expm(A * x) @ N @ la.expm(A * x).T for x in 0.5 * h * (1 + s)]
        V = 0.5 * h * sum(a * b for a, b in zip(w, parts, strict=True))
        Ad = la.expm(A * h)
        P = la.solve_discrete_are(Ad.T, C.T, V, R)
        filtering = np.linalg.eigvals(Ad - Ad @ P @ C.T @ np.linalg.solve(C @ P @ C.T + R, C))
        F, G, _ = by_hand(A, B, np.eye(14), h, delay)
        x, p = slice(0, n), F.shape[0]
        read = np.zeros((3, p))
        read[:, x] = C
        loop = lambda c, y: np.block([[F - G @ c.D @ y, G @ c.C], [-c.B @ y, c.A]])  # noqa: E731
        closed = loop(law, read)
        whole = np.zeros((n, p))
        whole[:, x] = T
        regulating = np.linalg.eigvals(loop(state, whole))
    found, expected = np.linalg.eigvals(closed), np.r_[regulating, filtering]
    assert (found.real.max() < 0) if rate is None else (np.abs(found).max() < 1)
    scale = 1.0 if rate else np.abs(expected).max()
    for pole in expected[np.abs(expected) > (1e-2 if rate else 0)]:  # those at zero, of held outputs, are multiple
        assert np.abs(found - pole).min() < 2e-4 * scale, pole


def test_lqg_takes_a_heavy_arm_to_its_place_and_holds_it() -> None:
    """Nonlinear, sampled with delay, limited; what the filter is told of the limit keeps it from ringing."""
    arm, place = planar(), [0.4, 0, 0, -0.8, 0, 0]
    measured = [("joint", 0), ("joint", 1), ("strain", 0, 0.0, "K3")]
    law = fa.lqg(arm, place, measure=measured, rate=500, delay=2e-3, limit=8.0)
    q, start = (arm.equilibrium(x, lock=[0, 1]) for x in (place, [0.3, 0, 0, -0.7, 0, 0]))
    run = fa.simulate(arm, np.linspace(0, 4, 41), start, control=law, integrator="implicit", step=1e-3)
    assert np.abs(run.q[-1] - q).max() < 2e-3 and np.abs(run.tau[:, [0, 3]]).max() <= 8.0 + 1e-12
    at_once = fa.lqg(arm, place, measure=measured, rate=500)
    still = fa.simulate(arm, [0, 0.1], q, control=at_once, integrator="implicit", step=1e-3)
    assert np.abs(still.q[-1] - q).max() < 1e-9


# -- PPF and IRC -----------------------------------------------------------------------------------------------------


def closed(arm: fa.Arm, law: fa.LinearController) -> np.ndarray:
    model = arm.linearize(arm.zero, inputs=law.actuate, outputs=law.measure)
    return np.linalg.eigvals(np.block([[model.A, model.B @ law.C], [-law.B @ model.C, law.A]]))


@pytest.mark.parametrize("share", [0.1, 0.5])
def test_ppf_of_one_mode_has_double_poles(share: float) -> None:
    w, arm = 30.0, mass(2.0, stiffness=1800.0)
    poles = closed(arm, fa.ppf(arm, measure=[("joint", 0)], share=share))
    zeta = 0.5 * np.sqrt(share / (1 - share))
    expected = w * np.array([-zeta + 1j * np.sqrt(1 - zeta**2)] * 2)
    np.testing.assert_allclose(poles[poles.imag > 0], expected, rtol=1e-6)


@pytest.mark.parametrize("share", [0.2, 0.6])
def test_irc_of_one_mode_is_damped_as_the_locus_says(share: float) -> None:
    arm = mass(2.0, stiffness=1800.0)
    law = fa.irc(arm, measure=[("joint", 0)], share=share)
    poles = closed(arm, law)
    zeta = -poles.real / np.abs(poles)
    assert zeta[poles.imag > 0][0] == pytest.approx(0.5 * (1 / np.sqrt(1 - share) - 1), rel=1e-8)
    for other in (0.8, 1.2):  # and no other gain gives more
        p = closed(arm, fa.LinearController.irc(other * law.gain, law.feedthrough, measure=[("joint", 0)]))
        assert (-p.real / np.abs(p))[p.imag > 0][0] < zeta[poles.imag > 0][0]


def test_short_pieces_of_a_split_beam_are_held_however_stiff() -> None:
    """A piece of 5 mm has modes a million times as fast as the arm's first one."""
    pzt = fa.Piezo(62e9, 0.3, 7800, d31=-1.9e-10, permittivity=1.6e-8)
    pair = [fa.Patch(0.005, 0.055, 0.02, 3e-4, pzt, face=face) for face in ("+y", "-y")]
    strip, aluminium = fa.Rectangle(0.002, 0.02), fa.Material(2700, 70e9, 0.33)
    beam = fa.Beam(0.4, strip, aluminium, {"bending_y": 4}, "legendre", patches=pair)
    whole = fa.Link(fa.Fixed(), beam=beam)
    laws = []
    for arm, link in ((fa.Arm([whole]), 0), (fa.Arm(fa.split(whole)), 1)):
        laws.append(fa.ppf(arm, measure=[("patch_voltage", link, 1)], actuate=[("patch", link, 0)], mode=0))
    assert laws[1].frequency == pytest.approx(laws[0].frequency, rel=0.06)  # one beam is coarse there


@pytest.mark.parametrize("make", [fa.ppf, fa.irc])
def test_patches_damp_the_modes_of_a_beam(make) -> None:
    """An actuator and a sensor patch, three modes: stable at almost the whole of the gain, and not above."""
    arm = patched()
    measure, actuate = [("patch_voltage", 0, 1)], [("patch", 0, 0)]
    law = make(arm, measure=measure, actuate=actuate)
    bare = np.linalg.eigvals(arm.linearize(arm.zero).A)
    first = np.abs(bare).min()
    poles = closed(arm, law)
    near = poles[(np.abs(np.abs(poles) - first) < 0.4 * first) & (poles.imag > 0)]
    assert poles.real.max() < 0 and (-near.real / np.abs(near)).min() > 0.02
    assert closed(arm, make(arm, measure=measure, actuate=actuate, share=0.98)).real.max() < 0
    if make is fa.ppf:
        gain = law.gain * 1.02 / 0.3
        above = fa.LinearController.ppf(law.frequency, law.damping_ratio, gain, measure=measure, actuate=actuate)
        assert closed(arm, above).real.max() > 0
    second = make(arm, measure=measure, actuate=actuate, mode=1)
    damped = closed(arm, second)
    speeds = np.sort(np.abs(bare))[::2]
    near = damped[(np.abs(np.abs(damped) - speeds[1]) < 0.3 * speeds[1]) & (damped.imag > 0)]
    assert (-near.real / np.abs(near)).min() > 5e-3


def test_static_strain_is_the_reference_of_a_sagging_arm() -> None:
    arm = patched(9.81)
    q = arm.equilibrium()
    for make in (fa.ppf, fa.irc):
        law = make(arm, measure=[("patch_voltage", 0, 1)], actuate=[("patch", 0, 0)])
        assert law.reference == pytest.approx(arm.patch_voltage(q, 0, 1)) and law.reference != 0.0
        run = fa.simulate(arm, [0, 0.05], q, control=law, integrator="implicit", step=1e-3)
        assert np.abs(run.q[-1] - q).max() < 1e-9


PATCHES = {"measure": [("patch_voltage", 0, 1)], "actuate": [("patch", 0, 0)]}


# -- bad input -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: fa.lqr(planar(), weights={}), "weights = {}"),
        (lambda: fa.lqr(planar(), weights={("joint", 0): 0.0}), "weights[('joint', 0)] = 0.0"),
        (lambda: fa.lqr(planar(), weights={("acceleration", 0): 1.0}), "acceleration"),
        (lambda: fa.lqr(planar(), weights={("joints", 0): 1.0}), "'joint'"),
        (lambda: fa.lqr(planar(), effort=[1.0, 2.0, 3.0]), ("effort =", "2", "positive", "number")),
        (lambda: fa.lqr(planar(), effort=-1.0), "effort = -1.0"),
        (lambda: fa.lqr(planar(), actuate=[0]), ("actuate", "'link 1 revolute'")),
        (lambda: fa.lqr(patched(), actuate=[("patch", 0, 0)]), "effort"),
        (lambda: fa.lqr(planar(), rate=0.0), "rate = 0.0"),
        (lambda: fa.lqr(planar(), delay=0.1), "delay = 0.1"),
        (lambda: fa.lqr(planar(), [0.0, 1.0]), "q has shape"),
        (lambda: fa.lqr(planar(), [np.nan, 0, 0, 0, 0, 0]), "q"),
        (lambda: fa.lqr(fa.Arm([fa.Link(fa.Spherical(), fa.RigidBody(1.0, inertia=(1, 1, 1)))])), "a ball"),
        (lambda: fa.lqr(3), ("arm = 3", "Arm")),
        (lambda: fa.irc(patched(), **{**PATCHES, "measure": [("strain", 0, 0.0, "K1")]}), "share no mode"),
        (lambda: fa.lqg(planar(), measure=[]), "measure"),
        (lambda: fa.lqg(planar(), measure=[fa.sensors.Encoder(0)]), ("measure", "sensors", "linear")),
        (lambda: fa.lqg(planar(), measure=[("joint", 0)], noise=[1.0, 2.0]), ("noise =", "positive", "number")),
        (lambda: fa.lqg(planar(gravity=0.0), measure=[("strain", 0, 0.0, "K3")]), ("measure", "no solution")),
        (lambda: fa.lqg(planar(), measure=[("joint", 0)], disturbance=0.0), "disturbance = 0.0"),
        (lambda: fa.ppf(planar(1), measure=[("rate", 0)]), "rate"),
        (lambda: fa.ppf(planar(1, 0.0), measure=[("joint", 0)]), ("motion", "nothing", "lock")),
        (lambda: fa.ppf(patched(), **PATCHES, share=1.0), "share = 1.0"),
        (lambda: fa.ppf(patched(), **PATCHES, mode=3), "mode = 3"),
        (lambda: fa.irc(patched(), **{**PATCHES, "measure": [("strain", 0, 0.2, "K3")]}), "collocated"),
    ],
)  # fmt: skip
def test_bad_designs(make, message: str) -> None:
    with refuses(message):
        make()
