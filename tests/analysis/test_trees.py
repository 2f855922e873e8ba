"""Trees: findings, tables, modes and equilibria of branches, against arms that are chains."""

from __future__ import annotations

import re
from dataclasses import replace

import flexarm as fa
import numpy as np
import pytest
from arms import STEEL, masts, paper_link, satellite, side_by_side, two_arms
from messages import warns
from scipy.linalg import eigh


def loaded(n: int = 1, tip: float = 0.3, **link: object) -> fa.Arm:
    beam = fa.Beam(0.5, fa.Rectangle(0.002, 0.02), STEEL, {"bending_y": n})
    return fa.Arm([fa.Link(fa.Revolute("z", stiffness=1.0), beam=beam, tip=fa.RigidBody(tip), **link)])


def test_findings_are_those_of_each_arm() -> None:
    """A beam does not bear the arm beside it, though that stands behind it in the list."""
    light, heavy = paper_link(), loaded()
    assert not fa.check(light) and len(fa.check(heavy)) == 1
    for pair, k in ((side_by_side(light, heavy), 1), (side_by_side(heavy, light), 0)):
        assert [str(x) for x in fa.check(pair)] == [re.sub(r"link\[0\]", f"link[{k}]", str(x)) for x in fa.check(heavy)]
    both = [str(x) for x in fa.check(side_by_side(heavy, heavy))]
    assert [x[:7] for x in both] == ["link[0]", "link[1]"] and both[0][7:] == both[1][7:] == str(fa.check(heavy)[0])[7:]


def test_a_beam_bears_all_its_branches() -> None:
    """Two loads on one end are as one of both, fixed or held by springs; a joint that nothing holds passes none on."""
    one = loaded(tip=0.3)
    beam = one.links[0].beam
    first = fa.Link(fa.Revolute("z", stiffness=1.0), beam=beam)
    half = fa.RigidBody(0.15)
    tree = fa.Arm([first, fa.Link(fa.Fixed(), half), fa.Link(fa.Fixed(), half, parent=0)])
    (a,), (b,) = fa.check(one), fa.check(tree)
    assert a.value == pytest.approx(b.value) and a.where == b.where
    loose = fa.Arm(
        [
            first,
            fa.Link(fa.Fixed(), fa.RigidBody(0.02)),
            fa.Link(fa.Planar(), fa.RigidBody(0.3, inertia=(0, 0, 1e-3)), parent=0),
        ]
    )
    assert not fa.check(loose)


def test_a_short_beam_that_goes_on_is_no_short_beam() -> None:
    beam = fa.Beam(0.05, fa.Rectangle(0.03, 0.03), STEEL, {"bending_y": 2})
    piece = fa.Link(fa.Fixed(), beam=beam)
    links = [fa.Link(fa.Revolute("z"), beam=beam), *[piece] * 9]
    assert not [x for x in fa.check(fa.Arm(links)) if "shear" in str(x)]
    across = fa.Arm(
        [*links, fa.Link(fa.Fixed(), beam=beam, parent=9), fa.Link(fa.Fixed(), fa.RigidBody(0.1), parent=3)]
    )
    assert not [x for x in fa.check(across) if "shear" in str(x)]
    alone = fa.Arm([*links, fa.Link(fa.Revolute("z"), beam=beam, parent=4)])
    assert [x.where for x in fa.check(alone) if "shear" in str(x)] == ["link[10].beam"]


def test_the_table_tells_who_sits_on_whom() -> None:
    text = str(satellite())
    rows = [line.split("  ") for line in text.splitlines()]
    on = {row[0].strip(): [x.strip() for x in row if x.strip()][1] for row in rows[2:7]}
    assert on == {"0 bus": "world", "1 left panel": "bus", "2 right panel": "bus", "3 upper": "bus", "4 fore": "upper"}
    assert text.count("end at zero") == 3 and "1.7 m from the base, that of fore" in text
    table = str(masts())
    assert "boom at 0.5 m" in table and "jib at 0.1 m" in table and table.count("end at zero") == 5
    assert "  on  " not in str(paper_link()) and str(paper_link()).startswith("link  joint")


def test_frequencies_of_a_fork_of_rigid_bodies() -> None:
    """A disc on a spring carries two that sit on springs of their own: a matrix by hand."""
    I0, I1, I2, k0, k1, k2 = 2.0, 0.5, 0.3, 40.0, 30.0, 10.0

    def disc(I: float, k: float, **more: object) -> fa.Link:
        return fa.Link(fa.Revolute("z", stiffness=k), fa.RigidBody(1.0, inertia=(I, I, I)), **more)

    arm = fa.Arm([disc(I0, k0), disc(I1, k1), disc(I2, k2, parent=0)])
    M = np.array([[I0 + I1 + I2, I1, I2], [I1, I1, 0], [I2, 0, I2]])
    assert np.allclose(arm.modes().frequencies, np.sqrt(eigh(np.diag([k0, k1, k2]), M)[0]), rtol=1e-12)


