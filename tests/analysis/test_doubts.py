"""Numbers that can hardly be meant are said, with the unit or the remedy; those of real arms are not."""

from __future__ import annotations

import pickle
import warnings
from typing import Any

import flexarm as fa
import numpy as np
import pytest

STEEL = fa.Material(7850, 209e9, 0.3)


def arm(material: fa.Material = STEEL, tip: fa.RigidBody | None = None, **beam: Any) -> fa.Arm:
    given = {"length": 0.5, "section": fa.Rectangle(0.001, 0.02), "modes": {"bending_y": 2}} | beam
    return fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(end=(0.1, 0, 0)), fa.Beam(material=material, **given), tip)])


DOUBTFUL: list[tuple[dict[str, Any], str]] = [
    ({"material": fa.Material(7850, 209)}, r"link\[0\].beam.material.youngs_modulus = 209 Pa: .*in GPa or MPa\?"),
    ({"material": fa.Material(7850, 209e3)}, r"youngs_modulus = 209000 Pa: .*in GPa or MPa\?"),
    ({"material": fa.Material(7850e3, 209e9)}, r"density = 7.85e\+06 kg/m\^3: .*unit\?"),
    ({"material": fa.Material(7.85, 209e9)}, r"density = 7.85 kg/m\^3: .*in g/cm\^3\?"),
    ({"material": fa.Material(7.8, 200)}, r"density = 7.8 kg/m\^3, youngs_modulus = 200 Pa: in g/cm\^3 and GPa\?"),
    ({"material": fa.Material(7.8, 70)}, r"in g/cm\^3 and GPa\?"),
    ({"material": fa.Material(2.7, 70)}, r"in g/cm\^3 and GPa\?"),
    ({"length": 500}, r"link\[0\].beam.length = 500 m, .*in mm\?"),
    ({"length": 500, "section": fa.Rectangle(1, 20)}, r"length = 500 m, .*in mm\?"),
    ({"material": fa.Material(2700, 70e3)}, r"youngs_modulus = 70000 Pa: .*in GPa or MPa\?"),
    ({"material": fa.Material(7850, 209e9, shear_modulus=80)}, r"shear_modulus = 80 Pa.* is its unit Pa\?"),
    ({"section": fa.Rectangle(1, 20)}, r"section: is 1 m by 20 m, of a beam of length 0.5 m: is it in mm\?"),
    ({"section": fa.Circle(5, 4)}, r"section: is .* in mm\?"),
    ({"section": fa.Taper([0, 0.5], [fa.Rectangle(1, 20), fa.Rectangle(0.5, 20)])}, r"section: is .* in mm\?"),
    ({"tip": fa.RigidBody(0.1, com=(20, 0, 0))}, r"link\[0\].tip.com = \(20, 0, 0\) m, .* in mm\?"),
    ({"tip": fa.RigidBody(0.1, end=(0, 50, 0))}, r"link\[0\].tip.end = \(0, 50, 0\) m, .* in mm\?"),
    ({"tip": fa.RigidBody(0.1, inertia=(1e4, 1e4, 1e4))}, r"tip.inertia: 10000 kg m\^2 of 0.1 kg .* in g mm\^2"),
    ({"tip": fa.RigidBody(0.1, inertia=(100, 100, 100))}, r"tip.inertia: 100 kg m\^2 .* or kg mm\^2\?"),
    ({"tip": fa.RigidBody(0.3, inertia=(120, 120, 120))}, r"tip.inertia: 120 kg m\^2 of 0.3 kg would be 20 m away"),
    ({"section": fa.Rectangle(0.5, 0.5)}, r"shear adds 78 % .*shear_y"),
    ({"section": fa.Circle(0.25), "modes": {"bending_z": 2, "shear_y": 1}}, r"shear adds .*shear_z"),
    ({"tip": fa.RigidBody(0.1), "basis": "loaded"}, r"link\[0\].beam.basis_tip: .* tip has 0.1 kg; give basis_tip"),
]


