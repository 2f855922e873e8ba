"""Exact derivatives of steps and rollouts: for filters, optimal control and learning."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import flexarm._core as _core

from .._check import Array, array, number
from ..acting.load import Load, at_time
from ..arm import Arm
from .arguments import check_options

_STATUS = ("ok", "the mass matrix is singular", "no solution was found; take a smaller step", "the motion ran away")


class StepDerivatives(NamedTuple):
    """A step's end, and its exact Jacobians.

    Attributes:
        q, v: at the end, (..., nq) and (..., nv).
        A: of [q; v] at the end by that at the beginning, (..., 2 nv, 2 nv).
        B: of [q; v] at the end by the forces, (..., 2 nv, nv).
    """

    q: Array
    v: Array
    A: Array
    B: Array


class Gradient(NamedTuple):
    """Derivatives of a number by a rollout's start, q0 (..., nq) and v0 (..., nv), and by its forces, tau (..., nstep,
    nv)."""

    q0: Array
    v0: Array
    tau: Array


def step_derivatives(
    arm: Arm,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    *,
    step: float,
    integrator: str = "implicit",
    rtol: float | None = None,
    spectral_radius: float | None = None,
    loads: Sequence[Load] | None = None,
    t: float = 0.0,
) -> StepDerivatives:
    """One step from each state, and what small changes of state and forces change of its end: derivatives of the
    method's own equations (Chung & Hulbert 1993; Runge-Kutta), by the exact ones of the dynamics. A step that begins
    anew, as in a `rollout` whose forces change at every step.

    Args:
        arm: without ball joints or dry friction.
        q, v, tau: states and the forces (N, N m) held over the step, (nq,) and (nv,) or (..., nq) and (..., nv).
        step: its length (s).
        integrator: "implicit" or "rk4"; see `simulate`.
        rtol, spectral_radius: of "implicit"; see `simulate`.
        loads, t: loads, which are held over the step with their values at time t (s).

    Raises:
        ValueError: naming the field and the value; where a step has no solution.
    """
    check_options(integrator, rtol, spectral_radius)
    q, v, tau = arm._batch(q=q, v=v, tau=tau)
    shape = np.broadcast_shapes(q.shape[:-1], v.shape[:-1], tau.shape[:-1])
    q, v, tau = (np.ascontiguousarray(np.broadcast_to(x, (*shape, x.shape[-1]))) for x in (q, v, tau))
    options = _options(rtol, spectral_radius)
    acting = at_time(arm, loads, t)
    found = _core.step_derivatives(arm._core, q, v, tau, integrator, number("step", step), *options, *acting)
    failed = np.flatnonzero(found[-1])
    if failed.size:
        which = f" of state {np.unravel_index(failed[0], shape)}" if shape else ""
        raise ValueError(f"step = {step}{which}: {_STATUS[found[-1][failed[0]]]}")
    return StepDerivatives(*found[:-1])


def _options(rtol: float | None, radius: float | None) -> tuple[float, float]:
    return 1e-10 if rtol is None else number("rtol", rtol), 1.0 if radius is None else number("spectral_radius", radius)


def rollout_gradient(
    arm: Arm,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    by_q: ArrayLike | None = None,
    by_v: ArrayLike | None = None,
    *,
    step: float,
    integrator: str = "implicit",
    rtol: float | None = None,
    spectral_radius: float | None = None,
) -> Gradient:
    """Derivatives of a number that depends on the rows of a rollout by its start and its forces, by the adjoint method:
    backwards through the steps, at a cost that does not depend on how many forces there are.

    Args:
        arm: without ball joints or dry friction.
        q, v: of the `rollout` with every=1, (..., nstep + 1, nq) and (..., nstep + 1, nv).
        tau: its forces, (..., nstep, nv).
        by_q, by_v: derivatives of the number by these rows, of the shapes of q and v; None: zero.
        step, integrator, rtol, spectral_radius: those of the rollout.

    Returns:
        Gradient.

    Raises:
        ValueError: naming the field and the value.
    """
    q, v, tau = array("q", q), array("v", v), array("tau", tau)
    if q.ndim < 2 or q.shape[-1] != arm.nq or q.shape[:-1] != v.shape[:-1] or v.shape[-1] != arm.nv:
        raise ValueError(f"q has shape {q.shape} and v {v.shape}: must be (..., nstep + 1, {arm.nq}) and as many rates")
    if tau.shape != (*v.shape[:-2], v.shape[-2] - 1, arm.nv):
        raise ValueError(f"tau has shape {tau.shape}: must be {(*v.shape[:-2], v.shape[-2] - 1, arm.nv)}")
    rows = [np.zeros(x.shape) if g is None else array(name, g, x.shape)
            for name, g, x in (("by_q", by_q, q), ("by_v", by_v, v))]  # fmt: skip
    check_options(integrator, rtol, spectral_radius)
    options = number("step", step), *_options(rtol, spectral_radius)
    batch = q.shape[:-2]
    out = Gradient(np.zeros((*batch, arm.nq)), np.zeros((*batch, arm.nv)), np.zeros(tau.shape))
    for i in np.ndindex(batch):
        *found, failed, status = _core.rollout_gradient(
            arm._core, q[i], v[i], tau[i], rows[0][i], rows[1][i], integrator, *options
        )
        if failed >= 0:
            raise ValueError(f"step {failed}{f' of scenario {i}' if batch else ''}: {_STATUS[status]}")
        for whole, part in zip(out, found, strict=True):
            whole[i] = part
    return out
