"""The variables of a unit of FMI, listed once: as XML for the importer, and as JSON for the unit's library, whose
kinds of variables are those of its room `fmi`."""

from __future__ import annotations

import re
from collections.abc import Iterable
from itertools import chain, count
from typing import Any

import numpy as np

from ..sensing.sensor import Sensor
from ..sensing.sensors import Camera

#: exponents of kg, m, s, A, rad
UNITS = {
    "rad": {"rad": 1},
    "m": {"m": 1},
    "s": {"s": 1},
    "kg": {"kg": 1},
    "rad/s": {"rad": 1, "s": -1},
    "m/s": {"m": 1, "s": -1},
    "rad/s2": {"rad": 1, "s": -2},
    "m/s2": {"m": 1, "s": -2},
    "N": {"kg": 1, "m": 1, "s": -2},
    "N.m": {"kg": 1, "m": 2, "s": -2},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
}
_FORCE = {"rad": "N.m", "m": "N"}
_WRENCH = ("force_x", "force_y", "force_z", "moment_x", "moment_y", "moment_z")


def identifier(name: str) -> str:
    """A name of letters, digits and underscores, as variables of FMI have it."""
    out = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_") or "_"
    return f"_{out}" if out[0].isdigit() else out


def _identifiers(names: Iterable[str]) -> list[str]:
    """Of names, no two alike."""
    out: list[str] = []
    for name in map(identifier, names):
        later = (f"{name}_{k}" for k in count(2))
        out.append(next(x for x in chain([name], later) if x not in out))
    return out


def _constant(law: Any) -> bool:
    """Whether a compiled law of time is none, or the same at all times."""
    if law is None:
        return True
    rows = np.array(law["coefficients"])
    return not rows[:-1].any() and bool((rows[-1] == rows[-1, 0]).all())


