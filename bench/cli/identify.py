"""What the paper does not publish of its drive, identified from what it tells of PD control (Sec. 5.3) and of Fig. 7.

    python bench/cli/identify.py [-o DIR]

Unknown: hub inertia, drive gain (torque per unit of Eq. 97's u), viscous and dry friction, size of the step. Told: rise
0.098 s, settling 0.143 s, overshoot 2.2 %, +-50 m/s^2 at the tip. Four numbers for five: the inertia is chosen, the
others are fitted for it, and three families of solutions are followed: the joint "sticks" within 1.3 to 2.4 s, or
"yields", rocked by the beam to the end, or "holds" from its first stop, which misses the marks by some 2 ms. Then: how
the marks depend on the unknowns; what a recording of joint and gauge would determine; what strain feedback costs each
solution; which set, all six numbers (the gain of strain feedback too) free together, meets the marks of PD alone and
what the paper says of strain feedback, "a small penalty"; and which masses explain Fig. 7.
Marks are those of the scene's runs ("gauss"); their derivatives are exact (`result.sensitivities`, "implicit").
Writes identify.csv, identify.txt and identify.png into DIR (default: here). Takes some five minutes.
"""

from __future__ import annotations

import csv
import sys
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import flexarm as fa
import numpy as np
from flexarm.cli.paper import control as dc
from flexarm.data.draw.style import BLUE, GREEN, INK, ORANGE, PURPLE, RED
from matplotlib.figure import Figure
from scipy.optimize import least_squares

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from reporting import finish, output_folder

PATHS = ("link.0.joint.reflected_inertia", "control.0.motor.torque_constant", "link.0.joint.damping",
         "link.0.joint.coulomb", "control.0.reference.value", "control.0.ks")  # fmt: skip
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
HEAVIEST = 0.4  #: inertia sought (kg m^2): 37 times the beam's about the joint
#: of all six together: name: (by how much PD's marks are loosened; torque of the drive, N m: 13 is four times what 20 W
#: give at 60 r/min; start)
TOGETHER = {
    "any drive": (1.0, np.inf, (0.05, 289.2, 3.05, 0.505, 0.557, 0.4)),
    "any drive, looser marks": (8.0, np.inf, (0.05, 289.2, 3.05, 0.505, 0.557, 0.4)),
    "drive up to 13 N m": (1.0, 13.0, (0.045, 128.9, 1.26, 0.735, 0.356, 0.3)),
    "drive up to 13 N m, looser marks": (8.0, 13.0, (0.045, 128.9, 1.26, 0.735, 0.356, 0.3)),
}
COMPARED = 0.95  #: about the demo's KS times its drive's gain (N m^2)
SCENE = 1  #: which of all solutions the scene has
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


def told(p: np.ndarray, band: float = dc.BAND, torque: float = 0.0) -> np.ndarray:
    """Rise (s), settling to a band (s), overshoot (%), ringing (m/s^2). torque: of strain feedback (N m per 1/m)."""
    m = dc.marks(response(p, -torque / float(p[1])), float(p[4]), band)
    return np.nan_to_num(np.array([m.rise, m.settling, m.overshoot, m.ringing]), nan=10.0)


