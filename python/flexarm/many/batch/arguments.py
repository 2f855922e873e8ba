"""Checks of the arguments of `simulate_batch` and `rollout`."""

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import flexarm._core as _core

from ..._check import Array, array, at_least, check_finite, choice, instance, known_keys, mapping, unmasked
from ..._threads import cores
from ...model.acting.drive import Motion, Torque, Voltage
from ...run.integrators import Integrator, integrator_of


def default_workers(workers: int | None) -> int:
    """The number of threads: as many as this process may use cores, if None."""
    return cores() if workers is None else at_least("workers", workers, 1)


def scenario_count(sizes: Mapping[str, int]) -> int:
    """B, from how many scenarios each argument is for; 1 suits all."""
    most = max(sizes, key=lambda k: sizes[k])
    count = sizes[most]
    for name, n in sizes.items():
        if n not in (1, count):
            raise ValueError(f"{name}: is for {n} scenarios, {most} for {count}; must be 1 or {count}")
    return count


def rows(name: str, value: ArrayLike | None, default: Array) -> Array:
    """(B or 1, n) from (B, n) or (n,)."""
    a = default if value is None else array(name, value, batch_ndim=2)
    if a.ndim not in (1, 2) or a.shape[-1] != default.shape[-1] or not len(a):
        n = default.shape[-1]
        raise ValueError(f"{name} has shape {a.shape}: must be ({n},) or (B, {n})")
    return np.atleast_2d(a)


def forces(tau: ArrayLike | None, nv: int, count: int | None, name: str = "nstep") -> Array:
    """Forces held over steps, (B or 1, count or 1, nv); not copied if they are such an array already."""
    if tau is None:
        return np.zeros((1, 1, nv))
    unmasked("tau", tau)
    try:
        a = np.ascontiguousarray(tau, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"tau = {tau!r}: must be numbers") from None
    if a.ndim not in (2, 3) or a.shape[-1] != nv or a.size == 0:
        raise ValueError(f"tau has shape {a.shape}: must be ({name}, {nv}) or (B, {name}, {nv}); {name} may be 1")
    if count is not None and a.shape[-2] not in (1, count):
        raise ValueError(f"tau has shape {a.shape}: its last axis but one must be {name} = {count}, or 1")
    check_finite("tau", a, a.ndim == 3)
    return a if a.ndim == 3 else a[None]


def _physical_memory() -> float:
    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return np.inf


def check_memory(arrays: str, need: float, otherwise: str) -> None:
    """ValueError if arrays need more bytes than the machine has."""
    there = _physical_memory()
    if need > there:
        raise ValueError(
            f"{arrays} take {need / 1e9:.3g} GB, this machine has {there / 1e9:.3g} GB; take a larger `every`, "
            f"{otherwise}"
        )


def prepared(out: Mapping[str, Array] | None, shapes: Mapping[str, tuple[int, ...]]) -> dict[str, Array]:
    """Arrays of these shapes: those of `out`, checked, or new ones."""
    known_keys("out", out or {}, shapes)
    made = {}
    for name, shape in shapes.items():
        x = (out or {}).get(name)
        if x is None:
            x = np.empty(shape)
        elif not isinstance(x, np.ndarray) or x.dtype != np.float64 or x.shape != shape:
            given = f"{x.dtype} {x.shape}" if isinstance(x, np.ndarray) else repr(x)
            raise ValueError(f"out['{name}'] is {given}: must be an array of float64, shape {shape}")
        elif not x.flags.c_contiguous or not x.flags.writeable:
            raise ValueError(f"out['{name}']: must be contiguous (C order) and writeable")
        made[name] = x
    return made


def checked_drive(drive: Any, name: str = "drive") -> dict[Any, Any]:
    """The argument `drive` of a batch."""
    found = mapping(name, drive, ", by link number")
    for key, law in found.items():
        instance(f"{name}[{key!r}]", law, (Motion, Torque, Voltage))
    return found


def checked_drives(drive: Any) -> list[dict[Any, Any]]:
    """The argument `drive` of a rollout: one for all scenarios, or one for each, of the same joints and kinds."""
    if not isinstance(drive, (list, tuple)) or not drive:
        return [checked_drive(drive)]
    drives = [checked_drive(own, f"drive[{k}]") for k, own in enumerate(drive)]
    kinds = [{key: type(law).__name__ for key, law in own.items()} for own in drives]
    for k, own in enumerate(kinds):
        if own != kinds[0]:
            raise ValueError(f"drive[{k}] = {own}: must drive the same as drive[0], {kinds[0]}")
    return drives


def stepping(integrator: str | Integrator, **options: Any) -> Integrator:
    """The integrator of a rollout; arguments as of `integrator_of`."""
    choice("integrator", integrator.name if isinstance(integrator, Integrator) else integrator, _core.ONE_STEP)
    return integrator_of(integrator, **options)
