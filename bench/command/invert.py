"""Inversion: the paper's link beside computed torque and input shapers, and arms up to seven links in space.

    python bench/command/invert.py [-o DIR]

The tip of the paper's link (scene "ist") turns by 1.5 rad in 0.6 s, two periods of its first mode. Its hub follows the
path itself, as the torque of the rigid link would have it; the path shaped by ZV and ZVD; and the inverse's motion.
Then the times and errors of arms: the tip's largest distance from its path where "ida" (rtol 1e-9) replays the joint
motions, in the model that was inverted (Legendre functions, order 2) and in a finer one: six functions for each
bending, three for torsion, order 3; and, by "implicit", with a payload of 0.22 kg instead of 0.2, and of other methods.
Writes invert.csv, arms.csv and invert.png into DIR (default: here).
"""

from __future__ import annotations

import csv
import os
import platform
import statistics
import sys
import time
import warnings
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from reporting import finish, output_folder

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import flexarm as fa
import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt

COLOURS = {"rigid": "#888888", "zv": "#E69F00", "zvd": "#D55E00", "inverse": "#0072B2"}
NAMES = {"rigid": "computed torque", "zv": "ZV", "zvd": "ZVD", "inverse": "inverse"}
STEEL = fa.Material(7850, 209e9, 0.3)
TURN, TIME, UNTIL = 1.5, 0.6, 1.6


def rise(s: Any) -> Any:
    """From 0 to 1 with four continuous derivatives."""
    return s**5 * (126 - 420 * s + 540 * s**2 - 315 * s**3 + 70 * s**4)


def move(a: float, b: float, T: float) -> fa.Motion:
    t = np.linspace(0.0, T, 101)
    return fa.Motion(t, a + (b - a) * rise(t / T), ends="rest")


# -- the paper's link -------------------------------------------------------------------------------------------------


def resting(motion: fa.Motion, begin: float, end: float) -> fa.Motion:
    """The same motion, at rest before and after its samples."""
    b0, b1 = motion.law.breaks[[0, -1]]

    def law(t: float) -> Any:
        q, v, a = motion(min(max(t, b0), b1))
        return (q, v, a) if b0 < t < b1 else (q, 0.0, 0.0)

    t = np.linspace(begin, end, int((end - begin) / 2e-3) + 1)
    return fa.Motion(t, *np.array([law(x) for x in t]).T)


def one_link(out: Path) -> None:
    arm, path = fa.load("ist").arm, move(0.0, TURN, TIME)
    inverse = fa.invert(arm, {"azimuth": path})
    w = arm.modes(lock=[0]).frequencies[0]
    motions, after = {"rigid": path}, {"rigid": 0.0}
    for kind in ("zv", "zvd"):
        shaper = fa.input_shaper(kind, w)
        motions[kind], after[kind] = shaper.shape(path), shaper.duration
    motions["inverse"], after["inverse"] = inverse.motions[0], inverse.post
    t = np.arange(-0.5, UNTIL, 1e-3)
    figure, (a, b, c) = plt.subplots(1, 3, figsize=(10.0, 3.7), layout="constrained")
    wanted = np.array([path(min(max(x, 0.0), TIME))[0] for x in t])
    rows = []
    for name, motion in motions.items():
        run = fa.simulate(arm, t, drive={0: resting(motion, t[0], t[-1])}, rtol=1e-9, atol=1e-11, max_order=5)
        p, _ = run.frame()
        tip = np.unwrap(np.arctan2(p[:, 1], p[:, 0]))
        off = 575 * (tip - wanted)  # mm along the arc
        end = TIME + after[name]
        on_path, later = (t >= 0) & (t <= TIME), t >= (end if name != "inverse" else TIME)
        begin = -inverse.pre if name == "inverse" else 0.0
        row = {"hub": NAMES[name], "begins (s)": f"{begin:.2f}", "ends (s)": f"{end:.2f}"}
        row["off the path (mm)"] = f"{np.abs(off[on_path]).max():.3g}"
        row["rings (mm)"] = f"{np.abs(off[later]).max():.2g}"
        row["peak torque (N m)"] = f"{np.abs(run.tau[:, 0]).max():.3f}"
        rows.append(row)
        look = {"color": COLOURS[name], "label": NAMES[name], "lw": 2.0 if name == "inverse" else 1.2}
        a.plot(t, run.q[:, 0], **look)
        b.plot(t, off, **look)
        c.plot(t, run.tau[:, 0], **look)
    a.plot(t, wanted, "k:", lw=1.4, label="tip, wanted")
    a.set(ylabel="angle (rad)")
    b.set(ylabel="tip off its path (mm)")
    c.set(ylabel="torque of the hub (N m)")
    for ax, title in ((a, "a: the hub"), (b, "b: the tip"), (c, "c: the torque")):
        ax.set_title(title, fontsize=10, loc="left")
        ax.set(xlabel="time (s)", xlim=(-0.3, 1.3))
        ax.axvspan(0, TIME, color="#0072B2", alpha=0.06, lw=0)
    b.legend(*a.get_legend_handles_labels(), frameon=False, fontsize=9, loc="lower right")
    finish(figure, out / "invert.png")
    write(out / "invert.csv", rows)


