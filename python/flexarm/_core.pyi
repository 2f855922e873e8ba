from collections.abc import Callable, Mapping, Sequence
from typing import Any, overload

from numpy import float64
from numpy.typing import ArrayLike, NDArray

_Array = NDArray[float64]

__version__: str
STRAINS: tuple[str, ...]  # names of the strain fields, in the order of a beam's coordinates
STRAIN_NAMES: tuple[str, ...]  # of the rows of a section's strains
STRAIN_FIELDS: tuple[StrainField, ...]  # in the order of STRAINS
ONE_STEP: dict[str, dict[str, bool]]  # methods that batches have, too, by name: rubs, iterates, damps, limited

class StrainField:
    def __init__(self, *args: Any, **kwargs: Any) -> None: ...  # made by the core alone
    @property
    def name(self) -> str: ...
    @property
    def row(self) -> int: ...
    @property
    def bending(self) -> bool: ...
    @property
    def position(self) -> int: ...
    @property
    def rotation(self) -> int: ...
    @property
    def sign(self) -> float: ...

class Material:
    def __init__(
        self, density: float, youngs_modulus: float, poisson_ratio: float | None, shear_modulus: float | None
    ) -> None: ...
    @property
    def shear_modulus(self) -> float: ...

class Face:
    def __init__(self, *args: Any, **kwargs: Any) -> None: ...  # made by the core alone
    @property
    def distance(self) -> float: ...
    @property
    def breadth(self) -> float: ...
    @property
    def twist(self) -> float | None: ...

class Section:
    def __init__(
        self,
        area: float,
        second_moment_y: float,
        second_moment_z: float,
        torsion_constant: float,
        shear_correction: Sequence[float],
    ) -> None: ...
    @staticmethod
    def rectangle(y: float, z: float, shear_correction: Sequence[float]) -> Section: ...
    @staticmethod
    def circle(radius: float, inner_radius: float, shear_correction: Sequence[float]) -> Section: ...
    @staticmethod
    def tube(radius: float, thickness: float, shear_correction: Sequence[float] | None) -> Section: ...
    @staticmethod
    def ellipse(y: float, z: float, shear_correction: Sequence[float] | None) -> Section: ...
    @staticmethod
    def box(y: float, z: float, thickness: Sequence[float], shear_correction: Sequence[float] | None) -> Section: ...
    @staticmethod
    def i_beam(y: float, z: float, flange: float, web: float, shear_correction: Sequence[float] | None) -> Section: ...
    @property
    def area(self) -> float: ...
    @property
    def second_moment_y(self) -> float: ...
    @property
    def second_moment_z(self) -> float: ...
    @property
    def torsion_constant(self) -> float: ...
    @property
    def shear_correction(self) -> tuple[float, float]: ...
    @property
    def reach(self) -> tuple[float | None, float | None]: ...
    @property
    def faces(self) -> tuple[Face | None, Face | None]: ...

class SectionMatrix:
    def __init__(self, stiffness: ArrayLike, inertia: ArrayLike) -> None: ...
    @property
    def com(self) -> _Array: ...
    @property
    def inertia_about_com(self) -> _Array: ...

class SectionProfile:
    def __init__(self, at: Callable[[float], Section], breaks: Sequence[float]) -> None: ...

class SectionMatrixProfile:
    def __init__(self, at: Callable[[float], SectionMatrix], breaks: Sequence[float]) -> None: ...

class BeamOptions:
    def __init__(
        self,
        modes: Sequence[int],
        basis: str,
        shapes: Sequence[ArrayLike],
        order: int,
        rotary_inertia: bool,
        damping_ratio: float,
        kelvin_voigt: Sequence[float],
        damping: ArrayLike,
        gauss_points: int,
        tip_mass: float,
        tip_offset: float,
        tip_inertia: ArrayLike,
        curvature: ArrayLike,
    ) -> None: ...

class Piezo:
    def __init__(
        self,
        youngs_modulus: float,
        poisson_ratio: float,
        density: float,
        d31: float,
        d32: float,
        d15: float,
        permittivity: float,
    ) -> None: ...

