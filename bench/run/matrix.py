"""Features against ways to run an arm: each pair is tried by a run, and compared with an independent one.

    cmake --preset release -DFLEXARM_BUILD_BENCH=ON && cmake --build --preset release --target bench_matrix
    python bench/run/matrix.py [--program build/release/bench_matrix] [--check] [WORD ...]

Writes the marked part of docs/matrix.md; with --check, or with words that choose features or ways, it only prints.
The truth is IDA at tight tolerances (of the column of IDA itself: Gauss collocation), of derivatives differences of
such runs, of poles a run from a small displacement, of economize a run of a richer model.
"""

from __future__ import annotations

import argparse
import inspect
import re
import subprocess
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "matrix.md"
H = 5e-5  # s, step of "implicit" and of what stands on it, and between two rows
T = H * np.arange(4001)
M = 0.1  # kg, mass of the tip: the parameter of derivatives, batches and fits
PATH = "link.0.tip.mass"
RATE = 250.0  # Hz, of what samples
MOTION, POLES, SLOPES, FITTED, CHOSEN = 1e-3, 1e-4, 1e-2, 1e-2, 1e-2  # how near is near enough, relative
Scene = dict[str, Any]


class NotApplicable(Exception):
    """The feature means nothing to this way."""


class Refused(Exception):
    """A way that has no place for the feature."""


# --- The features: each gives the arguments of `simulate` ---

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
    sensors: list[Any] = field(default_factory=lambda: [fa.Encoder(-1, noise=1.0)])
    path: str = PATH
    aside: str = ""  # arguments that only make it act: left out by ways that move the arm themselves
    pose: Any = None  # about which poles are
    turn: float = 0.0  # rad/s, about which they are; against the friction `drag` (N m)
    drag: float = 0.0

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

    seen = [fa.Encoder(0, pulses=None, filter=fa.LowPass(40.0)), fa.Tachometer(0)]
    held = {"rate": RATE}
    pid = {"kp": kp, "ki": 20.0, "kd": kd, "link": 0}
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
    }
    others = {"PD": "torque samples", "delay": "PD, sampled", "sensor with a filter": "PD, sampled"}
    return [
        Feature(name, lambda m, r, x, law=law: {"control": law(m, r, x)}, others.get(name, "PD"),
                [replace(seen[0], noise=1.0)] if name == "sensor with a filter" else [fa.Encoder(0, noise=1.0)])
        for name, law in kinds.items()
    ]  # fmt: skip


def features() -> list[Feature]:
    t2, volts = [0, 0.1, 0.2], [0.0, 150.0, -100.0]
    patch = [fa.Patch(0.02, 0.1, 0.02, 5e-4, PZT, face="y")]
    reel = fa.Link(fa.Free(), fa.RigidBody(0.5, inertia=0.01 * np.eye(3), end=(0.1, 0, 0)))
    turned = np.array([1.0, 2.0, 3.0])
    gauge = [fa.StrainGauge(-1, x=0.01, noise=1.0)]
    limited, dry, stopped = joint(torque_limit=0.3), joint(coulomb=0.5, stiction=0.6), joint(
        upper=0.2, limit_stiffness=60.0, limit_damping=0.05)  # fmt: skip
    space = {"modes": {"bending_y": 2, "bending_z": 1}}
    samples = {0: fa.Torque(S, push(S))}

    def dead(r: Any) -> fa.Load:
        return fa.Load(force=(0, 1.5, 0) if isinstance(r, float) else (np.outer(S / S[-1], [0.5, 1.5, 0])),
                       t=None if isinstance(r, float) else S)  # fmt: skip

    return [
        Feature("prescribed motion", lambda m, r, x: {"drive": {0: fa.Motion([0, 0.2], [0, 0.4], [0, 0], [0, 0])}}),
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
                sensors=gauge),
        Feature("free base", lambda m, r, x: {"arm": (a := arm(m, x, base=reel, **space)),
                                              "v0": np.r_[0.2, 0.1, 0.3, turned, -2.0, np.zeros(a.nv - 7)]},
                sensors=gauge, path="link.1.tip.mass"),
        Feature("dead load", lambda m, r, x: {"loads": [dead(r)]}),
        Feature("follower load", lambda m, r, x: {"loads": [fa.Load(force=(-3, 2, 0), axes="section")]}, "dead load"),
        Feature("voltage of a patch", lambda m, r, x: {
            "arm": arm(m, x, patches=patch), "drive": {("patch", 0, 0): fa.Voltage(t2, volts)}}),
        Feature("event", lambda m, r, x: {**SPUN, "events": [crosses(0.2, False)]}, ""),
        Feature("terminal event", lambda m, r, x: {**SPUN, "events": [crosses(0.2, True)]}, ""),
        Feature("curved beam", lambda m, r, x: {"arm": arm(m, x, order="exact", curvature=(0, 0, 1.0)), **SPUN}, "event"),
        Feature("stretching beam", lambda m, r, x: {
            "arm": arm(m, x, section=SOFT, modes={"bending_y": 2, "extension": 1}), **SPUN}, "event"),
    ]  # fmt: skip


