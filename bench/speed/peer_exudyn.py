"""Worker of bench/speed/peers.py: Exudyn's planar geometrically exact beam (quadratic elements), and its ANCF cable.

Generalised-alpha, spectral radius 0.95, index 3, sparse solver, modified Newton with a loosened absolute tolerance:
with the default, 1e-10, Newton fails on thin steel, and with 1e-6 on the 10 m beam. A driven beam has its first node's
coordinates prescribed; motions and torques are Exudyn's symbolic functions, so that no step enters Python. Two links
are made with geometrically exact beams only: ANCF nodes have no angle that a torque or an inertia could act on.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import exudyn as exu
import exudyn.utilities as eu
import numpy as np
from peer_common import Case, measure, report, versions, wanted

TRUTH = {"exact": "bending, shear, stretch, rotary inertia (Exudyn)", "ANCF": "bending, stretch (Exudyn)"}
TOLERANCE = {"a": 1e-6, "b": 1e-4, "c": 1e-6}  # of Newton
# case: formulation: (elements per beam, steps between two output times)
SWEEP = {
    "a": {
        "exact": [(2, 5), (4, 5), (4, 10), (8, 10), (8, 20), (8, 40), (16, 40), (16, 100)],
        "ANCF": [(4, 5), (8, 5), (8, 10), (16, 10), (16, 20), (32, 40), (32, 100)],
    },
    "b": {
        "exact": [(2, 5), (4, 5), (8, 5), (8, 10), (8, 20), (8, 40), (16, 20), (16, 50), (16, 100)],
        "ANCF": [(4, 5), (8, 5), (8, 10), (16, 10), (16, 20), (16, 40), (32, 50)],
    },
    "c": {"exact": [(2, 5), (4, 5), (4, 10), (8, 10), (8, 20), (8, 40), (16, 40), (16, 100)]},
}
# Elements, and the steps of two runs that are extrapolated to step zero: the check, and the truth.
FINE = {
    "a": {"exact": [(12, 40, 80), (24, 50, 100)], "ANCF": [(24, 40, 80), (48, 50, 100)]},
    "b": {"exact": [(12, 20, 40), (24, 25, 50)], "ANCF": [(24, 20, 40), (48, 25, 50)]},
    "c": {"exact": [(12, 40, 80), (24, 50, 100)]},
}


def _offset(law: Callable[[Any], Any], angle: Callable[[Any], Any]) -> Callable[..., Any]:
    def offset(mbs: Any, t: Any, itemNumber: Any, lOffset: Any) -> Any:
        return law(angle(t))

    return offset


class Model:
    """A case in Exudyn. `solve` starts from rest each time."""

    def __init__(self, case: Case, formulation: str, elements: int, every: int) -> None:
        self.case, self.formulation = case, formulation
        self.container = exu.SystemContainer()
        self.mbs = self.container.AddSystem()
        self.functions: list[Any] = []  # symbolic functions must outlive the run
        ground = self.mbs.AddNode(eu.NodePointGround())
        self.ground = self.mbs.AddMarker(eu.MarkerNodeCoordinate(nodeNumber=ground, coordinate=0))
        beams = [self._beam(case.hub + b * case.length, elements) for b in range(case.beams)]
        if case.spin:
            self._spin(beams[0][0])
        else:
            self._arm(beams)
        output = exu.OutputVariableType.Position
        self.sensor = self.mbs.AddSensor(
            eu.SensorNode(nodeNumber=beams[-1][-1], storeInternal=True, writeToFile=False, outputVariableType=output)
        )
        self.settings = self._settings(every)
        self.mbs.Assemble()

    def _settings(self, every: int) -> Any:
        s = exu.SimulationSettings()
        s.solution.sensors.writePeriod = self.case.end / self.case.outputs
        s.solution.file.write = False
        s.linearSolver.solverType = exu.LinearSolverType.EigenSparse
        i = s.timeIntegration
        i.endTime, i.numberOfSteps = self.case.end, self.case.outputs * every
        i.generalizedAlpha.spectralRadius = 0.95
        i.generalizedAlpha.useIndex2Constraints = False
        i.newton.useModifiedNewton = True
        i.newton.absoluteTolerance = TOLERANCE[self.case.name]
        i.adaptiveStep = False
        return s

    def _beam(self, start: float, elements: int) -> list[int]:
        """Nodes of a beam along x."""
        s, l = self.case.section, self.case.length / elements
        add = self.mbs.AddObject
        if self.formulation == "ANCF":
            at = [start + k * l for k in range(elements + 1)]
            nodes = [self.mbs.AddNode(eu.NodePoint2DSlope1(referenceCoordinates=[x, 0, 1, 0])) for x in at]
            for k in range(elements):
                shared = dict(massPerLength=s.rhoA, bendingStiffness=s.EI, axialStiffness=s.EA)
                add(eu.ObjectANCFCable2D(nodeNumbers=nodes[k : k + 2], length=l, **shared))
            return nodes
        at = [start + k * l / 2 for k in range(2 * elements + 1)]
        nodes = [self.mbs.AddNode(eu.NodeRigidBody2D(referenceCoordinates=[x, 0, 0])) for x in at]
        for k in range(elements):
            shared = dict(massPerLength=s.rhoA, crossSectionInertia=s.rhoI, bendingStiffness=s.EI)
            stiff = dict(axialStiffness=s.EA, shearStiffness=s.GA)
            add(eu.ObjectBeamGeometricallyExact2D(nodeNumbers=nodes[2 * k : 2 * k + 3], length=l, **shared, **stiff))
        return nodes

    def _marker(self, node: int, coordinate: int) -> Any:
        return self.mbs.AddMarker(eu.MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate))

    def _symbolic(self, function: Callable[..., Any], name: str, of: str) -> Any:
        self.functions.append(eu.CreateSymbolicUserFunction(self.mbs, function, name, itemTypeName=of))
        return self.functions[-1]

    def _spin(self, node: int) -> None:
        """Prescribes a node's displacement and angle (or slope)."""
        assert self.case.spin
        (speed, T), r, s = self.case.spin, self.case.hub, exu.symbolic
        w = 2 * math.pi / T

        def angle(t: Any) -> Any:
            early = speed / T * (t * t / 2 + (s.cos(w * t) - 1) / w**2)
            return s.IfThenElse(t < T, early, speed * (t - T / 2))

        laws = [lambda q: r * (s.cos(q) - 1), lambda q: r * s.sin(q)]
        laws += [lambda q: s.cos(q) - 1, s.sin] if self.formulation == "ANCF" else [lambda q: q]
        for k, law in enumerate(laws):
            function = self._symbolic(_offset(law, angle), "offsetUserFunction", "ObjectConnectorCoordinate")
            markers = [self.ground, self._marker(node, k)]
            self.mbs.AddObject(eu.CoordinateConstraint(markerNumbers=markers, offsetUserFunction=function))

    def _arm(self, beams: list[list[int]]) -> None:
        """Hubs and payload as rigid bodies on the beams' nodes, hinges as equal displacements, torques on angles."""
        case, add = self.case, self.mbs.AddObject
        below = None
        for b, nodes in enumerate(beams):
            add(eu.ObjectRigidBody2D(mass=case.hub_mass[b], inertia=case.hub_inertia[b], nodeNumber=nodes[0]))
            for k in range(2):
                base = self.ground if below is None else self._marker(below, k)
                add(eu.CoordinateConstraint(markerNumbers=[base, self._marker(nodes[0], k)]))
            self._torque(nodes[0], b, 1.0)
            if below is not None:
                self._torque(below, b, -1.0)
            below = nodes[-1]
        add(eu.ObjectRigidBody2D(mass=case.payload[0], inertia=case.payload[1], nodeNumber=beams[-1][-1]))

    def _torque(self, node: int, joint: int, sign: float) -> None:
        knots, values, s = self.case.knots, self.case.torques[joint], exu.symbolic

        def load(mbs: Any, t: Any, load: Any) -> Any:
            value = s.Real(sign * values[-1])
            for k in reversed(range(len(knots) - 1)):
                slope = (values[k + 1] - values[k]) / (knots[k + 1] - knots[k])
                value = s.IfThenElse(t < knots[k + 1], sign * (values[k] + slope * (t - knots[k])), value)
            return value

        function = self._symbolic(load, "loadUserFunction", "LoadCoordinate")
        self.mbs.AddLoad(eu.LoadCoordinate(markerNumber=self._marker(node, 2), load=1.0, loadUserFunction=function))

    def solve(self) -> np.ndarray | None:
        """Tip (outputs + 1, 2)."""
        try:
            self.mbs.SolveDynamic(self.settings)
        except exu.SolverError:
            return None
        rows = np.array(self.mbs.GetSensorStoredData(self.sensor))
        return rows[:, 1:3]


