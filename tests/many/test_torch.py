"""flexarm.torch: gradients of rollouts against differences, and what is learned with them."""

import flexarm as fa
import numpy as np
import pytest

torch = pytest.importorskip("torch")
from flexarm.torch import rollout  # noqa: E402
from messages import refuses  # noqa: E402

STEP = 4e-3


def arm_with(mass: float) -> fa.Arm:
    rod = fa.Material(7850.0, 209e9, 0.3)
    beam = fa.Beam(0.4, fa.Rectangle(0.004, 0.01), rod, {"bending_y": 1}, "legendre", "exact")
    link = fa.Link(fa.Revolute("y", damping=0.05), fa.RigidBody(0.2, inertia=(1e-3,) * 3), beam, fa.RigidBody(mass))
    return fa.Arm([link], gravity=(0, 0, -9.81))


def arm_of() -> fa.Arm:
    return arm_with(0.1)


def tensors(*shapes: tuple[int, ...]) -> list:
    rng = np.random.default_rng(1)
    return [torch.tensor(0.1 * rng.normal(size=s), dtype=torch.float64, requires_grad=True) for s in shapes]


@pytest.mark.parametrize("integrator", ["implicit", "rk4"])
def test_gradients_of_all_arguments(integrator: str) -> None:
    arm = arm_of()
    n, step = arm.nv, STEP if integrator == "implicit" else 1e-4
    q0, v0, tau = tensors((n,), (n,), (4, n))
    mass = torch.tensor(0.1, dtype=torch.float64, requires_grad=True)
    gravity = torch.tensor([0.1, 0.2, -9.81], dtype=torch.float64, requires_grad=True)
    rtol = {"rtol": 1e-13} if integrator == "implicit" else {}

    def rows(q0: object, v0: object, tau: object, mass: object, gravity: object) -> tuple:
        values = {"link.0.tip.mass": mass, "gravity": gravity}
        q, v = rollout(arm, q0, v0, tau, step=step, parameters=values, integrator=integrator, **rtol)
        return q, 0.01 * v

    assert torch.autograd.gradcheck(rows, (0.1 * q0.detach(), v0, tau, mass, gravity), eps=1e-5, atol=1e-7, rtol=1e-5)


def test_scenarios_fit_together_and_share() -> None:
    """One start, three masses, two lots of forces: six scenarios."""
    arm = arm_of()
    n = arm.nv
    q0, tau = tensors((n,), (2, 1, 5, n))
    mass = torch.tensor([0.05, 0.1, 0.2], dtype=torch.float64, requires_grad=True)
    q, v = rollout(arm, q0, torch.zeros(n), tau, step=STEP, parameters={"link.0.tip.mass": mass})
    assert q.shape == (2, 3, 6, n) and v.shape == (2, 3, 6, n)
    one = fa.rollout(arm_with(0.2), q0.detach().numpy(), None, tau[1, 0].detach().numpy(), step=STEP)
    np.testing.assert_allclose(q[1, 2].detach().numpy(), one.q[0], atol=1e-12)
    (q**2).sum().backward()
    assert q0.grad.shape == (n,) and tau.grad.shape == tau.shape and mass.grad.shape == (3,)
    for k, m in enumerate((0.05, 0.1, 0.2)):
        total = 0.0
        for j in range(2):
            r = fa.rollout(arm_with(m), q0.detach().numpy(), None, tau[j, 0].detach().numpy(), step=STEP)
            g = fa.rollout_gradient(arm_with(m), r.q[0], r.v[0], tau[j, 0].detach().numpy(), 2 * r.q[0], step=STEP,
                                    parameters=["link.0.tip.mass"])  # fmt: skip
            total += g.parameters["link.0.tip.mass"]
        assert float(mass.grad[k]) == pytest.approx(total, rel=1e-8)


def test_a_payload_is_found_by_descent() -> None:
    arm, n = arm_of(), arm_of().nv
    tau = np.zeros((50, n))
    tau[:, 0] = 0.3 * np.sin(0.2 * np.arange(50))
    seen = torch.tensor(fa.rollout(arm_with(0.137), arm.zero, None, tau, step=STEP).q[0])
    log_mass = torch.tensor(np.log(0.05), requires_grad=True)
    optimiser = torch.optim.LBFGS([log_mass], line_search_fn="strong_wolfe", tolerance_grad=1e-14,
                                  tolerance_change=0.0)  # fmt: skip

    def loss() -> object:
        optimiser.zero_grad()
        q, _ = rollout(arm, arm.zero, np.zeros(n), tau, step=STEP, parameters={"link.0.tip.mass": log_mass.exp()})
        value = ((q - seen) ** 2).sum()
        value.backward()
        return value

    for _ in range(3):
        optimiser.step(loss)
    assert float(log_mass.detach().exp()) == pytest.approx(0.137, rel=1e-6)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"q0": torch.zeros(3)}, ("q0 has shape (3,)", "(..., 2)")),
        ({"tau": torch.zeros(2)}, ("tau has shape (2,)", "(..., nstep, 2)")),
        ({"parameters": {"link.0.tip.mas": 1.0}}, "link.0.tip.mass"),
        ({"parameters": {"q0": 1.0}}, "argument"),
        ({"q0": torch.zeros(3, 2), "v0": torch.zeros(4, 2)}, "together"),
        ({"integrator": "gauss"}, "integrator = 'gauss'"),
        ({"v0": torch.full((2,), float("nan"))}, "v0"),
        ({"arm": [arm_of()]}, "Arm"),
    ],
)
def test_bad_input(change: dict, says: str) -> None:
    given = {"arm": arm_of(), "q0": torch.zeros(2), "v0": torch.zeros(2), "tau": torch.zeros(3, 2), "step": STEP}
    given |= change
    with refuses(says):
        rollout(**given)


def test_there_are_no_second_derivatives() -> None:
    arm = arm_of()
    (q0,) = tensors((2,))
    q, _ = rollout(arm, q0, torch.zeros(2), torch.zeros(3, 2), step=STEP)
    (g,) = torch.autograd.grad((q**2).sum(), q0, create_graph=True)
    with refuses("once_differentiable", error=RuntimeError):
        g.sum().backward()
