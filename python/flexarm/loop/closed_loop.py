"""The linear loop of an arm and its controllers: poles, zeros, modes, margins."""

import re
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._check import (
    Array,
    array,
    between,
    choice,
    increasing,
    instance,
    instances,
    not_negative,
    number,
    positive,
    whole,
)
from .._console import aligned
from ..analysis.equilibrium import steady_state, trimmed
from ..analysis.linear import forces_of, rows_of, state_space
from ..analysis.modes import Modes
from ..analysis.rates import elastic_rates, locked_rates
from ..arm.arm import Arm
from ..arm.variation import Setup, Variation, value_at
from ..data.draw.loop import plot_loop
from ..data.draw.style import Figure
from ..model.acting.control import Controller, controllers
from ..model.acting.load import Load, at_time
from ..model.acting.sampled import LinearController
from ..model.acting.shaping import Shaper, input_shaper
from .hybrid import Complex, Hybrid
from .laws import Channel, Tap, held_law, running_laws
from .locus import Limits, Locus, limits_of, locus_of
from .margins import Margins, Response, Robustness, margins_of, margins_table, robustness_of, short, stable, zeros_of
from .plant import Plant
from .tuning import StabilityMap, Tuned, Tuner, gains_of, map_of

_ROWS = 16  # poles that are printed
_LIGHTLY = 0.3  # the damping ratio below which a mode is shaped
_MOMENT = 1e-3  # s for which references are asked: only that they are there


