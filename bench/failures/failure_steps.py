"""Entries of the failure catalogue on fixed steps: the limit of explicit ones, drift of energy."""

from __future__ import annotations

import flexarm as fa
import numpy as np
from failure_common import Entry, Rows, entry, legend, panels
from flexarm.data.draw.style import BLUE, GREEN, INK, ORANGE, PURPLE, RED
from stability import steps

ALPHA, DAMPED, GAUSS = "implicit, radius 1", "implicit, radius 0.9", "gauss"
CHOICES: dict[str, tuple[dict, str]] = {
    ALPHA: ({"integrator": "implicit"}, BLUE),
    DAMPED: ({"integrator": "implicit", "spectral_radius": 0.9}, ORANGE),
    GAUSS: ({"integrator": "gauss"}, GREEN),
    "rk4": ({"integrator": "rk4"}, RED),
    "ida": ({}, PURPLE),
}


@entry
def explicit() -> Entry:
    """Explicit RK4 under and over its limit, implicit steps far above it."""
    fig, (left, right) = panels(
        ("phase per step  hω (rad)", "growth per step"), ("step", "amplitude of the fastest mode"), scales="oiio"
    )
    fine, wide = np.linspace(0.5, 3.1, 200), np.geomspace(0.5, 1e5, 200)
    left.plot(fine, steps.rk4_growth(fine), "-", color=INK, lw=1, label="theory")
    for radius in (0.9, 1.0):
        left.plot(wide, [_late(steps.alpha_path(radius, x, 120)) for x in wide], "-", color=INK, lw=1)
    phases = {name: np.geomspace(1, 5e4, 9) for name in (ALPHA, GAUSS, DAMPED)}
    for name, x in phases.items():
        options, colour = CHOICES[name]
        found = [_late(steps.fastest_mode(0, phase, 120, **options)) for phase in x]
        left.plot(x, found, "x" if name == GAUSS else "o", color=colour, ms=5, label=name)
    x = np.linspace(1, 3, 11)
    found = [steps.growth(steps.fastest_mode(0, phase, 20, integrator="rk4")) for phase in x]
    left.plot(x, found, "o", color=RED, ms=5, label="rk4")
    left.axvline(steps.LIMIT, color=RED, lw=0.8, ls=":")
    left.set_ylim(0.4, 1.6)
    for part, dash in ((0.99, "-"), (0.999, "--"), (1.001, "-."), (1.01, ":")):
        a = steps.fastest_mode(0, part * steps.LIMIT, 120, integrator="rk4")
        right.plot(a, dash, color=RED, lw=1.3, label=f"rk4, {part:g} of limit")
    for name, dash in ((ALPHA, "-"), (GAUSS, "--"), (DAMPED, "-")):
        options, colour = CHOICES[name]
        a = steps.fastest_mode(0, 300 * steps.LIMIT, 120, **options)
        right.plot(a, dash, color=colour, lw=1.3, label=f"{name}, 300 × limit")
    right.set_ylim(1e-5, 1e8)
    legend(left, loc="upper right")
    legend(right, fontsize=7, ncols=2, loc="upper left")
    truth, _ = steps.spin_up(0, rtol=1e-10, atol=1e-12)
    return fig, [_explicit_row(shear, truth) for shear in (0, 1, 2, 3, 6)]


def _late(amplitude: np.ndarray) -> float:
    """Growth per step over the second half: that of the long run, but for the n radius^n of a double root."""
    half = len(amplitude) // 2
    return float((amplitude[-1] / amplitude[half]) ** (1 / (len(amplitude) - 1 - half)))


def _explicit_row(shear: int, truth: np.ndarray) -> dict[str, object]:
    fastest = float(steps.clamped_link(shear).modes().frequencies.max())
    row: dict[str, object] = {"shear coordinates": shear, "fastest (rad/s)": f"{fastest:.4g}"}
    row["limit of the step (s)"] = f"{steps.LIMIT / fastest:.3g}"
    for part in (0.99, 1.01):
        found = steps.growth(steps.fastest_mode(shear, part * steps.LIMIT, 40, integrator="rk4"))
        row[f"rk4 at {part}: growth (theory {steps.rk4_growth(part * steps.LIMIT):.5f})"] = f"{found:.5f}"
    for name in (ALPHA, GAUSS):
        off = np.abs(steps.fastest_mode(shear, 300 * steps.LIMIT, 120, **CHOICES[name][0]) - 1).max()
        row[f"{_short(name)}, 300 × limit: amplitude − 1"] = f"{off:.0e}"
    for name in (ALPHA, GAUSS):
        row[f"{_short(name)}, 1 ms, fast mode excited (1e-7)"] = _loud(shear, 1e-3 * fastest, CHOICES[name][0])
    for name, h in ((ALPHA, 1e-3), (GAUSS, 25e-3)):
        tip, _ = steps.spin_up(shear, step=h, **CHOICES[name][0])
        row[f"{_short(name)}, {h * 1e3:g} ms: tip off by (m)"] = f"{np.abs(tip - truth).max():.1e}"
    return row


