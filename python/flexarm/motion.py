"""Motion of single slices and of the whole arm: velocities, accelerations, centre of mass, momentum.

All from the sweeps of inverse dynamics of a twin: the same arm without gravity on a base that is free to move. The six
forces of the base are the rate of the arm's momentum (Newton and Euler), so

    at rest, with accelerations v:        T_base = momentum at the velocities v               (1)
    at rest, base turning at dw/dt:       T_base = m dw/dt x c, with c the centre of mass     (2)
    with a probe (mass m_p, inertia m_p) on a slice, less the same without:
                                          T_base = m_p [a; dw/dt + p x a] of that slice       (3)

which are exact at every order, and have exact derivatives, those of inverse dynamics.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ._check import Array
from .joints import Fixed, Free
from .link import Link
from .model import RigidBody

if TYPE_CHECKING:
    from .arm import Arm

_BASE = RigidBody(1.0, inertia=(1.0, 1.0, 1.0))  # at rest itself: an arm of point masses alone has a singular free base


def twin(arm: Arm, probe: int | None = None, mass: float = 0.0) -> Arm:
    """The arm on a free base, without gravity; a probe of that mass sits at the end of link `probe`."""
    links = [Link(Free(), _BASE), *arm.links]
    if probe is not None:
        links.insert(probe + 2, Link(Fixed(), RigidBody(mass, inertia=(mass, mass, mass))))
    return type(arm)(links)


def _rows(q: Array, *rates: Array) -> list[Array]:
    """The twin's coordinates and rates (B, n), its base at rest in the origin."""
    base = np.tile([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (len(q), 1))
    return [np.hstack([base, q]), *(np.hstack([np.zeros((len(q), 6)), r]) for r in rates)]


def momentum(arm: Arm, q: Array, v: Array) -> Array:
    """[linear; angular about the world's origin] (B, 6), by (1)."""
    q2, v2, a2 = _rows(q, np.zeros_like(v), v)
    return twin(arm)._core.inverse_dynamics(q2, v2, a2)[:, :6]


def centre_of_mass(arm: Arm, q: Array) -> Array:
    """Position (B, 3), by (2): e_x x c = (0, -c_z, c_y) and e_y x c = (c_z, 0, -c_x)."""
    mass = sum(link.mass for link in arm.links)
    if mass == 0.0:
        raise ValueError("links: no link has a mass, so there is no centre of mass")
    still = np.zeros((len(q), arm.nv))
    whole = twin(arm)
    q2, v2, a = _rows(q, still, still)
    a[:, 3] = 1.0
    x = whole._core.inverse_dynamics(q2, v2, a)[:, :3]
    a[:, 3:5] = 0.0, 1.0
    y = whole._core.inverse_dynamics(q2, v2, a)[:, :3]
    return np.stack([-y[:, 2], x[:, 2], -x[:, 1]], axis=1) / mass


def _probed(arm: Arm, link: int) -> tuple[Arm, Arm, float]:
    mass = sum(part.mass for part in arm.links) or 1.0
    return twin(arm, link, mass), twin(arm), mass


def end_acceleration(arm: Arm, q: Array, v: Array, a: Array, link: int) -> Array:
    """[linear; angular] acceleration (B, 6) of a link's end, world axes, by (3)."""
    probed, plain, mass = _probed(arm, link)
    q2, v2, a2 = _rows(q, v, a)
    force = (probed._core.inverse_dynamics(q2, v2, a2) - plain._core.inverse_dynamics(q2, v2, a2))[:, :6] / mass
    p, _ = arm._core.frame(q, link, None)
    force[:, 3:] -= np.cross(p, force[:, :3])
    return force


def end_acceleration_derivatives(arm: Arm, q: Array, v: Array, a: Array, link: int) -> tuple[Array, Array]:
    """Derivatives of the linear acceleration of a link's end at fixed a, by q (3, nq) and by v (3, nv), from (3); that
    by a is the Jacobian. With v = 0 and a = v the first is that of the end's velocity."""
    probed, plain, mass = _probed(arm, link)
    q2, v2, a2 = (row[0] for row in _rows(q[None], v[None], a[None]))
    with_q, with_v = probed._core.inverse_derivatives(q2, v2, a2)
    without_q, without_v = plain._core.inverse_derivatives(q2, v2, a2)
    by_q, by_v = (with_q - without_q)[:3, 7:] / mass, (with_v - without_v)[:3, 6:] / mass
    return by_q, by_v
