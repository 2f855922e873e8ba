"""The paper's single-link experiment (Sec. 5), computed, plotted and held against its numbers.

Everything comes from the scene "ist": the arm, its order-2 beam and the hub motion. The paper does not
publish the hub motion it recorded; the scene's is reconstructed from its text and the axes of Fig. 9 and 10.
Fig. 7, 12 and 13 are in demo_control.py.
"""

from __future__ import annotations

import csv
import json
import shutil
import textwrap
import warnings
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from . import demo_control
from ._check import Array
from .arm import Arm
from .demo_table import COLUMNS, Row
from .result import Result
from .scene import SCENES, Scene, load
from .validity import RangeWarning

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

# Published: Sec. 5.1, Fig. 7, Sec. 5.2
PAPER_FREQUENCIES = (20.95, 131.28, 367.6)  #: clamped-free, rad/s
PAPER_HERTZ = (3.33, 20.89, 58.5)  #: the same in Hz
PAPER_CHANGE = (4.7, 1.9, 0.8)  #: from 0 to 10 rad/s of hub speed, %
MEASURED_HERTZ = (2.9, 20.5, 55.7)  #: damped, Fig. 7
PAPER_PEAK_SPEED = 7.6  #: rad/s
INSET_TIME = (0.40, 0.43)  #: window of Fig. 10's inset, s
INSET_HEIGHT = (0.070, 0.082)  #: m

ORDERS = (0, 1, 2)
HUB_SPEEDS = np.linspace(0.0, 10.0, 41)  #: of Fig. 8, rad/s

RECONSTRUCTED = (
    "The hub motion is RECONSTRUCTED: the paper does not publish the one it recorded. It was chosen to "
    "meet what the paper's text and figure axes tell: peak speed 7.6 rad/s, less than 5 rad of turn, and "
    "simulated tip peaks of 0.07 to 0.082 m between 0.40 and 0.43 s (inset of Fig. 10). These can agree "
    "only by construction (fitted); that order 2 swings faster than order 0, and by how much, is computed."
)


@dataclass(frozen=True)
class Spectrum:
    """Natural frequencies against hub speed (rad/s).

    Attributes:
        speeds: hub speeds of Fig. 8, (n,).
        frequencies: by order, (n, 3).
        wide_speeds: hub speeds up to beyond the loss of mode 1 for order 1, (m,).
        wide: frequency of mode 1 by order, (m,); nan where it is lost.
        loss: hub speed at which order 1 loses mode 1.
    """

    speeds: Array
    frequencies: dict[int, Array]
    wide_speeds: Array
    wide: dict[int, Array]
    loss: float


@dataclass(frozen=True)
class Manoeuvre:
    """The hub motion and what the tip does, orders 0 and 2.

    Attributes:
        results: by order.
        cruise: when the hub's speed is constant: from, to (s).
        peak: by order, time (s) and height (m) of the first positive peak of the tip during the cruise.
        period: by order, twice the time from that peak to the trough after it (s). For order 2 it is
            a little longer than 2 pi over the frequency, which is of small swings.
    """

    results: dict[int, Result]
    cruise: tuple[float, float]
    peak: dict[int, tuple[float, float]]
    period: dict[int, float]

    def tip(self, order: int) -> Array:
        """Tip displacement across the beam (m), (nt,)."""
        return self.results[order].tip_deflection()[:, 1]

    @property
    def lead(self) -> float:
        """How much earlier order 2 peaks than order 0 (s)."""
        return self.peak[0][0] - self.peak[2][0]

    @property
    def peak_speed(self) -> float:
        """Highest hub speed (rad/s)."""
        return float(np.abs(self.results[2].v[:, 0]).max())


