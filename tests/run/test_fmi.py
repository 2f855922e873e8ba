"""Units of FMI 3.0 and 2.0 in an importer of others, FMPy: its validation, its co-simulation, and its CVode on the
model in it.

Co-simulation is the native run to the last bit; CVode, which knows only derivatives and events, comes near it.
"""

from __future__ import annotations

import ctypes
import itertools
import re
import threading
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from flexarm.cli import main
from messages import naming, refuses, warns

fmpy = pytest.importorskip("fmpy", reason="SKIPPED, not passed: needs fmpy")
from fmpy.fmi1 import FMICallException  # noqa: E402
from fmpy.fmi2 import FMU2Model, FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE  # noqa: E402
from fmpy.fmi3 import FMU3Model, FMU3Slave, fmi3LogMessageCallback  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402

STEEL = fa.Material(7850.0, youngs_modulus=209e9, poisson_ratio=0.3)
T = np.arange(101) * 1e-3
NUMBERS = itertools.count()  # of folders: no library is written where one is in use


def arm(tip: float = 0.05, stiffness: float = 1.0, gravity: float = 9.81, spring: float = 0.0, **joint: Any) -> fa.Arm:
    steel = fa.Material(7850.0, youngs_modulus=stiffness * 209e9, poisson_ratio=0.3)
    beam = fa.Beam(0.4, fa.Rectangle(0.02, 0.002), steel, {"bending_z": 2})
    hub = fa.RigidBody(0.2, inertia=(1e-3,) * 3, end=(0.05, 0, 0))
    first, second = fa.Revolute("y", stiffness=spring, **joint), fa.Revolute("y", reflected_inertia=1e-3, damping=0.01)
    upper = fa.Link(first, hub, beam, fa.RigidBody(0.05), name="upper")
    return fa.Arm([upper, fa.Link(second, hub, beam, fa.RigidBody(tip), name="fore arm")], gravity=(0, 0, -gravity))


def ball() -> fa.Arm:
    beam = fa.Beam(0.3, fa.Rectangle(0.003, 0.01), STEEL, {"bending_y": 1, "bending_z": 1})
    hub = fa.RigidBody(0.2, inertia=(1e-3, 2e-3, 3e-3), end=(0.05, 0.02, 0))
    return fa.Arm([fa.Link(fa.Spherical(), hub, beam, fa.RigidBody(0.1, inertia=(1e-4,) * 3))], gravity=(0, 0, -9.81))


LOAD = fa.Load(-1, force=np.outer([0, 1, 0, 1, 1], [0.2, 0, 0.5]), t=[0, 0.02, 0.0501, 0.07, 0.1])
PID = fa.LinearController.pid(4.0, 2.0, 0.2, reference=0.3, rate=200, delay=1e-3)
SWING = fa.Motion(np.linspace(0, 0.1, 6), *np.array([(2 * t**3, 6 * t**2, 12 * t) for t in np.linspace(0, 0.1, 6)]).T)
SCENES = {
    "free": fa.Scene(arm(), t=T, q0={"upper": 0.2}),
    "loads": fa.Scene(arm(), t=T, loads=(LOAD,)),
    "PD": fa.Scene(arm(), t=T, control=(fa.PD(4.0, 0.2, link=0, reference=0.3, limit=0.7),)),
    "sampled": fa.Scene(arm(), t=T, control=(PID,)),
    "torque and motion": fa.Scene(arm(), t=T, drive={0: SWING, 1: fa.Torque([0, 0.03, 0.1], [0, 0.2, 0.1])}),
    "dry friction": fa.Scene(arm(coulomb=0.2, stiction=0.3), t=T, v0=[1, 0, 0, 0, 0, 0], q0={"upper": 0.2}),
    "computed torque": fa.Scene(
        arm(), t=T, control=(fa.ComputedTorque(1.0, 2.0, rate=1000.0, reference=[0.1, 0.2], elastic="zero"),)
    ),
    "ball": fa.Scene(ball(), t=T, v0=[1.0, 2.0, -1.0, 0.0, 0.0]),
}


#: What FMPy calls otherwise for FMI 2.0.
IN_FMI_2 = {
    "getFloat64": "getReal",
    "setFloat64": "setReal",
    "getInt32": "getInteger",
    "getFMUState": "getFMUstate",
    "setFMUState": "setFMUstate",
    "freeFMUState": "freeFMUstate",
    "serializeFMUState": "serializeFMUstate",
    "deserializeFMUState": "deSerializeFMUstate",
    "updateDiscreteStates": "newDiscreteStates",
    "getContinuousStateDerivatives": "getDerivatives",
}


