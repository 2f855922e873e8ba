"""A measured two-link arm, each of its three recordings predicted by an arm that was fitted to the other two.

    python bench/identify/quanser.py [--docs]

Prints tables: how good the model is, what each part of it brings, and other models beside it (`rivals.py`, which needs
mujoco). With --docs it puts them between the marks of docs/validation.md, and writes docs/figures/validation-*.png.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Mapping
from pathlib import Path

import flexarm as fa
from flexarm.data.draw.style import DPI
from flexarm.data.draw.trajectory import plot_recordings
from flexarm.identify.validate.rig import ARM, DEFLECTIONS, PER_RUN, SHIPPED, identified, read, with_motion, with_values
from flexarm.identify.validate.validate import Judged, _fitted, fitted, latest
from rivals import rivals

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from reporting import replace_table

DOCS = Path(__file__).parents[2] / "docs"
ZERO, DAMPER = "link.1.joint.outboard.rotation.2", "strut.cable.damping"
ROPE = ("strut.cable.stiffness", "strut.cable.length")
NONE = {ZERO: 0.0, DAMPER: 0.0, ROPE[0]: 0.0}
MODELS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("stiffness, mass and damping of the strips; gains and zeros of the gauges", ()),
    ("+ zero of the second joint", (ZERO,)),
    ("+ cable: a rope that goes slack", ROPE),
    ("+ cable: its damper", (DAMPER,)),
)


def cell(found: Mapping[str, float]) -> str:
    """NRMSE (%) of both deflections."""
    return ", ".join(f"{100 * found[name]:.1f}" for name in DEFLECTIONS)


def left_out(free: set[str]) -> dict[str, str]:
    """By recording, the errors of its second half, with the arm from the other two."""
    scene = with_values(fa.load("quanser"), {k: x for k, x in NONE.items() if k not in free})
    optional = {ZERO, DAMPER, *ROPE}
    arm = {k: x for k, x in ARM.items() if k not in optional or k in free}
    own = {k: x for k, x in PER_RUN.items() if k not in optional or k in free}
    found = {}
    for name in SHIPPED:
        fit = fitted(scene, [read(n) for n in SHIPPED if n != name], {**arm, **own})
        recording = read(name)
        one, half = with_values(scene, {k: fit.values[k] for k in arm}), float(recording.data.t[-1]) / 2
        begin = identified(next(n for n in reversed(SHIPPED) if n != name))[0]
        done = _fitted(with_motion(one, recording), recording, own, DEFLECTIONS, False, half, begin)
        rest = done.validate(recording.data)
        found[name] = cell(Judged.of(recording, "motion", "", rest, half).nrmse)
    return found


def table(first: str, rows: Mapping[str, Mapping[str, str]]) -> str:
    """Lines of Markdown, with a column for each recording."""
    lines = [f"| {first} | {' | '.join(SHIPPED)} |", "|-" + "|-:" * len(SHIPPED) + "|"]
    return "\n".join([*lines, *(f"| {name} | {' | '.join(x[n] for n in SHIPPED)} |" for name, x in rows.items())])


def models() -> str:
    """What each part of the model brings."""
    rows, free = {}, set[str]()
    for name, more in MODELS:
        free |= set(more)
        rows[name] = left_out(free)
        print(name, rows[name], flush=True)
    return table("model", rows)


def beside(ours: Mapping[str, str]) -> str:
    """Other models."""
    others = {model: {n: f"{100 * a:.1f}, {100 * b:.1f}" for n, (a, b) in x.items()} for model, x in rivals().items()}
    return table("model", {"flexarm": ours, **others})


def whole(made: Mapping[str, fa.results.Validation]) -> str:
    """What was fitted to which seconds, and the errors."""
    heads = "predicted | driven by | fitted to the others, whole | fitted to it | judged | joints | deflections"
    lines = [f"| {heads} |", "|-|-|-|-|-|-:|-:|"]
    for name, found in made.items():
        for j in found.judged:
            if j.recording != name:
                continue
            joints = ", ".join(f"{100 * j.nrmse[k]:.1f}" for k in ("joint1", "joint2") if k in j.nrmse) or "as measured"
            end = j.comparison.measured.t[-1]
            row = (name, j.driven, "the arm", j.role, f"{j.since:.1f} to {end:.1f} s", joints, cell(j.nrmse))
            lines.append(f"| {' | '.join(row)} |")
    return "\n".join(lines)


def numbers(made: Mapping[str, fa.results.Validation]) -> str:
    """The arm, as each two recordings tell it."""
    fits = {name: found.fits["motion"] for name, found in made.items()}
    rows = {path: {n: f"{f.values[path]:.3g} ({f.intervals[path][0]:.3g} to {f.intervals[path][1]:.3g})"
                   for n, f in fits.items()} for path in ARM}  # fmt: skip
    return table("number, without", {f"`{path}`": x for path, x in rows.items()})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--docs", action="store_true")
    parser.add_argument("--errors", action="store_true", help="the first two tables and the figures alone")
    args = parser.parse_args()
    began, made = time.perf_counter(), {}
    for name in SHIPPED:
        made[name] = fa.validate("quanser", predict=name)
        print(made[name], f"\n{time.perf_counter() - began:.0f} s\n", flush=True)
    tables = {"errors": whole(made), "numbers": numbers(made)}
    print(tables["errors"], "\n", tables["numbers"], "\n", flush=True)
    if args.docs:
        for driven in ("motion", "current"):
            own = [j for name, x in made.items() for j in x.judged if (j.driven, j.recording) == (driven, name)]
            plot_recordings(latest(own)).savefig(DOCS / "figures" / f"validation-{driven}.png", dpi=DPI * 0.8)
    if not args.errors:
        tables |= more(made)
    if args.docs:
        for name, made_table in tables.items():
            replace_table(DOCS / "validation.md", name, made_table)


def more(made: Mapping[str, fa.results.Validation]) -> dict[str, str]:
    """Other models, and what each part of ours brings."""
    last = {n: next(cell(j.nrmse) for j in reversed(x.judged) if j.driven == "motion") for n, x in made.items()}
    found = {"beside": beside(last)}
    print(found["beside"], "\n", flush=True)
    return found | {"models": models()}


if __name__ == "__main__":
    main()
