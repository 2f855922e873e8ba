"""Limits of joints as users give them: for all joints, for each, or by joint; and the joints' stops."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .._check import Array, choice
from ..arm.arm import Arm


def by_kind(limits: Any, kinds: Sequence[str]) -> dict[str, Any]:
    """The argument `limits` of a move or a path: limits by their kind; None: none."""
    if limits is not None and not isinstance(limits, Mapping):
        raise ValueError(f"limits = {limits!r}: must be a dictionary of {', '.join(kinds)}")
    return {choice("limits", kind, kinds): value for kind, value in (limits or {}).items()}


def joint_limits(arm: Arm, field: str, value: Any, rates: Sequence[int]) -> Array:
    """The limits (n,) of the joints with these rates: one number for all, one for each, or a dictionary by link, whose
    missing keys have none. None and inf: no limit.

    Raises:
        ValueError: a wrong shape, a joint that is not among these, a limit that is not positive.
    """
    out = _read(arm, field, value, rates, np.inf)
    for i, x in zip(rates, out, strict=True):
        if not x > 0.0:
            raise ValueError(f"{field} = {x:g} of '{arm.coordinates[i]}': must be positive")
    return out


def joint_ranges(arm: Arm, field: str, value: Any, rates: Sequence[int]) -> Array:
    """The ranges (2, n), lowest and highest, of the joints with these rates, given as the limits are, by pairs. None:
    the joints' stops."""
    if value is None:
        joints = [link.joint for link in arm.links]
        stops = [[x for joint in joints for x in joint._per_freedom(name, joint.nv)] for name in ("lower", "upper")]
        at = [i for n, joint in enumerate(joints) for i in range(arm._core.first(n), arm._core.first(n) + joint.nv)]
        return np.array(stops)[:, [at.index(i) for i in rates]].reshape(2, -1)
    out = _read(arm, field, value, rates, (-np.inf, np.inf))
    if not (out[:, 0] < out[:, 1]).all():
        raise ValueError(f"{field} = {value}: must be (lowest, highest)")
    return out.T


def _read(arm: Arm, field: str, value: Any, rates: Sequence[int], none: Any) -> Array:
    """Numbers (n,), or pairs (n, 2) where `none` is one, of the joints with these rates."""
    out = np.array(np.broadcast_to(none, (len(rates), *np.shape(none))), dtype=float)
    if value is None:
        return out
    one = "one number" if out.ndim == 1 else "one pair"
    if isinstance(value, Mapping):
        for i, x in arm.by_rate(field, value).items():
            where = f"{field} of '{arm.coordinates[i]}'"
            if i not in rates:
                raise ValueError(f"{field}: '{arm.coordinates[i]}' is not driven")
            given = _numbers(where, none if x is None else x)
            if given.shape != out.shape[1:]:
                raise ValueError(f"{where} = {x!r}: must be {one}")
            out[list(rates).index(i)] = given
        return out
    given = _numbers(field, value)
    if given.shape not in (out.shape[1:], out.shape):
        names = ", ".join(arm.coordinates[i] for i in rates)
        raise ValueError(
            f"{field} has shape {given.shape}: must be {one}, {len(out)} (one for each of {names}), or a dictionary by "
            "link"
        )
    out[:] = given
    return out


def _numbers(field: str, value: Any) -> Array:
    """Numbers; inf stands for no limit."""
    try:
        out = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f"{field} = {value!r}: must be numbers") from None
    if np.isnan(out).any():
        raise ValueError(f"{field} = {out.tolist()}: must not be nan")
    return out