class Instance:
    """An instance of a unit, by names. Functions are called as those of FMI 3.0."""

    def __init__(
        self, file: Path, folder: Path, slave: bool = True, log: list[str] | None = None, token: str | None = None,
        events: bool = False,
    ) -> None:  # fmt: skip
        self.about = fmpy.read_model_description(str(file))
        self.number = {v.name: v.valueReference for v in self.about.modelVariables}
        with zipfile.ZipFile(file) as archive:
            archive.extractall(folder)
        self.two = self.about.fmiVersion == "2.0"
        kind = (FMU2Model, FMU2Slave) if self.two else (FMU3Model, FMU3Slave)
        way = self.about.coSimulation if slave else self.about.modelExchange
        self.fmu: Any = kind[slave](
            guid=token or self.about.guid, unzipDirectory=str(folder), modelIdentifier=way.modelIdentifier,
            instanceName="arm",
        )  # fmt: skip
        said = [] if log is None else log
        if self.two:
            for three, two in IN_FMI_2.items():
                if hasattr(self.fmu, two):
                    setattr(self.fmu, three, getattr(self.fmu, two))
            self.log: Any = fmi2CallbackLoggerTYPE(lambda *told: said.append(told[-1].decode()))
            self.fmu.instantiate(callbacks=fmi2CallbackFunctions(logger=self.log))
            return
        self.log = fmi3LogMessageCallback(lambda *told: said.append(told[-1].decode()))
        self.fmu.instantiate(logMessage=self.log, **({"eventModeUsed": True} if events else {}))

    def begin(self, **start: float) -> Instance:
        self.set(**start)
        if self.two:
            self.fmu.setupExperiment(startTime=0.0)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=0.0)
        self.fmu.exitInitializationMode()
        return self

    def go(self, times: Any = T) -> np.ndarray:
        """Co-simulation to these times; q then."""
        for t0, t1 in itertools.pairwise(times):
            self.fmu.doStep(currentCommunicationPoint=t0, communicationStepSize=t1 - t0)
        return self.q()

    def set(self, **values: float) -> None:
        for name, value in values.items():
            self.fmu.setFloat64([self.number[name.replace("__", ".")]], [value])

    def get(self, *names: str) -> np.ndarray:
        return np.array(self.fmu.getFloat64([self.number[name] for name in names]))

    def q(self) -> np.ndarray:
        return self.get(*(name for name in self.number if name.startswith("q.")))

    def close(self) -> None:
        self.fmu.freeInstance()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("units")
    try:
        SCENES["free"].to_fmu(out / "free.fmu", fa.Implicit(1e-3))
    except RuntimeError as e:
        assert "libflexarm_fmi.so" in str(e)
        pytest.skip(f"SKIPPED, not passed: {e}")
    return out


def unit(scene: fa.Scene, folder: Path, integrator: Any = fa.Implicit(1e-3), version: int = 3) -> Path:  # noqa: B008
    file = folder / "unit.fmu"
    scene.to_fmu(file, integrator, version)
    return file


@contextmanager
def instance(scene: fa.Scene, folder: Path, **given: Any) -> Iterator[Instance]:
    integrator = given.pop("integrator", fa.Implicit(1e-3))
    version = given.pop("version", 3)
    out = Instance(unit(scene, folder, integrator, version), folder / f"unit{next(NUMBERS)}", **given)
    yield out
    out.close()


