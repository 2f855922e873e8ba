"""Worker of bench/speed/peers.py: MuJoCo, with each beam cut into rigid segments on hinges with springs.

N hinges at the middles of N equal pieces, stiffness N EI / L each, join rigid rods: that is a bending beam without
shear and stretch, of second order in 1/N. A driven hub is a hinge with a huge inertia, pushed so that it has the right
motion at every step's end. Steps run in C++ (mujoco.rollout), with the control held over a step. flexarm writes the
model, so that it runs beside it: pip install 'flexarm[mjcf]'.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace

import flexarm as fa
import mujoco
import numpy as np
import peer_flexarm
from flexarm.robots.segments import segmented
from flexarm.robots.write import mjcf
from mujoco import rollout
from peer_common import Case, measure, report, versions, wanted

HEAVY = 1e12  # inertia of a driven hub over the beam's: reactions move it by no more than rounding does
TRUTH = "bending, rotary inertia"
# case: integrator: (hinges per beam, steps between two output times); the explicit ones just below their limit
SWEEP = {
    "a": {"RK4": [(5, 8), (10, 25), (20, 100)], "implicitfast": [(5, 10), (10, 36), (20, 140), (40, 560)]},
    "b": {"RK4": [(5, 8), (10, 24), (20, 100)], "implicitfast": [(5, 10), (10, 36), (20, 140), (40, 560)]},
    "c": {"RK4": [(5, 12), (10, 40), (20, 160)], "implicitfast": [(5, 20), (10, 60), (20, 240)]},
}
for _settings in SWEEP.values():
    _settings["discrete"] = [(5, 10), (10, 20), (20, 50), (40, 100), (40, 400)]


def _heavy(case: Case) -> float:
    return HEAVY * case.section.rhoA * case.length**3 / 3


def xml(case: Case, n: int, integrator: str, step: float) -> str:
    """The model: the arm's own file (`Arm.to_mjcf`) with springs as they follow from the section, not fitted."""
    given = peer_flexarm.arm(case, 1)
    if case.spin:
        driven = fa.Revolute("z", reflected_inertia=_heavy(case))
        given = fa.Arm([replace(link, joint=driven) for link in given])
    root = ET.fromstring(mjcf(segmented(given, n, fit=False)))
    for body in root.iter("body"):  # shapes to look at take time
        for shape in body.findall("geom"):
            body.remove(shape)
    option = root.find("option")
    assert option is not None
    option.attrib.update(timestep=repr(step), integrator=integrator)
    ET.SubElement(option, "flag", contact="disable", constraint="disable", autoreset="disable")
    for motor in root.iter("motor"):
        motor.set("gear", repr(_heavy(case) if case.spin else 1.0))
    return ET.tostring(root, encoding="unicode")


def tip(case: Case, n: int, q: np.ndarray) -> np.ndarray:
    """Tip (..., 2) of joint angles q (..., nv)."""
    l = case.length / n
    lengths = ([case.hub + l / 2] + [l] * (n - 1) + [l / 2]) * case.beams
    angles = np.cumsum(q, axis=-1)
    return np.stack([np.cos(angles) @ lengths, np.sin(angles) @ lengths], axis=-1)


def controls(case: Case, steps: int, integrator: str) -> np.ndarray:
    """Joint torques, or the acceleration of a driven hub (steps, joints), held over each step.

    A driven hub has the right speed (RK4) or angle (the others, which move by the new speed) at every step's end.
    """
    t = np.linspace(0.0, case.end, steps + 1)
    if case.spin:
        angle, speed = np.array([case.angle(x)[:2] for x in t]).T
        if integrator != "RK4":
            speed = np.append(0.0, np.diff(angle) / t[1])
        return np.diff(speed)[:, None] / t[1]
    return np.stack([case.torque((t[1:] + t[:-1]) / 2, b) for b in range(case.beams)], axis=1)


def run(case: Case, integrator: str, n: int, every: int) -> None:
    """One setting."""
    steps = every * case.outputs

    text = xml(case, n, integrator, case.end / steps)

    def build() -> tuple[mujoco.MjModel, mujoco.MjData]:
        model = mujoco.MjModel.from_xml_string(text)
        return model, mujoco.MjData(model)

    setup, (model, data) = measure(build)
    control = controls(case, steps, integrator)
    start = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    cpu, (states, _) = measure(lambda: rollout.rollout(model, data, start, control[None]))
    rows = np.vstack([np.zeros(model.nq), states[0, every - 1 :: every, 1 : 1 + model.nq]])
    setting = f"{n} hinges, step {case.end / steps:.3g} s"
    path = tip(case, n, rows)
    report("run", case, f"MuJoCo {integrator}", setting, TRUTH, path, cpu_s=cpu, setup_s=setup)


if __name__ == "__main__":
    versions(mujoco=mujoco.__version__)
    for case, truth in wanted():
        if not truth:
            for integrator, settings in SWEEP[case.name].items():
                for setting in settings:
                    run(case, integrator, *setting)
