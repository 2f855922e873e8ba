"""Logs of robots: one topic of a MCAP file or of a bag of ROS 2, as columns over time."""

from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .._check import Array
from .files import Raw
from .store.files import Refused

LOGS = (".mcap", ".db3")

_JOINTS = "sensor_msgs/msg/JointState"
_CALENDAR = 10**18  # ns, in 2001: a smaller stamp is of a simulated clock
_EMPTY = "has no number in any message"


def read_log(path: Path, key: str | None) -> Raw:
    """The numbers of the messages of a topic, `key`; None: of the only one of joints, or at all. Their times "t" (s)
    are those of the headers, or else of the log, and count from the log's beginning; those of a simulated clock stay as
    they are. For use in `readable`."""
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as e:
        raise ImportError(f"logs of ROS 2 need rosbags ({e}): pip install 'flexarm[ros]'") from None
    # bags before ROS 2 Iron hold no definitions of their messages
    with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as log:
        types = {topic: str(of.msgtype) for topic, of in log.topics.items() if of.msgcount}
        topic = _chosen(types, key)
        messages = [(stamp, log.deserialize(raw, of.msgtype))
                    for of, stamp, raw in log.messages(log.topics[topic].connections)]  # fmt: skip
        begin = log.start_time
    stamps = np.array([_stamp(message) or stamp for stamp, message in messages])
    order = np.argsort(stamps, kind="stable")  # some arrive late
    stamps, contents = stamps[order], [messages[k][1] for k in order]
    found = _of_joints(topic, contents) if types[topic] == _JOINTS else _of_numbers(contents)
    if not found:
        raise Refused(f"topic '{topic}': its messages ({types[topic]}) hold no numbers; there are {_listed(types)}")
    return {"t": ((stamps - (begin if stamps[0] > _CALENDAR else 0)) * 1e-9, "s"), **found}


def _listed(types: dict[str, str]) -> str:
    return ", ".join(f"'{topic}' ({of})" for topic, of in sorted(types.items())) or "none"


def _chosen(types: dict[str, str], key: str | None) -> str:
    if key is not None and key not in types:
        raise Refused(f"key = {key!r}: there is no such topic with messages; there are {_listed(types)}")
    found = [key] if key else [topic for topic, of in types.items() if of == _JOINTS] or list(types)
    if len(found) != 1:
        raise Refused(f"key = None: must name the topic that is read; there are {_listed(types)}")
    return found[0]


def _stamp(message: Any) -> int:
    """Time of the header (ns); 0 if there is none."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return 0 if stamp is None else stamp.sec * 10**9 + stamp.nanosec


def _of_joints(topic: str, messages: list[Any]) -> Raw:
    """Columns "position/JOINT", "velocity/JOINT" and "effort/JOINT", in SI: a message does not tell rotations from
    shifts."""
    names, found = messages[0].name, Raw()
    for kind in ("position", "velocity", "effort"):
        rows = np.full((len(messages), len(names)), np.nan)
        for row, message in zip(rows, messages, strict=True):
            values, own = getattr(message, kind), message.name
            if sorted(own) != sorted(set(names)):
                both = f"{', '.join(names) or 'none'} and {', '.join(own) or 'none'}"
                raise Refused(f"topic '{topic}': the joints of two messages are {both}; must be alike, each once")
            if len(values) == len(names):
                row[:] = values if own == names else [values[own.index(joint)] for joint in names]
            elif len(values):
                raise Refused(f"topic '{topic}': a message has {len(values)} numbers of {kind} for {len(own)} joints")
        for joint, column in zip(names, rows.T, strict=True):
            found[f"{kind}/{joint}"] = (_EMPTY, None) if np.isnan(column).all() else (column, "")
    return found


def _of_numbers(messages: list[Any]) -> Raw:
    """Columns of all numbers, by their fields: "wrench/force/x", and of a list "data_0", "data_1", ..."""
    rows = [_numbers("", message) for message in messages]
    found = Raw()
    for name, first in rows[0].items():
        if any(row[name].shape != first.shape for row in rows):
            found[name] = ("has another length in some messages", None)
        elif first.ndim:
            found |= {f"{name}_{k}": (x, "") for k, x in enumerate(np.array([row[name] for row in rows]).T)}
        else:
            found[name] = (np.array([row[name] for row in rows], dtype=float), "")
    return found


def _numbers(before: str, message: Any) -> dict[str, Array]:
    """Numbers and lists of them, without bytes."""
    out: dict[str, Array] = {}
    for field in fields(message):
        x: Any = getattr(message, field.name)
        name = before + field.name
        if hasattr(x, "nanosec"):
            out[name] = np.array(x.sec + 1e-9 * x.nanosec)
        elif is_dataclass(x) and name != "header":
            out |= _numbers(f"{name}/", x)
        elif isinstance(x, (bool, int, float)) or (isinstance(x, np.ndarray) and x.dtype.itemsize > 1):
            out[name] = np.asarray(x)
    return out
