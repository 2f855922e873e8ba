"""How good the estimates of `Result.error` are: docs/error.md.

    python bench/choose/error.py [--keep FILE] [--truth FILE] [--drawn N] [--only ARM ...] [--seconds S] [--docs]

Runs the arms of bench/run/zoo at three tolerances each, and N drawn scenes; estimates each run's error of the tip, and
compares it with the true one, the distance from a much richer model: of bending four shapes more than the estimate
takes, of torsion two, of shear and extension as many, in all beams; exact rotation, rotary inertia. Truth is "ida" at
rtol 1e-10 where that model has at most 18 coordinates and takes a second of a drawn scene, else "gauss" at a tolerance
of 1e-8; the table tells of how many. The effectivity is the estimate over the true error. Processor times of all
threads, over the smaller one of two of the run. --keep: rows are kept in the file, and those that it has are not made
again; without new ones in --seconds, it tells what it has. --truth: so are the truths.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
from flexarm.choose.enrich import enriched, moving_strains
from flexarm.choose.models import Models
from flexarm.model.parts.beam import STRAINS

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "bench" / "run"), str(ROOT / "bench")]
from reporting import replace_table  # noqa: E402
from zoo import ARMS, length  # noqa: E402

TOLERANCES = (1e-3, 1e-5, 1e-7)
FEW = 18  # coordinates, up to which truth is sought by IDA
GOOD, WRONG = 2.0, 5.0  # factors
HARD = 100  # the first of the harder drawn scenes


class TooLong(Exception):
    pass


def timed(f: Callable[[], Any]) -> tuple[float, Any]:
    began = time.process_time()
    out = f()
    return time.process_time() - began, out


def simulated(scene: fa.Scene, integrator: Any, seconds: float = np.inf) -> fa.Result:
    began = time.thread_time()

    def look(_: float) -> None:
        if time.thread_time() - began > seconds:
            raise TooLong

    return fa.simulate(
        scene.arm, scene.t, scene.q0, scene.v0, integrator=integrator, progress=look, **scene.given()
    )  # fmt: skip


class Truths:
    """Truths of scenes by their names, in a file where one is given."""

    def __init__(self, path: Path | None) -> None:
        self.path = path
        self.kept = dict(np.load(path)) if path and path.exists() else {}

    def __call__(self, name: str, scene: fa.Scene, ida: float, most: float) -> tuple[str, np.ndarray]:
        if not any(key.startswith(f"{name}: ") for key in self.kept):
            try:
                by, places = truth(scene, ida, most)
            except TooLong:
                by, places = "none", np.zeros(0)
            self.kept[f"{name}: {by}"] = places
            if self.path:
                np.savez(self.path, **self.kept)
        key = next(key for key in self.kept if key.startswith(f"{name}: "))
        if not self.kept[key].size:
            raise TooLong
        return key.removeprefix(f"{name}: "), self.kept[key]


def truth(scene: fa.Scene, ida: float, most: float) -> tuple[str, np.ndarray]:
    """Places of the ends over time of a much richer model, and how they were found."""
    models = Models(scene)
    stiff = [s.startswith("shear") or s == "extension" for s in STRAINS]
    usual = enriched(models, 0, reached := moving_strains(models))

    def change(k: int, b: Any) -> Any:
        counts = zip(b.counts, usual.counts(k), stiff, strict=True)
        return replace(b, counts=tuple(min(n, few) if fast else n for n, few, fast in counts))

    rich = enriched(models, 2, reached).each(change)
    at = models.at(models.rebased(rich), {})
    ways = [("ida", fa.Ida(rtol=1e-10, atol=1e-13), ida)] if at.arm.nv <= FEW else []
    for name, integrator, seconds in [*ways, ("gauss", fa.Gauss(tolerance=1e-8), most)]:
        try:
            return name, at.arm.end_places(simulated(at, integrator, seconds).q)
        except TooLong:
            continue
    raise TooLong


# -- drawn scenes ------------------------------------------------------------------------------------------------------


def drawn(seed: int) -> tuple[fa.Scene, Any]:
    """A scene, and its integrator: one or two links, in a plane or in space; driven, controlled, sprung, loaded or
    floating; of any order, basis and number of modes; that vibrates at 1.5 to 12 Hz, for about three periods. From HARD
    on softer, undamped, for about eight periods; some swing freely from where they are let go."""
    rng, hard = np.random.default_rng(seed), seed >= HARD

    def pick(*options: Any) -> Any:
        return options[int(rng.integers(len(options)))]

    n = pick(1, 1, 2) if hard else pick(1, 1, 1, 2, 2)
    space, lengths = rng.random() < (0.1 if hard else 0.25), rng.uniform(0.3, 1.0, 3)
    floating, gravity = rng.random() < 0.15, pick((0, 0, 0), (0, -9.81, 0), (0, -9.81, 0))
    gravity = (0, 0, 0) if floating else gravity
    low, high, periods, longest = (0.7, 4.0, 8.0, 2.0) if hard else (1.5, 12.0, 3.0, 1.5)
    frequency, whole = float(np.exp(rng.uniform(np.log(low), np.log(high)))), float(lengths[:n].sum())
    order, basis = pick(1, 2, 2, 2, 3, "exact", "exact"), pick("clamped-free", "clamped-free", "legendre")
    radius, density, payload = rng.uniform(0.003, 0.01), rng.uniform(1e3, 8e3), pick(0.0, 0.1, 0.5, 2.0)
    mass = density * np.pi * radius**2 * whole
    stiffness = (payload + 0.25) * mass * whole**3 * (2 * np.pi * frequency) ** 2 / 3
    material = fa.Material(density, stiffness / (np.pi * radius**4 / 4), 0.3)
    modes = {"bending_y": int(rng.integers(1, 4))}
    modes |= {"bending_z": int(rng.integers(1, 4)), "torsion": 1} if space else {}
    links, drive, control = [], {}, []
    span = float(np.clip(periods / frequency, 0.2, longest))
    size = stiffness / whole  # N m: a moment that bends the arm by a radian
    for k in range(n):
        beam = fa.Beam(
            lengths[k], fa.Circle(radius), material, modes, basis, order=order,
            damping_ratio=0.0 if hard else pick(0.0, 0.01), rotary_inertia=space or pick(True, True, False),
        )  # fmt: skip
        small = 0.1 * payload * mass * (0.1 * whole) ** 2
        tip = fa.RigidBody(payload * mass, inertia=(small,) * 3) if payload else None
        axis = "z" if not space or k == 0 else pick("y", "z")
        inertia = mass * whole**2
        kinds = ["motion", "torque", "pd", "spring", "friction", *(["none"] * 3 if hard else [])]
        what = "free" if floating and k == 0 else pick(*kinds)
        given: dict[str, Any] = {"reflected_inertia": 0.2 * inertia}
        if what == "spring":
            given |= {"stiffness": pick(0.3, 1.0, 3.0) * size, "damping": 0.02 * size / frequency}
        if what == "friction":
            given |= {"coulomb": 0.02 * size, "stiction": 0.025 * size, "damping": 0.002 * size / frequency}
        if what == "free":
            joint: Any = fa.Free()
        else:
            joint = fa.Revolute(axis, **given)
        hub = fa.RigidBody(2 * mass, inertia=(0.5 * inertia,) * 3) if what == "free" else None
        links.append(fa.Link(joint, hub, beam, tip if k == n - 1 or rng.random() < 0.3 else None))
        turn = float(rng.uniform(0.2, 0.8))
        if what == "motion":
            drive[k] = fa.Motion([0, 0.4 * span, 2 * span], [0, turn, turn], [0, 0, 0], [0, 0, 0])
        elif what in ("torque", "friction"):
            drive[k] = fa.Torque(np.array([0, 0.1, 0.4, 0.6, 2]) * span, np.array([0, 1, 1, -0.5, 0]) * 0.15 * size)
        elif what == "pd":
            w = 2 * np.pi * frequency
            kp = 0.5 * inertia * w**2
            control.append(fa.PD(kp, 1.4 * kp / w, k, reference=pick(0.0, turn)))
    loads = []
    if rng.random() < 0.3:
        t = np.array([0, 0.2, 0.3, 2.0]) * span
        push = np.zeros((4, 3))
        push[1:3, 1] = 0.2 * size / whole
        place = pick(None, None, float(0.5 * lengths[n - 1]))
        loads.append(fa.Load(n - 1, place, t=t, force=push))
    v0 = None
    arm = fa.Arm(links, gravity)
    if rng.random() < 0.2 and not drive and not control:
        v0 = np.where([".joint" in x or "revolute" in x for x in arm.coordinates], 0.5 * frequency, 0.0)
    start = "equilibrium" if any(gravity) and not control and all(
        "stiffness" in str(link.joint) and link.joint.stiffness for link in links) else None  # fmt: skip
    if hard and start is None and any(gravity):
        start = {k: float(rng.uniform(0.2, 1.2)) for k in range(n) if k not in drive} or None
    integrator = pick(
        fa.Gauss(), fa.Gauss(), fa.Gauss(tolerance=1e-3), fa.Gauss(tolerance=1e-7), fa.Implicit(span / 200),
        fa.Ida(), fa.Gauss(step=span / 20),
    )  # fmt: skip
    scene = fa.Scene(
        arm, drive, tuple(loads), np.linspace(0, span, 101), start, v0, {}, f"drawn {seed}", (), tuple(control)
    )  # fmt: skip
    return scene, integrator


# -- rows --------------------------------------------------------------------------------------------------------------


def row(name: str, scene: fa.Scene, integrator: Any, of: tuple[str, np.ndarray]) -> dict[str, Any]:
    """The estimate of a run beside its true error."""
    times = [timed(lambda: simulated(scene, integrator)) for _ in range(2)]
    used, run = min(x for x, _ in times), times[-1][1]
    true = float(np.linalg.norm(of[1] - scene.arm.end_places(run.q), axis=-1).max())
    out = {"name": name, "by": repr(integrator), "truth": of[0], "true": true, "seconds": used, "nv": scene.arm.nv}
    out["span"] = float(np.ptp(of[1], axis=0).max())
    out["length"] = length(scene.arm)
    try:
        spent, found = timed(run.error)
    except (ValueError, fa.SimulationError) as e:
        return {**out, "refused": str(e)}
    top = found.sources[0]
    about = {k: getattr(found, k) for k in ("largest", "reliable", "reason", "richer", "runs")}
    added = sum(x.error for x in found.sources)
    first = {"top": f"{top.where}, {top.what}", "share": top.share}
    return {**out, **about, **first, "cost": spent / max(used, 1e-4), "added": added}


def rows(
    names: list[str], count: int, kept: dict[str, Any], seconds: float, truths: Truths
) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    began = time.monotonic()
    turns = [k for pair in zip(range(HARD), range(HARD, 2 * HARD), strict=True) for k in pair]
    for name in [*names, *(f"drawn {k}" for k in turns[:count])]:
        if name in kept or time.monotonic() - began > seconds:
            continue
        found: list[dict[str, Any]] = []
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                if name in ARMS:
                    scene = fa.load(ARMS[name])
                    of = truths(name, scene, 0.0, 240.0)
                    found += [row(f"{name}, {x:g}", scene, fa.Gauss(tolerance=x), of) for x in TOLERANCES]
                else:
                    scene, integrator = drawn(int(name.split()[1]))
                    found.append(row(name, scene, integrator, truths(name, scene, 1.0, 8.0)))
            except (fa.SimulationError, ValueError, TooLong) as e:
                found.append({"name": name, "failed": f"{type(e).__name__}: {e}"})
        yield name, found


# -- the page ----------------------------------------------------------------------------------------------------------

Rows = list[dict[str, Any]]


def least(x: dict[str, Any]) -> float:
    """The truths' own error, about: an estimate and an error below it agree."""
    return 1e-8 * x["length"]


