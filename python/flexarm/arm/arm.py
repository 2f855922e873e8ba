"""The arm: an immutable chain or tree of links, and its computations."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._check import Array, array, choice, finite
from ..analysis import assembly, damping, linear
from ..analysis import equilibrium as balance
from ..analysis import modes as modal
from ..analysis.describe import describe
from ..analysis.validity import range_warning, worst_range
from ..model.acting.drive import voltage_forces
from ..model.acting.load import Load, at_time
from ..model.parts.chain import Chain
from ..model.parts.tables import ArmFile, read_file
from ..robots import write as robot_files
from ..view import view
from . import casadi

METHODS = ("ab", "ci")


class Arm(Chain):
    """A chain of links, or a tree; joints on the world are at its origin, in its axes.

    Coordinates q are stacked link by link: the joint's, then the beam's elastic coordinates in the order bending_y,
    bending_z, torsion, shear_y, shear_z, extension (Eq. 33); `coordinates` names their rates. Ball joints have a
    quaternion, so that nq is above nv. `arm.pose({"elbow": 0.3})` makes q of joints' coordinates. Dynamics, energies
    and kinematics take arrays q (..., nq) and v, a, tau (..., nv) and broadcast over the leading axes; modes,
    equilibrium, derivatives and linear models are of one state.
    NumPy arrays of doubles are the fastest to pass. Any number of threads may use an arm at once. Bad arguments raise
    ValueError.

    Args:
        links: from the base to the tip, numbered from 0; -1 is the last one, the default. Each sits on the end of the
            one before, or on that of its `parent`.
        gravity: world axes (m/s^2).
        struts: struts and tendons between points of the links and of the world. `arm.struts` has the struts ahead of
            the tendons, numbered from 0. Those with a mass are two more links each, behind `links`; see Strut.
        contacts: spheres and points of links that touch surfaces of the world or of other links, numbered from 0.
        loops: joints that close loops, between places of two links, or of a link and the world, numbered from 0.

    `fa.check(arm)` lists numbers that are probably mistakes: a modulus in GPa, a length or a place in mm, an inertia in
    g mm², a short thick beam without shear; and beams with too few shape functions for their payload.
    """

    @staticmethod
    def from_dict(d: Mapping[str, Any]) -> Arm:
        """An arm from the structure of a scene file: {"gravity": [...], "link": [{...}, ...]}, and "strut",
        "tendon", "contact" and "loop" likewise."""
        return Arm._read(read_file(ArmFile, d))

    @classmethod
    def _read(cls, file: ArmFile) -> Arm:
        return cls(file.link, file.gravity, [*file.strut, *file.tendon], file.contact, file.loop)

    def __str__(self) -> str:
        return self.describe()

    def describe(self) -> str:
        """A plain table, which `print(arm)` shows: of each link the joint, sizes, modes, masses and the lowest
        frequencies of its clamped beam without the tip; of the arm its mass, and its lowest frequencies and damping
        ratios with all joints locked at zero, without gravity; of each strut and tendon its points, length, spring,
        damper and constant force; of each contact its point, its surface, its gap at zero and the numbers of its
        forces; of each loop its joint, its places and what it gives way with, and how many freedoms the loops leave,
        near zero."""
        return describe(self)

    def show(
        self,
        q: ArrayLike | None = None,
        *,
        magnify: float = 1.0,
        loads: Sequence[Load] | None = None,
        t: float = 0.0,
        open: bool = True,
    ) -> view.View:
        """The arm in 3-D: sections to scale, strain as colour, joints and their axes, loads, frames.

        Outside a notebook the page opens in the browser; a notebook shows the View that is returned. The page needs
        `pip install 'flexarm[view]'`; pictures do not: `arm.show(q, open=False).save("arm.png")`.

        Args:
            q: (nq,), or as `pose` takes it: {"elbow": 0.3}; `zero` if None.
            magnify: factor of the drawn elastic coordinates (colours are not changed).
            loads, t: external forces and moments, which are drawn with their values at time t (s).
            open: whether to open a browser.

        Raises:
            ValueError: bad shapes or values. ImportError: without flexarm[view], unless open=False.
        """
        q = self.zero if q is None else self._single(q=q)[0]
        at_time(self, loads, t)
        made = view.show(self, q, magnify, loads or (), float(array("t", t, ())))
        if open and not view.in_notebook():
            made.open()
        return made

    # -- loops ---------------------------------------------------------------------------------------------------------

    def assemble(self, q: ArrayLike | None = None, v: ArrayLike | None = None, *, hold: Iterable[Any] = ()) -> Any:
        """Positions near q at which all rigid loops are closed to rounding; with v, also the rates nearest to v (in
        kinetic energy) that keep them closed.

        By damped Gauss-Newton steps from q, each the shortest. Joints move; beams bend only where joints alone do not
        close the loops. Which of several closed positions is found depends on q.

        Args:
            q: start, (nq,), or as `pose` takes it: {"crank": 0.3}; `zero` if None.
            v: rates, (nv,); None: none are sought.
            hold: links, or (link, freedom), whose joints keep their positions, and rates.

        Returns:
            q (nq,); with v, q and v (nv,).

        Raises:
            ValueError: no such positions were found, naming the loop that is farthest from closed, and its gap.
        """
        return assembly.assemble(self, q, v, hold)

    def mobility(self, q: ArrayLike | None = None) -> assembly.Mobility:
        """How many independent motions rigid loops leave at q, and how many of their conditions are redundant.

        Args:
            q: positions at which the loops are closed, (nq,); `zero` if None.

        Returns:
            Mobility: `.freedoms`, `.rows`, `.redundant`.
        """
        return assembly.mobility(self, q)

    # -- dynamics ------------------------------------------------------------------------------------------------------

    def operation_count(self, q: ArrayLike | None = None, v: ArrayLike | None = None) -> int:
        """Floating-point operations (+ - * /) of one forward dynamics, without loads. A beam of order 3 or "exact" that
        bends little needs fewer of them.

        Args:
            q: coordinates; by default all 0.1, which bends beams much.
            v: rates; by default all 0.1.
        """
        q, v = (np.full(n, 0.1) if x is None else x for x, n in ((q, self.nq), (v, self.nv)))
        return self._core.operation_count(*self._single(q=q, v=v))

    def forward_dynamics(
        self,
        q: ArrayLike,
        v: ArrayLike,
        tau: ArrayLike | None = None,
        method: str = "ab",
        *,
        prescribed: Mapping[Any, float] | None = None,
        loads: Sequence[Load] | None = None,
        t: float = 0.0,
    ) -> Array:
        """Accelerations (..., nv) for generalised forces tau (N, N m; zero if None); with rigid loops closed, those
        that keep them so.

        Args:
            q, v, tau: (..., nv).
            method: "ab", articulated bodies (Eq. 92-96), O(N); or "ci", composite inertia (Eq. 90), O(N^3), which
                loses digits on long or badly scaled chains.
                Voltages V of patches are tau = patch_matrix @ V.
            loads, t: external forces and moments, with their values at time t (s).
            prescribed: given joint accelerations, by link; tau of those joints is ignored, and `inverse_dynamics` of
                the result gives their reactions.

        Raises:
            ValueError: bad shapes or values, or a singular mass matrix.
        """
        choice("method", method, METHODS)
        q, v, tau = self._batch(q=q, v=v, tau=np.zeros(self.nv) if tau is None else tau)
        given = {i: float(array("prescribed", a, ())) for i, a in self.by_rate("prescribed", prescribed).items()}
        return self._core.forward_dynamics(q, v, tau, method, given, *at_time(self, loads, t))

    def inverse_dynamics(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, *, loads: Sequence[Load] | None = None, t: float = 0.0
    ) -> Array:
        """Generalised forces tau = M a + h - J^T loads(t), shape (..., nv), by the sweeps of Eq. 84-87. O(N).

        An arm with rigid loops is refused: which forces make a motion there depends on which joints are driven."""
        self.refuse_loops("inverse_dynamics", rigid=True)
        q, v, a = self._batch(q=q, v=v, a=a)
        return finite("inverse dynamics", self._core.inverse_dynamics(q, v, a, *at_time(self, loads, t)))

    def joint_reaction(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        link: int | str = -1,
        side: str = "outboard",
        *,
        loads: Sequence[Load] | None = None,
        t: float = 0.0,
    ) -> Array:
        """Force and moment [f; m] (N, N m; (..., 6)) that a link's joint passes on to it, all six components.

        side "outboard": at the link's origin, in the link's axes; "inboard": the same force at the end of its
        parent, in that end's axes (it acts on the parent with the opposite sign). The loads act with their values at
        time t (s).
        """
        choice("side", side, ("outboard", "inboard"))
        self.refuse_loops("joint_reaction", rigid=True)
        q, v, a = self._batch(q=q, v=v, a=a)
        F = self._core.joint_reaction(q, v, a, self._link(link), side == "inboard", *at_time(self, loads, t))
        return finite("joint reaction", F)

    def bias(self, q: ArrayLike, v: ArrayLike) -> Array:
        """h(q, v) of M a + h = tau, shape (..., nv): inertial, gravity, elastic and damping forces; without those of
        rigid loops."""
        q, v = self._batch(q=q, v=v)
        return finite("bias", self._core.inverse_dynamics(q, v, np.zeros_like(v)))

    # -- to other programs ---------------------------------------------------------------------------------------------

    def to_casadi(self, *, step: float | None = None, integrator: Any = None, columns: int = 1) -> Any:
        """The arm's equations as a function of CasADi (`pip install 'flexarm[casadi]'`) with exact Jacobians, for
        optimal control of one's own.

        Without step and integrator it is accelerations = f(q, v, tau), as of `forward_dynamics`; with them
        x_next = f(x, u), a step that begins anew, with x = [q; v] and u = tau held over it, as of `step_derivatives`.
        Its arguments are matrices of N columns, each a state by itself: a whole horizon is one call. Jacobians are
        sparse, and IPOPT's. Second derivatives are differences of them; "hessian_approximation": "limited-memory" of
        IPOPT does without.

        Args:
            step: length of the step (s), here or in the integrator.
            integrator: "implicit" or "rk4", or `fa.Implicit(...)`, `fa.RK4(...)`; None with a step: "implicit".
            columns: N.

        Returns:
            casadi.Callback. Keep it as long as you use expressions of it: CasADi does not.

        Raises:
            ValueError: bad arguments; with a step, also balls, dry friction and contacts with friction.
            ImportError: without CasADi.
        """
        if step is None and integrator is None:
            return casadi.accelerations(self, columns, self.forward_dynamics)
        return casadi.steps(self, columns, step, integrator)

    def to_mjcf(self, path: str | Path | None = None, segments: int = 10) -> str:
        """The arm as an MJCF file for MuJoCo, its beams as rigid segments on springs.

        Each beam becomes `segments` hinges in the middles of equal pieces, for bending and torsion, with springs that
        are fitted to the arm's lowest three frequencies; the file tells how near they come. Rigid links are exact.
        There is a motor for each freedom of the arm's joints, a site "tip", and a time step for these segments. A strut
        or tendon becomes a spatial tendon with its spring and damper, and an actuator with its constant force. A loop
        becomes a weld (Fixed), a connect (Spherical), or two on its axis (Revolute). Contacts are left out: MuJoCo's
        have other laws. A tree of links becomes one of bodies, with a site "NAME tip" on each link that carries no
        other; `from_mjcf` reads its links branch after branch. A free joint becomes one of MJCF, if it sits on the
        world, its moving side is at the link's origin, and its freedoms have the same numbers; otherwise it becomes
        three slides and a ball.

        Args:
            path: where to write it; None: nowhere.
            segments: of each beam, 2 to 200.

        Returns:
            The text of the file.

        Raises:
            ValueError: loops of other joints; a ball whose damping or reflected inertia differs from axis to axis; a
                beam that is curved at rest; bad arguments.

        Warns:
            RobotWarning: features of the arm that the file lacks, and a frequency error of more than 1 %.
        """
        return robot_files.to_mjcf(self, path, segments)

    def to_urdf(self, path: str | Path | None = None, segments: int = 10) -> str:
        """The arm as a URDF file, its beams as in `to_mjcf`, with a link and a joint for each freedom.

        A free joint becomes a floating one, and a planar joint whose freedoms have the same numbers a planar one. URDF
        has no springs: those of the segments stand in elements that Gazebo alone reads. The tip is a link "tip"; those
        of a tree are links "NAME tip".

        Args:
            path: where to write it; None: nowhere.
            segments: of each beam, 2 to 200.

        Returns:
            The text of the file.

        Raises:
            ValueError: loops; a ball; a free joint with more than one number of damping for all its freedoms; a beam
                that is curved at rest; bad arguments.

        Warns:
            RobotWarning: features of the arm that the file lacks, and a frequency error of more than 1 %.
        """
        return robot_files.to_urdf(self, path, segments)

    # -- modes ---------------------------------------------------------------------------------------------------------

    def modes(
        self,
        q: ArrayLike | None = None,
        speed: Mapping[Any, float] | None = None,
        lock: Iterable[Any] | None = None,
        *,
        loads: Sequence[Load] | None = None,
        t: float = 0.0,
    ) -> modal.Modes:
        """Natural frequencies and modes about a steady state.

        The joints rest at q (zero if None) or move at constant `speed`, under the required forces; the elastic
        coordinates are in equilibrium (found from q by Newton's iteration). Rigid loops must be closed at q, and stay
        closed in each mode; take q from `equilibrium` or `assemble`. The forces are those of the locked joints then,
        and of others only where those are not enough.

        Args:
            q: (nq,), or as `pose` takes it: {"elbow": 0.3}.
            speed: joint rates by link, or by (link, freedom) (rad/s, m/s).
            lock: links whose joints follow that motion exactly; the others vibrate about it.
            loads, t: external forces and moments, with their values at time t (s), included in the equilibrium.

        Returns:
            Modes: `.frequencies` (rad/s), `.damping`, `.shapes`, `.eigenvalues`, `.q`.

        Raises:
            ValueError: bad arguments, or no steady state at this speed with all beams in range.
        """
        q = None if q is None else self._single(q=q)[0]
        return modal.modes(self, q, speed, lock, at_time(self, loads, t))

    def mode_shapes(self, modes: modal.Modes, points: int = 21) -> modal.ModeShapes:
        """Modes sampled along the arm: at `points` slices of every beam, from clamp to tip, and at every link's end.

        Returns:
            ModeShapes: `.link`, `.x`, `.position` (np, 3), `.displacement` (np, 3, n).

        Raises:
            ValueError: modes of another arm, or fewer than two points.
        """
        return modal.sample(self, modes, points)

    def modal_damping(
        self,
        ratios: Any,
        q: ArrayLike | None = None,
        lock: Iterable[Any] | None = None,
        *,
        loads: Sequence[Load] | None = None,
        t: float = 0.0,
    ) -> Arm:
        """The same arm with beams damped so that its modes have given damping ratios, payload included
        (`Beam.damping_ratio` is that of the bare clamped beam).

        Other modes keep their damping if the arm has one beam. With several, each beam is damped separately, and other
        modes get some damping, too. For one beam with all modes it is the classical modal damping (Caughey 1960). Each
        beam's share is in its `damping`.

        Args:
            ratios: {mode: ratio}, numbered as in `modes(q, lock=lock)` without damping; a list, from mode 0 on; or one
                number for all modes. 2 % is 0.02.
            q, lock, loads, t: as of `modes`.

        Raises:
            ValueError: a mode that does not exist, does not vibrate, or bends no beam; a ratio below the present
                damping.
        """
        q = None if q is None else self._single(q=q)[0]
        self.refuse_loops("modal_damping", rigid=True)
        links = damping.modal_damping(self, ratios, q, lock, at_time(self, loads, t))
        return self._alike(links, self.gravity)

    def rayleigh_damping(self, mass: float = 0.0, stiffness: float = 0.0) -> Arm:
        """The same arm with beams damped in proportion to their inertia and stiffness: `mass` (1/s) times the inertia
        of each beam's coordinates, payload included, at q = `zero`; `stiffness` (s) times their stiffness. A mode of
        frequency w then has a ratio of about mass / (2 w) + stiffness w / 2."""
        return self._alike(damping.rayleigh_damping(self, mass, stiffness), self.gravity)

    # -- equilibrium and linear models --------------------------------------------------------------------------------

    def equilibrium(
        self,
        q: ArrayLike | None = None,
        tau: ArrayLike | None = None,
        lock: Iterable[Any] | None = None,
        *,
        loads: Sequence[Load] | None = None,
        t: float = 0.0,
        voltages: Any = None,
    ) -> Array:
        """Coordinates (nq,) at rest in equilibrium with gravity, springs, loads and constant generalised forces.

        Damped Newton iteration from q with exact Jacobians, decreasing the potential energy if there is one: the
            equilibrium is then stable, unless q is one already. Rigid loops are closed first, near q.

        Args:
            q: start, and positions of locked joints, (nq,); `zero` if None.
            tau: generalised forces (N, N m), (nv,); zero if None. Those of locked joints are ignored: their reactions
                are `inverse_dynamics(q, 0, 0)`.
            lock: links, or (link, freedom), whose joints are locked.
            loads, t: external forces and moments, with their values at time t (s).
            voltages: of the patches (V), (n_patches,) in the order of `patches`, or by (link, patch).

        Raises:
            ValueError: bad arguments, or no equilibrium was found: for example a free joint without support, or a load
                that shortens a beam by more than its length.

        Warns:
            StateWarning: the equilibrium is unstable, and the given q is none.
            RangeWarning: a beam is bent further than its order is good for.
        """
        if voltages is not None:
            zero = np.zeros(self.nv) if tau is None else array("tau", tau, (self.nv,))
            tau = zero + voltage_forces(self, voltages)
        q = None if q is None else self._single(q=q)[0]
        found = balance.equilibrium(self, q, tau, lock, at_time(self, loads, t))
        if (beyond := worst_range(self, np.zeros(1), found[None])) is not None:
            warnings.warn(range_warning(self, beyond, still=True).of("equilibrium"), stacklevel=2)
        return found

    def trim(
        self, q: Any = None, *, loads: Sequence[Load] | None = None, t: float = 0.0, voltages: Any = None
    ) -> balance.Trim:
        """A static equilibrium for given joint positions: elastic coordinates, and forces that hold the joints.

        `arm.linearize(q, tau=tau)`, `simulate(arm, t, q, tau=tau)` and a controller's u0 need both.

        Args:
            q: the joints' positions: all coordinates (nq,), of which the elastic ones are the start of the search; or
                as `pose` takes it, {0: 0.5, 1: -1.0}; `zero` if None.
            loads, t: external forces and moments, with their values at time t (s).
            voltages: of the patches (V), as of `equilibrium`.

        Returns:
            Trim: `.q` (nq,) and `.tau` (nv,); `q, tau = arm.trim(...)`.

        Raises:
            ValueError: bad arguments, or no equilibrium of the beams was found.

        Warns:
            StateWarning: the equilibrium of the beams is unstable: they buckle.
            RangeWarning: a beam is bent further than its order is good for.
        """
        volts = np.zeros(self.nv) if voltages is None else voltage_forces(self, voltages)
        found = balance.trim(self, q, at_time(self, loads, t), volts)
        if (beyond := worst_range(self, np.zeros(1), found.q[None])) is not None:
            warnings.warn(range_warning(self, beyond, still=True).of("trim"), stacklevel=2)
        return found

    def inverse_derivatives(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, *, loads: Sequence[Load] | None = None, t: float = 0.0
    ) -> tuple[Array, Array, Array]:
        """Exact dtau/dq (nv, nq), dtau/dv (nv, nv) and dtau/da = M (nv, nv) of `inverse_dynamics`, for one q (nq,) and
        v, a (nv,), by dual numbers through its sweeps. O(N^2)."""
        self.refuse_loops("inverse_derivatives", rigid=True)
        q, v, a = self._single(q=q, v=v, a=a)
        by_q, by_v = self._core.inverse_derivatives(q, v, a, *at_time(self, loads, t))
        return finite("inverse derivatives", by_q), finite("inverse derivatives", by_v), self.mass_matrix(q)

    def forward_derivatives(
        self,
        q: ArrayLike,
        v: ArrayLike,
        tau: ArrayLike | None = None,
        *,
        loads: Sequence[Load] | None = None,
        t: float = 0.0,
    ) -> linear.Derivatives:
        """Exact da/dq (..., nv, nq), da/dv and da/dtau (..., nv, nv) of `forward_dynamics`, as `.dq`, `.dv` and
        `.dtau`.

        From those of inverse dynamics at the acceleration a: da/dq = -M^-1 dtau/dq, da/dv = -M^-1 dtau/dv, with M^-1
        by the articulated-body method's factors (Eq. 92-96). O(N^2). Columns of a ball's quaternion do not depend on
        its length.

        Args:
            q: (..., nq). v, tau: (..., nv); tau is zero if None.
            loads, t: external forces and moments, with their values at time t (s).

        Raises:
            ValueError: bad shapes or values, or a singular mass matrix.
        """
        q, v, tau = self._batch(q=q, v=v, tau=np.zeros(self.nv) if tau is None else tau)
        return linear.forward_derivatives(self, q, v, tau, at_time(self, loads, t))

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
            inputs: the inputs; None: the forces of all joints that are not locked. Each is
                a link, or (link, freedom): the force (torque) of its joint;
                ("acceleration", link) or ("acceleration", (link, freedom)): its acceleration, prescribed;
                ("load", link) or ("load", link, x): a force on the link's end or a slice, three world components (N);
                ("strut", strut): a driven force of a strut, or tension of a tendon (N), by name or number;
                ("patch", link, patch): a piezo patch's voltage (V).
            outputs: the measurements; None: the coordinates of all joints. Each is
                ("joint", link), ("rate", link): coordinates and rates, link or (link, freedom);
                ("tip", link) or ("tip", link, x): position of the link's end or a slice, world axes (m);
                ("velocity", link), ("acceleration", link), or with x: of the same, world axes;
                ("accelerometer", link), or with x: reading R^T (a - g) of one there, in its own axes (m/s^2);
                ("strain", link, x) or ("strain", link, x, "K3"): all strains, or one (1/m, rad; Eq. 18-21);
                ("charge", link, patch), ("patch_voltage", link, patch): of a piezo patch (C, V).
            tau: generalised forces there, (nv,); zero if None. `bias(q, 0)` holds the arm at rest.
            lock: links, or (link, freedom), whose joints keep their rates exactly; they are not states. With rigid
                loops, which must be closed at q, states are coordinates that the others follow.
            loads, t: external forces and moments, with their values at time t (s).

        Returns:
            LinearModel: `.A`, `.B`, `.C`, `.D`, labels, the outputs `.y` at the state, and `.to_control()`.

        Raises:
            ValueError: bad arguments, naming the entry.

        Warns:
            StateWarning: v is zero, but the arm is not in equilibrium (it falls, or sags): the model is valid for a
                moment only.
        """
        q = self._single(q=q)[0]
        return linear.linearize(self, q, v, tau, inputs, outputs, lock, at_time(self, loads, t))
