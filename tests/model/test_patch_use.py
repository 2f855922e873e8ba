"""Piezo patches at work: voltages as drives, sensors, linear models, placement, scene files, bad input."""

import json
import pickle
from dataclasses import replace

import flexarm as fa
import numpy as np
import pytest
from arms import STEEL, close, paper_link
from flexarm.cli import main
from messages import refuses
from model.test_patch import D31, FIBRE, GHOST, MOMENT, PAIR, PZT, B, E, H, L, T, clamped_free, strip
from numpy.polynomial import legendre

# -- drives, sensors, linear models ----------------------------------------------------------------------------------


def test_every_integrator_feels_the_voltage() -> None:
    arm = strip(PAIR, modes={"bending_y": 2}, joint=fa.Fixed())
    t = np.linspace(0, 0.05, 51)
    drive = {("patch", 0, 0): fa.Voltage([0, 0.02, 0.05], [0, 40, -10])}
    runs = {
        "gauss": fa.simulate(arm, t, drive=drive, integrator="gauss", step=1e-3),
        "ida": fa.simulate(arm, t, drive=drive, rtol=1e-9, atol=1e-13),
        "rk4": fa.simulate(arm, t, drive=drive, integrator="rk4", step=5e-5),
        "implicit": fa.simulate(arm, t, drive=drive, integrator="implicit", step=2e-5),
    }
    best = runs["gauss"].tip_deflection()[:, 1]
    assert np.abs(best).max() > 1e-4
    for name, run in runs.items():
        assert np.abs(run.tip_deflection()[:, 1] - best).max() < (1e-4 if name == "implicit" else 1e-5) * best.max()
    V = np.interp(t, [0, 0.02, 0.05], [0, 40, -10])
    np.testing.assert_allclose(runs["gauss"].tau, V[:, None] * arm.patch_matrix[:, 0], rtol=1e-12, atol=1e-18)
    a = arm.forward_dynamics(runs["ida"].q[20], runs["ida"].v[20], arm.patch_matrix @ [40.0])
    np.testing.assert_allclose(a, runs["ida"].a[20], rtol=1e-9)


def test_charge_and_voltage_from_the_material_law() -> None:
    """D = d31 sigma + epsilon E3 on the electrodes of each side, integrated along the beam."""
    arm = strip(PAIR, modes={"bending_y": 3, "bending_z": 2})
    q = np.array([0.3, -0.2, 0.1, 0.5, 0.4])
    s, w = legendre.leggauss(10)
    K3 = np.array([arm.strain(q, 0, float(at))[2] for at in 0.02 + 0.025 * (s + 1)])
    charge = 2 * E * D31 * B * 0.025 * w @ (-(H + T) / 2 * K3)
    assert arm.charge(q) == pytest.approx(charge, rel=1e-12)
    farads = 2 * (3e-8 - E * D31**2) * B * 0.05 / T
    assert arm.capacitance() == pytest.approx(farads, rel=1e-12)
    assert arm.patch_voltage(q) == pytest.approx(-charge / farads, rel=1e-12)
    run = fa.simulate(arm, [0, 0.01], q0=q / 100)
    assert run.charge().shape == run.patch_voltage(0, 0).shape == (2,)
    np.testing.assert_allclose(run.charge()[0], charge / 100, rtol=1e-12)


def test_reciprocity() -> None:
    """What patch 1 senses per volt on patch 0 is what patch 0 senses per volt on patch 1, in statics."""
    arm = strip(PAIR, replace(PAIR, start=0.2, end=0.3, face="+y"), modes={"bending_y": 4})
    there = arm.charge(arm.equilibrium(voltages=[1.0, 0.0]), 0, 1)
    back = arm.charge(arm.equilibrium(voltages=[0.0, 1.0]), 0, 0)
    assert there == pytest.approx(back, rel=1e-10)
    assert there != 0


