"""Units of FMI 3.0: a scene as an archive that other simulators import, without Python at their side.

The variables of a unit are listed here once, as XML for the importer, and as JSON for the library in it, whose kinds of
variables are those of its room `fmi`. (Modelica Association, Functional Mock-up Interface 3.0.1, 2023.)
"""

from __future__ import annotations

import hashlib
import html
import json
import platform
import re
import warnings
import zipfile
from io import BytesIO
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

import flexarm._core as _core

from ..._check import outside
from ...model.parts.part import ModelWarning
from ..sensing.sensor import Sensor
from ..sensing.sensors import Camera
from .writer import compiled_text

_LIBRARY = "libflexarm_fmi.so"
_DATE = (1980, 1, 1, 0, 0, 0)  # of the files within: the same scene gives the same bytes
#: exponents of kg, m, s, A, rad
_UNITS = {
    "rad": {"rad": 1}, "m": {"m": 1}, "s": {"s": 1}, "kg": {"kg": 1}, "rad/s": {"rad": 1, "s": -1},
    "m/s": {"m": 1, "s": -1}, "rad/s2": {"rad": 1, "s": -2}, "m/s2": {"m": 1, "s": -2}, "N": {"kg": 1, "m": 1, "s": -2},
    "N.m": {"kg": 1, "m": 2, "s": -2}, "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
}  # fmt: skip
_FORCE = {"rad": "N.m", "m": "N"}
_WRENCH = ("force_x", "force_y", "force_z", "moment_x", "moment_y", "moment_z")


def _identifier(name: str) -> str:
    """A name of letters, digits and underscores, as variables of FMI have it."""
    out = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_") or "_"
    return f"_{out}" if out[0].isdigit() else out


def _tag(name: str, given: dict[str, Any], inside: str = "") -> str:
    text = "".join(f" {k}={quoteattr(str(v))}" for k, v in given.items() if v is not None)
    return f"<{name}{text}>{inside}</{name}>" if inside else f"<{name}{text}/>"


def _constant(law: Any) -> bool:
    """Whether a compiled law of time is none, or the same at all times."""
    if law is None:
        return True
    rows = np.array(law["coefficients"])
    return not rows[:-1].any() and bool((rows[-1] == rows[-1, 0]).all())


