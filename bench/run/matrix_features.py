"""The features that matrix.py tries: each is a scene of one small arm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import flexarm as fa
import numpy as np

H = 5e-5  # s, step of "implicit" and of what stands on it, and between two rows
T = H * np.arange(4001)
M = 0.1  # kg, mass of the tip: the parameter of derivatives, batches and fits
PATH = "link.0.tip.mass"
RATE = 250.0  # Hz, of what samples
Scene = dict[str, Any]

STEEL = fa.Material(7850, 209e9, 0.3)
PZT = fa.Piezo(62e9, 0.3, 7800, d31=-1.8e-10, permittivity=1.5e-8)
SOFT = fa.SectionMatrix(np.diag([500, 1e5, 1e5, 20.0, 400, 9.4]), np.diag([0.47, 0.47, 0.47, 1.6e-5, 1.5e-5, 1e-6]))
S = np.linspace(0, T[-1], 21)
SPUN = {"v0": 3.0}  # rad/s, of the last joint


def push(t: Any) -> Any:
    """A torque (N m)."""
    return 0.5 * np.sin(25 * np.asarray(t))


def arm(m: float, rich: bool, joint: Any = None, base: Any = None, section: Any = None, **beam: Any) -> fa.Arm:
    """A hinge and a beam in a plane, on its base if it has one; rich: for the truth of `economize`."""
    modes = {k: n + 3 * rich for k, n in beam.pop("modes", {"bending_y": 2}).items()}
    material = None if section else STEEL
    body = fa.Beam(0.4, section or fa.Rectangle(0.003, 0.02), material, modes, "legendre",  damping_ratio=0.01,
                   **{"order": "exact" if rich else 2} | beam)  # fmt: skip
    hub = fa.RigidBody(0.3, inertia=0.005 * np.eye(3))
    link = fa.Link(joint or fa.Revolute("z", damping=0.02), hub, body, fa.RigidBody(m, inertia=1e-5 * np.eye(3)))
    return fa.Arm([base, link] if base else [link])


def fork(m: float, rich: bool) -> fa.Arm:
    """The same, whose tip and one slice carry two more beams."""
    (stem,) = arm(m, rich).links
    sides = [(fa.Fixed(inboard=fa.Placement(rotation=(0, 0, turn))), long) for turn, long in ((0.9, 0.4), (-0.7, 0.35))]
    links = [fa.Link(side, beam=replace(stem.beam, length=long), parent=0) for side, long in sides]
    return fa.Arm([stem, replace(links[0], at=0.25), links[1]])


def tied(m: float, rich: bool) -> fa.Arm:
    """The same, with a spring from the world to a slice, and a rope over its tip."""
    spring = fa.Strut((0.1, -0.2, 0), (0, 0.3), stiffness=300, damping=2)
    rope = fa.Tendon([(0.1, 0.3, 0), fa.Point(0, 0.2, (0, 0.02, 0)), 0], stiffness=100, damping=1, tension=4)
    return fa.Arm(arm(m, rich).links, struts=[spring, rope])


def lifted(m: float, r: Any, rich: bool) -> Scene:
    """The same, on a cylinder from the world, whose length a PD leads."""
    jack = fa.Strut((0.1, -0.2, 0), (0, 0.3), damping=2, name="jack", mass=0.2)
    made = fa.Arm(arm(m, rich).links, struts=[jack])
    length = float(made.strut_motion(made.zero)[0][0])
    led = fa.Motion([0, T[-1]], [length, length + 0.05], [0, 0], [0, 0]) if isinstance(r, fa.Motion) else length
    return {"arm": made, "control": fa.PD(4e3, 60.0, "jack", reference=led)}


def closed(m: float, rich: bool) -> fa.Arm:
    """The same, whose tip two rigid links join to the world: a four-bar."""
    (stem,) = arm(m, rich).links
    turn = float(np.arctan2(-0.2, 0.1))  # of the coupler, from (0.3, 0.2) to the tip

    def bar(length: float, angle: float, at: Any = (0, 0, 0)) -> fa.Link:
        hinge = fa.Revolute("z", inboard=fa.Placement(at, (0, 0, angle)), damping=0.01)
        return fa.Link(hinge, fa.RigidBody(0.2, (length / 2, 0, 0), 0.001 * np.eye(3), (length, 0, 0)))

    rocker, coupler = bar(0.3, np.pi, (0.6, 0.2, 0)), bar(float(np.hypot(0.1, 0.2)), turn - np.pi)
    return fa.Arm([rocker, coupler, replace(stem, parent="world")], loops=[fa.Loop(1, 2, fa.Revolute("z"))])


def touching(m: float, rich: bool, **more: float) -> fa.Arm:
    """The same, whose tip meets a surface when it has turned by 0.2 rad, and slides along it."""
    c, s = np.cos(0.2), np.sin(0.2)
    surface = fa.Plane((0.4 * c, 0.4 * s, 0), (np.sin(0.6), -np.cos(0.6), 0))
    touch = fa.Contact(0, surface, stiffness=400.0, damping=0.2, **more)
    return fa.Arm(arm(m, rich).links, contacts=[touch])


def pull(t: float, pose: Any, velocity: np.ndarray) -> np.ndarray:
    """Of a spring and of the air, at the tip."""
    return np.array([0.4, 0.1, 0.0]) * 20 - 20 * pose.p - 0.5 * np.abs(velocity[:3]) * velocity[:3]


def joint(**more: Any) -> fa.Revolute:
    return fa.Revolute("z", damping=0.02, **more)


def crosses(level: float, terminal: bool) -> Callable[..., float]:
    def event(t: float, q: np.ndarray, v: np.ndarray) -> float:
        return float(q[0] - level)

    event.terminal = terminal  # type: ignore[attr-defined]
    return event


def linear(gains: list[float], measure: list[Any], r: Any, **more: Any) -> fa.LinearController:
    """A law without memory on a reference of its first reading."""
    fixed = isinstance(r, float)
    whole = r * np.eye(len(gains))[0] if fixed else (T[[0, -1]], np.outer([0.0, 0.4], np.eye(len(gains))[0]))
    return fa.LinearController([], D=[gains], measure=measure, reference=whole, **more)


@dataclass
class Feature:
    """`make(m, r, rich)`: the scene with a tip of m kg, controllers at the reference r."""

    name: str
    make: Callable[[float, Any, bool], Scene]
    other: str = "torque samples"  # the feature that it is compared with: the runs must differ
    sensors: list[Any] = field(default_factory=lambda: [fa.sensors.Encoder(-1, noise=1.0)])
    path: str = PATH
    held: bool = False  # whether its forces are held from sample to sample
    aside: str = ""  # arguments that only make it act: left out by ways that move the arm themselves
    pose: Any = None  # about which poles are
    turn: float = 0.0  # rad/s, about which they are; against the friction `drag` (N m)
    drag: float = 0.0
    led: Any = None  # by MPC, where not by its hinge: arguments, what is seen of (arm, q), and where that is to be

    def scene(self, m: float = M, r: Any = None, rich: bool = False) -> Scene:
        """Fresh: some controllers remember."""
        reference = fa.Motion([0, T[-1]], [0, 0.4], [0, 0], [0, 0]) if r is None else r
        made = self.make(m, reference, rich)
        made = {"arm": arm(m, rich)} | made
        for k in ("v0", "q0"):  # of one joint, or whole
            if k in made and np.ndim(made[k]) == 0:
                made[k] = made[k] * np.eye(made["arm"].nv)[made["arm"].joint_rate(-1)]
        return made

    def run(self, m: float = M, rich: bool = False, **options: Any) -> fa.Result:
        scene = self.scene(m, None, rich)
        scene.pop("push", None)
        return fa.simulate(scene.pop("arm"), T, **scene, **options)

    @cached_property
    def truth(self) -> fa.Result:
        return self.run(integrator="ida", rtol=1e-9, atol=1e-12)

    @cached_property
    def slopes(self) -> np.ndarray:
        """Of q by the mass."""
        d = 1e-3 * M
        up, down = (self.run(M + s * d, integrator="ida", rtol=1e-10, atol=1e-13).q for s in (1, -1))
        return (up - down) / (2 * d)


def laws() -> list[Feature]:
    """Controllers, each alone at the joint."""
    q, v, k3 = ("joint", 0), ("rate", 0), ("strain", 0, 0.01, "K3")
    kp, kd, ks = 6.0, 0.4, -0.3

    def state(a: fa.Arm) -> np.ndarray:
        return np.array([[kp, *[0] * (a.nv - 1), kd, *[0] * (a.nv - 1)]])

    def follows(r: Any) -> Any:
        return (T[[0, -1]], [0.0, 0.4]) if isinstance(r, fa.Motion) else r

    def python(t: float, y: np.ndarray) -> float:
        return float(kp * (0.4 - y[0]) - kd * y[1])

    def still(t: float, y: np.ndarray) -> float:
        return float(-kp * y[0] - kd * y[1])

    def function(r: Any) -> Any:
        return still if isinstance(r, float) else python

    seen = [fa.sensors.Encoder(0, pulses=None, filter=fa.sensors.LowPass(40.0)), fa.sensors.Tachometer(0)]
    held = {"rate": RATE}
    pid = {"kp": kp, "ki": 20.0, "kd": kd, "link": 0}
    drive = {"kp": kp, "kv": kd, "ki": 20.0, "filter": 60.0, "delay": 1e-3, "limit": 0.8, "current_loop": 100.0, **held}
    steps = fa.sensors.Encoder(pulses=65536)
    kinds: dict[str, Callable[[float, Any, bool], Any]] = {
        "PD": lambda m, r, x: fa.PD(kp, kd, reference=r),
        "StrainFeedback": lambda m, r, x: fa.StrainFeedback(kp, kd, ks, x=0.01, reference=r),
        "StateFeedback": lambda m, r, x: fa.StateFeedback(state(arm(m, x)), u0=[0.0 if isinstance(r, float) else 0.8]),
        "FeedForward": lambda m, r, x: [fa.PD(kp, kd, reference=r), fa.FeedForward(r)],
        "LinearController": lambda m, r, x: fa.LinearController.pid(**pid, reference=follows(r), filter_time=2e-3),
        "PD, sampled": lambda m, r, x: linear([kp, kd], [q, v], r, **held),
        "StrainFeedback, sampled": lambda m, r, x: linear([kp, kd, ks], [q, v, k3], r, **held),
        "LinearController, sampled": lambda m, r, x: fa.LinearController.pid(**pid, reference=follows(r), **held),
        "Sampled": lambda m, r, x: fa.Sampled(function(r), RATE, [q, v]),
        "ComputedTorque": lambda m, r, x: fa.ComputedTorque(150.0, reference=r, rate=RATE),
        "MPC": lambda m, r, x: fa.MPC(reference=r if isinstance(r, float) else 0.4, rate=RATE, horizon=0.2),
        "delay": lambda m, r, x: linear([kp, kd], [q, v], r, **held, delay=0.003),
        "sensor with a filter": lambda m, r, x: linear([kp, kd], seen, r, **held),
        "limit of a controller": lambda m, r, x: fa.PD(kp, kd, reference=r, limit=0.25),
        "Servo": lambda m, r, x: fa.Servo(0, **drive, reference=r),
        "Servo, encoder in steps": lambda m, r, x: fa.Servo(0, **drive, sensor=steps, reference=r),
    }
    flowing = ("PD", "StrainFeedback", "StateFeedback", "FeedForward", "LinearController", "limit of a controller")
    others = {"PD": "torque samples", "delay": "PD, sampled", "sensor with a filter": "PD, sampled"}
    return [
        Feature(name, lambda m, r, x, law=law: {"control": law(m, r, x)}, others.get(name, "PD"),
                [replace(seen[0], noise=1.0)] if name == "sensor with a filter" else [fa.sensors.Encoder(0, noise=1.0)],
                held=name not in flowing)
        for name, law in kinds.items()
    ]  # fmt: skip


def features() -> list[Feature]:
    t2, volts = [0, 0.1, 0.2], [0.0, 150.0, -100.0]
    patch = [fa.Patch(0.02, 0.1, 0.02, 5e-4, PZT, face="y")]
    reel = fa.Link(fa.Free(), fa.RigidBody(0.5, inertia=0.01 * np.eye(3), end=(0.1, 0, 0)))
    turned = np.array([1.0, 2.0, 3.0])
    bend = ("strain", 0, 0.01, "K3")
    gauge = [fa.sensors.StrainGauge(-1, x=0.01, noise=1.0)]
    limited, dry, stopped = joint(torque_limit=0.3), joint(coulomb=0.5, stiction=0.6), joint(
        upper=0.2, limit_stiffness=60.0, limit_damping=0.05)  # fmt: skip
    space = {"modes": {"bending_y": 2, "bending_z": 1}}
    samples = {0: fa.Torque(S, push(S))}

    def dead(r: Any) -> fa.Load:
        return fa.Load(force=(0, 1.5, 0) if isinstance(r, float) else (np.outer(S / S[-1], [0.5, 1.5, 0])),
                       t=None if isinstance(r, float) else S)  # fmt: skip

    return [
        Feature("prescribed motion", lambda m, r, x: {"drive": {0: fa.Motion([0, 0.2], [0, 0.4], [0, 0], [0, 0])}},
                led=({"track": [bend], "inputs": [np.array([0.0, 1.0, 0.0])], "rate": 1e3, "horizon": 0.05},
                     lambda a, q: a.strain(q, 0, 0.01)[:, 2], [0.0])),
        Feature("torque samples", lambda m, r, x: {"drive": samples, "push": lambda t: np.interp(t, S, push(S))}, ""),
        Feature("torque, a callable", lambda m, r, x: {"drive": {0: fa.Torque(lambda t: 0.6 * float(push(t)))},
                                                       "push": lambda t: 0.6 * push(t)}),
        *laws(),
        Feature("torque limit of a joint", lambda m, r, x: {"arm": arm(m, x, limited), "drive": samples,
                                                            "push": lambda t: np.interp(t, S, push(S))},
                aside="drive push"),
        Feature("dry friction", lambda m, r, x: {"arm": arm(m, x, dry), **SPUN}, "event", turn=1.0, drag=0.5),
        Feature("stop", lambda m, r, x: {"arm": arm(m, x, stopped), **SPUN}, "event", pose={0: 0.21}),
        Feature("ball joint", lambda m, r, x: {"arm": (a := arm(m, x, fa.Spherical(), **space)),
                                               "v0": np.r_[turned, np.zeros(a.nv - 3)]},
                sensors=gauge, led=({"track": "tip"}, lambda a, q: a.frame(q)[0],
                                    0.4 * np.array([np.cos(0.2), np.sin(0.2), 0.0]))),
        Feature("free base", lambda m, r, x: {"arm": (a := arm(m, x, base=reel, **space)),
                                              "v0": np.r_[0.2, 0.1, 0.3, turned, -2.0, np.zeros(a.nv - 7)]},
                sensors=gauge, path="link.1.tip.mass",
                led=({"track": [("joint", 1)], "inputs": [1]}, lambda a, q: q[:, 7:8], [0.2])),
        Feature("tree", lambda m, r, x: {"arm": fork(m, x), "control": fa.PD(6.0, 0.4, 0, reference=r)}, "PD",
                sensors=[fa.sensors.Encoder(0, noise=1.0)]),
        Feature("dead load", lambda m, r, x: {"loads": [dead(r)]}),
        Feature("follower load", lambda m, r, x: {"loads": [fa.Load(force=(-3, 2, 0), axes="section")]}, "dead load"),
        Feature("load by its state", lambda m, r, x: {"loads": [fa.Load(force=pull)], **SPUN}, "event"),
        Feature("strut and tendon", lambda m, r, x: {"arm": tied(m, x), **SPUN}, "event"),
        Feature("cylinder", lifted, "PD", sensors=[fa.sensors.Encoder(0, noise=1.0)]),
        Feature("contact", lambda m, r, x: {"arm": touching(m, x), **SPUN}, "event", pose={0: 0.21}),
        Feature("contact with friction", lambda m, r, x: {"arm": touching(m, x, coulomb=0.5), **SPUN}, "contact",
                pose={0: 0.21}),
        Feature("loop", lambda m, r, x: {"arm": closed(m, x), "drive": {2: fa.Torque(S, push(S))}}, "",
                path="link.2.tip.mass"),
        Feature("voltage of a patch", lambda m, r, x: {
            "arm": arm(m, x, patches=patch), "drive": {("patch", 0, 0): fa.Voltage(t2, volts)}}),
        Feature("event", lambda m, r, x: {**SPUN, "events": [crosses(0.2, False)]}, ""),
        Feature("terminal event", lambda m, r, x: {**SPUN, "events": [crosses(0.2, True)]}, ""),
        Feature("curved beam", lambda m, r, x: {
            "arm": arm(m, x, order="exact", curvature=(0, 0, 1.0)), **SPUN}, "event"),
        Feature("stretching beam", lambda m, r, x: {
            "arm": arm(m, x, section=SOFT, modes={"bending_y": 2, "extension": 1}), **SPUN}, "event"),
    ]  # fmt: skip
