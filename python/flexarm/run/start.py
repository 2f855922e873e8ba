"""Where a run starts: as numbers, joints by name, or in balance."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from .._check import Array, array, choice, warn
from ..analysis.assembly import closed_start
from ..analysis.equilibrium import StateWarning, steady_state
from ..arm.arm import Arm
from ..arm.variation import OF_ARM, Setup
from ..model.acting.drive import Motion, split_drives, voltage_forces
from ..model.acting.load import Load, at_time, pushes
from .held import acting as acting
from .held import held

WORDS = ("equilibrium", "trim", "held")
NEAR = 0.02  # of the sag: a start that is as near is in balance, and something more


def start(
    arm: Arm, q0: Any, drive: Mapping[Any, Any] | None, loads: Sequence[Load] | None, t: float, tau: Any = None,
    control: Any = None,
) -> Array:  # fmt: skip
    """q (nq,) of a q0: numbers, joints by name, or where the arm is in balance at time t (s), "held" by `control`; zero
    if None. Of an arm with rigid loops, joints that are not named, nor moved by a motion, close them.

    Raises:
        ValueError: bad numbers or names, or no balance was found.
    """
    if not isinstance(q0, str):
        q = arm._place("q0", q0)
        if not arm.constrained or not (q0 is None or isinstance(q0, Mapping)):
            return q
        q, rates, fixed = moved(arm, q, np.zeros(arm.nv), drive, t)
        named = [i for key in q0 or () for i in arm.joint_rates(key)]
        return closed_start(arm, q, 0.0 * rates, (False, True), fixed, named)[0]
    if choice("q0", q0, WORDS) != "equilibrium":
        arm.refuse_loops(f"q0 = {q0!r}", rigid=True)
    if q0 == "held":
        return held(Setup(arm, dict(drive or {}), tuple(loads or ()), control), t, tau).q
    word, loads = q0, (*(loads or ()), *pushes(arm, drive))
    places = {key: float(law(t)[0]) for key, law in (drive or {}).items() if isinstance(law, Motion)}
    pose = arm.pose(places)
    forces, volts = acting(arm, drive or {}, t)
    if word == "trim":
        return arm.trim(pose, loads=loads, t=t, voltages=volts or None).q
    forces = forces if tau is None else forces + array("tau", tau, (arm.nv,))
    return arm.equilibrium(pose, forces, list(places), loads=loads, t=t, voltages=volts or None)


def state(
    arm: Arm, q0: Any, v0: Any, drive: Mapping[Any, Any] | None, loads: Sequence[Load] | None, t: float,
    control: Any = None,
) -> tuple[Array, Array]:  # fmt: skip
    """q (nq,) and v (nv,) at time t (s); joints whose motion is prescribed are where that is."""
    q = np.array(start(arm, q0, drive, loads, t, None, control))
    v = np.zeros(arm.nv) if v0 is None else np.array(v0, dtype=float)
    q, v, fixed = moved(arm, q, v, drive, t)
    return closed_start(arm, q, v, (True, v0 is not None), fixed)


def moved(
    arm: Arm, q: Array, v: Array, drive: Mapping[Any, Any] | None, t: float
) -> tuple[Array, Array, list[int]]:  # fmt: skip
    """q and v with the joints whose motion is prescribed where that is at time t (s), and their rates."""
    q, v, fixed = np.array(q), np.array(v), list[int]()
    for i, law in arm.by_rate("drive", split_drives(arm, drive)[0]).items():
        if isinstance(law, Motion):
            q[arm.coordinate_of(i)], v[i] = law(t)[:2]
            fixed.append(i)
    return q, v, fixed


def sagging(
    arm: Arm, q: Array, v: Array, drive: Mapping[Any, Any] | None, loads: Sequence[Load] | None, t: float
) -> tuple[Array, float]:
    """q with its elastic coordinates in balance at constant rates v, and how far off they are, over the sag, in the
    norm of the elastic energy: inf where nothing sags.

    Raises:
        ValueError: no balance was found.
    """
    volts = voltage_forces(arm, acting(arm, drive or {}, t)[1])
    sag = steady_state(arm, q, v, at_time(arm, [*(loads or ()), *pushes(arm, drive)], t), volts)
    size = off = 0.0
    for _, beam, at, _ in arm.beams():
        K = np.asarray(beam._core.stiffness)
        size, off = size + float(sag[at] @ K @ sag[at]), off + float((q - sag)[at] @ K @ (q - sag)[at])
    return sag, float(np.sqrt(off / size)) if size > 0.0 else np.inf


def check_one_start(q0: Any, paths: Iterable[str]) -> None:
    """ValueError where a q0 that is a word, and one of these parameters, say where a run begins."""
    named = [path for path in paths if isinstance(q0, str) and path.split(".")[0] == "q0"]
    if named:
        raise ValueError(f"parameters: '{named[0]}' and q0 = {q0!r} both say where the run begins; leave one out")


def warn_of_one_balance(
    arm: Arm, q0: Any, drive: Mapping[Any, Any] | None, loads: Sequence[Load] | None, t: float, paths: Iterable[str]
) -> None:
    """StateWarning where runs that differ in these parameters all start from the balance of one of them."""
    varied = [path for path in paths if path.split(".")[0] in (*OF_ARM, "load")]
    if q0 is None or isinstance(q0, (str, Mapping)) or np.ndim(q0) != 1 or not varied:
        return
    q, v = state(arm, q0, None, drive, loads, t)
    try:
        distance = sagging(arm, q, v, drive, loads, t)[1]
    except ValueError:
        return
    if distance < NEAR:
        warn(
            f"q0: is in balance with the numbers of the arm that is given; with another '{varied[0]}' it is not, and "
            'vibrates at once; q0 = "trim" (or "equilibrium") is the balance of each run',
            StateWarning,
        )