# --- Comparisons ---


def seen_of(a: fa.Arm, q: np.ndarray) -> np.ndarray:
    """The tip's place and the strains at the root."""
    return np.hstack([a.frame(q)[0], a.strain(q, link=-1, x=0.01)[:, [1, 2]]])


def off(a: fa.Arm, q: np.ndarray, truth: fa.Result) -> float:
    """The largest distance from the truth, as a part of its span: of the tip or of a strain."""
    if len(q) != len(truth.q):
        return np.inf
    found, wanted = seen_of(a, q), seen_of(truth.arm, truth.q)
    span = np.ptp(wanted, axis=0)
    span[:3] = span[:3].max()
    span[3:] = span[3:].max()
    return float((np.abs(found - wanted).max(axis=0) / span).max())


def given(way: Callable[..., Any], scene: Scene, instead: str = "") -> Scene:
    """The scene, where the way has an argument for everything in it; `instead`: what the caller has translated."""
    known = set(inspect.signature(way).parameters) | set(instead.split())
    for key in scene:
        if key not in known:
            raise Refused(f"{way.__name__} has no argument `{key}`")
    return scene


# --- The ways: each gives its error, in parts of what is near enough ---


def simulated(integrator: str, **options: Any) -> Callable[[Feature], float]:
    def way(f: Feature) -> float:
        truth = f.truth if integrator != "ida" else f.run(integrator="gauss", step=1e-3)
        r = f.run(integrator=integrator, **options)
        late = 0.0
        if truth.t_events:
            late = abs(r.t_events[0] - truth.t_events[0]).max() / T[-1]
        return max(late, off(r.arm, r.q, truth)) / MOTION

    return way


def rolled(f: Feature) -> float:
    scene = f.scene()
    drive, of, a = scene.pop("drive", {}), scene.pop("push", None), scene["arm"]
    tau = np.zeros((len(T) - 1, a.nv))
    for k, x in drive.items():
        if isinstance(x, fa.Torque):
            tau[:, a.joint_rate(k)] = of(T[:-1] + 0.5 * H)
        elif isinstance(x, fa.Motion):
            scene["motion"] = {k: x}
        else:
            raise Refused("rollout has no argument for voltages")
    scene = given(fa.rollout, scene)
    return off(a, fa.rollout(q0=scene.pop("q0", a.zero), tau=tau, step=H, **scene).q[0], f.truth) / MOTION


def in_lanes(f: Feature) -> float:
    masses = M * np.linspace(0.9, 1.6, 8)
    scene = f.scene()
    scene.pop("push", None)
    batch = fa.simulate_batch(scene.pop("arm"), T, **scene, step=H, parameters={f.path: masses})
    if batch.stats["engine"] != "steps" or batch.stats["lanes"] < 2:
        raise Refused("not in lanes: simulate_batch takes one simulate for each scenario")
    return off(f.truth.arm, batch.q[1], f.truth) / MOTION