class Variables:
    """The variables of a compiled scene, in the order of their value references."""

    def __init__(self, scene: Any, compiled: dict[str, Any]) -> None:
        self.scene, self.of = scene, compiled
        self.xml: list[dict[str, Any]] = []
        self.json: list[dict[str, Any]] = []
        self.states: list[int] = []  # references of the derivatives, in the order of the states
        self.left_out: list[str] = []
        self._add("time", "time", causality="independent", unit="s", description="time")
        self._rates()
        self._motion()
        self._ends()
        self._sensors()
        self._inputs()
        self._parameters()

    def _add(self, name: str, kind: str, i: int = 0, j: int = 0, more: dict[str, Any] | None = None, **xml: Any) -> int:
        """A variable. Returns its value reference."""
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

    def _calculated(
        self, name: str, kind: str, i: int, j: int = 0, more: dict[str, Any] | None = None, output: bool = False,
        **xml: Any,
    ) -> int:  # fmt: skip
        return self._add(
            name, kind, i, j, more, causality="output" if output else "local", initial="calculated", **xml
        )  # fmt: skip

    def _rates(self) -> None:
        """Names, units and coordinates of all rates, those of controllers' states too."""
        arm, links = self.scene.arm, self.of["arm"]["links"]
        more = len(self.of["v0"]) - arm.nv
        control = [f"control_state_{k}" for k in range(more)]
        self.rate_names = _identifiers([*arm.coordinates, *control])
        self.q_names = _identifiers([*arm.q_names, *control])
        self.link_names = _identifiers(arm.names)
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
        forces = {i: (links[n]["joint"]["forces"] or {k: None})[k] for i, n, k in self.joints}
        self.rubs = [i for i, f in forces.items() if f and (f["coulomb"] or f["stiction"])]

    def _motion(self) -> None:
        """The states, their derivatives, and forces."""
        moved = {self.coordinate[i] for i in self.prescribed}
        unit = {self.coordinate[i]: u for i, u in self.unit.items()}
        per = {i: f"{u}/s" for i, u in self.unit.items()}
        at_q = []
        for c, name in enumerate(self.q_names):
            start = {"initial": "calculated"} if c in moved else {"initial": "exact", "start": self.of["q0"][c]}
            at_q.append(
                self._add(
                    f"q.{name}",
                    "q",
                    c,
                    causality="output" if c in unit or c in moved else "local",
                    unit=unit.get(c),
                    description="coordinate",
                    **start,
                )
            )
        at_v, derivative = [], dict[int, int]()
        for i, name in enumerate(self.rate_names):
            start = (
                {"initial": "calculated"} if i in self.prescribed else {"initial": "exact", "start": self.of["v0"][i]}
            )
            c = self.coordinate[i]
            free = c >= 0 and i not in self.prescribed
            at_v.append(
                self._add(
                    f"v.{name}",
                    "v",
                    i,
                    causality="output" if i in self.unit else "local",
                    unit=per.get(i),
                    description="rate",
                    derivative=at_q[c] if free else None,
                    reinit="true" if i in self.rubs and i not in self.prescribed else None,
                    **start,
                )
            )
            if free:
                derivative[c] = at_v[-1]
        for c in range(len(self.q_names)):
            if c not in derivative and c not in moved:
                derivative[c] = self._calculated(f"der(q.{self.q_names[c]})", "dq", c, derivative=at_q[c])
        self.states = [derivative[c] for c in sorted(derivative)]
        for i, name in enumerate(self.rate_names):
            free = i not in self.prescribed
            unit_of = f"{per[i]}2" if i in per else None
            at = self._calculated(
                f"der(v.{name})" if free else f"a.{name}", "a", i, unit=unit_of, derivative=at_v[i] if free else None
            )
            if free:
                self.states.append(at)
        for i, u in self.unit.items():
            what = "force of drives and controllers; of a prescribed motion its reaction"
            self._calculated(f"force.{self.rate_names[i]}", "tau", i, unit=_FORCE[u], description=what)
        self.indicators = []
        for i in self.rubs:
            rate, unit_of = self.rate_names[i], _FORCE[self.unit[i]]
            self._calculated(f"friction.{rate}", "friction", i, unit=unit_of, description="dry friction")
            if i not in self.prescribed:
                what = "changes its sign where it sticks, or is torn loose"
                self.indicators.append(self._calculated(f"indicator.{rate}", "indicator", i, description=what))

    def _ends(self) -> None:
        """Place and rotation of the links on which no other sits."""
        count = len(self.scene.arm.links)  # behind them are those of controllers' states
        self.ends = sorted({*range(count)} - {*self.of["arm"]["parents"][:count]})
        for n in self.ends:
            name = "tip" if len(self.ends) == 1 else f"tip.{self.link_names[n]}"
            for j, axis in enumerate("xyz"):
                what = "place of the end in the world"
                self._calculated(f"{name}.{axis}", "place", n, j, output=True, unit="m", description=what)
            for j in range(9):
                at, what = f"{name}.R[{j // 3 + 1},{j % 3 + 1}]", "its axes in the world, in columns"
                self._calculated(at, "rotation", n, j, output=True, description=what)

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
            labels = _identifiers(label for label, _ in parts)
            for j, (label, (_, unit)) in enumerate(zip(labels, parts, strict=True)):
                by_q, by_v = np.zeros(nq), np.zeros(nv)
                by_q[: arm.nq], by_v[: arm.nv] = gain[j] * rows[0][j], gain[j] * rows[1][j]
                more = {"by_q": by_q.tolist(), "by_v": by_v.tolist(), "offset": float(offset[j])}
                if isinstance(sensor, Camera):
                    more |= {"x": sensor.x, "along": (gain[j] * np.eye(3)[j]).tolist()}
                link = arm._link(sensor.link) if isinstance(sensor, Camera) else 0
                name = base if len(parts) == 1 else f"{base}.{label}"
                known = unit if unit in UNITS else None
                self._calculated(name, "reading", link, 0, more, True, unit=known, description=sensor.title(arm))

    def _inputs(self) -> None:
        """What is added to the scene's own forces, loads and references."""
        for i, u in self.unit.items():
            if i not in self.prescribed:
                self._input(
                    f"add.force.{self.rate_names[i]}",
                    "add_tau",
                    i,
                    unit=_FORCE[u],
                    description="force of the joint, added to what the scene has",
                )
        for k, drive in enumerate(self.of["drives"]):
            if drive["column"]:
                self._input(f"add.voltage_{k}", "add_drive", k, unit="V", description="voltage of a patch, added")
        for k in range(len(self.of["loads"])):
            for j, part in enumerate(_WRENCH):
                self._input(
                    f"add.load_{k}.{part}",
                    "add_load",
                    k,
                    j,
                    unit="N" if j < 3 else "N.m",
                    description="of a load, added, in its axes",
                )
        for k, law in enumerate(self.of["feedback"]):
            at = np.flatnonzero(law["by_q"])
            unit = {self.coordinate[i]: u for i, u in self.unit.items()}
            single = int(at[0]) if len(at) == 1 and int(at[0]) in unit else -1
            of = "of the joint" if single >= 0 else "of u, gain included"
            self._input(
                f"add.law_{k}.reference",
                "add_reference",
                k,
                single,
                unit=unit.get(single),
                description=f"reference {of} of a continuous controller, added",
            )
        for k, law in enumerate(self.of["samplers"]):
            count = len(law["linear"]["reference"] if law["linear"] else law["computed_torque"]["axes"])
            for j in range(count):
                self._input(
                    f"add.sampled_{k}.reference_{j}",
                    "add_sampled",
                    k,
                    j,
                    description="reference of a sampled controller, added",
                )

    def _parameters(self) -> None:
        arm, links = self.scene.arm, self.of["arm"]["links"]
        for j, axis in enumerate("xyz"):
            self._parameter(
                f"gravity.{axis}", "gravity", self.of["arm"]["gravity"][j], j, unit="m/s2", description="gravity"
            )
        for n in range(len(arm.links)):
            if n in self.ends:
                self._parameter(
                    f"payload.{self.link_names[n]}",
                    "payload",
                    0.0,
                    n,
                    unit="kg",
                    min=0.0,
                    description="point mass at the end, added",
                )
            if links[n]["beam"] and links[n]["beam"]["stiffness"]:
                for what in ("stiffness", "damping"):
                    self._parameter(
                        f"beam_{what}.{self.link_names[n]}",
                        f"beam_{what}",
                        1.0,
                        n,
                        description=f"factor of the beam's {what}",
                    )
        balls = {i for _, rates in arm.ball_rates() for i in range(rates.start, rates.stop)}
        for i, n, k in self.joints:
            if i in balls:
                continue
            forces = links[n]["joint"]["forces"][k] if links[n]["joint"]["forces"] else {}
            for what in ("stiffness", "damping"):
                self._parameter(
                    f"joint_{what}.{self.rate_names[i]}",
                    what,
                    forces.get(what, 0.0),
                    i,
                    min=0.0,
                    description=f"{what} of the joint",
                )
            if forces.get("coulomb"):
                self._parameter(
                    f"joint_friction.{self.rate_names[i]}",
                    "coulomb",
                    forces["coulomb"],
                    i,
                    unit=_FORCE[self.unit[i]],
                    description="dry friction, sliding; stiction in proportion",
                )
        led = any(getattr(law, "reference_rate", None) is not None for law in self.scene.control)
        for k, law in enumerate(self.of["feedback"]):
            by_q, by_v = np.flatnonzero(law["by_q"]), np.flatnonzero(law["by_v"])
            if not led and _constant(law["reference"]) and len(by_q) == 1 and len(by_v) <= 1:
                self._parameter(
                    f"law_{k}.kp", "law_kp", law["by_q"][by_q[0]], k, description="gain, of the reference too"
                )
                for at in by_v:
                    self._parameter(f"law_{k}.kv", "law_kv", law["by_v"][at], k, description="gain of the rate")
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
