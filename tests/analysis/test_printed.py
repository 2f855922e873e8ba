"""Modes and linear models as tables and as a figure."""

import sys
from types import SimpleNamespace
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from arms import STEEL
from messages import refuses


def arm() -> fa.Arm:
    """A cantilever of length 1 on a joint, EI / (rho A) = 1."""
    section = fa.sections.GeneralSection(1.0, 1.0, 1.0, 1.0)
    beam = fa.Beam(1.0, section, fa.Material(1.0, 1.0, 0.3), {"bending_y": 4}, rotary_inertia=False)
    return fa.Arm([fa.Link(fa.Revolute("z", name="root"), beam=beam)])


def test_modes_print_as_a_table() -> None:
    lines = str(arm().modes(lock=["root"])).splitlines()
    assert lines[0].split("  ")[0].strip() == "mode" and len(lines) == 2 + 4
    cells = lines[2].split()
    assert cells[0] == "0" and float(cells[1]) == pytest.approx(3.516015, rel=1e-5)  # Euler and Bernoulli's
    assert float(cells[2]) == pytest.approx(3.516015 / (2 * np.pi), rel=1e-5)
    assert "rigid" in str(arm().modes()).splitlines()[2]


def test_linear_models_print_as_a_table() -> None:
    text = str(arm().linearize(arm().zero, lock=["root"], inputs=[("load", 0)], outputs=[("tip", 0)]))
    assert "8 states, 3 inputs, 3 outputs" in text and "bending_y 1" in text and "-0 " not in text
    first = next(line for line in text.splitlines() if "+-" in line).split()
    assert float(first[3]) == pytest.approx(3.516, rel=1e-3)


def test_modes_are_drawn_along_the_arm() -> None:
    """The second mode of a cantilever has its node at 0.7834 of the length (Blevins 1979); bending_y moves along y."""
    figure = arm().modes(lock=["root"]).plot(2)
    (ax,) = figure.axes
    assert "world y" in ax.get_ylabel()
    curves = [line for line in ax.lines if len(line.get_xdata()) > 2]
    s, y = curves[1].get_data()
    node = s[np.flatnonzero(np.diff(np.sign(y[1:])))[0] + 1]
    assert node == pytest.approx(0.7834, abs=0.03) and np.abs(y).max() == pytest.approx(1.0)
    assert "0.5596 Hz, damping 0 %" in curves[0].get_label()
    beam = fa.Beam(0.5, fa.Circle(0.01), STEEL, {"torsion": 1})
    with refuses("modes", "none"):
        fa.Arm([fa.Link(fa.Fixed(), beam=beam)]).modes().plot()
    with refuses("count = 0"):
        arm().modes().plot(0)


def test_joints_are_drawn_where_they_sit() -> None:
    """From the base along the arm: past what stands between a link's end and the next joint, whatever is rigid."""
    section = fa.sections.GeneralSection(1.0, 1.0, 1.0, 1.0)
    beam = fa.Beam(1.0, section, fa.Material(1.0, 1.0, 0.3), {"bending_y": 2}, rotary_inertia=False)
    raised, aside = fa.Placement((0, 0, 0.4)), fa.Placement((0.3, 0.4, 0.0))
    arm = fa.Arm(
        [
            fa.Link(fa.Revolute("z", name="root", inboard=raised), beam=beam),
            fa.Link(fa.Revolute("z", name="middle", inboard=aside, outboard=fa.Placement((0.25, 0, 0))),
                    fa.RigidBody(1.0, inertia=(1, 1, 1), end=(0.5, 0, 0))),
            fa.Link(fa.Revolute("z"), beam=beam, name="last"),
        ]
    )  # fmt: skip
    ax = arm.modes(lock=[0, 1, 2]).plot(1).axes[0]
    dotted = sorted(line.get_xdata()[0] for line in ax.lines if line.get_linestyle() == ":")
    np.testing.assert_allclose(dotted, [0.4, 1.9, 1.9 + 0.75], rtol=1e-12)
    assert [text.get_text() for text in ax.texts] == ["root", "middle", "last"]
    welded = fa.Arm([*arm.links[:1], fa.Link(fa.Fixed(name="bolts"), beam=beam), fa.Link(fa.Revolute("z"), beam=beam),
                     fa.Link(fa.Revolute("y"), fa.RigidBody(1.0, inertia=(1, 1, 1)), name="wrist"),
                     fa.Link(fa.Revolute("x"), fa.RigidBody(1.0, inertia=(1, 1, 1)), name="hand")])  # fmt: skip
    texts = welded.modes(lock=[0, 2, 3, 4]).plot(1).axes[0].texts
    assert [text.get_text() for text in texts] == ["root", "link 2", "wrist, hand"]  # what moves; one place, one word
    s = ax.lines[0].get_xdata()
    assert s[0] == pytest.approx(0.4) and s[-1] == pytest.approx(1.9 + 0.75 + 1.0)


def test_an_arm_prints_the_damping_of_its_frequencies() -> None:
    found = arm().modes(lock=["root"])
    beam = fa.Beam(1.0, fa.sections.GeneralSection(1.0, 1.0, 1.0, 1.0), fa.Material(1.0, 1.0, 0.3), {"bending_y": 4},
                   rotary_inertia=False, kelvin_voigt=1e-3)  # fmt: skip
    damped = fa.Arm([fa.Link(fa.Revolute("z", name="root"), beam=beam)])
    lines = {line[:16].strip(): line[16:].split() for line in str(damped).splitlines() if line}
    ratios = [float(x) for x in lines["damping ratios"][:4]]
    np.testing.assert_allclose(ratios, 0.5e-3 * found.frequencies, rtol=1e-3)  # tau omega / 2
    assert "damping ratios  0 0 0 0" in str(arm())


def test_an_arm_prints_beams_that_have_no_inertia_of_their_own() -> None:
    """Without rotary inertia, or without mass, a beam alone has no frequency: its tip moves as one with its shapes."""
    tip = fa.RigidBody(0.5, (0, 0, 0), (2e-3,) * 3)
    for density, modes, rotary in ((2700.0, {"torsion": 1}, False), (0.0, {"bending_y": 2}, True)):
        beam = fa.Beam(0.5, fa.Circle(0.01), fa.Material(density, 7e10, 0.3), modes, "legendre", rotary_inertia=rotary)
        printed = str(fa.Arm([fa.Link(fa.Fixed(), None, beam, tip)]))
        assert printed.splitlines()[2].split()[-1] == "-"
        assert "frequencies     none" not in printed


class _Formatter(dict[type, Any]):
    """What IPython has for each format: functions by type."""

    def for_type(self, kind: type, function: Any) -> None:
        self[kind] = function


def test_notebook_shows_figures_that_pyplot_did_not_make(monkeypatch: pytest.MonkeyPatch) -> None:
    known = {"image/png": _Formatter(), "image/svg+xml": _Formatter()}
    shell = SimpleNamespace(display_formatter=SimpleNamespace(formatters=known))
    modes = fa.load("ist").arm.modes(lock=[0])

    def plot() -> Any:
        with monkeypatch.context() as m:
            m.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))
            return modes.plot()

    figure = plot()
    assert known["image/png"][type(figure)](figure).startswith(b"\x89PNG")
    known["image/png"].clear()
    known["image/svg+xml"][type(figure)] = None  # the user has asked for another format
    plot()
    assert not known["image/png"]
