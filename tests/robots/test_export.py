"""Arms as MJCF and URDF: MuJoCo moves as the segments do, these as the arm does; rigid arms come back as they went."""

from __future__ import annotations

import dataclasses
import re
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from flexarm.robots.segments import segmented
from messages import refuses, warns
from scipy.linalg import eigh

mujoco = pytest.importorskip("mujoco")
ROBOTS = Path(__file__).parents[1] / "data" / "robots"
ALLOY = fa.Material(density=2700.0, youngs_modulus=70e9, poisson_ratio=0.33)


def plane(**options: Any) -> fa.Arm:
    def beam(length: float) -> fa.Beam:
        section = fa.Rectangle(0.004, 0.03)
        return fa.Beam(length, section, ALLOY, modes={"bending_y": 4}, basis="legendre", **options)

    hub = fa.RigidBody(0.1, inertia=(1e-4, 1e-4, 1e-4), end=(0.05, 0, 0))
    shoulder = fa.Revolute(damping=0.05, coulomb=0.01, reflected_inertia=0.01, name="shoulder")
    upper = fa.Link(shoulder, hub, beam(0.5), fa.RigidBody(0.2), name="upper")
    return fa.Arm([upper, fa.Link(fa.Revolute(damping=0.05), None, beam(0.4), fa.RigidBody(0.1))], (0, -9.81, 0))


def space() -> fa.Arm:
    """Crooked joints, a slide, bending both ways and torsion, a taper, a payload off the axis."""
    modes = {"bending_y": 4, "bending_z": 4, "torsion": 2}
    taper = fa.sections.Taper([0, 0.5], [fa.Rectangle(0.012, 0.03), fa.Rectangle(0.01, 0.02)])
    tube = fa.Tube(0.012, 0.001)
    tip = fa.RigidBody(0.2, (0.02, 0.01, 0.03), (2e-4, 3e-4, 4e-4), (0.03, 0, 0.01))
    turned = fa.Placement((0.01, 0.02, 0.03), (0.3, -0.2, 0.5))
    return fa.Arm(
        [
            fa.Link(fa.Revolute((0.1, -1, 0.4), inboard=turned, outboard=turned), None,
                    fa.Beam(0.5, taper, ALLOY, modes=modes, basis="legendre"), tip),
            fa.Link(fa.Prismatic("z", stiffness=50.0, rest=0.1, damping=2.0, inboard=turned),
                    fa.RigidBody(0.3, end=(0.1, 0, 0))),
            fa.Link(fa.Universal(damping=0.1), None, fa.Beam(0.4, tube, ALLOY, modes=modes, basis="legendre"), tip),
        ],
        (1.0, 0.0, -9.81),
    )  # fmt: skip


def rigid() -> fa.Arm:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.errors.RobotWarning)
        arm = fa.from_urdf(ROBOTS / "six.urdf", tip="tool", gravity=(0, 1, -9.81))
    return fa.Arm([replace(link, looks=()) for link in arm], arm.gravity)


def compiled(arm: fa.Arm, segments: int = 10) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.errors.RobotWarning)
        return mujoco.MjModel.from_xml_string(arm.to_mjcf(segments=segments))


def mass_matrix(model: Any, data: Any) -> np.ndarray:
    M = np.zeros((model.nv, model.nv))
    for k, unit in enumerate(np.eye(model.nv)):
        mujoco.mj_mulM(model, data, M[k], unit)
    return M


@pytest.mark.parametrize("make", [plane, space, rigid])
def test_mujoco_has_the_segments_dynamics(make: Any) -> None:
    arm = make()
    model, cut = compiled(arm, 4), segmented(arm, 4).arm
    data, rng = mujoco.MjData(model), np.random.default_rng(1)
    assert model.nv == cut.nv >= 6
    for _ in range(2):
        data.qpos[:], data.qvel[:] = rng.uniform(-0.5, 0.5, cut.nv), rng.normal(size=cut.nv)
        mujoco.mj_forward(model, data)
        M, h = mass_matrix(model, data), data.qfrc_bias - data.qfrc_passive
        np.testing.assert_allclose(cut.mass_matrix(data.qpos), M, rtol=0, atol=1e-11 * M.max())
        ours = fa.Arm(cut.links, cut.gravity).bias(data.qpos, data.qvel)
        np.testing.assert_allclose(ours, h, rtol=0, atol=1e-11 * np.abs(h).max())
        np.testing.assert_allclose(cut.frame(data.qpos)[0], data.site("tip").xpos, rtol=0, atol=1e-12)


