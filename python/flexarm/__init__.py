"""flexarm: simulation of flexible robot arms.

An arm is a serial chain of links; a link is a joint, a rigid hub, an elastic beam and a rigid tip. SI units, radians.
"""

from ._core import __version__
from .arm import Arm
from .balance import StateWarning
from .batch import batch_memory, simulate_batch
from .batch_result import BatchResult
from .chart import Chart, chart
from .control import PD, Controller, StateFeedback, StrainFeedback
from .doubts import ModelWarning
from .drive import Motion, Torque
from .economize import Plan, economize
from .joints import (
    Axes,
    Cylindrical,
    Fixed,
    Free,
    Joint,
    Placement,
    Planar,
    Prismatic,
    Revolute,
    Spherical,
    Universal,
)
from .linear import Derivatives, LinearModel
from .link import Link
from .load import Load
from .loops import LoopWarning
from .modal import Modes, ModeShapes
from .model import Beam, Circle, GeneralSection, Material, Rectangle, RigidBody, Taper
from .motor import Motor
from .pace import SlowWarning, StepWarning
from .patch import Patch, Piezo, Voltage
from .placement import PatchPlacement, placement
from .plan import Sweep, Vary, load_sweep
from .pulses import PulseWarning
from .reading import PowerSpectrum, Reading, psd
from .result import Result
from .rollout import BatchInterrupted, Failure, Rollout, rollout
from .sampled import LinearController, Sampled
from .scene import Scene, load
from .sensor import Sampler, Sensor
from .sensors import Accelerometer, Camera, Encoder, ForceTorque, StrainGauge, Tachometer
from .shaping import Shaper, input_shaper
from .simulation import SimulationError, SimulationInterrupted, simulate
from .split import split
from .sweep import SweepInterrupted, SweepResult, sweep
from .validity import RangeWarning
from .watch import Watch, WatchWarning

__all__ = [
    "PD",
    "Accelerometer",
    "Arm",
    "Axes",
    "BatchInterrupted",
    "BatchResult",
    "Beam",
    "Camera",
    "Chart",
    "Circle",
    "Controller",
    "Cylindrical",
    "Derivatives",
    "Encoder",
    "Failure",
    "Fixed",
    "ForceTorque",
    "Free",
    "GeneralSection",
    "Joint",
    "LinearController",
    "LinearModel",
    "Link",
    "Load",
    "LoopWarning",
    "Material",
    "ModeShapes",
    "ModelWarning",
    "Modes",
    "Motion",
    "Motor",
    "Patch",
    "PatchPlacement",
    "Piezo",
    "Placement",
    "Plan",
    "Planar",
    "PowerSpectrum",
    "Prismatic",
    "PulseWarning",
    "RangeWarning",
    "Reading",
    "Rectangle",
    "Result",
    "Revolute",
    "RigidBody",
    "Rollout",
    "Sampled",
    "Sampler",
    "Scene",
    "Sensor",
    "Shaper",
    "SimulationError",
    "SimulationInterrupted",
    "SlowWarning",
    "Spherical",
    "StateFeedback",
    "StateWarning",
    "StepWarning",
    "StrainFeedback",
    "StrainGauge",
    "Sweep",
    "SweepInterrupted",
    "SweepResult",
    "Tachometer",
    "Taper",
    "Torque",
    "Universal",
    "Vary",
    "Voltage",
    "Watch",
    "WatchWarning",
    "__version__",
    "batch_memory",
    "chart",
    "economize",
    "input_shaper",
    "load",
    "load_sweep",
    "placement",
    "psd",
    "rollout",
    "simulate",
    "simulate_batch",
    "split",
    "sweep",
]
