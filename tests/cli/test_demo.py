"""`flexarm demo`: its files, and its numbers against the paper and independent calculations."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from typing import Any

import flexarm as fa
import numpy as np
import pytest

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def done(demonstration: tuple[Any, Any]) -> Any:
    return demonstration[0]


@pytest.fixture(scope="module")
def told(done: Any) -> dict[str, Any]:
    out: dict[str, Any] = json.loads((done.folder / "demo.json").read_text())
    return out


@pytest.fixture(scope="module")
def table(told: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {row["key"]: row for row in told["table"]}


def test_every_file_is_written_and_listed(done: Any, told: dict[str, Any]) -> None:
    assert sorted(told["files"]) == sorted(p.name for p in done.folder.iterdir())
    for name in told["files"]:
        data = (done.folder / name).read_bytes()
        assert len(data) > 100, name
        assert not name.endswith(".png") or data.startswith(PNG)
    listing = (done.folder / "README.txt").read_text()
    assert all(name in listing for name in told["files"])


def test_frequencies_are_those_calculated_independently(told: dict[str, Any]) -> None:
    f = told["frequencies"]
    rest = [20.948766, 131.283672, 367.598084]
    for order in "012":
        np.testing.assert_allclose(f[order]["at_rest"], rest, atol=6e-7)
    np.testing.assert_allclose(f["2"]["at_10_rad_per_s"], [21.939904, 133.840341, 370.389888], atol=6e-7)
    np.testing.assert_allclose(f["1"]["at_10_rad_per_s"][0], 18.407900, atol=6e-7)
    np.testing.assert_allclose(f["0"]["at_10_rad_per_s"], rest, atol=6e-7)


def test_the_paper_is_met(told: dict[str, Any], table: dict[str, dict[str, Any]]) -> None:
    assert told["agrees"] is True
    for k, (w, hz, change, measured) in enumerate(
        [(20.95, 3.33, 4.7, 2.9), (131.28, 20.89, 1.9, 20.5), (367.6, 58.5, 0.8, 55.7)], start=1
    ):
        assert [table[f"mode{k}{x}"]["paper"] for x in ("", "_hz")] == [w, hz]
        assert table[f"mode{k}_hz"]["measured"] == measured
        assert table[f"mode{k}"]["agrees"] is True and table[f"mode{k}_hz"]["agrees"] is True
        assert round(table[f"mode{k}_change"]["value"], 1) == change
        assert table[f"mode{k}_change"]["paper"] == change


def test_order_one_loses_its_first_mode(done: Any, table: dict[str, dict[str, Any]]) -> None:
    assert table["order1_loss"]["value"] == pytest.approx(20.948766, abs=1e-6)
    s = done.spectrum
    beyond = s.wide_speeds > s.loss
    assert beyond.any() and np.isnan(s.wide[1][beyond]).all() and not np.isnan(s.wide[1][~beyond]).any()
    assert np.isfinite(s.wide[0]).all() and (np.diff(s.wide[2]) > 0).all() and (np.diff(s.wide[0]) < 1e-9).all()


def test_the_manoeuvre_meets_the_marks_of_figures_9_and_10(done: Any, table: dict[str, dict[str, Any]]) -> None:
    m = done.manoeuvre
    assert m.peak_speed == pytest.approx(7.6, abs=1e-9) and table["peak_speed"]["fitted"] is True
    r = m.results[2]
    assert r.t[-1] == 1.6 and r.q[:, 0].min() >= 0.0 and 4.0 < r.q[:, 0].max() < 5.0
    assert abs(r.v[0, 0]) < 1e-9 and abs(r.v[-1, 0]) < 1e-9 and abs(r.a[-1, 0]) < 1e-9
    assert np.abs(np.diff(r.a[:, 0])).max() < 0.5  # rad/s^2 in 1 ms: the acceleration has no jump
    for order in (0, 2):
        t, y = m.peak[order]
        assert 0.40 <= t <= 0.43 and 0.070 <= y <= 0.082
        assert m.tip(order).min() > -0.11 and m.tip(order).max() < 0.15


def test_order_two_swings_faster_than_order_zero(done: Any) -> None:
    m = done.manoeuvre
    assert m.lead > 1e-3 and m.period[2] < m.period[0]
    link = fa.load("ist").arm.links[0]
    arms = {order: fa.Arm([replace(link, beam=replace(link.beam, order=order))]) for order in (0, 2)}
    small = {order: 2 * np.pi / arm.modes(speed={0: 7.6}, lock=[0]).frequencies[0] for order, arm in arms.items()}
    assert m.period[0] == pytest.approx(small[0], rel=2e-4)  # the simplified model is linear
    assert small[2] < m.period[2] < 1.01 * small[2]  # order 2 swings a little slower the further it swings


def test_files_hold_the_same_numbers(done: Any) -> None:
    with (done.folder / "manoeuvre.csv").open(newline="") as f:
        rows = list(csv.reader(f))
    data = np.array(rows[1:], dtype=float)
    m = done.manoeuvre
    np.testing.assert_array_equal(data[:, 0], m.results[2].t)
    np.testing.assert_array_equal(data[:, 5], m.tip(2))
    again = fa.Result.load(done.folder / "order2.npz")
    np.testing.assert_array_equal(again.q, m.results[2].q)
    assert again.arm == m.results[2].arm
    with (done.folder / "table.csv").open(newline="") as f:
        keys = [row["key"] for row in csv.DictReader(f)]
    assert keys == [r.key for r in done.rows]


def test_says_that_the_motion_is_reconstructed(done: Any, told: dict[str, Any]) -> None:
    texts = [told["note"], *((done.folder / n).read_text() for n in ("README.txt", "table.txt", "ist.toml"))]
    assert all("RECONSTRUCTED" in text for text in texts)


def test_the_scene_in_the_folder_can_be_run(done: Any) -> None:
    copy = fa.load(done.folder / "ist.toml")
    assert copy.arm == fa.load("ist").arm == done.manoeuvre.results[2].arm


def test_a_number_that_misses_the_paper_is_marked(done: Any) -> None:
    row = next(r for r in done.rows if r.key == "mode1_hz")
    missed = replace(row, value=3.34)
    assert row.paper == 3.33 and missed.agrees is False and missed.cells()[-1] == "NO"
    assert replace(row, value=3.334).agrees is True
    assert replace(row, value=3.0, paper=None).agrees is None
    assert replace(row, value=0.44, paper=(0.40, 0.43)).agrees is False
