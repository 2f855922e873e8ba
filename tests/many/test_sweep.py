"""Sweeps: what is varied, what is noted, what is kept when one is interrupted or killed."""

import csv
import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import flexarm as fa
import h5py
import numpy as np
import pytest
from arms import SCENES, toml
from flexarm.cli import main
from flexarm.many.sweeps.quantities import QUANTITIES, settling_time
from messages import refuses, warns
from scipy import stats

LENGTH, STIFF = "link.0.beam.length", "link.0.beam.material.youngs_modulus"


def scene(**changes):
    """The paper's arm, coarse and short."""
    options = {"integrator": "implicit", "step": 4e-3}
    return replace(fa.load("ist"), t=np.linspace(0.0, 0.4, 21), options=options, **changes)


def plan(count=6, **more):
    return fa.SweepPlan([fa.Vary("grid", {LENGTH: {"from": 0.3, "to": 0.4, "count": count}})], **more)


# -- the picture ---------------------------------------------------------------------------------------------


def test_the_picture_of_a_sweep_has_units_and_reasons():
    axes = {LENGTH: [0.3, 0.4], STIFF: {"from": 1e11, "to": 2e11, "count": 3}}
    found = fa.sweep(scene(), fa.SweepPlan([fa.Vary("grid", axes)], outputs=["tip_deflection"]))
    found.columns["tip deflection"][2] = np.nan
    found.failures.append((2, 0.1, "as told"))
    figure = found.plot()
    assert figure.axes[0].get_ylabel() == f"{LENGTH} (m)"
    assert figure.axes[0].get_xlabel().replace("\n", " ") == f"{STIFF} (Pa)"
    assert figure.legends[0].get_texts()[0].get_text() == "failed: 1" and "1 failed" in figure.get_suptitle()


# -- what is varied -----------------------------------------------------------------------------------------


def test_grid_is_every_combination_the_last_fastest():
    stiff = {"from": 1e11, "to": 1e13, "count": 3, "scale": "log"}
    p = fa.SweepPlan([fa.Vary("grid", {LENGTH: [0.3, 0.4], STIFF: stiff})])
    found = p.parameters()
    assert found[LENGTH].tolist() == [0.3] * 3 + [0.4] * 3
    np.testing.assert_allclose(found[STIFF], [1e11, 1e12, 1e13] * 2, rtol=1e-14)


def test_blocks_combine_as_products_or_side_by_side():
    blocks = [fa.Vary("list", {"a": [1, 2], "b": [[1, 2, 3], [4, 5, 6]]}), fa.Vary("grid", {"c": [7, 8]})]
    found = fa.SweepPlan(blocks).parameters()
    assert found["a"].tolist() == [1, 1, 2, 2] and found["c"].tolist() == [7, 8, 7, 8]
    assert found["b"].tolist() == [[1, 2, 3]] * 2 + [[4, 5, 6]] * 2
    beside = fa.SweepPlan(blocks, combine="zip").parameters()
    assert beside["a"].tolist() == [1, 2] and beside["c"].tolist() == [7, 8]


def test_random_draws_follow_their_distributions_and_their_seed():
    laws = {
        "u": {"uniform": [2, 5]}, "l": {"loguniform": [1e-3, 10]}, "n": {"normal": [3, 0.5]},
        "g": {"lognormal": [2, 0.3]}, "s": stats.triang(0.5),
    }  # fmt: skip
    block = fa.Vary("random", laws, count=4000, seed=7)
    found = block.parameters()
    truth = {
        "u": stats.uniform(2, 3), "l": stats.loguniform(1e-3, 10), "n": stats.norm(3, 0.5),
        "g": stats.lognorm(0.3, scale=2), "s": stats.triang(0.5),
    }  # fmt: skip
    for name, law in truth.items():
        assert stats.kstest(found[name], law.cdf).pvalue > 1e-3, name
    assert abs(np.corrcoef(found["u"], found["n"])[0, 1]) < 0.06
    again, other = block.parameters(), replace(block, seed=8).parameters()
    assert np.array_equal(found["u"], again["u"]) and not np.array_equal(found["u"], other["u"])


