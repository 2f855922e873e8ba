"""Features against ways to run an arm: each pair is tried by a run, and compared with an independent one.

    python bench/run/matrix.py [--check] [WORD ...]

Writes the marked part of docs/matrix.md; with --check, or with words that choose features or ways, it only prints.
The truth is IDA at tight tolerances (of the column of IDA itself: Gauss collocation), of derivatives differences of
such runs, of poles a run from a small displacement, of economize a run of a richer model.
"""

from __future__ import annotations

import argparse
import inspect
import re
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
from matrix_features import RATE, Feature, H, M, Scene, T, features

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from reporting import replace_table

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "matrix.md"
MOTION, POLES, SLOPES, FITTED, CHOSEN = 1e-3, 1e-5, 2e-2, 1e-2, 1e-2  # how near is near enough, relative


class NotApplicable(Exception):
    """The feature means nothing to this way."""


class Refused(Exception):
    """A way that has no place for the feature."""


class Warned(Exception):
    """A way that says, where it is made, that the feature is not right in it."""


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


def given(way: Callable[..., Any], scene: Scene) -> Scene:
    """The scene, if the way has an argument for everything in it."""
    known = inspect.signature(way).parameters
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


def late(events: Any, truth: fa.Result) -> float:
    """How far an event's times are from those of the truth, as a part of the run."""
    return float(abs(events[0][0] - truth.t_events[0]).max()) / T[-1] if truth.t_events else 0.0


def rolled(f: Feature) -> float:
    scene, truth = f.scene(), f.truth
    scene.pop("push", None)
    a = scene.pop("arm")
    roll = fa.rollout(a, scene.pop("q0", a.zero), step=H, nstep=len(T) - 1, **given(fa.rollout, scene))
    q = roll.q[0][np.isfinite(roll.q[0, :, 0])]
    return max(late(roll.events[0], truth) if "events" in scene else 0.0, off(a, q, truth)) / MOTION


def in_lanes(f: Feature) -> float:
    masses, truth = M * np.linspace(0.9, 1.6, 8), f.truth
    scene = f.scene()
    scene.pop("push", None)
    batch = fa.simulate_batch(scene.pop("arm"), T, **scene, step=H, parameters={f.path: masses})
    error = max(off(truth.arm, batch[1].q, truth), late(batch.events[1], truth) if "events" in scene else 0.0) / MOTION
    if error <= 1 and batch.stats["lanes"] < 2:
        raise Refused("not in lanes: each scenario is one simulate, with right results")
    return error


def slopes_off(found: np.ndarray, f: Feature) -> float:
    n = min(len(found), len(f.slopes))
    size = np.abs(f.slopes[:n]).max(axis=0)
    return float((np.abs(found[:n] - f.slopes[:n]).max(axis=0) / np.maximum(size, 0.05 * size.max())).max())


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
    guess = scene_of(f, 1.15 * M, options={"integrator": "implicit", "step": H})
    place = f.truth.frame()[0]
    rows = np.arange(0, len(f.truth.t), 10)
    columns = {f"tip {'xyz'[k]}": (place[rows, k], k) for k in np.argsort(np.ptp(place, axis=0))[1:]}
    data = fa.Data(T[rows], {k: y for k, (y, _) in columns.items()}, dict.fromkeys(columns, "m"))
    outputs = {name: (lambda r, k=k: r.frame()[0][:, k]) for name, (_, k) in columns.items()}
    fit = fa.identify(guess, data, {f.path: None}, outputs=outputs, starts=1)
    return abs(fit.values[f.path] / M - 1) / FITTED


