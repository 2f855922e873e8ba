"""Fronts, tables and figures of bench/speed/peers.py."""

from __future__ import annotations

import re
from typing import Any

import matplotlib

matplotlib.use("Agg")
import numpy as np
from matplotlib.figure import Figure
from peer_common import CASES, Case

BEGIN, END = "<!-- written by bench/speed/peers.py: begin -->", "<!-- end -->"
TARGETS = (1e-4, 1e-5, 1e-6)  # m
EXUDYN, ROUGH = ("Exudyn exact", "8 elements, step 0.0005 s"), 1.3e-5  # its setting, and m, that an aim is about
PEERS = ("Exudyn", "MuJoCo", "SciPy")
COLOURS = {"flexarm": "Blues", "Exudyn": "Oranges", "MuJoCo": "Greens", "SciPy": "Purples"}
MARKS = "osD^vP*X<>"

Row = dict[str, Any]


def program(row: Row) -> str:
    """The first word of a method."""
    return str(row["method"]).split()[0]


def front(runs: list[Row]) -> list[Row]:
    """Runs that no other beats in both time and error, from fast to accurate."""
    out: list[Row] = []
    for row in sorted((r for r in runs if r["error"]), key=lambda r: (r["cpu_s"], r["error"])):
        if not out or row["error"] < out[-1]["error"]:
            out.append(row)
    return out


def time_for(target: float, runs: list[Row]) -> float | None:
    """CPU time (s) for an error, interpolated on the front (both logarithmic); None when it is not reached."""
    best = front(runs)
    if not best or best[-1]["error"] > target:
        return None
    errors, times = (np.log([r[k] for r in best])[::-1] for k in ("error", "cpu_s"))
    return float(np.exp(np.interp(np.log(target), errors, times)))


def ratios(runs: list[Row]) -> list[Row]:
    """By case and target error: each program's time, the best peer, and its time over flexarm's."""
    out = []
    for case in sorted({r["case"] for r in runs}):
        for target in TARGETS:
            mine = {p: [r for r in runs if r["case"] == case and program(r) == p] for p in COLOURS}
            times = {p: time_for(target, rows) for p, rows in mine.items()}
            reached = {p: t for p in PEERS if (t := times[p]) is not None}
            best = min(reached, key=lambda p: reached[p]) if reached else None
            own = times["flexarm"]
            ratio = reached[best] / own if best and own else None
            out.append({"case": case, "target": target, "times": times, "best_peer": best, "ratio": ratio})
    return out


def aims(runs: list[Row]) -> list[tuple[str, float | None, float]]:
    """What was aimed at: Exudyn's time over flexarm's, and that it should be at least."""

    def fastest(rows: list[Row], error: float) -> float | None:
        return min((r["cpu_s"] for r in rows if r["error"] and r["error"] <= error), default=None)

    def over(theirs: float | None, own: float | None) -> float | None:
        return theirs / own if theirs and own else None

    out = []
    mine = {case: [r for r in runs if r["case"] == case] for case in CASES}
    exudyn, own = ({c: [r for r in rows if program(r) == p] for c, rows in mine.items()} for p in ("Exudyn", "flexarm"))
    theirs = next((r for r in exudyn["a"] if (r["method"], r["setting"]) == EXUDYN and r["error"]), None)
    if theirs:
        for name, rows, aim in (
            ("any integrator", own["a"], 500.0),
            ("IDA", [r for r in own["a"] if "ida" in r["method"]], 50.0),
        ):
            words = f"(a) {', '.join(EXUDYN)} ({theirs['error']:.1e} m), against {name} at {ROUGH:.1e} m"
            out.append((words, over(theirs["cpu_s"], fastest(rows, ROUGH)), aim))
    for case, target, aim in (("a", 1e-6, 300.0), ("c", 1e-5, 40.0)):
        if mine[case]:
            words = f"({case}) at {target:.0e} m, both interpolated on their fronts"
            out.append((words, over(time_for(target, exudyn[case]), time_for(target, own[case])), aim))
    return out


def _ms(t: float | None) -> str:
    return "not reached" if t is None else f"{1e3 * t:.3g}"


