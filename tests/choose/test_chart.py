"""`flexarm chart`: the walk over models and settings, what it concludes, and what it says when it cannot go on."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from arms import STEEL, pendulum
from flexarm.choose.chart_search import ChartSearch
from flexarm.choose.trials import CHOSEN, line_options
from flexarm.cli import main
from messages import refuses

SWING = """
gravity = [0, -9.81, 0]
[[link]]
joint = { type = "revolute", axis = "z" }
tip = { mass = 0.05 }
[link.beam]
length = 0.5
section = { type = "rectangle", y = 0.001, z = 0.02 }
material = { density = 7850, youngs_modulus = 209e9, poisson_ratio = 0.3 }
modes = { bending_y = 1 }
[simulation]
duration = 0.1
interval = 0.01
"""


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scene") / "swing.toml"
    path.write_text(SWING)
    return path


@pytest.fixture(scope="module")
def chart(path: Path) -> fa.results.Chart:
    """A heavy steel pendulum let go, with bending along y; rk4 cannot take steps as long as its output interval."""
    return fa.chart(path, budget=15.0)


def off(chart: fa.results.Chart, result: fa.Result) -> float:
    """Largest distance of the tip from the truth's, over the truth's largest range in x, y or z."""
    assert chart.truth is not None
    if not hasattr(chart, "tip_run_again"):
        chart.tip_run_again = chart.scene_of(chart.truth.row).run().frame()[0]  # type: ignore[attr-defined]
    truth = chart.tip_run_again  # type: ignore[attr-defined]
    return float(np.linalg.norm(result.frame()[0] - truth, axis=1).max() / np.ptp(truth, axis=0).max())


def rerun(chart: fa.results.Chart, **change: object) -> fa.Result:
    """The scene at the truth's setting, but with another order, shift or value."""
    assert chart.truth is not None
    it = chart.truth.row
    wanted = change.get("order", it.model.order), change.get("shift", it.model.shift), it.model.basis
    alike = [r.model for r in chart.rows if (r.model.order, r.model.shift, r.model.basis) == wanted]
    factor = change.get("value", it.value) / it.value
    options = {k: factor * x if k in ("rtol", "atol", "step", "tolerance") else x for k, x in it.options.items()}
    return chart.scene_of(replace(it, model=alike[0], options=options)).run()


# -- the truth -----------------------------------------------------------------------------------------------


def test_the_truth_is_the_richest_model_and_says_how_converged_it_is(chart: fa.results.Chart) -> None:
    truth = chart.truth
    assert truth is not None and truth.row.model.order == "exact" and truth.row.model.modes == "5"
    assert truth.row.model.basis == "legendre"
    assert truth.tolerance == pytest.approx(off(chart, rerun(chart, value=truth.row.value * 100)), rel=1e-6)
    assert truth.modes == pytest.approx(off(chart, rerun(chart, shift=3)), rel=1e-6)
    assert truth.order == pytest.approx(off(chart, rerun(chart, order=3)), rel=1e-6)
    assert truth.tolerance < 1e-8 < truth.modes < 1e-3
    assert truth.uncertainty == max(truth.modes, truth.tolerance) < truth.basis
    assert truth.span == {"m": pytest.approx(np.ptp(rerun(chart).frame()[0], axis=0).max())}


def test_the_truth_agrees_with_another_integrator(chart: fa.results.Chart) -> None:
    assert chart.truth is not None
    scene = chart.scene_of(chart.truth.row)
    other = replace(scene, options={"integrator": "rk4", "step": 1e-4}).run()
    assert off(chart, other) < 1e-7


def test_errors_are_those_of_the_runs(chart: fa.results.Chart) -> None:
    for row in [r for r in chart.rows if r.status == "ok"][::7]:
        assert row.error == pytest.approx(off(chart, chart.scene_of(row).run()), rel=1e-5, abs=1e-13)
        assert row.absolute["m"] == pytest.approx(row.error * chart.truth.span["m"]) and row.time > 0


PAYLOAD = fa.RigidBody(0.1, inertia=(1e-4,) * 3)


