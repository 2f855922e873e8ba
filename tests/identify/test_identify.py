"""Fits of twins: runs of a scene whose numbers are known, with noise, from wrong starts."""

from __future__ import annotations

import re
import warnings
from dataclasses import replace
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from flexarm import _console
from messages import refuses, warns
from twin import DAMPING, MASS, MEASURED, MODULUS, NOISE, TRUE, T, recorded, scene


@pytest.fixture(scope="module")
def data() -> fa.Data:
    return recorded(scene())


def inside(fit: fa.results.Fit, true: dict[str, float], widths: float = 2.0) -> bool:
    """Whether all true values lie within so many half-widths of the intervals."""
    return all(abs(fit.values[k] - x) < widths * 0.5 * np.diff(fit.intervals[k])[0] for k, x in true.items())


# -- what is found -----------------------------------------------------------------------------------------------------


def test_a_twin_from_a_start_wrong_by_three(data: fa.Data) -> None:
    fit = fa.identify(scene(0.15, 0.7e11, 0.15), data, [MASS, MODULUS, DAMPING], **MEASURED)
    assert inside(fit, TRUE) and all(fit.std[k] < 0.01 * x for k, x in TRUE.items())
    assert fit.converged and not fit.untold and not fit.at_bounds
    assert fit.noise == pytest.approx(NOISE, rel=0.15)
    assert all(w.white for run in fit.whiteness for w in run.values())
    link = fit.scene.arm.links[0]
    assert link.tip is not None and link.tip.mass == fit.values[MASS]
    again = fit.scene.run()
    assert again.compare(data, {"angle": fit.scene.sensors[0]}).rmse["angle"] == pytest.approx(NOISE["angle"], rel=0.15)


def test_intervals_by_hand() -> None:
    """A mass on a rail under a known force: x = F t^2 / (2 m), so all of it has a closed form."""
    t, F, m, sigma = np.linspace(0.0, 1.0, 101), 3.0, 2.0, 1e-3
    arm = fa.Arm([fa.Link(fa.Prismatic("x"), tip=fa.RigidBody(m))])
    x = F * t**2 / (2 * m) + sigma * np.random.default_rng(1).normal(size=t.size)
    rail = fa.Scene(arm, {0: fa.Torque(F)}, t=t, options={"integrator": "implicit", "step": 0.01})
    position = {"outputs": {"x": "q link 0 prismatic"}, "noise": {"x": sigma}}
    fit = fa.identify(rail, fa.Data(t, {"x": x}, {"x": "m"}), {MASS: 1.0}, **position)
    a = F * t**2 / 2  # x = a / m: 1 / m is linear least squares
    inverse, spread = (a @ x) / (a @ a), sigma / np.linalg.norm(a)
    assert fit.values[MASS] == pytest.approx(1 / inverse, rel=1e-6)
    assert fit.std[MASS] == pytest.approx(spread / inverse**2, rel=1e-4)
    low, high = fit.intervals[MASS]
    assert high - low == pytest.approx(2 * 1.959964 * fit.std[MASS], rel=1e-4)


def test_a_prior_counts_as_a_reading() -> None:
    """Without data that tell the mass, the prior's interval remains; with both, the inverse variances add."""
    t, F, sigma = np.linspace(0.0, 1.0, 101), 3.0, 1e-2
    arm = fa.Arm([fa.Link(fa.Prismatic("x"), tip=fa.RigidBody(2.0))])
    x = F * t**2 / 4 + sigma * np.random.default_rng(1).normal(size=t.size)
    rail = fa.Scene(arm, {0: fa.Torque(F)}, t=t, options={"integrator": "implicit", "step": 0.01})
    given: dict[str, Any] = {"outputs": {"x": "q link 0 prismatic"}, "noise": {"x": sigma}}
    data = fa.Data(t, {"x": x}, {"x": "m"})
    alone = fa.identify(rail, data, {MASS: 1.5}, **given)
    both = fa.identify(rail, data, {MASS: fa.Unknown(1.5, mean=2.1, std=0.01), "gravity.1": fa.Unknown(
        mean=-9.81, std=0.02)}, **given)  # fmt: skip
    assert both.std["gravity.1"] == pytest.approx(0.02, rel=1e-6)
    assert both.values["gravity.1"] == pytest.approx(-9.81, abs=1e-4)
    assert both.std[MASS] == pytest.approx((alone.std[MASS] ** -2 + 0.01**-2) ** -0.5, rel=0.02)
    assert alone.values[MASS] < both.values[MASS] < 2.1


