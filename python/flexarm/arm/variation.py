"""Scenarios that differ in parameters: each named by its dotted path, as in a scene file ("link.0.tip.mass")."""

from __future__ import annotations

import copy
import difflib
import re
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._check import Array, array, mapping
from .._threads import each
from ..model.acting.control import Controller, limit_of
from ..model.acting.drive import Motion, Torque, Voltage
from ..model.acting.load import Load, pushes
from ..model.parts.chain import Parts
from ..model.parts.part import Part
from .arm import Arm

_CACHED = 256  # parts kept of each place of the tree, so that equal ones are built once

_Tree = dict[str, Any]  # by name: a tree, or the values (B, ...)


@dataclass
class Setup:
    """The arm of a scenario, and the actions on it."""

    arm: Arm
    drive: dict[Any, Any] = field(default_factory=dict)
    loads: tuple[Load, ...] = ()
    control: tuple[Controller, ...] = ()
    sensors: tuple[Part, ...] = ()  #: Sensor, whose room stands above this one

    @classmethod
    def of(cls, scene: Any) -> Setup:
        """That of a Scene, whose room stands above this one."""
        return cls(scene.arm, scene.drive, tuple(scene.loads), tuple(scene.control), tuple(scene.sensors))

    @property
    def forces(self) -> tuple[Load, ...]:
        """The loads, and the driven forces of struts as loads."""
        return (*self.loads, *pushes(self.arm, self.drive))

    @cached_property
    def known(self) -> list[str]:
        """Paths of everything that can vary."""
        out = ["gravity", "q0", "v0"]
        for name, own in self.arm._parts._asdict().items():
            out += () if name == "gravity" else _leaves(own, name)
        for key, law in self.drive.items():
            out += _leaves(law, f"drive.{drive_name(key)}")
        for parts, name in ((self.loads, "load"), (self.control, "control"), (self.sensors, "sensor")):
            out += _leaves(parts, name)
        return out


def _numeric(value: Any) -> bool:
    """Whether a field can vary: a number, numbers, or a number left out."""
    if isinstance(value, (bool, str, Mapping, int)):
        return False
    if isinstance(value, (float, np.floating)):
        return True
    if isinstance(value, np.ndarray):
        return bool(value.dtype.kind == "f")
    return isinstance(value, tuple) and bool(value) and all(_numeric(x) for x in value)


#: fields that are None where nothing is given, but can be given numbers
_OPTIONAL = (
    "poisson_ratio", "shear_modulus", "shear_correction", "lower", "upper", "stiction", "resistance", "limit",
    "torque_limit", "x", "length", "tangential_stiffness", "current_loop",
)  # fmt: skip


def fields_of(part: Any) -> dict[str, Any]:
    """The fields of a part, by name."""
    if isinstance(part, (tuple, list, np.ndarray)):
        return {str(k): p for k, p in enumerate(part)}
    if isinstance(part, Part):
        return part._arguments()
    if isinstance(part, Load):
        return {**part.given, "scale": 1.0}
    if isinstance(part, (Motion, Torque, Voltage)):
        value = {"value": part(0.0)} if part.constant else {}
        return {**value, "scale": 1.0, "offset": 0.0, "delay": 0.0}
    if isinstance(part, Controller):
        return part._arguments() if part.rebuilt else {k: v for k, v in vars(part).items() if not k.startswith("_")}
    return {}


def _nested(value: Any) -> bool:
    if isinstance(value, (tuple, list)):
        return bool(value) and all(_nested(x) for x in value)
    return isinstance(value, (Part, Load, Motion, Torque, Voltage, Controller))


def _leaves(part: Any, prefix: str) -> Iterator[str]:
    for name, value in fields_of(part).items():
        if _nested(value):
            yield from _leaves(value, f"{prefix}.{name}")
        elif _numeric(value) or (value is None and name in _OPTIONAL):
            yield f"{prefix}.{name}"
        elif name in ("force", "moment") and isinstance(part, Load) and value is None:
            yield f"{prefix}.{name}"


def drive_name(key: Any) -> str:
    return ".".join(str(k) for k in key) if isinstance(key, tuple) else str(key)


def numbered(setup: Setup, path: str) -> str:
    """A path with the number of a link, a strut, a contact or a loop where it has its name: "link.elbow.tip.mass", and
    that of a drive likewise."""
    arm, (root, *words) = setup.arm, str(path).split(".")
    known: Mapping[str, Any] = {"strut": arm.strut_names, "contact": arm.contact_names, "loop": arm.loop_names}
    if not words or words[0] not in known.get(root, arm._numbers):
        return str(path)
    if root in known:
        words[0] = str(known[root].index(words[0]))
    elif root == "link":
        words[0] = str(arm._link(words[0], f"'{path}': link"))
    elif root == "drive":
        for key in setup.drive:
            of_joint = isinstance(key, (int, str)) and key not in arm.strut_names
            if of_joint and arm._link(key) == arm._link(words[0], f"'{path}': link"):
                words[0] = str(key)
    return ".".join([root, *words])


