"""Entries of the failure catalogue on models and dynamics: orders, bases, chains, masses, large bending."""

from __future__ import annotations

import numpy as np
from failure_common import ORDER, Entry, Rows, entry, legend, panels
from flexarm.analysis.validity import LIMITS
from flexarm.data.draw.style import BLUE, GREEN, INK, RED
from stability import beams, chain


@entry
def softening() -> Entry:
    """Order 1 above 20.95 rad/s."""
    fig, (left, right) = panels(("hub speed (rad/s)", "growth of a deflection (1/s)"), ("time (s)", "tip / length"))
    speeds = np.array([15.0, 18, 20, 20.9, 21, 21.5, 22, 23, 24, 26, 28, 30])
    fine = np.linspace(15, 30, 601)
    left.plot(fine, np.sqrt(np.maximum(fine**2 - beams.CRITICAL**2, 0)), color=INK, lw=1, label="theory, order 1")
    rows: Rows = []
    marks = {0: "s", 1: "o", 2: "x"}
    for order in (0, 1, 2):
        found = [beams.growth_at_speed(order, w)[0] for w in speeds]
        left.plot(speeds, found, marks[order], color=ORDER[order], ms=6 - 2 * (order == 0), label=f"order {order}")
    t = np.linspace(0, 0.5, 201)
    truth, _ = beams.spin_up("exact", 20.0)
    for order in (0, 1, 2, "exact"):
        tip, turned = beams.spin_up(order, 20.0)
        right.plot(t, tip[:, 1], color=ORDER[order], lw=1.3, ls="--" if order == "exact" else "-",
                   label=order if order == "exact" else f"order {order}")  # fmt: skip
        rate, largest = beams.growth_at_speed(order, 30.0) if order != "exact" else (0.0, 0.0)
        rows.append(
            {
                "order": order,
                "growth at 30 rad/s (theory 21.474 for order 1), 1/s": f"{rate:.3f}" if order != "exact" else "-",
                "tip after 1 s, from 1e-9 m (m)": f"{largest:.2e}" if order != "exact" else "-",
                "spin-up to 20 rad/s: largest rotation (rad)": f"{turned:.3f}",
                "tip's error / length": f"{np.linalg.norm(tip - truth, axis=1).max():.4f}",
            }
        )
    right.set_title("spin-up to 20 rad/s in 0.5 s", fontsize=9)
    legend(left)
    legend(right)
    return fig, rows


@entry
def chains() -> Entry:
    """CI and AB on long and badly scaled chains."""
    fig, (left, right) = panels(
        ("links, uniform", "relative error of accelerations"), ("last link's mass (kg), 16 links", ""), scales="oooo"
    )
    rows: Rows = []
    counts, masses = (4, 8, 16, 32, 64), (1.0, 1e3, 1e6, 1e9, 1e12)
    long = [chain.errors(chain.CHAINS["uniform"](n), 3) for n in counts]
    heavy = [chain.errors([1.0] * 15 + [m]) for m in masses]
    for ax, x, found in ((left, counts, long), (right, masses, heavy)):
        for method, colour in (("ci", RED), ("ab", BLUE)):
            ax.plot(x, [f[method] for f in found], "o-", color=colour, lw=1.3, ms=4, label=method.upper())
        ax.plot(x, [f["data"] for f in found], ":", color=INK, lw=1, label="last bit of the input")
    left.set_xticks(counts, [str(n) for n in counts])
    left.minorticks_off()
    marks = {"uniform": (64, "3.5e-11", "1.3e-14"), "last link x 1e6": (16, "2.3e-7", "7.4e-11")}
    marks |= {"last link x 1e9": (16, "1.5e-4", "5.7e-9"), "1e-8 rising to 1 at the tip": (16, "7.7e-7", "5.2e-15")}
    for name, (n, ci, ab) in marks.items():
        found = chain.errors(chain.CHAINS[name](n), 3 if n > 40 else 25)
        ours = {"CI": f"{found['ci']:.1e}", "independent CI": ci, "AB": f"{found['ab']:.1e}"}
        ours |= {"AB, best state": f"{found['ab, best state']:.1e}", "independent AB": ab}
        rows.append({"chain": name, "links": n} | ours)
    legend(left)
    legend(right)
    return fig, rows