class ClosedLoop:
    """Small motions of an arm under its controllers, about a state; the result of `closed_loop`.

    `print` shows a table.

    Attributes:
        arm, control, q, v: the arm, its controllers, and the state.
        poles: s (1/s), (n,), the fastest growing first. With samples: log(z) / period, |Im s| up to pi / period; -inf
            for z = 0, a motion that ends after some samples.
        z: of each pole with samples, over one `period`; else None.
        period: the shortest time after which the samples of all controllers repeat (s); None without samples.
        growth: the largest real part of the poles (1/s). stable: whether no pole grows, but for rounding.
        frequencies, damping: |s| (rad/s) and -Re(s)/|s| of each pole, (n,).
        A, B, C, D: x' = A x + B u, y = C x + D u, from `inputs` to `outputs` (labels); with samples x+ = A x + B u over
            a period, u held.
        channels: the outputs of the controllers, where loops are broken: `.control`, `.output`, `.rate`, `.limit`.
    """

    def __init__(self, _setup: Setup, _hybrid: Hybrid, _options: dict[str, Any], _system: tuple[Any, ...]) -> None:
        self._setup, self._hybrid, self._options = _setup, _hybrid, _options
        self.arm, self.control, self.q, self.v = _setup.arm, _setup.control, _hybrid.plant.q, _hybrid.plant.v
        self.A, self.B, self.C, self.D, self.inputs, self.outputs = _system
        self.poles, self.z = _hybrid.poles()
        self.period: float | None = _hybrid.period
        self.channels: list[Channel] = _hybrid.channels

    def __str__(self) -> str:
        return "\n".join(_table(self))

    def __repr__(self) -> str:
        return f"ClosedLoop({len(self.poles)} poles, growth {self.growth:.4g} 1/s)"

    @property
    def growth(self) -> float:
        return float(self.poles.real.max(initial=-np.inf))

    @property
    def stable(self) -> bool:
        return stable(self.poles)

    @property
    def frequencies(self) -> Array:
        return np.asarray(np.abs(self.poles))

    @property
    def damping(self) -> Array:
        return _damping(self.poles)

    @cached_property
    def zeros(self) -> Complex:
        """The zeros of all inputs and outputs; see `zeros_of`."""
        return self.zeros_of(range(len(self.inputs)), range(len(self.outputs)))

    def zeros_of(self, inputs: Any, outputs: Any) -> Complex:
        """Transmission zeros from inputs to outputs: s (1/s), or z with samples, (n,).

        Args:
            inputs, outputs: as many of each: a label of `inputs` or `outputs`, its number, or a list of them, such as
                zeros_of(0, "tip link 0 y").

        Raises:
            ValueError: no such label or number, or not as many of each.
        """
        u, y = _indices("inputs", inputs, self.inputs), _indices("outputs", outputs, self.outputs)
        if len(u) != len(y):
            raise ValueError(
                f"zeros: there are {len(u)} inputs and {len(y)} outputs; name as many of each, such as zeros_of(0, 1), "
                f"of {', '.join(self.inputs)} and {', '.join(self.outputs)}"
            )
        values = self.poles if self.z is None else self.z
        return zeros_of(self.A, self.B[:, u], self.C[y], self.D[np.ix_(y, u)], values)

    @cached_property
    def margins(self) -> tuple[Margins, ...]:
        """Margins of each of `channels`, with its loop broken and all others closed: see Margins."""
        return tuple(margins_of(self._hybrid, k, self.poles) for k in range(len(self.channels)))

    @cached_property
    def robustness(self) -> Robustness:
        """The least singular value of I + L, all loops broken at once, over all frequencies; nan if only some loops are
        sampled."""
        return robustness_of(self._hybrid, self.poles)

    def loop_gain(self, frequency: ArrayLike, channels: Sequence[int] | None = None) -> Complex:
        """L(i w), or L(exp(i w period)), with the loops of some `channels` broken (all if None), the others closed: the
        negative of the controllers' response to these outputs. The loop's equation is 1 + L = 0.

        Args:
            frequency: w (rad/s), (nw,). channels: indices of `channels`.

        Returns:
            (nw, n, n); a channel that is sampled several times in a period stands once for each of its samples.

        Raises:
            ValueError: sampled and continuous loops, both broken, or one broken and the other closed.
        """
        w = array("frequency", frequency)
        chosen = range(len(self.channels)) if channels is None else [whole("channels", c) for c in channels]
        if not chosen or not all(0 <= c < len(self.channels) for c in chosen):
            raise ValueError(f"channels = {channels!r}: must be from 0 to {len(self.channels) - 1}")
        return Response(self._hybrid.opened(list(chosen)), self.period)(np.atleast_1d(w))

    @cached_property
    def modes(self) -> Modes:
        """Modes of the closed loop, by ascending frequency, one of each conjugate pair, in the form of `Arm.modes`;
        `Arm.mode_shapes` takes them. Poles without motion of the arm are left out."""
        s, theta = self._hybrid.motions()
        size = np.abs(theta).max(axis=0, initial=0.0)
        keep = np.isfinite(s) & (s.imag >= 0) & (size > 1e-12 * size.max(initial=0.0))
        s, theta = s[keep], theta[:, keep]
        largest = theta[np.abs(theta).argmax(axis=0), np.arange(s.size)]
        theta = theta / np.where(largest == 0, 1.0, largest)
        share = np.abs(np.real(np.conj(theta) * (self.arm.mass_matrix(self.q) @ theta)))
        share /= np.maximum(share.sum(axis=0), 1e-300)
        up = np.argsort(np.abs(s), kind="stable")
        return Modes(np.abs(s)[up], _damping(s)[up], theta[:, up], share[:, up], s[up], self.q, self.arm)

    def shaper(self, kind: str = "zvd", modes: int | Iterable[int] = 1) -> Shaper:
        """A shaper of commands for vibrations of the closed loop; see `input_shaper`.

        Args:
            kind: "zv", "zvd" or "zvdd".
            modes: the number of vibrations, from the slowest, among those with a damping ratio below 0.3; or indices of
                `modes`.

        Raises:
            ValueError: the loop is unstable, or has no such vibration.
        """
        if not self.stable:
            raise ValueError(f"shaper: the loop is unstable (it grows by {self.growth:.3g} 1/s)")
        found = self.modes
        rings = [k for k in range(len(found.frequencies))
                 if found.damping[k] < _LIGHTLY and found.eigenvalues[k].imag > 1e-6 * found.frequencies[k] > 0.0]
        if isinstance(modes, Iterable):
            chosen = [whole("modes", k) for k in modes]
            if not chosen or not all(k in range(len(found.frequencies)) for k in chosen):
                raise ValueError(f"modes = {chosen}: must be numbers of modes, from 0 to {len(found.frequencies) - 1}")
        else:
            if not rings:
                raise ValueError(f"shaper: no motion of this loop has a damping ratio below {_LIGHTLY}: nothing rings")
            if not 1 <= whole("modes", modes) <= len(rings):
                raise ValueError(f"modes = {modes}: must be from 1 to {len(rings)}, the vibrations of this loop")
            chosen = rings[:modes]
        each = [input_shaper(kind, float(found.frequencies[k]), max(float(found.damping[k]), 0.0)) for k in chosen]
        out = each[0]
        for other in each[1:]:
            out = out * other
        return out

    # -- over a parameter ----------------------------------------------------------------------------------------------

    def _with(self, values: Mapping[str, float]) -> Setup:
        """The arm and its controllers with changed parameters."""
        return Variation(self._setup, {path: np.array([x]) for path, x in values.items()}).scenario(0)

    def _loop_at(self, values: Mapping[str, float]) -> Hybrid:
        """The loop with changed parameters: all of the controllers, or one of the arm."""
        found = self._with(values)
        if all(path.startswith("control.") for path in values):  # the arm does not change
            return _hybrid(self._hybrid.plant, found.control, self._options["t"], found.forces)
        return closed_loop(found.arm, list(found.control), loads=found.forces, **self._options)._hybrid

    def _poles_at(self, values: Mapping[str, float]) -> Complex:
        return self._loop_at(values).poles()[0]

    def _poles_over(self, path: str) -> tuple[Any, float]:
        """A callable value -> poles, and the present value."""
        if path == "gain":
            ones = self._hybrid.ones()
            return (lambda x: self._hybrid.poles(x * ones)[0]), 1.0
        if path == "rate":
            rates = {f"control.{x.control}.rate": x.rate for x in self._hybrid.held}
            if not rates:
                raise ValueError("over = 'rate': no law of this loop is sampled")
            fastest = max(self._value(name) for name in rates)
            return (lambda x: self._poles_at({name: x * (r / fastest) for name, r in rates.items()})), fastest
        if not isinstance(path, str):
            raise ValueError(
                f'over = {path!r}: must be "gain", "rate", or a path such as "control.0.kp" or "link.0.tip.mass"'
            )
        now = self._value(path)
        return (lambda x: self._poles_at({path: float(x)})), now

    def _check_rates(self, path: str) -> None:
        """ValueError for one rate that varies while others stay: few values have a common period with them."""
        if re.fullmatch(r"rate|control\.\d+\.rate", path) is None:
            return
        kept = {f"control[{x.control}] ({x.rate:g} Hz)": None for x in self._hybrid.held
                if path not in ("rate", f"control.{x.control}.rate")}  # fmt: skip
        read = {f"a sensor of control[{x.control}] ({tap.rate:g} Hz)": None for x in self._hybrid.held
                for tap in x.taps if tap.rate is not None}  # fmt: skip
        if kept or read:
            how = "" if read else 'limits("rate") varies the rates of all laws together; '
            raise ValueError(
                f"over = {path!r}: {', '.join({**kept, **read})} keeps its rate, and a loop of two rates has poles "
                f"only where these have a common period, so there is no range to search; {how}locus(values, {path!r}) "
                "takes values with whole ratios, such as 250, 500 and 1000"
            )

    def _value(self, path: str) -> float:
        """The present value of the parameter."""
        value, law = value_at(self._setup, path)
        if path.endswith(".rate") and isinstance(law, LinearController) and law.A.size and not law.rebuilt:
            raise ValueError(
                f"over = {path!r}: the matrices of a LinearController are of one rate; make one for each rate, and "
                "ask closed_loop of each (the rate of .pid, .ppf and .irc can vary)"
            )
        if np.ndim(value) == 0 and value is not None and not isinstance(value, (str, tuple)):
            return number(path, value)
        Variation(self._setup, {path: np.zeros(1)})  # its error suggests similar names
        raise ValueError(f"over = {path!r}: is no number that can vary")

    def locus(self, values: ArrayLike, over: str = "gain", progress: Any = False) -> Locus:
        """Poles over a parameter: a root locus.

        Args:
            values: of the parameter, (m,), increasing.
            over: "gain": a factor of all outputs of the controllers. "rate": the rate of the fastest sampled law (Hz);
                those of all others change in proportion. Or a path as `simulate_batch(parameters=)` has it:
                "control.0.kp", "control.0.rate", "control.0.delay", "link.0.tip.mass", "link.forearm.tip.mass".
            progress: shows a bar on stderr, or lines where that is no terminal; or a callable of the number of values
                done, which may raise to stop.

        Returns:
            Locus: `.values`, `.poles`, `.crossings`, `.plot()`.
        """
        return locus_of(self._poles_over(over)[0], increasing("values", values), over, progress)

    def limits(self, over: str = "gain") -> Limits:
        """The range of a parameter in which the loop is stable, by root finding on its poles.

        Args:
            over: as of `locus`.

        Returns:
            Limits: `.low`, `.high`; `print` shows a sentence.

        Raises:
            ValueError: as of `locus`; the rate of one law while another law or a sensor keeps its rate.
        """
        poles, now = self._poles_over(over)
        self._check_rates(over)
        return limits_of(poles, now, over, self.poles)

    def _gains(self, control: int | None) -> tuple[int, list[str]]:
        """The controller to be tuned, and its gains."""
        found = {k: names for k, c in enumerate(self.control) if (names := gains_of(c))}
        number = next(iter(found), None) if control is None else whole("control", control)
        if number is None or number not in found:
            raise ValueError(
                f"control = {control!r}: must be the number of a controller with gains kp and kv, or kp and kd; "
                f"those here: {', '.join(map(str, found)) or 'none'}"
            )
        return number, found[number]

    def stability_map(
        self, x: ArrayLike | None = None, y: ArrayLike | None = None, over: tuple[str, str] | None = None,
        progress: Any = False,
    ) -> StabilityMap:  # fmt: skip
        """Which values of two parameters are stable, such as kp and kv of a Servo.

        Args:
            x, y: values of the first and the second, (nx,) and (ny,), increasing; None: 80 from a hundredth of the
                present value to a hundred times it.
            over: the paths of two parameters, such as ("control.0.delay", "link.0.tip.mass"); None: kp, and kv or kd,
                of the first controller that has them.
            progress: as of `locus`, of the rows done.

        Returns:
            StabilityMap: `.growth`, `.stable`, `.plot()`.
        """
        if over is None:
            k, names = self._gains(None)
            over = f"control.{k}.{names[0]}", f"control.{k}.{names[1]}"
        words = 'two different paths, such as ("control.0.kp", "control.0.kv")'
        paths = instances("over", over, object, words)
        if len(paths) != 2 or paths[0] == paths[1] or not all(isinstance(x, str) for x in paths):
            raise ValueError(f"over = {over!r}: must be a list of {words}")
        now = self._value(over[0]), self._value(over[1])
        values = []
        for name, given, at, path in zip("xy", (x, y), now, over, strict=True):
            if given is None and not at > 0.0:
                raise ValueError(f"{name} = None: give values; {path} is {at:g} now, about which there is no range")
            values.append(at * np.geomspace(1e-2, 1e2, 80) if given is None else increasing(name, given))
        return map_of(self._loop_at, (over[0], over[1]), values[0], values[1], now, progress)

    def tune(
        self, bandwidth: float, *, phase_margin: float = np.pi / 3, gain_margin: float = 2.0,
        integral: float | None = None, control: int | None = None,
    ) -> Tuned:  # fmt: skip
        """Gains of a Servo, PD, StrainFeedback or PID for a wanted bandwidth and margins.

        The loop gain is linear in the gains: kp and kv (or kd) are those with which it falls to 1 at the bandwidth,
        with the phase margin, or the least more that reaches the gain margin, too. All other loops stay closed.

        Args:
            bandwidth: where the loop gain falls to 1 (rad/s): references are followed up to about there.
            phase_margin: the least (rad), at all frequencies where the loop gain is 1.
            gain_margin: the loop is to be stable with its gains multiplied by this, and divided by it.
            integral: the frequency (rad/s) below which the integral is stronger than kp, ki / kp; None: a tenth of the
                bandwidth, or no integral if ki is zero now.
            control: the number of the controller; None: the first that has such gains.

        Returns:
            Tuned: `.control` with the new gains, `.gains`, `.margins`; `print` shows the margins that are reached.

        Raises:
            ValueError: no such gains; then with the best that were found, and a bandwidth that is within reach.
        """
        w, gain = positive("bandwidth", bandwidth, "rad/s"), number("gain_margin", gain_margin)
        between("phase_margin", phase_margin, 0, np.pi, " rad (60 degrees are 1.05)")
        if not gain > 1.0:
            raise ValueError(f"gain_margin = {gain_margin!r}: must be a factor above 1")
        if self.period is not None and not w < np.pi / self.period:
            raise ValueError(f"bandwidth = {w:g} rad/s: must be below half the sampling rate, {np.pi / self.period:g}")
        k, names = self._gains(control)
        mine = [i for i, c in enumerate(self.channels) if c.control == k]
        now = np.array([self._value(f"control.{k}.{name}") for name in names])
        if integral is None and len(names) > 2 and now[2] == 0.0:
            integral = 0.0
        part = None if integral is None else not_negative("integral", integral, "rad/s")
        tuner = Tuner(self._loop_at, k, names, now, mine[0])
        gains, margins = tuner.tune(w, (phase_margin, gain), lambda x: 0.1 * x if part is None else part)
        laws = self._with(tuner.values(gains)).control
        return Tuned(tuple(laws), dict(zip(names, gains.tolist(), strict=True)), w, margins, (phase_margin, gain))

    def plot(self) -> Figure:
        """A figure: poles; Nyquist and Bode diagrams of each channel's loop gain, with this channel alone broken."""
        curves = []
        for k, margin in enumerate(self.margins):
            try:
                response = Response(self._hybrid.opened([k]), self.period)
            except ValueError:  # there are sampled loops
                continue
            w = response.frequencies(self.poles)
            L = response(w)
            if L.shape[1] == 1:
                curves.append((margin, w, L[:, 0, 0]))
        return plot_loop(self.poles, self.z, curves)

    def to_control(self) -> Any:
        """The closed loop as a control.StateSpace (package python-control), sampled every `period` if it has one.

        Raises:
            ImportError: python-control is missing.
        """
        return state_space(self, "inputs", "outputs", period=self.period or 0.0)


