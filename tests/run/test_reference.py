"""The grammar of scene files is the parts' own: every argument is explained, and the reference page shows all."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from arms import toml
from flexarm.model.parts.arguments import Argument, arguments, kinds
from flexarm.run.scene.grammar import SAMPLES, SIMULATION, SceneFile
from messages import refuses

HOME = Path(__file__).parents[2]
PAGE = HOME / "docs" / "scene-reference.md"
page = runpy.run_path(str(HOME / "bench" / "run" / "scene_reference.py"))["page"]


def test_the_page_is_up_to_date() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "python bench/run/scene_reference.py > docs/scene-reference.md"


def below(make: Any, found: dict[Any, dict[str, Argument]]) -> dict[Any, dict[str, Argument]]:
    """All that tables of a file are made into."""
    if make not in found:
        found[make] = arguments(make)
        for argument in found[make].values():
            for part in (*argument.parts, *kinds(*argument.parts).values()) if argument.name not in SAMPLES else ():
                below(part, found)
    return found


@pytest.mark.parametrize(("made", "known"), [*below(SceneFile, {}).items(), ("simulation", SIMULATION)], ids=str)
def test_every_key_is_explained_and_on_the_page(made: Any, known: dict[str, Argument]) -> None:
    assert all(argument.meaning for argument in known.values())
    assert all(f"`{name}`" in page() for name in known)


def test_every_kind_is_known() -> None:
    joints = {fa.Fixed, fa.Revolute, fa.Prismatic, fa.Cylindrical, fa.Universal, fa.Planar, fa.Spherical, fa.Free}
    sensors = {
        fa.sensors.Encoder,
        fa.sensors.Tachometer,
        fa.sensors.ForceTorque,
        fa.sensors.StrainGauge,
        fa.sensors.Accelerometer,
        fa.sensors.Camera,
    }
    sections = {
        fa.Rectangle,
        fa.Circle,
        fa.Tube,
        fa.sections.Ellipse,
        fa.sections.Box,
        fa.sections.IBeam,
        fa.sections.GeneralSection,
        fa.sections.Taper,
    }
    assert joints | {fa.Axes} <= set(kinds(fa.Joint).values()) and sensors <= set(kinds(fa.sensors.Sensor).values())
    assert sections <= set(kinds(*arguments(fa.Beam)["section"].parts).values())
    assert {"pd", "strain_feedback", "state_feedback", "pid"} <= set(kinds(fa.Controller))


@pytest.mark.parametrize("kind", [fa.Revolute, fa.Spherical, fa.sensors.Encoder], ids=lambda kind: kind.__name__)
def test_help_explains_what_is_inherited(kind: Any) -> None:
    for name in arguments(kind):
        assert f" {name}: " in kind.__doc__ or f" {name}, " in kind.__doc__


def test_a_new_controller_is_read_and_saved_by_what_it_takes(tmp_path: Path) -> None:
    class Bang(fa.PD):
        """A law of one's own.

        Args:
            level: N m.
        """

        type = "bang"

        def __init__(self, level: float, reference: Any = 0.0) -> None:
            super().__init__(level, 0.0, reference=reference)
            self.level = level

    body = {"mass": 1.0, "inertia": [1, 1, 1]}
    d = {
        "link": [{"joint": {"type": "revolute"}, "tip": body}],
        "control": [{"type": "bang", "level": 2.0, "reference": {"t": [0, 1], "r": [0, 1]}}],
    }
    scene = fa.load(toml(tmp_path, d))
    scene.save(tmp_path / "scene.toml")
    law = fa.load(tmp_path / "scene.toml").control[0]
    assert type(law) is Bang and law.level == 2.0
    np.testing.assert_allclose(law.reference(0.5), 0.5)
    d["control"][0]["levl"] = 1.0
    with refuses("control[0]", "key 'levl'", "'level'"):
        fa.load(toml(tmp_path, d))
