"""A rollout and its vector-Jacobian product, from arrays to arrays, for flexarm.torch and flexarm.jax."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..._check import Array, array
from ...arm.arm import Arm
from ...arm.variation import Setup, Variation
from ...run.perturbed import components
from .gradient import rollout_gradient
from .rollout import rollout


class Rolling:
    """Rollouts of an arm whose start, forces and parameters are arguments. Leading axes are scenarios.

    Args:
        arm: as of `rollout`.
        paths: parameters of the arm, as of `rollout_gradient`.
        options: step, integrator, rtol, spectral_radius, workers.
    """

    def __init__(self, arm: Arm, paths: Sequence[str], options: Mapping[str, Any]) -> None:
        if not isinstance(arm, Arm):
            raise ValueError(f"arm = {arm!r}: must be an Arm; its parameters may differ by scenario")
        self.arm, self.paths, self.options = arm, list(paths), dict(options)
        #: of each argument, its axes behind those of scenarios; None: of any length
        self.tails: list[tuple[Any, ...]] = [(arm.nq,), (arm.nv,), (None, arm.nv)]
        for path in self.paths:
            if str(path).split(".")[0] in ("q0", "v0"):
                raise ValueError(f"parameters: '{path}' is an argument of its own")
            parts = components(Setup(arm), path, {})
            self.tails.append(() if parts == [path] else (len(parts),))

    @property
    def names(self) -> list[str]:
        """Names of the arguments."""
        return ["q0", "v0", "tau", *(f"parameters['{path}']" for path in self.paths)]

    def scenarios(self, shapes: Sequence[tuple[int, ...]]) -> tuple[int, ...]:
        """The axes of scenarios, of arguments of these shapes."""
        found = []
        for name, shape, tail in zip(self.names, shapes, self.tails, strict=True):
            behind = shape[len(shape) - len(tail) :]
            if len(shape) < len(tail) or any(n not in (None, m) for n, m in zip(tail, behind, strict=True)):
                want = ", ".join(["...", *("nstep" if n is None else str(n) for n in tail)])
                raise ValueError(f"{name} has shape {tuple(shape)}: must be ({want})")
            found.append(tuple(shape[: len(shape) - len(tail)]))
        try:
            return np.broadcast_shapes(*found)
        except ValueError:
            told = ", ".join(f"{name} {shape}" for name, shape in zip(self.names, found, strict=True))
            raise ValueError(f"scenarios: axes of {told} do not fit together") from None

    def rows(self, *arguments: Any) -> tuple[Array, Array]:
        """q and v, (*scenarios, nstep + 1, nq) and (..., nv)."""
        batch, arms, (q0, v0, tau) = self._read(arguments)
        found = rollout(arms, q0, v0, tau, **self.options)
        for failure in found.failures:
            where = f"scenario {np.unravel_index(failure.index, batch)}: " if batch else ""
            raise ValueError(f"{where}stopped at t = {failure.time:.9g} s: {failure.reason}")
        return tuple(x.reshape((*batch, *x.shape[1:])) for x in (found.q, found.v))  # type: ignore[return-value]

    def back(self, by_q: Any, by_v: Any, q: Any, v: Any, *arguments: Any, parameters: bool = True) -> list[Array]:
        """Derivatives of a number by all arguments, in each scenario, from those by the rows.

        Args:
            parameters: whether those by parameters are asked for; else they are zero.
        """
        batch, arms, (_, _, tau) = self._read(arguments)
        one: tuple[int, ...] = (int(np.prod(batch)),)
        by_q, by_v, q, v = (np.asarray(x, dtype=float) for x in (by_q, by_v, q, v))
        by_q, by_v, q, v = (np.broadcast_to(x, (*batch, *x.shape[-2:])).reshape((*one, *x.shape[-2:]))
                            for x in (by_q, by_v, q, v))  # fmt: skip
        paths = self.paths if parameters else []
        g = rollout_gradient(arms, q, v, tau, by_q, by_v, parameters=paths, **self.options)
        tails = [(self.arm.nq,), (self.arm.nv,), tau.shape[1:], *self.tails[3:]]
        by = [g.q0, g.v0, g.tau, *(g.parameters.get(path, np.zeros(one + tail))
                                   for path, tail in zip(self.paths, tails[3:], strict=True))]  # fmt: skip
        return [x.reshape((*batch, *tail)) for x, tail in zip(by, tails, strict=True)]

    def _read(self, arguments: Sequence[Any]) -> tuple[tuple[int, ...], list[Arm], list[Array]]:
        """The axes of scenarios, the arms, and q0, v0 and tau of (B, ...)."""
        given = [array(name, np.asarray(x, dtype=float)) for name, x in zip(self.names, arguments, strict=True)]
        batch = self.scenarios([x.shape for x in given])
        count = int(np.prod(batch))
        flat = []
        for x, tail in zip(given, self.tails, strict=True):
            own = x.shape[x.ndim - len(tail) :]
            flat.append(np.broadcast_to(x, (*batch, *own)).reshape((count, *own)))
        start, values = flat[:3], flat[3:]
        if not values:
            return batch, [self.arm], start
        alike = all((x == x[0]).all() for x in values)
        parameters = {path: x[:1] if alike else x for path, x in zip(self.paths, values, strict=True)}
        near = Variation(Setup(self.arm), parameters)
        return batch, [near.scenario(k).arm for k in range(1 if alike else count)], start
