"""Dynamics and their Jacobians against Lagrange's equations by automatic differentiation (oracle.py)."""

import flexarm as fa
import numpy as np
import pytest
from oracle import Beam, Jet, Oracle
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

SECTION = {
    "type": "general",
    "area": 2e-4,
    "second_moment_y": 6e-9,
    "second_moment_z": 2e-9,
    "torsion_constant": 5e-9,
    "shear_correction": 0.8,
}
SOFT = {"density": 3000.0, "youngs_modulus": 4e8, "shear_modulus": 1e8}  # so that inertia counts beside stiffness
HUB = {
    "mass": 0.4,
    "com": [0.03, -0.02, 0.01],
    "inertia": [2e-3, 3e-3, 4e-3, 2e-4, -3e-4, 1e-4],
    "end": [0.06, 0.01, -0.02],
}
TIP = {
    "mass": 0.3,
    "com": [0.05, 0.04, -0.03],
    "inertia": [1e-3, 2e-3, 1.5e-3, 1e-4, 2e-4, -2e-4],
    "end": [0.1, -0.05, 0.02],
}
SPATIAL = {"bending_y": 2, "bending_z": 2, "torsion": 1, "shear_y": 1, "shear_z": 1}
G = [1.0, -4.0, -8.0]
ORDERS = (1, 2, 3, "exact")


def beam(modes: dict, order: int | str = 2, length: float = 0.6, **more) -> dict:
    return {
        "length": length, "section": SECTION, "material": SOFT, "modes": modes, "basis": "legendre", "order": order,
    } | more  # fmt: skip


def link(joint: str, *bodies: dict, **more) -> dict:
    """Bodies in order: hub, beam, tip; {} where there is none."""
    return {"joint": {"type": joint, **more}} | {
        k: b for k, b in zip(("hub", "beam", "tip"), bodies, strict=False) if b
    }


PLANE = {"bending_y": 2}
SPRING = {"stiffness": 3.0, "rest": 0.2, "damping": 0.4}
SIDES = {
    "inboard": {"position": [0.02, -0.03, 0.05], "rotation": [0.3, -0.5, 0.4]},
    "outboard": {"position": [-0.04, 0.01, 0.03], "rotation": [-0.7, 0.2, 0.6]},
}
SCENES = {
    "two planar links": [link("revolute", {}, beam(PLANE), axis="z"), link("revolute", {}, beam(PLANE), axis="z")],
    "revolute and universal": [
        link("revolute", HUB, beam(SPATIAL), axis=[1.0, 2.0, 2.0], **SPRING),
        link(
            "universal", {}, beam({"bending_y": 1, "bending_z": 1, "torsion": 1}, kelvin_voigt=0.01), TIP, damping=0.1
        ),
    ],
    "cart": [link("prismatic", HUB, beam(SPATIAL), TIP, axis="y", **SPRING)],
    "tip body between links": [
        link("cylindrical", {}, beam({"bending_z": 2, "torsion": 1}), TIP, axis="x"),
        link("axes", HUB, beam({"bending_y": 2, "shear_y": 1}, rotary_inertia=False), {}, axes=["rz", "ty"], **SIDES),
    ],
    "free base and ball": [
        link("free", HUB, beam({"bending_y": 1, "torsion": 1}), TIP),
        link("spherical", {}, beam({"bending_z": 1}, 3), TIP, damping=0.2, **SIDES),
    ],
    "clamped-free": [
        link("revolute", HUB, beam({"bending_y": 2, "bending_z": 1, "torsion": 1}, basis="clamped-free"), axis="z"),
        link("planar", {}, beam({"bending_y": 1, "shear_y": 2}, 3, basis="clamped-free"), TIP),
    ],
} | {f"order {n}": [link("revolute", HUB, beam(SPATIAL, n), TIP, axis="y")] for n in ORDERS}
SCENES |= {
    f"stretching, order {n}": [
        link("revolute", HUB, beam(SPATIAL | {"extension": 2}, n), TIP, axis="y"),
        link("revolute", {}, beam({"bending_y": 2, "extension": 1}, n, kelvin_voigt=0.01), axis="z"),
    ]
    for n in ORDERS
}
SCENES |= {
    f"{b}, stretching in the plane, order {n}": [
        link("revolute", {}, beam({"bending_y": 2, "shear_y": 1, "extension": 2}, n, basis=b), TIP, axis="z")
    ]
    for n, b in ((2, "clamped-free"), (3, "legendre"), (3, "clamped-free"), ("exact", "legendre"))
}


def on(parent: int | str, link: dict, at: float | None = None) -> dict:
    return link | {"parent": parent} | ({} if at is None else {"at": at})


