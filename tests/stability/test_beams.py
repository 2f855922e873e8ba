"""Models of a beam where theory says that they fail, and this program's answer there."""

import pickle

import flexarm as fa
import numpy as np
import pytest
from arms import paper_link
from messages import warns
from stability import beams

#: loads that bend beams beyond the range of their order are what is looked at here
beyond_its_range = pytest.mark.filterwarnings("ignore::flexarm.errors.RangeWarning")

LIMITS = {0: 0.25, 1: 0.25, 2: 0.3, 3: 0.65}  # rad, docs/choosing.md


def test_order_one_diverges_above_its_critical_speed_at_the_rate_of_theory() -> None:
    """Order 1 turns omega^2 into omega^2 - Omega^2: growth at sqrt(Omega^2 - 20.948766^2), and none below."""
    assert beams.growth_at_speed(1, 20.5)[0] == 0.0
    for speed in (22.0, 30.0):
        rate, tip = beams.growth_at_speed(1, speed)
        assert rate == pytest.approx(np.sqrt(speed**2 - beams.CRITICAL**2), rel=1e-3)
        assert tip > 1e-7
        for order in (0, 2):
            rate, tip = beams.growth_at_speed(order, speed)
            assert rate == 0.0 and tip < 1.1e-9


def test_order_zero_is_wrong_but_bounded() -> None:
    """It swings at the same frequency at any speed, where a beam stiffens; order 2 stiffens as published."""
    for order, found in ((0, 20.948766), (2, 21.939904)):
        arm = paper_link(order, rotary_inertia=False)
        assert arm.modes(speed={0: 10.0}, lock=[0]).frequencies[0] == pytest.approx(found, abs=2e-6)
    truth, _ = beams.spin_up("exact", 10.0)
    wrong, right = (np.abs(beams.spin_up(order, 10.0)[0] - truth).max() for order in (0, 2))
    assert 0.015 < wrong < 0.05 and right < wrong / 2


def test_monomials_lose_definiteness_and_legendre_does_not() -> None:
    """Condition 3e7 with 5 terms, 3e15 with 10, as of a Hilbert matrix without its first rows; not positive definite in
    double precision with 12."""
    assert beams.monomial_condition(5) == pytest.approx(3.07e7, rel=0.01)
    assert beams.monomial_condition(10) == pytest.approx(3.01e15, rel=0.01)
    for n in (5, 10, 12, 20, 40):
        assert beams.definite(beams.monomial_mass(n)) == (n <= 10)
        arm = beams.clamped({"bending_y": n})
        M = arm.mass_matrix(arm.zero)
        assert beams.definite(M)
        d = 1 / np.sqrt(np.diag(M))
        assert np.linalg.cond(d[:, None] * M * d) < 500 * n**4
        if n >= 10:
            assert arm.modes().frequencies[0] == pytest.approx(3.516015268500, rel=1e-11)


@pytest.mark.parametrize("n", [3, 6, 12])
def test_modes_keep_the_digits_that_eigh_loses(n: int) -> None:
    """With shear at 1e7 rad/s, (1e7/21)^2 = 2e11 times above mode 1, eigh(K, M) leaves 8 digits of it."""
    naive, ours = beams.first_frequency_errors(beams.sheared(n))
    assert 1e-9 < naive < 1e-6
    assert ours < 5e-15


@pytest.mark.parametrize("mu", [1e2, 1e4, 1e6])
def test_a_tip_a_million_times_the_link(mu: float) -> None:
    found, exact = beams.tip_mass_frequencies(mu)
    assert found[0] == pytest.approx(exact[0], rel=1e-13)
    assert found[1] == pytest.approx(exact[1], rel=1e-8)


def test_ab_keeps_digits_under_a_heavy_tip() -> None:
    """What CI leaves of tau grows faster with the tip's mass than what AB leaves."""
    ab, ci = (beams.heavy_tip_residual(1e6, method) for method in ("ab", "ci"))
    assert ab < 5e-6 and ci > 10 * ab


# -- the range of an order ---------------------------------------------------------------------------------------------


@beyond_its_range
def test_elastica() -> None:
    """PL^2/EI = 1, tip force across: w/L 0.30172077, u/L 0.05643324, slope 0.46135195 by elliptic integrals (Bisshopp &
    Drucker, Quarterly of Applied Mathematics 3, 1945); exact meets it, order 2 misses it by 3 %."""
    arm = beams.clamped({"bending_y": 8}, "exact", fa.RigidBody(1e-9))
    p, R = arm.frame(arm.equilibrium(loads=beams.LOADS["tip force"](1.0)))
    np.testing.assert_allclose([p[1], 1 - p[0], np.arcsin(R[1, 0])], [0.30172077, 0.05643324, 0.46135195], atol=2e-8)
    angle, error = beams.static_error(2, "tip force", np.array([1.0]))[0]
    assert angle > LIMITS[2] and 0.03 < error < 0.04


