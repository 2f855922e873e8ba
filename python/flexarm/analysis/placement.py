"""Where to bond a piezo patch: its authority over each mode, along a beam (paper Eq. 61 against Eq. 62)."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .._check import Array, array, at_least, instance, number, whole
from .._console import aligned, progress_bar
from ..data.draw.style import INK, PALETTE, Figure, label_axes, legend, new_figure
from ..model.parts.chain import Chain
from ..model.parts.patch import Patch
from .modes import small_motions

_GRID = 201


@dataclass(frozen=True, repr=False)
class PatchPlacement:
    """The result of `place_patch`. Mode 0 is the lowest that bends the beam.

    Attributes:
        x: centres of the places tried (m from the clamp), (n,).
        authority: static deflection of each mode per volt there, (n, modes): the mode's share of the patch's forces
            (Eq. 61) over its elastic force (Eq. 62), where the mode's largest displacement along the beam counts as 1:
            m/V (rad/V for a mode that only twists the beam). The sign tells the direction.
        merit: weighted mean of the modes' authorities, each relative to its greatest, (n,), 0 to 1.
        best: start of the best place (m). best_authority: there, (modes,). best_merit: there.
        frequencies: of the modes (rad/s).
        weights: of the modes, their sum 1.
        patch: the patch, at the best place.
    """

    x: Array
    authority: Array
    merit: Array
    best: float
    best_authority: Array
    best_merit: float
    frequencies: Array
    weights: Array
    patch: Patch

    def __str__(self) -> str:
        p = self.patch
        rows, half = [["mode", "rad/s", "weight", "there (m/V)", "greatest (m/V)", "from (m)"]], (p.end - p.start) / 2
        for k, w in enumerate(self.frequencies):
            top = int(np.abs(self.authority[:, k]).argmax())
            there = f"{self.best_authority[k]:.3e}", f"{self.authority[top, k]:.3e}", f"{self.x[top] - half:.4g}"
            rows.append([str(k), f"{w:.5g}", f"{self.weights[k]:.3f}", *there])
        head = f"best place: from {p.start:.4g} to {p.end:.4g} m, merit {self.best_merit:.3f}"
        return "\n".join([head, *aligned(rows, range(6))])

    def __repr__(self) -> str:
        return f"PatchPlacement(best={self.best:.6g}, merit={self.best_merit:.4g}, {len(self.frequencies)} modes)"

    def plot(self) -> Figure:
        """A figure of each mode's authority, and of their weighted mean, over the place of the patch's centre."""
        figure = new_figure(8.0, 5.0)
        top, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        half = (self.patch.end - self.patch.start) / 2
        for k, w in enumerate(self.frequencies):
            relative = self.authority[:, k] / (np.abs(self.authority[:, k]).max() or 1.0)
            colour = PALETTE[k % len(PALETTE)]
            top.plot(self.x, relative, color=colour, label=f"mode {k}, {w:.4g} rad/s")
        top.axhline(0.0, color=INK, linewidth=0.6)
        below.plot(self.x, self.merit, color=INK)
        below.plot(self.best + half, self.best_merit, "o", color=INK)
        named = " : ".join(f"{w:.2g}" for w in self.weights)
        alike = np.ptp(self.weights) < 1e-12
        mean = "mean" if alike else f"weighted mean\n({named})" if len(self.weights) <= 4 else "weighted mean"
        for ax in (top, below):
            ax.axvspan(self.best, self.best + 2 * half, color="#EEEEEE", zorder=0)
        label_axes(top, "authority / its greatest")
        label_axes(below, mean, "centre of the patch from the clamp (m)")
        below.set_ylim(0.0, 1.05)
        legend(top, len(self.frequencies))
        return figure


def place_patch(
    arm: Chain,
    link: int | str = -1,
    *,
    patch: Patch,
    length: float | None = None,
    modes: int = 3,
    weights: Sequence[float] | None = None,
    lock: Iterable[Any] | None = None,
    points: int = _GRID,
    progress: Any = False,
) -> PatchPlacement:
    """Control authority of a patch on an arm's modes over its place along a beam, and the best place.

    The modes are those of the arm as it is, at zero and at rest; the patch's own stiffness and mass do not change them
    here. Give the arm the patch at `.best`, as `.patch`, to see their effect.

    Args:
        arm: the arm, whose link has a beam.
        link: where to bond it; -1 is the last.
        patch: the patch to bond: its own start and end tell its length alone; its profile moves with it.
        length: another length of the patch (m); not with a profile.
        modes: how many modes, from the lowest up; those that leave this beam straight are passed over.
        weights: of the modes, not negative, their sum above zero; None: all alike.
        lock: links whose joints hold still; None: all. [] are the modes of an arm that is free to swing.
        points: places tried, at equal distances, before the best is refined.
        progress: shows a bar on stderr, or lines where that is no terminal; or a callable, which is given the number of
            places tried so far, and may raise to give up.

    Raises:
        ValueError: naming the field and the value, or a patch that moves none of the modes.
    """
    n = arm._link(link)
    beam = arm.links[n].beam
    if beam is None:
        raise ValueError(f"link = {link}: has no beam")
    instance("patch", patch, Patch)
    size = patch.end - patch.start if length is None else number("length", length)
    if not 0 < size < beam.length:
        raise ValueError(f"length = {size}: must be positive and below the beam's, {beam.length} m")
    if length is not None and patch.profile is not None:
        raise ValueError(f"length = {length}: a patch with a profile keeps its length, {patch.end - patch.start} m")
    at_least("points", points, 3)
    omega, shapes = _modes(arm, n, whole("modes", modes), lock)
    w = np.ones(len(omega)) if weights is None else array("weights", weights, (len(omega),))
    if (w < 0).any() or not w.sum() > 0:
        raise ValueError(f"weights = {weights!r}: must not be negative, and their sum positive")
    w = w / w.sum()

    def at(start: float) -> Patch:
        return replace(patch, start=start, end=start + size, profile=_moved(patch, start))

    def authority(start: float) -> Array:
        force = beam._core.patch_force(at(start).on(beam.section, beam.length))[0]
        return np.asarray(force @ shapes) / omega**2

    last = beam.length - size
    starts = np.linspace(0.0, last, points)
    rows: list[Array] = []
    with progress_bar(progress, "placing", points) as bar:
        for x in starts:
            rows.append(authority(x))
            if bar is not None:
                bar(len(rows))
    found = np.array(rows)
    greatest = np.abs(found).max(axis=0)
    if not greatest.max() > 0:
        raise ValueError(f"patch: face {patch.face!r} at angle {patch.angle} moves none of the modes {modes}")
    scale = np.where(greatest > 1e-9 * greatest.max(), greatest, np.inf)

    def merit(a: Array) -> Any:
        return (np.abs(a) / scale) @ w

    from scipy.optimize import minimize_scalar  # slow to import

    merits = np.asarray(merit(found))
    k = int(merits.argmax())
    best = float(starts[k])
    around = (float(starts[max(k - 1, 0)]), float(starts[min(k + 1, points - 1)]))
    refined = minimize_scalar(lambda x: -merit(authority(x)), bounds=around, method="bounded", options={"xatol": 1e-9})
    if -refined.fun > merits[k] + 1e-12:
        best = float(refined.x)
    there = authority(best)
    return PatchPlacement(starts + size / 2, found, merits, best, there, float(merit(there)), omega, w, at(best))


def _modes(arm: Chain, n: int, count: int, lock: Iterable[Any] | None) -> tuple[Array, Array]:
    """Undamped frequencies at zero, without gravity, of the lowest modes that bend the beam of link n, and their shapes
    in its elastic coordinates, to such a scale that the modal force over omega^2 is the largest displacement."""
    at_least("modes", count, 1)
    arm.refuse_loops("place_patch: arm")
    beam, at = next(((beam, at) for k, beam, _, at in arm.beams() if k == n), (None, slice(0)))
    omega, shapes = [], []
    found = small_motions(arm._alike(arm.links), lock=arm.movable if lock is None else lock)
    modes = found.undamped()
    for w, modal in zip(modes.frequencies, modes.shapes.T, strict=True):
        shape = modal / np.sqrt(modal @ found.mass @ modal)  # of modal mass 1
        own = shape[at]
        if beam is None or w == 0.0 or own @ beam._core.stiffness @ own <= 1e-9 * w**2:
            continue  # a rigid motion, or one of other links
        J = np.array([arm.jacobian(arm.zero, n, float(x)) for x in np.linspace(0.0, beam.length, 101)])
        u = J @ shape
        moved, turned = np.abs(u[:, :3]), np.abs(u[:, 3:])
        part = u[:, :3] if moved.max() > 1e-6 * turned.max() * beam.length else u[:, 3:]
        omega.append(float(w))
        shapes.append(own * part.flat[np.abs(part).argmax()])  # positive there
    if len(omega) < count:
        raise ValueError(f"modes = {count}: the arm has {len(omega)} that bend this beam; give it more shape functions")
    return np.array(omega[:count]), np.array(shapes[:count]).T


def _moved(patch: Patch, start: float) -> Any:
    """The profile, for the patch moved to another start."""
    if patch.profile is None or "legendre" in patch.profile:
        return patch.profile
    x = tuple(v - patch.start + start for v in patch.profile["x"])
    return {"x": x, "share": patch.profile["share"]}
