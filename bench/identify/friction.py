"""What the currents tell of the drives of the measured arm, and how far they can take a prediction of its angles.

    python bench/identify/friction.py [--docs]

The torque of friction is that of the motor, by the handbook's torque of an ampere, less what the arm needs to move as
measured (its joints moved as measured, friction and all else of the drives left out). Prints, for the second drive, how
friction follows angle and speed while the joint stands; then how far the joints' angles in the second half of each
recording can be predicted from currents: by drives fitted to the first half, by drives fitted to all of it, which no
prediction has, and how much 1 % of the motor's torque moves the prediction. With --docs it puts the tables between the
marks of docs/validation.md, and writes docs/figures/validation-friction.png.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import flexarm as fa
import numpy as np
from flexarm.identify.validate import validate as judging
from flexarm.identify.validate.rig import (
    ARM,
    CURRENTS,
    DEFLECTIONS,
    DRIVES,
    JOINTS,
    SHIPPED,
    Recording,
    compared,
    identified,
    read,
    with_currents,
    with_motion,
    with_values,
)
from scipy.signal import savgol_filter

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from reporting import replace_table

DOCS = Path(__file__).parents[2] / "docs"
HANDBOOK = (8.9, 0.87)  # N m of an ampere
STANDS, LEAST = 0.06, 0.7  # rad/s, s: slower for longer, the second joint counts as standing
FREE = {f"link.{k}.joint.{name}": 0.0 for k in (0, 1) for name in ("coulomb", "damping")}


@dataclass
class Drive:
    """One drive of one recording: time, angle, speed, the motor's torque and that of friction."""

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    motor: np.ndarray
    friction: np.ndarray

    def standing(self) -> Iterator[np.ndarray]:
        """Rows of each time in which it stands, without their first and last 0.1 s."""
        slow = np.r_[False, np.abs(self.v) < STANDS, False]
        first, last = np.flatnonzero(slow[1:] & ~slow[:-1]), np.flatnonzero(~slow[1:] & slow[:-1])
        for a, b in zip(first + 5, last - 5, strict=True):
            if b - a > LEAST / (self.t[1] - self.t[0]):
                yield np.arange(a, b)


def drive(recording: Recording, k: int) -> Drive:
    """The k-th drive, from the arm moved as measured."""
    scene = with_values(fa.load("quanser"), identified(recording.name)[0] | FREE)
    needed = with_motion(scene, recording).run().to_data()[f"tau link {k} revolute"]
    data = recording.data
    speed = savgol_filter(data[JOINTS[k]], 5, 3, deriv=1, delta=data.step)
    motor = HANDBOOK[k] * data[CURRENTS[k]]
    return Drive(data.t, data[JOINTS[k]], speed, motor, motor - needed)


def standing(drives: dict[str, Drive]) -> str:
    """Friction of a joint that stands, by angle, by speed and by both; each time with its own mean and drift."""
    lines = ["| recording | times | friction while it stands, std (N m) | stiffness (N m/rad) | damping (N m s/rad) "
             "| explained (%): by the angle | by the speed | by both |", "|-|-:|-:|-:|-:|-:|-:|-:|"]  # fmt: skip
    for name, d in drives.items():
        rows = list(d.standing())

        def own(x: np.ndarray, rows: list[np.ndarray] = rows) -> np.ndarray:
            """Of each time, what is no straight line over time."""
            return np.concatenate([x[r] - np.polyval(np.polyfit(r, x[r], 1), r) for r in rows])

        f, q, v = own(d.friction), own(d.q), own(d.v)
        left = {}
        for by, columns in (("q", [q]), ("v", [v]), ("both", [q, v])):
            x = np.linalg.lstsq(np.column_stack(columns), f, rcond=None)[0]
            left[by] = 100 * (1 - np.var(f - np.column_stack(columns) @ x) / np.var(f))
        shares = " | ".join(f"{s:.0f}" for s in left.values())
        lines.append(f"| {name} | {len(rows)} | {f.std():.2f} | {x[0]:.0f} | {x[1]:.1f} | {shares} |")
    return "\n".join(lines)


