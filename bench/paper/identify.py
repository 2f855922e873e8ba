"""What the paper does not publish of its drive, identified from what it tells of PD control (Sec. 5.3) and of Fig. 7.

    python bench/paper/identify.py [-o DIR]

Unknown: hub inertia, drive gain (torque per unit of Eq. 97's u), viscous and dry friction, size of the step. Told: rise
0.098 s, settling 0.143 s, overshoot 2.2 %, +-50 m/s^2 at the tip. Four numbers for five: the inertia is chosen, the
others are fitted for it, and three families of solutions are followed: the joint "sticks" within 1.3 to 2.4 s, or
"yields", rocked by the beam to the end, or "holds" from its first stop, which misses the marks by some 2 ms. Then: how
the marks depend on the unknowns; what a recording of joint and gauge would determine; what strain feedback costs each
solution; and which masses explain Fig. 7.
Writes identify.csv, identify.txt and identify.png into DIR (default: here). Takes some three minutes.
"""

from __future__ import annotations

import argparse
import csv
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import flexarm as fa
import numpy as np
from flexarm.draw.style import BLUE, GREEN, INK, ORANGE, PURPLE, RED
from flexarm.paper import control as dc
from matplotlib.figure import Figure
from scipy.optimize import least_squares

NAMES = ("inertia (kg m^2)", "gain (N m)", "viscous (N m s/rad)", "dry (N m)", "step (rad)")
TOLD = np.array([dc.PAPER_RISE, dc.PAPER_SETTLING, dc.PAPER_OVERSHOOT, dc.PAPER_RINGING])
ROUNDING = np.array([5e-4, 5e-4, 0.05, 0.5])  # half of the last digit printed; of the ringing, taken to be exact to 1 %
#: starts: inertia: (gain, viscous, dry, step); None: from the one before
STARTS: dict[str, dict[float, tuple[float, ...] | None]] = {
    "sticks": {0.025: (46.0, 0.154, 0.853, 0.347), 0.03: (62.6, 0.386, 0.817, 0.345), 0.035: None, 0.04: None,
               0.045: None, 0.05: (160.0, 1.65, 0.70, 0.37)},
    "yields": {0.025: (249.0, 2.27, 0.59, 0.56), 0.03: (275.0, 2.6, 0.522, 0.534), 0.05: (301.5, 3.17, 0.472, 0.524)},
    "holds": {0.04: (61.9, 0.247, 1.05, 0.318), 0.08: (126.0, 0.72, 2.0, 0.318), 0.2: (312.0, 1.735, 5.6, 0.319),
              0.4: (614.0, 2.78, 12.9, 0.32)},
}  # fmt: skip
COMPARED = 0.95  #: about the demo's KS times its drive's gain (N m^2)
SHOWN = (("sticks", 0.025, ORANGE), ("sticks", 0.03, BLUE), ("sticks", 0.045, GREEN), ("yields", 0.025, PURPLE),
         ("holds", 0.04, INK))  # fmt: skip


def arm_with(inertia: float, viscous: float, dry: float, base: fa.Arm | None = None) -> fa.Arm:
    """The scene's arm with these values of its joint."""
    link = (base or fa.load("ist_control").arm).links[0]
    joint = replace(link.joint, reflected_inertia=inertia, damping=viscous, coulomb=dry)
    return fa.Arm([replace(link, joint=joint)])


def response(p: np.ndarray, ks: float = 0.0, duration: float = 4.0) -> fa.Result:
    """Of the five unknowns, in the order of NAMES."""
    inertia, gain, viscous, dry, step = (float(x) for x in p)
    return dc.respond(arm_with(inertia, viscous, dry), ks, gain=gain, step=step, duration=duration)


def told(p: np.ndarray, band: float = dc.BAND) -> np.ndarray:
    """Rise (s), settling to a band (s), overshoot (%), ringing (m/s^2)."""
    m = dc.marks(response(p), float(p[4]), band)
    return np.nan_to_num(np.array([m.rise, m.settling, m.overshoot, m.ringing]), nan=10.0)


