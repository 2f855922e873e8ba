"""Closed loops beside independent solutions (bench/run/loops_truth.py, Exudyn, Pinocchio), and what they cost.

    python bench/run/loops.py [--docs] [--peers DIR] [--only rigid,flexible,...]

- Rigid: the squeezer and the slider crank of the IVP test set, four bars, the double four-bar and Bricard's mechanism
  of the IFToMM library, a robot of three arms: by integrators and steps.
- Flexible: a four-bar and a slider crank of beams, and a four-bar with a misaligned axis, beside Exudyn
  (loops_exudyn.py; its answers are kept in DIR).
- Speed: an implicit step of a flexible five-bar; rings of bars; forward dynamics of the robot beside Pinocchio, in one
  program (loops_pinocchio.py; compiled at the first run, for many minutes).
Prints the tables; with --docs writes them into docs/loops.md, and the pictures docs/figures/loops*.png.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from time import thread_time
from typing import Any

import flexarm as fa
import loops_arms as arms
import loops_pinocchio
import matplotlib
import numpy as np
from loops_cases import FOURBAR as FLEXIBLE_FOURBAR
from loops_cases import HELD, MISALIGNED, OUTPUTS, SLIDER, Held
from loops_truth import ANDREWS, FOURBAR, Array, Rod, bricard_angles, double_four_bar
from loops_truth import bricard as bricard_truth
from loops_truth import delta as delta_truth

matplotlib.use("Agg")
import matplotlib.pyplot as plt

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from reporting import finish, replace_table

ROOT = Path(__file__).resolve().parents[2]
BLUE, ORANGE, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#666666"
TITLES = {"fourbar": "four-bar", "slider": "slider crank", "held": "two arms with a bar"}
Runs = list[tuple[str, dict[str, Any]]]


def least(job: Any, rounds: int = 5) -> float:
    """CPU time of this thread (s)."""
    best = np.inf
    for _ in range(rounds):
        began = thread_time()
        job()
        best = min(best, thread_time() - began)
    return float(best)


def steps_of(integrator: str, *lengths: float) -> Runs:
    """Runs in steps of these lengths (ms)."""
    return [(f"{integrator}, {h:g} ms", {"integrator": integrator, "step": h / 1000}) for h in lengths]


RUNS: Runs = [
    *steps_of("implicit", 1), *steps_of("gauss", 10), ("default", {}), *steps_of("rk4", 1),
    ("ida, rtol 1e-8", {"integrator": "ida", "rtol": 1e-8, "atol": 1e-10}),
]  # fmt: skip


# -- rigid -------------------------------------------------------------------------------------------------------------


def measured(arm: fa.Arm, t: Array, q: Any, v: Any, off: Any, options: dict[str, Any], **more: Any) -> list[Any]:
    """Off by; g and dg/dt are at most; CPU time (s). Or why not."""
    began = thread_time()
    try:
        run = fa.simulate(arm, t, q, v, **options, **more)
    except fa.SimulationError as e:
        return [f"stops at {e.time:.3g} s", None, None, None]
    spent = thread_time() - began
    g, rate = arm.loop_motion(run.q, run.v)
    return [float(off(run)), float(np.abs(g).max()), float(np.abs(rate).max()), spent]


def scaled(options: dict[str, Any], by: float) -> dict[str, Any]:
    return options | {k: v * by for k, v in options.items() if k == "step"}


def rigid() -> dict[str, list[tuple[str, list[Any]]]]:
    found: dict[str, list[tuple[str, list[Any]]]] = {}

    def all_runs(name: str, *args: Any, by: float = 1.0, **more: Any) -> None:
        found[name] = [(run, measured(*args, scaled(options, by), **more)) for run, options in RUNS]

    arm, tau = arms.squeezer(), np.zeros(7)
    tau[0] = ANDREWS.torque
    q = arm.assemble(ANDREWS.start[arms.SQUEEZER_ORDER])
    ends = ANDREWS.q_end[arms.SQUEEZER_ORDER]
    all_runs("squeezer", arm, np.linspace(0, ANDREWS.end, 4), q, None, lambda r: np.abs(r.q[-1] - ends).max(), by=0.01,
             tau=tau)  # fmt: skip
    arm = arms.four_bar()
    t = np.linspace(0, 1, 11)
    y = FOURBAR.run(0.5, 3.0, t)
    q, v = arm.assemble([y[0, 0], y[0, 1] - y[0, 0], y[0, 2]], [3.0, 0, 0], hold=[0])
    all_runs("four bars", arm, t, q, v, lambda r: np.abs(r.q[:, 0] - y[:, 0]).max())
    arm, up, t10 = arms.double_four_bar(), np.array([1, -1, 1, -1, 1]), np.linspace(0, 10, 101)
    angle, _ = double_four_bar(t10)
    all_runs("double four-bar", arm, t10, np.pi / 2 * up, -1.0 * up,
             lambda r: np.abs(np.pi / 2 - r.q[:, 0] - angle).max())  # fmt: skip
    arm = arms.bricard_arm()
    whole, start = bricard_truth()
    t2 = np.linspace(0, 2, 5)
    own = np.array([bricard_angles(m)[0][:5] for m in whole.run(start, t2)])
    all_runs("Bricard", arm, t2, None, None, lambda r: np.abs(r.q - own).max())
    arm, tau = arms.delta_arm()
    robot, at = delta_truth()
    t3 = np.linspace(0, 0.2, 5)
    plate = np.array([m.p[9] for m in robot.run(at, t3)])
    all_runs("Delta", arm, t3, None, None, lambda r: np.abs(r.frame("body9")[0] - plate).max(), tau=tau)
    return found


def kept() -> list[tuple[str, str, float, float, float]]:
    """Of 10 s: mechanism, run, g, dg/dt, and by how much energy changes of its largest kinetic part."""
    rows = []
    for name, arm, q, v in (("four bars", arms.four_bar(), None, None), ("Bricard", arms.bricard_arm(), None, None)):
        if name == "four bars":
            q = arm.assemble([0.5, 0.2, 1.5], hold=[0])
        for run, options in RUNS:
            r = fa.simulate(arm, np.linspace(0, 10, 101), q, v, **options)
            g, rate = arm.loop_motion(r.q, r.v)
            kinetic, total = np.asarray(r.energy()[0]), np.asarray(sum(r.energy()))
            rows.append((name, run, float(np.abs(g).max()), float(np.abs(rate).max()),
                         float(np.ptp(total) / kinetic.max())))  # fmt: skip
    return rows


def orders() -> list[tuple[str, list[tuple[float, float]], float]]:
    """Of four bars, 1 s: integrator, steps (s) and the crank off by (rad), the order from the two finest."""
    arm, t = arms.four_bar(), np.linspace(0, 1, 11)
    y = FOURBAR.run(0.5, 3.0, t)
    q, v = arm.assemble([y[0, 0], y[0, 1] - y[0, 0], y[0, 2]], [3.0, 0, 0], hold=[0])
    rows = []
    for name, steps in (("implicit", (8e-3, 4e-3, 2e-3, 1e-3)), ("gauss", (0.1, 0.05, 0.025, 0.0125)),
                        ("rk4", (8e-3, 4e-3, 2e-3, 1e-3))):  # fmt: skip
        off = [(h, float(np.abs(fa.simulate(arm, t, q, v, integrator=name, step=h).q[:, 0] - y[:, 0]).max()))
               for h in steps]  # fmt: skip
        rows.append((name, off, float(np.log2(off[1][1] / off[2][1]))))
    return rows


# -- flexible ----------------------------------------------------------------------------------------------------------


def peer(name: str, folder: Path) -> dict[str, Any]:
    """Exudyn's answer; from a file of an earlier run, if there is one."""
    kept_in = folder / f"{name}.json"
    if not kept_in.exists():
        worker = Path(__file__).with_name("loops_exudyn.py")
        out = subprocess.run([sys.executable, str(worker), name], check=True, capture_output=True, text=True).stdout
        folder.mkdir(parents=True, exist_ok=True)
        kept_in.write_text(out, encoding="utf-8")
    return dict(json.loads(kept_in.read_text(encoding="utf-8")))


