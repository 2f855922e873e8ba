"""`check` finds numbers that can hardly be meant, and beams that are too coarse; in real arms it finds nothing."""

from __future__ import annotations

import pickle
import re
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from messages import refuses

STEEL = fa.Material(7850, 209e9, 0.3)


def arm(material: fa.Material = STEEL, tip: fa.RigidBody | None = None, **beam: Any) -> fa.Arm:
    given = {"length": 0.5, "section": fa.Rectangle(0.001, 0.02), "modes": {"bending_y": 2}} | beam
    return fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(end=(0.1, 0, 0)), fa.Beam(material=material, **given), tip)])


DOUBTFUL: list[tuple[dict[str, Any], str]] = [
    ({"material": fa.Material(7850, 209)}, r"link\[0\].beam.material.youngs_modulus: 209 Pa .*in GPa or MPa\?"),
    ({"material": fa.Material(7850, 209e3)}, r"youngs_modulus: 209000 Pa .*in GPa or MPa\?"),
    ({"material": fa.Material(7850e3, 209e9)}, r"density: 7.85e\+06 kg/m\^3: .*unit\?"),
    ({"material": fa.Material(7.85, 209e9)}, r"density: 7.85 kg/m\^3: .*in g/cm\^3\?"),
    ({"material": fa.Material(7.8, 200)}, r"density 7.8 kg/m\^3, youngs_modulus 200 Pa; in g/cm\^3 and GPa\?"),
    ({"material": fa.Material(7.8, 70)}, r"in g/cm\^3 and GPa\?"),
    ({"material": fa.Material(2.7, 70)}, r"in g/cm\^3 and GPa\?"),
    ({"length": 500}, r"link\[0\].beam.length: 500 m, .*in mm\?"),
    ({"length": 500, "section": fa.Rectangle(1, 20)}, r"length: 500 m, .*in mm\?"),
    ({"material": fa.Material(2700, 70e3)}, r"youngs_modulus: 70000 Pa .*in GPa or MPa\?"),
    ({"material": fa.Material(7850, 209e9, shear_modulus=80)}, r"shear_modulus: 80 Pa.* is its unit Pa\?"),
    ({"section": fa.Rectangle(1, 20)}, r"section: is 1 m by 20 m, of a beam of length 0.5 m; is it in mm\?"),
    ({"section": fa.Circle(5, 4)}, r"section: is .* in mm\?"),
    ({"section": fa.sections.Taper([0, 0.5], [fa.Rectangle(1, 20), fa.Rectangle(0.5, 20)])}, r"section: is .* in mm\?"),
    ({"tip": fa.RigidBody(0.1, com=(20, 0, 0))}, r"link\[0\].tip.com: \(20, 0, 0\) m, .* in mm\?"),
    ({"tip": fa.RigidBody(0.1, end=(0, 50, 0))}, r"link\[0\].tip.end: \(0, 50, 0\) m, .* in mm\?"),
    ({"tip": fa.RigidBody(0.1, inertia=(1e4, 1e4, 1e4))}, r"tip.inertia: 10000 kg m\^2 of 0.1 kg .* in g mm\^2"),
    ({"tip": fa.RigidBody(0.1, inertia=(100, 100, 100))}, r"tip.inertia: 100 kg m\^2 .* or kg mm\^2\?"),
    ({"tip": fa.RigidBody(0.3, inertia=(120, 120, 120))}, r"tip.inertia: 120 kg m\^2 of 0.3 kg would be 20 m away"),
    ({"section": fa.Rectangle(0.5, 0.5)}, r"shear adds 78 % .*shear_y"),
    ({"section": fa.Circle(0.25), "modes": {"bending_z": 2, "shear_y": 1}}, r"shear adds .*shear_z"),
    ({"tip": fa.RigidBody(0.1), "basis": "loaded"}, r"link\[0\].beam.basis_tip: .* tip has 0.1 kg; give basis_tip"),
]