class _Variables:
    """The variables of a compiled scene, in the order of their value references."""

    def __init__(self, scene: Any, compiled: dict[str, Any]) -> None:
        self.scene, self.of = scene, compiled
        self.xml: list[dict[str, Any]] = []
        self.json: list[dict[str, Any]] = []
        self.states: list[int] = []  # references of the derivatives, in the order of the states
        self.names: set[str] = set()
        self.left_out: list[str] = []
        self._add("time", "time", causality="independent", unit="s", description="time")
        self._rates()
        self._motion()
        self._ends()
        self._sensors()
        self._inputs()
        self._parameters()

    def _add(
        self, name: str, kind: str, i: int = 0, j: int = 0, more: dict[str, Any] | None = None, **xml: Any
    ) -> int:
        """A variable. @ its value reference"""
        base, k = name, 2
        while name in self.names:
            name, k = f"{base}_{k}", k + 1
        self.names.add(name)
        about = {"name": name, "kind": kind, "i": i, "j": j, **(more or {})}
        if xml.get("causality") in ("input", "parameter"):
            about["start"] = xml["start"]
        self.json.append(about)
        self.xml.append({"name": name, "valueReference": len(self.xml), **xml})
        return len(self.xml) - 1

    def _input(self, name: str, kind: str, i: int, j: int = 0, **xml: Any) -> None:
        self._add(name, kind, i, j, causality="input", start=0.0, **xml)

    def _parameter(self, name: str, kind: str, start: float, i: int = 0, j: int = 0, **xml: Any) -> None:
        self._add(name, kind, i, j, causality="parameter", variability="fixed", initial="exact", start=start, **xml)

    def _rates(self) -> None:
        """Names, units and coordinates of all rates, those of controllers' states too."""
        arm, links = self.scene.arm, self.of["arm"]["links"]
        more = len(self.of["v0"]) - arm.nv
        self.rate_names = [*map(_identifier, arm.coordinates), *(f"control_state_{k}" for k in range(more))]
        self.q_names = [*map(_identifier, arm.q_names), *(f"control_state_{k}" for k in range(more))]
        self.coordinate = [arm.coordinate_of(i) for i in range(arm.nv)]
        self.coordinate += [arm.nq + k for k in range(more)]
        self.unit: dict[int, str] = {}  # of the rates of joints
        self.joints: list[tuple[int, int, int]] = []  # rate, link, freedom
        first = 0
        for n, link in enumerate(links):
            count = len(link["joint"]["labels"])
            if n < len(arm.links):
                self.unit |= dict(zip(range(first, first + count), arm[n].joint.units, strict=True))
                self.joints += [(first + k, n, k) for k in range(count)]
            first += count + (len(link["beam"]["stiffness"]) if link["beam"] else 0)
        self.prescribed = {d["rate"] for d in self.of["drives"] if d["motion"] is not None}

    def _motion(self) -> None:
        """The states, their derivatives, and forces."""
        moved = {self.coordinate[i] for i in self.prescribed}
        unit = {self.coordinate[i]: u for i, u in self.unit.items()}
        per = {i: f"{u}/s" for i, u in self.unit.items()}
        at_q = []
        for c, name in enumerate(self.q_names):
            start = {"initial": "calculated"} if c in moved else {"initial": "exact", "start": self.of["q0"][c]}
            at_q.append(self._add(f"q.{name}", "q", c, causality="output" if c in unit or c in moved else "local",
                                  unit=unit.get(c), description="coordinate", **start))  # fmt: skip
        at_v, derivative = [], dict[int, int]()
        for i, name in enumerate(self.rate_names):
            start = {"initial": "calculated"} if i in self.prescribed else {"initial": "exact", "start": self.of["v0"][i]}
            c = self.coordinate[i]
            free = c >= 0 and i not in self.prescribed
            at_v.append(self._add(f"v.{name}", "v", i, causality="output" if i in self.unit else "local",
                                  unit=per.get(i), description="rate", derivative=at_q[c] if free else None, **start))  # fmt: skip
            if free:
                derivative[c] = at_v[-1]
        for c in range(len(self.q_names)):
            if c not in derivative and c not in moved:
                derivative[c] = self._add(f"der(q.{self.q_names[c]})", "dq", c, causality="local", initial="calculated",
                                          derivative=at_q[c])  # fmt: skip
        self.states = [derivative[c] for c in sorted(derivative)]
        for i, name in enumerate(self.rate_names):
            free = i not in self.prescribed
            at = self._add(f"der(v.{name})" if free else f"a.{name}", "a", i, causality="local", initial="calculated",
                           unit=f"{per[i]}2" if i in per else None, derivative=at_v[i] if free else None)  # fmt: skip
            if free:
                self.states.append(at)
        for i, u in self.unit.items():
            about: dict[str, Any] = {"causality": "local", "initial": "calculated", "unit": _FORCE[u]}
            self._add(f"force.{self.rate_names[i]}", "tau", i, **about,
                      description="force of drives and controllers; of a prescribed motion its reaction")  # fmt: skip
        self.indicators = []
        for i, n, k in self.joints:
            forces = self.of["arm"]["links"][n]["joint"]["forces"]
            if not forces or not (forces[k]["coulomb"] or forces[k]["stiction"]):
                continue
            self._add(f"friction.{self.rate_names[i]}", "friction", i, causality="local", initial="calculated",
                      unit=_FORCE[self.unit[i]], description="dry friction")  # fmt: skip
            if i not in self.prescribed:
                at = self._add(f"indicator.{self.rate_names[i]}", "indicator", i, causality="local",
                               initial="calculated", description="changes its sign where it sticks, or is torn loose")  # fmt: skip
                self.indicators.append(at)

    def _ends(self) -> None:
        """Place and rotation of the links on which no other sits."""
        parents = set(self.of["arm"]["parents"])
        ends = [n for n in range(len(self.scene.arm.links)) if n not in parents]
        for n in ends:
            name = "tip" if len(ends) == 1 else f"tip.{_identifier(self.scene.arm.names[n])}"
            for j, axis in enumerate("xyz"):
                self._add(f"{name}.{axis}", "place", n, j, causality="output", initial="calculated", unit="m",
                          description="place of the end in the world")  # fmt: skip
            for j in range(9):
                self._add(f"{name}.R[{j // 3 + 1},{j % 3 + 1}]", "rotation", n, j, causality="output",
                          initial="calculated", description="its axes in the world, in columns")  # fmt: skip

    def _sensors(self) -> None:
        """Readings of instruments that are functions of the state."""
        arm, nq, nv = self.scene.arm, len(self.of["q0"]), len(self.of["v0"])
        for k, sensor in enumerate(self.scene.sensors):
            base = f"sensor_{k}_{sensor.type}"
            parts = sensor.components(arm)
            gain, offset = sensor._each("gain", len(parts), 1.0), sensor._each("offset", len(parts), 0.0)
            if isinstance(sensor, Camera) and sensor.axes == "world":
                rows = np.zeros((3, arm.nq)), np.zeros((3, arm.nv))
            elif type(sensor).measure is not Sensor.measure or (found := sensor._rows(arm)) is None:
                self.left_out.append(f"sensors[{k}], {sensor.title(arm)}")
                continue
            else:
                rows = found
            for j, (label, unit) in enumerate(parts):
                by_q, by_v = np.zeros(nq), np.zeros(nv)
                by_q[: arm.nq], by_v[: arm.nv] = gain[j] * rows[0][j], gain[j] * rows[1][j]
                more = {"by_q": by_q.tolist(), "by_v": by_v.tolist(), "offset": float(offset[j])}
                if isinstance(sensor, Camera):
                    more |= {"x": sensor.x, "along": (gain[j] * np.eye(3)[j]).tolist()}
                link = arm._link(sensor.link) if isinstance(sensor, Camera) else 0
                name = base if len(parts) == 1 else f"{base}.{_identifier(label)}"
                self._add(name, "reading", link, 0, more, causality="output", initial="calculated",
                          unit=unit if unit in _UNITS else None, description=sensor.title(arm))  # fmt: skip

    def _inputs(self) -> None:
        """What is added to the scene's own forces, loads and references."""
        for i, u in self.unit.items():
            if i not in self.prescribed:
                self._input(f"add.force.{self.rate_names[i]}", "add_tau", i, unit=_FORCE[u],
                            description="force of the joint, added to what the scene has")  # fmt: skip
        for k, drive in enumerate(self.of["drives"]):
            if drive["column"]:
                self._input(f"add.voltage_{k}", "add_drive", k, unit="V", description="voltage of a patch, added")
        for k in range(len(self.of["loads"])):
            for j, part in enumerate(_WRENCH):
                self._input(f"add.load_{k}.{part}", "add_load", k, j, unit="N" if j < 3 else "N.m",
                            description="of a load, added, in its axes")  # fmt: skip
        for k, law in enumerate(self.of["feedback"]):
            at = np.flatnonzero(law["by_q"])
            unit = {self.coordinate[i]: u for i, u in self.unit.items()}
            single = int(at[0]) if len(at) == 1 and int(at[0]) in unit else -1
            of = "of the joint" if single >= 0 else "of u, gain included"
            self._input(f"add.law_{k}.reference", "add_reference", k, single, unit=unit.get(single),
                        description=f"reference {of} of a continuous controller, added")  # fmt: skip
        for k, law in enumerate(self.of["samplers"]):
            count = len(law["linear"]["reference"] if law["linear"] else law["computed_torque"]["axes"])
            for j in range(count):
                self._input(f"add.sampled_{k}.reference_{j}", "add_sampled", k, j,
                            description="reference of a sampled controller, added")  # fmt: skip

    def _parameters(self) -> None:
        arm, links = self.scene.arm, self.of["arm"]["links"]
        for j, axis in enumerate("xyz"):
            unit = {"unit": "m/s2", "description": "gravity"}
            self._parameter(f"gravity.{axis}", "gravity", self.of["arm"]["gravity"][j], j, **unit)
        parents = set(self.of["arm"]["parents"])
        for n in range(len(arm.links)):
            if n not in parents:
                self._parameter(f"payload.{_identifier(arm.names[n])}", "payload", 0.0, n, unit="kg", min=0.0,
                                description="point mass at the end, added")  # fmt: skip
            if links[n]["beam"] and links[n]["beam"]["stiffness"]:
                for what in ("stiffness", "damping"):
                    self._parameter(f"beam_{what}.{_identifier(arm.names[n])}", f"beam_{what}", 1.0, n,
                                    description=f"factor of the beam's {what}")  # fmt: skip
        balls = {i for _, rates in arm.ball_rates() for i in range(rates.start, rates.stop)}
        for i, n, k in self.joints:
            if i in balls:
                continue
            forces = links[n]["joint"]["forces"][k] if links[n]["joint"]["forces"] else {}
            for what in ("stiffness", "damping"):
                self._parameter(f"joint_{what}.{self.rate_names[i]}", what, forces.get(what, 0.0), i, min=0.0,
                                description=f"{what} of the joint")  # fmt: skip
            if forces.get("coulomb"):
                self._parameter(f"joint_friction.{self.rate_names[i]}", "coulomb", forces["coulomb"], i,
                                unit=_FORCE[self.unit[i]], description="dry friction, sliding; stiction in proportion")  # fmt: skip
        led = any(getattr(law, "reference_rate", None) is not None for law in self.scene.control)
        for k, law in enumerate(self.of["feedback"]):
            by_q, by_v = np.flatnonzero(law["by_q"]), np.flatnonzero(law["by_v"])
            if not led and _constant(law["reference"]) and len(by_q) == 1 and len(by_v) <= 1:
                self._parameter(f"law_{k}.kp", "law_kp", law["by_q"][by_q[0]], k, description="gain, of the reference too")
                for i in by_v:
                    self._parameter(f"law_{k}.kv", "law_kv", law["by_v"][i], k, description="gain of the rate")
            else:
                self._parameter(f"law_{k}.gain", "law_gain", 1.0, k, description="factor of all gains")
        for k, law in enumerate(self.of["samplers"]):
            if law["linear"]:
                self._parameter(f"sampled_{k}.gain", "sampled_gain", 1.0, k, description="factor of all gains")
                continue
            for j, axis in enumerate(law["computed_torque"]["axes"]):
                for what in ("kp", "kv"):
                    self._parameter(f"sampled_{k}.axis_{j}.{what}", f"sampled_{what}", axis[what], k, j)
        if self.of["tolerance"] == 0.0:
            self._parameter("step", "step", self.of["step"], unit="s", description="longest step of co-simulation")