# -- co-simulation and validation --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("case", "version", "integrator"),
    [
        *((case, 3, method) for case in SCENES for method in (fa.Implicit(1e-3), fa.Gauss(), fa.RK4(1e-4))),
        *((case, 2, fa.Implicit(1e-3)) for case in ("sampled", "ball")),
    ],
)
def test_co_simulation_is_the_native_run(folder: Path, case: str, version: int, integrator: Any) -> None:
    scene = SCENES[case]
    sim = fa.Simulation(scene, integrator)
    with instance(scene, folder, integrator=integrator, version=version) as of:
        assert not validate_fmu(str(folder / "unit.fmu"))
        of.begin()
        for t0, t1 in itertools.pairwise(T):
            of.go([t0, t1])
            sim.step(until=t1)
            np.testing.assert_array_equal(of.q(), sim.q)
        rates = [name for name in of.number if name.startswith("v.")]
        np.testing.assert_array_equal(of.get(*rates), sim.v)
        derivatives = [f"der({n})" if f"der({n})" in of.number else n.replace("v.", "a.") for n in rates]
        np.testing.assert_array_equal(of.get(*derivatives), sim.a)
        place, R = scene.arm.frame(sim.q)
        np.testing.assert_allclose(of.get("tip.x", "tip.y", "tip.z"), place, atol=1e-14)
        np.testing.assert_allclose(
            of.get(*(f"tip.R[{i},{j}]" for i in (1, 2, 3) for j in (1, 2, 3))), R.ravel(), atol=1e-14
        )


def test_times_may_be_sums_that_round(folder: Path) -> None:
    """An importer adds its steps up; the run is that of the even times."""
    sim = fa.Simulation(SCENES["loads"], fa.Implicit(1e-3))
    for t in T[1:]:
        sim.step(until=t)
    with instance(SCENES["loads"], folder) as of:
        of.begin()
        t = 0.0
        for _ in T[1:]:
            of.fmu.doStep(currentCommunicationPoint=t, communicationStepSize=1e-3)
            t += 1e-3
        assert t != T[-1]
        np.testing.assert_array_equal(of.q(), sim.q)


def test_inputs_are_added(folder: Path) -> None:
    scene = fa.Scene(arm(), t=T, loads=(LOAD,), control=(fa.PD(4.0, 0.2, link=0, reference=0.25),))
    both = fa.Scene(
        arm(),
        t=T,
        loads=(LOAD, fa.Load(-1, force=(0.0, 0.0, 0.4))),
        control=(fa.PD(4.0, 0.2, link=0, reference=0.25 + 0.125),),
        drive={1: fa.Torque(0.05)},
    )
    with instance(scene, folder) as of:
        of.begin(add__load_0__force_z=0.4, add__law_0__reference=0.125, add__force__fore_arm_revolute=0.05)
        got = of.go()
    sim = fa.Simulation(both, fa.Implicit(1e-3))
    for t in T[1:]:
        sim.step(until=t)
    np.testing.assert_allclose(got, sim.q, rtol=0, atol=1e-11)
    with instance(scene, folder) as of:
        of.begin()
        of.go(T[:51])
        of.set(add__force__fore_arm_revolute=0.05)
        got = of.go(T[50:])
    sim = fa.Simulation(scene, fa.Implicit(1e-3))
    for k, t in enumerate(T[1:]):
        if k == 50:
            sim.set_tau(0.05 * np.eye(6)[3])
        sim.step(until=t)
    np.testing.assert_array_equal(got, sim.q)


@pytest.mark.parametrize(
    ("given", "other"),
    [
        ({"payload__fore_arm": 0.3}, fa.Scene(arm(tip=0.35), t=T, q0={"upper": 0.2})),
        (
            {"beam_stiffness__upper": 1.5, "beam_stiffness__fore_arm": 1.5},
            fa.Scene(arm(stiffness=1.5), t=T, q0={"upper": 0.2}),
        ),
        (
            {"joint_stiffness__upper_revolute": 2.0, "joint_damping__upper_revolute": 0.1},
            fa.Scene(arm(spring=2.0, damping=0.1), t=T, q0={"upper": 0.2}),
        ),
    ],
)
def test_parameters(folder: Path, given: dict[str, float], other: fa.Scene) -> None:
    """A unit with a parameter moves as that of the scene with this number."""
    with instance(SCENES["free"], folder) as of:
        got = of.begin(**given).go()
    sim = fa.Simulation(other, fa.Implicit(1e-3))
    for t in T[1:]:
        sim.step(until=t)
    still = fa.Simulation(SCENES["free"], fa.Implicit(1e-3))
    still.step(until=T[-1])
    assert np.abs(sim.q - still.q).max() > 1e-4
    np.testing.assert_allclose(got, sim.q, rtol=0, atol=1e-10)


