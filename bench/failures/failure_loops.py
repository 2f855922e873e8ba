"""Entries of the failure catalogue: control loops."""

from __future__ import annotations

import warnings
from typing import Any

import flexarm as fa
import numpy as np
from failure_common import Entry, Rows, entry, legend, panels
from flexarm.data.draw.style import BLUE, GREEN, INK, ORANGE, RED
from scipy.optimize import brentq
from stability import loops

FACTORS = (0.97, 0.99, 1.01, 1.03)


def said(arm: fa.Arm, law: fa.Controller, time: float, step: float) -> str:
    """What a run is told."""
    start = np.where(np.arange(arm.nq) == 1, 1e-6, 0.0)
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        fa.simulate(arm, np.linspace(0, time, 801), start, control=law, integrator="gauss", step=step)
    return "; ".join(str(w.message) for w in heard) or "nothing"


def around(ax: Any, lost: float, theory: Any, runs: Any, unit: float = 1.0) -> float:
    """Draws growths about a limit, of poles and of runs, and finds the runs' own limit."""
    fine = lost * np.linspace(0.96, 1.04, 33)
    ax.plot(unit * fine, [theory(x) for x in fine], color=BLUE, label="fastest pole")
    found = [runs(f * lost) for f in FACTORS]
    ax.plot(unit * lost * np.array(FACTORS), found, "o", color=RED, label="runs")
    ax.axhline(0, color=INK, lw=1)
    ax.axvline(unit * lost, color=INK, lw=1, ls=":")
    legend(ax)
    return loops.critical(runs, FACTORS[0] * lost, FACTORS[-1] * lost)


@entry
def slow_sampling() -> Entry:
    """The paper's strain feedback at 500 Hz, slower and slower."""
    arm = loops.paper_arm()
    loop = fa.closed_loop(arm, loops.strain_feedback(500.0))
    growths = "growth of the fastest pole (1/s)"
    fig, (a, b) = panels(("rate (Hz)", growths), ("rate (Hz)", "growth (1/s)"), scales="oiii")
    rates = np.geomspace(60, 1000, 60)
    a.plot(rates, [fa.closed_loop(arm, loops.strain_feedback(r)).growth for r in rates], color=BLUE)
    a.axhline(0, color=INK, lw=1)
    lost = loop.limits("control.0.rate")
    found = around(b, lost.low, lambda r: fa.closed_loop(arm, loops.strain_feedback(r)).growth, loops.rate_growth)
    rows: Rows = [{"unstable below": f"{lost.low:.2f} Hz, at {lost.frequencies[0]:.1f} rad/s",
                   "of runs": f"{found:.2f} Hz", "warning of a run at 90 Hz":
                   said(arm, loops.strain_feedback(90.0), 12.0, 5e-3)}]  # fmt: skip
    return fig, rows


@entry
def late_loop() -> Entry:
    """The same at 500 Hz, its force later and later."""
    arm = loops.paper_arm()

    def growth(late: float) -> float:
        return fa.closed_loop(arm, loops.strain_feedback(500.0, late)).growth

    loop = fa.closed_loop(arm, loops.strain_feedback(500.0))
    fig, (a, b) = panels(("delay (ms)", "growth of the fastest pole (1/s)"), ("delay (ms)", "growth (1/s)"))
    delays = np.linspace(0, 8e-3, 60)
    a.plot(1e3 * delays, [growth(x) for x in delays], color=BLUE)
    a.axhline(0, color=INK, lw=1)
    late = loop.margins[0].delay
    found = around(b, late, growth, loops.delay_growth, 1e3)
    rows: Rows = [{"delay margin": f"{1e3 * late:.4f} ms", "of runs": f"{1e3 * found:.4f} ms",
                   "warning of a run with a delay of 5 ms":
                   said(arm, loops.strain_feedback(500.0, 5e-3), 12.0, 5e-3)}]  # fmt: skip
    return fig, rows


@entry
def tip_pd() -> Entry:
    """PD on the joint's angle, and on the tip's, by the joint's torque."""
    arm = loops.slender()
    fig, (a, b) = panels(("real part (1/s)", "imaginary part (rad/s)"), ("factor of the gains", "growth (1/s)"))
    rows: Rows = []
    for what, colour in (("joint", GREEN), ("tip", ORANGE)):
        loop = fa.closed_loop(arm, loops.pd_on(what))
        s = loop.locus(np.geomspace(1e-2, 3.0, 240)).poles.ravel()
        s = s[(s.imag > 0) & (s.imag < 160)]
        a.plot(s.real, s.imag, ".", ms=3, color=colour, label=f"PD on the {what}")
        lost = loop.limits()
        rows.append({"PD on": what, "unstable above, times its gains": f"{lost.high:.4f}",
                     "at (rad/s)": f"{lost.frequencies[1]:.1f}"})  # fmt: skip
    a.axvline(0, color=INK, lw=1)
    a.set(xlim=(-30, 12), ylim=(0, 160))
    a.set_title("gains times 0.01 to 3", fontsize=9)
    legend(a, loc="upper left")
    found = around(b, lost.high, lambda f: fa.closed_loop(arm, loops.pd_on("tip", f)).growth, loops.tip_growth)
    for row, what, runs in ((rows[0], "joint", ""), (rows[1], "tip", f"{found:.4f}")):
        row |= {"of runs": runs}
        row |= {"warning of a run with 1.5 times the gains": said(arm, loops.pd_on(what, 1.5), 4.0, 2e-3)}
    return fig, rows