_RIGID, _BENT = {"mass": 0.4, "com": [0.1, 0.02, 0], "inertia": [2e-3, 3e-3, 4e-3]}, {"bending_y": 1, "torsion": 1}
SCENES |= {  # trees
    f"fork of beams, order {n}": [
        link("revolute", HUB, beam(SPATIAL, n), TIP, axis="z", **SPRING),
        link("revolute", {}, beam(_BENT, n), TIP, axis="y", damping=0.2),
        on(0, link("universal", HUB, beam(_BENT, n), **SIDES)),
    ]
    for n in ORDERS
} | {
    "planar fork on a cart": [
        link("prismatic", _RIGID, axis="x"),
        link("revolute", {}, beam(PLANE), axis="z"),
        link("revolute", {}, beam(PLANE, "exact"), axis="z"),
        on(0, link("revolute", {}, beam(PLANE, 3), axis="z", **SPRING)),
        on(0, link("revolute", _RIGID, axis="z")),
    ],
    "two arms on the world": [
        link("revolute", HUB, beam(_BENT), axis="z"),
        link("revolute", _RIGID, axis="y"),
        on("world", link("cylindrical", HUB, beam(_BENT), TIP, axis="y", **SIDES)),
    ],
    "satellite": [
        link("free", HUB),
        link("revolute", {}, beam(_BENT), TIP, axis="z"),
        on(0, link("revolute", {}, beam(_BENT, 3), axis="y", **SIDES)),
        on(0, link("spherical", {}, beam({"bending_z": 1}), TIP, **SIDES)),
        on(3, link("revolute", _RIGID, axis="x")),
        on(3, link("fixed", {}, beam({"bending_z": 1}), TIP, **SIDES)),
    ],
    "in an order across": [  # children of a link after those of another
        link("revolute", HUB, axis="z"),
        link("revolute", {}, beam(_BENT), axis="y"),
        on(0, link("revolute", _RIGID, axis="x", **SIDES)),
        on(1, link("revolute", TIP, axis="y", damping=0.1)),
        on(2, link("universal", {}, beam(_BENT), TIP)),
        on(1, link("revolute", HUB, axis="x", **SIDES)),
        on(4, link("prismatic", TIP, axis="z", **SPRING)),
    ],
} | {
    f"on slices of a beam, order {n}": [  # two on one slice, one on another, one on the end, one on a slice of a child
        link("revolute", HUB, beam(SPATIAL | {"extension": 1}, n), TIP, axis="z", **SPRING),
        on(0, link("revolute", {}, beam(_BENT, n), TIP, axis="y", damping=0.2, **SIDES), 0.25),
        on(0, link("spherical", TIP), 0.45),
        on(0, link("universal", HUB, beam(_BENT, n), **SIDES)),
        on(0, link("fixed", {}, beam(_BENT, n), TIP, **SIDES), 0.25),
        on(1, link("revolute", _RIGID, axis="x", **SIDES), 0.3),
        on(4, link("prismatic", TIP, axis="z", **SPRING)),
    ]
    for n in ORDERS
} | {
    f"on slices in the plane, order {n}": [  # none on the end of the last beam, and one on its whole length
        link("prismatic", _RIGID, axis="x"),
        link("revolute", {}, beam(PLANE | {"shear_y": 1, "extension": 1}, n), TIP, axis="z"),
        on(1, link("revolute", {}, beam(PLANE, n), axis="z", **SPRING), 0.2),
        on(1, link("revolute", _RIGID, axis="z"), 0.35),
        on(2, link("prismatic", _RIGID, axis="y", **SPRING), 0.6),
        on(1, link("revolute", {}, beam(PLANE, 3), axis="z")),
    ]
    for n in ORDERS
}

_BASES = [0.3, -0.4, 0.2], [-0.2, 0.3, -0.4]  # in the world
_PISTON = {"stiffness": 300.0, "damping": 4.0, "force": 7.0, "length": 0.5}
_ROPE = {"stiffness": 200.0, "damping": 3.0, "tension": 2.0}
_OVER = [_BASES[0], ["a", 0.2], {"link": "b", "at": 0.45, "offset": [0.02, 0.1, -0.05]}, "b"]


def named(*links: dict) -> list[dict]:
    return [x | {"name": name} for x, name in zip(links, "abcdef", strict=False)]


