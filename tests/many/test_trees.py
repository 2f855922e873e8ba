"""Trees in many runs: lanes beside single runs, sweeps of all ends, gradients by parameters of a branch."""

from __future__ import annotations

from dataclasses import replace

import flexarm as fa
import numpy as np
import pytest
from arms import masts, two_arms

MASS = "link.left fore.hub.mass"


def scene() -> fa.Scene:
    drive = {"left shoulder": fa.Torque(0.4), "right elbow": fa.Torque(-0.1)}
    return fa.Scene(two_arms(), t=np.linspace(0.0, 0.2, 11), drive=drive,
                    options={"integrator": "implicit", "step": 2e-3})  # fmt: skip


def test_a_batch_runs_as_each_alone() -> None:
    s, masses = scene(), np.array([0.3, 0.4, 0.5, 0.9, 0.2])
    found = fa.simulate_batch(
        s.arm, s.t, drive=s.drive, parameters={MASS: masses, "link.1.beam.length": 0.4 + 0 * masses}, **s.options
    )
    for k, mass in enumerate(masses):
        links = list(s.arm.links)
        links[1] = replace(links[1], beam=replace(links[1].beam, length=0.4))
        links[2] = replace(links[2], hub=replace(links[2].hub, mass=mass))
        one = replace(s, arm=fa.Arm(links)).run()
        assert np.allclose(found.q[k], one.q, atol=1e-9)


@pytest.mark.parametrize("order", [0, 1, 2, 3, "exact"])
def test_a_batch_with_links_on_slices_runs_as_each_alone(order: int | str) -> None:
    arm, masses, at = masts(order, 1), np.array([0.3, 0.4, 0.5, 0.9, 0.2]), np.linspace(0.1, 0.7, 5)
    given = {"drive": {"slew": fa.Torque(0.2)}, "integrator": "implicit", "step": 2e-3}
    t = np.linspace(0.0, 0.1, 3)
    batch = {"link.bucket.hub.mass": masses, "link.jib.at": at}
    found = fa.simulate_batch(arm, t, **given, parameters=batch)
    assert found.stats["lanes"] > 1
    for k in range(5):
        links = list(arm.links)
        links[1] = replace(links[1], hub=replace(links[1].hub, mass=masses[k]))
        links[3] = replace(links[3], at=at[k])
        one = fa.simulate(fa.Arm(links, arm.gravity), t, **given)
        assert np.allclose(found.q[k], one.q, atol=1e-9)


def test_a_sweep_notes_every_end() -> None:
    s = scene()
    plan = fa.SweepPlan([fa.Vary("grid", {MASS: [0.4, 0.8]})], outputs=["end_position", "settling"],
                        link="left upper", band=0.5)  # fmt: skip
    found = fa.sweep(s, plan)
    run = s.run()
    for k, name in ((2, "left fore"), (4, "right fore")):
        assert np.allclose([found.columns[f"end of {name} {x}"][0] for x in "xyz"], run.frame(k)[0][-1], atol=1e-9)
    away = np.linalg.norm(run.arm.end_places(run.q) - run.arm.end_places(run.q[-1]), axis=2).max(axis=1)
    last = run.t[np.flatnonzero(away > 0.5 * away.max())[-1]]
    assert 0 <= found.columns["settling"][0] - last <= run.t[1]  # between two rows


def test_a_gradient_by_the_mass_of_a_hand() -> None:
    arm = two_arms()
    tau = 0.05 * np.ones((20, arm.nv))

    def run(mass: float) -> np.ndarray:
        links = [replace(x, hub=replace(x.hub, mass=mass)) if x.name == "left fore" else x for x in arm.links]
        return fa.rollout(fa.Arm(links), arm.zero, None, tau, step=2e-3).q[0]

    r = fa.rollout(arm, arm.zero, None, tau, step=2e-3)
    g = fa.rollout_gradient(arm, r.q[0], r.v[0], tau, 2 * r.q[0], step=2e-3, parameters=[MASS])
    h = 1e-4
    numeric = ((run(0.4 + h) ** 2).sum() - (run(0.4 - h) ** 2).sum()) / (2 * h)
    assert np.isclose(g.parameters[MASS], numeric, rtol=1e-5)


def test_arms_of_different_trees_share_no_lanes() -> None:
    """The same links, one of which sits elsewhere in half of the scenarios."""
    arm = two_arms()
    other = fa.Arm([replace(x, parent="left upper") if x.name == "right upper" else x for x in arm.links])
    q = arm.zero + 0.3
    q[[i for i, name in enumerate(arm.coordinates) if "bending" in name]] = 0.05
    arms = [arm, other] * 4
    found = fa.rollout(arms, np.tile(q, (8, 1)), np.ones((8, arm.nv)), None, step=2e-3, nstep=20)
    for k, one in enumerate(arms):
        alone = fa.rollout(one, q, np.ones(arm.nv), None, step=2e-3, nstep=20)
        assert np.allclose(found.q[k], alone.q[0], atol=1e-10)
    assert np.abs(found.q[0] - found.q[1]).max() > 1e-3
