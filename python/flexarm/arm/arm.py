"""The arm: an immutable chain or tree of links, and its computations. Those that have a file of their own, in this room
or a lower one, are functions whose first argument is the arm, and here its methods."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._check import Array, array, choice, finite
from ..analysis import assembly, damping, linear
from ..analysis import equilibrium as balance
from ..analysis import modes as modal
from ..analysis.describe import describe
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

    describe = __str__ = describe

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

    def inverse_derivatives(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, *, loads: Sequence[Load] | None = None, t: float = 0.0
    ) -> tuple[Array, Array, Array]:
        """Exact dtau/dq (nv, nq), dtau/dv (nv, nv) and dtau/da = M (nv, nv) of `inverse_dynamics`, for one q (nq,) and
        v, a (nv,), by dual numbers through its sweeps. O(N^2)."""
        self.refuse_loops("inverse_derivatives", rigid=True)
        q, v, a = self._single(q=q, v=v, a=a)
        by_q, by_v = self._core.inverse_derivatives(q, v, a, *at_time(self, loads, t))
        return finite("inverse derivatives", by_q), finite("inverse derivatives", by_v), self.mass_matrix(q)

    # -- functions of other rooms ------------------------------------------------------------------------------------

    assemble, mobility = assembly.assemble, assembly.mobility
    equilibrium, trim = balance.equilibrium, balance.trim
    forward_derivatives, linearize = linear.forward_derivatives, linear.linearize
    modes, mode_shapes = modal.modes, modal.mode_shapes
    modal_damping, rayleigh_damping = damping.modal_damping, damping.rayleigh_damping
    to_casadi, to_mjcf, to_urdf = casadi.to_casadi, robot_files.to_mjcf, robot_files.to_urdf