def solved(case: Case, formulation: str, elements: int, every: int) -> np.ndarray:
    return Model(case, formulation, elements, every).solve()


def truth(case: Case, formulation: str) -> None:
    """Two step sizes extrapolated to zero (second order), on the finest mesh; a coarser pair is the check."""
    answers = []
    for elements, coarse, fine in FINE[case.name][formulation]:
        a, b = solved(case, formulation, elements, coarse), solved(case, formulation, elements, fine)
        ratio = (fine / coarse) ** 2
        answers.append((ratio * b - a) / (ratio - 1))
    converged = float(np.linalg.norm(answers[1] - answers[0], axis=1).max())
    setting = "{} elements, {} and {} steps extrapolated".format(
        FINE[case.name][formulation][1][0], *(case.outputs * n for n in FINE[case.name][formulation][1][1:])
    )
    report("truth", case, f"Exudyn {formulation}", setting, TRUTH[formulation], answers[1], converged=converged)


def run(case: Case, formulation: str, elements: int, every: int) -> None:
    """One setting."""
    setup, model = measure(lambda: Model(case, formulation, elements, every))
    cpu, path = measure(model.solve)
    setting = f"{elements} elements, step {case.end / case.outputs / every:.3g} s"
    report("run", case, f"Exudyn {formulation}", setting, TRUTH[formulation], path, cpu_s=cpu, setup_s=setup)


if __name__ == "__main__":
    exu.config.printToConsole = False
    versions(exudyn=exu.__version__)
    for case, wants_truth in wanted():
        for formulation, settings in SWEEP[case.name].items():
            if wants_truth:
                truth(case, formulation)
            else:
                for setting in settings:
                    run(case, formulation, *setting)
