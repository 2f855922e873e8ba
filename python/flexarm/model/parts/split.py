"""A link as several links, joined rigidly, to follow jumps of its beam, such as those at the ends of a patch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from textwrap import shorten
from typing import Any

import numpy as np

from ..._check import array, whole
from .beam import STRAINS, Beam
from .joints import Fixed
from .link import Link
from .patch import Patch
from .shapes import curvature_at
from .taper import Taper


def split(link: Link, modes: int | Mapping[str, int] = 4, places: Sequence[float] | None = None) -> list[Link]:
    """The same link in pieces with fixed joints between them, cut at the ends of its patches.

    The curvature of a beam jumps where a stiff patch begins. Smooth shape functions follow that slowly: a pair half as
    stiff as the beam leaves a static tip wrong by a fifth with three shapes and by 2 % with thirty (docs/piezo.md);
    pieces, each smooth, converge exponentially. Use it as Arm([*split(link), ...]). Links behind it are numbered anew;
    the first piece keeps the link's name and its parent, the others are "NAME 2" and so on. All on the link sits
    on its last piece then: a `parent`, or a point of a strut or of a contact, that names the link's end must name that
    one, and numbers of links move on; a link `at` a place along the beam sits on the piece there, at the place less
    where that piece begins.

    Args:
        link: with a beam. Its damping must be kelvin_voigt: a damping_ratio, and a damping, is for a whole beam.
        modes: shape functions of each piece (Legendre), for each strain that the beam has; or by strain.
        places: where to cut instead (m from the clamp). A patch that is cut becomes one of each piece.
    """
    if not isinstance(link, Link) or link.beam is None:
        raise ValueError(f"link = {shorten(repr(link), 80)}: must be a Link with a beam")
    beam = link.beam
    if beam.damping_ratio > 0:
        raise ValueError(f"damping_ratio = {beam.damping_ratio}: is of the whole beam's modes; give kelvin_voigt")
    if beam.damping:
        raise ValueError("damping: is of the whole beam's coordinates; give kelvin_voigt")
    if places is None:
        cuts = np.array([x for p in beam.patches for x in (p.start, p.end)])
    else:
        cuts = array("places", places)
    near = 1e-9 * beam.length
    if cuts.ndim != 1 or (cuts < -near).any() or (cuts > beam.length + near).any():
        raise ValueError(f"places = {places!r}: must be a list of places from 0 to the length, {beam.length} m")
    ends = [0.0]
    for x in [*np.sort(cuts).tolist(), beam.length]:
        if ends[-1] + near < x < beam.length - near:
            ends.append(x)
    ends.append(beam.length)
    counts = modes if isinstance(modes, Mapping) else {s: whole("modes", modes) for s in STRAINS if s in beam.counts}
    out = []
    for k in range(len(ends) - 1):
        first, last = k == 0, k + 2 == len(ends)
        own = piece(beam, ends[k], ends[k + 1], counts)
        hub = link.hub if first else None
        name = link.name if first or link.name is None else f"{link.name} {k + 1}"
        joint, parent, at = (link.joint, link.parent, link.at) if first else (Fixed(), None, None)
        out.append(Link(joint, hub, own, link.tip if last else None, name, parent=parent, at=at))
    return out


def piece(beam: Beam, a: float, b: float, counts: Mapping[str, int]) -> Beam:
    """The part of a beam from a to b (m), as a beam of its own with so many Legendre polynomials for each strain."""
    section: Any = beam.section
    if isinstance(section, Taper):
        x = np.array([a, *(v for v in section.x if a < v < b), b])
        section = Taper((x - a).tolist(), [section.at(float(v)) for v in x])
    patches = [_part(p, a, b) for p in beam.patches if min(p.end, b) - max(p.start, a) > 1e-9 * beam.length]
    curvature: Any = beam.curvature
    if isinstance(curvature, Mapping):

        def curvature(x: float) -> Any:
            return curvature_at(beam.curvature, beam.length, x + a)

    given: dict[str, Any] = {"section": section, "patches": patches, "modes": dict(counts), "length": b - a}
    given["curvature"] = curvature
    return replace(beam, basis="legendre", basis_tip=None, gauss_points=None, **given)


def _part(patch: Patch, a: float, b: float) -> Patch:
    """The part of a patch from a to b, with places counted from a."""
    start, end = max(patch.start, a), min(patch.end, b)
    profile: Any = None
    if patch.profile is not None and "x" in patch.profile:
        x = np.array([start, *(v for v in patch.profile["x"] if start < v < end), end])
        profile = {"x": x - a, "share": [patch.share(float(v)) for v in x]}
    elif patch.profile is not None:

        def profile(x: float) -> float:
            return patch.share(x + a)

    return replace(patch, start=start - a, end=end - a, profile=profile)
