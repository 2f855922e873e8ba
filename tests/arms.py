"""Arms for the tests: the paper's link, and random spatial arms with every strain."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import flexarm as fa
import numpy as np

DATA = Path(__file__).parent / "data"
G = 9.81
STEEL = fa.Material(7850, 209e9, 0.3)
SCENES = Path(fa.__file__).parent / "scenes"  # those that are shipped
STRAINS = ("bending_y", "bending_z", "torsion", "shear_y", "shear_z", "extension")


def shear_modulus(material: fa.Material) -> float:
    """Of an isotropic material by its Poisson ratio."""
    return material.youngs_modulus / (2 * (1 + material.poisson_ratio))


def toml(folder: Path, table: dict) -> Path:
    """A file of this table, as a user writes it."""

    def text(x: object) -> str:
        if isinstance(x, dict):
            return "{" + ", ".join(f"{json.dumps(k)} = {text(v)}" for k, v in x.items()) + "}"
        return f"[{', '.join(map(text, x))}]" if isinstance(x, (list, tuple)) else json.dumps(x)

    path = folder / "table.toml"
    path.write_text("".join(f"{k} = {text(v)}\n" for k, v in table.items()))
    return path


def reference(name: str) -> dict:
    """A reference case: scene and states or trajectories, made by an independent program (see data/README.md)."""
    return json.loads((DATA / f"{name}.json").read_text())


def paper_link(order: int = 2, n: int = 3, basis: str = "clamped-free", **beam) -> fa.Arm:
    """The IST single link of the paper's Sec. 5."""
    return fa.Arm(
        [
            fa.Link(
                fa.Revolute("z"),
                fa.RigidBody(end=(0.075, 0, 0)),
                fa.Beam(
                    0.5,
                    fa.Rectangle(0.001, 0.02),
                    fa.Material(7850, 209e9, 0.3),
                    {"bending_y": n},
                    basis,
                    order,
                    **beam,
                ),
            )
        ]
    )


def random_arm(rng: np.random.Generator, links: int, orders=(0, 1, 2, 3, "exact")) -> fa.Arm:
    """Mixed joints, bodies, sections, bases and strains; well scaled, so that 1e-10 is a fair demand."""

    def body() -> fa.RigidBody:
        m = rng.uniform(0.2, 2.0)
        A = rng.normal(size=(3, 3))
        spread = A @ A.T + 0.1 * np.eye(3)  # integral of r r^T dm: of this, an inertia that a body can have
        inertia = m * 0.005 * (np.trace(spread) * np.eye(3) - spread)
        return fa.RigidBody(m, rng.uniform(-0.1, 0.1, 3), inertia, rng.uniform(-0.2, 0.2, 3))

    def beam() -> fa.Beam:
        section = (
            fa.Rectangle(*rng.uniform(0.004, 0.02, 2)) if rng.random() < 0.5 else fa.Circle(rng.uniform(0.003, 0.01))
        )
        modes = {s: int(rng.integers(0, 3)) for s in STRAINS}
        return fa.Beam(
            rng.uniform(0.3, 1.0),
            section,
            fa.Material(rng.uniform(1e3, 8e3), rng.uniform(1e7, 1e9), 0.3),
            modes,
            basis=str(rng.choice(["clamped-free", "legendre"])),
            order=orders[int(rng.integers(len(orders)))],
            damping_ratio=float(rng.choice([0.0, 0.02])),
        )

    def joint(first: bool) -> fa.Joint:
        sides = {
            side: fa.Placement(rng.uniform(-0.1, 0.1, 3), rng.normal(size=3))
            for side in ("inboard", "outboard")
            if rng.random() < 0.3
        }
        force = {}
        if rng.random() < 0.3:
            force = {"stiffness": 2.0, "rest": 0.1, "damping": 0.3, "lower": -0.5, "upper": 0.4}
            force |= {"limit_stiffness": 50.0, "limit_damping": 0.5}
        kinds = [
            lambda: fa.Revolute(axis=rng.normal(size=3), **force, **sides),
            lambda: fa.Prismatic(axis=rng.normal(size=3), **force, **sides),
            lambda: fa.Cylindrical(axis=rng.normal(size=3), **force, **sides),
            lambda: fa.Universal(**force, **sides),
            lambda: fa.Planar(**force, **sides),
            lambda: fa.Axes(axes=("tz", "rx", "ty", "rz"), **force, **sides),
            lambda: fa.Spherical(damping=0.2, **sides),
            lambda: fa.Free(**sides),
            lambda: fa.Fixed(**sides),
        ]
        weights = np.array([4, 3, 1, 1, 1, 1, 2, 2 if first else 0, 0 if first else 2], dtype=float)
        return kinds[rng.choice(len(kinds), p=weights / weights.sum())]()

    chain = []
    for k in range(links):
        elastic = beam() if rng.random() < 0.7 else None
        needs_hub = elastic is not None and elastic.order == 0
        hub = body() if needs_hub or rng.random() < 0.8 else None
        chain.append(fa.Link(joint(k == 0), hub, elastic, body()))
    return fa.Arm(chain, rng.normal(size=3) * 5)


