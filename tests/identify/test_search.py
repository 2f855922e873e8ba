"""The search: its curvature, its derivatives, its end; progress of several fits."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from flexarm.identify.identify import _task
from flexarm.identify.search import _bent, _slopes_of_size
from flexarm.identify.statistics import upper
from flexarm.identify.validate.rig import ARM, DEFLECTIONS, PER_RUN, outputs, read, with_motion
from flexarm.run.perturbed import FOURTH, SECOND
from flexarm.run.simulation import source
from messages import warns

EXCERPT = Path(__file__).parents[1] / "data" / "quanser_excerpt.csv"


def test_the_triangle_of_many_rows_is_that_of_all() -> None:
    J = np.random.default_rng(0).normal(size=(3001, 7))
    R = upper(J)
    assert R.shape == (7, 7)
    np.testing.assert_allclose(R.T @ R, J.T @ J, rtol=1e-12, atol=1e-9)


def test_least_squares_of_the_size_take_the_steps_of_all_rows() -> None:
    rng = np.random.default_rng(1)
    r, J = rng.normal(size=200), rng.normal(size=(200, 4))
    bend = np.diag([50.0, 0.0, 10.0, 5.0])
    A = _slopes_of_size(r, J, bend)
    size = np.append(np.linalg.norm(r), np.zeros(4))
    np.testing.assert_allclose(A.T @ size, J.T @ r, rtol=1e-9)
    np.testing.assert_allclose(A.T @ A, J.T @ J + bend, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("loss", ["linear", "huber"])
@pytest.mark.parametrize("noise", [None, {"u": 0.1}])
def test_a_point_without_residuals_is_the_end(noise: Any, loss: Any) -> None:
    """The torque is what the data have, whatever the damping is."""
    arm = fa.Arm([fa.Link(fa.Revolute("z", reflected_inertia=0.05, damping=0.1), tip=fa.RigidBody(0.2))])
    t = np.linspace(0.0, 0.5, 51)
    scene = fa.Scene(arm, {0: fa.Torque(0.0)}, t=t, options={"integrator": "implicit", "step": 0.01})
    data = fa.Data(t, {"u": np.sin(8 * t)}, {"u": "N m"})
    told: Any = {"inputs": {0: "u"}, "outputs": {"u": "tau link 0 revolute"}, "noise": noise, "loss": loss}
    for start in (1.0, 2.0):
        fit = fa.identify(scene, data, {"drive.0.scale": start}, **told)
        assert fit.converged and fit.values["drive.0.scale"] == pytest.approx(1.0, abs=1e-9) and not fit.untold
        assert fit.std["drive.0.scale"] < 0.1
    damping = "link.0.joint.damping"
    with warns(fa.errors.FitWarning, "cannot tell", damping):
        fit = fa.identify(scene, data, [damping], **told)
    assert fit.converged and fit.values[damping] == 0.1 and np.isinf(fit.std[damping])


def test_curvature_is_that_of_the_last_step() -> None:
    rng = np.random.default_rng(2)
    s, rest, y = rng.normal(size=(3, 4))
    y = y if s @ y > 0 else -y
    S = _bent(np.eye(4), s, y, rest)
    np.testing.assert_allclose(S @ s, rest, rtol=1e-9)
    np.testing.assert_allclose(S, S.T, rtol=1e-12)


def test_derivatives_of_outputs_are_those_by_four_neighbours() -> None:
    """Sensors are filtered once for all parameters, by two neighbours; the oracle reads each, by four."""
    recording = read(EXCERPT)
    scene = with_motion(fa.load("quanser"), recording)
    names = dict.fromkeys(DEFLECTIONS, 1e-3)
    task = _task(scene, recording.data, {**ARM, **PER_RUN}, None, outputs(scene, DEFLECTIONS), names, None, 0.01, None)
    run, paths = task.residuals.runs[0], [x.path for x in task.residuals.sought]
    made = source(run.setup, run.t, run.q0, run.v0, **task.residuals.options)
    found = run.slopes(replace(made, by=SECOND).sensitivities(paths), run.setup)
    known = replace(made, by=FOURTH).sensitivities(paths).of(run.read)
    for path, x, y in zip(paths, found, known, strict=True):
        np.testing.assert_allclose(x, y, atol=1e-7 * max(1e-9, np.abs(y).max()), err_msg=path)


def test_large_residuals_do_not_keep_it_from_the_least() -> None:
    """Of a motion that the model lacks, a third of the deviation is left. SciPy's minimum of the squares, without
    derivatives, is the oracle."""
    from scipy.optimize import minimize_scalar

    joint = fa.Revolute("z", reflected_inertia=0.5, stiffness=20.0, damping=0.2)
    arm = fa.Arm([fa.Link(joint, tip=fa.RigidBody(0.1))], gravity=(0, 0, 0))
    t = np.linspace(0.0, 4.0, 201)
    options = {"integrator": "implicit", "step": 0.02}
    scene = fa.Scene(arm, {0: fa.Torque(t, np.sin(5.0 * t))}, t=t, options=options)

    def angle(stiffness: float) -> Any:
        link = replace(arm.links[0], joint=replace(joint, stiffness=stiffness))
        return replace(scene, arm=fa.Arm([link], gravity=(0, 0, 0))).run().q[:, 0]

    true = angle(23.0)
    y = true + 0.5 * true.std() * np.sin(6.0 * t + 1.0)
    path, column = "link.0.joint.stiffness", next(iter(scene.run().to_data()))
    fit = fa.identify(scene, fa.Data(t, {"y": y}, {"y": "rad"}), {path: 20.0}, outputs={"y": column}, starts=1)
    assert fit.nrmse["y"] > 0.2 and fit.converged
    value = fit.values[path]
    near = (0.97 * value, 1.03 * value)
    least = minimize_scalar(lambda x: float(np.sum((angle(x) - y) ** 2)), bracket=near, tol=1e-9)
    assert value == pytest.approx(least.x, abs=0.02 * fit.std[path])


def test_several_fits_have_one_bar() -> None:
    told: list[tuple[float, str]] = []
    fa.validate(data=EXCERPT, progress=lambda done, text="": told.append((done, text)))
    shares = [done for done, _ in told]
    assert shares == sorted(shares) and 0 < shares[0] < shares[-1] <= 1
    said = [f"fit {k} of 5" for k in range(1, 6)]  # the last one only if the drives are not found before
    assert {text for _, text in told} in (set(said), set(said[:-1]))