def beams(folder: Path) -> dict[str, Any]:
    """Of the four-bar and the slider crank: the peer, and flexarm's runs: shapes, run, off by (of the span), time."""
    found: dict[str, Any] = {}
    for name, case in (("fourbar", FLEXIBLE_FOURBAR), ("slider", SLIDER), ("held", HELD)):
        other = peer(name, folder)
        truth, t = np.array(other["truth"]), np.linspace(0, case.end, OUTPUTS + 1)
        rows = []
        for shapes, fine in (((2, 3, 3), 1), ((3, 5, 4), 1), ((4, 5, 5), 2)):
            if isinstance(case, Held):
                arm, watched, long, drive = arms.held(case, shapes, fine), "bar", case.bar, arms.held_drives(case)
                q = arms.held_start(arm, case)
            else:
                arm, watched, long, drive = arms.planar(case, shapes, fine), "coupler", case.coupler, arms.drives(case)
                q = arms.start(arm, case)
            for run, options in (*steps_of("gauss", 10, 5), *steps_of("implicit", 1, 0.1), RUNS[-1]):
                results: list[fa.Result] = []

                def job(arm: Any = arm, q: Any = q, drive: Any = drive, options: Any = options,
                        t: Any = t, results: Any = results) -> None:  # fmt: skip
                    results.append(fa.simulate(arm, t, q, drive=drive, **options))

                spent = least(job, 3)
                r = results[-1]
                places = np.hstack([r.frame(watched, long / 2)[0][:, :2], r.frame(watched)[0][:, :2]])
                off = float(np.abs(places - truth).max() / case.span)
                rows.append((shapes if case.base is not None else shapes[:2], fine, run, off, spent))
                found[name, "run"] = r
        at = [x for x in other["runs"] if x["error"] <= 1e-6]
        found[name] = {"peer": min(x["seconds"] for x in at), "doubt": max(other["by elements"][-1] / 15,
                       other["by steps"]), "rows": rows, "runs": other["runs"]}  # fmt: skip
    return found


