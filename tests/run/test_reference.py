"""The grammar of scene files is the parts' own: every argument is explained, and the reference page shows all."""

from __future__ import annotations

import re
import runpy
from inspect import signature
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from arms import toml
from messages import refuses

HOME = Path(__file__).parents[2]
PAGE = HOME / "docs" / "scene-reference.md"
page = runpy.run_path(str(HOME / "bench" / "run" / "scene_reference.py"))["page"]


def test_the_page_is_up_to_date() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "python bench/run/scene_reference.py > docs/scene-reference.md"


JOINTS = (fa.Fixed, fa.Revolute, fa.Prismatic, fa.Cylindrical, fa.Universal, fa.Planar, fa.Spherical, fa.Free, fa.Axes)
SECTIONS = (fa.Rectangle, fa.Circle, fa.Tube, fa.sections.Ellipse, fa.sections.Box, fa.sections.IBeam,
            fa.sections.GeneralSection, fa.SectionMatrix, fa.sections.Taper)  # fmt: skip
SENSORS = (fa.sensors.Encoder, fa.sensors.Tachometer, fa.sensors.ForceTorque, fa.sensors.StrainGauge,
           fa.sensors.Accelerometer, fa.sensors.Camera)  # fmt: skip
LAWS = (fa.PD, fa.StrainFeedback, fa.StateFeedback, fa.LinearController, fa.LinearController.pid,
        fa.LinearController.ppf, fa.LinearController.irc, fa.Servo, fa.MPC, fa.FeedForward,
        fa.ComputedTorque)  # fmt: skip
OTHERS = (fa.Link, fa.Placement, fa.RigidBody, fa.Beam, fa.Material, fa.Patch, fa.Piezo, fa.Look, fa.Load, fa.Motor,
          fa.sensors.LowPass)  # fmt: skip
TYPES = """fixed revolute prismatic cylindrical universal planar spherical free axes rectangle circle tube ellipse box
    i_beam general matrix taper plane sphere box pd strain_feedback state_feedback linear pid ppf irc servo mpc
    feed_forward computed_torque encoder tachometer force_torque contact_force strain_gauge accelerometer
    camera""".split()


@pytest.mark.parametrize("made", [*JOINTS, *SECTIONS, *SENSORS, *LAWS, *OTHERS], ids=lambda made: made.__qualname__)
def test_every_key_is_on_the_page(made: Any) -> None:
    """tests/test_help.py holds that every argument is explained."""
    assert not [name for name in signature(made).parameters if f"`{name}`" not in page()]


def test_every_key_has_a_meaning_and_every_type_is_known() -> None:
    rows = re.findall(r"^\| `.*` \| .* \| (.*?) ?\|$", page(), re.MULTILINE)
    assert len(rows) > 200 and all(rows)
    assert re.findall(r'`type = "(\w+)"`', page()) == TYPES


@pytest.mark.parametrize("kind", [fa.Revolute, fa.Spherical, fa.sensors.Encoder], ids=lambda kind: kind.__name__)
def test_help_explains_what_is_inherited(kind: Any) -> None:
    for name in signature(kind).parameters:
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
