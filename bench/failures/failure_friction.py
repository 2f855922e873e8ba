"""Entry of the failure catalogue: dry friction at zero speed."""

from __future__ import annotations

import numpy as np
from failure_common import Entry, Rows, entry, legend, panels
from flexarm.data.draw.style import BLUE, GREEN, ORANGE, PURPLE
from stability import friction


@entry
def dry_friction() -> Entry:
    """A block that slides to rest under a push below its friction."""
    fig, (left, right) = panels(
        ("time (s)", "speed (m/s)"), ("time (s)", "place, less that of rest (m)"), scales="iiio"
    )
    end, rest, place = 2.0, 1.0, 0.25
    rows: Rows = []
    for name, law, h, colour in (
        ("sign, RK4 10 ms", friction.sign, 1e-2, ORANGE),
        ("sign, RK4 1 ms", friction.sign, 1e-3, PURPLE),
        ("tanh(v / 1 mm/s), RK4 1 ms", friction.smooth, 1e-3, GREEN),
    ):
        t = np.arange(round(end / h) + 1) * h
        x, v = friction.rk4(law, t).T
        _draw((left, right), t, x, v, name, colour)
        after = t > rest + 0.1
        rows.append(_row(name, v[after], x[-1] - place, 4 * (len(t) - 1)))
    t = np.linspace(0, end, 401)
    for name, options in (
        ("flexarm, ida", {}),
        ("flexarm, implicit 10 ms", {"integrator": "implicit", "step": 1e-2}),
        ("flexarm, gauss 100 ms", {"integrator": "gauss", "step": 0.1}),
    ):
        r = friction.chosen(t, **options)
        if not options:
            _draw((left, right), t, r.q[:, 0], r.v[:, 0], "flexarm", BLUE)
        rows.append(_row(name, r.v[t > rest + 0.1, 0], r.q[-1, 0] - place, r.stats["evaluations"]))
    for name, law, stop in (("sign, RK45", friction.sign, end), ("tanh, RK45", friction.smooth, end)):
        found = friction.adaptive(law, stop)
        note = "" if found["reached"] == stop else f"stopped at t = {found['reached']:.4f} s"
        rows.append({"friction": name, "evaluations": found["evaluations"], "": note})
    left.set_xlim(0.9, 1.2)
    left.set_ylim(-0.01, 0.06)
    right.set_ylim(1e-6, 1)
    legend(left)
    return fig, rows


def _draw(axes: tuple, t: np.ndarray, x: np.ndarray, v: np.ndarray, name: str, colour: str) -> None:
    axes[0].plot(t, v, color=colour, lw=1.1, label=name)
    axes[1].plot(t, np.abs(x - 0.25), color=colour, lw=1.1)


def _row(name: str, v: np.ndarray, moved: float, evaluations: float) -> dict[str, object]:
    return {
        "friction": name,
        "speed at rest, mean (m/s)": f"{v.mean():.1e}",
        "peak to peak (m/s)": f"{np.ptp(v):.1e}",
        "position error after 2 s (m)": f"{moved:+.1e}",
        "evaluations": evaluations,
    }