@pytest.mark.parametrize("make", [plane, space])
def test_frequencies(make: Any) -> None:
    """The arm's first three, as MuJoCo's own mass matrix and springs have them."""
    arm = make()
    locked = [k for k, link in enumerate(arm) if link.joint.nv]
    wanted = fa.Arm(arm.links).modes(lock=locked).frequencies[:3]
    model = compiled(arm)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    hinges = [model.joint(k).dofadr[0] for k in range(model.njnt) if "hinge" in model.joint(k).name]
    assert len(hinges) == 10 * sum(len(link.beam.counts) for link in arm if link.beam)
    M = mass_matrix(model, data)[np.ix_(hinges, hinges)]
    K = np.diag([np.ravel(model.jnt_stiffness[model.dof_jntid[k]])[0] for k in hinges])
    found = np.sqrt(eigh(K, M, eigvals_only=True)[:3])
    np.testing.assert_allclose(found, wanted, rtol=1e-3)


@pytest.mark.parametrize("make", [plane, space])
def test_sag(make: Any) -> None:
    """Locked, the tip hangs where the arm's does, to half a percent of how far that gives way."""
    arm = make()
    cut = segmented(arm, 10)
    stiff = fa.Arm(cut.arm.links, arm.gravity)
    locked = [k for k, link in enumerate(stiff) if link.joint.nv and k not in cut.hinges]
    own = [k for k, link in enumerate(arm) if link.joint.nv]
    moved = [x.frame(x.equilibrium(lock=held))[0] - x.frame(x.zero)[0] for x, held in ((arm, own), (stiff, locked))]
    assert np.linalg.norm(moved[0]) > 1e-3
    np.testing.assert_allclose(moved[1], moved[0], rtol=0, atol=5e-3 * np.linalg.norm(moved[0]))


def test_the_tip_in_mujoco() -> None:
    """Let fall from the horizontal with a torque: the tip stays where the arm's is, next to how far that bends."""
    arm = plane(order=2)
    arm = fa.Arm([fa.Link(fa.Revolute(damping=0.05), x.hub, x.beam, x.tip) for x in arm], arm.gravity)
    model = compiled(arm)
    data = mujoco.MjData(model)
    torque, end = np.array([1.5, 0.3]), 0.3
    track = []
    for _ in range(int(end / model.opt.timestep)):
        data.ctrl[:] = torque
        mujoco.mj_step(model, data)
        mujoco.mj_kinematics(model, data)
        track.append(data.site("tip").xpos.copy())
    every = slice(9, None, 10)
    t = np.arange(1, len(track) + 1)[every] * model.opt.timestep
    run = fa.simulate(arm, np.append(0.0, t), drive={0: fa.Torque(1.5), 1: fa.Torque(0.3)})
    error = np.linalg.norm(run.frame()[0][1:] - np.array(track)[every], axis=1).max()
    bent = max(np.abs(run.tip_deflection(k)[:, 1]).max() for k in (0, 1))
    assert bent > 0.01 and error < 0.1 * bent and error < 2e-3


def test_a_rigid_arm_comes_back(tmp_path: Path) -> None:
    arm = rigid()
    with warns(fa.errors.RobotWarning, "gravity", "URDF", "none"):
        arm.to_urdf(tmp_path / "arm.urdf")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        arm.to_mjcf(tmp_path / "arm.xml")  # says nothing: all is in it
        warnings.simplefilter("ignore", fa.errors.RobotWarning)
        backs = [fa.from_mjcf(tmp_path / "arm.xml")]
        backs.append(fa.from_urdf(tmp_path / "arm.urdf", tip="tip", gravity=arm.gravity))
    q, v = np.linspace(-1, 1, 6), np.linspace(1, -0.5, 6)
    for back in backs:
        assert [x.joint.name for x in back][:6] == [x.joint.name for x in arm][:6]
        np.testing.assert_allclose(back.mass_matrix(q), arm.mass_matrix(q), rtol=0, atol=1e-10)
        np.testing.assert_allclose(back.bias(q, v), arm.bias(q, v), rtol=0, atol=1e-10)
        assert back["pan"].joint.coulomb == 0.7
    np.testing.assert_allclose(backs[1].frame(q)[0], arm.frame(q)[0], atol=1e-12)


