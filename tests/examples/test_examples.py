"""The scripts of `examples` run, write what they say, and what they compute is held against something else."""

from __future__ import annotations

import ast
import runpy
import sys
from pathlib import Path
from typing import Any

import flexarm as fa
import matplotlib
import numpy as np
import pytest
from scipy import integrate

FOLDER = Path(__file__).parents[2] / "examples"
SCRIPTS = sorted(FOLDER.glob("*.py"))


@pytest.fixture
def ran(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Any:
    """run(name): the names that a script leaves; it has written each file that it prints, and nothing anywhere else."""
    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    def run(name: str) -> dict[str, Any]:
        here, out = tmp_path / "here", tmp_path / "out" / "deep"
        here.mkdir()
        monkeypatch.chdir(here)
        monkeypatch.setattr(sys, "argv", [name, "--output", str(out)])
        names = runpy.run_path(str(FOLDER / f"{name}.py"), run_name="__main__")
        plt.close("all")
        said = capsys.readouterr().out
        written = list(out.iterdir())
        assert not list(here.iterdir()) and written and all(str(p) in said for p in written if p.suffix != ".csv")
        assert all(p.stat().st_size > 10_000 for p in written if p.suffix == ".png")
        return names

    return run


def test_each_says_what_it_is() -> None:
    assert len(SCRIPTS) == 10
    for script in SCRIPTS:
        text = script.read_text(encoding="utf-8")
        told = ast.get_docstring(ast.parse(text)) or ""
        for word in ("Shows:", "You see:", "Takes:", "Needs:", f"python {script.name} [--output DIR]"):
            assert word in told, script.name
        assert 30 <= text.count("\n") <= 90, script.name


def test_two_links(ran: Any) -> None:
    """What the swinging link loses of its height and the beams do not hold, it moves with; another method agrees."""
    names = ran("01_two_links")
    arm, run = names["arm"], names["run"]
    assert abs(names["change"]).max() < 1e-8
    other = fa.simulate(arm, run.t, integrator="gauss", step=0.01)
    np.testing.assert_allclose(run.frame()[0], other.frame()[0], atol=1e-6)
    assert abs(run.tip_deflection("upper")[:, 1]).max() > 0.05  # m: there is something to see


def test_modes_of_an_arm(ran: Any) -> None:
    """With twelve functions and no characteristic equation the same comes out, and a heavy payload is a mass on a
    spring: f = sqrt(3 EI / (M + 33/140 m) L^3) / 2 pi (Rayleigh)."""
    names = ran("02_modes_of_an_arm")
    beam, truth, m = names["beam"], names["truth"], names["beam_mass"]
    mass = names["payloads"][-1] + 33 / 140 * m
    rayleigh = np.sqrt(3 * names["bending_stiffness"] / (mass * beam.length**3)) / (2 * np.pi)
    assert abs(truth[-1, 0] / rayleigh - 1) < 1e-4
    assert abs(truth[0] / [3.33413, 20.8947] - 1).max() < 1e-4  # published for the clamped link: 20.95, 131.28 rad/s
    errors = names["errors"]
    assert errors["loaded"].max() < 1e-4 and errors["clamped-free"][1:].min() > 1e-3
    assert np.all(np.diff(errors["legendre"][:, 0]) < 0)


def test_spin_up(ran: Any) -> None:
    """The stretch at full speed is that of a bar that turns: u = L (tan k / k - 1), k = speed L sqrt(rho A / EA)."""
    names = ran("03_spin_up")
    k = names["speed"] * names["length"] * np.sqrt(names["mass_per_length"] / names["stretch"])
    closed = names["length"] * (np.tan(k) / k - 1)
    for order in (2, "exact"):
        run = names["runs"][order]
        steady = run.t > 16
        assert abs(run.tip_deflection()[steady, 0].mean() / closed - 1) < 5e-3
        assert 0.57 < -run.tip_deflection()[:, 1].min() < 0.58  # m; Simo and Vu-Quoc's figure: a little below 0.6
    assert names["runs"][1].t[-1] < 15  # softens, and runs away
    assert -names["runs"][0].tip_deflection()[:, 1].min() > 0.62


def test_your_robot(ran: Any) -> None:
    """The tube lies horizontally in the first pose: w L^4 / 8 EI + m g L^3 / 3 EI, and sags with the cosine."""
    names = ran("04_your_robot")
    tube = names["tube"]
    outer, inner = tube.section.radius, tube.section.radius - tube.section.thickness
    bending = tube.material.youngs_modulus * np.pi / 4 * (outer**4 - inner**4)
    weight = 9.81 * tube.material.density * np.pi * (outer**2 - inner**2)  # N/m
    length, gripper = tube.length, 0.4
    sag = weight * length**4 / (8 * bending) + 9.81 * gripper * length**3 / (3 * bending)
    assert names["sags"][0] == pytest.approx(1e3 * sag, rel=2e-3)
    assert names["sags"][2] / names["sags"][0] == pytest.approx(np.cos(0.8) ** 2, rel=1e-2)


def test_joint_control(ran: Any) -> None:
    """The nonlinear runs, sampled and delayed, grow and decay as the poles of the linear loop do."""
    names = ran("05_joint_control")
    poles, seen = np.transpose(names["growths"])
    np.testing.assert_allclose(seen, poles, rtol=0.01)
    assert poles[0] < 0 and poles[1] < 0 < poles[2]


def test_shaped_move(ran: Any) -> None:
    """When the planned move ends there is no energy left in the arm; the plain one leaves a twentieth of a joule."""
    names = ran("06_shaped_move")
    left = {name: sum(run.energy())[names["t"] > names["move"].duration].max() for name, run in names["cases"].items()}
    assert left["planned"] < 1e-6 * left["plain"] and left["plain"] > 0.05
    peak = abs(names["cases"]["planned"].tau[:, names["joints"]]).max(0)
    assert np.all(peak < 1.001 * np.array(names["limits"]))


def test_tip_path(ran: Any) -> None:
    """The tip stays on the circle; what the motors give over the whole motion, from rest to rest, the dampers take."""
    names = ran("07_tip_path")
    _, run, off = names["runs"]["stable"]
    place = run.frame()[0][:, :2]
    assert abs(np.hypot(*(place - [0.6, 0.2]).T) - names["radius"]).max() < 1e-6 and off.max() < 1e-3
    given = integrate.trapezoid(np.sum(run.tau * run.v, axis=1), run.t)
    assert 0 < given < 0.05 * abs(run.tau).max() and sum(run.energy())[-1] < 1e-6
    assert names["runs"]["rigid"][2].max() > 10  # mm


def test_piezo_damping(ran: Any) -> None:
    """The damping that the decay shows is that of the closed loop's pole, and open, that of the beam."""
    names = ran("08_piezo_damping")
    (open_seen, _), (seen, pole) = names["ratios"]["open"], names["ratios"]["closed"]
    assert open_seen == pytest.approx(0.002, rel=0.05)
    assert seen == pytest.approx(pole, rel=0.02) and seen > 0.05


def test_fit_a_payload(ran: Any) -> None:
    """A finer model made the records: its numbers are within the intervals, or at their edge, and near."""
    names = ran("09_fit_a_payload")
    fit = names["fit"]
    for name, true in names["true"].items():
        low, high = fit.intervals[name]
        middle, half = (low + high) / 2, (high - low) / 2
        assert abs(true - middle) < 1.5 * half and abs(fit.values[name] / true - 1) < 0.02
    again = fa.load(names["folder"] / "fitted.toml")
    assert again.arm.links[0].tip.mass == fit.values["link.0.tip.mass"]


def test_batch_of_payloads(ran: Any) -> None:
    """Of one linear mode, ZV leaves |cos(pi/2 w/w0)| and ZVD its square; a run of the batch is the run by IDA."""
    names = ran("10_batch_of_payloads")
    ratio = names["w"] / names["w0"]
    left = {k: names["ringing"][k][names["few"]] for k in names["ringing"]}
    for name, power in (("zv", 1), ("zvd", 2)):
        closed = abs(np.cos(np.pi / 2 * ratio)) ** power
        np.testing.assert_allclose(left[name] / left["unshaped"], closed, atol=2e-3)
    arm = names["runs"][0].arm
    assert arm.links[0].tip.mass == names["payloads"][0]
    run = fa.simulate(arm, names["t"], drive={0: names["command"]}, rtol=1e-8)
    alone = 1e3 * np.ptp(run.tip_deflection()[names["after"], 1]) / 2
    assert alone == pytest.approx(names["ringing"]["zvd"][0], rel=2e-3)
