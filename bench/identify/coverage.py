"""Do 95 % intervals of `fa.identify` hold in 95 % of all fits?

    python bench/identify/coverage.py [-o DIR] [-n TWINS] [--seed SEED] [--case CASE ...]
    python bench/identify/coverage.py --docs CSV ...

Each twin is an arm of one flexible link with numbers drawn at random (30 % about those of the scene), a torque that is
measured, and noise. Counted is how often the truth lies within its interval, and the median error, in per cent. Fitted
from starts that are wrong by up to a factor of 3 in each number: white noise that differs by orders of magnitude
between columns; noise that is coloured (behind a first-order filter); a quantised encoder; a joint with dry friction
that sticks and slides; a drive and sensors with a delay, an offset, a gain and a filter that are sought with the rest.
Fitted from one start within 10 %: a length, a thickness, a density and two gains that the model has wrong by 0.5 %, and
the same where the fit is told so (each is sought, with a prior of 0.5 %); outliers; a measured torque that is noisy,
or was not measured, or is a random walk; and a digital loop on an encoder's steps, driven by its command.
Then: of 24 twins, whose starts are wrong by a factor of 3 in each number, how many are found from 1 and from 8 starts.
Writes coverage.csv and coverage.md into DIR (default: here); with --docs, the rows of such files into the page's table.
"""

from __future__ import annotations

import argparse
import csv
import re
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np

DOCS = Path(__file__).parents[2] / "docs" / "identify.md"
T = np.linspace(0.0, 1.0, 251)
TRUE = {
    "link.0.tip.mass": 0.05,
    "link.0.beam.material.youngs_modulus": 2.09e11,
    "link.0.joint.damping": 0.05,
    "link.0.joint.reflected_inertia": 0.01,
}
BEAM = dict(list(TRUE.items())[:2])
FRICTION = {"link.0.joint.coulomb": 0.12}
CHAIN = {"drive.0.delay": 0.0061, "sensor.0.offset": 0.02, "sensor.1.gain": 1.1, "sensor.1.filter.frequency": 20.0}
NOISE = {"angle": 5e-4, "strain": 2e-6}
#: what the model has wrong by 0.5 %: a standard deviation
WRONG = {
    "link.0.beam.length": 0.5, "link.0.beam.section.y": 0.002, "link.0.beam.material.density": 7850.0,
    "drive.0.scale": 1.0, "sensor.1.gain": 1.0,
}  # fmt: skip
SHARE = 0.005
TORQUE_NOISE = 0.02  # N m, of each sample
OUTLIERS = 0.05  # of the readings
WALK = 0.5  # N m/sqrt(s)


@dataclass
class Case:
    """What the twins of one kind have."""

    title: str
    true: dict[str, float]
    coloured: bool = False
    pulses: int | None = None
    share: float = 1.0  #: of the twins: they take longer
    step: float = 1e-3  #: of the integrator (s)
    wrong: bool = False  #: whether WRONG numbers are
    told: bool = False  #: whether the fit is told that
    outliers: bool = False
    torque_noise: bool = False
    loop: bool = False
    motion: bool = False  #: whether the torque was not measured
    walk: bool = False  #: whether it is a random walk
    near: bool = True  #: whether the fit starts within 10 %, from there alone
    fit: dict[str, Any] = field(default_factory=dict)  #: further arguments