def effectivity(x: dict[str, Any]) -> float:
    return (x["largest"] + least(x)) / (x["true"] + least(x))


def written(number: float) -> str:
    return f"{number:.1e}".replace("e-0", "e-")


def lines(head: str, cells: list[list[str]]) -> str:
    return "\n".join([head, "|-" * (head.count("|") - 1) + "|", *(f"| {' | '.join(row)} |" for row in cells)])


def told(x: dict[str, Any]) -> list[str]:
    own = [written(x["largest"]), written(x["true"]), f"{effectivity(x):.2f}"]
    return [x["name"].replace("_", " "), *own]


def table_of_zoo(found: Rows) -> str:
    cells = [[*told(x), f"{x['top']}, {100 * x['share']:.0f} %", "yes" if x["reliable"] else x["reason"],
              f"{x['cost']:.1f}"] for x in found if "largest" in x]  # fmt: skip
    head = "| arm, tolerance | estimate (m) | true (m) | effectivity | largest source | reliable | time, in runs |"
    return lines(head, cells)


def table_of_drawn(found: Rows) -> str:
    done = [x for x in found if "largest" in x]
    e = np.array([effectivity(x) for x in done])
    sure = np.array([x["reliable"] for x in done], dtype=bool)
    near = (e >= 1 / GOOD) & (e <= GOOD)
    parts = [abs(x["added"] - x["largest"]) < 0.1 * x["largest"] for x in done if x["reliable"]]
    counts = {
        "drawn": len(found),
        "cannot be run, or no truth within the time": sum("failed" in x for x in found),
        "refused by name": sum("refused" in x for x in found),
        "estimated": len(done),
        "truth by IDA at 1e-10": sum(x["truth"] == "ida" for x in done),
        "effectivity between 1/2 and 2": int(near.sum()),
        "of these, said to be reliable": int((near & sure).sum()),
        "said to be not reliable": int((~sure).sum()),
        "outside 1/2 to 2, and said to be reliable": int((~near & sure).sum()),
        "below 1/5, and said to be reliable": int(((e < 1 / WRONG) & sure).sum()),
        "median effectivity": f"{np.median(e):.3f}",
        "5 % and 95 % of effectivities": f"{np.quantile(e, 0.05):.2f}, {np.quantile(e, 0.95):.2f}",
        "of the reliable, parts add up to the largest error within 10 %": sum(parts),
        **{
            f"median time, in runs, {word}": f"{np.median(times):.1f} (of {len(times)})"
            for word, low, high in (("below 5 ms", 0.0, 5e-3), ("from 5 to 20 ms", 5e-3, 2e-2), ("above", 2e-2, np.inf))
            if (times := [x["cost"] for x in done if low <= x["seconds"] < high])
        },
    }
    return lines("| drawn scenes | |", [[k, str(v)] for k, v in counts.items()])


