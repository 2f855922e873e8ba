"""Struts and tendons beside independent solutions (bench/run/struts_truth.py), and what they cost.

    python bench/run/struts.py [--docs]

- A boom of two sections and two cylinders: rigid, beside the equations of a double pendulum; of beams that bend, by its
  energy and beside its own run with short steps.
- The same with cylinders of 1e8 N/m and steps of 1 ms, as close to rigid as a cylinder is.
- The boom again, whose cylinders have rods: struts with a mass, which are links of the arm.
- A bar that sags, and a stay: equilibrium by the number of shape functions, beside shooting.
- A bar between two stays: frequencies beside the zeros of a determinant.
- What 1, 2 and 4 struts add to an arm of seven links.
Prints the tables; with --docs writes them into docs/struts.md and the picture docs/figures/struts.png.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from time import thread_time
from typing import Any

import flexarm as fa
import matplotlib
import numpy as np
from scipy.integrate import cumulative_simpson
from struts_truth import BOOM, GRAVITY, RHO, STIFF, STRUCK, Array, Boom, E, Stayed, Stays

matplotlib.use("Agg")
import matplotlib.pyplot as plt

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from reporting import fastest, finish, replace_table

ROOT = Path(__file__).resolve().parents[2]
BLUE, ORANGE, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#666666"
STEEL = fa.Material(RHO, E, 0.3)
NAMES, OF = ("lift", "fold"), ("boom", "jib")

# -- the boom ----------------------------------------------------------------------------------------------------------


def boom(of: Boom, modes: int = 0) -> fa.Arm:
    """Rigid; or its sections beams of about the same mass, with shape functions in the plane."""

    def link(k: int) -> fa.Link:
        s = of.sections[k]
        joint = fa.Revolute("z", name=f"{OF[k]} hinge")
        if not modes:
            return fa.Link(
                joint,
                fa.RigidBody(s.mass, (s.com, 0, 0), (0, 0, s.inertia), end=(s.length, 0, 0)),
                name=OF[k],
            )
        wall = s.mass / s.length / RHO / 0.48
        beam = fa.Beam(s.length, fa.sections.Box(0.12, 0.12, wall), STEEL, {"bending_y": modes}, "legendre", order=2)
        return fa.Link(joint, beam=beam, tip=fa.RigidBody(5.0 if k else 0.0), name=OF[k])

    def point(at: tuple[int, float, float]) -> fa.Point:
        link, x, y = at
        if link < 0:
            return fa.Point("world", offset=(x, y, 0))
        if modes and x > 0:
            return fa.Point(OF[link], at=x, offset=(0, y, 0))
        return fa.Point(OF[link], at="origin", offset=(x, y, 0))

    struts = [
        fa.Strut(point(c.a), point(c.b), stiffness=c.stiffness, damping=c.damping, length=rest, name=name,
                 mass=rod or None)
        for c, rest, name, rod in zip(of.cylinders, of.rest, NAMES, of.rods, strict=True)
    ]  # fmt: skip
    return fa.Arm([link(0), link(1)], gravity=(0, -GRAVITY, 0), struts=struts)


@dataclass
class Timed:
    run: fa.Result
    seconds: float


def moved(of: Boom, arm: fa.Arm, t: Array, **options: Any) -> Timed:
    if callable(of.forces):
        drive = {name: fa.Torque(lambda t, k=k: of.forces(t)[k]) for k, name in enumerate(NAMES)}
    else:
        drive = {name: fa.Torque(of.times, f) for name, f in zip(NAMES, np.transpose(of.forces), strict=True)}
    began = thread_time()
    run = fa.simulate(arm, t, dict(zip(OF, of.start, strict=True)), drive=drive, **options)
    return Timed(run, thread_time() - began)


def end(of: Boom, y: Array) -> Array:
    """Where the jib's end is, by the angles, (nt, 2)."""
    return np.array([of.point((1, of.sections[1].length, 0.0), q)[0] for q in y[:, :2]])