@pytest.mark.parametrize("links", [1, 2])
def test_the_truth_is_true_and_errors_are_right_with_a_payload(links: int) -> None:
    """Modes of a free beam converge slowly under a body on the tip or another link: the basis is varied."""
    beam = fa.Beam(0.5, fa.Rectangle(0.002, 0.02), STEEL, {"bending_y": 2})

    def arm(beam: fa.Beam) -> fa.Arm:
        more = [fa.Link(fa.Revolute("z"), None, beam, PAYLOAD)] * (links - 1)
        return fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(end=(0.05, 0, 0)), beam, PAYLOAD), *more])

    drive = {k: fa.Motion.spin_up((3.0, -2.0)[k] / links**2, 0.15) for k in range(links)}
    scene = fa.Scene(arm(beam), drive, t=np.linspace(0, 0.2, 41))
    chart = fa.chart(scene, budget=8.0)
    best = replace(beam, modes={"bending_y": 9}, basis="legendre", order="exact")
    known = fa.simulate(arm(best), scene.t, drive=drive, integrator="gauss", step=0.005).frame()[0]

    def wrong(row: Any) -> float:
        run = chart.scene_of(row).run().frame()[0]
        return float(np.linalg.norm(run - known, axis=1).max() / np.ptp(known, axis=0).max())

    truth = chart.truth
    assert truth is not None and truth.basis is not None and "from the scene's basis (order exact, 4" in str(chart)
    assert wrong(truth.row) <= truth.uncertainty < 1e-6 < 1e-4 < truth.basis
    for tol in (1e-2, 1e-3, 1e-4):
        row = chart.recommend(tol)
        assert row is not None and row.error == pytest.approx(wrong(row), rel=1e-2, abs=1e-6)
        assert row.model.basis or tol > 1e-4
    assert {r.model.basis for r in chart.rows} == {"", "legendre", "loaded"}


# -- what it concludes ---------------------------------------------------------------------------------------


def test_nothing_beats_the_front(chart: fa.results.Chart) -> None:
    front = chart.front
    assert len(front) >= 3
    for row in front:
        assert not [r for r in chart.rows if r.time < row.time and r.error and r.error < row.error and r.runs]
    assert [r.time for r in front] == sorted(r.time for r in front)
    assert [r.error for r in front] == sorted((r.error for r in front), reverse=True)


def test_best_on_known_points(chart: fa.results.Chart) -> None:
    points = [(1, 5), (2, 6), (3, 1), (0.5, 9), (3, 0.9), (4, 0.9), (9, 1e-9)]
    row = replace(chart.rows[0], options={"rtol": 1.0}, choice="ida", status="ok")
    rows = [replace(row, time=float(t), error=float(e)) for t, e in points]
    chosen = replace(chart, rows=rows).front
    assert [(r.time, r.error) for r in chosen] == [(0.5, 9), (1, 5), (3, 0.9), (9, 1e-9)]


def test_recommendations_keep_their_tolerance(chart: fa.results.Chart) -> None:
    times = []
    for tol in (1e-2, 1e-3, 1e-4, 1e-5, 1e-6):
        row = chart.recommend(tol)
        assert row is not None and off(chart, chart.scene_of(row).run()) <= tol
        times.append(row.time)
    assert times == sorted(times)
    assert chart.recommend(1e-12) is None  # finer than the truth's own tolerance
    with refuses("tolerance = 0"):
        chart.recommend(0)


def test_poor_models_are_poor_and_kept(chart: fa.results.Chart) -> None:
    assert chart.truth is not None
    it = chart.truth.row.model
    alike = [r for r in chart.rows if r.value == chart.truth.row.value and r.model.basis == it.basis]
    rich = {r.model.order: r.error for r in alike if r.model.shift == it.shift - 2}
    assert rich[0] > 5 * rich[2] > 4 * rich["exact"]
    lines = {"ida", "ida, BDF 2", "implicit", "gauss", CHOSEN, "rk4"}
    assert {r.choice for r in chart.rows if r.status == "ok"} == lines


