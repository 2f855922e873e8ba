"""Worker of bench/run/loops.py: mechanisms of beams in Exudyn.

    python loops_exudyn.py fourbar|slider|held|misaligned  # one line of JSON
    python loops_exudyn.py fourbar 8 2000            # with so many elements a beam and steps: the run alone

The planar ones are of geometrically exact beams with quadratic elements, pinned together, with Kelvin and Voigt's
damping in all strains. Finer and finer elements and steps are extrapolated to none; then the cheapest of all pairs is
sought whose error is 1e-6 of the span. Generalised-alpha, spectral radius 0.95, index 3, modified Newton; no step
enters Python. Needs Exudyn and NumPy only; loops_cases.py has the numbers.
"""

from __future__ import annotations

import json
import sys
import time
from itertools import pairwise
from typing import Any

import exudyn as exu
import exudyn.utilities as eu
import numpy as np
from loops_cases import FOURBAR, HELD, MISALIGNED, OUTPUTS, SLIDER, Held, Planar

ELEMENTS, STEPS = (2, 4, 8, 16, 32), (10, 20, 40, 80, 160)  # of each beam; between two outputs
ERROR = 1e-6  # of the span, at which times are compared
NEWTON = 1e-5  # absolute tolerance; with less, rounding stops it


class Model:
    def __init__(self, case: Planar, elements: int) -> None:
        self.case = case
        self.container = exu.SystemContainer()
        self.mbs = self.container.AddSystem()
        self.kept: list[Any] = []  # symbolic functions must outlive the run
        ground = self.mbs.AddNode(eu.NodePointGround())
        self.ground = self.mbs.AddMarker(eu.MarkerNodeCoordinate(nodeNumber=ground, coordinate=0))
        beams = [self._beam(*ends, elements) for ends in case.places()]
        if isinstance(case, Held):
            self._hold(beams)
            self._watch([beams[2][elements], beams[2][-1]])
            return
        crank, coupler = beams[:2]
        add = self.mbs.AddObject
        for k in range(2):
            self._equal(self.ground, self._marker(crank[0], k))
            self._equal(self._marker(crank[-1], k), self._marker(coupler[0], k))
        if case.base is None:  # a block slides along x
            self._equal(self.ground, self._marker(coupler[-1], 1))
            add(eu.ObjectRigidBody2D(mass=case.block, inertia=0, nodeNumber=coupler[-1]))
        else:
            for k in range(2):
                self._equal(self._marker(coupler[-1], k), self._marker(beams[2][0], k))
                self._equal(self.ground, self._marker(beams[2][-1], k))
        if case.turn:
            self._driven(crank[0])
        else:
            add(eu.ObjectRigidBody2D(mass=0, inertia=case.hub, nodeNumber=crank[0]))
            self._torque(crank[0])
        self._watch([coupler[len(coupler) // 2], coupler[-1]])

    def _hold(self, beams: list[list[int]]) -> None:
        """Shoulders and elbows are hinges; hands are rigid on the bar."""
        for k in range(2):
            self._equal(self.ground, self._marker(beams[0][0], k))
            self._equal(self.ground, self._marker(beams[-1][-1], k))
        for j, (a, b) in enumerate(pairwise(beams)):
            for k in range(3 if j in (1, 2) else 2):
                self._equal(self._marker(a[-1], k), self._marker(b[0], k))
        for node, share in ((beams[0][0], 1.0), (beams[-1][-1], 0.5)):
            self.mbs.AddObject(eu.ObjectRigidBody2D(mass=0, inertia=self.case.hub, nodeNumber=node))
            self._torque(node, share)

    def _watch(self, watched: list[int]) -> None:
        kinds = {"storeInternal": True, "writeToFile": False, "outputVariableType": exu.OutputVariableType.Position}
        self.sensors = [self.mbs.AddSensor(eu.SensorNode(nodeNumber=n, **kinds)) for n in watched]
        self.mbs.Assemble()

    def _marker(self, node: int, coordinate: int) -> Any:
        return self.mbs.AddMarker(eu.MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate))

    def _equal(self, a: Any, b: Any) -> None:
        self.mbs.AddObject(eu.CoordinateConstraint(markerNumbers=[a, b]))

    def _beam(self, start: Any, end: Any, elements: int) -> list[int]:
        case, add = self.case, self.mbs.AddObject
        start, end = np.array(start), np.array(end)
        length = float(np.hypot(*(end - start))) / elements
        places = [start + (end - start) * k / (2 * elements) for k in range(2 * elements + 1)]
        nodes = [self.mbs.AddNode(eu.NodeRigidBody2D(referenceCoordinates=[*p, 0])) for p in places]
        s = case.stiffness()
        for k in range(elements):
            of = eu.ObjectBeamGeometricallyExact2D(
                nodeNumbers=nodes[2 * k : 2 * k + 3], length=length, massPerLength=s["mass"],
                crossSectionInertia=s["turning"], bendingStiffness=s["EI"], axialStiffness=s["EA"],
                shearStiffness=s["GA"], bendingDamping=case.retardation * s["EI"],
                axialDamping=case.retardation * s["EA"], shearDamping=case.retardation * s["GA"],
            )  # fmt: skip
            body = self.mbs.AddMarker(eu.MarkerBodyMass(bodyNumber=add(of)))
            self.mbs.AddLoad(eu.LoadMassProportional(markerNumber=body, loadVector=[0, -case.gravity, 0]))
        return nodes

    def _law(self, function: Any, name: str, of: str) -> Any:
        self.kept.append(eu.CreateSymbolicUserFunction(self.mbs, function, name, itemTypeName=of))
        return self.kept[-1]

    def _torque(self, node: int, share: float = 1.0) -> None:
        knots, values, s = self.case.knots, [share * x for x in self.case.torques], exu.symbolic

        def load(mbs: Any, t: Any, load: Any) -> Any:
            value = s.Real(values[-1])
            for k in reversed(range(len(knots) - 1)):
                slope = (values[k + 1] - values[k]) / (knots[k + 1] - knots[k])
                value = s.IfThenElse(t < knots[k + 1], values[k] + slope * (t - knots[k]), value)
            return value

        law = self._law(load, "loadUserFunction", "LoadCoordinate")
        self.mbs.AddLoad(eu.LoadCoordinate(markerNumber=self._marker(node, 2), load=0, loadUserFunction=law))

    def _driven(self, node: int) -> None:
        turn, T = self.case.turn, self.case.end

        def offset(mbs: Any, t: Any, itemNumber: Any, lOffset: Any) -> Any:
            x = t * (1.0 / T)
            return turn * x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)

        law = self._law(offset, "offsetUserFunction", "ObjectConnectorCoordinate")
        markers = [self.ground, self._marker(node, 2)]
        self.mbs.AddObject(eu.CoordinateConstraint(markerNumbers=markers, offsetUserFunction=law))

    def solve(self, every: int, newton: float = NEWTON) -> tuple[float, np.ndarray]:
        """CPU time (s), and places of the coupler's middle and end, (outputs + 1, 4), by so many steps between two."""
        s = exu.SimulationSettings()
        s.solution.file.write = False
        s.solution.sensors.writePeriod = self.case.end / OUTPUTS
        s.linearSolver.solverType = exu.LinearSolverType.EigenSparse
        i = s.timeIntegration
        i.endTime, i.numberOfSteps, i.adaptiveStep = self.case.end, OUTPUTS * every, False
        i.generalizedAlpha.spectralRadius, i.generalizedAlpha.useIndex2Constraints = 0.95, False
        i.newton.useModifiedNewton, i.newton.absoluteTolerance = True, newton
        started = time.process_time()
        self.mbs.SolveDynamic(s)
        spent = time.process_time() - started
        return spent, np.hstack([np.array(self.mbs.GetSensorStoredData(n))[:, 1:3] for n in self.sensors])


class Misaligned:
    """Bars in space, of linear elements."""

    def __init__(self, elements: int) -> None:
        case = MISALIGNED
        self.container = exu.SystemContainer()
        self.mbs = self.container.AddSystem()
        mbs = self.mbs
        ground = mbs.AddObject(eu.ObjectGround())
        ends, middles = [], []
        for k, side in enumerate(case.sides):
            a, b = (np.array([*case.corners[j], 0.0]) for j in (k, k + 1))
            x = (b - a) / np.linalg.norm(b - a)
            R = np.column_stack([x, np.cross([0, 0, 1.0], x), [0, 0, 1.0]])
            section = exu.BeamSection()
            section.stiffnessMatrix, section.massPerLength, section.inertia = case.section(side)
            section.dampingMatrix = case.retardation * section.stiffnessMatrix
            turn = eu.RotationMatrix2EulerParameters(R)
            nodes = [mbs.AddNode(eu.NodeRigidBodyEP(referenceCoordinates=[*(a + (b - a) * j / elements), *turn]))
                     for j in range(elements + 1)]  # fmt: skip
            long = float(np.linalg.norm(b - a)) / elements
            for pair in pairwise(nodes):
                mbs.AddObject(eu.ObjectBeamGeometricallyExact(nodeNumbers=list(pair), length=long, sectionData=section))
            ends.append((nodes[0], nodes[-1], R))
            middles.append(nodes[elements // 2])

        def marker(node: int) -> Any:
            return mbs.AddMarker(eu.MarkerNodeRigid(nodeNumber=node))

        def on_ground(corner: int) -> Any:
            return mbs.AddMarker(eu.MarkerBodyRigid(bodyNumber=ground, localPosition=[*case.corners[corner], 0.0]))

        c, s = np.cos(case.tilt), np.sin(case.tilt)
        tilted = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])  # third column: the axis (sin, 0, cos)
        I = np.eye(3)

        def hinge(a: Any, Ra: Any, b: Any, Rb: Any, axes: Any = I, driven: int = 0, **more: Any) -> None:
            """At rest the hinge has these axes in the world."""
            more |= {"rotationMarker0": Ra.T @ axes, "rotationMarker1": Rb.T @ axes}
            held = [1, 1, 1, 1, 1, driven]
            mbs.AddObject(eu.GenericJoint(markerNumbers=[a, b], constrainedAxes=held, **more))

        def offset(mbs: Any, t: float, item: int, parameters: Any) -> list[float]:
            return [0.0, 0.0, 0.0, 0.0, 0.0, case.angle(t)]

        (a0, a1, Ra), (b0, b1, Rb), (c0, c1, Rc) = ends
        hinge(on_ground(0), I, marker(a0), Ra, driven=1, offsetUserFunction=offset)
        hinge(marker(a1), Ra, marker(b0), Rb)
        hinge(marker(b1), Rb, marker(c0), Rc, tilted)
        hinge(marker(c1), Rc, on_ground(3), I)
        kinds = {"storeInternal": True, "writeToFile": False, "outputVariableType": exu.OutputVariableType.Position}
        self.sensors = [mbs.AddSensor(eu.SensorNode(nodeNumber=n, **kinds)) for n in (b1, *middles[1:])]
        mbs.Assemble()

    def solve(self, every: int, newton: float = 1e-6) -> tuple[float, np.ndarray]:
        s = exu.SimulationSettings()
        s.linearSolver.solverType = exu.LinearSolverType.EigenSparse
        s.solution.file.write = False
        s.solution.sensors.writePeriod = MISALIGNED.end / OUTPUTS
        i = s.timeIntegration
        i.endTime, i.numberOfSteps, i.adaptiveStep = MISALIGNED.end, OUTPUTS * every, False
        i.generalizedAlpha.spectralRadius, i.newton.useModifiedNewton = 0.95, False
        i.newton.absoluteTolerance = i.newton.relativeTolerance = newton
        start = time.process_time()
        self.mbs.SolveDynamic(s)
        cpu = time.process_time() - start
        return cpu, np.hstack([np.array(self.mbs.GetSensorStoredData(x))[:, 1:4] for x in self.sensors])


def misaligned() -> None:
    """Errors of order 2 and 4 in the elements' length are taken away. Steps of half the length change more: Newton's
    tolerance cannot be small enough for them, because rounding stops it."""

    def solved(elements: int, every: int) -> np.ndarray:
        for newton in (1e-6, 1e-5, 1e-4):  # rounding stops it where this is too small for the elements
            try:
                return Misaligned(elements).solve(every, newton)[1]
            except exu.SolverError:
                continue
        raise SystemExit(f"no solution with {elements} elements, {every} steps")

    a, b, c = (solved(n, 24) for n in (8, 16, 32))
    first, second = (4 * b - a) / 3, (4 * c - b) / 3
    fine = (16 * second - first) / 15
    by_steps = float(np.abs(solved(8, 48) - a).max())
    print(json.dumps({"exudyn": exu.__version__, "by elements": float(np.abs(second - fine).max()),
                      "by steps": by_steps, "truth": fine.tolist()}))  # fmt: skip


def main() -> None:
    exu.config.printToConsole = False
    if sys.argv[1] == "misaligned":
        misaligned()
        return
    case = {"fourbar": FOURBAR, "slider": SLIDER, "held": HELD}[sys.argv[1]]
    if len(sys.argv) > 2:
        spent, places = Model(case, int(sys.argv[2])).solve(int(sys.argv[3]) // OUTPUTS)
        print(json.dumps({"seconds": spent, "places": places.tolist()}))
        return
    span = case.span
    runs = {(n, e): Model(case, n).solve(e) for n in ELEMENTS for e in STEPS if n < ELEMENTS[-1] or e >= STEPS[-3]}

    def at_no_step(n: int) -> np.ndarray:
        """By halves of the step: errors of order 2, then of order 4, taken away."""
        a, b, c = (runs[n, e][1] for e in STEPS[-3:])
        first, second = (4 * b - a) / 3, (4 * c - b) / 3
        return (16 * second - first) / 15

    fine = {n: at_no_step(n) for n in ELEMENTS}
    change = [float(np.abs(fine[a] - fine[b]).max() / span) for a, b in pairwise(ELEMENTS)]
    truth = fine[ELEMENTS[-1]] + (fine[ELEMENTS[-1]] - fine[ELEMENTS[-2]]) / 15
    for n in ELEMENTS:  # the fewest steps that this mesh needs
        mesh, whole = (float(np.abs(x - truth).max() / span) for x in (fine[n], runs[n, STEPS[-1]][1]))
        if mesh < 0.9 * ERROR:
            every = int(np.ceil(STEPS[-1] * np.sqrt(whole / ERROR)))
            runs[n, every] = Model(case, n).solve(every)
            while np.abs(runs[n, every][1] - truth).max() / span > ERROR:
                every = int(np.ceil(1.03 * every))
                runs[n, every] = Model(case, n).solve(every)
            break
    rows = [{"elements": n, "steps": e * OUTPUTS, "seconds": x[0], "error": float(np.abs(x[1] - truth).max() / span)}
            for (n, e), x in runs.items()]  # fmt: skip
    a, b = (runs[ELEMENTS[-1], e][1] for e in STEPS[-2:])
    doubt = float(np.abs((4 * b - a) / 3 - fine[ELEMENTS[-1]]).max() / span)
    print(json.dumps({"exudyn": exu.__version__, "by elements": change, "by steps": doubt, "runs": rows,
                      "truth": truth.tolist()}))  # fmt: skip


if __name__ == "__main__":
    main()