def test_drive_and_sensors_are_sought_too() -> None:
    true = {"drive.0.scale": 1.1, "drive.0.offset": 0.02, "drive.0.delay": 0.0033, "sensor.0.offset": 0.01,
            "sensor.1.gain": 1.07, "sensor.1.delay": 0.0021, "sensor.1.filter.frequency": 25.0}  # fmt: skip
    base = replace(scene(), sensors=(scene().sensors[0], fa.sensors.StrainGauge(0, 0.01, filter=40.0)))
    torque, (encoder, gauge) = base.drive[0], base.sensors
    sensors = replace(encoder, offset=0.01), replace(gauge, gain=1.07, delay=0.0021, filter=25.0)
    data = recorded(replace(base, drive={0: torque.scaled(1.1).moved(0.02, 0.0033)}, sensors=sensors))
    known = {MODULUS: 2.09e11}
    fit = fa.identify(base, data, [*true, MODULUS], **MEASURED)
    assert inside(fit, {**true, **known})
    assert abs(fit.values["drive.0.delay"] - 0.0033) < 3e-4


def test_a_gauge_that_saturates_is_fitted_as_it_is(data: fa.Data) -> None:
    """A fifth of its readings stand at the end of its range, and say no more than that."""
    most = float(np.quantile(np.abs(data["strain"]), 0.8))
    cut = fa.Data(T, {**data.columns, "strain": np.clip(data["strain"], -most, most)}, data.units)
    base = scene(0.08, 1.5e11)
    sensors = (base.sensors[0], fa.sensors.StrainGauge(0, 0.01, range=most))
    fit = fa.identify(replace(base, sensors=sensors), cut, [MASS, MODULUS, DAMPING], **MEASURED)
    assert inside(fit, TRUE) and fit.nrmse["strain"] < 0.05


def test_a_sensor_that_samples_less_often_than_the_data_is_refused(data: fa.Data) -> None:
    slow = replace(scene(), sensors=(scene().sensors[0], fa.sensors.StrainGauge(0, 0.01, rate=50)))
    with refuses("outputs['strain']", "50 Hz", "200 Hz", "rate=None", "samples", "rows"):
        fa.identify(slow, data, MASS, **MEASURED)
    fast = replace(scene(), sensors=(scene().sensors[0], fa.sensors.StrainGauge(0, 0.01, rate=200)))
    assert inside(fa.identify(fast, data, MASS, **MEASURED), {MASS: 0.05})


@pytest.mark.parametrize(("integrator", "step"), [("implicit", 1e-3), ("gauss", 5e-3)])
def test_friction_from_stick_slip(integrator: str, step: float) -> None:
    options = {"integrator": integrator, "step": step}
    data = recorded(scene(coulomb=0.1))
    start = replace(scene(0.03, 3e11, coulomb=0.2), options=options)
    fit = fa.identify(start, data, [MASS, MODULUS, "link.0.joint.coulomb"], **MEASURED)
    assert inside(fit, {MASS: 0.05, MODULUS: 2.09e11, "link.0.joint.coulomb": 0.1}, 2.5)
    assert fit.std["link.0.joint.coulomb"] < 0.002


def test_runs_with_starts_of_their_own(data: fa.Data) -> None:
    twins = [replace(scene(), q0=np.array([q, 0, 0])) for q in (0.1, -0.2)]
    fit = fa.identify(scene(0.08), [recorded(x, k) for k, x in enumerate(twins)], [MASS, "q0.0"], **MEASURED)
    assert inside(fit, {MASS: 0.05, "run 0: q0.0": 0.1, "run 1: q0.0": -0.2})
    third = fit.validate(recorded(replace(scene(), q0=np.array([0.4, 0, 0])), 7))
    assert third.rmse["angle"] == pytest.approx(NOISE["angle"], rel=0.15)


def test_a_joint_that_moves_as_measured(data: fa.Data) -> None:
    exact = recorded(scene(), noise={"strain": 2e-6})
    fit = fa.identify(scene(0.1), exact, [MASS], inputs={0: (fa.Motion, "angle")}, outputs={"strain": "sensor.1"})
    assert fit.values[MASS] == pytest.approx(0.05, rel=0.02)