def balance(of: Boom, run: fa.Result) -> Array:
    """Energy since the start, less what the cylinders' forces did and dampers took, as a part of it, (nt,)."""
    _, rate, _ = run.arm.strut_motion(run.q, run.v)
    power = (of.driven(run.t) * rate - np.array([c.damping for c in of.cylinders]) * rate**2).sum(1)
    work = np.zeros(run.t.size)
    for a, b in zip(of.times, of.times[1:], strict=False):  # forces have corners
        here = (run.t >= a - 1e-9) & (run.t <= b + 1e-9)
        done = cumulative_simpson(power[here], x=run.t[here], initial=0.0)
        work[here] = work[here][0] + done
    total = np.asarray(sum(run.energy()))
    return np.asarray(total - total[0] - work) / np.ptp(total)


RUNS: list[tuple[str, dict[str, Any]]] = [
    ("implicit, step 2 ms", {"integrator": "implicit", "step": 2e-3}),
    ("implicit, step 1 ms", {"integrator": "implicit", "step": 1e-3}),
    ("implicit, step 0.5 ms", {"integrator": "implicit", "step": 5e-4}),
    ("default", {}),
    ("gauss, step 10 ms", {"integrator": "gauss", "step": 1e-2, "rtol": 1e-14}),
    ("gauss, step 5 ms", {"integrator": "gauss", "step": 5e-3, "rtol": 1e-14}),
    ("ida", {"integrator": "ida"}),
    ("ida, rtol 1e-10", {"integrator": "ida", "rtol": 1e-10, "atol": 1e-12}),
]


def rods() -> list[tuple[str, float, float, float]]:
    """Of each integrator, with rods: the error of the jib's end (m) and CPU time; and that of lines without mass."""
    t = np.linspace(0.0, BOOM.times[-1], 401)
    heavy = replace(BOOM, rods=(12.0, 6.0))
    places, arms = end(heavy, heavy.run(t)), (boom(heavy), boom(BOOM))
    rows = []
    for name, options in RUNS:
        ours, lines = moved(heavy, arms[0], t, **options), moved(BOOM, arms[1], t, **options)
        rows.append((name, np.abs(end(heavy, ours.run.q) - places).max(), ours.seconds, lines.seconds))
    return rows