def test_linear_model_between_voltage_and_sensors() -> None:
    arm = paper_link(n=3, patches=[PAIR, replace(PAIR, start=0.1, end=0.15)])
    outputs = [("charge", 0, 0), ("patch_voltage", 0, 1), ("tip", 0)]
    model = arm.linearize(arm.zero, inputs=[("patch", 0, 0), 0], outputs=outputs, lock=[])
    expected = np.linalg.solve(arm.mass_matrix(arm.zero), arm.patch_matrix[:, 0])
    np.testing.assert_allclose(model.B[4:, 0], expected, rtol=1e-10)
    held = arm.linearize(arm.zero, inputs=[("patch", 0, 0)], outputs=outputs, lock=[0])
    gain = -held.C @ np.linalg.solve(held.A, held.B)[:, 0]
    q = arm.equilibrium(lock=[0], voltages={(0, 0): 1e-3})
    close(gain[:2] * 1e-3, [arm.charge(q), arm.patch_voltage(q, 0, 1)], 1e-9)
    assert gain[3] * 1e-3 == pytest.approx(arm.frame(q)[0][1], rel=1e-9)
    assert model.inputs == ("patch link 0 patch 0", "force link 0 revolute")
    assert model.outputs[:2] == ("charge link 0 patch 0", "patch_voltage link 0 patch 1")
    bent = np.array([0.2, 0.01, 0.002, 0.001])
    tau = arm.bias(bent, np.zeros(4))
    assert arm.linearize(bent, inputs=[], outputs=outputs, tau=tau).y[0] == pytest.approx(arm.charge(bent), rel=1e-12)


# -- placement -------------------------------------------------------------------------------------------------------


def test_placement_tells_how_far_it_is() -> None:
    told: list[int] = []
    fa.place_patch(paper_link(), patch=GHOST, points=7, progress=told.append)
    assert told == [1, 2, 3, 4, 5, 6, 7]


@pytest.mark.parametrize("length", [0.05, 0.15])
def test_placement_against_slopes_of_the_modes(length: float) -> None:
    """Authority = moment times the change of slope over omega^2 times the modal mass, and so its best place."""
    arm = paper_link(rotary_inertia=False)
    found = fa.place_patch(arm, patch=GHOST, length=length)
    mass = 7850 * H * B * L / 4
    starts = found.x - length / 2
    for k in range(3):
        slope = clamped_free(k, starts + length, 1) - clamped_free(k, starts, 1)
        expected = MOMENT * slope / (mass * found.frequencies[k] ** 2)
        close(found.authority[:, k] / np.abs(expected).max(), expected / np.abs(expected).max(), 1e-8)
        best = fa.place_patch(arm, patch=GHOST, length=length, weights=np.eye(3)[k]).best
        fine = np.linspace(0, L - length, 20001)
        change = np.abs(clamped_free(k, fine + length, 1) - clamped_free(k, fine, 1))
        assert best == pytest.approx(fine[change.argmax()], abs=3e-5)
    assert fa.place_patch(arm, patch=GHOST, length=length, weights=[1, 0, 0]).best == 0  # the root
    assert fa.place_patch(arm, patch=GHOST, length=0.15, weights=[0, 1, 0]).best == pytest.approx(0.19, abs=0.02)


def test_placement_is_the_static_deflection() -> None:
    """Bonding the patch there and a volt across it: the modes' deflections add up to the beam's."""
    arm = paper_link(n=3)
    found = fa.place_patch(arm, patch=GHOST, weights=[1, 0, 0])
    bonded = paper_link(n=3, patches=[found.patch])
    tip = bonded.deflection(bonded.equilibrium(lock=[0], voltages=[1.0]))[1]
    assert found.best_authority.sum() == pytest.approx(tip, rel=1e-6)  # each mode is 1 at the tip
    assert "best place: from 0 to 0.05 m" in str(found)
    top = found.plot().axes[0]
    assert top.get_ylabel() == "authority / its greatest"
    # modes count from 0, as `arm.modes` counts them
    lowest = arm.modes(lock=[0]).frequencies[:3]
    assert [row.split()[0] for row in str(found).splitlines()[3:]] == ["0", "1", "2"]
    assert [text.get_text() for text in top.get_legend().get_texts()] == [
        f"mode {k}, {w:.4g} rad/s" for k, w in enumerate(lowest)
    ]