class PatchSection:
    def __init__(
        self,
        material: Piezo,
        across: int,
        plus: bool,
        minus: bool,
        opposed: bool,
        angle: float,
        width: float,
        thickness: float,
        inner: float,
        electrode: float,
        twist: float,
    ) -> None: ...
    @property
    def rigidity(self) -> _Array: ...
    @property
    def force(self) -> _Array: ...
    @property
    def capacitance(self) -> float: ...
    @property
    def mass(self) -> float: ...
    @property
    def inertia(self) -> _Array: ...

def surface_twist(depth: float, breadth: float, width: float) -> float: ...

class Patch:
    def __init__(
        self,
        start: float,
        end: float,
        at: Callable[[float], PatchSection],
        breaks: Sequence[float],
        stiffness: bool,
        mass: bool,
    ) -> None: ...

class Beam:
    @overload
    def __init__(
        self,
        length: float,
        section: Section | SectionProfile,
        material: Material,
        options: BeamOptions,
        patches: Sequence[Patch],
    ) -> None: ...
    @overload
    def __init__(
        self,
        length: float,
        section: SectionMatrix | SectionMatrixProfile,
        options: BeamOptions,
        patches: Sequence[Patch],
    ) -> None: ...
    @property
    def patch_forces(self) -> _Array: ...
    @property
    def patch_capacitances(self) -> _Array: ...
    def patch_force(self, patch: Patch) -> tuple[_Array, float]: ...
    @property
    def mass(self) -> float: ...
    @property
    def gauss_points(self) -> int: ...
    @property
    def stiffness(self) -> _Array: ...
    def turns(self, x: ArrayLike) -> _Array: ...
    def truncation(self, q: ArrayLike) -> _Array: ...
    @property
    def damping(self) -> _Array: ...
    def strains(self, x: float) -> _Array: ...

class RigidBody:
    def __init__(self, mass: float, com: ArrayLike, inertia: ArrayLike, end: ArrayLike) -> None: ...

class JointForce:
    def __init__(
        self,
        stiffness: float,
        rest: float,
        damping: float,
        lower: float,
        upper: float,
        limit_stiffness: float,
        limit_damping: float,
        coulomb: float,
        stiction: float,
        reflected_inertia: float,
        torque_limit: float,
    ) -> None: ...

class Joint:
    def __init__(
        self,
        motions: Sequence[tuple[bool, ArrayLike]],
        ball: bool,
        labels: Sequence[str],
        forces: Sequence[JointForce],
        inboard: tuple[ArrayLike, ArrayLike],
        outboard: tuple[ArrayLike, ArrayLike],
    ) -> None: ...

class Link:
    def __init__(self, joint: Joint, hub: RigidBody | None, beam: Beam | None, tip: RigidBody | None) -> None: ...
    @property
    def mass(self) -> float: ...

class ArmAlone:
    def __init__(self, *args: Any, **kwargs: Any) -> None: ...  # raises TypeError; the base of what follows

