"""Worker of bench/run/loops.py: mechanisms of beams in Exudyn.

    python loops_exudyn.py fourbar|slider            # one line of JSON
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
from typing import Any

import exudyn as exu
import exudyn.utilities as eu
import numpy as np
from loops_cases import FOURBAR, OUTPUTS, SLIDER, Planar

NEWTON = 1e-6  # absolute tolerance; with less, rounding stops it


class Model:
    def __init__(self, case: Planar, elements: int) -> None:
        self.case = case
        self.container = exu.SystemContainer()
        self.mbs = self.container.AddSystem()
        self.kept: list[Any] = []  # symbolic functions must outlive the run
        ground = self.mbs.AddNode(eu.NodePointGround())
        self.ground = self.mbs.AddMarker(eu.MarkerNodeCoordinate(nodeNumber=ground, coordinate=0))
        beams = [self._beam(*ends, elements) for ends in case.places()]
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
        kinds = {"storeInternal": True, "writeToFile": False, "outputVariableType": exu.OutputVariableType.Position}
        watched = [coupler[len(coupler) // 2], coupler[-1]]
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

    def _torque(self, node: int) -> None:
        knots, values, s = self.case.knots, self.case.torques, exu.symbolic

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


def main() -> None:
    exu.config.printToConsole = False
    case = {"fourbar": FOURBAR, "slider": SLIDER}[sys.argv[1]]
    if len(sys.argv) > 2:
        spent, places = Model(case, int(sys.argv[2])).solve(int(sys.argv[3]) // OUTPUTS)
        print(json.dumps({"seconds": spent, "places": places.tolist()}))
        return
    span = case.span
    elements, every = (4, 8, 16, 32), (10, 20, 40, 80, 160)
    runs = {}
    for n in elements:
        for e in every:
            if n == 32 and e < 80:
                continue
            runs[n, e] = Model(case, n).solve(e)

    def at_no_step(n: int) -> np.ndarray:
        a, b = runs[n, every[-2]][1], runs[n, every[-1]][1]
        return (4 * b - a) / 3

    fine = {n: at_no_step(n) for n in elements}
    orders = [float(np.abs(fine[a] - fine[b]).max() / np.abs(fine[b] - fine[c]).max())
              for a, b, c in zip(elements, elements[1:], elements[2:], strict=False)]  # fmt: skip
    truth = fine[32] + (fine[32] - fine[16]) / (orders[-1] - 1)
    rows = [{"elements": n, "steps": e * OUTPUTS, "seconds": x[0], "error": float(np.abs(x[1] - truth).max() / span)}
            for (n, e), x in runs.items()]  # fmt: skip
    doubt = float(np.abs(truth - fine[32]).max() / span)
    print(json.dumps({"exudyn": exu.__version__, "orders": orders, "doubt": doubt, "runs": rows,
                      "truth": truth.tolist()}))  # fmt: skip


if __name__ == "__main__":
    main()
