"""The arm: an immutable serial chain of links, and everything that is computed from it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from . import _core, modal
from ._check import Array, array, batch, choice
from .model import Link, _plain

METHODS = ("ab", "ci")


class Arm:
    """A serial chain of links; the first joint sits at the world's origin, in its axes.

    Coordinates q are stacked link by link: the joint's, then the beam's elastic coordinates in the order bending_y,
    bending_z, torsion, shear_y, shear_z (Eq. 33); `coordinates` names them. All methods take arrays (..., nv) and
    broadcast over the leading axes; bad arguments raise ValueError.

    Args:
        links: from the base to the tip.
        gravity: world axes (m/s^2).
    """

    def __init__(self, links: Sequence[Link], gravity: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
        self.links: tuple[Link, ...] = tuple(links)
        for k, link in enumerate(self.links):
            if not isinstance(link, Link):
                raise ValueError(f"links[{k}] = {link!r}: must be a Link")
        self.gravity: tuple[float, ...] = tuple(array("gravity", gravity, (3,)).tolist())
        self._core = _core.Arm([link._core for link in self.links], self.gravity)
        self.nq: int = self._core.nq
        self.nv: int = self._core.nv
        self.coordinates: tuple[str, ...] = tuple(self._core.coordinates)

    @staticmethod
    def from_dict(d: Mapping[str, Any]) -> Arm:
        """An arm from the structure of a scene file: {"gravity": [...], "link": [{...}, ...]}."""
        from .scene import arm_from_dict

        return arm_from_dict(d)

    def to_dict(self) -> dict[str, Any]:
        """The inverse of `from_dict`."""
        return {"gravity": _plain(self.gravity), "link": [link.to_dict() for link in self.links]}

    def __reduce__(self) -> Any:
        return Arm, (self.links, self.gravity)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Arm) and (self.links, self.gravity) == (other.links, other.gravity)

    __hash__ = None  # type: ignore[assignment]  # beams hold dictionaries

    def __repr__(self) -> str:
        return f"Arm({len(self.links)} links, {self.nv} coordinates: {', '.join(self.coordinates)})"

    def _link(self, link: Any, field: str = "link") -> int:
        n = len(self.links)
        if isinstance(link, bool) or not isinstance(link, (int, np.integer)) or not -n <= link < n:
            raise ValueError(f"{field} = {link!r}: must be from {-n} to {n - 1}")
        return int(link) % n

    def joint_coordinate(self, link: int, field: str = "link") -> int:
        """Index in q and v of the coordinate of a link's joint; `field` is what an error calls the link."""
        n = self._link(link, field)
        if self.links[n].joint.nv == 0:
            raise ValueError(f"{field} = {link}: its joint is fixed, it has no coordinate")
        return self._core.first(n)

    # -- dynamics ----------------------------------------------------------------------------------------------------

    def forward_dynamics(
        self,
        q: ArrayLike,
        v: ArrayLike,
        tau: ArrayLike | None = None,
        method: str = "ab",
        prescribed: Mapping[int, float] | None = None,
    ) -> Array:
        """Accelerations (..., nv) for generalised forces tau (N, N m; zero if None).

        Args:
            q, v, tau: (..., nv).
            method: "ab", articulated bodies (Eq. 92-96), O(N); or "ci", composite inertia (Eq. 90), O(N^3), which
                loses digits on long or badly scaled chains.
            prescribed: joint accelerations that are given, by link; tau of those joints is ignored, and
                `inverse_dynamics` of the result tells their reactions.

        Raises:
            ValueError: bad shapes or values, or a singular mass matrix.
        """
        choice("method", method, METHODS)
        lead, (q, v, tau) = batch(self.nv, q=q, v=v, tau=np.zeros(self.nv) if tau is None else tau)
        given = [False] * self.nv
        a = np.zeros_like(q)
        for link, value in (prescribed or {}).items():
            i = self.joint_coordinate(link, "prescribed: link")
            given[i] = True
            a[:, i] = array(f"prescribed[{link}]", value, ())
        return self._core.forward_dynamics(q, v, tau, method, given, a).reshape(*lead, self.nv)

    def inverse_dynamics(self, q: ArrayLike, v: ArrayLike, a: ArrayLike) -> Array:
        """Generalised forces tau = M(q) a + h(q, v), shape (..., nv), by the sweeps of Eq. 84-87. O(N)."""
        lead, rows = batch(self.nv, q=q, v=v, a=a)
        return self._core.inverse_dynamics(*rows).reshape(*lead, self.nv)

    def mass_matrix(self, q: ArrayLike) -> Array:
        """Joint-space mass matrix of Eq. 90, shape (..., nv, nv)."""
        lead, rows = batch(self.nv, q=q)
        return self._core.mass_matrix(*rows).reshape(*lead, self.nv, self.nv)

    def bias(self, q: ArrayLike, v: ArrayLike) -> Array:
        """h(q, v) of M a + h = tau, shape (..., nv): inertial, gravity, elastic and damping forces."""
        return self.inverse_dynamics(q, v, np.zeros(self.nv))

    def energy(self, q: ArrayLike, v: ArrayLike) -> tuple[Any, Any]:
        """Kinetic and potential energy (J), each of shape (...): potential is elastic less sum of m g . p."""
        lead, rows = batch(self.nv, q=q, v=v)
        e = self._core.energy(*rows)
        if lead == ():
            return float(e[0, 0]), float(e[0, 1])
        return e[:, 0].reshape(lead), e[:, 1].reshape(lead)

    # -- kinematics --------------------------------------------------------------------------------------------------

    def frame(self, q: ArrayLike, link: int = -1, x: float | None = None) -> tuple[Array, Array]:
        """Position (..., 3) and orientation (..., 3, 3) in the world of the slice of a link's beam at x metres.

        x = None is the link's end, where the next joint sits. The columns of R are the slice's axes.
        """
        lead, (q,) = batch(self.nv, q=q)
        p, R = self._core.frame(q, self._link(link), x)
        return p.reshape(*lead, 3), R.reshape(*lead, 3, 3)

    def jacobian(self, q: ArrayLike, link: int = -1, x: float | None = None) -> Array:
        """Jacobian (..., 6, nv) of such a frame: [linear; angular] velocity in world axes (Phi H of Eq. 91)."""
        lead, (q,) = batch(self.nv, q=q)
        return self._core.jacobian(q, self._link(link), x).reshape(*lead, 6, self.nv)

    def strain(self, q: ArrayLike, link: int = 0, x: float = 0.0) -> Array:
        """Strains K1, K2, K3 (1/m) and phi12, phi13 (rad) at x metres along a link's beam (Eq. 18-21), (..., 5)."""
        lead, (q,) = batch(self.nv, q=q)
        return self._core.strain(q, self._link(link), x).reshape(*lead, 5)

    def deflection(self, q: ArrayLike, link: int = 0, x: float | None = None) -> Array:
        """Displacement (..., 3) of the slice at x metres (None: the beam's tip) from rest, in the link's axes (m)."""
        lead, (q,) = batch(self.nv, q=q)
        n = self._link(link)
        beam = self.links[n].beam
        if beam is None:
            raise ValueError(f"link = {link}: has no beam, so no deflection")
        return self._core.deflection(q, n, beam.length if x is None else x).reshape(*lead, 3)

    # -- modes -------------------------------------------------------------------------------------------------------

    def modes(
        self,
        q: ArrayLike | None = None,
        speed: Mapping[int, float] | None = None,
        lock: Iterable[int] | None = None,
    ) -> modal.Modes:
        """Natural frequencies and modes about a steady state.

        The joints stand at q (zero if None) or move at constant `speed`, under whatever forces that takes; the elastic
        coordinates are in balance (found from q by Newton's iteration).

        Args:
            q: (nv,).
            speed: joint rates by link (rad/s, m/s).
            lock: links whose joints keep exactly to that motion; the others are free to vibrate about it.

        Returns:
            Modes: `.frequencies` (rad/s), `.damping`, `.shapes`, `.eigenvalues`, `.q`.

        Raises:
            ValueError: bad arguments, or no steady state at this speed.
        """
        return modal.modes(self, q, speed, lock)
