"""What an arm lacks costs nothing."""

import flexarm as fa
import pytest
from arms import STEEL


def operations(**beam: object) -> int:
    """Of one link."""
    options = {"length": 0.5, "section": fa.Rectangle(y=0.001, z=0.02), "material": STEEL, **beam}
    hub = fa.RigidBody(0.2, inertia=(1e-3,) * 3)
    return fa.Arm([fa.Link(fa.Revolute("z"), hub, fa.Beam(**options))]).operation_count()


def test_operations_grow_with_what_is_modelled() -> None:
    modes = [{}, {"bending_y": 1}, {"bending_y": 3}, {"bending_y": 3, "bending_z": 3}]
    counts = [operations(modes=m) for m in modes] + [operations(modes=modes[-1] | {"torsion": 1})]
    assert counts == sorted(set(counts))
    assert counts[-1] > 20 * counts[1] > 20 * counts[0]  # the plane is left
    assert operations(modes=modes[2], order=1) < counts[2] < operations(modes=modes[2], damping_ratio=0.01)


def test_a_patch_costs_nothing_once_it_is_set_up() -> None:
    patch = fa.Patch(0.1, 0.2, 0.02, 5e-4, fa.Piezo(62e9, 0.3, 7800.0, d31=-1.8e-10), mass=False)
    assert operations(modes={"bending_y": 2}, patches=[patch]) == operations(modes={"bending_y": 2})


@pytest.mark.parametrize("modes", [{"bending_y": 3}, {"bending_y": 3, "bending_z": 3, "torsion": 1}])
def test_operations_by_order(modes: dict[str, int]) -> None:
    """Orders 0 and 1 do without what 2 has; sections are turned at each Gauss point at order 3 and exactly."""
    count = {order: operations(modes=modes, order=order) for order in (0, 1, 2, 3, "exact")}
    assert 0 < max(count[0], count[1]) < count[2] < min(count[3], count["exact"])


def test_a_ball_costs_less_than_three_hinges() -> None:
    def count(joint: fa.Joint) -> int:
        links = [fa.Link(joint, fa.RigidBody(1.0, inertia=(1, 1, 1), end=(0.1, 0.2, 0.3))) for _ in range(2)]
        return fa.Arm(links).operation_count()

    assert 0 < count(fa.Spherical()) < count(fa.Axes(("rx", "ry", "rz")))
