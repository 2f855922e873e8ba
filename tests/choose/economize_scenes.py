"""Twelve scenes of mixed kind for `economize`: each with more in its model than it needs, or less."""

from __future__ import annotations

from collections.abc import Callable

import flexarm as fa
import numpy as np
from flexarm.choose.economize_search import EconomizeSearch
from flexarm.choose.measures import Measure
from flexarm.choose.trials import Budget

STEEL = fa.Material(7850, 209e9, 0.3)
ALUMINIUM = fa.Material(2700, 70e9, 0.33)
PLASTIC = fa.Material(1200, 2.4e9, 0.38)
STRIP = fa.Rectangle(0.001, 0.02)


def hub(end: float = 0.075, mass: float = 0.0) -> fa.RigidBody:
    return fa.RigidBody(mass, inertia=(mass * 1e-3,) * 3, end=(end, 0, 0))


def times(duration: float, n: int = 400) -> np.ndarray:
    return np.linspace(0.0, duration, n + 1)


def paper(speed: float, time: float, duration: float, modes: dict | None = None, order: int | str = 2) -> fa.Scene:
    """The paper's link, spun up smoothly."""
    beam = fa.Beam(0.5, STRIP, STEEL, modes or {"bending_y": 3}, order=order)
    arm = fa.Arm([fa.Link(fa.Revolute("z"), hub(), beam)])
    return fa.Scene(arm, {0: fa.Motion.spin_up(speed, time)}, t=times(duration), name=f"paper's link, {speed} rad/s")


def planar_two() -> fa.Scene:
    """Two links swinging in a vertical plane, with a torque at the shoulder."""
    beams = [fa.Beam(length, fa.Rectangle(0.004, 0.03), ALUMINIUM, {"bending_y": 3}) for length in (0.6, 0.5)]
    links = [fa.Link(fa.Revolute("z", damping=0.02), hub(0.05, 0.2), b, fa.RigidBody(0.1)) for b in beams]
    arm = fa.Arm(links, gravity=(0, -9.81, 0))
    drive = {0: fa.Torque([0, 0.2, 0.4, 0.6], [0, 1.5, 0, 0])}
    return fa.Scene(arm, drive, t=times(0.6), q0=at(arm, {0: -np.pi / 2}), name="planar, two links")


def spatial_two() -> fa.Scene:
    """Shoulder about z, elbow about y, both driven."""
    few = {"bending_y": 2, "bending_z": 2, "torsion": 1}
    beams = [fa.Beam(length, fa.Rectangle(0.015, 0.02), ALUMINIUM, few) for length in (0.5, 0.4)]
    arm = fa.Arm(
        [
            fa.Link(fa.Revolute("z"), hub(0.05), beams[0], fa.RigidBody(0.3, inertia=(2e-4,) * 3)),
            fa.Link(fa.Revolute("y"), hub(0.05), beams[1], fa.RigidBody(0.2)),
        ]
    )
    t = np.array([0.0, 0.25, 0.5, 0.7])
    drive = {0: fa.Motion(t, [0, 0.3, 0.6, 0.6], ends="rest"), 1: fa.Motion(t, [0, -0.4, -0.8, -0.8], ends="rest")}
    return fa.Scene(arm, drive, t=times(0.6), name="two links in space")


def stocky() -> fa.Scene:
    """A short thick beam of plastic on a wall, pulled and let go: shear and rotary inertia count."""
    beam = fa.Beam(0.2, fa.Rectangle(0.06, 0.03), PLASTIC, {"bending_y": 3, "shear_y": 2, "torsion": 1})
    arm = fa.Arm([fa.Link(fa.Fixed(), None, beam, fa.RigidBody(0.2))])
    pull = fa.Load(-1, force=[[0, 0, 0], [0, 50, 0], [0, 0, 0], [0, 0, 0]], t=[0, 2e-3, 4e-3, 1])
    return fa.Scene(arm, loads=(pull,), t=times(0.02), name="stocky")


def slender() -> fa.Scene:
    """A thin strip that bends far."""
    beam = fa.Beam(0.8, fa.Rectangle(0.001, 0.02), STEEL, {"bending_y": 4}, "legendre")
    arm = fa.Arm([fa.Link(fa.Revolute("z"), hub(), beam)])
    return fa.Scene(arm, {0: fa.Motion.spin_up(5.0, 0.6)}, t=times(0.8), name="slender")


def heavy_tip() -> fa.Scene:
    """Three times the beam's mass on its end, swung from rest to rest, with weight across."""
    beam = fa.Beam(0.4, fa.Rectangle(0.008, 0.02), STEEL, {"bending_y": 3, "bending_z": 2})
    arm = fa.Arm([fa.Link(fa.Revolute("z"), hub(), beam, fa.RigidBody(1.5))], gravity=(0, 0, -9.81))
    t = np.array([0.0, 0.2, 0.4, 0.6])
    return fa.Scene(arm, {0: fa.Motion(t, [0, 0.1, 0.2, 0.2], ends="rest")}, t=times(0.4), name="heavy tip")


def floating() -> fa.Scene:
    """A body in space with a boom, pushed on its end."""
    boom = fa.Beam(1.2, fa.Circle(0.012, 0.010), ALUMINIUM, {"bending_y": 2, "bending_z": 2, "torsion": 1})
    body = fa.RigidBody(6.0, com=(-0.1, 0, 0), inertia=(0.1, 0.15, 0.12))
    arm = fa.Arm([fa.Link(fa.Free(), body, boom, fa.RigidBody(0.4, com=(0, 0.02, 0)))])
    push = fa.Load(0, force=[[0, 0, 0], [0, 3, 1], [0, 0, 0], [0, 0, 0]], t=[0, 0.1, 0.2, 1])
    return fa.Scene(arm, loads=(push,), t=times(0.6), name="floating")