def _damping(s: Complex) -> Array:
    """Damping ratios: 1 of -inf, 0 of 0."""
    size = np.where(np.isfinite(s) & (s != 0), np.abs(s), 1.0)
    return np.where(np.isfinite(s), -s.real / size, 1.0)


def _table(loop: ClosedLoop) -> list[str]:
    """The lines that `print` shows."""
    z, count = loop.z, len(loop.poles)
    kinds = ", ".join(f"control[{k}] {type(c).__name__}" for k, c in enumerate(loop.control)) or "no control"
    often = "" if loop.period is None else f"; sampling period {loop.period:.6g} s"
    rests = loop.growth < -1e-6
    state = "UNSTABLE" if not loop.stable else "stable" if rests else "stable, but some of it does not die away"
    rows = [["growth (1/s)", "frequency (rad/s)", "(Hz)", "damping ratio", *(() if z is None else ("z",))]]
    shown = [k for k in range(count) if loop.poles[k].imag >= 0 or np.isneginf(loop.poles[k].real)]
    for k in shown[:_ROWS]:
        s, size = loop.poles[k], float(loop.frequencies[k])
        rows.append([short(s.real, "-inf"), short(size, "inf"), short(size / 2 / np.pi, "inf"), short(loop.damping[k])])
        if z is not None:
            side = f" +- {abs(z[k].imag):.4g}i" if s.imag > 0 and abs(z[k].imag) > 1e-12 else ""
            rows[-1].append(f"{z[k].real:.4g}{side}" if abs(z[k]) > 1e-3 else "0, but for rounding")
    out = [f"{kinds}: {state}, {count} poles, fastest growth {short(loop.growth)} 1/s{often}", ""]
    out += aligned(rows, range(5))
    out += [f"... and {len(shown) - _ROWS} more, which fall faster"] if shown[_ROWS:] else []
    if loop.channels and loop.stable:
        out += ["", *margins_table(loop.margins)]
        out += [str(loop.robustness)] if np.isfinite(loop.robustness.value) else []
    elif loop.channels:
        out += ["", str(loop.limits())]
    return out


