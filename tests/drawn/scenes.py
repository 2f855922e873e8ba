"""Scenes drawn by hypothesis: every joint, section, basis and order, well scaled or wild, as in a scene file."""

from __future__ import annotations

import functools
import os
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.errors import UnsatisfiedAssumption

STRAINS = ("bending_y", "bending_z", "torsion", "shear_y", "shear_z", "extension")
#: FLEXARM_EXAMPLES=1000 draws so many examples of each property, others each time (or those of --hypothesis-seed);
#: without it few, and the same ones every time. FLEXARM_SHARE=0.25 takes that part of the few, where all is slow.
EXAMPLES, SHARE = int(os.environ.get("FLEXARM_EXAMPLES", "0")), float(os.environ.get("FLEXARM_SHARE", "1"))

SEEDS = st.integers(0, 2**31)

_now: Counter[str] = Counter()


def drawn(few: int, *strategies: st.SearchStrategy[Any]) -> Callable[[Any], Any]:
    """A property of `few` examples (or FLEXARM_EXAMPLES) of strategies, which are its last arguments. It counts those
    that were drawn, and refused by `assume`; tests/drawn/conftest.py prints the counts, and fails where most were."""

    def of(test: Any) -> Any:
        count: Counter[str] = Counter()

        @functools.wraps(test)
        def counted(*args: Any, **named: Any) -> None:
            global _now
            _now = count
            count["drawn"] += 1
            try:
                test(*args, **named)
            except UnsatisfiedAssumption:
                count["refused"] += 1
                raise

        how = settings(
            max_examples=EXAMPLES or max(1, round(SHARE * few)),
            derandomize=not EXAMPLES,
            deadline=None,
            database=None,
            suppress_health_check=list(HealthCheck),
        )
        made = how(given(*strategies)(counted))
        made.drawn = count
        return made

    return of


def note(what: str) -> None:
    """Counts something about the example at hand."""
    _now[what] += 1


def number(low: float, high: float, wild: bool = False) -> st.SearchStrategy[float]:
    """From low to high, both positive, on a scale of logarithms; now and then, when wild, of any size."""
    usual = st.floats(np.log(low), np.log(high)).map(lambda x: float(np.exp(x)))
    return st.one_of(usual, usual, st.floats(-12, 12).map(lambda x: float(10**x))) if wild else usual


def vector(size: float) -> st.SearchStrategy[list[float]]:
    return st.lists(st.floats(-size, size), min_size=3, max_size=3)


@st.composite
def body(draw: st.DrawFn, wild: bool) -> dict[str, Any]:
    """A rigid body; its inertia is that of some mass: J = trace(S) - S of a positive S."""
    m = draw(number(0.2, 2.0, wild))
    A = np.array([draw(vector(0.1)) for _ in range(3)]) + 0.05 * np.eye(3)
    S = m * A @ A.T
    J = np.trace(S) * np.eye(3) - S
    return {"mass": m, "com": draw(vector(0.1)), "inertia": (0.5 * (J + J.T)).tolist(), "end": draw(vector(0.3))}


@st.composite
def section(draw: st.DrawFn, wild: bool) -> dict[str, Any]:
    size = number(0.004, 0.03, wild)
    kind = draw(st.sampled_from(["rectangle", "circle", "tube", "general"]))
    if kind == "rectangle":
        return {"type": "rectangle", "y": draw(size), "z": draw(size)}
    if kind == "general":
        area = draw(number(1e-5, 1e-3, wild))
        second = st.floats(0.05, 0.3).map(lambda x: float(x * area**2))
        names = ("second_moment_y", "second_moment_z", "torsion_constant")
        return {"type": "general", "area": area, **{n: draw(second) for n in names}}
    radius = draw(size)
    inner = {"inner_radius": radius * draw(st.floats(0.1, 0.95))} if kind == "tube" else {}
    return {"type": "circle", "radius": radius, **inner}


