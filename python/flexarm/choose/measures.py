"""The compared quantity of runs: times of comparison, values along a run, distances, sensitivity to coordinates."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from .._check import Array, choice
from ..arm.arm import Arm
from ..model.acting.drive import moved_rates
from ..model.parts.beam import STRAIN_NAMES
from ..run.result import Result
from ..run.scene.scene import Scene

_ROWS = 200  # output times of the runs that are compared, and as many times between them
_PROBES = 4000


def times_to_compare(t: Array) -> Array:
    """The first and the last output time, some of the others, and as many times between them, each drawn at random from
    its own part of the run, so that no vibration has zeros at all of them."""
    rng = np.random.default_rng(19)
    part = (np.arange(_ROWS) + rng.random((2, _ROWS))) / _ROWS
    own = t if len(t) <= _ROWS else t[np.unique(np.append(part[0] * len(t), [0, len(t) - 1]).astype(int))]
    gaps, many = len(t) - 1, -(-_ROWS // (len(t) - 1))  # several in each where output times are few
    drawn = np.searchsorted(t, t[0] + part[1] * (t[-1] - t[0])).clip(1, gaps) - 1
    gap = np.arange(gaps) if many > 1 else np.unique(drawn)
    share = 0.01 + 0.98 * (np.arange(many) + rng.random((len(gap), many))) / many
    inside = (t[gap, None] + share * np.diff(t)[gap, None]).ravel()
    return np.union1d(own, inside)


def thinned(result: Result, t: Array) -> Result:
    """The rows of a result at the times t, which must be among its own."""
    rows = np.searchsorted(result.t, t - 1e-12 * max(1.0, float(abs(t[-1]))))
    if len(rows) == len(result.t):
        return result
    names = ("t", "q", "v", "a", "tau", "friction", "driven", "contacts", "loops")
    return replace(result, **{name: x[rows] for name in names if (x := getattr(result, name)) is not None})


def between(result: Result, t: Array) -> Result:
    """A result at other times within its own: polynomials of degree five through coordinates, rates and accelerations
    at both ends (degree three for quaternions, without second derivatives); forces by linear interpolation."""
    if np.isin(t, result.t).all():
        return thinned(result, t)
    arm, old = result.arm, result.t
    k = np.clip(np.searchsorted(old, t, side="right") - 1, 0, len(old) - 2)
    h, u = np.diff(old)[k][:, None], ((t - old[k]) / np.diff(old)[k])[:, None]

    def through(x: Array, dx: Array, ddx: Array | None) -> Array:
        rise = x[k + 1] - x[k]
        c, d = h * dx[k] - rise, h * dx[k + 1] - rise  # slopes less the straight line's
        out = x[k] + u * rise + u * (1 - u) * ((1 - u) * c - u * d)
        if ddx is not None:  # curvatures less the cubic's
            e, f = h**2 * ddx[k] + 4 * c + 2 * d, h**2 * ddx[k + 1] - (2 * c + 4 * d)
            out = out + u**2 * (1 - u) ** 2 / 2 * ((1 - u) * e + u * f)
        return np.asarray(out)

    rates = np.array([arm._core.rates(x, y)[0] for x, y in zip(result.q, result.v, strict=True)])
    q = through(result.q, rates, None)
    plain = [(i, arm.coordinate_of(i)) for i in range(arm.nv) if arm.coordinate_of(i) >= 0]
    of, at = [i for i, _ in plain], [j for _, j in plain]
    q[:, at] = through(result.q[:, at], result.v[:, of], result.a[:, of])
    for _, ball in arm.quaternions():
        q[:, ball] /= np.linalg.norm(q[:, ball], axis=1, keepdims=True)
    given = {"a": result.a, "tau": result.tau, "driven": result.driven}
    line: dict[str, Any] = {name: x[k] + u * (x[k + 1] - x[k]) for name, x in given.items() if x is not None}
    v = through(result.v, result.a, None)
    return replace(result, t=t, q=q, v=v, friction=None, contacts=None, loops=None, **line)


def probes(scene: Scene) -> Array:
    """Times (s) at which functions of time in Python are sampled."""
    return np.asarray(scene.t[0] + np.ptp(scene.t) * np.sort(np.random.default_rng(4).random(_PROBES)))


MEASURES = ("tip", "joint", "strain")


class Measure:
    """A quantity of a scene's runs whose error matters.

    Args:
        scene: defines the joints and beams. quantity: "tip", "joint", "strain", or a callable of a Result that
            returns an array (nt,) or (nt, k).
        atol: an absolute tolerance, in the quantity's unit; None: errors are relative to the span.

    Attributes:
        span: by unit, the divisor of errors.
        ranges: by unit, the range of the quantity.
    """

    def __init__(self, scene: Scene, quantity: str | Callable[[Result], Any], atol: float | None = None) -> None:
        if not callable(quantity):
            choice("quantity", quantity, MEASURES)
        self.quantity, self.scene, self.atol = quantity, scene, atol
        self.span: dict[str, float] = {}

    @property
    def name(self) -> str:
        return getattr(self.quantity, "__name__", "quantity") if callable(self.quantity) else self.quantity

    def _joints(self, arm: Arm) -> dict[str, list[tuple[int, int]]]:
        """By unit, (index in q, index in v or -1) of the joint coordinates that are not prescribed."""
        given = self.scene.arm
        held = {given.coordinate_of(i) for i in moved_rates(given, self.scene.drive)}
        out: dict[str, list[tuple[int, int]]] = {}
        rates = {arm.coordinate_of(i): i for i in range(arm.nv)}
        moving = [k for k, link in enumerate(arm.links) if link.joint.nq]  # pieces of a beam add fixed ones
        own = [k for k, link in enumerate(given.links) if link.joint.nq]
        for k, mine in zip(moving, own, strict=True):
            first = arm._core.first_q(k)
            for i, unit in enumerate(arm.links[k].joint.q_units):
                if given._core.first_q(mine) + i not in held:
                    out.setdefault(unit, []).append((first + i, rates.get(first + i, -1)))
        return out

    def _beams(self) -> list[int]:
        return [k for k, link in enumerate(self.scene.arm.links) if link.beam is not None]

    def _strains(self) -> dict[str, slice]:
        """Compared strains by unit: shear angles and stretches only if the scene's own beams have them."""
        has = {name for link in self.scene.arm.links if link.beam is not None for name in link.beam.counts}
        out = {"1/m": slice(0, 3)}
        if has & {"shear_y", "shear_z"}:
            out["rad"] = slice(3, 5)
        return {**out, "1": slice(5, 6)} if "extension" in has else out

    def values(self, result: Result, first: Sequence[int] | None = None) -> dict[str, Array]:
        """Values by unit, (nt, places, components). `first`: for beams in pieces, the first piece of each link."""
        arm = result.arm
        if callable(self.quantity):
            y = np.asarray(self.quantity(result), dtype=float)
            if y.ndim not in (1, 2) or len(y) != len(result.t):
                raise ValueError(f"quantity = {self.quantity!r}: gave shape {y.shape}; must be ({len(result.t)},) or "
                                 f"({len(result.t)}, k), a row for each time of the result")  # fmt: skip
            return {"": y.reshape(len(y), 1, -1)}
        if self.quantity == "tip":
            return {"m": arm.end_places(result.q)}
        if self.quantity == "joint":
            return {u: result.q[:, [i for i, _ in at], None] for u, at in self._joints(arm).items()}
        beams = self._beams()
        if not beams:
            return {}
        rigid = np.zeros((len(result.t), len(STRAIN_NAMES)))
        at = beams if first is None else [first[k] for k in beams]
        rows = [arm.strain(result.q, k, 0.0) if arm.links[k].beam.ne else rigid for k in at]  # type: ignore[union-attr]
        both = np.stack(rows, axis=1)
        return {unit: both[:, :, rows] for unit, rows in self._strains().items()}

    def set_span(self, values: dict[str, Array]) -> None:
        """Sets the divisors of errors: by unit, the largest range of any one component, without units of constant
        values (with atol, 1: errors are then in the quantity's unit).

        Raises:
            ValueError: nothing moves.
        """
        ranges = {unit: float(np.ptp(x, axis=0).max(initial=0.0)) for unit, x in values.items()}
        least = {unit: 1e-12 * max(1.0, float(np.abs(values[unit]).max(initial=0.0))) for unit in ranges}
        self.ranges = {unit: r for unit, r in ranges.items() if r > least[unit]}
        if not self.ranges:
            why = "nothing moves" if values else "there is none that is not prescribed"
            raise ValueError(f"quantity = {self.name!r}: {why} in this scene; take another")
        # a unit with almost no motion, such as shear angles beside curvatures, must not set the scale
        self.span = {u: 1.0 for u in self.ranges} if self.atol is not None else dict(self.ranges)

    def size_of(self, unit: str) -> float:
        """The size of the arm, which a tolerance of steps is a part of, in a unit of the quantity."""
        arm = self.scene.arm
        if unit != "m":
            return 1.0 if unit == "rad" else self.span[unit]
        places = [arm.frame(arm.zero, link=k)[0] for k in range(len(arm.links))]
        return float(np.linalg.norm(np.diff(places, axis=0, prepend=np.zeros((1, 3))), axis=1).sum())

    def by_unit(self, a: dict[str, Array], b: dict[str, Array]) -> dict[str, float]:
        """Largest distance over all times and places, by unit."""
        return {u: float(np.linalg.norm(a[u] - b[u], axis=-1).max()) for u in self.span}

    def distance(self, a: dict[str, Array], b: dict[str, Array]) -> float:
        """Largest distance over all times, places and units, over the span."""
        return max(d / self.span[u] for u, d in self.by_unit(a, b).items())

    def sense(self, scene: Scene, q: Array) -> Callable[[Array], float]:
        """The largest change of the quantity, over its span, as a function of small motions (nt, nv) about q (nt, nq);
        for a callable, that of the tips."""
        maps = self._slopes(scene, q)

        def size(x: Array) -> float:
            moved = [np.einsum("tpcn,tn->tpc", np.broadcast_to(m, (len(x), *m.shape[1:])), x) for m in maps]
            return max((float(np.linalg.norm(y, axis=-1).max(initial=0.0)) for y in moved), default=0.0)

        return size

    def _slopes(self, scene: Scene, q: Array) -> list[Array]:
        """Derivatives of the quantity by the rates, by unit, (nt or 1, places, components, nv), over the span."""
        arm = scene.arm
        if self.quantity == "joint":
            unit = np.eye(arm.nv)
            return [np.array([unit[i] if i >= 0 else 0 * unit[0] for _, i in at])[None, :, None, :] / self.span[u]
                    for u, at in self._joints(arm).items() if u in self.span]  # fmt: skip
        if self.quantity == "strain":
            E = np.asarray(arm._core.rates(arm.zero, np.zeros(arm.nv))[2])
            beams = [k for k in self._beams() if arm.links[k].beam.ne]  # type: ignore[union-attr]
            S = np.array([arm.strain(E.T, k, 0.0) for k in beams]).transpose(0, 2, 1)  # strains are linear in q
            return [S[None, :, rows] / self.span[u] for u, rows in self._strains().items() if u in self.span]
        J = np.stack([arm.jacobian(q, k)[:, :3] for k in arm.ends], axis=1)
        if self.quantity == "tip":
            return [J / self.span["m"]]
        moved = float(np.ptp(arm.end_places(q), axis=0).max()) or 1.0
        return [J / moved * self.ranges[""] / self.span[""]]
