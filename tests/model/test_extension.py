"""Beams that stretch: closed forms of rods, and the balance of energy."""

import flexarm as fa
import numpy as np
import pytest
from messages import refuses, warns
from scipy.optimize import brentq

E, RHO, AREA, L = 2e9, 2000.0, 3e-4, 0.8
STUFF = fa.Material(RHO, E, 0.3)
SECTION = fa.Rectangle(0.01, 0.03)
ORDERS = (0, 1, 2, 3, "exact")


def rod(modes: dict, order: int | str = 2, basis: str = "legendre", joint=None, tip: float = 0.0, **more) -> fa.Arm:
    beam = fa.Beam(L, SECTION, STUFF, modes, basis, order, **more)
    hub = fa.RigidBody(0.1, inertia=(1e-3,) * 3)  # order 0 asks for one
    link = fa.Link(joint or fa.Fixed(), hub, beam, fa.RigidBody(tip) if tip else None)
    return fa.Arm([link], more.get("gravity", (0, 0, 0)))


@pytest.mark.parametrize(
    ("basis", "tip"),  # clamped-free modes converge slowly with a mass on the end
    [("clamped-free", 0.0), ("legendre", 0.0), ("legendre", 0.7), ("loaded", 0.0), ("loaded", 0.7)],
)
@pytest.mark.parametrize("order", ORDERS)
def test_longitudinal_frequencies(basis: str, order, tip: float) -> None:
    """beta tan beta = rho A L / m; without a mass, odd multiples of pi / 2."""
    more = {"basis_tip": fa.RigidBody(tip)} if basis == "loaded" else {}
    arm = rod({"extension": 8}, order, basis, tip=tip, **more)
    roots = [(k + 0.5) * np.pi for k in range(2)]
    if tip:
        roots = [brentq(lambda b: b * np.tan(b) - RHO * AREA * L / tip, r - np.pi / 2 + 1e-9, r - 1e-9) for r in roots]
    expected = np.array(roots) / L * np.sqrt(E / RHO)
    np.testing.assert_allclose(arm.modes().frequencies[:2], expected, rtol=1e-6)


def test_clamped_free_modes_are_the_rod_s_own() -> None:
    arm = rod({"extension": 3}, basis="clamped-free", damping_ratio=0.02)
    expected = (np.arange(3) + 0.5) * np.pi / L * np.sqrt(E / RHO)
    found = arm.modes()
    np.testing.assert_allclose(found.frequencies, expected, rtol=1e-9)
    np.testing.assert_allclose(found.damping, 0.02, rtol=1e-9)


@pytest.mark.parametrize("order", ORDERS)
def test_a_hanging_rod(order) -> None:
    """eps = (m g + rho A g (L - x)) / E A."""
    g, m = 9.81, 0.7
    beam = fa.Beam(L, SECTION, STUFF, {"extension": 2}, "legendre", order)
    hub = fa.RigidBody(0.1, inertia=(1e-3,) * 3)
    arm = fa.Arm([fa.Link(fa.Fixed(), hub, beam, fa.RigidBody(m))], (g, 0, 0))
    q = arm.equilibrium()
    for x in (0.0, 0.3, L):
        eps = (m + RHO * AREA * (L - x)) * g / (E * AREA)
        np.testing.assert_allclose(arm.strain(q, 0, x), [0, 0, 0, 0, 0, eps], rtol=1e-10, atol=1e-18)
    stretch = (m * L + RHO * AREA * L**2 / 2) * g / (E * AREA)
    assert arm.frame(q)[0][0] - L == pytest.approx(stretch, rel=1e-9)
    assert arm.deflection(q)[0] == pytest.approx(stretch, rel=1e-9)