@pytest.mark.parametrize("kind", ["random", "latin_hypercube"])
def test_drawn_blocks_of_one_seed_are_independent(kind):
    a, b, c = (fa.Vary(kind, {name: {"uniform": [0, 1]}}, count=200) for name in "abc")
    found = fa.SweepPlan([a, b, c], combine="zip").parameters()
    np.testing.assert_array_equal(found["a"], a.parameters()["a"])
    assert np.abs(np.corrcoef([found[k] for k in "abc"])[np.triu_indices(3, 1)]).max() < 0.2
    again = fa.SweepPlan([a, b, c], combine="zip").parameters()
    assert all(np.array_equal(found[k], again[k]) for k in "abc")
    own = [a, replace(b, seed=1), fa.Vary("list", {"d": np.arange(200.0)})]
    for block in own:  # a seed that no block before it has
        name = next(iter(block.values))
        np.testing.assert_array_equal(fa.SweepPlan(own, combine="zip").parameters()[name], block.parameters()[name])
    both = fa.SweepPlan([replace(a, count=3), replace(b, count=3)]).parameters()
    assert not np.array_equal(np.unique(both["a"]), np.unique(both["b"]))


def test_latin_hypercube_has_one_draw_in_every_slice():
    n = 50
    values = {"a": {"uniform": [0, 1]}, "b": {"normal": [0, 1]}}
    found = fa.Vary("latin_hypercube", values, count=n, seed=1).parameters()
    for u in (found["a"], stats.norm.cdf(found["b"])):
        assert sorted(np.floor(u * n).astype(int)) == list(range(n))


def test_a_sweep_file_says_the_same_with_paths_as_tables(tmp_path):
    values = {"link": {"0": {"tip": {"mass": {"uniform": [0, 1]}}}}}
    d = {"vary": [{"kind": "random", "count": 3, "seed": 2, "values": values}]}
    assert list(fa.SweepPlan.load(toml(tmp_path, d)).parameters()) == ["link.0.tip.mass"]
    grid = {"vary": [{"values": {"drive": {"0": {"scale": [1, 2]}}}}], "combine": "zip", "outputs": ["strain"]}
    assert fa.SweepPlan.load(toml(tmp_path, grid)).parameters()["drive.0.scale"].tolist() == [1, 2]


