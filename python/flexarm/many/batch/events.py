"""Events of a batch in arrays of one shape, although their numbers differ between scenarios."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...data.store.scenarios import Column

PARTS = ("t_events", "q_events", "v_events")


def columns(events: int, most: int, nq: int, nv: int) -> dict[str, Column]:
    """The arrays by name: the number of occurrences of each event, and the first `most` of them."""
    of = (events, most)
    rows = {k: Column(shape, "<f8", np.nan) for k, shape in zip(PARTS, (of, (*of, nq), (*of, nv)), strict=True)}
    return {"events": Column(of[:1], "<i4", 0), **rows}


def packed(found: NDArray[Any], events: int, most: int, nq: int, nv: int) -> dict[str, NDArray[Any]]:
    """These arrays from the events of each scenario (None: not known); blank beyond."""
    of = columns(events, most, nq, nv)
    out = {k: np.full((len(found), *x.shape), x.blank, x.kind) for k, x in of.items()}
    for i, scenario in enumerate(found):
        for name, parts in zip(PARTS, scenario or (), strict=False):
            for k, part in enumerate(parts):
                n = min(len(part), most)
                out["events"][i, k], out[name][i, k, :n] = n, part[:n]
    return out


def kept(found: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """These arrays with room for all occurrences."""
    known = [scenario for scenario in found if scenario is not None]
    if not known:
        return {}
    most = max(len(t) for t_events, _, _ in known for t in t_events)
    nq, nv = known[0][1][0].shape[1], known[0][2][0].shape[1]
    return packed(found, len(known[0][0]), most, nq, nv)


def crowded(found: NDArray[Any], most: int) -> list[int]:
    """Scenarios in which an event occurred more often than `most` times."""
    return [i for i, scenario in enumerate(found) if scenario and any(len(t) > most for t in scenario[0])]


def unpacked(held: Mapping[str, NDArray[Any]], done: NDArray[np.bool_]) -> NDArray[Any]:
    """The events of each scenario that is done, (B,): lists of t, q and v of each event; None in the others."""
    out = np.full(len(done), None)
    for i in np.flatnonzero(done):
        out[i] = tuple([np.array(held[name][i, k, :n]) for k, n in enumerate(held["events"][i])] for name in PARTS)
    return out