def test_the_default_run_is_a_line(chart: fa.results.Chart) -> None:
    """The tolerance of steps that are chosen: tighter ones take more steps, and the scene of a row has it."""
    rows = [r for r in chart.rows if r.choice == CHOSEN and r.status == "ok"]
    assert {r.setting for r in rows} == {"tolerance"}
    loose = [r for r in rows if r.value == 1e-2]
    assert loose and all("tolerance 0.01" in r.label for r in loose)
    for model in {r.model for r in loose}:
        of = sorted((r for r in rows if r.model == model), key=lambda r: -r.value)
        assert of[-1].steps >= of[0].steps
    assert chart.scene_of(loose[0]).options == {"integrator": "gauss", "tolerance": 1e-2}
    given = replace(chart.scene, options={"integrator": "gauss", "step": 0.1, "tolerance": 1e-7, "stages": 3})
    assert line_options(given, CHOSEN, 1e-4) == {"integrator": "gauss", "stages": 3, "tolerance": 1e-4}
    assert line_options(given, "gauss", 0.01) == {"integrator": "gauss", "stages": 3, "step": 0.01}


def test_rk4_beyond_its_limit_is_a_row_with_a_reason(chart: fa.results.Chart) -> None:
    failed = chart.with_status("failed")
    assert len({(r.model, r.choice) for r in failed}) == len(failed)  # its next step is one that is stable
    assert failed and all(r.choice == "rk4" and "ran away" in r.reason and r.error is None for r in failed)
    assert any(r.choice == "rk4" and r.value < min(f.value for f in failed) for r in chart.with_status("ok"))
    assert f"{failed[0].label.removesuffix(' s')}" in chart.table()


def test_the_table_reads_for_this_take_that(chart: fa.results.Chart) -> None:
    lines = str(chart).splitlines()
    row = chart.recommend(1e-3)
    assert row is not None and row.error is not None and chart.truth is not None
    line = next(s for s in lines if s.startswith("1e-3"))
    assert row.label in line and f"{row.error:.1e}" in line and f"{1e-3 * chart.truth.span['m']:.2g} m" in line
    starred = {s.split()[0] for s in lines if s.endswith("*") and s[:3] == "1e-"}
    assert starred == {f"1e-{k}" for k in range(2, 7) if 10.0**-k < chart.truth.uncertainty}


def test_the_picture(chart: fa.results.Chart) -> None:
    ax = chart.plot().axes[0]
    assert ax.get_xscale() == ax.get_yscale() == "log"
    drawn = np.concatenate([line.get_xydata() for line in ax.lines])
    for row in chart.front:
        assert np.isclose(drawn[:, 0], row.time, rtol=1e-12).any()
    listed = "\n".join(text.get_text() for text in chart.plot().axes[1].texts)
    assert all(f"{k}  {row.label}" in listed for k, row in enumerate(chart.front, 1)) and len(chart.front) > 1


def notes_in(ax: Any) -> str:
    return " ".join(" ".join(text.get_text() for text in ax.texts).split())


def test_the_picture_says_what_is_not_converged_or_has_no_error(chart: fa.results.Chart) -> None:
    assert chart.truth is not None
    told = notes_in(chart.plot().axes[0])
    assert chart.with_status("failed") and f"{len(chart.with_status('failed'))} of rk4" in told
    assert "NOT CONVERGED" not in told and "PARTIAL" not in told
    doubtful = replace(chart, truth=replace(chart.truth, modes=0.03), complete=False)
    told = notes_in(doubtful.plot().axes[0])
    assert "PARTIAL" in told and "NOT CONVERGED" in told and "3.0e-02" in told
    cut = replace(next(r for r in chart.rows if r.error is not None), status="cut", error=None, time=1.25)
    ax = replace(chart, rows=[*chart.rows, cut]).plot().axes[0]
    crosses = [line.get_xdata()[0] for line in ax.lines if line.get_marker() == "x"]
    assert crosses == [1.25] and "1 run given up" in notes_in(ax)


# -- budget, Ctrl-C, failures --------------------------------------------------------------------------------