@beyond_its_range
@pytest.mark.parametrize("order", [0, 1, 2, 3])
@pytest.mark.parametrize("load", beams.LOADS)
def test_within_its_range_an_order_is_good_for_two_per_cent(order: int, load: str) -> None:
    rows = beams.static_error(order, load, np.geomspace(0.05, 5.0, 16))
    within = rows[:, 0] <= LIMITS[order]
    assert within.sum() >= 3 and (rows[within, 1] < 0.02).all()
    if load == "force against moment" and order < 3:  # where these fare worst: the limit is not far inside
        assert rows[rows[:, 0] < 1.5 * LIMITS[order], 1].max() > 0.02


def bent(order: int | str, tip: float) -> tuple[fa.Arm, np.ndarray]:
    """The paper's link bent by about `tip` of its length in its first mode."""
    return paper_link(order), np.array([0.0, 0.5 * tip, 0.0, 0.0])


@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_a_run_out_of_range_warns(order: int) -> None:
    """A mode 1 of tip deflection w has a slope of 1.376505 w/L at the tip."""
    t = np.linspace(0, 0.02, 5)
    hold = {0: fa.Motion([0.0, 1.0], [0.0, 0.0])}
    limit = LIMITS[order]
    arm, q0 = bent(order, 0.97 * limit / 1.376505)
    fa.simulate(arm, t, q0, drive=hold)  # warnings are errors here
    arm, q0 = bent(order, 1.05 * limit / 1.376505)
    with warns(fa.errors.RangeWarning, "link 0", f"order {order}", "order =") as caught:
        fa.simulate(arm, t, q0, drive=hold)
    w = caught[0].message
    assert caught[0].filename == __file__  # it points at the caller
    assert (w.link, w.time, w.finding.limit) == (0, 0.0, limit)
    assert w.finding.value == pytest.approx(1.05 * limit, rel=2e-2)
    twin = pickle.loads(pickle.dumps(w))
    assert str(twin) == str(w) and vars(twin) == vars(w)


@pytest.mark.parametrize(("rotation", "orders"), [(0.28, '2, 3 or "exact"'), (0.6, '3 or "exact"'), (0.9, '"exact"')])
def test_only_orders_that_are_good_for_it_are_named(rotation: float, orders: str) -> None:
    arm, q = bent(1, rotation / 1.376505)
    with warns(fa.errors.RangeWarning, f"order = {orders}"):
        fa.simulate(arm, [0, 1e-4], q, drive={0: fa.Motion([0.0, 1.0], [0.0, 0.0])})


def test_exact_never_warns() -> None:
    arm, q0 = bent("exact", 0.7)
    fa.simulate(arm, np.linspace(0, 0.01, 5), q0, drive={0: fa.Motion([0.0, 1.0], [0.0, 0.0])})


def test_torsion_alone_moves_no_tip_and_does_not_warn() -> None:
    beam = fa.Beam(0.5, fa.Circle(0.002), fa.Material(7850, 209e9, 0.3), {"bending_y": 1, "torsion": 1})
    arm = fa.Arm([fa.Link(fa.Fixed(), beam=beam)])
    fa.simulate(arm, np.linspace(0, 1e-3, 5), [0.0, 1.0])
    with pytest.warns(fa.errors.RangeWarning):  # bending below its limit, but turned by the twist
        fa.simulate(arm, np.linspace(0, 1e-3, 5), [0.5 * 0.25 / 1.376505, 1.0])


def test_the_worst_link_is_named_and_the_others_counted() -> None:
    link = paper_link().links[0]
    arm = fa.Arm([link, fa.Link(fa.Fixed(), beam=link.beam)])
    with warns(fa.errors.RangeWarning, "link 1", "order 2"):
        fa.simulate(arm, [0, 1e-3], [0, 0.12, 0, 0, 0.2, 0, 0])


def test_the_rotation_is_the_integral_of_the_strains() -> None:
    modes = {"bending_y": 2, "bending_z": 3, "torsion": 2, "shear_y": 1}
    arm = beams.clamped(modes, 1, rotary_inertia=True)
    x, w = np.polynomial.legendre.leggauss(12)
    at = 0.4
    K = sum(at / 2 * w_ * arm.strain(np.eye(arm.nq), 0, at * (x_ + 1) / 2)[:, :3] for x_, w_ in zip(x, w, strict=True))
    np.testing.assert_allclose(arm.links[0].beam._core.turns([at]), K.T, atol=1e-14)
