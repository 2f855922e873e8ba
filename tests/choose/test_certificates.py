"""Certificates of `economize` hold: scenes whose check would agree with a wrong run, against a truth made apart."""

from __future__ import annotations

from dataclasses import replace

import choose.economize_scenes as scenes
import flexarm as fa
import numpy as np
import pytest
from choose.economize_scenes import ALUMINIUM, STEEL, STRIP, hub, times
from flexarm.choose.measures import times_to_compare
from flexarm.choose.models import Models
from messages import warns

TOL = 1e-2


def clamped(modes: dict | None = None) -> fa.Arm:
    return fa.Arm([fa.Link(fa.Fixed(), None, fa.Beam(0.5, STRIP, STEEL, modes or {"bending_y": 3}))])


def hinged(tip: fa.RigidBody | None = None) -> fa.Arm:
    beam = fa.Beam(0.5, fa.Rectangle(0.004, 0.02), ALUMINIUM, {"bending_y": 3})
    return fa.Arm([fa.Link(fa.Revolute("z", damping=0.05), hub(0.05, 0.2), beam, tip)])


def load_samples() -> fa.Scene:
    t = np.arange(0, 4.1, 0.4)
    force = np.zeros((len(t), 3))
    force[:, 1] = 0.05 * np.random.default_rng(0).normal(size=len(t))
    return fa.Scene(clamped(), loads=(fa.Load(-1, force=force, t=t),), t=times(4.0), name="load samples every 0.4 s")


def torque_samples() -> fa.Scene:
    t = np.arange(0, 1.0001, 0.05)
    tip = fa.RigidBody(0.3, com=(0.03, 0.05, 0), inertia=(1e-4,) * 3)
    drive = {0: fa.Torque(t, 0.8 * np.sin(40.0 * t**2))}
    return fa.Scene(hinged(tip), drive, t=times(1.0), name="an imbalanced payload, torque samples every 0.05 s")


def motion_samples() -> fa.Scene:
    t = np.arange(0, 4.01, 0.25)
    arm = fa.Arm([fa.Link(fa.Revolute("z"), hub(), fa.Beam(0.5, STRIP, STEEL, {"bending_y": 3}))])
    drive = {0: fa.Motion(t, 0.02 * np.random.default_rng(2).normal(size=len(t)))}
    return fa.Scene(arm, drive, t=times(4.0), name="motion samples every 0.25 s")


def sampled_control() -> fa.Scene:
    law = fa.LinearController.pid(0.6, 0.3, 0.05, rate=5.0, reference=0.4)
    return fa.Scene(hinged(fa.RigidBody(0.1)), control=(law,), t=times(4.0), name="PID at 5 Hz")


def pulse() -> fa.Scene:
    """A callable, whose pulse fits between Gauss' points of long steps."""
    push = fa.Load(-1, force=lambda t: (0.0, 0.5 * np.sin(np.pi * (t - 0.77) / 0.004) * (0.77 < t < 0.774), 0.0))
    swing = {0: fa.Motion.spin_up(0.3, 0.5)}
    arm = fa.Arm([fa.Link(fa.Revolute("z"), hub(), fa.Beam(0.5, STRIP, STEEL, {"bending_y": 3}))])
    return fa.Scene(arm, swing, (push,), times(0.9), name="a pulse of a callable")


@pytest.mark.parametrize("make", [load_samples, torque_samples, motion_samples, sampled_control, pulse])
def test_samples_and_callables_do_not_hide_the_error_of_the_steps(make) -> None:
    """Steps end at samples: half the step that is asked for may be the same steps, which agree with themselves."""
    scene = make()
    plan = fa.economize(scene, TOL)
    rich = scenes.enriched(scene, {"bending_y": 7})
    truth = scenes.run(rich, integrator="gauss", step=float(np.ptp(scene.t)) / 400)
    assert not plan.certified or scenes.off(plan.scene.run().frame()[0], truth.frame()[0]) <= TOL
    assert plan.certified, plan.reasons


