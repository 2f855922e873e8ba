"""Classes that functions and methods return, for annotations and `isinstance`; nobody makes them."""

from .analysis.modes import Modes as Modes, ModeShapes as ModeShapes
from .analysis.linear import LinearModel as LinearModel, Derivatives as Derivatives
from .analysis.equilibrium import Trim as Trim
from .loop.closed_loop import ClosedLoop as ClosedLoop
from .loop.tuning import StabilityMap as StabilityMap, Tuned as Tuned
from .analysis.damping import Decay as Decay
from .analysis.placement import PatchPlacement as PatchPlacement
from .view.view import View as View
from .analysis.findings import Finding as Finding
from .run.outputs import StrutMotion as StrutMotion, ContactMotion as ContactMotion, LoopMotion as LoopMotion
from .run.sensitivity import Sensitivities as Sensitivities
from .run.sensing.reading import Reading as Reading, PowerSpectrum as PowerSpectrum
from .command.inversion.inversion import Inversion as Inversion
from .command.moves.move import Move as Move, LimitUse as LimitUse
from .live.live import Live as Live
from .estimate.estimate import Estimate as Estimate
from .data.compare import Comparison as Comparison
from .identify.fit import Fit as Fit
from .identify.validate.validate import Validation as Validation
from .many.batch.rollout import Rollout as Rollout
from .many.batch.problems import Failure as Failure
from .many.batch.gradient import Gradient as Gradient, StepDerivatives as StepDerivatives
from .many.sweeps.sweep import SweepResult as SweepResult
from .choose.chart import Chart as Chart
from .choose.economize import ModelPlan as ModelPlan
from .choose.error_estimate import ErrorEstimate as ErrorEstimate, ErrorSource as ErrorSource
