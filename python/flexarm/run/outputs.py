"""A result as columns with names and units, in files and beside measured data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._check import Array, array, choice
from ..analysis.findings import RunWarning
from ..arm.arm import Arm
from ..data.compare import Comparison, compared
from ..data.data import Data
from ..data.signal import at_times
from ..data.units import unit
from ..model.acting.drive import Torque
from ..model.acting.load import Load, Push
from ..model.parts.labels import deflections, ends, joint_coordinates, joint_rates
from ..model.parts.loop import Loop

Titles = dict[str, list[tuple[str, str]]]
_OF_STRUT = (("length", "m"), ("rate", "m/s"), ("force", "N"))
_OF_CONTACT = (("gap", "m"), ("rate", "m/s"), ("normal", "N"))


@dataclass
class StrutMotion:
    """A strut or tendon over time, (nt,) each.

    Attributes:
        length: m. rate: m/s.
        force: with which it pushes its points apart (N): spring, damper, constant and driven part.
    """

    length: Array
    rate: Array
    force: Array

    @property
    def tension(self) -> Array:
        """With which it pulls its points together (N): -force."""
        return -self.force


@dataclass
class ContactMotion:
    """A contact over time, (nt,) each.

    Attributes:
        gap: m; below zero where it touches. rate: of the gap (m/s).
        normal: force along the surface's normal (N).
        force: the whole force on its link, with friction, in world axes (N), (nt, 3); nan where that is not known.
    """

    gap: Array
    rate: Array
    normal: Array
    force: Array

    @property
    def touching(self) -> NDArray[np.bool_]:
        """Whether it touches."""
        return self.gap < 0.0

    @property
    def friction(self) -> Array:
        """The size of the force of friction (N)."""
        return np.asarray(np.sqrt(np.maximum(np.sum(self.force**2, axis=1) - self.normal**2, 0.0)))


@dataclass
class LoopMotion:
    """A loop over time.

    Attributes:
        force: with which the loop acts on its place b (N), world axes, (nt, 3); the opposite acts on a.
        moment: likewise (N m), about the origin of the joint's frame on b.
        gap: the largest way that a direction which the joint holds has opened (m), (nt,): zero but for rounding of a
            rigid loop.
        place: coordinates of the joint, (nt, n), as of a link's joint: angle (rad), displacement (m), or both; a
            ball's quaternion; none of a fixed joint. Angles go on beyond half a turn.
    """

    force: Array
    moment: Array
    gap: Array
    place: Array


def row_shapes(arm: Arm) -> dict[str, tuple[int, ...]]:
    """The shape of a row of each array of a Result but its times."""
    rates = dict.fromkeys(("v", "a", "tau", "friction"), (arm.nv,))
    return {"q": (arm.nq,), **rates, "driven": (len(arm.struts),), "contacts": (len(arm.contacts), 3),
            "loops": (len(arm.loops), 6)}  # fmt: skip


@dataclass(repr=False)
class Rows:
    """The data of a Result, where its attributes are explained."""

    arm: Arm
    t: Array
    q: Array
    v: Array
    a: Array
    tau: Array
    stats: dict[str, Any] = field(default_factory=dict)
    loads: tuple[Load, ...] | None = ()
    t_events: list[Array] | None = None
    q_events: list[Array] | None = None
    v_events: list[Array] | None = None
    status: int = 0
    friction: Array | None = None
    driven: Array | None = None
    contacts: Array | None = None
    loops: Array | None = None
    _source: Any = field(default=None, compare=False)
    _wrong: list[RunWarning] = field(default_factory=list, compare=False)
    _error: Any = field(default=None, init=False, compare=False)  # the request, and the estimate or its refusal

    @property
    def matrices(self) -> dict[str, Array]:
        """The arrays that it has but its times, by name, (nt, n) each."""
        held = {k: (getattr(self, k), prod(shape)) for k, shape in row_shapes(self.arm).items()}
        return {k: x.reshape(len(self.t), n) for k, (x, n) in held.items() if x is not None}

    @property
    def acting(self) -> tuple[Arm, tuple[Load, ...]]:
        """An arm and loads, linear between the rows, by which inverse dynamics has all that acted: the driven forces of
        struts are loads, and so are the forces of contacts, in place of these, where they have friction, and those of
        loops, in place of these."""
        out, arm = [*(self.loads or ())], self.arm
        if not len(self.t):
            return arm, tuple(out)
        t = self.t if len(self.t) > 1 else self.t[0] + np.array([0.0, 1.0])
        if self.driven is not None:
            if not np.isfinite(self.driven).all():
                raise ValueError("driven: this result does not keep the drives of its struts")
            laws = (Torque(t, np.broadcast_to(x, t.shape)) for x in self.driven.T)
            out += [Push(arm, *x) for x in zip(arm.strut_names, laws, strict=True)]
        if arm.rubbing:
            if self.contacts is None:
                raise ValueError(f"contacts: this result does not keep the friction of {', '.join(arm.rubbing)}")
            at = arm.contact_places(self.q)[0]
            for k, (point, surface) in enumerate(arm._touching):
                out.append(_pull(arm, t, self.q, point, self.contacts[:, k], at[:, k]))
                if surface[0] >= 0:
                    out.append(_pull(arm, t, self.q, surface, -self.contacts[:, k], at[:, k]))
            arm = arm._alike(arm.links, arm.gravity, contacts=())
        if arm.loops:
            if self.loops is None:
                raise ValueError(f"loops: this result does not keep the forces of {', '.join(arm.loop_names)}")
            for k, sides in enumerate(self.arm._closing):
                at, pulled = self.arm._loop_frames(self.q, k)[1][0], self.loops[:, k]
                for sign, side in zip((-1.0, 1.0), sides, strict=True):
                    if side[0] >= 0:
                        out.append(_pull(self.arm, t, self.q, side, sign * pulled[:, :3], at, sign * pulled[:, 3:]))
            arm = arm._alike(arm.links, arm.gravity, loops=())
        return arm, tuple(out)

    def frame(self, link: int | str = -1, x: float | None = None) -> tuple[Array, Array]:
        """Position (nt, 3) and orientation (nt, 3, 3) in the world; see Arm.frame."""
        return self.arm.frame(self.q, link, x)

    def tip_deflection(self, link: int | str = -1) -> Array:
        """Displacement (nt, 3) of the beam's tip from rest, in the axes of the link's hub (m)."""
        return self.arm.deflection(self.q, link)

    def strut(self, strut: int | str = -1) -> StrutMotion:
        """Length, rate and force of a strut or tendon, by its name or its number in `arm.struts`: `.length` (m),
        `.rate` (m/s), `.force` (N), with which it pushes, and `.tension`, its negative; (nt,) each. Forces are nan
        where the result does not keep the drives of the struts."""
        k = self.arm._strut(strut)
        known = self.driven is None or np.isfinite(self.driven).all()
        length, rate, force = self.arm.strut_motion(self.q, self.v, self.driven if known else None)
        if self.arm.struts[k].mass is not None:
            force[:, k] += self.tau[:, self.arm.joint_rate(self.arm.strut_names[k])]
        return StrutMotion(length[:, k], rate[:, k], force[:, k] if known else np.full(len(length), np.nan))

    def contact(self, contact: int | str = -1) -> ContactMotion:
        """Gap, rate and forces of a contact, by its name or its number in `arm.contacts`: `.gap` (m), `.rate` (m/s),
        `.normal` (N), `.friction` (N), `.touching`, (nt,) each; `.force` (N), (nt, 3), world axes. The last two are nan
        where there is friction that the result does not have."""
        k = self.arm._contact(contact)
        gap, rate, normal = (x[:, k] for x in self.arm.contact_motion(self.q, self.v))
        if self.contacts is not None:
            force = self.contacts[:, k]
        elif self.arm.contacts[k].coulomb:
            force = np.full((len(gap), 3), np.nan)
        else:
            force = normal[:, None] * self.arm.contact_places(self.q)[1][:, k]
        return ContactMotion(gap, rate, normal, force)

    def loop(self, loop: int | str = -1) -> LoopMotion:
        """Forces of a loop and where its joint is, by its name or its number in `arm.loops`: `.force` (N) and `.moment`
        (N m), (nt, 3), world axes, nan where the result does not keep them; `.gap` (m), (nt,); `.place`, (nt, n)."""
        k, q = self.arm._loop(loop), self.q
        pulled = np.full((len(q), 6), np.nan) if self.loops is None else self.loops[:, k]
        ways = [n == k and not turns for n, turns, _ in self.arm._core.loop_rows]
        gap = np.abs(self.arm.loop_motion(q)[0][:, ways]).max(axis=1)
        place = self.arm.loop_place(q, k)
        if not self.arm.loops[k].joint.ball:
            turns = [c for c, of in enumerate(self.arm.loops[k].joint.units) if of == "rad"]
            place[:, turns] = np.unwrap(place[:, turns], axis=0)
        return LoopMotion(pulled[:, :3], pulled[:, 3:], gap, place)


def _pull(arm: Arm, t: Array, q: Array, on: Any, force: Array, at: Array, moment: Array | None = None) -> Load:
    """A force (N), and a moment (N m), at places `at` in the world (m), on the body of a point of a contact or a loop,
    at the rows."""
    link, where, x, _ = on
    x = x if where == "slice" else 0.0 if where == "origin" and arm.links[link].beam is not None else None
    moment = np.cross(at - arm.frame(q, link, x)[0], force) + (0.0 if moment is None else moment)
    shape = (len(t), 3)
    return Load(link, x, force=np.broadcast_to(force, shape), moment=np.broadcast_to(moment, shape), t=t)


def titles(arm: Arm) -> Titles:
    """Name and unit of each column of q, v, a, tau, friction, contacts and loops."""
    places = {i: of for i, _, of in joint_coordinates(arm)}
    rates = {i: of for i, _, of in joint_rates(arm)}
    forces = {"rad": "N m", "m": "N"}
    out: Titles = {"q": [(f"q {name}", places.get(i, "")) for i, name in enumerate(arm.q_names)]}
    for kind, per in (("v", "/s"), ("a", "/s^2")):
        out[kind] = [(f"{kind} {n}", rates[i] + per if i in rates else "") for i, n in enumerate(arm.coordinates)]
    out["contacts"] = [(f"{name} force {x}", "N") for name in arm.contact_names for x in "xyz"]
    of_loop = [(f"{word} {x}", of) for word, of in (("force", "N"), ("moment", "N m")) for x in "xyz"]
    out["loops"] = [(f"{name} {word}", of) for name in arm.loop_names for word, of in of_loop]
    for kind in ("tau", "friction"):
        out[kind] = [(f"{kind} {n}", forces[rates[i]] if i in rates else "") for i, n in enumerate(arm.coordinates)]
    return out


def derived(result: Rows) -> tuple[Titles, dict[str, Array]]:
    """Titles and values, (nt, k), of quantities that follow from q: the tips' deflections, the places of the ends, and
    the lengths of struts and the gaps of contacts, with their forces, where v is known; those of contacts without
    friction; gaps and places of loops. None without q."""
    if not len(result.t) or not np.isfinite(result.q).all():
        return {}, {}
    bent = deflections(result.arm)
    tips = {k: result.tip_deflection(k) for k in sorted({k for k, _, _ in bent})}
    names: Titles = {"deflection": [(f"{label} deflection", "m") for _, _, label in bent]} if bent else {}
    values = {"deflection": np.column_stack([tips[k][:, c] for k, c, _ in bent])} if bent else {}
    names["end"] = [(f"{label} {axis}", "m") for _, label in ends(result.arm) for axis in "xyz"]
    values["end"] = result.arm.end_places(result.q).reshape(len(result.t), -1)
    if result.arm.struts and np.isfinite(result.v).all():
        moved = [result.strut(k) for k in range(len(result.arm.struts))]
        kept = 3 if all(np.isfinite(s.force).all() for s in moved) else 2  # a file may lack their drives
        names["strut"] = [(f"{name} {word}", of) for name in result.arm.strut_names for word, of in _OF_STRUT[:kept]]
        values["strut"] = np.column_stack([x for s in moved for x in (s.length, s.rate, s.force)[:kept]])
    if result.arm.contacts and np.isfinite(result.v).all():
        touched = [result.contact(k) for k in range(len(result.arm.contacts))]
        names["contact"] = [(f"{n} {word}", of) for n in result.arm.contact_names for word, of in _OF_CONTACT]
        values["contact"] = np.column_stack([x for c in touched for x in (c.gap, c.rate, c.normal)])
    if result.arm.loops:
        closed = [result.loop(k) for k in range(len(result.arm.loops))]
        names["loop"] = [x for name, of in zip(result.arm.loop_names, result.arm.loops, strict=True)
                         for x in ((f"{name} gap", "m"), *_places(name, of))]  # fmt: skip
        values["loop"] = np.column_stack([x for c in closed for x in (c.gap, c.place)])
    return names, values


def _places(name: str, loop: Loop) -> list[tuple[str, str]]:
    """Name and unit of each coordinate of a loop's joint."""
    joint = loop.joint
    labels = [x.removeprefix(joint.type).strip() for x in joint.labels]
    if joint.ball:
        labels = [f"quaternion {c}" for c in "wxyz"]
    words = [x or ("angle" if of == "rad" else "displacement") for x, of in zip(labels, joint.q_units, strict=True)]
    return [(f"{name} {word}", "" if joint.ball else of) for word, of in zip(words, joint.q_units, strict=True)]


