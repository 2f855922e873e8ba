"""PID on a joint's angle."""

from __future__ import annotations

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