def test_a_mass_on_a_slice_as_between_two_halves() -> None:
    """Modes of a beam with a point mass a third of the way, where the shear force jumps: with twice the shapes the
    error is an eighth, against two beams that meet there."""
    beam = fa.Beam(0.6, fa.Rectangle(0.004, 0.02), STEEL, {"bending_y": 8, "bending_z": 8}, "legendre")
    boom = fa.Link(fa.Revolute("z", stiffness=5.0), beam=beam)
    block = fa.Link(fa.Fixed(), fa.RigidBody(0.4), parent=0)
    truth = fa.Arm([*fa.split(boom, 10, [0.2]), block]).modes().frequencies[:6]
    errors = []
    for n in (4, 8, 16):
        more = replace(boom, beam=replace(beam, modes={"bending_y": n, "bending_z": n}))
        found = fa.Arm([more, replace(block, at=0.2)]).modes().frequencies[:6]
        assert (found > truth * (1 - 1e-9)).all()  # fewer shapes are stiffer
        errors.append((found / truth - 1).max())
    assert errors[0] > 5 * errors[1] > 25 * errors[2] and errors[2] < 1e-3
    without = fa.Arm([boom, replace(block, at=None)]).modes().frequencies[:6]
    assert np.abs(without / truth - 1).max() > 0.1  # the place matters


def test_modes_of_a_tree_are_drawn_branch_by_branch() -> None:
    arm = satellite(free=False)
    modes = arm.modes()
    figure = modes.plot(2)
    lines = [line for line in figure.axes[0].lines if len(line.get_xdata()) > 2]
    assert len(lines) == 6  # two modes of three branches
    ends = sorted({(round(float(x.get_xdata()[0]), 9), round(float(x.get_xdata()[-1]), 9)) for x in lines})
    assert ends == [(0.0, 1.7), (0.0, 2.4)]
    names = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert names[2:] == ["left panel", "right panel", "fore"]
    on_world = side_by_side(paper_link(), paper_link())
    drawn = [x for x in on_world.modes().plot(1).axes[-1].lines if len(x.get_xdata()) > 2]
    assert [np.ptp(x.get_xdata()) for x in drawn] == pytest.approx([0.5, 0.5])


def test_branches_on_slices_are_drawn_from_there() -> None:
    arm = fa.Arm(masts().links)
    lines = [x for x in arm.modes().plot(1).axes[0].lines if len(x.get_xdata()) > 1 and np.ptp(x.get_xdata()) > 0]
    begins = sorted(round(float(x.get_xdata()[0]), 2) for x in lines)
    assert begins == [0.2, 0.4, 0.53, 0.7, 0.7]  # boom; jib; claw, from the nearest point drawn of the jib; the others


def test_findings_of_a_beam_with_a_load_on_a_slice() -> None:
    """A load on the end is told of; on a slice near the clamp it is not one of the end."""
    one = loaded(tip=0.0)
    block = fa.Link(fa.Fixed(), fa.RigidBody(0.3))
    assert len(fa.check(fa.Arm([*one.links, block]))) == 1
    assert not fa.check(fa.Arm([*one.links, replace(block, at=0.05)]))


def test_equilibrium_under_a_load_on_a_slice() -> None:
    """A weight on a slice bends a beam as a force there does."""
    beam = fa.Beam(0.6, fa.Rectangle(0.01, 0.02), STEEL, {"bending_y": 3}, "legendre", 3)
    boom, block = fa.Link(fa.Fixed(), beam=beam), fa.Link(fa.Fixed(), fa.RigidBody(2.0), at=0.25)
    found = fa.Arm([boom, block], (0, -9.81, 0)).equilibrium()
    wanted = fa.Arm([boom], (0, -9.81, 0)).equilibrium(loads=[fa.Load(0, force=(0, -2.0 * 9.81, 0), x=0.25)])
    assert np.allclose(found, wanted, rtol=1e-8) and np.abs(found).max() > 1e-4


def test_equilibrium_of_each_branch() -> None:
    """Under gravity, springs in the joints: each arm sags as if it were alone."""
    one = paper_link(n=2)
    held = fa.Arm(
        [fa.Link(fa.Revolute("z", stiffness=k), x.hub, x.beam) for k in (3.0,) for x in one.links], (0, -9.81, 0)
    )
    other = fa.Arm([fa.Link(fa.Revolute("z", stiffness=8.0), x.hub, x.beam) for x in one.links], (0, -9.81, 0))
    found = side_by_side(held, other).equilibrium()
    assert np.allclose(found, [*held.equilibrium(), *other.equilibrium()], atol=1e-9)


def test_a_patch_is_placed_on_a_branch_as_alone() -> None:
    beam = fa.Beam(0.4, fa.Rectangle(0.002, 0.02), STEEL, {"bending_y": 4}, "legendre")
    other = fa.Beam(0.7, fa.Rectangle(0.002, 0.02), STEEL, {"bending_y": 4}, "legendre")
    arms = [fa.Arm([fa.Link(fa.Revolute("z"), beam=b)]) for b in (other, beam)]
    patch = fa.Patch(0.0, 0.05, 0.02, 5e-4, fa.Piezo(62e9, 0.3, 7800, -1.8e-10))
    found, alone = (fa.place_patch(arm, patch=patch, modes=2) for arm in (side_by_side(*arms), arms[1]))
    assert found.best == pytest.approx(alone.best, abs=1e-6) and np.allclose(
        found.authority, alone.authority, rtol=1e-6
    )


def test_a_branch_beyond_its_range_is_named() -> None:
    arm = two_arms()
    q = arm.zero
    q[arm.coordinate_of(arm.joint_rates("right elbow")[0] - 2)] = 3.0  # the right upper arm bends by 1.5 rad
    t = np.linspace(0.0, 0.01, 3)
    with warns(fa.errors.RangeWarning, "right upper"):
        fa.simulate(arm, t, q)
