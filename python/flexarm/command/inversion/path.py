"""The path of a tip: components of its place and orientation over time, at rest before and after."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import numpy as np

import flexarm._core as _core

from ..._check import Array, array
from ...model.acting.drive import Motion
from ...model.parts.chain import Chain

PLACE, TURN = ("x", "y", "z"), ("rx", "ry", "rz")
COMPONENTS = (*PLACE, *TURN, "azimuth")
_STILL = 1e-6  # largest initial and final rate and acceleration, as parts of the path's largest
_LOOKED_AT = 400  # points at which a callable is searched for jumps


class Path:
    """Components of a slice's place and orientation over time.

    Attributes:
        names: of the components, (p,). begin, end: times (s) between which it moves.
    """

    def __init__(self, tip: Any, t: Any) -> None:
        if not isinstance(tip, Mapping) or not tip:
            raise ValueError(
                f"tip = {tip!r}: must be a dictionary such as {{'x': fa.Motion(t, x), 'y': 0.3}}, of {_listed()}"
            )
        for name in tip:
            if name not in COMPONENTS:
                raise ValueError(f"tip: unknown component {name!r}; known are {_listed()}")
        if "azimuth" in tip and ("x" in tip or "y" in tip):
            raise ValueError("tip: 'azimuth' is the direction of x and y: give it, or these")
        self.names = tuple(name for name in COMPONENTS if name in tip)
        self._laws = [_law(f"tip[{name!r}]", tip[name]) for name in self.names]
        moving = [(name, law) for name, law in zip(self.names, self._laws, strict=True) if isinstance(law, Motion)]
        if not moving:
            raise ValueError("tip: at least one component must be a Motion")
        if t is not None and all(isinstance(law.law, _core.PiecewisePolynomial) for _, law in moving):
            raise ValueError("t: is for motions that are callables, and each of the tip's has its own times")
        self._spans = [_span(name, law, t) for name, law in moving]
        self.begin, self.end = min(s[0] for s in self._spans), max(s[1] for s in self._spans)
        self._factor = 1.0
        for (name, law), span in zip(moving, self._spans, strict=True):
            _check(f"tip[{name!r}]", law, span)

    def slowed(self, factor: float) -> Path:
        """The path slowed by a factor, from the same beginning."""
        out = copy.copy(self)
        out._factor, out.end = factor, self.begin + factor * (self.end - self.begin)
        return out

    def __call__(self, t: Array) -> Array:
        """The components at times t (nt,), at rest before and after: (nt, p)."""
        t = self.begin + (t - self.begin) / self._factor
        out, spans = np.empty((len(t), len(self.names))), iter(self._spans)
        for k, law in enumerate(self._laws):
            out[:, k] = [law(x)[0] for x in np.clip(t, *next(spans))] if isinstance(law, Motion) else law
        return out


def _listed() -> str:
    return ", ".join(COMPONENTS)


def _law(where: str, value: Any) -> Motion | float:
    if isinstance(value, Motion):
        return value
    if np.ndim(value) or isinstance(value, (str, bool)) or callable(value):
        raise ValueError(f"{where} = {value!r}: must be a Motion, or a number")
    return float(array(where, value, ()))


def _span(name: str, law: Motion, t: Any) -> tuple[float, float]:
    if isinstance(law.law, _core.PiecewisePolynomial):
        begin, end = law.law.breaks[[0, -1]].tolist()
        return begin, end
    if t is None:
        raise ValueError(f"tip[{name!r}]: is a callable, so t = (begin, end) (s) must say when it moves")
    begin, end = array("t", t, (2,)).tolist()
    if not begin < end:
        raise ValueError(f"t = {t}: must be (begin, end), end after begin")
    return begin, end


def _check(where: str, law: Motion, span: tuple[float, float]) -> None:
    """ValueError where a path starts or ends moving, or jumps."""
    smooth = isinstance(law.law, _core.PiecewisePolynomial)
    times = np.linspace(*span, _LOOKED_AT // 8 if smooth else _LOOKED_AT)
    law.check_rates(where, times)
    values = array(where, [law(x) for x in times], (len(times), 3))
    for order, rate in ((1, "velocity"), (2, "acceleration")):
        largest = np.abs(values[:, order]).max()
        rounding = 1e-9 * np.abs(values[:, 0]).max() / (span[1] - span[0]) ** order
        for at, side in ((0, "starts"), (-1, "ends")):
            if abs(values[at, order]) > _STILL * largest + rounding:
                raise ValueError(
                    f"{where}: {side} with {rate} {values[at, order]:.4g}, which jumps there, so that no bounded, "
                    "continuous torque follows it; let it start and end at rest with zero acceleration, such as "
                    'Motion(t, q, ends="rest")'
                )
    if smooth:
        return  # its acceleration is continuous
    for order, quantity in enumerate(("place", "velocity", "acceleration")):
        found = _jump(law, order, times, values[:, order])
        if found is not None:
            raise ValueError(
                f"{where}: its {quantity} jumps by {found[1]:.4g} at t = {found[0]:.6g} s; place, velocity and "
                "acceleration must be continuous for torques that are bounded and continuous"
            )


def _jump(law: Motion, order: int, times: Array, values: Array) -> tuple[float, float] | None:
    """The place and size of a jump of a function: the largest change between two times, bisected until it vanishes."""
    k = int(np.abs(np.diff(values)).argmax())
    (lo, hi), (a, b) = times[k : k + 2], values[k : k + 2]
    for _ in range(40):
        middle = 0.5 * (lo + hi)
        c = float(law(middle)[order])
        lo, hi, a, b = (lo, middle, a, c) if abs(c - a) > abs(b - c) else (middle, hi, c, b)
    jump = abs(b - a)
    return (hi, jump) if jump > 1e-3 * np.ptp(values) else None


class Output:
    """The quantities that follow the path: components of the frame of a link's end or of a slice."""

    def __init__(self, arm: Chain, link: int, x: float | None, names: tuple[str, ...]) -> None:
        self._core, self.link, self.x, self.names = arm._core, arm._link(link), arm._x(x), names
        self._rows = [(*PLACE, *TURN).index(name) for name in names if name != "azimuth"]
        self._turns = [k for k, name in enumerate(names) if name in TURN]
        self._axes = [TURN.index(names[k]) for k in self._turns]
        arm._core.frame(arm.zero[None], self.link, self.x)  # x beyond the beam

    def error(self, q: Array, wanted: Array) -> Array:
        """Wanted components (..., p) less those at q (..., nq); rotations as rotation vectors in world axes (rad)."""
        p, R = self._core.frame(q, self.link, self.x)
        out = np.empty_like(wanted)
        for k, name in enumerate(self.names):
            if name in PLACE:
                out[..., k] = wanted[..., k] - p[..., PLACE.index(name)]
            elif name == "azimuth":
                off = wanted[..., k] - np.arctan2(p[..., 1], p[..., 0])
                out[..., k] = np.remainder(off + np.pi, 2 * np.pi) - np.pi
        if self._turns:
            from scipy.spatial.transform import Rotation  # slow to import

            target = np.zeros((*wanted.shape[:-1], 3))
            target[..., self._axes] = wanted[..., self._turns]
            left = Rotation.from_rotvec(target.reshape(-1, 3)) * Rotation.from_matrix(R.reshape(-1, 3, 3)).inv()
            out[..., self._turns] = left.as_rotvec().reshape(target.shape)[..., self._axes]
        return out

    def jacobian(self, q: Array) -> Array:
        """Derivatives of the components by the rates, (..., p, nv)."""
        J = self._core.jacobian(q, self.link, self.x)
        if "azimuth" not in self.names:
            return np.ascontiguousarray(J[..., self._rows, :])
        p, _ = self._core.frame(q, self.link, self.x)
        x, y = p[..., :1], p[..., 1:2]
        round_z = (x * J[..., 1, :] - y * J[..., 0, :]) / np.maximum(x**2 + y**2, 1e-300)
        return np.concatenate([J[..., self._rows, :], round_z[..., None, :]], axis=-2)
