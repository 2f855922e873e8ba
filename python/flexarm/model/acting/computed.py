"""Control by inverse dynamics: feed-forward of a motion, and computed torque."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

import flexarm._core as _core
from flexarm._core import Feedback, Sampler

from ..._check import Array, array, choice, for_each, instance, not_negative, positive
from ..parts.chain import Chain
from .control import Controller, Run, all_joints
from .drive import Motion
from .following import Fitted, check_motion, fitted, kinks_of, motions_of

ELASTIC = ("static", "zero")


def _motions(arm: Chain, reference: Any, rates: Sequence[int], times: Array, inertia: bool = True) -> list[Motion]:
    names = [arm.coordinates[i] for i in rates]
    out = motions_of(reference, names)
    for name, motion in zip(names, out, strict=True):
        check_motion(f"reference of '{name}'", motion, times, smooth=inertia)
    return out


class _OfInverse(Controller):
    """The base of laws by inverse dynamics, which act on all joints."""

    model: Chain | None

    def _columns(self, arm: Chain) -> list[Array]:
        return [np.eye(arm.nv)[i] for i in all_joints(arm)]

    def _model_arm(self, arm: Chain, rates: Sequence[int]) -> tuple[Chain, list[int]]:
        """The arm that the law uses as its model, and the rates of its joints' freedoms."""
        (self.model or arm).refuse_loops(f"{type(self).__name__}: arm", rigid=True)
        if self.model is None:
            return arm, list(rates)
        own = all_joints(self.model)
        if len(own) != len(rates):
            raise ValueError(f"model: its joints have {len(own)} freedoms; the arm's have {len(rates)}")
        return self.model, own


class FeedForward(_OfInverse):
    """The forces that a motion of the joints needs, M(q) q'' + h(q, q') at the reference.

    Elastic coordinates are at rest. Use it together with feedback, `control=[fa.PD(...), ..., fa.FeedForward(...)]`:
    the forces add up.

    They include joint springs, viscous friction, struts and the normal forces of contacts, not loads, and not dry
    friction: of that of contacts only its damping.
    They are computed once for a run, as piecewise polynomials, and evaluated in C++ by every integrator and in batches.

    Args:
        reference: of each freedom of the joints, from the base to the tip: a Motion, or a number (rad, m) for a
            constant position; a single one if there is one freedom.
        inertia: False: only gravity and springs, along the reference.
        elastic: "static": the beams are in static equilibrium with gravity at the reference; "zero": their elastic
            coordinates are zero.
        model: (not in files) the arm that the law assumes, for example rigid or with another payload; None: the
            controlled arm.

    Raises:
        ValueError: (in a run) a reference that jumps or does not cover the run, a wrong number of references, or no
            static equilibrium.
    """

    type = "feed_forward"
    of_arm = True

    def __init__(
        self, reference: Any, *, inertia: bool = True, elastic: str = "static", model: Any = None
    ) -> None:  # fmt: skip
        self.reference, self.inertia, self.elastic = reference, bool(inertia), choice("elastic", elastic, ELASTIC)
        self.model = None if model is None else instance("model", model, Chain, "an Arm or None")

    def forces(self, arm: Chain, t: Any) -> Array:
        """The forces at times t (n,), (n, nv)."""
        times = np.atleast_1d(array("t", t))
        rates = all_joints(arm)
        motions = _motions(arm, self.reference, rates, np.sort(times), self.inertia)
        out = np.zeros((len(times), arm.nv))
        out[:, rates] = self._forces(arm, rates, motions)(times)
        return out

    def _forces(self, arm: Chain, rates: Sequence[int], motions: Sequence[Motion]) -> Callable[[Array], Array]:
        """A function t (n,) -> forces of all joints' freedoms."""
        model, own = self._model_arm(arm, rates)
        axes = [(i, m.law, 0.0, 0.0, np.inf) for i, m in zip(own, motions, strict=True)]
        core = _core.ComputedTorque(model._core, axes, self.elastic == "static", [], model.nv)
        return lambda t: core.feed_forward(t, self.inertia)[:, own]

    def _laws(self, arm: Chain, run: Run) -> tuple[list[Feedback], list[Sampler]]:
        rates = all_joints(arm)
        motions = _motions(arm, self.reference, rates, run.times, self.inertia)
        sampled = [m.law for m in motions if isinstance(m.law, _core.PiecewisePolynomial) and not m.constant]
        kinks = [kinks_of(law) for law in sampled]
        laws: list[Fitted] = fitted(
            self._forces(arm, rates, motions), float(run.times[0]), float(run.times[-1]),
            np.concatenate([np.zeros(0), *kinks]),
        )  # fmt: skip
        none = np.zeros(arm.nq), np.zeros(arm.nv)
        return [Feedback(np.eye(arm.nv)[i], *none, law, np.inf) for i, law in zip(rates, laws, strict=True)], []