def test_several_starts_leave_a_local_minimum(data: fa.Data) -> None:
    """From a beam a hundred times too soft one search ends elsewhere, and says so; of several, one does not."""
    soft = scene(0.05, 2e9)
    with warns(fa.errors.FitWarning, "local minimum"):
        lost = fa.identify(soft, data, [MASS, MODULUS, DAMPING], **MEASURED, starts=1)
    assert lost.nrmse["strain"] > 0.5
    sought = {MASS: fa.Unknown(low=0.01, high=0.2), MODULUS: fa.Unknown(low=1e9, high=1e12), DAMPING: None}
    found = fa.identify(soft, data, sought, starts=24, **MEASURED)
    assert inside(found, TRUE)
    assert sum(end is not None for _, end in found.starts) == 3
    near = fa.identify(scene(0.05 / 3, 2.09e11 / 3, 0.15), data, [MASS, MODULUS, DAMPING], **MEASURED)
    assert inside(near, TRUE)  # of one start, and of more where that is not enough


def test_outputs_of_any_kind_give_the_same(data: fa.Data) -> None:
    one = fa.identify(scene(0.08), data, [MASS], inputs={0: "torque"}, outputs={"angle": "sensor.0"})
    for what in (fa.sensors.Encoder(0, pulses=500), "q link 0 revolute", lambda r: r.q[:, 0]):
        other = fa.identify(scene(0.08), data, [MASS], inputs={0: "torque"}, outputs={"angle": what})
        assert other.values[MASS] == pytest.approx(one.values[MASS], rel=1e-6)
    renamed = fa.Data(T, {"sensor.0": data["angle"], "torque": data["torque"]})
    assert fa.identify(scene(0.08), renamed, [MASS], inputs={0: "torque"}).values == one.values


# -- what is told of it ------------------------------------------------------------------------------------------------


def test_what_the_data_cannot_tell_is_named(data: fa.Data) -> None:
    """Stiffness and mass of a strip go with its width; all inertia with the torque."""
    names = [MODULUS, "link.0.beam.material.density", "link.0.beam.section.z", DAMPING]
    with warns(fa.errors.FitWarning, "cannot tell"):
        fit = fa.identify(scene(0.06), data, [*names, MASS], **MEASURED)
    assert len(fit.untold) == 1 and set(fit.untold[0].names) == set(names[:3])
    changes = dict(zip(fit.untold[0].names, fit.untold[0].changes, strict=True))
    assert changes[names[0]] == pytest.approx(changes[names[1]], rel=0.02)
    assert changes[names[0]] == pytest.approx(-changes[names[2]], rel=0.02)
    assert np.isinf(fit.std[MODULUS]) and inside(fit, {MASS: 0.05, DAMPING: 0.05})
    assert "link.0.beam.section.z" in fit.report()
    assert fit.values["link.0.beam.section.z"] == pytest.approx(0.02, rel=0.1)
    with warns(fa.errors.FitWarning, "gravity.2"):  # along the joint's axis
        assert np.isinf(fa.identify(scene(), data, {MASS: None, "gravity.2": -9.81}, **MEASURED).std["gravity.2"])


@pytest.mark.filterwarnings("ignore::flexarm.errors.FitWarning")  # the others
@pytest.mark.parametrize("coloured", [False, True])
def test_data_that_no_number_moves_tell_none_of_them(data: fa.Data, coloured: bool) -> None:
    """The arm stays in its plane."""
    beside = 1e-3 * np.random.default_rng(0).normal(size=len(T))
    if coloured:
        beside = fa.sensors.LowPass(5.0).apply(T, beside)
    data = replace(data, columns={**data.columns, "z": beside}, units={**data.units, "z": "m"})
    with warns(fa.errors.FitWarning, "cannot tell", MASS):
        fit = fa.identify(scene(), data, [MASS, DAMPING], inputs={0: "torque"}, outputs={"z": "end z"})
    assert {x.names for x in fit.untold} == {(MASS,), (DAMPING,)} and not fit.loose
    assert all(np.isinf(x) for x in fit.std.values()) and "hardly be seen" in fit.report()


