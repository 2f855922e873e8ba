"""A closed loop as a table."""

from __future__ import annotations

from typing import Any

import numpy as np

_ROWS = 16  # poles that are shown


def _number(x: float, none: str = "-") -> str:
    return none if not np.isfinite(x) else f"{x + 0.0 if abs(x) > 1e-12 else 0.0:.4g}"


def table(loop: Any) -> str:
    """What `print` shows of a ClosedLoop."""
    n = len(loop.poles)
    kinds = ", ".join(f"control[{k}] {type(c).__name__}" for k, c in enumerate(loop.control)) or "no control"
    often = "" if loop.period is None else f"; sampling period {loop.period:.6g} s"
    rests = loop.growth < -1e-6
    state = "UNSTABLE" if not loop.stable else "stable" if rests else "stable, but some of it does not die away"
    out = [f"{kinds}: {state}, {n} poles, fastest growth {_number(loop.growth)} 1/s{often}", ""]
    z = loop.z
    head = f"{'growth (1/s)':>14}{'frequency (rad/s)':>20}{'(Hz)':>10}{'damping ratio':>16}"
    out.append(head + ("" if z is None else f"{'z':>24}"))
    shown = [k for k in range(n) if loop.poles[k].imag >= 0 or np.isneginf(loop.poles[k].real)]
    for k in shown[:_ROWS]:
        s = loop.poles[k]
        size = float(np.abs(s))
        row = f"{_number(s.real, '-inf'):>14}{_number(size, 'inf'):>20}{_number(size / 2 / np.pi, 'inf'):>10}"
        row += f"{_number(float(loop.damping[k])):>16}"
        if z is not None:
            side = f" +- {abs(z[k].imag):.4g}i" if s.imag > 0 and abs(z[k].imag) > 1e-12 else ""
            text = f"{z[k].real:.4g}{side}" if abs(z[k]) > 1e-3 else "0, but for rounding"
            row += f"{text:>24}"
        out.append(row)
    if len(shown) > _ROWS:
        out.append(f"{'...':>14} and {len(shown) - _ROWS} more, which fall faster")
    if loop.channels and loop.stable:
        out += ["", *_margins(loop)]
    elif loop.channels:
        out += ["", str(loop.limits())]
    return "\n".join(out)


def _margins(loop: Any) -> list[str]:
    width = max(12, *(len(m.name) + 2 for m in loop.margins))
    out = [f"{'loop at':<{width}}{'gain, from':>12}{'to':>10}{'phase (deg)':>14}{'at (rad/s)':>12}{'delay (ms)':>12}"]
    for m in loop.margins:
        out.append(
            f"{m.name:<{width}}{_number(m.gain[0]):>12}{_number(m.gain[1], 'inf'):>10}"
            f"{_degrees(m.phase):>14}{_number(m.phase_frequency):>12}{_milli(m.delay):>12}"
        )
    if np.isfinite(loop.robustness.value):
        out.append(
            f"least singular value of I + L: {loop.robustness.value:.3f}, at {_number(loop.robustness.frequency)} rad/s"
        )
    return out


def _degrees(x: float) -> str:
    return "-" if np.isnan(x) else "any" if np.isinf(x) else f"{np.degrees(x):.4g}"


def _milli(x: float) -> str:
    return "-" if np.isnan(x) else "any" if np.isinf(x) else f"{1e3 * x:.4g}"
