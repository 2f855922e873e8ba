"""Worker of bench/rod/rods.py: Exudyn's geometrically exact beam in space (two nodes, Euler parameters).

Statics: the load in steps, on meshes each twice as fine as the last. In time: generalised-alpha, spectral radius 0.95,
index 3, full Newton. Its error is of second order in the element's length and in the step, so that both are
extrapolated (Richardson, twice).
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from itertools import pairwise
from typing import Any

import exudyn as exu
import exudyn.utilities as eu
import numpy as np
from rod_cases import (
    DYNAMICS,
    PRINCETON_ANGLES,
    PRINCETON_LOADS,
    STATICS,
    Dynamic,
    Piece,
    Pulse,
    Static,
    Z,
    princeton,
)

MESHES = (8, 16, 32, 64)  # elements of each beam, in statics
TOLERANCE = 1e-6  # of Newton: with less, rounding stops it
MESHES_IN_TIME = (8, 16, 32, 64, 128)
STEPS = (5, 10, 20, 40)  # between two output times


def turned(v: Any) -> np.ndarray:
    """Rotation matrix of a rotation vector."""
    return np.asarray(eu.RotationVector2RotationMatrix(np.array(v, dtype=float)))


def along(piece: Piece, s: float) -> tuple[np.ndarray, np.ndarray]:
    """Place and turn of a piece's section at rest, from its root: a helix."""
    k = np.array(piece.curvature)
    size = float(np.linalg.norm(k))
    e1 = np.array([1.0, 0.0, 0.0])
    if size == 0.0:
        return s * e1, np.eye(3)
    axis, a = k / size, size * s
    across = e1 - (e1 @ axis) * axis
    p = (e1 @ axis) * axis * s + (np.sin(a) * across + (1 - np.cos(a)) * np.cross(axis, across)) / size
    return p, turned(k * s)


class Chain:
    """Beams in a row, clamped or free, with the nodes of their elements."""

    def __init__(self, pieces: tuple[Piece, ...], elements: int, root: Any = (Z, Z), free: bool = False) -> None:
        self.container = exu.SystemContainer()
        self.mbs = self.container.AddSystem()
        ground = self.mbs.AddNode(eu.NodePointGround())
        p, R = np.array(root[0], dtype=float), turned(root[1])
        self.ends: list[int] = []
        for piece in pieces:
            R = R @ turned(piece.turn)
            section = exu.BeamSection()
            section.stiffnessMatrix, section.massPerLength = piece.matrix, piece.inertia[0]
            section.inertia = np.diag(piece.inertia[3:])
            h = piece.length / elements
            rest = [along(piece, k * h) for k in range(elements + 1)]
            nodes = [self.node(p + R @ x, R @ turn) for x, turn in rest]
            for k in range(elements):
                self.mbs.AddObject(
                    eu.ObjectBeamGeometricallyExact(nodeNumbers=nodes[k : k + 2], length=h, sectionData=section)
                )
            if self.ends:
                self.join(self.ends[-1], nodes[0], turned(piece.turn))
            else:
                self.root = nodes[0]
                if not free:
                    self.join(ground, nodes[0], R)
            self.ends.append(nodes[-1])
            p, R = p + R @ rest[-1][0], R @ rest[-1][1]

    def node(self, p: np.ndarray, R: np.ndarray) -> int:
        quaternion = eu.RotationMatrix2EulerParameters(R)
        return int(self.mbs.AddNode(eu.NodeRigidBodyEP(referenceCoordinates=[*p, *quaternion])))

    def marker(self, node: int) -> Any:
        return self.mbs.AddMarker(eu.MarkerNodeRigid(nodeNumber=node))

    def join(self, a: int, b: int, turn: np.ndarray) -> None:
        """Node b rigidly to node a, turned against it."""
        place = exu.HT(rotation=turn, translation=[0.0, 0.0, 0.0])
        first = self.mbs.AddMarker(eu.MarkerNodeRigid(nodeNumber=a, localHT=place))
        self.mbs.AddObject(eu.GenericJoint(markerNumbers=[first, self.marker(b)]))

    def load(self, node: int, force: Any, moment: Any, follows: bool, law: Any = None) -> None:
        marker = self.marker(node)
        for kind, vector in ((eu.Force, force), (eu.Torque, moment)):
            if any(vector):
                given = {} if law is None else {"loadVectorUserFunction": law}
                self.mbs.AddLoad(kind(markerNumber=marker, loadVector=list(vector), bodyFixed=follows, **given))


def settings() -> Any:
    s = exu.SimulationSettings()
    s.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    s.solution.file.write = False
    return s