def test_coloured_residuals_widen_intervals(data: fa.Data) -> None:
    rng = np.random.default_rng(4)
    noise = fa.sensors.LowPass(5.0).apply(T, rng.normal(size=len(T)))
    noise *= NOISE["angle"] / noise.std()
    clean = recorded(scene(), noise={})
    coloured = fa.Data(T, {**clean.columns, "angle": clean["angle"] + noise}, clean.units)
    only: dict[str, Any] = {"inputs": {0: "torque"}, "outputs": {"angle": "sensor.0"}}
    white, dyed = (fa.identify(scene(), d, [MASS, DAMPING], **only) for d in (data, coloured))
    assert white.whiteness[0]["angle"].white and not dyed.whiteness[0]["angle"].white
    assert dyed.noise["angle"] == pytest.approx(white.noise["angle"], rel=0.2)
    assert dyed.std[DAMPING] > 2 * white.std[DAMPING]
    assert "not white" in dyed.report() and "not white" not in white.report()
    assert "step of the integrator" in dyed.report() and "sensor whose filter" in dyed.report()


def test_noise_that_was_told_wrong_is_named(data: fa.Data) -> None:
    fit = fa.identify(scene(), data, [MASS], **MEASURED, noise={"angle": 1e-5})
    assert "times the noise that was told" in fit.report() and fit.noise["angle"] == 1e-5


def test_a_bound_is_kept_and_named(data: fa.Data) -> None:
    fit = fa.identify(scene(0.1), data, {MASS: fa.Unknown(low=0.08), MODULUS: None}, **MEASURED)
    assert fit.at_bounds == [MASS] and fit.values[MASS] == pytest.approx(0.08) and fit.intervals[MASS][0] >= 0.08


def test_report_and_figure(data: fa.Data) -> None:
    fit = fa.identify(scene(), data, [MASS, DAMPING], **MEASURED)
    text = fit.report()
    assert str(fit) == text and all(name in text for name in (MASS, DAMPING, "angle", "strain", "estimated"))
    figure = fit.plot()
    assert [ax.get_title(loc="left")[:6] for ax in figure.axes if ax.lines][:1] == ["angle,"]
    assert fit.to_dict()["values"] == fit.values
    assert fit.correlation.shape == (2, 2) and fit.correlation[0, 0] == pytest.approx(1)


def test_a_step_too_long_for_the_data_is_shortened(data: fa.Data) -> None:
    long = replace(scene(), options={"integrator": "implicit", "step": 0.005})
    with warns(fa.errors.FitWarning, "moves"):
        biased = fa.identify(long, data, [MASS, MODULUS, DAMPING], **MEASURED)
    fit = fa.identify(scene(), data, [MASS, MODULUS, DAMPING], **MEASURED)
    assert fit.stats["step"] < 0.005 and inside(fit, TRUE) and not inside(biased, TRUE)


# -- what is refused ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("parameters", "given", "said"),
    [
        ({}, {}, "at least one"),
        (5, {}, "parameters = 5"),
        (["link.0.tip.mas"], {}, "'link.0.tip.mass'"),
        (["link.0.joint"], {}, "number"),
        (["gravity"], {}, "'gravity.0'"),
        (["q0.9"], {}, "'q0."),
        (["sensor.1.filter.frequency"], {}, "filter"),
        ({MASS: "heavy"}, {}, "number"),
        ({MASS: -1.0}, {}, "negative"),
        ({MASS: fa.Unknown(low=0.1)}, {}, ("start = 0.05", "0.1")),
        ({"link.0.joint.upper": None}, {}, "start"),
        ([MASS], {"outputs": {"angel": "sensor.0"}}, ("outputs['angel']", "'angle'")),
        ([MASS], {"outputs": {"angle": "sensor.5"}}, "sensor.0, sensor.1"),
        ([MASS], {"outputs": {"angle": "q link 1"}}, "outputs['angle']"),
        ([MASS], {"outputs": {"angle": "sensor.1"}}, ("'sensor.1.gain'", "rad", "strain")),
        ([MASS], {"outputs": {"angle": fa.sensors.StrainGauge(0, x=0.02, gauge_factor=2.1)}},
         ("'sensor.2.gain'", "rad", "dR/R")),
        ([MASS], {"outputs": {"angle": fa.sensors.Camera(0)}}, "3 components"),
        ([MASS], {"outputs": {"angle": lambda r: r.q}}, "row"),
        ([MASS], {"outputs": None}, ("column", "data")),
        ([MASS], {"outputs": {"still": "sensor.0"}}, ("'still'", "constant")),
        ([MASS], {"inputs": {0: "torqe"}}, "'torque'"),
        ([MASS], {"inputs": {5: "torque"}}, "inputs[5]"),
        ([MASS], {"inputs": {0: "angle"}}, "(fa.Motion, 'angle')"),
        ([MASS], {"inputs": {0: (fa.Motion, "torque")}}, "rad or m"),
        ([MASS], {"noise": {"angle": 0.0}}, "positive"),
        ([MASS], {"noise": {"torque": 1.0}}, "key 'torque'"),
        ([MASS], {"starts": 0}, "starts = 0"),
        ([MASS], {"integrator": "euler"}, "integrator"),
        (["q0.0"], {"inputs": {0: (fa.Motion, "angle")}}, ("motion", "prescribed")),
        ([MASS, "link.0.tip"], {}, "number"),
    ],
)
def test_bad_input_is_named(parameters: Any, given: dict[str, Any], said: str, data: fa.Data) -> None:
    with_still = fa.Data(T, {**data.columns, "still": np.full(len(T), 0.1)}, data.units)
    with refuses(said):
        fa.identify(scene(), with_still, parameters, **{**MEASURED, **given})


