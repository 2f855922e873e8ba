"""The diagram of frames, axes and signs: an arm of two links, drawn with flexarm's own kinematics.

    python bench/data/axes.py [-o FILE]

Writes docs/figures/axes.png.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import flexarm as fa
import numpy as np
from flexarm.data.draw.style import BLUE, DPI, GREEN, INK, RED, new_figure
from matplotlib.axes import Axes

ROOT = Path(__file__).parents[2]
BEAM = {"length": 1.0, "section": fa.Rectangle(0.01, 0.02), "material": fa.Material(2700, 70e9, 0.33)}


def two_links() -> fa.Arm:
    beam = fa.Beam(**BEAM, modes={"bending_y": 1}, order="exact")
    hub = fa.RigidBody(0.3, end=(0.2, 0.0, 0.0))
    return fa.Arm([fa.Link(fa.Revolute("z"), hub, beam), fa.Link(fa.Revolute("z"), beam=beam)])


def frame(ax: Axes, p: np.ndarray, R: np.ndarray) -> None:
    """x and y axes of a frame in the plane."""
    for k, colour in enumerate((RED, GREEN)):
        end = p + 0.22 * R[:, k]
        ax.annotate("", end[:2], p[:2], arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 2.0}, zorder=6)
        at = p + 0.27 * R[:, k]
        ax.text(*at[:2], "xy"[k], color=colour, fontsize=11, ha="center", va="center", weight="bold")


def side(ax: Axes) -> None:
    """The arm from above: z points at the reader."""
    ax.set_aspect("equal")
    ax.set_xlim(-0.45, 2.75)
    ax.set_ylim(-0.35, 2.0)
    arm = two_links()
    q = arm.zero
    q[[0, 1, 2, 3]] = 0.35, 0.0, 0.5, 0.0
    bend = next(k for k, name in enumerate(arm.q_names) if "bending_y" in name)
    while arm.strain(q, 0, 0.0)[2] < 0.75:  # to where K3 at the clamp is seen
        q[bend] += 0.05
    origin, end = np.zeros(3), arm.frame(q, 0)[0]
    points = np.array([arm.frame(q, 0, x)[0] for x in np.linspace(0, 1, 60)])
    second = np.array([arm.frame(q, 1, x)[0] for x in np.linspace(0, 1, 30)])
    clamp, R = arm.frame(q, 0, 0.0)
    straight = clamp + R[:, 0]
    ax.plot(*np.array([origin, clamp])[:, :2].T, color=INK, lw=9, solid_capstyle="butt", label="hub, rigid (hub.end)")
    ax.plot(*points[:, :2].T, color=BLUE, lw=5, label="beam of link 0, bent: K3 > 0")
    ax.plot(*np.array([clamp, straight])[:, :2].T, color=BLUE, lw=1.4, ls="--", label="the same at rest: along its x")
    ax.plot(*second[:, :2].T, color="#56B4E9", lw=5, label="beam of link 1, straight")
    ax.annotate("", end[:2], straight[:2], arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 1.6, "shrinkB": 5})
    beside = 0.5 * (end + straight) + [0.06, -0.14, 0]
    ax.text(*beside[:2], "deflection: bending_y\nmoves the beam along its y", fontsize=10)
    for place in (origin, end):
        ax.plot(*place[:2], "o", ms=13, mfc="white", mec=INK, mew=2, zorder=5)
        ax.plot(*place[:2], ".", ms=5, color=INK, zorder=5)
    frame(ax, clamp, R)
    ax.text(clamp[0] + 0.02, clamp[1] - 0.2, "clamp: slice x = 0", fontsize=10, color=INK)
    tip, turned = arm.frame(q, 1, 1.0)
    frame(ax, tip, turned)
    ax.text(tip[0] + 0.07, tip[1] - 0.02, "tip of link 1: slice x = L", fontsize=10, color=INK)
    level = 0.62
    ax.plot([0, level], [0, 0], color="#999999", lw=1.0)
    turn = np.linspace(0, q[0], 20)
    ax.plot(0.55 * np.cos(turn), 0.55 * np.sin(turn), color="#777777", lw=1.4)
    ax.text(0.58, 0.07, "q[0] > 0", fontsize=10, color="#555555")
    ax.text(-0.03, -0.14, "joint 0:\nworld's origin", fontsize=10, color=INK, ha="center", va="top")
    ax.text(end[0] + 0.1, end[1], "joint 1: at the end of link 0;\nq > 0 turns counterclockwise about z", fontsize=10)
    frame(ax, np.array([2.1, -0.1, 0]), np.eye(3))
    ax.text(2.1, -0.27, "world's axes; z points at you", fontsize=10, color=INK, ha="center")
    ax.set_axis_off()
    ax.legend(loc="upper left", fontsize=10, frameon=False)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", type=Path, default=ROOT / "docs" / "figures" / "axes.png")
    figure = new_figure(8.3, 5.6)
    side(figure.subplots())
    figure.savefig(parser.parse_args().o, dpi=DPI)


if __name__ == "__main__":
    main()
