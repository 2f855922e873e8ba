"""Damping of the whole arm's modes, and what a measured decay tells."""

from __future__ import annotations

from dataclasses import replace

import flexarm as fa
import numpy as np
import pytest
from messages import refuses

STEEL = fa.Material(7800, 210e9, 0.3)


def loaded(modes: int = 3, joint: fa.Joint | None = None, payload: float = 5.0, **options) -> fa.Arm:
    """A beam of 0.5 kg, with ten times that on its end."""
    beam = fa.Beam(1.0, fa.Rectangle(0.004, 0.016), STEEL, {"bending_y": modes}, "legendre", **options)
    tip = fa.RigidBody(payload, inertia=(1e-3, 1e-3, 1e-3))
    return fa.Arm([fa.Link(joint or fa.Revolute("z"), fa.RigidBody(1.0, inertia=(0, 0, 0.5)), beam, tip)])


def two(**options) -> fa.Arm:
    beam = fa.Beam(0.5, fa.Rectangle(0.004, 0.016), STEEL, {"bending_y": 2, "bending_z": 1}, "legendre", **options)
    body = fa.RigidBody(0.3, inertia=(1e-3, 2e-3, 2e-3))
    return fa.Arm([fa.Link(fa.Revolute("z"), body, beam, body), fa.Link(fa.Revolute("y"), body, beam, body)])


@pytest.mark.parametrize("lock", [None, [0]])
def test_a_payload_does_not_change_what_was_asked_for(lock) -> None:
    arm = loaded()
    assert replace_beam(arm, damping_ratio=0.005).modes(lock=[0]).damping[0] < 0.001  # the bare beam's
    first = 0 if lock else 1  # behind the motion of the joint
    ratios = {first: 0.005, first + 1: 0.02, first + 2: 0.03}
    damped = arm.modal_damping(ratios, lock=lock)
    found = damped.modes(lock=lock)
    for mode, ratio in ratios.items():
        assert found.damping[mode] == pytest.approx(ratio, rel=1e-9)
    assert np.allclose(found.frequencies, arm.modes(lock=lock).frequencies, rtol=1e-9)


def replace_beam(arm: fa.Arm, **options) -> fa.Arm:
    return fa.Arm([replace(x, beam=replace(x.beam, **options)) for x in arm.links], arm.gravity)


def test_modes_that_are_not_named_keep_what_they_have() -> None:
    arm = loaded(kelvin_voigt=1e-5)
    before = arm.modes(lock=[0]).damping
    after = arm.modal_damping({1: 0.05}, lock=[0]).modes(lock=[0]).damping
    assert after[1] == pytest.approx(0.05, rel=1e-9) and np.allclose(after[[0, 2]], before[[0, 2]], rtol=1e-3)


def test_two_links_in_space() -> None:
    arm = two()
    damped = arm.modal_damping(0.01, lock=[0, 1])
    assert np.allclose(damped.modes(lock=[0, 1]).damping, 0.01, rtol=1e-8)
    eigenvalues = np.linalg.eigvalsh(np.array(damped.links[0].beam.damping))
    assert eigenvalues[0] > -1e-12 * eigenvalues[-1]


def tubes(**modes: int) -> fa.Arm:
    beam = fa.Beam(0.5, fa.Tube(0.01, 0.008), fa.Material(2700, 70e9, 0.3), modes, "legendre")
    return fa.Arm([fa.Link(fa.Revolute("z"), None, beam), fa.Link(fa.Revolute("z"), None, beam, fa.RigidBody(0.2))])


@pytest.mark.parametrize(
    ("modes", "ratios"),
    [({"bending_y": 2, "bending_z": 2}, [0.01] * 3), ({"bending_y": 2, "bending_z": 2}, 0.01),
     ({"bending_y": 2, "bending_z": 2}, [0.02] * 6), ({"bending_y": 3}, 0.01)],
)  # fmt: skip
def test_two_tubes_whose_modes_come_in_pairs(modes: dict[str, int], ratios) -> None:
    """Each is reached: as many numbers are free in two positive semidefinite matrices."""
    arm = tubes(**modes)
    found = arm.modal_damping(ratios, lock=[0, 1]).modes(lock=[0, 1])
    wanted = ratios if np.ndim(ratios) else [ratios] * len(found.damping)
    # of a pair of equal frequencies, which is not told apart, one has it
    assert np.allclose(np.sort(np.abs(found.damping[: len(wanted)] - wanted))[: len(wanted) - 1], 0.0, atol=1e-8)
    assert (found.damping > -1e-12).all()


def test_ratios_that_no_damping_of_beams_gives() -> None:
    """Two beams of one shape each: ratio_k = sum over beams of d_b s_bk^2 / (2 w_k m_k), with d_b >= 0."""
    from scipy.optimize import nnls

    arm = tubes(bending_y=1)
    modes, M = arm.modes(lock=[0, 1]), arm.mass_matrix(arm.zero)[np.ix_([1, 3], [1, 3])]
    S = modes.shapes[[1, 3]]
    A = (S**2 / np.diag(S.T @ M @ S) / (2 * modes.frequencies)).T
    nearest = (A / A.max(axis=0)) @ nnls(A / A.max(axis=0), np.array([0.05, 0.0]))[0]
    with refuses("modes [0]", "modes [1]") as e:
        arm.modal_damping([0.05, 0.0], lock=[0, 1])
    offered = eval(str(e.value).rpartition("ratios=")[2])
    assert [offered[0], offered[1]] == pytest.approx(nearest.tolist(), rel=0.02)  # small ratios add up
    assert np.allclose(arm.modal_damping(offered, lock=[0, 1]).modes(lock=[0, 1]).damping, list(offered.values()))