CASES = {
    "white": Case("white noise", TRUE, near=False),
    "coloured": Case("coloured noise, behind a filter of 8 Hz", TRUE, coloured=True, near=False),
    "encoder": Case("an encoder's steps, 2000 a turn, and no other noise of the angle", TRUE, pulses=2000, near=False),
    "friction": Case("dry friction, stick and slip", {**TRUE, **FRICTION}, step=5e-4, near=False),
    "chain": Case("delay of the drive, offset, gain and filter of sensors sought, too", {**TRUE, **CHAIN}, share=0.3,
                  near=False),
    "wrong": Case("white noise; five other numbers of the model wrong by 0.5 %", TRUE, wrong=True),
    "told": Case("the same, each of the five sought with a prior of 0.5 %", TRUE, wrong=True, told=True, step=2.5e-4),
    "outliers": Case("5 % of the readings wrong by a deviation of their column", TRUE, outliers=True),
    "huber": Case('the same, `loss="huber"`', TRUE, outliers=True, fit={"loss": "huber"}),
    "torque": Case("measured torque with 0.02 N m of noise", TRUE, torque_noise=True),
    "filter": Case('the same, `method="filter"`', TRUE, torque_noise=True, fit={"method": "filter"}),
    "motion": Case('torque not measured, `inputs={0: (fa.Motion, "angle")}`', BEAM, motion=True),
    "free": Case('the same without inputs, `method="filter"`', BEAM, motion=True, fit={"method": "filter"}),
    "walk": Case("the same, of a torque that is a random walk, another one in each; noise of the readings given", BEAM,
                 motion=True, walk=True, fit={"method": "filter", "noise": NOISE}),
    "loop": Case("digital PD at 500 Hz on an encoder of 2000 counts a turn, by its command", TRUE, pulses=2000,
                 loop=True, step=2.5e-4),
}  # fmt: skip


def torque(t: float) -> float:
    """Drives the arm (N m)."""
    return float(0.35 * np.sin(2 * np.pi * (1.0 + 4.0 * t) * t) + 0.1 * np.sign(np.sin(9.0 * t)))


def scene(step: float, friction: bool = False, low_pass: bool = False) -> fa.Scene:
    """The arm with a torque on its joint, an encoder and a strain gauge."""
    joint = fa.Revolute("z", damping=0.05, reflected_inertia=0.01, coulomb=0.12 if friction else 0.0)
    beam = fa.Beam(0.5, fa.Rectangle(0.002, 0.02), fa.Material(7850, 2.09e11, 0.3), modes={"bending_y": 2},
                   basis="legendre", damping_ratio=0.01)  # fmt: skip
    arm = fa.Arm([fa.Link(joint, beam=beam, tip=fa.RigidBody(0.05))])
    gauge = fa.sensors.StrainGauge(0, 0.01, filter=20.0 if low_pass else None)
    samples = fa.Torque(T, [torque(x) for x in T])
    options = {"integrator": "implicit", "step": step}
    return fa.Scene(arm, {0: samples}, t=T, sensors=(fa.sensors.Encoder(0, pulses=None), gauge), options=options)


def looped(base: fa.Scene) -> fa.Scene:
    """The scene with a digital PD in place of its torque; its difference is filtered, its command the torque / 3."""
    a, kp, kd, time = 0.8, 20.0, 0.8, 8e-3  # of the low pass, gains, and its time constant (s)
    encoder = fa.sensors.Encoder(0, pulses=2000)
    law = fa.LinearController([[a]], [[1 - a]], [[-kd / time]], [[kp + kd / time]], rate=500, delay=1e-3, limit=3.0,
                              measure=[encoder], reference=(T, [torque(x) / 3 for x in T]))  # fmt: skip
    return replace(base, drive={}, control=(law,))


def with_values(base: fa.Scene, values: dict[str, float]) -> fa.Scene:
    """The scene with other numbers: a fit that has nothing to do gives it."""
    from flexarm.arm.variation import Setup, Variation

    setup = Setup(base.arm, base.drive, tuple(base.loads), tuple(base.control), base.sensors)
    made = Variation(setup, {k: np.array([x]) for k, x in values.items()}).scenario(0)
    return replace(base, arm=made.arm, drive=made.drive, sensors=made.sensors)