@pytest.mark.parametrize(("change", "says"), DOUBTFUL)
def test_a_number_that_can_hardly_be_meant_is_found(change: dict[str, Any], says: str) -> None:
    """And nothing is said where the arm is made or used: warnings are errors here."""
    made = arm(**change)
    (found,) = [x for x in fa.check(made) if "leave out" not in str(x)]
    assert re.search(says, str(found)) and found.remedy and found.value != found.limit
    assert pickle.loads(pickle.dumps(fa.check(made))) == fa.check(made) == fa.check(fa.Arm.from_dict(made.to_dict()))


PLAUSIBLE: list[dict[str, Any]] = [
    {},
    {"material": fa.Material(1000, 3e4, 0.5)},  # a gel
    {"material": fa.Material(1, 1), "length": 1, "section": fa.Rectangle(1, 1)},  # a beam without units
    {"section": fa.sections.GeneralSection(1.0, 1.0, 1.0, 1.0)},  # E I alone
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
def test_nothing_is_found_in_real_arms(change: dict[str, Any]) -> None:
    assert not [x for x in fa.check(arm(**change)) if "leave out" not in str(x)]


def test_inertias_of_rigid_links_are_looked_at_too() -> None:
    says = r"link\[0\].hub.inertia: 1200 kg m\^2 of 0.3 kg would be 63.2 m away, on a rigid link of 0.5 m; .* kg mm\^2"

    def found(joint: fa.Joint, body: fa.RigidBody) -> str:
        return str(fa.check(fa.Arm([fa.Link(joint, body)])))

    assert re.search(says, found(fa.Revolute("z"), fa.RigidBody(0.3, inertia=(1200,) * 3, end=(0.5, 0, 0))))
    for joint, body in (
        (fa.Revolute("z"), fa.RigidBody(0.3, inertia=(0, 0, 100), end=(0.5, 0, 0))),  # a rotor's, geared
        (fa.Revolute("z"), fa.RigidBody(0.0, inertia=(0, 0, 1200))),
        (fa.Free(), fa.RigidBody(4.2e5, inertia=(1.3e8, 1.1e8, 2e8))),  # a space station
    ):
        assert found(joint, body) == "nothing to remark"


def sag(made: fa.Arm) -> float:
    return float(made.deflection(made.equilibrium(lock=[0], loads=[fa.Load(force=(0, -0.5, 0))]), 0)[1])


def said(made: fa.Arm, t: Any = None, **run: Any) -> str:
    """What is found about the shape functions of an arm, or of its run."""
    found = fa.check(made) if t is None else fa.simulate(made, t, **run).check()
    return "\n".join(str(x) for x in found if "leave out" in x.what)


def test_too_few_modes_under_a_heavy_tip_are_said() -> None:
    """What is said to be left out is what is left out, beside P L^3 / 3 E I; the remedy works."""
    heavy = fa.RigidBody(1.0)
    exact = -0.5 * 0.5**3 / (3 * 209e9 * 0.02 * 0.001**3 / 12)
    poor = arm(tip=heavy, modes={"bending_y": 1})
    assert said(poor).startswith("link[0].beam.modes: 1 of bending_y leave out 2.9 %")
    assert 1 - sag(poor) / exact == pytest.approx(0.029, abs=2e-3)
    assert "leave out 25 %" in said(arm(tip=heavy, modes={"bending_y": 1}, basis="legendre"))
    turned = fa.RigidBody(1.0, inertia=(1e-3, 1e-3, 1e-3))
    assert "1 of torsion leave out 19 %" in said(arm(tip=turned, modes={"bending_y": 2, "torsion": 1}))
    batch = fa.simulate_batch(poor, [0, 0.01], v0=np.ones((2, 2)), integrator="implicit", step=5e-3)
    assert "leave out 2.9 %" in str(batch[1].check())
    for remedy in ({"basis": "legendre"}, {"basis": "loaded", "basis_tip": heavy, "modes": {"bending_y": 1}}, {}):
        better = arm(tip=heavy, **remedy)
        assert not fa.check(better) and sag(better) == pytest.approx(exact, rel=6e-3)
    assert not fa.check(arm(tip=fa.RigidBody(0.01), modes={"bending_y": 1}))  # light


def test_beams_almost_without_mass_are_looked_at_too() -> None:
    """One gives way under its tip as one that has some; of what is beyond rounding nothing is said."""
    offset = fa.RigidBody(1.0, (0.05, 0, 0))
    for density in (7850, 1e-13):
        beam = fa.Beam(0.5, fa.Rectangle(0.001, 0.02), fa.Material(density, 209e9, 0.3), {"bending_y": 1})
        assert "1 of bending_y leave out 5.5 %" in said(fa.Arm([fa.Link(fa.Fixed(), None, beam, offset)]))
    far = fa.Arm([fa.Link(fa.Fixed(), None, beam, fa.RigidBody(1.0, (0, 1e9, 0)))])
    assert not said(far, [0, 1e-9]) and "is it in mm" in str(fa.check(far))


def test_a_tip_beyond_rounding_is_looked_at_without_overflow() -> None:
    assert fa.check(arm(tip=fa.RigidBody(0.24, com=(0, -1.9e8, 0)), section=fa.Rectangle(1e8, 1e8)))


def test_a_short_piece_of_a_split_beam_is_no_short_beam() -> None:
    pzt = fa.Piezo(62e9, 0.3, 7800, d31=-1.8e-10)
    patch = fa.Patch(0.005, 0.05, 0.02, 3e-4, pzt)
    beam = fa.Beam(0.5, fa.Rectangle(0.002, 0.02), STEEL, {"bending_y": 3}, "legendre", patches=[patch])
    pieces = fa.split(fa.Link(fa.Revolute("z"), beam=beam))
    assert not fa.check(fa.Arm(pieces))
    short = fa.Arm([fa.Link(fa.Revolute("z"), beam=pieces[0].beam, tip=fa.RigidBody(0.1)), *pieces[1:]])
    assert "link[0].beam: is so short for its thickness" in str(fa.check(short))


def test_strains_that_a_motion_leaves_at_zero_are_not_doubted() -> None:
    made = arm(tip=fa.RigidBody(1.0, inertia=(1e-3, 1e-3, 1e-3)), modes={"bending_y": 3, "bending_z": 1, "torsion": 1})
    turn = {0: fa.Motion([0, 1], [0, 0.1], [0, 0], [0, 0])}
    assert not said(made, [0, 1], drive=turn)  # in the plane
    assert "1 of bending_z leave out" in said(made, [0, 1], drive=turn, loads=[fa.Load(force=(0, 0, 1e-3))])


def test_links_that_are_carried_count_and_tapers_are_measured() -> None:
    wedge = fa.sections.Taper([0.0, 0.5], [fa.Rectangle(0.004, 0.02), fa.Rectangle(0.001, 0.02)])
    light = arm(section=wedge, modes={"bending_y": 1})
    assert not said(light)
    both = fa.Arm([*light.links, fa.Link(fa.Revolute("z"), fa.RigidBody(2.0, inertia=(1, 1, 1)))])
    (found,) = fa.check(both)
    assert found.where == "link[0].beam.modes" and found.unit == "%"
    fine = sag(arm(section=wedge, modes={"bending_y": 12}))
    assert 1 - sag(light) / fine == pytest.approx(found.value / 100, rel=0.05)


BASES = ("clamped-free", "legendre")


def moved(made: fa.Arm, drive: dict[int, Any]) -> fa.Result:
    return fa.simulate(made, np.linspace(0, 1, 51), drive=drive, integrator="gauss", step=0.01)


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
    known = moved(made("legendre", 8), drive).frame()[0]

    def off(basis: str) -> tuple[float, str]:
        run = moved(made(basis, n), drive)
        found = [str(x) for x in run.check() if "leave out" in x.what]
        return float(np.linalg.norm(run.frame()[0] - known, axis=1).max() / np.ptp(known, axis=0).max()), "".join(found)

    wrong, told = off("clamped-free")
    assert wrong < 1e-3 or told
    assert not told or (wrong > 2e-4 and 'basis "legendre"' in told)
    if told and n > 2:
        better, still = off("legendre")
        assert better < 0.1 * wrong and not still
    assert bool(told) == (carries == "link" or (carries == "tip" and n < 4))


def test_a_moment_on_the_end_asks_for_another_basis() -> None:
    made = {b: arm(modes={"bending_y": 3}, basis=b, section=fa.Rectangle(0.002, 0.02), order="exact") for b in BASES}
    held = {0: fa.Motion([0, 1], [0, 0])}
    loads = {"1.4": fa.Load(moment=(0, 0, 2.0)), "0.14": fa.Load(force=(0, 50.0, 0))}
    for says, load in loads.items():
        run = {"t": np.linspace(0, 0.5, 51), "drive": held, "loads": [load]}
        assert re.search(f"leave out {says} % .* under the load there.*legendre", said(made["clamped-free"], **run))
        assert not said(made["legendre"], **run)
    assert not said(made["clamped-free"], [0, 0.01], drive=held, loads=[fa.Load(moment=(0, 0, 1e-3))])  # hardly bends


def test_a_joint_that_gives_way_passes_no_moment_on() -> None:
    """Behind a driven joint the second beam bends the end of the first, behind a hinge it does not."""
    beam = fa.Beam(1.0, fa.Rectangle(0.004, 0.04), STEEL, {"bending_y": 3})
    two = fa.Arm([fa.Link(fa.Revolute("z"), None, beam, fa.RigidBody(0.5))] * 2)
    assert not said(two, [0, 0.01])
    assert "link[0].beam.modes: 3 of bending_y leave out" in said(two, [0, 0.01], drive={1: fa.Motion([0, 1], [0, 0])})


def test_findings_are_a_list_that_prints() -> None:
    none, two = fa.check(arm()), fa.check(arm(fa.Material(7850, 209), fa.RigidBody(1e-3, com=(20, 0, 0))))
    assert not none and len(none) == 0 and str(none) == "nothing to remark"
    assert len(two) == 2 and str(two) == "\n".join(str(x) for x in two)
    found = next(x for x in two if "youngs" in x.where)
    assert (found.value, found.limit, found.unit) == (209, 1e6, "Pa") and found.remedy == "is it in GPa or MPa?"


def test_runs_without_rows_and_batches_without_states_are_checked() -> None:
    """For what their arm shows."""
    poor = arm(tip=fa.RigidBody(1.0), modes={"bending_y": 1})
    with pytest.raises(fa.SimulationError) as e:
        fa.simulate(poor, [0, 1], v0=[1e200, 0])
    batch = fa.simulate_batch(poor, [0, 0.01], v0=np.ones((2, 2)), integrator="implicit", step=5e-3, outputs=["tau"])
    for result in (e.value.result, batch[0], fa.simulate_batch(poor, [0, 0.01], integrator="ida")[0]):
        assert "leave out 2.9 %" in str(result.check())


def test_a_scene_is_checked_without_a_run() -> None:
    """Angles in degrees, and steps of "rk4" above the limit, too."""
    made = arm(fa.Material(7850, 209e9, 0.3))
    turn = {0: fa.Motion([0, 1], [0, 90.0], [0, 0], [0, 0])}
    scene = fa.Scene(made, turn, t=np.linspace(0, 1, 11), options={"integrator": "rk4", "step": 5e-2})
    degrees, steps = fa.check(scene)
    assert "commanded to 90 rad: was that meant in degrees?" in str(degrees)
    assert steps.value == 5e-2 and "above 2.83 over the highest frequency" in steps.what
    assert not fa.check(fa.Scene(made)) and not fa.check("ist")
    with refuses("of = 3", "Arm", "Scene"):
        fa.check(3)  # type: ignore[arg-type]


def test_a_watch_is_asked_for_after_the_run() -> None:
    with refuses("watch", "result.check"):
        fa.simulate(arm(), [0, 1], watch=True)
