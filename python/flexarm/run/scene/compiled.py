"""Scenes compiled to resolved numbers for C++, in the format of the C++ room `scene`."""

from __future__ import annotations

from typing import Any

import flexarm._core as _core

from ..integrators import integrator_of
from ..problem import Problem

_NUMBERS = "a compiled scene holds numbers alone: give samples"


def compiled_text(scene: Any) -> str:
    """The compiled file of a scene.

    Raises:
        ValueError: a law that is Python code, named by its owner.
        RuntimeError: flexarm was built without it (FLEXARM_SCENES=OFF).
    """
    if not hasattr(_core, "scene_text"):
        raise RuntimeError("this flexarm was built without compiled scenes (FLEXARM_SCENES=OFF)")
    if scene.events:
        raise ValueError("events: are Python code, which a compiled scene cannot hold")
    integrator = integrator_of(**{"integrator": "ida", **scene.options})

    def text(control: Any) -> str:
        run = Problem(scene.arm, scene.t, scene.q0, scene.v0, None, scene.drive, scene.loads, control, None)
        laws = {f"drive {key!r}": law for key, law in scene.drive.items()}
        laws |= {f"loads[{k}]": law for k, law in enumerate(scene.loads)}
        for where, law in laws.items():
            if not isinstance(law.law, (tuple, _core.PiecewisePolynomial)):
                raise ValueError(f"{where} = {law!r}: is a Python function; {_NUMBERS}")
        return _core.scene_text(run.core, run.times, integrator.core)

    try:
        return text(scene.control)
    except ValueError:
        for k, controller in enumerate(scene.control):  # find the controller with the law
            try:
                text([controller])
            except ValueError as e:
                raise ValueError(
                    f"control[{k}] = {controller!r}: is a Python function, or reads or follows one; {_NUMBERS}, or a "
                    f"controller of numbers, such as LinearController ({e})"
                ) from None
        raise
