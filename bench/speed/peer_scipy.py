"""Worker of bench/speed/peers.py: SciPy's Radau and DOP853 on flexarm's equations of motion, arm.forward_dynamics.

Also the converged models of flexarm's mechanics: DOP853 at rtol 1e-9, order "exact", Legendre modes. They owe nothing
to flexarm's own integrators.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import flexarm as fa
import numpy as np
import scipy
from peer_common import Case, measure, report, versions, wanted
from peer_flexarm import TRUTH, arm
from scipy.integrate import solve_ivp

SWEEP = [("DOP853", n, 10.0**-k) for n, k in ((2, 3), (3, 4), (4, 5), (5, 6))]
SWEEP += [("Radau", n, 10.0**-k) for n, k in ((2, 3), (3, 4), (4, 5), (5, 6))]
SLOW = {"c": 3}  # modes beyond which a case is left out of the sweep, for its time
CONVERGED = {"a": 6, "b": 7, "c": 6}  # modes


def right_hand_side(case: Case, model: fa.Arm) -> Callable[[float, np.ndarray], np.ndarray]:
    """dy/dt of y = [q; v]. Where a trial step has left the possible, NaN, which makes SciPy shorten it."""
    n = model.nv

    def finite(v: np.ndarray, a: Callable[[], np.ndarray]) -> np.ndarray:
        try:
            return np.concatenate([v, a()])
        except ValueError:
            return np.full(2 * n, np.nan)

    def driven(t: float, y: np.ndarray) -> np.ndarray:
        q, v, hub = y[:n].copy(), y[n:].copy(), case.angle(t)
        q[0], v[0] = hub[:2]
        return finite(v, lambda: model.forward_dynamics(q, v, prescribed={0: hub[2]}))

    first = [model.joint_rate(b) for b in range(case.beams)]

    def torqued(t: float, y: np.ndarray) -> np.ndarray:
        tau = np.zeros(n)
        tau[first] = [case.torque(t, b) for b in range(case.beams)]
        return finite(y[n:], lambda: model.forward_dynamics(y[:n], y[n:], tau))

    return driven if case.spin else torqued


def simulate(case: Case, model: fa.Arm, method: str, rtol: float) -> np.ndarray | None:
    """The tip's path (outputs + 1, 2); integrated anew from each time where the drive has a kink."""
    f, y, rows = right_hand_side(case, model), np.zeros(2 * model.nv), []
    kinks = [k for k in (case.spin[1:] if case.spin else case.knots) if 0 < k < case.end]
    ends = [0.0, *kinks, case.end]
    for start, end in pairwise(ends):
        times = np.unique(np.append(case.times[(case.times >= start - 1e-12) & (case.times < end - 1e-12)], end))
        times = np.clip(times, start, end)
        out = solve_ivp(f, (start, end), y, method, t_eval=times, rtol=rtol, atol=1e-2 * rtol)
        if not out.success:
            return None
        y = out.y[:, -1]
        rows.append(out.y[: model.nv, :-1].T)
    q = np.vstack([*rows, y[None, : model.nv]])
    if case.spin:
        q[:, 0] = [case.angle(t)[0] for t in case.times]
    return model.frame(q)[0][:, :2]


def truth(case: Case) -> None:
    """The converged model; checked by one with a mode fewer, solved at another tolerance. For a driven beam also the
    one without rotary inertia, to compare with Exudyn's ANCF."""
    n = CONVERGED[case.name]
    kinds: list[tuple[str, dict[str, Any]]] = [(TRUTH, {})]
    if case.beams == 1:
        kinds += [("bending", {"rotary_inertia": False})]
    for name, beam in kinds:
        both = [simulate(case, arm(case, k, **beam), "DOP853", r) for k, r in ((n, 1e-9), (n - 1, 1e-8))]
        fine, coarse = (np.full((case.outputs + 1, 2), np.nan) if p is None else p for p in both)
        converged = float(np.linalg.norm(fine - coarse, axis=1).max())
        report("truth", case, "flexarm with DOP853", f"{n} Legendre modes, rtol 1e-9", name, fine, converged=converged)


def run(case: Case, method: str, modes: int, rtol: float) -> None:
    """One setting."""
    setup, model = measure(lambda: arm(case, modes))
    cpu, path = measure(lambda: simulate(case, model, method, rtol))
    setting = f"{modes} legendre modes, rtol {rtol:.0e}"
    report("run", case, f"SciPy {method}, order exact", setting, TRUTH, path, cpu_s=cpu, setup_s=setup)


if __name__ == "__main__":
    versions(scipy=scipy.__version__)
    for case, wants_truth in wanted():
        if wants_truth:
            truth(case)
        else:
            for setting in SWEEP:
                if setting[1] <= SLOW.get(case.name, 9):
                    run(case, *setting)