@pytest.mark.parametrize("order", [1, 2, 3, "exact"])
def test_a_spinning_rod(order) -> None:
    """u'' = -rho w^2 (x + u) / E, u(0) = 0, u'(L) = 0."""
    w = 400.0
    beam = fa.Beam(L, SECTION, STUFF, {"bending_y": 1, "extension": 6}, "legendre", order)
    arm = fa.Arm([fa.Link(fa.Revolute("z"), None, beam)])
    found = arm.modes(speed={0: w}, lock=[0]).q
    k = w * np.sqrt(RHO / E)
    for x in (0.3, L):
        u = np.sin(k * x) / (k * np.cos(k * L)) - x
        np.testing.assert_allclose(arm.deflection(found, 0, x), [u, 0, 0], rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("modes", [{"bending_y": 2}, {"bending_y": 1, "bending_z": 1, "torsion": 1, "shear_z": 1}])
def test_energy_is_kept(order, modes: dict) -> None:
    """Of a pendulum that swings, bends and stretches by some per cent."""
    soft = fa.sections.GeneralSection(3e-5, 2.5e-6, 2.5e-6, 5e-6)
    beam = fa.Beam(L, soft, fa.Material(RHO, 2e6, 0.3), modes | {"extension": 2}, "legendre", order)
    hub = fa.RigidBody(0.1, inertia=(1e-2,) * 3)
    arm = fa.Arm([fa.Link(fa.Revolute("z"), hub, beam, fa.RigidBody(0.2, inertia=(1e-4,) * 3))], (0, -9.81, 0))
    v0 = np.zeros(arm.nv)
    v0[0] = 1.0
    run = fa.simulate(arm, np.linspace(0, 0.5, 51), v0=v0, rtol=1e-9, atol=1e-12)
    total = sum(run.energy())
    assert np.abs(run.strain(0, 0.0)[:, 5]).max() > 0.01
    assert np.ptp(total) < 1e-6 * np.ptp(run.energy()[0])


@pytest.mark.parametrize("order", [1, 2, 3, "exact"])
def test_a_stretch_that_cannot_happen_changes_nothing(order) -> None:
    """As the axis stiffens, the motion becomes that of a beam without extension."""
    modes, away = {"bending_y": 2, "shear_y": 1}, []
    section = fa.sections.GeneralSection(AREA, 6e-9, 9e-9, 4e-9)
    for area in (0.1, 10.0):
        stiff = fa.sections.GeneralSection(AREA * area, 6e-9, 9e-9, 4e-9, 0.8 / area)
        arms = []
        for s, m in ((section, modes), (stiff, modes | {"extension": 1})):
            rho = RHO * AREA / s.area
            beam = fa.Beam(L, s, fa.Material(rho, 2e7, 0.3), m, "legendre", order, rotary_inertia=False)
            hub = fa.RigidBody(0.1, inertia=(1e-2,) * 3)
            arms.append(fa.Arm([fa.Link(fa.Revolute("z"), hub, beam)], (0, -9.81, 0)))
        tips = [fa.simulate(arm, [0, 0.1, 0.2], rtol=1e-9, atol=1e-12).frame()[0][-1] for arm in arms]
        away.append(np.abs(tips[0] - tips[1]).max())
    assert away[1] < 0.02 * away[0] < 0.01 * L


def test_a_patch_on_one_side_pulls_and_couples() -> None:
    """Static, per volt: the strain and curvature of a bimaterial strip, by forces and moments of its layers."""
    h, b, t = 0.002, 0.02, 0.0005
    pzt = fa.Piezo(60e9, 0.3, 7500.0, -270e-12)
    patch = fa.Patch(0.0, 0.1, b, t, pzt, "+y")
    beam = fa.Beam(0.1, fa.Rectangle(h, b), fa.Material(7850.0, 200e9, 0.3), {"bending_y": 1, "extension": 1},
                   "legendre", patches=[patch])  # fmt: skip
    arm = fa.Arm([fa.Link(fa.Fixed(), None, beam)])
    found = arm.strain(arm.equilibrium(voltages=[1.0]), 0, 0.05)
    r = (h + t) / 2
    free = -270e-12 / t
    EA, EI = 200e9 * h * b, 200e9 * b * h**3 / 12
    area, second = b * t, b * ((h / 2 + t) ** 3 - (h / 2) ** 3) / 3
    A = np.array([[EA + 60e9 * area, -60e9 * area * r], [-60e9 * area * r, EI + 60e9 * second]])
    eps, K3 = np.linalg.solve(A, 60e9 * area * free * np.array([1.0, -r]))
    np.testing.assert_allclose(found[[5, 2]], [eps, K3], rtol=1e-10)
    assert K3 > 0 > eps


def test_a_gauge_feels_the_stretch() -> None:
    arm = rod({"bending_y": 2, "extension": 1})
    q = np.array([0.3, 0.1, 0.02])
    K3 = arm.strain(q, 0, 0.2)[2]
    for face, side in (("+y", -1), ("-y", 1)):
        found = fa.sensors.StrainGauge(0, 0.2, face).measure(arm, 0.0, q, 0 * q)
        assert float(np.squeeze(found)) == pytest.approx(side * 0.005 * K3 + 0.02)


# -- turned inside out: 1 + eps <= 0 -----------------------------------------------------------------------------------

TURNED = "rod", "inside out", "1 + eps"
HELD = fa.Motion([0.0, 0.2], [0.0, 0.0])


def spun(order, **modes: int) -> fa.Arm:
    beam = fa.Beam(L, SECTION, STUFF, modes | {"extension": 5}, "legendre", order)
    return fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(0.1, inertia=(1e-3,) * 3), beam, name="rod")])