def _indices(field: str, given: Any, labels: Sequence[str]) -> list[int]:
    """Indices of inputs or outputs."""
    found = []
    for entry in given if isinstance(given, Iterable) and not isinstance(given, str) else [given]:
        if isinstance(entry, str):
            choice(field, entry, labels)
            found.append(labels.index(entry))
        elif 0 <= whole(field, entry) < len(labels):
            found.append(int(entry))
        else:
            named = ", ".join(labels)
            raise ValueError(f"{field} = {entry!r}: must be from 0 to {len(labels) - 1}, or a label: {named}")
    return found


def _system(hybrid: Hybrid, inputs: Any, outputs: Any, locked: NDArray[np.bool_]) -> tuple[Any, ...]:
    """A, B, C, D and the labels of inputs and outputs."""
    plant, arm = hybrid.plant, hybrid.plant.arm
    nv, (drives, forces) = arm.nv, forces_of(arm, plant.q, inputs, locked)
    reads, rows = rows_of(arm, plant.q, plant.v, plant.E, outputs)
    back = np.linalg.pinv(plant.E)
    taps = [Tap(r[:nv] @ back, r[nv : 2 * nv], r[2 * nv :]) for r in rows]
    return (*hybrid.model(forces, taps), drives, reads)


def _hybrid(plant: Plant, controls: Sequence[Controller], t: float, loads: Any) -> Hybrid:
    """The loop of a plant and controllers, linearised at time t."""
    arm, q, v = plant.arm, plant.q, plant.v
    running, sampled, felt = running_laws(arm, controls, np.array([t, t + _MOMENT]), loads)
    held = [held_law(arm, k, c, own, felt, q, v, t, loads, recorded=False)
            for k, (c, own) in enumerate(zip(controls, sampled, strict=True)) if own]  # fmt: skip
    return Hybrid(plant, running, [x for x in held if x is not None], int(felt.sum()))