def test_a_gauge_whose_gain_is_sought_may_be_measured_in_rad(data: fa.Data) -> None:
    """As the message tells: 5 rad for a strain of 1, so 2.5 rad for each unit of dR/R at a gauge factor of 2."""
    gauge = fa.sensors.StrainGauge(link=0, x=0.01, gauge_factor=2.0)
    in_rad = fa.Data(T, {**data.columns, "bend": 5.0 * data["strain"]}, {**data.units, "bend": "rad"})
    given = {**MEASURED, "outputs": {"bend": gauge}}
    with refuses("'sensor.2.gain'", "parameters"):
        fa.identify(scene(), in_rad, [DAMPING], **given)
    found = fa.identify(scene(), in_rad, [DAMPING, "sensor.2.gain"], **given)
    assert found.values["sensor.2.gain"] == pytest.approx(2.5, rel=0.05)


def test_bad_data_are_named(data: fa.Data) -> None:
    with refuses("fa.Data"):
        fa.identify(scene(), "rig.csv", [MASS], **MEASURED)  # type: ignore[arg-type]
    with refuses("fa.Scene"):
        fa.identify(scene().arm, data, [MASS], **MEASURED)  # type: ignore[arg-type]
    with refuses("empty", "list"):
        fa.identify(scene(), [], [MASS], **MEASURED)
    with refuses("t = 0", "samples"):
        fa.identify(scene(), data.shift(3.0), [MASS], outputs=MEASURED["outputs"])
    short = data.between(0.0, 0.01)
    with refuses("7 numbers", "3 readings"):
        fa.identify(scene(), short, [MASS, MODULUS, DAMPING, "q0.0", "v0.0", "q0.1", "q0.2"], inputs={0: "torque"},
                    outputs={"angle": "sensor.0"})  # fmt: skip
    kept = np.delete(np.arange(len(T)), range(50, 60))
    gap = fa.Data(T[kept], {k: x[kept] for k, x in data.columns.items()}, data.units)
    with warns(fa.errors.DataWarning, "0.055 s", "t = 0.245", "gap"):
        fa.identify(scene(), gap, [MASS], **MEASURED)


@pytest.mark.filterwarnings("ignore::flexarm.errors.StepWarning")
def test_a_run_that_diverges_within_the_fit_shortens_the_step(data: fa.Data) -> None:
    """rk4 above its limit at the start's stiffness is an error; from a start below it, the search goes on past it."""
    stiff = replace(scene(modulus=2e14), options={"integrator": "rk4", "step": 1e-3})
    told = ("8 starts", "link.0.beam", "youngs_modulus = 2e+14")
    with refuses(told, error=fa.errors.FitError) as e:
        fa.identify(stiff, data, [MODULUS], **MEASURED)
    assert e.value.values == {MODULUS: 2e14}
    several = {MODULUS: fa.Unknown(low=1e10, high=1e15)}
    fit = fa.identify(stiff, data, several, starts=12, **MEASURED)
    assert fit.values[MODULUS] == pytest.approx(2.09e11, rel=1e-3)
    assert not np.isfinite(fit.starts[0][0]) and "could not be simulated" in fit.report()


