"""An extended, iterated Kalman filter on an implicit step: states, payload and joint friction from sensors, online."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import flexarm._core as _core

from .._check import Array, array, for_each, increasing, instance, instances, number, positive, unmasked, warn
from .._console import progress_bar
from ..analysis.rates import elastic_rates
from ..arm.arm import Arm
from ..model.acting.acts import acts_from, at_rest
from ..model.acting.control import padded
from ..model.parts.part import ModelWarning
from ..run.sensing.reading import Reading
from ..run.sensing.sensor import Sensor
from .estimate import Estimate
from .rows import sensor_rows, unknowns

_STATUS = ("", "the mass matrix is singular", "a step has no solution", "the estimate ran away")
_WINDOW = 500  # readings over which innovations are tested
_BEYOND = 6.0  # standard deviations of a normal distribution: one window in 1e9
_LEARNT = 0.95  # of a parameter's first standard deviation: above it readings have not determined it


class FilterWarning(UserWarning):
    """A Kalman filter whose readings contradict its model, or do not determine a parameter."""


class KalmanFilter:
    """An extended Kalman filter on the arm's own model: implicit steps of order 4, exact derivatives.

    Where places are read, its update is repeated about the place to which it leads (the iterated filter).

    It estimates coordinates q and rates v from applied forces and sensors' readings, and with them the unknown
    constants that `estimate` names:

    =============  ===================================================================================================
    payload        mass (kg) of a point at the last link's end, beyond the arm's own
    damping.LINK   viscous friction of a joint (N m s/rad; N s/m), beyond the arm's own
    coulomb.LINK   Coulomb friction of a joint (N m; N), beyond the arm's own
    offset.LINK    a constant force in a joint (N m; N)
    gain.LINK      the force in a joint is 1 + gain times tau
    =============  ===================================================================================================

    LINK is a number from 0, or LINK.FREEDOM if a joint has several. The covariance is kept as a square root
    (Potter 1963; Schmidt 1970), so that rounding never makes it indefinite. A prediction includes the product of the
    errors of the payload and of the acceleration. Dry friction, the arm's own as well, is
    c v / sqrt(v^2 + friction_speed^2), without stiction. Call `update` with the readings of a time, if any, before
    `predict`: `update`, `predict`, `update`, ... `flexarm/kalman.hpp` is the same for C++, without allocation.

    Errors of a ball are rotation vectors in body axes (the multiplicative filter: Lefferts, Markley, Shuster 1982). The
    actions of `drive`, `loads` and `control` are known functions of time; the clock starts at `t`.

    Args:
        arm: the arm; its contacts without friction.
        sensors: Encoder, Tachometer, StrainGauge, or Camera (axes="world"). The variance of each is noise^2 + step^2 /
            12, with its `noise` and the step of its resolution or pulses. Its `gain` and `offset` are used; a `filter`
            adds one or two states to the model, a `delay` one for each step that it lasts (100 at most): readings are
            given as they come. Readings at its `range` or beyond are ignored.
        step: time from one prediction to the next (s).
        force_noise: two-sided density (N m/sqrt(Hz); N/sqrt(Hz)) of white forces that the model lacks: one number, for
            joints only, or one for each rate, (nv,). The mean of such a force over a time T has the
            standard deviation force_noise / sqrt(T). (A one-sided density n, as of a LowPass and in data sheets, is
            n / sqrt(2) here.) With a larger value, readings weigh more and the model less.
        estimate: by name of a parameter (start, its standard deviation).
        drift: by name of a parameter, its random walk in a second (unit/sqrt(s)); 0 if not named.
        drive, loads, control: as of `simulate`, actions beside the forces given to `predict`. Prescribed joints are
            known without error. Controllers must be continuous: their laws act in the model at the estimate. Give the
            held forces of sampled ones to `predict`. Sampled laws are constant outside their samples.
        t: time at the start (s), for functions of time.
        q, v: the state at the start, (nq,) and (nv,); `arm.zero` and zero if None.
        q_std, v_std: their standard deviations, a number or (nv,); of a ball those of its rotation (rad).
        friction_speed: rate (rad/s; m/s) above which Coulomb friction is about constant.

    Raises:
        ValueError: naming the field and the value.

    Warns:
        ModelWarning: the arm's own joints have dry friction, whose sticking the filter does not model.
    """

    def __init__(
        self,
        arm: Arm,
        sensors: Sequence[Sensor],
        step: float,
        *,
        force_noise: ArrayLike,
        q_std: ArrayLike,
        v_std: ArrayLike,
        estimate: Mapping[str, tuple[float, float]] | None = None,
        drift: Mapping[str, float] | None = None,
        q: ArrayLike | None = None,
        v: ArrayLike | None = None,
        drive: Any = None,
        loads: Any = None,
        control: Any = None,
        t: float = 0.0,
        friction_speed: float = 0.01,
    ) -> None:
        instance("arm", arm, Arm).refuse_rubbing("KalmanFilter: arm")
        arm.refuse_loops("KalmanFilter: arm")
        self.arm, self.step = arm, positive("step", step, "s")
        self.sensors: tuple[Sensor, ...] = instances("sensors", sensors, Sensor, "sensors", 1)
        labels, rows, ranges = [], [], []
        for k, sensor in enumerate(self.sensors):
            try:
                rows += sensor_rows(arm, sensor, self.step)
            except ValueError as e:
                raise ValueError(f"sensors[{k}]: {e}") from None
            parts = [label for label, _ in sensor.components(arm)]
            labels += [f"{sensor.title(arm)}, {part}" for part in parts]
            ranges += list(sensor._each("range", len(parts), np.inf))
        #: labels of the k readings, in the order of the sensors and their components
        self.labels: tuple[str, ...] = tuple(labels)
        self._range = np.array(ranges)
        self._names, parameters = unknowns(arm, {} if estimate is None else estimate, {} if drift is None else drift)
        noise = _each("force_noise", force_noise, arm.nv)
        if np.ndim(force_noise) == 0:
            noise[elastic_rates(arm)] = 0.0
        speed = number("friction_speed", friction_speed)
        begin = number("t", t)
        self._known = begin, self.step, drive, loads, control
        self._acts = acts_from(arm, *self._known)
        if self._acts.sampled:
            raise ValueError("control: one of them samples; its forces are held: give them to `predict`, or to `run`")
        self._size = nq, nv = self._acts.both.nq, self._acts.both.nv  # with the states of controllers
        rows = [(padded(by_q, nv), padded(by_v, nv), *rest) for by_q, by_v, *rest in rows]
        self._made = self.step, rows, parameters, padded(noise, nv), speed
        self._core: _core.KalmanFilter = self._make()
        self._start: list[Any] = [
            padded(arm._place("q", q), nq),
            padded(array("v", np.zeros(arm.nv) if v is None else v, (arm.nv,)), nv),
            padded(_each("q_std", q_std, arm.nv), nv),
            padded(_each("v_std", v_std, arm.nv), nv),
            begin,
        ]
        for i, motion in self._acts.motions.items():
            at = motion(begin)
            self._start[0][arm.coordinate_of(i)], self._start[1][i] = at[0], at[1]
        self.reset()
        links = zip(arm.joint_names, arm.links, strict=True)
        rubs = [name for name, link in links if link.joint.rubs]
        if rubs:
            warn(ModelWarning(
                f"dry friction of {', '.join(map(repr, rubs))}: where it holds a joint still, the filter's creeps: its "
                f"friction is smooth, without stiction. Readings must hold it there: give each such joint a sensor, "
                f"and a force_noise that allows for its friction"
            ))  # fmt: skip

    def _make(self) -> _core.KalmanFilter:
        return _core.KalmanFilter(self._acts.core_problem(at_rest(self.arm), onward=True, weak=True), *self._made)

    def __getstate__(self) -> dict[str, Any]:
        """Copies continue from the present state."""
        own = {"_acts": None, "_core": self._core.state(), "_tested": self._tested.copy(), "_sums": self._sums.copy()}
        return {**self.__dict__, **own}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._acts = acts_from(self.arm, *self._known)
        self._core = self._make()
        self._core.resume(state["_core"])

    def reset(self) -> None:
        """Resets the filter to its start."""
        self._core.start(*self._start)
        self._tested: deque[tuple[float, int]] = deque()
        self._sums = [0.0, 0]
        self._warned = False

    # -- a cycle -------------------------------------------------------------------------------------------------------

    def update(self, readings: ArrayLike) -> None:
        """Updates the estimate with readings (k,) of the present time, in the order of `labels`; nan without a reading.

        Raises:
            ValueError: a wrong shape. RuntimeError: the estimate is not finite.

        Warns:
            FilterWarning: once, if the latest 500 readings are further from their predictions than the filter's noises
                allow (a chi-square test of `nis`).
        """
        y = self._readings(readings, 1)
        self._check(self._core.update(y))
        self._test(self.nis, self.used)

    def predict(self, tau: ArrayLike | None = None) -> None:
        """Predicts over one `step` with constant forces tau (nv,), added to the filter's known actions; zero if None.

        Raises:
            ValueError: a wrong shape. RuntimeError: the step has no solution; the estimate is as it was.
        """
        forces = np.zeros(self.arm.nv) if tau is None else array("tau", tau, (self.arm.nv,))
        self._check(self._core.predict(padded(forces, self._size[1])))

    def run(
        self, t: ArrayLike, tau: ArrayLike | None, readings: ArrayLike | Sequence[Reading], *, progress: Any = False
    ) -> Estimate:
        """Runs the filter over recorded data from its present state: readings at t[0], a prediction to t[1], ...

        Args:
            t: times (s), (nt,), `step` apart. With functions of time, the first is the filter's present time.
            tau: constant forces from each time to the next, beside known actions, (nt, nv); None: none.
            readings: at the times, (nt, k), nan without a reading; or a Reading of each sensor, which may be sampled
                less often.
            progress: shows a bar on stderr, or lines where that is no terminal; or a callable, which is given the share
                of the rows that is done.

        Raises:
            ValueError: bad shapes or times. RuntimeError: a step has no solution.

        Warns:
            FilterWarning: as `update`; or readings do not determine a parameter.
        """
        times = increasing("t", t)
        if np.abs(np.diff(times) / self.step - 1).max() > 1e-3:
            raise ValueError(f"t: must increase in steps of {self.step:g} s, the filter's step")
        if self._acts.drives or self._acts.forces or self._acts.feedback:
            if abs(times[0] - self._core.t) > 1e-3 * self.step:
                raise ValueError(f"t[0] = {times[0]:g}: the filter is at {self._core.t:g} s; give it `t` at the start")
        none = np.zeros((times.size, self.arm.nv))
        forces = none if tau is None else array("tau", tau, none.shape)
        extra = self._size[1] - self.arm.nv
        y = self._readings(self._sampled(times, readings), 2)
        if len(y) != times.size:
            raise ValueError(f"readings has {len(y)} rows: must have {times.size}, one for each of t")
        first = self._core.deviations
        with progress_bar(progress, "filtering") as look:
            found = self._core.run(np.pad(forces, ((0, 0), (0, extra))), y, len(self.arm.links), look)
        done = len(found["q"])
        for nis, used in zip(found["nis"], found["used"], strict=True):
            self._test(nis, used)
        self._check(found["status"], f" at t = {times[min(done, times.size - 1)]:g} s")
        n, m, all_of, std = self.arm.nv, len(self._names), self._size[1], found["std"]
        for k, name in enumerate(self._names, 2 * all_of):
            if first[k] > 0 and std[-1, k] > _LEARNT * first[k]:
                warn(FilterWarning(
                    f"{name}: the readings have told nothing of it; its standard deviation is still "
                    f"{std[-1, k]:.3g}. Move the arm so that it matters, add a sensor, or leave it out"
                ))  # fmt: skip
        return Estimate(
            times, found["q"][:, : self.arm.nq], found["v"][:, :n], std[:, :n], std[:, all_of : all_of + n],
            {name: found["p"][:, k] for k, name in enumerate(self._names)},
            {name: std[:, 2 * all_of + k] for k, name in enumerate(self._names[:m])},
            found["tip"], found["tip_std"], found["innovations"], found["innovation_std"],
            found["nis"], found["used"], self.labels,
        )  # fmt: skip

    # -- the present estimate ------------------------------------------------------------------------------------------

    @property
    def q(self) -> Array:
        """Coordinates, (nq,)."""
        return self._core.q[: self.arm.nq]

    @property
    def v(self) -> Array:
        """Rates, (nv,)."""
        return self._core.v[: self.arm.nv]

    @property
    def t(self) -> float:
        """Present time (s)."""
        return self._core.t

    @property
    def parameters(self) -> dict[str, float]:
        """Values of the parameters, by name."""
        return dict(zip(self._names, self._core.p.tolist(), strict=True))

    @property
    def covariance(self) -> Array:
        """Covariance of [q; v; parameters], (2 nv + m, 2 nv + m); of q in terms of rates: of a ball, its rotation."""
        n, all_of = self.arm.nv, self._size[1]
        rows = [*range(n), *range(all_of, all_of + n), *range(2 * all_of, 2 * all_of + len(self._names))]
        root = self._core.root[rows]
        return np.asarray(root @ root.T)

    @property
    def q_std(self) -> Array:
        """Standard deviations of q, (nv,)."""
        return self._core.deviations[: self.arm.nv]

    @property
    def v_std(self) -> Array:
        """Standard deviations of v, (nv,)."""
        return self._core.deviations[self._size[1] :][: self.arm.nv]

    @property
    def parameter_std(self) -> dict[str, float]:
        """Standard deviations of the parameters, by name."""
        return dict(zip(self._names, self._core.deviations[2 * self._size[1] :].tolist(), strict=False))

    def tip(self, link: int | str = -1, x: float | None = None) -> tuple[Array, Array]:
        """Position (3,) of a link's end, or of a slice at x metres of its beam, in the world (m), and its covariance
        (3, 3) (m^2)."""
        return self._core.place(self.arm._link(link), None if x is None else number("x", x))

    @property
    def innovation(self) -> Array:
        """Readings of the last update less their predictions, each given the readings before it, (k,); nan without a
        reading."""
        return self._core.innovations

    @property
    def innovation_std(self) -> Array:
        """Predicted standard deviations of the innovations of the last update, (k,)."""
        return self._core.innovation_std

    @property
    def nis(self) -> float:
        """Sum of squares of the last update's innovations over their standard deviations (NIS). It is chi-square
        distributed with `used` degrees of freedom if model and noises are right."""
        return self._core.nis

    @property
    def used(self) -> int:
        """Number of readings of the last update."""
        return self._core.used

    @property
    def consistency(self) -> float:
        """NIS over the number of readings, for the latest 500 readings: about 1 if model and noises are right."""
        return self._sums[0] / self._sums[1] if self._sums[1] else np.nan

    # ------------------------------------------------------------------------------------------------------------------

    def _check(self, status: int, when: str = "") -> None:
        if status:
            told = "".join(f", {k} = {x:.4g}" for k, x in self.parameters.items())
            raise RuntimeError(
                f"the filter cannot go on{when}: {_STATUS[status]}{told}; give smaller standard deviations at the "
                f"start, more force_noise, or a shorter step"
            )

    def _test(self, nis: float, used: int) -> None:
        if not used:
            return
        self._tested.append((nis, used))
        self._sums[0] += nis
        self._sums[1] += used
        while self._sums[1] - self._tested[0][1] >= _WINDOW:
            old, count = self._tested.popleft()
            self._sums[0] -= old
            self._sums[1] -= count
        n = self._sums[1]
        spread = 2 / (9 * n)
        most = (1 - spread + _BEYOND * spread**0.5) ** 3  # chi-square's quantile over n, by Wilson and Hilferty
        if n >= _WINDOW and not self._warned and self.consistency > most:
            self._warned = True
            warn(FilterWarning(
                f"the latest {n} readings are {self.consistency ** 0.5:.3g} times as far from their predictions as the "
                f"filter's noises allow (rms): the model is wrong, or force_noise or a sensor's noise is too small; "
                f"its standard deviations are not to be believed"
            ))  # fmt: skip

    def _readings(self, readings: ArrayLike, ndim: int) -> Array:
        unmasked("readings", readings)
        try:
            y = np.array(readings, dtype=float)
        except (TypeError, ValueError):
            raise ValueError("readings: must be numbers, or nan where there is none") from None
        if y.ndim != ndim or y.shape[-1] != len(self.labels):
            shape = f"({len(self.labels)},)" if ndim == 1 else f"(nt, {len(self.labels)})"
            raise ValueError(f"readings has shape {y.shape}: must be {shape}: {'; '.join(self.labels)}")
        y[~(np.abs(y) < self._range)] = np.nan
        return y

    def _sampled(self, t: Array, readings: Any) -> Any:
        """Rows of readings that were sampled at some of the times; nan elsewhere."""
        if not (isinstance(readings, (list, tuple)) and readings and isinstance(readings[0], Reading)):
            return readings
        if len(readings) != len(self.sensors):
            raise ValueError(f"readings: are {len(readings)}, must be {len(self.sensors)}, one of each sensor")
        columns = []
        for k, reading in enumerate(readings):
            rows = np.full((t.size, reading.y.shape[1]), np.nan)
            at = (reading.t - t[0]) / self.step
            whole = np.round(at).astype(int)
            if np.abs(at - whole).max(initial=0.0) > 1e-3:
                raise ValueError(f"readings[{k}].t: must be times of t; have a rate that divides {1 / self.step:g} Hz")
            inside = (whole >= 0) & (whole < t.size)
            rows[whole[inside]] = reading.y[inside]
            columns.append(rows)
        return np.hstack(columns)


def _each(field: str, value: ArrayLike, count: int) -> Array:
    given = for_each(field, value, count, "rate")
    if (given < 0).any():
        raise ValueError(f"{field} = {value!r}: must not be negative")
    return given.copy()