def test_placement_of_a_free_arm_and_of_a_profile() -> None:
    arm = paper_link(n=4)
    free = fa.place_patch(arm, patch=GHOST, lock=[], weights=[1, 0, 0])
    np.testing.assert_allclose(free.frequencies, arm.modes().frequencies[1:4], rtol=1e-6)
    assert free.best > 0.1  # a pinned root has little curvature
    shaped = fa.place_patch(arm, patch=replace(GHOST, profile=[0, 1, 0]), modes=2)
    assert (shaped.patch.profile["x"][0], shaped.patch.profile["x"][-1]) == pytest.approx(
        (shaped.patch.start, shaped.patch.end)
    )


def test_ab_and_ci_agree_in_space() -> None:
    rng = np.random.default_rng(3)
    strains = {"bending_y": 2, "bending_z": 2, "torsion": 1, "shear_y": 1, "shear_z": 1}
    patch = replace(PAIR, face="+y", angle=0.5, material=FIBRE)
    for order in (1, 2, 3, "exact"):
        link = strip(patch, replace(patch, start=0.2, end=0.3, width=8e-4, face="z"), modes=strains, order=order).links[
            0
        ]
        arm = fa.Arm([replace(link, joint=fa.Spherical()), replace(link, joint=fa.Revolute("y"))], (0, 0, -9.81))
        q = arm.zero + 0.01 * rng.normal(size=arm.nq)
        v, tau = 0.1 * rng.normal(size=arm.nv), arm.patch_matrix @ [50.0, -20.0, 10.0, 5.0]
        a = arm.forward_dynamics(q, v, tau)
        np.testing.assert_allclose(arm.forward_dynamics(q, v, tau, ), a, rtol=0, atol=1e-8 * np.abs(a).max())
        close(arm.inverse_dynamics(q, v, a), tau, 1e-11 * np.abs(arm.bias(q, v)).max())
        assert arm.patches == [(0, 0), (0, 1), (1, 0), (1, 1)]


# -- scenes, pickling, errors ----------------------------------------------------------------------------------------

SCENE = """
[[link]]
joint = { type = "revolute", axis = "z" }
[link.beam]
length = 0.5
section = { type = "rectangle", y = 0.001, z = 0.02 }
material = { density = 7850, youngs_modulus = 209e9 }
modes = { bending_y = 2 }
[[link.beam.patches]]
start = 0.02
end = 0.07
width = 0.02
thickness = 0.0002
profile = [1.0, 0.5]
material = { youngs_modulus = 60.6e9, poisson_ratio = 0.3, density = 7500, d31 = -274e-12 }
[[drive]]
link = 0
patch = 0
voltage = { t = [0, 0.01, 0.1], V = [0, 10, 10] }
[simulation]
duration = 0.02
"""


