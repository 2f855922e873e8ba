"""The result of a simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from .._check import Array, instance, named, path_of
from .._console import progress_bar
from ..arm.arm import Arm
from ..data.draw.style import Figure
from ..data.draw.trajectory import plot_panels
from ..data.files import CSV, HDF5, MAT, NPZ, read_arrays, write_hdf5, write_npz
from ..data.store.files import readable
from ..model.parts.labels import deflections, ends, joint_coordinates, joint_rates
from ..view.view import View, animate
from . import outputs
from . import watch as monitors


@dataclass(repr=False)
class Result(outputs.Rows):
    """Trajectory of an arm; every array has one row per output time.

    Attributes:
        arm: the arm.
        t: times (s), (nt,).
        q: coordinates, (nt, nq). v, a: rates and accelerations, (nt, nv).
        tau: generalised forces (N, N m), (nt, nv): those applied, and the reactions of prescribed motions.
        friction: dry friction of the joints (N, N m), (nt, nv): it opposes sliding, or holds a joint that sticks; None
            where no joint has any.
        driven: forces that drives add to each strut, and tensions to each tendon (N), (nt, n); None where
            none is driven.
        contacts: the whole force of each contact on its link (N), friction included, world axes, (nt, n, 3); None where
            there is none, or it is not kept.
        loops: force (N) and moment (N m) of each loop on its place b, about the origin of the joint's frame there,
            world axes, (nt, n, 6); None where there is none, or it is not kept.
        loads: the loads of the simulation; None when they were not kept (a file keeps none).
        stats: the integrator, steps, evaluations, jacobians, newton_iterations, linear_iterations (of GMRES),
            failed_steps (whose equations were not solved, or whose error was too large), switches (of joints between
            sticking and sliding), wall_time (s).
        t_events, q_events, v_events: per event, the times (n,), coordinates (n, nq) and rates (n, nv) of its
            occurrences; None without events.
        status: 0: the last output time was reached, or the run failed; 1: a terminal event ended it.
    """

    def __repr__(self) -> str:
        by = f" of {self.stats['integrator']}" if "integrator" in self.stats else ""
        span = f"t = {self.t[0]:g} to {self.t[-1]:g} s" if len(self.t) else "no times"
        off = f", {self._known.short}" if self._known else ""
        steps = f"{self.stats.get('steps', 0)} steps{by}{off}"
        return f"Result({len(self.t)} rows, {span}, {self.arm.nv} coordinates, {steps})"

    def strain(self, link: int | str = -1, x: float = 0.0) -> Array:
        """K1, K2, K3 (1/m), phi12, phi13 (rad), eps at x metres along a link's beam, (nt, 6); see Arm.strain."""
        return self.arm.strain(self.q, link, x)

    def energy(self) -> tuple[Array, Array]:
        """Kinetic and potential energy (J), (nt,) each."""
        return self.arm.energy(self.q, self.v)

    def joint_reaction(self, link: int | str = -1, side: str = "outboard") -> Array:
        """Force and moment (nt, 6) that a link's joint passes on to it (N, N m); see Arm.joint_reaction."""
        if self.loads is None:
            raise ValueError(
                "loads = None: the file does not keep the loads of this result, so its reactions are not known"
            )
        arm, loads = self.acting
        if not loads:
            return arm.joint_reaction(self.q, self.v, self.a, link, side)
        rows = zip(self.q, self.v, self.a, self.t, strict=True)
        return np.array([arm.joint_reaction(q, v, a, link, side, loads=loads, t=t) for q, v, a, t in rows])

    def charge(self, link: int | str = -1, patch: int = 0) -> Array:
        """Short-circuit charge of a link's patch (C), (nt,); see Arm.charge. A driven patch has capacitance V more."""
        return self.arm.charge(self.q, link, patch)

    def patch_voltage(self, link: int | str = -1, patch: int = 0) -> Array:
        """Open-circuit voltage of a link's patch (V), (nt,); see Arm.patch_voltage."""
        return self.arm.patch_voltage(self.q, link, patch)

    def plot(self) -> Figure:
        """A figure of the joint coordinates, the tip deflections, the torques and forces of the joints that are driven,
        the forces of struts and tendons, the normal forces of contacts, and the sizes of the forces of loops, over
        time; and of the error, where it was estimated."""
        arm, t = self.arm, self.t
        joints = joint_coordinates(arm)
        panels: list[tuple[str, list[tuple[str, Array]]]] = []
        units = {"rad": "Joint angle (rad)", "m": "Joint displacement (m)", "1": "Quaternion of a ball"}
        for unit, name in units.items():
            curves = [(label, self.q[:, i]) for i, label, u in joints if u == unit]
            if curves:
                panels.append((name, curves))
        tips = {k: self.tip_deflection(k) for k in sorted({k for k, _, _ in deflections(arm)})}
        bent = [(label, tips[k][:, component]) for k, component, label in deflections(arm)]
        if bent:
            panels.append(("Tip deflection (m)", bent))
        if not panels:
            for k, label in ends(arm):
                position = self.frame(k)[0]
                panels.append((f"Position of the {label} (m)", [(x, position[:, i]) for i, x in enumerate("xyz")]))
        rates = joint_rates(arm)
        for unit, name in {"rad": "Joint torque (N m)", "m": "Joint force (N)"}.items():
            forces = [(label, self.tau[:, i]) for i, label, u in rates if u == unit and self.tau[:, i].any()]
            if forces:
                panels.append((name, forces))
        if arm.struts:
            panels.append(("Strut force (N)", [(name, self.strut(name).force) for name in arm.strut_names]))
        if arm.contacts:
            forces = [(name, self.contact(name).normal) for name in arm.contact_names]
            panels.append(("Normal force (N)", forces))
        if arm.loops and self.loops is not None:
            sizes = [(name, np.linalg.norm(self.loop(name).force, axis=1)) for name in arm.loop_names]
            panels.append(("Force of the loop (N)", sizes))
        if self._known:
            panels.append(self._known.panel)
        return plot_panels(t, panels)

    def animate(
        self, *others: Result, magnify: float = 1.0, speed: float = 1.0, titles: Sequence[str] | None = None
    ) -> View:
        """The run in 3-D: the arm with strain as colour, the path of its tip, loads, and a slider of time.

        A View: a notebook shows it; `.open()` shows it in a browser (`pip install 'flexarm[view]'`), and
        `.save("run.html")`, ".png", ".gif" or ".mp4" writes it; pictures and films need no browser.

        Args:
            others: further results, of this arm or of others, side by side with this one.
            magnify: the elastic coordinates are drawn that many times as large (the colours are not).
            speed: of playing; 1 is real time.
            titles: one for each result.

        Raises:
            ValueError: bad arguments, or a result without rows.
        """
        runs = (self, *others)
        for k, run in enumerate(others):
            instance(f"others[{k}]", run, Result)
        names = [f"run {k + 1}" if others else "" for k in range(len(runs))] if titles is None else titles
        texts = isinstance(names, (list, tuple)) and all(isinstance(x, str) for x in names)
        if not texts or len(names) != len(runs):
            raise ValueError(f"titles = {titles!r}: must be a list of {len(runs)} strings, one for each result")
        return animate([(run.arm, run.t, run.q, run.loads) for run in runs], magnify, speed, names)

    def sensitivities(self, parameters: Sequence[str], *, progress: Any = False) -> Any:
        """Derivatives of all rows by parameters, forward: at a cost that grows with their number. The run is made
        again, and derived step by step: these are derivatives of the integrator's own equations. Rows stand at their
        times; those of a run that a terminal event ended end before it. The times and states of events move with the
        parameters: see Sensitivities.

        Args:
            parameters: dotted paths as of `simulate_batch`: "link.0.tip.mass", "control.0.kp", "drive.0.scale",
                "q0.1"; "gravity" stands for its three components.
            progress: shows progress on stderr: a bar, or lines where that is no terminal; or a callable (done, text).

        Raises:
            ValueError: naming the parameter: nothing that can vary, or no room to vary in; where derivatives do not
                go through: dry friction together with balls; contacts with friction; laws in Python that remember;
                sensors of controllers that read in steps; of a result that is not one of `simulate`.
        """
        with progress_bar(progress, "deriving") as look:
            return self._made().sensitivities(parameters, look=look)

    def gradient(self, loss: Any, parameters: Sequence[str], *, progress: Any = False) -> dict[str, Any]:
        """Derivatives of a number that depends on the rows, by the adjoint method: backwards through the run, at a cost
        that hardly grows with the number of parameters. (With "ida", and under controllers that sample sensors, or an
        MPC, it is made of `sensitivities`.)

        Args:
            loss: derivatives of the number by rows, such as {"q": (nt, nq), "tau": (nt, nv)}, of "q", "v", "a", "tau",
                and by "t_events", "q_events", "v_events", lists as the result has them; or a function of a Result that
                gives the number and these.
            parameters: paths as of `sensitivities`; "tau" is the constant forces, and "drive.0.samples" the samples of
                a torque or voltage.
            progress: as of `sensitivities`.

        Returns:
            By path a number, or an array where the path stands for several.

        Raises:
            ValueError: as of `sensitivities`; a loss of wrong names or shapes.
        """
        with progress_bar(progress, "deriving") as look:
            found: dict[str, Any] = self._made().gradient(loss, parameters, look=look)
        return found

    def error(
        self, quantity: Any = "tip", *, parameters: Mapping[str, float] | None = None, progress: Any = False
    ) -> Any:  # fmt: skip
        """The error of this run, over time, and its sources: steps, and of each beam the order of rotation,
        rotary inertia, Gauss points, missing shapes of each strain, and strains that are left out.

        The run is made again in finer steps, and in a richer model, and backwards through that (3 runs, however many
        sources there are; 2 more with `parameters`). The error is the difference; the adjoint method splits it. The
        result keeps the last estimate: `print`, `plot` and `check` tell it, and it is not made twice.

        Args:
            quantity: "tip", the position of the arm's end, of a tree of all its ends; "joint", the coordinates of
                those joints that are not prescribed; "strain", that of every beam at its clamp; or a callable of a
                Result that returns an array (nt,) or (nt, k), of its coordinates.
            parameters: uncertain numbers of the scene, by their paths as of `sensitivities`, with the uncertainty of
                each in parts of its value: {"link.0.beam.material.youngs_modulus": 0.02}.
            progress: shows the present activity on stderr: a bar, or lines if that is no terminal.

        Returns:
            ErrorEstimate: prints as a table; `.total` over time, `.largest`, `.sources`, `.reliable`, `.reason`,
            `.plot()`.

        Raises:
            ValueError: where derivatives do not go through, as of `gradient`; rigid loops; constant forces `tau` on
                elastic coordinates; a quantity that is none of these.
        """
        known = {} if parameters is None else parameters
        words = "a dictionary of relative uncertainties by path, such as {'link.0.tip.mass': 0.02}"
        asked = quantity, dict(instance("parameters", known, Mapping, words))
        if self._error is None or self._error[0] != asked:
            try:
                found = Result._estimate(self, quantity, parameters, progress)
            except ValueError as e:
                found = e
            self._error = asked, found
        if isinstance(self._error[1], ValueError):
            raise self._error[1].with_traceback(None)
        return self._error[1]

    _estimate: ClassVar[Any]  # of the room `choose`, which makes richer models

    @property
    def _known(self) -> Any:
        """The last estimate of the error; None: there is none."""
        return None if self._error is None or isinstance(self._error[1], ValueError) else self._error[1]

    def _made(self) -> Any:
        if self._source is None:
            raise ValueError("this result does not know what it was made of; one that `simulate` gives does")
        return self._source

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_source": None, "_error": None}

    def to_pandas(self) -> Any:
        """A pandas DataFrame of `to_data`: its index is t (s), `.attrs["units"]` has the units. It needs
        `pip install 'flexarm[pandas]'`."""
        return self.to_data().to_pandas()

    def save(self, path: str | Path) -> None:
        """Writes a file, in the format of its suffix.

        .npz (or none), .h5 (or .hdf5, where each matrix has attributes "columns" and "units"): everything, the arm and
        events included; `Result.load` reads it. .csv (or .txt) and .mat: the columns of `to_data`. `fa.Data.load` reads
        the columns of all of them.

        Raises:
            ValueError: another suffix, or where nothing can be written.
        """
        file = named(path, *NPZ, *HDF5, *CSV, *MAT)
        kind = file.suffix.lower()
        if kind in (*CSV, *MAT):
            self.to_data().save(file)
            return
        arrays, about = self._packed()
        names, values = outputs.derived(self)
        arrays, names = {**arrays, **values}, {"t": [("t", "s")], **outputs.titles(self.arm), **names}
        (write_hdf5 if kind in HDF5 else write_npz)(file, arrays, names, about)

    check, compare, to_data = monitors.check, outputs.compare, outputs.to_data

    def _packed(self) -> tuple[dict[str, Array], dict[str, Any]]:
        """All arrays by name, and the rest for JSON."""
        kept = None if self.loads is None else len(self.loads)
        more = {f"{name}_events_{k}": x for name in "tqv" for k, x in enumerate(getattr(self, f"{name}_events") or ())}
        about = {"arm": self.arm.to_dict(), "stats": self.stats, "loads": kept is None or kept, "status": self.status}
        about["events"] = None if self.t_events is None else len(self.t_events)
        return {"t": self.t, **self.matrices, **more}, about

    @staticmethod
    def load(path: str | Path) -> Result:
        """Reads a file of `save`, .npz or .h5; tables (.csv, .mat) keep no arm: `fa.Data.load` reads their columns.

        Raises:
            ValueError: no such file, another kind of file, a damaged one.
        """
        file = path_of("result", path)
        if file.suffix.lower() in (*CSV, *MAT):
            raise ValueError(f"result {str(path)!r}: a table keeps no arm: fa.Data.load reads its columns")
        with readable("result", file, "a file that Result.save wrote"):
            about, arrays = read_arrays(file.read_bytes())
            arm = Arm.from_dict(about["arm"])
            count = about.get("events")
            if any(x.dtype != float for x in arrays.values()):
                raise ValueError("an array has no numbers")
            found: dict[str, Any] = {name: arrays.pop(name) for name in ("t", "q", "v", "a", "tau")}
            for name, shape in outputs.row_shapes(arm).items():
                x = found[name] if name in found else arrays.pop(name, None)
                if x is not None and x.shape != (*found["t"].shape, prod(shape)):
                    raise ValueError(f"{name} has shape {x.shape}")
                found[name] = x if x is None else x.reshape(len(found["t"]), *shape)
            if count is not None:
                found |= {f"{n}_events": [arrays.pop(f"{n}_events_{k}") for k in range(count)] for n in "tqv"}
            loads, status = None if about["loads"] else (), int(about.get("status", 0))
            result = Result(arm, **found, stats=dict(about["stats"]), loads=loads, status=status)
            if not set(arrays) <= {"deflection", "end", "strut", "contact", "loop"} or (np.diff(result.t) < 0).any():
                raise ValueError("other arrays, or times that do not increase")
            return result
