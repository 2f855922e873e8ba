"""The command line: `flexarm demo`, `run`, `modes`, `chart`, `economize`, `place`, `batch`, each with --help.

Tables go to stdout, progress and errors to stderr. Exit codes: 0 done; 1 a simulation that could not go on;
2 bad input, one line says which; 130 interrupted.
"""

from __future__ import annotations

import argparse
import contextlib
import errno
import io
import json
import math
import os
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, NoReturn

if TYPE_CHECKING:
    from rich.table import Table

    from .modal import Modes
    from .result import Result
    from .scene import Scene


class _Parser(argparse.ArgumentParser):
    """Bad options take one line, without the usage."""

    def error(self, message: str) -> NoReturn:
        raise ValueError(f"{message}; see '{self.prog} --help'")


def _complain(message: str) -> None:
    line = " ".join(message.split())
    line = "flexarm: " + (line if len(line) <= 500 else f"{line[:300]} ... {line[-190:]}")
    try:
        print(line, file=sys.stderr, flush=True)
    except OSError:  # nobody listens; the exit code still tells
        _drop(sys.stderr)


def _open_streams() -> None:
    """Streams that take everything: a closed one (`>&-`) is None, and an ASCII one knows no Greek."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _drop(stream: IO[str]) -> None:
    """What is still to be written cannot be; Python would try again at its exit, and end with 120."""
    with contextlib.suppress(OSError, ValueError):
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, stream.fileno())
        os.close(null)


def _json(value: Any) -> str:
    """JSON text; what is not finite becomes null."""

    def finite(x: Any) -> Any:
        if isinstance(x, dict):
            return {k: finite(v) for k, v in x.items()}
        if isinstance(x, (list, tuple)):
            return [finite(v) for v in x]
        return None if isinstance(x, float) and not math.isfinite(x) else x

    return json.dumps(finite(value), indent=1, allow_nan=False)


def _print_table(table: Table) -> None:
    from rich.console import Console

    console = Console(markup=False, emoji=False)  # titles are the user's: [brackets] and :colons: are text
    if not console.is_terminal:  # a pipe has no width: do not cut anything
        console.width = 160
    with console.capture() as text:
        console.print(table)
    print(text.get(), end="")


def _table(title: str, *columns: str) -> Table:
    """An empty table, numbers to the right."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, title=title, title_justify="left", pad_edge=False)
    for k, name in enumerate(columns):
        table.add_column(name, justify="left" if k == 0 or name == "unit" else "right")
    return table


@contextlib.contextmanager
def _progress(total: int) -> Iterator[Callable[[str], None]]:
    """A bar on stderr, gone when done; yields what moves it by one and tells what was done."""
    if not sys.stderr.isatty():  # a log wants neither a bar nor the empty line that it leaves
        yield lambda done: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    columns = (BarColumn(), TextColumn("{task.completed} of {task.total}  {task.description}"))
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("frequencies", total=total)
        yield lambda done: bar.update(task, advance=1, description=done)


def _folder(path: str) -> Path:
    """A folder that exists and can be written to; ValueError if not."""
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except FileExistsError:
        raise ValueError(f"output folder {path!r}: is a file") from None
    except OSError as e:
        raise ValueError(f"output folder {path!r}: {e.strerror}") from None
    return folder


# -- demo ----------------------------------------------------------------------------------------------------


def _demo(args: argparse.Namespace) -> int:
    from . import demo

    folder = _folder(args.output)
    with _progress(demo.STEPS) as tick:
        done = demo.run(folder, tick)
    if args.json:
        print(_json(done.to_dict()))
        return 0
    _print_table(demo.rich_table(done.rows))
    print(demo.note())
    print(f"\nPictures, data and README.txt are in {folder}{os.sep}")
    return 0


# -- run -----------------------------------------------------------------------------------------------------


