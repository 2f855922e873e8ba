"""Simulates flexible robot arms: serial chains of rigid bodies and elastic beams. SI units, radians.

An arm is a chain of links; a link is a joint, a rigid hub, an elastic beam and a rigid tip. `help(fa.Beam)` and so on,
with `import flexarm as fa`, tell arguments and units. Bad arguments raise ValueError with the field and the value.

Parts of an arm
    Arm, Link               the chain, and what is computed of it: dynamics, modes, ...; a link: joint, hub, beam, tip
    Joint                   what joints share: springs, stops, friction; their Placement. There are
                            Fixed Revolute Prismatic Cylindrical Universal Planar Spherical Free Axes
    RigidBody, Beam         the bodies; of a beam the Material and the section: Rectangle Circle Tube Ellipse Box IBeam
                            GeneralSection Taper, or
    SectionMatrix           any section, 6 x 6; laminate makes one of a list of Ply (Orthotropic), polygon of an outline
    Patch, Piezo            a piezo patch on a beam, and its material; split: a link in pieces that end where it does
    from_urdf, from_mjcf    an arm of a robot's file, whose links are rigid, or Flexible; Look: what is drawn of a link
What acts on it
    Motion, Torque, Voltage, Load       over time: on joints, patches, slices
    PD, StrainFeedback, StateFeedback   controllers that act continuously
    LinearController, Sampled           A B C D of your own; any function of the state, at a rate
    FeedForward, ComputedTorque, MPC    forces that a motion takes; that make the arm follow it; from a plan ahead
    lqr, lqg, ppf, irc                  regulators about a pose; dampers of modes
    Controller, Motor                   what controllers share; a motor between one and its joint
    input_shaper, Shaper                a command that leaves no vibration
    plan_move, Move, LimitUse           a fast move, within limits, that leaves the arm at rest
    invert, Inversion                   torques and motions of the joints that carry the tip along a path
Analysis
    LinearModel, Derivatives, Trim      what arm.linearize, arm.forward_derivatives and arm.trim give
    Modes, ModeShapes, View             what arm.modes, arm.mode_shapes give; arm.show: a picture, film, page in 3-D
    closed_loop, ClosedLoop             poles, margins, root loci of an arm with its controllers
    fit_decay, Decay                    frequencies and damping of a measured decay
    placement, PatchPlacement           where to bond a patch
    chart, Chart                        error against time of models and integrators
    economize, Plan                     the cheapest model within a tolerance
One run
    load, Scene                         a TOML file, or a shipped one: an arm, what drives it, for how long
    simulate, Result                    an arm over time; its trajectory
    check, Finding, Watch               what could be better, of an arm or a scene; result.check(): of a run, its limits
    Ida Implicit Gauss RK4, Simulation  integrators, with their options; an arm step by step, its states restored
    Sensitivities                       what result.sensitivities gives: exact derivatives; see result.gradient, too
    SimulationError                     the run could not go on; as SimulationInterrupted (Ctrl-C) it holds the result
Sensors
    Encoder Tachometer ForceTorque StrainGauge Accelerometer Camera
    Sensor, Sampler, Reading            what they share; one in a control loop; what one reads of a run
    LowPass, psd, PowerSpectrum         the filter of a sensor, first or second order; power spectral density
    KalmanFilter, Estimate              states, payload and friction from what sensors read, online; over a record
Data
    load_data, Data         columns over time with units, from CSV, HDF5, .mat, .npz, pandas or a result
    Comparison              what result.compare(data) gives: a run beside what was measured
    identify, Fit, Unknown  unknown numbers of a scene from measured runs, with intervals; FitError, FitInterrupted
    validate, Validation    the shipped model of a measured arm against recordings of it
Many runs
    simulate_batch, BatchResult         runs that differ in start, forces, parameters; its bytes: batch_memory
    rollout, Rollout, rollout_gradient  arrays to arrays; derivatives: Gradient, step_derivatives, StepDerivatives
    sweep, SweepResult                  a scene over parameters: Sweep, Vary, load_sweep
    Failure                             a run that could not go on; Ctrl-C: BatchInterrupted, SweepInterrupted
Warnings
    ModelWarning, StateWarning          a part beyond its theory, or an angle in degrees; a state that does not last
    RangeWarning, LoopWarning           a run beyond the range of its model; a control loop that grows
    StepWarning, SlowWarning            steps that miss a part of the motion; so many that the run will hardly end
    DataWarning FitWarning FilterWarning    gaps in time, constant signals; what data cannot tell; a surprised filter
    MoveWarning InversionWarning MPCWarning RobotWarning    limits that are passed; no answer in time; what is left out

Elsewhere: flexarm.env, .tasks (Gymnasium), .torch, .jax, .cli; `flexarm examples`; https://flexarm.readthedocs.io
"""

# ruff: noqa: I001  (X as X: so do type checkers know what is for others)
from . import _starting as _starting  # first, for Ctrl-C

import typing as _typing
from types import ModuleType as _ModuleType

