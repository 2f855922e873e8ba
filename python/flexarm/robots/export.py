"""Arm.to_mjcf and Arm.to_urdf."""

from __future__ import annotations

import warnings
from typing import Any

from .._check import named
from ..data.store.files import write_whole
from ..model.parts.chain import Chain
from .segments import Segmented, segmented
from .tree import RobotWarning
from .write import WORLD, missing_features, mjcf, urdf

_NEAR = 0.01
_BOTH = {
    "stiction": "stiction above dry friction",
    "limit_stiffness": "stiffness and damping of soft stops (the range is written)",
}
_MJCF = {**_BOTH, "name": "names of fixed joints"}
_URDF = {**_BOTH, "stiffness": "springs, but for Gazebo", "reflected_inertia": "reflected inertia"}


def to_mjcf(arm: Chain, path: Any, segments: int) -> str:
    """See Arm.to_mjcf."""
    cut = segmented(arm, segments)
    name = [f"the name '{WORLD}' of a link, which is the base's: '{WORLD}_' there"] if WORLD in cut.names else []
    return _written(path, ".xml", mjcf(cut), cut, missing_features(cut, _MJCF) + name)


def to_urdf(arm: Chain, path: Any, segments: int) -> str:
    """See Arm.to_urdf."""
    cut = segmented(arm, segments)
    gravity = ["gravity: URDF has none"] if any(arm.gravity) else []
    return _written(path, ".urdf", urdf(cut), cut, missing_features(cut, _URDF) + gravity)


def _written(path: Any, suffix: str, text: str, cut: Segmented, left_out: list[str]) -> str:
    if path is not None:
        content = text.encode()
        write_whole(named(path, suffix), lambda f: f.write(content), "path")
    if cut.error > _NEAR:
        worst = max(range(len(cut.wanted)), key=lambda k: abs(cut.frequencies[k] / cut.wanted[k] - 1))
        left_out.append(
            f"frequency {worst + 1} of the arm: {cut.wanted[worst]:.6g} rad/s, of the segments "
            f"{cut.frequencies[worst]:.6g}; take more segments, or see whether the arm has modes enough"
        )
    if left_out:
        said = "\n".join(f"  - {line}" for line in left_out)
        warnings.warn(f"the file does not have\n{said}", RobotWarning, stacklevel=4)
    return text
