"""Struts and tendons of random arms: what follows from their lengths."""

import flexarm as fa
import numpy as np
import pytest
from arms import differences, moved, near, random_arm, random_state, strutted
from hypothesis import assume, given, settings
from hypothesis import strategies as st

seeds = st.integers(0, 2**32 - 1)
common = settings(max_examples=40, deadline=None, derandomize=True)


def drawn(
    seed: int, links: int, orders: tuple[int | str, ...] = (0, 1, 2, 3, "exact")
) -> tuple[fa.Arm, fa.Arm, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """An arm with struts, the same without, and a state where no points coincide."""
    rng = np.random.default_rng(seed)
    bare = random_arm(rng, links, orders)
    arm = strutted(rng, bare)
    q, v, _ = random_state(rng, arm)
    assume(arm.strut_motion(q)[0].min() > 0.1)
    return arm, bare, (q, v, rng.normal(size=arm.nv))


@common
@given(seeds, st.integers(1, 4))
def test_rates_and_jacobian_are_those_of_the_lengths(seed: int, links: int) -> None:
    arm, _, (q, v, _) = drawn(seed, links)
    J = arm.strut_jacobian(q)
    near(J, differences(lambda x: arm.strut_motion(moved(arm, q, x))[0], arm.nv), 1e-8, 1.0)
    near(J @ v, arm.strut_motion(q, v)[1], 1e-12, np.abs(J).max() * np.abs(v).max())


@common
@given(seeds, st.integers(1, 4))
def test_forces_of_motion(seed: int, links: int) -> None:
    """By the definitions of force, energy and virtual work, beside the arm without struts."""
    arm, bare, (q, v, a) = drawn(seed, links)
    length, rate, found = arm.strut_motion(q, v)
    force, spring = [], 0.0
    for s, l, dl in zip(arm.struts, length, rate, strict=True):
        over = l - s.length
        if isinstance(s, fa.Strut):
            force.append(s.force - s.stiffness * over - s.damping * dl)
        elif not s.tension_only:
            force.append(-(s.tension + s.stiffness * over + s.damping * dl))
        else:
            over = max(over, 0.0)
            force.append(-max(s.tension + s.stiffness * over + s.damping * min(over / 1e-3, 1.0) * dl, 0.0))
        spring += 0.5 * s.stiffness * over**2
    near(found, np.array(force), 1e-12)
    added = bare.inverse_dynamics(q, v, a) - arm.inverse_dynamics(q, v, a)
    size = np.abs(bare.inverse_dynamics(q, v, a)).max()
    near(added, arm.strut_jacobian(q).T @ found, 1e-11, size)
    T, U = (x - y for x, y in zip(arm.energy(q, v), bare.energy(q, v), strict=True))
    assert T == 0 and pytest.approx(spring, rel=1e-10, abs=1e-12 * size) == U
    tau = arm.inverse_dynamics(q, v, a)
    one, two = (arm.forward_dynamics(q, v, tau, m) for m in ("ab", "ci"))
    M = arm.mass_matrix(q)
    assert np.array_equal(M, bare.mass_matrix(q))
    for found in (one, two):
        near(M @ (found - a), np.zeros(arm.nv), 1e-9, size + np.abs(tau).max())


@common
@given(seeds, st.integers(1, 3))
def test_jacobians_of_what_struts_add(seed: int, links: int) -> None:
    """Against differences of what they add to inverse dynamics."""
    arm, bare, (q, v, a) = drawn(seed, links)

    def added(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return -arm.strut_jacobian(q).T @ arm.strut_motion(q, v)[2]

    rope = [(s, l) for s, l in zip(arm.struts, arm.strut_motion(q)[0], strict=True) if s.tension_only]
    assume(all(abs(l - s.length) > 2e-3 for s, l in rope))  # differences do not pass over its corner
    assume(all(abs(f) > 0.1 or f == 0 for f in arm.strut_motion(q, v)[2][2:3]))
    turns = differences(lambda x: moved(arm, q, x), arm.nv)
    found = [x - y for x, y in zip(arm.inverse_derivatives(q, v, a), bare.inverse_derivatives(q, v, a), strict=True)]
    size = max(np.abs(x).max() for x in bare.inverse_derivatives(q, v, a)[:2])
    near(found[0] @ turns, differences(lambda x: added(moved(arm, q, x), v), arm.nv), 1e-7, size)
    near(found[1], differences(lambda x: added(q, v + x), arm.nv), 1e-8, size)
    assert not found[2].any()


@common
@given(seeds, st.integers(1, 4))
def test_what_is_inside_moves_nothing_as_a_whole(seed: int, links: int) -> None:
    """A free arm: struts between its links do no work where all of it shifts and turns."""
    rng = np.random.default_rng(seed)
    base = fa.Link(fa.Free(), fa.RigidBody(1.0, (0.1, 0, 0), (0.02, 0.03, 0.04), (0.1, 0.2, 0)))
    arm = strutted(rng, fa.Arm([base, *random_arm(rng, links).links]), world=False)
    q = random_state(rng, arm)[0]
    assume(arm.strut_motion(q)[0].min() > 0.1)
    J = arm.strut_jacobian(q)
    near(J[:, :6], np.zeros_like(J[:, :6]), 1e-12, 1.0 + np.abs(J).max())


@common
@given(seeds, st.integers(1, 4))
def test_one_number_at_many_states_is_that_at_each(seed: int, links: int) -> None:
    arm, _, (q, v, a) = drawn(seed, links, (1, 2, 3, "exact"))
    rng = np.random.default_rng(seed)
    Q, V, A = (x + 0.01 * rng.normal(size=(5, x.size)) for x in (q, v, a))
    for f, given_ in ((arm.inverse_dynamics, (Q, V, A)), (arm.forward_dynamics, (Q, V, A)), (arm.energy, (Q, V))):
        many, each = np.array(f(*given_)), [f(*x) for x in zip(*given_, strict=True)]
        near(many, np.array(each).T if f == arm.energy else np.array(each), 1e-12)