from ._core import __version__ as __version__
from .model.acting.computed import ComputedTorque as ComputedTorque, FeedForward as FeedForward
from .model.acting.control import (
    PD as PD,
    Controller as Controller,
    StateFeedback as StateFeedback,
    StrainFeedback as StrainFeedback,
)
from .model.acting.drive import Motion as Motion, Torque as Torque
from .model.acting.load import Load as Load
from .model.acting.motor import Motor as Motor
from .model.acting import compensators as _compensators  # noqa: F401  (LinearController.pid, .ppf and .irc)
from .model.acting.mpc import MPC as MPC, MPCWarning as MPCWarning
from .model.acting.sampled import LinearController as LinearController, Sampled as Sampled
from .model.acting.shaping import Shaper as Shaper, input_shaper as input_shaper
from .model.acting.drive import Voltage as Voltage
from .analysis.equilibrium import StateWarning as StateWarning, Trim as Trim
from .loop.design import lqg as lqg, lqr as lqr
from .analysis.linear import Derivatives as Derivatives, LinearModel as LinearModel
from .analysis.findings import (
    Finding as Finding,
    LoopWarning as LoopWarning,
    RangeWarning as RangeWarning,
    SlowWarning as SlowWarning,
    StepWarning as StepWarning,
)
from .analysis.damping import Decay as Decay, fit_decay as fit_decay
from .analysis.modes import Modes as Modes, ModeShapes as ModeShapes
from .loop.resonant_design import irc as irc, ppf as ppf
from .analysis.placement import PatchPlacement as PatchPlacement, placement as placement
from .arm.arm import Arm as Arm
from .many.batch.result import BatchResult as BatchResult
from .many.batch.gradient import (
    Gradient as Gradient,
    StepDerivatives as StepDerivatives,
    rollout_gradient as rollout_gradient,
    step_derivatives as step_derivatives,
)
from .many.batch.rollout import (
    BatchInterrupted as BatchInterrupted,
    Failure as Failure,
    Rollout as Rollout,
    rollout as rollout,
)
from .many.batch.simulate import batch_memory as batch_memory, simulate_batch as simulate_batch
from .choose.chart import Chart as Chart, chart as chart
from .choose.economize import Plan as Plan, economize as economize
from .command.moves.move import LimitUse as LimitUse, Move as Move
from .command.moves.plan import MoveWarning as MoveWarning, plan_move as plan_move
from .command.inversion.inversion import Inversion as Inversion
from .command.inversion.invert import InversionWarning as InversionWarning, invert as invert
from .data.compare import Comparison as Comparison
from .data.data import Data as Data
from .data.load import load_data as load_data
from .data.signal import DataWarning as DataWarning
from .estimate.estimate import Estimate as Estimate
from .estimate.kalman import FilterWarning as FilterWarning, KalmanFilter as KalmanFilter
from .identify.fit import (
    Fit as Fit,
    FitError as FitError,
    FitInterrupted as FitInterrupted,
    FitWarning as FitWarning,
)
from .identify.identify import identify as identify
from .identify.unknown import Unknown as Unknown
from .loop.closed_loop import ClosedLoop as ClosedLoop, closed_loop as closed_loop
from .model.parts.beam import Beam as Beam, RigidBody as RigidBody
from .model.parts.joints import (
    Axes as Axes,
    Cylindrical as Cylindrical,
    Fixed as Fixed,
    Free as Free,
    Joint as Joint,
    Placement as Placement,
    Planar as Planar,
    Prismatic as Prismatic,
    Revolute as Revolute,
    Spherical as Spherical,
    Universal as Universal,
)
from .model.parts.link import Link as Link
from .model.parts.look import Look as Look
from .model.parts.material import Material as Material
from .model.parts.laminate import Orthotropic as Orthotropic, Ply as Ply, laminate as laminate
from .model.parts.part import ModelWarning as ModelWarning
from .model.parts.patch import Patch as Patch, Piezo as Piezo
from .model.parts.polygon import polygon as polygon
from .model.parts.sections import (
    Box as Box,
    Circle as Circle,
    Ellipse as Ellipse,
    GeneralSection as GeneralSection,
    IBeam as IBeam,
    Rectangle as Rectangle,
    SectionMatrix as SectionMatrix,
    Tube as Tube,
)
from .model.parts.split import split as split
from .model.parts.taper import Taper as Taper
from .robots.chain import Flexible as Flexible
from .robots.tree import RobotWarning as RobotWarning
from .run.integrators import RK4 as RK4, Gauss as Gauss, Ida as Ida, Implicit as Implicit
from .run.result import Result as Result
from .run.sensitivity import Sensitivities as Sensitivities
from .run.simulation import (
    SimulationError as SimulationError,
    SimulationInterrupted as SimulationInterrupted,
    simulate as simulate,
)
from .run.stepping import Simulation as Simulation
from .run.watch import Watch as Watch
from .run.scene.check import check as check
from .run.scene.robot import from_mjcf as from_mjcf, from_urdf as from_urdf
from .run.scene.scene import Scene as Scene, load as load
from .run.sensing.lowpass import LowPass as LowPass
from .run.sensing.reading import PowerSpectrum as PowerSpectrum, Reading as Reading, psd as psd
from .run.sensing.sensor import Sampler as Sampler, Sensor as Sensor
from .run.sensing.sensors import (
    Accelerometer as Accelerometer,
    Camera as Camera,
    Encoder as Encoder,
    ForceTorque as ForceTorque,
    StrainGauge as StrainGauge,
    Tachometer as Tachometer,
)
from .many.sweeps.result import SweepInterrupted as SweepInterrupted, SweepResult as SweepResult
from .many.sweeps.sweep import sweep as sweep
from .many.sweeps.vary import Sweep as Sweep, Vary as Vary, load_sweep as load_sweep
from .identify.validate.validate import validate as validate
from .identify.validate.validation import Validation as Validation
from .view.view import View as View


_RENAMED = {"PulseWarning": "StepWarning", "WatchWarning": "RangeWarning"}


if not _typing.TYPE_CHECKING:  # to which any name would be right

    def __getattr__(name: str) -> object:
        more = f"; it is {_RENAMED[name]} now" if name in _RENAMED else ""
        raise AttributeError(f"module 'flexarm' has no attribute '{name}'{more}")


def __dir__() -> list[str]:
    """The public names, without the rooms of the package."""
    public = [k for k, x in globals().items() if not k.startswith("_") and not isinstance(x, _ModuleType)]
    return sorted([*public, "__version__"])
