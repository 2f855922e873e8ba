"""Contacts beside independent solutions (bench/run/contacts_truth.py), and what they cost.

    python bench/run/contacts.py [--docs]

- A ball that bounces, undamped and damped, beside closed forms: by integrators and steps.
- A block on a slope: whether it creeps in 100 s, and how it slides.
- A beam that falls on a stop, beside assembled finite elements: by integrators, and by the number of shape functions.
- An arm of a rigid link and a beam whose controller presses on a wall and slides along it, beside an own model.
- What contacts add to an arm of seven links; 64 arms that hit a wall, in lanes and one by one.
Prints the tables; with --docs writes them into docs/contact.md and the pictures docs/figures/contact*.png.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from time import thread_time
from typing import Any

import flexarm as fa
import matplotlib
import numpy as np
from contacts_truth import FALLING, GRAVITY, PRESSER, RHO, Array, Block, E, elastic_fall, restitution
from contacts_truth import Law as OwnLaw
from matplotlib.patches import Rectangle

matplotlib.use("Agg")
import matplotlib.pyplot as plt

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from reporting import fastest, finish, replace_table

ROOT = Path(__file__).resolve().parents[2]
BLUE, ORANGE, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#666666"
STEEL = fa.Material(RHO, E, 0.3)


def timed(arm: fa.Arm, *args: Any, **options: Any) -> tuple[fa.Result, float]:
    began = thread_time()
    run = fa.simulate(arm, *args, **options)
    return run, thread_time() - began


# -- a ball ------------------------------------------------------------------------------------------------------------


def ball(stiffness: float, damping: float = 0.0, gravity: float = GRAVITY) -> fa.Arm:
    body = fa.Link(fa.Prismatic("z"), fa.RigidBody(1.0), name="ball")
    touch = fa.Contact("ball", fa.Plane((0, 0, 0)), stiffness=stiffness, damping=damping, name="ground")
    return fa.Arm([body], (0, 0, -gravity), contacts=[touch])


Runs = list[tuple[str, dict[str, Any]]]


def steps_of(integrator: str, *lengths: float) -> Runs:
    """Runs in steps of these lengths (ms)."""
    return [(f"{integrator}, {h:g} ms", {"integrator": integrator, "step": h / 1000}) for h in lengths]


DEFAULT: Runs = [("default", {})]
RUNS: Runs = [
    *steps_of("implicit", 1, 0.1, 0.01), *steps_of("gauss", 1, 0.1), *DEFAULT, *steps_of("rk4", 0.1),
    ("ida", {"integrator": "ida"}), ("ida, rtol 1e-9", {"integrator": "ida", "rtol": 1e-9, "atol": 1e-11}),
]  # fmt: skip


def bouncing() -> list[tuple[str, float, float, float, float]]:
    """Of 1 kg on 1e6 N/m: off by so much in 2 s (m); energy changes by (of it); the speed of release after an impact at
    1 m/s, damped, off by (m/s); CPU time (s)."""
    t, height, rows = np.linspace(0, 2, 401), 0.3, []
    own = elastic_fall(OwnLaw(1e6), 1.0, height, t)
    speed = restitution(0.5, 1.0)
    for name, options in RUNS:
        run, seconds = timed(ball(1e6), t, [height], **options)
        energy = np.asarray(sum(run.energy()))
        hit, _ = timed(ball(1e6, 0.5, 0.0), [0, 0.02], [0.005], [-1.0], **options)
        rows.append((name, float(np.abs(run.q[:, 0] - own).max()), float(np.ptp(energy) / energy[0]),
                     float(abs(hit.v[-1, 0] - speed)), seconds))  # fmt: skip
    return rows


# -- a block on a slope ------------------------------------------------------------------------------------------------


def block(angle: float, mu: float) -> fa.Arm:
    plane = fa.Plane((0, 0, 0), (np.sin(angle), 0, np.cos(angle)))
    foot = fa.Contact("block", plane, stiffness=1e6, damping=1.0, coulomb=mu, name="foot")
    link = fa.Link(fa.Axes(("tx", "ty", "tz")), fa.RigidBody(2.0), name="block")
    return fa.Arm([link], (0, 0, -GRAVITY), contacts=[foot])


def slope() -> list[tuple[str, float, float, float]]:
    """Of 2 kg at 0.3 rad, with the coefficient 1.05 tan(0.3): creeps from 10 to 100 s by (m); where it slides, with 0.5
    tan(0.3), within 1 s off by (m); CPU time of 100 s."""
    rows, t, mu = [], np.linspace(0, 1, 101), 0.5 * np.tan(0.3)
    model = Block(OwnLaw(1e6, 1.0, 1.0, mu, 1e6), angle=0.3)
    own = model.run([0.0, model.rest, 0.0, 0.0], t)[:, 0]
    down = np.array([np.cos(0.3), 0, -np.sin(0.3)])
    start = -2.0 * GRAVITY * np.cos(0.3) / 1e6 * np.array([np.sin(0.3), 0, np.cos(0.3)])
    for name, options in (RUNS[0], RUNS[1], RUNS[3], RUNS[5], RUNS[7]):
        run, seconds = timed(block(0.3, 1.05 * np.tan(0.3)), [0, 10, 20, 100], start, **options)
        slid, _ = timed(block(0.3, mu), t, start, **options)
        rows.append((name, float(np.ptp(run.q[1:] @ down)), float(np.abs(slid.q @ down - own).max()), seconds))
    return rows


# -- a beam that falls on a stop ---------------------------------------------------------------------------------------


def falling(shapes: int) -> fa.Arm:
    of = FALLING
    beam = fa.Beam(of.length, fa.Rectangle(of.thick, of.wide), STEEL, {"bending_y": shapes}, "legendre",
                   kelvin_voigt=of.retardation, rotary_inertia=False)  # fmt: skip
    link = fa.Link(fa.Fixed(), beam=beam, tip=fa.RigidBody(of.tip), name="beam")
    stop = fa.Contact("beam", fa.Plane((0, -of.below, 0), (0, 1, 0)), stiffness=of.law.stiffness,
                      damping=of.law.damping, name="stop")  # fmt: skip
    return fa.Arm([link], (0, -GRAVITY, 0), contacts=[stop])


IDA_TIGHT: Runs = [("ida, rtol 1e-8", {"integrator": "ida", "rtol": 1e-8, "atol": 1e-10})]
FALL_RUNS: Runs = [
    *steps_of("implicit", 1, 0.1, 0.01), *steps_of("gauss", 1, 0.1, 0.02), *DEFAULT, *steps_of("rk4", 0.001),
    ("ida", {"integrator": "ida"}), *IDA_TIGHT,
]  # fmt: skip


def stopped() -> tuple[list[tuple[str, float, float, float]], list[tuple[int, float, float]], dict[str, Array]]:
    """Of each integrator, 12 shape functions: end and force off by (m, N), CPU time (s); of each number of shape
    functions end and force off by within 30 ms; the own solution and a run, fine."""
    t = np.arange(0, 101) * 1e-3
    own = FALLING.fall(t)
    end, force = FALLING.end(own), own[:, -2]

    def off(run: fa.Result) -> tuple[float, float]:
        return (float(np.abs(run.frame()[0][:, 1] - end).max()),
                float(np.abs(run.contact("stop").normal - force).max()))  # fmt: skip

    rows = [(name, *off(run), seconds) for name, (run, seconds) in
            ((name, timed(falling(12), t, **options)) for name, options in FALL_RUNS)]  # fmt: skip
    fine: dict[str, Any] = {"integrator": "gauss", "step": 1e-5}
    few = t[:31]
    end, force = end[:31], force[:31]
    counts = [(n, *off(fa.simulate(falling(n), few, **fine))) for n in (1, 2, 3, 4, 6, 8, 12)]
    t = np.linspace(0, 0.1, 2001)
    own = FALLING.fall(t)
    run = fa.simulate(falling(12), t)
    drawn = {"t": t, "own end": FALLING.end(own), "own force": own[:, -2], "end": run.frame()[0][:, 1],
             "force": run.contact("stop").normal}  # fmt: skip
    return rows, counts, drawn


# -- an arm that presses and slides ------------------------------------------------------------------------------------


def presser() -> fa.Arm:
    of = PRESSER
    upper = fa.RigidBody(of.upper_mass, (of.upper / 2, 0, 0), [of.upper_inertia] * 3, (of.upper, 0, 0))
    beam = fa.Beam(of.length, fa.Rectangle(of.thick, of.wide), STEEL, {"bending_y": of.shapes}, "legendre", "exact",
                   kelvin_voigt=of.retardation, rotary_inertia=False)  # fmt: skip
    joints = [fa.Revolute("z", reflected_inertia=J, name=name)
              for J, name in zip(of.rotor, ("shoulder", "elbow"), strict=True)]  # fmt: skip
    links = [fa.Link(joints[0], upper, name="upper"),
             fa.Link(joints[1], beam=beam, tip=fa.RigidBody(of.tip), name="fore")]  # fmt: skip
    law = of.law
    finger = fa.Contact("fore", fa.Plane((of.wall, 0, 0), (-1, 0, 0)), radius=of.radius, stiffness=law.stiffness,
                        damping=law.damping, coulomb=law.coulomb, tangential_stiffness=law.tangential,
                        name="finger")  # fmt: skip
    return fa.Arm(links, contacts=[finger])


def press(t: Array, **options: Any) -> tuple[fa.Result, float]:
    """The controller is a part of the problem, the same for both."""
    sums = [0.0]

    def law(now: float, y: Array) -> Array:
        tau, sums[0] = PRESSER.control(now, y[:2], y[2:4], y[4], sums[0])
        return tau

    measure = [("joint", 0), ("joint", 1), ("rate", 0), ("rate", 1), fa.sensors.ContactForce("finger")]
    arm = presser()
    q = arm.pose(dict(zip(("shoulder", "elbow"), PRESSER.joints(), strict=True)))
    return timed(arm, t, q, control=fa.Sampled(law, PRESSER.rate, measure, ("upper", "fore")), **options)


PRESS_RUNS: Runs = [
    *steps_of("implicit", 1, 0.1, 0.01), *steps_of("gauss", 1, 0.1), *DEFAULT, *steps_of("rk4", 0.02), *IDA_TIGHT,
]  # fmt: skip


def pressing() -> tuple[list[tuple[str, float, float, float, float]], dict[str, Array]]:
    """Of each integrator: the end off by, until 0.24 s and after (m); both forces after 0.4 s off by (N); CPU time (s);
    and the solutions, fine at the impact."""
    impact = np.arange(230, 330)[:, None] * 1e-3 + np.arange(20) * 5e-5
    t = np.unique(np.round(np.concatenate([np.arange(0, 2501) * 1e-3, impact.ravel()]), 9))
    own = PRESSER.press(t)
    end, force = PRESSER.end(own), own[:, -4:-2]
    rows = []
    for name, options in PRESS_RUNS:
        run, seconds = press(t[np.isclose(np.mod(t * 1e3 + 0.5, 1.0), 0.5)], **options)
        at = np.searchsorted(t, run.t - 1e-9)
        touch = run.contact("finger")
        forces = np.column_stack([touch.normal, -touch.force[:, 1]])
        off = np.abs(run.frame()[0][:, :2] - end[at]).max(1)
        late = run.t > 0.4
        rows.append((name, float(off[run.t < 0.235].max()), float(off.max()),
                     float(np.abs(forces - force[at])[late].max()), seconds))  # fmt: skip
    drawn = {"t": t, "own end": end, "own forces": force, "own q": own[:, : PRESSER.n]}
    for name, options in (("default", {}), ("implicit", {"integrator": "implicit", "step": 1e-3})):
        run, _ = press(t if name == "default" else np.arange(0, 2501) * 1e-3, **options)
        touch = run.contact("finger")
        drawn |= {f"{name} t": run.t, f"{name} end": run.frame()[0][:, :2],
                  f"{name} forces": np.column_stack([touch.normal, -touch.force[:, 1]])}  # fmt: skip
    return rows, drawn


# -- cost, lanes -------------------------------------------------------------------------------------------------------


def seven(modes: dict[str, int], contacts: int, far: float, mu: float) -> fa.Arm:
    """Seven links about z and y in turn; a sphere at the end of the last ones against planes that are `far` away."""
    beam = fa.Beam(0.5, fa.sections.Tube(0.02, 0.002), STEEL, modes, "legendre", order=2) if modes else None

    def link(k: int) -> fa.Link:
        joint = fa.Revolute("zy"[k % 2], stiffness=200.0, damping=1.0)
        tip = fa.RigidBody(0.5, (0, 0, 0) if beam else (0.25, 0, 0), (1e-3, 2e-3, 2e-3), (0 if beam else 0.5, 0, 0))
        return fa.Link(joint, beam=beam, tip=tip if beam else None, hub=None if beam else tip, name=f"link{k}")

    touching = [
        fa.Contact(f"link{6 - k}", fa.Plane((0, 0, -0.05 - far)), radius=0.05, stiffness=1e4, damping=0.5, coulomb=mu)
        for k in range(contacts)
    ]
    return fa.Arm([link(k) for k in range(7)], gravity=(0, 0, -GRAVITY), contacts=touching)


def cost() -> list[tuple[str, str, Array]]:
    """Arm, what, times (s): no contact; one away; one that touches; one that rubs; four that rub."""
    cases = [(0, 1.0, 0.0), (1, 100.0, 0.0), (1, -1e-3, 0.0), (1, -1e-3, 0.3), (4, -1e-3, 0.3)]
    rows = []
    for name, modes in (("rigid", {}), ("3 + 3 + 1 modes", {"bending_y": 3, "bending_z": 3, "torsion": 1})):
        arms = [seven(modes, *case) for case in cases]
        rng = np.random.default_rng(3)
        many = 200
        q, v = (1e-6 * rng.normal(size=(many, arms[0].nv)) for _ in range(2))
        none = np.zeros((many, arms[0].nv))

        def forward(arm: fa.Arm, q: Array = q, v: Array = v, none: Array = none) -> Callable[[], Any]:
            return lambda: arm.forward_dynamics(q, v, none)

        def steps(arm: fa.Arm) -> Callable[[], Any]:
            t = np.linspace(0.0, 0.2, 2)
            start = arm.equilibrium()
            return lambda: fa.simulate(arm, t, start, integrator="implicit", step=1e-3)

        rows.append((name, "forward dynamics", fastest([forward(a) for a in arms], 400) / many))
        rows.append((name, "implicit step of 1 ms", fastest([steps(a) for a in arms], 100) / 200))
    return rows


def lanes() -> dict[str, float]:
    """64 arms that hit the wall with their joints free, at several speeds."""
    arm, t = presser(), np.linspace(0, 0.4, 41)
    q = np.tile(arm.pose(dict(zip(("shoulder", "elbow"), PRESSER.joints(), strict=True))), (64, 1))
    v = np.zeros((64, arm.nv))
    v[:, 1] = -np.linspace(0.5, 2.0, 64)
    options: dict[str, Any] = {"integrator": "implicit", "step": 1e-3}
    alone = [fa.simulate(arm, t, x, y, **options) for x, y in zip(q, v, strict=True)]
    batch = fa.simulate_batch(arm, t, q0=q, v0=v, **options)
    off = max(float(np.abs(batch.q[k] - run.q).max()) for k, run in enumerate(alone))
    hits = sum(bool(run.contact("finger").touching.any() or (run.contact("finger").gap < 1e-3).any()) for run in alone)
    singly, together = fastest(
        [lambda: [fa.simulate(arm, t, x, y, **options) for x, y in zip(q, v, strict=True)],
         lambda: fa.simulate_batch(arm, t, q0=q, v0=v, workers=1, **options)], 10,
    )  # fmt: skip
    bare = fa.Arm(arm.links)
    free = fastest([lambda: fa.simulate_batch(bare, t, q0=q, v0=v, workers=1, **options)], 10)[0]
    return {"off": off, "hits": hits, "singly": singly / 64, "together": together / 64, "free": free / 64}


# -- tables and pictures -----------------------------------------------------------------------------------------------


def tables(found: dict[str, Any]) -> dict[str, str]:
    made: dict[str, str] = {}

    def table(name: str, heads: list[str], rows: list[list[str]], note: str = "") -> None:
        lines = ["| " + " | ".join(heads) + " |", "|-" * len(heads) + "|"]
        made[name] = "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows] + (["", note] if note else []))

    table("ball", ["run of 2 s", "undamped: off by (m)", "energy changes by", "damped: release off by (m/s)",
                   "CPU time (ms)"],
          [[name, f"{off:.0e}", f"{energy:.0e}", f"{speed:.0e}", f"{1e3 * s:.2g}"]
           for name, off, energy, speed, s in found["bouncing"]])  # fmt: skip
    table("block", ["run", "creeps from 10 to 100 s by (m)", "slides: off by in 1 s (m)", "CPU time of 100 s (s)"],
          [[name, f"{creep:.0e}", f"{off:.0e}", f"{s:.2g}"] for name, creep, off, s in found["slope"]])  # fmt: skip
    rows, counts, drawn = found["stopped"]
    table("beam", ["run of 0.1 s", "end off by (m)", "force off by (N)", "CPU time (ms)"],
          [[name, f"{end:.0e}", f"{force:.0e}", f"{1e3 * s:.2g}"] for name, end, force, s in rows],
          f"The force is up to {drawn['own force'].max():.0f} N.")  # fmt: skip
    table("shapes", ["shape functions", *(str(n) for n, *_ in counts)],
          [["end off by (m)", *(f"{end:.0e}" for _, end, _ in counts)],
           ["force off by (N)", *(f"{force:.0e}" for *_, force in counts)]])  # fmt: skip
    rows, drawn = found["pressing"]
    table("press", ["run of 2.5 s", "end off by before the impact (m)", "at any time (m)",
                    "forces off by after 0.4 s (N)", "CPU time (ms)"],
          [[name, f"{early:.0e}", f"{end:.0e}", f"{force:.0e}", f"{1e3 * s:.2g}"]
           for name, early, end, force, s in rows])  # fmt: skip
    table("cost", ["seven links", "", "no contact (µs)", "one, away", "one, touching", "one, rubbing", "four, rubbing"],
          [[name, what, f"{1e6 * times[0]:.3g}", *(f"x {x:.2f}" for x in times[1:] / times[0])]
           for name, what, times in found["cost"]])  # fmt: skip
    x = found["lanes"]
    ms = {k: f"{1e3 * x[k]:.2g}" for k in ("singly", "together", "free")}
    made["lanes"] = (
        "Of 64 arms of the example, thrown at the wall by 0.5 to 2 rad/s of the elbow and run for 0.4 s by implicit\n"
        f"steps of 1 ms, {x['hits']:.0f} hit it. A run takes {ms['singly']} ms alone, {ms['together']} ms in lanes on "
        f"one core ({ms['free']} ms without the wall);\nthe coordinates differ by {x['off']:.0e}."
    )
    return made


def draw_press(path: Path, drawn: dict[str, Array]) -> None:
    figure, axes = plt.subplots(2, 2, figsize=(11.0, 8.0), layout="constrained")
    t, own = drawn["t"], drawn["own forces"]
    ax = axes[0, 0]
    for when, colour in ((0.0, GREY), (0.5, BLUE), (2.0, GREEN)):
        q = drawn["own q"][np.searchsorted(t, when - 1e-9)]
        p, *_ = PRESSER.places(q, np.zeros_like(q))
        elbow = PRESSER.upper * np.array([np.cos(q[0]), np.sin(q[0])])
        ax.plot(*np.transpose([[0, 0], elbow]), "o-", color=colour, lw=4, ms=6)
        ax.plot(*np.transpose([elbow, *p]), color=colour, lw=1.8, label=f"{when:g} s")
        ax.plot(*p[-1], "o", color=colour, ms=5)
    ax.add_patch(Rectangle((PRESSER.wall, -0.4), 0.05, 1.0, color="#cccccc"))
    ax.set(xlabel="x (m)", ylabel="y (m)", title="(a) the arm, its beam and the wall", aspect="equal",
           ylim=(-0.34, 0.42))  # fmt: skip
    ax.legend(frameon=False, loc="upper left")
    ax = axes[0, 1]
    labels = ("normal force", "friction")
    for k, colour in enumerate((BLUE, ORANGE)):
        ax.plot(t, own[:, k], color=colour, lw=2.6, alpha=0.35, label=f"{labels[k]}, own solution")
        ax.plot(drawn["default t"], drawn["default forces"][:, k], color=colour, lw=0.9,
                label=f"{labels[k]}, flexarm")  # fmt: skip
    ax.axhline(PRESSER.force, color=GREY, lw=0.7, ls="--")
    ax.set(xlabel="time (s)", ylabel="N", title="(b) approach, impact, 20 N; from 1.1 s on it slides", xlim=(0, 2.5),
           ylim=(-10, 40))  # fmt: skip
    ax.legend(frameon=False, fontsize=8.5, loc="upper right", ncols=2)
    ax = axes[1, 0]
    here = (t > 0.23) & (t < 0.3)
    ax.plot(1e3 * t[here], own[here, 0], color=BLUE, lw=3, alpha=0.35, label="own solution")
    ax.plot(1e3 * t[here], drawn["default forces"][here, 0], color=BLUE, lw=0.9, label="flexarm, default")
    it = drawn["implicit t"]
    late = (it > 0.23) & (it < 0.3)
    ax.plot(1e3 * it[late], drawn["implicit forces"][late, 0], ".-", color=GREEN, lw=0.6, ms=4,
            label="flexarm, implicit, 1 ms")  # fmt: skip
    ax.set(xlabel="time (ms)", ylabel="normal force (N)", title="(c) the impact rings", xlim=(230, 300))
    ax.legend(frameon=False, loc="upper right")
    ax = axes[1, 1]
    for name, colour, label in (("default", BLUE, "default"), ("implicit", GREEN, "implicit, 1 ms")):
        at = np.searchsorted(t, drawn[f"{name} t"] - 1e-9)
        off = np.abs(drawn[f"{name} end"] - drawn["own end"][at]).max(1)
        ax.semilogy(drawn[f"{name} t"], np.maximum(off, 1e-13), color=colour, lw=0.9, label=label)
    ax.set(xlabel="time (s)", ylabel="the end off by (m)", title="(d) flexarm less the own solution", xlim=(0, 2.5))
    ax.legend(frameon=False)
    finish(figure, path)


def draw(path: Path, found: dict[str, Any]) -> None:
    figure, axes = plt.subplots(2, 2, figsize=(11.0, 7.6), layout="constrained")
    ax = axes[0, 0]
    t = np.linspace(0, 1.5, 1501)
    ax.plot(t, elastic_fall(OwnLaw(1e6), 1.0, 0.3, t), color=BLUE, lw=2.6, alpha=0.35, label="closed form")
    for name, options, colour in (("default", {}, BLUE), ("implicit, 1 ms", RUNS[0][1], GREEN)):
        ax.plot(t, fa.simulate(ball(1e6), t, [0.3], **options).q[:, 0], color=colour, lw=0.9, label=name)
    ax.set(xlabel="time (s)", ylabel="height (m)", title="(a) 1 kg falls on 1e6 N/m, undamped", ylim=(-0.02, 0.37))
    ax.legend(frameon=False, loc="upper right", ncols=3)
    ax = axes[0, 1]
    speeds = np.geomspace(0.05, 20, 60)
    for damping, colour in ((0.1, BLUE), (0.5, ORANGE), (2.0, GREEN)):
        ax.semilogx(speeds, [restitution(damping, v) for v in speeds], color=colour, lw=1.2,
                    label=f"damping {damping:g} s/m")  # fmt: skip
        dots = speeds[::6]
        found_at = []
        for v in dots:
            hit = fa.simulate(ball(1e6, damping, 0.0), [0, 0.02 / v + 0.02], [0.01], [-v])
            found_at.append(hit.v[-1, 0] / v)
        ax.semilogx(dots, found_at, "o", color=colour, mfc="none", ms=5)
    ax.set(xlabel="speed of impact (m/s)", ylabel="speed of release over that",
           title="(b) restitution: closed form, flexarm (circles)", ylim=(0, 1.02))  # fmt: skip
    ax.legend(frameon=False)
    _, _, d = found["stopped"]
    for ax, name, unit, colour in ((axes[1, 0], "end", 1e3, BLUE), (axes[1, 1], "force", 1.0, ORANGE)):
        ax.plot(1e3 * d["t"], unit * d[f"own {name}"], color=colour, lw=2.8, alpha=0.35, label="finite elements")
        ax.plot(1e3 * d["t"], unit * d[name], color=colour, lw=0.9, label="flexarm")
        ax.legend(frameon=False)
    axes[1, 0].set(xlabel="time (ms)", ylabel="its end (mm)", title="(c) a beam falls on a stop 1 mm below its end")
    axes[1, 1].set(xlabel="time (ms)", ylabel="force of the stop (N)", title="(d) and bounces")
    finish(figure, path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--docs", action="store_true", help="write the tables and the pictures of docs/contact.md")
    args = parser.parse_args()
    found = {
        "bouncing": bouncing(),
        "slope": slope(),
        "stopped": stopped(),
        "pressing": pressing(),
        "cost": cost(),
        "lanes": lanes(),
    }
    made = tables(found)
    print("\n\n".join(made.values()))
    if args.docs:
        draw(ROOT / "docs" / "figures" / "contact.png", found)
        draw_press(ROOT / "docs" / "figures" / "contact-press.png", found["pressing"][1])
        for name, table in made.items():
            replace_table(ROOT / "docs" / "contact.md", name, table)


if __name__ == "__main__":
    main()
