"""Trees of links: names and numbers of parents, what a link carries, links in pieces, models in controllers."""

from __future__ import annotations

import pickle
from dataclasses import replace

import flexarm as fa
import numpy as np
import pytest
from arms import STEEL, masts, random_arm, random_state, satellite, side_by_side, two_arms
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


def test_who_sits_on_slices() -> None:
    arm = masts()
    assert arm.seats == ((-1, None), (0, None), (0, 0.5), (0, 0.2), (0, 0.5), (3, 0.1)) and not arm.is_chain
    assert arm.children("boom") == [1, 2, 3, 4] and arm.carried("jib") == [5] and arm.path("claw") == [0, 3, 5]
    assert arm.ends == [1, 2, 3, 4, 5]  # the jib's end is free
    assert not fa.Arm([arm["boom"], replace(arm["jib"], parent=None)]).is_chain
    for again in (pickle.loads(pickle.dumps(arm)), fa.Arm.from_dict(arm.to_dict())):
        assert again == arm and again.seats == arm.seats
    q = random_state(np.random.default_rng(2), arm)[0]
    p, R = arm.frame(q, "boom", 0.5)
    stay = arm.frame(q, "stay")[0] - p  # its universal joint sits right there, and turns about x and y
    assert np.linalg.norm(stay) == pytest.approx(0.2) and not np.allclose(R.T @ stay, (0.2, 0, 0))
    J, of_slice = arm.jacobian(q, "stay"), arm.jacobian(q, "boom", 0.5)
    bends = [i for i, name in enumerate(arm.coordinates) if name.startswith("boom ")]
    turned = np.cross(of_slice[3:, bends].T, stay).T
    assert np.allclose(J[:3, bends], of_slice[:3, bends] + turned, atol=1e-12)
    assert np.allclose(J[3:, bends], of_slice[3:, bends], atol=1e-12)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"at": 0.9}, ("at = 0.9", "parent 'boom'", "0.8 m")),
        ({"at": 0.0}, ("at = 0:", "above 0")),
        ({"at": -0.1}, ("at = -0.1", "above 0")),
        ({"at": float("nan")}, ("at = nan", "above 0")),
        ({"parent": "bucket"}, ("at = 0.5", "parent 'bucket' has no beam", "inboard placement")),
        ({"parent": "world"}, ("at = 0.5", "world has no beam", "inboard placement")),
    ],
)
def test_a_slice_is_on_the_beam_of_the_parent(change: dict[str, object], says: tuple[str, ...]) -> None:
    arm = masts()
    with refuses("links[4]", *says):
        fa.Arm([*arm.links[:4], replace(arm.links[4], **change), arm.links[5]])
    for wrong in ("middle", True, (0.1,)):
        with refuses("at"):
            fa.Link(fa.Fixed(), at=wrong)


@pytest.mark.parametrize(
    ("order", "kind"),
    [("exact", "curved"), *((n, kind) for n in (0, 1, 2, 3, "exact") for kind in ("planar", "in space"))],
)
def test_the_slice_at_the_length_is_the_end(order: int | str, kind: str) -> None:
    modes = {"bending_y": 2} if kind == "planar" else {"bending_y": 2, "bending_z": 1, "torsion": 1}
    curvature = (0.2, 0.0, 1.5) if kind == "curved" else None
    beam = fa.Beam(0.6, fa.Rectangle(0.01, 0.02), STEEL, modes, "legendre", order, curvature=curvature)
    first = fa.Link(fa.Revolute("z"), fa.RigidBody(0.2, end=(0.1, 0, 0)), beam, fa.RigidBody(0.3, (0.02, 0, 0)))
    last = fa.Link(fa.Revolute("z"), fa.RigidBody(0.5, (0.2, 0.05, 0), (2e-3, 3e-3, 4e-3)))
    end, slice = (fa.Arm([first, replace(last, at=at)], (0.0, -9.81, 0.0)) for at in (None, 0.6))
    q, v, tau = random_state(np.random.default_rng(4), end)
    q[1:-1] *= 0.1 if order == 0 else 1.0
    a = end.forward_dynamics(q, v, tau)
    assert np.allclose(slice.forward_dynamics(q, v, tau), a, rtol=1e-10, atol=1e-12 * np.abs(a).max())
    assert np.allclose(slice.mass_matrix(q), end.mass_matrix(q), rtol=1e-12, atol=1e-14)
    assert np.allclose(slice.inverse_dynamics(q, v, a), tau, atol=1e-9 * np.abs(end.mass_matrix(q) @ a).max())
    assert np.allclose(slice.momentum(q, v), end.momentum(q, v)) and np.allclose(slice.energy(q, v), end.energy(q, v))
    for x, y in zip(slice.inverse_derivatives(q, v, a), end.inverse_derivatives(q, v, a), strict=True):
        assert np.allclose(x, y, rtol=1e-9, atol=1e-11 * np.abs(y).max())
    assert np.allclose(slice.acceleration(q, v, a), end.acceleration(q, v, a))
    for side in ("outboard", "inboard"):
        assert np.allclose(*(x.joint_reaction(q, v, a, 1, side) for x in (slice, end)))


