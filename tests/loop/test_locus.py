"""Root loci, limits of gains, rates, delays and payloads; modes and shapers of closed loops; bad input."""

from __future__ import annotations

import control as ct
import flexarm as fa
import numpy as np
import pytest
from arms import STEEL, paper_link
from messages import refuses
from scipy.optimize import brentq

INERTIA = 0.35


def rigid() -> fa.Arm:
    return fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, (0.5, 0, 0), (0, 0, 0.1), (1, 0, 0)))])


def sampled_pd(kp: float, kd: float, rate: float) -> fa.Sampled:
    return fa.Sampled(lambda t, y: -INERTIA * (kp * y[0] + kd * y[1]), rate, [("joint", 0), ("rate", 0)])


def damper(share: float, rate: float = 100.0, delay: float = 0.0) -> fa.LinearController:
    """Sampled, kd period / inertia = share."""
    none = np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0))
    return fa.LinearController(*none, [[share * INERTIA * rate]], rate=rate, measure=[("rate", 0)], delay=delay)


def test_a_sampled_damper_is_lost_at_two() -> None:
    """z = 1 - kd h / I: by the gain, by the matrix's entry, by the rate, by the inertia."""
    loop = fa.closed_loop(rigid(), damper(0.5))
    lost = loop.limits()
    assert lost.stable and lost.low == 0.0 and lost.high == pytest.approx(4.0, rel=1e-9)
    assert lost.frequencies[1] == pytest.approx(np.pi * 100, rel=1e-6)
    assert str(lost) == "the gains: unstable above 4 times their value (lost at 314.2 rad/s)"
    assert loop.margins[0].gain[1] == pytest.approx(4.0, rel=1e-9)
    assert loop.limits("control.0.D.0.0").high == pytest.approx(4 * 0.5 * INERTIA * 100, rel=1e-9)
    assert loop.limits("control.0.rate").low == pytest.approx(25.0, rel=1e-9)
    assert loop.limits("link.0.hub.mass").high == np.inf
    # z^2 - z + k = 0 with a period's delay: k < 1, |z|^2 = k
    late = fa.closed_loop(rigid(), damper(0.25, delay=0.01))
    assert late.limits().high == pytest.approx(4.0, rel=1e-9)
    unstable = fa.closed_loop(rigid(), damper(2.5)).limits()
    assert not unstable.stable and unstable.high == pytest.approx(0.8, rel=1e-9)
    assert "unstable above 0.8 times" in str(fa.closed_loop(rigid(), damper(2.5)))


def test_a_delay_is_lost_where_the_polynomial_says() -> None:
    """z^2 - z + k (1 - d) z + k d = 0 of a damper that is d < 1 of a period late: |z|^2 = k d = 1."""
    assert fa.closed_loop(rigid(), damper(1.6)).limits("control.0.delay").high == pytest.approx(0.01 / 1.6, rel=1e-9)
    loop = fa.closed_loop(rigid(), damper(1.6))
    assert loop.margins[0].delay == pytest.approx(0.01 / 1.6, rel=1e-9)


def test_a_locus_follows_its_poles_and_finds_its_crossing() -> None:
    loop = fa.closed_loop(rigid(), fa.LinearController.pid(30 * INERTIA, 60 * INERTIA, 5 * INERTIA, filter_time=1e-3))
    locus = loop.locus(np.geomspace(0.05, 5.0, 81))
    assert locus.poles.shape == (81, 4) and len(locus.crossings) == 1
    # s^2 (1 + tf s) s + g (kd s^2 + (kp s + ki) (1 + tf s)): Routh
    a3, a2, a1, a0 = 1e-3, 1.0, np.array([5 + 30e-3, 0]), np.array([30 + 60e-3, 60])
    g = locus.crossings[0].value
    p = [a3, a2, g * a1[0], g * a0[0], g * a0[1]]
    roots = np.roots(p)
    assert np.abs(roots.real).min() < 1e-6 and np.abs(roots.imag).max() == pytest.approx(locus.crossings[0].frequency)
    assert (locus.stable == (locus.values > g)).all()
    steps = np.abs(np.diff(locus.poles, axis=0)) / np.maximum(np.abs(locus.poles[1:]), 1.0)
    assert steps.max() < 0.5  # no pole jumps onto another
    for k, value in enumerate(locus.values):
        assert np.sort_complex(locus.poles[k]) == pytest.approx(
            np.sort_complex(np.roots([a3, a2, *(value * np.array([a1[0], a0[0], a0[1]]))])), rel=1e-6
        )
    assert loop.margins[0].gain[0] == pytest.approx(g, rel=1e-6)