def slopes(p: np.ndarray, torque: float = 0.0, band: float = dc.BAND, step: float = 0.001) -> np.ndarray:
    """Derivatives of `told` (of a response with strain feedback of `torque` N m per 1/m) by the logarithms of the five
    unknowns and of the torque, (4, 6): of the equations of steps of "implicit", through dry friction.

    A time t at which q passes a level L has dt = (dL - dq) / v; the largest of q or of the tip's acceleration changes
    as at its time.
    """
    inertia, gain, viscous, dry, ref = (float(x) for x in p)
    ks = -torque / gain
    law = fa.StrainFeedback(dc.KP, dc.KV, ks, x=0.0, reference=ref, motor=fa.Motor(gain))
    t = np.linspace(0.0, 4.0, 4001)
    run = fa.simulate(arm_with(inertia, viscous, dry), t, control=law, integrator="implicit", step=step)
    s = run.sensitivities(PATHS)
    scale = np.array([*p, -ks])  # of what d/d(ln value) is; ks = -torque / gain: below
    q, v = s.result.q[:, 0], s.result.v[:, 0]

    def passing(k: int, level: float) -> np.ndarray:
        """Of the time at which q passes `level` times the step, before row k."""
        part = (level * ref - q[k - 1]) / (q[k] - q[k - 1])
        dq, rate = ((1 - part) * x[..., k - 1] + part * x[..., k] for x in (s.q[:, :, 0], v))
        return np.asarray((level * (np.arange(6) == 4) - dq) / rate)

    outside = np.flatnonzero(np.abs(q / ref - 1) > band)[-1]
    settling = np.full(6, np.nan)
    if outside + 1 < len(q):
        settling = passing(outside + 1, 1 - band if q[outside] < ref else 1 + band)
    top = int(q.argmax())
    a = dc.tip_acceleration(s.result)
    at = 3000 + int(np.abs(a[3000:]).argmax())

    def tip(r: fa.Result, _: object) -> np.ndarray:
        rows = slice(at, at + 1)
        return dc.tip_acceleration(fa.Result(r.arm, r.t[rows], r.q[rows], r.v[rows], r.a[rows], r.tau[rows]))

    by = np.array([passing(int(np.argmax(q >= 0.9 * ref)), 0.9) - passing(int(np.argmax(q >= 0.1 * ref)), 0.1),
                   settling,
                   100 * (s.q[:, top, 0] - q[top] / ref * (np.arange(6) == 4)) / ref,
                   np.sign(a[at]) * s.of(tip)[:, 0]])  # fmt: skip
    by *= np.where(np.arange(6) == 5, ks, scale)
    by[:, 1] -= by[:, 5]  # more gain is less ks, for the torque given
    return by


def fit_marks(
    inertia: float, start: np.ndarray, goal: np.ndarray = TOLD, band: float = dc.BAND, most: int = 25
) -> tuple[np.ndarray, float]:
    """The five values for a chosen inertia, and the largest miss, in units of the printed rounding."""

    def values(logs: np.ndarray) -> np.ndarray:
        return np.array([inertia, *np.exp(logs)])

    def miss(logs: np.ndarray) -> np.ndarray:
        return (told(values(logs), band) - goal) / ROUNDING

    def by(logs: np.ndarray) -> np.ndarray:
        return np.nan_to_num(slopes(values(logs), band=band)[:, 1:5] / ROUNDING[:, None])

    found = least_squares(miss, np.log(start), by, x_scale=0.1, max_nfev=most)
    return values(found.x), float(np.abs(found.fun).max())


def traces(p: np.ndarray, duration: float = 1.0) -> np.ndarray:
    """Joint angle and strain of the root of a response, each millisecond, (2 nt,)."""
    r = response(p, duration=duration)
    return np.concatenate([r.q[:, 0], fa.sensors.StrainGauge(0).measure(r.arm, r.t, r.q, r.v, r.a)[:, 0]])


def fit_traces(
    record: np.ndarray, noise: tuple[float, float], start: np.ndarray, duration: float = 1.0
) -> fa.results.Fit:
    """All five values, PATHS[:5], from a recording (2 nt,) of joint and strain with noise of these standard
    deviations."""
    inertia, gain, viscous, dry, ref = (float(x) for x in start)
    law = fa.StrainFeedback(dc.KP, dc.KV, 0.0, x=0.0, reference=ref, motor=fa.Motor(gain))
    scene = fa.Scene(arm_with(inertia, viscous, dry), control=(law,), sensors=(fa.sensors.StrainGauge(0),),
                     options={"integrator": "implicit"})  # fmt: skip
    n = record.size // 2
    columns = {"joint": record[:n], "strain": record[n:]}
    data = fa.Data(np.linspace(0.0, duration, n), columns, {"joint": "rad", "strain": "1"})
    read = {"joint": lambda r: r.q[:, 0], "strain": "sensor.0"}
    sought = {path: fa.Unknown(low=0.1 * x, high=10 * x, log=True) for path, x in zip(PATHS, start, strict=False)}
    return fa.identify(scene, data, sought, outputs=read, noise=dict(zip(columns, noise, strict=True)))