@entry
def spillover() -> Entry:
    """LQG designed on one mode of the beam, on an arm with one and with three."""

    def growth(modes: int, weight: float) -> float:
        return fa.closed_loop(loops.slender(modes), loops.observed(weight)).growth

    label = ("weight of the design", "growth (1/s)")
    fig, (a, b) = panels(label, label, scales="oiii")
    weights = np.geomspace(1e-3, 1.0, 50)
    for modes, colour, name in ((1, GREEN, "one mode, as designed for"), (3, ORANGE, "three modes")):
        a.plot(weights, [growth(modes, w) for w in weights], color=colour, label=name)
    a.axhline(0, color=INK, lw=1)
    legend(a)
    lost = float(brentq(lambda w: growth(3, w), 1e-2, 1e-1, rtol=1e-9))
    found = around(b, lost, lambda w: growth(3, w), loops.spillover_growth)
    rows: Rows = [{"unstable above a weight of": f"{lost:.5f}", "of runs": f"{found:.5f}",
                   "the design's own growth there (1/s)": f"{growth(1, lost):.2f}",
                   "warning of a run with twice this weight":
                   said(loops.slender(), loops.observed(2 * lost), 2.0, 1e-3)}]  # fmt: skip
    return fig, rows


@entry
def windup() -> Entry:
    """PID with a limit on a rigid joint: small moves come to rest, large ones do not."""
    loop = fa.closed_loop(loops.rigid(), loops.pid(None))
    amplitude, frequency = loops.described(loop.margins[0])
    start = loops.edge()
    found = loops.between(start)
    fig, (a,) = panels(("time (s)", "joint angle (rad)"))
    for factor, colour in ((0.9, GREEN), (1.0, INK), (1.02, ORANGE)):
        r = loops.swing(factor * start, 12.0)
        a.plot(r.t, r.q[:, 0], color=colour, lw=1.2, label=f"from {factor * start:.4f} rad")
    for sign in (-1, 1):
        a.axhline(sign * amplitude, color=BLUE, lw=1, ls="--", label="describing function" if sign > 0 else None)
    a.set_ylim(-1.2, 1.7)
    legend(a, loc="upper left", ncols=2)
    m = loop.margins[0]
    rows: Rows = [{"unstable below a gain of": f"{m.gain[0]:.4f}", "limit cycle by the describing function":
                   f"{amplitude:.3f} rad, {frequency:.2f} rad/s",
                   "of a run at the limit": f"{found[0]:.3f} rad, {found[1]:.2f} rad/s",
                   "largest start that comes to rest": f"{start:.4f} rad"}]  # fmt: skip
    return fig, rows


@entry
def wrong_payload() -> Entry:
    """Inverse dynamics of an arm with another payload, with PD on what is left, and alone."""
    fig, (a, b) = panels(
        ("time (s)", "error of the joint angle (rad)"), ("payload of the model (kg)", "error at rest (rad)")
    )
    rows: Rows = []
    truth, believed = 0.5, (0.0, 0.25, 0.5, 0.75)
    errors = []
    for mass, colour in zip(believed, (ORANGE, GREEN, BLUE, RED), strict=True):
        r = loops.lift(mass, truth, 20.0, 2.0)
        s = np.clip(r.t, 0, 1)
        a.plot(r.t, r.q[:, 0] - 0.8 * (10 * s**3 - 15 * s**4 + 6 * s**5), color=colour, lw=1.2, label=f"{mass:g} kg")
        errors.append(float(r.q[-60:, 0].mean() - 0.8))
        rows.append({"payload of the model (kg), 0.5 is true": f"{mass:g}",
                     "error at rest, static balance (rad)": f"{loops.lift_error(mass, truth, 20.0):+.5f}",
                     "of the run (rad)": f"{errors[-1]:+.5f}"})  # fmt: skip
    masses = np.linspace(0, 0.75, 16)
    b.plot(masses, [loops.lift_error(m, truth, 20.0) for m in masses], color=BLUE, label="balance")
    b.plot(believed, errors, "o", color=RED, label="runs")
    legend(a, loc="lower right", title="believed")
    legend(b)
    theory, found = loops.left_alone(truth)
    rows.append({"payload of the model (kg), 0.5 is true": "0.5, torque alone", "error at rest, static balance (rad)":
                 f"none: grows at {theory:.4f} 1/s", "of the run (rad)": f"grows at {found:.4f} 1/s"})  # fmt: skip
    return fig, rows
