"""A closed loop, and its margins, as tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

_ROWS = 16  # poles that are shown


def table(loop: Any) -> str:
    """The text of a ClosedLoop, as `print` shows it."""
    n = len(loop.poles)
    kinds = ", ".join(f"control[{k}] {type(c).__name__}" for k, c in enumerate(loop.control)) or "no control"
    often = "" if loop.period is None else f"; sampling period {loop.period:.6g} s"
    rests = loop.growth < -1e-6
    state = "UNSTABLE" if not loop.stable else "stable" if rests else "stable, but some of it does not die away"
    out = [f"{kinds}: {state}, {n} poles, fastest growth {short(loop.growth)} 1/s{often}", ""]
    z = loop.z
    head = f"{'growth (1/s)':>14}{'frequency (rad/s)':>20}{'(Hz)':>10}{'damping ratio':>16}"
    out.append(head + ("" if z is None else f"{'z':>24}"))
    shown = [k for k in range(n) if loop.poles[k].imag >= 0 or np.isneginf(loop.poles[k].real)]
    for k in shown[:_ROWS]:
        s = loop.poles[k]
        size = float(np.abs(s))
        row = f"{short(s.real, '-inf'):>14}{short(size, 'inf'):>20}{short(size / 2 / np.pi, 'inf'):>10}"
        row += f"{short(float(loop.damping[k])):>16}"
        if z is not None:
            side = f" +- {abs(z[k].imag):.4g}i" if s.imag > 0 and abs(z[k].imag) > 1e-12 else ""
            text = f"{z[k].real:.4g}{side}" if abs(z[k]) > 1e-3 else "0, but for rounding"
            row += f"{text:>24}"
        out.append(row)
    if len(shown) > _ROWS:
        out.append(f"{'...':>14} and {len(shown) - _ROWS} more, which fall faster")
    if loop.channels and loop.stable:
        out += ["", *margins_table(loop.margins)]
        if np.isfinite(loop.robustness.value):
            out.append(str(loop.robustness))
    elif loop.channels:
        out += ["", str(loop.limits())]
    return "\n".join(out)


def margins_table(margins: Sequence[Any]) -> list[str]:
    """The lines of Margins as a table: its head, then one for each."""
    width = max(12, *(len(m.name) + 2 for m in margins))
    out = [f"{'loop at':<{width}}{'gain, from':>12}{'to':>10}{'phase (deg)':>14}{'at (rad/s)':>12}{'delay (ms)':>12}"]
    for m in margins:
        out.append(
            f"{m.name:<{width}}{short(m.gain[0]):>12}{short(m.gain[1], 'inf'):>10}"
            f"{_any(np.degrees(m.phase)):>14}{short(m.phase_frequency):>12}{_any(1e3 * m.delay):>12}"
        )
    return out


def short(x: float, none: str = "-") -> str:
    """Four digits; `none` of inf and nan."""
    return none if not np.isfinite(x) else f"{x + 0.0 if abs(x) > 1e-12 else 0.0:.4g}"


def _any(x: float) -> str:
    return "-" if np.isnan(x) else "any" if np.isinf(x) else f"{x:.4g}"