def slopes_off(found: np.ndarray, f: Feature) -> float:
    n = min(len(found), len(f.slopes))
    size = np.abs(f.slopes[:n]).max(axis=0)
    return float((np.abs(found[:n] - f.slopes[:n]).max(axis=0) / np.maximum(size, 0.01 * size.max())).max())


def forward(**options: Any) -> Callable[[Feature], float]:
    return lambda f: slopes_off(f.run(**options).sensitivities([f.path]).q[0], f) / SLOPES


def adjoint(**options: Any) -> Callable[[Feature], float]:
    def way(f: Feature) -> float:
        r = f.run(**options)
        weights = np.random.default_rng(1).uniform(size=r.q.shape)
        parts = weights * f.slopes[: len(weights)]
        return abs(r.gradient({"q": weights}, [f.path])[f.path] - parts.sum()) / np.abs(parts).sum() / SLOPES

    return way


def scene_of(f: Feature, m: float, **more: Any) -> fa.Scene:
    scene = f.scene(m)
    scene.pop("push", None)
    control = scene.pop("control", ())
    scene["control"] = tuple(control) if isinstance(control, list) else (control,) if control else ()
    scene["loads"] = tuple(scene.pop("loads", ()))
    return fa.Scene(t=T, **given(fa.Scene, scene), **more)


def identified(f: Feature) -> float:
    place = f.truth.frame()[0]
    rows = np.arange(0, len(T), 10)
    columns = {f"tip {'xyz'[k]}": (place[rows, k], k) for k in np.argsort(np.ptp(place, axis=0))[1:]}
    data = fa.Data(T[rows], {k: y for k, (y, _) in columns.items()}, dict.fromkeys(columns, "m"))
    outputs = {name: (lambda r, k=k: r.frame()[0][:, k]) for name, (_, k) in columns.items()}
    guess = scene_of(f, 1.15 * M, options={"integrator": "implicit", "step": H})
    fit = fa.identify(guess, data, {f.path: None}, outputs=outputs, starts=1)
    return abs(fit.values[f.path] / M - 1) / FITTED


def filtered(f: Feature) -> float:
    """Readings that are hardly believed: what it follows is its model, under the torques of the run."""
    scene, truth = f.scene(), f.truth
    for key in ("drive", "push", "control"):
        scene.pop(key, None)
    if "events" in scene:
        raise NotApplicable("an event ends a run; a filter goes on")
    q0, v0 = scene.pop("q0", truth.q[0]), scene.pop("v0", truth.v[0])
    a = given(fa.KalmanFilter, scene)["arm"]
    kalman = fa.KalmanFilter(a, f.sensors, H, force_noise=1e-9, q_std=1e-9, v_std=1e-9, q=q0, v=v0)
    samples = any(hasattr(c, "rate") and c.rate for c in np.atleast_1d(f.scene().get("control", [])))
    tau = truth.tau[:-1] if samples else 0.5 * (truth.tau[1:] + truth.tau[:-1])
    found = kalman.run(T, np.vstack([tau, tau[-1:]]), [s.read(truth) for s in f.sensors])
    return off(a, found.q, truth) / MOTION


def mpc(f: Feature) -> float:
    """Brings the arm, as its model knows it, to a place 0.2 rad away."""
    scene = f.scene()
    if "events" in scene:
        raise NotApplicable("an event ends a run; a plan has none")
    for key in ("push", *f.aside.split()):
        scene.pop(key, None)
    a, v0 = scene.pop("arm"), scene.pop("v0", None)
    given(fa.MPC, scene)
    law = fa.MPC(a, reference=0.2, rate=RATE, horizon=0.2)
    r = fa.simulate(a, np.linspace(0, 0.6, 301), None, v0, control=law, integrator="implicit", step=5e-4)
    return float(abs(r.q[-50:, 0] - 0.2).max() / 0.2 + law.failures) / 0.05