def value_at(setup: Setup, path: str, more: Mapping[str, Any] | None = None) -> tuple[Any, Any]:
    """The value at a path, None if there is none, and the part that holds it; `more`: other roots, such as q0."""
    root, *names = numbered(setup, path).split(".")
    here: Any = None
    like: Any = None
    acting = {"load": setup.loads, "control": setup.control, "sensor": setup.sensors}
    tree: dict[str, Any] = {**setup.arm._parts._asdict(), **acting, **(more or {})}
    if root == "drive":
        for key, law in setup.drive.items():
            own = drive_name(key).split(".")
            if names[: len(own)] == own:
                here, names = law, names[len(own) :]
    else:
        here = tree.get(root)
    for name in names:
        like, here = here, fields_of(here).get(name)
    return here, like


def can_vary(at: str, known: Sequence[str]) -> bool:
    """Whether a path, or that of the array of which it is an entry, is a known one."""
    return at in known or re.sub(r"(\.\d+){1,2}$", "", at) in known


OF_ARM = Parts._fields
_ROOTS = (*OF_ARM, "drive", "load", "control", "sensor")


class Variation:
    """The scenarios of one setup and its parameters.

    Args:
        setup: common to all.
        parameters: values (B, ...) or (1, ...) by path.
        once: each scenario is asked for once, and all are different: no part is kept for others, and errors are
            those of the scenarios.
    """

    def __init__(self, setup: Setup, parameters: Mapping[str, ArrayLike] | None, once: bool = False) -> None:
        parameters = mapping("parameters", parameters, ", by paths such as 'link.0.tip.mass'")
        self.setup, self.once = setup, once
        self.values: dict[str, Array] = {}
        known = setup.known if parameters else []
        self._at: dict[str, str] = {}  # the same paths with the numbers of links
        for path, value in parameters.items():
            at = self._at[path] = numbered(setup, path)
            if not can_vary(at, known):
                near = difflib.get_close_matches(str(path), known, n=1, cutoff=0.3)
                hint = f"; did you mean '{near[0]}'?" if near else ""
                raise ValueError(f"parameters: '{path}' is nothing that can vary{hint}")
            name = f"parameters['{path}']"
            self.values[path] = array(name, value, batch_ndim=1)
            if self.values[path].ndim == 0:
                raise ValueError(f"{name} = {value!r}: must have one entry for each scenario")
        for path, at in self._at.items():
            for other, below in self._at.items():
                if below.startswith(at + ".") or (below == at and other != path):
                    raise ValueError(f"parameters: '{other}' is a part of '{path}'; give one of them")
        self._trees = {root: self._tree(root) for root in _ROOTS}
        self._parts: dict[str, OrderedDict[bytes, Future[Any]]] = {}
        self._lock = threading.Lock()
        if not self.one_setup and not once:
            self.scenario(0)  # so that an error of all is raised here

    @property
    def sizes(self) -> dict[str, int]:
        """How many scenarios each parameter is for."""
        return {f"parameters['{path}']": len(v) for path, v in self.values.items()}

    def initial(self, name: str, value: Array) -> Array:
        """q0 or v0 (B or 1, n), with the values of parameters."""
        whole = self.values.get(name)
        if whole is not None:
            if whole.ndim != 2 or whole.shape[1] != value.shape[1]:
                raise ValueError(f"parameters['{name}'] has shape {whole.shape}: must be (B, {value.shape[1]})")
            return whole
        for path, values in self.values.items():
            if path.startswith(name + "."):
                k = int(path.rpartition(".")[2])
                if k >= value.shape[1] or values.ndim != 1:
                    raise ValueError(f"parameters['{path}']: must be (B,), of a coordinate below {value.shape[1]}")
                count = max(len(value), len(values))
                value = np.array(np.broadcast_to(value, (count, value.shape[1])))
                value[:, k] = values
        return value

    def scenario(self, i: int) -> Setup:
        """The setup of scenario i."""
        base = self.setup
        arm = self._memo("arm", {root: self._trees[root] for root in OF_ARM}, i, self._arm)
        drive = base.drive
        if self._trees["drive"]:
            drive = {k: self._rebuilt(f"drive.{drive_name(k)}", law, self._below("drive", drive_name(k)), i)
                     for k, law in drive.items()}  # fmt: skip
        loads = self._rebuilt("load", base.loads, self._trees["load"], i)
        control = self._rebuilt("control", base.control, self._trees["control"], i)
        sensors = self._rebuilt("sensor", base.sensors, self._trees["sensor"], i)
        return Setup(arm, drive, loads, control, sensors)

    @property
    def one_setup(self) -> bool:
        """Whether all scenarios are made of the same, and differ at most in their start."""
        return not any(len(tree) for tree in self._trees.values())

    def scenarios(
        self, indices: Sequence[int] | NDArray[np.int64], workers: int = 1, stop: Callable[[], bool] = lambda: False
    ) -> list[Setup]:
        """The setups of these scenarios: one for each, or one for all. Beams are built by threads. Once
        `stop` says so, KeyboardInterrupt."""
        if self.one_setup:
            return [self.setup]
        found = [self.setup] * len(indices)

        def build(k: int) -> None:
            if stop():
                raise KeyboardInterrupt
            found[k] = self.scenario(int(indices[k]))

        beams = any(".beam." in path for path in self.values)  # all else is short, and Python's
        each(build, len(indices), workers if beams else 1)
        return found

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_parts": {}, "_lock": None}  # a copy begins without the cache

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _lock=threading.Lock())

    def _arm(self, i: int) -> Arm:
        base, were = self.setup.arm, self.setup.arm._parts
        parts = Parts(*(self._rebuilt(k, x, self._trees[k], i) for k, x in were._asdict().items()))
        try:
            same = all(x is y for x, y in zip(parts, were, strict=True))
            return base if same else Arm._varied(base, parts)
        except ValueError as e:
            raise ValueError(f"parameters of scenario {i}: {e}") from None

    def _tree(self, root: str) -> Any:
        tree: _Tree = {}
        for given, values in self.values.items():
            path = self._at[given]
            if path == root:
                return values
            if path.startswith(root + "."):
                *inner, last = path[len(root) + 1 :].split(".")
                node = tree
                for name in inner:
                    node = node.setdefault(name, {})
                node[last] = values
        return tree

    def _below(self, root: str, name: str) -> Any:
        node = self._trees[root]
        for part in name.split("."):
            node = node.get(part, {})
        return node

    def _memo(self, where: str, tree: Any, i: int, build: Callable[[int], Any]) -> Any:
        """build(i), or its earlier result for the same values."""
        if self.once:
            return build(i)
        key = b"".join(_values_at(tree, i))
        with self._lock:
            kept = self._parts.setdefault(where, OrderedDict())
            made = kept.get(key)
            mine = made is None
            if made is None:
                made = kept[key] = Future()
            if len(kept) > _CACHED:
                kept.popitem(last=False)
        if mine:
            try:
                made.set_result(build(i))
            except BaseException as e:
                with self._lock:
                    kept.pop(key, None)
                made.set_exception(e)
        return made.result()  # of another thread, where that builds it

    def _rebuilt(self, where: str, part: Any, tree: Any, i: int) -> Any:
        if isinstance(tree, np.ndarray):
            return _leaf(where, part, tree[i % len(tree)], i)
        if not tree:
            return part
        return self._memo(where, tree, i, lambda k: self._build(where, part, tree, k))

    def _build(self, where: str, part: Any, tree: _Tree, i: int) -> Any:
        old = None if isinstance(part, (Part, tuple)) else fields_of(part)
        new = {}
        for name, below in tree.items():
            was = old[name] if old is not None else part[int(name)] if isinstance(part, tuple) else getattr(part, name)
            new[name] = self._rebuilt(f"{where}.{name}", was, below, i)
        try:
            return _replaced(part, new)
        except ValueError as e:
            raise ValueError(f"parameters of scenario {i}: {where}.{e}") from None