def test_a_truth_whose_curvature_jumps_is_compared_with_pieces() -> None:
    """Fewer smooth modes say little of how far off a beam with a stiff patch is: its tip is 2 % off with thirty."""
    pair = fa.Patch(0.02, 0.07, 0.02, 0.0005, fa.Piezo(62e9, 0.31, 7800, -190e-12))
    beam = fa.Beam(0.3, fa.Rectangle(0.002, 0.02), fa.Material(2700, 70e9), {"bending_y": 2}, patches=[pair])
    drive = {("patch", 0, 0): fa.Voltage([0, 0.01, 0.02], [0, 100, 0])}
    scene = fa.Scene(fa.Arm([fa.Link(fa.Fixed(), None, beam)]), drive, t=np.linspace(0, 0.02, 41))
    chart = fa.chart(scene, budget=4)
    assert chart.truth.pieces > 1e-2 and chart.truth.uncertainty >= chart.truth.pieces
    assert "its beams in pieces" in str(chart) and not any(row.model.pieces for row in chart.front)


def test_the_budget_is_kept(path: Path, chart: fa.results.Chart) -> None:
    for share in (0.4, 0.2, 0.6):  # of a time that was measured beside other work
        short = fa.chart(path, budget=share * chart.used)
        skipped = short.with_status("skipped")
        if skipped and short.truth is not None:
            break
    assert skipped and all(r.reason and r.error is None for r in skipped) and "for the budget" in str(short)
    assert short.complete and short.truth is not None and short.front


def test_a_run_longer_than_the_budget_is_given_up() -> None:
    arm = fa.Arm([fa.Link(fa.Revolute("y"), None, fa.Beam(1.0, fa.Circle(0.01), STEEL, {"bending_z": 2}))], (0, 0, -10))
    chart = fa.chart(fa.Scene(arm, t=np.linspace(0, 1e4, 1001)), budget=0.5)
    assert chart.truth is None and "No truth" in str(chart)
    assert chart.with_status("cut") and not chart.with_status("ok")


def test_an_order_that_was_given_up_stands_for_richer_ones_alone(path: Path) -> None:
    search = ChartSearch(fa.load(path), "tip", 1.0, lambda used, doing: None)
    exact, third, second = (search.planned(search.models.uniform(o, 0), "ida", 1e-6) for o in ("exact", 3, 2))
    search.trials.store(replace(third, status="cut", time=5.0))
    assert search.predict(exact) == 5.0 and search.predict(second) == 0.0