@pytest.mark.parametrize(("change", "says"), DOUBTFUL)
def test_what_can_hardly_be_meant_is_said_once(change: dict[str, Any], says: str) -> None:
    with pytest.warns(fa.ModelWarning, match=says) as said:
        made = arm(**change)
    assert len(said) == 1 and said[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert pickle.loads(pickle.dumps(made)) == made
        str(made)


PLAUSIBLE: list[dict[str, Any]] = [
    {},
    {"material": fa.Material(1000, 3e4, 0.5)},  # a gel
    {"material": fa.Material(1, 1), "length": 1, "section": fa.Rectangle(1, 1)},  # a beam without units
    {"section": fa.GeneralSection(1.0, 1.0, 1.0, 1.0)},  # E I alone
    {"basis": "loaded"},  # the modes of a beam that carries nothing
    {"tip": fa.RigidBody(0.1), "basis": "loaded", "basis_tip": fa.RigidBody(0.0)},  # the same, meant
    {"material": fa.Material(1e-6, 209e9)},  # as good as without mass
    {"material": fa.Material(3500, 5e5, 0.49)},  # rubber full of iron
    {"material": fa.Material(19300, 411e9, 0.28)},  # tungsten
    {"length": 110.0, "section": fa.Circle(1.5, 1.47), "material": fa.Material(1900, 40e9, 0.3)},  # a turbine's blade
    {"damping_ratio": 0.9},
    {"section": fa.Rectangle(0.12, 0.02)},  # a quarter as thick as long
    {"section": fa.Rectangle(0.5, 0.5), "modes": {"bending_y": 2, "shear_y": 1}},
    {"tip": fa.RigidBody(0.01, inertia=(0, 0, 1))},  # about the hinge alone: all that a planar arm asks for
    {"tip": fa.RigidBody(0.01, inertia=(0, 1, 1))},  # a rod
    {"tip": fa.RigidBody(0.01, inertia=(1, 1, 2.005))},  # a plate of a rounded table
    {"tip": fa.RigidBody(0.01)},
    {"tip": fa.RigidBody(0.1, (0.5, 0, 0.3), (0.01, 0.01, 0.01))},
    {"material": fa.Material(1070, 1e5, 0.49), "section": fa.Circle(0.01)},  # silicone
    {"length": 1e-4, "section": fa.Rectangle(1e-6, 1e-5), "material": fa.Material(2330, 160e9),
     "tip": fa.RigidBody(1e-9, (1e-3, 0, 0), (1e-16,) * 3)},  # a probe of a microscope
    {"length": 40.0, "section": fa.Rectangle(0.8, 0.8), "tip": fa.RigidBody(5e3, (0, 0, -9), (1e4,) * 3)},  # a crane
]


@pytest.mark.parametrize("change", PLAUSIBLE)
def test_real_arms_are_not_doubted(change: dict[str, Any]) -> None:
    arm(**change)  # warnings are errors here


def test_inertias_of_rigid_links_are_doubted_too() -> None:
    says = r"link\[0\].hub.inertia: 1200 kg m\^2 of 0.3 kg would be 63.2 m away, on a rigid link of 0.5 m: .* kg mm\^2"
    with pytest.warns(fa.ModelWarning, match=says):
        fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(0.3, inertia=(1200,) * 3, end=(0.5, 0, 0)))])
    fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(0.3, inertia=(0, 0, 100), end=(0.5, 0, 0)))])  # a rotor's, geared
    fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(0.0, inertia=(0, 0, 1200)))])
    fa.Arm([fa.Link(fa.Free(), fa.RigidBody(4.2e5, inertia=(1.3e8, 1.1e8, 2e8)))])  # a space station


def sag(made: fa.Arm) -> float:
    return float(made.deflection(made.equilibrium(lock=[0], loads=[fa.Load(force=(0, -0.5, 0))]), 0)[1])


