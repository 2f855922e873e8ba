"""Model predictive control: each sample plans the motion over a horizon and applies the first torques, within
limits."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import flexarm._core as _core
from flexarm._core import Feedback, Sampler

from ..._check import (
    Array,
    at_least,
    flag,
    for_each,
    instance,
    not_negative,
    number,
    positive,
    unmasked,
    warn,
    whole,
    within,
)
from ..parts.chain import Chain
from .acts import Acts, acts_from, at_rest, predictable
from .control import Controller, Run, force_columns, listed
from .drive import Motion, Torque, split_drives
from .motor import reach_of
from .sampled import columns_of, is_samples
from .tracked import CallableReference, each, extended_by, projection, rows_of

_STATUS = ("", "a coordinate without inertia", "a stage, or the quadratic program, had no solution",
           "a state that is not finite, or that no arm reaches")  # fmt: skip
_INF = float("inf")


class MPCWarning(UserWarning):
    """Predictive control could not solve a sample and continued with its last plan."""


class MPC(Controller):
    """Model predictive control at a rate (1 kHz and more), in C++.

    It is a real-time iteration (Diehl, Bock, Schlöder 2005).

    At each sample the arm's motion over `horizon` is predicted by implicit steps (L-stable, of order 2) under the plan
    of the sample before, linearised with exact derivatives, and the inputs of least cost within the limits follow from
    one quadratic program (DAQP: Arnström, Bemporad, Axehill 2022). The cost is the integral over the horizon of

        weight (y - r)² + rate_weight (dy/dt - dr/dt)² + effort (u - u_held)² + rate_effort (du/dt)²

    where y are the tracked outputs, r is the reference, u are the joints' torques, and u_held those that hold the arm
    in its position against gravity and other known forces. The law needs the whole state; with sensors, estimate it by
    a
    KalmanFilter and give it to `step`. If a sample cannot be solved, the law warns once (MPCWarning) and continues with
    its last plan, within the limits: `failures` counts these samples.

    Args:
        model: the arm of the prediction: links and joints as the plant's, its own (usually fewer) elastic coordinates;
        None: the controlled arm. Not in files.
        drive, loads, control: (not in files) other actions on the model, as of `simulate`: motions, torques and
            voltages over the horizon; loads; controllers of an inner loop, which are not part of the law itself: give
            them to `simulate` too. Sampled ones must be LinearControllers without sensors; the stages are divided at
            their samples, and their states are predicted. Laws of samples are constant outside these.
        track: the tracked outputs: "joints", all joint coordinates (rad, m); "tip", the three coordinates of the
            last link's end in the world (m); or a list of ("joint", link), ("joint", (link, freedom)), ("tip", link),
            ("tip", link, "x") and ("strain", link, x, "K3"). Ball joints cannot be tracked: use "tip".
        reference: of the tracked outputs: a number, numbers (ny,), samples (t, r), linear in between and constant
            before and after, r (nt,) or (nt, ny); a Motion, or a list of ny of them; or a callable t -> (ny,)
            numbers, or (2, ny) with their rates. It must be known up to the horizon beyond a run's end.
        weight: of (y - r)², one number or (ny,), not negative.
        rate_weight: of the rates', in s²; None: weight times (0.05 s)².
        rate: samples a second (Hz).
        horizon: length of the prediction (s), at least `stages` periods.
        stages: steps over the horizon, the first as long as a period, each next one longer.
        blocks: number of parts of the horizon with constant inputs, short ones first; at most `stages`.
        terminal: time (s) that weights the end of the horizon in the cost; None: a fifth of the horizon.
        inputs: the inputs u: links, (link, freedom), ("patch", link, patch), or arrays (nv,), columns of generalised
            forces per unit of u; None: all joints without prescribed motion, of a ball the three torques in body axes.
        limit: of each |u|, one number or (nu,) (N m, N); None: the `torque_limit` of the joints that u drives, if they
            have one. Neither limit is ever exceeded.
        rate_limit: of each |du/dt|, one number or (nu,); None: no limit. It is never exceeded.
        effort: of u², one number or (nu,); None: 0.001 of the mean weight for the u that moves its joint by 1 rad, or 1
            m, in the horizon, or for its limit, if that is less.
        rate_effort: of (du/dt)², one number or (nu,); None: effort times (20 ms)².
        joint_limit: soft limits (lower, upper) of all joint coordinates except balls, two numbers or two rows (nj,);
            None: no limits.
        speed_limit: soft limit of their speeds, one number or (nj,); None: no limit.
        strain_limit: soft limits of strains: a list of (link, x, strain, most) with strain "K1", "K2", "K3", "phi12",
            "phi13" or "eps" at x metres along the link's beam, and most its largest magnitude (1/m).
        soft: cost of exceeding a soft limit by its own value for a second; None: 100 times the largest weight.
        delay: whether torques act one period after their sample, which leaves time to compute; the motion in between is
            predicted.
        iterations: number of linearisations, with a quadratic program each, in a sample.

    Raises:
        ValueError: bad arguments, by name. At the run: a model that does not match the plant, or has contacts with
            friction, or a controller of `control` that cannot be predicted.
            RuntimeError: flexarm was built without it (FLEXARM_MPC=OFF).
    """

    type = "mpc"

    def __init__(
        self, model: Any = None, *, drive: Any = None, loads: Any = None, control: Any = None, track: Any = "joints",
        reference: Any = 0.0, weight: ArrayLike = 1.0, rate_weight: ArrayLike | None = None, rate: float = 1000.0,
        horizon: float = 0.5, stages: int = 25,
        blocks: int = 12, terminal: float | None = None, inputs: Sequence[Any] | None = None,
        limit: ArrayLike | None = None, rate_limit: ArrayLike | None = None, effort: ArrayLike | None = None,
        rate_effort: ArrayLike | None = None, joint_limit: Any = None, speed_limit: ArrayLike | None = None,
        strain_limit: Sequence[Any] = (), soft: float | None = None, delay: bool = False, iterations: int = 1,
    ) -> None:  # fmt: skip
        if not hasattr(_core, "Mpc"):
            raise RuntimeError("MPC: this flexarm was built without it (FLEXARM_MPC=OFF)")
        self._given_as = {k: v for k, v in locals().items() if k not in ("self", "__class__")}
        self.model = None if model is None else instance("model", model, Chain, "an Arm or None")
        self.reference, self.rate, self.delay = reference, positive("rate", rate), flag("delay", delay)
        self.drive, self.loads, self.control = drive, loads, control
        self.track = track if isinstance(track, str) else listed("track", track)
        if isinstance(track, str) and track not in ("joints", "tip"):
            raise ValueError(f'track = {track!r}: must be "joints", "tip" or a list')
        self.inputs = None if inputs is None else [_entry(x) for x in listed("inputs", inputs)]
        self.horizon, self.stages, self.blocks = positive("horizon", horizon), whole("stages", stages), blocks
        within("stages", stages, 1, 1000)
        within("blocks", whole("blocks", blocks), 1, stages, ", the stages")
        if self.horizon * self.rate < stages * (1 - 1e-9):
            raise ValueError(
                f"horizon = {horizon}: is shorter than {stages} stages of at least a period, {stages / self.rate:g} s"
            )
        self.terminal = 0.2 * self.horizon if terminal is None else not_negative("terminal", terminal, "s")
        self.soft = None if soft is None else positive("soft", soft)
        self.strain_limit = list(strain_limit)
        self.iterations = at_least("iterations", iterations, 1)
        #: number of samples that could not be solved so far, in `step` and in all runs
        self.failures = 0
        self._core: Any = None
        self._failed: Any = None
        self._known: Any = None
        self._led: Any = None
        self._planned = np.zeros(0), np.zeros((0, 0))

    def __getstate__(self) -> dict[str, Any]:
        """Copies start without a plan."""
        return {**self.__dict__, "_core": None, "_failed": None, "_known": None, "_led": None}

    def _arguments(self) -> dict[str, Any]:
        return dict(self._given_as)

    # -- use outside of a run ------------------------------------------------------------------------------------------

    def step(self, t: float, q: ArrayLike, v: ArrayLike) -> Array:
        """Inputs u (nu,) from a state q (nq,), v (nv,) of the model at time t (s): one sample of your own loop.
        Controllers of the model sample from the first t on.

        Raises:
            ValueError: a wrong shape, no `model`, or a law of `control` that is fitted to the times of a run.
        """
        if self.model is None:
            raise ValueError("model = None: `step` needs the arm")
        now = number("t", t)
        if self._core is None:
            known = predictable(acts_from(self.model, now, 1.0 / self.rate, self.drive, self.loads, self.control))
            self._known = known
            unit = projection(self.model, self.model)
            self._core = self._made(self.model, known, unit, np.array(self._columns(self.model)).T, mine=True)
            self._failed = self._failing()
        states = [np.asarray(x, dtype=float) for x in (q, v)]
        for name, x, n in zip("qv", states, (self.model.nq, self.model.nv), strict=True):
            if x.shape != (n,):
                raise ValueError(f"{name} has shape {x.shape}: must be ({n},)")
        status = self._core.feedback(now, *states)
        if status:
            self._failed(t, status)
        u: Array = self._core.u
        self._planned = self._core.block_times, self._core.plan
        self._core.prepare()
        return u

    def reset(self) -> None:
        """Deletes the plan of `step`."""
        self._core = None

    @property
    def plan(self) -> tuple[Array, Array]:
        """The plan of the last `step`: starts of the blocks and end of the horizon (s from the sample), (blocks + 1,),
        and the constant inputs of the blocks, (blocks, nu)."""
        if self._core is None:
            raise ValueError("plan: there is none before `step`")
        return self._planned

    def _failing(self) -> Callable[[float, int], None]:
        """The callback of a run for samples that could not be solved. The core holds it, unseen by the garbage
        collector, and this object holds the core: the callback must not hold this object."""
        first, counter = True, weakref.ref(self)

        def failed(t: float, status: int) -> None:
            nonlocal first
            if (law := counter()) is not None:
                law.failures += 1
            if first:
                first = False
                warn(MPCWarning(
                    f"MPC: the sample at t = {t:.6g} s could not be solved: {_STATUS[status]}; it went on along its "
                    f"last plan. Give more effort, a shorter horizon, more stages or wider limits"
                ))  # fmt: skip

        return failed

    # ------------------------------------------------------------------------------------------------------------------

    def _columns(self, arm: Chain) -> list[Array]:
        given = arm.by_rate("drive", split_drives(arm if self.model is None else self.model, self.drive)[0])
        rates = [i for i in arm.freedoms if not isinstance(given.get(i), Motion)]
        if self.inputs is None and not rates:
            raise ValueError("inputs = None: all joints have a motion in `drive`; name the inputs u")
        return [np.eye(arm.nv)[i] for i in rates] if self.inputs is None else force_columns(arm, self.inputs)

    def _laws(self, arm: Chain, run: Run) -> tuple[list[Feedback], list[Sampler]]:
        model = arm if self.model is None else self.model
        known = predictable(Acts(model, run.times, self.drive, self.loads, self.control))
        columns, pad = np.array(self._columns(arm)).T, ((0, 0), (0, run.total))
        to_q, to_v = (np.pad(x, pad) for x in projection(arm, model))
        law = self._made(arm, known, (to_q, to_v), np.pad(columns, pad[::-1]))
        return [], [Sampler(float(run.times[0]), 1.0 / self.rate, self.delay / self.rate, law)]

    def _made(self, arm: Chain, known: Acts, to_model: tuple[Array, Array], forces: Array, mine: bool = False) -> Any:
        """The core's; `mine`: for `step`, where it holds no function of the user's: they may hold this object."""
        model = known.arm
        model.refuse_rubbing("MPC: model")
        model.refuse_loops("MPC: model")
        columns = np.array(self._columns(model)).T
        nu = columns.shape[1]
        rows = [row for k, entry in enumerate(self._tracked(model)) for row in rows_of(model, f"track[{k}]", entry)]
        weight = each("weight", self._given_as["weight"], len(rows))
        rate_weight = self._given_as["rate_weight"]
        rate_weight = 0.05**2 * weight if rate_weight is None else each("rate_weight", rate_weight, len(rows))
        if not (weight > 0).any():
            raise ValueError("weight: must be positive for at least one tracked output")
        limits = reach_of(arm, forces, each("limit", self._given_as["limit"], nu, above=True))
        effort = self._given_as["effort"]
        if effort is None:
            inertia = np.einsum("ik,ij,jk->k", columns, model.mass_matrix(model.zero), columns)
            moved = 4.0 * inertia / np.maximum(np.sum(columns**2, axis=0), 1e-300) / self.horizon**2
            effort = 1e-3 * weight.mean() / np.minimum(limits, moved) ** 2
        efforts = each("effort", effort, nu)
        rate_effort = self._given_as["rate_effort"]
        rate_efforts = (20e-3) ** 2 * efforts if rate_effort is None else each("rate_effort", rate_effort, nu)
        if not (efforts + rate_efforts > 0).all():
            raise ValueError("effort: effort or rate_effort must be positive, for each input")
        rate_limits = each("rate_limit", self._given_as["rate_limit"], nu, above=True)
        free = (-_INF, _INF, -_INF, _INF)
        outputs = [(*row, w, r, *free) for row, w, r in zip(rows, weight, rate_weight, strict=True)]
        reference = self._reference(len(rows))
        outputs += (limited := self._limited(model))
        if limited:
            reference = extended_by(reference, len(limited))
        if mine and callable(reference):  # of a user's object, perhaps, that has this MPC
            self._led, owner = reference, weakref.ref(self)
            reference = lambda t: owner()._led(t)  # type: ignore[union-attr]  # noqa: E731
        soft = 100.0 * float(weight.max()) if self.soft is None else self.soft
        extra = known.both.nv - model.nv  # states of controllers
        columns = np.pad(columns, ((0, extra), (0, 0)))
        outputs = [(np.pad(by_q, (0, extra)), *rest) for by_q, *rest in outputs]
        problem = known.core_problem(at_rest(model), onward=True, weak=mine)
        of_inputs = [-limits, limits, rate_limits, efforts]
        return _core.Mpc(
            problem, outputs, columns, [*of_inputs, rate_efforts], 1.0 / self.rate,
            self.horizon, self.stages, self.blocks, self.terminal, soft, self.delay, self.iterations, extra, reference,
            *to_model, forces, self._failing(),
        )  # fmt: skip

    def _tracked(self, model: Chain) -> list[Any]:
        if self.track == "joints":
            for k, _ in model.ball_rates():
                raise ValueError(f'track = "joints": link {k} has a ball, without coordinates to be led; take "tip"')
            return [("joint", k) for k in model.movable]
        return [("tip", -1)] if self.track == "tip" else list(self.track)

    def _limited(self, model: Chain) -> list[Any]:
        """Outputs with soft limits."""
        none = (np.zeros(model.nv), None, 0.0, 0.0)
        rates = [i for i in model.freedoms if model.coordinate_of(i) >= 0]
        out: list[Any] = []
        both, speed = self._given_as["joint_limit"], self._given_as["speed_limit"]
        if both is not None or speed is not None:
            lower, upper = np.full(len(rates), -_INF), np.full(len(rates), _INF)
            if both is not None:
                if not isinstance(unmasked("joint_limit", both), (list, tuple, np.ndarray)) or len(both) != 2:
                    raise ValueError(f"joint_limit = {both!r}: must be (lower, upper)")
                lower, upper = (np.broadcast_to(np.asarray(x, dtype=float), (len(rates),)) for x in both)
                if not (lower < upper).all():
                    raise ValueError(f"joint_limit = {both!r}: lower must be below upper")
            speeds = each("speed_limit", speed, len(rates), above=True)
            out += [(np.eye(model.nv)[i], None, 0.0, 0.0, lo, up, -s, s)
                    for i, lo, up, s in zip(rates, lower, upper, speeds, strict=True)]  # fmt: skip
        for k, entry in enumerate(self.strain_limit):
            if not isinstance(entry, (list, tuple)) or len(entry) != 4:
                raise ValueError(f'strain_limit[{k}] = {entry!r}: must be (link, x, "K3", most)')
            row, _ = rows_of(model, f"strain_limit[{k}]", ("strain", *entry[:3]))[0]
            most = positive(f"strain_limit[{k}]: most", entry[3])
            out.append((row, *none[1:], -most, most, -_INF, _INF))
        return out

    def _reference(self, ny: int) -> Any:
        """A polynomial for each tracked output, or a callable t -> (2, ny)."""
        given = self.reference
        if isinstance(given, Motion):
            given = [given]
        if isinstance(given, (list, tuple)) and any(isinstance(m, Motion) for m in given):
            if len(given) != ny or not all(isinstance(m, Motion) for m in given):
                raise ValueError(f"reference: must be {ny} Motions, one for each tracked output")
            motions = list(given)
            if all(isinstance(m.law, _core.PiecewisePolynomial) for m in motions):
                return [m.law for m in motions]
            return lambda t: np.array([m(t)[:2] for m in motions], dtype=float).T
        if is_samples(given) and not callable(given):
            return [law.law for law in columns_of(given[0], given[1], ny)]
        if callable(given):
            return CallableReference(given, ny)
        return [Torque(float(r)).law for r in for_each("reference", given, ny, "tracked")]


def _entry(given: Any) -> Any:
    """An entry from a file (lists become tuples), or unchanged."""
    names = isinstance(given, list) and (given[:1] == ["patch"] or len(given) == 2)
    return tuple(given) if names else given
