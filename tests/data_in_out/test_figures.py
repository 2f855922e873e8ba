"""Figures of made-up numbers, with many links, strains and long names: no text is cut at an edge, and none overprints
another; and what maps, points, Bode diagrams and charts show."""

from __future__ import annotations

from itertools import combinations
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from flexarm.data.draw import fit, loop, modes, sweep, tradeoff, trajectory
from matplotlib.backends.backend_agg import FigureCanvasAgg

NAMES = [f"segment {k} of the snake arm behind the elbow" for k in range(12)]
T = np.linspace(0, 1, 50)


def words(figure: Any) -> list[tuple[str, Any]]:
    """Titles, labels, legends and annotations of a figure, and where they stand (pixels)."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    found = list(figure.texts) + ([figure._suptitle] if figure._suptitle else [])
    for ax in figure.axes:
        found += [ax.title, ax._left_title, *ax.texts, ax.xaxis.label, ax.yaxis.label]
        found += ax.get_legend().get_texts() if ax.get_legend() else []
    for legend in figure.legends:
        found += legend.get_texts()
    renderer = canvas.get_renderer()
    kept = {id(text): text for text in found if text.get_visible() and text.get_text().strip()}.values()
    return [(text.get_text(), text.get_window_extent(renderer)) for text in kept]


def readable(figure: Any) -> None:
    wide, tall = figure.bbox.width, figure.bbox.height
    seen = words(figure)
    for text, box in seen:
        inside = box.x0 > -1 and box.y0 > -1 and box.x1 < wide + 1 and box.y1 < tall + 1
        assert inside, f"{text!r} is cut: {box} of {wide} x {tall}"
    for (a, first), (b, second) in combinations(seen, 2):
        across = min(first.x1, second.x1) - max(first.x0, second.x0)
        down = min(first.y1, second.y1) - max(first.y0, second.y0)
        assert across < 2 or down < 2, f"{a!r} overprints {b!r}"
    assert wide <= 1600 and tall <= 1600


def test_curves_of_many_links() -> None:
    curves = [(f"{name} revolute", k * T) for k, name in enumerate(NAMES)]
    more = [(f"{name} bending_y {n}", 1e-5 * k * T) for k, name in enumerate(NAMES) for n in range(3)]
    panels = [("Joint angle (rad)", curves), ("Tip deflection (m)", more), (NAMES[0] * 2, curves[:1])]
    readable(trajectory.plot_panels(T, panels))


@pytest.mark.parametrize("count", [7, 13, 25])
def test_many_panels(count: int) -> None:
    """Those of an estimate of friction and damping in twelve joints were 66 inches tall."""
    band = [("estimate", T), ("two std above", 1 + T), ("and below", T - 1)]
    panels = [(f"coulomb.{k}", band) for k in range(count)]
    readable(trajectory.plot_panels(1e-2 * T, [*panels, ("tip (m)", [(f"tip {c}", T) for c in "xyz"])]))


@pytest.mark.parametrize("recordings", [1, 2, 4])
def test_recordings_of_long_names(recordings: int) -> None:
    panels = {f"deflection of segment {k} (mm)": (T, 1 - T, 12.3) for k in range(4)}
    title = "recording of the calibration stand, second afternoon.csv"
    readable(trajectory.plot_recordings([trajectory.Curves(title, T, 0.5, panels)] * recordings))


@pytest.mark.parametrize("count", [3, 12])
def test_names_of_joints_over_modes(count: int) -> None:
    s = np.linspace(0, 3.6, 60)
    moved = np.sin(s[:, None, None] * np.arange(1, 9)) * np.array([0, 1, 1])[None, :, None]
    labels = [f"mode {k}: {100 * k} Hz, damping 0.005 %" for k in range(8)]
    readable(modes.plot_modes(s, moved, labels, [(3.6 / count * k, name) for k, name in enumerate(NAMES[:count])],
                              {"arm": range(60)}))  # fmt: skip


def pair(count: int) -> Any:
    names = [f"q {NAMES[k]} bending_y {k}" for k in range(count)]
    columns = {name: 1e-4 * np.sin(5 * T + k) for k, name in enumerate(names)}

    class Table(dict):  # type: ignore[type-arg]
        t, units = T, dict.fromkeys(names, "rad/s")

    return SimpleNamespace(measured=Table(columns), simulated=Table(columns), nrmse=dict.fromkeys(names, 0.0123))


@pytest.mark.parametrize(("runs", "columns"), [(1, 10), (2, 4)])
def test_a_fit_of_many_columns(runs: int, columns: int) -> None:
    pairs = [pair(columns) for _ in range(runs)]
    tests = [{name: SimpleNamespace(correlation=np.zeros(20)) for name in p.nrmse} for p in pairs]
    readable(fit.plot_fit(pairs, tests))


@pytest.mark.parametrize("count", [1, 10])
def test_measured_beside_simulated(count: int) -> None:
    readable(fit.plot_pair(pair(count)))


def test_loops_of_many_joints() -> None:
    w = np.geomspace(0.1, 100, 60)
    margins = [SimpleNamespace(name=f"control[{k}]", phase_frequency=1.0) for k in range(12)]
    readable(loop.plot_loop(np.array([-1 + 2j, -1 - 2j]), None, [(m, w, 3 / (1j * w)) for m in margins]))


def test_parameters_with_long_paths() -> None:
    parameters = [(f"link.{name}.beam.material.youngs_modulus (Pa)", 1e9 * (1 + T)) for name in NAMES[:4]]
    columns = [("tip deflection of the last link (m)", 1e-4 * T), ("residual (m)", T)]
    readable(sweep.plot_sweep(columns, parameters, None, False, "twelve segments: 50 runs"))
    grid = {name: 1e9 * np.arange(1.0, n + 1) for (name, _), n in zip(parameters[:2], (5, 10), strict=True)}
    readable(sweep.plot_sweep(columns, parameters[:2], grid, False, "twelve segments: 50 runs"))


def chart(count: int, words_of_a_run: str, near: float = 1.5) -> Any:
    points = [(1e-3 * near**k, 1e-2 / near ** (2 * k)) for k in range(count)]
    kinds = tradeoff.Kind("exact", "60 in all", "legendre"), tradeoff.Kind(2, "24 in all")
    lines = [tradeoff.Line(kinds[0], "gauss", points), tradeoff.Line(kinds[1], "ida", points[1:])]
    front = [tradeoff.Cheapest(t, error, words_of_a_run) for t, error in points]
    label, note = "Largest error of the tip (share of its span)", "NOT CONVERGED: it is known to 1e-5 of the span. " * 4
    return tradeoff.plot_lines(lines, front, ["gauss", "ida"], 1e-5, label, "chart", [note])


@pytest.mark.parametrize(
    ("count", "run"),
    [(20, "order exact, 3+2+1+1+2+1 modes (clamped-free), gauss, ci, step 0.0003125 s"), (9, "order 2, " * 30)],
)
def test_the_list_under_a_chart(count: int, run: str) -> None:
    readable(chart(count, run))


def test_numbers_of_a_chart_lie_apart_where_its_points_do_not() -> None:
    readable(chart(9, "order 2, 3 modes, gauss, step 0.01 s", near=1.06))


def test_a_plan_of_twelve_links() -> None:
    label = "; ".join(f"{name}: order 2, bending_y 2, torsion 1, 5 Gauss points" for name in NAMES)
    note = "NOT CERTIFIED: against the check it is off by 0.003, and the reference, against which choices were " * 2
    models = [tradeoff.Trial(1e-3 * k, 1e-4 * k, 2) for k in range(1, 9)]
    for notes in ([], [note]):
        readable(tradeoff.plot_trials(models, [(1e-3, 1e-3)], (2e-3, 1e-3), (1e-3, 1e-4), 1e-3, False,
                            "Largest error of the tip (share of its span, 0.1 m)", "Twelve links", f"chosen: {label}",
                            notes))  # fmt: skip


# -- what is drawn -----------------------------------------------------------------------------------------------------


def test_a_map_names_what_has_no_number() -> None:
    axes = {"length (m)": np.array([0.3, 0.4, 0.5]), "stiff (Pa)": np.array([1e11, 2e11])}
    full = np.arange(6.0)
    holes = np.where(np.arange(6) < 3, np.nan, full)
    why = np.array([0, 1, 2, 2, 2, 2])
    columns = [("deflection (m)", full), ("settling (s)", holes), ("strain", full), ("speed (rad/s)", full)]
    figure = sweep.plot_sweep(columns, [], axes, False, "four", why)
    assert max(figure.get_size_inches()) <= 10  # a page shows it
    bars = [ax.get_ylabel() for ax in figure.axes if ax.get_label() == "<colorbar>"]
    assert bars == ["deflection (m)", "settling (s)\n(grey: no number)", "strain", "speed (rad/s)"]
    (legend,) = figure.legends
    assert [t.get_text() for t in legend.get_texts()] == ["failed: 1", "not run yet: 1", "no value: 1"]
    lost = figure.axes[1].collections[1].get_array()
    assert lost.compressed().tolist() == [0, 1, 2]
    assert not sweep.plot_sweep([columns[0]], [], axes, False, "one", why).legends


def test_points_without_a_number_are_crosses_at_the_bottom() -> None:
    x, y = np.arange(5.0), np.array([1.0, np.nan, 2.0, 3.0, np.nan])
    figure = sweep.plot_sweep(
        [("settling (s)", y)], [("mass (kg)", x)], None, False, "points", np.array([2, 0, 2, 2, 1])
    )
    (cross,) = (line for line in figure.axes[0].lines if line.get_marker() == "x")
    assert cross.get_xdata().tolist() == [1.0]  # the last was not run
    assert figure.legends[0].get_texts()[0].get_text() == "without a number (failed: 1)"


def test_few_values_of_a_parameter_have_ticks_themselves() -> None:
    mass, turn = np.array([0.1, 0.2]), np.array([30.0, 60.0, 90.0])
    over = np.repeat(mass, 3), np.tile(turn, 2)
    ticks = lambda axis: [t.get_text() for t in axis.get_ticklabels()]  # noqa: E731
    grid = {"mass (kg)": mass, "turn (deg)": turn}
    ax = sweep.plot_sweep([("settling (s)", np.arange(6.0))], [], grid, False, "map").axes[0]
    assert ticks(ax.yaxis) == ["0.1", "0.2"] and ticks(ax.xaxis) == ["30", "60", "90"]
    named = list(zip(grid, over, strict=True))
    points = sweep.plot_sweep([("settling (s)", np.arange(6.0))], named, None, False, "points")
    assert [ticks(ax.xaxis) for ax in points.axes] == [["0.1", "0.2"], ["30", "60", "90"]]
    assert ticks(points.axes[0].yaxis) != ["0", "1", "2", "3", "4", "5"]  # what comes out has round ticks
    stiff = sweep.plot_sweep(
        [("a", np.arange(3.0))], [("E (Pa)", np.array([1e9, 1e11, 2e11]))], None, True, "log"
    ).axes[0]
    assert ticks(stiff.xaxis) == ["1G", "100G", "200G"] and stiff.get_xscale() == "log"
    for many in (np.arange(9.0), np.array([0.1, 0.10001, 0.5])):  # too many; too near
        ax = sweep.plot_sweep([("a", np.ones(many.size))], [("x", many)], None, True, "many").axes[0]
        assert not set(many) <= set(ax.get_xticks())


def test_a_bode_diagram_begins_a_decade_below_what_matters() -> None:
    w = np.geomspace(1e-5, 1e3, 2000)
    s = 1j * w
    margins = SimpleNamespace(name="control[0]", phase_frequency=np.nan)

    def begins(*gains: Any) -> float:
        axes = loop.plot_loop(np.array([-1.0 + 0j]), None, [(margins, w, L) for L in gains]).axes
        (low,) = {line.get_xdata().min() for ax in axes[2:4] for line in ax.lines if len(line.get_xdata()) > 2}
        return low

    assert begins(100 / (s * (1 + s / 2))) == pytest.approx(0.2, rel=0.2)  # its pole at 2
    assert begins(1e4 * (1 + s / 5) / s**2) == pytest.approx(0.5, rel=0.2)  # its zero at 5
    assert begins(100 / (1 + 2e-3 * s / 7 + (s / 7) ** 2)) == pytest.approx(0.5, rel=0.2)  # hardly damped, at 7
    assert begins(0.3 / s) == pytest.approx(0.03, rel=0.02)  # crosses 1 at 0.3
    assert begins(0.3 / s, 100 / (1 + s)) == pytest.approx(0.03, rel=0.02)
    assert begins(0.3 + 0 * s) == w[0]  # nothing matters: all


def test_every_model_of_the_picture_has_a_look_of_its_own() -> None:
    kinds = [
        tradeoff.Kind(order, str(n), basis)
        for order in (0, 1, 2, 3, "exact")
        for n in range(1, 21)
        for basis in ("", "b")
    ]
    looks = tradeoff.model_styles(kinds)
    assert len({(s["color"], str(s["marker"]), s["fillstyle"]) for s in looks.values()}) == len(kinds) == 200
