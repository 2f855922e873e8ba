"""Modes along an arm."""

from collections.abc import Mapping, Sequence

import numpy as np

from ..._check import Array
from .style import PALETTE, Figure, label_axes, legend, new_figure, short, words

_WIDE, _LETTER = 4.8, 0.07  # inches: width of the axes, and of a letter
_BRANCHES = ("-.", "--", ":")  # lines of further branches
_LEAST = 12  # letters, so that names stay distinct


def _merged_joints(s: Array, joints: Sequence[tuple[float, str]]) -> list[tuple[float, dict[int, str]]]:
    """The places of joints, and at each the joints' names by their links' numbers."""
    out: dict[float, dict[int, str]] = {}
    for k, (place, name) in enumerate(joints):
        same = next((x for x in out if abs(x - place) < 1e-6 * s.max()), place)
        out.setdefault(same, {})[k] = name
    return sorted(out.items(), key=lambda x: x[0])


def _joint_labels(s: Array, joints: Sequence[tuple[float, dict[int, str]]]) -> tuple[list[str], bool]:
    """The labels over the joints' lines, as wide as there is room, and whether they are links' numbers."""
    ends = [*[place for place, _ in joints[1:]], float(s.max()) + 0.2 * float(np.ptp(s))]
    letters = [int(_WIDE * (end - place) / max(float(np.ptp(s)), 1e-300) / _LETTER) - 1
               for (place, _), end in zip(joints, ends, strict=True)]  # fmt: skip
    names = [", ".join(at.values()) for _, at in joints]
    if all(len(name) <= room or room >= _LEAST for name, room in zip(names, letters, strict=True)):
        return [short(name, room) for name, room in zip(names, letters, strict=True)], False
    every = 1 + int(3 / max(1, min(letters)))
    return [", ".join(map(str, at)) if k % every == 0 else "" for k, (_, at) in enumerate(joints)], True


def plot_modes(
    s: Array,
    moved: Array,
    labels: Sequence[str],
    joints: Sequence[tuple[float, str]],
    branches: Mapping[str, Sequence[int]],
) -> Figure:
    """One panel for each world axis with displacement.

    s: places along the arm (m), (np,). moved: displacements, (np, 3, n), to any scale. labels: of the modes. joints:
    where they sit along the arm, and whose they are. branches: the points of each line, by name; a chain has one.
    """
    axes_used = [c for c in range(3) if np.abs(moved[:, c]).max(initial=0.0) > 0.02] or [1]
    fig = new_figure(9.0, 1.2 + 2.4 * len(axes_used))
    axes = np.atleast_1d(fig.subplots(len(axes_used), 1, sharex=True))
    for ax, c in zip(axes, axes_used, strict=True):
        for k, label in enumerate(labels):
            for n, points in enumerate(branches.values()):
                style = "-" if k < len(PALETTE) else "--"
                ax.plot(
                    s[points], moved[points, c, k], ls=_BRANCHES[n % len(_BRANCHES)] if n else style,
                    color=PALETTE[k % len(PALETTE)], lw=1.8, label="_" if n else words(label),
                )  # fmt: skip
        for place, _ in joints:
            ax.axvline(place, color="#999999", lw=1.0, ls=":")
        label_axes(ax, f"displacement along\nworld {'xyz'[c]} (1 = largest)")
        ax.set_ylim(-1.12, 1.12)
    for n, name in enumerate(branches if len(branches) > 1 else ()):
        axes[0].plot([], [], ls=_BRANCHES[n % len(_BRANCHES)] if n else "-", color="#666666", label=words(name))
    axes[0].set_xlim(left=0.0)
    named = _merged_joints(s, joints)
    over, by_number = _joint_labels(s, named)
    for (place, _), word in zip(named, over, strict=True):
        axes[0].annotate(
            words(word), (place, 1.0), (2, 2), xycoords=("data", "axes fraction"), textcoords="offset points",
            fontsize=8, color="#666666",
        )  # fmt: skip
    meaning = "joints, by their links' numbers" if by_number else "joints"
    axes[-1].set_xlabel(f"place along the arm, from its base (m); dotted: {meaning}")
    legend(axes[0], len(labels) + (len(branches) if len(branches) > 1 else 0))
    return fig