def test_segments_in_urdf(tmp_path: Path) -> None:
    arm = plane()
    with pytest.warns(fa.errors.RobotWarning) as seen:
        text = arm.to_urdf(tmp_path / "arm.urdf", segments=3)
    said = str(seen[0].message)
    assert "springs, but for Gazebo: upper segment 1 hinge" in said and "reflected inertia: shoulder" in said
    assert text == (tmp_path / "arm.urdf").read_text() and text.count("<springStiffness>") == 6
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.errors.RobotWarning)
        back = fa.from_urdf(tmp_path / "arm.urdf", gravity=arm.gravity)
    cut = segmented(arm, 3).arm
    q = np.linspace(-0.3, 0.4, 8)
    # a rotor's inertia is no URDF's
    rotor = np.zeros((8, 8))
    rotor[0, 0] = 0.01
    np.testing.assert_allclose(back.mass_matrix(q) + rotor, cut.mass_matrix(q), rtol=0, atol=1e-12)


def test_damping() -> None:
    """The first mode keeps the beam's ratio, whether of the beam or of its material."""
    for options in ({"damping_ratio": 0.02}, {"kelvin_voigt": 1e-3}):
        section = fa.Rectangle(0.004, 0.03)
        beam = fa.Beam(0.5, section, ALLOY, modes={"bending_y": 4}, basis="legendre", **options)
        arm = fa.Arm([fa.Link(fa.Revolute(), None, beam)])
        cut = segmented(arm, 10).arm
        ours = fa.Arm(cut.links).modes(lock=[0]).damping[0]
        np.testing.assert_allclose(ours, arm.modes(lock=[0]).damping[0], rtol=0.02)


def test_a_beam_that_neither_bends_nor_twists() -> None:
    """One body, with the beam's mass; nothing to fit."""
    beam = fa.Beam(0.5, fa.Tube(0.01, 0.001), ALLOY, modes={"extension": 1})
    arm = fa.Arm([fa.Link(fa.Revolute(), fa.RigidBody(0.1, end=(0.1, 0, 0)), beam, fa.RigidBody(0.2, end=(0.1, 0, 0)))])
    cut = segmented(arm)
    assert len(cut.arm.links) == 1 and not len(cut.wanted) and cut.left_out
    np.testing.assert_allclose(cut.arm.mass_matrix(np.zeros(1)), arm.mass_matrix(arm.zero)[:1, :1], rtol=1e-12)
    np.testing.assert_allclose(cut.arm.frame(np.zeros(1))[0], arm.frame(arm.zero)[0], rtol=1e-14)


def test_beams_without_rotary_inertia_and_without_mass() -> None:
    """Thin rods have no moment about their own axis: they are cut as others are, with the frequencies of the beam. What
    leaves a segment without inertia is named."""
    tip, steel = fa.RigidBody(0.5, (0, 0, 0), (2e-3,) * 3), fa.Material(7850, 2.1e11, 0.3)

    def arm(material: fa.Material, modes: dict[str, int], rotary: bool = False) -> fa.Arm:
        beam = fa.Beam(0.5, fa.Circle(0.005), material, modes, "legendre", rotary_inertia=rotary)
        return fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(0.1, inertia=(1e-2,) * 3), beam, tip)])

    thin = arm(steel, {"bending_y": 3})
    cut = segmented(thin, 20).arm
    np.testing.assert_allclose(cut.mass_matrix(cut.zero)[0, 0], thin.mass_matrix(thin.zero)[0, 0], rtol=1e-6)
    assert compiled(thin).nv == 11
    massless = fa.Material(0.0, 2.1e11, 0.3)
    assert arm(massless, {}).to_mjcf()  # a rigid rod
    with refuses("density = 0"):
        arm(massless, {"bending_y": 2}, True).to_mjcf()
    with refuses("rotary_inertia = False"):
        arm(steel, {"torsion": 1}).to_mjcf()


