"""Events of contacts: where one touches its surface, and where it leaves it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from ..arm.arm import Arm
from ..model.parts.part import Part


@dataclass(frozen=True)
class OfContact(Part):
    """The base of events of contacts: `simulate(arm, t, events=fa.Touch("toe"))`."""

    contact: str | int = -1
    terminal: bool | int = field(default=False, kw_only=True)
    direction: ClassVar[int] = 0

    def of(self, arm: Arm) -> Callable[[float, Any, Any], float]:
        """The event of an arm: its value is the gap (m)."""
        k, core = arm._contact(self.contact, f"{type(self).__name__}: contact"), arm._core

        def gap(t: float, q: Any, v: Any) -> float:
            return float(core.contact_motion(np.ascontiguousarray(q), np.ascontiguousarray(v))[k, 0])

        return gap


@dataclass(frozen=True)
class Touch(OfContact):
    """The event that a contact touches its surface: its gap falls below zero. For `simulate(events=...)`.

    Args:
        contact: its name or its number in `arm.contacts`; -1 is the last.
        terminal: True: the run ends there; a number: at that occurrence.
    """

    direction: ClassVar[int] = -1


@dataclass(frozen=True)
class Release(OfContact):
    """The event that a contact leaves its surface: its gap rises above zero. For `simulate(events=...)`.

    Args:
        contact: its name or its number in `arm.contacts`; -1 is the last.
        terminal: True: the run ends there; a number: at that occurrence.
    """

    direction: ClassVar[int] = 1


def bound(event: Any, arm: Arm) -> Callable[..., Any]:
    """An event as a callable (t, q, v)."""
    found: Callable[..., Any] = event.of(arm) if isinstance(event, OfContact) else event
    return found


def of_contacts(events: Any) -> bool:
    """Whether one of these events belongs to contacts, which differ from arm to arm."""
    given = events if isinstance(events, (list, tuple)) else [events]
    return any(isinstance(x, OfContact) for x in given)