def test_a_decay_of_the_arm_has_the_ratio() -> None:
    arm = loaded(2, fa.Fixed()).modal_damping({0: 0.01})
    q0 = arm.modes().shapes[:, 0].real * 1e-3
    t = np.linspace(0, 4, 2001)
    result = fa.simulate(arm, t, q0, integrator="gauss", step=2e-3)
    decay = fa.fit_decay(t, result.frame()[0][:, 1])
    assert decay.damping[0] == pytest.approx(0.01, rel=1e-3)
    assert decay.frequencies[0] == pytest.approx(arm.modes().frequencies[0], rel=1e-4) and decay.residual < 1e-3


def test_rayleigh() -> None:
    arm = loaded(2, fa.Fixed())
    mass, stiffness = 0.3, 1e-4
    found = arm.rayleigh_damping(mass, stiffness).modes()
    w = found.frequencies
    assert np.allclose(found.damping, mass / (2 * w) + stiffness * w / 2, rtol=1e-9)
    twice = arm.rayleigh_damping(mass).rayleigh_damping(0.0, stiffness)
    assert np.allclose(twice.modes().damping, found.damping, rtol=1e-9)


def test_kelvin_voigt_by_strain() -> None:
    section, modes = fa.Circle(0.01), {"bending_y": 1, "torsion": 1}
    beam = fa.Beam(1.0, section, STEEL, modes, kelvin_voigt={"torsion": 1e-4})
    found = fa.Arm([fa.Link(fa.Fixed(), None, beam)]).modes()
    torsion = np.abs(found.shapes[1]) > 0.5
    assert np.allclose(found.damping, np.where(torsion, 0.5e-4 * found.frequencies, 0.0))
    assert beam.to_dict()["kelvin_voigt"] == {"torsion": 1e-4}
    with refuses("kelvin_voigt", "twist"):
        replace(beam, kelvin_voigt={"twist": 1.0})


def test_files_and_other_models_keep_it(tmp_path) -> None:
    arm = loaded(3).modal_damping(0.01, lock=[0])
    assert fa.Arm.from_dict(arm.to_dict()) == arm
    swing = {0: fa.Motion.spin_up(1.0, 0.5)}
    rich = fa.economize(fa.Scene(arm, swing, t=np.linspace(0, 0.5, 51)), 1e-3).rich.arm
    assert rich.links[0].beam.counts["bending_y"] > 3
    assert np.allclose(rich.modes(lock=[0]).damping[:2], 0.01, rtol=0.02)


def test_a_decay_of_two_modes_in_two_signals() -> None:
    t = np.arange(2000) * 1e-3
    w, z = np.array([31.0, 77.0]), np.array([0.004, 0.02])
    modes = np.exp(-np.outer(t, z * w)) * np.cos(np.outer(t, w * np.sqrt(1 - z**2)) + 0.3)
    noise = 1e-3 * np.sin(1e5 * np.arange(len(t)) ** 2 % 7)
    y = modes @ [[1.0, 0.5], [0.4, -0.7]] + noise[:, None] + [0.2, -3.0]
    found = fa.fit_decay(t, y, 2)
    assert np.allclose(found.frequencies, w, rtol=1e-4) and np.allclose(found.damping, z, rtol=0.02)
    assert np.allclose(found.amplitudes, [[1.0, 0.5], [0.4, 0.7]], rtol=0.01) and found.residual < 0.01


BAD = [
    (lambda arm: arm.modal_damping({7: 0.01}), ("mode = 7", "0")),
    (lambda arm: arm.modal_damping({0: 0.01}), ("mode 0", "vibrate")),
    (lambda arm: arm.modal_damping({1: 2.0}), ("ratios[1] = 2.0", "0.5")),
    (lambda arm: arm.modal_damping({}), "ratios = {}"),
    (lambda arm: arm.modal_damping(0.01, lock=[0]).modal_damping({1: 0.001}, lock=[0]),
     "modes [1]"),
    (lambda arm: arm.rayleigh_damping(-1.0), "mass = -1.0"),
    (lambda arm: replace_beam(arm, damping=[[1.0]]), ("damping = 1 x 1", "3")),
    (lambda arm: replace_beam(arm, damping=np.diag([1.0, 1.0, -1.0])), "damping = -1"),
    (lambda arm: fa.fit_decay([0, 1, 2], [0, 1, 2]), ("3 samples", "too few")),
    (lambda arm: fa.fit_decay(np.arange(20.0) ** 2, np.zeros(20)), ("t", "increase", "equal", "steps")),
    (lambda arm: fa.fit_decay(np.arange(20.0), np.zeros(20)), ("y", "constant")),
]


@pytest.mark.parametrize(("make", "match"), BAD)
def test_bad_input(make, match) -> None:
    with refuses(match):
        make(loaded())
