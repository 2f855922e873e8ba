"""Worker of bench/run/zoo.py: the whip in Exudyn, a chain of planar, geometrically exact beams (quadratic elements).

    python zoo_exudyn.py ERROR < SCENE

Reads the scene as JSON and runs it in steps that are halved, to extrapolate the answer to step zero; then in the step
whose error is ERROR. An error is the largest distance of a beam's end, over all output times, in parts of the
chain's length, from that answer of the same elements. Damping of the beams is Kelvin and Voigt's, with the scene's
ratio at the first frequency of each, clamped. Generalised-alpha, spectral radius 0.95, index 3, modified Newton; no
step enters Python. Prints one line of JSON. Needs Exudyn and NumPy only.
"""

from __future__ import annotations

import json
import math
import sys
import time
from typing import Any

import exudyn as exu
import exudyn.utilities as eu
import numpy as np

ELEMENTS = 2  # of each beam
NEWTON = 1e-8  # absolute tolerance; with less, rounding stops it
HALVINGS = 11  # of the output interval
CLAMPED = 1.8751041  # the first root of cos x cosh x = -1


class Chain:
    """Beams below one another. Exudyn's x is the scene's x, its y points down, and angles count from straight down."""

    def __init__(self, scene: dict[str, Any]) -> None:
        self.scene = scene
        self.container = exu.SystemContainer()
        self.mbs = self.container.AddSystem()
        self.kept: list[Any] = []  # symbolic functions must outlive the run
        ground = self.mbs.AddNode(eu.NodePointGround())
        self.ground = self.mbs.AddMarker(eu.MarkerNodeCoordinate(nodeNumber=ground, coordinate=0))
        self.ends: list[int] = []
        self.length = 0.0
        for link in scene["link"]:
            self._hang(link)
        tip = float(scene["link"][-1]["tip"]["mass"])
        self.mbs.AddObject(eu.ObjectRigidBody2D(mass=tip, inertia=0, nodeNumber=self.ends[-1]))
        weight = -scene["gravity"][2] * tip
        self.mbs.AddLoad(eu.LoadCoordinate(markerNumber=self._marker(self.ends[-1], 1), load=weight))
        position = exu.OutputVariableType.Position
        kinds = {"storeInternal": True, "writeToFile": False, "outputVariableType": position}
        self.sensors = [self.mbs.AddSensor(eu.SensorNode(nodeNumber=n, **kinds)) for n in self.ends]
        self.mbs.Assemble()

    def _marker(self, node: int, coordinate: int) -> Any:
        return self.mbs.AddMarker(eu.MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate))

    def _hang(self, link: dict[str, Any]) -> None:
        """One more beam below the last one, on a hinge."""
        beam, material, add = link["beam"], link["beam"]["material"], self.mbs.AddObject
        r, E, nu = beam["section"]["radius"], material["youngs_modulus"], material["poisson_ratio"]
        A, I, l = math.pi * r**2, math.pi * r**4 / 4, beam["length"] / ELEMENTS
        mass, shear = material["density"] * A, 6 * (1 + nu) / (7 + 6 * nu) * E / (2 + 2 * nu) * A
        first = CLAMPED**2 * math.sqrt(E * I / (mass * beam["length"] ** 4))
        stiff = {"bendingStiffness": E * I, "axialStiffness": E * A, "shearStiffness": shear}
        inert = {"massPerLength": mass, "crossSectionInertia": material["density"] * I}
        damping = 2 * beam["damping_ratio"] / first * E * I
        places = [self.length + k * l / 2 for k in range(2 * ELEMENTS + 1)]
        nodes = [self.mbs.AddNode(eu.NodeRigidBody2D(referenceCoordinates=[0, y, 0])) for y in places]
        for k in range(ELEMENTS):
            three = {"nodeNumbers": nodes[2 * k : 2 * k + 3], "length": l}
            of = eu.ObjectBeamGeometricallyExact2D(**three, **stiff, **inert, bendingDamping=damping)
            body = self.mbs.AddMarker(eu.MarkerBodyMass(bodyNumber=add(of)))
            down = [0, -self.scene["gravity"][2], 0]
            self.mbs.AddLoad(eu.LoadMassProportional(markerNumber=body, loadVector=down))
        above = self.ends[-1] if self.ends else None
        for k in range(2):
            base = self.ground if above is None else self._marker(above, k)
            add(eu.CoordinateConstraint(markerNumbers=[base, self._marker(nodes[0], k)]))
        if above is None:
            self._swing(nodes[0])
        else:
            markers, damper = [self._marker(n, 2) for n in (above, nodes[0])], link["joint"]["damping"]
            add(eu.CoordinateSpringDamper(markerNumbers=markers, stiffness=0, damping=damper))
        self.length += beam["length"]
        self.ends.append(nodes[-1])

    def _swing(self, node: int) -> None:
        """Prescribes the first angle: of degree 5 between samples, where rate and acceleration are zero."""
        motion, s = self.scene["drive"][0]["motion"], exu.symbolic
        if any(motion["v"]) or any(motion["a"]):
            raise SystemExit("drive: samples must be at rest")
        t, q = motion["t"], [x - math.pi / 2 for x in motion["q"]]

        def offset(mbs: Any, time: Any, itemNumber: Any, lOffset: Any) -> Any:
            value = s.Real(q[-1])
            for k in reversed(range(len(t) - 1)):
                x = (time - t[k]) / (t[k + 1] - t[k])
                value = s.IfThenElse(
                    time < t[k + 1], q[k] + (q[k + 1] - q[k]) * x * x * x * (10.0 - 15.0 * x + 6.0 * x * x), value
                )
            return value

        kind = "ObjectConnectorCoordinate"
        law = eu.CreateSymbolicUserFunction(self.mbs, offset, "offsetUserFunction", itemTypeName=kind)
        self.kept.append(law)
        markers = [self.ground, self._marker(node, 2)]
        self.mbs.AddObject(eu.CoordinateConstraint(markerNumbers=markers, offsetUserFunction=law))

    def solve(self, every: int) -> tuple[float, np.ndarray]:
        """CPU time (s), and ends of the beams at the output times, (outputs + 1, beams, 2), by so many steps between
        two of these."""
        end, gap = self.scene["simulation"]["duration"], self.scene["simulation"]["interval"]
        s = exu.SimulationSettings()
        s.solution.file.write = False
        s.solution.sensors.writePeriod = gap
        s.linearSolver.solverType = exu.LinearSolverType.EigenSparse
        i = s.timeIntegration
        i.endTime, i.numberOfSteps, i.adaptiveStep = end, round(end / gap) * every, False
        i.generalizedAlpha.spectralRadius, i.generalizedAlpha.useIndex2Constraints = 0.95, False
        i.newton.useModifiedNewton, i.newton.absoluteTolerance = True, NEWTON
        started = time.process_time()
        self.mbs.SolveDynamic(s)
        spent = time.process_time() - started
        return spent, np.stack([np.array(self.mbs.GetSensorStoredData(n))[:, 1:3] for n in self.sensors], axis=1)


def main() -> None:
    scene, wanted = json.load(sys.stdin), float(sys.argv[1])
    exu.config.printToConsole = False
    runs = {}
    for k in range(3, HALVINGS):
        runs[2**k] = Chain(scene).solve(2**k)[1]
    finer, fine = runs[max(runs)], runs[max(runs) // 2]
    truth = (4 * finer - fine) / 3
    length = Chain(scene).length

    def off(answer: np.ndarray) -> float:
        return float(np.linalg.norm(answer - truth, axis=2).max() / length)

    middle = max(runs) // 8
    every = math.ceil(1.1 * middle * math.sqrt(off(runs[middle]) / wanted))  # second order
    tries = [Chain(scene).solve(every) for _ in range(2)]
    gap = scene["simulation"]["interval"]
    line = {"step": gap / every, "seconds": min(x[0] for x in tries), "error": off(tries[0][1])}
    print(json.dumps({**line, "exudyn": exu.__version__, "ends": truth[:: len(truth) // 4].tolist()}))


if __name__ == "__main__":
    main()