def to_data(result: Rows) -> Data:
    """Columns over time: "q ...", "v ...", "a ..." and "tau ..." of each coordinate by its name (`arm.q_names`,
    `arm.coordinates`), "friction ..." where there is any, "link 0 tip y deflection" (m) and the like, and the place
    of the arm's end, "end x", "end y", "end z" (m), of a tree of each end, "end of NAME x" and so on; of struts
    and tendons "NAME length" (m), "NAME rate" (m/s) and "NAME force" (N); of contacts "NAME gap" (m), "NAME
    rate" (m/s), "NAME normal" (N), and "NAME force x" and so on (N); of loops "NAME gap" (m), the coordinates of
    its joint such as "NAME angle" (rad), "NAME force x" (N) and "NAME moment x" (N m) and so on. Units are those of
    joints; elastic coordinates have "", since theirs depend on the beam's basis. Rows that a batch did not keep are
    left out.

    Raises:
        ValueError: no rows.
    """
    if not len(result.t):
        raise ValueError("result: has no rows")
    names, values = derived(result)
    names = {**titles(result.arm), **names}
    own = result.matrices
    own.pop("driven", None)  # it is in the forces of struts
    columns: dict[str, Array] = {}
    for kind, x in {**own, **values}.items():
        if np.isfinite(x).any():
            columns |= {name: y for (name, _), y in zip(names[kind], x.T, strict=True)}
    units = {name: of for group in names.values() for name, of in group if name in columns}
    return Data(result.t, columns, units)


