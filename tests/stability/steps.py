"""Measures of fixed steps: the step limit of explicit RK4, and what becomes of energy over very many steps.

Each function returns numbers; test_stability_steps.py judges them, bench/failures/failures.py draws them.
"""

from __future__ import annotations

import flexarm as fa
import numpy as np
from arms import paper_link, pendulum, reference
from run.test_steps import amplification, slider

LIMIT = 2 * np.sqrt(2)  # of h omega, for classical RK4 on undamped oscillation


def rk4_growth(phase: np.ndarray | float) -> np.ndarray:
    """Growth of an undamped oscillation in one step of classical RK4 with h omega = phase: |sum_k (i x)^k / k!|."""
    x = np.asarray(phase, dtype=float)
    return np.hypot(1 - x**2 / 2 + x**4 / 24, x - x**3 / 6)


def dividing(time: float, count: int) -> float:
    """A step that makes `count` of a time exactly, whatever rounding does: a little longer than they are."""
    return time / (count - 0.5)


def alpha_growth(radius: float, phase: float) -> float:
    """The same of generalised-alpha in the long run: spectral radius of its map of (q, v, a)."""
    return float(np.abs(np.linalg.eigvals(amplification(radius, phase))).max())


def alpha_path(radius: float, phase: float, steps: int) -> np.ndarray:
    """Amplitude sqrt((omega q)^2 + v^2), by that at the start, after every step of generalised-alpha from (1, 0): by
    powers of that map. Below radius 1 the first steps of a fast mode grow, as n radius^n: its roots are double."""
    A, x = amplification(radius, phase), [np.array([1.0, 0.0, -(phase**2)])]
    for _ in range(steps):
        x.append(A @ x[-1])
    q, v, _ = np.array(x).T
    return np.hypot(phase * q, v) / phase


# -- the step limit ----------------------------------------------------------------------------------------------------


def clamped_link(shear: int = 0) -> fa.Arm:
    """The paper's link on a wall, with three bending and n shear coordinates."""
    beam = paper_link().links[0].beam
    modes = {"bending_y": 3} | ({"shear_y": shear} if shear else {})
    return fa.Arm([fa.Link(fa.Fixed(), beam=fa.Beam(beam.length, beam.section, beam.material, modes))])


def fastest_mode(shear: int, phase: float, steps: int, size: float = 1e-10, **options) -> np.ndarray:
    """Amplitude, by that at the start, of the fastest mode of that link after every step of h = phase / omega, let go
    with `size` in its largest coordinate: so little that the motion is linear. sqrt((omega q)^2 + v^2) of the mode."""
    arm = clamped_link(shear)
    modes = arm.modes()
    omega, shapes = modes.frequencies[-1], np.real(modes.shapes)
    h = phase / omega
    q0 = shapes[:, -1] * size / np.abs(shapes[:, -1]).max()
    r = fa.simulate(arm, np.arange(steps + 1) * h, q0, step=dividing(steps * h, steps), **options)
    part = np.linalg.inv(shapes)[-1]
    amplitude = np.hypot(omega * (r.q @ part), r.v @ part)
    return amplitude / amplitude[0]


def growth(amplitude: np.ndarray) -> float:
    """Growth per step, first to last."""
    return float(amplitude[-1] ** (1 / (len(amplitude) - 1)))


def spin_up(shear: int, samples: int = 101, **options) -> tuple[np.ndarray, int]:
    """Path of the tip (nt,) in m of the paper's spin-up with n shear coordinates, and the steps taken."""
    beam = clamped_link(shear).links[0].beam
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(end=(0.075, 0, 0)), beam)])
    drive = {0: fa.Motion.spin_up(7.6, 0.5)}
    r = fa.simulate(arm, np.linspace(0, 1, samples), drive=drive, **options)
    return r.tip_deflection()[:, 1], int(r.stats["steps"])


# -- energy ------------------------------------------------------------------------------------------------------------


def oscillator(cycles: np.ndarray, per_period: int, swinging: bool = False, **options) -> np.ndarray:
    """Relative error of the energy of an undamped oscillator after these whole numbers of periods, in so many steps
    each: a mass on a spring with a period of 1 s, or a pendulum that swings by 1 rad either way."""
    arm, q0, period = slider((2 * np.pi) ** 2), [1.0], 1.0
    if swinging:  # the period is that of small swings, shorter than the real one: no matter
        arm, q0, period = pendulum(), [1.0 - np.pi / 2], 2.0
    t = np.concatenate([[0.0], cycles]) * period
    if options.get("integrator", "ida") != "ida":
        options["step"] = dividing(t[-1], int(cycles[-1]) * per_period)
    energy = np.sum(fa.simulate(arm, t, q0, **options).energy(), axis=0)
    lowest = -9.81 if swinging else 0.0
    return (energy - energy[0])[1:] / (energy[0] - lowest)


def free_arm(steps: int, h: float, outputs: int = 1000, **options) -> dict:
    """The paper's arm, free, bent by 0.05 m and turning at 2 rad/s, for `steps` of h: output steps, relative error
    of the energy there, its slope (over the run, of a line fitted), its swing about that line, steps, computing (s)."""
    arm = fa.Arm.from_dict(reference("ist_order2")["scene"])
    q0, v0 = np.zeros(arm.nq), np.zeros(arm.nv)
    q0[1], v0[0] = 0.05, 2.0
    at = np.arange(outputs + 1) * (steps // outputs)
    if options.get("integrator", "ida") != "ida":
        options["step"] = dividing(steps * h, steps)
    r = fa.simulate(arm, at * h, q0, v0, **options)
    energy = np.sum(r.energy(), axis=0)
    error = energy / energy[0] - 1
    x = np.linspace(0, 1, len(at))
    slope = float(np.polyfit(x, error, 1)[0])
    return {
        "at": at,
        "error": error,
        "slope": slope,
        "swing": float(np.ptp(error - slope * x)),
        "steps": int(r.stats["steps"]),
        "wall": float(r.stats["wall_time"]),
    }