def _description(name: str, model: str, token: str, of: dict[str, Any], variables: _Variables) -> str:
    """modelDescription.xml."""
    exact = not any(law["computed_torque"] and law["computed_torque"]["sags"] for law in of["samplers"])
    state = {"canGetAndSetFMUState": "true", "canSerializeFMUState": "true" if exact else "false"}
    exchange = {} if of["arm"]["loops"] or any(c["coulomb"] for c in of["arm"]["contacts"]) else {
        "modelIdentifier": model, **state, "providesDirectionalDerivatives": "true",
        "needsCompletedIntegratorStep": "false"}  # fmt: skip
    step = {"canHandleVariableCommunicationStepSize": "true", **state}
    units = "".join(_tag("Unit", {"name": u}, _tag("BaseUnit", base)) for u, base in _UNITS.items())
    t = of["t"]
    structure = [_tag("Output", {"valueReference": x["valueReference"]})
                 for x in variables.xml if x.get("causality") == "output"]  # fmt: skip
    structure += [_tag("ContinuousStateDerivative", {"valueReference": k}) for k in variables.states]
    calculated = {x["valueReference"] for x in variables.xml if x.get("initial") == "calculated"}
    first = [x["valueReference"] for x in variables.xml if x.get("causality") == "output"] + variables.states
    structure += [_tag("InitialUnknown", {"valueReference": k}) for k in dict.fromkeys(first) if k in calculated]
    structure += [_tag("EventIndicator", {"valueReference": k}) for k in variables.indicators]
    about = {
        "fmiVersion": "3.0", "modelName": name, "instantiationToken": token, "generationTool": f"flexarm {_core.__version__}",
        "variableNamingConvention": "structured",
    }  # fmt: skip
    parts = [
        _tag("ModelExchange", exchange) if exchange else "",
        _tag("CoSimulation", {"modelIdentifier": model, **step}),
        _tag("UnitDefinitions", {}, units),
        _tag("LogCategories", {}, _tag("Category", {"name": "logStatusError", "description": "why a call failed"})),
        _tag("DefaultExperiment", {"startTime": t[0], "stopTime": t[-1], "stepSize": (t[-1] - t[0]) / (len(t) - 1)}),
        _tag("ModelVariables", {}, "\n" + "\n".join(_tag("Float64", x) for x in variables.xml) + "\n"),
        _tag("ModelStructure", {}, "\n" + "\n".join(structure) + "\n"),
    ]
    inside = "\n" + "\n".join(filter(None, parts)) + "\n"
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + _tag("fmiModelDescription", about, inside) + "\n"


