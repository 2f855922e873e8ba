"""A free satellite with two flexible panels and an arm: frequencies beside finite elements; what stays in a run.

    python bench/run/trees.py [--docs]

Frequencies: of the satellite at rest with its arm bent, joints free, against a finite-element model that is assembled
here with NumPy: Hermite elements of beams that bend in two planes and twist, rigid bodies, hinges. Nothing of flexarm
is in it. Two meshes, extrapolated. Beside the same elements: a block on a slice of a boom.
Momentum and energy: of a run from large rates, without forces from outside; and with torques in the arm's joints, where
momentum stays.
Prints the tables; with --docs writes them into docs/trees.md and the picture docs/figures/trees.png.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from time import thread_time
from typing import Any

import flexarm as fa
import matplotlib
import numpy as np
from hermite import hermite
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.linalg import eigh

matplotlib.use("Agg")
import matplotlib.pyplot as plt

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from reporting import finish, replace_table

ROOT = Path(__file__).resolve().parents[2]
BLUE, ORANGE, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#666666"
Array = NDArray[np.float64]

BUS = {"mass": 60.0, "com": (0.02, 0.0, 0.01), "inertia": (5.0, 6.0, 7.0)}
PANEL = {"length": 2.0, "y": 0.01, "z": 0.5, "density": 2700.0, "E": 70e9, "nu": 0.33}
UPPER = {"length": 0.8, "y": 0.012, "z": 0.02, "density": 2700.0, "E": 70e9, "nu": 0.33}
SHOULDER = {"mass": 1.0, "com": (0.05, 0.0, 0.0), "inertia": (0.01, 0.01, 0.01)}
FORE = {"mass": 2.0, "com": (0.2, 0.0, 0.0), "inertia": (0.01, 0.02, 0.02)}
SEATS = {"left": ((0.0, 0.4, 0.0), np.pi / 2), "right": ((0.0, -0.4, 0.0), -np.pi / 2), "arm": ((0.4, 0.0, 0.0), 0.0)}
HUB_END, BENT = (0.1, 0.0, 0.0), {"shoulder": 0.5, "elbow": -0.9}
SHOWN = 10  # frequencies


def satellite(shapes: int, order: int | str = 2) -> fa.Arm:
    """The same in flexarm."""

    def beam(of: dict[str, float], modes: dict[str, int]) -> fa.Beam:
        material = fa.Material(of["density"], of["E"], of["nu"])
        return fa.Beam(of["length"], fa.Rectangle(of["y"], of["z"]), material, modes, "legendre", order)

    def seat(name: str) -> fa.Placement:
        place, turn = SEATS[name]
        return fa.Placement(place, (0, 0, turn))

    bends = {"bending_y": shapes, "bending_z": shapes, "torsion": shapes}
    return fa.Arm(
        [
            fa.Link(fa.Free(), fa.RigidBody(**BUS), name="bus"),
            fa.Link(fa.Fixed(inboard=seat("left")), beam=beam(PANEL, bends), name="left panel", parent="bus"),
            fa.Link(fa.Fixed(inboard=seat("right")), beam=beam(PANEL, bends), name="right panel", parent="bus"),
            fa.Link(
                fa.Revolute("z", inboard=seat("arm"), name="shoulder"),
                fa.RigidBody(**SHOULDER, end=HUB_END),
                beam(UPPER, bends),
                name="upper",
                parent="bus",
            ),
            fa.Link(fa.Revolute("z", name="elbow"), fa.RigidBody(**FORE, end=(0.4, 0, 0)), name="fore"),
        ]
    )


# -- finite elements ---------------------------------------------------------------------------------------------------


def turn_z(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def cross(r: Any) -> Array:
    return np.array([[0.0, -r[2], r[1]], [r[2], 0.0, -r[0]], [-r[1], r[0], 0.0]])


def torsion_constant(a: float, b: float) -> float:
    """Of a rectangle with sides a >= b, by Saint-Venant's series (m^4)."""
    n = np.arange(1, 400, 2)
    return float(a * b**3 / 3 * (1 - 192 * b / (np.pi**5 * a) * (np.tanh(n * np.pi * a / (2 * b)) / n**5).sum()))