class Arm(ArmAlone):
    def __init__(
        self,
        links: Sequence[Link],
        gravity: ArrayLike,
        seats: Sequence[tuple[int, float | None]],
        struts: Sequence[Strut] = ...,
        contacts: Sequence[Contact] = ...,
        loops: Sequence[Loop] = ...,
    ) -> None: ...
    @property
    def nq(self) -> int: ...
    @property
    def nv(self) -> int: ...
    @property
    def coordinates(self) -> list[str]: ...
    @property
    def zero(self) -> _Array: ...
    def patch_matrix(self) -> _Array: ...
    def operation_count(self, q: _Array, v: _Array) -> int: ...
    def first(self, link: int) -> int: ...
    def first_q(self, link: int) -> int: ...
    def coordinate_of(self, rate: int) -> int: ...
    def farthest_out(self, q: ArrayLike, v: ArrayLike) -> str: ...
    def rates(self, q: ArrayLike, v: ArrayLike) -> tuple[_Array, _Array, _Array]: ...
    def one_state(self, named: dict[str, Any], balls: bool) -> bool: ...
    def forward_dynamics(
        self,
        q: ArrayLike,
        v: ArrayLike,
        tau: ArrayLike,
        method: str = ...,
        prescribed: Mapping[int, float] = ...,
        loads: Sequence[Load] = ...,
        wrenches: ArrayLike = ...,
    ) -> _Array: ...
    def inverse_dynamics(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        loads: Sequence[Load] = ...,
        wrenches: ArrayLike = ...,
    ) -> _Array: ...
    def joint_reaction(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        link: int,
        inboard: bool,
        loads: Sequence[Load] = ...,
        wrenches: ArrayLike = ...,
    ) -> _Array: ...
    def inverse_derivatives(
        self,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        loads: Sequence[Load] = ...,
        wrenches: ArrayLike = ...,
        by_v: bool = ...,
        reactions: ArrayLike = ...,
    ) -> tuple[_Array, _Array]: ...
    def forward_derivatives(
        self,
        q: ArrayLike,
        v: ArrayLike,
        tau: ArrayLike,
        loads: Sequence[Load] = ...,
        wrenches: ArrayLike = ...,
    ) -> tuple[_Array, _Array, _Array]: ...
    def mass_matrix(self, q: ArrayLike) -> _Array: ...
    def energy(self, q: ArrayLike, v: ArrayLike) -> _Array: ...
    def frame(self, q: ArrayLike, link: int, x: float | None) -> tuple[_Array, _Array]: ...
    def jacobian(self, q: ArrayLike, link: int, x: float | None) -> _Array: ...
    def slice_motion(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, link: int, x: float | None
    ) -> tuple[_Array, _Array]: ...
    def motion_derivatives(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, link: int, x: float | None
    ) -> tuple[_Array, _Array]: ...
    def jacobian_rate(self, q: ArrayLike, v: ArrayLike, link: int, x: float | None) -> _Array: ...
    def momentum(self, q: ArrayLike, v: ArrayLike) -> tuple[_Array, _Array]: ...
    def deflection(self, q: ArrayLike, link: int, x: float) -> _Array: ...
    def strain(self, q: ArrayLike, link: int, x: float) -> _Array: ...
    def strut_motion(self, q: ArrayLike, v: ArrayLike, driven: ArrayLike) -> tuple[_Array, _Array]: ...
    def contact_motion(self, q: ArrayLike, v: ArrayLike) -> _Array: ...
    @property
    def loop_rows(self) -> list[tuple[int, bool, bool]]: ...
    def loop_motion(self, q: ArrayLike, v: ArrayLike) -> _Array: ...

class Loop:
    def __init__(
        self,
        a: tuple[int, str, float, ArrayLike],
        b: tuple[int, str, float, ArrayLike],
        kind: str,
        axes_a: ArrayLike,
        axes_b: ArrayLike,
        stiffness: float,
        damping: float,
        angular_stiffness: float,
        angular_damping: float,
    ) -> None: ...

class Contact:
    def __init__(
        self,
        point: tuple[int, str, float, ArrayLike],
        radius: float,
        kind: str,
        at: tuple[int, str, float, ArrayLike],
        axes: ArrayLike,
        size: ArrayLike,
        stiffness: float,
        exponent: float,
        damping: float,
        coulomb: float,
        tangential_stiffness: float,
    ) -> None: ...

class Strut:
    def __init__(
        self,
        points: Sequence[tuple[int, str, float, ArrayLike]],
        stiffness: float,
        damping: float,
        length: float,
        force: float,
        tension_only: bool,
    ) -> None: ...

class StateForce:
    def __init__(self, law: Callable[[float, _Array, _Array, _Array], Sequence[float]]) -> None: ...

class Load:
    def __init__(self, *args: Any, **kwargs: Any) -> None: ...  # raises TypeError; made by what follows
    @staticmethod
    def at_end(arm: Arm, link: int, world_axes: bool) -> Load: ...
    @staticmethod
    def at_slice(arm: Arm, link: int, x: float, world_axes: bool) -> Load: ...
    @staticmethod
    def by_state(arm: Arm, link: int, x: float | None, world_axes: bool, law: StateForce) -> Load: ...
    @staticmethod
    def on_strut(arm: Arm, strut: int) -> Load: ...
    @staticmethod
    def along(arm: Arm, link: int, a: float, b: float, world_axes: bool) -> Load: ...

