"""AB against CI on chains that are long or badly scaled, and links without mass; judged in 60 digits."""

import flexarm as fa
import numpy as np
import pytest
from messages import refuses
from stability import chain

# Formulation stiffness (Ascher, Pai & Cloutier, Int. J. Robotics Research 16, 1997): relative error of CI and of AB in
# an independent program, at one state, which is not told. Both are met within a factor of ten; AB also because the
# kernel leaves nothing along a free coordinate but what is applied to it (without that, the last link x 1e9 was 50
# times above the mark).
MARKS = [
    ("uniform", 64, 3.5e-11, 1.3e-14),
    ("last link x 1e6", 16, 2.3e-7, 7.4e-11),
    ("last link x 1e9", 16, 1.5e-4, 5.7e-9),
    ("1e-8 rising to 1 at the tip", 16, 7.7e-7, 5.2e-15),
]


@pytest.mark.parametrize(("name", "n", "ci", "ab"), MARKS, ids=[p[0] for p in MARKS])
def test_ci_loses_the_digits_that_ab_keeps(name: str, n: int, ci: float, ab: float) -> None:
    found = chain.errors(chain.CHAINS[name](n), states=3 if n > 50 else 5)
    assert ci / 10 < found["ci"] < 10 * ci
    assert found["ab"] < 10 * ab
    assert found["ab"] < found["ci"] / 50
    assert found["data"] < 1e-14  # the loss is the method's: the last bit of the input is worth no more


def test_the_judge_agrees_on_a_chain_of_two() -> None:
    """The double pendulum's equations, written out."""
    q, v, tau = [0.3, 0.7], [1.1, -0.4], [0.2, 0.5]
    c, s = np.cos(0.7), np.sin(0.7)
    M = np.array([[5 / 3 + c, 1 / 3 + c / 2], [1 / 3 + c / 2, 1 / 3]])
    h = np.array([-s / 2 * (2 * 1.1 * -0.4 + 0.4**2), s / 2 * 1.1**2])
    expected = np.linalg.solve(M, tau - h)
    np.testing.assert_allclose([float(x) for x in chain.accelerations([1, 1], q, v, tau)], expected, rtol=1e-14)


def test_a_link_without_mass_that_nothing_hangs_on_is_refused() -> None:
    for masses in ([1.0, 1.0, 0.0], [0.0], [1.0, 0.0, 0.0]):
        last = len(masses) - 1
        with refuses("inertia", f"coordinate 'link {last} revolute' = 0"):
            chain.rods(masses)


@pytest.mark.parametrize("method", ["ab", "ci"])
@pytest.mark.parametrize(
    "masses",
    [(1, 0, 1), (0, 1, 1), (1, 0, 0, 1), (1, 1e-300, 1), (1, 1e-12, 1), (1, 1, 1e-12), (1, 1, 1e-300)],
    ids=str,
)
def test_a_link_of_no_or_next_to_no_mass_is_right(masses: tuple[float, ...], method: str) -> None:
    """Inside a chain, the mass beyond carries it; at its end, it flies off as it must: to 1e300 rad/s^2."""
    found = chain.errors(list(masses), states=5)
    assert found[method] < 1e-12


def test_a_massless_link_runs() -> None:
    """Two massless rods in the middle: energy is kept, at no more steps than the chain of equal rods takes."""
    steps = []
    for masses in ([1, 0, 1], [1, 1, 1]):
        arm = chain.rods(masses)
        r = fa.simulate(arm, np.linspace(0, 2, 21), [0.1, 0.8, -0.5], [0.5, -0.3, 0.2], rtol=1e-8, atol=1e-10)
        energy = r.energy()[0]
        assert np.ptp(energy) < 1e-6 * energy[0]
        steps.append(r.stats["steps"])
    assert steps[0] < 3 * steps[1]