def test_payloads_rates_and_frequencies() -> None:
    """A pendulum on its head, held by PD: lost where kp is the weight's moment."""
    link = fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, (0.5, 0, 0), (0, 0, 0.1), (1, 0, 0)), tip=fa.RigidBody(0.2))
    arm = fa.Arm([link], (0, -9.81, 0))
    loop = fa.closed_loop(arm, fa.PD(10.0, 1.0), [np.pi / 2])
    assert loop.limits("link.0.tip.mass").high == pytest.approx(10.0 / 9.81 - 0.5, rel=1e-8)
    assert loop.limits("control.0.kp").low == pytest.approx((0.5 + 0.2) * 9.81, rel=1e-8)
    assert loop.limits().frequencies[0] == pytest.approx(0.0, abs=1e-3)


def test_two_channels_are_broken_one_at_a_time_and_together() -> None:
    link = fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, (0.5, 0, 0), (0, 0, 0.1), (1, 0, 0)))
    arm = fa.Arm([link, link])
    q = [0.3, 0.9]
    loop = fa.closed_loop(arm, [fa.PD(40.0, 4.0, 0), fa.PD(15.0, 1.5, 1)], q)
    model = arm.linearize(q, outputs=[("joint", 0), ("joint", 1), ("rate", 0), ("rate", 1)])
    K = np.array([[40.0, 0, 4.0, 0], [0, 15.0, 0, 1.5]])
    open_ = ct.ss(model.A, model.B, K @ model.C, np.zeros((2, 2)))
    w = np.geomspace(0.1, 100, 7)
    expected = np.moveaxis(ct.frequency_response(open_, w).frdata, 2, 0)
    assert loop.loop_gain(w) == pytest.approx(expected, rel=1e-9)
    fine = np.geomspace(0.1, 1e3, 20_000)
    least = np.linalg.svd(np.eye(2) + loop.loop_gain(fine))[1][:, -1].min()
    assert loop.robustness.value == pytest.approx(least, rel=1e-4) and loop.robustness.value < 1.0
    one = ct.ss(model.A - model.B[:, 1:] @ K[1:] @ model.C, model.B[:, :1], K[:1] @ model.C, 0.0)
    assert loop.margins[0].phase == pytest.approx(np.radians(ct.margin(one)[1]), rel=1e-5)
    assert loop.loop_gain(w, [0])[:, 0, 0] == pytest.approx(one(1j * w), rel=1e-9)
    for share in (0.999, 1.001):  # every output by 1 / (1 +- value) at once is allowed
        assert fa.closed_loop(arm, [fa.PD(40.0 * share, 4.0 * share, 0), fa.PD(15.0, 1.5, 1)], q).stable


def test_zeros_of_the_clamped_arm_and_of_the_tip() -> None:
    """From a torque to its own joint: what the arm does with that joint held; to the tip of one link: in pairs +-s."""
    arm = paper_link(1)
    loop = fa.closed_loop(arm, fa.PD(5.0, 0.1), outputs=[("joint", 0)])
    clamped = arm.modes(lock=[0]).frequencies
    up = np.sort(loop.zeros.imag[loop.zeros.imag > 0])
    assert up == pytest.approx(clamped, rel=1e-6) and np.abs(loop.zeros.real).max() < 1e-4
    held = fa.closed_loop(arm, sampled_pd(100.0, 5.0, 1000.0), outputs=[("joint", 0)])
    found = held.zeros[np.abs(held.zeros.imag) > 1e-3]
    assert len(found) == 6 and np.abs(found).max() < 1.01
    system = loop.to_control()
    assert np.sort_complex(system.poles()) == pytest.approx(np.sort_complex(loop.poles), rel=1e-6)
    assert held.to_control().dt == 1e-3
    assert np.abs(system(1j * up[0])).max() < 1e-6


