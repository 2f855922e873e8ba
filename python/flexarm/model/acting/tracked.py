"""Outputs of predictive control: references, rows of outputs, and the model's coordinates by those of its arm."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..._check import Array, array, choice, unmasked
from ..parts.chain import Chain
from .control import rows_of_entry
from .drive import Torque

_INF = float("inf")
_WORLD = {"x": 0, "y": 1, "z": 2}


class CallableReference:
    """A callable reference t -> (2, ny); for t -> (ny,) the rates are central differences."""

    def __init__(self, law: Callable[[float], Any], ny: int) -> None:
        self.law, self.ny = law, ny

    def _at(self, t: float) -> Array:
        r = np.asarray(self.law(t), dtype=float)
        if r.shape == () or r.shape == (1,):
            r = np.broadcast_to(r, (self.ny,))
        if r.shape not in ((self.ny,), (2, self.ny)) or not np.isfinite(r).all():
            raise ValueError(f"reference at t = {t}: gave {r!r}; must be {self.ny} finite numbers, or (2, {self.ny})")
        return r

    def __call__(self, t: float) -> Array:
        r = self._at(t)
        if r.ndim == 2:
            return r
        h = 1e-5
        return np.stack([r, (self._at(t + h) - self._at(t - h)) / (2 * h)])


def extended_by(reference: Any, more: int) -> Any:
    """A reference with appended zeros for outputs that only have limits."""
    if isinstance(reference, list):
        return reference + [Torque(0.0).law] * more
    return lambda t: np.pad(reference(t), ((0, 0), (0, more)))


def each(field: str, given: Any, count: int, above: bool = False) -> Array:
    """Checked numbers, one for each: not negative, or for limits (`above`) positive; None: no limit."""
    if above and given is None:
        return np.full(count, _INF)
    x = np.asarray(unmasked(field, given), dtype=float) if above else array(field, given)
    if x.shape not in ((), (count,)):
        raise ValueError(f"{field} has shape {x.shape}: must be one number, or {count} of them")
    if not ((x > 0).all() if above else (x >= 0).all()):
        raise ValueError(f"{field} = {given!r}: must be {'positive' if above else 'zero or positive'}")
    return np.array(np.broadcast_to(x, (count,)), dtype=float)


def rows_of(model: Chain, field: str, entry: Any) -> list[Any]:
    """(by_q, None) or (by_q, (link, x, along)) of each number that an entry of `track` stands for."""
    kind = entry[0] if isinstance(entry, (list, tuple)) and entry else entry
    if kind == "joint" and len(entry) == 2:
        link = tuple(entry[1]) if isinstance(entry[1], list) else entry[1]
        rates = model.joint_rates(link, f"{field}: link")
        if any(model.coordinate_of(i) < 0 for i in rates):
            raise ValueError(f'{field} = {entry!r}: a ball has no coordinates to be led; take ("tip", link)')
        return [(np.eye(model.nv)[i], None) for i in rates]
    if kind == "tip" and len(entry) in (2, 3):
        link = model._link(entry[1], f"{field}: link")
        axes = list(_WORLD) if len(entry) == 2 else [choice(f"{field}: axis", entry[2], _WORLD)]
        return [(np.zeros(model.nv), (link, None, np.eye(3)[_WORLD[a]])) for a in axes]
    if kind == "strain" and len(entry) == 4:
        return [(_by_rate(model, rows_of_entry(model, field, tuple(entry))[0][0]), None)]
    raise ValueError(
        f'{field} = {entry!r}: must be ("joint", link), ("tip", link), ("tip", link, "x") or ("strain", link, x, "K3")'
    )


def _by_rate(model: Chain, by_q: Array) -> Array:
    """Derivatives by coordinates as those by rates; a ball's have none."""
    at = [model.coordinate_of(i) for i in range(model.nv)]
    return np.array([by_q[k] if k >= 0 else 0.0 for k in at])


def projection(arm: Chain, model: Chain) -> tuple[Array, Array]:
    """Matrices from an arm's coordinates and rates to a model's: joints are equal, strains of beams fit by least
    squares."""
    if arm.links == model.links:
        return np.eye(arm.nq), np.eye(arm.nv)
    for k, (sits, known_on) in enumerate(zip(arm.seats, model.seats, strict=False)):
        if sits != known_on:
            on = [f"link {n}" if x is None else f"link {n} at {x:g} m" for n, x in (known_on, sits)]
            on = ["the world" if name == "link -1" else name for name in on]
            raise ValueError(f"model: link {k} sits on {on[0]}, that of the arm on {on[1]}")
    out, place = np.zeros((model.nv, arm.nv)), np.zeros((model.nq, arm.nq))
    for k in range(max(len(arm.links), len(model.links))):
        plant, known = (c.links[k] if k < len(c.links) else None for c in (arm, model))
        joints = [0 if link is None else link.joint.nv for link in (plant, known)]
        if joints[0] != joints[1] or len({k in dict(c.quaternions()) for c in (arm, model)}) > 1:
            raise ValueError(f"model: link {k} has {joints[1]} joint coordinates, that of the arm has {joints[0]}")
        if joints[0]:
            out[model.joint_rates(k), arm.joint_rates(k)] = 1.0
        if plant is None or known is None or plant.beam is None or known.beam is None:
            continue
        part = (np.polynomial.legendre.leggauss(16)[0] + 1) / 2
        strains = [
            np.concatenate([c.strain(np.eye(c.nq), k, x * beam.length).T for x in part])
            for c, beam in ((arm, plant.beam), (model, known.beam))
        ]
        mine = np.flatnonzero(np.abs(strains[1]).max(axis=0) > 0)
        place[mine] += np.linalg.lstsq(strains[1][:, mine], strains[0], rcond=None)[0]
    both = [np.array([c.coordinate_of(i) for i in range(c.nv)]) for c in (model, arm)]
    own, other = (np.flatnonzero(at >= 0) for at in both)
    grid = np.ix_(own, other)
    out[grid] += place[np.ix_(both[0][own], both[1][other])]
    place[np.ix_(both[0][own], both[1][other])] = out[grid]
    for (_, to), (_, at) in zip(model.quaternions(), arm.quaternions(), strict=True):
        place[to, at] = np.eye(4)
    return place, out
