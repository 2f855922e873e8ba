"""Events of a batch: how often they occur differs from scenario to scenario, and a file's arrays have one shape."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

PARTS = ("t_events", "q_events", "v_events")
#: number of axes and type of the arrays that keep them
ARRAYS = {"events": (2, "<i4"), "t_events": (3, "<f8"), "q_events": (4, "<f8"), "v_events": (4, "<f8")}


def shapes(scenarios: int, events: int, most: int, nq: int, nv: int) -> dict[str, tuple[tuple[int, ...], str]]:
    """Shape and kind of the arrays by name: how often each event occurred, and what is kept of so many occurrences."""
    all_of = (scenarios, events, most)
    of = {"events": all_of[:2], "t_events": all_of, "q_events": (*all_of, nq), "v_events": (*all_of, nv)}
    return {name: (of[name], kind) for name, (_, kind) in ARRAYS.items()}


def packed(found: NDArray[Any], events: int, most: int, nq: int, nv: int) -> dict[str, NDArray[Any]]:
    """Arrays of these shapes from what occurred in each scenario (None: nothing is known of it); nan beyond."""
    of = shapes(len(found), events, most, nq, nv)
    out = {k: np.full(shape, 0 if k == "events" else np.nan, kind) for k, (shape, kind) in of.items()}
    for i, scenario in enumerate(found):
        for name, parts in zip(PARTS, scenario or (), strict=False):
            for k, part in enumerate(parts):
                n = min(len(part), most)
                out["events"][i, k], out[name][i, k, :n] = n, part[:n]
    return out


def kept(found: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """The same arrays, as long as need be."""
    known = [scenario for scenario in found if scenario is not None]
    if not known:
        return {}
    most = max(len(t) for t_events, _, _ in known for t in t_events)
    nq, nv = known[0][1][0].shape[1], known[0][2][0].shape[1]
    return packed(found, len(known[0][0]), most, nq, nv)


def crowded(found: NDArray[Any], most: int) -> list[int]:
    """Scenarios in which an event occurred more often than that."""
    return [i for i, scenario in enumerate(found) if scenario and any(len(t) > most for t in scenario[0])]


def unpacked(held: Mapping[str, NDArray[Any]], done: NDArray[np.bool_]) -> NDArray[Any]:
    """What occurred in each scenario that is done, (B,): lists of t, q and v of each event; None in the others."""
    out = np.full(len(done), None)
    for i in np.flatnonzero(done):
        out[i] = tuple([np.array(held[name][i, k, :n]) for k, n in enumerate(held["events"][i])] for name in PARTS)
    return out
