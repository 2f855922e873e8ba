"""flexarm: simulation of flexible robot arms.

An arm is a serial chain of links; a link is a joint, a rigid hub, an elastic beam and a rigid tip. SI units, radians.
"""

from ._core import __version__
from .arm import Arm
from .drive import Motion, Torque
from .modal import Modes
from .model import (
    Beam,
    Circle,
    Fixed,
    GeneralSection,
    Link,
    Material,
    Prismatic,
    Rectangle,
    Revolute,
    RigidBody,
)
from .result import Result
from .scene import Scene, load
from .simulation import SimulationError, simulate

__all__ = [
    "Arm",
    "Beam",
    "Circle",
    "Fixed",
    "GeneralSection",
    "Link",
    "Material",
    "Modes",
    "Motion",
    "Prismatic",
    "Rectangle",
    "Result",
    "Revolute",
    "RigidBody",
    "Scene",
    "SimulationError",
    "Torque",
    "__version__",
    "load",
    "simulate",
]
