"""Trees in the choice of models: pieces whose parents move along, all ends of an arm, a plan for two arms."""

from __future__ import annotations

from dataclasses import replace

import flexarm as fa
import numpy as np
import pytest
from arms import STEEL, masts, two_arms
from flexarm.choose.measures import Measure
from flexarm.choose.models import Models

TOL = 1e-3


def scene(**more: object) -> fa.Scene:
    drive = {"left shoulder": fa.Torque(0.4), "right elbow": fa.Torque(-0.1)}
    given = {"arm": two_arms(), "t": np.linspace(0.0, 0.3, 16), "drive": drive} | more
    return fa.Scene(**given, options={"integrator": "implicit", "step": 2e-3})


def test_pieces_take_what_they_carry_along() -> None:
    """Named and numbered parents; those of the world stay there."""
    arm = two_arms(n=3)
    numbered = [replace(x, parent=0) if x.name == "right upper" else x for x in arm.links]
    for links in (arm.links, numbered):
        whole = fa.Arm([*links, replace(numbered[3], name="third", joint=fa.Fixed(), parent="left upper"),
                        fa.Link(fa.Revolute("z"), fa.RigidBody(1, inertia=(1, 1, 1)), parent="world")])  # fmt: skip
        loads = [fa.Load(k, force=(0, 1, 0), x=x) for k, x in ((1, 0.2), (1, 0.3), (3, 0.1))]
        models = Models(fa.Scene(whole, t=np.linspace(0.0, 0.1, 3), loads=loads))
        model = replace(models.given, pieces=True)
        cut = models.arm(model)
        assert models.jumps == {1: [0.2, 0.3], 3: [0.1]} and models.first(model) == [0, 1, 4, 5, 7, 8, 9]
        assert cut.parents == (-1, 0, 1, 2, 3, 0, 5, 6, 3, -1)
        assert np.allclose(cut.end_places(cut.zero), whole.end_places(whole.zero))
        one, other = (x.modes(lock=x.movable).frequencies[:3] for x in (whole, cut))
        assert np.allclose(one, other, rtol=2e-3)


def test_pieces_take_what_sits_on_slices_along() -> None:
    arm = masts(n=3)
    models = Models(fa.Scene(arm, t=np.linspace(0.0, 0.1, 3), loads=[fa.Load("boom", force=(0, 1, 0), x=0.3)]))
    cut = models.arm(replace(models.given, pieces=True))
    assert models.jumps == {0: [0.2, 0.3, 0.5], 3: [0.1]}  # the links on slices, and the load
    nones = [(n, None) for n in range(-1, 4)]
    wanted = (*nones, (2, 0.2), (0, 0.2), (6, None), (2, 0.2), (6, 0.1))
    assert [n for n, _ in cut.seats] == [n for n, _ in wanted]
    assert [x for _, x in cut.seats if x] == pytest.approx([x for _, x in wanted if x])
    assert np.allclose(cut.end_places(cut.zero), arm.end_places(arm.zero))
    one, other = (x.modes(lock=x.movable).frequencies[:3] for x in (arm, cut))
    assert np.allclose(one, other, rtol=0.04) and (other < one).all()  # pieces have more shapes


def test_a_scene_in_pieces_runs_alike() -> None:
    """A load in the middle of one arm's beam cuts that beam; the other arm's hand moves as before."""
    load = fa.Load("left upper", force=(0, 2.0, 0), x=0.25)
    s = scene(loads=(load,), arm=two_arms(n=3))
    models = Models(s)
    assert models.jumps == {1: [0.25]}
    model = replace(models.given, pieces=True)
    found, given = models.at(model, s.options).run(), s.run()
    measure = Measure(s, "tip")
    a, b = measure.values(found, models.first(model)), measure.values(given)
    assert a["m"].shape == b["m"].shape == (16, 2, 3)
    assert np.abs(a["m"] - b["m"]).max() < 2e-3 * np.ptp(b["m"], axis=0).max()


def test_all_ends_are_measured() -> None:
    """The last link stands still while another one moves."""
    s = scene(drive={"left elbow": fa.Torque(0.2), "waist": fa.Motion(lambda t: (0.0, 0.0, 0.0)),
                     "right shoulder": fa.Motion(lambda t: (0.0, 0.0, 0.0)),
                     "right elbow": fa.Motion(lambda t: (0.0, 0.0, 0.0))})  # fmt: skip
    run = s.run()
    assert np.ptp(run.frame()[0], axis=0).max() < 1e-9 < np.ptp(run.frame("left fore")[0], axis=0).max()
    measure = Measure(s, "tip")
    values = measure.values(run)
    measure.set_span(values)
    assert measure.span["m"] == pytest.approx(np.ptp(run.frame("left fore")[0], axis=0).max())
    assert measure.sense(s, run.q)(run.v) > 0


def test_loaded_shapes_are_for_links_at_ends() -> None:
    beam = fa.Beam(0.5, fa.Rectangle(0.002, 0.02), STEEL, {"bending_y": 2})
    link = fa.Link(fa.Revolute("z"), beam=beam, tip=fa.RigidBody(0.2))
    arm = fa.Arm([link, link, replace(link, parent=0)])
    models = Models(fa.Scene(arm, t=np.linspace(0, 0.1, 3)))
    rebased = models.rebased(models.given, "loaded")
    assert [b.basis for b in rebased.beams] == [None, "loaded", "loaded"]


def test_a_plan_for_two_arms() -> None:
    """Within its tolerance of a rich model, at both hands."""
    s = scene()
    plan = fa.economize(s, TOL)
    rich = replace(s, arm=two_arms(4, "exact"), options={"integrator": "gauss", "step": 2e-3}).run()
    lean = plan.scene.run()
    off = np.linalg.norm(lean.arm.end_places(lean.q) - rich.arm.end_places(rich.q), axis=2).max()
    assert plan.certified and off < TOL * np.ptp(rich.arm.end_places(rich.q), axis=0).max()
    assert plan.arm.parents == s.arm.parents