STRUTS = {  # beside links: tables of struts and tendons
    "struts, rigid chain": {
        "link": named(link("revolute", HUB, axis="z"), link("revolute", HUB, {}, TIP, axis="z", **SPRING)),
        "strut": [
            {"a": _BASES[0], "b": "a"} | _PISTON,
            {"a": {"link": "a", "at": "origin", "offset": [0, 0.1, 0]}, "b": {"link": 1, "offset": [0, 0, 0.1]}}
            | _PISTON,
            {"a": "a", "b": "b", "stiffness": 50.0},  # at rest as the arm is made
        ],
    },
    "tendons, spatial with a ball": {
        "link": named(
            link("revolute", HUB, beam({"bending_y": 2, "torsion": 1}, "exact"), {}, axis="z"),
            link("spherical", {}, beam({"bending_y": 1, "bending_z": 1}, 3), TIP, damping=0.2),
        ),
        "strut": [{"a": "a", "b": {"link": "b", "at": 0.25, "offset": [0, 0.05, 0]}} | _PISTON],
        "tendon": [
            {"points": _OVER, "length": 0.4} | _ROPE,  # tight
            {"points": _OVER, "length": 4.0} | _ROPE,  # slack
            {"points": [_BASES[1], {"link": "a", "at": "origin", "offset": [0, 0, 0.1]}, ["b", 0.0], ["b", 0.6]]}
            | {"stiffness": 80.0, "length": 4.0, "damping": 1.0, "tension_only": False},
        ],
    },
}
STRUTS |= {
    f"struts, planar beams, order {n}": {
        "link": named(link("revolute", {}, beam(PLANE, n), axis="z"), link("revolute", {}, beam(PLANE, n), axis="z")),
        "strut": [{"a": ["a", 0.3], "b": {"link": "b", "at": 0.2, "offset": [0.0, -0.05, 0.0]}} | _PISTON],
        "tendon": [{"points": [_BASES[0], ["a", 0.5], "b"], "length": 0.3} | _ROPE],
    }
    for n in (2, "exact")
} | {
    f"struts, fork of beams, order {n}": {
        "link": named(*SCENES[f"fork of beams, order {n}"]),
        "strut": [
            {"a": {"link": "b", "at": 0.4, "offset": [0.0, 0.03, 0.02]}, "b": {"link": "c", "offset": [0, 0.1, 0]}}
            | _PISTON,
            {"a": _BASES[1], "b": {"link": "c", "at": 0.2, "offset": [0.01, 0.02, 0.03]}} | _PISTON,
        ],
        "tendon": [{"points": ["b", ["a", 0.3], ["c", 0.5], _BASES[0]], "length": 0.5} | _ROPE],
    }
    for n in ORDERS
} | {
    "struts, satellite": {
        "link": named(*SCENES["satellite"]),
        "strut": [{"a": "b", "b": "d"} | _PISTON, {"a": ["b", 0.3], "b": ["f", 0.4]} | _PISTON],
        "tendon": [{"points": [["b", 0.5], {"link": "a", "offset": [0, 0.1, 0]}, ["c", 0.5], "e"]} | _ROPE],
    },
}
SCENES |= {name: scene["link"] for name, scene in STRUTS.items()}

_STIFF, _HERTZ = {"stiffness": 2e3, "damping": 0.3}, {"stiffness": 2e4, "damping": 0.2, "exponent": 1.5, "radius": 0.04}
_RUBS = {"stiffness": 2e3, "damping": 0.1, "coulomb": 0.6, "tangential_stiffness": 900.0, "radius": 0.03}
_PLANE, _BALL = {"type": "plane", "normal": [1.0, -2.0, 2.0]}, {"type": "sphere", "radius": 0.2}
_BOX = {"type": "box", "size": [0.4, 0.6, 0.2], "rotation": [0.3, -0.5, 0.7]}
_HAND = {"link": "b", "at": 0.35, "offset": [0.02, 0.03, -0.04]}
_DIP = np.multiply(_PLANE["normal"], -0.05 / 3).tolist()


def on_box(at: list[float], law: dict) -> dict:
    return {"point": "b", "against": _BOX | {"center": [0, 0, 0]}, "at": at} | law