def table(rows: list[Row], truths: list[Row], runs: list[Row], about: Row) -> str:
    """Markdown: times by error, fronts, converged models."""
    versions = ", ".join(f"{k} {v}" for k, v in about["versions"].items())
    text = [f"Measured on {about['cpu']} at commit {about['commit']}; {versions}.", ""]
    head = ["case", "error (m)", *(f"{p} (ms)" for p in COLOURS), "best peer", "its time divided by flexarm's"]
    text += [_line(head), _line(["-"] * len(head))]
    for r in rows:
        ratio = "" if r["ratio"] is None else f"{r['ratio']:.2g}"
        times = [_ms(r["times"][p]) for p in COLOURS]
        text.append(_line([r["case"], f"{r['target']:.0e}", *times, r["best_peer"] or "none", ratio]))
    text += ["", "Exudyn's time divided by flexarm's, and the aims:", ""]
    for name, ratio, aim in aims(runs):
        text.append(f"- {name}: {'not reached' if ratio is None else f'**{ratio:.3g}**'} (aim ≥ {aim:g})")
    text += ["", "The settings on the fronts of flexarm and Exudyn:", ""]
    text += [_line(["case", "method", "setting", "error (m)", "CPU (ms)"]), _line(["-"] * 5)]
    for case in sorted({r["case"] for r in runs}):
        for p in ("flexarm", "Exudyn"):
            for r in front([r for r in runs if r["case"] == case and program(r) == p]):
                text.append(_line([case, r["method"], r["setting"], f"{r['error']:.1e}", _ms(r["cpu_s"])]))
    text += ["", "The converged models:", ""]
    text += [_line(["case", "strains and inertia", "how", "moved by the last refinement (m)", "to the others (m)"])]
    text += [_line(["-"] * 5)]
    for t in sorted(truths, key=lambda t: str(t["case"])):
        apart = "; ".join(f"{name}: {d:.1e}" for name, d in t["distance"].items())
        how = f"{t['method']}, {t['setting']}"
        text.append(_line([t["case"], t["truth"], how, f"{t['converged']:.1e}", apart]))
    failed = [r for r in runs if r["error"] is None]
    if failed:
        text += ["", f"{len(failed)} settings of {len(runs)} failed:", ""]
        text += failures(failed)
    return "\n".join(text) + "\n"


def failures(failed: list[Row]) -> list[str]:
    """A line for each case and method: how many settings failed, in which steps, why, and the limit that they name."""
    groups: dict[tuple[str, str], list[Row]] = {}
    for r in failed:
        groups.setdefault((r["case"], r["method"].partition(",")[0]), []).append(r)
    lines = []
    for (case, method), rows in groups.items():
        notes = [str(r.get("note", "")) for r in rows]
        steps = _span(r"\bstep (\S+) s", [str(r["setting"]) for r in rows])
        limits = _span(r": below (\S+) s\)", notes)
        why = "; ".join(dict.fromkeys(reason for note in notes if (reason := _reason(note))))
        parts = [f"- {case}: {len(rows)} of {method}", steps and f", in steps of {steps} s", why and f": {why}"]
        lines.append("".join([*parts, limits and f"; the longest stable step of these models is {limits} s"]))
    return lines


def _reason(note: str) -> str:
    """The first words of what an error says, without its time and its numbers."""
    words = re.sub(r"^stopped at t = \S+ s: ", "", note)
    return re.split(r" in steps of|[:;(\n]", words)[0].strip()


def _span(pattern: str, texts: list[str]) -> str:
    """The least and the largest number that a pattern finds."""
    found = [float(x) for text in texts for x in re.findall(pattern, text)]
    return "" if not found else " to ".join(dict.fromkeys(f"{x:g}" for x in (min(found), max(found))))


def _line(cells: list[Any]) -> str:
    return "| " + " | ".join(str(c) for c in cells) + " |"


def figure(case: Case, runs: list[Row]) -> Figure:
    """Error against CPU time: every run a faint mark, a line along each method's front, rings on the front of all."""
    fig = Figure(figsize=(8, 5.2), layout="constrained")
    ax = fig.subplots()
    done = [r for r in runs if r["error"] and r["error"] < case.length / 10]
    for p, shades in COLOURS.items():
        methods = sorted({r["method"] for r in done if program(r) == p})
        for k, method in enumerate(methods):
            mine = [r for r in done if r["method"] == method]
            colour = matplotlib.colormaps[shades](0.9 - 0.5 * k / max(1, len(methods) - 1))
            mark = MARKS[k % len(MARKS)]
            x, y = ([r[i] for r in mine] for i in ("cpu_s", "error"))
            ax.plot(x, y, mark, color=colour, alpha=0.25, ms=4, mew=0)
            x, y = ([r[i] for r in front(mine)] for i in ("cpu_s", "error"))
            ax.plot(x, y, mark + "-", color=colour, ms=5, label=method)
    best = front(done)
    x, y = ([r[i] for r in best] for i in ("cpu_s", "error"))
    ax.plot(x, y, "o", mfc="none", mec="black", ms=11, label="front of all")
    ax.set(xscale="log", yscale="log", xlabel="CPU time of the simulation (s)", ylabel="largest error of the tip (m)")
    ax.set_title(f"({case.name}) {CASES[case.name].title}", fontsize=10, loc="left")
    ax.grid(which="major", alpha=0.3)
    fig.legend(loc="outside right upper", fontsize=8, frameon=False)
    return fig
