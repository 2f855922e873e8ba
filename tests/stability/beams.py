"""Measures of how models of a beam fail: spurious softening, monomials, eigenvalues, heavy tips, large bending.

Each function returns numbers; test_beams.py judges them, bench/failures/failures.py draws them.
"""

from __future__ import annotations

import warnings

import flexarm as fa
import mpmath
import numpy as np
from arms import paper_link
from scipy import linalg

CRITICAL = 20.948766  # rad/s: the first clamped-free frequency of the paper's link, without rotary inertia


def clamped(modes: dict[str, int], order: int | str = 2, tip: fa.RigidBody | None = None, **beam) -> fa.Arm:
    """A beam on a wall with L = EI = rho A = 1."""
    options = {"basis": "legendre", "rotary_inertia": False} | beam
    section, material = fa.sections.GeneralSection(1.0, 1.0, 1.0, 1.0), fa.Material(1.0, 1.0, 0.3)
    return fa.Arm([fa.Link(fa.Fixed(), beam=fa.Beam(1.0, section, material, modes, order=order, **options), tip=tip)])


def stiffness(arm: fa.Arm) -> np.ndarray:
    """dh/dq at rest, (nv, nv)."""
    zero = np.zeros(arm.nv)
    return arm.inverse_derivatives(arm.zero, zero, zero)[0]


# -- order 1 above its critical speed ---------------------------------------------------------------------------------


def growth_at_speed(order: int | str, speed: float, time: float = 1.0) -> tuple[float, float]:
    """Rate (1/s) at which a small deflection of the paper's link, hub at constant speed, grows over the second half of
    a simulation of `time` s (0 if its envelope does not), and the largest tip deflection met (m)."""
    arm = paper_link(order, rotary_inertia=False)
    t = np.linspace(0, time, 401)
    spin = fa.Motion(lambda x: (speed * x, speed, 0.0))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.errors.RangeWarning)  # that is what is to be seen
        r = fa.simulate(arm, t, arm.zero + np.eye(arm.nq)[1] * 1e-9, drive={0: spin}, rtol=1e-8, atol=1e-17)
    tip = np.abs(r.tip_deflection()[:, 1])
    half = len(t) // 2
    rate = np.polyfit(t[half:], np.log(tip[half:] + 1e-300), 1)[0]
    return (float(rate) if (np.diff(tip[half:]) > 0).all() else 0.0), float(tip.max())


def largest_rotation(r: fa.Result) -> float:
    """Of a section of the first beam (rad), as RangeWarning measures it."""
    (found,) = (x for x in r.check(fa.Watch({("rotation", 0): 0.0})) if x.limit == 0.0)
    return float(found.value)


def spin_up(order: int | str, speed: float, time: float = 0.5, samples: int = 201) -> tuple[np.ndarray, float]:
    """Path of the tip (nt, 3) of the paper's link in a spin-up, by its length, and the largest rotation of a section
    (rad) that RangeWarning's measure finds."""
    arm = paper_link(order, 5, "legendre")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.errors.RangeWarning)
        r = fa.simulate(arm, np.linspace(0, time, samples), drive={0: fa.Motion.spin_up(speed, time)}, max_order=2)
    return r.tip_deflection() / arm.links[0].beam.length, largest_rotation(r)


# -- shape functions and eigenvalues ----------------------------------------------------------------------------------


def monomial_mass(n: int) -> np.ndarray:
    """Mass matrix of the deflections x^2 ... x^(n + 1) of a beam with L = rho A = 1: 1/(i + j + 1)."""
    k = np.arange(2, n + 2)
    return 1.0 / (k[:, None] + k + 1)


def monomial_condition(n: int) -> float:
    """Its condition number, to 60 digits."""
    with mpmath.workdps(60):
        values = mpmath.eigsy(mpmath.matrix(n, n) + mpmath.matrix([[mpmath.mpf(1) / (i + j + 5) for j in range(n)]
                                                                   for i in range(n)]), eigvals_only=True)  # fmt: skip
        return float(values[n - 1] / values[0])


def definite(M: np.ndarray) -> bool:
    """Whether every eigenvalue of a symmetric matrix is positive in double precision, scaled to a unit diagonal."""
    d = 1.0 / np.sqrt(np.diag(M))
    return bool(np.linalg.eigvalsh(d[:, None] * M * d)[0] > 0)


def sheared(n: int) -> fa.Arm:
    """The paper's link clamped, with n bending and n shear coordinates: its shear reaches 1e7 rad/s."""
    beam = paper_link().links[0].beam
    modes = {"bending_y": n, "shear_y": n}
    return fa.Arm([fa.Link(fa.Fixed(), beam=fa.Beam(0.5, beam.section, beam.material, modes, "legendre"))])