def poles(f: Feature) -> float:
    """A run from a small displacement is a sum of the modes of the poles."""
    scene = f.scene(r=0.0)
    if "events" in scene:
        raise NotApplicable("an event is no part of a linear loop")
    for key in ("push", "v0", *f.aside.split()):
        scene.pop(key, None)
    drive, a, control = scene.pop("drive", {}), scene.pop("arm"), scene.pop("control", [])
    if any(not isinstance(x, fa.Motion) for x in drive.values()):
        raise NotApplicable("a torque or voltage over time moves no pole")
    locked = [k for k, x in drive.items() if isinstance(x, fa.Motion)]
    v = f.turn * np.eye(a.nv)[0]
    loop = fa.closed_loop(a, control, f.pose and a.pose(f.pose), v, lock=locked, **given(fa.closed_loop, scene))
    period, hold = loop.period or 4e-3, loop.q
    tau = a.inverse_dynamics(hold, v, np.zeros(a.nv), **scene) + f.drag * np.sign(v)
    small = 1e-5 * np.ones(a.nv)
    small[locked] = 0
    t = period * np.arange(4 * len(loop.poles))
    if control:
        scene["control"] = control
    if locked:
        scene["drive"] = {k: fa.Motion([0, t[-1]], [0.0, 0.0]) for k in locked}
    away = hold.copy()
    for k in range(a.nv):
        if a.coordinate_of(k) >= 0:
            away[a.coordinate_of(k)] += small[k]
    options = {"tau": tau, "integrator": "gauss", "step": 1e-3, **scene}
    y = fa.simulate(a, t, away, v + small, **options).v - fa.simulate(a, t, hold, v, **options).v
    y = np.delete(y, locked, axis=1)
    modes = np.exp(np.outer(t, loop.poles))
    late = slice(len(t) // 4, None)  # what dies in finite time has no pole
    rest = y[late] - modes[late] @ np.linalg.lstsq(modes[late], y[late], rcond=None)[0]
    return float(np.abs(rest).max() / np.abs(y[late]).max()) / POLES


def economized(f: Feature) -> float:
    plan = fa.economize(scene_of(f, M), tol=CHOSEN)
    if not plan.certified:
        raise Refused(f"not certified: {plan.reasons[0]}")
    rich = f.run(rich=True, integrator="gauss", step=1e-3)
    truth, found = rich.frame()[0], plan.run().frame()[0]
    return float(np.abs(found - truth).max() / np.ptp(truth, axis=0).max()) / CHOSEN


def in_cpp(program: Path) -> Callable[[Feature], float]:
    def way(f: Feature) -> float:
        scene = f.scene()
        for key in scene:
            if key not in ("arm", "q0", "v0"):
                raise Refused(f"load_arm reads no `{key}`")
        a = scene["arm"]
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "scene.toml"
            fa.Scene(a, t=T).save(file)
            start = " ".join(repr(float(x)) for k in "qv" for x in getattr(f.truth, k)[0])
            command = [program, file, "implicit", str(H), str(len(T) - 1)]
            out = subprocess.run(command, input=start, capture_output=True, text=True)
        if out.returncode:
            raise Refused(out.stderr.strip())
        q = np.array([line.split() for line in out.stdout.splitlines()], float)
        return off(a, np.vstack([f.truth.q[:1], q]), f.truth) / MOTION

    return way


def ways(program: Path) -> dict[str, Callable[[Feature], float]]:
    return {
        "`ida`": simulated("ida", rtol=1e-8),
        "`implicit`": simulated("implicit", step=H),
        "`gauss`": simulated("gauss", step=1e-3),
        "`rk4`": simulated("rk4", step=H),
        "`rollout`": rolled,
        "batch in lanes": in_lanes,
        "forward, `ida`": forward(integrator="ida", rtol=1e-8),
        "forward, `implicit`": forward(integrator="implicit", step=H),
        "adjoint, `implicit`": adjoint(integrator="implicit", step=H),
        "adjoint, `gauss`": adjoint(integrator="gauss", step=1e-3),
        "`identify`": identified,
        "Kalman filter": filtered,
        "model of MPC": mpc,
        "`closed_loop`": poles,
        "`economize`": economized,
        "steps in C++": in_cpp(program),
    }


# --- The table ---


def tried(f: Feature, way: Callable[[Feature], float]) -> tuple[str, str]:
    """The outcome of a cell, "yes", "no", "void" or "WRONG", and its reason."""
    try:
        error = way(f)
    except NotApplicable as e:
        return "void", str(e)
    except (Refused, ValueError) as e:
        return "no", re.split(r"[.;] ", re.sub(r"^control\[0\] = \w+", "control", str(e)))[0].strip()
    except Exception as e:  # noqa: BLE001  (whatever goes wrong is told by the table)
        return "WRONG", f"{type(e).__name__}: {e}"
    return ("yes", "") if error <= 1 else ("WRONG", f"off by {error:.3g} times what is near enough")


def told(cells: dict[tuple[str, str], tuple[str, str]], rows: list[str], columns: list[str]) -> str:
    """The table, the count and the reasons."""
    reasons: dict[tuple[str, str], list[tuple[str, str]]] = {}
    for at, (outcome, why) in cells.items():
        if outcome != "yes":
            reasons.setdefault((outcome, why), []).append(at)
    letters = [a + b for a in ("", *"abc") for b in "abcdefghijklmnopqrstuvwxyz"]
    mark = {key: letter for key, letter in zip(sorted(reasons, key=lambda k: -len(reasons[k])), letters, strict=False)}
    shape = {"no": "{}", "void": "({})", "WRONG": "**WRONG** {}"}
    lines = [f"| | {' | '.join(columns)} |", "|-" * (len(columns) + 1) + "|"]
    for row in rows:
        marks = ["yes" if cells[row, c][0] == "yes" else shape[cells[row, c][0]].format(mark[cells[row, c]])
                 for c in columns]  # fmt: skip
        lines.append(f"| {row} | {' | '.join(marks)} |")
    count = {k: sum(outcome == k for outcome, _ in cells.values()) for k in ("yes", "no", "WRONG", "void")}
    most = len(cells) - count["void"]
    share = {k: f"{count[k]} ({100 * count[k] / most:.1f} %)" for k in ("yes", "no", "WRONG")}
    lines += ["", f"Of {len(cells)} pairs {count['void']} mean nothing. Of the other {most}, {share['yes']} work, "
              f"{share['no']} are refused, and {share['WRONG']} are wrong.", ""]  # fmt: skip
    kinds = {"no": "refused", "void": "means nothing", "WRONG": "wrong"}
    lines += ["| | pairs | | reason |", "|-|-|-|-|"]
    lines += [f"| {letter} | {len(reasons[key])} | {kinds[key[0]]} | {key[1].replace('|', '/')} |"
              for key, letter in mark.items()]  # fmt: skip
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", type=Path, default=ROOT / "build/release/bench_matrix")
    parser.add_argument("--check", action="store_true", help="print only")
    parser.add_argument("words", nargs="*", help="features or ways whose names contain one of these")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    all_of, columns = {f.name: f for f in features()}, ways(options.program)
    rows = list(all_of)
    if not options.program.exists():
        raise SystemExit(f"{options.program}: is not there; see --help")
    wanted = [[x for x in names if any(w in x for w in options.words)] or list(names) for names in (rows, columns)]
    cells = {}
    for name in wanted[0]:
        f = all_of[name]
        if f.other and off(f.truth.arm, f.truth.q, all_of[f.other].truth) < 10 * MOTION:
            raise SystemExit(f"{name}: makes no difference to the run")
        for column in wanted[1]:
            cells[name, column] = tried(f, columns[column])
            print(f"{name:28} {column:22} {cells[name, column][0]:6} {cells[name, column][1]}", flush=True)
    table = told(cells, *wanted)
    print(table)
    if options.check or options.words:
        return
    text = PAGE.read_text(encoding="utf-8")
    pattern = r"(<!-- matrix: [^\n]*-->\n).*?(<!-- end of matrix -->)"
    new, count = re.subn(pattern, lambda found: f"{found[1]}{table}\n{found[2]}", text, flags=re.S)
    if count != 1:
        raise SystemExit(f"{PAGE}: the marks of the matrix are missing")
    PAGE.write_text(new, encoding="utf-8")


if __name__ == "__main__":
    main()