def _quantities(result: Result) -> list[dict[str, Any]]:
    """Least, greatest and last value of the joints' motion and forces and of the tips' deflections."""
    from .plots import deflections, joint_coordinates, joint_rates

    places = {label: (i, unit) for i, label, unit in joint_coordinates(result.arm)}
    curves = [(label, unit, result.q[:, i]) for label, (i, unit) in places.items() if unit == "1"]  # without rates
    for i, label, unit in joint_rates(result.arm):
        if label in places:
            curves.append((label, unit, result.q[:, places[label][0]]))
        curves.append((f"{label} rate", f"{unit}/s", result.v[:, i]))
        force = ("torque", "N m") if unit == "rad" else ("force", "N")
        curves.append((f"{label} {force[0]}", force[1], result.tau[:, i]))
    for link, component, label in deflections(result.arm):
        curves.append((f"{label} deflection", "m", result.tip_deflection(link)[:, component]))
    return [
        {"name": n, "unit": u, "minimum": float(y.min()), "maximum": float(y.max()), "final": float(y[-1])}
        for n, u, y in curves
    ]


def _write_run(folder: Path, result: Result, summary: dict[str, Any], table: Table) -> None:
    """run.npz, run.csv, run.png, summary.txt, summary.json."""
    from rich.console import Console

    from . import plots
    from .demo import write_csv

    result.save(folder / "run.npz")
    names, columns = ["t"], [result.t]
    for kind, values in (("q", result.q), ("v", result.v), ("a", result.a), ("tau", result.tau)):
        names += [f"{kind} {label}" for label in (result.arm.q_names if kind == "q" else result.arm.coordinates)]
        columns += list(values.T)
    for link, component, label in plots.deflections(result.arm):
        names.append(f"{label} deflection")
        columns.append(result.tip_deflection(link)[:, component])
    names += ["end x", "end y", "end z"]
    columns += list(result.frame()[0].T)
    write_csv(folder / "run.csv", names, columns)
    plots.plot_result(result).savefig(folder / "run.png", dpi=plots.DPI)
    with (folder / "summary.txt").open("w", encoding="utf-8") as f:
        Console(file=f, width=160, color_system=None, markup=False, emoji=False).print(table)
    (folder / "summary.json").write_text(_json(summary) + "\n", encoding="utf-8")


def _run(args: argparse.Namespace) -> int:
    from .scene import load
    from .simulation import SimulationError, SimulationInterrupted

    scene = load(args.scene)
    folder = _folder(args.output)
    failure: SimulationError | SimulationInterrupted | None = None
    try:
        result = scene.run(progress=sys.stderr.isatty())
    except (SimulationError, SimulationInterrupted) as e:
        failure, result = e, e.result
    summary: dict[str, Any] = {
        "scene": scene.name,
        "complete": failure is None,
        "error": None if failure is None else str(failure),
        "time_reached": float(scene.t[-1]) if failure is None else failure.time,
        "stats": result.stats,
        "folder": str(folder),
        "files": [],
        "quantities": [],
    }
    title = f"{scene.name}: {summary['time_reached']:.6g} s simulated"
    table = _table(title, "", "unit", "minimum", "maximum", "final")
    if len(result.t):
        summary["quantities"] = _quantities(result)
        summary["files"] = ["run.npz", "run.csv", "run.png", "summary.txt", "summary.json"]
        for name, reading in scene.readings(result).items():
            reading.save(folder / f"{name}.csv")
            summary["files"].append(f"{name}.csv")
        for c in summary["quantities"]:
            table.add_row(c["name"], c["unit"], *(f"{c[k]:.6g}" for k in ("minimum", "maximum", "final")))
        _write_run(folder, result, summary, table)
    if args.json:
        print(_json(summary))
    elif len(result.t):
        _print_table(table)
        s = result.stats
        print(f"{s['steps']} steps, {s['evaluations']} evaluations, {s['wall_time']:.3g} s of computing")
        print(f"Picture, data and summary are in {folder}{os.sep}")
    if failure is not None:
        kept = f"the result up to there is in {folder}{os.sep}" if len(result.t) else "nothing to save"
        _complain(f"{failure}; {kept}")
        return 130 if isinstance(failure, KeyboardInterrupt) else 1
    return 0