def out_of_plane(folder: Path) -> dict[str, Any]:
    other = peer("misaligned", folder)
    truth, t = np.array(other["truth"]), np.linspace(0, MISALIGNED.end, OUTPUTS + 1)
    found: dict[str, Any] = {"doubt": other["by steps"], "t": t, "truth": truth, "rows": []}
    finest = None
    for bending, rest, options in ((4, 2, {"integrator": "gauss", "step": 0.01}),
                                   (3, 2, {"integrator": "implicit", "step": 0.005}),
                                   (2, 1, {"integrator": "implicit", "step": 0.005})):  # fmt: skip
        arm = arms.misaligned(bending, rest)
        results: list[fa.Result] = []

        def job(arm: fa.Arm = arm, options: Any = options, results: Any = results) -> None:
            results.append(fa.simulate(arm, t, drive=arms.misaligned_drive(), **options))

        spent = least(job, 1)
        r = results[-1]
        c = r.frame("coupler")[0]
        finest = c if finest is None else finest
        g, _ = arm.loop_motion(r.q, r.v)
        found["rows"].append((arm.nv, options, float(np.abs(c - finest).max()), float(np.abs(c - truth[:, :3]).max()),
                              float(np.abs(g).max()), spent))  # fmt: skip
        if "drawn t" not in found:
            found["drawn t"] = np.linspace(0, MISALIGNED.end, 2401)
            r = fa.simulate(arm, found["drawn t"], drive=arms.misaligned_drive(), **options)
            found |= {"c": r.frame("coupler")[0], "force": r.loop("C").force, "torque": r.tau[:, 0]}
    return found


