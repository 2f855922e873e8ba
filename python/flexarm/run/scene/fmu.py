"""Units of FMI 3.0 and 2.0: a scene as an archive that other simulators import, without Python at their side. (Modelica
Association, Functional Mock-up Interface 3.0.1, 2023; 2.0.4, 2022.)"""

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

import flexarm._core as _core

from ..._check import outside
from ...model.parts.part import ModelWarning
from .fmu_variables import UNITS, Variables, identifier
from .writer import compiled_text

_LIBRARY = "libflexarm_fmi.so"
_DATE = (1980, 1, 1, 0, 0, 0)  # of the files within: the same scene gives the same bytes


#: What XML cannot hold.
_UNTOLD = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def _tag(name: str, given: dict[str, Any], inside: str = "") -> str:
    text = "".join(f" {k}={quoteattr(_UNTOLD.sub(' ', str(v)))}" for k, v in given.items() if v is not None)
    return f"<{name}{text}>{inside}</{name}>" if inside else f"<{name}{text}/>"


#: What the two versions call the same.
_WORDS: dict[int, dict[str, Any]] = {
    3: {
        "token": "instantiationToken",
        "get and set": "canGetAndSetFMUState",
        "bytes": "canSerializeFMUState",
        "derivatives": {"providesDirectionalDerivatives": "true", "needsCompletedIntegratorStep": "false"},
        "events": {"hasEventMode": "true"},
        "folder": {},
    },
    2: {
        "token": "guid",
        "get and set": "canGetAndSetFMUstate",
        "bytes": "canSerializeFMUstate",
        "derivatives": {"providesDirectionalDerivative": "true", "completedIntegratorStepNotNeeded": "true"},
        "events": {},
        "folder": {"x86_64": "linux64"},
    },
}


def _variable(version: int, x: dict[str, Any]) -> str:
    if version == 3:
        return _tag("Float64", x)
    outside = ("name", "valueReference", "description", "causality", "variability", "initial")
    inside = {k: v for k, v in x.items() if k not in outside}
    if inside.get("derivative") is not None:
        inside["derivative"] += 1  # its place in the list
    return _tag("ScalarVariable", {k: x[k] for k in outside if k in x}, _tag("Real", inside))


def _structure(version: int, variables: Variables) -> str:
    outputs = [x["valueReference"] for x in variables.xml if x.get("causality") == "output"]
    calculated = {x["valueReference"] for x in variables.xml if x.get("initial") == "calculated"}
    first = [k for k in dict.fromkeys(outputs + variables.states) if k in calculated]
    if version == 2:
        lists = {"Outputs": outputs, "Derivatives": variables.states, "InitialUnknowns": sorted(first)}
        return "\n".join(
            _tag(name, {}, "".join(_tag("Unknown", {"index": k + 1}) for k in found)) for name, found in lists.items()
        )
    parts = {"Output": outputs, "ContinuousStateDerivative": variables.states, "InitialUnknown": first}
    parts["EventIndicator"] = variables.indicators
    return "\n".join(_tag(name, {"valueReference": k}) for name, found in parts.items() for k in found)


def _description(
    version: int, name: str, model: str, token: str, of: dict[str, Any], variables: Variables
) -> str:  # fmt: skip
    """modelDescription.xml."""
    words = _WORDS[version]
    exact = not any(law["computed_torque"] and law["computed_torque"]["sags"] for law in of["samplers"])
    state = {words["get and set"]: "true", words["bytes"]: "true" if exact else "false"}
    exchange = (
        {}
        if of["arm"]["loops"] or any(c["coulomb"] for c in of["arm"]["contacts"])
        else {"modelIdentifier": model, **state, **words["derivatives"]}
    )
    step = {"canHandleVariableCommunicationStepSize": "true", **state, **words["events"]}
    units = "".join(_tag("Unit", {"name": u}, _tag("BaseUnit", base)) for u, base in UNITS.items())
    t = of["t"]
    about = {
        "fmiVersion": f"{version}.0",
        "modelName": name,
        words["token"]: token,
        "generationTool": f"flexarm {_core.__version__}",
        "variableNamingConvention": "structured",
        "numberOfEventIndicators": len(variables.indicators) if version == 2 and exchange else None,
    }
    listed = "\n".join(_variable(version, x) for x in variables.xml)
    parts = [
        _tag("ModelExchange", exchange) if exchange else "",
        _tag("CoSimulation", {"modelIdentifier": model, **step}),
        _tag("UnitDefinitions", {}, units),
        _tag("LogCategories", {}, _tag("Category", {"name": "logStatusError", "description": "why a call failed"})),
        _tag("DefaultExperiment", {"startTime": t[0], "stopTime": t[-1], "stepSize": (t[-1] - t[0]) / (len(t) - 1)}),
        _tag("ModelVariables", {}, f"\n{listed}\n"),
        _tag("ModelStructure", {}, f"\n{_structure(version, variables)}\n"),
    ]
    inside = "\n" + "\n".join(filter(None, parts)) + "\n"
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + _tag("fmiModelDescription", about, inside) + "\n"


def _page(name: str, variables: Variables) -> str:
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


def unit_of(scene: Any, version: int = 3) -> bytes:
    """The archive of a scene, of FMI 3.0 or 2.0.

    Raises:
        ValueError: another version; as `compiled_text`; an integrator that takes no steps one by one.
        RuntimeError: the library is missing.
    """
    if isinstance(version, bool) or version not in (2, 3):
        raise ValueError(f"version = {version!r}: must be 3 or 2, of FMI")
    text = compiled_text(scene)
    compiled = json.loads(text)
    if compiled["integrator"] == "ida":
        raise ValueError(
            'integrator = "ida": takes no steps one by one, as a unit must; give integrator=fa.Implicit(step), such as '
            "fa.Implicit(1e-3), or fa.Gauss()"
        )
    variables = Variables(scene, compiled)
    for what in variables.left_out:
        why = (
            f"{what}: is left out of the unit, which has encoders, tachometers, strain gauges and cameras of the world"
        )
        warnings.warn(ModelWarning(why), stacklevel=outside())
    program = library().read_bytes()
    model = identifier(scene.name)
    digest = hashlib.sha256(repr((model, variables.xml, variables.json)).encode() + text.encode() + program)
    token = f"{{{digest.hexdigest()[:32]}}}"
    machine = platform.machine().lower()
    folder = _WORDS[version]["folder"].get(machine, f"{machine}-linux")
    files: dict[str, str | bytes] = {
        "modelDescription.xml": _description(version, scene.name, model, token, compiled, variables),
        f"binaries/{folder}/{model}.so": program,
        "resources/scene.json": text,
        "resources/variables.json": json.dumps({"token": token, "variables": variables.json}),
        "documentation/index.html": _page(scene.name, variables),
    }
    out = BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name, _DATE), content, zipfile.ZIP_DEFLATED)
    return out.getvalue()