def table_of_failures(found: Rows) -> str:
    cells = []
    for x in found:
        if "largest" in x and not x["reliable"] and x["largest"] < 1e-5 * x["length"] and "told" in x["reason"]:
            continue  # nothing that anybody looks for
        if "largest" not in x:
            why = x.get("refused") or x["failed"].replace("TooLong: ", "no truth within the time")
            cells.append([x["name"], "", "", "", why[:160].replace("|", "/")])
        elif not x["reliable"] or not 1 / GOOD <= effectivity(x) <= GOOD:
            cells.append([*told(x), x["reason"] or "said to be reliable"])
    return lines("| scene | estimate (m) | true (m) | effectivity | what it says |", cells)


def draw(zoo: Rows, others: Rows, path: Path) -> None:
    import matplotlib.pyplot as plt

    figure, ax = plt.subplots(figsize=(6.5, 5.5), layout="constrained")
    for name, group, mark in (("drawn scenes", others, "o"), ("arms of the zoo", zoo, "s")):
        for word, sure, colour in (("", True, "tab:blue"), (", said to be not reliable", False, "tab:red")):
            of = [((x["true"] + least(x)) / x["length"], (x["largest"] + least(x)) / x["length"])
                  for x in group if "largest" in x and x["reliable"] == sure]  # fmt: skip
            if of:
                ax.plot(*zip(*of, strict=True), mark, ms=5, color=colour, mfc="none" if mark == "o" else colour,
                        label=name + word)  # fmt: skip
    ends = np.array([1e-9, 1.0])
    ax.plot(ends, ends, color="0.4", lw=0.8)
    ax.fill_between(ends, ends / GOOD, ends * GOOD, color="0.85", label="a factor of two")
    ax.set(xscale="log", yscale="log", xlabel="true error (parts of the arm's length)", ylabel="estimated error")
    ax.legend(fontsize=8)
    figure.savefig(path, dpi=110)