def _short(name: str) -> str:
    return name.split(",")[0]


def _loud(shear: int, phase: float, options: dict) -> str:
    try:
        steps.fastest_mode(shear, phase, 120, size=1e-7, **options)
    except fa.SimulationError:
        return "refused"
    return "solved"


@entry
def drift() -> Entry:
    """Energy over 1e6 periods, and over 1e5 steps of a flexible arm."""
    fig, (left, middle, right) = panels(
        ("periods", "error of the energy"), ("swings", ""), ("steps", ""), scales="oooooo"
    )
    rows: Rows = []
    # periods to run: where the energy is gone, no more
    spans = {ALPHA: (10**6, 16), DAMPED: (10**5, 16), GAUSS: (10**6, 4), "rk4": (10**4, 16), "ida": (10**4, 0)}
    for swinging, ax in ((False, left), (True, middle)):
        for name, (n, per_period) in spans.items():
            options, colour = CHOICES[name]
            n = min(n, 300_000) if swinging else n
            cycles = np.unique(np.geomspace(1, n, 300).astype(int))
            ends = np.concatenate([np.arange(1, 201), np.arange(n - 199, n + 1)])
            cycles = np.unique(np.concatenate([cycles, ends]))
            error = steps.oscillator(cycles, per_period, swinging, **options)
            few = np.unique(np.searchsorted(cycles, np.geomspace(1, n, 90).astype(int)))
            ax.plot(cycles[few], np.abs(error[few]) + 1e-16, color=colour, lw=1, label=name)
            first, last = error[cycles <= 200], error[cycles > n - 200]
            case = "pendulum, 1 rad" if swinging else "mass on a spring"
            rows.append(
                {
                    "case": case,
                    "integrator": name,
                    "run": f"{n:.0e} periods, {per_period} steps each" if per_period else f"{n:.0e} periods",
                    "at most, first 200": f"{np.abs(first).max():.0e}",
                    "last 200": f"{np.abs(last).max():.0e}",
                    "drift of the mean": f"{last.mean() - (first.mean() if swinging else 0):+.1e}",
                    "theory": _decay(name, n, per_period) if not swinging else "",
                }
            )
    arm = [(ALPHA, {}, 1e-3), (DAMPED, {}, 1e-3), (GAUSS, {"stages": 1}, 1e-3), (GAUSS, {}, 5e-3), ("rk4", {}, 1e-3)]
    arm += [("ida", {"rtol": 1e-6, "atol": 1e-9}, 1e-3), ("ida", {"rtol": 1e-9, "atol": 1e-12}, 1e-3)]
    for name, more, h in arm:
        options, colour = CHOICES[name]
        found = steps.free_arm(100_000, h, **options, **more)
        setting = ", ".join(f"{k} {v:g}" for k, v in more.items() if k != "atol")
        dashed = h != 1e-3 or more.get("rtol") == 1e-9
        few = np.unique(np.geomspace(1, len(found["at"]) - 1, 90).astype(int))
        line = "--" if dashed else "-"
        right.plot(found["at"][few], np.abs(found["error"][few]) + 1e-16, line, color=colour, lw=0.9)
        rows.append(
            {
                "case": "free flexible arm",
                "integrator": f"{name}, {setting}" if setting else name,
                "run": f"{100_000 * h:g} s, {found['steps']} steps, {found['wall']:.1f} s",
                "swing": f"{found['swing']:.1e}",
                "slope over the run": f"{found['slope']:+.1e}",
                "slope / swing": f"{found['slope'] / found['swing']:+.3f}",
            }
        )
    for ax, title in ((left, "mass on a spring"), (middle, "pendulum, 1 rad"), (right, "free flexible arm")):
        ax.set_title(title, fontsize=9)
        ax.set_ylim(1e-16, 30)
    right.set_ylim(1e-9, 1)
    right.text(0.03, 0.03, "dashed: gauss, 4 stages, 5 ms; ida, rtol 1e-9", fontsize=7, transform=right.transAxes)
    legend(middle, fontsize=7, loc="lower right")
    return fig, rows


def _decay(name: str, periods: int, per_period: int) -> str:
    """What theory says is lost of a linear oscillator's energy."""
    phase = 2 * np.pi / max(per_period, 1)
    if name in (ALPHA, GAUSS):
        return "0"
    if name == "ida":
        return "-"
    step = steps.alpha_growth(0.9, phase) if name == DAMPED else float(steps.rk4_growth(phase))
    return f"{step ** (2 * per_period * periods) - 1:+.1e}"
