"""What an arm lacks costs nothing."""

import flexarm as fa
from arms import STEEL


def operations(**beam: object) -> int:
    """Of one link."""
    options = {"length": 0.5, "section": fa.Rectangle(y=0.001, z=0.02), "material": STEEL, **beam}
    link = fa.Link(fa.Revolute("z"), fa.RigidBody(0.2, inertia=(1e-3,) * 3), fa.Beam(**options))
    return fa.Arm([link]).operation_count()


def test_operations_grow_with_what_is_modelled() -> None:
    modes = [{}, {"bending_y": 1}, {"bending_y": 3}, {"bending_y": 3, "bending_z": 3}]
    counts = [operations(modes=m) for m in modes] + [operations(modes=modes[-1] | {"torsion": 1})]
    assert counts == sorted(set(counts))
    assert counts[-1] > 20 * counts[1] > 20 * counts[0]  # the plane is left
    assert operations(modes=modes[2], order=1) < counts[2] < operations(modes=modes[2], damping_ratio=0.01)


def test_a_patch_costs_nothing_once_it_is_set_up() -> None:
    patch = fa.Patch(0.1, 0.2, 0.02, 5e-4, fa.Piezo(62e9, 0.3, 7800.0, d31=-1.8e-10), mass=False)
    assert operations(modes={"bending_y": 2}, patches=[patch]) == operations(modes={"bending_y": 2})


def test_every_order_has_a_count() -> None:
    counts = [operations(modes={"bending_y": 2}, order=order) for order in (0, 1, 2, 3, "exact")]
    assert min(counts) > 0
    assert counts[2] < min(counts[3:])


def test_a_ball_costs_less_than_three_hinges() -> None:
    def count(joint: fa.Joint) -> int:
        links = [fa.Link(joint, fa.RigidBody(1.0, inertia=(1, 1, 1), end=(0.1, 0.2, 0.3))) for _ in range(2)]
        return fa.Arm(links).operation_count()

    assert 0 < count(fa.Spherical()) < count(fa.Axes(("rx", "ry", "rz")))