def _values_at(tree: Any, i: int) -> Iterator[bytes]:
    if isinstance(tree, np.ndarray):
        yield tree[i % len(tree)].tobytes()
    else:
        for below in tree.values():
            yield from _values_at(below, i)


def _leaf(where: str, old: Any, value: Any, i: int) -> Any:
    """The value of scenario i, as the field it replaces has it."""
    if isinstance(old, float) and isinstance(value, float):  # NumPy's are, and shapes are slow
        return float(value)
    if old is not None and np.shape(old) != np.shape(value):
        want = f"(B, {', '.join(str(n) for n in np.shape(old))})" if np.ndim(old) else "(B,)"
        raise ValueError(f"parameters['{where}'] has entries of shape {np.shape(value)}: must be {want}")
    return float(value) if np.ndim(value) == 0 else np.array(value)


def _replaced(part: Any, new: dict[str, Any]) -> Any:
    """The part with some of its fields replaced."""
    if isinstance(part, (tuple, np.ndarray, list)):
        out = list(part)
        for name, value in new.items():
            out[int(name)] = value
        return np.array(out) if isinstance(part, np.ndarray) else tuple(out)
    if isinstance(part, Part):
        return part._replaced(new)
    if isinstance(part, Load):
        scale = new.pop("scale", None)
        load = Load(**{**part.given, **new}) if new else part
        return load if scale is None else load.scaled(scale)
    if isinstance(part, (Motion, Torque, Voltage)):
        law = type(part)(new["value"]) if "value" in new else part
        law = law.scaled(new["scale"]) if "scale" in new else law
        return law.moved(new.get("offset", 0.0), new.get("delay", 0.0)) if {"offset", "delay"} & new.keys() else law
    if part.rebuilt:
        return type(part)(**{**part._arguments(), **new})
    made = copy.copy(part)
    for name, value in new.items():
        setattr(made, name, limit_of(value, None, np.size(value)) if name == "limit" else value)
    return made