@dataclass(frozen=True)
class Demo:
    """What the demo computed, and the files it wrote."""

    spectrum: Spectrum
    manoeuvre: Manoeuvre
    control: demo_control.Control
    rows: list[Row]
    folder: Path
    files: list[str]

    def to_dict(self) -> dict[str, Any]:
        """For JSON: the table, the frequencies (rad/s) at rest and at 10 rad/s by order, the files."""
        frequencies = {
            str(order): {"at_rest": f[0].tolist(), "at_10_rad_per_s": f[-1].tolist()}
            for order, f in self.spectrum.frequencies.items()
        }
        rows = [{**asdict(r), "agrees": r.agrees} for r in self.rows]
        agrees = all(r.agrees is not False for r in self.rows)
        return {
            "agrees": agrees,
            "table": rows,
            "frequencies": frequencies,
            "note": RECONSTRUCTED,
            "note_control": demo_control.IDENTIFIED,
            "folder": str(self.folder),
            "files": self.files,
        }


def with_order(arm: Arm, order: int) -> Arm:
    """The same arm with every beam's rotation cut at this order."""
    links = [replace(k, beam=replace(k.beam, order=order)) if k.beam else k for k in arm.links]
    return Arm(links, arm.gravity)


def spectrum(arm: Arm, tick: Callable[[], None] = lambda: None) -> Spectrum:
    """Frequencies of the arm, its hub held to a constant speed (Sec. 5.1); calls `tick` after each order."""
    arms = {order: with_order(arm, order) for order in ORDERS}

    def square(speed: float) -> float:  # s^2 of order 1's first mode: negative while it oscillates
        s = arms[1].modes(speed={0: speed}, lock=[0]).eigenvalues[0]
        return float((s * s).real)

    loss = float(brentq(square, 0.0, 40.0, xtol=1e-10))
    before, after = loss * np.sin(np.linspace(0.0, np.pi / 2, 40)), np.linspace(loss, 25.0, 12)[1:]
    wide_speeds = np.concatenate([before, after])
    frequencies, wide = {}, {}
    for order, a in arms.items():
        frequencies[order] = np.array([a.modes(speed={0: w}, lock=[0]).frequencies[:3] for w in HUB_SPEEDS])
        first = [a.modes(speed={0: w}, lock=[0]) for w in wide_speeds]
        wide[order] = np.array([m.frequencies[0] if m.stable else np.nan for m in first])
        tick()
    wide[1][before.size - 1] = 0.0
    return Spectrum(HUB_SPEEDS, frequencies, wide_speeds, wide, loss)


def _peak(t: Array, y: Array, cruise: tuple[float, float]) -> tuple[float, float, float]:
    """Time and height of the first positive peak within `cruise`, and the time of the trough after it."""
    curve = CubicSpline(t, y)
    turns = curve.derivative().roots(extrapolate=False)
    turns = turns[(turns > cruise[0]) & (turns < cruise[1])]
    peak = next(x for x in turns if curve(x) > 0 and curve(x, 2) < 0)
    return float(peak), float(curve(peak)), float(next(x for x in turns if x > peak))


def manoeuvre(scene: Scene, tick: Callable[[], None] = lambda: None) -> Manoeuvre:
    """Runs the scene with orders 0 and 2 (Sec. 5.2); calls `tick` after each."""
    results = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RangeWarning)  # the two are run to be held against each other
        for order in (0, 2):
            results[order] = replace(scene, arm=with_order(scene.arm, order)).run()
            tick()
    r = results[2]
    steady = r.t[r.v[:, 0] > (1 - 1e-9) * r.v[:, 0].max()]
    cruise = float(steady[0]), float(steady[-1])
    peak, period = {}, {}
    for order, r in results.items():
        at, height, trough = _peak(r.t, r.tip_deflection()[:, 1], cruise)
        peak[order], period[order] = (at, height), 2 * (trough - at)
    return Manoeuvre(results, cruise, peak, period)


