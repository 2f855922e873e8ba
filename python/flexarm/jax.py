"""Rollouts as functions of JAX's arrays, with exact gradients, under jit and vmap; needs the extra "jax"."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from .arm.arm import Arm
from .many.batch.gradient import Rolling
from .run.integrators import Integrator

try:
    import jax
    import jax.numpy as jnp
except ImportError as e:
    raise ImportError(f"flexarm.jax needs JAX ({e}): pip install 'flexarm[jax]'") from None


def _ask(function: Any, shapes: list[tuple[int, ...]], *arguments: Any) -> Any:
    """The results of a function of NumPy's arrays, of these shapes; vmap adds leading axes."""
    like = [jax.ShapeDtypeStruct(shape, jnp.float64) for shape in shapes]
    return jax.pure_callback(function, like, *arguments, vmap_method="expand_dims")


def _rows(of: Rolling, *arguments: Any) -> Any:
    batch = of.scenarios([x.shape for x in arguments])
    count = arguments[2].shape[-2] + 1
    return tuple(_ask(of.rows, [(*batch, count, of.arm.nq), (*batch, count, of.arm.nv)], *arguments))


@partial(jax.custom_vjp, nondiff_argnums=(0,))
def _rollout(of: Rolling, *arguments: Any) -> Any:
    return _rows(of, *arguments)


def _forward(of: Rolling, *arguments: Any) -> Any:
    rows = _rows(of, *arguments)
    return rows, (*rows, *arguments)


def _backward(of: Rolling, kept: Any, by: Any) -> Any:
    arguments = kept[2:]
    batch = of.scenarios([x.shape for x in arguments])
    behind = [x.shape[x.ndim - len(tail) :] for x, tail in zip(arguments, of.tails, strict=True)]
    found = _ask(of.back, [batch + own for own in behind], *by, *kept)
    alike = [tuple(k for k, n in enumerate(batch) if x.shape[k] != n) for x in arguments]
    return tuple(jnp.sum(x, axis=axes, keepdims=True) for x, axes in zip(found, alike, strict=True))


_rollout.defvjp(_forward, _backward)


def rollout(
    arm: Arm,
    q0: Any,
    v0: Any,
    tau: Any,
    *,
    step: float | None = None,
    parameters: Mapping[str, Any] | None = None,
    integrator: str | Integrator = "implicit",
    rtol: float | None = None,
    spectral_radius: float | None = None,
    workers: int | None = None,
) -> tuple[Any, Any]:
    """`fa.rollout` as a function of JAX's arrays, which `jax.grad`, `jax.vjp`, `jax.jit` and `jax.vmap` take: exact
    derivatives by the adjoint method, of first order. It computes on the processor, in float64. Leading axes are
    scenarios; a missing axis, or one of length 1, is broadcast.

    Args:
        arm: as of `fa.rollout_gradient`.
        q0, v0: the start, (..., nq) and (..., nv). tau: forces held over each step, (..., nstep, nv).
        step: length of a step (s), here or in the integrator.
        parameters: values of parameters of the arm, (...) or (..., n), by their dotted paths: {"link.0.tip.mass": m}.
        integrator, rtol, spectral_radius, workers: as of `fa.rollout`.

    Returns:
        q and v, (..., nstep + 1, nq) and (..., nstep + 1, nv), the start first.

    Raises:
        ValueError: a bad argument, with its value; or JAX without 64-bit numbers.
        jax.errors.JaxRuntimeError: a rollout failed, with the reason.
    """
    if not jax.config.jax_enable_x64:
        raise ValueError("jax_enable_x64 = False: must be True: jax.config.update('jax_enable_x64', True)")
    values = dict(parameters or {})
    of = Rolling(arm, list(values), {"step": step, "integrator": integrator, "rtol": rtol,
                                     "spectral_radius": spectral_radius, "workers": workers})  # fmt: skip
    given = [jnp.asarray(x, dtype=jnp.float64) for x in (q0, v0, tau, *values.values())]
    depth = len(of.scenarios([x.shape for x in given]))
    whole = []
    for x, tail in zip(given, of.tails, strict=True):  # add all axes of scenarios: those of vmap come before
        own = x.ndim - len(tail)
        whole.append(x.reshape((1,) * (depth - own) + x.shape))
    q, v = _rollout(of, *whole)
    return q, v
