"""Tables and figures of bench/rod/rods.py."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import numpy as np
from matplotlib.figure import Figure

BEGIN, END = "<!-- written by bench/rod/rods.py: begin -->", "<!-- end -->"
OWN, PEER = "tab:blue", "tab:orange"

Row = dict[str, Any]


def tables(found: dict[str, list[Row]], about: Row) -> str:
    """What the page shows between its marks."""
    parts = [
        f"Measured on {about['cpu']} at commit {about['commit']}; flexarm {about['flexarm']}, "
        f"exudyn {about['exudyn']}.",
        "### Equilibria\n\nError of the tip divided by the length, compared with shooting; CPU time of the solution.",
        _statics(found["statics"]),
        _strip(found["strip"]),
        "### Buckling\n\nThe load at which a frequency about the equilibrium becomes zero. "
        "Strips: in √(EI GJ)/L²\nor, of moments, √(EI GJ)/L.",
        _buckling(found["buckling"]),
        "### Frequencies of curved rods\n\nClamped at one end (Hz), compared with collocation of the linear equations.",
        _rings(found["rings"]),
        "### Rotating blades\n\nThe first two flapping frequencies, in √(EI/ρA)/L², and the length of the "
        "rotating blade.",
        _blades(found["blades"], about["wright"]),
        "### Motions\n\nLargest distance between two solutions, of any end of a beam at any output time (m).",
        _motions(found["motions"]),
    ]
    return "\n\n".join(parts) + "\n"


def _table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in [head, ["-"] * len(head), *rows])


def _e(x: float | None) -> str:
    return "" if x is None else f"{x:.1e}"


def _statics(rows: list[Row]) -> str:
    head = ["equilibrium", "tip", *(f"{n} shapes" for n in (4, 8, 12)), "ms with 8", "Exudyn, 64 elements", "published"]
    lines = []
    for r in rows:
        own = {x["shapes"]: x for x in r["flexarm"]}
        tip = "({:.7g}, {:.7g}, {:.7g})".format(*(0.0 if abs(x) < 1e-12 else x for x in r["tip"]))
        theirs = [x["error"] for x in r["exudyn"] if x["elements"] == 64]
        errors = [_e(own[n]["error"]) for n in (4, 8, 12)]
        peer = _e(theirs[0]) if theirs else "refuses couplings"
        lines.append([r["case"].name, tip, *errors, f"{1e3 * own[8]['cpu_s']:.0f}", peer, r["case"].published])
    return _table(head, lines)


def _strip(rows: list[Row]) -> str:
    worst, theirs = max(r["error"] for r in rows), [r["exudyn_error"] for r in rows if r["exudyn_error"] is not None]
    peer = f"; Exudyn's, extrapolated, by at most {max(theirs):.1e}" if theirs else ""
    return (
        f"On the Princeton beam's {len(rows)} loads and angles flexarm's tip, with 8 shapes of each strain, is off by "
        f"at most {worst:.1e} of the length{peer}."
    )


def _buckling(rows: list[Row]) -> str:
    lines = []
    for r in rows:
        unit = r["case"].unit
        shooting = "" if r["shooting"] is None else f"{r['shooting'] / unit:.6f}"
        lines.append([r["case"].name, f"{r['flexarm'] / unit:.6f}", shooting, r["case"].known])
    return _table(["case", "flexarm", "shooting", "closed form, or published"], lines)


def _rings(rows: list[Row]) -> str:
    lines = []
    for r in rows:
        own = ", ".join(f"{x:.5g}" for x in r["own"])
        lines.append([r["ring"].name, f"{r['ring'].shapes}", own, _e(r["error"])])
    text = _table(["rod", "shapes of each strain", "the first six", "largest relative difference"], lines)
    spring = [r for r in rows if "clamped" in r]
    if spring:
        own = ", ".join(f"{x:.1f}" for x in spring[0]["clamped"])
        text += f"\n\nThe same collocation with both ends of the spring clamped: {own} Hz."
    return text


def _blades(rows: list[Row], wright: dict[float, tuple[float, float]]) -> str:
    head = ["slenderness", "speed", "flexarm", "largest relative difference", "length", "its difference"]
    head.append("not stretching (Wright et al.)")
    lines = []
    for r in rows:
        pair = ", ".join(f"{x:.6f}" for x in r["own"])
        difference = np.abs(r["own"] / r["true"] - 1).max()
        known = ", ".join(f"{x:.4f}" for x in wright[r["speed"]])
        line = [f"{r['slenderness']:g}", f"{r['speed']:g}", pair, _e(difference)]
        lines.append([*line, f"{r['tip']:.9f}", _e(abs(r["tip_error"])), known])
    return _table(head, lines)


def _motions(rows: list[Row]) -> str:
    head = ["motion", "duration (s)", "shapes, step (s)", "change by the last refinement", "CPU (s)"]
    head += ["Exudyn, change by the last refinement", "its finest run (s)", "flexarm − Exudyn"]
    lines = []
    for r in rows:
        n, step = r["settings"][1]
        line = [r["case"].title, f"{r['case'].end:g}", f"{n}, {step:g}", _e(r["moved"]), f"{r['cpu_s'][1]:.2g}"]
        if "apart" in r:
            line += [_e(r["exudyn_moved"]), f"{r['exudyn_cpu_s']:.2g}", f"**{r['apart'].max():.1e}**"]
        else:
            line += ["", "", ""]
        lines.append(line)
    return _table(head, lines)


def figures(found: dict[str, list[Row]]) -> dict[str, Figure]:
    draw: dict[str, Callable[[list[Row]], Figure]]
    draw = {"statics": _draw_statics, "strip": _draw_strip, "motions": _draw_motions}
    return {name: function(found[name]) for name, function in draw.items()}


def _draw_statics(rows: list[Row]) -> Figure:
    """Error against the number of coordinates, one panel a program."""
    figure = Figure(figsize=(9, 4.6), layout="constrained")
    axes = figure.subplots(1, 2, sharex=True, sharey=True)
    colours = matplotlib.colormaps["tab20"](np.linspace(0, 1, len(rows)))
    for r, colour in zip(rows, colours, strict=True):
        size = len(r["case"].pieces)
        own = [(x["size"], max(x["error"], 1e-13)) for x in r["flexarm"]]
        theirs = [(7 * size * (x["elements"] + 1), max(x["error"], 1e-13)) for x in r["exudyn"]]
        for ax, points in zip(axes, (own, theirs), strict=True):
            if points:
                ax.loglog(*np.transpose(points), "o-", color=colour, ms=4, label=r["case"].name)
    for ax, title in zip(axes, ("flexarm", "Exudyn"), strict=True):
        ax.set(title=title, xlabel="coordinates")
        ax.grid(which="major", alpha=0.3)
    axes[0].set_ylabel("error of the tip / length")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=7, frameon=False)
    return figure


def _draw_strip(rows: list[Row]) -> Figure:
    """Displacements and twist of the Princeton beam against the angle of the load."""
    figure = Figure(figsize=(9, 3.4), layout="constrained")
    axes = figure.subplots(1, 3)
    for k, load in enumerate(sorted({r["load"] for r in rows})):
        mine = [r for r in rows if r["load"] == load]
        angle = [r["angle"] for r in mine]
        for ax, i in ((axes[0], 2), (axes[1], 1)):
            ax.plot(angle, [1e3 * r["tip"][i] for r in mine], "-", color=f"C{k}", label=f"{load} N")
            ax.plot(angle, [1e3 * r["own"][i] for r in mine], "o", mfc="none", color=f"C{k}")
            if all(r["exudyn"] for r in mine):
                ax.plot(angle, [1e3 * r["exudyn"][i] for r in mine], "x", color=f"C{k}", ms=5)
        axes[2].plot(angle, [abs(r["twist"]) for r in mine], "-", color=f"C{k}")
        axes[2].plot(angle, [abs(r["own_twist"]) for r in mine], "o", mfc="none", color=f"C{k}")
    labels = ("across the flat side (mm)", "across the edge (mm)", "twist of the tip (°)")
    for ax, label in zip(axes, labels, strict=True):
        ax.set(xlabel="angle of the load (°)", ylabel=label, xticks=range(0, 91, 30))
        ax.grid(alpha=0.3)
    axes[1].plot([], [], "k-", label="shooting")
    axes[1].plot([], [], "ko", mfc="none", label="flexarm")
    axes[1].plot([], [], "kx", ms=5, label="Exudyn")
    handles, labels = axes[1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=6, fontsize=8, frameon=False)
    return figure


def _draw_motions(rows: list[Row]) -> Figure:
    """Paths of the last end, and how far the programs are apart."""
    figure = Figure(figsize=(9, 5.6), layout="constrained")
    axes = figure.subplots(2, len(rows), squeeze=False)
    for k, r in enumerate(rows):
        t, path = r["case"].times, r["path"][:, -3:]
        for i, name in enumerate("xyz"):
            axes[0, k].plot(t, path[:, i] - path[0, i], "-", color=f"C{i}", label=f"{name}, flexarm")
            if "exudyn" in r:
                theirs = r["exudyn"][:, -3:]
                axes[0, k].plot(t[::4], (theirs - theirs[0])[::4, i], "x", color=f"C{i}", ms=4, label=f"{name}, Exudyn")
        axes[0, k].set_title(r["case"].title.replace(", ", ",\n", 1), fontsize=7)
        if "apart" in r:
            axes[1, k].semilogy(t[1:], np.maximum(r["apart"][1:], 1e-12), color="black")
        axes[1, k].set(xlabel="t (s)", ylim=(1e-10, 1e-3))
        for ax in axes[:, k]:
            ax.grid(alpha=0.3)
            ax.tick_params(labelsize=7)
        if k:
            axes[1, k].set_yticklabels([])
    axes[0, 0].set_ylabel("displacement of the last end (m)", fontsize=8)
    axes[1, 0].set_ylabel("distance to Exudyn (m)", fontsize=8)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=6, fontsize=8, frameon=False)
    return figure


def keep(page: Path, text: str) -> None:
    """Writes a text between the page's marks."""
    head, rest = page.read_text(encoding="utf-8").split(BEGIN)
    tail = rest.split(END)[1]
    page.write_text(f"{head}{BEGIN}\n\n{text}\n{END}{tail}", encoding="utf-8")
