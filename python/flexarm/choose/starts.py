"""Initial states of a scene's models: if the scene starts in equilibrium, each model starts in its own equilibrium."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .._check import Array
from ..analysis.equilibrium import elastic_rates
from ..model.acting.drive import Motion
from ..run.scene.scene import Scene
from ..run.start import NEAR, acting, sagging, state
from .coordinates import restated

_FARTHEST_START = 0.5  # a start farther than this is not meant to be in equilibrium
_REST_MOTION = 1e-3  # rad or m: tolerated motion of a joint in equilibrium when it is released


class Start:
    """The initial state of a scene, and of its models.

    Attributes:
        distance: of the elastic coordinates from equilibrium at the joints' positions and rates, over the sag, in the
            norm of elastic energy; inf if there is no equilibrium, or q0 is a word.
        balanced: whether every model starts in its own equilibrium. free: also with released joints.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene, self.distance = scene, np.inf
        self.balanced, self.free = isinstance(scene.q0, str), False
        if scene.q0 is None or self.balanced:
            return
        arm, at = scene.arm, elastic_rates(scene.arm)
        q, v = state(arm, scene.q0, scene.v0, scene.drive, scene.loads, float(scene.t[0]))
        if not at.any() or v[at].any():
            return
        try:
            sag, self.distance = _joints_held(scene, q, v)
        except ValueError:
            return
        self.balanced = self.distance < NEAR
        self.extra = q - sag
        self.free = self.balanced and not v.any() and not scene.control and _stays_at_rest(scene, sag)

    @property
    def note(self) -> str:
        """A note on the start for a reader of a plan; "" if there is none."""
        if NEAR <= self.distance < _FARTHEST_START:
            return (
                f"the start is {100 * self.distance:.2g} % of the sag from balance in the scene's own model; other "
                "models begin with the same strains, and vibrate otherwise; if balance is meant, say q0 = "
                '"trim" or "equilibrium"'
            )
        if self.balanced and np.isfinite(self.distance):
            return "the start is in balance in the scene's own model; so is that of each model, with strains of its own"
        return ""

    def of(self, scene: Scene, parts: Sequence[Sequence[tuple[int, float]]]) -> tuple[Array | None, Array | None]:
        """q0 and v0 of the scene with another model of its arm; `parts` as of `restated`.

        Raises:
            ValueError: that model has no such equilibrium.
        """
        given, arm = self.scene, scene.arm
        v0 = None if given.v0 is None else restated(given.v0, given.arm, arm, parts, rates=True)
        if given.q0 is None:
            return None, v0
        if isinstance(given.q0, str):
            return replace(scene, q0=given.q0).start(), v0
        q0 = restated(given.start(), given.arm, arm, parts)
        if not self.balanced:
            return q0, v0
        q, v = state(arm, q0, v0, scene.drive, scene.loads, float(scene.t[0]))
        try:
            sag = _joints_released(scene, q) if self.free else _joints_held(scene, q, v)[0]
        except ValueError as e:
            raise ValueError(f"q0: is in balance in the scene's own model, in this one is none: {e}") from None
        return sag + restated(self.extra + given.arm.zero, given.arm, arm, parts) - arm.zero, v0


def _joints_held(scene: Scene, q: Array, v: Array) -> tuple[Array, float]:
    return sagging(scene.arm, q, v, scene.drive, scene.loads, float(scene.t[0]))


def _joints_released(scene: Scene, q: Array) -> Array:
    """q in equilibrium with all joints released except those of prescribed motion."""
    t, arm = float(scene.t[0]), scene.arm
    tau, volts = acting(arm, scene.drive, t)
    held = [key for key, law in scene.drive.items() if isinstance(law, Motion)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return arm.equilibrium(q, tau, held, loads=scene.loads, t=t, voltages=volts or None)


def _stays_at_rest(scene: Scene, q: Array) -> bool:
    """Whether released joints stay at rest."""
    try:
        found = _joints_released(scene, q)
    except ValueError:
        return False
    return bool(np.abs(found - q).max() < _REST_MOTION)