# -- arms -------------------------------------------------------------------------------------------------------------


def beam_link(axis: str, section: Any, fine: bool, modes: dict[str, int], tip: float = 0.2) -> fa.Link:
    if fine:
        modes = {name: 3 if name == "torsion" else 6 for name in modes}
    return fa.Link(
        fa.Revolute(axis),
        fa.RigidBody(0.3, (0.02, 0, 0), np.eye(3) * 3e-4, (0.05, 0, 0)),
        fa.Beam(0.4, section, fa.Material(2700, 70e9, 0.33), modes, "legendre", 3 if fine else 2),
        fa.RigidBody(tip, inertia=np.eye(3) * 2e-4),
    )


def planar(fine: bool, payload: float) -> fa.Arm:
    sections = fa.Rectangle(0.006, 0.03), fa.Rectangle(0.004, 0.03)
    tips = 0.2, payload
    return fa.Arm([beam_link("z", *of, {"bending_y": 3}, m) for *of, m in zip(sections, [fine] * 2, tips, strict=True)])


def spatial(axes: str, fine: bool, payload: float) -> fa.Arm:
    n, tips = 3 if len(axes) > 3 else 2, [0.2] * (len(axes) - 1) + [payload]
    modes = {"bending_y": n, "bending_z": n, "torsion": 1}
    links = [beam_link(axis, fa.Tube(0.02, 0.017), fine, modes, tip) for axis, tip in zip(axes, tips, strict=True)]
    return fa.Arm(links, (0.0, 0.0, -9.81))


SEVEN = [0.3, -0.6, 0.9, 0.3, 0.7, -0.2, 0.5]
#: how each is made, its joints at the start (rad), by how much its tip moves (m), and the time (s)
ARMS: dict[str, tuple[Any, list[float], tuple[float, ...], float]] = {
    "2 links, plane": (planar, [0.3, 0.9], (-0.3, 0.2), 0.8),
    "3 links, space": (lambda *of: spatial("zyy", *of), [0.2, -0.7, 1.2], (-0.2, 0.5, 0.2), 1.0),
    "7 links, space": (lambda *of: spatial("zyyxyxy", *of), SEVEN, (-0.3, 0.8, 0.4), 2.0),
}


def largest(inverse: fa.results.Inversion, arm: fa.Arm | None = None, **options: Any) -> str:
    return f"{np.linalg.norm(inverse.tip_error(inverse.replay(arm, **options)), axis=1).max():.1e}"


def tried(name: str) -> dict[str, Any]:
    make, joints, by, T = ARMS[name]
    arm, fine, heavy = make(False, 0.2), make(True, 0.2), make(False, 0.22)
    q = arm.zero
    for k, angle in enumerate(joints):
        q[arm.joint_rate(k)] = angle
    p, _ = arm.frame(arm.equilibrium(q, lock=range(len(joints))))
    tip = {axis: move(p[k], p[k] + d, T) for k, (axis, d) in enumerate(zip("xyz", by, strict=False))}
    seconds = []
    for _ in range(9):
        begin = time.process_time()  # of one thread: what else the machine does does not count
        inverse = fa.invert(arm, tip, q=q)
        seconds.append(time.process_time() - begin)
    row: dict[str, Any] = {"arm": name, "coordinates": arm.nv, "path (s)": T, "rows": len(inverse.t)}
    row |= {"ahead (s)": f"{inverse.pre:.2f}", "computing (ms)": f"{1e3 * statistics.median(seconds):.0f}"}
    row |= {"tip off (m)": largest(inverse), "in a finer model (m)": largest(inverse, fine)}
    row["payload + 10 % (m)"] = largest(inverse, heavy, integrator="implicit", step=1e-3)
    for method in ("quasi-static", "rigid"):
        start = {"q": q} if method == "quasi-static" else {"posture": q}
        other = fa.invert(arm, tip, method=method, **start)
        row[f"{method} (m)"] = largest(other, integrator="implicit", step=1e-3)
    return row


def write(path: Path, rows: list[dict[str, Any]]) -> None:
    print("\n".join("  ".join(f"{k}: {v}" for k, v in row.items()) for row in rows))
    with path.open("w", newline="") as f:
        f.write(f"# flexarm {fa.__version__}, {platform.machine()}, Python {platform.python_version()}\n")
        writer = csv.DictWriter(f, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def main() -> None:
    out = output_folder(__doc__)
    warnings.simplefilter("ignore", fa.errors.RangeWarning)
    one_link(out)
    write(out / "arms.csv", [tried(name) for name in ARMS])


if __name__ == "__main__":
    main()
