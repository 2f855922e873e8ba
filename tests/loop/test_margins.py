"""Margins of sampled loops against eigenvalues that are made apart: of gains, and of a delay in one output alone."""

from __future__ import annotations

import flexarm as fa
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

ALUMINIUM = fa.Material(2700, 70e9, 0.33)


def start_page() -> fa.Arm:
    """The two links of docs/start.md."""

    def link(length: float, thickness: float, rotor: float, payload: float) -> fa.Link:
        beam = fa.Beam(length, fa.Rectangle(thickness, 0.03), ALUMINIUM, {"bending_y": 3}, "legendre",
                       damping_ratio=0.01)  # fmt: skip
        return fa.Link(fa.Revolute("z", reflected_inertia=rotor), beam=beam, tip=fa.RigidBody(payload))

    return fa.Arm([link(0.6, 0.006, 0.02, 0.3), link(0.5, 0.003, 0.005, 0.1)])


@pytest.mark.parametrize(
    ("rate", "delay", "gains"),
    [(1000, 0.0, (20, 20 / 6, 2.5, 0.4)), (2000, 0.001, (40, 40 / 6, 5.0, 0.8))],
)
def test_a_response_that_is_real_at_half_the_rate_has_margins(rate: float, delay: float, gains: tuple) -> None:
    """The response there is real but for rounding, of which two ways to compute it give two signs."""
    pid = fa.LinearController.pid
    k0, d0, k1, d1 = gains
    arm = start_page()
    laws = [pid(k0, 0, d0, 0, rate=rate, delay=delay), pid(k1, 0, d1, 1, rate=rate, delay=delay)]
    loop = fa.closed_loop(arm, laws)
    for k, margin in enumerate(loop.margins):
        assert margin.gain[0] < 1.0 < margin.gain[1] < np.inf
        for share, good in ((0.999, True), (1.001, False)):
            kp, kd = (share * margin.gain[1] * x for x in gains[2 * k : 2 * k + 2])
            one = [*laws[:k], pid(kp, 0, kd, k, rate=rate, delay=delay), *laws[k + 1 :]]
            assert fa.closed_loop(arm, one).stable is good
    assert "delay (ms)" in str(loop)


def grows(arm: fa.Arm, K: np.ndarray, T: float, output: int, late: float) -> float:
    """Of u = -K [q; v], sampled every T and held, one output `late` behind its sample: the spectral radius less 1.

    Between samples x' = A x + B u; an output that is m samples and e seconds late acts by what it was m + 1 samples
    ago for e seconds, then by what it was m samples ago."""
    model = arm.linearize(arm.zero)
    A, B = model.A, model.B
    n, nu = B.shape

    def flow(span: float) -> tuple[np.ndarray, np.ndarray]:
        e = expm(np.block([[A, B], [np.zeros((nu, n + nu))]]) * span)
        return e[:n, :n], e[:n, n:]

    m, e = int(late / T + 1e-12), late - int(late / T + 1e-12) * T
    whole, held = flow(T)
    rest, new = flow(T - e)
    _, old = flow(e)
    chain = m + 1  # samples of that output that are kept, the last one first
    Z = np.zeros((n + chain, n + chain))
    Z[:n, :n] = whole
    for i in range(nu):
        if i != output:
            Z[:n, :n] -= np.outer(held[:, i], K[i])
    now = np.zeros((m + 2, n + chain))  # that output: of this sample, then of those before
    now[0, :n] = -K[output]
    now[1:, n:] = np.eye(chain)
    Z[:n] += np.outer(new[:, output], now[m]) + np.outer(rest @ old[:, output], now[m + 1])
    Z[n:] = now[:chain]
    return float(np.abs(np.linalg.eigvals(Z)).max() - 1.0)


def test_each_output_of_a_law_has_the_delay_that_it_stands_alone() -> None:
    """All rows had the least of all, as if the whole law were late."""
    link = fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, (0.5, 0, 0), (0, 0, 0.1), (1, 0, 0)))
    arm, T = fa.Arm([link] * 3), 0.005
    K = np.diag([60.0, 30.0, 4.0]) @ np.hstack([np.eye(3), np.diag([0.2, 0.1, 0.5])])
    K[0, 1], K[1, 4] = 3.0, 0.4
    measure = [("joint", k) for k in range(3)] + [("rate", k) for k in range(3)]
    law = fa.LinearController([], None, None, K, rate=1 / T, measure=measure, actuate=[0, 1, 2])
    loop = fa.closed_loop(arm, law)
    assert loop.stable and loop.period == pytest.approx(T)
    found = [m.delay for m in loop.margins]
    for i, delay in enumerate(found):
        fine = np.linspace(0.0, 1.2 * delay, 150)
        unstable = [grows(arm, K, T, i, late) > 1e-9 for late in fine]
        k = unstable.index(True)
        assert not any(unstable[:k])
        truth = brentq(lambda late, i=i: grows(arm, K, T, i, late), fine[k - 1], fine[k], xtol=1e-12)
        assert delay == pytest.approx(truth, rel=1e-5)
    assert max(found) > 1.5 * min(found)


def test_a_slow_crossover_beside_fast_damping() -> None:
    """Poles of the shear's damping, 1e11 1/s, hide no crossover: the phase margin of a soft servo is that of the arm
    whose shear is hardly damped."""
    phases = []
    for kelvin_voigt in (1e-5, 0.1):
        material, modes = fa.Material(2700, 7e10, 0.3), {"bending_y": 2, "shear_y": 2}
        beam = fa.Beam(1.0, fa.Rectangle(0.01, 0.02), material, modes, kelvin_voigt=kelvin_voigt)
        arm = fa.Arm([fa.Link(fa.Revolute("z", damping=0.1), beam=beam, tip=fa.RigidBody(0.5))])
        phases.append(fa.closed_loop(arm, fa.PD(1.0, 0.01, 0)).margins[0].phase)
    assert phases[1] == pytest.approx(phases[0], rel=1e-2)
