"""The arm: an immutable serial chain of links, and everything that is computed from it."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from . import _core, balance, describe, linear, modal
from . import patch as _patch
from ._check import Array, array, batch, choice, finite, number
from ._part import _plain
from .doubts import ModelWarning, doubts
from .link import Link
from .load import Load, at_time
from .validity import range_warning, worst_range

METHODS = ("ab", "ci")


class Arm:
    """A serial chain of links; the first joint sits at the world's origin, in its axes.

    Coordinates q are stacked link by link: the joint's, then the beam's elastic coordinates in the order bending_y,
    bending_z, torsion, shear_y, shear_z (Eq. 33); `coordinates` names their rates. Ball joints have a quaternion, so
    that nq is above nv. All methods take arrays q (..., nq) and v, a, tau (..., nv) and broadcast over the leading
    axes; bad arguments raise ValueError.

    Args:
        links: from the base to the tip.
        gravity: world axes (m/s^2).

    Warns:
        ModelWarning: numbers that can hardly be meant: a modulus in GPa, a length in mm, a damping ratio in per cent,
            principal moments of inertia that no body has, a short thick beam without shear.
    """

    def __init__(self, links: Sequence[Link], gravity: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
        self._build(links, gravity)
        self._warned = False
        self._warn()

    @staticmethod
    def _made(links: Sequence[Link], gravity: Sequence[float] = (0.0, 0.0, 0.0)) -> Arm:
        """An arm made of another, whose user has been warned already."""
        arm = Arm.__new__(Arm)
        arm._build(links, gravity)
        arm._warned = True
        return arm

    def _warn(self) -> None:
        """ModelWarning of numbers that can hardly be meant, once: where the arm is made, or, of one that was read from
        a scene, where it is first used."""
        if not self._warned:
            self._warned = True
            for text in doubts(self):
                warnings.warn(text, ModelWarning, stacklevel=3)

    def _build(self, links: Sequence[Link], gravity: Sequence[float]) -> None:
        if not isinstance(links, Sequence):
            raise ValueError(f"links = {links!r}: must be a list of links")
        self.links: tuple[Link, ...] = tuple(links)
        for k, link in enumerate(self.links):
            if not isinstance(link, Link):
                raise ValueError(f"links[{k}] = {link!r}: must be a Link")
        self.gravity: tuple[float, ...] = tuple(array("gravity", gravity, (3,)).tolist())
        self._core = _core.Arm([link._core for link in self.links], self.gravity)
        self.nq: int = self._core.nq
        self.nv: int = self._core.nv
        self.coordinates: tuple[str, ...] = tuple(self._core.coordinates)
        self.patch_matrix: Array = self._core.patch_matrix()  #: generalised forces per volt (Eq. 61), (nv, n_patches)
        self.patch_matrix.flags.writeable = False
        self._fast_modes: Any = ()  # once known, see pace.py
        self.patches: list[tuple[int, int]] = _patch.patch_list(self)  #: (link, patch) of each of its columns

    @staticmethod
    def from_dict(d: Mapping[str, Any]) -> Arm:
        """An arm from the structure of a scene file: {"gravity": [...], "link": [{...}, ...]}. What can hardly be meant
        there (ModelWarning) is said where the arm is first simulated, linearised, or asked for modes or a balance."""
        from .scene import arm_from_dict

        return arm_from_dict(d)

    def to_dict(self) -> dict[str, Any]:
        """The inverse of `from_dict`."""
        return {"gravity": _plain(self.gravity), "link": [link.to_dict() for link in self.links]}

    def __reduce__(self) -> Any:
        return Arm._made, (self.links, self.gravity)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Arm) and (self.links, self.gravity) == (other.links, other.gravity)

    __hash__ = None  # type: ignore[assignment]  # beams hold dictionaries

    def __repr__(self) -> str:
        return f"Arm({len(self.links)} links, {self.nv} coordinates: {', '.join(self.coordinates)})"

    def __str__(self) -> str:
        return self.describe()

    def describe(self) -> str:
        """A plain table, which `print(arm)` shows: of each link the joint, sizes, modes, masses and the lowest
        frequencies of its beam clamped, without the tip; of the arm its mass, and its lowest frequencies with all
        joints locked at zero, without gravity."""
        self._warn()
        return describe.describe(self)

    def _link(self, link: Any, field: str = "link") -> int:
        n = len(self.links)
        if isinstance(link, bool) or not isinstance(link, (int, np.integer)) or not -n <= link < n:
            raise ValueError(f"{field} = {link!r}: must be from {-n} to {n - 1}")
        return int(link) % n

    def joint_rates(self, link: Any, field: str = "link") -> list[int]:
        """Indices in v of the rates of a link's joint, or of one of them when `link` is (link, freedom); `field` is
        what an error calls the link."""
        name, freedom = link if isinstance(link, tuple) and len(link) == 2 else (link, None)
        n = self._link(name, field)
        nv = self.links[n].joint.nv
        if nv == 0:
            raise ValueError(f"{field} = {link}: its joint is fixed, it has no coordinate")
        if freedom is None:
            return list(range(self._core.first(n), self._core.first(n) + nv))
        if isinstance(freedom, bool) or not isinstance(freedom, (int, np.integer)) or not 0 <= freedom < nv:
            raise ValueError(f"{field} = {link}: its joint has freedoms 0 to {nv - 1}")
        return [self._core.first(n) + int(freedom)]

    def joint_rate(self, link: Any, field: str = "link") -> int:
        """The index of one rate: of a joint with one freedom, or of (link, freedom)."""
        rates = self.joint_rates(link, field)
        if len(rates) > 1:
            raise ValueError(f"{field} = {link}: its joint has {len(rates)} freedoms; name one as ({link}, 0)")
        return rates[0]

    def by_rate(self, field: str, keyed: Mapping[Any, Any] | None) -> dict[int, Any]:
        """What is keyed by link or (link, freedom), keyed by the index of that rate instead."""
        if keyed is not None and not isinstance(keyed, Mapping):
            raise ValueError(f"{field} = {keyed!r}: must be a dictionary, by link number")
        out: dict[int, Any] = {}
        for link, value in (keyed or {}).items():
            i = self.joint_rate(link, f"{field}: link")
            if i in out:
                raise ValueError(f"{field}: link = {link}: is named twice")
            out[i] = value
        return out

    def coordinate_of(self, rate: int) -> int:
        """Index in q of the coordinate whose rate has index `rate` in v; -1 for the rates of a ball."""
        return self._core.coordinate_of(rate)

    @property
    def q_names(self) -> tuple[str, ...]:
        """A label per coordinate of q: as `coordinates`, but with the quaternions of balls; (nq,)."""
        names = [""] * self.nq
        for i, label in enumerate(self.coordinates):
            if self.coordinate_of(i) >= 0:
                names[self.coordinate_of(i)] = label
        for k, at in self.quaternions():
            names[at] = [f"link {k} {self.links[k].joint.type} quaternion {c}" for c in "wxyz"]
        return tuple(names)

    def quaternions(self) -> list[tuple[int, slice]]:
        """The links whose joints hold a ball, and where its quaternion (w, x, y, z) stands in q."""
        ends = [self._core.first_q(k) + link.joint.nq for k, link in enumerate(self.links)]
        return [(k, slice(end - 4, end)) for k, end in enumerate(ends) if self.links[k].joint.ball]

    @property
    def zero(self) -> Array:
        """All coordinates zero, but the quaternions of balls 1 0 0 0; (nq,)."""
        return np.array(self._core.zero)

    @staticmethod
    def _x(x: float | None) -> float | None:
        return None if x is None else number("x", x)

    def _batch(self, **named: ArrayLike) -> tuple[tuple[int, ...], list[Array]]:
        lead, rows = batch({k: self.nq if k == "q" else self.nv for k in named}, **named)
        if "q" in named:
            self.check_balls("q", rows[list(named).index("q")])
        return lead, rows

    def check_balls(self, field: str, q: Array) -> None:
        """ValueError when a quaternion in q (..., nq) has no length, or one whose square overflows."""
        for k, at in self.quaternions():
            size = np.abs(q[..., at]).max(axis=-1, initial=0.0)
            for value, bad in (("0 0 0 0", size < 1e-100), (f"up to {size.max(initial=0.0):g}", size > 1e100)):
                if bad.any():
                    raise ValueError(
                        f"{field}[{at.start}:{at.stop}] = {value}: the quaternion of link {k} must have a length, "
                        "from 1e-100 to 1e100"
                    )

    # -- dynamics ----------------------------------------------------------------------------------------------------

    def operation_count(self) -> int | None:
        """Floating-point operations (+ - * /) of one forward dynamics on the fast kernels; None for arms that these do
        not know: with balls, or beams of order 0, 3 or "exact"."""
        return self._core.operation_count() or None

    def forward_dynamics(
        self,
        q: ArrayLike,
        v: ArrayLike,
        tau: ArrayLike | None = None,
        method: str = "ab",
        prescribed: Mapping[Any, float] | None = None,
        loads: Sequence[Load] | None = None,
        t: float = 0.0,
    ) -> Array:
        """Accelerations (..., nv) for generalised forces tau (N, N m; zero if None).

        Args:
            q, v, tau: (..., nv).
            method: "ab", articulated bodies (Eq. 92-96), O(N); or "ci", composite inertia (Eq. 90), O(N^3), which
                loses digits on long or badly scaled chains.
                Voltages V of patches are tau = patch_matrix @ V.
            loads, t: external forces and moments, with their values at time t (s).
            prescribed: joint accelerations that are given, by link; tau of those joints is ignored, and
                `inverse_dynamics` of the result tells their reactions.

        Raises:
            ValueError: bad shapes or values, or a singular mass matrix.
        """
        choice("method", method, METHODS)
        lead, (q, v, tau) = self._batch(q=q, v=v, tau=np.zeros(self.nv) if tau is None else tau)
        given = [False] * self.nv
        a = np.zeros_like(v)
        for i, value in self.by_rate("prescribed", prescribed).items():
            given[i] = True
            a[:, i] = array("prescribed", value, ())
        return self._core.forward_dynamics(q, v, tau, method, given, a, *at_time(self, loads, t)).reshape(
            *lead, self.nv
        )

    def inverse_dynamics(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, loads: Sequence[Load] | None = None, t: float = 0.0
    ) -> Array:
        """Generalised forces tau = M a + h - J^T loads(t), shape (..., nv), by the sweeps of Eq. 84-87. O(N)."""
        lead, (q, v, a) = self._batch(q=q, v=v, a=a)
        tau = self._core.inverse_dynamics(q, v, a, *at_time(self, loads, t))
        return finite("inverse dynamics", tau).reshape(*lead, self.nv)

    def joint_reaction(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        link: int = 0,
        side: str = "outboard",
        loads: Sequence[Load] | None = None,
        t: float = 0.0,
    ) -> Array:
        """Force and moment [f; m] (N, N m; (..., 6)) that a link's joint passes on to it, all six components.

        side "outboard": at the link's origin, in the link's axes; "inboard": the same force at the end of the link
        below, in that end's axes (it acts on the link below with the opposite sign). The loads are those that act at
        time t (s).
        """
        choice("side", side, ("outboard", "inboard"))
        lead, (q, v, a) = self._batch(q=q, v=v, a=a)
        F = self._core.joint_reaction(q, v, a, self._link(link), side == "inboard", *at_time(self, loads, t))
        return finite("joint reaction", F).reshape(*lead, 6)

    def mass_matrix(self, q: ArrayLike) -> Array:
        """Joint-space mass matrix of Eq. 90, shape (..., nv, nv)."""
        lead, rows = self._batch(q=q)
        return finite("mass matrix", self._core.mass_matrix(*rows)).reshape(*lead, self.nv, self.nv)

    def bias(self, q: ArrayLike, v: ArrayLike) -> Array:
        """h(q, v) of M a + h = tau, shape (..., nv): inertial, gravity, elastic and damping forces."""
        return self.inverse_dynamics(q, v, np.zeros(self.nv))

    def energy(self, q: ArrayLike, v: ArrayLike) -> tuple[Any, Any]:
        """Kinetic and potential energy (J), each of shape (...): potential is elastic less sum of m g . p."""
        lead, rows = self._batch(q=q, v=v)
        e = finite("energy", self._core.energy(*rows))
        if lead == ():
            return float(e[0, 0]), float(e[0, 1])
        return e[:, 0].reshape(lead), e[:, 1].reshape(lead)

    # -- kinematics --------------------------------------------------------------------------------------------------

    def frame(self, q: ArrayLike, link: int = -1, x: float | None = None) -> tuple[Array, Array]:
        """Position (..., 3) and orientation (..., 3, 3) in the world of the slice of a link's beam at x metres.

        x = None is the link's end, where the next joint sits. The columns of R are the slice's axes.
        """
        lead, (q,) = self._batch(q=q)
        p, R = self._core.frame(q, self._link(link), self._x(x))
        return finite("frame", p).reshape(*lead, 3), finite("frame", R).reshape(*lead, 3, 3)

    def jacobian(self, q: ArrayLike, link: int = -1, x: float | None = None) -> Array:
        """Jacobian (..., 6, nv) of such a frame: [linear; angular] velocity in world axes (Phi H of Eq. 91)."""
        lead, (q,) = self._batch(q=q)
        return finite("jacobian", self._core.jacobian(q, self._link(link), self._x(x))).reshape(*lead, 6, self.nv)

    def jacobian_rate(self, q: ArrayLike, v: ArrayLike, link: int = -1, x: float | None = None) -> Array:
        """Time derivative (..., 6, nv) of that Jacobian at the rates v: acceleration = J a + dJ/dt v."""
        lead, (q, v) = self._batch(q=q, v=v)
        rate = self._core.jacobian_rate(q, v, self._link(link), self._x(x))
        return finite("jacobian rate", rate).reshape(*lead, 6, self.nv)

    def velocity(self, q: ArrayLike, v: ArrayLike, link: int = -1, x: float | None = None) -> Array:
        """Velocity (..., 6) of such a frame: [linear (m/s); angular (rad/s)] in world axes (Eq. 85)."""
        lead, (q, v) = self._batch(q=q, v=v)
        velocity, _ = self._core.slice_motion(q, v, v, self._link(link), self._x(x))
        return finite("velocity", velocity).reshape(*lead, 6)

    def acceleration(self, q: ArrayLike, v: ArrayLike, a: ArrayLike, link: int = -1, x: float | None = None) -> Array:
        """Acceleration (..., 6) of such a frame: [linear (m/s^2); angular (rad/s^2)] in world axes (Eq. 86)."""
        lead, (q, v, a) = self._batch(q=q, v=v, a=a)
        _, acceleration = self._core.slice_motion(q, v, a, self._link(link), self._x(x))
        return finite("acceleration", acceleration).reshape(*lead, 6)

    def center_of_mass(self, q: ArrayLike) -> Array:
        """Position (..., 3) of the whole arm's centre of mass in the world (m)."""
        lead, (q,) = self._batch(q=q)
        if not any(link.mass for link in self.links):
            raise ValueError("links: no link has a mass, so there is no centre of mass")
        _, centre = self._core.momentum(q, np.zeros((len(q), self.nv)))
        return finite("centre of mass", centre).reshape(*lead, 3)

    def momentum(self, q: ArrayLike, v: ArrayLike) -> Array:
        """The whole arm's momentum (..., 6): [linear (kg m/s); angular about the world's origin (kg m^2/s)], world
        axes. At order 0 it is that of the cut kinetic energy, a little off mass times the centre of mass's velocity."""
        lead, (q, v) = self._batch(q=q, v=v)
        return finite("momentum", self._core.momentum(q, v)[0]).reshape(*lead, 6)

    def strain(self, q: ArrayLike, link: int = 0, x: float = 0.0) -> Array:
        """Strains K1, K2, K3 (1/m) and phi12, phi13 (rad) at x metres along a link's beam (Eq. 18-21), (..., 5)."""
        lead, (q,) = batch({"q": self.nq}, q=q)  # strains do not ask for a ball's quaternion
        return finite("strain", self._core.strain(q, self._link(link), number("x", x))).reshape(*lead, 5)

    def deflection(self, q: ArrayLike, link: int = 0, x: float | None = None) -> Array:
        """Displacement (..., 3) of the slice at x metres (None: the beam's tip) from rest, in the link's axes (m)."""
        lead, (q,) = self._batch(q=q)
        n = self._link(link)
        beam = self.links[n].beam
        if beam is None:
            raise ValueError(f"link = {link}: has no beam, so no deflection")
        return finite("deflection", self._core.deflection(q, n, beam.length if x is None else number("x", x))).reshape(
            *lead, 3
        )

    def charge(self, q: ArrayLike, link: int = 0, patch: int = 0) -> Array:
        """Charge (C) that strain brings onto the electrodes of a link's patch when they are short-circuited, (...): by
        reciprocity, the patch's forces per volt (Eq. 61) times the elastic coordinates."""
        lead, (q,) = batch({"q": self.nq}, q=q)
        with np.errstate(over="ignore", invalid="ignore"):
            return finite("charge", _patch.charge(self, q, link, patch)).reshape(lead)

    def patch_voltage(self, q: ArrayLike, link: int = 0, patch: int = 0) -> Array:
        """Voltage (V) of a link's patch when its electrodes are open, (...): -charge / capacitance, so that one that
        shrinks under a voltage shows it when stretched. What that voltage does to the motion is not in it."""
        with np.errstate(over="ignore"):
            return finite("patch voltage", -self.charge(q, link, patch) / self.capacitance(link, patch))

    def capacitance(self, link: int = 0, patch: int = 0) -> float:
        """Capacitance (F) of a link's patch, of a pair in parallel, with all strains held.

        Raises:
            ValueError: no such patch, or its material has no permittivity.
        """
        return _patch.capacitance(self, self._link(link), patch)

    # -- modes -------------------------------------------------------------------------------------------------------

    def modes(
        self,
        q: ArrayLike | None = None,
        speed: Mapping[int, float] | None = None,
        lock: Iterable[int] | None = None,
        loads: Sequence[Load] | None = None,
        t: float = 0.0,
    ) -> modal.Modes:
        """Natural frequencies and modes about a steady state.

        The joints stand at q (zero if None) or move at constant `speed`, under whatever forces that takes; the elastic
        coordinates are in balance (found from q by Newton's iteration).

        Args:
            q: (nq,).
            speed: joint rates by link, or by (link, freedom) (rad/s, m/s).
            lock: links whose joints keep exactly to that motion; the others are free to vibrate about it.
            loads, t: external forces and moments, with their values at time t (s), which the elastic coordinates bear.

        Returns:
            Modes: `.frequencies` (rad/s), `.damping`, `.shapes`, `.eigenvalues`, `.q`.

        Raises:
            ValueError: bad arguments, or no steady state at this speed.
        """
        q = None if q is None else self._single(q=q)[0]
        self._warn()
        return modal.modes(self, q, speed, lock, at_time(self, loads, t))

    def mode_shapes(self, modes: modal.Modes, points: int = 21) -> modal.ModeShapes:
        """Modes sampled along the arm: at `points` slices of every beam, from clamp to tip, and at every link's end.

        Returns:
            ModeShapes: `.link`, `.x`, `.position` (np, 3), `.displacement` (np, 3, n).

        Raises:
            ValueError: modes of another arm, or fewer than two points.
        """
        return modal.sample(self, modes, points)

    # -- equilibrium and linear models -------------------------------------------------------------------------------

    def equilibrium(
        self,
        q: ArrayLike | None = None,
        tau: ArrayLike | None = None,
        lock: Iterable[Any] | None = None,
        loads: Sequence[Load] | None = None,
        t: float = 0.0,
        voltages: Any = None,
    ) -> Array:
        """Coordinates (nq,) at rest in balance with gravity, springs, loads and constant generalised forces.

        Newton's iteration from q with exact Jacobians, damped, and downhill in potential energy, where there is one:
        the equilibrium found is then stable, unless q is in balance already.

        Args:
            q: where to start, and where locked joints stay, (nq,); `zero` if None.
            tau: generalised forces (N, N m), (nv,); zero if None. Those of locked joints are ignored: what they bear is
                `inverse_dynamics(q, 0, 0)`.
            lock: links, or (link, freedom), whose joints stay where they are.
            loads, t: external forces and moments, with their values at time t (s).
            voltages: of the patches (V), (n_patches,) in the order of `patches`, or by (link, patch).

        Raises:
            ValueError: bad arguments, or no equilibrium was found: a joint that nothing holds falls for ever.

        Warns:
            StateWarning: the equilibrium is unstable, and no q in balance was given.
            RangeWarning: a beam is bent further than its order is good for.
        """
        if voltages is not None:
            zero = np.zeros(self.nv) if tau is None else array("tau", tau, (self.nv,))
            tau = zero + _patch.voltage_forces(self, voltages)
        q = None if q is None else self._single(q=q)[0]
        self._warn()
        found = balance.equilibrium(self, q, tau, lock, at_time(self, loads, t))
        if (beyond := worst_range(self, np.zeros(1), found[None])) is not None:
            warnings.warn(range_warning(self, beyond, "equilibrium: ", still=True), stacklevel=2)
        return found

    def inverse_derivatives(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, loads: Sequence[Load] | None = None, t: float = 0.0
    ) -> tuple[Array, Array, Array]:
        """Exact dtau/dq (nv, nq), dtau/dv (nv, nv) and dtau/da = M (nv, nv) of `inverse_dynamics`, for one q (nq,) and
        v, a (nv,), by dual numbers through its sweeps. O(N^2)."""
        q, v, a = self._single(q=q, v=v, a=a)
        by_q, by_v = self._core.inverse_derivatives(q, v, a, *at_time(self, loads, t))
        return finite("inverse derivatives", by_q), finite("inverse derivatives", by_v), self.mass_matrix(q)

    def forward_derivatives(
        self,
        q: ArrayLike,
        v: ArrayLike,
        tau: ArrayLike | None = None,
        loads: Sequence[Load] | None = None,
        t: float = 0.0,
    ) -> linear.Derivatives:
        """Exact da/dq (nv, nq), da/dv and da/dtau (nv, nv) of `forward_dynamics`, as `.dq`, `.dv` and `.dtau`.

        From those of inverse dynamics at the acceleration a: da/dq = -M^-1 dtau/dq, da/dv = -M^-1 dtau/dv. Columns of
        a ball's quaternion do not depend on its length.

        Args:
            q: (nq,). v, tau: (nv,); tau is zero if None.
            loads, t: external forces and moments, with their values at time t (s).

        Raises:
            ValueError: bad shapes or values, or a singular mass matrix.
        """
        q, v, tau = self._single(q=q, v=v, tau=np.zeros(self.nv) if tau is None else tau)
        return linear.forward_derivatives(self, q, v, tau, at_time(self, loads, t))

    def _single(self, **named: ArrayLike) -> list[Array]:
        arrays = [array(k, value, (self.nq if k == "q" else self.nv,)) for k, value in named.items()]
        if "q" in named:
            self.check_balls("q", arrays[list(named).index("q")])
        return arrays

    def linearize(
        self,
        q: ArrayLike,
        v: ArrayLike | None = None,
        inputs: Sequence[Any] | None = None,
        outputs: Sequence[Any] | None = None,
        *,
        tau: ArrayLike | None = None,
        lock: Iterable[Any] | None = None,
        loads: Sequence[Load] | None = None,
        t: float = 0.0,
    ) -> linear.LinearModel:
        """Linear model about a state, by exact Jacobians.

        Args:
            q, v: the state, (nq,) and (nv,); v is zero if None.
            inputs: what drives it; None: the forces of all joints that are not locked. Each is
                a link, or (link, freedom): the force (torque) of its joint;
                ("acceleration", link) or ("acceleration", (link, freedom)): its acceleration, prescribed;
                ("load", link) or ("load", link, x): a force on the link's end or a slice, three world components (N);
                ("patch", link, patch): a piezo patch's voltage (V).
            outputs: what is measured; None: the coordinates of all joints. Each is
                ("joint", link), ("rate", link): coordinates and rates, link or (link, freedom);
                ("tip", link) or ("tip", link, x): position of the link's end or a slice, world axes (m);
                ("velocity", link), ("acceleration", link), or with x: of the same, world axes;
                ("accelerometer", link), or with x: what one there reads, R^T (a - g), in its own axes (m/s^2);
                ("strain", link, x) or ("strain", link, x, "K3"): all strains, or one (1/m, rad; Eq. 18-21);
                ("charge", link, patch), ("patch_voltage", link, patch): of a piezo patch (C, V).
            tau: generalised forces there, (nv,); zero if None. `bias(q, 0)` holds the arm at rest.
            lock: links, or (link, freedom), whose joints keep their rates exactly; they leave the state.
            loads, t: external forces and moments, with their values at time t (s).

        Returns:
            LinearModel: `.A`, `.B`, `.C`, `.D`, labels, the outputs `.y` at the state, and `.to_control()`.

        Raises:
            ValueError: bad arguments, naming the entry.

        Warns:
            StateWarning: v is zero, but the arm does not rest there (it falls, or sags): the model holds for a moment.
        """
        q = self._single(q=q)[0]
        self._warn()
        return linear.linearize(self, q, v, tau, inputs, outputs, lock, at_time(self, loads, t))
