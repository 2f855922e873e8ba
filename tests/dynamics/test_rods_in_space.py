"""Rods in space with all six strains against what shares nothing with flexarm: shooting, collocation, Exudyn
(tests/data/rods_in_space.json; bench/rod/rod_data.py made it, docs/rods.md draws such)."""

import json
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest

DATA = json.loads((Path(__file__).parent.parent / "data" / "rods_in_space.json").read_text())
STRAINS = ("bending_y", "bending_z", "torsion", "shear_y", "shear_z", "extension")
# eight shapes of each strain but where a rod turns by several radians along its length
SHAPES = {"rolled up, and a force across": 10, "a turn of a helix": 10, "strip twisted by 90° at rest": 10}
SHAPES |= {"post-buckled column": 10, "half a ring under a follower": 10}


def matrix(numbers: list[float]) -> np.ndarray:
    return np.diag(numbers) if len(numbers) == 6 else np.reshape(numbers, (6, 6))


def chain(pieces: list[dict[str, Any]], shapes: int, base: fa.Joint | None = None) -> fa.Arm:
    """The pieces as links, the first clamped or on `base`."""
    links = []
    for k, p in enumerate(pieces):
        section = fa.SectionMatrix(matrix(p["stiffness"]), matrix(p["inertia"]))
        curvature = p["curvature"] if any(p["curvature"]) else None
        modes = {s: shapes for s in STRAINS}
        beam = fa.Beam(p["length"], section, None, modes, "legendre", "exact", curvature=curvature)
        joint = base if base and not k else fa.Fixed(inboard=fa.Placement(rotation=p["turn"]))
        links.append(fa.Link(joint, None, beam))
    return fa.Arm(links)


def named(group: str) -> Any:
    return pytest.mark.parametrize("case", DATA[group], ids=lambda c: c["name"])


@named("equilibria")
def test_equilibria(case: dict[str, Any]) -> None:
    """From rest, to 1e-8 of the length."""
    arm = chain(case["pieces"], SHAPES.get(case["name"], 8))
    q = arm.equilibrium(
        loads=[
            fa.Load(force=case["force"], moment=case["moment"]),
            fa.Load(force=case["follower_force"], moment=case["follower_moment"], axes="section"),
        ]
    )
    p, R = arm.frame(q)
    assert np.abs(p - case["tip"]).max() < 1e-8 * sum(piece["length"] for piece in case["pieces"])
    assert np.abs(R - case["orientation"]).max() < 1e-7


@named("buckling")
def test_critical_loads(case: dict[str, Any]) -> None:
    """The lowest square of a frequency about the equilibrium, at somewhat less load, points to zero where shooting's
    Jacobian is singular; and beyond that load the arm is unstable."""
    links, at = list(chain(case["pieces"], 6).links), np.zeros(3)
    first = len(links)
    for place, _ in case["arms"]:  # bars on the tip, without mass
        links.append(fa.Link(fa.Fixed(), fa.RigidBody(end=tuple(np.array(place) - at))))
        at = np.array(place)
    arm = fa.Arm(links)
    forces = [(first - 1, case["force"]), *((first + k, force) for k, (_, force) in enumerate(case["arms"]))]

    def loads(factor: float) -> list[fa.Load]:
        return [fa.Load(link, force=factor * np.array(force)) for link, force in forces]

    critical = case["critical"]
    q = arm.equilibrium(loads=loads(0.8 * critical))

    def squares(factor: float) -> float:
        return float(-np.real(arm.modes(q, loads=loads(factor)).eigenvalues ** 2).max())

    factors = critical * np.linspace(0.9, 0.98, 6)
    roots = np.polynomial.Polynomial.fit(factors, [squares(f) for f in factors], 5).roots()
    assert np.abs(roots - critical).min() < 1e-5 * critical
    assert squares(0.99 * critical) > 0.0 > squares(1.01 * critical)


@pytest.mark.parametrize("case", DATA["rings"][:-1], ids=lambda c: c["name"])
def test_frequencies_of_arcs(case: dict[str, Any]) -> None:
    own = chain([case["piece"]], 12).modes().frequencies[:6] / (2 * np.pi)
    assert np.abs(own / case["hertz"] - 1.0).max() < 1e-7


def test_frequencies_of_a_helical_spring() -> None:
    """Mottershead's, clamped at one end, as eight beams in a row."""
    case = DATA["rings"][-1]
    piece = {**case["piece"], "length": case["piece"]["length"] / 8}
    own = chain([piece] * 8, 6).modes().frequencies[:6] / (2 * np.pi)
    assert np.abs(own / case["hertz"] - 1.0).max() < 3e-4
    assert np.abs(own[2:4] / case["hertz"][2:4] - 1.0).max() < 2e-6


@pytest.mark.parametrize("case", DATA["blades"], ids=lambda c: f"speed {c['speed']:g}")
def test_rotating_blades(case: dict[str, Any]) -> None:
    """A blade that stretches and shears: flapping coupled with twist, and how long its turning makes it."""
    piece = {**case, "length": 1.0, "curvature": (0, 0, 0), "turn": (0, 0, 0)}
    arm = chain([piece], 10, fa.Revolute("z"))
    modes = arm.modes(speed={0: case["speed"]}, lock=[0])
    for flap in case["flap"]:
        assert np.abs(modes.frequencies / flap - 1.0).min() < 1e-9
    assert abs(np.linalg.norm(arm.frame(modes.q)[0]) - case["length"]) < 1e-12


MOTIONS = {"elbow-smooth": (10, 0.1, 2e-6), "spaghetti-smooth": (8, 0.1, 1e-5), "follower": (10, 0.05, 2e-6)}


@named("motions")
def test_motions(case: dict[str, Any]) -> None:
    """Against Exudyn's, extrapolated: to what so few shapes leave."""
    shapes, step, tolerance = MOTIONS[case["name"]]
    base = fa.Free(inboard=fa.Placement(*case["root"])) if case["free"] else None
    arm, loads = chain(case["pieces"], shapes, base), []
    for pulse in case["pulses"]:
        assert pulse["smooth"]

        def law(vector: list[float], end: float = pulse["knots"][2]) -> Any:
            return lambda t: np.array(vector) * (np.sin(np.pi * t / end) ** 6 if t < end else 0.0)

        at = {"link": 0, "x": 0.0} if pulse["piece"] < 0 else {"link": pulse["piece"]}
        axes = "section" if pulse["follows"] else "world"
        loads.append(fa.Load(**at, force=law(pulse["force"]), moment=law(pulse["moment"]), axes=axes))
    run = fa.simulate(arm, case["times"], loads=loads, integrator="gauss", step=step)
    ends = [run.frame(k)[0] for k in range(len(case["pieces"]))]
    root = run.frame(0, 0.0)[0] if case["free"] else np.zeros_like(ends[0])
    assert np.abs(np.hstack([root, *ends]) - case["path"]).max() < tolerance