def measured(case: Case, base: fa.Scene, true: dict[str, float], rng: np.random.Generator) -> fa.Data:
    """What a rig with these numbers would record; its torque is known as it was asked for."""
    twin = with_values(base, true)
    asked = np.array([torque(x) for x in T])
    if case.torque_noise:
        twin = replace(twin, drive={0: fa.Torque(T, asked + TORQUE_NOISE * rng.normal(size=len(T)))})
    if case.walk:
        t = np.linspace(0.0, 1.0, 2001)
        twin = replace(twin, drive={0: fa.Torque(t, WALK * np.sqrt(t[1]) * np.cumsum(rng.normal(size=t.size)))})
    fine = replace(twin, t=np.linspace(0.0, 1.0, 2001), options={"integrator": "implicit", "step": 1.25e-4})
    run = fine.run()
    columns = {}
    for name, sensor in zip(NOISE, twin.sensors, strict=True):
        y = sensor.read(run).y[::8, 0]
        noise = NOISE[name] * rng.normal(size=y.size)
        if case.coloured:
            noise = fa.sensors.LowPass(8.0).apply(T, 3 * noise)
        if name == "angle" and case.pulses:
            y = np.round(y * case.pulses / (2 * np.pi)) * (2 * np.pi) / case.pulses
        else:
            y = y + noise
        if case.outliers:
            y = np.where(rng.random(y.size) < OUTLIERS, y + y.std() * rng.normal(0.5, 1.0, y.size), y)
        columns[name] = y
    units = {"angle": "rad", "strain": "1", "torque": "N m", "command": "rad"}
    return fa.Data(T, {**columns, "torque": asked, "command": asked / 3}, units)


def fits(case: Case, count: int, seed: int = 0) -> Iterator[tuple[dict[str, float], fa.results.Fit]]:
    """Truth and fit of each twin."""
    base = scene(case.step, "link.0.joint.coulomb" in case.true, "sensor.1.filter.frequency" in case.true)
    base = looped(base) if case.loop else base
    model = replace(base, drive={}) if case.motion else base
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        true = {name: x * rng.uniform(0.7, 1.3) for name, x in case.true.items()}
        wrong = {name: x * (1 + SHARE * rng.normal()) for name, x in WRONG.items()} if case.wrong else {}
        data = measured(case, base, {**true, **wrong}, rng)
        sought: dict[str, Any] = {}
        for name, x in true.items():
            start = x * 3.0 ** rng.uniform(-1, 1) if not case.near else x * rng.uniform(0.9, 1.1)
            sought[name] = fa.Unknown(start, low=start / 4, high=start * 4)
        if case.told:
            sought |= {name: fa.Unknown(x, mean=x, std=SHARE * x) for name, x in WRONG.items()}
        inputs: dict[Any, Any] = {"control.0.reference": "command"} if case.loop else {0: "torque"}
        outputs = {"angle": "sensor.0", "strain": "sensor.1"}
        if case.motion and case.fit:
            inputs = {}
        elif case.motion:
            inputs, outputs = {0: (fa.Motion, "angle")}, {"strain": "sensor.1"}
        yield true, fa.identify(
            model, data, sought, inputs=inputs, outputs=outputs, starts=1 if case.near else 16, keep=2, seed=k,
            workers=1, **case.fit,
        )  # fmt: skip


def found(starts: int | None, count: int = 24) -> int:
    """How many twins are fitted, and not in a local minimum, from starts wrong by a factor of 3 in each number."""
    case, good = CASES["white"], 0
    base = scene(case.step)
    for k in range(count):
        rng = np.random.default_rng([5, k])
        true = {name: x * rng.uniform(0.7, 1.3) for name, x in case.true.items()}
        data = measured(case, base, true, rng)
        sought = {name: x * 3.0 ** rng.choice([-1, 1]) for name, x in true.items()}
        fit = fa.identify(
            base, data, sought, inputs={0: "torque"}, outputs={"angle": "sensor.0", "strain": "sensor.1"},
            starts=starts, workers=1,
        )  # fmt: skip
        good += fit.nrmse["strain"] < 0.05
    return good


