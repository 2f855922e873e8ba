"""flexarm: simulation of flexible robot arms.

An arm is a serial chain of links; a link is a joint, a rigid hub, an elastic beam and a rigid tip. SI units, radians.
"""

from ._core import __version__
from .acting.control import PD, Controller, StateFeedback, StrainFeedback
from .acting.drive import Motion, Torque
from .acting.load import Load
from .acting.motor import Motor
from .acting.sampled import LinearController, Sampled
from .acting.shaping import Shaper, input_shaper
from .acting.voltage import Voltage
from .analysis.doubts import ModelWarning
from .analysis.equilibrium import StateWarning
from .analysis.linear import Derivatives, LinearModel
from .analysis.loops import LoopWarning
from .analysis.modes import Modes, ModeShapes
from .analysis.placement import PatchPlacement, placement
from .analysis.validity import RangeWarning
from .arm import Arm
from .batch.result import BatchResult
from .batch.rollout import BatchInterrupted, Failure, Rollout, rollout
from .batch.simulate import batch_memory, simulate_batch
from .choose.chart import Chart, chart
from .choose.economize import Plan, economize
from .parts.beam import Beam, Circle, GeneralSection, Material, Rectangle, RigidBody, Taper
from .parts.joints import (
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
from .parts.link import Link
from .parts.patch import Patch, Piezo
from .parts.split import split
from .run.pace import SlowWarning, StepWarning
from .run.pulses import PulseWarning
from .run.result import Result
from .run.simulation import SimulationError, SimulationInterrupted, simulate
from .run.watch import Watch, WatchWarning
from .scene.scene import Scene, load
from .sensing.reading import PowerSpectrum, Reading, psd
from .sensing.sensor import Sampler, Sensor
from .sensing.sensors import Accelerometer, Camera, Encoder, ForceTorque, StrainGauge, Tachometer
from .sweeps.result import SweepInterrupted, SweepResult
from .sweeps.sweep import sweep
from .sweeps.vary import Sweep, Vary, load_sweep

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