# -- beside measured data ----------------------------------------------------------------------------------------------


def compare(
    result: Rows, data: Data, columns: Mapping[str, Any] | Iterable[str] | str | None = None
) -> Comparison:  # fmt: skip
    """This run beside measured data, at the times of the data that lie within the run's (it is interpolated there
    by cubic splines).

    Args:
        data: measured.
        columns: by name of a column of the data, its counterpart: the name of a column of `to_data`; a
            sensor of one component, such as `fa.sensors.StrainGauge(0)`; a function of a result that gives (nt,);
            or numbers (nt,). A list of names: both have them. None: all names that both have.

    Returns:
        Comparison: `.nrmse["name"]`, `.bias`, `.lag`, `.correlation`, `print`, `.plot()`.

    Raises:
        ValueError: no such column, different units, shapes that do not fit, less than two rows in common.
        (DataWarning: a measured column is constant: it has no NRMSE.)
    """
    if not isinstance(data, Data):
        raise ValueError(f"data = {type(data).__name__}: must be fa.Data, such as fa.Data.load(...) gives")
    own = to_data(result)
    if columns is None:
        columns = [name for name in data if name in own]
        if not columns:
            raise ValueError(
                f"columns: the data ({', '.join(data) or 'none'}) and the result ({', '.join(own)}) have no name in "
                "common; give {'name in the data': 'name in the result', or a sensor}"
            )
    elif isinstance(columns, str):
        columns = [columns]
    pairs = dict(columns) if isinstance(columns, Mapping) else {name: name for name in columns}
    for name in pairs:
        choice("columns", name, data)
    found = {name: _signal(result, own, name, other) for name, other in pairs.items()}
    for name, (_, _, of) in found.items():
        theirs = data.units[name]
        if of and theirs and of != theirs:
            raise ValueError(f"columns['{name}']: the data are in {theirs}, and the result is in {of}")
    first = max(t[0] for t, _, _ in found.values())
    last = min(t[-1] for t, _, _ in found.values())
    slack = 1e-9 * max(1.0, abs(first), abs(last))
    kept = (data.t >= first - slack) & (data.t <= last + slack)
    if kept.sum() < 2:
        raise ValueError(
            f"data: are from {data.t[0]:g} to {data.t[-1]:g} s, the result from {first:g} to {last:g} s: they have "
            f"{kept.sum()} rows in common, and two are needed; data.shift moves times"
        )
    t, units = data.t[kept], {name: data.units[name] or of for name, (_, _, of) in found.items()}
    measured = Data(t, {name: data[name][kept] for name in pairs}, units, data.name)
    at = {name: at_times(own_t, y[:, None], np.clip(t, own_t[0], own_t[-1]), "cubic")[:, 0]
          for name, (own_t, y, _) in found.items()}  # fmt: skip
    return compared(measured, Data(t, at, units))


def _signal(result: Rows, own: Data, name: str, other: Any) -> tuple[Array, Array, str]:
    """Times, values and unit of the signal that a column is compared with."""
    where = f"columns['{name}']"
    if isinstance(other, str):
        choice(where, other, own)
        return own.t, own[other], own.units[other]
    if hasattr(other, "read"):  # a sensor, whose room stands above this one
        reading = other.read(result)
        if reading.y.shape[1] != 1:
            parts = ", ".join(reading.labels)
            raise ValueError(
                f"{where}: this sensor has {reading.y.shape[1]} components ({parts}); a function can choose one, such "
                "as lambda r: sensor.read(r).y[:, 0]"
            )
        of = unit(reading.units[0]).si if np.all(getattr(other, "gain", 1.0) == 1.0) else ""  # a gain may have a unit
        return reading.t, reading.y[:, 0], of
    y = array(where, other(result) if callable(other) else other)
    if y.shape not in (result.t.shape, (*result.t.shape, 1)):
        raise ValueError(f"{where} has shape {y.shape}: must be {len(result.t)} numbers, one for each row")
    return result.t, y.reshape(-1), ""