def test_set() -> dict[str, float]:
    """The IVP test set's slider crank, from a straight rod, for 10 ms: how far the linear rod is from the curved one,
    and flexarm from both: the rod's middle, across the chord (m), and the block (m)."""
    t, shapes = np.linspace(0, 0.01, 11), (4, 6)
    zero = np.zeros(sum(shapes))
    answers = {}
    for curved in (False, True):
        of = Rod(*shapes, curved=curved, damping=2e-7)
        q, _ = of.run(t, zero, zero, 1e-8, "Radau")
        middle = q[:, : shapes[0]] @ np.sin(np.pi * np.arange(1, shapes[0] + 1) / 2)
        answers[curved] = middle, of.ends(t, q)[1]
    arm = arms.rod_crank(of, 7, 4)
    q0 = arm.assemble(arm.pose({"block": of.crank + of.length}), hold=["crank"])
    v0 = np.zeros(arm.nv)
    v0[:2] = of.speed, -of.speed * (1 + of.crank / of.length)  # the rod straight, and no rate of its shapes
    turn = fa.Motion([0, t[-1]], [0, of.speed * t[-1]], [of.speed] * 2, [0, 0])
    r = fa.simulate(arm, t, q0, v0, drive={"crank": turn}, integrator="gauss", step=2e-5)
    ends = [r.frame("rod", x)[0][:, :2] for x in (of.length / 2, of.length)]
    pin = of.crank * np.column_stack([np.cos(r.q[:, 0]), np.sin(r.q[:, 0])])
    way = ends[1] - pin
    way /= np.linalg.norm(way, axis=1)[:, None]
    at = ends[0] - pin
    middle = way[:, 0] * at[:, 1] - way[:, 1] * at[:, 0]
    found = {"bends by": float(np.abs(answers[True][0]).max())}
    for name, curved in (("linear", False), ("curved", True)):
        found[f"{name} middle"] = float(np.abs(middle - answers[curved][0]).max())
        found[f"{name} block"] = float(np.abs(ends[1][:, 0] - answers[curved][1]).max())
    found["apart middle"], found["apart block"] = (
        float(np.abs(a - b).max()) for a, b in zip(*answers.values(), strict=True))  # fmt: skip
    return found


# -- speed -------------------------------------------------------------------------------------------------------------


def per_step(arm: fa.Arm, q: Array, step: float = 1e-3) -> float:
    """Of an implicit step (s): of a long run less a short one."""
    def run(end: float) -> float:
        return least(lambda: fa.simulate(arm, [0, end], q, integrator="implicit", step=step), 7)

    return (run(2000 * step) - run(200 * step)) / 1800


def rings() -> list[tuple[int, Array]]:
    """Bars; forward dynamics and a step of the ring, and of the chain that it is without its loop (s)."""
    rows = []
    for bars in (4, 8, 16, 32, 64, 128):
        arm, q = arms.closed_ring(bars)
        chain = fa.Arm(arm.links, arm.gravity)
        many = 200
        at, none = np.tile(q, (many, 1)), np.zeros((many, arm.nv))
        times = [least(lambda a=a, x=at, z=none: a.forward_dynamics(x, z, z), 30) / many for a in (arm, chain)]
        rows.append((bars, np.array([*times, *(per_step(a, q) for a in (arm, chain))])))
    return rows


def speed() -> dict[str, Any]:
    found: dict[str, Any] = {}
    five = arms.five_bar()
    q = five.pose({"left crank": 2.0, "left coupler": -1.0, "right crank": 1.1, "right coupler": 1.0})
    q = five.assemble(q, hold=["left crank", "right crank"])
    found["five"] = [per_step(a, q) for a in (five, fa.Arm(five.links, five.gravity))]
    found["five nv"] = five.nv
    found["rings"] = rings()
    return found