CONTACTS = {  # beside links; `at`: where the sphere's centre is to be, in the axes of the surface
    "contacts, rigid chain": {
        "link": named(link("revolute", HUB, axis="z"), link("revolute", HUB, {}, TIP, axis="z", **SPRING)),
        "contact": [
            {"point": "b", "against": _PLANE | {"point": [0, 0, 0]}, "at": _DIP} | _STIFF,
            {"point": {"link": "b", "at": "origin", "offset": [0, 0, 0.1]}, "against": _BALL | {"center": [0, 0, 0]},
             "at": [0.1, -0.1, 0.1]} | _STIFF,
            {"point": "a", "against": _BALL | {"center": [0, 0, 0]}, "at": [0.3, 0.1, 0.1]} | _STIFF,  # away
        ],
    },
    "contacts, sides of boxes": {
        "link": named(
            link("revolute", HUB, beam({"bending_y": 1, "torsion": 1}, 2), axis="y"),
            link("spherical", {}, beam({"bending_y": 1, "bending_z": 1}, 3), TIP, damping=0.2),
        ),
        "contact": [
            on_box([0.21, 0.1, -0.05], _HERTZ),  # a face
            on_box([-0.21, 0.31, -0.05], _HERTZ),  # an edge
            on_box([0.21, -0.32, 0.11], _HERTZ),  # a corner
            on_box([-0.05, 0.1, -0.08], _STIFF),  # a point inside
        ],
    },
    "contacts, link on link": {
        "link": named(*SCENES["fork of beams, order 2"]),
        "contact": [
            {"point": _HAND, "against": _PLANE | {"point": {"link": "c", "at": 0.3, "offset": [0, 0, 0]}}, "at": _DIP}
            | _STIFF,
            {"point": "c", "against": _BALL | {"center": {"link": "a", "offset": [0, 0, 0]}}, "at": [0.12, -0.1, 0.14]}
            | _HERTZ,
            {"point": ["c", 0.2], "against": _BOX | {"center": {"link": "b", "at": "origin", "offset": [0, 0, 0]}},
             "at": [0.19, 0.31, 0.02]} | _HERTZ,
        ],
    },
    "contacts, satellite": {
        "link": named(*SCENES["satellite"]),
        "contact": [
            {"point": "e", "against": _PLANE | {"point": {"link": "a", "offset": [0, 0, 0]}}, "at": _DIP} | _HERTZ,
            {"point": ["b", 0.5], "against": _BALL | {"center": {"link": "f", "at": 0.3, "offset": [0, 0, 0]}},
             "at": [0.02, -0.18, 0.08]} | _STIFF,
        ],
    },
    "contacts that rub, slowly": {
        "link": named(*SCENES["fork of beams, order 3"]),
        "contact": [
            {"point": _HAND, "against": _PLANE | {"point": [0, 0, 0]}, "at": _DIP} | _RUBS,
            {"point": "c", "against": _BALL | {"center": {"link": "a", "offset": [0, 0, 0]}}, "at": [0.12, -0.1, 0.14]}
            | _RUBS,
            {"point": ["c", 0.2], "against": _BOX | {"center": [0, 0, 0]}, "at": [0.19, 0.31, 0.02]} | _RUBS,
        ],
    },
}  # fmt: skip
CONTACTS |= {
    f"contacts, planar beams, order {n}": {
        "link": named(link("revolute", {}, beam(PLANE, n), axis="z"), link("revolute", {}, beam(PLANE, n), axis="z")),
        "contact": [
            {"point": "b", "against": _PLANE | {"point": [0, 0, 0]}, "at": _DIP} | _STIFF,
            {"point": {"link": "b", "at": 0.4, "offset": [0, 0.02, 0]},
             "against": _BALL | {"center": {"link": "a", "at": 0.2, "offset": [0, 0, 0]}}, "at": [-0.1, 0.12, 0.0]}
            | _STIFF,
        ],
    }
    for n in (2, "exact")
}  # fmt: skip
CONTACTS["contacts that rub, fast"] = CONTACTS["contacts that rub, slowly"]
SCENES |= {name: scene["link"] for name, scene in CONTACTS.items()}


def put(scene: dict, q: np.ndarray) -> dict:
    """Surfaces moved to where their contacts are as asked at q."""
    contacts = [{k: x for k, x in c.items() if k != "at"} for c in scene["contact"]]
    made = Oracle(scene | {"contact": contacts}, 20)
    moved = []
    for c, x, law, y in zip(contacts, scene["contact"], made.contacts, made.centres(q), strict=True):
        key = "point" if law.kind == "plane" else "center"
        point = c["against"][key] if isinstance(c["against"][key], dict) else {"link": "world"}
        offset = law.on[2][0, 0] + law.axes @ (y - x["at"])
        moved.append(c | {"against": c["against"] | {key: point | {"offset": offset.tolist()}}})
    return scene | {"contact": moved}