@entry
def monomials() -> Entry:
    """Monomial shape functions, and eigh(K, M)."""
    fig, (left, right) = panels(
        ("shape functions", "condition of the mass matrix"),
        ("shape functions per strain", "error of the first frequency"),
        scales="ioio",
    )
    rows: Rows = []
    counts = [2, 3, 4, 5, 6, 8, 10, 12, 14]
    monomial, legendre = [], []
    for n in counts:
        arm = beams.clamped({"bending_y": n})
        M = arm.mass_matrix(arm.zero)
        d = 1 / np.sqrt(np.diag(M))
        monomial.append(beams.monomial_condition(n))
        legendre.append(float(np.linalg.cond(d[:, None] * M * d)))
        sound = beams.definite(beams.monomial_mass(n)), beams.definite(M)
        if n in (5, 10, 12):
            rows.append(
                {
                    "functions": n,
                    "monomial: condition": f"{monomial[-1]:.2e}",
                    "definite": "yes" if sound[0] else "no",
                    "Legendre: condition": f"{legendre[-1]:.1e}",
                    "definite ": "yes" if sound[1] else "no",
                }
            )
    left.plot(counts, monomial, "o-", color=RED, ms=4, label="monomials x², x³, …")
    left.plot(counts, legendre, "o-", color=BLUE, ms=4, label="Legendre strains, unit diagonal")
    left.axhline(1 / np.finfo(float).eps, color=INK, lw=0.8, ls=":")
    left.text(2, 1.5 / np.finfo(float).eps, "end of double precision", fontsize=8)
    sizes = (2, 3, 4, 6, 8, 10, 12)
    found = [beams.first_frequency_errors(beams.sheared(n)) for n in sizes]
    right.plot(sizes, [f[0] for f in found], "o-", color=RED, ms=4, label="eigh(K, M)")
    right.plot(sizes, [max(f[1], 1e-17) for f in found], "o-", color=BLUE, ms=4, label="arm.modes")
    rows[-1] |= {"eigh(K, M), worst": f"{max(f[0] for f in found):.1e}"}
    rows[-1] |= {"arm.modes, worst": f"{max(f[1] for f in found):.1e}"}
    legend(left)
    legend(right)
    return fig, rows


@entry
def massless() -> Entry:
    """A link of no or next to no mass."""
    fig, (ax,) = panels(("mass of the middle rod of three (kg)", "relative error of accelerations"), scales="oo")
    rows: Rows = []
    masses = [10.0**-k for k in (0, 2, 4, 6, 8, 10, 12, 14, 16)]
    found = {where: [chain.errors([1.0, m, 1.0] if where == "middle" else [1.0, 1.0, m], 5) for m in masses]
             for where in ("middle", "last")}  # fmt: skip
    for where, dash in (("middle", "-"), ("last", "--")):
        for method, colour in (("ab", BLUE), ("ci", RED)):
            y = [f[method] for f in found[where]]
            ax.plot(masses, y, dash, marker="o", ms=3, color=colour, lw=1.2, label=f"{method.upper()}, {where} rod")
    ax.set_xlabel("mass of one rod of three, the others 1 kg (kg)")
    for masses_ in ([1.0, 0.0, 1.0], [1.0, 1e-300, 1.0], [1.0, 1.0, 1e-300]):
        e = chain.errors(masses_, 11)
        rows.append({"masses (kg)": ", ".join(f"{m:g}" for m in masses_), "AB": f"{e['ab']:.0e}",
                     "CI": f"{e['ci']:.0e}"})  # fmt: skip
    try:
        chain.rods([1.0, 1.0, 0.0])
    except ValueError as e:
        rows.append({"masses (kg)": "1, 1, 0", "AB": f"ValueError: {str(e).split(';')[0]}", "CI": "the same"})
    ax.set_ylim(1e-18, 1e-13)
    legend(ax, ncols=2)
    return fig, rows