# -- modes ---------------------------------------------------------------------------------------------------


def _speeds(options: Sequence[str]) -> dict[int, float]:
    out: dict[int, float] = {}
    for text in options:
        link, _, value = text.partition("=")
        try:
            key, speed = int(link), float(value)
        except ValueError:
            raise ValueError(f"--speed {text}: must be LINK=SPEED, such as 0=10 (rad/s)") from None
        if key in out:
            raise ValueError(f"--speed {text}: link {key} is given twice")
        out[key] = speed
    return out


def _locks(options: Sequence[str] | None, scene: Scene) -> list[int]:
    """Links to lock; unless told otherwise those whose motion the scene prescribes."""
    from .drive import Motion

    if options is None:
        return [link for link, law in scene.drive.items() if isinstance(law, Motion)]
    out = []
    for text in options:
        if text == "none":
            continue
        try:
            out.append(int(text))
        except ValueError:
            raise ValueError(f"--lock {text}: must be the number of a link, or none") from None
    return out


def _place(scene: Scene) -> Any:
    """The scene's initial coordinates, prescribed joints where their motion starts."""
    import numpy as np

    from .drive import Motion

    q = scene.arm.zero if scene.q0 is None else np.array(scene.q0)
    for link, law in scene.drive.items():
        if isinstance(law, Motion):
            rate = scene.arm.joint_rate(link, "drive: link")
            q[scene.arm.coordinate_of(rate)] = law(float(scene.t[0]))[0]
    return q


def _mode_rows(modes: Modes, coordinates: Sequence[str], count: int) -> list[dict[str, Any]]:
    import numpy as np

    rows = []
    for k in range(min(count, len(modes.frequencies))):
        shape = modes.shapes[:, k]
        rows.append(
            {
                "frequency": float(modes.frequencies[k]),
                "hertz": float(modes.frequencies[k] / (2 * np.pi)),
                "damping": float(modes.damping[k]),
                "eigenvalue": [float(modes.eigenvalues[k].real), float(modes.eigenvalues[k].imag)],
                "largest_in": coordinates[int(modes.participation[:, k].argmax())],
                "share": float(modes.participation[:, k].max()),
                "shape_real": np.real(shape).tolist(),
                "shape_imag": np.imag(shape).tolist(),
            }
        )
    return rows


def _modes(args: argparse.Namespace) -> int:
    from .scene import load

    if args.count < 1:
        raise ValueError(f"-n {args.count}: must be at least 1")
    speed = _speeds(args.speed)
    scene = load(args.scene)
    lock = _locks(args.lock, scene)
    modes = scene.arm.modes(q=_place(scene), speed=speed, lock=lock)
    rows = _mode_rows(modes, scene.arm.coordinates, args.count)
    if args.json:
        keys = {"scene": scene.name, "speed": speed, "lock": lock, "stable": modes.stable}
        print(_json({**keys, "coordinates": list(scene.arm.coordinates), "modes": rows}))
        return 0
    spin = ", ".join(f"link {k} at {w:g}" for k, w in speed.items() if w) or "at rest"
    held = f", link {', '.join(map(str, lock))} locked" if lock else ""
    table = _table(f"{scene.name}: {spin}{held}", "mode", "rad/s", "Hz", "damping ratio", "most of its energy in")
    for k, m in enumerate(rows):
        numbers = [f"{m['frequency']:.6g}", f"{m['hertz']:.6g}", f"{m['damping']:.4g}"]
        if m["frequency"] == 0:
            numbers[2] = "grows" if m["eigenvalue"][0] > 0 else "rigid"
        where = f"{m['largest_in']} ({100 * m['share']:.0f} %)"
        table.add_row(str(k + 1), *numbers, where, style=None if m["damping"] >= 0 else "bold red")
    _print_table(table)
    if not modes.stable:
        print("This steady state is not stable: at least one motion grows.")
    return 0


# -- the parser ----------------------------------------------------------------------------------------------


_Command = Callable[[argparse.Namespace], int]