@pytest.mark.parametrize(
    ("d", "says"),
    [
        ({}, "vary"),
        ({"vary": [{"values": {"a": [1]}}], "output": []}, "'outputs'"),
        ({"vary": [{"values": {"a": [1]}}], "outputs": ["strian"]}, "'strain'"),
        ({"vary": [{"kind": "lattice", "values": {"a": [1]}}]}, "vary[0].kind = 'lattice'"),
        ({"vary": [{"kind": "random", "values": {"a": {"uniform": [0, 1]}}}]}, "vary[0].count"),
        ({"vary": [{"kind": "random", "count": 2, "values": {"a": {"uniform": [1, 0]}}}]}, "low < high"),
        ({"vary": [{"kind": "random", "count": 2, "values": {"a": {"unifrm": 1, "to": 1}}}]}, "'uniform'"),
        ({"vary": [{"kind": "grid", "count": 2, "values": {"a": [1]}}]}, "values"),
        ({"vary": [{"values": {"a": {"from": 0, "to": 1, "count": 3, "scale": "log"}}}]}, "positive"),
        ({"vary": [{"values": {"a": {"from": 0, "to": 1}}}]}, "missing"),
        ({"vary": [{"kind": "list", "values": {"a": [1, 2], "b": [1]}}]}, ("2 of a", "1 of b")),
        ({"vary": [{"values": {"a": [1]}}, {"values": {"a": [2]}}]}, ("'a'", "twice")),
        ({"vary": [{"values": {"a": [1, 2]}}, {"values": {"b": [2]}}], "combine": "zip"}, "2 of vary[0]"),
        ({"vary": [{"values": {"a": ["x"]}}]}, "numbers"),
        ({"vary": [{"values": {key: {"from": 0, "to": 1, "count": 1000} for key in "abc"}}]}, "scenarios"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_sweep_is_named(d, says, tmp_path):
    with refuses(says):
        fa.SweepPlan.load(toml(tmp_path, d)).parameters()


# -- what is noted ------------------------------------------------------------------------------------------


def test_every_quantity_is_that_of_the_run_alone():
    s, p = scene(), plan(3, outputs=list(QUANTITIES))
    found = fa.sweep(s, p)
    assert not found.failures and found.complete
    link = s.arm.links[0]
    for i, length in enumerate(found.parameters[LENGTH]):
        arm = fa.Arm([replace(link, beam=replace(link.beam, length=float(length)))])
        run = replace(s, arm=arm).run()
        want = np.concatenate([QUANTITIES[name].of(run, 0, 0.02) for name in p.outputs])
        np.testing.assert_allclose([c[i] for c in found.columns.values()], want, rtol=1e-9, atol=1e-12)
        strain = max(np.abs(run.strain(0, float(x))[:, 2]).max() for x in np.linspace(0, length, 17)) * 0.0005
        assert found["strain"][i] == pytest.approx(strain, rel=1e-9)
        assert found["tip deflection"][i] == pytest.approx(np.abs(run.tip_deflection()[:, 1]).max(), rel=0.05)
        assert found["link 0 revolute force"][i] == pytest.approx(np.abs(run.tau[:, 0]).max(), rel=1e-9)


def swing(result):
    """Of the hub (rad)."""
    return np.ptp(result.q[:, 0])


def test_a_function_can_be_noted():
    found = fa.sweep(scene(), plan(3, outputs=[swing, "energy"]))
    np.testing.assert_allclose(found["swing"], np.ptp(scene().run().q[:, 0]), rtol=1e-9)
    with refuses("'swing'", "twice"):
        fa.sweep(scene(), plan(3, outputs=[swing, swing]))
    with refuses("outputs = 'swing'"):
        plan(3, outputs=["swing"])


def test_a_value_that_cannot_be_is_named_with_its_scenario():
    p = fa.SweepPlan([fa.Vary("list", {LENGTH: [0.3, 0.3, 0.4, 0.3, -0.1]})])
    with refuses("scenario 4", "link.0.beam.length", "parameters"):
        fa.sweep(scene(), p, batch=2)


def test_settling_time():
    t = np.linspace(0, 10, 1001)
    assert settling_time(t, np.exp(-t), 0.02) == pytest.approx(-np.log(0.02), abs=1e-4)
    assert np.isnan(settling_time(t, np.ones_like(t), 0.02))
    assert np.isnan(settling_time(t, 0.5 + 0.5 * np.cos(t), 0.02))  # rings on
    assert settling_time(t, np.zeros_like(t), 0.02) == 0.0


def test_outputs_that_an_arm_does_not_have_are_refused():
    rigid = fa.Arm([fa.Link(joint=fa.Revolute("z"), tip=fa.RigidBody(mass=1.0, inertia=(1, 1, 1)))])
    s = fa.Scene(rigid, t=np.linspace(0, 0.1, 3))
    p = fa.SweepPlan([fa.Vary("grid", {"link.0.tip.mass": [1.0, 2.0]})], outputs=["tip_deflection"])
    with refuses("tip_deflection", "link -1", "beam"):
        fa.sweep(s, p)
    found = fa.sweep(s, replace(p, outputs=["speed", "energy"]))
    assert found["link 0 revolute speed"].tolist() == [0, 0]


def test_a_failing_scenario_is_named_and_spoils_no_other():
    s = scene()
    s = replace(s, options={"integrator": "rk4", "step": 4e-3})  # above 2.83 / the highest frequency of the stiff one
    p = fa.SweepPlan([fa.Vary("grid", {STIFF: [209e9, 4e12]})], outputs=["tip_deflection"])
    with warns(fa.errors.StepWarning, "scenario 1", "0.00176 s"):
        found = fa.sweep(s, p)
    assert [f[0] for f in found.failures] == [1] and np.isnan(found["tip deflection"][1])
    assert np.isfinite(found["tip deflection"][0])


def test_beams_bent_too_far_are_told_once():
    with warns(fa.errors.RangeWarning, "scenario 0", "1 others", "link 0") as told:
        stiff = fa.Vary("grid", {STIFF: [20e9, 30e9, 900e9]})
        found = fa.sweep(scene(), fa.SweepPlan([stiff], outputs=["tip_deflection"]))
    assert len(told) == 1 and [i for i, *_ in found.beyond] == [0, 1]


# -- what is kept -------------------------------------------------------------------------------------------


def test_table_figure_and_trajectories(tmp_path):
    s = scene()
    found = fa.sweep(s, plan(5, trajectories=True, every=4), out=tmp_path, batch=2)
    rows = list(csv.reader((tmp_path / "sweep.csv").read_text().splitlines()))
    assert rows[0][:3] == ["scenario", LENGTH, "tip deflection (m)"] and len(rows) == 6
    assert float(rows[3][2]) == found["tip deflection"][2]
    t, q, v = found.trajectory(3)
    link = s.arm.links[0]
    arm = fa.Arm([replace(link, beam=replace(link.beam, length=float(found[LENGTH][3])))])
    run = replace(s, arm=arm).run()
    np.testing.assert_allclose(t, run.t[::4])
    np.testing.assert_allclose(q, run.q[::4], atol=1e-12)
    np.testing.assert_allclose(v, run.v[::4], atol=1e-12)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["sweep.csv", "sweep.h5", "sweep.png"]
    again = fa.sweep(s, plan(5, trajectories=True, every=4), out=tmp_path)
    assert again.stats["computed"] == 0 and np.array_equal(again["strain"], found["strain"])


def test_ctrl_c_keeps_what_is_done_and_the_next_call_goes_on(tmp_path):
    s, whole = scene(), fa.sweep(scene(), plan())

    def stop(done, total):
        assert total == 6
        if done == 4:
            raise KeyboardInterrupt

    with refuses("4 of 6", error=fa.errors.SweepInterrupted) as e:
        fa.sweep(s, plan(), out=tmp_path, batch=2, progress=stop)
    part = e.value.result
    assert part.done.tolist() == [True] * 4 + [False] * 2 and np.isnan(part["strain"][4:]).all()
    assert len((tmp_path / "sweep.csv").read_text().splitlines()) == 5
    with refuses("another sweep"):
        fa.sweep(s, plan(7), out=tmp_path)
    with refuses("another sweep"):
        fa.sweep(replace(s, t=s.t[:-1]), plan(), out=tmp_path)
    rest = fa.sweep(s, plan(), out=tmp_path, batch=1)
    assert rest.stats["computed"] == 2 and rest.complete
    assert np.array_equal(rest["strain"], whole["strain"])
    with refuses("another sweep", "parameters"):  # finished, too
        fa.sweep(s, plan(7), out=tmp_path)
    assert np.array_equal(fa.sweep(s, plan(), out=tmp_path)["strain"], whole["strain"])
    assert fa.sweep(s, plan(7), out=tmp_path, resume=False).stats["computed"] == 7


def test_killed_in_the_middle_it_goes_on_from_there(tmp_path):
    code = """
import os, signal, sys
sys.path.insert(0, sys.argv[2])
import many.test_sweep as t
def stop(done, total):
    if done >= 3: os.kill(os.getpid(), signal.SIGKILL)
t.fa.sweep(t.scene(), t.plan(), out=sys.argv[1], batch=1, progress=stop)
"""
    here = os.path.dirname(os.path.dirname(__file__))
    dead = subprocess.run([sys.executable, "-c", code, str(tmp_path), here], timeout=60, check=False)
    assert dead.returncode == -signal.SIGKILL
    with h5py.File(tmp_path / "sweep.h5", "r+") as f:  # as if killed in the middle of writing
        f["columns/strain"][5], f["status"][5] = 7.0, 0
    rest = fa.sweep(scene(), plan(), out=tmp_path)
    assert rest.stats["computed"] == 3 and np.array_equal(rest["strain"], fa.sweep(scene(), plan())["strain"])


# -- the command --------------------------------------------------------------------------------------------


@pytest.fixture
def files(tmp_path):
    text = (SCENES / "ist.toml").read_text()
    text = text.replace("interval = 0.001", 'interval = 0.02\nintegrator = "implicit"\nstep = 4e-3')
    (tmp_path / "scene.toml").write_text(text)
    (tmp_path / "sweep.toml").write_text(
        'outputs = ["tip_deflection", "settling"]\n[[vary]]\n[vary.values]\n'
        "link.0.beam.length = { from = 0.3, to = 0.35, count = 3 }\ndrive.0.scale = [0.5, 0.6]\n"
    )
    return tmp_path


def test_command_prints_and_writes(files, capsys):
    args = ["batch", str(files / "scene.toml"), str(files / "sweep.toml"), "-o", str(files / "out")]
    assert main([*args, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["scenarios"] == 6 and found["complete"] and found["failures"] == []
    assert found["columns"][0]["name"] == "tip deflection" and found["columns"][0]["minimum"] > 0
    assert set(found["files"]) >= {"sweep.csv", "sweep.png"}
    table, other = (files / "out" / "sweep.csv").read_bytes(), files / "other.toml"
    other.write_text((files / "sweep.toml").read_text().replace("0.35", "0.36"))
    assert main([*args[:2], str(other), *args[3:]]) == 2  # finished, it is not written over
    assert "holds another sweep, with another parameters" in capsys.readouterr().err
    assert (files / "out" / "sweep.csv").read_bytes() == table
    assert main([*args, "--workers", "2", "--fresh"]) == 0
    out = capsys.readouterr().out
    assert "6 of 6 scenarios" in out and "tip deflection" in out and "6 computed" in out


@pytest.mark.parametrize(
    ("more", "says"),
    [
        (["--on", "mars"], "--on mars: must be threads"),
        (["--workers", "0"], "--workers 0"),
    ],
)
def test_command_complains_in_one_line(files, capsys, more, says):
    assert main(["batch", str(files / "scene.toml"), str(files / "sweep.toml"), *more]) == 2
    assert says in capsys.readouterr().err


def test_command_names_a_parameter_that_is_not_there(files, capsys):
    (files / "bad.toml").write_text("[[vary]]\n[vary.values]\nlink.0.beam.lenght = [0.3]\n")
    assert main(["batch", str(files / "scene.toml"), str(files / "bad.toml"), "-o", str(files / "o")]) == 2
    assert "link.0.beam.length" in capsys.readouterr().err
    assert main(["batch", "ist", "nowhere"]) == 2
    assert "sweep 'nowhere'" in capsys.readouterr().err


def test_the_shipped_sweep_is_one():
    p = fa.SweepPlan.load("ist")
    assert len(p.parameters()[LENGTH]) == 135 and p.grid() is not None


def test_the_sweep_of_the_documentation_is_one(tmp_path):
    text = (Path(__file__).parents[2] / "docs" / "sweeps.md").read_text()
    (tmp_path / "sweep.toml").write_text(text.split("```toml")[1].split("```")[0])
    found = fa.SweepPlan.load(tmp_path / "sweep.toml").parameters()
    assert {k: v.shape for k, v in found.items()} == {
        "link.0.tip.mass": (1000,), "gravity": (1000, 3), STIFF: (1000,), LENGTH: (1000,),
    }  # fmt: skip
    assert all(f"| `{name}`" in text or f"`{name}`" in text for name in QUANTITIES)