def friction() -> fa.Scene:
    """A joint that sticks and slides under torques that jump."""
    beam = fa.Beam(0.6, fa.Rectangle(0.004, 0.03), ALUMINIUM, {"bending_y": 3}, damping_ratio=0.02)
    joint = fa.Revolute("z", coulomb=0.3, stiction=0.4, damping=0.05, reflected_inertia=0.02)
    t, tau = [0, 0.3, 0.3001, 0.6, 0.6001, 0.9, 0.9001, 2], [1.2, 1.2, -1.2, -1.2, 0.8, 0.8, 0, 0]
    arm = fa.Arm([fa.Link(joint, None, beam, fa.RigidBody(0.2))])
    return fa.Scene(arm, {0: fa.Torque(t, tau)}, t=times(1.5, 300), name="dry friction, torque steps")


def whip() -> fa.Scene:
    """1.5 m of plastic, swung to and fro."""
    rod = fa.Material(1200, 3e9, 0.35)
    beam = fa.Beam(1.5, fa.Circle(0.005), rod, {"bending_y": 4}, order="exact", damping_ratio=0.01)
    arm = fa.Arm([fa.Link(fa.Revolute("z"), hub(0.0, 0.1), beam, fa.RigidBody(0.005))])
    swing = fa.Motion([0, 0.25, 0.5, 0.75, 1.2], [0, -0.8, 0.5, -0.3, -0.3], ends="rest")
    return fa.Scene(arm, {0: swing}, t=times(1.2, 240), name="whip")


@pytest.mark.parametrize("make, runs", [(friction, 10), (whip, 20)])
def test_friction_and_a_whip_are_decided_in_few_runs(make, runs: int) -> None:
    """Ten for one reference; a whip may need a second one."""
    scene = make()
    plan = fa.economize(scene, 1e-3)
    assert plan.certified and plan.runs <= runs, plan.reasons
    rich = scenes.enriched(scene, {"bending_y": 10})
    truth = scenes.run(rich, integrator=fa.Gauss(tolerance=1e-8)).frame()[0]
    assert scenes.off(plan.scene.run().frame()[0], truth) <= 1e-3


def test_the_check_has_more_of_every_strain_that_the_reference_has() -> None:
    """Shear converges slowly in stocky beams: a check with no more shapes of it agreed with a run, 2e-4 off."""
    scene = scenes.SCENES["stocky"]()
    plan = fa.economize(scene, 1e-4)
    rich = scenes.enriched(scene, scenes.STRAINS_OF["stocky"])
    truth = scenes.run(rich, integrator="gauss", step=float(scene.t[-1]) / 160).frame()[0]
    assert not plan.certified or scenes.off(plan.scene.run().frame()[0], truth) <= 1e-4
    check, reference = plan._search.rich.model.beam(0).counts, plan._search.reference.model.beam(0).counts
    assert all(n > m for n, m in zip(check, reference, strict=True) if m)


def test_a_vibration_with_its_zeros_at_the_output_times_is_seen() -> None:
    """Nine output times, at the zeros of the first mode that a hub at rest is struck into."""
    arm = clamped()
    beat = np.pi / arm.modes().frequencies[0]
    v0 = np.array([0.5, 0.0, 0.0])
    scene = fa.Scene(arm, t=beat * np.arange(9), v0=v0, loads=(fa.Load(-1, force=(0, 1e-3, 0)),))
    plan = fa.economize(scene, 1e-2)
    lean = replace(plan.scene, t=np.linspace(0, scene.t[-1], 801)).run()
    fine = {"integrator": "gauss", "step": 0.01}
    rich = fa.Arm([replace_modes(arm.links[0], 5)])
    truth = fa.simulate(rich, lean.t, None, np.eye(5)[0] * 0.5, loads=scene.loads, **fine)
    assert plan.certified and scenes.off(lean.frame()[0], truth.frame()[0]) <= 1e-2


def replace_modes(link: fa.Link, n: int) -> fa.Link:
    return fa.Link(link.joint, link.hub, replace(link.beam, modes={"bending_y": n}, order="exact"), link.tip)