def test_modes_of_a_loop_that_holds_its_joint_are_those_of_the_locked_arm() -> None:
    arm = paper_link(1)
    stiff = fa.closed_loop(arm, fa.PD(1e7, 0.0))
    locked = arm.modes(lock=[0])
    found = stiff.modes
    assert found.frequencies[:2] == pytest.approx(locked.frequencies[:2], rel=1e-4)
    shapes = arm.mode_shapes(found, 5).displacement[:, 1, 0]
    expected = arm.mode_shapes(locked, 5).displacement[:, 1, 0]
    assert np.abs(shapes / shapes[-1] - expected / expected[-1]).max() < 1e-3
    free = fa.closed_loop(arm, [])
    assert free.modes.frequencies[-3:] == pytest.approx(arm.modes().frequencies[-3:], rel=1e-8)
    assert free.modes.participation.sum(axis=0) == pytest.approx(1.0)
    assert not free.channels and free.margins == () and free.robustness.value == 1.0
    sampled = fa.closed_loop(arm, sampled_pd(40.0, 0.0, 5000.0)).modes
    assert sampled.frequencies[0] == pytest.approx(fa.closed_loop(arm, fa.PD(14.0, 0.0)).modes.frequencies[0], rel=1e-3)


def test_a_shaper_of_the_closed_loop_leaves_nothing() -> None:
    arm, t = paper_link(2), np.linspace(0, 3, 1501)
    law = fa.PD(1.0, 0.01)
    loop = fa.closed_loop(arm, law)
    move = fa.Motion([0, 0.4, 3], [0, 0.1, 0.1], [0, 0, 0], [0, 0, 0])
    left = []
    for shaper in (loop.shaper("zv"), fa.input_shaper("zv", arm.modes(lock=[0]).frequencies[0])):
        reference = np.array([shaper.shape(move)(x)[0] for x in t])
        r = fa.simulate(arm, t, control=fa.PD(1.0, 0.01, reference=(t, reference)), integrator="gauss", step=0.01)
        left.append(np.abs(r.tip_deflection()[(t > 1.0) & (t < 2.0), 1]).max())
    assert left[0] < 1e-4 < 5e-3 < left[1]
    assert loop.shaper("zvd", 2).duration > loop.shaper("zvd", [0]).duration == loop.shaper().duration
    with refuses("unstable"):
        fa.closed_loop(rigid(), fa.PD(1.0, -1.0)).shaper()
    with refuses("nothing", "rings"):
        fa.closed_loop(rigid(), fa.PD(1.0, 5.0)).shaper()


def test_python_laws_are_taken_for_their_differences() -> None:
    """A law of products and sines about a state, and one with a memory."""
    def law(t: float, y: np.ndarray) -> float:
        return -INERTIA * (30.0 * np.sin(y[0] - 0.4) + (4.0 + y[0]) * y[1] + 2.0)

    found = fa.closed_loop(rigid(), fa.Sampled(law, 200, [("joint", 0), ("rate", 0)]), [0.9])
    expected = fa.closed_loop(rigid(), sampled_pd(30.0 * np.cos(0.5), 4.9, 200))
    assert found.z == pytest.approx(expected.z, rel=1e-7)

    class Difference:
        last = None

        def __call__(self, t: float, y: np.ndarray) -> float:
            rate = 0.0 if self.last is None else (y[0] - self.last) * 200.0
            self.last = float(y[0])
            return -INERTIA * float(20.0 * y[0] + 3.0 * rate)

    own = Difference()
    loop = fa.closed_loop(rigid(), fa.Sampled(own, 200, [("joint", 0)]))
    assert own.last is None  # it was a copy that was asked
    T = 1 / 200
    poly = np.polyadd(np.polymul([1, 0], [1, -2, 1]), T**2 / 2 * np.polymul([1, 1], [20 + 3 / T, -3 / T]))
    assert np.sort_complex(loop.z) == pytest.approx(np.sort_complex(np.roots(poly)), rel=1e-4)


