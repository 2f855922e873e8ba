"""Arm.to_casadi: exact Jacobians against CasADi's own differences, and a move that IPOPT plans with them."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from arms import random_arm, random_state
from messages import refuses

casadi = pytest.importorskip("casadi")

STEP = 0.01


def two_links() -> fa.Arm:
    aluminium = fa.Material(2700.0, 70e9, 0.33)

    def link(length: float, height: float, tip: float) -> fa.Link:
        beam = fa.Beam(length, fa.Rectangle(height, 0.03), aluminium, {"bending_y": 2}, "legendre", damping_ratio=0.01)
        body = fa.RigidBody(tip, inertia=1e-4 * np.eye(3))
        return fa.Link(fa.Revolute("z", damping=0.02), fa.RigidBody(0.2, inertia=1e-3 * np.eye(3)), beam, body)

    return fa.Arm([link(0.5, 0.005, 0.2), link(0.4, 0.004, 0.1)], gravity=(0, 0, -9.81))


def jacobians(of: Any, at: list[np.ndarray]) -> list[np.ndarray]:
    """Of a function of CasADi by each of its arguments, as CasADi itself asks for them."""
    given = [casadi.MX.sym(of.name_in(k), of.sparsity_in(k)) for k in range(of.n_in())]
    whole = casadi.Function("whole", given, [casadi.jacobian(of(*given), x) for x in given])
    found = whole.call(at)
    return [np.array(x.full()) for x in found]


class Differences(casadi.Callback):
    """The same value, whose derivatives are left to CasADi."""

    def __init__(self, of: Any) -> None:
        super().__init__()
        self.of = of
        self.construct("differences", {"enable_fd": True, "fd_method": "smoothing"})

    def get_n_in(self) -> int:
        return int(self.of.n_in())

    def get_n_out(self) -> int:
        return 1

    def get_name_in(self, k: int) -> str:
        return str(self.of.name_in(k))

    def get_sparsity_in(self, k: int) -> Any:
        return self.of.sparsity_in(k)

    def get_sparsity_out(self, k: int) -> Any:
        return self.of.sparsity_out(k)

    def eval(self, given: Any) -> Any:
        return [self.of(*given)]


@pytest.mark.parametrize("columns", [1, 3])
@pytest.mark.parametrize("options", [{}, {"step": 4e-3}, {"integrator": fa.Implicit(4e-3, spectral_radius=0.8)}])
def test_jacobians_are_those_of_casadis_differences(columns: int, options: dict[str, Any]) -> None:
    arm = two_links()
    of = arm.to_casadi(columns=columns, **options)
    rng = np.random.default_rng(3)
    at = [rng.normal(size=of.sparsity_in(k).shape) for k in range(of.n_in())]
    at[0] *= np.where(np.arange(len(at[0]))[:, None] % arm.nv % 3 == 0, 0.3, 0.003)  # joints and beams
    for exact, near in zip(jacobians(of, at), jacobians(Differences(of), at), strict=True):
        assert np.abs(exact - near).max() < 2e-6 * np.abs(exact).max()


def test_a_jacobian_may_be_asked_for_by_itself() -> None:
    """CasADi gives nothing for arguments that are zero."""
    arm = two_links()
    of = arm.to_casadi()
    at = [np.full((arm.nq, 1), 1e-3), np.zeros((arm.nv, 1)), np.ones((arm.nv, 1))]
    found = of.jacobian()(*at, 0)
    for exact, near in zip(found, jacobians(of, at), strict=True):
        np.testing.assert_array_equal(np.array(exact), near)


def test_columns_are_states_by_themselves() -> None:
    """One call for all: numbers and slopes are those of flexarm's own functions, blocks on the diagonal."""
    arm, count = two_links(), 4
    n, rng = arm.nv, np.random.default_rng(5)
    q, v, tau = (scale * rng.normal(size=(count, n)) for scale in (0.01, 0.1, 0.1))
    of = arm.to_casadi(columns=count)
    assert [of.name_in(k) for k in range(3)] == ["q", "v", "tau"] and of.name_out(0) == "a"
    np.testing.assert_allclose(of(q.T, v.T, tau.T).full().T, arm.forward_dynamics(q, v, tau), rtol=1e-13)
    slopes = arm.forward_derivatives(q, v, tau)
    for kind, own in zip(("dq", "dv", "dtau"), slopes, strict=True):
        single = [getattr(arm.forward_derivatives(*at), kind) for at in zip(q, v, tau, strict=True)]
        np.testing.assert_array_equal(own, single)
    for found, own in zip(jacobians(of, [q.T, v.T, tau.T]), slopes, strict=True):
        blocks = found.reshape(count, n, count, n)
        np.testing.assert_array_equal(blocks[range(count), :, range(count)], own)
        assert np.count_nonzero(found) <= count * n * n
    step = arm.to_casadi(step=STEP, columns=count)
    ends = fa.step_derivatives(arm, q, v, tau, step=STEP)
    x = np.concatenate([q, v], axis=1)
    np.testing.assert_array_equal(step(x.T, tau.T).full().T, np.concatenate([ends.q, ends.v], axis=1))
    for found, own in zip(jacobians(step, [x.T, tau.T]), (ends.A, ends.B), strict=True):
        blocks = found.reshape(count, 2 * n, count, -1)
        np.testing.assert_array_equal(blocks[range(count), :, range(count)], own)