@pytest.mark.parametrize(("order", "lock"), [(1, [0]), (2, [0]), (2, None), ("exact", [0])])
def test_no_steady_state_beyond_the_speed_that_stretches_a_rod_without_end(order, lock) -> None:
    """u'' + k^2 (x + u) = 0, k = w sqrt(rho / E): 1 + eps = cos(k (L - x)) / cos(k L), above 0 up to k L = pi / 2."""
    critical = np.pi / (2 * L) * np.sqrt(E / RHO)
    for share in (0.9, 0.99):
        q = spun(order).modes(speed={0: share * critical}, lock=lock).q
        assert 1 + spun(order).strain(q, 0, 0.0)[5] == pytest.approx(1 / np.cos(share * np.pi / 2), rel=1e-3)
    for share in (1.01, 2.0):
        with refuses("speed", TURNED):
            spun(order).modes(speed={0: share * critical}, lock=lock)


def pressed(order, g: float) -> fa.Arm:
    """A rod that stands on its clamp under its tip's weight m g: eps = -m g / E A = -g / 100, as E A = 600 N."""
    beam = fa.Beam(L, SECTION, fa.Material(1e-6, 2e6, 0.3), {"extension": 1}, "legendre", order)
    hub = fa.RigidBody(0.1, inertia=(1e-3,) * 3)
    links = [fa.Link(fa.Revolute("z"), hub, beam, fa.RigidBody(6.0, inertia=(1e-2,) * 3), name="rod")]
    return fa.Arm(links, (-g, 0, 0))


@pytest.mark.parametrize("order", ORDERS)
def test_a_balance_turned_inside_out_is_refused(order) -> None:
    for find in (lambda arm: arm.equilibrium(lock=[0]), lambda arm: arm.trim().q):
        assert pressed(order, 99.0).strain(find(pressed(order, 99.0)), 0, 0.4)[5] == pytest.approx(-0.99, rel=1e-6)
        with refuses(TURNED, "-0.01", "0.98", "load"):
            find(pressed(order, 101.0))


@pytest.mark.parametrize("integrator", ["ida", "implicit", "gauss", "rk4"])
def test_a_run_turned_inside_out_is_told(integrator: str) -> None:
    """A tip mass on a rod without mass, thrown at v: eps = -(v / L w) sin(w t), w^2 = E A / m L."""
    arm, w = pressed("exact", 0.0), np.sqrt(600.0 / (6.0 * L))
    step = {} if integrator == "ida" else {"step": 1e-3}
    t = np.linspace(0.0, 0.2, 41)
    q0, v0 = arm.zero, np.zeros(arm.nv)

    def run(share: float) -> fa.Result:
        v0[1] = -share * w  # of eps, the constant shape
        return fa.simulate(arm, t, q0, v0, drive={0: HELD}, integrator=integrator, **step)

    run(0.9)
    with warns(fa.errors.RangeWarning, TURNED, "t =") as told:
        out = run(1.2)
    found = told[0].message
    assert found.link == 0 and found.finding.limit == 0.0
    assert found.finding.value == pytest.approx(1 + out.strain(0, 0.4)[:, 5].min(), rel=1e-3)
    assert found.time == pytest.approx(np.arcsin(1 / 1.2) / w, abs=t[1])
    with warns(fa.errors.RangeWarning, "scenario 1", TURNED):
        start = np.array([[0, -share * w] for share in (0.9, 1.2)])
        fa.simulate_batch(arm, t, q0, start, drive={0: HELD}, integrator=integrator, **step)
    if integrator in ("implicit", "rk4"):
        with warns(fa.errors.RangeWarning, "scenario 1", TURNED) as told:
            out = fa.rollout(arm, q0, start, drive={0: HELD}, integrator=integrator, nstep=200, every=5, **step)
        assert len(told) == 1 and out.stats["out_of_range"] == 1
        assert told[0].message.time == found.time
        assert told[0].message.finding.value == pytest.approx(found.finding.value)