def piezo() -> fa.Scene:
    """A strip on a wall, bent by a pair of films that a pulse drives. (Stiff patches make the curvature jump, which no
    smooth basis follows: see fa.split.)"""
    film = fa.Piezo(3e9, 0.3, 1780, 23e-12)
    patch = fa.Patch(0.02, 0.12, 0.02, 0.0001, film, face="y")
    beam = fa.Beam(0.3, fa.Rectangle(0.002, 0.02), ALUMINIUM, {"bending_y": 4}, patches=[patch], damping_ratio=0.01)
    arm = fa.Arm([fa.Link(fa.Fixed(), None, beam)])
    drive = {("patch", 0, 0): fa.Voltage([0, 0.02, 0.04, 1], [0, 100, 0, 0])}
    return fa.Scene(arm, drive, t=times(0.15), name="piezo")


def spliced() -> fa.Scene:
    """A long beam of six pieces, turned slowly."""
    piece = fa.Beam(0.3, fa.Rectangle(0.01, 0.03), ALUMINIUM, {"bending_y": 2}, "legendre")
    links = [fa.Link(fa.Revolute("z"), None, piece), *[fa.Link(fa.Fixed(), None, piece)] * 5]
    t = np.array([0.0, 0.3, 0.6, 1.0])
    drive = {0: fa.Motion(t, [0, 0.15, 0.3, 0.3], ends="rest")}
    return fa.Scene(fa.Arm(links), drive, t=times(0.8), name="spliced")


def controlled() -> fa.Scene:
    """A joint that a PD law moves, with a beam stiff enough to be left rigid at a loose tolerance."""
    beam = fa.Beam(0.4, fa.Rectangle(0.02, 0.02), STEEL, {"bending_y": 3, "torsion": 1})
    arm = fa.Arm([fa.Link(fa.Revolute("z", damping=0.1), hub(0.05, 0.5), beam)])
    return fa.Scene(arm, control=(fa.PD(60.0, 6.0, reference=0.5),), t=times(0.5), name="controlled")


def at(arm: fa.Arm, joints: dict[int, float]) -> np.ndarray:
    q = arm.zero
    for link, value in joints.items():
        q[arm.coordinate_of(arm.joint_rate(link))] = value
    return q


SCENES: dict[str, Callable[[], fa.Scene]] = {
    "slow": lambda: paper(0.5, 1.0, 1.2),
    "medium": lambda: paper(7.6, 1.2, 1.6),
    "fast": lambda: paper(19.0, 3.0, 3.2),
    "planar": planar_two,
    "spatial": spatial_two,
    "stocky": stocky,
    "slender": slender,
    "heavy_tip": heavy_tip,
    "floating": floating,
    "piezo": piezo,
    "spliced": spliced,
    "controlled": controlled,
}

#: Scenes in a plane: by hand, which strains are not zero there.
_SIDE = {"bending_y": 7, "shear_y": 3}
_ALL = {"bending_y": 5, "bending_z": 5, "torsion": 2, "shear_y": 2, "shear_z": 2}
STRAINS_OF = {name: _ALL if name in ("spatial", "heavy_tip", "floating") else _SIDE for name in SCENES}
STRAINS_OF["piezo"] = {"bending_y": 14, "shear_y": 3}
STRAINS_OF["stocky"] = {"bending_y": 8, "shear_y": 8}
STRAINS_OF["spliced"] = {"bending_y": 3, "shear_y": 1}


def enriched(scene: fa.Scene, modes: dict[str, int]) -> fa.Scene:
    """The truth: exact rotation, rotary inertia, these modes, in Legendre polynomials. It knows nothing of
    `economize`."""
    links = []
    for link in scene.arm.links:
        b = link.beam
        if b is not None:
            options = {"damping_ratio": b.damping_ratio, "patches": b.patches}
            b = fa.Beam(b.length, b.section, b.material, modes, "legendre", "exact", rotary_inertia=True, **options)
        links.append(fa.Link(link.joint, link.hub, b, link.tip))
    arm = fa.Arm(links, scene.arm.gravity)
    q0 = None
    if scene.q0 is not None:
        names = dict(zip(scene.arm.q_names, scene.q0, strict=True))
        q0 = np.array([names.get(name, start) for name, start in zip(arm.q_names, arm.zero, strict=True)])
    return fa.Scene(arm, scene.drive, scene.loads, scene.t, q0, None, {}, scene.name, (), scene.control)


def search(scene: fa.Scene, tolerance: float) -> EconomizeSearch:
    """Of the cheapest model for the tip, before its first run."""
    return EconomizeSearch(scene, Measure(scene, "tip"), tolerance, Budget(), lambda doing: None)


def run(scene: fa.Scene, **options) -> fa.Result:
    return fa.simulate(
        scene.arm, scene.t, scene.q0, scene.v0, drive=scene.drive, loads=scene.loads, control=scene.control, **options
    )


def off(a: np.ndarray, b: np.ndarray) -> float:
    """Largest distance over the largest range of a component of b."""
    return float(np.linalg.norm(a - b, axis=1).max() / np.ptp(b, axis=0).max())
