"""What `economize` chooses, against a truth that it does not know and against an exhaustive search: docs/economize.md.

    python bench/choose/economize.py [-o DIR] [--only scenes|search]

Writes figures/economize-*.png, figures/economize-scenes.csv and figures/economize-search.csv into DIR (docs by default)
and puts the tables between the marks in DIR/economize.md. The scenes are those of tests/choose/economize_scenes.py.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import platform
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
from flexarm.choose.models import ORDERS, BeamModel, Model, Models
from flexarm.choose.trials import timed
from flexarm.data.draw.tradeoff import label_errors, scale_errors
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "bench")]
from choose import economize_scenes as scenes  # noqa: E402
from reporting import replace_table  # noqa: E402

TOLERANCES = (1e-2, 1e-3, 1e-4)
STEPS = {"spatial": 48, "floating": 48, "heavy_tip": 96}  # of the truth; others take 320
_COUNT = 5  # runs, of which the least time counts
COLOURS = {"rigid": "#999999", 0: "#E69F00", 1: "#CC79A7", 2: "#0072B2", 3: "#009E73", "exact": "#333333"}


def truth_of(name: str, scene: fa.Scene) -> tuple[np.ndarray, float]:
    """Tip positions of the truth, and how far it moves when its steps are doubled, over its span."""
    if name in RICH:
        models, counts = Models(scene), tuple(RICH[name].get(s, 0) for s in fa._core.STRAINS)
        rich = models.given.each(lambda k, b: BeamModel(counts, "exact", True, None, "legendre"))
        some = [models.at(rich, {"integrator": "gauss", "tolerance": x}).run().frame()[0] for x in (1e-7, 1e-8)]
        return some[1], scenes.off(*some)
    rich = scenes.enriched(scene, scenes.STRAINS_OF.get(name, scenes.STRAINS_OF["slow"]))
    n = STEPS.get(name, 320)
    coarse, fine = (
        scenes.run(rich, integrator="gauss", step=float(scene.t[-1]) / k).frame()[0] for k in (n // 2, n)
    )  # fmt: skip
    return fine, scenes.off(coarse, fine)


def tip_and_time(scene: fa.Scene, count: int = _COUNT) -> tuple[np.ndarray, float]:
    """Tip positions of a run, and its processor time (s)."""
    runs = [timed(scene) for _ in range(count)]
    return runs[0][0].frame()[0], min(least for _, least, _ in runs)


# -- twelve scenes, three tolerances -----------------------------------------------------------------------------------


def judge() -> list[dict[str, object]]:
    rows: list[dict[str, object]] = []
    fa.economize("ist", 1e-2)  # imports
    for name, make in scenes.SCENES.items():
        scene = make()
        truth, known = truth_of(name, scene)
        tip, default = tip_and_time(scene)
        for tol in TOLERANCES:
            used = time.thread_time()
            plan = fa.economize(scene, tol)
            used = time.thread_time() - used
            lean_tip, lean = tip_and_time(plan.scene)
            rows.append(
                {
                    "scene": name,
                    "tol": tol,
                    "certified": plan.certified,
                    "error": scenes.off(lean_tip, truth),
                    "truth known to": known,
                    "default error": scenes.off(tip, truth),
                    "default ms": 1e3 * default,
                    "lean ms": 1e3 * lean,
                    "deciding ms": 1e3 * used,
                    "runs": plan.runs,
                    "coordinates": f"{scene.arm.nv} to {plan.arm.nv}",
                    "model": plan.model,
                }
            )
            print(
                f"{name} {tol:g}: error {rows[-1]['error']:.1e}, certified {plan.certified}, {plan.model}", flush=True
            )
    return rows


def judged_table(rows: list[dict[str, object]]) -> list[str]:
    out = [
        "| scene | tolerance | certified | true error | default: error, time | lean: time | deciding | runs | "
        "coordinates |"
    ]
    out.append("|-|-|-|-|-|-|-|-|-|")
    for r in rows:
        ratio = r["deciding ms"] / r["default ms"]
        out.append(
            f"| {r['scene']} | {r['tol']:.0e} | {'yes' if r['certified'] else 'no'} | {r['error']:.1e} | "
            f"{r['default error']:.1e}, {r['default ms']:.3g} ms | {r['lean ms']:.3g} ms | "
            f"{r['deciding ms']:.3g} ms ({ratio:.2g} defaults) | {r['runs']} | {r['coordinates']} |"
        )
    sure = [r for r in rows if r["certified"]]
    kept = [r for r in sure if r["error"] <= r["tol"]]
    faster = np.median([r["default ms"] / r["lean ms"] for r in rows])
    cost = np.median([r["deciding ms"] / r["default ms"] for r in rows])
    out += [
        "",
        f"{len(sure)} of {len(rows)} are certified, and {len(kept)} of these keep their tolerance. A lean run takes "
        f"1/{faster:.3g} of the time of the default one (median), deciding {cost:.2g} default runs (median).",
    ]
    return out


# -- exhaustive search -------------------------------------------------------------------------------------------------


def candidates(scene: fa.Scene, plan: fa.results.ModelPlan, most: dict[str, Any]) -> list[Model]:
    """All models with up to so many modes of these strains (or from so many to so many), link by link, of every order,
    in the plan's basis."""
    models = Models(scene)
    strains = fa._core.STRAINS
    bounds = [x if isinstance(x := most.get(s, 0), tuple) else (0, x) for s in strains]
    per_beam = list(itertools.product(*(range(least, more + 1) for least, more in bounds)))
    basis = plan._search.lean.model.basis or None
    found = {}
    for counts in itertools.product(per_beam, repeat=len(models.groups)):
        for order in ORDERS:
            of = {k: c for g, c in zip(models.groups, counts, strict=True) for k in g}
            for needs in (2, 6):  # torsion and shear need rotary inertia, unless what follows has some
                model = models.given.each(lambda k, _: BeamModel(of[k], order, any(of[k][needs:5]), None, basis))  # noqa: B023
                found[model] = None
    return list(found) if models.groups else []


