"""Whether a run grew because of a control loop: the linear loop at the start of the run, looked at when a run fails, or
has grown."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._check import Array
from ..analysis.findings import Finding, LoopWarning
from ..model.acting.load import at_time
from ..model.parts.chain import Chain
from .hybrid import Hybrid
from .laws import HeldLaw, held_law, running_laws
from .plant import Plant

_MOST = 400  # states of a linear model that is looked at
_LEAST = 0.001  # share of its gains at which a loop is tried
_GROWN = 2.0  # logarithm of the growth in the time of a run from which a loop is named


class _Growths(NamedTuple):
    """1/s: of the arm without control; the least of a run that has grown; and one that is as good as none."""

    bare: float
    grown: float
    quiet: float


def _edge(growth: Callable[[float], float], quiet: float, good: float, bad: float) -> float:
    """The factor between a good one and a bad one where growth(factor) ceases to be quiet."""
    for _ in range(8 + int(abs(np.log2(bad / good)))):
        middle = np.sqrt(good * bad)
        good, bad = (middle, bad) if growth(middle) <= quiet else (good, middle)
    return float(good)


def _stable_shares(growth: Callable[[float], float], quiet: float) -> tuple[float, float] | None:
    """Between which factors below 1 growth(factor) of the gains is quiet; from zero where the least tried is so."""
    shares = np.geomspace(1.0, _LEAST, 37)
    found = next((k for k in range(1, shares.size) if growth(shares[k]) <= quiet), None)
    if found is None:
        return None
    low = 0.0 if growth(_LEAST) <= quiet else _edge(growth, quiet, shares[found], _LEAST)
    return low, _edge(growth, quiet, shares[found], shares[found - 1])


def _remedy(growth: Callable[[float], float], of: _Growths) -> str:
    """The factor of the gains that makes the loop stable, in words; growth(factor) is its growth."""
    shares = _stable_shares(growth, of.quiet)
    if shares is None and growth(-1.0) <= of.quiet:
        return "with the other sign of its gains it is stable"
    if shares is None:
        falls = f", and without it the arm grows by {of.bare:.3g} 1/s" if of.bare > of.quiet else ""
        return f"no share of its gains down to {_LEAST} makes it stable{falls}"
    low, high = shares
    where = f"between {low:.2g} and" if low else "below"
    return f"it is stable with its gains {where} {high:.2g} of what they are"


def unstable(
    arm: Chain, q: Array, prescribed: Sequence[int], times: Array, loads: Any, controls: Sequence[Any], time: float,
    failed: bool, samplers: Sequence[Any] | None = None,
) -> LoopWarning | None:  # fmt: skip
    """The warning that the loops of a run deserve which has grown in `time` (s); None where they are stable at its
    start, or are not linear. A loop that a limit may hold is not named unless the run has `failed`.

    Args:
        q: the start, (nq,). times, loads: of the run.
        samplers: its sampled laws, as the core was given them, with their questions and answers; None: they are asked.
    """
    if 2 * (arm.nv - len(prescribed)) > _MOST:
        return None
    start = float(times[0])
    # ValueError and LinAlgError: a state that has no linear model, of which the run says enough by itself
    with np.errstate(all="ignore"), suppress(ValueError, np.linalg.LinAlgError):
        plant = Plant(arm, q, np.zeros(arm.nv), prescribed, at_time(arm, loads, start))
        running, own, felt = running_laws(arm, controls, times, loads)
        running = [x for x in running if not x.acts or failed or not np.isfinite(x.limit)]
        given = [law for laws in own for law in laws] if samplers is None else samplers
        held, memory = _seen_laws(arm, controls, [len(laws) for laws in own], given, felt, q, start, failed), felt.sum()
        of = _Growths(
            max(Hybrid(plant, [], [], 0).growth(), 0.0), _GROWN / max(time, 1e-300),
            0.05 * _GROWN / max(time, float(times[-1] - times[0])),
        )  # fmt: skip
        with suppress(ValueError):
            return _named(Hybrid(plant, running, held, memory), of)
        # rates without a common period: the laws without samples, then each of the others beside them
        for chosen in ([], *([x] for x in held)):
            with suppress(ValueError):
                if found := _named(Hybrid(plant, running, chosen, memory), of):
                    return found
    return None


def _seen_laws(
    arm: Chain, controls: Sequence[Any], counts: Sequence[int], samplers: Sequence[Any], felt: NDArray[np.bool_],
    q: Array, start: float, failed: bool,
) -> list[HeldLaw]:  # fmt: skip
    """The laws of those controllers with samplers, `counts` of each, that are linear, or have been so in this run."""
    laws, found = iter(samplers), []
    for k, (c, count) in enumerate(zip(controls, counts, strict=True)):
        own, v = [next(laws) for _ in range(count)], np.zeros(arm.nv)
        if not own:
            continue
        try:
            law = held_law(arm, k, c, own, felt, q, v, start, None, recorded=True)
            if law is None and failed:  # too early to have seen it: it is asked
                law = held_law(arm, k, c, own, felt, q, v, start, None, recorded=False)
        except ValueError:
            continue
        if law is not None and (failed or np.isinf(law.limit).all()):
            found.append(law)
    return found


def _guilty(loop: Hybrid, own: Sequence[int], of: _Growths) -> list[int]:
    """Which of the controllers `own` make a loop grow: one that does so without the others, or one whose share of its
    gains alone makes it stable, or all of them."""

    def growth(k: int, factor: float) -> float:
        return loop.growth(np.array([factor if c.control == k else 1.0 for c in loop.channels]))

    if len(own) > 1:
        for k in own:
            if loop.alone(k).growth() > 1.05 * of.bare + of.grown:
                return [k]
        cures = [k for k in own if _stable_shares(lambda f, k=k: growth(k, f), of.quiet)]  # type: ignore[misc]
        if len(cures) == 1:
            return cures
    return list(own)


def _controller(loop: Hybrid, k: int) -> str:
    """Controller k, in words."""
    mine = [c for c in loop.channels if c.control == k]
    return mine[0].name if len(mine) == 1 else f"{mine[0].kind} of {', '.join(dict.fromkeys(c.at for c in mine))}"


def _named(loop: Hybrid, of: _Growths) -> LoopWarning | None:
    """The warning that a loop deserves; None where it does not grow, or the arm grows by itself as fast, and no share
    of the gains keeps it from that."""
    poles, z = loop.poles()
    if not loop.channels or not poles.size or poles[0].real <= of.grown:
        return None
    named = _guilty(loop, list(dict.fromkeys(c.control for c in loop.channels)), of)
    mine = np.isin([c.control for c in loop.channels], named)

    def growth(factor: float) -> float:
        return loop.growth(np.where(mine, factor, 1.0))

    if poles[0].real <= 1.05 * of.bare + of.grown and _stable_shares(growth, of.quiet) is None:
        return None
    how, names = _remedy(growth, of), " and ".join(_controller(loop, k) for k in named)
    chosen = [x for x in loop.held if x.control in named]

    def warning(cause: str, remedy: str) -> LoopWarning:
        found = Finding(f"control[{named[0]}]", cause, float(poles[0].real), of.grown, "1/s", remedy)
        return LoopWarning(found, control=named[0])

    if not chosen:
        pole = _text(complex(poles[0]))
        return warning(f"the loop of {names} feeds energy in: about the start its fastest pole is {pole} 1/s", how)
    often = _oftener(loop, named, of.quiet)
    if often:
        how = f"{often} it is stable, while {how}" if how.startswith("no") else f"{how}, or {often}"
    first = chosen[0]
    whole = float(np.max(first.delay)) + max((tap.delay for tap in first.taps), default=0.0)
    late = f" with a delay of {whole:g} s" if whole else ""
    assert z is not None
    cause = f"the loop of {names}, sampled every {1.0 / first.rate:g} s{late}, is unstable"
    return warning(f"{cause}: about the start its fastest pole is z = {_text(complex(z[0]))}", how)


def _oftener(loop: Hybrid, named: Sequence[int], quiet: float) -> str:
    """How often laws without a memory must be sampled to be stable, in words; "" where up to 64 times is no help."""
    chosen = [x for x in loop.held if x.control in named]
    if any(x.A.size for x in chosen):
        return ""
    for parts in (2, 4, 8, 16, 32, 64):
        finer = [replace(x, rate=x.rate * parts) if x.control in named else x for x in loop.held]
        try:
            if loop.with_held(finer).growth() <= quiet:
                return f"sampled every {1.0 / (chosen[0].rate * parts):g} s"
        except ValueError:  # too many samples are under way
            return ""
    return ""


def _text(pole: complex) -> str:
    if abs(pole.imag) <= 1e-9 * abs(pole):
        return f"{pole.real:.3g}"
    return f"{pole.real:.3g} +- {abs(pole.imag):.3g}i"


def has_grown(v: Array) -> NDArray[np.bool_]:
    """Whether rates (..., nt, n) are in the last fifth of the rows far above those of the first tenth, and near the
    largest of all: a motion that settles is not growing."""
    rows = v.shape[-2]
    parts = v[..., : max(2, rows // 10), :], v[..., -max(2, rows // 5) :, :], v
    first, last, most = (np.maximum(x.max(axis=-2, initial=0.0), -x.min(axis=-2, initial=0.0)) for x in parts)
    grown: NDArray[np.bool_] = ((last > 3.0 * first) & (last >= 0.5 * most)).any(axis=-1)
    return grown