# -- tables and pictures -----------------------------------------------------------------------------------------------


def tables(found: dict[str, Any]) -> dict[str, str]:
    made: dict[str, str] = {}

    def table(name: str, heads: list[str], rows: list[list[str]], note: str = "") -> None:
        lines = ["| " + " | ".join(heads) + " |", "|-" * len(heads) + "|"]
        made[name] = "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows] + (["", note] if note else []))

    def cell(x: Any) -> str:
        return "" if x is None else x if isinstance(x, str) else f"{x:.0e}"

    if "rigid" in found:
        units = {"squeezer": "rad", "four bars": "rad", "double four-bar": "rad", "Bricard": "rad", "Delta": "m"}
        names = [name for name, _ in RUNS]
        rows = [[f"{name} ({units[name]})", *(cell(x[0]) for _, x in runs)] for name, runs in found["rigid"].items()]
        table("rigid", ["off by", *names], rows)
        table("kept", ["10 s", "run", "g (m)", "dg/dt (m/s)", "energy changes by, of the largest kinetic"],
              [[name, run, *map(cell, numbers)] for name, run, *numbers in found["kept"]])  # fmt: skip
        rows = [[name, *(f"{1e3 * h:g} ms: {e:.0e}" for h, e in off), f"{order:.1f}"]
                for name, off, order in found["orders"]]  # fmt: skip
        table("orders", ["four bars, 1 s", "", "", "", "", "order"], rows)
    if "beams" in found:
        rows, notes = [], []
        for name, title in TITLES.items():
            x = found["beams"][name]
            rows += [[title, f"{'+'.join(map(str, shapes))} of bending, {fine} of shear and stretch", run, cell(off),
                      f"{s:.2g}", f"{x['peer'] / s:.0f}" if off < 1e-6 else ""]
                     for shapes, fine, run, off, s in x["rows"]]  # fmt: skip
            notes.append(f"{title} {x['peer']:.2g} s ({x['doubt']:.0e})")
        table("beams", ["", "shapes of each beam", "run", "off by, of the span", "CPU time (s)",
                        "Exudyn's time for 1e-6, over that"], rows,
              "Exudyn's time for 1e-6, and how sure its extrapolated answer is: " + ", ".join(notes) + ".")  # fmt: skip
    if "misaligned" in found:
        x = found["misaligned"]
        rows = [[str(nv), f"{o['integrator']}, {1e3 * o['step']:g} ms", cell(own), cell(off), cell(g), f"{s:.2g}"]
                for nv, o, own, off, g, s in x["rows"]]  # fmt: skip
        heads = ["coordinates", "run of 12 s", "C from the first row (m)", "from Exudyn (m)", "g (m)", "CPU time (s)"]
        table("misaligned", heads, rows,
              f"C leaves the plane by up to {1e3 * np.abs(x['c'][:, 2]).max():.1f} mm. Exudyn's own runs in steps of 5 "
              f"and 2.5 ms are {x['doubt']:.0e} m apart.")  # fmt: skip
    if "test set" in found:
        x = found["test set"]
        table("testset", ["slider crank at 150 rad/s, 10 ms", "the rod's middle (m)", "the block (m)"],
              [["flexarm from the curved rod", cell(x["curved middle"]), cell(x["curved block"])],
               ["flexarm from the linear rod", cell(x["linear middle"]), cell(x["linear block"])],
               ["the two rods from one another", cell(x["apart middle"]), cell(x["apart block"])]],
              f"The rod bends by up to {1e3 * x['bends by']:.2g} mm.")  # fmt: skip
    if "pinocchio" in found:
        made["pinocchio"] = loops_pinocchio.table(*found["pinocchio"])
    if "speed" in found:
        x = found["speed"]
        us = 1e6
        made["speed"] = (f"An implicit step of the five-bar of beams ({x['five nv']} coordinates) takes "
                         f"{us * x['five'][0]:.2g} µs, and {us * x['five'][1]:.2g} µs without its loop.")  # fmt: skip
        table("rings", ["bars of the ring", *(str(n) for n, _ in x["rings"])],
              [["forward dynamics (µs)", *(f"{us * s[0]:.3g}" for _, s in x["rings"])],
               ["of the open chain", *(f"{us * s[1]:.3g}" for _, s in x["rings"])],
               ["implicit step (µs)", *(f"{us * s[2]:.3g}" for _, s in x["rings"])],
               ["of the open chain", *(f"{us * s[3]:.3g}" for _, s in x["rings"])]])  # fmt: skip
    return made


