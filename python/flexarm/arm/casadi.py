"""An arm's equations as functions of CasADi, with exact Jacobians: Arm.to_casadi."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any

import numpy as np

import flexarm._core as _core

from .._check import Array, at_least, choice, positive
from ..analysis.step import step_slopes
from ..model.parts.chain import Chain

#: Of the inputs, each (N, n): the value (N, m); or its slopes by each input, (N, m, n).
Of = Callable[..., Any]


def to_casadi(arm: Any, *, step: float | None = None, integrator: Any = None, columns: int = 1) -> Any:
    """The arm's equations as a function of CasADi (`pip install 'flexarm[casadi]'`) with exact Jacobians, for
    optimal control of one's own.

    Without step and integrator it is accelerations = f(q, v, tau), as of `forward_dynamics`; with them
    x_next = f(x, u), a step that begins anew, with x = [q; v] and u = tau held over it, as of `step_derivatives`.
    Its arguments are matrices of N columns, each a state by itself: a whole horizon is one call. Jacobians are
    sparse, and IPOPT's. Second derivatives are differences of them; "hessian_approximation": "limited-memory" of
    IPOPT does without.

    Args:
        step: length of the step (s), here or in the integrator.
        integrator: "implicit" or "rk4", or `fa.Implicit(...)`, `fa.RK4(...)`; None with a step: "implicit".
        columns: N.

    Returns:
        casadi.Callback. Keep it as long as you use expressions of it: CasADi does not.

    Raises:
        ValueError: bad arguments; with a step, also balls, dry friction and contacts with friction.
        ImportError: without CasADi.
    """
    if step is None and integrator is None:
        return _accelerations(arm, columns)
    return _steps(arm, columns, step, integrator)


def _accelerations(arm: Any, columns: int) -> Any:
    sizes = {"q": arm.nq, "v": arm.nv, "tau": arm.nv}
    return _function("accelerations", sizes, ("a", arm.nv), columns, arm.forward_dynamics,
                     arm.forward_derivatives)  # fmt: skip


def _steps(arm: Chain, columns: int, step: Any, integrator: Any) -> Any:
    """The map of [q; v] and tau to [q; v] after a step."""
    given = {} if integrator is None or isinstance(integrator, str) else integrator.options
    if step is not None and given:
        raise ValueError(f"step = {step}: belongs into the integrator, {type(integrator).__name__}(step=...)")
    name = choice("integrator", getattr(integrator, "name", integrator or "implicit"), _core.ONE_STEP)
    length = positive("step", given.get("step", step), "s")
    options = name, length, given.get("rtol", 1e-10), given.get("spectral_radius", 1.0)

    def ask(x: Array, u: Array) -> tuple[Array, Array, Array]:
        q, v = (np.ascontiguousarray(part) for part in (x[:, : arm.nq], x[:, arm.nq :]))
        *ends, A, B = step_slopes(arm, "to_casadi", q, v, u, options)
        return np.concatenate(ends, axis=1), A, B

    last: tuple[Array, Array, tuple[Array, Array, Array]] | None = None

    def known(x: Array, u: Array) -> tuple[Array, Array, Array]:
        """Solvers ask for the slopes where they have asked for the value."""
        nonlocal last
        found = last
        if found is None or not (np.array_equal(found[0], x) and np.array_equal(found[1], u)):
            last = found = (x.copy(), u.copy(), ask(x, u))
        return found[2]

    ask(np.zeros((0, arm.nq + arm.nv)), np.zeros((0, arm.nv)))  # refuses arms without such derivatives
    sizes = {"x": arm.nq + arm.nv, "u": arm.nv}
    return _function("step", sizes, ("x_next", arm.nq + arm.nv), columns, lambda *at: known(*at)[0],
                     lambda *at: known(*at)[1:])  # fmt: skip


def _function(name: str, sizes: Mapping[str, int], out: tuple[str, int], columns: int, value: Of, slopes: Of) -> Any:
    """A casadi.Callback of matrices of `columns` columns, whose columns know nothing of each other."""
    try:
        casadi: Any = import_module("casadi")
    except ImportError as e:
        raise ImportError(f"to_casadi needs CasADi ({e}): pip install casadi, or 'flexarm[casadi]'") from None
    count, dense = at_least("columns", columns, 1), casadi.Sparsity.dense

    def columns_of(given: Sequence[Any]) -> list[Array]:
        """CasADi gives None for zeros."""
        found = zip(given, sizes.values(), strict=False)
        return [np.zeros((count, n)) if x is None else np.frombuffer(x).reshape(count, n) for x, n in found]

    by = {f"jac_{out[0]}_{x}": casadi.diagcat(*[dense(out[1], n)] * count) for x, n in sizes.items()}
    inputs = {x: dense(n, count) for x, n in sizes.items()}
    outputs = {out[0]: dense(out[1], count)}

    class Function(casadi.Callback):  # type: ignore[misc]
        def __init__(self, name: str, inputs: Mapping[str, Any], outputs: Mapping[str, Any], options: Any) -> None:
            super().__init__()
            self.inputs, self.outputs = list(inputs.items()), list(outputs.items())
            self.kept: list[Any] = []  # CasADi does not
            self.construct(name, options)

        def get_n_in(self) -> int:
            return len(self.inputs)

        def get_n_out(self) -> int:
            return len(self.outputs)

        def get_name_in(self, i: int) -> str:
            return self.inputs[i][0]

        def get_name_out(self, i: int) -> str:
            return self.outputs[i][0]

        def get_sparsity_in(self, i: int) -> Any:
            return self.inputs[i][1]

        def get_sparsity_out(self, i: int) -> Any:
            return self.outputs[i][1]

        def answers(self, at: list[Array]) -> list[Array]:
            raise NotImplementedError

        def has_eval_buffer(self) -> bool:
            return True

        def eval_buffer(self, given: Any, found: Any) -> int:
            """CasADi stores numbers column by column: a matrix of N columns of n numbers is an array (N, n)."""
            answers = self.answers(columns_of(given))
            for place, x in zip(found, answers, strict=True):
                if place is not None:
                    np.frombuffer(place)[:] = x.ravel()
            return 0

    class Jacobian(Function):
        def answers(self, at: list[Array]) -> list[Array]:
            return [x.swapaxes(1, 2) for x in slopes(*at)]

        def has_jac_sparsity(self, o: int, i: int) -> bool:
            return True

        def get_jac_sparsity(self, o: int, i: int, symmetric: bool) -> Any:
            """Of differences, which are as few as this tells: a block depends on its own column."""
            of, by = self.outputs[o][1], self.inputs[i][1]
            rows, columns = of.get_triplet()
            places = np.array(rows) + of.size1() * np.array(columns)
            each, own = places.reshape(count, -1), np.arange(by.nnz()).reshape(count, -1)
            pairs = [np.meshgrid(*one, indexing="ij") for one in zip(each, own, strict=True)]
            at = [np.concatenate([pair[k].ravel() for pair in pairs]).tolist() for k in (0, 1)]
            return casadi.Sparsity.triplet(of.numel(), by.numel(), *at)

    class Value(Function):
        def answers(self, at: list[Array]) -> list[Array]:
            return [value(*at)]

        def has_jacobian(self) -> bool:
            return True

        def get_jacobian(self, name: str, inames: Any, onames: Any, options: Any) -> Any:
            nominal = {f"out_{out[0]}": casadi.Sparsity(out[1], count)}
            self.kept.append(Jacobian(name, {**inputs, **nominal}, by, {"enable_fd": True}))
            return self.kept[-1]

        def has_jac_sparsity(self, o: int, i: int) -> bool:
            return True

        def get_jac_sparsity(self, o: int, i: int, symmetric: bool) -> Any:
            return list(by.values())[i]

    return Value(name, inputs, outputs, {})
