"""The picture of docs/viewing.md of robots with their meshes: a UR5 whose forearm bends, and a Panda.

    pip install 'flexarm[urdf,view]' example-robot-data
    python bench/view/robots.py [--data DIR]

The robots are those of the package example-robot-data (BSD; the Panda's meshes: Apache 2.0). Writes
docs/figures/viewing-robots.png, by matplotlib.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import warnings
from pathlib import Path

import flexarm as fa
from PIL import Image

FIGURE = Path(__file__).parents[2] / "docs" / "figures" / "viewing-robots.png"
INSTALLED = Path(sys.prefix) / "lib" / f"python{sys.version_info[0]}.{sys.version_info[1]}" / "site-packages"


def ur5(folder: Path) -> fa.results.View:
    """Its forearm is a tube of aluminium, bent."""
    tube = fa.Beam(0.39225, fa.Tube(0.035, 0.002), fa.Material(2700, 70e9, 0.33), {"bending_y": 2, "bending_z": 2})
    arm = fa.from_urdf(folder / "ur_description/urdf/ur5_robot.urdf", tip="tool0", flexible={"forearm_link": tube})
    q = arm.pose({name: x for name, x in zip(POSED, (0.3, -1.1, 1.1, 0.2, 0.4, 0.0), strict=True)})
    return arm.show(arm.equilibrium(q, lock=POSED), magnify=100, open=False)


POSED = [f"{name}_joint" for name in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")]


def panda(folder: Path) -> fa.results.View:
    arm = fa.from_urdf(folder / "panda_description/urdf/panda.urdf", tip="panda_hand_tcp")
    return arm.show([0.3, 0.3, 0, -1.8, 0, 2, 0.5], open=False)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=INSTALLED / "cmeel.prefix/share/example-robot-data/robots")
    folder = parser.parse_args().data
    warnings.simplefilter("ignore", fa.errors.RobotWarning)
    parts = []
    with tempfile.TemporaryDirectory() as place:
        for name, make in (("ur5", ur5), ("panda", panda)):
            file = Path(place) / f"{name}.png"
            make(folder).save(file, size=(5.0, 4.2))
            parts.append(Image.open(file).convert("RGB"))
    both = Image.new("RGB", (sum(p.width for p in parts), parts[0].height), "white")
    for k, part in enumerate(parts):
        both.paste(part, (k * part.width, 0))
    both.save(FIGURE, optimize=True)


if __name__ == "__main__":
    main()