def together(
    start: np.ndarray, ringing: float, slack: float, strongest: float, most: int = 12
) -> tuple[np.ndarray, dc.Marks, float]:
    """All six free, to both responses: the marks of PD alone, and the smallest penalty (overshoot and rise) of strain
    feedback that leaves no more than `ringing` at the tip (m/s^2).

    Args:
        start: the five, and the torque of strain feedback per curvature (N m^2).
        slack: by how much PD's marks are loosened: their misses count over this many roundings.
        strongest: torque of the drive (N m); PD asks for its most as the step begins, gain KP step.

    Returns:
        the six; the marks with strain feedback; PD's largest miss, in units of the rounding.
    """

    def fed(x: np.ndarray) -> dc.Marks:
        return dc.marks(response(x[:5], -x[5] / x[1]), float(x[4]))

    def miss(logs: np.ndarray) -> np.ndarray:
        x = np.exp(logs)
        m = fed(x)
        wanted = [(m.rise - dc.PAPER_RISE) / 0.02, m.overshoot / 10.0, max(m.ringing - ringing, 0.0)]
        wanted.append(max(x[1] * dc.KP * x[4] / strongest - 1, 0.0) / 0.02)
        return np.array([*(told(x[:5]) - TOLD) / (slack * ROUNDING), *np.nan_to_num(wanted, nan=50.0)])

    def by(logs: np.ndarray) -> np.ndarray:
        x = np.exp(logs)
        alone, strain = slopes(x[:5]) / (slack * ROUNDING[:, None]), slopes(x[:5], x[5])
        over = fed(x).ringing > ringing
        torque = x[1] * dc.KP * x[4] / strongest
        torque = (torque > 1) * torque / 0.02 * np.array([0, 1, 0, 0, 1, 0])
        return np.nan_to_num(np.vstack([alone, strain[0] / 0.02, strain[2] / 10.0, over * strain[3], torque]))

    bounds = np.log([[0.02, 10, 0.01, 0.02, 0.1, 0.05], [HEAVIEST, 3000, 40, 20, 1.5, 20]])
    found = least_squares(miss, np.log(start), by, bounds=bounds, x_scale=0.1, max_nfev=most, ftol=1e-3, xtol=1e-4)
    x = np.exp(found.x)
    return x, fed(x), float(np.abs((told(x[:5]) - TOLD) / ROUNDING).max())


def cost_of_damping(p: np.ndarray) -> list[tuple[float, dc.Marks]]:
    """Strain feedback with growing gain: torque per curvature (N m^2) and marks."""
    out = []
    for torque in (0.0, 0.1, 0.2, 0.35, 0.5, 0.7, COMPARED, 1.3, 1.8):
        out.append((torque, dc.marks(response(p, -torque / p[1]), float(p[4]))))
    return out


def fronts(say: Callable[[str], None]) -> dict[str, list[dc.Marks]]:
    """The least that strain feedback costs at all, by TOGETHER, for what is left of the ringing."""
    say("\nall six free together: ringing wanted; PD's largest miss in roundings; " + ", ".join(NAMES)
        + ", strain feedback (N m^2), torque (N m), power (W); then rise, settling, overshoot, ringing")  # fmt: skip
    found: dict[str, list[dc.Marks]] = {}
    for name, (slack, strongest, start) in TOGETHER.items():
        x = np.array(start)
        say(f"  {name}")
        for ringing in (25.0, 10.0, 5.0):
            x, m, miss = together(x, ringing, slack, strongest)
            found.setdefault(name, []).append(m)
            marks = (m.rise, m.settling, m.overshoot, m.ringing)
            say(f"  {ringing:4g} {miss:6.2f} " + " ".join(f"{y:9.4g}" for y in (*x, *asked(x), *marks)))
    return found


