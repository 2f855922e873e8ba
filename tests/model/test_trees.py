"""Trees of links: names and numbers of parents, what a link carries, links in pieces, models in controllers."""

from __future__ import annotations

import pickle
from dataclasses import replace

import flexarm as fa
import numpy as np
import pytest
from arms import random_arm, random_state, satellite, side_by_side, two_arms
from messages import refuses


def test_who_sits_on_whom() -> None:
    arm = satellite()
    assert arm.parents == (-1, 0, 0, 0, 3) and not arm.is_chain and arm.ends == [1, 2, 4]
    assert arm.children("bus") == [1, 2, 3] == arm.carried("bus")[:3] and arm.carried("bus") == [1, 2, 3, 4]
    assert arm.carried("upper") == [4] and arm.carried("fore") == [] == arm.children("left panel")
    assert arm.path("fore") == [0, 3, 4] and arm.path("bus") == [0]
    assert arm.longest([1.0, 5.0, 7.0, 2.0, 4.0]) == 8.0
    assert np.allclose(arm.end_places(arm.zero), [(0, 2.4, 0), (0, -2.4, 0), (1.7, 0, 0)])
    assert pickle.loads(pickle.dumps(arm)).parents == fa.Arm.from_dict(arm.to_dict()).parents == arm.parents
    chain = random_arm(np.random.default_rng(0), 3)
    assert chain.is_chain and chain.ends == [2] and chain.path(2) == [0, 1, 2] == [0, *chain.carried(0)]


@pytest.mark.parametrize(
    ("parent", "says"), [("nobody", "nobody"), *((k, "before this one") for k in (2, -1, "fore", 7))]
)
def test_a_parent_stands_before_its_children(parent: str | int, says: str) -> None:
    links = list(satellite().links)
    with refuses("parent", says):
        fa.Arm([*links[:2], replace(links[2], parent=parent), *links[3:]])
    with refuses("links[0]: parent = 0", "as this is the first link"):
        fa.Arm([replace(links[0], parent=0), *links[1:]])
    with refuses("parent", True):
        fa.Link(fa.Fixed(), parent=True)


def test_arms_on_the_world_do_not_feel_each_other() -> None:
    rng = np.random.default_rng(5)
    parts = [random_arm(rng, 3), random_arm(rng, 2)]
    parts[1] = fa.Arm(parts[1].links, parts[0].gravity)
    both = side_by_side(*parts)
    states = [random_state(rng, arm) for arm in parts]
    q, v, tau = (np.concatenate(x) for x in zip(*states, strict=True))
    a = both.forward_dynamics(q, v, tau)
    assert np.allclose(a, np.concatenate([arm.forward_dynamics(*s) for arm, s in zip(parts, states, strict=True)]))
    for side in ("outboard", "inboard"):
        one = parts[1].joint_reaction(states[1][0], states[1][1], a[parts[0].nv :], 1, side)
        assert np.allclose(both.joint_reaction(q, v, a, 4, side), one)


def test_inboard_reactions_balance_the_parent() -> None:
    """On a body that floats without springs: what its joint passes on is what its branches take and its own inertia."""
    arm = satellite()
    rng = np.random.default_rng(3)
    q, v, _ = random_state(rng, arm)
    a = arm.forward_dynamics(q, v)
    F = [arm.joint_reaction(q, v, a, k, "inboard") for k in (1, 2, 3)]  # at the bus's end, its origin, in its axes
    _, R = arm.frame(q, "bus")
    w, alpha = R.T @ arm.velocity(q, v, "bus")[3:], R.T @ arm.acceleration(q, v, a, "bus")[3:]
    c, J = np.array([0.02, 0, 0.01]), np.diag([5.0, 6.0, 7.0])
    at_com = R.T @ arm.acceleration(q, v, a, "bus")[:3] + np.cross(alpha, c) + np.cross(w, np.cross(w, c))
    force = 60.0 * at_com
    moment = J @ alpha + np.cross(w, J @ w) + np.cross(c, force)
    assert np.allclose(-np.sum(F, axis=0), [*force, *moment], atol=1e-9 * np.abs(F).max())


def test_a_link_in_pieces_keeps_its_place_in_the_tree() -> None:
    """With what sat on it on the last piece: the same shape where nothing is bent, and nearly the same modes."""
    arm = satellite(n=3, free=False)
    pieces = [replace(x, name=None) if k else x for k, x in enumerate(fa.split(arm["upper"], 6, [0.3]))]
    assert pieces[0].parent == "bus" and pieces[1].parent is None
    with_pieces = fa.Arm([*arm.links[:3], *pieces, arm["fore"]])
    assert with_pieces.parents == (-1, 0, 0, 0, 3, 4)
    assert np.allclose(with_pieces.end_places(with_pieces.zero), arm.end_places(arm.zero))
    found, whole = (x.modes().frequencies for x in (with_pieces, arm))
    assert np.allclose(found[5:9], whole[5:9], rtol=1e-4)


def test_a_model_of_another_tree_is_refused() -> None:
    arm = two_arms()
    moved = [replace(x, parent="world") if x.name == "right upper" else x for x in arm.links]
    law = fa.MPC(fa.Arm(moved), track=[("joint", "waist")], reference=0.1, limit=1.0, rate=100)
    with refuses("model", "link 3", "world"):
        fa.simulate(arm, np.linspace(0.0, 0.05, 2), control=law)
