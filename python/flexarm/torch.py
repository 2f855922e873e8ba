"""Rollouts as functions of PyTorch's tensors, with exact gradients; needs the extra "torch"."""

from collections.abc import Mapping
from typing import Any

from .arm.arm import Arm
from .many.batch.gradient import Rolling
from .run.integrators import Integrator

try:
    import torch
    from torch.autograd.function import once_differentiable
except ImportError as e:
    raise ImportError(f"flexarm.torch needs PyTorch ({e}): pip install 'flexarm[torch]'") from None


class _Rollout(torch.autograd.Function):  # type: ignore[misc]
    @staticmethod
    def forward(ctx: Any, of: Rolling, *arguments: Any) -> Any:
        given = [x.detach().cpu() for x in arguments]
        q, v = (torch.from_numpy(x) for x in of.rows(*(x.numpy() for x in given)))
        ctx.of = of
        ctx.save_for_backward(q, v, *given)
        return q, v

    @staticmethod
    @once_differentiable  # type: ignore[untyped-decorator]
    def backward(ctx: Any, by_q: Any, by_v: Any) -> Any:
        rows = (x.detach().cpu().numpy() for x in (by_q, by_v, *ctx.saved_tensors))
        asked = ctx.needs_input_grad[1:]
        found = ctx.of.back(*rows, parameters=any(asked[3:]))
        return (None, *(torch.from_numpy(x) if wanted else None for x, wanted in zip(found, asked, strict=True)))


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
    """`fa.rollout` as a function of tensors, through which `backward` goes: exact derivatives by the adjoint method, of
    first order. It computes on the processor, in float64. Leading axes are scenarios; a missing axis, or one of length
    1, is broadcast.

    Args:
        arm: as of `fa.rollout_gradient`.
        q0, v0: the start, (..., nq) and (..., nv). tau: forces held over each step, (..., nstep, nv).
        step: length of a step (s), here or in the integrator.
        parameters: values of parameters of the arm, (...) or (..., n), by their dotted paths: {"link.0.tip.mass": m}.
        integrator, rtol, spectral_radius, workers: as of `fa.rollout`.

    Returns:
        q and v, (..., nstep + 1, nq) and (..., nstep + 1, nv), the start first.

    Raises:
        ValueError: a bad argument, with its value; or a rollout that fails.
    """
    values = dict(parameters or {})
    of = Rolling(arm, list(values), {"step": step, "integrator": integrator, "rtol": rtol,
                                     "spectral_radius": spectral_radius, "workers": workers})  # fmt: skip
    given = [torch.as_tensor(x, dtype=torch.float64) for x in (q0, v0, tau, *values.values())]
    batch = of.scenarios([tuple(x.shape) for x in given])
    whole = [x.expand((*batch, *x.shape[x.ndim - len(tail) :])) for x, tail in zip(given, of.tails, strict=True)]
    q, v = _Rollout.apply(of, *whole)
    return q, v