def random_point(rng: np.random.Generator, arm: fa.Arm, link: int) -> fa.Point:
    """Of a strut: any of the places on this link, or in the world (-1)."""
    if link < 0:
        return fa.Point("world", offset=rng.normal(size=3))
    beam, places = arm.links[link].beam, ["end", "origin"]
    at = rng.choice(places) if beam is None or rng.random() < 0.3 else float(rng.uniform(0.0, beam.length))
    return fa.Point(link, at=at if isinstance(at, float) else str(at), offset=rng.uniform(-0.1, 0.1, 3))


def strutted(rng: np.random.Generator, arm: fa.Arm, world: bool = True) -> fa.Arm:
    """The arm with two struts, a rope and a tendon that pushes too, between any links, and the world."""

    def points(n: int) -> list[fa.Point]:
        low = -1 if world else 0
        return [random_point(rng, arm, int(k)) for k in rng.integers(low, len(arm.links), n)]

    def law(of: str) -> dict[str, float]:
        return {"stiffness": rng.uniform(10, 200), "damping": rng.uniform(0, 5), "length": rng.uniform(0.2, 2),
                of: rng.normal()}  # fmt: skip

    def drawn(kind: int) -> fa.Strut | fa.Tendon:
        if kind < 2:
            return fa.Strut(*points(2), **law("force"))
        return fa.Tendon(points(int(rng.integers(2, 5))), tension_only=kind == 2, **law("tension"))

    found: list[fa.Strut | fa.Tendon] = []
    while len(found) < 4:
        new = drawn(len(found))
        with contextlib.suppress(ValueError):  # all its points on one rigid body
            fa.Arm(arm.links, struts=[new])
            found.append(new)
    return fa.Arm(arm.links, arm.gravity, struts=found)