def asked(p: np.ndarray) -> tuple[float, float]:
    """What PD alone asks of the drive: the largest torque (N m) and power (W)."""
    r = response(p[:5], duration=0.5)
    torque = p[1] * (dc.KP * (p[4] - r.q[:, 0]) - dc.KV * r.v[:, 0])
    return float(np.abs(torque).max()), float((torque * r.v[:, 0]).max())


def readings(p: np.ndarray, other: np.ndarray, say: Callable[[str], None]) -> None:
    """Whether another reading of the rig makes the penalty small: strain feedback of COMPARED. `other`: the five values
    if settling is to 2 %."""
    say(f"\nother readings, {COMPARED} N m per 1/m: overshoot, ringing with strain feedback; ringing of PD alone")
    t, arm = np.linspace(0.0, 4.0, 4001), arm_with(p[0], p[2], p[3])
    damped = replace(arm.links[0], beam=replace(arm.links[0].beam, damping_ratio=0.02))

    def law(x: float, late: bool, ks: float) -> fa.Controller:
        if not late:
            return fa.StrainFeedback(dc.KP, dc.KV, ks, x=x, reference=float(p[4]), motor=fa.Motor(p[1]))
        read = ("joint", 0), ("rate", 0), ("strain", 0, 0.0, "K3")
        gains = np.array([dc.KP, dc.KV, ks])
        return fa.Sampled(lambda _, y: dc.KP * p[4] - gains @ y, 500.0, read, delay=2e-3, motor=fa.Motor(p[1]))

    for name, body, x, late in (("as it is", arm, 0.0, False), ("gauge 50 mm out", arm, 0.05, False),
                                ("sampled at 500 Hz, 2 ms late", arm, 0.0, True),
                                ("modal damping 2 %", fa.Arm([damped]), 0.0, False)):  # fmt: skip
        runs = [fa.simulate(body, t, control=law(x, late, ks), integrator="gauss", step=0.002)
                for ks in (-COMPARED / p[1], 0.0)]  # fmt: skip
        m, alone = (dc.marks(r, float(p[4])) for r in runs)
        say(f"  {name:30s} {m.overshoot:6.1f} {m.ringing:6.1f} {alone.ringing:6.1f}")
    m, alone = (dc.marks(response(other, ks), float(other[4])) for ks in (-COMPARED / other[1], 0.0))
    say(f"  {'settling to 2 %':30s} {m.overshoot:6.1f} {m.ringing:6.1f} {alone.ringing:6.1f}")


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
    J = slopes(p, step=0.0005)[:, :5] / ROUNDING[:, None]
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
    record = traces(p) + np.repeat(noise, 1001) * np.random.default_rng(5).normal(size=2002)
    say("\na recording of 1 s of joint (200000 counts a turn) and gauge (noise 5e-6), from a start 20 % off:")
    say(fit_traces(record, noise, p * [1.2, 0.85, 1.2, 0.85, 1.05]).report())