def draw(path: Path, found: dict[str, Any]) -> None:
    figure, axes = plt.subplots(2, 2, figsize=(11.0, 8.0), layout="constrained")
    ax = axes[0, 0]
    arm, up = arms.double_four_bar(), np.array([1, -1, 1, -1, 1])
    t = np.linspace(0, 10, 401)
    angle, _ = double_four_bar(t)
    for name, options, colour in (("rk4, 1 ms", RUNS[3][1], GREEN), ("gauss, 10 ms", RUNS[1][1], ORANGE),
                                  ("implicit, 1 ms", RUNS[0][1], BLUE)):  # fmt: skip
        r = fa.simulate(arm, t, np.pi / 2 * up, -1.0 * up, **options)
        off = np.abs(np.pi / 2 - r.q[:, 0] - angle)
        ax.semilogy(t, np.maximum(off, 1e-15), color=colour, lw=0.9, label=name)
    for k in range(10):
        line = np.interp(np.pi * (k + 0.5), angle, t, right=np.nan)
        ax.axvline(line, color=GREY, lw=0.6, ls=":")
    ax.set(xlabel="time (s)", ylabel="cranks off by (rad)", xlim=(0, 10), ylim=(1e-14, 1e-2),
           title="(a) double four-bar; dotted: all bars in one line")  # fmt: skip
    ax.legend(frameon=False, loc="lower right", ncols=3)
    ax = axes[0, 1]
    case, r = FLEXIBLE_FOURBAR, found["beams"]["fourbar", "run"]
    s = np.linspace(0, 1, 40)
    for k, colour in ((0, GREY), (20, BLUE), (34, GREEN), (48, ORANGE)):
        for name, length in (("crank", case.crank), ("coupler", case.coupler), ("last", case.rocker)):
            p = np.array([r.arm.frame(r.q[k], name, x)[0][:2] for x in s * length])
            ax.plot(*p.T, color=colour, lw=1.8, label=f"{r.t[k]:.2f} s" if name == "crank" else None)
            ax.plot(*p[[0, -1]].T, "o", color=colour, ms=3.5)
    ax.set(xlabel="x (m)", ylabel="y (m)", aspect="equal", title="(b) four-bar of beams", xlim=(-0.25, 0.85))
    ax.legend(frameon=False, loc="upper right")
    ax = axes[1, 0]
    for name, colour in (("fourbar", BLUE), ("slider", GREEN)):
        x, title = found["beams"][name], TITLES[name]
        for kind, marker in (("gauss", "o"), ("implicit", "s")):
            rows = [row for row in x["rows"] if row[2].startswith(kind)]
            ax.loglog([row[4] for row in rows], [row[3] for row in rows], marker, color=colour, ms=5,
                      label=f"{title}, flexarm {kind}")  # fmt: skip
        ax.loglog([y["seconds"] for y in x["runs"]], [y["error"] for y in x["runs"]], "x", color=colour, ms=5,
                  alpha=0.6, label=f"{title}, Exudyn")  # fmt: skip
    ax.axhline(1e-6, color=GREY, lw=0.7, ls="--")
    ax.set(xlabel="CPU time (s)", ylabel="off by, of the span", title="(c) runs of 1 s", xlim=(0.01, 300))
    ax.legend(frameon=False, fontsize=8, loc="upper right")
    ax = axes[1, 1]
    n = np.array([k for k, _ in found["speed"]["rings"]])
    times = 1e6 * np.array([s for _, s in found["speed"]["rings"]])
    lines = (("forward dynamics, ring", BLUE, "-"), ("open chain", BLUE, "--"), ("implicit step, ring", ORANGE, "-"),
             ("open chain", ORANGE, "--"))  # fmt: skip
    for k, (label, colour, dash) in enumerate(lines):
        ax.loglog(n, times[:, k], "o" + dash, color=colour, lw=1.1, ms=4, label=label)
    ax.loglog(n, times[-1, 0] * n / n[-1] * 0.3, color=GREY, lw=0.8, ls=":", label="proportional")
    ax.set(xlabel="bars", ylabel="µs", title="(d) a closed ring of rigid bars")
    ax.legend(frameon=False, fontsize=8.5)
    finish(figure, path)