@pytest.mark.parametrize("t", [np.array([0.0, 1.0]), np.linspace(0, 3, 50), np.linspace(1, 2, 5001)])
def test_times_of_comparison(t: np.ndarray) -> None:
    at = times_to_compare(t)
    inside = at[~np.isin(at, t)]
    assert at[0] == t[0] and at[-1] == t[-1] and (np.diff(at) > 0).all() and 200 <= len(at) <= 450
    assert 150 <= len(inside) and np.diff(at).max() < 0.05 * np.ptp(t)
    for period in np.geomspace(0.02, 0.5, 40) * np.ptp(t):  # none is small at all of them
        assert np.abs(np.sin(2 * np.pi * (at - t[0]) / period)).max() > 0.9


def test_the_run_that_is_judged_is_the_run_that_is_used() -> None:
    """Times of comparison must not shorten the steps: those of IDA depend on the output times."""
    scene = replace(scenes.SCENES["floating"](), t=times(0.3, 100))
    plan = fa.economize(scene, TOL)
    trials, model = plan._search.trials, plan._search.lean.model
    at = np.isin(trials.all, scene.t)
    assert at.sum() == len(scene.t) < len(trials.all)
    for options in (
        {"integrator": "gauss", "step": 0.1},
        {"integrator": "ida", "rtol": 1e-3, "atol": 1e-6},
        {"integrator": "implicit", "step": 0.003},
        {"integrator": "rk4", "step": 0.003},
    ):
        judged = trials.run(model, options, whole=True)
        used = trials.models.at(model, options).run().frame()[0]
        fine = replace(trials.models.at(model, {"integrator": "gauss", "step": 0.02}), t=trials.all).run().frame()[0]
        off = np.linalg.norm(judged.full["m"][:, 0] - fine, axis=1)
        assert np.abs(judged.full["m"][at, 0] - used).max() < 1e-12
        between = 1e-5 * TOL * np.ptp(fine, axis=0).max()  # what interpolation between a run's rows may cost
        assert off[~at].max() < 2 * off[at].max() + between


def bent() -> fa.Scene:
    """Modes of a free beam under a payload, and a start in them: only another basis converges soon."""
    beam = fa.Beam(0.4, fa.Rectangle(0.004, 0.02), STEEL, {"bending_y": 2})
    arm = fa.Arm([fa.Link(fa.Fixed(), None, beam, fa.RigidBody(0.3, inertia=(1e-4,) * 3))])
    return fa.Scene(arm, t=times(0.2, 100), q0=np.array([0.02, 0.001]), name="starts bent")


def test_a_start_in_elastic_coordinates_does_not_tie_the_basis() -> None:
    scene = bent()
    models = Models(scene)
    based = models.rebased(models.given)
    other, many = models.at(based, {}), models.at(based.but(counts=(9, 0, 0, 0, 0, 0)), {})
    x = np.linspace(0, 0.4, 41)
    given, two, nine = (np.array([s.arm.strain(s.q0, 0, p)[2] for p in x]) for s in (scene, other, many))
    assert other.arm.links[0].beam.basis == "legendre" and np.abs(two - given).max() > 1e-2 * np.abs(given).max()
    assert np.abs(nine - given).max() < 1e-3 * np.abs(given).max()
    plan = fa.economize(scene, 2e-3)
    truth = replace(many, arm=models.arm(based.but(counts=(9, 0, 0, 1, 0, 0), order="exact", rotary=True)))
    truth = replace(truth, q0=np.append(many.q0, 0.0), options={"integrator": "gauss", "step": 5e-4})
    assert plan.certified, plan.reasons
    assert scenes.off(plan.scene.run().frame()[0], truth.run().frame()[0]) <= 2e-3


# -- what symmetry leaves out ------------------------------------------------------------------------------------------


