"""A measured two-link arm: which part of its model brings how much, and how good the whole is.

    python bench/identify/quanser.py [--docs]

Each model is fitted to one of the recordings that the package ships and predicts the other, both ways; of the other,
only what differs from recording to recording is fitted. Takes about ten minutes; prints tables. With --docs it puts
them between the marks of docs/validation.md, and writes docs/figures/validation-*.png.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import replace
from pathlib import Path

import flexarm as fa
from flexarm.data.draw.style import DPI
from flexarm.identify.validate.rig import (
    ARM,
    DEFLECTIONS,
    PER_RUN,
    SHIPPED,
    Recording,
    compared,
    identified,
    read,
    with_motion,
    with_values,
)
from flexarm.identify.validate.validate import Judged, _fitted

DOCS = Path(__file__).parents[2] / "docs"
ZERO, SPRING, LEVEL = "link.1.joint.outboard.rotation.2", "control.0.K.0.0", "gravity.1"
DRAG = "control.1.limit"
LEFT_OUT = {ZERO: 0.0, SPRING: 0.0, LEVEL: 0.0, DRAG: 1e-9}
GAUGES = [path for path in PER_RUN if path.startswith("sensor")]
BODIES = [path for path in ARM if path != DRAG]
MODELS = (
    ("stiffness, mass and damping of the strips; gains and zeros of the gauges", []),
    ("zero of the second joint", [ZERO]),
    ("cable: a spring", [SPRING]),
    ("cable: dry friction", [DRAG]),
    ("level of the table", [LEVEL]),
)


def errors(recording: Recording, comparison: fa.results.Comparison) -> list[str]:
    """NRMSE (%) of both deflections."""
    nrmse = Judged.of(recording, "motion", "", comparison).nrmse
    return [f"{100 * nrmse[name]:.1f}" for name in DEFLECTIONS]


def both_ways(free: list[str], filtered: bool) -> list[str]:
    """Errors of the fitted and of the predicted recording, for both of them fitted to."""
    scene = with_values(fa.load("quanser"), {k: x for k, x in LEFT_OUT.items() if k not in free})
    if not filtered:
        scene = replace(scene, sensors=tuple(replace(s, filter=None) for s in scene.sensors))
    arm = {k: x for k, x in ARM.items() if k in BODIES or k in free}
    each = {k: x for k, x in PER_RUN.items() if k in GAUGES or k in free}
    cells = []
    for names in (("lqr", "fsf"), ("fsf", "lqr")):
        first, other = map(read, names)
        fit = _fitted(with_motion(scene, first), first, {**arm, **each}, DEFLECTIONS, False)
        again = _fitted(with_motion(fit.scene, other), other, each, DEFLECTIONS, False)
        cells += errors(first, fit.comparisons[0]) + errors(other, again.comparisons[0])
    return cells


def models() -> str:
    """The table of models, each with what the ones above have."""
    lines = [
        "| model, each with what those above have | fitted to lqr | predicted fsf | fitted to fsf | predicted lqr |",
        "|-|-:|-:|-:|-:|",
    ]
    free: list[str] = []
    for k, (name, more) in enumerate((*MODELS, ("the last, without the low pass of the gauges", []))):
        free += more
        cells = both_ways(free, k < len(MODELS))
        pairs = [f"{a}, {b}" for a, b in zip(cells[::2], cells[1::2], strict=True)]
        lines.append(f"| {'+ ' if 0 < k < len(MODELS) else ''}{name} | {' | '.join(pairs)} |")
        print(lines[-1], flush=True)
    return "\n".join(lines)


def refits() -> str:
    """The table of what is fitted to the recording that is predicted."""
    steps = (
        ("nothing", []),
        ("zeros of the gauges", [path for path in GAUGES if "offset" in path]),
        ("+ zero of the second joint", [ZERO]),
        ("+ gains of the gauges", [path for path in GAUGES if "gain" in path]),
        ("+ pull of the cable", [SPRING]),
        ("+ level of the table", [LEVEL]),
    )
    cells: dict[str, list[str]] = {name: [] for name, _ in steps}
    for names in (("lqr", "fsf"), ("fsf", "lqr")):
        first, other = map(read, names)
        fit = _fitted(with_motion(fa.load("quanser"), first), first, {**ARM, **PER_RUN}, DEFLECTIONS, False)
        scene, free = with_motion(fit.scene, other), list[str]()
        for name, more in steps:
            free += more
            each, begin = {path: PER_RUN[path] for path in free}, {path: fit.values[path] for path in free}
            said = compared(scene, other, DEFLECTIONS)
            if free:
                said = _fitted(scene, other, each, DEFLECTIONS, False, None, begin).comparisons[0]
            cells[name].append(", ".join(errors(other, said)))
    lines = ["| fitted to what is predicted | fsf, the arm from lqr | lqr, the arm from fsf |", "|-|-:|-:|"]
    return "\n".join([*lines, *(f"| {name} | {' | '.join(x)} |" for name, x in cells.items())])


def levels() -> str:
    """The table of the level, as each recording tells it, with the shipped values of the arm."""
    lines = ["| recording | tilt of the table, degrees | 95 % interval | numbers that stand in for it |", "|-|-:|-:|-|"]
    for name in SHIPPED:
        recording = read(name)
        begin = identified(name)[0]
        scene = with_motion(fa.load("quanser"), recording)
        fit = _fitted(scene, recording, PER_RUN, DEFLECTIONS, False, None, begin)
        angle, low, high = (math.degrees(math.asin(g / 9.81)) for g in (fit.values[LEVEL], *fit.intervals[LEVEL]))
        others = [path for x in fit.loose if LEVEL in x.names for path in x.names if path != LEVEL]
        row = dict(zip(fit.values, fit.correlation[list(fit.values).index(LEVEL)], strict=True))
        told = ", ".join(f"`{path}` (correlation {row[path]:+.3f})" for path in others) or "none above 0.95"
        lines.append(f"| {name} | {angle:.1f} | {low:.1f} to {high:.1f} | {told} |")
    return "\n".join(lines)


def whole(made: fa.results.Validation) -> str:
    """The table of a validation."""
    lines = ["| driven by | recording | what was fitted to it | judged from | joints | deflections |"]
    lines.append("|-|-|-|-|-:|-:|")
    for j in made.judged:
        x = {name: f"{100 * e:.1f}" for name, e in j.nrmse.items()}
        joints = f"{x['joint1']}, {x['joint2']}" if "joint1" in x else "as measured"
        both = ", ".join(x[name] for name in DEFLECTIONS)
        lines.append(f"| {j.driven} | {j.recording} | {j.role} | {j.since:.1f} s | {joints} | {both} |")
    return "\n".join(lines)


def put(text: str, name: str, table: str) -> str:
    """The text with the table between its marks."""
    begin, end = f"<!-- {name}: written by bench/identify/quanser.py -->\n", f"\n<!-- end of {name} -->"
    i = text.index(begin) + len(begin)
    return text[:i] + table + text[text.index(end) :]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--docs", action="store_true")
    args = parser.parse_args()
    began = time.perf_counter()
    made = fa.validate("quanser")
    tables = {"errors": whole(made), "level": levels()}
    print(tables["errors"], "\n", tables["level"], f"\n{time.perf_counter() - began:.0f} s\n", flush=True)
    if args.docs:
        for driven in ("motion", "current"):
            made.plot(driven).savefig(DOCS / "figures" / f"validation-{driven}.png", dpi=DPI * 0.8)
    tables["refits"] = refits()
    print(tables["refits"], "\n", flush=True)
    tables["models"] = models()
    if args.docs:
        page = DOCS / "validation.md"
        text = page.read_text(encoding="utf-8")
        for name, table in tables.items():
            text = put(text, name, table)
        page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