def first_frequency_errors(arm: fa.Arm) -> tuple[float, float]:
    """Relative error of the first frequency by scipy's eigh(K, M) and by arm.modes, against inverse iteration on the
    same matrices in 40 digits."""
    M, K = arm.mass_matrix(arm.zero), stiffness(arm)
    K = 0.5 * (K + K.T)
    with mpmath.workdps(40):
        Km, Mm = mpmath.matrix(K.tolist()), mpmath.matrix(M.tolist())
        step = mpmath.inverse(Km) * Mm
        x = mpmath.ones(len(M), 1)
        for _ in range(12):
            x = step * x
            x /= mpmath.norm(x)
        truth = mpmath.sqrt((x.T * Km * x)[0] / (x.T * Mm * x)[0])
        found = np.sqrt(linalg.eigh(K, M, eigvals_only=True)[0]), arm.modes().frequencies[0]
        return float(abs(found[0] / truth - 1)), float(abs(found[1] / truth - 1))


# -- a heavy tip ------------------------------------------------------------------------------------------------------


def tip_mass_frequencies(mu: float) -> tuple[np.ndarray, np.ndarray]:
    """First two frequencies of the clamped beam with a tip mu times its mass: arm.modes, and the closed form
    1 + cos b cosh b + mu b (cos b sinh b - sin b cosh b) = 0, omega = b^2."""
    found = clamped({"bending_y": 10}, tip=fa.RigidBody(mu)).modes().frequencies[:2]
    with mpmath.workdps(30):

        def f(b):  # divided by cosh b
            return 1 / mpmath.cosh(b) + mpmath.cos(b) + mu * b * (mpmath.cos(b) * mpmath.tanh(b) - mpmath.sin(b))

        roots = [mpmath.findroot(f, guess) for guess in ((3 / (mu + 0.25)) ** 0.25, 3.93)]
        return found, np.array([float(b**2) for b in roots])


def heavy_tip_residual(mu: float, method: str, links: int = 6, states: int = 5) -> float:
    """Of a chain of flexible links with a tip mu times one of them: what inverse dynamics of the accelerations leaves
    of tau (of size 1), by the largest of tau; the median over random states."""
    rng = np.random.default_rng(3)
    beam = clamped({"bending_y": 3}).links[0].beam
    chain = [fa.Link(fa.Revolute("z"), beam=beam)] * (links - 1)
    arm = fa.Arm([*chain, fa.Link(fa.Revolute("z"), beam=beam, tip=fa.RigidBody(mu))])
    joints = np.array(["revolute" in c for c in arm.coordinates])
    out = []
    for _ in range(states):
        q, v, tau = rng.normal(size=(3, arm.nv)) * np.where(joints, 1.0, 0.05)
        a = arm.forward_dynamics(q, v, tau, method)
        left = arm.inverse_dynamics(q, v, a) - tau
        out.append(np.abs(left).max() / np.abs(tau).max())
    return float(np.median(out))


# -- large bending ----------------------------------------------------------------------------------------------------

LOADS = {  # static loads of size P on the unit beam
    "tip force": lambda P: [fa.Load(force=(0, P, 0))],
    "tip moment": lambda P: [fa.Load(moment=(0, 0, P))],
    "uniform load": lambda P: [fa.Load(force=(0, P, 0), along=(0.0, 1.0))],
    "force against moment": lambda P: [fa.Load(force=(0, -2.2 * P, 0)), fa.Load(moment=(0, 0, P))],
}


def static_error(order: int, load: str, sizes: np.ndarray) -> np.ndarray:
    """Rows (rotation (rad) that RangeWarning's measure finds, distance of the tip from where "exact" has it, by the
    length) for loads of these sizes; shorter where an order finds no equilibrium."""
    arm, exact = clamped({"bending_y": 8}, order, fa.RigidBody(1e-9)), clamped({"bending_y": 8}, "exact")
    q, truth, rows = arm.zero, exact.zero, []
    for P in sizes:
        try:
            q, truth = arm.equilibrium(q, loads=LOADS[load](P)), exact.equilibrium(truth, loads=LOADS[load](P))
        except ValueError:
            break
        still = fa.Result(arm, np.zeros(1), q[None], *[np.zeros((1, arm.nv))] * 3)
        rows.append((largest_rotation(still), np.linalg.norm(arm.frame(q)[0] - exact.frame(truth)[0])))
    return np.array(rows).reshape(-1, 2)