def search(name: str, scene: fa.Scene, tol: float, most: dict[str, Any]) -> dict[str, object]:
    """Runs them all, with the plan's integrator and output times."""
    truth, _ = truth_of(name, scene)
    plan = fa.economize(scene, tol)
    models, chosen = Models(scene), plan._search.lean.model
    _, default = tip_and_time(scene)
    options = dict(plan._search.trials.setting)
    points = []
    some = candidates(scene, plan, most)
    for model in some:
        try:
            tip, least = tip_and_time(models.at(model, options), 2 if len(some) > 100 else 6)
        except (ValueError, fa.SimulationError):
            continue  # torsion of the last link has no inertia but its slices'
        if np.isfinite(tip).all():
            points.append((model, least, scenes.off(tip, truth)))
    plain = chosen.but(gauss=None)
    tip, least = tip_and_time(models.at(plain, options), 10)
    own = (plain, least, scenes.off(tip, truth))
    points = [*(p for p in points if p[0] != plain), own]
    lean_tip, lean = tip_and_time(plan.scene)
    good = [p for p in points if p[2] <= tol]
    again = sorted(good, key=lambda p: p[1])[:5]  # the least time of many that were measured twice is luck
    best = min(((m, tip_and_time(models.at(m, options), 10)[1], e) for m, _, e in again), key=lambda p: p[1])
    return {
        "name": name, "scene": scene, "tol": tol, "plan": plan, "points": points, "own": own, "best": best,
        "default": default, "lean": (lean, scenes.off(lean_tip, truth)), "label": models.label,
        "default error": scenes.off(scene.run().frame()[0], truth),
    }  # fmt: skip


def front_of(points: list[tuple]) -> list[tuple]:
    out, lowest = [], np.inf
    for p in sorted(points, key=lambda p: p[1]):
        if p[2] < lowest:
            out.append(p)
            lowest = p[2]
    return out


def kind_of(model: Model) -> int | str:
    """Its order, or "rigid"."""
    return model.order if model.elastic else "rigid"


def draw(found: dict, path: Path) -> None:
    fig = Figure(figsize=(7.4, 5.4), layout="constrained")
    ax = fig.subplots()
    for order, colour in COLOURS.items():
        some = [p for p in found["points"] if kind_of(p[0]) == order]
        if some:
            label = "rigid" if order == "rigid" else f"order {order}"
            ax.plot([p[1] for p in some], [p[2] for p in some], "o", ms=4, alpha=0.5, color=colour, label=label)
    front = front_of(found["points"])
    ax.plot([p[1] for p in front], [p[2] for p in front], color="#333333", lw=1.5, drawstyle="steps-post", alpha=0.6)
    ax.plot(*found["own"][1:], "o", ms=13, mfc="none", mec="#D55E00", mew=2, label="chosen, same integrator")
    ax.plot(*found["lean"], "*", ms=15, color="#D55E00", label="chosen, with its integrator and Gauss points")
    ax.plot(
        found["default"],
        found["default error"],
        "^",
        ms=10,
        mfc="none",
        mec="#009E73",
        mew=2,
        label="the scene as given",
    )
    ax.axhline(found["tol"], color="#009E73", ls="--", lw=1.2)
    ax.text(
        1.01, found["tol"], "tolerance", transform=ax.get_yaxis_transform(), ha="left", va="center", color="#009E73"
    )
    scale_errors(ax, 3.0)
    ax.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    label_errors(ax, "Largest error of the tip, over its span")
    ax.set_title(f"{found['scene'].name}: {len(found['points'])} models, all run", fontsize=11, fontweight="bold")
    fig.legend(frameon=False, fontsize=8, loc="outside lower center", ncols=4)
    fig.savefig(path, dpi=150)