@pytest.mark.filterwarnings("ignore::flexarm.errors.LoopWarning")
def test_what_does_not_fit_is_named() -> None:
    arm, J = rigid(), [("joint", 0)]
    for said, bad in {
        ("control[0]", "'link 0 revolute'", "lock"): lambda: fa.closed_loop(arm, fa.PD(1, 1), lock=[0]),
        "K has shape (1, 3)": lambda: fa.closed_loop(arm, fa.StateFeedback([[1, 2, 3]])),
        "q = [nan]": lambda: fa.closed_loop(arm, fa.PD(1, 1), [np.nan]),
        "v = [inf]": lambda: fa.closed_loop(arm, fa.PD(1, 1), v=[np.inf]),
        "controller": lambda: fa.closed_loop(arm, "pd"),
        "Arm": lambda: fa.closed_loop("arm", []),
        "no common period": lambda: fa.closed_loop(
            arm, [fa.Sampled(lambda t, y: 0.0, 333.3, J), fa.Sampled(lambda t, y: 0.0, 1000 * np.pi, J)]
        ),
        ("derivative", "state"): lambda: fa.closed_loop(arm, fa.Sampled(lambda t, y: np.sign(y[0]), 50, J)),
        ("finite", "number"): lambda: fa.closed_loop(arm, fa.Sampled(lambda t, y: [1.0, 2.0], 50, J)),
        "300": lambda: fa.closed_loop(arm, fa.Sampled(lambda t, y: -y[0], 50, J, delay=30.0)),
        "'control.0.kv'": lambda: fa.closed_loop(arm, fa.PD(1, 1)).limits("control.0.kq"),
        "rate": lambda: fa.closed_loop(
            arm, fa.LinearController([[0.5]], [[1.0]], [[1.0]], [[1.0]], rate=50, measure=J)
        ).limits("control.0.rate"),
        ("numbers", "increase"): lambda: fa.closed_loop(arm, fa.PD(1, 1)).locus([1.0, 0.5]),
        ("1", "3", "inputs", "outputs"): lambda: fa.closed_loop(arm, fa.PD(1, 1), outputs=[("tip", 0)]).zeros,
        ("a ball", "angle"): lambda: fa.closed_loop(
            fa.Arm([fa.Link(fa.Spherical(), fa.RigidBody(1.0, inertia=(1, 1, 1)))]), fa.PD(1, 1, 0, 0)
        ),
        "elastic": lambda: fa.closed_loop(paper_link(), fa.PD(1, 1), v=[0, 1.0, 0, 0]),
    }.items():
        with refuses(said):
            bad()


def test_an_arm_with_a_ball_elsewhere_and_a_slider() -> None:
    beam = fa.Beam(0.5, fa.Rectangle(0.004, 0.02), STEEL, {"bending_y": 2}, damping_ratio=0.01)
    ball = fa.Link(fa.Spherical(), fa.RigidBody(1.0, (0.5, 0, 0), (0.1, 0.1, 0.1)))
    loop = fa.closed_loop(fa.Arm([ball, fa.Link(fa.Revolute("z"), beam=beam)]), fa.PD(20.0, 1.0, 1))
    assert loop.stable and loop.margins[0].phase > 0 and len(loop.poles) == 12
    arm = fa.Arm([fa.Link(fa.Prismatic("x"), fa.RigidBody(2.0)), fa.Link(fa.Revolute("z"), beam=beam)], (0, -9.81, 0))
    q = [0.1, -0.7, 0.0, 0.0]
    held = fa.closed_loop(arm, fa.PD(20.0, 1.0, 1), q, lock=[0])
    assert len(held.poles) == 6 and held.q[2] != 0.0  # the beam sags
    model = arm.linearize(held.q, tau=arm.trim(q).tau, lock=[0], inputs=[1], outputs=[("joint", 1), ("rate", 1)])
    assert np.sort_complex(held.poles) == pytest.approx(
        np.sort_complex(np.linalg.eigvals(model.A - model.B @ [[20.0, 1.0]] @ model.C)), rel=1e-7
    )


