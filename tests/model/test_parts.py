"""Parts made of NumPy's numbers are those made of plain ones, and so are the files they are saved in."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from messages import refuses

STEEL = {"density": 7850.0, "youngs_modulus": 209e9, "poisson_ratio": 0.25}
PZT = {"youngs_modulus": 63e9, "poisson_ratio": 0.3, "density": 7600.0, "d31": -1.7e-10, "permittivity": 1.5e-8}
SPRING = {"stiffness": 2.0, "rest": 0.5, "damping": 0.25, "lower": -1.0, "upper": 1.0, "limit_stiffness": 50.0}
DRY = {"coulomb": 0.5, "stiction": 0.75, "reflected_inertia": 0.125, "limit_damping": 0.5}
NOISY = {"rate": 100.0, "delay": 0.25, "noise": 0.5, "range": 8.0, "seed": 3}
STRIP = {"length": 0.5, "modes": {"bending_y": 2, "torsion": 1}, "order": 2, "gauss_points": 9, "rotary_inertia": True}


def beam(**given: Any) -> fa.Beam:
    return fa.Beam(section=fa.Rectangle(0.001, 0.02), material=fa.Material(**STEEL), **given)


def patch(**given: Any) -> fa.Patch:
    return fa.Patch(material=fa.Piezo(**PZT), **given)


KINDS: list[tuple[Callable[..., Any], dict[str, Any]]] = [
    (fa.Material, STEEL),
    (fa.Rectangle, {"y": 0.5, "z": 0.25, "shear_correction": 0.75}),
    (fa.Circle, {"radius": 0.5, "inner_radius": 0.25}),
    (fa.sections.Box, {"y": 0.5, "z": 0.25, "thickness": [0.0625, 0.03125], "shear_correction": [0.5, 0.25]}),
    (fa.sections.IBeam, {"y": 0.5, "z": 0.25, "flange": 0.0625, "web": 0.03125}),
    (
        fa.sections.GeneralSection,
        {"area": 0.5, "second_moment_y": 1.0, "second_moment_z": 2.0, "torsion_constant": 0.5},
    ),
    (fa.sections.Taper, {"x": [0.0, 0.5], "sections": [fa.Circle(0.5), fa.Circle(0.25)]}),
    (fa.RigidBody, {"mass": 2, "com": [0.5, 0.0, 1.0], "inertia": [1.0, 1.0, 1.5], "end": [1.0, 0.0, 0.0]}),
    (fa.RigidBody, {"inertia": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]}),
    (fa.Placement, {"position": [0.5, 0.0, 0.0], "rotation": [0.0, 0.5, 0.0]}),
    (fa.Piezo, PZT),
    (patch, {"start": 0.125, "end": 0.25, "width": 0.5, "thickness": 0.25, "angle": 0.5, "face": "+y", "mass": False}),
    (patch, {"start": 0.0, "end": 0.5, "width": 0.5, "thickness": 0.25, "offset": 0.0, "profile": [0.0, 1.0]}),
    (beam, STRIP | {"damping_ratio": 0.25, "kelvin_voigt": 0.5, "basis": "legendre"}),
    (beam, STRIP | {"modes": {"bending_y": [{"legendre": [1.0]}, {"legendre": [0.0, 0.5]}]}}),
    (fa.Revolute, SPRING | DRY | {"axis": "y"}),
    (fa.Prismatic, SPRING | {"axis": [0.0, 0.0, 1.0]}),
    (fa.Universal, {"stiffness": [1.0, 2.0], "damping": 0.5, "coulomb": [0.5, 0.0]}),
    (fa.Planar, {"lower": [-1.0, -2.0, -3.0], "limit_stiffness": 4.0}),
    (fa.Spherical, {"stiffness": 2.0, "upper": 1.5, "limit_stiffness": 8.0}),
    (fa.Free, {"damping": 0.5}),
    (fa.Axes, {"axes": ["tx", "rz"], "damping": [0.5, 0.25]}),
    (fa.Fixed, {}),
    (fa.sensors.Encoder, NOISY | {"link": 0, "freedom": 0, "pulses": 500, "quadrature": True, "gear_ratio": 2.0}),
    (fa.sensors.Tachometer, NOISY | {"link": 0, "resolution": 0.5}),
    (fa.sensors.ForceTorque, NOISY | {"link": 0, "side": "inboard", "noise": [1.0, 1.0, 1.0, 0.5, 0.5, 0.5]}),
    (fa.sensors.StrainGauge, NOISY | {"link": 0, "x": 0.25, "face": "-y", "gauge_factor": 2.0, "distance": 0.5}),
    (fa.sensors.Accelerometer, NOISY | {"link": -1, "x": 0.25, "axis": "xyz", "gravity": False}),
    (fa.sensors.Accelerometer, {"axis": [0.0, 1.0, 0.0]}),
    (fa.sensors.Camera, NOISY | {"link": -1, "x": 0.5, "axes": "link"}),
]


def as_numpy(value: Any, pick: Callable[[int], int]) -> Any:
    """The same in one of NumPy's types; what stands here is exact in all of them."""
    if isinstance(value, dict):
        return {k: as_numpy(v, pick) for k, v in value.items()}
    if isinstance(value, list):
        if any(isinstance(v, (list, dict)) or hasattr(v, "to_dict") for v in value) or pick(2):
            return [as_numpy(v, pick) for v in value]
        return np.array(value)
    if isinstance(value, bool):
        return np.bool_(value)
    if isinstance(value, int):
        return [np.int64, np.int32, np.int16, lambda x: np.array(x)][pick(4)](value)
    if isinstance(value, float):
        kinds = [np.float64, lambda x: np.array(x), np.longdouble, np.float32]
        return kinds[pick(4 if float(np.float32(value)) == value else 2)](value)
    return np.str_(value) if isinstance(value, str) else value


