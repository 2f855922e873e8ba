"""Worker of bench/speed/peers.py: flexarm itself, with every integrator that it has.

`ADJUST` says what each integrator is swept over; one that it does not name is taken to have a fixed `step`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import flexarm as fa
import numpy as np
from flexarm.run.integrators import INTEGRATORS
from peer_common import Case, Section, measure, report, versions, wanted

TRUTH, WHOLE = "bending, rotary inertia", "bending, shear, stretch, rotary inertia"
CAP = 1.0  # s of CPU for one run: no tighter setting and no more modes are tried beyond
SAMPLES = 33  # of the spin-up's motion, quintic between: exact to 1e-9 rad
# order, basis, numbers of modes: with more, Legendre modes converge faster, and the error of order 2 stays
MODELS: list[tuple[int | str, str, range]] = [
    ("exact", "legendre", range(2, 7)),
    ("exact", "clamped-free", range(1, 5)),
    (2, "clamped-free", range(1, 4)),
]

STRETCH = "b"  # the case whose beam stretches enough to matter: at order "exact" it has all strains there


def strains(case: Case, modes: int, order: int | str) -> dict[str, int]:
    """Shapes besides those of bending: shear and extension as Exudyn's beam has them, where the case asks for it."""
    n = (modes + 1) // 2
    return {"shear": n, "extension": n} if case.name == STRETCH and order == "exact" else {}


Setting = tuple[str, dict[str, Any]]  # what the table says, and the arguments of fa.simulate


def ida(case: Case, modes: int) -> Iterator[list[Setting]]:
    """Tolerances from loose to tight, about as small as the error of that many modes."""
    for max_order in (5, 2):
        tolerances = [10.0**-k for k in range(max(2, modes), modes + 3)]
        yield [
            (f"rtol {r:.0e}, BDF 1-{max_order}", {"rtol": r, "atol": 1e-2 * r, "max_order": max_order})
            for r in tolerances
        ]


def fixed(case: Case, modes: int) -> Iterator[list[Setting]]:
    """Steps that divide the output times, from long to short."""
    steps = [case.end / case.outputs / n for n in (1, 2, 5, 10, 20, 50, 100)]
    yield [(f"step {h:.3g} s", {"step": h}) for h in steps]


def gauss(case: Case, modes: int) -> Iterator[list[Setting]]:
    """Steps from long to short, which need not divide the output times; of each the order, and how far it is solved."""
    steps = [case.end / n for n in (12, 25, 50, 100, 200, 400, 800, 1600)]
    for stages, rtol in ((4, 1e-6), (4, 1e-12), (3, 1e-6), (2, 1e-6)):
        yield [
            (f"{stages} stages, step {h:.3g} s, rtol {rtol:.0e}", {"step": h, "stages": stages, "rtol": rtol})
            for h in steps
        ]


ADJUST = {"ida": ida, "implicit": fixed, "gauss": gauss, "rk4": fixed}


def section(s: Section) -> tuple[fa.sections.GeneralSection, fa.Material]:
    """A section and a material with these stiffnesses and inertias."""
    density, correction = 1000.0, 5 / 6
    area, moment = s.rhoA / density, s.rhoI / density
    material = fa.Material(density, s.EI / moment, shear_modulus=s.GA / (correction * area))
    return fa.sections.GeneralSection(area, moment, moment, 2 * moment, correction), material


def arm(case: Case, modes: int, order: int | str = "exact", basis: str = "legendre", **beam: Any) -> fa.Arm:
    """The case's arm."""
    shapes = {"bending_y": modes, "shear_y": beam.pop("shear", 0), "extension": beam.pop("extension", 0)}
    elastic = fa.Beam(case.length, *section(case.section), shapes, basis, order, **beam)
    links = []
    for b in range(case.beams):
        hub = fa.RigidBody(end=(case.hub, 0, 0))
        if not case.spin:
            hub = fa.RigidBody(case.hub_mass[b], inertia=(0, 0, case.hub_inertia[b]), end=(case.hub, 0, 0))
        last = b == case.beams - 1 and case.payload[0] > 0
        tip = fa.RigidBody(case.payload[0], inertia=(0, 0, case.payload[1])) if last else None
        links.append(fa.Link(fa.Revolute("z"), hub, elastic, tip))
    return fa.Arm(links)


def drive(case: Case) -> dict[int, fa.Motion | fa.Torque]:
    """Sampled, so that no step enters Python."""
    if not case.spin:
        return {b: fa.Torque(case.knots, case.torques[b]) for b in range(case.beams)}
    t = np.linspace(0.0, case.spin[1], SAMPLES)
    if case.end > t[-1]:
        t = np.append(t, case.end)
    return {0: fa.Motion(t, *np.array([case.angle(x) for x in t]).T)}


def run(case: Case, modes: int, order: int | str, basis: str, integrator: str) -> float:
    """All settings of an integrator on one model; the CPU time of the cheapest (s)."""
    more = strains(case, modes, order)
    setup, model = measure(lambda: arm(case, modes, order, basis, **more))
    laws, cheapest = drive(case), CAP
    for settings in ADJUST.get(integrator, fixed)(case, modes):
        for name, arguments in settings:

            def simulate(arguments: dict[str, Any] = arguments) -> fa.Result:
                return fa.simulate(model, case.times, drive=laws, integrator=integrator, **arguments)

            cpu, path, note = 0.0, None, ""
            try:
                cpu, result = measure(simulate)
                path, cheapest = result.frame()[0][:, :2], min(cpu, cheapest)
            except (fa.SimulationError, ValueError) as failure:
                note = str(failure)
            method = f"flexarm {integrator}, order {order}{', all strains' if more else ''}"
            setting = f"{modes} {basis} modes, {name}"
            report("run", case, method, setting, WHOLE if more else TRUTH, path, cpu_s=cpu, setup_s=setup, note=note)
            if cpu > CAP:
                break
        if cheapest >= CAP:
            break
    return cheapest


def sweep(case: Case, integrator: str) -> None:
    """Modes upwards, until they cost too much."""
    for order, basis, counts in MODELS:
        for modes in counts:
            if run(case, modes, order, basis, integrator) >= CAP:
                break


def truth(case: Case) -> None:
    """With all strains: more modes and half the step are the check."""
    paths = []
    for modes, step in ((9, 0.15), (11, 0.075)):
        model = arm(case, modes, **strains(case, modes, "exact"))
        result = fa.simulate(model, case.times, drive=drive(case), integrator="gauss", step=step)
        paths.append(result.frame()[0][:, :2])
    converged = float(np.linalg.norm(paths[1] - paths[0], axis=1).max())
    setting = "11 + 6 + 6 Legendre modes, step 0.075 s"
    report("truth", case, "flexarm gauss", setting, WHOLE, paths[1], converged=converged)


if __name__ == "__main__":
    versions(flexarm=fa.__version__, numpy=np.__version__)
    for case, wants_truth in wanted():
        if wants_truth:
            if case.name == STRETCH:
                truth(case)
            continue
        for integrator in INTEGRATORS:
            sweep(case, integrator)