def table_rows(s: Spectrum, m: Manoeuvre) -> list[Row]:
    """The table of the demo."""
    f = s.frequencies[2]
    rows = []
    for k in range(3):
        w, hz = PAPER_FREQUENCIES[k], MEASURED_HERTZ[k]
        digits = 1 if k == 2 else 2
        name, turn = f"Mode {k + 1}, hub at rest", 2 * np.pi
        rows.append(Row(f"mode{k + 1}", name, "rad/s", float(f[0, k]), digits, w, hz * turn))
        rows.append(Row(f"mode{k + 1}_hz", "", "Hz", float(f[0, k] / turn), digits, PAPER_HERTZ[k], hz))
    for k in range(3):
        change = float(100 * (f[-1, k] / f[0, k] - 1))
        name = f"Mode {k + 1} change at 10 rad/s"
        rows.append(Row(f"mode{k + 1}_change", name, "%", change, 1, PAPER_CHANGE[k]))
    softened = float(s.frequencies[1][-1, 0])
    rows.append(Row("order1_mode1", "Mode 1, order 1, 10 rad/s", "rad/s", softened, 2))
    rows.append(Row("order1_loss", "Order 1 loses mode 1 at", "rad/s", s.loss, 2))
    rows.append(Row("peak_speed", "Peak hub speed *", "rad/s", m.peak_speed, 1, PAPER_PEAK_SPEED, fitted=True))
    for order in (0, 2):
        at, height = m.peak[order]
        name = f"Order {order} tip peak"
        rows.append(Row(f"peak_time_order{order}", f"{name} * at", "s", at, 4, INSET_TIME, fitted=True))
        rows.append(Row(f"peak_height_order{order}", f"{name} * height", "m", height, 4, INSET_HEIGHT, fitted=True))
    rows.append(Row("lead", "Order 2 peaks earlier by", "ms", 1e3 * m.lead, 2))
    for order in (0, 2):
        name = f"Period at cruise, order {order}"
        rows.append(Row(f"period_order{order}", name, "ms", 1e3 * m.period[order], 1))
    change = 100 * (m.period[2] / m.period[0] - 1)
    rows.append(Row("period_change", "Period, order 2 against 0", "%", change, 1))
    return rows


def rich_table(rows: Iterable[Row]) -> Table:
    """The table for a terminal."""
    from rich import box
    from rich.table import Table

    title = "The paper's single flexible link (Sec. 5)"
    table = Table(box=box.SIMPLE_HEAD, title=title, pad_edge=False, padding=(0, 1, 0, 0))
    for name in COLUMNS:
        table.add_column(name, justify="left" if name in ("", "unit") else "right", no_wrap=True)
    for row in rows:
        table.add_row(*row.cells(), style="bold red" if row.agrees is False else None)
    return table


def print_table(rows: Iterable[Row], file: IO[str]) -> None:
    """The table as plain text."""
    from rich.console import Console

    Console(file=file, width=100, color_system=None).print(rich_table(rows))
    file.write(note() + "\n")


def write_csv(path: Path, header: Iterable[str], columns: Iterable[Array]) -> None:
    """Columns of numbers, all digits, under one header line."""
    with path.open("w", newline="", encoding="utf-8") as f:
        out = csv.writer(f, lineterminator="\n")
        out.writerow(header)
        out.writerows([repr(float(x)) for x in row] for row in zip(*columns, strict=True))


_FILES = {
    "README.txt": "this text",
    "table.txt": "this program's numbers beside the paper's and the measured ones",
    "table.csv": "the same, for a spreadsheet",
    "demo.json": "the same, for a program, with all digits",
    "fig8-frequencies.png": "frequencies against hub speed, orders 0, 1 and 2",
    "fig8-frequencies.csv": "its data, rad/s",
    "fig9-manoeuvre.png": "the hub's motion (reconstructed)",
    "fig10-tip.png": "the tip's displacement, orders 0 and 2",
    "manoeuvre.csv": "data of Fig. 9 and 10: s, rad, rad/s, rad/s^2, m",
    "order0.npz": "the simulation of order 0, for flexarm.Result.load",
    "order2.npz": "the simulation of order 2",
    "ist.toml": "the scene that Fig. 8, 9 and 10 were computed from; change it and `flexarm run ist.toml`",
    **demo_control.FILES,
}