def test_a_slice_of_a_beam_that_does_not_bend() -> None:
    """A beam without modes, curved at rest: the child sits where its slice is."""
    bent = fa.Beam(0.6, fa.Rectangle(0.01, 0.02), STEEL, {}, order="exact", curvature=(0.0, 1.0, 2.0))
    first = fa.Link(fa.Revolute("z"), fa.RigidBody(0.2, end=(0.1, 0, 0)), bent)
    p, R = fa.Arm([first]).frame([0.0], 0, 0.4)
    body = fa.RigidBody(0.5, (0.2, 0.05, 0), (2e-3, 3e-3, 4e-3))
    on_slice = fa.Arm([first, fa.Link(fa.Revolute("z"), body, parent=0, at=0.4)], (0, -9.81, 0))
    hub = fa.RigidBody(0.2, end=p.tolist())
    last = fa.Link(fa.Revolute("z", inboard=fa.Placement(rotation=R)), body)
    by_hand = fa.Arm([replace(first, hub=hub, beam=None), last])
    q = np.array([0.3, -0.4])
    for found, wanted in zip(on_slice.frame(q), by_hand.frame(q), strict=True):
        assert np.allclose(found, wanted)
    assert np.allclose(on_slice.mass_matrix(q)[1], by_hand.mass_matrix(q)[1])


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


def test_a_link_in_pieces_takes_what_sits_on_slices() -> None:
    """Cut right at the slice, what sits there sits on the end of the first piece: nearly the same modes; two halves
    have more shapes, and are softer."""
    arm = masts(n=6)
    first, second = fa.split(arm["boom"], 6, [0.5])
    moved = {"bucket": {"parent": second.name}, "hoist": {"at": None}, "stay": {"at": None}, "jib": {}}
    cut = fa.Arm([first, second, *(replace(x, **moved.get(x.name, {})) for x in arm.links[1:])], arm.gravity)
    assert cut.seats == ((-1, None), (0, None), (1, None), (0, None), (0, 0.2), (0, None), (4, 0.1))
    found, whole = (x.modes().frequencies[:8] for x in (cut, arm))
    assert np.allclose(found, whole, rtol=0.02) and (found < whole * (1 + 1e-9)).all()


def test_a_model_of_another_tree_is_refused() -> None:
    arm = two_arms()
    moved = [replace(x, parent="world") if x.name == "right upper" else x for x in arm.links]
    law = fa.MPC(fa.Arm(moved), track=[("joint", "waist")], reference=0.1, limit=1.0, rate=100)
    with refuses("model", "link 3", "world"):
        fa.simulate(arm, np.linspace(0.0, 0.05, 2), control=law)


def test_a_model_with_a_link_elsewhere_on_the_beam_is_refused() -> None:
    arm = masts()
    moved = [replace(x, at=0.4) if x.name == "hoist" else x for x in arm.links]
    law = fa.MPC(fa.Arm(moved), track=[("joint", "slew")], reference=0.1, limit=1.0, rate=100)
    with refuses("model", "link 2", "at 0.4 m", "at 0.5 m"):
        fa.simulate(arm, np.linspace(0.0, 0.05, 2), control=law)
