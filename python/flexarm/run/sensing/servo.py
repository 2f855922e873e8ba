"""A drive as it is built: the position loop of a joint, with its encoder, sampling, limits and current loop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import pi
from typing import Any

import numpy as np

import flexarm._core as _core
from flexarm._core import Feedback, Sampler

from ..._check import Array, finite_number, instance, positive
from ...model.acting.computed import FeedForward
from ...model.acting.control import Run, all_joints, gain_of
from ...model.acting.drive import Motion, Torque
from ...model.acting.following import led, led_by, scalar_law, scaled
from ...model.acting.motor import Motor
from ...model.acting.sampled import LinearController, as_floats, together
from ...model.parts.chain import Chain
from .lowpass import LowPass, as_low_pass
from .sensor import Sensor
from .sensors import Encoder

_COMPUTED = ("gravity", "motion")
_STAYS = 1e4  # s for which the last torques of a move stay


class Servo(LinearController):
    """A drive as it is built: the position loop of a joint, from its encoder to its current.

    u = kp (r - y) + ki int (r - y) dt + kv (r' - v) + feedforward. A sample reads the encoder's y in its steps; v is
    the difference of the last two readings over the time between them, behind a low pass. The integral does not wind
    up at a limit. It is a sampled linear law, which runs in C++.

    Args:
        link: the joint, or (link, freedom).
        kp, kv, ki: gains, per rad (m), rad/s and rad s; of a torque (N m, N), or of the motor's current or voltage.
        rate: samples a second (Hz).
        sensor: its encoder, on this joint unless it names another link; None: an angle without steps.
        filter: low pass of v: a cut-off (Hz) for one of the first order, or a LowPass; None: no filter.
        delay: time from a sample to its force (s).
        limit: of |u|; None: the motor's. The joint's `torque_limit` holds besides.
        reference: r (rad, m): a number, samples (t, r), linear in between, a callable t -> r, or a Motion.
        reference_rate: r', likewise; None: the rate of a Motion, else zero.
        feedforward: an added torque (N m, N): a number, samples (t, tau), a callable or a Torque; a Move of
            `plan_move`, for its torques; "gravity": the torque that holds the arm where the references of all its
            servos are, its other joints at zero, or "motion": the one that these references need with their
            accelerations, as of FeedForward; None: nothing.
        current_loop: bandwidth (Hz) of the current loop, with which the torque follows u (first order); None: at once.
        motor: converts u to a torque; None: u is the torque.
        tracking_time: time constant (s) that unwinds the integral while u is at a limit (back-calculation; Astrom &
            Hagglund 2006); None: sqrt(kv / ki), without kv kp / ki, and at least a sample.
    """

    type = "servo"
    rebuilt = True
    link: Any
    current_loop: float | None
    reference_rate: Torque | None
    feedforward: str | Torque | None

    def __init__(
        self, link: int | str | Sequence[Any] = -1, *, kp: float, kv: float, ki: float = 0.0, rate: float,
        sensor: Sensor | None = None, filter: LowPass | float | None = None, delay: float = 0.0,
        limit: float | None = None, reference: Any = 0.0, reference_rate: Any = None, feedforward: Any = None,
        current_loop: float | None = None, motor: Motor | None = None, tracking_time: float | None = None,
    ) -> None:  # fmt: skip
        at: Any = tuple(link) if isinstance(link, list) else link  # (link, freedom) from a file
        kp, kv, ki = finite_number("kp", kp), finite_number("kv", kv), finite_number("ki", ki)
        low = None if filter is None else as_low_pass("filter", filter)
        cut, ratio = (None, None) if low is None else (low.frequency, low.damping_ratio)
        lag = None if current_loop is None else positive("current_loop", current_loop, "Hz")
        back = None if tracking_time is None else positive("tracking_time", tracking_time)
        samples, delay, limit = as_floats(positive("rate", rate, "Hz"), delay, limit)
        r, its_rate = led_by(reference, reference_rate)
        if sensor is not None and instance("sensor", sensor, Encoder).link == -1:
            place = dict(zip(("link", "freedom"), at if isinstance(at, tuple) else (at,), strict=False))
            sensor = replace(sensor, **place)
        *system, windup, start = _core.servo(kp, kv, ki, cut, ratio, back, 1.0 / positive("rate", rate))
        super().__init__(
            *system, rate=samples, measure=[("joint", at) if sensor is None else sensor], actuate=[at], delay=delay,
            limit=limit, motor=motor, anti_windup=windup,
        )  # fmt: skip
        forward = _forward(feedforward, at)
        self.start, self.memory, self.of_arm = start, int(lag is not None), isinstance(forward, str)
        self._given_as = {
            "link": at, "kp": kp, "kv": kv, "ki": ki, "rate": samples, "sensor": sensor, "filter": low, "delay": delay,
            "limit": limit, "reference": r, "reference_rate": its_rate, "feedforward": forward,
            "current_loop": lag, "motor": motor, "tracking_time": back,
        }  # fmt: skip
        vars(self).update(self._given_as, limit=self.limit)

    def _takes(self) -> Array:
        return np.array([[1.0], [1.0], [0.0], [0.0]])  # e is r - y, -y, r', and the feedforward

    def _reader(self, arm: Chain, loads: Any, opened: list[Any]) -> Any:
        read = super()._reader(arm, loads, opened)
        return lambda t, q, v, a: self._takes() @ read(t, q, v, a)

    def _given(self, arm: Chain, run: Run) -> Any:
        r, rate = self.reference, self.reference_rate
        forward = scaled(self._forward(arm, run), 1.0 / gain_of(self.motor))
        return together([led(r, rate, by_q, by_v, run.times) for by_q, by_v in ((1.0, 0.0), (0.0, 0.0), (0.0, 1.0))]
                        + [forward])  # fmt: skip

    def _forward(self, arm: Chain, run: Run) -> Torque:
        """The torque that is added, over time."""
        word = self.feedforward
        if not isinstance(word, str):
            torque = Torque(0.0) if word is None else word
            torque.check_span("feedforward", run.times)
            return torque
        led_to = {arm.joint_rate(c.link, "link"): c._moved(word) for c in run.controls if isinstance(c, Servo)}
        rates = all_joints(arm)
        laws, _ = FeedForward([led_to.get(i, 0.0) for i in rates], inertia=word == "motion")._laws(arm, run)
        return Torque.of(laws[rates.index(arm.joint_rate(self.link, "link"))].reference)

    def _moved(self, word: str) -> Motion:
        """The reference as a motion."""
        r = self.reference
        if isinstance(r, Motion):
            return r
        if not isinstance(r.law, _core.PiecewisePolynomial) or (word == "motion" and not r.constant):
            kinds = "a Motion or a number" if word == "motion" else "a Motion, a number or samples"
            raise ValueError(f'feedforward = "{word}": the reference must be {kinds}')
        return Motion.of(r.law, r.constant)

    def _columns_of_run(self, columns: Array, arm: Chain, run: Run) -> Array:
        if self.current_loop is None:
            return super()._columns_of_run(columns, arm, run)
        return 2 * pi * self.current_loop * np.eye(arm.nv + run.total)[:, [arm.nv + run.first]]

    def _laws(self, arm: Chain, run: Run) -> tuple[list[Feedback], list[Sampler]]:
        laws, samplers = super()._laws(arm, run)
        if self.current_loop is None:
            return laws, samplers
        state, none = np.eye(arm.nv + run.total)[arm.nv + run.first], np.zeros(arm.nq)
        follows = Feedback(state, none, 2 * pi * self.current_loop * state, None, np.inf)  # x' = w (u - x)
        acts = Feedback(gain_of(self.motor) * self._columns(arm)[0], none, -state, None, np.inf)
        return [*laws, follows, acts], samplers


def _forward(given: Any, link: Any) -> str | Torque | None:
    """The meaning of `feedforward`: a word, or a Torque."""
    if given is None:
        return None
    if isinstance(given, str):
        if given not in _COMPUTED:
            raise ValueError(f'feedforward = {given!r}: must be "gravity", "motion", a torque or a Move')
        return given
    if hasattr(given, "torques") and hasattr(given, "joints"):  # a Move
        column = given.joints.index(given.arm.coordinates[given.arm.joint_rate(link, "link")])
        tau = given.torques[:, column]
        return Torque(np.append(given.t, given.t[-1] + _STAYS), np.append(tau, tau[-1]))
    return scalar_law("feedforward", given)