def state(arm: fa.Arm, elastic: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q, v, a with tip deflections of a third of the length, where the orders differ."""

    def scale(name: str) -> float:
        turns, strains = ("bending" in name or "torsion" in name), ("shear" in name or "extension" in name)
        return elastic if turns else 0.1 if strains else 1.0

    rng = np.random.default_rng(len(arm.coordinates))
    q, v, a = (rng.normal(size=n) for n in (arm.nq, arm.nv, arm.nv))
    rates = np.array([scale(c) for c in arm.coordinates])
    return q * [scale(c) for c in arm.q_names], 2 * v * rates, 5 * a * rates


def both(name: str) -> tuple[Oracle, fa.Arm, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    scene = {"gravity": G, "link": SCENES[name]} | STRUTS.get(name, {})
    q, v, a = state(fa.Arm.from_dict(scene), 0.1 if name.startswith("clamped-free") else 1.0)
    if name in CONTACTS:
        scene = put({"gravity": G} | CONTACTS[name], q)
        v = v * (0.02 if name.endswith("slowly") else 1.0)
    return Oracle(scene, 16), fa.Arm.from_dict(scene), (q, v, a)


def close(found: np.ndarray, expected: np.ndarray, rtol: float) -> None:
    """Entry by entry, but for what is below rounding of the largest."""
    np.testing.assert_allclose(found, expected, rtol=rtol, atol=1e-3 * rtol * np.abs(expected).max())


# -- the oracle is to be trusted -------------------------------------------------------------------------------------


def test_pendulum() -> None:
    body = {"mass": 2.0, "com": [0.3, 0, 0], "inertia": [0, 0, 0.05]}
    oracle = Oracle({"gravity": [0, -9.81, 0], "link": [link("revolute", body, axis="z", **SPRING)]})
    q, v, a = 0.7, 1.3, -2.1
    expected = (0.05 + 2.0 * 0.3**2) * a + 2.0 * 9.81 * 0.3 * np.cos(q) + 3.0 * (q - 0.2) + 0.4 * v
    np.testing.assert_allclose(oracle.inverse([q], [v], [a]), expected, rtol=1e-13)


def test_euler_top() -> None:
    """A body turning about its centre of mass: J dw/dt + w x J w, in its own axes."""
    oracle = Oracle({"link": [link("spherical", {"mass": 1.0, "inertia": HUB["inertia"]})]})
    xx, yy, zz, xy, xz, yz = HUB["inertia"]
    J = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    w, dw = np.array([3.0, -1.0, 2.0]), np.array([0.5, 4.0, -2.0])
    p = np.array([0.5, -0.1, 0.7, 0.2])
    np.testing.assert_allclose(oracle.inverse(p, w, dw), J @ dw + np.cross(w, J @ w), rtol=1e-13)
    by_q, by_v, by_a = oracle.jacobians(p, w, dw)
    np.testing.assert_allclose(by_q, 0, atol=1e-15)
    np.testing.assert_allclose(by_v, np.cross(w, J.T).T + np.cross(np.eye(3), J @ w).T, rtol=1e-13, atol=1e-16)
    np.testing.assert_allclose(by_a, J, rtol=1e-13)


def test_arc() -> None:
    """Constant curvature bends an exact beam to a circle, constant twist and curvature to a helix."""
    for K in ([0.0, 0.0, 3.0], [2.0, 0.0, 3.0]):
        modes = {"bending_y": 1, "torsion": 1}
        beam_ = Beam(beam(modes, "exact", length=0.8), 20)
        x, R = beam_.sections(Jet({0: np.array([[[K[2], K[0]]]])}))
        turned = Rotation.from_rotvec(0.8 * np.array(K)).as_matrix()
        np.testing.assert_allclose(R.parts[0][0, 0, -1], turned, atol=1e-13)
        k = np.linalg.norm(K)
        n = np.array(K) / k  # x = int R e1: along the axis, and turning about it
        e, s, c = np.eye(3)[0], np.sin(0.8 * k) / k, (1 - np.cos(0.8 * k)) / k
        tip = 0.8 * n * n[0] + s * (e - n * n[0]) + c * np.cross(n, e)
        np.testing.assert_allclose(x.parts[0][0, 0, -1], tip, atol=1e-13)


@pytest.mark.parametrize("name", SCENES)
def test_power_balance(name: str) -> None:
    """What the forces do is stored or goes into the dampers."""
    oracle, _, (q, v, a) = both(name)
    stored, lost = oracle.power(q, v, a)
    np.testing.assert_allclose(stored + lost, v @ oracle.inverse(q, v, a), rtol=1e-11)


def test_energy_is_conserved() -> None:
    """A falling, bending arm left to itself for 0.1 s; the integrator's tolerance is 1e-8."""
    modes = {"bending_y": 1, "bending_z": 1}
    oracle = Oracle({"gravity": G, "link": [link("revolute", HUB, beam(modes, 1), TIP, axis=[0.0, 1.0, 1.0])]}, 6)
    start = np.array([0.3, 1.5, 0.8, 2.0, -3.0, 4.0])

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[3:], oracle.forward(y[:3], y[3:], np.zeros(3))])

    end = solve_ivp(rate, (0.0, 0.1), start, method="DOP853", rtol=1e-8, atol=1e-8).y[:, -1]
    before, after = (np.array(oracle.energy(y[:3], y[3:])) for y in (start, end))
    assert abs(after[0] - before[0]) > 0.1  # J: much of it changes hands
    assert abs((after - before).sum()) < 1e-6 * before[0]


def test_orders_differ() -> None:
    """At these states each order has its own Jacobian by v, so that agreement at one says something."""
    answers = [o.jacobians(*s)[1] for o, _, s in (both(f"order {n}") for n in ORDERS)]
    for i, x in enumerate(answers):
        for y in answers[:i]:
            assert np.linalg.norm(x - y) > 1e-3 * np.linalg.norm(x)


