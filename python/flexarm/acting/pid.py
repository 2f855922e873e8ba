"""PID on a joint's angle."""

from __future__ import annotations

from typing import Any

import numpy as np

from .._check import Array
from .motor import Motor, finite, positive
from .sampled import LinearController


class PID(LinearController):
    """PID on a joint's angle: u = kp e + ki int e dt + kd de/dt, with e = reference - q. Sampled by Tustin's rule, or,
    without a rate, continuous.

    Args:
        kp, ki, kd: gains, per rad (m), per rad s and per rad/s; of a torque (N m, N), or of the motor's current or
            voltage.
        link: which joint, or (link, freedom).
        rate: samples a second (Hz); None: continuous.
        reference: of q (rad, m): a number, samples (t, r) with straight lines between, or a callable t -> r.
        filter_time: of the low pass ahead of the derivative (s); None: two samples.
        delay: from a sample to its force (s); needs a rate.
        limit: u is kept within -limit .. limit; None: the motor's.
        motor: turns u into a torque; None: u is the torque.
        tracking_time: s, how fast the integral is led back while u is at its limit (back-calculation; Astrom & Hagglund
            2006): between kd/kp and kp/ki is usual, at least a sample. None: the integral winds up.
    """

    type = "pid"
    rebuilt = True

    def __init__(
        self, kp: float, ki: float, kd: float, link: Any = -1, *, rate: float | None = None, reference: Any = 0.0,
        filter_time: float | None = None, delay: float = 0.0, limit: float | None = None, motor: Motor | None = None,
        tracking_time: float | None = None,
    ) -> None:  # fmt: skip
        link = tuple(link) if isinstance(link, list) else link  # (link, freedom) in a file
        kp, ki, kd = finite("kp", kp), finite("ki", ki), finite("kd", kd)
        self._given_as = {"kp": kp, "ki": ki, "kd": kd, "link": link, "rate": rate, "reference": reference,
                          "filter_time": filter_time, "delay": delay, "limit": limit, "motor": motor,
                          "tracking_time": tracking_time}  # fmt: skip
        if rate is None and filter_time is None:
            raise ValueError(
                "filter_time = None: a continuous PID needs the time constant of its derivative's low pass"
            )
        tf = 2.0 / positive("rate", rate) if filter_time is None else positive("filter_time", filter_time)
        # states: integral of e; low-passed e
        A = np.array([[0.0, 0.0], [0.0, -1.0 / tf]])
        B = np.array([[1.0], [1.0 / tf]])
        C = np.array([[ki, -kd / tf]])
        D = np.array([[kp + kd / tf]])
        super().__init__(
            (A, B, C, D), rate=rate, measure=[("joint", link)], actuate=[link], reference=reference, delay=delay,
            limit=limit, motor=motor, anti_windup=_tracking(tracking_time, ki, rate),
        )  # fmt: skip

    def _arguments(self) -> dict[str, Any]:
        return self._given_as


LinearController.pid = PID


def _tracking(time: Any, ki: float, rate: float | None) -> Array | None:
    """What back-calculation does to the states of a PID."""
    if time is None:
        return None
    least = 0.0 if rate is None else 1.0 / rate
    if positive("tracking_time", time) < least:
        raise ValueError(f"tracking_time = {time}: must be at least a sample, {least:g} s")
    if ki == 0.0:
        raise ValueError("tracking_time: there is no integral to lead back; ki is zero")
    return np.array([[1.0 / (ki * time)], [0.0]])