def _page(name: str, variables: _Variables) -> str:
    """documentation/index.html: the variables."""
    rows = "".join(
        "<tr>" + "".join(f"<td>{html.escape(str(x.get(k) or ''))}</td>" for k in _COLUMNS) + "</tr>\n"
        for x in variables.xml
    )
    head = "".join(f"<th>{k}</th>" for k in _COLUMNS)
    title = html.escape(name)
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title></head><body>\n'
        f"<h1>{title}</h1>\n<p>A flexible robot arm, made by flexarm {_core.__version__}. SI units and radians. Inputs "
        "are added to the forces, loads and references that the scene has; parameters and the start of q and v are set "
        f"before or in initialisation.</p>\n<table>\n<tr>{head}</tr>\n{rows}</table>\n</body></html>\n"
    )


_COLUMNS = ("name", "causality", "unit", "start", "description")


def library() -> Path:
    """The library of units.

    Raises:
        RuntimeError: this installation has none.
    """
    found = Path(_core.__file__).resolve().parent / "lib" / _LIBRARY
    if not found.exists():
        raise RuntimeError(f"{_LIBRARY}: is not in this installation ({found.parent}), so that no unit can be made")
    return found


def unit_of(scene: Any) -> bytes:
    """The archive of a scene.

    Raises:
        ValueError: as `compiled_text`; an integrator that takes no steps one by one.
        RuntimeError: the library is missing.
    """
    text = compiled_text(scene)
    compiled = json.loads(text)
    if compiled["integrator"] == "ida":
        raise ValueError(
            'integrator = "ida": takes no steps one by one, as a unit must; give integrator=fa.Implicit(step), such as '
            "fa.Implicit(1e-3), or fa.Gauss()"
        )
    variables = _Variables(scene, compiled)
    for what in variables.left_out:
        text_ = f"{what}: is left out of the unit, which has encoders, tachometers, strain gauges and cameras of the world"
        warnings.warn(ModelWarning(text_), stacklevel=outside())
    program = library().read_bytes()
    model = _identifier(scene.name)
    digest = hashlib.sha256(repr((model, variables.xml, variables.json)).encode() + text.encode() + program)
    token = f"{{{digest.hexdigest()[:32]}}}"
    files = {
        "modelDescription.xml": _description(scene.name, model, token, compiled, variables),
        f"binaries/{platform.machine().lower()}-linux/{model}.so": program,
        "resources/scene.json": text,
        "resources/variables.json": json.dumps({"token": token, "variables": variables.json}),
        "documentation/index.html": _page(scene.name, variables),
    }
    out = BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name, _DATE), content, zipfile.ZIP_DEFLATED)
    return out.getvalue()
