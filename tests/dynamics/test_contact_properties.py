"""Contacts of random arms: what follows from their gaps."""

import flexarm as fa
import numpy as np
import pytest
from arms import contacted, differences, moved, near, random_arm, random_state
from hypothesis import assume, given, settings
from hypothesis import strategies as st

seeds = st.integers(0, 2**32 - 1)
common = settings(max_examples=40, deadline=None, derandomize=True)


def drawn(
    seed: int, links: int, orders: tuple[int | str, ...] = (0, 1, 2, 3, "exact"), **law: float
) -> tuple[fa.Arm, fa.Arm, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """An arm with contacts, the same without, and a state where some of them touch; nothing is near an edge of its
    law."""
    rng = np.random.default_rng(seed)
    bare = random_arm(rng, links, orders)
    q, v, _ = random_state(rng, bare)
    arm = contacted(rng, bare, q, **law)
    gap, rate, force = arm.contact_motion(q, v)
    assume(force.any())
    assume(np.abs(gap).min() > 2e-3)
    assume(all(abs(1 - c.damping * r) > 0.05 for c, r in zip(arm.contacts, rate, strict=True)))
    return arm, bare, (q, v, rng.normal(size=arm.nv))


def by_q(arm: fa.Arm, q: np.ndarray) -> np.ndarray:
    """The Jacobian of the gaps, where they have one: not at the edges between what is nearest of a box."""
    J, coarse = (differences(lambda x: arm.contact_motion(moved(arm, q, x))[0], arm.nv, h) for h in (1e-4, 2e-4))
    assume(np.abs(J - coarse).max() < 1e-7 * max(1.0, np.abs(J).max()))
    return J


@common
@given(seeds, st.integers(1, 4))
def test_rates_and_jacobian_are_those_of_the_gaps(seed: int, links: int) -> None:
    arm, _, (q, v, _) = drawn(seed, links)
    J = arm.contact_jacobian(q)
    near(J, by_q(arm, q), 1e-7, 1.0)
    near(J @ v, arm.contact_motion(q, v)[1], 1e-12, np.abs(J).max() * np.abs(v).max())


@common
@given(seeds, st.integers(1, 4))
def test_forces_of_motion(seed: int, links: int) -> None:
    """By the definitions of force, energy and virtual work, beside the arm without contacts."""
    arm, bare, (q, v, a) = drawn(seed, links)
    gap, rate, found = arm.contact_motion(q, v)
    depth = np.maximum(-gap, 0.0)
    n, stiffness, damping = (
        np.array([getattr(c, name) for c in arm.contacts]) for name in ("exponent", "stiffness", "damping")
    )
    near(found, np.maximum(stiffness * depth**n * (1 - damping * rate), 0.0), 1e-11)
    added = bare.inverse_dynamics(q, v, a) - arm.inverse_dynamics(q, v, a)
    size = np.abs(bare.inverse_dynamics(q, v, a)).max()
    near(added, arm.contact_jacobian(q).T @ found, 1e-11, size)
    T, U = (x - y for x, y in zip(arm.energy(q, v), bare.energy(q, v), strict=True))
    spring = (stiffness * depth ** (n + 1) / (n + 1)).sum()
    assert T == 0 and pytest.approx(spring, rel=1e-9, abs=1e-12 * size) == U
    M, tau = arm.mass_matrix(q), arm.inverse_dynamics(q, v, a)
    assert np.array_equal(M, bare.mass_matrix(q))
    for method in ("ab", "ci"):
        near(M @ (arm.forward_dynamics(q, v, tau, method) - a), np.zeros(arm.nv), 1e-9, size + np.abs(tau).max())


@common
@given(seeds, st.integers(1, 3))
def test_jacobians_of_what_contacts_add(seed: int, links: int) -> None:
    """Against differences of what they add to inverse dynamics."""
    arm, bare, (q, v, a) = drawn(seed, links)

    def added(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return arm.inverse_dynamics(q, v, a) - bare.inverse_dynamics(q, v, a)

    by_q(arm, q)  # where there is one
    turns = differences(lambda x: moved(arm, q, x), arm.nv)
    found = [x - y for x, y in zip(arm.inverse_derivatives(q, v, a), bare.inverse_derivatives(q, v, a), strict=True)]
    size = max(np.abs(x).max() for x in bare.inverse_derivatives(q, v, a)[:2])
    near(found[0] @ turns, differences(lambda x: added(moved(arm, q, x), v), arm.nv), 1e-6, size)
    near(found[1], differences(lambda x: added(q, v + x), arm.nv), 1e-7, size)
    assert not found[2].any()


@common
@given(seeds, st.integers(1, 4), st.sampled_from([0.0, 0.5]))
def test_what_is_inside_moves_nothing_as_a_whole(seed: int, links: int, coulomb: float) -> None:
    """A free arm: contacts between its links, friction included, do no work where all of it shifts and turns."""
    rng = np.random.default_rng(seed)
    base = fa.Link(fa.Free(), fa.RigidBody(1.0, (0.1, 0, 0), (0.02, 0.03, 0.04), (0.1, 0.2, 0)))
    bare = fa.Arm([base, *random_arm(rng, links).links])
    q, v, a = random_state(rng, bare)
    friction = {"coulomb": coulomb, "tangential_stiffness": 1e3} if coulomb else {}
    arm = contacted(rng, bare, q, world=False, **friction)
    force = arm.contact_motion(q, v)[2]
    assume(force.any())
    added = arm.inverse_dynamics(q, v, a) - bare.inverse_dynamics(q, v, a)
    assert np.abs(added).max() > 0
    near(added[:6], np.zeros(6), 1e-11, np.abs(bare.inverse_dynamics(q, v, a)).max() + force.max())


@common
@given(seeds, st.integers(1, 4))
def test_friction_takes_power(seed: int, links: int) -> None:
    """Bristles that are unbent hold by their damping: against the motion, and by at most their share of the force."""
    law = {"coulomb": 0.4, "tangential_stiffness": 1e3}
    arm, _, (q, v, a) = drawn(seed, links, **law)
    bare = fa.Arm(arm.links, arm.gravity, contacts=[
        fa.Contact(c.point, c.against, radius=c.radius, stiffness=c.stiffness, damping=c.damping, exponent=c.exponent)
        for c in arm.contacts
    ])  # fmt: skip
    assert np.array_equal(arm.contact_motion(q, v), bare.contact_motion(q, v))
    added = arm.inverse_dynamics(q, v, a) - bare.inverse_dynamics(q, v, a)  # what it takes to move against it
    assert v @ added >= -1e-9 * np.abs(v).max() * np.abs(added).max()
    still = np.zeros(arm.nv)
    size = np.abs(bare.inverse_dynamics(q, still, a)).max()
    near(arm.inverse_dynamics(q, still, a), bare.inverse_dynamics(q, still, a), 1e-12, size)
    assert arm.energy(q, v) == bare.energy(q, v)


@common
@given(seeds, st.integers(1, 4))
def test_one_number_at_many_states_is_that_at_each(seed: int, links: int) -> None:
    arm, _, (q, v, a) = drawn(seed, links, (1, 2, 3, "exact"))
    rng = np.random.default_rng(seed)
    Q, V, A = (x + 0.01 * rng.normal(size=(5, x.size)) for x in (q, v, a))
    for f, given_ in ((arm.inverse_dynamics, (Q, V, A)), (arm.forward_dynamics, (Q, V, A)), (arm.energy, (Q, V)),
                      (arm.contact_motion, (Q, V))):  # fmt: skip
        many, each = np.array(f(*given_)), [f(*x) for x in zip(*given_, strict=True)]
        one_by_one = np.array(each) if f in (arm.inverse_dynamics, arm.forward_dynamics) else np.stack(each, axis=1)
        near(many, one_by_one, 1e-12)
