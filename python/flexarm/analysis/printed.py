"""Modes and linear models as plain tables."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._console import aligned

_ROWS = 16  # that are shown


def modes_table(modes: Any, most: int = _ROWS) -> str:
    """The text of the lowest of some Modes: numbers from 0, as `shapes` and `animate` count them."""
    rows = [["mode", "rad/s", "Hz", "damping ratio", "most of its energy in"]]
    for k, (w, s) in enumerate(zip(modes.frequencies[:most], modes.eigenvalues, strict=False)):
        where = int(modes.participation[:, k].argmax())
        part = f"{modes.arm.coordinates[where]} ({100 * modes.participation[where, k]:.0f} %)"
        ratio = f"{modes.damping[k]:.4g}" if w else "grows" if s.real > 0 else "rigid"
        rows.append([str(k), f"{w:.6g}", f"{w / (2 * np.pi):.6g}", ratio, part])
    return "\n".join(aligned(rows, range(4)) + _more(len(modes.frequencies), most, "modes, which are faster"))


def model_table(model: Any) -> str:
    """The text of a LinearModel: its size, its inputs and outputs, and its eigenvalues."""
    s: NDArray[np.complex128] = model.eigenvalues
    counts = f"{len(s)} states, {len(model.inputs)} inputs, {len(model.outputs)} outputs"
    lines = [f"dx/dt = A x + B u, y = C x + D u: {counts}"]
    for kind in ("states", "inputs", "outputs"):
        labels = getattr(model, kind)
        more = f", and {len(labels) - _ROWS} more" if len(labels) > _ROWS else ""
        lines.append(f"{kind:<8} {', '.join(labels[:_ROWS]) or 'none'}{more}")
    upper = s[s.imag >= 0]
    upper = upper[np.argsort(np.abs(upper), kind="stable")]
    rows = [["eigenvalue (1/s)", "size (rad/s)", "Hz", "damping ratio"]]
    for x in upper[:_ROWS]:
        size = float(np.abs(x))
        text = f"{x.real + 0.0:.4g}" + (f" +- {x.imag:.4g}i" if x.imag else "")
        rows.append([text, f"{size:.4g}", f"{size / (2 * np.pi):.4g}", f"{-x.real / size:.4g}" if size else "-"])
    rest = _more(len(upper), _ROWS, "eigenvalues, which are faster")
    return "\n".join([*lines, "", *aligned(rows, range(1, 4)), *rest])


def _more(count: int, shown: int, of: str) -> list[str]:
    return [f"... and {count - shown} more {of}"] if count > shown else []
