"""Warnings, and exceptions beside ValueError and `SimulationError`."""

from .model.parts.part import ModelWarning as ModelWarning
from .analysis.equilibrium import StateWarning as StateWarning
from .analysis.findings import RangeWarning as RangeWarning, LoopWarning as LoopWarning, StepWarning as StepWarning
from .analysis.findings import SlowWarning as SlowWarning
from .command.moves.plan import MoveWarning as MoveWarning
from .command.inversion.invert import InversionWarning as InversionWarning
from .model.acting.mpc import MPCWarning as MPCWarning
from .robots.tree import RobotWarning as RobotWarning
from .data.signal import DataWarning as DataWarning
from .identify.fit import FitWarning as FitWarning
from .estimate.kalman import FilterWarning as FilterWarning
from .identify.fit import FitError as FitError, FitInterrupted as FitInterrupted
from .run.simulation import SimulationInterrupted as SimulationInterrupted
from .many.batch.rollout import BatchInterrupted as BatchInterrupted
from .many.sweeps.sweep import SweepInterrupted as SweepInterrupted