NAMES = {
    "link.0.tip.mass": "tip mass", "link.0.beam.material.youngs_modulus": "modulus", "link.0.joint.damping": "damping",
    "link.0.joint.reflected_inertia": "rotor", "link.0.joint.coulomb": "friction", "drive.0.delay": "delay",
    "sensor.0.offset": "offset", "sensor.1.gain": "gain", "sensor.1.filter.frequency": "filter",
}  # fmt: skip


def table(found: list[dict[str, Any]], old: str = "") -> str:
    """Of the rows of coverage.csv; of kinds that have none the row of the old table."""
    kept = {line.split(" | ")[1]: line for line in old.splitlines() if line.count(" | ") == 4}
    head = ["arms", "noise", "truth within the 95 % interval, for each number (%)", "all (%)", "median error (%)"]
    lines = [f"| {' | '.join(head)} |", "|-|-|-|-|-|"]
    for name, case in CASES.items():
        rows = [r for r in found if r["case"] == name]
        hits, off = dict[str, float](), dict[str, float]()
        for p in case.true if rows else ():
            own = [[float(r[k]) for k in ("low", "true", "high", "value")] for r in rows if r["number"] == p]
            low, true, high, value = np.array(own).T
            hits[p], off[p] = 100 * np.mean((low <= true) & (true <= high)), 100 * np.median(np.abs(value / true - 1))
        if rows:
            each = ", ".join(f"{NAMES[p]} {x:.1f}" for p, x in hits.items())
            error = ", ".join(f"{x:.2g}" for x in off.values())
            lines.append(f"| {len(own)} | {case.title} | {each} | {np.mean(list(hits.values())):.1f} | {error} |")
        elif case.title in kept:
            lines.append(kept[case.title])
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", type=Path, default=Path(), help="folder for the tables")
    parser.add_argument("-n", type=int, default=200, help="twins of each kind")
    parser.add_argument("--seed", type=int, default=0, help="of all draws")
    parser.add_argument("--case", choices=CASES, action="append", help="these alone")
    parser.add_argument("--docs", metavar="CSV", type=Path, nargs="+", help="write docs/identify.md's table of these")
    args = parser.parse_args()
    if args.docs:
        found = [row for path in args.docs for row in csv.DictReader(path.open())]
        text = DOCS.read_text(encoding="utf-8")
        begin, end = "<!-- coverage: written by bench/identify/coverage.py -->\n", "<!-- end of coverage -->"
        text = re.sub(f"{begin}(.*?){end}", lambda m: begin + table(found, m[1]) + end, text, flags=re.DOTALL)
        DOCS.write_text(text, encoding="utf-8")
        return
    args.o.mkdir(parents=True, exist_ok=True)
    warnings.simplefilter("ignore")
    keys = ["case", "twin", "number", "true", "start", "value", "low", "high", "std"]
    rows: list[dict[str, Any]] = []
    with (args.o / "coverage.csv").open("w", newline="") as f:
        writer = csv.DictWriter(f, keys)
        writer.writeheader()
        for name in args.case or CASES:
            began, count = time.perf_counter(), round(CASES[name].share * args.n)
            for k, (true, fit) in enumerate(fits(CASES[name], count, args.seed)):
                for p, x in true.items():
                    row = [name, k, p, x, fit.start[p], fit.values[p], *fit.intervals[p], fit.std[p]]
                    rows.append(dict(zip(keys, row, strict=True)))
                    writer.writerow(rows[-1])
                f.flush()
            print(f"{name}: {(time.perf_counter() - began) / count:.2f} s for each fit", flush=True)
    text = table(rows)
    if not args.case:
        told = ", ".join(f"starts={n}: {found(n)}" for n in (1, 8, None))
        text += f"\nOf 24 arms with starts wrong by a factor of 3 in each number, it finds with {told}.\n"
    print(text)
    (args.o / "coverage.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
