"""Other models of the measured arm, fitted and judged as flexarm's is: for the table in docs/validation.md.

Each has its arm fitted to two recordings, its set-up (zeros, gains, cable) to the first half of the third, and is
judged by the deflections of the second half, joints moved as measured.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import mujoco
import numpy as np
from flexarm.identify.validate.rig import DEFLECTIONS, JOINTS, SHIPPED, Recording, read
from flexarm.identify.validate.validate import _NOISE
from mujoco import rollout
from scipy.optimize import least_squares
from scipy.signal import lfilter

STEP = 0.004  # s
EVERY = round(0.02 / STEP)  # steps for each row of a recording
SET_UP = {"zero": (0.0, 0.5), "gain1": (1.0, 0.2), "gain2": (1.0, 0.2), "offset1": (0.0, 5e-3), "offset2": (0.0, 5e-3),
          "cable": (1.0, 0.7), "length": (1.0, 0.05)}  #: start and standard deviation, as in PER_RUN  # fmt: skip
ZEROS = {"lqr": -0.7}  # rad, where the search for the second joint's zero begins; else 0
Values = dict[str, float]
Model = Callable[[Recording, Values], np.ndarray]  #: (the recording, numbers) -> bending in rad every STEP, (n, 2)


def low_pass(x: np.ndarray) -> np.ndarray:
    """The rig's filter of 2 Hz with damping ratio 0.9, by the bilinear transform."""
    w, zeta = np.tan(np.pi * 2.0 * STEP), 0.9
    a = np.array([1 + 2 * zeta * w + w**2, 2 * (w**2 - 1), 1 - 2 * zeta * w + w**2])
    return np.asarray(lfilter(w**2 * np.array([1.0, 2.0, 1.0]), a, x, axis=0))