def contacted(rng: np.random.Generator, arm: fa.Arm, q: np.ndarray, world: bool = True, **law: float) -> fa.Arm:
    """The arm with three contacts of each kind of surface: planes, balls and boxes of links, or of the world, against
    which its points come at q, in depths and beside them."""

    def somewhere(link: int) -> tuple[fa.Point, np.ndarray, np.ndarray]:
        point = random_point(rng, arm, link)
        if link < 0:
            return point, np.array(point.offset), np.eye(3)
        point = replace(point, at="end") if point.at == "origin" else point
        p, R = arm.frame(q, link, None if point.at == "end" else point.at)
        return point, p + R @ point.offset, R

    def drawn(kind: int) -> fa.Contact:
        sphere, centre, _ = somewhere(int(rng.integers(len(arm.links))))
        low = -1 if world else 0
        surface, at, R = somewhere(int(rng.integers(low, len(arm.links))))
        radius, depth = rng.uniform(0.0, 0.1), rng.uniform(-0.03, 0.05)
        turned = fa.Placement(rotation=rng.normal(size=3))
        way = rng.normal(size=3)
        way /= np.linalg.norm(way)
        far = radius - depth  # of the sphere's centre from the surface
        if kind == 2:
            half, B = rng.uniform(0.1, 0.3, 3), turned._core[1]
            face = int(rng.integers(3))
            y = rng.uniform(-0.9, 0.9, 3) * half
            y[face] = np.sign(way[face]) * (half[face] + far)
            if far > 0 and rng.random() < 0.5:  # beside an edge
                other, turn = (face + 1) % 3, rng.uniform(0.2, 1.3)
                y[face] = np.sign(way[face]) * (half[face] + far * np.sin(turn))
                y[other] = np.sign(way[other]) * (half[other] + far * np.cos(turn))
            away = B @ y
        else:
            ball = rng.uniform(0.1, 0.3)
            away = way * (far + ball) if kind else way * far
        place = replace(surface, offset=surface.offset + R.T @ (centre - at) - away)
        made = (
            (lambda: fa.Plane(place, way)),
            (lambda: fa.Sphere(place, ball)),
            (lambda: fa.Box(place, 2 * half, turned.rotation)),
        )[kind]()
        numbers = {"stiffness": rng.uniform(500, 5000), "damping": rng.uniform(0, 0.3),
                   "exponent": float(rng.choice([1.0, 1.5]))}  # fmt: skip
        return fa.Contact(sphere, made, radius=radius, **(numbers | law))

    found: list[fa.Contact] = []
    while len(found) < 9:
        new = drawn(len(found) % 3)
        with contextlib.suppress(ValueError):  # a link against itself
            fa.Arm(arm.links, contacts=[new])
            found.append(new)
    return fa.Arm(arm.links, arm.gravity, contacts=found)


def random_state(rng: np.random.Generator, arm: fa.Arm) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q, v, tau with deflections of a few per cent of a length; of a few thousandths where a beam has order 0, whose
    kinetic energy, cut at first order, is not positive further out."""
    small = any(link.beam and link.beam.order == 0 for link in arm.links)
    elastic = 0.003 if small else 0.05
    strains = STRAINS
    q = np.array([elastic if any(s in c for s in strains) else 1.0 for c in arm.q_names]) * rng.normal(size=arm.nq)
    v = np.array([elastic if any(s in c for s in strains) else 1.0 for c in arm.coordinates]) * rng.normal(size=arm.nv)
    return q, v, rng.normal(size=arm.nv)


def rates(arm: fa.Arm, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """dq/dt: v, but for the quaternions of balls."""
    return arm._core.rates(q, v)[0]


BODY = fa.RigidBody(1.3, (0.1, -0.05, 0.02), (0.02, 0.03, 0.04, 0.002, 0.001, -0.003), (0.4, 0.1, 0.0))
STRIP = fa.Beam(
    0.5,
    fa.Rectangle(0.004, 0.01),
    fa.Material(7850, 1e9, 0.3),
    {"bending_y": 2, "bending_z": 2, "torsion": 1},
    "legendre",
    gauss_points=6,
)


def pendulum(**joint) -> fa.Arm:
    """1 kg at 1 m, swinging in the x-y plane; weight along -y: it hangs at q = -pi/2."""
    return fa.Arm([fa.Link(fa.Revolute("z", **joint), fa.RigidBody(1.0, com=(1, 0, 0)))], gravity=(0, -G, 0))


def floating_arm(gravity=(0.3, -G, 1.0)) -> fa.Arm:
    joints = (fa.Free(), fa.Spherical(damping=0.1), fa.Revolute("y"))
    return fa.Arm([fa.Link(j, BODY, STRIP, BODY) for j in joints], gravity)


def moved(arm: fa.Arm, q: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """q after small rates theta for unit time; quaternions need not be of unit length."""
    return q + arm._core.rates(q, theta)[2] @ theta


def unit_balls(arm: fa.Arm, q: np.ndarray) -> np.ndarray:
    q = q.copy()
    for _, at in arm.quaternions():
        q[at] /= np.linalg.norm(q[at])
    return q


def differences(f, n: int, h: float = 1e-4) -> np.ndarray:
    """Jacobian at zero of f(small) by central differences of fourth order: truncation h^4, rounding 1e-16 / h, so about
    1e-11 of f's size and derivatives where those are well scaled."""

    def column(k: int) -> np.ndarray:
        e = np.eye(n)[k] * h
        return (8 * (f(e) - f(-e)) - (f(2 * e) - f(-2 * e))) / (12 * h)

    return np.stack([column(k) for k in range(n)], axis=-1)