def draw(
    found: list[tuple[str, np.ndarray, float]], costs: list[list[tuple[float, dc.Marks]]],
    least: dict[str, list[dc.Marks]], path: Path,
) -> None:  # fmt: skip
    fig = Figure(figsize=(10.5, 8.0), layout="constrained")
    a, b, c, d = fig.subplots(2, 2).flat
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
    looks = ((PURPLE, "-"), (PURPLE, "--"), (BLUE, "-"), (BLUE, "--"))
    for (name, row), (colour, dash) in zip(least.items(), looks, strict=True):
        d.plot([m.overshoot for m in row], [m.ringing for m in row], dash, marker="o", ms=4, color=colour, label=name)
    d.plot(*np.array([(m.overshoot, m.ringing) for _, m in costs[SCENE]]).T, ":", color=INK, label="the demo's drive")
    d.plot(dc.PAPER_OVERSHOOT, dc.PAPER_RINGING, "x", color=RED, ms=8, mew=2, label="PD alone")
    a.axhspan(0.95, 1.05, color="#EEEEEE", zorder=0)
    a.set(xlabel="time (s)", ylabel="joint angle / step", xlim=(0, 0.6), ylim=(0, 1.1))
    b.set(xlabel="inertia chosen (kg m²)", ylabel="value / value at 0.03 kg m²", yscale="log")
    c.set(xlabel="overshoot of the joint (%)", ylabel="tip acceleration, 3 to 4 s (m/s²)", yscale="log")
    d.set(xlabel="overshoot of the joint (%)", ylabel="tip acceleration, 3 to 4 s (m/s²)", yscale="log")
    for ax, title in ((a, "a: PD alone"), (b, "b: the solutions that stick"), (c, "c: what strain feedback costs"),
                      (d, "d: the least it costs, all six numbers free")):  # fmt: skip
        ax.set_title(title, fontsize=10, loc="left")
        where = {a: "lower right", b: "upper left", c: "lower left", d: "upper right"}[ax]
        ax.legend(frameon=False, fontsize=8, loc=where)
    for ax, ticks in ((b, (0.3, 0.5, 1, 2, 4)), (c, (5, 10, 20, 50)), (d, (5, 10, 20, 50))):
        ax.set_yticks(ticks, [f"{x:g}" for x in ticks])
        ax.yaxis.minorticks_off()
    c.set_xlim(left=0)
    d.set_xlim(0, 32)
    finish(fig, path)


def main() -> None:
    out = output_folder(__doc__)
    warnings.simplefilter("ignore", fa.errors.RangeWarning)
    lines: list[str] = []

    def say(text: str) -> None:
        print(text, flush=True)
        lines.append(text)

    masses(say)
    found = families()
    costs = [cost_of_damping(p) for _, p, _ in found]
    say("\nsolutions: miss in units of rounding, then " + ", ".join(NAMES))
    say("  and rise, settling, overshoot, ringing, held;"
        f" with strain feedback of {COMPARED} N m per 1/m: overshoot, ringing")  # fmt: skip
    with (out / "identify.csv").open("w", newline="") as f:
        writer = csv.writer(f)
        marks = ["rise", "settling", "overshoot", "ringing", "held", "strain overshoot", "strain ringing"]
        writer.writerow(["kind", "miss", *NAMES, *marks])
        for (kind, p, miss), cost in zip(found, costs, strict=True):
            m = cost[0][1]
            strain = dict(cost)[COMPARED]
            row = (*p, m.rise, m.settling, m.overshoot, m.ringing, m.held, strain.overshoot, strain.ringing)
            writer.writerow([kind, f"{miss:.3g}", *(f"{x:.5g}" for x in row)])
            say(f"  {kind} {miss:6.2f} " + " ".join(f"{x:9.4g}" for x in row))
    tries = [fit_marks(p[0], p[1:], band=0.02) for kind, p, _ in found if p[0] in (0.025, 0.04, 0.05, 0.2)]
    other, miss = min(tries, key=lambda x: x[1])
    say(f"\nsettling read as 2 %, from {len(tries)} starts: the best misses by {miss:.0f} roundings:")
    say(f"  {told(other, 0.02)}, of {other}")
    determined(found[SCENE][1], say)
    readings(found[SCENE][1], other, say)
    least = fronts(say)
    (out / "identify.txt").write_text("\n".join(lines) + "\n")
    draw(found, costs, least, out / "identify.png")


if __name__ == "__main__":
    main()
