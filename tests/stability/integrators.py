"""Measures of how integrators fail: BDF above order 2, stiff coordinates, solutions that run away.

Each function returns numbers; test_integrators.py judges them, bench/failures/failures.py draws them.
"""

from __future__ import annotations

import warnings
from math import comb

import flexarm as fa
import numpy as np
from arms import paper_link

RK4_LIMIT = 2.828427  # of h omega

# -- backward differentiation on an undamped oscillation ---------------------------------------------------------------


def bdf_growth(order: int, phase: np.ndarray) -> np.ndarray:
    """Largest growth per step of BDF with fixed steps on y' = i omega y, for h omega = phase: the largest root of
    sum_j 1/j (1 - 1/z)^j = i h omega, by its companion matrix."""
    a = np.zeros(order + 1)
    for j in range(1, order + 1):
        for m in range(j + 1):
            a[m] += (-1) ** m * comb(j, m) / j
    out = []
    for x in phase:
        p = a.astype(complex)
        p[0] -= 1j * x
        companion = np.zeros((order, order), complex)
        companion[0] = -p[1:] / p[0]
        companion[1:, :-1] = np.eye(order - 1)
        out.append(np.abs(np.linalg.eigvals(companion)).max())
    return np.array(out)


def bdf_limits(order: int) -> tuple[float, float]:
    """Largest growth per step, and the h omega above which the method is stable again (0 if it always is)."""
    phase = np.linspace(0.0, 10.0, 20001)[1:]
    growth = bdf_growth(order, phase)
    unstable = np.flatnonzero(growth > 1 + 1e-9)
    return float(growth.max()), float(phase[unstable[-1]]) if unstable.size else 0.0


def quiet_mode(max_order: int, duration: float = 0.5, rtol: float = 1e-4) -> dict:
    """The paper's link on a wall, undamped, let go bent in its first mode by 0.02 m: what IDA makes of modes 4 to 6,
    which stay at some 2e-8 m in truth. Returns t, `fast` (largest of their amplitudes, m), steps, and the drift of the
    energy."""
    beam = paper_link(n=6).links[0].beam
    arm = fa.Arm([fa.Link(fa.Fixed(), beam=beam)])
    modes = arm.modes()
    t = np.linspace(0, duration, 251)
    q0 = np.real(modes.shapes[:, 0]) * 0.02
    r = fa.simulate(arm, t, q0, rtol=rtol, atol=1e-3 * rtol, max_order=max_order)
    amplitude = np.abs(r.q @ np.linalg.inv(np.real(modes.shapes)).T)
    energy = np.add(*r.energy())
    return {
        "t": t,
        "fast": amplitude[:, 3:].max(axis=1),
        "steps": r.stats["steps"],
        "drift": float(energy[-1] / energy[0] - 1),
    }


# -- stiff shear -------------------------------------------------------------------------------------------------------


def stiff_shear(shear: int, max_order: int = 2, samples: int = 101) -> dict:
    """The paper's spin-up with n shear coordinates: fastest frequency (rad/s), steps, wall time (s), path of the tip
    (nt,) in m, and the steps explicit RK4 would need for stability alone."""
    beam = paper_link().links[0].beam
    modes = {"bending_y": 3} | ({"shear_y": shear} if shear else {})
    link = fa.Beam(beam.length, beam.section, beam.material, modes)
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(end=(0.075, 0, 0)), link)])
    fastest = float(arm.modes(lock=[0]).frequencies.max())
    r = fa.simulate(arm, np.linspace(0, 1, samples), drive={0: fa.Motion.spin_up(7.6, 0.5)}, max_order=max_order)
    return {
        "fastest": fastest,
        "steps": r.stats["steps"],
        "wall": r.stats["wall_time"],
        "tip": r.tip_deflection()[:, 1],
        "rk4": fastest / RK4_LIMIT,
    }


# -- solutions that run away -------------------------------------------------------------------------------------------


def collapse(blow_up: float = 1.0, power: int = 3) -> dict:
    """A torque 1/(blow_up - t)^power on a rigid body of unit inertia, asked for twice that time: what happened, the
    time reached (s), the rows kept, and the steps taken."""
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(inertia=(0, 0, 1.0)))])
    torque = fa.Torque(lambda t: 1.0 / max(blow_up - t, 1e-300) ** power)
    return _failed(arm, np.linspace(0, 2 * blow_up, 2001), {"drive": {0: torque}})


def overflow(speed: float = 100.0, modes: int = 1, integrator: str = "ida", **options) -> dict:
    """The paper's link at order 1 with one mode (or more), far above its critical speed: it grows as
    exp(sqrt(speed^2 - 20.95^2) t) until squares leave double precision, at 1e154."""
    arm = paper_link(1, modes, rotary_inertia=False)
    spin = fa.Motion(lambda x: (speed * x, speed, 0.0))
    how = {"drive": {0: spin}, "q0": arm.zero + 1e-6 * np.eye(arm.nq)[1], "integrator": integrator, **options}
    return _failed(arm, np.linspace(0, 20, 2001), how)


def _failed(arm: fa.Arm, t: np.ndarray, how: dict) -> dict:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.errors.RangeWarning)
        try:
            fa.simulate(arm, t, **how)
        except fa.SimulationError as e:
            return {
                "message": str(e),
                "time": e.time,
                "t": e.result.t,
                "q": e.result.q,
                "steps": e.result.stats["steps"],
            }
    return {"message": "", "time": t[-1], "t": t, "q": None, "steps": 0}
