"""Modes and linear models as plain tables."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._check import Array
from .._console import aligned

_ROWS = 16  # that are shown


def modes_table(frequencies: Array, damping: Array, eigenvalues: Any, share: Array, names: tuple[str, ...]) -> str:
    """The text of Modes: numbers from 0, as `shapes` and `animate` count them."""
    rows = [["mode", "rad/s", "Hz", "damping ratio", "most of its energy in"]]
    for k in range(min(len(frequencies), _ROWS)):
        where = int(share[:, k].argmax())
        part = f"{names[where]} ({100 * share[where, k]:.0f} %)"
        ratio = f"{damping[k]:.4g}" if frequencies[k] else "grows" if eigenvalues[k].real > 0 else "rigid"
        rows.append([str(k), f"{frequencies[k]:.6g}", f"{frequencies[k] / (2 * np.pi):.6g}", ratio, part])
    return "\n".join(aligned(rows, range(4)) + _more(len(frequencies), "modes, which are faster"))


def model_table(model: Any) -> str:
    """The text of a LinearModel: its size, its inputs and outputs, and its eigenvalues."""
    s: NDArray[np.complex128] = model.eigenvalues
    counts = f"{len(s)} states, {len(model.inputs)} inputs, {len(model.outputs)} outputs"
    lines = [f"dx/dt = A x + B u, y = C x + D u: {counts}"]
    for what in ("states", "inputs", "outputs"):
        labels = getattr(model, what)
        more = f", and {len(labels) - _ROWS} more" if len(labels) > _ROWS else ""
        lines.append(f"{what:<8} {', '.join(labels[:_ROWS]) or 'none'}{more}")
    upper = s[s.imag >= 0]
    upper = upper[np.argsort(np.abs(upper), kind="stable")]
    rows = [["eigenvalue (1/s)", "size (rad/s)", "Hz", "damping ratio"]]
    for x in upper[:_ROWS]:
        size = float(np.abs(x))
        text = f"{x.real + 0.0:.4g}" + (f" +- {x.imag:.4g}i" if x.imag else "")
        rows.append([text, f"{size:.4g}", f"{size / (2 * np.pi):.4g}", f"{-x.real / size:.4g}" if size else "-"])
    return "\n".join([*lines, "", *aligned(rows, range(1, 4)), *_more(len(upper), "eigenvalues, which are faster")])


def _more(count: int, what: str) -> list[str]:
    return [f"... and {count - _ROWS} more {what}"] if count > _ROWS else []
