"""The cases of bench/speed/peers.py, and how its workers measure and report. Needs NumPy only, which every peer has.

All cases are planar: joints turn about z, the tip's path is (x, y) in the world (m) at `Case.times`.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

REPEATS = 3


@dataclass(frozen=True)
class Section:
    """Stiffness and inertia of a uniform beam in its plane, per length where that makes sense (SI)."""

    EA: float
    GA: float  # with the shear correction
    EI: float
    rhoA: float
    rhoI: float


def rectangle(density: float, E: float, nu: float, y: float, z: float) -> Section:
    """A strip that bends across y."""
    A, I = y * z, z * y**3 / 12
    return Section(E * A, E / (2 + 2 * nu) * 5 / 6 * A, E * I, density * A, density * I)


@dataclass(frozen=True)
class Case:
    """One simulation. Driven cases: the hub turns by `spin` = (speed (rad/s), time (s)). Others: joint torques, linear
    between `knots`."""

    name: str
    title: str
    length: float  # of each beam (m)
    section: Section
    end: float  # of the run (s)
    outputs: int  # intervals between output times
    hub: float = 0.0  # radius (m)
    spin: tuple[float, float] | None = None
    beams: int = 1
    hub_mass: tuple[float, ...] = ()  # kg, at the joint
    hub_inertia: tuple[float, ...] = ()  # kg m^2
    payload: tuple[float, float] = (0.0, 0.0)  # kg, kg m^2, at the last beam's end
    knots: tuple[float, ...] = ()  # s
    torques: tuple[tuple[float, ...], ...] = ()  # N m at the knots, by joint

    @property
    def times(self) -> np.ndarray:
        """Output times (s), (outputs + 1,)."""
        return np.linspace(0.0, self.end, self.outputs + 1)

    def angle(self, t: float) -> tuple[float, float, float]:
        """Angle, rate and acceleration of the driven hub (rad, s): smooth spin-up (Kane, Ryan & Banerjee 1987)."""
        assert self.spin
        speed, T = self.spin
        if t >= T:
            return speed * (t - T / 2), speed, 0.0
        w = 2 * math.pi / T
        q = speed / T * (t * t / 2 + (math.cos(w * t) - 1) / w**2)
        return q, speed / T * (t - math.sin(w * t) / w), speed / T * (1 - math.cos(w * t))

    def torque(self, t: Any, joint: int) -> Any:
        """Joint torque (N m) at time(s) t."""
        return np.interp(t, self.knots, self.torques[joint])


CASES = {
    "a": Case(
        "a",
        "the paper's link, spun up to 7.6 rad/s in 0.5 s",
        0.5,
        rectangle(7850.0, 209e9, 0.3, 0.001, 0.02),
        end=1.0,
        outputs=200,
        hub=0.075,
        spin=(7.6, 0.5),
    ),
    "b": Case(
        "b",
        "Simo & Vu-Quoc's spin-up of a 10 m beam to 6 rad/s in 15 s",
        10.0,
        Section(EA=2.8e7, GA=1e7, EI=1.4e4, rhoA=1.2, rhoI=6e-4),
        end=15.0,
        outputs=300,
        spin=(6.0, 15.0),
    ),
    "c": Case(
        "c",
        "two flexible links driven by joint torques",
        0.5,
        rectangle(2700.0, 70e9, 0.33, 0.0015, 0.05),
        end=1.0,
        outputs=200,
        beams=2,
        hub_mass=(0.0, 1.0),
        hub_inertia=(0.1, 0.1),
        payload=(0.1, 5e-4),
        knots=(0.0, 0.1, 0.4, 0.5, 1.0),
        torques=((0.0, 1.0, -1.0, 0.0, 0.0), (0.0, -0.3, 0.3, 0.0, 0.0)),
    ),
}


def measure(simulate: Callable[[], Any], repeats: int = REPEATS) -> tuple[float, Any]:
    """CPU time (s) of the fastest of some runs, and the last one's answer."""
    best = math.inf
    for _ in range(repeats):
        start = time.process_time()
        answer = simulate()
        best = min(best, time.process_time() - start)
    return best, answer


def report(kind: str, case: Case, method: str, setting: str, truth: str, path: Any, **more: Any) -> None:
    """One line of JSON on stdout.

    Args:
        kind: "run", or "truth" for a converged path.
        truth: names the mechanics that the path is an answer of.
        path: the tip's (outputs + 1, 2) in m; None when the run failed.
        more: cpu_s, setup_s, converged (m), note.
    """
    rows = None if path is None else np.asarray(path, dtype=float)
    if rows is not None and (rows.shape != (case.outputs + 1, 2) or not np.isfinite(rows).all()):
        rows = None
    line = {"kind": kind, "case": case.name, "method": method, "setting": setting, "truth": truth, **more}
    print(json.dumps({**line, "path": None if rows is None else rows.tolist()}), flush=True)


def wanted() -> Iterator[tuple[Case, bool]]:
    """The cases a worker was asked for, and whether it shall report truths (else runs); told to it by the driver."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", default="a,b,c")
    parser.add_argument("--truth", action="store_true")
    arguments = parser.parse_args()
    for name in arguments.cases.split(","):
        yield CASES[name], arguments.truth


def versions(**programs: str) -> None:
    """Reports the versions of what was measured."""
    python = ".".join(map(str, sys.version_info[:3]))
    print(json.dumps({"kind": "versions", **programs, "python": python}), flush=True)
