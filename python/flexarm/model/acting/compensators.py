"""Linear controllers of a few numbers: PID, positive position feedback, integral resonant control."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi
from typing import Any

import flexarm._core as _core

from ..._check import finite_number, positive
from .motor import Motor
from .sampled import LinearController, as_floats


class PID(LinearController):
    """PID on a joint's angle: u = kp e + ki int e dt + kd de/dt, with e = reference - q. Sampled by Tustin's rule, or,
    without a rate, continuous.

    Args:
        kp, ki, kd: gains, per rad (m), per rad s and per rad/s; of a torque (N m, N), or of the motor's current or
            voltage.
        link: the joint, or (link, freedom).
        rate: samples a second (Hz); None: continuous.
        reference: of q (rad, m): a number, samples (t, r), linear in between, or a callable t -> r.
        filter_time: time constant of the low pass before the derivative (s); None: two samples. It delays the
            derivative: gains that are stable with a measured rate, as of PD, may be unstable here.
        delay: time from a sample to its force (s); needs a rate.
        limit: of |u|; None: the motor's.
        motor: converts u to a torque; None: u is the torque.
        tracking_time: time constant (s) that unwinds the integral while u is at its limit (back-calculation; Astrom &
            Hagglund 2006): usually between kd/kp and kp/ki, at least a sample. None: no anti-windup.
    """

    type = "pid"
    rebuilt = True

    def __init__(
        self, kp: float, ki: float, kd: float, link: Any = -1, *, rate: float | None = None, reference: Any = 0.0,
        filter_time: float | None = None, delay: float = 0.0, limit: float | None = None, motor: Motor | None = None,
        tracking_time: float | None = None,
    ) -> None:  # fmt: skip
        link = tuple(link) if isinstance(link, list) else link  # (link, freedom) from a file
        kp, ki, kd = finite_number("kp", kp), finite_number("ki", ki), finite_number("kd", kd)
        tf = None if filter_time is None else positive("filter_time", filter_time)
        led_back = None if tracking_time is None else positive("tracking_time", tracking_time)
        rate, delay, limit = as_floats(rate, delay, limit)
        *system, windup = _core.pid(kp, ki, kd, tf, led_back, None if rate is None else 1.0 / rate)
        given = {"rate": rate, "reference": reference, "delay": delay, "limit": limit, "motor": motor}
        super().__init__(tuple(system), measure=[("joint", link)], actuate=[link], anti_windup=windup, **given)
        own = {"kp": kp, "ki": ki, "kd": kd, "link": link, "filter_time": tf, "tracking_time": led_back}
        self._given_as = {**own, **given}


LinearController.pid = PID


class _Resonant(LinearController):
    """The base of PPF and IRC: one measurement, one force, and a constant reference."""

    rebuilt = True

    def _make(self, own: dict[str, float], system: tuple[Any, ...], **given: Any) -> None:
        """`own`: arguments that the other controllers lack."""
        for name in ("measure", "actuate"):
            if not isinstance(given[name], (list, tuple)) or len(given[name]) != 1:
                raise ValueError(f"{name} = {given[name]!r}: must be a list of one entry")
        LinearController.__init__(self, system, **given)
        self._given_as = {**own, **given, "measure": self.measure, "actuate": self.actuate}


class PPF(_Resonant):
    """Positive position feedback: u = gain w² / (s² + 2 zeta w s + w²) (y - reference), with positive sign (Fanson &
    Caughey, AIAA Journal 28, 1990). Use one for each mode; several add up.

    If y is collocated with u (the strain or voltage of a patch beside the actuating one, a joint's angle and its
    torque) it is stable for any modes if gain times the static y by u is below 1. `fa.ppf` chooses such a gain.

    Args:
        frequency: w of the filter (rad/s), near the mode's.
        damping_ratio: zeta of the filter; 0.3 to 0.7 are usual.
        gain: u per unit of y; its sign is that of the static y by u.
        measure: a list of one entry, as of Sampled, such as [("strain", 0, 0.0, "K3")].
        actuate: a list of one entry, as of Sampled.
        rate: samples a second (Hz), by Tustin's rule with its peak at w; None: continuous.
        reference: of y, such as its value in static equilibrium.
        delay, limit, motor: as of LinearController.
    """

    type = "ppf"

    def __init__(
        self, frequency: float, damping_ratio: float, gain: float, *, measure: Sequence[Any],
        actuate: Sequence[Any] = (-1,), rate: float | None = None, reference: float = 0.0, delay: float = 0.0,
        limit: float | None = None, motor: Motor | None = None,
    ) -> None:  # fmt: skip
        w, zeta = positive("frequency", frequency), positive("damping_ratio", damping_ratio)
        g = finite_number("gain", gain)
        rate, delay, limit = as_floats(rate, delay, limit)
        if rate is not None and w / rate >= pi:
            raise ValueError(f"rate = {rate:.10g}: must be above {w / pi:.6g} Hz, twice the filter's frequency")
        system = _core.positive_position(w, zeta, g, None if rate is None else 1.0 / rate)[:4]
        self.frequency, self.damping_ratio, self.gain = w, zeta, g
        own = {"frequency": w, "damping_ratio": zeta, "gain": g}
        self._make(own, system, rate=rate, reference=reference, measure=measure, actuate=actuate, delay=delay,
                   limit=limit, motor=motor)  # fmt: skip


class IRC(_Resonant):
    """Integral resonant control (Aphale, Fleming & Moheimani, Smart Materials and Structures 16, 2007): integral of the
    measurement less `feedthrough` times u, u' = gain (y - reference - feedthrough u). It damps several modes at
    once.

    If y is collocated with u it is stable if `feedthrough` has the sign of the static y by u and is larger. `fa.irc`
    chooses it.

    Args:
        gain: u per unit of y and second; its sign is that of the static y by u.
        feedthrough: y per unit of u, which swaps the poles and zeros of the arm.
        measure, actuate: lists of one entry, as of Sampled.
        rate: samples a second (Hz), by Tustin's rule; None: continuous.
        reference: of y, such as its value in static equilibrium.
        delay, limit, motor: as of LinearController.
    """

    type = "irc"

    def __init__(
        self, gain: float, feedthrough: float, *, measure: Sequence[Any], actuate: Sequence[Any] = (-1,),
        rate: float | None = None, reference: float = 0.0, delay: float = 0.0, limit: float | None = None,
        motor: Motor | None = None,
    ) -> None:  # fmt: skip
        k, d = finite_number("gain", gain), finite_number("feedthrough", feedthrough)
        rate, delay, limit = as_floats(rate, delay, limit)
        self.gain, self.feedthrough = k, d
        own, system = {"gain": k, "feedthrough": d}, _core.integral_resonant(k, d)[:4]
        self._make(own, system, rate=rate, reference=reference, measure=measure, actuate=actuate, delay=delay,
                   limit=limit, motor=motor)  # fmt: skip


LinearController.ppf = PPF
LinearController.irc = IRC