def _parser() -> _Parser:
    from . import __version__, cli_batch, cli_chart, cli_economize, cli_place, cmake

    top = _Parser(
        prog="flexarm",
        description="Simulates flexible robot arms.",
        epilog="Start with 'flexarm demo'. SCENE is a TOML file, or the name of a shipped scene such as ist.",
    )
    top.add_argument("--version", action="version", version=f"flexarm {__version__}")
    folder = "print where CMake's find_package(flexarm) looks, for C++ users"
    top.add_argument("--cmakedir", action=cmake.PrintCMakeDir, help=folder)
    commands = top.add_subparsers(metavar="COMMAND", required=True, parser_class=_Parser)

    def command(name: str, does: _Command, summary: str, text: str) -> argparse.ArgumentParser:
        description = f"{summary[0].upper()}{summary[1:]}. {text}"
        p = commands.add_parser(name, help=summary, description=description)
        p.set_defaults(does=does)
        p.add_argument("--json", action="store_true", help="print JSON, and only that, on stdout")
        return p

    scene: dict[str, Any] = {
        "metavar": "SCENE",
        "help": "TOML file, or the name of a shipped scene such as ist",
    }
    output: dict[str, Any] = {"metavar": "DIR", "help": "folder to write into (%(default)s)"}

    text = "Needs no scene, network or display."
    p = command("demo", _demo, "the paper's single-link experiment, held against its numbers", text)
    p.add_argument("-o", "--output", default="flexarm-demo", **output)

    text = "Writes run.npz (for flexarm.Result.load), run.csv, run.png, summary.txt and summary.json, "
    text += "and for each [[sensor]] of the scene what it reads, sensor-K-TYPE.csv."
    p = command("run", _run, "simulate a scene", text)
    p.add_argument("scene", **scene)
    p.add_argument("-o", "--output", default="flexarm-run", **output)

    text = "About rest at the scene's initial position, or about a steady spin. Frequencies are in rad/s."
    p = command("modes", _modes, "natural frequencies of a scene's arm", text)
    p.add_argument("scene", **scene)
    speed = "steady speed of a joint (rad/s; m/s if prismatic), such as 0=10; repeat for more joints"
    p.add_argument("--speed", metavar="LINK=RAD_PER_S", action="append", default=[], help=speed)
    lock = "hold a joint exactly to its steady motion; repeat for more joints, 'none' for no joint "
    lock += "(default: those whose motion the scene prescribes)"
    p.add_argument("--lock", metavar="LINK", action="append", help=lock)
    count = "show the lowest COUNT (%(default)s)"
    p.add_argument("-n", dest="count", metavar="COUNT", type=int, default=10, help=count)

    p = command("chart", cli_chart.run, "speed against accuracy of models and integrators on a scene", cli_chart.TEXT)
    cli_chart.options(p, scene, output)

    p = command("economize", cli_economize.run, "the cheapest model of a scene for a tolerance", cli_economize.TEXT)
    cli_economize.options(p, scene, output)

    p = command("place", cli_place.run, "where to bond a piezo patch", cli_place.TEXT)
    cli_place.options(p, scene, output)

    summary = "simulate a scene many times over, its parameters varied"
    p = command("batch", cli_batch.run, summary, cli_batch.TEXT)
    cli_batch.options(p, scene, output)
    return top


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command line and returns the exit code (see the module)."""
    _open_streams()
    try:
        args = _parser().parse_args(argv)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # numpy's, beside our one line
            warnings.showwarning = lambda message, *_, **__: _complain(f"warning: {message}")
            code = int(args.does(args))
        sys.stdout.flush()
        return code
    except ValueError as e:
        _complain(str(e))
        return 2
    except BrokenPipeError:  # the reader of a pipe left
        _drop(sys.stdout)
        return 0
    except OSError as e:
        if e.errno == errno.ENOSPC and e.filename is None:
            _drop(sys.stdout)
        _complain(f"{e.filename or 'file'}: {e.strerror or e}")
        return 2
    except KeyboardInterrupt:
        _complain("interrupted")
        return 130


if __name__ == "__main__":
    sys.exit(main())