def bounds() -> str:
    """Errors of the joints in the second half by what the drives were fitted to, and how far small errors move them."""
    lines = ["| recording | drives fitted to the first half | drives fitted to all of it | moved by 1 % of the torques "
             "| moved by 1 % of dry friction | moved by 5 mA |", "|-|-:|-:|-:|-:|-:|"]  # fmt: skip
    for name in SHIPPED:
        recording, columns = read(name), (*JOINTS, *DEFLECTIONS)
        until = float(recording.data.t[-1]) / 2
        found = fa.validate("quanser", predict=name)
        scene = with_values(fa.load("quanser"), {path: found.fits["motion"].values[path] for path in ARM})
        own = with_values(with_motion(scene, recording), found.calibrations[name])
        driven, fits = with_currents(own, recording), []
        for begin in (identified(n)[1] for n in SHIPPED):
            of = with_values(driven, {p: x for p, x in begin.items() if not p.startswith("drive")})
            fits.append(judging._fitted(of, recording, DRIVES, columns, False, None, begin, others=False))
        best = min(fits, key=lambda fit: sum(fit.nrmse.values()))
        cells = [errors(found.judged[-1].nrmse)]
        cells.append(errors(judging.Judged.of(recording, "current", "", best.validate(recording.data), until).nrmse))
        half = found.fits["current"].values
        for of, move in (("drive.{}.scale", 0.01), ("link.{}.joint.coulomb", 0.01), ("drive.{}.offset", None)):
            steps = []
            for k in (0, 1):
                step = half[of.format(k)] * move if move else 0.005 * half[f"drive.{k}.scale"]
                ends = [compared(with_values(driven, half | {of.format(k): half[of.format(k)] + sign * step}),
                                 recording, columns) for sign in (-1, 1)]  # fmt: skip
                rows, y = ends[0].measured.t >= until, JOINTS[k]
                apart = (ends[1].simulated[y] - ends[0].simulated[y])[rows] / 2
                steps.append(f"{100 * np.sqrt(np.mean(apart**2)) / ends[0].measured[y][rows].std():.1f}")
            cells.append(", ".join(steps))
        lines.append(f"| {name} | {' | '.join(cells)} |")
        print(lines[-1], flush=True)
        for of, fit in (("the first half", found.fits["current"]), ("all", best)):
            zeros = [f"{-1e3 * fit.values[f'drive.{k}.offset'] / fit.values[f'drive.{k}.scale']:.1f}" for k in (0, 1)]
            print(f"{name}, zeros of the currents by {of}: {', '.join(zeros)} mA", flush=True)
    return "\n".join(lines)


def errors(nrmse: dict[str, float]) -> str:
    return ", ".join(f"{100 * nrmse[k]:.1f}" for k in JOINTS)


def drawn(drives: dict[str, Drive]) -> None:
    """Friction of the second drive over its speed, and over its angle while it stands."""
    import matplotlib.pyplot as plt
    from flexarm.data.draw.style import DPI

    figure, axes = plt.subplots(2, 3, figsize=(10, 6), layout="constrained", sharey="col")
    for (over, under), (name, d) in zip(axes.T, drives.items(), strict=True):
        over.plot(d.v, d.friction, ".", markersize=2.5)
        over.set(title=f"{name}, joint 2", xlabel="speed (rad/s)", ylabel="friction (N m)")
        for rows in d.standing():
            own = [x[rows] - x[rows].mean() for x in (d.q, d.friction)]
            under.plot(np.degrees(own[0]), own[1], linewidth=0.8)
        under.set(title="each time that it stands", xlabel="angle less its mean (deg)",
                  ylabel="friction less its mean (N m)")  # fmt: skip
    figure.savefig(DOCS / "figures" / "validation-friction.png", dpi=DPI * 0.8)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--docs", action="store_true")
    args = parser.parse_args()
    drives = {name: drive(read(name), 1) for name in SHIPPED}
    tables = {"standing": standing(drives)}
    print(tables["standing"], flush=True)
    if args.docs:
        drawn(drives)
    tables["bounds"] = bounds()
    if args.docs:
        for name, table in tables.items():
            replace_table(DOCS / "validation.md", name, table)


if __name__ == "__main__":
    main()