def strut(load: float, side: float = 0.0, duration: float = 2.0) -> fa.Scene:
    """A strip under so much of its buckling load, shaken in its stiff plane."""
    arm = clamped({"bending_y": 2, "bending_z": 2})
    critical = np.pi**2 * 209e9 * 0.02 * 0.001**3 / 12 / (4 * 0.5**2)
    t = np.linspace(0, duration, 11)
    force = np.stack([np.full(11, -load * critical), np.full(11, side), 0.5 * np.sin(2 * t)], axis=1)
    return fa.Scene(arm, loads=(fa.Load(-1, force=force, t=t),), t=times(duration, 200), name=f"strut at {load}")


def test_a_strut_above_its_buckling_load_is_not_certified_to_stay_straight() -> None:
    """1e-3 N across move it far; symmetry says that nothing moves it at all."""
    plan = fa.economize(strut(1.25), 1e-2)
    assert not plan.certified and "unstable" in plan.reasons[-1] and "bending_y" in plan.reasons[-1]
    assert fa.economize(strut(0.8), 2e-2).certified  # its stretch, struck by the load, is 3e-3
    side = replace(strut(1.25, 1e-3), t=times(0.8, 80))  # at order 2 it would run away later on
    with pytest.warns(fa.errors.RangeWarning):
        touched = scenes.run(side, integrator="gauss", step=0.01)
    assert np.ptp(touched.frame()[0][:, 1]) > 20 * np.ptp(plan.scene.run().frame()[0][:, 2])


def resonant() -> fa.Scene:
    """Two strips in an L, the second frequency twice the first, struck in their plane."""
    strips = [fa.Beam(0.3, fa.Rectangle(0.002, 0.02), STEEL, {"bending_y": 2}),
              fa.Beam(0.25, fa.Rectangle(0.001, 0.02), STEEL, {"bending_y": 2})]  # fmt: skip
    ends = fa.RigidBody(0.1), fa.RigidBody(0.0023314067263558325)
    links = [fa.Link(j, None, b, e) for j, b, e in zip((fa.Fixed(), fa.Revolute("z")), strips, ends, strict=True)]
    arm = fa.Arm(links)
    q0 = scenes.at(arm, {1: np.pi / 2})
    w = arm.modes(q0, lock=[1]).frequencies
    assert abs(w[1] / w[0] - 2) < 1e-6
    t = np.append(np.arange(4) * np.pi / w[1], 2.0)
    push = fa.Load(-1, force=np.outer([0, 6, -6, 0, 0], [1.0, 0, 0]), t=t)
    return fa.Scene(arm, {1: fa.Motion([0, 1], [np.pi / 2] * 2, ends="rest")}, (push,), times(1.0), q0)


def test_what_rings_in_the_plane_is_not_taken_for_an_instability_out_of_it() -> None:
    """Few rows of ringing make a stiffness that jumps: growth of 400, where a kick out of the plane hardly grows."""
    scene = resonant()
    plan = fa.economize(scene, 0.05)
    assert plan.certified and ("bending_z", "symmetry") in {(c.what, c.how) for c in plan.choices}
    strains = {"bending_y": 2, "bending_z": 1, "torsion": 1}
    arm = fa.Arm([fa.Link(x.joint, x.hub, replace(x.beam, modes=strains, order="exact"), x.tip)
                  for x in scene.arm.links])  # fmt: skip
    side = [i for i, name in enumerate(arm.coordinates) if "bending_z" in name or "torsion" in name]
    v0 = np.zeros(arm.nv)
    v0[side] = 1e-4
    kicked = replace(scene, arm=arm, q0=scenes.at(arm, {1: np.pi / 2}), v0=v0)
    with warns(fa.errors.StepWarning, "step = 0.005", "halved"):
        r = scenes.run(kicked, integrator="gauss", step=5e-3)
    M = arm.mass_matrix(r.q)[:, side][:, :, side]
    speed = np.sqrt(np.einsum("ti,tij,tj->t", r.v[:, side], M, r.v[:, side]))
    assert speed[0] > 0 and speed.max() < 10 * speed[0]


