"""Measures of dry friction: a block of 1 kg pushed by less than its friction, by three treatments.

Each function returns numbers; test_stability_friction.py judges them, bench/failures/failures.py draws them.
"""

from __future__ import annotations

from collections.abc import Callable

import flexarm as fa
import numpy as np
from scipy.integrate import RK45

COULOMB, PUSH = 2.0, 1.5  # N


def block() -> fa.Arm:
    """A block of 1 kg on a rough line."""
    return fa.Arm([fa.Link(fa.Prismatic("x", coulomb=COULOMB), fa.RigidBody(1.0))])


def chosen(t: np.ndarray, v0: float = 0.5, **options) -> fa.Result:
    """This program: sticks and slides, pushed by PUSH from the speed v0 on."""
    return fa.simulate(block(), t, v0=[v0], tau=[PUSH], **options)


def _rate(law: Callable[[float], float]) -> Callable[[float, np.ndarray], np.ndarray]:
    arm = block()  # forward_dynamics leaves dry friction out: the law puts it in

    def f(_t: float, x: np.ndarray) -> np.ndarray:
        return np.array([x[1], arm.forward_dynamics(x[:1], x[1:], [PUSH - law(x[1])])[0]])

    return f


def sign(v: float) -> float:
    """Friction as a sign function."""
    return COULOMB * float(np.sign(v))


def smooth(v: float, width: float = 1e-3) -> float:
    """Friction smoothed over +- width (m/s)."""
    return COULOMB * float(np.tanh(v / width))


def rk4(law: Callable[[float], float], t: np.ndarray, v0: float = 0.5) -> np.ndarray:
    """Place and speed (nt, 2) by classical RK4 with steps from t to t."""
    f, x = _rate(law), [np.array([0.0, v0])]
    for now, h in zip(t, np.diff(t), strict=False):
        k1 = f(now, x[-1])
        k2 = f(now + h / 2, x[-1] + h / 2 * k1)
        k3 = f(now + h / 2, x[-1] + h / 2 * k2)
        k4 = f(now + h, x[-1] + h * k3)
        x.append(x[-1] + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
    return np.array(x)


def adaptive(law: Callable[[float], float], end: float, v0: float = 0.5, most: int = 20_000) -> dict[str, float]:
    """SciPy's RK45 at rtol 1e-6 up to `end`, or for about so many evaluations: how many it took, how far it came (s),
    and the speed there (m/s)."""
    solver = RK45(_rate(law), 0.0, [0.0, v0], end, rtol=1e-6, atol=1e-9)
    while solver.status == "running" and solver.nfev < most:
        solver.step()
    return {"evaluations": solver.nfev, "reached": float(solver.t), "speed": float(solver.y[1])}