def test_scene_file_and_copies(tmp_path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    scene = fa.load(path)
    run = scene.run()
    assert np.abs(run.tip_deflection()[:, 1]).max() > 1e-6
    patch = scene.arm.links[0].beam.patches[0]
    assert patch.profile == {"x": (0.02, 0.07), "share": (1.0, 0.5)}
    assert scene.arm.patches == [(0, 0)]
    for copy in (pickle.loads(pickle.dumps(scene.arm)), fa.Arm.from_dict(scene.arm.to_dict())):
        assert copy == scene.arm
        np.testing.assert_array_equal(copy.patch_matrix, scene.arm.patch_matrix)
    run.save(tmp_path / "run.npz")
    np.testing.assert_allclose(fa.Result.load(tmp_path / "run.npz").charge(), run.charge(), rtol=1e-12)
    assert "Patch(start=0.02" in repr(patch)
    curved = replace(GHOST, profile=np.cos)
    assert pickle.loads(pickle.dumps(curved)) == curved
    assert curved.share(0.05) == pytest.approx(np.cos(0.05), rel=1e-13)


def test_place_on_the_command_line(tmp_path, capsys) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    assert main(["place", str(path), "-o", str(tmp_path / "out"), "-n", "1"]) == 0
    assert "best place: from 0 to 0.05 m" in capsys.readouterr().out
    assert {p.name for p in (tmp_path / "out").iterdir()} == {f"placement.{end}" for end in ("txt", "csv", "png")}
    assert (tmp_path / "out" / "placement.csv").read_text().splitlines()[0] == "centre (m),mode 0 (m/V),merit"
    weights = ["--weight", "0", "--weight", "1"]
    assert main(["place", str(path), "-o", str(tmp_path / "out"), "-n", "2", *weights, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    bare = strip(modes={"bending_y": 2}, basis="clamped-free", joint=fa.Revolute("z"))
    patch = fa.load(path).arm.links[0].beam.patches[0]
    assert found["best"] == pytest.approx(fa.place_patch(bare, patch=patch, modes=2, weights=[0, 1]).best, abs=1e-8)
    assert main(["place", "ist"]) == 2
    assert "link = -1: has no patches" in capsys.readouterr().err


def bad(**change) -> fa.Arm:
    return strip(replace(PAIR, **change))


def bonded(**beam) -> fa.Arm:
    return strip(PAIR, **beam)


BAD = [
    (lambda: bad(start=-0.01), "start = -0.01"),
    (lambda: bad(end=0.01), "end = 0.01"),
    (lambda: bad(end=0.6), ("patches[0].end = 0.6", "0.5 m")),
    (lambda: bad(width=0.03), ("patches[0].width = 0.03", "0.02 m")),
    (lambda: bad(width=0.01, face="z"), ("patches[0].width = 0.01", "0.001 m")),
    (lambda: bad(width=0), "width = 0"),
    (lambda: bad(thickness=-1e-4), "thickness = -0.0001"),
    (lambda: bad(thickness="thin"), "thickness = 'thin'"),
    (lambda: bad(angle=np.nan), "angle = nan"),
    (lambda: bad(offset=-1.0), "offset = -1"),
    (lambda: bad(face="x"), "face = 'x'"),
    (lambda: bad(face="+y", pair="same"), "pair = 'same'"),
    (lambda: bad(pair="oposed"), ("pair = 'oposed'", "'opposed'")),
    (lambda: bad(material=STEEL), ("material = Material", "Piezo")),
    (lambda: bad(stiffness=1), "stiffness = 1"),
    (lambda: bad(profile=[1.0, 1.2]), ("profile", "1.2", "-1 to 1")),
    (lambda: bad(profile={"x": [0, 1], "share": [1, 1]}), ("profile.x =", "0.02 to 0.07", "start", "end")),
    (lambda: bad(profile={"x": [0, 1], "shar": [1, 1]}), ("profile", "key 'shar'", "'share'")),
    (lambda: bad(profile=lambda x: abs(x - 0.04)), ("profile", "smooth", "samples")),
    (lambda: bad(profile=0.5), ("profile has shape ()", "samples")),
    (
        lambda: bonded(section=fa.sections.GeneralSection(2e-5, 1e-12, 1e-12, 1e-12)),
        "patches[0].offset = None",
    ),
    (lambda: strip(7), ("patches[0] = 7", "Patch")),
    (lambda: fa.Piezo(-1, 0.3, 7500, 0), "youngs_modulus = -1"),
    (lambda: fa.Piezo(6e10, 0.7, 7500, 0), "poisson_ratio = 0.7"),
    (lambda: fa.Piezo(6e10, 0.3, 7500, np.inf), "d31 = inf"),
    (lambda: bad(material=replace(PZT, permittivity=1e-9)), "permittivity = 1e-09"),
    (lambda: bad(material=replace(PZT, permittivity=0.0)).patch_voltage([0, 0, 0]), "permittivity = 0.0"),
    (lambda: bonded().charge([0, 0, 0], 0, 1), ("patch = 1", "-1 to 0", "link 0")),
    (lambda: strip().charge([0, 0, 0]), "link = -1"),
    (lambda: bonded().equilibrium(voltages=[1, 2]), ("voltages has shape (2,)", "number")),
    (lambda: bonded().equilibrium(voltages={0: 1.0}), ("voltages", "0", "link")),
    (lambda: fa.simulate(bonded(), [0, 1], drive={("patch", 0, 0): fa.Torque(1.0)}), "Voltage"),
    (lambda: fa.simulate(bonded(), [0, 1], drive={("patch", 0): fa.Voltage(1.0)}), ("patch", "link")),
    (lambda: fa.simulate(bonded(), [0, 1], drive={("patch", 0, 3): fa.Voltage(1.0)}), ("drive", "patch = 3")),
    (lambda: fa.simulate(bonded(), [0, 1], drive={("patch", 0, 0): fa.Voltage([0, 0.5], [0, 1])}), "samples"),
    (lambda: fa.simulate(bonded(), [0, 1], drive={("patch", 0, 0): fa.Voltage(lambda t: "a")}), ("Voltage", "t = 0")),
    (lambda: fa.simulate(paper_link(), [0, 1], drive={0: fa.Voltage(1.0)}), ("Motion", "Torque")),
    (lambda: fa.Voltage([0, 1], [0, np.nan]), ("V =", "finite")),
    (lambda: bonded().linearize([0, 0, 0], inputs=[("patch", 0)]), ("inputs[0] =", "patch", "link")),
    (lambda: bonded().linearize([0, 0, 0], inputs=[], outputs=[("charge", 0, 2)]), ("outputs[0]", "patch = 2")),
    (lambda: fa.place_patch(paper_link(), patch=PAIR, length=0.6), "length = 0.6"),
    (lambda: fa.place_patch(paper_link(), patch=PAIR, weights=[1, 1]), ("weights has shape (2,)", "3", "numbers")),
    (lambda: fa.place_patch(paper_link(), patch=PAIR, modes=4), ("modes = 4", "3")),
    (lambda: fa.place_patch(paper_link(), patch=replace(PAIR, face="z", width=1e-3)), ("face 'z'", "none")),
    (lambda: fa.split(strip(PAIR, damping_ratio=0.1).links[0]), "damping_ratio = 0.1"),
    (lambda: fa.split(strip(PAIR).links[0], places=[0.7]), "places = [0.7]"),
    (lambda: fa.split(fa.Link(fa.Fixed())), ("link =", "Link", "beam")),
    (lambda: fa.place_patch(paper_link(), patch="pzt"), ("patch = 'pzt'", "Patch")),
]  # fmt: skip


@pytest.mark.parametrize(("call", "message"), BAD)
def test_bad_input(call, message: str) -> None:
    with refuses(message):
        call()


def test_bad_scenes(tmp_path) -> None:
    for change, message in (
        (('face = "w"\nprofile', "profile"), "link[0].beam.patches[0].face = 'w'"),
        (("d33 = 1, d31", "d31"), ("patches[0].material", "key 'd33'")),
        (("volts", "voltage"), ("drive[0]", "key 'volts'", "'voltage'")),
        (("patch = 2", "patch = 0"), ("drive", "patch = 2")),
    ):
        path = tmp_path / "scene.toml"
        path.write_text(SCENE.replace(change[1], change[0], 1))
        with refuses(message):
            fa.load(path).run()