def test_accelerations_of_any_arm() -> None:
    """In space, and with a ball, whose quaternion has one number more than rates."""
    rng = np.random.default_rng(11)
    arm = random_arm(rng, 3)
    q, v, _ = random_state(rng, arm)
    ball = fa.Arm([fa.Link(fa.Spherical(), fa.RigidBody(1.0, (0.1, 0.2, 0.3), (1.0, 1.1, 1.2)))], (0, 0, -9.81))
    turned = np.array([0.8, 0.1, -0.4, 0.2])
    for one, at, rates in ((arm, q, v), (ball, turned, np.array([0.3, -0.2, 0.5]))):
        of, tau = one.to_casadi(), rng.normal(size=one.nv)
        np.testing.assert_allclose(of(at, rates, tau).full()[:, 0], one.forward_dynamics(at, rates, tau), rtol=1e-12)
        near = jacobians(Differences(of), [at, rates, tau])
        for exact, other in zip(jacobians(of, [at, rates, tau]), near, strict=True):
            assert np.abs(exact - other).max() < 1e-4 * np.abs(exact).max()


HORIZON, PERIOD = 40, 0.015
GOAL = np.array([0.9, -0.6])
LIMIT = np.array([4.0, 1.2])
METHOD = fa.Implicit(PERIOD, spectral_radius=0.9)


def planned(arm: fa.Arm, hessian: str) -> tuple[np.ndarray, np.ndarray, Any]:
    """From rest to rest by multiple shooting, within the limits of both motors: states, torques, numbers of IPOPT."""
    n, motors = arm.nv, arm.freedoms
    step = arm.to_casadi(integrator=METHOD, columns=HORIZON)
    task = casadi.Opti()
    x, u = task.variable(2 * n, HORIZON + 1), task.variable(len(motors), HORIZON)
    end = np.zeros(2 * n)
    end[motors] = GOAL
    away = (x - end)[motors, :]
    task.minimize(casadi.sumsqr(away) + 0.01 * casadi.sumsqr(x[n:, :]) + 1e-3 * casadi.sumsqr(u))
    task.subject_to(x[:, 1:] == step(x[:, :-1], casadi.mtimes(casadi.sparsify(np.eye(n)[:, motors]), u)))
    task.subject_to(x[:, 0] == 0)
    task.subject_to(x[:, -1] == end)
    most = np.outer(LIMIT, np.ones(HORIZON))
    task.subject_to(task.bounded(-most, u, most))
    options = {"print_level": 0, "sb": "yes", "hessian_approximation": hessian, "max_iter": 100}
    task.solver("ipopt", {"print_time": False}, options)
    found = task.solve()
    return found.value(x).T, found.value(u).T, found.stats()