def test_too_few_modes_under_a_heavy_tip_are_said() -> None:
    """What is said to be left out is what is left out, beside P L^3 / 3 E I; the remedy works."""
    heavy = fa.RigidBody(1.0)
    exact = -0.5 * 0.5**3 / (3 * 209e9 * 0.02 * 0.001**3 / 12)
    poor = arm(tip=heavy, modes={"bending_y": 1})
    for how in ({}, {"watch": True}):
        with pytest.warns(fa.ModelWarning, match=r"link\[0\].beam.modes: 1 of bending_y leave out 2.9 %") as said:
            fa.simulate(poor, [0, 0.01], **how)
        assert said[0].filename == __file__
    assert 1 - sag(poor) / exact == pytest.approx(0.029, abs=2e-3)
    with pytest.warns(fa.ModelWarning, match="leave out 25 %"):
        fa.simulate(arm(tip=heavy, modes={"bending_y": 1}, basis="legendre"), [0, 0.01])
    with pytest.warns(fa.ModelWarning, match="1 of torsion leave out 19 %"):
        turned = fa.RigidBody(1.0, inertia=(1e-3, 1e-3, 1e-3))
        fa.simulate(arm(tip=turned, modes={"bending_y": 2, "torsion": 1}), [0, 0.001])
    with pytest.warns(fa.ModelWarning, match="leave out 2.9 %"):
        fa.simulate_batch(poor, [0, 0.01], v0=np.ones((2, 2)), integrator="implicit", step=5e-3)
    for remedy in ({"basis": "legendre"}, {"basis": "loaded", "basis_tip": heavy, "modes": {"bending_y": 1}}, {}):
        better = arm(tip=heavy, **remedy)
        fa.simulate(better, [0, 0.01])
        assert sag(better) == pytest.approx(exact, rel=6e-3)
    fa.simulate(arm(tip=fa.RigidBody(0.01), modes={"bending_y": 1}), [0, 0.01])  # light


def test_advice_never_costs_a_run() -> None:
    """A beam with hardly any mass gives way under its tip as one that has some; of what is beyond rounding nothing is
    said, and the run is kept."""
    offset, says = fa.RigidBody(1.0, (0.05, 0, 0)), r"link\[0\].beam.modes: 1 of bending_y leave out 5.5 %"
    for density in (7850, 1e-13):
        beam = fa.Beam(0.5, fa.Rectangle(0.001, 0.02), fa.Material(density, 209e9, 0.3), {"bending_y": 1})
        with pytest.warns(fa.ModelWarning, match=says):
            fa.simulate(fa.Arm([fa.Link(fa.Fixed(), None, beam, offset)]), [0, 0.01])
    with pytest.warns(fa.ModelWarning, match="is it in mm"):
        far = fa.Arm([fa.Link(fa.Fixed(), None, beam, fa.RigidBody(1.0, (0, 1e9, 0)))])
        assert len(fa.simulate(far, [0, 1e-9]).q) == 2


def test_a_short_piece_of_a_split_beam_is_no_short_beam() -> None:
    pzt = fa.Piezo(62e9, 0.3, 7800, d31=-1.8e-10)
    patch = fa.Patch(0.005, 0.05, 0.02, 3e-4, pzt)
    beam = fa.Beam(0.5, fa.Rectangle(0.002, 0.02), STEEL, {"bending_y": 3}, "legendre", patches=[patch])
    pieces = fa.split(fa.Link(fa.Revolute("z"), beam=beam))
    fa.Arm(pieces)  # warnings are errors here
    with pytest.warns(fa.ModelWarning, match=r"link\[0\].beam: is so short for its thickness"):
        fa.Arm([fa.Link(fa.Revolute("z"), beam=pieces[0].beam, tip=fa.RigidBody(0.1)), *pieces[1:]])


def test_strains_that_a_motion_leaves_at_zero_are_not_doubted() -> None:
    made = arm(tip=fa.RigidBody(1.0, inertia=(1e-3, 1e-3, 1e-3)), modes={"bending_y": 3, "bending_z": 1, "torsion": 1})
    turn = {0: fa.Motion([0, 1], [0, 0.1], [0, 0], [0, 0])}
    fa.simulate(made, [0, 1], drive=turn)  # in the plane: warnings are errors here
    with pytest.warns(fa.ModelWarning, match="1 of bending_z leave out"):
        fa.simulate(made, [0, 1], drive=turn, loads=[fa.Load(force=(0, 0, 1e-3))])


def test_links_that_are_carried_count_and_tapers_are_measured() -> None:
    wedge = fa.Taper([0.0, 0.5], [fa.Rectangle(0.004, 0.02), fa.Rectangle(0.001, 0.02)])
    light = arm(section=wedge, modes={"bending_y": 1})
    fa.simulate(light, [0, 0.001])
    both = fa.Arm([*light.links, fa.Link(fa.Revolute("z"), fa.RigidBody(2.0, inertia=(1, 1, 1)))])
    with pytest.warns(fa.ModelWarning, match=r"link\[0\].beam.modes: 1 of bending_y leave out (\S+) %") as said:
        fa.simulate(both, [0, 0.001])
    share = float(str(said[0].message).split("leave out ")[1].split()[0]) / 100
    fine = sag(arm(section=wedge, modes={"bending_y": 12}))
    assert 1 - sag(light) / fine == pytest.approx(share, rel=0.05)