def closed_loop(
    arm: Arm,
    control: Controller | Sequence[Controller],
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    *,
    inputs: Sequence[Any] | None = None,
    outputs: Sequence[Any] | None = None,
    lock: Iterable[Any] | None = None,
    loads: Sequence[Load] | None = None,
    t: float = 0.0,
) -> ClosedLoop:
    """The linear loop of an arm and its controllers: poles, zeros, modes, margins, root loci.

    Continuous laws are solved with the arm; sampled ones are exact, with hold, delay, and the filters, rates and delays
    of their sensors, by matrix exponentials over the period after which all samples repeat (Åström and
    Wittenmark, Computer-Controlled Systems, 1997). Back-EMF of motors is part of the arm. A callable of `Sampled` is
    linearised by differences about the state; one with memory, as the linear law of up to three past samples that
    fits its answers. Limits, noise, steps of a sensor and dry friction of joints are left out: the joint slides.

    Args:
        arm: the arm.
        control: a controller, or a list of them, as `simulate` takes them.
        q, v: the state: joints stand at q (nq,), `arm.zero` if None, or turn at constant v (nv,), zero if None, with
            the forces that this requires; elastic coordinates are in equilibrium (found from q), as in `arm.trim`.
        inputs, outputs: of the transfer for `zeros`, as of `Arm.linearize`; None: the forces and coordinates
            of all joints that are not locked.
        lock: links, or (link, freedom), whose joints keep to their motion exactly.
        loads, t: external forces and moments, with their values at time t (s), also for laws in Python.

    Returns:
        ClosedLoop: `.poles`, `.zeros`, `.margins`, `.modes`, `.locus(gains)`, `.limits()`, `.shaper()`, `.plot()`.

    Raises:
        ValueError: bad arguments; a controller that acts on a locked joint; gains of wrong shapes; sampling rates that
            have no common period; a law that has no derivative at the state.
    """
    instance("arm", arm, Arm)
    controls = controllers(control)
    q0 = arm._single(q=arm.zero if q is None else q)[0]
    v0 = np.zeros(arm.nv) if v is None else array("v", v, (arm.nv,))
    if v0[elastic_rates(arm)].any():
        raise ValueError("v: must be zero for elastic coordinates: their balance is sought")
    locked, now = locked_rates(arm, lock), number("t", t)
    for k, c in enumerate(controls):
        for i in np.flatnonzero(locked):
            if any(column[i] != 0.0 for column in c._columns(arm)):
                raise ValueError(f"control[{k}]: acts on '{arm.coordinates[i]}', which lock prescribes")
    forces = at_time(arm, loads, now)
    q0 = steady_state(arm, q0, v0, forces) if v0.any() or arm.constrained else trimmed(arm, q0, forces).q
    try:
        plant = Plant(arm, q0, v0, [int(i) for i in np.flatnonzero(locked)], forces)
    except np.linalg.LinAlgError:
        raise ValueError("q: the mass matrix is singular in double precision; no linear model follows") from None
    hybrid = _hybrid(plant, controls, now, loads)
    options = {"q": q, "v": v, "inputs": inputs, "outputs": outputs, "lock": lock, "t": now}
    setup = Setup(arm, {}, tuple(loads or ()), controls)
    return ClosedLoop(setup, hybrid, options, _system(hybrid, inputs, outputs, locked))