def near(found: np.ndarray, expected: np.ndarray, rtol: float, size: float = 0.0) -> None:
    """Within a part of the largest number, or of `size`."""
    np.testing.assert_allclose(found, expected, rtol=0, atol=rtol * max(size, np.abs(expected).max()))


def derivative(f: Callable[[float], np.ndarray], x: float, h: float) -> np.ndarray:
    """Of f at x, by central differences of sixth order."""
    weights = {-3: -1 / 60, -2: 3 / 20, -1: -3 / 4, 1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
    return sum(w / h * f(x + k * h) for k, w in weights.items())


def run_derivatives(
    run: Callable[[float], fa.Result], x: float, h: float, rows: Sequence[str] = ("q", "v")
) -> dict[str, np.ndarray]:
    """Of the rows of run(x), by their names; of an arm without balls."""

    def stacked(x: float) -> np.ndarray:
        result = run(x)
        return np.array([getattr(result, name) for name in rows])

    return dict(zip(rows, derivative(stacked, x, h), strict=True))


def close(found: np.ndarray, expected: np.ndarray, tolerance: float) -> None:
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance * max(1.0, np.abs(expected).max()))


def satellite(order: int | str = 2, n: int = 2, free: bool = True, **beam) -> fa.Arm:
    """A free body with two flexible panels and an arm of two links, whose upper one bends."""

    def strip(length: float, y: float, z: float, modes: dict[str, int]) -> fa.Beam:
        return fa.Beam(length, fa.Rectangle(y, z), fa.Material(2700, 70e9, 0.33), modes, "legendre", order, **beam)

    half = np.pi / 2
    panel = {"bending_y": n, "torsion": 1}
    return fa.Arm(
        [
            fa.Link(
                fa.Free() if free else fa.Axes(("tx", "ty", "rz")),
                fa.RigidBody(60.0, (0.02, 0, 0.01), (5, 6, 7)),
                name="bus",
            ),
            fa.Link(
                fa.Fixed(inboard=fa.Placement((0, 0.4, 0), (0, 0, half))),
                beam=strip(2.0, 0.01, 0.5, panel),
                name="left panel",
                parent="bus",
            ),
            fa.Link(
                fa.Fixed(inboard=fa.Placement((0, -0.4, 0), (0, 0, -half))),
                beam=strip(2.0, 0.01, 0.5, panel),
                name="right panel",
                parent="bus",
            ),
            fa.Link(
                fa.Revolute("z", inboard=fa.Placement((0.4, 0, 0)), name="shoulder"),
                fa.RigidBody(1.0, (0.05, 0, 0), (0.01, 0.01, 0.01), (0.1, 0, 0)),
                strip(0.8, 0.012, 0.012, {"bending_y": n, "bending_z": n}),
                name="upper",
                parent="bus",
            ),
            fa.Link(
                fa.Revolute("z", name="elbow"),
                fa.RigidBody(2.0, (0.2, 0, 0), (0.01, 0.02, 0.02), (0.4, 0, 0)),
                name="fore",
            ),
        ]
    )


