"""Warnings and exceptions beside ValueError and `SimulationError`."""

from .analysis.equilibrium import StateWarning as StateWarning
from .analysis.findings import (
    LoopWarning as LoopWarning,
)
from .analysis.findings import (
    RangeWarning as RangeWarning,
)
from .analysis.findings import (
    SlowWarning as SlowWarning,
)
from .analysis.findings import (
    StepWarning as StepWarning,
)
from .command.inversion.invert import InversionWarning as InversionWarning
from .command.moves.plan import MoveWarning as MoveWarning
from .data.signal import DataWarning as DataWarning
from .estimate.kalman import FilterWarning as FilterWarning
from .identify.fit import FitError as FitError
from .identify.fit import FitInterrupted as FitInterrupted
from .identify.fit import FitWarning as FitWarning
from .many.batch.rollout import BatchInterrupted as BatchInterrupted
from .many.sweeps.result import SweepInterrupted as SweepInterrupted
from .model.acting.mpc import MPCWarning as MPCWarning
from .model.parts.part import ModelWarning as ModelWarning
from .robots.tree import RobotWarning as RobotWarning
from .run.simulation import SimulationInterrupted as SimulationInterrupted