ZOO = ROOT / "bench" / "run" / "zoo"
#: Of arms of the zoo, the shapes of the truth.
RICH = {
    "crane": {"bending_y": 5, "bending_z": 5, "torsion": 2},
    "picking": {"bending_y": 5, "bending_z": 5, "torsion": 2},
    "stick_and_slip": {"bending_y": 6},
}
CRANE = ROOT / "tests" / "data" / "crane.toml"
SEARCHES = {
    "crane": (lambda: fa.load(CRANE), 1e-3, {"bending_y": (1, 2), "bending_z": (1, 2), "torsion": 1}),
    "picking": (lambda: fa.load(ZOO / "picking.toml"), 1e-3, {"bending_y": 1, "bending_z": 1, "torsion": 1}),
    "stick_and_slip": (lambda: fa.load(ZOO / "stick_and_slip.toml"), 1e-3, {"bending_y": (1, 3)}),
    "slow": (lambda: scenes.SCENES["slow"](), 1e-3, {"bending_y": 4}),
    "ist": (lambda: fa.load("ist"), 1e-3, {"bending_y": 4}),
    "spatial": (scenes.spatial_two, 1e-3, {"bending_y": 2, "bending_z": 2, "torsion": 1}),
    "spliced": (scenes.spliced, 1e-3, {"bending_y": 3, "shear_y": 1}),
}


def searches(folder: Path) -> list[dict]:
    out = []
    for name, (make, tol, most) in SEARCHES.items():
        begun = time.perf_counter()
        found = search(name, make(), tol, most)
        draw(found, folder / f"economize-{name}.png")
        label = found["label"]
        words = [f"{label(m)}, {t:.2g} s, error {e:.1e}" for m, t, e in (found["own"], found["best"])]
        spent = time.perf_counter() - begun
        print(
            f"{name}: {len(found['points'])} models in {spent:.0f} s; chosen {' / cheapest '.join(words)}", flush=True
        )
        out.append(found)
    return out


def search_table(all_found: list[dict]) -> list[str]:
    out = ["| scene | models run | chosen | error, time | cheapest that keeps 1e-3 | error, time | times its time |"]
    out.append("|-|-|-|-|-|-|-|")
    for f in all_found:
        cells = [f"{f['label'](m)} | {e:.1e}, {1e3 * t:.3g} ms" for m, t, e in (f["own"], f["best"])]
        out.append(f"| {f['name']} | {len(f['points'])} | {' | '.join(cells)} | {f['own'][1] / f['best'][1]:.2f} |")
    return out


# -- the page ----------------------------------------------------------------------------------------------------------


def save(path: Path, rows: list[dict[str, object]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as f:
        writer = csv.DictWriter(f, list(rows[0]))
        writer.writeheader()
        writer.writerows({k: f"{v:.6g}" if isinstance(v, float) else v for k, v in r.items()} for r in rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", type=Path, default=ROOT / "docs")
    parser.add_argument("--only", choices=("scenes", "search"))
    args = parser.parse_args()
    warnings.simplefilter("ignore", fa.errors.RangeWarning)
    figures, page = args.o / "figures", args.o / "economize.md"
    figures.mkdir(parents=True, exist_ok=True)
    made = f"flexarm {fa.__version__}, {platform.machine()}, Python {platform.python_version()}"
    if args.only != "scenes":
        found = searches(figures)
        replace_table(page, "search", "\n".join([*search_table(found), "", made]))
        rows = [
            {"scene": f["name"], "model": f["label"](m), "ms": 1e3 * t, "error": e}
            for f in found
            for m, t, e in f["points"]
        ]
        save(figures / "economize-search.csv", rows)
        plan = next(f for f in found if f["name"] == "ist")["plan"]
        replace_table(page, "table", f"```text\n{plan}\n```")
    if args.only != "search":
        rows = judge()
        save(figures / "economize-scenes.csv", rows)
        replace_table(page, "scenes", "\n".join([*judged_table(rows), "", made]))


if __name__ == "__main__":
    main()