def fit_marks(
    inertia: float, start: np.ndarray, goal: np.ndarray = TOLD, band: float = dc.BAND, most: int = 25
) -> tuple[np.ndarray, float]:
    """The five values for a chosen inertia, and the largest miss, in units of the printed rounding."""

    def miss(logs: np.ndarray) -> np.ndarray:
        return (told(np.array([inertia, *np.exp(logs)]), band) - goal) / ROUNDING

    found = least_squares(miss, np.log(start), diff_step=1e-5, x_scale=0.1, max_nfev=most)
    return np.array([inertia, *np.exp(found.x)]), float(np.abs(found.fun).max())


def traces(p: np.ndarray, duration: float = 1.0) -> np.ndarray:
    """Joint angle and strain of the root of a response, each millisecond, (2 nt,)."""
    r = response(p, duration=duration)
    return np.concatenate([r.q[:, 0], fa.StrainGauge(0).measure(r.arm, r.t, r.q, r.v, r.a)[:, 0]])


def fit_traces(record: np.ndarray, noise: tuple[float, float], start: np.ndarray, duration: float = 1.0) -> np.ndarray:
    """All five values from a recording (2 nt,) of joint and strain with noise of these standard deviations."""
    scale = np.repeat(noise, record.size // 2)

    def miss(logs: np.ndarray) -> np.ndarray:
        return (traces(np.exp(logs), duration) - record) / scale

    return np.exp(least_squares(miss, np.log(start), diff_step=1e-5, x_scale=0.1, max_nfev=30).x)


def jacobian(f: Callable[[np.ndarray], np.ndarray], p: np.ndarray, h: float = 1e-4) -> np.ndarray:
    """df/d(ln p), by central differences."""
    columns = [(f(p * np.exp(h * e)) - f(p * np.exp(-h * e))) / (2 * h) for e in np.eye(p.size)]
    return np.array(columns).T


def cost_of_damping(p: np.ndarray) -> list[tuple[float, dc.Marks]]:
    """Strain feedback with growing gain: torque per curvature (N m^2) and marks."""
    out = []
    for torque in (0.0, 0.1, 0.2, 0.35, 0.5, 0.7, COMPARED, 1.3, 1.8):
        out.append((torque, dc.marks(response(p, -torque / p[1]), float(p[4]))))
    return out


def families() -> list[tuple[str, np.ndarray, float]]:
    """(kind, values, miss) of every inertia."""
    found = []
    for kind, family in STARTS.items():
        p = np.full(5, np.nan)
        for inertia, start in family.items():
            guess = np.array(start) if start else p[1:] * [inertia / p[0], inertia / p[0], 1, 1]
            p, miss = fit_marks(inertia, guess)
            found.append((kind, p, miss))
    return found


def masses(say: Callable[[str], None]) -> None:
    """Which changes of the beam bring its frequencies into the bins of Fig. 7's peaks."""
    width = dc.RATE / dc.SAMPLES
    bins = np.round(np.array(dc.PAPER_PEAKS) / width)
    say(f"Fig. 7: bins of {width:.4f} Hz: number {bins}, at {np.round(bins * width, 2)} Hz; printed {dc.PAPER_PEAKS}")
    bare = fa.load("ist").arm.modes(lock=[0]).frequencies[:3] / (2 * np.pi)
    low, high = (bins - 0.5) * width / bare, (bins + 0.5) * width / bare
    say(f"  frequencies may be these parts of the bare beam's: {np.round(low, 4)} to {np.round(high, 4)}")
    part = low.max(), high.min()
    say(f"  all alike (mass spread evenly): {part[0]:.4f} to {part[1]:.4f}: +{100 * (part[1] ** -2 - 1):.2f} to "
        f"+{100 * (part[0] ** -2 - 1):.2f} % of the beam's mass")  # fmt: skip

    def inside(f: np.ndarray) -> bool:
        return bool(np.all(np.abs(f / width - bins) < 0.5))

    link = fa.load("ist").arm.links[0]
    fine = replace(link.beam, modes={"bending_y": 6})

    def tip(m: float) -> np.ndarray:
        return fa.Arm([replace(link, beam=fine, tip=fa.RigidBody(m))]).modes(lock=[0]).frequencies[:3] / (2 * np.pi)

    def clamp(k: float) -> np.ndarray:
        arm = fa.Arm([replace(link, beam=fine, joint=fa.Revolute("z", stiffness=k), hub=None)])
        return arm.modes().frequencies[:3] / (2 * np.pi)

    def lump(m: float, x: float) -> np.ndarray:
        inner, outer = (replace(link.beam, length=n, basis="legendre", modes={"bending_y": 7}) for n in (x, 0.5 - x))
        links = [fa.Link(fa.Revolute("z"), beam=inner, tip=fa.RigidBody(m)), fa.Link(fa.Fixed(), beam=outer)]
        return fa.Arm(links).modes(lock=[0]).frequencies[:3] / (2 * np.pi)

    for name, f, values in (("a body on the tip, g", lambda g: tip(1e-3 * g), np.arange(0.5, 6, 0.05)),
                            ("a clamp that yields, N m/rad", clamp, np.arange(10.0, 100, 0.5))):  # fmt: skip
        fits = [x for x in values if inside(f(x))]
        say(f"  {name}: " + (f"{fits[0]:.2f} to {fits[-1]:.2f}" if fits else "none meets all three"))
    for x in (0.3, 0.325, 0.35, 0.375):
        fits = [m for m in np.arange(1.0, 15, 0.25) if inside(lump(1e-3 * m, x))]
        say(f"  a body at {x} m, g: " + (f"{fits[0]:.2f} to {fits[-1]:.2f}" if fits else "none meets all three"))


def determined(p: np.ndarray, say: Callable[[str], None]) -> None:
    """How well the marks, and a recording, determine the unknowns."""
    J = jacobian(told, p) / ROUNDING[:, None]
    say("\nd(mark)/d(ln value), marks in units of their rounding: " + ", ".join(NAMES))
    for name, row in zip(("rise", "settling", "overshoot", "ringing"), J, strict=True):
        say(f"  {name:10s}" + "".join(f"{x:10.1f}" for x in row))
    _, s, V = np.linalg.svd(J)
    say(f"  singular values {np.round(s, 2)}; free direction of ln values: {np.round(V[-1] / np.abs(V[-1]).max(), 3)}")
    C = np.linalg.inv(J[:, 1:].T @ J[:, 1:]) / 3  # a rounding error is uniform: variance 1/3 of half a digit squared
    say(f"  inertia given: standard deviations (%) {np.round(100 * np.sqrt(np.diag(C)), 3)} of {NAMES[1:]}")
    d = np.sqrt(np.diag(C))
    say("  correlation\n" + "\n".join("   " + "".join(f"{x:8.3f}" for x in row) for row in C / np.outer(d, d)))
    noise = (2 * np.pi / 200_000 / np.sqrt(12), 5e-6)
    T = jacobian(traces, p) / np.repeat(noise, 1001)[:, None]
    C = np.linalg.inv(T.T @ T)
    say(f"a recording of 1 s of joint (200000 counts a turn) and gauge (noise 5e-6): standard deviations (%) "
        f"{np.round(100 * np.sqrt(np.diag(C)), 4)} of all five")  # fmt: skip


def draw(found: list[tuple[str, np.ndarray, float]], costs: list[list[tuple[float, dc.Marks]]], path: Path) -> None:
    fig = Figure(figsize=(13.0, 4.2), layout="constrained")
    a, b, c = fig.subplots(1, 3)
    for kind, inertia, colour in SHOWN:
        k = next(k for k, (other, p, _) in enumerate(found) if other == kind and p[0] == inertia)
        p, label = found[k][1], f"{kind}, {inertia:g} kg m²"
        dash = {"sticks": "-", "yields": "-.", "holds": "--"}[kind]
        r = response(p, duration=0.6)
        a.plot(r.t, r.q[:, 0] / p[4], dash, color=colour, label=label, lw=1.4)
        overshoot, ringing = ([getattr(m, name) for _, m in costs[k]] for name in ("overshoot", "ringing"))
        c.plot(overshoot, ringing, dash, marker="o", ms=4, color=colour, label=label)
    family = np.array([p for kind, p, _ in found if kind == "sticks"])
    base = family[np.argmin(np.abs(family[:, 0] - 0.03))]
    for k, (name, colour) in enumerate(
        zip(("gain", "viscous", "dry", "step"), (BLUE, ORANGE, RED, GREEN), strict=True)
    ):
        b.plot(family[:, 0], family[:, k + 1] / base[k + 1], "o-", ms=4, color=colour, label=name)
    a.axhspan(0.95, 1.05, color="#EEEEEE", zorder=0)
    a.set(xlabel="time (s)", ylabel="joint angle / step", xlim=(0, 0.6), ylim=(0, 1.1))
    b.set(xlabel="inertia chosen (kg m²)", ylabel="value / value at 0.03 kg m²", yscale="log")
    c.set(xlabel="overshoot of the joint (%)", ylabel="tip acceleration, 3 to 4 s (m/s²)", yscale="log")
    for ax, title in ((a, "a: PD alone"), (b, "b: the solutions that stick"),
                      (c, "c: what strain feedback costs")):  # fmt: skip
        ax.set_title(title, fontsize=10, loc="left")
        ax.grid(alpha=0.3)
        ax.spines[["top", "right"]].set_visible(False)
        ax.legend(frameon=False, fontsize=8, loc={a: "lower right", b: "upper left", c: "lower left"}[ax])
    for ax, ticks in ((b, (0.3, 0.5, 1, 2, 4)), (c, (5, 10, 20, 50))):
        ax.set_yticks(ticks, [f"{x:g}" for x in ticks])
        ax.yaxis.minorticks_off()
    c.set_xlim(left=0)
    fig.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", type=Path, default=Path(), help="folder for the tables and the figure")
    out = parser.parse_args().o
    out.mkdir(parents=True, exist_ok=True)
    warnings.simplefilter("ignore", fa.RangeWarning)
    lines: list[str] = []

    def say(text: str) -> None:
        print(text, flush=True)
        lines.append(text)

    masses(say)
    found = families()
    costs = [cost_of_damping(p) for _, p, _ in found]
    say(
        "\nsolutions: miss in units of rounding, then "
        + ", ".join(NAMES)
        + "; rise, settling, overshoot, ringing, held;\n"
        f"  then with strain feedback of {COMPARED} N m per 1/m: overshoot, ringing"
    )
    with (out / "identify.csv").open("w", newline="") as f:
        writer = csv.writer(f)
        writer.writerow(
            [
                "kind",
                "miss",
                *NAMES,
                "rise",
                "settling",
                "overshoot",
                "ringing",
                "held",
                "strain overshoot",
                "strain ringing",
            ]
        )
        for (kind, p, miss), cost in zip(found, costs, strict=True):
            m = cost[0][1]
            marks = [m.rise, m.settling, m.overshoot, m.ringing, m.held]
            strain = dict(cost)[COMPARED]
            marks += [strain.overshoot, strain.ringing]
            writer.writerow([kind, f"{miss:.3g}", *(f"{x:.5g}" for x in (*p, *marks))])
            say(f"  {kind} {miss:6.2f} " + " ".join(f"{x:9.4g}" for x in (*p, *marks)))
    tries = [fit_marks(p[0], p[1:], band=0.02) for kind, p, _ in found if p[0] in (0.025, 0.04, 0.05, 0.2)]
    p, miss = min(tries, key=lambda x: x[1])
    say(f"\nsettling read as 2 %, from {len(tries)} starts: the best misses by {miss:.0f} roundings: {told(p, 0.02)}")
    determined(next(p for kind, p, _ in found if kind == "sticks" and p[0] == 0.03), say)
    (out / "identify.txt").write_text("\n".join(lines) + "\n")
    draw(found, costs, out / "identify.png")


if __name__ == "__main__":
    main()
