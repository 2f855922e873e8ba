"""The shipped model of a measured arm against its recordings."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import flexarm as fa
import numpy as np
import pytest
from flexarm.cli import main
from flexarm.identify.validate.rig import (
    CURRENTS,
    DEFLECTIONS,
    FOLDER,
    JOINTS,
    PER_RUN,
    SHIPPED,
    UNITS,
    compared,
    identified,
    read,
    with_currents,
    with_motion,
    with_values,
)
from flexarm.identify.validate.validate import Judged, _fitted
from messages import refuses

EXCERPT = Path(__file__).parents[1] / "data" / "quanser_excerpt.csv"


def errors(name: str, driven_by: str = "motion", **changed: float) -> dict[str, float]:
    """NRMSE of the shipped values, nothing fitted."""
    recording = read(name)
    each, drives = identified(name)
    scene = with_values(with_motion(fa.load("quanser"), recording), {**each, **changed})
    if driven_by == "motion":
        return Judged.of(recording, driven_by, "", compared(scene, recording, DEFLECTIONS)).nrmse
    scene = with_values(with_currents(scene, recording), drives)
    return Judged.of(recording, driven_by, "", compared(scene, recording, (*JOINTS, *DEFLECTIONS))).nrmse


@pytest.mark.parametrize("name", ["lqr", "fsf", "psf"])
def test_deflections_of_all_three_follow_from_the_motion_of_the_joints_by_one_arm(name: str) -> None:
    assert max(errors(name).values()) < 0.11


def test_what_differs_from_recording_to_recording_matters() -> None:
    straight = errors("lqr", **{"link.1.joint.outboard.rotation.2": 0.0})
    assert straight["link2_deflection"] > 0.15
    assert errors("fsf", **{"sensor.0.gain": 1.05})["link1_deflection"] > 0.25
    loose, undamped = (errors("psf", **{f"strut.cable.{k}": 0.0}) for k in ("stiffness", "damping"))
    assert min(loose.values()) > 0.25 and max(undamped.values()) > 0.09


def test_angles_and_deflections_follow_from_the_currents() -> None:
    e = errors("lqr", "current")
    assert e["joint1"] < 0.05 and e["joint2"] < 0.15 and max(e.values()) < 0.15


def test_recordings_are_shipped_with_their_licence() -> None:
    assert "MIT License" in (FOLDER / "LICENSE").read_text() and "basta" in (FOLDER / "README.md").read_text()
    lqr, fsf, psf = map(read, SHIPPED)
    assert lqr.tares == (0.0, 0.0) and fsf.tares == psf.tares == pytest.approx((1.0, 0.2), abs=0.011)
    assert lqr.data.t[-1] > 19.9
    assert np.degrees(np.ptp(lqr.data["joint1"])) == pytest.approx(52.98, abs=0.02)  # of the original
    assert sum(f.stat().st_size for f in FOLDER.iterdir()) < 400_000


def test_a_tared_gauge_reads_nothing_and_then_less_its_mean() -> None:
    recording = read("fsf")
    scene = with_motion(fa.load("quanser"), recording)
    result = scene.run()
    plain = fa.sensors.StrainGauge(link=0, face="-y", gauge_factor=scene.sensors[0].gauge_factor)  # type: ignore[attr-defined]
    there, t = plain.measure(result.arm, result.t, result.q, result.v)[:, 0], result.t
    read_so = scene.sensors[0].measure(result.arm, t, result.q, result.v)[:, 0]
    dead = t < recording.tares[0]
    assert not read_so[dead].any()
    np.testing.assert_allclose(read_so[~dead], there[~dead] - there[dead].mean(), rtol=1e-12)


def test_fine_recordings_are_averaged_without_a_lag() -> None:
    t = np.arange(0.0, 4.0, 0.002)
    data = fa.Data(t, {name: np.sin(3 * t) for name in UNITS}, UNITS)
    recording = read(data)
    assert recording.data.step == pytest.approx(0.02)
    np.testing.assert_allclose(recording.data["joint1"], np.sin(3 * (recording.data.t + 0.009)), atol=1e-3)


def test_command_judges_a_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate", "quanser", "--data", str(EXCERPT), "--json", "-o", str(tmp_path)]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [j["driven"] for j in told["judged"]] == ["motion", "motion", "current"]
    assert all(set(DEFLECTIONS) <= set(j["nrmse"]) for j in told["judged"])
    assert {p.name for p in tmp_path.iterdir()} == {
        "validate.txt", "validate.json", "validate-motion.png", "validate-current.png"
    }  # fmt: skip


def test_the_command_lists_the_arms(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["validate"]) == 0 and "quanser" in capsys.readouterr().out
    assert main(["validate", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["quanser"]["recordings"] == ["lqr", "fsf", "psf"]


def test_what_is_left_out_is_not_in_the_fit() -> None:
    """A recording that is spoilt in its second half leaves what is fitted to its first half as it is."""
    scene, psf = fa.load("quanser"), read("psf")
    columns = {k: np.where(psf.data.t > 11.0, 0.0, x) for k, x in psf.data.columns.items()}
    spoilt = replace(psf, data=fa.Data(psf.data.t, columns, UNITS))
    begin = identified("fsf")[0]
    one, other = (_fitted(with_motion(scene, r), r, PER_RUN, DEFLECTIONS, False, 9.8, begin) for r in (psf, spoilt))
    assert other.values == pytest.approx(one.values, rel=1e-3)


def test_a_mirrored_recording_has_mirrored_values() -> None:
    """The search begins on the wrong side: 0.7 rad from straight, to the other."""
    lqr = read("lqr")
    mirrored = replace(lqr, data=fa.Data(lqr.data.t, {k: -x for k, x in lqr.data.columns.items()}, UNITS))
    scene, begin = fa.load("quanser"), identified("lqr")[0]
    turned = with_values(scene, {"strut.cable.points.0.offset.1": 1.0})
    pairs = ((scene, lqr), (turned, mirrored))
    one, other = (_fitted(with_motion(s, r), r, PER_RUN, DEFLECTIONS, False, 10.0, begin) for s, r in pairs)
    odd = ("rotation", "offset")
    for path, x in one.values.items():
        sign = -1.0 if any(word in path for word in odd) else 1.0
        known = 0.02 if "stiffness" not in path else 0.2  # lqr hardly tells the cable's
        assert other.values[path] == pytest.approx(sign * x, rel=known, abs=1e-4), path


def columns(without: str = "", unit: str = "rad", end: float = 4.0) -> fa.Data:
    t = np.arange(0.0, end, 0.01)
    names = [name for name in UNITS if name != without]
    units = {name: unit if name == "joint1" else UNITS[name] for name in names}
    return fa.Data(t, {name: np.sin(3 * t) for name in names}, units)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"rig": "quanser2"}, "rig = 'quanser2'"),
        ({"predict": "lqg"}, "predict = 'lqg'"),
        ({"calibrate": 30.0, "data": "psf"}, "calibrate = 30"),
        ({"data": columns(without=CURRENTS[1])}, ("column 'motor2_current'", "missing")),
        ({"data": columns(unit="m")}, ("column 'joint1'", "m")),
        ({"data": columns(end=1.0)}, "2 s"),
        ({"data": columns(), "calibrate": 3.9}, ("calibrate = 3.9", "1")),
        ({"data": "none.csv"}, "none.csv"),
        ({"data": []}, ("data", "empty", "list")),
    ],
)
def test_bad_input_is_named(given: dict[str, object], said: str) -> None:
    with refuses(said):
        fa.validate(**given)  # type: ignore[arg-type]