def test_spring_and_damper() -> None:
    """A mass on a slide, a spring and a damper across it: the triangle's own sums."""
    strut = {"a": [0.0, 0.4, 0.0], "b": "a", "stiffness": 500.0, "damping": 20.0, "length": 0.45, "force": 6.0}
    slide = link("prismatic", {"mass": 2.0}, axis="x") | {"name": "a"}
    q, v, a = 0.3, 1.2, -0.7
    length, rate = 0.5, 0.3 / 0.5 * v
    for sign, oracle in (
        (1, Oracle({"link": [slide], "strut": [strut]})),
        (-1, Oracle({"link": [slide], "tendon": [{"points": [strut["a"], "a"], "tension": 6.0} | strut]})),
    ):
        push = sign * 6.0 - 500.0 * (length - 0.45) - 20.0 * rate
        np.testing.assert_allclose(oracle.strut_motion([q], [v]), [[length, rate, push]], rtol=1e-13)
        np.testing.assert_allclose(oracle.strut_jacobian([q]), [[0.6]], rtol=1e-13)
        np.testing.assert_allclose(oracle.inverse([q], [v], [a]), 2.0 * a - 0.6 * push, rtol=1e-13)
        np.testing.assert_allclose(oracle.energy([q], [v]), (1.44, 0.5 * 500.0 * 0.05**2), rtol=1e-13)
        dl, dJ = 0.6, 0.4**2 / 0.5**3  # derivatives of length and of dl/dq
        by_q = -dJ * push + 0.6 * (500.0 * dl + 20.0 * dJ * v)
        for found, expected in zip(oracle.jacobians([q], [v], [a]), (by_q, 20.0 * 0.36, 2.0), strict=True):
            np.testing.assert_allclose(found, expected, rtol=1e-13)


def test_ball_on_a_plane() -> None:
    """A mass on a slide across an inclined plane, the normal force and friction by hand."""
    slope = {"type": "plane", "point": [0, 0, 0], "normal": [0.6, 0.0, 0.8]}
    law = {"stiffness": 500.0, "damping": 0.3, "coulomb": 0.4, "tangential_stiffness": 200.0, "radius": 0.1}
    for exponent, v in ((1.0, -0.2), (1.5, -0.2), (1.5, -5.0)):
        touch = {"point": "a", "against": slope, "exponent": exponent} | law
        slide = link("prismatic", {"mass": 2.0}, axis="z") | {"name": "a"}
        oracle = Oracle({"link": [slide], "contact": [touch]})
        q, a = 0.08, -0.7
        depth, rate = 0.1 - 0.8 * q, 0.8 * v
        push = 500.0 * depth**exponent * (1 - 0.3 * rate)
        drag = min(0.3 * push * 0.6 * -v, 0.4 * push)  # upwards along the slope, as it moves down
        np.testing.assert_allclose(oracle.contact_motion([q], [v]), [[-depth, rate, push]], rtol=1e-13)
        np.testing.assert_allclose(oracle.inverse([q], [v], [a]), 2.0 * a - 0.8 * push - 0.6 * drag, rtol=1e-13)
        np.testing.assert_allclose(oracle.energy([q], [v])[1], 500.0 * depth ** (exponent + 1) / (exponent + 1))
        by_q, by_v, by_a = oracle.jacobians([q], [v], [a])
        push_q, push_v = -0.8 * exponent * push / depth, -0.8 * 0.3 * push / (1 - 0.3 * rate)
        if drag < 0.4 * push:
            drag_q, drag_v = 0.3 * push_q * 0.6 * -v - 200.0 * 0.6, 0.3 * (push_v * 0.6 * -v - 0.6 * push)
        else:
            drag_q, drag_v = 0.4 * push_q, 0.4 * push_v
        for found, expected in ((by_q, -0.8 * push_q - 0.6 * drag_q), (by_v, -0.8 * push_v - 0.6 * drag_v), (by_a, 2)):
            np.testing.assert_allclose(found, expected, rtol=1e-12)


# -- flexarm against the oracle --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SCENES)
def test_forces(name: str) -> None:
    oracle, arm, (q, v, a) = both(name)
    np.testing.assert_allclose(arm.energy(q, v), oracle.energy(q, v), rtol=1e-10)
    close(arm.inverse_dynamics(q, v, a), oracle.inverse(q, v, a), 1e-10)


@pytest.mark.parametrize("name", SCENES)
def test_jacobians(name: str) -> None:
    """Of inverse dynamics, and of forward dynamics at the same motion; without a load, and with one of nothing."""
    oracle, arm, (q, v, a) = both(name)
    by_q, by_v, M = oracle.jacobians(q, v, a)
    turns = oracle.small_turns(q)
    inverse = arm.inverse_derivatives(q, v, a)
    close(inverse[0] @ turns, by_q, 1e-9)
    close(inverse[1], by_v, 1e-9)
    close(inverse[2], M, 1e-9)
    general = arm.inverse_derivatives(q, v, a, loads=[fa.Load(0, None, force=(0, 0, 0))])
    close(general[0] @ turns, by_q, 1e-9)
    close(general[1], by_v, 1e-9)
    forward = arm.forward_derivatives(q, v, oracle.inverse(q, v, a))
    close(forward.dq @ turns, -np.linalg.solve(M, by_q), 1e-7)
    close(forward.dv, -np.linalg.solve(M, by_v), 1e-7)
    close(forward.dtau, np.linalg.inv(M), 1e-7)