def draw_misaligned(path: Path, x: dict[str, Any]) -> None:
    figure, axes = plt.subplots(1, 3, figsize=(11.0, 3.6), layout="constrained")
    t = x["drawn t"]
    axes[0].plot(x["t"], 1e3 * x["truth"][:, 2], color=BLUE, lw=2.8, alpha=0.35, label="Exudyn")
    axes[0].plot(t, 1e3 * x["c"][:, 2], color=BLUE, lw=0.9, label="flexarm")
    axes[0].set(xlabel="time (s)", ylabel="mm", title="C, out of the plane")
    axes[0].legend(frameon=False)
    for k, colour, name in ((0, BLUE, "x"), (1, ORANGE, "y"), (2, GREEN, "z")):
        axes[1].plot(t, x["force"][:, k], color=colour, lw=0.9, label=name)
    axes[1].set(xlabel="time (s)", ylabel="N", title="force of the hinge at C")
    axes[1].legend(frameon=False)
    axes[2].plot(t, x["torque"], color=BLUE, lw=0.9)
    axes[2].set(xlabel="time (s)", ylabel="N m", title="torque that turns the crank")
    finish(figure, path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--docs", action="store_true", help="write the tables and the pictures of docs/loops.md")
    parser.add_argument("--peers", type=Path, default=ROOT / "build" / "bench" / "loops", help="Exudyn's answers")
    parser.add_argument("--only", default="rigid,beams,misaligned,test set,speed,pinocchio")
    parser.add_argument("--flags", default="portable,native", help="of the builds of flexarm and Pinocchio")
    args = parser.parse_args()
    wanted = args.only.split(",")
    found: dict[str, Any] = {}
    if "rigid" in wanted:
        found |= {"rigid": rigid(), "kept": kept(), "orders": orders()}
    if "beams" in wanted:
        found["beams"] = beams(args.peers)
    if "misaligned" in wanted:
        found["misaligned"] = out_of_plane(args.peers)
    if "test set" in wanted:
        found["test set"] = test_set()
    if "speed" in wanted:
        found["speed"] = speed()
    if "pinocchio" in wanted:
        found["pinocchio"] = loops_pinocchio.measure(args.flags.split(","))
    made = tables(found)
    print("\n\n".join(f"{name}\n{x}" for name, x in made.items()))
    if args.docs:
        if {"beams", "speed"} <= found.keys():
            draw(ROOT / "docs" / "figures" / "loops.png", found)
        if "misaligned" in found:
            draw_misaligned(ROOT / "docs" / "figures" / "loops-misaligned.png", found["misaligned"])
        for name, table in made.items():
            replace_table(ROOT / "docs" / "loops.md", name, table)


if __name__ == "__main__":
    main()