class PiecewisePolynomial:
    def __init__(self, breaks: ArrayLike, coefficients: ArrayLike) -> None: ...
    def __call__(self, t: float) -> tuple[float, float, float]: ...
    def standing(self) -> PiecewisePolynomial: ...
    @property
    def breaks(self) -> _Array: ...
    @property
    def coefficients(self) -> _Array: ...

class LinearLaw:
    def __init__(
        self,
        A: ArrayLike,
        B: ArrayLike,
        C: ArrayLike,
        D: ArrayLike,
        columns: ArrayLike,
        by_q: ArrayLike,
        by_v: ArrayLike,
        limit: ArrayLike,
        reference: Any,
        read: Callable[[float, _Array, _Array, _Array], _Array] | None,
        u0: ArrayLike,
        windup: ArrayLike,
        reach: ArrayLike,
        offset: ArrayLike,
        resolution: ArrayLike,
        start: ArrayLike,
        first: float,
    ) -> None: ...
    @property
    def columns(self) -> _Array: ...
    @property
    def reads(self) -> bool: ...

_StateSpace = tuple[_Array, _Array, _Array, _Array, _Array]  # A, B, C, D, windup

def pid(
    kp: float, ki: float, kd: float, filter_time: float | None, tracking_time: float | None, period: float | None
) -> _StateSpace: ...
def servo(
    kp: float,
    kv: float,
    ki: float,
    filter: float | None,
    damping_ratio: float | None,
    tracking_time: float | None,
    period: float,
) -> tuple[_Array, _Array, _Array, _Array, _Array, _Array]: ...  # and the start
def positive_position(frequency: float, damping_ratio: float, gain: float, period: float | None) -> _StateSpace: ...
def integral_resonant(gain: float, feedthrough: float) -> _StateSpace: ...
def sampled(
    A: ArrayLike, B: ArrayLike, C: ArrayLike, D: ArrayLike, windup: ArrayLike, period: float, hold: bool
) -> _StateSpace: ...

class ComputedTorque:
    def __init__(
        self,
        arm: Arm,
        axes: Sequence[tuple[int, Any, float, float, float]],
        sags: bool,
        moved: Sequence[tuple[int, int]],
        size: int,
    ) -> None: ...
    def __call__(self, t: float, q: ArrayLike, v: ArrayLike, a: Any = None) -> _Array: ...
    def feed_forward(self, t: ArrayLike, inertia: bool) -> _Array: ...
    def at_rest(self, t: ArrayLike) -> _Array: ...

class Drive:
    def __init__(self, rate: int, moves: bool, law: Any, column: ArrayLike = ...) -> None: ...
    @property
    def rate(self) -> int: ...
    @property
    def moves(self) -> bool: ...
    @property
    def law(self) -> Any: ...
    @property
    def column(self) -> _Array: ...

class LoadLaw:
    def __init__(self, place: Load, law: Any) -> None: ...
    @property
    def place(self) -> Load: ...
    @property
    def law(self) -> Any: ...

class Feedback:
    def __init__(self, column: ArrayLike, by_q: ArrayLike, by_v: ArrayLike, reference: Any, limit: float) -> None: ...
    @property
    def column(self) -> _Array: ...
    @property
    def by_q(self) -> _Array: ...
    @property
    def by_v(self) -> _Array: ...
    @property
    def reference(self) -> Any: ...
    @property
    def limit(self) -> float: ...

class Sampler:
    def __init__(self, first: float, period: float, delay: float, law: Any) -> None: ...
    @property
    def first(self) -> float: ...
    @property
    def period(self) -> float: ...
    @property
    def delay(self) -> float: ...
    @property
    def law(self) -> Any: ...

class Event:
    def __init__(self, value: Any, terminal: int, direction: int) -> None: ...
    @property
    def value(self) -> Any: ...
    @property
    def terminal(self) -> int: ...
    @property
    def direction(self) -> int: ...

class Remembered:
    def __init__(self, law: Callable[[float], Any]) -> None: ...
    def __call__(self, t: float) -> Any: ...
    @property
    def law(self) -> Callable[[float], Any]: ...

