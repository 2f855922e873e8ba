"""Whether the steps of a run are right: short enough for the motion, and not far too many."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .._check import Array
from ..analysis.findings import Finding, RunWarning, SlowWarning, StepWarning
from ..analysis.modes import SmallMotions, locked_modes, motions_about, small_motions
from ..arm.arm import Arm
from ..model.parts.beam import STRAINS

_MOST_SWITCHES = 20  # so many switches of one joint within a step of another may be: it turns, or is torn loose again
_FOLLOWED_BY_GAUSS = 1.0  # step times frequency of a mode that the points of Radau keep, to 1e-6 in a step
_DAMPED_BY_GAUSS = 4.0  # and from which on they damp it at once, by 2 % in a step and soon by half
_RINGS = 40.0  # phase (rad) over which a vibration must ring to matter
_MOST_STRUCK = 1.5  # switches times their share of vibration: of 90 drawn runs those below it were right to 4e-4
_FEW_HALVED, _SHARE_HALVED = 30, 0.1  # so many steps, and that share, may be halved: a pulse or a start costs some
_GREAT_GROWTH = 20.0  # logarithm of a growth that makes rounding errors felt
_SURELY_STABLE = 2.0  # step times |s|, up to which rk4 amplifies no motion e^(s t) that decays
FAST_JOINTS = 0.3  # step times rate of a joint: less of it changes the limit of rk4's steps by less than a hundredth
_NEAR_FASTEST = 0.9  # of a run's largest rate: rates that are like it
_STEPS_JUDGED = 1e4  # steps of a run that is done, from which on the modes that they follow are sought
_STEPS_OF_LOOPS = 2e5  # steps of a whole run, from which on loops of control are looked at
_TOO_MANY_STEPS = 2e7  # steps that are too many, whatever they follow
_FAST_MODES = 300.0  # parts of the lowest frequency: faster modes hardly move the arm
_FOLLOWED = (0.003, 20.0)  # step times frequency of a mode that holds the steps down
_DEPARTURE = 0.2  # parts of all that a callable does, from which on a departure counts
_CURVATURE = 3.0  # parts of its change nearby, below which a departure is but curvature


def explicit_limit(
    arm: Arm, step: float, q: Array, held: Sequence[int], v: Array | None = None
) -> tuple[str, float, float]:
    """Words the limit of rk4's steps, of small motions of all rates but those `held`, about rest with the joints as in
    q, or about a motion at rates v; stuck joints are free to slide. And how much the fastest grows by one step, and
    the limit (s). "", 1.0 and inf if these steps are below it."""
    free = np.ones(arm.nv, bool)
    free[list(held)] = False
    if not free.any():
        return "", 1.0, np.inf
    q = np.array(q)
    try:
        bare = arm._alike(arm.links, arm.gravity, loops=[x for x in arm.loops if not x.rigid])  # no slower
        if step * _fastest(motions_about(bare, q, np.zeros(arm.nv) if v is None else v, free=free)) <= _SURELY_STABLE:
            return "", 1.0, np.inf
        if v is None and arm.constrained:
            motions = motions_about(arm._alike(arm.links), q, np.zeros(arm.nv), free=free)
        elif v is None:
            q[[arm.coordinate_of(i) for i in _elastic(arm)]] = 0.0
            motions = small_motions(arm._alike(arm.links), q)
            M, G, K = (X[np.ix_(free, free)] for X in (motions.M, motions.G, motions.K))
            motions = replace(motions, free=free, M=M, G=G, K=K)
        else:
            motions = motions_about(arm._alike(arm.links), q, v, free=free)
        modes = motions.solve()
    except ValueError:
        return "", 1.0, np.inf
    bound = modes.frequencies > 0.0  # all else is not pulled back
    s, shapes = modes.eigenvalues[bound], modes.shapes[:, bound]
    if not s.size:
        return "", 1.0, np.inf
    s, w = np.minimum(s.real, 0.0) + 1j * s.imag, np.abs(s)
    low, high = np.full(s.size, _SURELY_STABLE), np.full(s.size, 4.0)  # between them rk4 begins to amplify
    for _ in range(40):
        middle = (low + high) / 2.0
        grows = _growth(middle * s / w) > 1.0
        low, high = np.where(grows, low, middle), np.where(grows, middle, high)
    k = int((low / w).argmin())
    if step * w[k] <= low[k]:
        return "", 1.0, np.inf
    if motions.T is None:
        G, K = motions.G, motions.K
        pull = (np.abs(np.diag(K)) + w[k] * np.abs(np.diag(G))) * np.abs(shapes[free, k]) ** 2
        most = arm.coordinates[np.flatnonzero(free)[pull.argmax()]]
    else:
        most = arm.coordinates[int(modes.participation[:, bound][:, k].argmax())]
    limit = float(low[k] / w[k])
    return f", here {w[k]:.3g} rad/s of {most}: below {limit:.3g} s", float(_growth(step * s).max()), limit


def _fastest(about: SmallMotions) -> float:
    """A bound of the eigenvalues s (1/s) of M s^2 + G s + K: |s|^2 <= |M^-1 G| |s| + |M^-1 K| in any matrix norm."""
    M, G, K = about.M, about.G, about.K
    size = np.sqrt(np.maximum(M.diagonal(), 0.0))
    with np.errstate(all="ignore"):
        damping, stiffness = np.linalg.solve(M / np.outer(size, size), np.array([G, K]) / np.outer(size, size))
    g, k = float(np.linalg.norm(damping)), float(np.linalg.norm(stiffness))
    return 0.5 * (g + float(np.sqrt(g * g + 4.0 * k)))


def _growth(z: Any) -> Array:
    """Of a motion e^(s t), by a step of rk4 with z = s step."""
    grown: Array = np.abs(1.0 + z * (1.0 + z / 2.0 * (1.0 + z / 3.0 * (1.0 + z / 4.0))))
    return grown


def beyond_explicit(
    arm: Arm, step: float, span: float, q: Array, held: Sequence[int], rows: tuple[Array, Array, Array] | None = None
) -> StepWarning | None:
    """Warns where steps of rk4 above their limit (see explicit_limit) have made rounding errors felt in a run of `span`
    (s): the limit about rest, or in rows (t, q, v) of the run that of the row at which its joints move fastest."""
    words, growth, limit = explicit_limit(arm, step, q, held)
    when = ""
    if rows is not None and len(rows[0]) > 1 and not np.log(growth) * span / step >= _GREAT_GROWTH:
        t, qs, v = rows
        joints = np.ones(arm.nv, bool)
        joints[_elastic(arm)] = False
        speed = np.abs(v[:, joints]).max(axis=1, initial=0.0)
        k = int(speed.argmax())
        if step * speed[k] > FAST_JOINTS:
            words, growth, limit = explicit_limit(arm, step, qs[k], held, v[k])
            span = float(np.gradient(t)[speed > _NEAR_FASTEST * speed[k]].sum())
            when = f" at t = {t[k]:.4g} s, where the joints move at up to {speed[k]:.3g} rad/s or m/s,"
    if np.log(growth) * span / step < _GREAT_GROWTH:
        return None
    what = (
        f"is{when} above 2.83 over the highest frequency{words}; motion so fast grows {growth:.3g} times in every step"
    )
    return StepWarning(Finding(_where("rk4", step), what, step, limit, "s", "take shorter steps"), growth=growth)


def _where(integrator: str, step: float) -> str:
    return f'integrator = "{integrator}", step = {step:g}'


def switches_too_often(integrator: str, step: float, switches: int, count: int) -> StepWarning | None:
    """Warns where `count` of the switches of dry friction came within a step (three of "rk4") behind one of the same
    joint: the joint follows a vibration that the steps do not resolve."""
    if count <= _MOST_SWITCHES:
        return None
    what = (
        f"dry friction switched {switches} times, {count} of them within "
        f"{'three steps' if integrator == 'rk4' else 'a step'} behind another of the same joint: the joint follows a "
        "vibration too fast for the step, and the motion may be wrong"
    )
    remedy = 'take a smaller step, or integrator="implicit"'
    return StepWarning(Finding(_where(integrator, step), what, count, _MOST_SWITCHES, "switches", remedy))


@dataclass(frozen=True)
class Struck:
    """Vibrations that steps of "gauss" damp at once, but the arm does not, where dry friction strikes them.

    A switch is a leap of the force on its joint. In the acceleration that answers it, fast modes have a great share if
    the joint itself is light: while they ring, the joint may turn back and stick, again and again.

    Attributes:
        share: of the acceleration of `joint`, from 0 to 1. frequency: of the mode that has most of it (rad/s).
    """

    joint: str = ""
    share: float = 0.0
    frequency: float = 0.0

    @staticmethod
    def of(arm: Arm, step: float, q: Array, held: Sequence[int]) -> Struck:
        """The largest share, about q; `held` are the prescribed rates."""
        from scipy.linalg import LinAlgError, eigh

        joints = {i: name for n, (name, link) in enumerate(zip(arm.joint_names, arm.links, strict=True))
                  if link.joint.rubs for i in arm.joint_rates(n)}  # fmt: skip
        free = np.setdiff1d(np.arange(arm.nv), held)
        try:
            about = motions_about(arm, q, np.zeros(arm.nv), free=np.isin(np.arange(arm.nv), free))
            M, G, K = about.M, about.G, about.K
            squares, own = eigh((K + K.T) / 2.0, M)
            shapes = about.shapes(own)
        except (ValueError, LinAlgError):
            return Struck()
        w = np.sqrt(np.maximum(squares, 0.0))
        fast = w * step > _DAMPED_BY_GAUSS
        damping = np.einsum("ik,ij,jk->k", own, G, own)[fast] / (2.0 * w[fast])
        found = [Struck()]
        for i in free.tolist():
            if i in joints and fast.any():
                answer = shapes[i] ** 2
                rings = answer[fast] * np.exp(-_RINGS * np.maximum(damping, 0.0))
                share = float(rings.sum() / (rings.sum() + answer[~fast].sum() or 1.0))
                found.append(Struck(joints[i], share, float(w[fast][rings.argmax()])))
        return max(found, key=lambda x: x.share)

    def warning(self, step: float, switches: int) -> StepWarning | None:
        """Of a run with so many switches."""
        if switches * self.share <= _MOST_STRUCK:
            return None
        what = (
            f"dry friction switched {switches} times, and strikes vibrations of {self.frequency:.3g} rad/s, "
            f"{100 * self.share:.2g} % of the answer of '{self.joint}'. These steps damp them at once, and the arm "
            "hardly; while they ring, the joint may turn back and stick more often, and move differently"
        )
        remedy = f'take steps below {_FOLLOWED_BY_GAUSS / self.frequency:.2g} s, or integrator="ida"; or damp the beam'
        return StepWarning(Finding(_where("gauss", step), what, switches * self.share, _MOST_STRUCK, "", remedy))


def failed_steps(integrator: str, step: float, stats: Mapping[str, int], doubt: float) -> StepWarning | None:
    """Warns where steps were halved so often, mostly because their equations could not be solved, that those which
    were not may be too long as well; of "implicit", where a step was divided at all.

    Args:
        doubt: of "implicit": the largest error of the speed behind such a step, in parts of it.
    """
    count, steps = stats["failed_steps"], stats["steps"]
    if integrator == "implicit" and count:
        what = (
            f"the equations of {count} of {steps} steps could not be solved: a force leaps, or a mode vibrates, faster "
            "than the steps resolve; these steps were divided, which damps such vibration, and changes the speed by up "
            f"to {100.0 * doubt:.2g} % in a step"
        )
        remedy = "compare the motion with a run of a smaller step"
        return StepWarning(Finding(_where(integrator, step), what, count, 0, "steps", remedy))
    most = max(_FEW_HALVED, _SHARE_HALVED * steps)
    if not count > most:
        return None
    what = f"steps had to be halved {count} times, in {steps} steps: those that were not may be too long as well"
    remedy = "the motion may be wrong; compare it with a run of a smaller step"
    return StepWarning(Finding(_where(integrator, step), what, count, most, "times", remedy))


def _fast_modes(arm: Arm) -> tuple[Array, str] | None:
    """Frequencies with the joints locked (rad/s), increasing, and which coordinate moves most in the highest mode;
    None where there are none, or they cannot be told."""
    elastic = _elastic(arm)
    if not elastic:
        return None
    try:
        modes = locked_modes(arm)
    except ValueError:
        return None
    order = np.argsort(modes.frequencies)
    if not modes.frequencies[order[0]] > 0.0:
        return None
    shape = np.abs(modes.shapes[:, order[-1]])
    inertia = np.diag(arm.mass_matrix(arm.zero))  # each coordinate's part of the motion
    most = max(elastic, key=lambda i: inertia[i] * shape[i] ** 2)
    return modes.frequencies[order], arm.coordinates[most]


def _elastic(arm: Arm) -> list[int]:
    """The rates of the beams."""
    return [i for i, name in enumerate(arm._core.coordinates) if any(s in name for s in STRAINS)]


def _held_down(arm: Arm, step: float) -> tuple[str, str, float] | None:
    """The modes that steps (s) of "ida" follow, the remedy, and, where these modes are far above those that move the
    arm, the step (s) of "implicit" that steps over them, else nan; None where no vibration explains the steps."""
    if (modes := _fast_modes(arm)) is None:
        return None
    w, name = modes
    slow = w[w < _FAST_MODES * w[0]]
    fast = w[slow.size :]
    if fast.size and fast[-1] * step > _FOLLOWED[0] and fast[0] * step < _FOLLOWED[1]:
        other = float(f"{0.2 / slow[-1]:.0e}")
        what = (
            f"they follow modes at {fast[0]:.2g} to {fast[-1]:.2g} rad/s ({name}), which hardly move the arm (the "
            f"first is at {w[0]:.3g})"
        )
        return what, f'integrator = "implicit", step = {other:g} steps over them', other
    if w[-1] * step > _FOLLOWED[0] and w[0] * step < _FOLLOWED[1]:
        what = f"they follow the vibration of the beams, whose modes reach up to {w[-1]:.3g} rad/s"
        remedy = 'a larger rtol, or integrator = "gauss" or "implicit" with a step of your choice, takes fewer'
        return what, remedy, np.nan
    return None


def short_steps(arm: Arm, steps: int, span: float) -> Iterator[Finding]:
    """Steps of "ida" over `span` (s) that follow modes which could be stepped over."""
    found = _held_down(arm, span / steps) if steps > _STEPS_JUDGED else None
    if found is not None and np.isfinite(found[2]):
        what = f"took {steps} steps, {span / steps:.2g} s each: {found[0]}"
        yield Finding('integrator = "ida"', what, steps, _STEPS_JUDGED, "steps", found[1])


class Pace:
    """Told now and then how many steps "ida" has taken; warns once.

    Args:
        grown: the warning about control loops, by the time since the start; or None.
        tell: called with the warning.
    """

    def __init__(
        self, arm: Arm, times: Array, grown: Callable[[float], RunWarning | None], tell: Callable[[RunWarning], None]
    ) -> None:
        self.arm, self.begin, self.end, self.grown, self.tell = arm, float(times[0]), float(times[-1]), grown, tell
        self.last, self.warned, self.started = (self.begin, 0), False, time.perf_counter()

    def __call__(self, now: float, steps: int) -> None:
        since, before = self.last
        self.last = now, steps
        if self.warned or steps <= before or now <= since:  # dry friction begins anew, and counts from there
            return
        step = (now - since) / (steps - before)
        expected = steps + (self.end - now) / step
        found = self.judge(now, steps, step, expected) if expected >= _STEPS_OF_LOOPS else None
        if found is not None:
            self.warned = True
            self.tell(found)

    def judge(self, now: float, steps: int, step: float, expected: float) -> RunWarning | None:
        loop = self.grown(now - self.begin)
        if loop is not None or expected < _TOO_MANY_STEPS:
            return loop
        minutes = (time.perf_counter() - self.started) * (expected - steps) / steps / 60.0
        left = f"{minutes:.2g} minutes" if minutes < 100.0 else f"{minutes / 60.0:.2g} hours"
        why, remedy, other = _held_down(self.arm, step) or ("", "look for what changes so fast", np.nan)
        what = (
            f"has taken {steps} steps for {now - self.begin:.3g} s of {self.end - self.begin:.3g} s, now {step:.2g} s "
            f"each: {expected - steps:.1e} steps are to come, {left} at this pace{'; ' * bool(why)}{why}"
        )
        found = Finding('integrator = "ida"', what, expected, _TOO_MANY_STEPS, "steps", remedy)
        return SlowWarning(found, time=now, steps=steps, step=other)


def missed(where: str, law: Callable[[float], Any], asked: Array, begin: float, end: float) -> StepWarning | None:
    """Asks a law where a run has not, in equal parts from `begin` to `end`, and compares.

    Args:
        asked: the run's last call in each part: time and values, (n, 1 + k); a time of nan where there was none.
    """
    parts = len(asked)
    calls = asked[np.isfinite(asked[:, 0])]
    if len(calls) < 4:
        return None
    empty = np.flatnonzero(~np.isfinite(asked[:, 0]))
    times = begin + (empty + 0.5) * (end - begin) / parts
    times = times[(times > calls[1, 0]) & (times < calls[-2, 0])]
    if not times.size:
        return None
    try:
        values = np.array([np.ravel(law(float(t))) for t in times])
    except Exception:  # the run is done: a law that cannot be asked twice does not spoil it
        return None
    right = np.clip(np.searchsorted(calls[:, 0], times), 2, len(calls) - 2)
    before, after = calls[right - 1], calls[right]
    share = ((times - before[:, 0]) / (after[:, 0] - before[:, 0]))[:, None]
    off = np.abs(values - (before[:, 1:] + share * (after - before)[:, 1:]))
    around = np.stack([calls[right + k, 1:] for k in (-2, -1, 0, 1)])
    lowest, highest = (f(np.vstack([calls[:, 1:], values]), axis=0) for f in (np.min, np.max))
    limit = np.maximum(_DEPARTURE * (highest - lowest), _CURVATURE * np.ptp(around, axis=0))
    beyond = np.where(highest > lowest, off - limit, -1.0)
    if not (beyond > 0.0).any():
        return None
    i, j = np.unravel_index(int(np.argmax(beyond)), beyond.shape)
    value, seen = float(values[i, j]), (float(before[i, 1 + j]), float(after[i, 1 + j]))
    what = (
        f"is {value:.4g} at t = {times[i]:.6g} s; the steps passed that by, and saw {seen[0]:.4g} at "
        f"{before[i, 0]:.6g} s and {seen[1]:.4g} at {after[i, 0]:.6g} s"
    )
    remedy = "give samples, which steps end at, or output times that lie closer there"
    return StepWarning(Finding(where, what, value, remedy=remedy))
