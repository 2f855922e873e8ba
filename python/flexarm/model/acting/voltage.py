"""Voltages of piezo patches, and the forces of patches on an arm (paper Eq. 61)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import flexarm._core as _core

from ..._check import Array, array
from ..parts.chain import Chain
from .drive import Scalar


class Voltage(Scalar):
    """Voltage of a patch (V): samples (t, V), linear in between; a callable; a number."""

    def __init__(self, t: ArrayLike | Callable[[float], float], V: ArrayLike | None = None) -> None:
        self._read("V", t, V)


def is_patch(key: Any) -> bool:
    return isinstance(key, tuple) and len(key) > 0 and key[0] == "patch"


def split_drives(drive: Any) -> tuple[Any, dict[Any, Any]]:
    """The drives of joints, and those of patches."""
    if not isinstance(drive, Mapping):
        return drive, {}
    joints = {k: law for k, law in drive.items() if not is_patch(k)}
    return joints, {k: law for k, law in drive.items() if is_patch(k)}


def patch_laws(arm: Chain, drives: Mapping[Any, Any], t: Array) -> list[_core.Drive]:
    """The core's drives for voltages of patches, keyed by ("patch", link, patch)."""
    out: dict[int, Any] = {}
    for key, law in drives.items():
        if len(key) != 3:
            raise ValueError(f'drive {key!r}: must be ("patch", link, patch)')
        k = arm.patch_column(key[1], key[2], "drive: ")
        where = f"drive of patch {key[2]} of link {key[1]}"
        if not isinstance(law, Voltage):
            raise ValueError(f"{where} = {law!r}: must be a Voltage")
        if k in out:
            raise ValueError(f"{where}: is named twice")
        law.check_span(where, t)
        out[k] = law.law
    B = arm.patch_matrix
    return [_core.Drive(-1, False, law, B[:, k]) for k, law in out.items()]


def voltage_forces(arm: Chain, voltages: Any) -> Array:
    """Generalised forces (nv,) of constant voltages: (n_patches,), or by (link, patch)."""
    B = arm.patch_matrix
    V = np.zeros(B.shape[1])
    if isinstance(voltages, Mapping):
        for key, value in voltages.items():
            if not isinstance(key, tuple) or len(key) != 2:
                raise ValueError(f"voltages: {key!r}: must be (link, patch)")
            V[arm.patch_column(*key, "voltages: ")] = array("voltages", value, ())
    else:
        V = array("voltages", voltages, V.shape)
    return np.asarray(B @ V)