class Problem:
    def __init__(
        self,
        *,
        arm: Arm,
        t: ArrayLike,
        q0: ArrayLike,
        v0: ArrayLike,
        tau: ArrayLike,
        drives: Sequence[Drive],
        loads: Sequence[LoadLaw],
        feedback: Sequence[Feedback],
        samplers: Sequence[Sampler],
        events: Sequence[Event],
    ) -> None: ...
    @property
    def q0(self) -> _Array: ...
    @property
    def v0(self) -> _Array: ...
    @property
    def asked(self) -> list[_Array | None]: ...

class Neighbour:
    def __init__(self, weight: float, offset: float, problem: Problem) -> None: ...

class Parameter:
    def __init__(self, scale: float, forces_only: bool, start_only: bool, neighbours: Sequence[Neighbour]) -> None: ...

class Integrator:
    def __init__(
        self,
        name: str,
        *,
        step: float = ...,
        rtol: float = ...,
        spectral_radius: float = ...,
        stages: int = ...,
        atol: float = ...,
        max_order: int = ...,
        linear_solver: str = ...,
        tolerance: float | None = ...,
    ) -> None: ...

def simulate_ida(
    problem: Problem,
    t: ArrayLike,
    integrator: Integrator,
    *,
    slow: Callable[[float, int], None] | None,
    alive: Callable[[float], None] | None,
    parameters: Sequence[Parameter],
) -> dict[str, Any]: ...
def step_derivatives(
    arm: Arm,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    integrator: str,
    step: float,
    rtol: float,
    spectral_radius: float,
    loads: Sequence[Load],
    wrenches: ArrayLike,
) -> tuple[_Array, _Array, _Array, _Array, list[int]]: ...
def roll_on_tape(
    arm: Arm,
    integrator: str,
    step: float,
    rtol: float,
    spectral_radius: float,
    q0: ArrayLike,
    v0: ArrayLike,
    tau: ArrayLike,
) -> tuple[Any, _Array, _Array, list[int], int, int]: ...

class Mpc:
    def __init__(
        self,
        problem: Problem,
        outputs: Sequence[Any],
        columns: ArrayLike,
        of_inputs: Sequence[ArrayLike],
        period: float,
        horizon: float,
        stages: int,
        blocks: int,
        terminal: float,
        soft: float,
        delayed: bool,
        iterations: int,
        carried: int,
        reference: Any,
        to_q: ArrayLike,
        to_v: ArrayLike,
        forces: ArrayLike,
        failed: Callable[[float, int], None],
    ) -> None: ...
    def feedback(self, t: float, q: ArrayLike, v: ArrayLike) -> int: ...
    def prepare(self) -> int: ...
    def reset(self) -> None: ...
    @property
    def u(self) -> _Array: ...
    @property
    def forces(self) -> _Array: ...
    @property
    def plan(self) -> _Array: ...
    @property
    def block_times(self) -> _Array: ...
    @property
    def predicted(self) -> _Array: ...
    @property
    def stage_times(self) -> _Array: ...
    @property
    def qp_iterations(self) -> int: ...

class KalmanFilter:
    def __init__(
        self,
        problem: Problem,
        step: float,
        sensors: Sequence[Any],
        parameters: Sequence[tuple[int, int, float, float, float]],
        force_noise: ArrayLike,
        friction_speed: float,
    ) -> None: ...
    def start(self, q: ArrayLike, v: ArrayLike, q_deviation: ArrayLike, v_deviation: ArrayLike, t: float) -> None: ...
    def predict(self, tau: ArrayLike) -> int: ...
    def update(self, y: ArrayLike) -> int: ...
    def run(
        self, tau: ArrayLike, y: ArrayLike, links: int, progress: Callable[[float], None] | None
    ) -> dict[str, Any]: ...
    def place(self, link: int, x: float | None) -> tuple[_Array, _Array]: ...
    def transition(self) -> _Array: ...
    def state(self) -> _Array: ...
    def resume(self, state: ArrayLike) -> None: ...
    @property
    def t(self) -> float: ...
    @property
    def q(self) -> _Array: ...
    @property
    def v(self) -> _Array: ...
    @property
    def p(self) -> _Array: ...
    @property
    def root(self) -> _Array: ...
    @property
    def deviations(self) -> _Array: ...
    @property
    def innovations(self) -> _Array: ...
    @property
    def innovation_std(self) -> _Array: ...
    @property
    def nis(self) -> float: ...
    @property
    def used(self) -> int: ...