def booms() -> tuple[list[tuple[str, float, float, float, float, float]], Array]:
    """Of each integrator: rigid, the error of the jib's end (m) and CPU time; of beams, likewise, and what its energy
    misses. And the angles of the own solution."""
    t = np.linspace(0.0, BOOM.times[-1], 401)
    own = BOOM.run(t)
    places = end(BOOM, own)
    rigid, bends = boom(BOOM), boom(BOOM, 3)
    fine_t = np.linspace(0.0, BOOM.times[-1], 64001)
    fine = moved(BOOM, bends, fine_t, integrator="gauss", step=6.25e-5, rtol=1e-14).run
    kept = np.abs(balance(BOOM, fine)).max()
    fine_places = fine.frame()[0][:: (fine_t.size - 1) // (t.size - 1)]
    rows = []
    for name, options in RUNS:
        one, two = moved(BOOM, rigid, t, **options), moved(BOOM, bends, t, **options)
        off = np.abs(end(BOOM, one.run.q) - places).max()
        off_beams = np.abs(two.run.frame()[0] - fine_places).max()
        rows.append((name, off, one.seconds, off_beams, two.seconds, kept))
    return rows, own


STIFF_RUNS: list[tuple[str, dict[str, Any]]] = [
    ("implicit, step 1 ms", {"integrator": "implicit", "step": 1e-3}),
    ("implicit, step 1 ms, spectral radius 0.9", {"integrator": "implicit", "step": 1e-3, "spectral_radius": 0.9}),
    ("gauss, step 1 ms", {"integrator": "gauss", "step": 1e-3}),
    ("gauss, steps of its own choice", {"integrator": "gauss"}),
    ("ida", {"integrator": "ida"}),
    ("ida, rtol 1e-10", {"integrator": "ida", "rtol": 1e-10, "atol": 1e-12}),
]


def stiff() -> list[tuple[str, float, float, float]]:
    """Of each integrator: the error of the jib's end under smooth forces and under ones with corners (m), and the CPU
    time of the latter (s), which are no functions in Python."""
    t = np.linspace(0.0, 1.0, 101)
    arm = boom(STIFF)
    own = [end(of, of.run(t, 1e-11)) for of in (STIFF, STRUCK)]
    rows = []
    for name, options in STIFF_RUNS:
        found = [moved(of, arm, t, **options) for of in (STIFF, STRUCK)]
        off = [float(np.abs(end(STIFF, x.run.q) - y).max()) for x, y in zip(found, own, strict=True)]
        rows.append((name, *off, found[1].seconds))
    return rows


# -- a beam and its stays ----------------------------------------------------------------------------------------------


def bar(of: Stayed | Stays, radius: float, modes: dict[str, int], order: int | str, split: bool) -> list[fa.Link]:
    """Clamped, one beam or two that meet at the slice, each with so many shape functions. Both hold the slice."""

    def beam(length: float) -> fa.Beam:
        return fa.Beam(length, fa.Circle(radius), STEEL, modes, "legendre", order, rotary_inertia=False)

    lengths = [of.at, of.length - of.at] if split else [of.length]
    return [fa.Link(fa.Fixed(), beam=beam(x), name=name) for x, name in zip(lengths, ("bar", "outer"), strict=False)]


def stayed(of: Stayed, modes: int, split: bool) -> fa.Arm:
    links = bar(of, 0.008, {"bending_y": modes}, "exact", split)
    stay = fa.Tendon(
        [(*of.anchor, 0), fa.Point("bar", at="end" if split else of.at)], stiffness=of.stiffness, length=of.rest
    )
    return fa.Arm(links, gravity=(0, -GRAVITY, 0), struts=[stay])


def sagging(of: Stayed) -> tuple[list[tuple[int, float, float]], Array, Array]:
    """By the number of shape functions: the errors of the end's place of one beam and of two, as parts of the length;
    the own shape, and a beam's."""
    s = np.linspace(0.0, of.length, 51)
    own = of.solve(s[:-1])
    rows = []
    for n in (2, 3, 4, 6, 8, 12, 16, 24):
        off = []
        for split, each in ((False, n), (True, n // 2)):
            if split and n % 2:
                off.append(np.nan)
                continue
            arm = stayed(of, each, split)
            p = arm.frame(arm.equilibrium())[0]
            off.append(float(np.abs(p[:2] - own[:2, -1]).max() / of.length))
        rows.append((n, *off))
    arm = stayed(of, 6, False)
    q = arm.equilibrium()
    shape = np.array([arm.frame(q, "bar", x)[0][:2] for x in s[::2]])
    return rows, own, shape


def vibrating(of: Stays) -> list[tuple[str, float, list[float]]]:
    """Of each mode: in the stays' plane or across, own frequency (rad/s), errors of one beam with 6 and 12, of two with
    6 shape functions in either plane."""
    own = {across: of.frequencies(4, across) for across in (False, True)}
    found: dict[bool, list[Array]] = {False: [], True: []}
    for n, split in ((6, False), (12, False), (6, True)):
        links = bar(of, 0.01, {"bending_y": n, "bending_z": n}, 2, split)
        x, y = of.anchor
        at = fa.Point("bar", at="end" if split else of.at)
        length = of.far - of.tension / of.stiffness  # so that it is taut by the tension
        stays = [fa.Tendon([(x, side * y, 0), at], stiffness=of.stiffness, length=length) for side in (-1, 1)]
        modes = fa.Arm(links, struts=stays).modes()
        names = modes.arm.coordinates
        for across in (False, True):
            rows = [k for k, name in enumerate(names) if ("bending_z" in name) == across]
            belongs = [(modes.shapes[rows, k] ** 2).sum() > 0.5 * (modes.shapes[:, k] ** 2).sum()
                       for k in range(modes.shapes.shape[1])]  # fmt: skip
            found[across].append(np.sort(modes.frequencies[belongs])[:4])
    return [
        ("across" if across else "in", w, [float(abs(f[k] / w - 1)) for f in found[across]])
        for across in (False, True)
        for k, w in enumerate(own[across])
    ]


# -- cost --------------------------------------------------------------------------------------------------------------


def seven(modes: dict[str, int], struts: int) -> fa.Arm:
    """Seven links about z and y in turn; each strut from the middle of a link to the middle of the next."""
    beam = fa.Beam(0.5, fa.sections.Tube(0.02, 0.002), STEEL, modes, "legendre", order=2) if modes else None

    def link(k: int) -> fa.Link:
        joint = fa.Revolute("zy"[k % 2], stiffness=200.0, damping=1.0)
        tip = fa.RigidBody(0.5, (0, 0, 0) if beam else (0.25, 0, 0), (1e-3, 2e-3, 2e-3))
        return fa.Link(joint, beam=beam, tip=tip if beam else None, hub=None if beam else tip, name=f"link{k}")

    def point(k: int) -> fa.Point:
        return fa.Point(f"link{k}", at=0.25 if beam else "end", offset=(0, 0.02 + 0.01 * k, 0.03))

    held = [fa.Strut(point(k), point(k + 1), stiffness=2e4, damping=50.0) for k in range(struts)]
    return fa.Arm([link(k) for k in range(7)], gravity=(0, 0, -GRAVITY), struts=held)


def cost() -> list[tuple[str, str, Array]]:
    """Arm, what, times (s) with 0, 1, 2 and 4 struts."""
    rows = []
    for name, modes in (("rigid", {}), ("3 + 3 + 1 modes", {"bending_y": 3, "bending_z": 3, "torsion": 1})):
        arms = [seven(modes, n) for n in (0, 1, 2, 4)]
        rng = np.random.default_rng(3)
        many = 200
        q = 1e-3 * rng.normal(size=(many, arms[0].nq))
        v = 1e-3 * rng.normal(size=(many, arms[0].nv))
        none = np.zeros((many, arms[0].nv))

        def forward(arm: fa.Arm, q: Array = q, v: Array = v, none: Array = none) -> Callable[[], Any]:
            return lambda: arm.forward_dynamics(q, v, none)

        def steps(arm: fa.Arm) -> Callable[[], Any]:
            t = np.linspace(0.0, 0.2, 2)
            return lambda: fa.simulate(arm, t, integrator="implicit", step=1e-3)

        rows.append((name, "forward dynamics", fastest([forward(a) for a in arms], 400) / many))
        rows.append((name, "implicit step of 1 ms", fastest([steps(a) for a in arms], 300) / 200))
    return rows


# -- tables and picture ------------------------------------------------------------------------------------------------


def tables(found: dict[str, Any]) -> dict[str, str]:
    rows, _ = found["booms"]
    out = ["| run of 4 s | rigid: off by (m) | CPU time (ms) | beams: off by (m) | CPU time (ms) |", "|-" * 5 + "|"]
    for name, off, seconds, off_beams, seconds_beams, _kept in rows:
        out.append(f"| {name} | {off:.1e} | {1e3 * seconds:.2g} | {off_beams:.1e} | {1e3 * seconds_beams:.2g} |")
    out += ["", f"The fine run of the beams (gauss, 1/16 ms) balances its energy to {rows[0][-1]:.0e} of it."]
    made = {"boom": "\n".join(out)}
    out = ["| run of 1 s | smooth: off by (m) | corners: off by (m) | CPU time (ms) |", "|-" * 4 + "|"]
    out += [f"| {name} | {one:.1e} | {two:.1e} | {1e3 * seconds:.2g} |" for name, one, two, seconds in found["stiff"]]
    made["stiff"] = "\n".join(out)
    out = ["| run of 4 s | off by (m) | CPU time (ms) | of lines without mass (ms) |", "|-" * 4 + "|"]
    out += [f"| {name} | {off:.1e} | {1e3 * own:.2g} | {1e3 * lines:.2g} |" for name, off, own, lines in found["rods"]]
    made["rods"] = "\n".join(out)
    out = ["| shape functions in all | one beam: end off by (of the length) | two beams that meet at the stay |",
           "|-" * 3 + "|"]  # fmt: skip
    out += [f"| {n} | {one:.0e} | {'-' if np.isnan(two) else f'{two:.0e}'} |" for n, one, two in found["sagging"][0]]
    made["stay"] = "\n".join(out)
    out = ["| to the stays' plane | own (rad/s) | one beam, 6 | one beam, 12 | two beams, 6 each |", "|-" * 5 + "|"]
    for plane, w, off in found["vibrating"]:
        out.append(f"| {plane} | {w:.6f} | {' | '.join(f'{x:.0e}' for x in off)} |")
    made["frequencies"] = "\n".join(out)
    out = ["| seven links | | no strut (µs) | 1 strut | 2 struts | 4 struts |", "|-" * 6 + "|"]
    for name, what, times in found["cost"]:
        ratios = " | ".join(f"x {x:.2f}" for x in times[1:] / times[0])
        out.append(f"| {name} | {what} | {1e6 * times[0]:.3g} | {ratios} |")
    made["cost"] = "\n".join(out)
    return made


def draw(path: Path, found: dict[str, Any]) -> None:
    figure, axes = plt.subplots(2, 2, figsize=(11.0, 7.8), layout="constrained")
    rows, own = found["booms"]
    ax = axes[0, 0]
    for when, colour in ((0.0, BLUE), (1.0, ORANGE), (2.0, GREEN)):
        q = own[round(when / BOOM.times[-1] * (len(own) - 1)), :2]
        corners = [(0, 0.0, 0.0), (1, 0.0, 0.0), (1, BOOM.sections[1].length, 0.0)]
        ax.plot(*np.transpose([BOOM.point(c, q)[0] for c in corners]), "o-", color=colour, lw=3, ms=5,
                label=f"{when:g} s")  # fmt: skip
        for c in BOOM.cylinders:
            ax.plot(*np.transpose([BOOM.point(p, q)[0] for p in (c.a, c.b)]), color=colour, lw=1.6, ls=":")
        ax.plot(*np.transpose([BOOM.point(p, q)[0] for p in ((1, 0.0, 0.0), BOOM.cylinders[1].b)]), color=colour, lw=2)
    ax.set(xlabel="x (m)", ylabel="y (m)", title="(a) a boom, its jib, and their cylinders (dotted)", aspect="equal")
    ax.legend(frameon=False, loc="lower right")
    ax = axes[0, 1]
    for name, marker, colour in (("implicit", "o", BLUE), ("gauss", "s", ORANGE), ("ida", "^", GREEN),
                                 ("default", "D", GREY)):  # fmt: skip
        mine = [r for r in rows if r[0].startswith(name)]
        ax.loglog([1e3 * r[2] for r in mine], [r[1] for r in mine], marker + "-", color=colour, label=f"{name}, rigid")
        ax.loglog([1e3 * r[4] for r in mine], [r[3] for r in mine], marker + ":", color=colour, mfc="none",
                  label=f"{name}, beams")  # fmt: skip
    ax.set(xlabel="CPU time of 4 s (ms)", ylabel="the jib's end off by (m)", title="(b) the boom's runs",
           ylim=(1e-17, 1e-2))  # fmt: skip
    ax.legend(frameon=False, fontsize=8.5, ncols=2, loc="lower left")
    ax = axes[1, 0]
    counts, shape, dots = found["sagging"]
    of = Stayed()
    ax.plot(*shape[:2], color=BLUE, lw=2, label="by shooting")
    ax.plot(*dots.T, "o", color=ORANGE, ms=4.5, mfc="none", label="flexarm, 6 shape functions")
    at = of.solve([of.at])[:2, 0]
    ax.plot(*np.transpose([of.anchor, at]), color=GREY, lw=1.4, label="stay")
    ax.plot(*of.anchor, "s", color=GREY)
    ax.plot(0, 0, "s", color=BLUE)
    ax.set(xlabel="x (m)", ylabel="y (m)", title="(c) a bar that sags, and its stay", aspect="equal")
    ax.legend(frameon=False, loc="upper right")
    ax = axes[1, 1]
    n = [r[0] for r in counts]
    ax.loglog(n, [max(r[1], 1e-16) for r in counts], "o-", color=BLUE, label="one beam")
    ax.loglog([r[0] for r in counts if r[2] == r[2]], [max(r[2], 1e-16) for r in counts if r[2] == r[2]], "s-",
              color=ORANGE, label="two beams that meet at the stay")  # fmt: skip
    ax.set(xlabel="shape functions in all", ylabel="end off by (of the length)", title="(d) the bar's equilibrium",
           xticks=n, xticklabels=n)  # fmt: skip
    ax.minorticks_off()
    ax.legend(frameon=False)
    finish(figure, path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--docs", action="store_true", help="write the tables and the picture of docs/struts.md")
    args = parser.parse_args()
    found = {
        "booms": booms(),
        "stiff": stiff(),
        "rods": rods(),
        "sagging": sagging(Stayed()),
        "vibrating": vibrating(Stays()),
        "cost": cost(),
    }
    made = tables(found)
    print("\n\n".join(made.values()))
    if args.docs:
        draw(ROOT / "docs" / "figures" / "struts.png", found)
        for name, table in made.items():
            replace_table(ROOT / "docs" / "struts.md", name, table)


if __name__ == "__main__":
    main()
