"""Simulates flexible robot arms: chains, trees and loops of rigid bodies and elastic beams. SI units, radians.

An arm is a chain or a tree of links; a link is a joint, a rigid hub, an elastic beam and a rigid tip. `help(fa.Beam)`
and so on, with `import flexarm as fa`, tell arguments and units. Bad arguments raise ValueError with the field and
the value.

More names are in fa.sections, fa.sensors, fa.results (classes of results) and fa.errors (warnings, exceptions); and in
flexarm.env, .tasks (Gymnasium), .torch, .jax, .cli. `flexarm examples`; https://flexarm.readthedocs.io
"""

# The list of the public names, with those in sections, sensors, results and errors; its order is that of the map.
# `X as X` tells type checkers that it is for others.
from . import _starting as _starting  # first, for Ctrl-C

import sys as _sys
import typing as _typing

from . import _face, errors as errors, results as results, sections as sections, sensors as sensors
from ._core import __version__ as __version__
from .model.acting import compensators as _compensators  # noqa: F401  (LinearController.pid, .ppf and .irc)
from .arm.arm import Arm as Arm
from .model.parts.link import Link as Link
from .model.parts.joints import Joint as Joint, Fixed as Fixed, Revolute as Revolute, Prismatic as Prismatic
from .model.parts.joints import Cylindrical as Cylindrical, Universal as Universal, Planar as Planar
from .model.parts.joints import Spherical as Spherical, Free as Free, Axes as Axes, Placement as Placement
from .model.parts.beam import RigidBody as RigidBody, Beam as Beam
from .model.parts.material import Material as Material
from .model.parts.sections import Rectangle as Rectangle, Circle as Circle, Tube as Tube, SectionMatrix as SectionMatrix
from .model.parts.patch import Patch as Patch, Piezo as Piezo
from .model.parts.split import split as split
from .model.parts.look import Look as Look
from .model.parts.strut import Point as Point, Strut as Strut, Tendon as Tendon
from .model.parts.contact import Contact as Contact, Plane as Plane, Sphere as Sphere, Box as Box
from .model.parts.loop import Loop as Loop
from .robots.chain import Flexible as Flexible
from .model.acting.drive import Motion as Motion, Torque as Torque
from .model.acting.drive import Voltage as Voltage
from .model.acting.load import Load as Load
from .model.acting.control import PD as PD, StrainFeedback as StrainFeedback, StateFeedback as StateFeedback
from .model.acting.control import Controller as Controller
from .model.acting.sampled import LinearController as LinearController, Sampled as Sampled
from .model.acting.computed import FeedForward as FeedForward, ComputedTorque as ComputedTorque
from .model.acting.mpc import MPC as MPC
from .model.acting.motor import Motor as Motor
from .run.sensing.servo import Servo as Servo
from .model.acting.shaping import input_shaper as input_shaper, Shaper as Shaper
from .run.scene.scene import load as load, Scene as Scene
from .run.scene.check import check as check
from .run.scene.robot import from_urdf as from_urdf, from_mjcf as from_mjcf
from .run.simulation import simulate as simulate, SimulationError as SimulationError
from .run.result import Result as Result
from .run.stepping import Simulation as Simulation
from .run.touch import Touch as Touch, Release as Release
from .run.integrators import Ida as Ida, Implicit as Implicit, Gauss as Gauss, RK4 as RK4
from .run.watch import Watch as Watch
from .loop.closed_loop import closed_loop as closed_loop
from .loop.design import lqr as lqr, lqg as lqg
from .loop.resonant_design import ppf as ppf, irc as irc
from .analysis.damping import fit_decay as fit_decay
from .analysis.placement import place_patch as place_patch
from .command.inversion.invert import invert as invert
from .command.moves.plan import plan_move as plan_move
from .live.live import live as live
from .data.data import Data as Data
from .estimate.kalman import KalmanFilter as KalmanFilter
from .identify.identify import identify as identify
from .identify.unknown import Unknown as Unknown
from .identify.validate.validate import validate as validate
from .many.batch.simulate import simulate_batch as simulate_batch, batch_memory as batch_memory
from .many.batch.result import BatchResult as BatchResult
from .many.batch.rollout import rollout as rollout
from .many.batch.gradient import rollout_gradient as rollout_gradient, step_derivatives as step_derivatives
from .many.sweeps.sweep import sweep as sweep
from .many.sweeps.vary import SweepPlan as SweepPlan, Vary as Vary
from .choose.chart import chart as chart
from .choose.economize import economize as economize
from .choose import error as _error  # noqa: F401  (Result.error)


for _module in (errors, results, sections, sensors, _sys.modules[__name__]):
    _face.describe(_module)


if not _typing.TYPE_CHECKING:  # to which any name would be right

    def __getattr__(name: str) -> object:
        raise _face.missing(name)


def __dir__() -> list[str]:
    """The public names, without the rooms of the package."""
    return sorted({*_face.public(_sys.modules[__name__]), *_face.LISTS, "__version__"})