def test_large_bending() -> None:
    """An exact beam bent by more than a right angle."""
    scene = {
        "gravity": G,
        "link": [link("revolute", HUB, beam({"bending_y": 2, "bending_z": 1}, "exact"), TIP, axis="z")],
    }
    oracle, arm = Oracle(scene, points=24), fa.Arm.from_dict(scene)
    q, v, a = np.array([0.4, 3.5, 1.0, -1.5]), np.array([2.0, 3.0, -2.0, 1.0]), np.array([5.0, -4.0, 3.0, 2.0])
    close(arm.inverse_dynamics(q, v, a), oracle.inverse(q, v, a), 1e-9)
    for found, expected in zip(arm.inverse_derivatives(q, v, a), oracle.jacobians(q, v, a), strict=True):
        close(found, expected, 1e-8)


@pytest.mark.parametrize("name", STRUTS)
def test_struts(name: str) -> None:
    """Lengths, rates, forces, and the Jacobian of lengths; the mass matrix is that of the arm without them."""
    oracle, arm, (q, v, _) = both(name)
    close(arm.strut_motion(q, v), oracle.strut_motion(q, v).T, 1e-11)
    close(arm.strut_jacobian(q), oracle.strut_jacobian(q), 1e-11)
    bare = fa.Arm.from_dict({"gravity": G, "link": SCENES[name]})
    assert np.array_equal(arm.mass_matrix(q), bare.mass_matrix(q))


@pytest.mark.parametrize(
    ("over", "tension", "speed"),
    [
        (-1e-4, 0.0, 1.0),  # slack
        (-1e-4, 5.0, 1.0),  # slack, but pulled
        (4e-4, 0.0, 1.0),  # the damper sets in
        (4e-4, 0.0, -30.0),  # it would push: no tension
        (2e-3, 5.0, 1.0),
        (2e-3, 5.0, -30.0),
    ],
)
def test_tendon_near_its_length(over: float, tension: float, speed: float) -> None:
    """Which of its regimes a tendon is in; by how much it is longer than `length`, m."""
    name = "tendons, spatial with a ball"
    tendon = {"points": _OVER, "stiffness": 200.0, "damping": 3.0, "tension": tension}
    scene = {"gravity": G, "link": SCENES[name], "tendon": [tendon | {"length": 1.0}]}
    q, v, a = state(fa.Arm.from_dict({"gravity": G, "link": SCENES[name]}), 1.0)
    length, rate, _ = Oracle(scene, 20).strut_motion(q, v)[0]
    v = v * speed / rate
    scene["tendon"][0]["length"] = length - over
    oracle, arm = Oracle(scene, 20), fa.Arm.from_dict(scene)
    pull = tension + max(over, 0) * 200.0 + 3.0 * min(max(over, 0) / 1e-3, 1.0) * speed
    np.testing.assert_allclose(oracle.strut_motion(q, v)[0, 2], -max(pull, 0.0), rtol=1e-9)
    close(arm.strut_motion(q, v), oracle.strut_motion(q, v).T, 1e-10)
    close(arm.inverse_dynamics(q, v, a), oracle.inverse(q, v, a), 1e-10)
    np.testing.assert_allclose(arm.energy(q, v), oracle.energy(q, v), rtol=1e-10)
    by_q, by_v, M = oracle.jacobians(q, v, a)
    found = arm.inverse_derivatives(q, v, a)
    close(found[0] @ oracle.small_turns(q), by_q, 1e-9)
    close(found[1], by_v, 1e-9)
    close(found[2], M, 1e-9)


@pytest.mark.parametrize("name", CONTACTS)
def test_contacts(name: str) -> None:
    """Gaps, rates and normal forces; all act but the one that is away. The mass matrix is that of the arm without."""
    oracle, arm, (q, v, _) = both(name)
    gap, rate, normal = arm.contact_motion(q, v)
    close(np.stack([gap, rate, normal], axis=-1), oracle.contact_motion(q, v), 1e-10)
    away = [name == "contacts, rigid chain" and k == 2 for k in range(len(arm.contacts))]
    assert np.array_equal(normal == 0, away) and np.array_equal(gap > 0, away)
    bare = fa.Arm.from_dict({"gravity": G, "link": SCENES[name]})
    assert np.array_equal(arm.mass_matrix(q), bare.mass_matrix(q))