def test_gains_step_and_start(folder: Path) -> None:
    with instance(SCENES["PD"], folder) as of:
        got = of.begin(law_0__kp=6.0, law_0__kv=0.5, step=5e-4, q__upper_revolute=0.1).go()
    scene = fa.Scene(arm(), t=T, control=(fa.PD(6.0, 0.5, link=0, reference=0.3, limit=0.7),), q0={"upper": 0.1})
    sim = fa.Simulation(scene, fa.Implicit(5e-4))
    for t in T[1:]:
        sim.step(until=t)
    np.testing.assert_allclose(got, sim.q, rtol=0, atol=1e-12)


def test_readings(folder: Path) -> None:
    sensors = (
        fa.sensors.Encoder(0),
        fa.sensors.Tachometer(1, gain=2.0, offset=0.1),
        fa.sensors.StrainGauge(0, x=0.1),
        fa.sensors.Camera(1, x=0.2, offset=(0.0, 0.0, 1.0)),
    )
    scene = fa.Scene(arm(), t=T, loads=(LOAD,), sensors=sensors)
    sim = fa.Simulation(scene, fa.Implicit(1e-3))
    for t in T[1:]:
        sim.step(until=t)
    with instance(scene, folder) as of:
        of.begin().go()
        got = of.get(*(name for name in of.number if name.startswith("sensor_")))
    want = [s.measure(scene.arm, T[-1], sim.q, sim.v) for s in sensors]
    want = np.concatenate([want[0], 2.0 * want[1] + 0.1, want[2], want[3] + [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(got, want, rtol=1e-12, atol=1e-15)
    scene.sensors = (fa.sensors.Accelerometer(0),)
    with warns(fa.errors.ModelWarning, "sensors[0]", "accelerometer"):
        scene.to_fmu(folder / "unit.fmu", fa.Implicit(1e-3))


# -- model exchange ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("case", "version"), [*((case, 3) for case in SCENES), ("sampled", 2), ("dry friction", 2), ("ball", 2)]
)
def test_model_exchange_by_cvode(folder: Path, case: str, version: int) -> None:
    """FMPy's CVode (BDF), at a tolerance of 1e-8, against the native run with an error below 1e-8."""
    scene = SCENES[case]
    file = unit(scene, folder, fa.Gauss(tolerance=1e-9), version)
    names = [v.name for v in fmpy.read_model_description(str(file)).modelVariables if v.name.startswith("q.")]
    got = fmpy.simulate_fmu(
        str(file),
        fmi_type="ModelExchange",
        stop_time=T[-1],
        output_interval=1e-3,
        output=names,
        relative_tolerance=1e-8,
        record_events=False,
    )
    run = fa.simulate(scene.arm, T, scene.q0, scene.v0, **scene.given(), integrator=fa.Gauss(tolerance=1e-9))
    np.testing.assert_allclose(np.stack([got[name] for name in names], axis=1), run.q, rtol=0, atol=2e-6)


def test_friction_holds_at_events(folder: Path) -> None:
    """A joint that slides comes to rest, and is still to the last bit, until a torque tears it loose."""
    scene = fa.Scene(
        arm(gravity=0.0, coulomb=0.4, stiction=0.5),
        t=T,
        v0=[0.2, 0, 0, 0, 0, 0],
        drive={0: fa.Torque([0, 0.05, 0.1], [0, 0, 2])},
    )
    file = unit(scene, folder)
    got = fmpy.simulate_fmu(
        str(file),
        fmi_type="ModelExchange",
        stop_time=0.1,
        output_interval=1e-3,
        output=["q.upper_revolute", "v.upper_revolute"],
        relative_tolerance=1e-8,
        record_events=False,
    )
    v = got["v.upper_revolute"]
    still = np.flatnonzero(v == 0.0)
    assert 20 < len(still) == still[-1] - still[0] + 1 < 60
    assert v[still[-1] + 5] > 0 and len(set(got["q.upper_revolute"][still])) == 1
    run = fa.simulate(scene.arm, T, v0=scene.v0, drive=scene.drive, integrator=fa.Implicit(5e-5))
    np.testing.assert_allclose(got["q.upper_revolute"], run.q[:, 0], atol=1e-5)


@pytest.mark.parametrize(
    ("version", "case"), [*((3, c) for c in ("loads", "PD", "ball", "dry friction", "torque and motion")), (2, "ball")]
)
def test_directional_derivatives(folder: Path, case: str, version: int) -> None:
    """Of all derivatives and outputs by all states and inputs, against differences of fourth order."""
    scene = SCENES[case]
    rng = np.random.default_rng(1)
    with instance(scene, folder, slave=False, version=version) as of:
        of.begin()
        of.fmu.updateDiscreteStates()
        of.fmu.enterContinuousTimeMode()
        about = of.about
        derivatives = [u.variable for u in about.derivatives]
        n = len(derivatives)
        states = [v.derivative.valueReference for v in derivatives]
        unknowns = [v.valueReference for v in derivatives]
        unknowns += [u.variable.valueReference for u in about.outputs if not u.variable.name.startswith("sensor")]
        inputs = [v.valueReference for v in about.modelVariables if v.causality == "input" and "sampled" not in v.name]
        x = np.zeros(n)
        at = x.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
        of.fmu.getContinuousStates(at, n)
        move = rng.normal(size=n) * np.array([1e-3 if "bending" in v.name else 0.3 for v in derivatives])
        if case != "dry friction":  # whose first joint slides
            x += move
        u, seed = 0.1 * rng.normal(size=len(inputs)), rng.normal(size=n + len(inputs))
        seed[:n] *= 1e-2
        x0 = x.copy()

        def values(h: float) -> np.ndarray:
            x[:] = x0 + h * seed[:n]
            of.fmu.setContinuousStates(at, n)
            if inputs:
                of.fmu.setFloat64(inputs, list(u + h * seed[n:]))
            return np.array(of.fmu.getFloat64(unknowns))

        h = 2e-3
        want = (8 * (values(h) - values(-h)) - (values(2 * h) - values(-2 * h))) / (12 * h)
        values(0.0)
        got = np.array(of.fmu.getDirectionalDerivative(unknowns, states + inputs, list(seed)))
        assert np.abs(want).max() > 0.1
        np.testing.assert_allclose(got, want, rtol=2e-7, atol=2e-7 * np.abs(want).max())


def test_what_is_no_ordinary_differential_equation_is_for_co_simulation(folder: Path) -> None:
    floor = fa.Contact(fa.Point(1), fa.Plane((0, 0, -0.1), (0, 0, 1)), stiffness=1e5, coulomb=0.3)
    scene = fa.Scene(fa.Arm(arm().links, contacts=[floor]), t=T)
    about = fmpy.read_model_description(str(unit(scene, folder)))
    assert about.modelExchange is None and about.coSimulation is not None
    assert not validate_fmu(str(folder / "unit.fmu"))


# -- states, errors, threads -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("case", "version"),
    [("loads", 3), ("sampled", 3), ("dry friction", 3), ("computed torque", 3), ("sampled", 2), ("dry friction", 2)],
)
def test_states_go_on_to_the_last_bit(folder: Path, case: str, version: int) -> None:
    of_version = {"version": version}
    with instance(SCENES[case], folder, **of_version) as of, instance(SCENES[case], folder, **of_version) as other:
        of.begin(add__force__upper_revolute=0.1)
        of.go(T[:41])
        state = of.fmu.getFMUState()
        of.set(add__force__upper_revolute=0.2)
        want = of.go(T[40:])
        of.fmu.setFMUState(state)
        of.set(add__force__upper_revolute=0.2)
        np.testing.assert_array_equal(of.go(T[40:]), want)
        content = of.fmu.serializeFMUState(state)
        of.fmu.freeFMUState(state)
        with refuses("failed", error=FMICallException):
            other.fmu.deserializeFMUState(content[:40] + b"?" + content[41:])  # a byte is damaged
        there = other.fmu.deserializeFMUState(content)  # in an instance that has not begun
        other.fmu.setFMUState(there)
        assert other.get("add.force.upper_revolute") == 0.1
        other.set(add__force__upper_revolute=0.2)
        np.testing.assert_array_equal(other.go(T[40:]), want)
        other.fmu.freeFMUState(there)


def test_reset(folder: Path) -> None:
    with instance(SCENES["sampled"], folder) as of:
        want = of.begin().go()
        of.fmu.reset()
        other = of.begin(payload__fore_arm=0.1).go()
        of.fmu.reset()
        assert np.abs(other - want).max() > 1e-4
        np.testing.assert_array_equal(of.begin().go(), want)


def test_a_state_brings_its_parameters(folder: Path) -> None:
    """Into an instance whose own were others, and have not yet been used."""
    with instance(SCENES["free"], folder) as of:
        of.begin(payload__fore_arm=0.1).go(T[:21])
        state = of.fmu.getFMUState()
        want = of.go(T[20:])
        of.fmu.reset()
        of.begin().go(T[:5])
        of.fmu.reset()
        of.set(payload__fore_arm=0.1)
        of.fmu.setFMUState(state)
        np.testing.assert_array_equal(of.go(T[20:]), want)
        of.fmu.freeFMUState(state)


def test_event_mode_of_co_simulation(folder: Path) -> None:
    """For importers that set inputs in it; steps meet events themselves."""
    log: list[str] = []
    with instance(SCENES["sampled"], folder) as of, instance(SCENES["sampled"], folder, events=True, log=log) as other:
        want = of.begin(add__force__upper_revolute=0.2).go()
        other.begin()
        with refuses("failed", error=FMICallException):
            other.go(T[:2])
        assert re.search(naming("fmi3DoStep", "event"), log[-1])
        other.set(add__force__upper_revolute=0.2)
        assert not any(other.fmu.updateDiscreteStates()[:5])
        other.fmu.enterStepMode()
        other.go(T[:51])
        other.fmu.enterEventMode()
        other.fmu.updateDiscreteStates()
        other.fmu.enterStepMode()
        np.testing.assert_array_equal(other.go(T[50:]), want)
        with refuses("failed", error=FMICallException):
            of.fmu.enterEventMode()


@pytest.mark.parametrize("version", [3, 2])
def test_events_ask_solvers_to_begin_anew(folder: Path, version: int) -> None:
    """Forces leap there, also where states do not."""
    with instance(SCENES["sampled"], folder, slave=False, version=version) as of:
        of.begin()
        *_, changed, defined, when = of.fmu.updateDiscreteStates()
        assert changed and defined and when == 1e-3  # the delayed force of the first sample


@pytest.mark.parametrize("version", [3, 2])
def test_calls_that_are_wrong_give_errors(folder: Path, version: int) -> None:
    """Pointers to nothing, and calls in the wrong mode: each is refused, with a reason."""
    log: list[str] = []
    none = ctypes.c_void_p()
    with instance(SCENES["dry friction"], folder, slave=False, log=log, version=version) as of:

        def refused(name: str, *given: Any) -> None:
            log.clear()
            call = of.fmu.dll[f"fmi{version}{name}"]  # without FMPy's types
            assert call(ctypes.c_void_p(of.fmu.component), *given) == 3, name
            assert len(log) == 1, name
            assert call(none, *given) == 3, name

        number, many = (ctypes.c_double * 99)(), ctypes.c_size_t(12)
        state, values = ("FMUState", "Float64") if version == 3 else ("FMUstate", "Real")
        refused("EnterEventMode")
        refused("SetTime", ctypes.c_double(0.1))
        refused("SetContinuousStates", number, many)
        refused("CompletedIntegratorStep", 1, number, number)
        refused("ExitInitializationMode")
        of.begin()
        for get_or_set in ("Get", "Set"):
            refused(get_or_set + values, none, many, none, many)
        refused("GetContinuousStates", none, many)
        refused("GetContinuousStates", number, ctypes.c_size_t(11))
        refused("GetEventIndicators", none, ctypes.c_size_t(1))
        refused("SetDebugLogging", 1, many, none)
        refused("Get" + state, none)
        refused("Set" + state, none)
        refused(f"Serialized{state}Size", none, number)
        refused("DoStep", ctypes.c_double(0.0), ctypes.c_double(1e-3), 1, number, number, number, number)
        rest = [many, none, many] if version == 3 else [none]
        refused("GetDirectionalDerivative", none, many, none, many, none, *rest)
        refused("UpdateDiscreteStates" if version == 3 else "NewDiscreteStates", *[none] * 6)


@pytest.mark.parametrize("version", [3, 2])
def test_errors_are_logged_by_name(folder: Path, version: int) -> None:
    log: list[str] = []
    with instance(SCENES["PD"], folder, log=log, version=version) as of:

        def fails(what: Any, *named: Any) -> None:
            log.clear()
            with refuses("failed", error=FMICallException):
                what()
            assert len(log) == 1
            assert re.search(naming(*named), log[0])

        fails(lambda: of.set(payload__fore_arm=-1.0) or of.q(), "payload.fore_arm", -1)
        of.set(payload__fore_arm=0.0)
        fails(lambda: of.set(add__force__upper_revolute=np.nan), "add.force.upper_revolute", "nan", "finite")
        fails(lambda: of.set(tip__x=1.0), "tip.x", "calculated")
        fails(lambda: of.go([0.0, 0.1]), f"fmi{version}DoStep", "instantiated")
        of.begin()
        fails(lambda: of.set(law_0__kp=1.0), "law_0.kp", 1, "initialisation")
        fails(lambda: of.go([0.05, 0.1]), "currentCommunicationPoint", 0.05)
        fails(lambda: of.fmu.getInt32([1]), *(("Int32", "Float64") if version == 3 else ("Integer", "Real")))
        fails(lambda: of.fmu.getFloat64([99999]), "value reference", 99999)
        of.set(add__force__upper_revolute=1e12)
        fails(lambda: of.go([0.0, 1.0]), "step")
    log.clear()
    with refuses("instantiate", error=Exception):
        Instance(unit(SCENES["PD"], folder, version=version), folder / "other", log=log, token="another")
    assert re.search(naming("token", "another"), log[0])


def test_threads(folder: Path) -> None:
    """Instances of one library, in threads of their own."""
    file = unit(SCENES["sampled"], folder)
    all_ = [Instance(file, folder / f"thread{k}") for k in range(4)]
    found: dict[int, np.ndarray] = {}

    def work(k: int) -> None:
        found[k] = all_[k].begin(payload__fore_arm=0.1 * (k % 2)).go()

    threads = [threading.Thread(target=work, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    np.testing.assert_array_equal(found[0], found[2])
    np.testing.assert_array_equal(found[1], found[3])
    assert np.abs(found[0] - found[1]).max() > 1e-4


# -- names -----------------------------------------------------------------------------------------------------


def test_names_that_become_alike_are_told_apart(folder: Path) -> None:
    link, other = arm().links
    links = [replace(link, name="a b"), replace(other, name="a_b", joint=fa.Revolute("y", coulomb=0.1))]
    scene = fa.Scene(fa.Arm(links), t=T, name="of <two> \"arms\"\x01")
    with instance(scene, folder) as of:
        assert not validate_fmu(str(folder / "unit.fmu"))
        assert {"q.a_b_revolute", "der(v.a_b_revolute_2)", "friction.a_b_revolute_2", "payload.a_b_2"} <= {*of.number}


def test_an_arm_with_a_servo_has_its_end(folder: Path) -> None:
    """Links of the controller's states come behind it."""
    servo = fa.Servo(0, kp=6.0, kv=0.4, current_loop=100.0, rate=250.0, reference=0.3)
    scene = fa.Scene(arm(), t=T, control=(servo,))
    with instance(scene, folder) as of:
        q = of.begin(payload__fore_arm=0.0).go()
        np.testing.assert_allclose(of.get("tip.x", "tip.y", "tip.z"), scene.arm.frame(q[: scene.arm.nq])[0], atol=1e-14)


# -- the archive -------------------------------------------------------------------------------------------------------


def test_command(folder: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    assert main(["export", "ist", "--fmi", "ist.fmu", "--step", "1e-3"]) == 0
    assert "ist.fmu" in capsys.readouterr().out
    assert not validate_fmu("ist.fmu")
    assert (folder / "ist.fmu").stat().st_size < 5e6
    with zipfile.ZipFile("ist.fmu") as archive:
        assert "documentation/index.html" in archive.namelist()
    assert main(["export", "ist", "--fmi", "ist.fmu", "--step", "-1"]) == 2
    assert main(["export", "ist", "--fmi", "two.fmu", "--step", "1e-3", "--fmi-version", "2"]) == 0
    assert fmpy.read_model_description("two.fmu").fmiVersion == "2.0" and not validate_fmu("two.fmu")


def test_refuses(folder: Path) -> None:
    scene = SCENES["free"]
    with refuses("integrator", "ida", "Implicit"):
        scene.to_fmu(folder / "bad.fmu", fa.Ida())
    with refuses("version", 1, 3):
        scene.to_fmu(folder / "bad.fmu", fa.Implicit(1e-3), version=1)
    with refuses("path", ".fmu"):
        scene.to_fmu(folder / "bad.zip", fa.Implicit(1e-3))
    with refuses("drive 0", "samples"):
        fa.Scene(arm(), drive={0: fa.Torque(lambda t: t)}).to_fmu(folder / "bad.fmu", fa.Implicit(1e-3))
    assert not list(folder.glob("bad.*"))