@pytest.mark.parametrize(("make", "plain"), KINDS, ids=lambda x: getattr(x, "__name__", ""))
@settings(max_examples=4, deadline=None, derandomize=True, phases=[Phase.generate])
@given(data=st.data())
def test_numpys_numbers_make_the_same_part(make: Callable[..., Any], plain: dict[str, Any], data: Any) -> None:
    part = make(**plain)
    other = make(**as_numpy(plain, lambda n: data.draw(st.integers(0, n - 1))))
    assert other == part and repr(other) == repr(part)
    assert json.dumps(other.to_dict()) == json.dumps(part.to_dict())  # json knows no numbers of NumPy's
    assert pickle.loads(pickle.dumps(other)) == part


def test_a_spring_given_by_numpy_is_in_the_saved_scene(tmp_path) -> None:
    hinge = fa.Revolute("z", stiffness=np.float64(2), damping=np.array(0.5), lower=np.float32(-1), limit_stiffness=[3])
    body = fa.RigidBody(np.float32(2), inertia=np.ones(3))
    arm = fa.Arm([fa.Link(hinge, body)], np.array([0, -10, 0]))
    scene = fa.Scene(arm, {np.int64(0): fa.Torque(np.float64(1))}, options={"rtol": np.float64(1e-7)})
    scene.sensors = (fa.sensors.Encoder(link=np.int64(0), pulses=np.int32(100)),)
    scene.control = (fa.PD(np.float32(1), np.int64(2), np.int64(0), limit=np.float64(3)),)
    scene.loads = (fa.Load(np.int64(0), force=np.ones(3)),)
    scene.save(tmp_path / "scene.toml")
    back = fa.load(tmp_path / "scene.toml")
    assert back.arm == arm and back.arm.links[0].joint.stiffness == 2.0 and back.sensors == scene.sensors
    run = scene.run()
    np.testing.assert_array_equal(back.run().q, run.q)
    run.save(tmp_path / "run.npz")
    assert fa.Result.load(tmp_path / "run.npz").arm == arm


def test_noise_does_not_depend_on_the_type_of_a_number() -> None:
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, inertia=(1, 1, 1)))])
    run = fa.simulate(arm, np.linspace(0, 1, 11), v0=[1])
    noisy = [fa.sensors.Tachometer(link=link, noise=0.1).read(run).y for link in (0, np.int64(0))]
    np.testing.assert_array_equal(*noisy)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: fa.Material("steel", 2e11), "density = 'steel'"),
        (lambda: fa.Link(3), ("joint = 3", "Joint")),
        (lambda: fa.Link(fa.Fixed(), hub=fa.Fixed()), ("hub = Fixed", "RigidBody", "None")),
        (lambda: fa.Revolute(inboard=3), ("inboard = 3", "Placement", "None")),
        (lambda: fa.sections.Ply(1e-3, 7), ("material = 7", "Orthotropic", "Material")),
        (lambda: fa.sensors.Encoder(quadrature=1), "quadrature = 1"),
        (lambda: fa.Motor(0.05, limit="high"), "limit = 'high'"),
    ],
)
def test_a_part_checks_its_arguments_by_their_types(make: Any, message: str) -> None:
    with refuses(message):
        make()
