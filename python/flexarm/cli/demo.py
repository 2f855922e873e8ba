"""`flexarm demo`: the paper's single-link experiments (Sec. 5), computed, plotted and compared with its numbers."""

import argparse
import csv
import itertools
import shutil
import textwrap
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from .._console import json_text, progress_bar, write_csv
from ..data.draw.style import DPI, Figure
from ..run.scene.scene import SCENES, load
from . import options
from .paper import control, figures, single_link, table
from .paper.single_link import ORDERS, RECONSTRUCTED, Manoeuvre, Spectrum, manoeuvre, spectrum
from .paper.table import Row


@dataclass(frozen=True)
class Demo:
    """The demo's results, and the files it wrote."""

    spectrum: Spectrum
    manoeuvre: Manoeuvre
    control: control.Control
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
        return {
            "agrees": all(r.agrees is not False for r in self.rows), "table": rows, "frequencies": frequencies,
            "note": RECONSTRUCTED, "note_control": control.IDENTIFIED, "folder": str(self.folder), "files": self.files,
        }  # fmt: skip


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
    **control.FILES,
}


def _write_data(folder: Path, s: Spectrum, m: Manoeuvre, rows: list[Row]) -> None:
    (folder / "table.txt").write_text(f"{table.text(rows)}\n\n{note()}\n", encoding="utf-8")
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
    listing = "\n".join(f"  {name:25s} {text}" for name, text in _FILES.items())
    head = "flexarm demo: the single flexible link of Martins, Sa da Costa and Ayala Botto, Sec. 5."
    body = f"{head}\n\n{note()}\n\n{listing}\n"
    (folder / "README.txt").write_text(body, encoding="utf-8")


def note() -> str:
    """The meaning of the stars in the table, in lines for a terminal."""
    return "\n".join(textwrap.fill(text, 80) for text in ("* " + RECONSTRUCTED, "** " + control.IDENTIFIED))


def computed(folder: str | Path, tick: Callable[[str], None] = lambda _: None) -> Demo:
    """Computes the experiment and writes its table, figures and data into a folder, which must exist.

    `tick` is called STEPS times, each time with the text of a finished step.

    Raises:
        OSError: the folder cannot be written to.
    """
    folder = Path(folder)
    scene = load("ist")
    s = spectrum(scene.arm, lambda: tick("frequencies"))
    m = manoeuvre(scene, lambda: tick("manoeuvre"))
    c = control.compute(lambda: tick("control"))
    rows = single_link.table_rows(s, m) + control.table_rows(c)
    _write_data(folder, s, m, rows)
    control.write_data(folder, c)
    tick("data")

    pictures: dict[str, Callable[[], Figure]] = {
        "fig8-frequencies.png": lambda: figures.figure_8(s),
        "fig9-manoeuvre.png": lambda: figures.figure_9(m),
        "fig10-tip.png": lambda: figures.figure_10(m),
        "fig7-spectrum.png": lambda: figures.figure_7(c),
        "fig12-pd.png": lambda: figures.figure_12(c),
        "fig13-strain-feedback.png": lambda: figures.figure_13(c),
    }
    for name, draw in pictures.items():
        draw().savefig(folder / name, dpi=DPI)
        tick(name)
    out = Demo(s, m, c, rows, folder, list(_FILES))
    (folder / "demo.json").write_text(json_text(out.to_dict()) + "\n", encoding="utf-8")
    return out


STEPS = len(ORDERS) + 2 + 2 + 1 + 6  #: number of calls of `tick`


SUMMARY = "the paper's single-link experiment, held against its numbers"
TEXT = "Needs no scene, network or display."


def arguments(p: argparse.ArgumentParser) -> None:
    options.output(p, "flexarm-demo")


def run(args: argparse.Namespace) -> int:
    """Computes, writes and prints."""
    out = options.Output(args.output)
    with progress_bar(True, "demo", STEPS) as bar:
        count = itertools.count(1)
        done = computed(out.path, lambda text: bar(next(count), text) if bar else None)
    where = f"\nPictures, data and README.txt are in {out}"
    options.told(args, done.to_dict(), table.text(done.rows), note(), where)
    return 0
