"""Where to bond a piezo patch on the paper's link, and how many shape functions follow its stiffness.

    python bench/analysis/placement.py [-o DIR]

Writes into DIR (default: here) placement.csv and placement.png: authority of a pair of PZT plates, 50 mm x 20 mm x
0.2 mm, on the first three modes over its place, hub held and hub free (with 2e-3 kg m^2), from `fa.place_patch`; and
patch_shapes.csv and patch_shapes.png: what one beam, and three beams joined rigidly at the patch's ends, have wrong of
the static tip at one volt (closed form) and of three frequencies (the three beams, with many shape functions).
"""

from __future__ import annotations

import csv
import platform
import sys
from pathlib import Path
from typing import Any

import flexarm as fa
import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.ticker import NullFormatter

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from reporting import output_folder

STEEL = fa.Material(7850, 209e9, 0.3)
PZT = fa.Piezo(youngs_modulus=60.6e9, poisson_ratio=0.3, density=7500, d31=-274e-12, permittivity=3e-8)
PAIR = fa.Patch(start=0.02, end=0.07, width=0.02, thickness=0.2e-3, material=PZT)
L, H, B = 0.5, 1e-3, 0.02
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")


def strip(n: int, *patches: fa.Patch, basis: str = "legendre", length: float = L, joint: Any = None) -> fa.Link:
    hub = fa.RigidBody(0.1, inertia=(2e-3, 2e-3, 2e-3), end=(0.075, 0, 0)) if joint else None
    beam = fa.Beam(length, fa.Rectangle(H, B), STEEL, {"bending_y": n}, basis, rotary_inertia=False, patches=patches)
    return fa.Link(joint or fa.Fixed(), hub, beam)


def split(n: int, patch: fa.Patch) -> fa.Arm:
    """The clamped strip in three beams, which meet at the patch's ends."""
    return fa.Arm(fa.split(strip(n, patch), n))


def places(out: Path, head: str) -> None:
    arm = fa.Arm([strip(12, joint=fa.Revolute("z"))])
    cases = {"hub held": fa.place_patch(arm, patch=PAIR), "hub free": fa.place_patch(arm, patch=PAIR, lock=[])}
    with (out / "placement.csv").open("w", newline="") as f:
        f.write(head)
        writer = csv.writer(f)
        writer.writerow(["centre (m)", *(f"{c}, mode {k} (m/V)" for c in cases for k in range(3))])
        rows = np.column_stack([cases["hub held"].x, *(p.authority for p in cases.values())])
        writer.writerows([[f"{v:.6g}" for v in row] for row in rows])
    figure, axes = plt.subplots(2, 2, figsize=(9.5, 5.6), sharex=True, height_ratios=(3, 2), layout="constrained")
    for (top, below), (name, p) in zip(axes.T, cases.items(), strict=True):
        print(f"\n{name}: {p}")
        for k, w in enumerate(p.frequencies):
            single = fa.place_patch(arm, patch=PAIR, lock=None if name == "hub held" else [], weights=np.eye(3)[k])
            print(f"best for mode {k} alone: from {1e3 * single.best:.2f} mm, {single.best_authority[k]:.4g} m/V")
            relative = p.authority[:, k] / np.abs(p.authority[:, k]).max()
            top.plot(1e3 * p.x, relative, color=COLOURS[k], label=f"mode {k}, {w:.4g} rad/s")
        below.plot(1e3 * p.x, p.merit, color="#333333")
        below.plot(1e3 * (p.patch.start + p.patch.end) / 2, p.best_merit, "o", color="#333333")
        for ax in (top, below):
            ax.axvspan(1e3 * p.patch.start, 1e3 * p.patch.end, color="#EEEEEE", zorder=0, label="best place")
            ax.grid(alpha=0.3)
        top.axhline(0, color="#333333", lw=0.6)
        top.set_title(name, fontsize=10)
        top.legend(fontsize=8, title="modes count from 0", title_fontsize=8)
        below.set(xlabel="centre of the patch from the clamp (mm)", ylim=(0, 1.05))
    axes[0, 0].set_ylabel("authority / its greatest")
    axes[1, 0].set_ylabel("mean of the three,\nwithout signs")
    figure.savefig(out / "placement.png", dpi=110)


def followed(out: Path, head: str) -> None:
    stiff = STEEL.youngs_modulus * B * H**3 / 12
    added = 2 * PZT.youngs_modulus * B * ((H / 2 + PAIR.thickness) ** 3 - (H / 2) ** 3) / 3
    moment = -PZT.youngs_modulus * PZT.d31 * B * (H + PAIR.thickness)
    tip = moment / (stiff + added) * 0.05 * (L - 0.045)
    truth = split(16, PAIR).modes().frequencies[:3]
    kinds = {
        "one beam, clamped-free": (
            [2, 3, 4, 6, 8, 12, 16, 24],
            lambda n: fa.Arm([strip(n, PAIR, basis="clamped-free")]),
        ),
        "one beam, legendre": ([2, 3, 4, 6, 8, 12, 16, 24, 32], lambda n: fa.Arm([strip(n, PAIR)])),
        "three beams, legendre": ([1, 2, 3, 4, 5, 6, 8, 10], lambda n: split(n, PAIR)),
    }
    rows = []
    for name, (counts, make) in kinds.items():
        for n in counts:
            arm = make(n)
            y = arm.frame(arm.equilibrium(voltages=[1.0]))[0][1]
            off = np.full(3, np.nan)
            found = arm.modes().frequencies[:3]
            off[: len(found)] = np.abs(found / truth[: len(found)] - 1)
            rows.append([name, arm.nv, abs(y / tip - 1), *off])
    with (out / "patch_shapes.csv").open("w", newline="") as f:
        f.write(head)
        writer = csv.writer(f)
        writer.writerow(["model", "coordinates", "tip", "mode 0", "mode 1", "mode 2"])
        writer.writerows([[v if isinstance(v, (str, int)) else f"{v:.3g}" for v in row] for row in rows])
    print("\nrelative errors: tip, modes 0 to 2")
    for row in rows:
        print(f"{row[0]:24s} {row[1]:4d}  " + "  ".join(f"{v:9.2e}" for v in row[2:]))
    figure, axes = plt.subplots(1, 2, figsize=(9.5, 3.8), sharey=True, layout="constrained")
    for ax, column, title in ((axes[0], 2, "static tip at one volt"), (axes[1], 3, "first frequency")):
        for colour, name in zip(COLOURS, kinds, strict=False):
            mine = [r for r in rows if r[0] == name and r[1] > 1 and r[column] > 1e-11]
            ax.loglog([r[1] for r in mine], [r[column] for r in mine], "o-", ms=4, color=colour, label=name)
        ax.set(xlabel="elastic coordinates", title=title, ylim=(1e-11, 1))
        ax.title.set_fontsize(10)
        ax.grid(alpha=0.3)
        ax.xaxis.set_minor_formatter(NullFormatter())
        ax.set_xticks([2, 4, 8, 16, 32], labels=["2", "4", "8", "16", "32"])
    axes[0].set_ylabel("relative error")
    axes[0].legend(fontsize=8)
    figure.savefig(out / "patch_shapes.png", dpi=110)


def main() -> None:
    out = output_folder(__doc__)
    head = f"# flexarm {fa.__version__}, {platform.machine()}, Python {platform.python_version()}\n"
    places(out, head)
    followed(out, head)


if __name__ == "__main__":
    main()