class Model:
    """Small motions z of an assembly: M z'' + K z = 0. Each point has rows (6, n) that give its displacement and its
    small turn, in world axes, by z."""

    def __init__(self, size: int) -> None:
        self.M, self.K, self.size, self.used = np.zeros((size, size)), np.zeros((size, size)), size, 0

    def new(self, count: int) -> Array:
        """Rows of unknowns of one's own, (count, n)."""
        rows = np.zeros((count, self.size))
        rows[range(count), range(self.used, self.used + count)] = 1.0
        self.used += count
        return rows

    def moved(self, at: Array, r: Array) -> Array:
        """The point at r (world axes) from `at`, rigidly joined to it."""
        return np.vstack([at[:3] - cross(r) @ at[3:], at[3:]])

    def hinge(self, at: Array, axis: Array) -> Array:
        """Behind a hinge without friction."""
        out = at.copy()
        out[3:] += np.outer(axis, self.new(1)[0])
        return out

    def body(self, at: Array, R: Array, mass: float, com: Any, inertia: Any) -> None:
        """A rigid body; its inertia is about its centre of mass."""
        centre = self.moved(at, R @ np.array(com))
        self.M += mass * centre[:3].T @ centre[:3] + centre[3:].T @ (R @ np.diag(inertia) @ R.T) @ centre[3:]

    def beam(self, at: Array, R: Array, of: dict[str, float], elements: int) -> Array:
        """A slender straight beam along R's first column, clamped at `at`, which keeps its length; returns its end. Of
        each node: deflections v, w and their slopes, the twist and its slope."""
        L, y, z, density, E = (of[k] for k in ("length", "y", "z", "density", "E"))
        A, h = y * z, L / elements
        Iz, Iy, GJ = z * y**3 / 12, y * z**3 / 12, E / (2 + 2 * of["nu"]) * torsion_constant(max(y, z), min(y, z))
        along = R[:, 0] @ at[:3]
        self.M += density * A * L * np.outer(along, along)
        fixed = R.T @ at[:3], R.T @ at[3:]
        # v, v' = turn about z; w, w' = -turn about y; twist and its rate, which is free also at the clamp
        node = np.vstack([fixed[0][1], fixed[1][2], fixed[0][2], -fixed[1][1], fixed[1][0], self.new(1)[0]])
        for _ in range(elements):
            after = self.new(6)
            for first, stiff, mass, rotary in (
                (0, E * Iz, density * A, density * Iz),
                (2, E * Iy, density * A, density * Iy),
                (4, None, density * (Iy + Iz), 0.0),
            ):
                rows = np.vstack([node[first : first + 2], after[first : first + 2]])
                m0, m1, m2 = hermite(h)
                self.M += rows.T @ (mass * m0 + rotary * m1) @ rows
                self.K += rows.T @ (GJ * m1 if stiff is None else stiff * m2) @ rows
            node = after
        local = np.vstack([along, node[0], node[2]]), np.vstack([node[4], -node[3], node[1]])
        return np.vstack([R @ local[0], R @ local[1]])

    def frequencies(self, zeros: int) -> Array:
        """Those above zero (rad/s); so many are zero."""
        assert self.used == self.size
        square = eigh(self.K, self.M, eigvals_only=True)
        return np.sqrt(square[zeros:])


def by_elements(elements: int) -> Array:
    """Frequencies of the satellite (rad/s)."""
    model = Model(6 + 2 + 3 * (6 * elements + 1))
    bus = model.new(6)
    model.body(bus, np.eye(3), **BUS)
    for side in ("left", "right"):
        place, turn = SEATS[side]
        model.beam(model.moved(bus, np.array(place)), turn_z(turn), PANEL, elements)
    up = np.array([0.0, 0.0, 1.0])
    R = turn_z(BENT["shoulder"])
    shoulder = model.hinge(model.moved(bus, np.array(SEATS["arm"][0])), up)
    model.body(shoulder, R, **SHOULDER)
    elbow = model.beam(model.moved(shoulder, R @ np.array(HUB_END)), R, UPPER, elements)
    model.body(model.hinge(elbow, up), turn_z(BENT["shoulder"] + BENT["elbow"]), **FORE)
    return model.frequencies(8)


def frequencies() -> list[tuple[float, float, float, float]]:
    """Of each mode: by elements, extrapolated; its doubt; by flexarm with 4 and with 8 shapes of each strain."""
    coarse, fine = (by_elements(n)[:SHOWN] for n in (10, 20))
    limit = fine + (fine - coarse) / 15  # errors of Hermite elements: h^4
    found = []
    for shapes in (4, 8):
        modes = satellite(shapes).modes(BENT)
        found.append(modes.frequencies[modes.frequencies > 1e-3][:SHOWN])
    return list(zip(limit, np.abs(fine - limit) / 10, *found, strict=True))  # type: ignore[arg-type]


# -- a block on a slice of a boom --------------------------------------------------------------------------------------

BOOM = UPPER | {"length": 0.6}
PLACE, BLOCK = 0.2, {"mass": 0.2, "com": (0.01, 0.02, 0.0), "inertia": (1e-4, 2e-4, 2e-4)}


def block_by_elements(elements: int) -> Array:
    """Frequencies of the boom, clamped, with the block on it (rad/s)."""
    model = Model(6 * 3 * elements + 2)
    at = model.beam(np.zeros((6, model.size)), np.eye(3), BOOM | {"length": PLACE}, elements)
    model.body(at, np.eye(3), **BLOCK)
    model.beam(at, np.eye(3), BOOM | {"length": BOOM["length"] - PLACE}, 2 * elements)
    return model.frequencies(0)


