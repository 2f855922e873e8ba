"""The reference cases of tests/data."""

import flexarm as fa
import numpy as np
import pytest
from arms import reference

CASES = [
    ("ist_order1", 1e-11),
    ("ist_order2", 1e-11),
    ("ist_order3", 1e-10),
    ("ist_exact", 1e-10),
    ("two_link_exact", 5e-9),
    ("two_link_order2", 5e-9),  # the reference's torsion constant holds eight digits
    ("elbow_order2", 1e-10),
]


@pytest.mark.parametrize(("name", "limit"), CASES)
def test_states(name: str, limit: float) -> None:
    case = reference(name)
    arm = fa.Arm.from_dict(case["scene"])
    for s in case["states"]:
        q, v, tau, a, M = (np.array(s[k]) for k in ("q", "v", "tau", "a", "mass_matrix"))
        for method in ("ab", "ci"):
            assert np.abs(arm.forward_dynamics(q, v, tau, method) - a).max() < limit * np.abs(a).max()
        assert np.abs(arm.inverse_dynamics(q, v, a) - tau).max() < limit * np.abs(M @ a).max()
        d = np.sqrt(np.diag(M))
        assert np.abs((arm.mass_matrix(q) - M) / np.outer(d, d)).max() < limit
        kinetic, potential = arm.energy(q, v)
        assert kinetic == pytest.approx(s["kinetic"], rel=limit)
        assert potential == pytest.approx(s["potential"], rel=limit)
        p, R = arm.frame(q)
        np.testing.assert_allclose(p, s["tip_position"], atol=1e-12)
        np.testing.assert_allclose(R, s["tip_rotation"], atol=1e-12)


@pytest.mark.parametrize("order", [1, 2, "exact"])
def test_spin_up(order: int) -> None:
    case = reference(f"spinup_order_{order}")
    arm = fa.Arm.from_dict(case["scene"])
    r = fa.simulate(arm, case["t"], drive={0: fa.Motion.spin_up(7.6, 0.5)}, rtol=1e-8, atol=1e-10)
    assert np.abs(r.tip_deflection()[:, 1] - case["tip_deflection_y"]).max() < 2e-8
    assert np.abs(r.frame()[0] - case["tip_position"]).max() < 2e-8


def test_batches_are_the_states_one_by_one() -> None:
    case = reference("elbow_order2")
    arm = fa.Arm.from_dict(case["scene"])
    q, v, tau = (np.array([s[k] for s in case["states"]]) for k in ("q", "v", "tau"))
    a = arm.forward_dynamics(q[:, None], v[:, None], tau)  # (3, 1) and (3,): all pairs
    assert a.shape == (3, 3, arm.nv)
    np.testing.assert_array_equal(a[1, 2], arm.forward_dynamics(q[1], v[1], tau[2]))
    np.testing.assert_array_equal(arm.mass_matrix(q)[2], arm.mass_matrix(q[2]))
    np.testing.assert_array_equal(arm.energy(q, v)[1][0], arm.energy(q[0], v[0])[1])
    np.testing.assert_array_equal(arm.frame(q, link=1, x=0.2)[0][1], arm.frame(q[1], link=1, x=0.2)[0])
