"""Entries of the failure catalogue on integration in time: BDF, explicit steps, drift, singularities, collapse."""

from __future__ import annotations

import numpy as np
from failure_common import Entry, Rows, entry, legend, panels
from flexarm.data.draw.style import BLUE, GREEN, INK, ORANGE, RED, SKY
from stability import balls, beams, integrators


@entry
def bdf() -> Entry:
    """BDF above order 2 on an undamped beam."""
    fig, (left, right) = panels(
        ("phase per step  hω (rad)", "largest growth per step"), ("time (s)", "modes 4 to 6 (m)"), scales="iiio"
    )
    rows: Rows = []
    colours = {1: SKY, 2: BLUE, 3: RED, 4: ORANGE, 5: GREEN}
    phase = np.linspace(0.01, 10, 1000)
    for order, colour in colours.items():
        left.plot(phase, integrators.bdf_growth(order, phase), color=colour, lw=1.4, label=f"BDF {order}")
        found = integrators.quiet_mode(order, 1.5)
        if order in (2, 3, 5):
            right.plot(found["t"][::2], found["fast"][::2], color=colour, lw=0.9, label=f"max_order {order}")
        growth, end = integrators.bdf_limits(order)
        rows.append(
            {
                "order": order,
                "growth per step": f"{growth:.4f}",
                "unstable below hω": f"{end:.3f}" if end else "never",
                "IDA, max_order: steps": found["steps"],
                "fast modes at most (m)": f"{found['fast'].max():.1e}",
                "energy drift": f"{found['drift']:.1e}",
            }
        )
    left.axhline(1, color=INK, lw=0.6)
    left.set_ylim(0.6, 1.45)
    right.set_ylim(1e-10, 1e-4)
    legend(left)
    legend(right)
    return fig, rows


@entry
def stiff_shear() -> Entry:
    """Shear coordinates of 1e7 rad/s."""
    fig, (ax,) = panels(("fastest frequency (rad/s)", "steps for 1 s"), scales="oo")
    rows: Rows = []
    counts = (0, 1, 2, 3, 6)
    found = [integrators.stiff_shear(n) for n in counts]
    x = [f["fastest"] for f in found]
    ax.plot(x, [f["rk4"] for f in found], "o--", color=RED, ms=4, label="explicit RK4: its stability limit")
    ax.plot(x, [f["steps"] for f in found], "o-", color=BLUE, ms=4, label="IDA, max_order 2, taken")
    for n, f in zip(counts, found, strict=True):
        off = np.abs(f["tip"] - found[0]["tip"]).max()
        rows.append({"shear coordinates": n, "fastest (rad/s)": f"{f['fastest']:.3g}", "IDA steps": f["steps"],
                     "computing (s)": f"{f['wall']:.2f}", "RK4 steps, at least": f"{f['rk4']:.3g}",
                     "tip moves by (m)": f"{off:.1e}"})  # fmt: skip
    legend(ax)
    return fig, rows


@entry
def quaternions() -> Entry:
    """Drift of a quaternion's length."""
    fig, (ax,) = panels(("time (s)", "length of the quaternion − 1"))
    t = np.linspace(0, 400, 101)
    naive, pulled = (balls.quaternion_length(pull, 400.0) for pull in (False, True))
    ax.plot(t, naive, color=RED, lw=1.3, label="q′ = ½ q ω, as it stands")
    ax.plot(t, pulled, color=BLUE, lw=1.3, label="with this program's pull to 1")
    legend(ax)
    run = balls.long_run(1000.0)
    how = {"length of q − 1": f"{naive[-1]:.1e}", "energy": "", "angular momentum": "", "steps": 4000}
    rows: Rows = [{"run": "RK4, step 0.1 s, 400 s, as it stands"} | how]
    rows.append({"run": "the same with the pull"} | how | {"length of q − 1": f"{pulled[-1]:.1e}"})
    rows.append({"run": "fa.simulate, rtol 1e-8, 1000 s", "length of q − 1": f"{run['length']:.0e}",
                 "energy": f"{run['energy']:.0e}", "angular momentum": f"{run['momentum']:.0e}",
                 "steps": run["steps"]})  # fmt: skip
    return fig, rows


@entry
def euler() -> Entry:
    """A ball joint where Euler angles are singular."""
    fig, (left, right) = panels(
        ("distance from the singularity (rad)", "condition of the mass matrix"),
        ("distance from the singularity (rad)", "steps for half a turn"),
        scales="oooo",
    )
    gaps = [0.3, 0.1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7]
    left.plot(gaps, [balls.euler_condition(g) for g in gaps], "o", color=RED, ms=4, label="rx ry rz")
    s = np.cos(gaps)
    left.plot(gaps, (1 + s) ** 2 / np.sin(gaps) ** 2, "-", color=INK, lw=1, label="theory (1 + sin)/(1 − sin)")
    left.axhline(1, color=BLUE, lw=1.4, label="ball")
    rows: Rows = []
    steps: dict[str, list] = {"euler": [], "ball": []}
    for gap in (*gaps, 1e-8):
        row: dict[str, object] = {"distance (rad)": f"{gap:g}"}
        for kind in steps:
            found = balls.passage(kind, gap)
            row[f"{kind}: steps"] = found["steps"]
            row[f"{kind}: error"] = f"stopped at {found['time']:.6f} s" if found["failed"] else f"{found['error']:.0e}"
            steps[kind].append(np.nan if found["failed"] else found["steps"])
        rows.append(row)
    for kind, colour in (("euler", RED), ("ball", BLUE)):
        right.plot((*gaps, 1e-8), steps[kind], "o-", color=colour, ms=4, label={"euler": "rx ry rz"}.get(kind, kind))
    right.set_ylim(30, 5000)
    legend(left)
    legend(right)
    return fig, rows


@entry
def collapse() -> Entry:
    """Solutions that run away."""
    fig, (left, right) = panels(
        ("time (s)", "angle (rad)"), ("time (s)", "elastic coordinate at 100 rad/s (m)"), scales="ioio"
    )
    torque, grown = integrators.collapse(), integrators.overflow()
    left.plot(torque["t"][1:], torque["q"][1:, 0], color=BLUE, lw=1.4)
    right.plot(grown["t"], np.abs(grown["q"][:, 1]), color=BLUE, lw=1.4)
    rate = np.sqrt(100**2 - beams.CRITICAL**2)
    theory = ("1", f"{np.arccosh(5.0 / 1e-6) / rate:.3f}")  # ten times the length
    rows: Rows = []
    for ax, found, name, end in ((left, torque, "torque 1/(1 − t)³", theory[0]),
                                 (right, grown, "order 1 at 100 rad/s", theory[1])):  # fmt: skip
        ax.axvline(float(end), color=RED, lw=1, ls="--", label="where theory has its end, or ten lengths")
        legend(ax, loc="upper left")
        row = {"case": name, "theory (s)": end, "time reached (s)": f"{found['time']:.6f}"}
        rows.append(row | {"computing (s)": f"{found['wall']:.2f}", "message": found["message"]})
    for name in ("ida", "implicit", "gauss", "rk4"):
        fixed = {} if name == "ida" else {"step": 1e-3}
        found = integrators.overflow(modes=3, integrator=name, **fixed)
        row = {"case": f"the same, 3 modes, {name}{', 1 ms' if fixed else ''}", "theory (s)": theory[1]}
        row |= {"time reached (s)": f"{found['time']:.6f}", "computing (s)": f"{found['wall']:.2f}"}
        rows.append(row | {"message": found["message"]})
    return fig, rows