def random_tree(rng: np.random.Generator) -> dict:
    """Links on ends and slices of random ones before; contacts of each kind on the world and on links."""
    kinds = ("revolute", "prismatic", "cylindrical", "universal", "spherical")
    links: list[dict] = []
    for k in range(int(rng.integers(3, 5))):
        joint = str(rng.choice(kinds))
        axis = {"axis": rng.normal(size=3).tolist()} if joint in kinds[:3] else {}
        sides = SIDES if rng.random() < 0.5 else {}
        modes = {s: int(rng.integers(0, 2)) for s in ("bending_y", "bending_z", "torsion")}
        flexible = sum(modes.values()) > 0 and rng.random() < 0.7
        elastic = beam(modes, [1, 2, 3, "exact"][int(rng.integers(4))]) if flexible else {}
        new = link(joint, HUB if rng.random() < 0.7 else {}, elastic, TIP, **axis, **sides)
        if k:
            parent = int(rng.integers(k))
            on_slice = "beam" in links[parent] and rng.random() < 0.5
            new = on(parent, new, float(rng.uniform(0.1, 0.6)) if on_slice else None)
        links.append(new)

    def somewhere(number: int) -> dict:
        if number < 0:
            return {"link": "world", "offset": [0, 0, 0]}
        places: list[str | float] = ["end", "origin"]
        if "beam" in links[number]:
            places += rng.uniform(0.0, 0.6, 4).tolist()
        at = places[int(rng.integers(len(places)))]
        return {"link": number, "at": at, "offset": rng.uniform(-0.1, 0.1, 3).tolist()}

    targets = ([0.0, 0.0, 0.02], [0.1, -0.1, 0.1], [0.19, 0.31, 0.02], [0.21, 0.1, -0.05], [0.05, -0.31, 0.11])
    contacts = []
    for k, y in enumerate(targets):
        surface = [_PLANE | {"normal": [0, 0, 1]}, _BALL, _BOX, _BOX, _BOX][k]
        one = int(rng.integers(len(links)))
        other = int(rng.choice([x for x in range(-1, len(links)) if x != one]))
        key = "point" if k == 0 else "center"
        contacts.append({"point": somewhere(one), "against": surface | {key: somewhere(other)}, "at": y} | _HERTZ
                        | {"exponent": float(rng.choice([1.0, 1.5]))})  # fmt: skip
    return {"gravity": G, "link": links, "contact": contacts}


@pytest.mark.parametrize("seed", range(8))
def test_contacts_of_random_trees(seed: int) -> None:
    scene = random_tree(np.random.default_rng(seed))
    q, v, a = state(fa.Arm.from_dict({k: scene[k] for k in ("gravity", "link")}), 0.5)
    scene = put(scene, q)
    oracle, arm = Oracle(scene), fa.Arm.from_dict(scene)
    motion = oracle.contact_motion(q, v)
    assert (motion[:, 0] < 0).all() and (motion[:, 2] > 0).sum() > 1
    close(np.stack(arm.contact_motion(q, v), axis=-1), motion, 1e-10)
    tau = oracle.inverse(q, v, a)
    close(arm.inverse_dynamics(q, v, a), tau, 1e-10)
    by_q, by_v, M = oracle.jacobians(q, v, a)
    np.testing.assert_allclose(M @ arm.forward_dynamics(q, v, tau), M @ a, rtol=0, atol=1e-10 * np.abs(tau).max())
    found = arm.inverse_derivatives(q, v, a)
    close(found[0] @ oracle.small_turns(q), by_q, 1e-8)
    close(found[1], by_v, 1e-9)


def test_contacts_at_order_0() -> None:
    """As of struts, below."""
    name = "contacts, link on link"
    q, v, a = state(fa.Arm.from_dict({"gravity": G, "link": SCENES[name]}), 1.0)
    links = [x | {"beam": x["beam"] | {"order": 1}} for x in SCENES[name]]
    scene = put(CONTACTS[name] | {"gravity": G, "link": links}, q)
    oracle, bare_oracle = Oracle(scene, 20), Oracle({"gravity": G, "link": links}, 20)
    links = [x | {"beam": x["beam"] | {"order": 0}} for x in links]
    arm, bare = fa.Arm.from_dict(scene | {"link": links}), fa.Arm.from_dict({"gravity": G, "link": links})
    close(np.stack(arm.contact_motion(q, v), axis=-1), oracle.contact_motion(q, v), 1e-10)
    added = arm.inverse_dynamics(q, v, a) - bare.inverse_dynamics(q, v, a)
    close(added, oracle.inverse(q, v, a) - bare_oracle.inverse(q, v, a), 1e-10)


def test_struts_at_order_0() -> None:
    """Slices are where those of order 1 are; what struts add to forces and Jacobians is the oracle's at order 1."""
    name = "struts, fork of beams, order 1"
    oracle, _, (q, v, a) = both(name)
    bare_oracle = Oracle({"gravity": G, "link": SCENES[name]}, 20)
    links = [x | {"beam": x["beam"] | {"order": 0}} for x in SCENES[name]]
    arm = fa.Arm.from_dict(STRUTS[name] | {"gravity": G, "link": links})
    bare = fa.Arm.from_dict({"gravity": G, "link": links})
    close(arm.strut_motion(q, v), oracle.strut_motion(q, v).T, 1e-11)
    added = arm.inverse_dynamics(q, v, a) - bare.inverse_dynamics(q, v, a)
    close(added, oracle.inverse(q, v, a) - bare_oracle.inverse(q, v, a), 1e-10)
    found = [x - y for x, y in zip(arm.inverse_derivatives(q, v, a), bare.inverse_derivatives(q, v, a), strict=True)]
    expected = [x - y for x, y in zip(oracle.jacobians(q, v, a), bare_oracle.jacobians(q, v, a), strict=True)]
    close(found[0] @ oracle.small_turns(q), expected[0], 1e-9)
    close(found[1], expected[1], 1e-9)