def test_a_callable_that_leaves_the_plane_between_output_times_is_seen() -> None:
    arm = clamped({"bending_y": 1, "bending_z": 1})
    push = fa.Load(-1, force=lambda t: (0.0, 0.1, 0.1 * (0.505 < t < 0.515)))
    scene = fa.Scene(arm, loads=(push,), t=np.linspace(0, 1, 11))
    steady = replace(scene, loads=(fa.Load(-1, force=(0.0, 0.1, 0.0)),))
    plans = [fa.economize(s, 0.05) for s in (scene, steady)]
    assert ["symmetry" in {c.how for c in plan.choices if c.what == "bending_z"} for plan in plans] == [False, True]


@pytest.mark.parametrize("axis, stable", [(0, True), (1, False), (2, True)])
def test_a_free_body_that_spins_about_its_middle_axis_is_unstable(axis: int, stable: bool) -> None:
    boom = fa.Beam(0.3, fa.Rectangle(0.01, 0.01), ALUMINIUM, {"bending_y": 1, "bending_z": 1})
    body = fa.RigidBody(5.0, inertia=(0.1, 0.2, 0.3), end=(0.0, 0.0, 0.0))
    arm = fa.Arm([fa.Link(fa.Free(), body, boom)])
    v0 = np.zeros(arm.nv)
    rate = [i for i in range(arm.nv) if arm.coordinate_of(i) < 0][axis]
    v0[rate] = 3.0
    angle = lambda r: np.einsum("tij->tij", r.frame()[1])[:, (axis + 1) % 3, (axis + 1) % 3]  # noqa: E731
    plan = fa.economize(fa.Scene(arm, t=times(6.0), v0=v0, name="spin"), 1e-2, angle)
    assert plan.certified == stable or "against the check" in plan.reasons[0]
    assert any("unstable" in r for r in plan.reasons) != stable


def patched(scene: fa.Scene) -> fa.Scene:
    """The truth of a scene of one link whose beam has one patch: the beam in three pieces, told by hand."""
    link, (patch,) = scene.arm.links[0], scene.arm.links[0].beam.patches
    whole = replace(link, beam=replace(link.beam, order="exact"))
    pieces = fa.split(whole, {"bending_y": 7, "shear_y": 3}, [patch.start, patch.end])
    drive = {key if key == 0 else ("patch", 1, 0): law for key, law in scene.drive.items()}
    return replace(scene, arm=fa.Arm(pieces), drive=drive, options={"integrator": "gauss", "step": 1e-3})


def driven_patch(length: float, h: float, start: float, end: float, thickness: float, moved: float) -> fa.Scene:
    """A strip on a hub that is moved, and on it a pair that a sampled voltage drives."""
    pzt = fa.Piezo(60e9, 0.3, 7500, -200e-12)
    pair = fa.Patch(start, end, 0.02, thickness, pzt)
    damped = {"kelvin_voigt": 1e-4, "patches": [pair]}
    strip = fa.Beam(length, fa.Rectangle(h, 0.02), STEEL, {"bending_y": 4}, "legendre", **damped)
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(0.1, inertia=(1e-4,) * 3, end=(0.05, 0, 0)), strip)])
    t, tv = np.array([0, 0.1, 0.25, 0.35, 0.5]), np.linspace(0, 0.5, 50)
    swing = fa.Motion(t, moved * np.array([0, 0.3, 0.9, 1, 1]), ends="rest")
    return fa.Scene(arm, {0: swing, ("patch", 0, 0): fa.Voltage(tv, 180 * np.sin(33 * tv))}, t=times(0.5, 200))


@pytest.mark.parametrize(
    "scene", [driven_patch(0.583, 0.00202, 0.041, 0.199, 3.2e-4, 0.18), driven_patch(0.3, 0.002, 0.05, 0.13, 2e-5, 0.1)]
)
def test_a_driven_patch_is_judged_by_the_beam_in_pieces(scene: fa.Scene) -> None:
    """Smooth shapes, few or many, miss the jump of the curvature alike: they agree, and are 4e-3 off at 1e-3."""
    plan = fa.economize(scene, 1e-3)
    away = scenes.off(plan.scene.run().frame()[0], patched(scene).run().frame()[0])
    assert not plan.certified or away <= 1e-3
    assert plan.certified or "fa.split" in plan.reasons[0]


