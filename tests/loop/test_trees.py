"""Trees in loops of control: poles and laws of two arms that do not feel each other are those of each."""

from __future__ import annotations

import flexarm as fa
import numpy as np
from arms import side_by_side, two_arms
from flexarm.model.acting.compensators import PID


def one(length: float) -> fa.Arm:
    beam = fa.Beam(
        length, fa.Rectangle(0.003, 0.02), fa.Material(7850, 209e9, 0.3), {"bending_y": 2}, damping_ratio=0.02
    )
    joint = fa.Revolute("z", damping=0.05)
    return fa.Arm([fa.Link(joint, fa.RigidBody(0.1, inertia=(0.01,) * 3), beam, fa.RigidBody(0.1))])


def sorted_poles(*loops: fa.results.ClosedLoop) -> np.ndarray:
    return np.sort_complex(np.round(np.concatenate([x.poles for x in loops]), 6))


def test_poles_of_two_loops() -> None:
    """One of them a law with states of its own, which are links behind the last one, also in a run."""
    arms = [one(0.4), one(0.5)]
    pair = side_by_side(*arms)

    def law(k: int, n: int) -> fa.Controller:
        return PID(3.0, 1.0, 0.3, k, filter_time=0.05) if n else fa.PD(3.0, 0.3, k)

    alone = [fa.closed_loop(arm, law(0, n)) for n, arm in enumerate(arms)]
    both = fa.closed_loop(pair, [law(0, 0), law(1, 1)])
    t = np.linspace(0.0, 0.5, 6)
    run = fa.simulate(pair, t, {0: 0.2, 1: 0.3}, control=[law(0, 0), law(1, 1)], integrator="gauss", step=2e-3)
    for n, part in enumerate((slice(0, 3), slice(3, 6))):
        single = fa.simulate(arms[n], t, {0: 0.2 + 0.1 * n}, control=law(0, n), integrator="gauss", step=2e-3)
        assert np.allclose(run.q[:, part], single.q, atol=1e-9)
    assert np.allclose(sorted_poles(both), sorted_poles(*alone), rtol=1e-6, atol=1e-5)


def test_a_regulator_of_a_tree() -> None:
    """Each arm's gains are its own; of the others' states there are none. And two arms on a torso come to rest."""
    arms = [one(0.4), one(0.5)]
    pair = side_by_side(*arms)
    own = [np.asarray(fa.lqr(arm, weights={("joint", 0): 0.1}, effort=[1.0]).K) for arm in arms]
    K = np.asarray(fa.lqr(pair, weights={("joint", k): 0.1 for k in (0, 1)}, effort=[1.0, 1.0]).K)
    n = [arm.nv for arm in arms]
    parts = [slice(0, n[0]), slice(n[0], sum(n))]
    for k, part in enumerate(parts):
        for half in (0, sum(n)):
            mine = K[k, half + part.start : half + part.stop]
            assert np.allclose(
                mine, own[k][0, (half > 0) * n[k] :][: n[k]], rtol=1e-6, atol=1e-6 * np.abs(own[k]).max()
            )
            other = parts[1 - k]
            assert np.abs(K[k, half + other.start : half + other.stop]).max() < 1e-6 * np.abs(K).max()
    arm = two_arms()
    law = fa.lqr(arm)
    assert fa.closed_loop(arm, law).poles.real.max() < -1.0


def test_predictive_control_leads_both_hands() -> None:
    arm = two_arms()
    law = fa.MPC(track=[("tip", "left fore", "x"), ("tip", "right fore", "y")], reference=[0.8, -0.4], limit=5.0,
                 horizon=0.3, stages=10, blocks=5, rate=100)  # fmt: skip
    q = arm.pose({"left elbow": 0.4, "right elbow": -0.4})
    run = fa.simulate(arm, np.linspace(0.0, 0.6, 7), q, control=law, integrator="implicit", step=1e-2)
    assert abs(run.frame("left fore")[0][-1, 0] - 0.8) < 5e-3 and abs(run.frame("right fore")[0][-1, 1] + 0.4) < 5e-3


def test_a_model_with_fewer_shapes_of_the_same_tree() -> None:
    arm = two_arms(n=3)
    options = {"limit": 5.0, "horizon": 0.2, "stages": 5, "blocks": 3, "rate": 50}
    track = [("tip", "left fore", "x")]
    laws = [fa.MPC(model, track=track, reference=0.85, **options) for model in (two_arms(n=2), None)]
    q, t = arm.pose({"left elbow": 0.4}), np.linspace(0.0, 0.2, 3)
    a, b = (fa.simulate(arm, t, q, control=law, integrator="implicit", step=1e-2) for law in laws)
    assert np.abs(a.frame("left fore")[0] - b.frame("left fore")[0]).max() < 1e-2
