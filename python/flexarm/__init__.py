"""flexarm: simulation of flexible robot arms.

An arm is a serial chain of links; a link is a joint, a rigid hub, an elastic beam and a rigid tip. SI units, radians.
"""

from ._core import __version__
from .arm import Arm
from .chart import Chart, chart
from .drive import Motion, Torque
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
from .modal import Modes, ModeShapes
from .model import Beam, Circle, GeneralSection, Material, Rectangle, RigidBody, Taper
from .patch import Patch, Piezo, Voltage
from .placement import PatchPlacement, placement
from .result import Result
from .scene import Scene, load
from .simulation import SimulationError, SimulationInterrupted, simulate
from .split import split
from .validity import RangeWarning

__all__ = [
    "Arm",
    "Axes",
    "Beam",
    "Chart",
    "Circle",
    "Cylindrical",
    "Derivatives",
    "Fixed",
    "Free",
    "GeneralSection",
    "Joint",
    "LinearModel",
    "Link",
    "Load",
    "Material",
    "ModeShapes",
    "Modes",
    "Motion",
    "Patch",
    "PatchPlacement",
    "Piezo",
    "Placement",
    "Planar",
    "Prismatic",
    "RangeWarning",
    "Rectangle",
    "Result",
    "Revolute",
    "RigidBody",
    "Scene",
    "SimulationError",
    "SimulationInterrupted",
    "Spherical",
    "Taper",
    "Torque",
    "Universal",
    "Voltage",
    "__version__",
    "chart",
    "load",
    "placement",
    "simulate",
    "split",
]