@pytest.mark.parametrize("calls", [1, 12])
def test_ctrl_c_keeps_what_was_done(calls: int, path: Path, tmp_path: Path) -> None:
    """In a run of the search for a truth, and in a later one."""
    code = f"""
import os, signal, sys, threading
import flexarm as fa
from flexarm import cli
from flexarm.choose.trials import Trials
run, calls = Trials.run, []
def slow(*args, **options):
    calls.append(1)
    if len(calls) <= {calls}:
        return run(*args, **options)
    threading.Timer(0.2, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, (1, 0, 0)))])
    fa.simulate(arm, [0, 1e6], v0=[1], integrator="rk4", step=1e-3)
Trials.run = slow
sys.exit(cli.main(["chart", {str(path)!r}, "-o", {str(tmp_path)!r}]))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == 130 and "interrupted" in done.stderr and done.stdout.startswith("PARTIAL")
    told = json.loads((tmp_path / "chart.json").read_text())
    assert told["complete"] is False and len(told["rows"]) == calls and told["truth"] is not None
    assert {p.name for p in tmp_path.iterdir()} == {"chart.png", "chart.txt", "chart.csv", "chart.json"}
    assert all(r["error"] is not None for r in told["rows"]) and "Warning" not in done.stderr
    assert calls == 12 or told["truth"]["uncertainty"] is None  # fewer modes were not run: nothing is known


def test_a_scene_that_nothing_can_run_is_an_error(path: Path) -> None:
    scene = replace(fa.load(path), drive={0: fa.Torque([0, 0.05], [0, 0])})  # ends before the simulation
    with refuses("scene", "samples"):
        fa.chart(scene, budget=2.0)


# -- other scenes and quantities -----------------------------------------------------------------------------


def test_a_rigid_arm_has_no_orders_and_no_modes() -> None:
    q0 = np.array([0.3])
    chart = fa.chart(fa.Scene(pendulum(), t=np.linspace(0, 1, 51), q0=q0), budget=5.0, quantity="joint")
    assert chart.truth is not None and chart.truth.modes is None and chart.truth.order is None
    assert chart.truth.span.keys() == {"rad"} and {r.model.label for r in chart.rows} == {"the rigid arm"}
    assert chart.recommend(1e-4) is not None and chart.plot() is not None


def test_strains_have_their_units_and_initial_bending_is_carried(path: Path) -> None:
    scene = replace(fa.load(path), q0=np.array([0.0, 0.01]))
    chart = fa.chart(scene, budget=2.0, quantity="strain")
    assert chart.truth is not None and chart.truth.span.keys() == {"1/m"}
    row = next(r for r in chart.rows if r.model.shift == 2 and not r.model.basis)
    q = chart.scene_of(row).q0
    assert q is not None and list(q) == [0.0, 0.01, 0.0, 0.0]


def test_shapes_of_ones_own_are_not_added_to() -> None:
    beam = fa.Beam(1.0, fa.Circle(0.01), STEEL, {"bending_y": [lambda x: 1 - x, lambda x: (1 - x) ** 2], "torsion": 1})
    own = fa.Arm([fa.Link(fa.Revolute("z"), None, replace(beam, modes={"bending_y": beam.modes["bending_y"]}))])
    both = fa.Arm([fa.Link(fa.Revolute("z"), None, beam)])
    swing = {"drive": {0: fa.Motion.spin_up(1.0, 0.1)}, "t": np.linspace(0, 0.1, 11)}
    rows = [fa.chart(fa.Scene(arm, **swing), budget=1.0).rows for arm in (own, both)]
    models = [{r.model.shift: r.model.modes for r in some} for some in rows]
    assert models[0].keys() == {-1, 0}
    assert models[1].keys() == {-1, 0, 1, 2} and [models[1][s] for s in (-1, 0, 2)] == ["1+1", "2+1", "2+3"]


# -- the command ---------------------------------------------------------------------------------------------


def test_json(path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["chart", str(path), "-o", str(tmp_path), "--budget", "1", "--quantity", "joint", "--json"]) == 0
    out, err = capsys.readouterr()
    told = json.loads(out)
    assert err == "" and told["quantity"] == "joint" and list(told["truth"]["span"]) == ["rad"]
    assert [a["tolerance"] for a in told["recommend"]] == [1e-2, 1e-3, 1e-4, 1e-5, 1e-6]
    take = told["recommend"][1]
    assert told["rows"][take["row"]]["error"] <= 1e-3 and take["absolute"]["rad"] > 0
    with (tmp_path / "chart.csv").open() as f:
        assert sum(1 for _ in f) == 1 + len(told["rows"])


@pytest.mark.parametrize(
    ("argv", "says"),
    [
        (["nope.toml"], "shipped scenes are"),
        (["ist", "--budget", "0"], "budget = 0"),
        (["ist", "--budget", "nan"], "budget = nan"),
        (["ist", "--budget", "soon"], "soon"),
        (["ist", "--quantity", "tips"], "did you mean 'tip'?"),
        (["ist", "--quantity", "joint", "--budget", "5"], "none that is not prescribed"),
    ],
)
def test_bad_arguments(argv: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["chart", *argv, "-o", str(tmp_path)]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("flexarm: ") and err.count("\n") == 1 and says in err


def test_bad_arguments_in_python(path: Path) -> None:
    with refuses("scene = 3"):
        fa.chart(3)  # type: ignore[arg-type]
    with refuses("budget = 'long'"):
        fa.chart(path, budget="long")  # type: ignore[arg-type]
    with refuses("quantity = 'strain'"):
        fa.chart(fa.Scene(pendulum(), q0=np.array([-np.pi / 2])), quantity="strain", budget=1.0)


def test_progress_may_be_a_callable_that_gives_up() -> None:
    seen = []

    def enough(t: float) -> None:
        seen.append(t)
        raise LookupError

    with pytest.raises(LookupError):
        fa.simulate(pendulum(), [0, 1e4], integrator="rk4", step=1e-4, progress=enough)
    assert len(seen) == 1 and 0 < seen[0] < 1e4