def test_what_is_left_out(tmp_path: Path) -> None:
    modes = {"bending_y": 2, "shear_y": 1, "extension": 1}
    joint = fa.Revolute(coulomb=1.0, stiction=2.0, lower=-1.0, upper=1.0, limit_stiffness=10.0)
    arm = fa.Arm([fa.Link(joint, None, fa.Beam(0.5, fa.Rectangle(0.01, 0.03), ALLOY, modes=modes), name="a")])
    with pytest.warns(fa.errors.RobotWarning) as seen:
        text = arm.to_mjcf()
    said = str(seen[0].message)
    for words in ("shear_y, extension of 'a'", "stiction above dry friction: a", "soft stops"):
        assert words in said
    assert 'range="-1.0 1.0"' in text and re.search(r"\(rad/s.*\): [\d.]+ \([+-]0\.", text)


def test_names_that_formats_have_themselves(tmp_path: Path) -> None:
    solid = fa.RigidBody(1.0, inertia=(1, 1, 1), end=(1, 0, 0))
    arm = fa.Arm([fa.Link(fa.Revolute(), solid, name=name) for name in ("world", "tip", 'a<&"b--')])
    assert compiled(arm).nv == 3
    with warns(fa.errors.RobotWarning, "'world'", "link"):
        arm.to_mjcf()
    named = [fa.Link(fa.Revolute(), solid, name="a"), fa.Link(fa.Revolute(name="a joint"), solid, name="b")]
    assert compiled(fa.Arm(named)).nv == 2
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.errors.RobotWarning)
        arm.to_urdf(tmp_path / "arm.urdf")
        assert fa.from_urdf(tmp_path / "arm.urdf").names == arm.names


def test_bad_input(tmp_path: Path) -> None:
    for segments in (1, 0, 2.5, 300, "few"):
        with refuses("segments ="):
            plane().to_mjcf(segments=segments)  # type: ignore[arg-type]
    ball = fa.Arm([fa.Link(fa.Spherical(), fa.RigidBody(1.0, inertia=(1, 1, 1)), name="wrist")])
    with refuses("wrist", "joint 'spherical'", "no balls"):
        ball.to_urdf()
    bent = fa.Beam(0.5, fa.Tube(0.01, 0.001), ALLOY, modes={"bending_y": 2}, order="exact", curvature=(0, 0, 1))
    with refuses("link 0", "curvature"):
        fa.Arm([fa.Link(fa.Revolute(), None, bent)]).to_urdf()
    with refuses("path =", ".xml"):
        plane().to_mjcf(tmp_path / "arm.txt")


def test_one_sided_stops(tmp_path: Path) -> None:
    """Each end that an arm has stands in the file; where a format wants both, the other is beyond reach."""
    solid = fa.RigidBody(1.0, inertia=(1, 1, 1), end=(1, 0, 0))
    joints = [fa.Revolute(upper=0.5, limit_stiffness=10.0), fa.Revolute(lower=-0.25, limit_stiffness=10.0),
              fa.Prismatic(lower=0.1, limit_stiffness=10.0), fa.Revolute(), fa.Prismatic()]  # fmt: skip
    arm = fa.Arm([fa.Link(replace(joint, name=f"j{k}"), solid, name=f"l{k}") for k, joint in enumerate(joints)])
    with warns(fa.errors.RobotWarning, "soft stops", "j0, j1, j2"):
        text = arm.to_urdf(tmp_path / "arm.urdf")
    with warns(fa.errors.RobotWarning, "soft stops", "j0, j1, j2"):
        arm.to_mjcf(tmp_path / "arm.xml")
    types = re.findall(r'<joint name="j\d" type="(\w+)"', text)
    assert types == ["revolute", "revolute", "prismatic", "continuous", "prismatic"]
    far = 1e6
    for read in (fa.from_urdf, fa.from_mjcf):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", fa.errors.RobotWarning)
            back = read(tmp_path / ("arm.urdf" if read is fa.from_urdf else "arm.xml"), stops=1.0)
        limits = [(x.joint.lower, x.joint.upper) for x in back][:5]
        slide = (-far, far) if read is fa.from_urdf else (None, None)  # URDF wants limits of a slide
        assert limits == [(-far, 0.5), (-0.25, far), (0.1, far), (None, None), slide]


