"""The moves of a scene once more, with shaped and with inverted commands."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from ..command.inversion.invert import invert
from ..command.joint_limits import freedoms
from ..model.acting.control import PD
from ..model.acting.drive import Motion, Torque
from ..model.acting.shaping import input_shaper
from ..run.scene.scene import Scene

SHAPER, INVERSION = "Shaper", "Inversion"
_ROWS = 200  # samples of an inverted motion


def moves(scene: Scene) -> dict[int, Motion]:
    """By rate, the motions that joints of a scene make, or that their PD laws follow."""
    found = {}
    for key, law in scene.drive.items():
        if isinstance(law, Motion) and not law.constant:
            found[scene.arm.joint_rate(key, "drive")] = law
    for one in scene.control:
        if isinstance(one, PD) and isinstance(one.reference, Motion) and not one.reference.constant:
            found[one._rate(scene.arm)] = one.reference
    return found


def _with_moves(scene: Scene, made: dict[int, Motion], end: float, torques: dict[Any, Torque]) -> Scene:
    """The scene with other motions, up to another time, and torques of joints that are fed forward."""

    def of(rate: int, law: Any) -> Any:
        return made[rate] if isinstance(law, Motion) and rate in made else law

    drive = {key: of(scene.arm.joint_rate(key, "drive"), law) if isinstance(law, Motion) else law
             for key, law in scene.drive.items()}  # fmt: skip
    control = []
    for one in scene.control:
        one = copy(one)
        if isinstance(one, PD):
            one.reference = of(one._rate(scene.arm), one.reference)
        control.append(one)
    times = np.append(scene.t[scene.t < end], end)
    return replace(scene, drive={**drive, **torques}, control=tuple(control), t=times)


def shaped(scene: Scene) -> Scene:
    """The moves behind a ZV shaper of each of the lowest modes, as many as joints move, with these joints held in the
    middle of their ways.

    Raises:
        ValueError: no move, or none that begins at rest; an arm without vibration.
    """
    found = _some(scene)
    arm, q = scene.arm, scene.start()
    for rate, motion in found.items():
        way = [motion(float(t))[0] for t in np.linspace(scene.t[0], scene.t[-1], 101)]
        q[arm.coordinate_of(rate)] = (min(way) + max(way)) / 2
    held = [key for key, rate in freedoms(arm).items() if rate in found]
    modes = arm.modes(q, lock=held)
    used = [(w, z) for w, z in zip(modes.frequencies, modes.damping, strict=True) if w > 0 and z < 1][: len(found)]
    if not used:
        raise ValueError("the arm does not vibrate where its joints are held")
    shaper = input_shaper("zv", *used[0])
    for mode in used[1:]:
        shaper = shaper * input_shaper("zv", *mode)
    made = {rate: shaper.shape(motion) for rate, motion in found.items()}
    return _with_moves(scene, made, float(scene.t[-1]) + shaper.duration, {})


def inverted(scene: Scene) -> Scene:
    """The moves by which the arm's end goes the way that it would go if no beam bent: motions, and where controllers
    follow them, torques that are fed forward.

    Raises:
        ValueError: no move; a way of the end that the moving joints do not determine, or that cannot be inverted.
    """
    found = _some(scene)
    arm, begin, end = scene.arm, float(scene.t[0]), float(scene.t[-1])
    times = np.linspace(begin, end, 201)
    q = np.repeat(scene.start()[None], len(times), axis=0)
    for _, _, at, _ in arm.beams():
        q[:, at] = 0.0
    for rate, motion in found.items():
        q[:, arm.coordinate_of(rate)] = [motion(float(t))[0] for t in times]
    way = arm.frame(q)[0]
    names = [k for k in range(3) if np.ptp(way[:, k]) > 1e-6 * np.ptp(way)]
    if len(found) == 1 and names == [0, 1]:
        path = {"azimuth": Motion(times, np.unwrap(np.arctan2(way[:, 1], way[:, 0])), ends="rest")}
    elif len(names) > len(found):
        raise ValueError(f"{len(found)} joints move, and the end moves along {len(names)} axes")
    else:
        path = {"xyz"[k]: Motion(times, way[:, k], ends="rest") for k in names}
    joints = {rate: key for key, rate in freedoms(arm).items()}
    held = [key for rate, key in joints.items() if rate not in found]
    inverse = invert(arm, path, q=q[0], lock=held)
    rows = np.unique(np.linspace(0, len(inverse.t) - 1, _ROWS).round().astype(int))
    t = inverse.t[rows] - inverse.t[0] + begin
    made = {
        rate: Motion(t, inverse.q[rows, arm.coordinate_of(rate)], inverse.v[rows, rate], inverse.a[rows, rate])
        for rate in found
    }
    followed = {one._rate(arm) for one in scene.control if isinstance(one, PD)}
    fed = {joints[rate]: Torque(t, inverse.tau[rows, rate]) for rate in found if rate in followed}
    return _with_moves(scene, made, float(t[-1]), fed)


def _some(scene: Scene) -> dict[int, Motion]:
    found = moves(scene)
    if not found:
        raise ValueError("no joint makes, and no PD follows, a motion")
    return found