@entry
def heavy_tip() -> Entry:
    """A tip up to 1e9 times the link."""
    fig, (left, right) = panels(
        ("tip mass / link mass", "relative error of frequencies"),
        ("tip mass / link mass, 6 links", "what inverse dynamics leaves of τ"),
        scales="oooo",
    )
    rows: Rows = []
    mus = [1.0, 1e2, 1e4, 1e6, 1e8]
    pairs = [beams.tip_mass_frequencies(mu) for mu in mus]
    off = np.array([np.abs(a / b - 1) for a, b in pairs])
    for k, colour in ((0, BLUE), (1, GREEN)):
        left.plot(mus, np.maximum(off[:, k], 1e-17), "o-", color=colour, ms=4, label=f"mode {k + 1} of arm.modes")
    residual = {m: [beams.heavy_tip_residual(mu, m) for mu in mus] for m in ("ab", "ci")}
    for method, colour in (("ci", RED), ("ab", BLUE)):
        right.plot(mus, residual[method], "o-", color=colour, ms=4, label=method.upper())
    for k, mu in enumerate(mus):
        rows.append({"tip / link": f"{mu:.0e}", "ω₁ √(ρA/EI) L²": f"{pairs[k][0][0]:.8g}",
                     "closed form": f"{pairs[k][1][0]:.8g}", "error, mode 1": f"{off[k, 0]:.0e}",
                     "mode 2": f"{off[k, 1]:.0e}", "residual AB": f"{residual['ab'][k]:.0e}",
                     "residual CI": f"{residual['ci'][k]:.0e}"})  # fmt: skip
    legend(left)
    legend(right)
    return fig, rows


@entry
def bending() -> Entry:
    """Large bending, order by order, and the limits of RangeWarning."""
    fig, (left, right) = panels(
        ("largest rotation of a section (rad)", "tip's error / length"),
        ("largest rotation of a section (rad)", "tip's error / length"),
        scales="oooo",
    )
    rows: Rows = []
    speeds = (4.0, 6.0, 8.0, 10.0, 14.0, 20.0, 30.0, 40.0)
    fastest = {1: 20.0}  # above its first frequency, 20.9 rad/s, order 1 diverges, and the run is stopped
    paths = {order: [beams.spin_up(order, w) for w in speeds if w <= fastest.get(order, w)] for order in ORDER}
    dashes = dict(zip(beams.LOADS, ("-", "--", "-.", ":"), strict=True))
    for order in (0, 1, 2, 3):
        row: dict[str, object] = {"order": order}
        for load, dash in dashes.items():
            found = beams.static_error(order, load, np.geomspace(0.05, 6, 24))
            if order:  # at rest order 0 is order 1
                left.plot(*found.T, dash, color=ORDER[order], lw=1.2)
            row[load] = f"{np.exp(np.interp(np.log(0.02), np.log(found[:, 1]), np.log(found[:, 0]))):.3f}"
        error = [np.linalg.norm(a[0] - b[0], axis=1).max() for a, b in zip(paths[order], paths["exact"], strict=False)]
        turned = [a[1] for a in paths[order]]
        right.plot(turned, error, "o-", color=ORDER[order], ms=4, lw=1.2, label=f"order {order}")
        row["spin-up in 0.5 s"] = f"{np.exp(np.interp(np.log(0.02), np.log(error), np.log(turned))):.3f}"
        row["limit"] = f"{LIMITS[order]:g}"
        rows.append(row)
    for load, dash in dashes.items():
        left.plot([], [], dash, color=INK, lw=1.2, label=load)
    for ax, title in ((left, "at rest, under loads"), (right, "spin-up in 0.5 s, first swing")):
        ax.axhline(0.02, color=INK, lw=0.8, ls=":")
        for order in (1, 2, 3):
            ax.axvline(LIMITS[order], color=ORDER[order], lw=0.8, alpha=0.6)
        ax.set_xlim(0.08, 1.6)
        ax.set_ylim(1e-5, 2)
        ax.set_xticks([0.1, 0.2, 0.5, 1.0], ["0.1", "0.2", "0.5", "1"])
        ax.minorticks_off()
        ax.set_title(title, fontsize=9)
    left.plot([], [], color=INK, lw=0.8, alpha=0.6, label="limit of RangeWarning")
    left.plot([], [], ":", color=INK, lw=0.8, label="2 % of the length")
    left.set_title("at rest, under loads; colours as beside", fontsize=9)
    for ax in (left, right):
        ax.legend(frameon=False, fontsize=7.5, loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2)
    return fig, rows