@cache
def moved(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Times every STEP, and the smoothed angles of both joints, (n, 2)."""
    recording = read(name)
    t = np.arange(0.0, recording.data.t[-1] + 0.5 * STEP, STEP)
    laws = [recording.motion(j) for j in JOINTS]
    return t, np.array([[law(x)[0] for law in laws] for x in t])


def reading(recording: Recording, bent: np.ndarray, own: Values) -> np.ndarray:
    """What the gauges tell, tared as in the recording, at its rows, (nt, 2)."""
    t, out = moved(recording.name)[0], np.array(bent)
    for k, tare in enumerate(recording.tares):
        if dead := int(np.sum(t < tare)):
            out[dead:, k] -= out[:dead, k].mean()
            out[:dead, k] = 0.0
    start = out[0]
    out = start + low_pass(out - start)
    gains, offsets = (np.array([own[f"{x}{k}"] for k in (1, 2)]) for x in ("gain", "offset"))
    return np.asarray((out * gains + offsets)[::EVERY][: len(recording.data)])


def measured(recording: Recording) -> np.ndarray:
    return np.array([recording.data[name] for name in DEFLECTIONS]).T


def solved(
    model: Model, names: Sequence[str], arm: dict[str, float], free: bool, half: bool, own: Sequence[str]
) -> Values:
    """Numbers of the arm (if `free`) and set-ups of recordings, by least squares of the readings."""
    recordings = [read(n) for n in names]
    start = dict(arm) if free else {}
    for r in recordings:
        start |= {f"{r.name} {k}": ZEROS.get(r.name, 0.0) if k == "zero" else SET_UP[k][0] for k in own}
    size = {k: SET_UP[k.split(" ")[1]][1] if " " in k else abs(x) for k, x in start.items()}
    low = [0.0 if " " not in k else -np.inf for k in start]

    def residuals(z: np.ndarray) -> np.ndarray:
        values = {**arm, **{k: float(x) * size[k] for k, x in zip(start, z, strict=True)}}
        rows = [(z[i] * size[k] - start[k]) / size[k] for i, k in enumerate(start) if " " in k]
        out = [np.array(rows)]
        for r in recordings:
            until = len(r.data) // 2 if half else None
            here = {**{k: x for k, (x, _) in SET_UP.items()}, **values}
            here |= {k.split(" ")[1]: x for k, x in values.items() if k.startswith(f"{r.name} ")}
            e = (reading(r, model(r, here), here) - measured(r)) / _NOISE[DEFLECTIONS[0]]
            out.append(np.nan_to_num(e[:until], nan=1e3, posinf=1e3, neginf=-1e3).clip(-1e3, 1e3).ravel())
        return np.concatenate(out)

    z0 = np.array([start[k] / size[k] for k in start])
    z = least_squares(residuals, z0, bounds=(low, np.inf), max_nfev=25, diff_step=1e-4).x
    return {**arm, **{k: float(x) * size[k] for k, x in zip(start, z, strict=True)}}


def judged(
    model: Model, arm: dict[str, float], own: Sequence[str] = tuple(SET_UP), fitted: bool = True
) -> dict[str, list[float]]:
    """By the recording that is left out, NRMSE of both deflections in its second half (1)."""
    found = {}
    for name in SHIPPED:
        others = [n for n in SHIPPED if n != name]
        values = solved(model, others, arm, True, False, own) if fitted else arm
        values = solved(model, [name], {k: values[k] for k in arm}, False, True, own)
        r = read(name)
        here = {**{k: x for k, (x, _) in SET_UP.items()}, **values}
        here |= {k.split(" ")[1]: x for k, x in values.items() if " " in k}
        found[name] = error(r, reading(r, model(r, here), here))
    return found


def error(recording: Recording, y: np.ndarray) -> list[float]:
    rows = recording.judged & (recording.data.t >= recording.data.t[-1] / 2)
    x = measured(recording)[rows]
    return list(np.sqrt(np.mean((y[rows] - x) ** 2, axis=0)) / x.std(axis=0))


# -- MuJoCo: a hinge with a spring in each strip -----------------------------------------------------------------------

_L = 0.202  # m, of both strips
_XML = """
<mujoco><option timestep="{step}" gravity="0 0 0"/><worldbody><site name="world" pos="0.33 -1 0"/>
<body><joint name="joint1" axis="0 0 1" armature="1e6"/><inertial pos="0 0 0" mass="0.01" diaginertia="1e-3 1e-3 1e-3"/>
<body pos="{clamp} 0 0"><joint name="strip1" axis="0 0 1" stiffness="1"/>
<inertial pos="{com} 0 0" mass="1.4" diaginertia="2e-3 2e-3 2e-3"/><site name="end" pos="{end} 0 0"/>
<body pos="{end} 0 0"><joint name="joint2" axis="0 0 1" armature="1e6"/>
<inertial pos="0 0 0" mass="0.01" diaginertia="5e-4 5e-4 5e-4"/>
<body pos="{clamp} 0 0"><joint name="strip2" axis="0 0 1" stiffness="1"/>
<inertial pos="{far} 0 0" mass="0.157" diaginertia="3.2e-5 3.2e-5 3.2e-5"/></body></body></body></body></worldbody>
<tendon><spatial name="cable" springlength="0 1.13" stiffness="15">
<site site="world"/><site site="end"/></spatial></tendon>
<actuator><motor joint="joint1"/><motor joint="joint2"/></actuator></mujoco>
""".format(step=STEP, clamp=0.079 + _L / 3, com=_L * 2 / 3 + 0.05, end=_L * 2 / 3 + 0.079, far=_L * 2 / 3)
_ARM = {"stiffness1": 27.0, "stiffness2": 4.6, "damping1": 0.02, "damping2": 0.004, "mass": 1.3}
_ARM_RIGID = {k: _ARM[k] for k in ("mass", "stiffness1", "stiffness2")}


class Hinges:
    """MuJoCo's arm: strips are rigid with a hinge a third of their length beyond the clamp, about which a cantilever's
    end moves. Joints follow the recording: the force on their armature makes MuJoCo's step repeat its positions."""

    def __init__(self) -> None:
        self.model = mujoco.MjModel.from_xml_string(_XML)
        self.data = mujoco.MjData(self.model)

    def __call__(self, recording: Recording, x: Values) -> np.ndarray:
        m, q = self.model, moved(recording.name)[1] + [0.0, x["zero"]]
        m.jnt_stiffness[:] = [0, x["stiffness1"], 0, x["stiffness2"]]
        m.dof_damping[:] = [0, x["damping1"], 0, x["damping2"]]
        m.body_mass[2] = x["mass"]
        m.tendon_stiffness[0], m.tendon_lengthspring[0] = 15.0 * x["cable"], [0.0, 1.13 * x["length"]]
        m.tendon_damping[0] = x.get("rope", 0.0)
        v = np.diff(q, axis=0) / STEP
        a = np.diff(v, axis=0) / STEP
        state = np.zeros(1 + m.nq + m.nv)
        state[1:5:2], state[5::2] = q[0], v[0]
        state[[1, 3]], state[[5, 7]] = q[1], v[0]
        told, _ = rollout.rollout(m, self.data, state, control=1e6 * a)
        bent = np.asarray(told)[0][:, [2, 4]]
        return np.vstack([np.zeros((len(q) - len(bent), 2)), bent])


# -- a rigid arm: the bending is the moment at the strip's root, over its stiffness ------------------------------------


def rigid(recording: Recording, x: Values) -> np.ndarray:
    q = moved(recording.name)[1]
    v, a = np.gradient(q, STEP, axis=0), np.gradient(np.gradient(q, STEP, axis=0), STEP, axis=0)
    turn1, turn2 = q[:, 0], q[:, 0] + q[:, 1] + x["zero"]
    E1, E2 = np.exp(1j * turn1), np.exp(1j * turn2)
    w1, w2, a1, a2 = v[:, 0], v.sum(axis=1), a[:, 0], a.sum(axis=1)
    root1, com1, end1, root2, end2 = 0.079, 0.331, 0.36, 0.079, 0.281
    f1 = x["mass"] * com1 * E1 * (1j * a1 - w1**2)
    f2 = 0.157 * (end1 * E1 * (1j * a1 - w1**2) + end2 * E2 * (1j * a2 - w2**2))
    place = end1 * E1 + end2 * E2
    moment1 = -(np.conj((com1 - root1) * E1) * f1 + np.conj(place - root1 * E1) * f2).imag - 2e-3 * a1
    moment2 = -(np.conj((end2 - root2) * E2) * f2).imag - 3.2e-5 * a2
    y = end1 * E1 - (0.33 - 1j)
    pull = 15.0 * x["cable"] * np.maximum(np.abs(y) - 1.13 * x["length"], 0.0) * y / np.abs(y)
    moment1 -= (np.conj((end1 - root1) * E1) * pull).imag
    return np.array([moment1 / x["stiffness1"], moment2 / x["stiffness2"]]).T


# -- the manufacturer's own: two stages that do not know of each other, with its numbers ------------------------------


def quanser(recording: Recording, x: Values) -> np.ndarray:
    t, q = moved(recording.name)
    out = np.zeros_like(q)
    for k, (inertia, stiffness, damping) in enumerate(((0.17043, 39.96, 0.0), (0.0064, 6.858, 0.0856))):
        a = np.gradient(np.gradient(q[:, k], STEP), STEP)
        v = np.gradient(q[:, k], STEP)
        y = w = 0.0
        for i in range(len(t)):
            w += STEP * (-a[i] - (stiffness * y + damping * (w + v[i])) / inertia)
            y += STEP * w
            out[i, k] = y
    return out


# -- ARX of the same order ---------------------------------------------------------------------------------------------


def arx(order: int = 6, every: int = 2) -> dict[str, list[float]]:
    """Both deflections from their last `order` values and those of both accelerations of the joints, by least squares;
    12 states, as flexarm's model has. Then a run of it; zeros and gains of the gauges from the first half."""

    def series(name: str) -> tuple[Recording, np.ndarray, np.ndarray]:
        r = read(name)
        q = moved(name)[1]
        a = np.gradient(np.gradient(q, STEP, axis=0), STEP, axis=0)[::EVERY][: len(r.data)]
        return r, measured(r)[::every], a[::every]

    def rows(y: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.array([before(y, u, i) for i in range(order, len(y))]), y[order:]

    def before(y: np.ndarray, u: np.ndarray, i: int) -> np.ndarray:
        return np.concatenate([y[i - order : i].ravel(), u[i - order : i + 1].ravel(), [1.0]])

    found = {}
    for name in SHIPPED:
        others = [series(n) for n in SHIPPED if n != name]
        X, Y = zip(*[rows(y[r.judged[::every]], u[r.judged[::every]]) for r, y, u in others], strict=True)
        B = np.linalg.lstsq(np.vstack(X), np.vstack(Y), rcond=None)[0]
        r, y, u = series(name)
        ran = np.array(y)
        for i in range(order + int(np.argmax(r.judged[::every])), len(y)):
            ran[i] = before(ran, u, i) @ B
        half, t = len(y) // 2, np.arange(len(r.data))
        for k in range(2):
            A = np.stack([ran[:, k], np.ones(len(ran))], axis=1)
            ran[:, k] = A @ np.linalg.lstsq(A[:half], y[:half, k], rcond=None)[0]
        fine = np.array([np.interp(t, t[::every], ran[:, k]) for k in range(2)]).T
        found[name] = error(r, fine)
    return found


def rivals() -> dict[str, dict[str, list[float]]]:
    """By model, the errors of the recordings that were left out."""
    hinges = Hinges()
    no_cable = tuple(k for k in SET_UP if k not in ("cable", "length"))
    gauges = tuple(k for k in no_cable if k != "zero")
    return {
        "MuJoCo, a hinge with a spring and a damper in each strip, and the cable": judged(hinges, _ARM | {"rope": 0.3}),
        "the rigid arm, its moments over the stiffness of the strips": judged(rigid, _ARM_RIGID),
        "ARX of 12 states": arx(),
        "the manufacturer's model with its own numbers": judged(quanser, {}, gauges, fitted=False),
    }


if __name__ == "__main__":
    for model, found in rivals().items():
        print(f"{model}: " + "; ".join(f"{n} {100 * a:.1f}, {100 * b:.1f}" for n, (a, b) in found.items()), flush=True)