def two_arms(n: int = 2, order: int | str = 2) -> fa.Arm:
    """A torso that turns about z, with two arms of a flexible upper and a rigid lower link, in the plane."""

    def arm(side: str, sign: float) -> list[fa.Link]:
        beam = fa.Beam(0.5, fa.Rectangle(0.004, 0.03), STEEL, {"bending_y": n}, "legendre", order, kelvin_voigt=1e-3)
        seat = fa.Placement((0, sign * 0.15, 0), (0, 0, sign * 0.4))
        shoulder = fa.Revolute("z", inboard=seat, damping=0.05, name=f"{side} shoulder")
        elbow = fa.Revolute("z", damping=0.05, name=f"{side} elbow")
        return [
            fa.Link(
                shoulder,
                fa.RigidBody(0.3, (0.02, 0, 0), (1e-3, 1e-3, 1e-3)),
                beam,
                name=f"{side} upper",
                parent="torso",
            ),
            fa.Link(elbow, fa.RigidBody(0.4, (0.2, 0, 0), (1e-3, 6e-3, 6e-3), (0.4, 0, 0)), name=f"{side} fore"),
        ]

    torso = fa.Link(
        fa.Revolute("z", damping=0.5, name="waist"), fa.RigidBody(5.0, (0, 0, 0), (0.2, 0.2, 0.1)), name="torso"
    )
    return fa.Arm([torso, *arm("left", 1.0), *arm("right", -1.0)])


def masts(order: int | str = 2, n: int = 2) -> fa.Arm:
    """A boom on a turning post that carries a hoist and a stay on one slice, a jib on another, and a bucket on its end;
    all that bends does so in space, and every joint is held by a spring."""

    def bar(length: float) -> fa.Beam:
        return fa.Beam(length, fa.Rectangle(0.008, 0.012), STEEL, {"bending_y": n, "bending_z": n, "torsion": 1},
                       "legendre", order, kelvin_voigt=1e-3)  # fmt: skip

    held = {"stiffness": 20.0, "damping": 0.05}
    block = fa.RigidBody(0.4, (0.1, 0, 0.02), (1e-3, 6e-3, 6e-3), (0.2, 0, 0))
    seat = fa.Placement((0.01, 0.02, 0.03), (0.3, -0.2, 0.4))
    return fa.Arm(
        [
            fa.Link(fa.Revolute("z", name="slew", damping=0.2, stiffness=40.0), block, bar(0.8), block, "boom"),
            fa.Link(fa.Revolute("y", **held), block, name="bucket"),
            fa.Link(fa.Prismatic("z", inboard=seat, stiffness=900.0), block, name="hoist", parent="boom", at=0.5),
            fa.Link(fa.Revolute("y", inboard=seat, **held), None, bar(0.3), name="jib", parent="boom", at=0.2),
            fa.Link(fa.Universal(**held), block, name="stay", parent="boom", at=0.5),
            fa.Link(fa.Revolute("x", **held), block, name="claw", parent="jib", at=0.1),
        ],
        (0.0, 0.0, -9.81),
    )


def side_by_side(*arms: fa.Arm) -> fa.Arm:
    """Arms of one gravity as one tree, each on the world: they move as if each were alone."""
    links: list[fa.Link] = []
    for arm in arms:
        at = len(links)
        for link, parent in zip(arm.links, arm.parents, strict=True):
            links.append(replace(link, parent="world" if parent < 0 else at + parent))
    return fa.Arm(links, arms[0].gravity)


def bennett(mass: float = 0.3) -> fa.Arm:
    """Bennett's linkage of four skew hinges, three of whose conditions are redundant; nothing closes it from zero.
    `mass` is that of its second bar."""
    long, short, twist = 0.4, 0.3, np.pi / 3
    other = np.arcsin(short * np.sin(twist) / long)
    links = []
    for name, of, length, turn in (("a", long, long, 0.0), ("b", mass, short, twist), ("c", long, long, other)):
        body = fa.RigidBody(of, (length / 2, 0, 0), (1e-3, length**3 / 12, length**3 / 12), (length, 0, 0))
        links.append(fa.Link(fa.Revolute("z", inboard=fa.Placement(rotation=(turn, 0, 0))), body, name=name))
    hinge = fa.Revolute("z", inboard=fa.Placement(rotation=(twist, 0, 0)),
                        outboard=fa.Placement((short, 0, 0), (other, 0, 0)))  # fmt: skip
    return fa.Arm(links, (0, -9.81, -3.0), loops=[fa.Loop("c", (0, 0, 0), hinge, name="close")])