def filtered(f: Feature) -> float:
    """Readings that are hardly believed: what it follows is its model, told all that acts; of controllers that sample,
    and of those that are fitted to a run, their torques."""
    scene, truth = f.scene(), f.truth
    scene.pop("push", None)
    if "events" in scene:
        raise NotApplicable("an event ends a run; a filter goes on")
    scene.setdefault("q", scene.pop("q0", truth.q[0]))
    scene.setdefault("v", scene.pop("v0", truth.v[0]))
    tau = None
    smooth = f.name == "FeedForward" or "Servo" in f.name  # whose current loops are
    if f.held or smooth:
        scene.pop("control")
        tau = 0.5 * (truth.tau[1:] + truth.tau[:-1]) if smooth else truth.tau[:-1]
        tau = np.vstack([tau, tau[-1:]])
    a = given(fa.KalmanFilter, scene).pop("arm")
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", fa.errors.ModelWarning)
        kalman = fa.KalmanFilter(a, f.sensors, H, force_noise=1e-9, q_std=1e-9, v_std=1e-9, **scene)
    found = kalman.run(T, tau, [s.read(truth) for s in f.sensors])
    error = off(a, found.q, truth) / MOTION
    if error > 1 and said:
        raise Warned(str(said[0].message))
    return error


def mpc(f: Feature) -> float:
    """Brings the arm to a place 0.2 rad away, or another goal of the feature, against what it knows to act."""
    scene = f.scene(r=0.0)
    if "events" in scene:
        raise NotApplicable("an event ends a run; a plan has none")
    for key in ("push", *f.aside.split()):
        scene.pop(key, None)
    a, v0 = scene.pop("arm"), scene.pop("v0", None)
    led, seen, goal = f.led or ({}, lambda a, q: q[:, :1], [0.2])
    short = "drive" in scene  # which ends
    law = fa.MPC(a, **{"reference": goal, "rate": RATE, "horizon": 0.1 if short else 0.2} | led, **given(fa.MPC, scene))
    scene["control"] = [*np.atleast_1d(scene.pop("control", [])), law]
    r = fa.simulate(a, T[::10] if short else np.linspace(0, 0.6, 301), None, v0, **scene, integrator="implicit",
                    step=5e-4)  # fmt: skip
    found = seen(a, r.q[-50:])
    return float(np.abs(found - goal).max() / max(np.abs(goal).max(), 0.2) + law.failures) / 0.05


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
    if any(hasattr(x, "steps") and x.steps(a).any() for x in getattr(control, "measure", ())):
        raise NotApplicable("an encoder does not see what is smaller than its step")
    locked = [k for k, x in drive.items() if isinstance(x, fa.Motion)]
    v = f.turn * np.eye(a.nv)[0]
    loop = fa.closed_loop(a, control, f.pose and a.pose(f.pose), v, lock=locked, **given(fa.closed_loop, scene))
    period, hold = loop.period or 4e-3, loop.q
    small = 1e-5 * np.ones(a.nv)
    small[locked] = 0
    if a.constrained:  # which rests without forces
        tau, small = np.zeros(a.nv), a.assemble(hold, small)[1]
    else:
        tau = a.inverse_dynamics(hold, v, np.zeros(a.nv), **scene) + f.drag * np.sign(v)
    parts, count = 8, 4 * len(loop.poles)  # filters of sensors see the arm at output times
    t = period / parts * np.arange(parts * count + 1)
    if control:
        scene["control"] = control
    if locked:
        scene["drive"] = {k: fa.Motion([0, t[-1]], [0.0, 0.0]) for k in locked}
    options = {"tau": tau, "integrator": "gauss", "step": 1e-3, **scene}
    up, down = (fa.simulate(a, t, hold, v + sign * small, **options).v for sign in (1, -1))
    y = np.delete(up - down, locked, axis=1)[::parts]
    modes = np.exp(np.outer(t[::parts], loop.poles))
    late = slice(count // 4, None)  # what dies in finite time has no pole
    rest = y[late] - modes[late] @ np.linalg.lstsq(modes[late], y[late], rcond=None)[0]
    return float(np.abs(rest).max() / np.abs(y[late]).max()) / POLES


def economized(f: Feature) -> float:
    plan = fa.economize(scene_of(f, M), tolerance=CHOSEN)
    if not plan.certified:
        raise Refused(f"not certified: {plan.reasons[0]}")
    rich = f.run(rich=True, integrator="gauss", step=1e-3)
    truth, found = rich.frame()[0], plan.run().frame()[0]
    return float(np.abs(found - truth).max() / np.ptp(truth, axis=0).max()) / CHOSEN


def stepped(f: Feature) -> float:
    scene = f.scene()
    scene.pop("push", None)
    sim = fa.Simulation(scene.pop("arm"), fa.Implicit(H), t=T, **scene)
    rows, late = [sim.q], 0.0
    for t in T[1:]:
        sim.step(until=t)
        if sim.terminated:
            break
        rows.append(sim.q)
    if "events" in scene:
        late = abs(sim.t_events[0] - f.truth.t_events[0]).max() / T[-1]
    return float(max(off(sim.arm, np.array(rows), f.truth), late)) / MOTION


def ways() -> dict[str, Callable[[Feature], float]]:
    return {
        "ida": simulated("ida", rtol=1e-8),
        "implicit": simulated("implicit", step=H),
        "gauss": simulated("gauss", step=1e-3),
        "rk4": simulated("rk4", step=H),
        "rollout": rolled,
        "lanes": in_lanes,
        "forward ida": forward(integrator="ida", rtol=1e-8),
        "forward implicit": forward(integrator="implicit", step=H),
        "adjoint implicit": adjoint(integrator="implicit", step=H),
        "adjoint gauss": adjoint(integrator="gauss", step=1e-3),
        "identify": identified,
        "filter": filtered,
        "MPC": mpc,
        "closed loop": poles,
        "economize": economized,
        "stepper": stepped,
    }


# --- The table ---


def tried(f: Feature, way: Callable[[Feature], float]) -> tuple[str, str]:
    """The outcome of a cell, "yes", "no", "warned", "void" or "WRONG", and its reason."""
    try:
        error = way(f)
    except NotApplicable as e:
        return "void", str(e)
    except Warned as e:
        return "warned", re.split(r"[.;] ", str(e))[0].strip()
    except (Refused, ValueError) as e:
        return "no", re.split(r"[.;] ", re.sub(r"^control\[0\] = \w+", "control", str(e)))[0].strip()
    except Exception as e:  # whatever goes wrong, the table tells
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
    shape = {"no": "{}", "warned": "! {}", "void": "({})", "WRONG": "**✗ {}**"}
    lines = [f"| | {' | '.join(columns)} |", "|-" * (len(columns) + 1) + "|"]
    for row in rows:
        marks = ["yes" if cells[row, c][0] == "yes" else shape[cells[row, c][0]].format(mark[cells[row, c]])
                 for c in columns]  # fmt: skip
        lines.append(f"| {row} | {' | '.join(marks)} |")
    count = {k: sum(outcome == k for outcome, _ in cells.values()) for k in ("yes", "no", "warned", "WRONG", "void")}
    most = len(cells) - count["void"]
    share = {k: f"{count[k]} ({100 * count[k] / max(most, 1):.1f} %)" for k in ("yes", "no", "warned", "WRONG")}
    lines += ["", f"Of {len(cells)} pairs {count['void']} mean nothing. Of the other {most}, {share['yes']} work, "
              f"{share['no']} are refused, {share['warned']} warn, and {share['WRONG']} are wrong.", ""]  # fmt: skip
    kinds = {"no": "refused", "warned": "warns", "void": "means nothing", "WRONG": "wrong"}
    lines += ["| | pairs | | reason |", "|-|-|-|-|"]
    lines += [f"| {letter} | {len(reasons[key])} | {kinds[key[0]]} | {key[1].replace('|', '/')} |"
              for key, letter in mark.items()]  # fmt: skip
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="print only")
    parser.add_argument("words", nargs="*", help="features or ways whose names contain one of these")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    all_of, columns = {f.name: f for f in features()}, ways()
    rows = list(all_of)
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
    replace_table(PAGE, "matrix", table)


if __name__ == "__main__":
    main()