def equilibrium(case: Static, elements: int) -> tuple[np.ndarray, float]:
    """The tip, and CPU time of the solution (s)."""
    chain = Chain(case.pieces, elements)
    chain.load(chain.ends[-1], case.force, case.moment, False)
    chain.load(chain.ends[-1], case.follower_force, case.follower_moment, True)
    chain.mbs.Assemble()
    s = settings()
    s.staticSolver.numberOfLoadSteps, s.staticSolver.adaptiveStep = case.steps, True
    size = max(map(abs, (*case.force, *case.moment, *case.follower_force, *case.follower_moment)))
    s.staticSolver.newton.relativeTolerance, s.staticSolver.newton.absoluteTolerance = 1e-9, 1e-7 * size
    start = time.process_time()
    chain.mbs.SolveStatic(s)
    cpu = time.process_time() - start
    return np.array(chain.mbs.GetNodeOutput(chain.ends[-1], exu.OutputVariableType.Position)), cpu


def _law(pulse: Pulse, vector: Any) -> Any:
    def law(mbs: Any, t: float, load: Any) -> Any:
        return [x * pulse.share(t) for x in vector]

    return law


def simulate(case: Dynamic, elements: int, every: int) -> tuple[np.ndarray, float]:
    """Root and ends of all pieces (outputs + 1, 3 (pieces + 1)), and CPU time (s)."""
    chain = Chain(case.pieces, elements, case.root, case.free)
    for pulse in case.pulses:
        node = chain.root if pulse.piece < 0 else chain.ends[pulse.piece]
        for kind, vector in (("force", pulse.force), ("moment", pulse.moment)):
            both = (vector, Z) if kind == "force" else (Z, vector)
            chain.load(node, *both, pulse.follows, _law(pulse, vector))
    variable = exu.OutputVariableType.Position
    sensors = [
        chain.mbs.AddSensor(
            eu.SensorNode(nodeNumber=n, storeInternal=True, writeToFile=False, outputVariableType=variable)
        )
        for n in (chain.root, *chain.ends)
    ]
    chain.mbs.Assemble()
    s = settings()
    s.solution.sensors.writePeriod = case.end / case.outputs
    i = s.timeIntegration
    i.endTime, i.numberOfSteps, i.adaptiveStep = case.end, case.outputs * every, False
    i.generalizedAlpha.spectralRadius, i.newton.useModifiedNewton = 0.95, False
    i.newton.absoluteTolerance = i.newton.relativeTolerance = TOLERANCE
    start = time.process_time()
    chain.mbs.SolveDynamic(s)
    cpu = time.process_time() - start
    return np.hstack([np.array(chain.mbs.GetSensorStoredData(x))[:, 1:4] for x in sensors]), cpu


def extrapolated(rows: list[np.ndarray]) -> tuple[np.ndarray, float]:
    """Of answers, each of a mesh or step half the last one's, errors of order 2, 4, ... taken away (Romberg); and how
    far that differs from the same without the finest."""
    table, best = list(rows), []
    for order in range(1, len(rows)):
        best.append(table[-2])
        table = [(4**order * fine - coarse) / (4**order - 1) for coarse, fine in pairwise(table)]
    return table[0], float(np.abs(table[0] - best[-1]).max())


def refined(case: Dynamic) -> tuple[np.ndarray, float, float]:
    """Extrapolated in the mesh at the longest step; added is what shorter steps change, extrapolated in the step and,
    on some of the meshes, in the mesh. What the finest mesh and the last change moved; CPU time of the finest run."""
    runs = {(n, STEPS[0]): simulate(case, n, STEPS[0]) for n in MESHES_IN_TIME}
    changes, moved, cpu = [], 0.0, runs[MESHES_IN_TIME[-1], STEPS[0]][1]
    for n in MESHES_IN_TIME[1:4]:
        rows = [runs[n, STEPS[0]][0], *(simulate(case, n, every)[0] for every in STEPS[1:])]
        path, moved = extrapolated(rows)
        changes.append(path - rows[0])
    best, by_mesh = extrapolated([runs[n, STEPS[0]][0] for n in MESHES_IN_TIME])
    change, by_change = extrapolated(changes)
    return best + change, max(moved, by_mesh, by_change), cpu


def say(**line: Any) -> None:
    print(json.dumps(line), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", default="statics,princeton,dynamics")
    wanted = parser.parse_args().cases.split(",")
    exu.config.printToConsole = False
    say(kind="versions", exudyn=exu.__version__, python=".".join(map(str, sys.version_info[:3])))
    for case in STATICS if "statics" in wanted else ():
        for elements in MESHES:
            try:
                tip, cpu = equilibrium(case, elements)
                say(kind="static", case=case.name, elements=elements, tip=tip.tolist(), cpu_s=cpu)
            except Exception as failure:
                say(kind="static", case=case.name, elements=elements, tip=None, note=str(failure))
    for load in PRINCETON_LOADS if "princeton" in wanted else ():
        for angle in PRINCETON_ANGLES:
            tips = [equilibrium(princeton(load, angle), n)[0] for n in MESHES[1:]]
            say(kind="princeton", load=load, angle=angle, tip=extrapolated(tips)[0].tolist())
    for motion in DYNAMICS:
        if "dynamics" in wanted or motion.name in wanted:
            path, moved, cpu = refined(motion)
            say(kind="dynamic", case=motion.name, path=path.tolist(), moved=moved, cpu_s=cpu)


if __name__ == "__main__":
    main()