def scene_text(problem: Problem, t: ArrayLike, integrator: Integrator) -> str: ...
def simulate_fixed(
    problem: Problem,
    t: ArrayLike,
    integrator: Integrator,
    *,
    alive: Callable[[float], None] | None,
    tape: Tape | None = None,
) -> dict[str, Any]: ...

class State:
    def __init__(self, *args: Any, **kwargs: Any) -> None: ...
    @property
    def t(self) -> float: ...

class Simulation:
    def __init__(self, problem: Problem, integrator: Integrator, t: float) -> None: ...
    def step(self) -> bool: ...
    def advance(self, until: float) -> bool: ...
    @property
    def t(self) -> float: ...
    @property
    def q(self) -> _Array: ...
    @property
    def v(self) -> _Array: ...
    @property
    def a(self) -> _Array: ...
    @property
    def tau(self) -> _Array: ...
    @property
    def friction(self) -> _Array: ...
    @property
    def failure(self) -> str: ...
    @property
    def steps(self) -> int: ...
    @property
    def failed_steps(self) -> int: ...
    @property
    def terminated(self) -> bool: ...
    @property
    def events(self) -> tuple[list[_Array], list[_Array], list[_Array]]: ...
    def set_tau(self, tau: ArrayLike) -> None: ...
    def set_force(self, drive: int, value: float) -> None: ...
    def set_load(self, load: int, wrench: ArrayLike) -> None: ...
    def set_reference(self, feedback: int, value: float) -> None: ...
    def state(self) -> State: ...
    def restore(self, state: State) -> None: ...

class Tape:
    def __init__(self) -> None: ...
    @property
    def t(self) -> _Array: ...
    @property
    def q(self) -> _Array: ...
    @property
    def v(self) -> _Array: ...
    @property
    def a(self) -> _Array: ...
    @property
    def occurrences(self) -> list[tuple[int, float, int, int]]: ...
    @property
    def points(self) -> list[int]: ...
    @property
    def switches(self) -> _Array: ...
    @property
    def sides(self) -> _Array: ...
    def complete(self, problem: Problem) -> None: ...
    def repeat_switches(
        self, problem: Problem, rtol: float, spectral_radius: float
    ) -> tuple[_Array, list[list[float]]]: ...
    def weigh(
        self, problem: Problem, parameters: Sequence[Parameter], needed: ArrayLike, applied: ArrayLike, threads: int
    ) -> _Array: ...
    def repeat_looks(self, problem: Problem, run: Problem) -> _Array: ...
    def tangents(
        self,
        problem: Problem,
        rtol: float,
        spectral_radius: float,
        switches: Sequence[_Array],
        parameters: Sequence[Parameter],
        accelerations: bool,
        threads: int,
    ) -> dict[str, _Array]: ...
    def adjoint(
        self,
        problem: Problem,
        rtol: float,
        spectral_radius: float,
        q: ArrayLike,
        v: ArrayLike,
        a: ArrayLike,
        tau: ArrayLike,
        threads: int,
        rough: bool = ...,
    ) -> tuple[_Array, _Array, _Array, _Array, _Array, _Array, _Array]: ...

def in_kernels(method: str, arm: Arm) -> bool: ...

class BatchProblem:
    def __init__(
        self,
        problems: Sequence[Problem],
        arms: Sequence[Arm],
        *,
        scenarios: int,
        t: ArrayLike,
        every: int,
        q0: _Array | None,
        v0: _Array | None,
        tau: _Array | None,
        nq: int,
        nv: int,
        integrator: Integrator,
        slow: Callable[[int, float, int], None] | None,
        lanes: bool,
        whole: int,
    ) -> None: ...
    def run(
        self, out: dict[str, Any], workers: int, alive: Callable[[float], None] | None
    ) -> dict[str, Any]: ...