class ComputedTorque(_OfInverse):
    """Computed torque, sampled: inverse dynamics makes the arm follow a motion.

    (Luh, Walker & Paul, IEEE Trans. Automatic Control 25, 1980.) In C++: tau = M(q) (r'' + kv (r' - v) + kp (r - q)) +
    h(q, v) at the joints, of the arm with its elastic coordinates at rest. A rigid arm without limits then has the
    characteristic polynomial s² + kv s + kp at every joint and position. The law ignores vibration: keep sqrt(kp) below
    a third of the lowest frequency with locked joints.

    Args:
        kp, kv: gains (1/s², 1/s), a number, or one for each freedom of the joints; kv = None: 2 sqrt(kp), critical
            damping.
        reference: as of FeedForward.
        rate: samples a second (Hz).
        delay: time from a sample to its force (s).
        elastic: as of FeedForward, at the measured joint positions.
        limit: of each |force| (N, N m): a number, or one for each freedom; None: no limit.
        model: as of FeedForward.

    Raises:
        ValueError: as of FeedForward.
    """

    type = "computed_torque"

    def __init__(
        self, kp: Any, kv: Any = None, *, reference: Any, rate: float, delay: float = 0.0, elastic: str = "static",
        limit: Any = None, model: Any = None,
    ) -> None:  # fmt: skip
        self.model = None if model is None else instance("model", model, Chain, "an Arm or None")
        self.kp = array("kp", kp)
        if not (self.kp >= 0.0).all():
            raise ValueError(f"kp = {kp!r}: must not be negative (1/s²)")
        self.kv = 2.0 * np.sqrt(self.kp) if kv is None else array("kv", kv)
        for name in ("kp", "kv"):
            if getattr(self, name).ndim > 1:
                raise ValueError(f"{name} = {locals()[name]!r}: must be one number, or one for each joint's freedom")
        self.reference, self.rate, self.delay = reference, positive("rate", rate), not_negative("delay", delay, "s")
        self.elastic = choice("elastic", elastic, ELASTIC)
        self.limit = None if limit is None else array("limit", limit)
        if self.limit is not None and not (self.limit > 0.0).all():
            raise ValueError(f"limit = {limit!r}: must be positive")

    def law(self, arm: Chain, times: Any = (0.0, 1.0)) -> Any:
        """The law of one arm: a callable (t, q, v) -> forces (nv,), without sampling or delay.

        Args:
            times: times that the references must cover.
        """
        return self._law(arm, array("times", times), arm.nv)

    def _law(self, arm: Chain, times: Array, size: int) -> Any:
        rates = all_joints(arm)
        motions, n = _motions(arm, self.reference, rates, times), len(rates)
        gains = (for_each(name, getattr(self, name), n, "freedom").tolist() for name in ("kp", "kv"))
        limits = np.full(n, np.inf) if self.limit is None else for_each("limit", self.limit, n, "freedom")
        model, own = self._model_arm(arm, rates)
        axes = [(i, m.law, *rest) for i, m, *rest in zip(own, motions, *gains, limits.tolist(), strict=True)]
        moved = [(arm.coordinate_of(i), i) for i in rates]
        return _core.ComputedTorque(model._core, axes, self.elastic == "static", moved, size)

    def _laws(self, arm: Chain, run: Run) -> tuple[list[Feedback], list[Sampler]]:
        span = float(run.times[-1] - run.times[0])
        if self.rate * span > 1e8:
            raise ValueError(f"rate = {self.rate}: asks for {self.rate * span:.3g} samples in {span} s; at most 1e8")
        law = self._law(arm, run.times, arm.nv + run.total)
        return [], [Sampler(float(run.times[0]), 1.0 / self.rate, self.delay, law)]
