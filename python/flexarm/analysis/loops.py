"""Whether a run grew because of a control loop: the linear loop at the start of the run, looked at when a run fails, or
has grown."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from .._check import Array
from ..acting.load import at_time
from ..parts.chain import Chain
from .hybrid import Hybrid
from .laws import HeldLaw, held_law, running_laws
from .plant import Plant

_MOST = 400  # states of a linear model that is looked at
_GROWN = 2.0  # logarithm of what a loop must grow by in the time of a run, to be named


class LoopWarning(UserWarning):
    """A control loop is unstable where the run begins, and the run has grown.

    Attributes:
        control: index of the controller. growth: of its fastest growing motion (1/s), for small deviations.
    """

    def __init__(self, message: str, control: int, growth: float) -> None:
        super().__init__(message)
        self.control, self.growth = control, growth

    def __reduce__(self) -> Any:
        return type(self), (str(self), self.control, self.growth)

    def of(self, whom: str) -> LoopWarning:
        """The same, said of one of many."""
        return LoopWarning(f"{whom}: {self}", self.control, self.growth)


def _remedy(growth: Callable[[float], float], limit: float) -> str:
    """growth(factor) of the gains: what factor makes it stable, in words."""
    for share in np.geomspace(1.0, 1e-3, 19)[1:]:
        if growth(share) > limit:
            continue
        low, high = share, share * 1.468
        for _ in range(8):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if growth(middle) <= limit else (low, middle)
        return f"it is stable with its gains below {low:.2g} of what they are"
    if growth(-1.0) <= limit:
        return "with the other sign of its gains it is stable"
    return "no share of its gains down to 0.001 makes it stable"


def unstable(
    arm: Chain, q: Array, prescribed: Sequence[int], times: Array, loads: Any, controls: Sequence[Any], time: float,
    failed: bool, samplers: Sequence[Any] | None = None,
) -> LoopWarning | None:  # fmt: skip
    """The warning that the loops of a run deserve which has grown in `time` (s); None where they are stable at its
    start, or are not linear. A loop that a limit may hold is not named unless the run has `failed`.

    Args:
        q: the start, (nq,). times, loads: of the run.
        samplers: its sampled laws, as the core was given them, which know what they were asked; None: they are asked.
    """
    try:
        with np.errstate(all="ignore"):
            return _unstable(arm, q, prescribed, times, loads, controls, time, failed, samplers)
    except (ValueError, np.linalg.LinAlgError):  # a state that has no linear model: the run's own words must do
        return None


def _seen_laws(
    arm: Chain, controls: Sequence[Any], counts: Sequence[int], samplers: Sequence[Any], q: Array, start: float,
    failed: bool,
) -> list[HeldLaw]:  # fmt: skip
    """The laws of those controllers with samplers, `counts` of each, that are linear, or have been so in this run."""
    laws, found = iter(samplers), []
    for k, (c, count) in enumerate(zip(controls, counts, strict=True)):
        own, v = [next(laws) for _ in range(count)], np.zeros(arm.nv)
        if not own:
            continue
        try:
            law = held_law(arm, k, c, own, q, v, start, None, seen=True)
            if law is None and failed:  # too early to have seen it: it is asked
                law = held_law(arm, k, c, own, q, v, start, None, seen=False)
        except ValueError:
            continue
        if law is not None and (failed or not np.isfinite(law.limit)):
            found.append(law)
    return found


def _unstable(
    arm: Chain, q: Array, prescribed: Sequence[int], times: Array, loads: Any, controls: Sequence[Any], time: float,
    failed: bool, samplers: Sequence[Any] | None,
) -> LoopWarning | None:  # fmt: skip
    if 2 * (arm.nv - len(prescribed)) > _MOST:
        return None
    start = float(times[0])
    plant = Plant(arm, q, np.zeros(arm.nv), prescribed, at_time(arm, loads, start))
    running, own, memory = running_laws(arm, controls, times, loads)
    running = [x for x in running if not x.acts or failed or not np.isfinite(x.limit)]
    given = [law for laws in own for law in laws] if samplers is None else samplers
    held = _seen_laws(arm, controls, [len(laws) for laws in own], given, q, start, failed)
    bare = max(Hybrid(plant, [], [], 0).growth(), 0.0) * 1.05
    least = bare + _GROWN / max(time, 1e-300)
    quiet = bare + 0.05 * _GROWN / max(time, float(times[-1] - times[0]))
    return _running(plant, running, memory, least, quiet) or _held(plant, running, held, memory, least, quiet)


def _running(plant: Plant, running: Sequence[Any], memory: int, least: float, quiet: float) -> LoopWarning | None:
    """Of the loops without samples."""
    loop = Hybrid(plant, running, [], memory)
    poles, _ = loop.poles()
    if not poles.size or poles[0].real <= least:
        return None
    own = sorted({x.control for x in running})
    for k in own:
        mine = [x for x in running if x.control == k or not x.acts]
        if len(own) == 1 or Hybrid(plant, mine, [], memory).growth() > least:
            break
    how = _remedy(lambda f: loop.growth(f * loop.ones()), quiet)
    return LoopWarning(
        f"the loop of control[{k}] feeds energy in: about the start its fastest pole is {_text(complex(poles[0]))} "
        f"1/s; {how}",
        k, float(poles[0].real),
    )  # fmt: skip


def _oftener(plant: Plant, running: Sequence[Any], chosen: Sequence[HeldLaw], memory: int, quiet: float) -> str:
    """How often laws without a memory must be sampled to be stable, in words; "" where up to 64 times is no help."""
    if any(x.A.size for x in chosen):
        return ""
    for parts in (2, 4, 8, 16, 32, 64):
        finer = [replace(x, rate=x.rate * parts) for x in chosen]
        try:
            if Hybrid(plant, running, finer, memory).growth() <= quiet:
                return f"sampled every {1.0 / finer[0].rate:g} s"
        except ValueError:  # too many samples are under way
            return ""
    return ""


def _held(
    plant: Plant, running: Sequence[Any], held: Sequence[HeldLaw], memory: int, least: float, quiet: float
) -> LoopWarning | None:
    """Of the loops with samples: of each alone, then of all together."""
    for chosen in [[x] for x in held] + ([list(held)] if len(held) > 1 else []):
        loop = Hybrid(plant, running, chosen, memory)
        try:
            s, z = loop.poles()
        except ValueError:  # rates without a common period
            continue
        if not s.size or s[0].real <= least:
            continue
        assert z is not None
        factors = np.array([c.rate is not None for c in loop.channels])
        how = _remedy(lambda f, x=loop, y=factors: x.growth(np.where(y, f, 1.0)), quiet)  # type: ignore[misc]
        often = _oftener(plant, running, chosen, memory, quiet)
        if often:
            how = f"{often} it is stable, while {how}" if how.startswith("no") else f"{how}, or {often}"
        names = " and ".join(f"control[{x.control}]" for x in chosen)
        first = chosen[0]
        whole = float(np.max(first.delay)) + max((tap.delay for tap in first.taps), default=0.0)
        late = f" with a delay of {whole:g} s" if whole else ""
        return LoopWarning(
            f"the loop of {names}, sampled every {1.0 / first.rate:g} s{late}, is unstable: about the start its "
            f"fastest pole is z = {_text(complex(z[0]))}; {how}",
            first.control, float(s[0].real),
        )  # fmt: skip
    return None


def _text(pole: complex) -> str:
    if abs(pole.imag) <= 1e-9 * abs(pole):
        return f"{pole.real:.3g}"
    return f"{pole.real:.3g} +- {abs(pole.imag):.3g}i"


def has_grown(v: Array) -> bool:
    """Whether rates (nt, n) are in the last fifth of the rows far above those of the first tenth, and near the largest
    of all: what settles is not growing."""
    parts = v[: max(2, len(v) // 10)], v[-max(2, len(v) // 5) :]
    first, last = (np.abs(part).max(axis=0, initial=0.0) for part in parts)
    grown = last > 3.0 * first
    return bool(grown.any() and (grown & (last >= 0.5 * np.abs(v).max(axis=0, initial=0.0))).any())
