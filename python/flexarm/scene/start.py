"""Where a scene starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .._check import Array, choice
from ..acting.drive import Motion
from ..acting.load import Load
from ..acting.voltage import is_patch
from ..arm import Arm

WORDS = ("equilibrium", "trim")


def start(arm: Arm, q0: Any, drive: Mapping[Any, Any], loads: Sequence[Load], t: float) -> Array:
    """q (nq,) of what a file's q0 says: numbers, joints by name, or where the arm is in balance at time t (s).

    Raises:
        ValueError: bad numbers or names, or no balance was found.
    """
    if isinstance(q0, Mapping):
        return arm.pose(q0)
    if not isinstance(q0, str):
        return arm._place("q0", q0)
    word = choice("q0", q0, WORDS)
    moved = {key: float(law(t)[0]) for key, law in drive.items() if isinstance(law, Motion)}
    pose = arm.pose(moved)
    if word == "trim":
        return arm.trim(pose, loads=loads, t=t).q
    tau, volts = np.zeros(arm.nv), {}
    for key, law in drive.items():
        if is_patch(key):
            volts[key[1:]] = float(law(t))
        elif key not in moved:
            tau[arm.joint_rate(key, "drive: link")] = float(law(t))
    return arm.equilibrium(pose, tau, list(moved), loads=loads, t=t, voltages=volts or None)