def _write_data(folder: Path, s: Spectrum, m: Manoeuvre, rows: list[Row]) -> None:
    with (folder / "table.txt").open("w", encoding="utf-8") as text:
        print_table(rows, text)
    with (folder / "table.csv").open("w", newline="", encoding="utf-8") as f:
        out = csv.writer(f, lineterminator="\n")
        out.writerow(["key", "name", "unit", "flexarm", "paper", "paper_to", "measured", "agrees"])
        for r in rows:
            low, high = r.paper if isinstance(r.paper, tuple) else (r.paper, None)
            out.writerow([r.key, r.name, r.unit, repr(r.value), low, high, r.measured, r.cells()[-1]])
    names = [f"order {o} mode {k + 1} (rad/s)" for o in ORDERS for k in range(3)]
    columns = [s.frequencies[o][:, k] for o in ORDERS for k in range(3)]
    write_csv(folder / "fig8-frequencies.csv", ["hub speed (rad/s)", *names], [s.speeds, *columns])
    r2 = m.results[2]
    header = ["t", "hub position", "hub velocity", "hub acceleration", "tip order 0", "tip order 2"]
    columns = [r2.t, r2.q[:, 0], r2.v[:, 0], r2.a[:, 0], m.tip(0), m.tip(2)]
    write_csv(folder / "manoeuvre.csv", header, columns)
    for order, result in m.results.items():
        result.save(folder / f"order{order}.npz")
    for name in ("ist.toml", "ist_control.toml"):
        shutil.copyfile(SCENES / name, folder / name)
    listing = "\n".join(f"  {name:25s} {what}" for name, what in _FILES.items())
    head = "flexarm demo: the single flexible link of Martins, Sa da Costa and Ayala Botto, Sec. 5."
    body = f"{head}\n\n{note()}\n\n{listing}\n"
    (folder / "README.txt").write_text(body, encoding="utf-8")


def note() -> str:
    """What the stars in the table mean, in lines for a terminal."""
    return "\n".join(textwrap.fill(text, 80) for text in ("* " + RECONSTRUCTED, "** " + demo_control.IDENTIFIED))


def run(folder: str | Path, tick: Callable[[str], None] = lambda _: None) -> Demo:
    """Computes the experiment and writes its table, figures and data into a folder, which must exist.

    `tick` is called STEPS times, with what was done.

    Raises:
        OSError: the folder cannot be written to.
    """
    folder = Path(folder)
    scene = load("ist")
    s = spectrum(scene.arm, lambda: tick("frequencies"))
    m = manoeuvre(scene, lambda: tick("manoeuvre"))
    c = demo_control.compute(lambda: tick("control"))
    rows = table_rows(s, m) + demo_control.table_rows(c)
    _write_data(folder, s, m, rows)
    demo_control.write_data(folder, c)
    tick("data")

    from . import plots, plots_control

    figures: dict[str, Callable[[], Figure]] = {
        "fig8-frequencies.png": lambda: plots.figure_8(s, PAPER_FREQUENCIES, PAPER_CHANGE, MEASURED_HERTZ),
        "fig9-manoeuvre.png": lambda: plots.figure_9(m),
        "fig10-tip.png": lambda: plots.figure_10(m, INSET_TIME, INSET_HEIGHT),
        "fig7-spectrum.png": lambda: plots_control.figure_7(c),
        "fig12-pd.png": lambda: plots_control.figure_12(c),
        "fig13-strain-feedback.png": lambda: plots_control.figure_13(c),
    }
    for name, draw in figures.items():
        draw().savefig(folder / name, dpi=plots.DPI)
        tick(name)
    out = Demo(s, m, c, rows, folder, list(_FILES))
    (folder / "demo.json").write_text(json.dumps(out.to_dict(), indent=1) + "\n", encoding="utf-8")
    return out


STEPS = len(ORDERS) + 2 + 2 + 1 + 6  #: how many times `run` calls its `tick`