def test_the_figures(tmp_path) -> None:
    loop = fa.closed_loop(rigid(), sampled_pd(20.0, 5.0, 100.0))
    assert len(loop.plot().axes) == 4 and len(fa.closed_loop(rigid(), []).plot().axes) == 1
    fig = loop.locus(np.geomspace(0.1, 100, 30)).plot()
    assert any("crosses at 4" in t.get_text() for t in fig.axes[0].get_legend().get_texts())
    fig.savefig(tmp_path / "locus.png")


def test_a_locus_tells_how_far_it_is() -> None:
    told: list[int] = []
    fa.closed_loop(rigid(), sampled_pd(20.0, 5.0, 100.0)).locus(np.geomspace(0.1, 5, 7), progress=told.append)
    assert told == [1, 2, 3, 4, 5, 6, 7]


def test_a_short_locus_has_labels_enough(tmp_path) -> None:
    fig = fa.closed_loop(rigid(), sampled_pd(20.0, 5.0, 100.0)).locus(np.geomspace(0.1, 5, 20)).plot()
    fig.savefig(tmp_path / "locus.png")
    for axis in (fig.axes[2].yaxis, fig.axes[1].xaxis):
        assert {"0.1", "0.2", "0.5", "1", "2", "5"} <= {t.get_text() for t in axis.get_ticklabels()}


def test_a_rate_beside_another_cannot_be_varied_alone() -> None:
    loop = fa.closed_loop(rigid(), [damper(0.5), damper(0.1, rate=50.0)])
    assert loop.period == pytest.approx(0.02) and loop.stable
    with refuses("over = 'control.0.rate'", "control[1]", "50 Hz", '"rate"'):
        loop.limits("control.0.rate")
    rates = [50.0, 100.0, 200.0]  # whole ratios
    assert loop.locus(rates, "control.0.rate").stable.all()
    read = fa.closed_loop(rigid(), fa.Sampled(lambda t, y: -y[0], 100, [fa.sensors.Encoder(0, pulses=None, rate=50)]))
    with refuses("over = 'rate'", "sensor", "control[0]", "50 Hz"):
        read.limits("rate")
    # both of one gain: z = 1 - k1 twice, less what the slower one holds
    factor = loop.limits().high
    held = fa.closed_loop(rigid(), [damper(0.5 * factor), damper(0.1 * factor, rate=50.0)])
    assert np.abs(held.z).max() == pytest.approx(1.0, abs=1e-8)
    for k, m in enumerate(loop.margins):  # of two rates: found by poles
        shares = [1.0, 1.0]
        shares[k] = m.gain[1]
        edge = fa.closed_loop(rigid(), [damper(0.5 * shares[0]), damper(0.1 * shares[1], rate=50.0)])
        assert np.abs(edge.z).max() == pytest.approx(1.0, abs=1e-8)
    assert np.isnan(loop.margins[0].phase) and loop.margins[1].phase == np.inf  # that is sampled once a period