def test_ipopt_moves_a_flexible_arm() -> None:
    """The plan is what flexarm's own rollout makes of its torques, and IDA up to the error of the plan's steps."""
    arm = two_links()
    n, motors = arm.nv, arm.freedoms
    x, u, stats = planned(arm, "limited-memory")
    assert stats["success"] and (np.abs(u) <= LIMIT * (1 + 1e-6)).all()
    assert (np.abs(u).max(axis=0) > 0.999 * LIMIT).all()  # both motors are at their limits
    tau = np.zeros((HORIZON, n))
    tau[:, motors] = u
    own = fa.rollout(arm, arm.zero, None, tau, integrator=METHOD)
    np.testing.assert_allclose(own.q[0], x[:, :n], atol=1e-6)
    np.testing.assert_allclose(own.v[0], x[:, n:], atol=1e-4)
    q, v = arm.zero, np.zeros(n)
    for force in tau:  # from one torque to the next
        run = fa.simulate(arm, [0.0, PERIOD], q, v, tau=force, rtol=1e-8, atol=1e-10)
        q, v = run.q[-1], run.v[-1]
    assert np.abs(q[motors] - GOAL).max() < 0.02
    bent = np.abs(x[:, :n]).max(axis=0)
    assert (np.delete(bent, motors) > 0.02).all()  # on the way


def test_hessians_by_differences_serve_too() -> None:
    """IPOPT's default takes fewer iterations to the same plan."""
    arm = two_links()
    (_, one, first), (_, other, second) = (planned(arm, kind) for kind in ("limited-memory", "exact"))
    assert np.abs(one - other).max() < 1e-3 and second["iter_count"] < first["iter_count"]


def test_collocation_by_accelerations() -> None:
    """Trapezoidal collocation of a motion under smooth torques, all nodes in one call, against IDA."""
    arm = two_links()
    n, motors, count, h = arm.nv, arm.freedoms, 100, 2e-3
    t = h * np.arange(count + 1)
    smooth = np.sin(np.pi * t / t[-1]) ** 2
    tau = np.zeros((n, count + 1))
    tau[motors] = np.outer([0.8, -0.3], smooth)
    of = arm.to_casadi(columns=count + 1)
    task = casadi.Opti()
    q, v = task.variable(n, count + 1), task.variable(n, count + 1)
    a = of(q, v, tau)
    for x, slope in ((q, v), (v, a)):
        task.subject_to(x[:, 0] == 0)
        task.subject_to(x[:, 1:] - x[:, :-1] == 0.5 * h * (slope[:, 1:] + slope[:, :-1]))
    options = {"print_level": 0, "sb": "yes", "hessian_approximation": "limited-memory"}
    task.solver("ipopt", {"print_time": False}, options)
    found = task.solve().value(q).T
    drive = {k: fa.Torque(t, tau[i]) for k, i in enumerate(motors)}
    run = fa.simulate(arm, t, drive=drive, rtol=1e-9, atol=1e-11)
    assert (np.abs(found - run.q).max(axis=0) < 0.01 * np.abs(run.q).max(axis=0)).all()


def test_bad_arguments_are_named() -> None:
    arm = two_links()
    rubbing = fa.Arm([fa.Link(fa.Revolute("z", coulomb=0.1), fa.RigidBody(1.0, inertia=(1, 1, 1)))])
    ball = fa.Arm([fa.Link(fa.Spherical(), fa.RigidBody(1.0, inertia=(1, 1, 1)))])
    with refuses("columns", 0):
        arm.to_casadi(columns=0)
    with refuses("step", -1):
        arm.to_casadi(step=-1.0)
    with refuses("integrator", "gauss", "implicit", "rk4"):
        arm.to_casadi(step=STEP, integrator="gauss")
    with refuses("step", STEP, "Implicit"):
        arm.to_casadi(step=STEP, integrator=fa.Implicit(STEP))
    with refuses("step"):
        arm.to_casadi(integrator="rk4")
    with refuses("friction"):
        rubbing.to_casadi(step=STEP)
    with refuses("ball"):
        ball.to_casadi(step=STEP)
    with refuses("step", "state 1", error=RuntimeError):
        arm.to_casadi(step=1.0, columns=2)(np.outer(np.ones(2 * arm.nv), [0.0, 1e200]), 0)


def test_it_is_imported_where_it_is_used() -> None:
    """And its absence is told."""
    text = """
import sys, flexarm as fa
assert "casadi" not in sys.modules
sys.modules["casadi"] = None
arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, inertia=(1, 1, 1)))])
try:
    arm.to_casadi()
except ImportError as e:
    assert "pip install casadi" in str(e)
else:
    raise SystemExit(1)
"""
    subprocess.run([sys.executable, "-c", text], check=True, timeout=120)
