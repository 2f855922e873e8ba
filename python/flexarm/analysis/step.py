"""Derivatives of one step of the arm alone, as the core finds them."""

from __future__ import annotations

from typing import Any

import numpy as np

import flexarm._core as _core

from .._check import Array
from ..model.parts.chain import Chain

#: Why the core could not go on, by its status.
STATUS = ("ok", "the mass matrix is singular", "no solution was found; take a smaller step", "the motion ran away")


def step_slopes(
    arm: Chain, who: str, q: Array, v: Array, tau: Array, method: tuple[str, float, float, float], loads: Any = None
) -> tuple[Array, Array, Array, Array]:
    """q and v behind a step, and the Jacobians A, B of `flexarm.step_derivatives`.

    Args:
        who: asks, for messages.
        q, v, tau: (..., nq), (..., nv) and (..., nv) of one shape.
        method: name, step (s), rtol and spectral radius.
        loads: places and wrenches; by default none.

    Raises:
        ValueError: for an arm that has no such derivatives, or a step without a solution.
    """
    arm.refuse_rubbing(f"{who}: arm")
    with arm.naming():
        *found, status = _core.step_derivatives(arm._core, q, v, tau, *method, *(loads or ((), np.zeros((0, 6)))))
    failed = np.flatnonzero(status)
    if failed.size:
        which = "".join(f", state {k}" for k in np.unravel_index(failed[0], q.shape[:-1])) if q.ndim > 1 else ""
        raise ValueError(f"step = {method[1]:g}{which}: {STATUS[np.ravel(status)[failed[0]]]}")
    q1, v1, A, B = found
    return q1, v1, A, B