@st.composite
def beam(draw: st.DrawFn, wild: bool) -> dict[str, Any]:
    length = draw(number(0.2, 1.5, wild))
    shape = draw(section(wild))
    if draw(st.integers(0, 5)) == 0:
        shape = {"type": "taper", "x": [0.0, length], "sections": [shape, shape]}
    material = {"density": draw(number(1e3, 8e3, wild)), "youngs_modulus": draw(number(1e8, 1e11, wild))}
    modes = {s: draw(st.integers(0, 3)) for s in STRAINS if draw(st.booleans())}
    return {
        "length": length, "section": shape, "material": {**material, "poisson_ratio": draw(st.floats(0, 0.45))},
        "modes": modes, "basis": draw(st.sampled_from(["clamped-free", "legendre", "loaded"])),
        "order": draw(st.sampled_from([0, 1, 2, 2, 3, "exact"])),
        "damping_ratio": draw(st.sampled_from([0.0, 0.0, 0.02])),
    }  # fmt: skip


@st.composite
def joint(draw: st.DrawFn, wild: bool) -> dict[str, Any]:
    freedoms = {"revolute": 1, "prismatic": 1, "cylindrical": 2, "universal": 2, "planar": 3, "spherical": 3, "free": 6,
                "fixed": 0}  # fmt: skip
    kind = draw(st.sampled_from(["revolute", "revolute", *freedoms]))
    out: dict[str, Any] = {"type": kind}
    if kind in ("revolute", "prismatic", "cylindrical"):
        out["axis"] = draw(st.sampled_from(["x", "y", "z", [0.3, -0.5, 0.8]]))
    ball = kind in ("spherical", "free")
    if freedoms[kind] and draw(st.booleans()):
        out["stiffness"] = draw(number(0.1, 50.0, wild))
        out["damping"] = draw(number(0.01, 2.0, wild))
        if draw(st.booleans()):
            out |= {"upper": draw(st.floats(0.05, 1.5)), "limit_stiffness": draw(number(10, 1000, wild))}
        if not ball and draw(st.booleans()):
            out["coulomb"] = draw(number(0.01, 1.0, wild))
            out["stiction"] = out["coulomb"] * draw(st.floats(1.0, 2.0))
    for side in ("inboard", "outboard"):
        if draw(st.integers(0, 3)) == 0:
            out[side] = {"position": draw(vector(0.2)), "rotation": draw(vector(1.5))}
    return out


@st.composite
def arm(draw: st.DrawFn, wild: bool = False, most: int = 3) -> dict[str, Any]:
    """`gravity` and `link` of a scene file; the last link carries a body."""
    links = []
    n = draw(st.integers(1, most))
    for k in range(n):
        link = {"joint": draw(joint(wild))}
        if draw(st.booleans()):
            link["beam"] = draw(beam(wild))
        if draw(st.booleans()):
            link["hub"] = draw(body(wild))
        if k == n - 1 or draw(st.booleans()):
            link["tip"] = draw(body(wild))
        links.append(link)
    return {"gravity": draw(st.sampled_from([[0.0, 0.0, 0.0], [0.0, -9.81, 0.0], [3.0, 1.0, -9.0]])), "link": links}


def state(arm: Any, seed: int, size: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q, v, tau: joints of order one, sections turned by some per cent; quaternions of length one."""
    rng = np.random.default_rng(seed)
    small = 0.003 if any(link.beam is not None and link.beam.order == 0 for link in arm.links) else 0.02

    def sizes(names: tuple[str, ...]) -> np.ndarray:
        return np.array([small if any(s in name for s in STRAINS) else 1.0 for name in names])

    q = size * sizes(arm.q_names) * rng.normal(size=arm.nq)
    for _, at in arm.quaternions():
        q[at.start] += 1.0
        q[at] /= np.linalg.norm(q[at])
    return q, size * sizes(arm.coordinates) * rng.normal(size=arm.nv), size * rng.normal(size=arm.nv)