BASES = ("clamped-free", "legendre")


def moved(made: fa.Arm, drive: dict[int, Any]) -> np.ndarray:
    return fa.simulate(made, np.linspace(0, 1, 51), drive=drive, integrator="gauss", step=0.01).frame()[0]


@pytest.mark.parametrize("n", [2, 3, 4])
@pytest.mark.parametrize("carries", ["nothing", "light", "tip", "link"])
def test_a_basis_that_loses_a_thousandth_of_the_span_is_said_and_no_other(carries: str, n: int) -> None:
    """Clamped-free modes cannot bend at their end, where a moment comes in, and hardly follow a force."""
    section, tips = fa.Rectangle(0.004, 0.04), {"light": fa.RigidBody(0.05), "tip": fa.RigidBody(2.0)}
    material = fa.Material(2700, 70e9, 0.33)

    def made(basis: str, n: int) -> fa.Arm:
        beam = fa.Beam(1.0, section, material, {"bending_y": n}, basis, "exact")
        links = [fa.Link(fa.Revolute("z"), None, beam, tips.get(carries))]
        return fa.Arm(links * (1 + (carries == "link")))

    drive = {0: fa.Motion.spin_up(2.0, 0.8)} | ({1: fa.Motion.spin_up(-2.0, 0.8)} if carries == "link" else {})
    known = moved(made("legendre", 8), drive)

    def off(basis: str) -> float:
        x = moved(made(basis, n), drive)
        return float(np.linalg.norm(x - known, axis=1).max() / np.ptp(known, axis=0).max())

    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        wrong = off("clamped-free")
    assert wrong < 1e-3 or said
    assert not said or (wrong > 2e-4 and 'basis "legendre"' in str(said[0].message))
    if said and n > 2:
        assert off("legendre") < 0.1 * wrong  # without a warning
    assert bool(said) == (carries == "link" or (carries == "tip" and n < 4))


def test_a_moment_on_the_end_asks_for_another_basis() -> None:
    made = {b: arm(modes={"bending_y": 3}, basis=b, section=fa.Rectangle(0.002, 0.02), order="exact") for b in BASES}
    held = {0: fa.Motion([0, 1], [0, 0])}
    loads = {"1.4": fa.Load(moment=(0, 0, 2.0)), "0.14": fa.Load(force=(0, 50.0, 0))}
    for says, load in loads.items():
        times = np.linspace(0, 0.5, 51)
        with pytest.warns(fa.ModelWarning, match=f"leave out {says} % .* under the load there.*legendre"):
            fa.simulate(made["clamped-free"], times, drive=held, loads=[load])
        fa.simulate(made["legendre"], times, drive=held, loads=[load])
    fa.simulate(made["clamped-free"], [0, 0.01], drive=held, loads=[fa.Load(moment=(0, 0, 1e-3))])  # hardly bends


def test_a_joint_that_gives_way_passes_no_moment_on() -> None:
    """Behind a driven joint the second beam bends the end of the first, behind a hinge it does not."""
    beam = fa.Beam(1.0, fa.Rectangle(0.004, 0.04), STEEL, {"bending_y": 3})
    two = fa.Arm([fa.Link(fa.Revolute("z"), None, beam, fa.RigidBody(0.5))] * 2)
    fa.simulate(two, [0, 0.01])
    with pytest.warns(fa.ModelWarning, match=r"link\[0\].beam.modes: 3 of bending_y leave out \d.* %"):
        fa.simulate(two, [0, 0.01], drive={1: fa.Motion([0, 1], [0, 0])})


def test_an_arm_of_a_scene_is_doubted_where_it_is_first_used() -> None:
    with pytest.warns(fa.ModelWarning):
        described = arm(material=fa.Material(7850, 209)).to_dict()
    for use in (lambda a: fa.simulate(a, [0, 1e-3]), fa.Arm.modes, fa.Arm.equilibrium, str):
        read = fa.Arm.from_dict(described)  # warnings are errors here
        with pytest.warns(fa.ModelWarning, match="in GPa") as said:
            use(read)
        assert len(said) == 1
        read.modes(lock=[0])  # once