@pytest.mark.filterwarnings("ignore::flexarm.errors.FitWarning")
def test_interrupted_keeps_its_best(data: fa.Data) -> None:
    def stop(runs: int) -> None:
        if runs > 30:
            raise KeyboardInterrupt

    with pytest.raises(fa.errors.FitInterrupted) as e:
        fa.identify(scene(0.15, 0.7e11, 0.15), data, [MASS, MODULUS, DAMPING], **MEASURED, progress=stop)
    assert isinstance(e.value, KeyboardInterrupt) and e.value.fit is not None
    fit = e.value.fit
    assert not fit.converged and "did not come to its end" in fit.report()
    nothing = fa.identify(scene(0.15, 0.7e11, 0.15), data, ["gravity.2"], **MEASURED)
    assert fit.nrmse["strain"] < 0.7 * nothing.nrmse["strain"]


def test_a_long_fit_tells_how_long_it_takes(
    data: fa.Data, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without a terminal: no estimate before the first iteration is done, one after it."""
    for name in ("_FIRST_LINE", "_EACH_LINE"):
        monkeypatch.setattr(_console, name, 0.0)
    fa.identify(scene(0.04), data, [MASS], **MEASURED, starts=1, progress=True)
    lines = capsys.readouterr().err.splitlines()
    assert "iteration 1" in lines[0] and "in all" not in lines[0]
    estimate = r"iteration 2, rms \S+; about \S+ m?s in all if it takes 21 iterations, which is usual\): \S+ m?s so far"
    assert any(re.search(estimate, line) for line in lines)


# -- whether intervals hold --------------------------------------------------------------------------------------------


def test_intervals_hold_in_95_percent() -> None:
    """Of 12 twins of three numbers; bench/identify/coverage.py counts more, of more kinds. Errors over deviations must
    be about one, so that intervals are neither too narrow nor too wide."""
    hits, errors = [], []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        clean = recorded(scene(), noise={})
        for k in range(12):
            rng = np.random.default_rng([9, k])
            noisy = {name: clean[name] + x * rng.normal(size=len(T)) for name, x in NOISE.items()}
            data = fa.Data(T, {**noisy, "torque": clean["torque"]}, clean.units)
            fit = fa.identify(scene(0.06, 1.9e11, 0.06), data, list(TRUE), **MEASURED, step=1.25e-3)
            hits.append([fit.intervals[p][0] <= x <= fit.intervals[p][1] for p, x in TRUE.items()])
            errors.append([(fit.values[p] - x) / fit.std[p] for p, x in TRUE.items()])
    assert np.mean(hits) >= 0.84  # 95 % less three standard deviations of a count of 36
    assert 0.7 < np.sqrt(np.mean(np.square(errors))) < 1.35


def test_noise_that_is_told_far_too_large_is_named(data: fa.Data) -> None:
    fit = fa.identify(scene(0.08), data, [MASS, DAMPING], **MEASURED, noise={"angle": 30 * NOISE["angle"]})
    said = [note for note in fit.notes() if "smaller than the noise that was told" in note]
    assert len(said) == 1 and said[0].startswith("Residuals of angle are 3")


def test_numbers_that_stand_in_for_each_other_say_how_far() -> None:
    """A mass on a rail under a known force and a pull of gravity, over a hundredth of a metre: both give one
    acceleration, but for a drag. By hand: the pair's change that leaves 1 % more."""
    t, sigma = np.linspace(0.0, 1.0, 101), 1e-4
    force = 3.0 + 0.1 * t
    arm = fa.Arm([fa.Link(fa.Prismatic("x"), tip=fa.RigidBody(2.0))], gravity=(0, 0, 0))
    x = (1.5 * t**2 + 0.1 * t**3 / 6) / 2 + sigma * np.random.default_rng(1).normal(size=t.size)
    options = {"integrator": "implicit", "step": 0.002}
    rail = fa.Scene(arm, {0: fa.Torque(t, force)}, t=t, options=options)
    fit = fa.identify(rail, fa.Data(t, {"x": x}, {"x": "m"}), {"drive.0.scale": 1.0, "gravity.0": 0.0},
                      outputs={"x": "q link 0 prismatic"}, noise={"x": sigma})  # fmt: skip
    J = np.column_stack([(1.5 * t**2 + 0.1 * t**3 / 6) / 2, t**2 / 2])  # by the scale, by gravity
    (found,) = fit.loose
    assert found.names == ("drive.0.scale", "gravity.0") and found.correlation > 0.95
    left = x - J @ [fit.values["drive.0.scale"], fit.values["gravity.0"]]
    more = left - J @ found.changes
    assert np.linalg.norm(more) / np.linalg.norm(left) == pytest.approx(1.01, abs=1e-4)
    assert "leaves 1 % more" in "\n".join(fit.notes())


def test_three_numbers_whose_sum_alone_is_told_are_named_together() -> None:
    """Three forces on a mass, which only their slow waves tell apart: no two are correlated by 0.95. By hand: the
    multiple correlation of the first with the others, and the change that leaves 1 % more."""
    t, h, sigma = np.linspace(0.0, 1.0, 101), 0.01, 1e-4
    pushes = 2.0 + 2.0 * np.array([np.sin(np.pi * t), np.cos(3 * np.pi * t)])
    a = np.array([*(pushes / 2.0), np.ones(101)])  # linear between the samples, and integrated twice
    v = np.cumsum(np.insert((a[:, 1:] + a[:, :-1]) * h / 2, 0, 0.0, axis=1), axis=1)
    steps = v[:, :-1] * h + (2 * a[:, :-1] + a[:, 1:]) * h**2 / 6
    J = np.cumsum(np.insert(steps, 0, 0.0, axis=1), axis=1).T
    x = J @ [1.0, 1.0, 0.5] + sigma * np.random.default_rng(1).normal(size=t.size)
    arm = fa.Arm([fa.Link(fa.Prismatic("x"), tip=fa.RigidBody(2.0))], gravity=(0.5, 0, 0))
    load = fa.Load(0, force=np.column_stack([pushes[1], 0 * t, 0 * t]), t=t)
    rail = fa.Scene(arm, {0: fa.Torque(t, pushes[0])}, loads=(load,), t=t,
                    options={"integrator": "implicit", "step": 0.002})  # fmt: skip
    paths = {"drive.0.scale": 1.0, "load.0.scale": 1.0, "gravity.0": 0.5}
    fit = fa.identify(rail, fa.Data(t, {"x": x}, {"x": "m"}), paths, outputs={"x": "q link 0 prismatic"},
                      noise={"x": sigma})  # fmt: skip
    assert np.abs(fit.correlation - np.eye(3)).max() < 0.95
    (found,) = fit.loose
    assert found.names == tuple(paths)
    C = np.linalg.inv(J.T @ J)
    assert found.correlation == pytest.approx(np.sqrt(1 - 1 / (C[0, 0] * (J.T @ J)[0, 0])), abs=1e-4)
    left = x - J @ list(fit.values.values())
    assert np.linalg.norm(left - J @ found.changes) / np.linalg.norm(left) == pytest.approx(1.01, abs=5e-4)
    np.testing.assert_allclose(found.changes, C[0] / C[0, 0] * found.changes[0], rtol=1e-3)


def test_all_warnings_of_the_fitted_runs_are_told(data: fa.Data) -> None:
    """Those of ranges alone had been: a pulse of a load that no step has seen was not."""
    push = fa.Load(0, force=lambda t: (0.0, 1e-3 if 0.5014 < t < 0.5016 else 0.0, 0.0))
    options = {"integrator": "implicit", "step": 5e-3}
    with warns(fa.errors.StepWarning, "loads[0]", "0.001", "t = 0.50"):
        fa.identify(replace(scene(), loads=(push,), options=options), data, [MASS], **MEASURED)


def test_each_run_has_a_scene_of_its_own() -> None:
    """Tips of 50 and 80 g, which are known."""
    twins = [scene(0.05 + x) for x in (0.0, 0.03)]
    runs = [recorded(x, k) for k, x in enumerate(twins)]

    base = [scene(0.05, 1.5e11), scene(0.08, 1.5e11)]
    fit = fa.identify(base, runs, [MODULUS, DAMPING], **MEASURED)
    assert inside(fit, {MODULUS: TRUE[MODULUS], DAMPING: TRUE[DAMPING]})
    assert all(c.nrmse["strain"] < 0.05 for c in fit.comparisons)
    alike = fa.identify(base[0], runs, [MODULUS, DAMPING], **MEASURED, starts=1)
    assert alike.nrmse["strain"] > 2 * fit.nrmse["strain"]
    with refuses("scene", "2 scenes", "3 runs"):
        fa.identify(base, [*runs, runs[0]], [MODULUS], **MEASURED)