def test_a_start_in_balance_is_balanced_anew_in_every_model() -> None:
    """Two modes of a free beam sag otherwise under a payload than the beam does: their strains are no balance of it."""
    beam = fa.Beam(0.8, fa.Rectangle(0.004, 0.02), ALUMINIUM, {"bending_y": 2})
    arm = fa.Arm([fa.Link(fa.Revolute("z"), None, beam, fa.RigidBody(0.3))], gravity=(0, -9.81, 0))
    swing = {0: fa.Motion([0, 0.25, 0.5], [0, 0.02, 0.02], ends="rest")}
    fine = fa.Arm([replace_modes(replace(arm.links[0], beam=replace(beam, basis="legendre")), 8)], arm.gravity)
    truth = fa.simulate(fine, times(0.5, 100), fine.trim().q, drive=swing, integrator="gauss", step=2e-3).frame()[0]
    for q0 in (arm.trim().q, "trim"):
        plan = fa.economize(fa.Scene(arm, swing, t=times(0.5, 100), q0=q0), 2e-3)
        assert plan.certified and scenes.off(plan.scene.run().frame()[0], truth) <= 2e-3
    some = arm.trim().q * [1, 1.2, 0.9]
    plan = fa.economize(fa.Scene(arm, swing, t=times(0.5, 100), q0=some), 2e-3)
    assert "from balance" in str(plan)


def test_an_arm_in_pieces_is_the_same_arm() -> None:
    """Nothing that acts on it, measures it or damps it is lost: with a film too thin to matter, smooth shapes say the
    same."""
    film = fa.Piezo(3e6, 0.3, 1780, 23e-9, permittivity=1e-8)
    bent = {"bending_y": 4, "bending_z": 2}
    damped = {"damping_ratio": 0.02, "damping": np.diag([1e-3] * 6).tolist()}
    beam = fa.Beam(0.4, fa.Rectangle(0.003, 0.02), ALUMINIUM, bent, "legendre", "exact",
                   patches=[fa.Patch(0.06, 0.16, 0.02, 1e-4, film)], **damped)  # fmt: skip
    second = fa.Beam(0.3, fa.Rectangle(0.003, 0.02), ALUMINIUM, {"bending_z": 2})
    joints = fa.Revolute("z", damping=0.01), fa.Revolute("y", damping=0.01)
    arm = fa.Arm([fa.Link(joints[0], hub(0.03, 0.2), beam), fa.Link(joints[1], None, second, fa.RigidBody(0.05))],
                 gravity=(0, -2.0, -9.81))  # fmt: skip
    resonant = fa.LinearController.ppf(60.0, 0.4, -5.0, measure=[("strain", 0, 0.12, "K3")], actuate=[("patch", 0, 0)])
    laws = fa.PD(5, 0.3, -1, reference=0.1), fa.StrainFeedback(20, 1, 0.5, 0, x=0.1, reference=0.2), resonant
    loads = (fa.Load(0, 0.1, force=[[0, 0, 0], [0, 0.5, 0.2], [0, 0, 0]], t=[0, 0.1, 1]),
             fa.Load(0, along=(0.05, 0.3), force=(0, 0.3, 0)), fa.Load(-1, moment=(0, 0.01, 0)))  # fmt: skip
    drive = {("patch", 0, 0): fa.Voltage([0, 0.05, 0.1], [0, 5, 0])}
    models = Models(fa.Scene(arm, drive, loads, times(0.1, 20), q0="trim", control=laws))
    assert models.jumps == {0: [0.05, 0.06, 0.1, 0.16, 0.3]}
    options = {"integrator": "gauss", "step": 1e-2}
    whole, cut = (models.at(replace(models.given, pieces=p), options).run() for p in (False, True))
    assert scenes.off(whole.frame()[0], cut.frame()[0]) < 1e-3
    none = models.at(replace(models.given, pieces=True), options)
    lost = replace(none, control=none.control[:-1]).run()  # without its damping, say
    assert scenes.off(lost.frame()[0], cut.frame()[0]) > 1e-3