def test_zeros_to_the_tip_are_real_and_in_pairs() -> None:
    """Of a pinned beam from torque to the tip's deflection: sin kL + sinh kL = 0, s^2 = -k^4 EI/m, so that s is real
    (nonminimum phase); by a solver of its own."""
    L, h = 0.6, 0.0005
    beam = fa.Beam(L, fa.Rectangle(h, 0.02), STEEL, {"bending_y": 9}, "legendre", 1)
    arm = fa.Arm([fa.Link(fa.Revolute("z"), beam=beam)])
    loop = fa.closed_loop(arm, fa.PD(0.3, 0.01), outputs=[("tip", 0)])
    found = loop.zeros_of(0, "tip link 0 y")
    real = np.sort(found.real[(found.real > 0) & (np.abs(found.imag) < 1e-6 * np.abs(found))])
    z = brentq(lambda a: (np.sin((1 + 1j) * a) + np.sinh((1 + 1j) * a)).real, 2.0, 3.0)  # k L = (1 + i) a
    expected = 2 * (z / L) ** 2 * np.sqrt(STEEL.youngs_modulus * h**2 / 12 / STEEL.density)
    assert abs(np.sin((1 + 1j) * z) + np.sinh((1 + 1j) * z)) < 1e-9
    assert real[0] == pytest.approx(expected, rel=1e-4)
    assert np.abs(found + expected).min() < 1e-3 * expected
    with refuses("'tip link 0 y'"):
        loop.zeros_of(0, "tip link 0 yy")
    with refuses("0 to 2"):
        loop.zeros_of(0, 3)


def test_names_of_links_and_joints_are_paths() -> None:
    body, tip = fa.RigidBody(1.0, (0.5, 0, 0), (0, 0, 0.1), (1, 0, 0)), fa.RigidBody(0.2, (0.3, 0, 0), (0, 0, 0.1))
    links = [fa.Link(fa.Revolute("z"), body, name="upper"), fa.Link(fa.Revolute("z", name="elbow"), tip=tip)]
    loop = fa.closed_loop(fa.Arm(links), [fa.PD(20.0, 2.0, 0), fa.PD(10.0, 1.0, "elbow")])
    assert loop.limits("link.elbow.tip.mass")[1:4] == loop.limits("link.1.tip.mass")[1:4] == (0.2, 0.0, np.inf)
    masses = [0.1, 0.4]
    assert loop.locus(masses, "link.upper.hub.mass").poles == pytest.approx(
        loop.locus(masses, "link.0.hub.mass").poles
    )
    with refuses("'link.1.tip.mass'"):
        loop.limits("link.elbow.tip.mas")


def test_the_rate_of_a_pid_varies_and_it_is_designed_anew() -> None:
    """Of whole numbers, too; at the limit, a PID that is made for that rate is on the unit circle."""

    def loop(rate: float) -> fa.results.ClosedLoop:
        return fa.closed_loop(rigid(), fa.LinearController.pid(20, 5, 4, 0, rate=rate, delay=0.001, limit=9))

    low = loop(500).limits("control.0.rate").low
    assert 1.0 < low < 500.0
    assert np.abs(loop(low).z).max() == pytest.approx(1.0, abs=1e-7)
    assert loop(500).limits("control.0.delay").value == 0.001
    law = fa.LinearController.irc(-1, -1, measure=[("joint", 0)], rate=200)
    assert fa.closed_loop(rigid(), [fa.PD(1.0, 1.0), law]).limits("control.1.rate").value == 200.0


def test_all_rates_vary_together() -> None:
    """With both laws at one joint: z = 1 - k1 - k2, with k = share of each at this rate."""
    loop = fa.closed_loop(rigid(), [damper(0.5), damper(0.3)])
    assert loop.limits("rate").low == pytest.approx(100.0 * 0.8 / 2.0, rel=1e-9)
    two = fa.closed_loop(rigid(), [damper(0.5), damper(0.1, rate=50.0)])
    low = two.limits("rate").low  # the slower one keeps half the rate
    slow = fa.LinearController([], D=[[0.1 * INERTIA * 50.0]], rate=low / 2, measure=[("rate", 0)])
    fast = fa.LinearController([], D=[[0.5 * INERTIA * 100.0]], rate=low, measure=[("rate", 0)])
    assert np.abs(fa.closed_loop(rigid(), [fast, slow]).z).max() == pytest.approx(1.0, abs=1e-7)
    with refuses("law", "sampled"):
        fa.closed_loop(rigid(), fa.PD(1.0, 1.0)).limits("rate")