def page(kept: dict[str, Rows]) -> None:
    zoo = [x for name in ARMS for x in kept.get(name, [])]
    others = [x for name, found in kept.items() if name.startswith("drawn") for x in found]
    draw(zoo, others, ROOT / "docs" / "figures" / "error.png")
    tables = {"zoo": table_of_zoo(zoo), "drawn": table_of_drawn(others), "failures": table_of_failures(zoo + others)}
    for mark, of in tables.items():
        replace_table(ROOT / "docs" / "error.md", mark, of)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--truth", type=Path)
    parser.add_argument("--drawn", type=int, default=200)
    parser.add_argument("--only", nargs="*", default=list(ARMS), help="of the arms of the zoo")
    parser.add_argument("--seconds", type=float, default=np.inf)
    parser.add_argument("--docs", action="store_true", help="write the table and the figure of docs/error.md")
    args = parser.parse_args()
    kept = json.loads(args.keep.read_text()) if args.keep and args.keep.exists() else {}
    fa.load(ARMS["boom"]).run(error=True)  # loads libraries
    for name, found in rows(args.only, args.drawn, kept, args.seconds, Truths(args.truth)):
        kept[name] = found
        for x in found:
            ratio = effectivity(x) if "largest" in x else np.nan
            print(x["name"], f"{ratio:.3g}", {k: v for k, v in x.items() if k not in ("name", "richer")}, flush=True)
        if args.keep:
            args.keep.write_text(json.dumps(kept, indent=1))
    if args.docs:
        page(kept)


if __name__ == "__main__":
    main()
