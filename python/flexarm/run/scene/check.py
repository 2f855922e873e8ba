"""Remarks about an arm or a scene, without a run."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ...analysis.coarse import coarse
from ...analysis.findings import Finding, Findings
from ...analysis.mistakes import mistakes
from ...arm.arm import Arm
from ..integrators import integrator_on
from ..problem import Problem
from ..result import Result
from ..steps import beyond_explicit
from .scene import Scene, load


def check(of: Arm | Scene | str | Path) -> Findings:
    """Lists probable mistakes in an arm or a scene, and possible improvements.

    It looks at units, impossible bodies, strains that a beam lacks, too few shape functions for the payload; of a scene
    also angles in degrees and steps of "rk4" above its limit. `print` shows one finding on a line. `Result.check` finds
    more, from a run.

    Args:
        of: an Arm, a Scene, or the path or name of one.

    Raises:
        ValueError: another argument, or a scene that cannot be run.
    """
    if isinstance(of, Arm):
        return Findings([*mistakes(of), *coarse(of, None, None)])
    if not isinstance(of, (Scene, str, Path)):
        raise ValueError(f"of = {of!r}: must be an Arm, a Scene, or the path of one; a result has result.check()")
    scene = of if isinstance(of, Scene) else load(of)
    chosen = integrator_on(scene, scene.options)
    run = _problem(scene)
    found = [*mistakes(scene.arm), *coarse(scene.arm, scene.drive, scene.control), *_angles(run)]
    if chosen.explicit:
        step, span = chosen.options["step"], float(run.times[-1] - run.times[0])
        blown = beyond_explicit(scene.arm, step, span, run.start["q0"], run.prescribed)
        found += [] if blown is None else [blown.finding]
    return Findings(found)


def check_run(scene: Scene, result: Result) -> Findings:
    """Findings of `Result.check` in the scene's run, and angles in degrees."""
    return Findings([*result.check(), *_angles(_problem(scene))])


def _problem(scene: Scene) -> Problem:
    return Problem(scene, scene.t, scene.q0, scene.v0, events=scene.events)


def _angles(run: Problem) -> Iterator[Finding]:
    if degrees := run.in_degrees():
        yield Finding("angles", degrees)