def on_slice() -> list[tuple[int, float, float]]:
    """The largest error of the lowest six frequencies, by shapes of each strain: on a slice, and between two halves."""
    coarse, fine = (block_by_elements(n)[:6] for n in (6, 12))
    limit = fine + (fine - coarse) / 15
    out = []
    for shapes in (4, 8, 16):
        modes = {"bending_y": shapes, "bending_z": shapes, "torsion": shapes}
        material = fa.Material(BOOM["density"], BOOM["E"], BOOM["nu"])
        beam = fa.Beam(BOOM["length"], fa.Rectangle(BOOM["y"], BOOM["z"]), material, modes, "legendre")
        boom, block = fa.Link(fa.Fixed(), beam=beam), fa.Link(fa.Fixed(), fa.RigidBody(**BLOCK), parent=0)
        halves = fa.Arm([*fa.split(boom, shapes // 2, [PLACE]), block])
        errors = [
            float(np.abs(arm.modes().frequencies[:6] / limit - 1).max())
            for arm in (fa.Arm([boom, replace(block, at=PLACE)]), halves)
        ]
        out.append((shapes, *errors))
    return out


# -- a run -------------------------------------------------------------------------------------------------------------

RUNS: list[tuple[str, dict[str, Any]]] = [
    ("default run", {}),
    ("ida, rtol 1e-9", {"integrator": "ida", "rtol": 1e-9, "atol": 1e-11}),
    ("implicit, step 1 ms", {"integrator": "implicit", "step": 1e-3}),
    ("gauss, step 5 ms", {"integrator": "gauss", "step": 5e-3, "rtol": 1e-15}),
    ("gauss, step 2.5 ms", {"integrator": "gauss", "step": 2.5e-3, "rtol": 1e-15}),
]  # steps end at the output times, between which a state is interpolated
TORQUES = {"shoulder": fa.Torque(lambda t: 2.0 * np.sin(3.0 * t)), "elbow": fa.Torque(lambda t: -np.sin(5.0 * t))}


def start(arm: fa.Arm) -> tuple[Array, Array]:
    """The arm bent, all bodies in motion; panels swing by some centimetres."""
    v = np.zeros(arm.nv)
    v[:6] = 0.1, -0.05, 0.02, 0.2, 0.1, 0.3  # m/s; rad/s
    v[arm.joint_rate("shoulder")], v[arm.joint_rate("elbow")] = 0.8, -1.5
    for name in ("left panel", "right panel"):
        v[arm.coordinates.index(f"{name} bending_y 1")] = 0.1
    return arm.pose(BENT), v


def work(run: fa.Result) -> Array:
    """Of the torques in the joints, at each row (J): integral of a spline of their power."""
    power = np.einsum("ti,ti->t", run.tau, run.v)
    return np.asarray(make_interp_spline(run.t, power, k=5).antiderivative()(run.t))


def drift(x: Array) -> float:
    """The largest change of a quantity (nt, ...), in parts of its size."""
    return float(np.abs(x - x[0]).max() / np.abs(x).max())


def runs() -> tuple[list[tuple[str, str, Array]], fa.Result, fa.Result]:
    """The rows of the table: momentum, angular momentum, energy (less the torques' work); a free run, and one with
    torques."""
    arm = satellite(3)
    q0, v0 = start(arm)
    t = np.linspace(0.0, 10.0, 401)
    rows, kept = [], None
    for name, options in RUNS:
        began = thread_time()
        run = fa.simulate(arm, t, q0, v0, **options)
        seconds = thread_time() - began
        p, E = arm.momentum(run.q, run.v), sum(run.energy())
        rows.append((name, f"{seconds:.2g}", np.array([drift(p[:, :3]), drift(p[:, 3:]), drift(np.asarray(E))])))
        kept = run
    began = thread_time()
    driven = fa.simulate(arm, np.linspace(0.0, 10.0, 4001), q0, v0, drive=TORQUES, integrator="rk4", step=1e-4)
    seconds = thread_time() - began
    p, E = arm.momentum(driven.q, driven.v), np.asarray(sum(driven.energy())) - work(driven)
    found = np.array([drift(p[:, :3]), drift(p[:, 3:]), drift(E)])
    rows.append(("torques in the joints; rk4, step 0.1 ms", f"{seconds:.2g}", found))
    assert kept is not None
    return rows, kept, driven


# -- tables and picture ------------------------------------------------------------------------------------------------


def tables(modes: list[tuple[float, float, float, float]], rows: list[tuple[str, str, Array]]) -> dict[str, str]:
    first = ["| mode | elements (rad/s) | flexarm, 4 shapes | off by | flexarm, 8 shapes | off by |", "|-" * 6 + "|"]
    for k, (limit, _, four, eight) in enumerate(modes, 1):
        off = [f"{abs(x / limit - 1):.0e}" for x in (four, eight)]
        first.append(f"| {k} | {limit:.6f} | {four:.6f} | {off[0]} | {eight:.6f} | {off[1]} |")
    doubt = max(d / limit for limit, d, *_ in modes)
    first += ["", f"The elements' own frequencies are sure to about {doubt:.0e}."]
    second = ["| run of 10 s | CPU time (s) | momentum | angular momentum | energy |", "|-" * 5 + "|"]
    for name, seconds, off in rows:
        numbers = " | ".join(f"{x:.0e}" for x in off)
        second.append(f"| {name} | {seconds} | {numbers} |")
    third = ["| shapes of each strain | `at=0.2` | as many in all, on two halves |", "|-" * 3 + "|"]
    third += [f"| {shapes} | {slice:.0e} | {halves:.0e} |" for shapes, slice, halves in on_slice()]
    return {"frequencies": "\n".join(first), "drift": "\n".join(second), "slices": "\n".join(third)}


def draw(path: Path, modes: list[tuple[float, float, float, float]], run: fa.Result, driven: fa.Result) -> None:
    figure, axes = plt.subplots(2, 2, figsize=(11.0, 7.4), layout="constrained")
    arm = run.arm
    ax = axes[0, 0]
    numbers = np.arange(1, len(modes) + 1)
    for shapes, k, colour in ((4, 2, ORANGE), (8, 3, BLUE)):
        off = [max(abs(m[k] / m[0] - 1), 1e-13) for m in modes]
        ax.semilogy(numbers, off, "o-", color=colour, label=f"flexarm, {shapes} shapes of each strain")
    ax.semilogy(numbers, [m[1] / m[0] for m in modes], ":", color=GREY, label="doubt of the elements")
    ax.set(xlabel="mode", ylabel="frequency off by (relative)", title="(a) beside finite elements", xticks=numbers)
    ax.set_ylim(top=30.0)
    ax.legend(frameon=False, loc="upper left")
    ax = axes[0, 1]
    early = driven.t <= 3.0
    for name, colour in (("left panel", BLUE), ("right panel", ORANGE), ("upper", GREEN)):
        ax.plot(driven.t[early], 1e3 * driven.tip_deflection(name)[early, 1], color=colour, lw=1.3, label=name)
    ax.set(xlabel="time (s)", ylabel="deflection of the beam's end (mm)", title="(b) torques in the joints")
    ax.legend(frameon=False, ncols=3, loc="upper right")
    ax.margins(y=0.2)
    ax = axes[1, 0]
    T, U = (np.asarray(x) for x in run.energy())
    E = np.asarray(sum(driven.energy()))
    ax.plot(driven.t, E - E[0], color=ORANGE, lw=3.0, alpha=0.5, label="energy since the start")
    ax.plot(driven.t, work(driven), color=BLUE, lw=1.2, ls="--", label="work of the torques")
    ax.set(xlabel="time (s)", ylabel="energy (J)", title="(c) torques in the joints")
    ax.legend(frameon=False, loc="upper right")
    ax.margins(y=0.25)
    ax = axes[1, 1]
    for of, name, colour in ((run, "free", BLUE), (driven, "torques", ORANGE)):
        y = arm.momentum(of.q, of.v)
        for part, style, kind in ((slice(0, 3), "-", "momentum"), (slice(3, 6), "--", "angular momentum")):
            off = np.abs(y[:, part] - y[0, part]).max(axis=1) / np.abs(y[:, part]).max()
            ax.semilogy(of.t, np.maximum(off, 1e-17), style, color=colour, lw=1.2, label=f"{kind}, {name}")
    off = np.abs(T + U - T[0] - U[0]) / (T + U)
    ax.semilogy(run.t, np.maximum(off, 1e-17), ":", color=GREY, lw=1.4, label="energy, free")
    ax.set(xlabel="time (s)", ylabel="change since the start (relative)", title="(d) what stays", ylim=(1e-17, 1e-8))
    ax.legend(frameon=False, fontsize=8.5, loc="upper left", ncols=2)
    finish(figure, path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--docs", action="store_true", help="write the tables and the picture of docs/trees.md")
    args = parser.parse_args()
    modes = frequencies()
    rows, run, driven = runs()
    made = tables(modes, rows)
    print("\n\n".join(made.values()))
    if args.docs:
        draw(ROOT / "docs" / "figures" / "trees.png", modes, run, driven)
        for name, table in made.items():
            replace_table(ROOT / "docs" / "trees.md", name, table)


if __name__ == "__main__":
    main()
