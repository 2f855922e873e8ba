"""Drives that come later and are shifted, as parameters of a batch."""

from __future__ import annotations

import flexarm as fa
import numpy as np
import pytest
from messages import refuses


def test_moved_laws_by_hand() -> None:
    t = np.linspace(0.0, 1.0, 11)
    for law in (fa.Torque(t, np.sin(5 * t)), fa.Torque(lambda s: np.sin(5 * s))):
        moved = law.moved(offset=0.5, delay=0.13)
        assert moved(0.43) == pytest.approx(law(0.30) + 0.5)
    samples = fa.Torque(t, 1 + t)
    late, early = samples.moved(delay=0.13), samples.moved(delay=-0.13)
    assert [late(x) for x in (0.0, 0.1, 0.13, 1.0)] == pytest.approx([1, 1, 1, 1.87])  # stands at its first value
    assert [early(x) for x in (0.0, 0.87, 0.9, 1.0)] == pytest.approx([1.13, 2, 2, 2])
    late.check_span("late", np.array([0.0, 1.0]))
    assert fa.Torque(3.0).moved(1.0, 0.2)(0.0) == 4.0
    motion = fa.Motion(t, t**2)
    assert motion.moved(0.5, 0.13)(0.43) == pytest.approx((0.59, 0.6, 2.0))
    assert motion.moved(0.5, 0.13)(0.05) == pytest.approx((0.5, 0.0, 0.0))
    assert fa.Motion(lambda s: (s, 1.0, 0.0)).moved(2.0, 0.1)(0.3) == pytest.approx((2.2, 1.0, 0.0))


def test_laws_at_many_times() -> None:
    t = np.linspace(0.0, 1.0, 11)
    q, v, a = fa.Motion(t, t**2)(t)
    np.testing.assert_allclose(np.array([q, v, a]), [t**2, 2 * t, np.full(11, 2.0)], atol=1e-10)
    assert fa.Motion(lambda s: (s, 1.0, 0.0))(t.reshape(1, 11))[0].tolist() == [t.tolist()]
    for law in (fa.Torque(t, 3 * t), fa.Torque(lambda s: 3 * s)):
        np.testing.assert_allclose(law(t), 3 * t, atol=1e-14)
    np.testing.assert_array_equal(fa.Torque(3.0)(t), np.full(11, 3.0))
    with refuses("t = [0.0, nan]"):
        fa.Torque(3.0)([0.0, np.nan])


def test_offset_and_delay_vary_in_batches() -> None:
    arm = fa.Arm([fa.Link(fa.Prismatic("x"), tip=fa.RigidBody(2.0))])
    t = np.linspace(0.0, 1.0, 101)
    drive = {0: fa.Torque(t, np.full(101, 3.0))}
    runs = fa.simulate_batch(
        arm, t, drive=drive, step=0.01, parameters={"drive.0.scale": [1.0, 2.0], "drive.0.offset": [0.5, 1.0]}
    )
    assert runs.q is not None
    np.testing.assert_allclose(runs.q[:, -1, 0], [3.5 / 4, 7 / 4], rtol=1e-9)
    ramp = {0: fa.Torque([0.0, 0.2, 0.2001, 1.0], [0.0, 0.0, 2.0, 2.0])}
    late = fa.simulate_batch(arm, t, drive=ramp, step=0.01, parameters={"drive.0.delay": [0.0, 0.3037]})
    assert late.q is not None
    np.testing.assert_allclose(late.q[:, -1, 0], [0.8**2 / 2, (0.8 - 0.3037) ** 2 / 2], rtol=1e-3)
