"""`flexarm identify SCENE DATA.csv ...`: its options and its output."""

import argparse
from typing import Any

from .._console import complain
from ..data.data import Data
from ..identify.fit import FitError, FitInterrupted
from ..identify.identify import METHODS, identify
from ..identify.loss import LOSSES
from ..identify.unknown import Unknown
from ..model.acting.drive import Motion
from ..run.scene.scene import load
from . import options

SUMMARY = "fit unknown numbers of a scene to measured data"
TEXT = (
    "Spaces in names of columns may be written as underscores. Writes fit.txt, fit.png, fit.json and fitted.toml, the "
    "scene with the fitted values."
)
_EXAMPLE = "such as 'link.0.tip.mass', with a start '=0.1', or with a start and bounds '=0.1:0.02:0.5'"


def arguments(p: argparse.ArgumentParser) -> None:
    options.scene(p)
    p.add_argument("data", metavar="DATA", nargs="+", help="measured runs: CSV, HDF5, .mat, .npz, logs of ROS 2")
    p.add_argument("-p", "--parameter", metavar="PATH[=START[:LOW:HIGH]]", action="append", required=True,
                   help=f"an unknown, {_EXAMPLE}; repeat for each")  # fmt: skip
    p.add_argument("--output", metavar="COLUMN=OUTPUT", action="append",
                   help="a measured column, and its output in the scene: 'sensor.0' or a column of a run; repeat "
                   "for each (default: all names that both have)")  # fmt: skip
    p.add_argument("--input", metavar="DRIVE=COLUMN", action="append",
                   help="a joint and the measured torque that drives it, '1=torque_1'; '1=motion:angle_1' of a joint "
                   "that moves as measured; 'control.0.reference=command' of a controller that is given it; repeat for "
                   "each (default: the scene's drives and references)")  # fmt: skip
    p.add_argument("--noise", metavar="COLUMN=STD", action="append",
                   help="standard deviation of a column (SI); of others it is estimated")  # fmt: skip
    p.add_argument("--validate", metavar="DATA", action="append", default=[],
                   help="a run kept aside, which the fit is compared with; repeat for each")  # fmt: skip
    p.add_argument("--starts", metavar="N", type=int,
                   help="from how many starts to search (default: one, and 8 where that explains little)")  # fmt: skip
    p.add_argument("--loss", choices=("linear", *LOSSES), default="linear",
                   help="of residuals: others than linear are for data with outliers")  # fmt: skip
    p.add_argument("--method", choices=METHODS, default="simulation",
                   help="of the likelihood: a run from its start to its end, or that of a Kalman filter, for noisy "
                   "torques (%(default)s)")  # fmt: skip
    p.add_argument("--unit", metavar="COLUMN=UNIT", action="append", help="of columns whose heading tells none")
    folder = "folder to write into (%(default)s)"
    p.add_argument("-o", dest="folder", default="flexarm-identify", metavar="DIR", help=folder)


def _pairs(option: str, given: list[str] | None) -> dict[str, str]:
    """NAME=VALUE, repeated."""
    found: dict[str, str] = {}
    for text in given or []:
        name, mark, value = text.partition("=")
        if not (name and mark and value):
            raise ValueError(f"{option} {text}: must be NAME=VALUE")
        found[name] = value
    return found


def _number(where: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{where}: {text!r} is not a number") from None


def _parameters(given: list[str]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for text in given:
        path, mark, value = text.partition("=")
        where = f"--parameter {text}"
        parts = [_number(where, x) if x else None for x in value.split(":")] if mark else []
        if len(parts) not in (0, 1, 3):
            raise ValueError(f"{where}: must be a path, {_EXAMPLE}")
        low, high = parts[1:] if len(parts) == 3 else (None, None)
        bounds: dict[str, Any] = {k: x for k, x in (("low", low), ("high", high)) if x is not None}
        try:
            found[path] = Unknown(parts[0] if parts else None, **bounds)
        except ValueError as e:
            raise ValueError(f"{where}: {e}") from None
    return found


def _key(where: str, text: str) -> Any:
    """A drive's key: a link, link.freedom, or patch.link.patch."""
    head, *rest = map(options.link, text.split("."))
    if head == "patch" and len(rest) == 2 and isinstance(rest[1], int):
        return (head, *rest)
    if head == "control":
        return text
    if head not in ("patch", "") and (not rest or (len(rest) == 1 and isinstance(rest[0], int))):
        return (head, *rest) if rest else head
    raise ValueError(f"{where}: must begin with a link, such as '1=torque_1', or '1.0=...', 'patch.0.0=...'")


def _column(name: str, columns: Any) -> str:
    """The column that is meant: shells do not like spaces."""
    alike = [c for c in columns if c.replace(" ", "_") == name]
    return alike[0] if name not in columns and len(alike) == 1 else name


def run(args: argparse.Namespace) -> int:
    """Fits, writes and prints; 0, or 130 after Ctrl-C, or 1 if no run could be simulated."""
    scene = load(args.scene)
    units = _pairs("--unit", args.unit)
    runs = [Data.load(path, units=units or None) for path in args.data]
    kept = [Data.load(path, units=units or None) for path in args.validate]
    names = runs[0]
    inputs: dict[Any, Any] = {}
    for text, source in _pairs("--input", args.input).items():
        kind, mark, column = source.partition(":")
        moves = mark and kind == "motion"
        column = _column(column if moves else source, names)
        inputs[_key(f"--input {text}={source}", text)] = (Motion, column) if moves else column
    outputs = {_column(name, names): source for name, source in _pairs("--output", args.output).items()} or None
    noise = {_column(name, names): _number(f"--noise {name}", x) for name, x in _pairs("--noise", args.noise).items()}
    out = options.Output(args.folder)
    interrupted: FitInterrupted | None = None
    try:
        fit = identify(
            scene, runs, _parameters(args.parameter), inputs=inputs or None, outputs=outputs, noise=noise or None,
            loss=args.loss, method=args.method, starts=args.starts, progress=True,
        )  # fmt: skip
    except FitError as e:
        complain(str(e))
        return 1
    except FitInterrupted as e:
        if e.fit is None:
            raise
        interrupted, fit = e, e.fit
    compared = [] if interrupted else [fit.validate(data) for data in kept]
    text = "\n".join([fit.report(), *(f"\nKept aside: {c.measured.name}\n{c}" for c in compared)])
    out.text("fit.txt", text)
    out.picture("fit.png", fit.plot())
    values = "\n".join(f"{name} = {x:.9g}" for name, x in fit.values.items())
    try:
        fit.scene.save(out.path / "fitted.toml", f"Fitted by flexarm identify:\n{values}")
        out.files.append("fitted.toml")
    except ValueError as e:
        complain(f"fitted.toml was not written: {e}")
    for k, c in enumerate(compared):
        out.picture(f"validation-{k}.png", c.plot())
    about = {**fit.to_dict(), "complete": interrupted is None}
    about["validation"] = [{"data": c.measured.name, "nrmse": dict(c.nrmse)} for c in compared]
    options.told(args, out.json("fit.json", about), text, f"\nPicture, table and fitted scene are in {out}")
    if interrupted:
        complain(str(interrupted).replace(".fit is the best so far", f"the best so far is in {out}"))
        return 130
    return 0