#: Each argument of a joint, not at its default.
ALL_OF_A_JOINT: dict[str, Any] = {
    "stiffness": 2.0, "rest": 0.1, "damping": 0.3, "lower": -1.0, "upper": 2.0, "limit_stiffness": 50.0,
    "limit_damping": 1.0, "coulomb": 0.4, "stiction": 0.5, "reflected_inertia": 0.01,
    "torque_limit": 5.0,
    "inboard": fa.Placement((0.1, 0, 0)), "outboard": fa.Placement((0, 0.1, 0)), "name": "elbow",
}  # fmt: skip


def test_nothing_is_lost_in_silence() -> None:
    """Each argument of a joint is in the file, or named in the warning: a file and a warning that an argument does not
    change would not know of it."""
    made, base = ALL_OF_A_JOINT, {"limit_stiffness": 50.0}
    needs = {"rest": {"stiffness": 2.0}, "limit_damping": {"upper": 1.0}, "limit_stiffness": {"upper": 1.0}}
    solid = fa.RigidBody(1.0, inertia=(1, 1, 1), end=(1, 0, 0))

    def told(write: str, **options: Any) -> tuple[str, str]:
        arm = fa.Arm([fa.Link(fa.Revolute(**{**base, **options}), solid, name="a")])
        with warnings.catch_warnings(record=True) as seen:
            warnings.simplefilter("always")
            return getattr(arm, write)(), "".join(str(w.message) for w in seen)

    fields = {f.name for f in dataclasses.fields(fa.Revolute) if f.init} - {"axis"}
    assert set(made) == fields
    for write in ("to_mjcf", "to_urdf"):
        for name, value in made.items():
            more = needs.get(name, {})
            if name.startswith("limit_"):
                assert "soft stops" in told(write, **more)[1]
            else:
                assert told(write, **more) != told(write, **more, **{name: value}), (write, name)


def test_what_beams_and_bodies_lose() -> None:
    """Damping of higher modes, couplings of strains, looks, and moments that no body has."""
    section = fa.Rectangle(0.004, 0.03)
    ratio = fa.Beam(0.5, section, ALLOY, modes={"bending_y": 4}, basis="legendre", damping_ratio=0.01)
    stiff = np.diag([1e6, 1e6, 1e6, 30.0, 20.0, 40.0])
    stiff[4, 5] = stiff[5, 4] = 10.0
    coupled = fa.SectionMatrix(stiffness=stiff, inertia=np.diag([1.0, 1.0, 1.0, 2e-5, 1e-5, 1e-5]))
    bent = fa.Beam(0.5, coupled, modes={"bending_y": 2, "bending_z": 2}, basis="legendre")
    flat = fa.RigidBody(1.0, inertia=(0, 0, 1e-3), end=(0.1, 0, 0))
    look = fa.Look("ball", [0.1])
    arm = fa.Arm(
        [fa.Link(fa.Revolute(name="base"), flat, ratio, name="a", looks=[look]),
         fa.Link(fa.Fixed(name="bolts"), None, bent, fa.RigidBody(0.1), name="b")]
    )  # fmt: skip
    for write in (arm.to_mjcf, arm.to_urdf):
        with pytest.warns(fa.errors.RobotWarning) as seen:
            write(segments=4)
        said = str(seen[0].message)
        assert ("names of fixed joints: bolts" in said) == (write == arm.to_mjcf)
        for words in (
            "damping ratio of 'a' in modes above the lowest",
            "coupling of strains of 'b'",
            "looks (shapes and meshes): a",
            "moments of inertia of 'a'",
        ):
            assert words in said, words
