"""A page in which an arm computes: the C++ core in WebAssembly, with sliders, switches and a hand at the arm's end."""

from __future__ import annotations

import base64
import gzip
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._check import Array, instance, named
from ..arm.arm import Arm
from ..data.store.files import write_whole
from ..model.acting.control import PD
from ..model.acting.drive import Motion
from ..model.acting.load import Load
from ..model.parts.beam import RigidBody
from ..model.parts.chain import Chain
from ..run.integrators import Ida, Implicit, integrator_on
from ..run.scene.scene import Scene
from ..view import page
from ..view.body import Body
from ..view.track import make_track
from ..view.view import browse, framed
from .commands import INVERSION, SHAPER, inverted, moves, shaped
from .numbers import ArmAlone, Numbers
from .sliders import Slider, chosen, given, has

CORE = "flexarm.wasm"
_STEP = 1e-3  # s, of scenes that name no integrator with a step
_BENT = 0.2  # of the hand's way, by which it bends the arm


class Live:
    """A page whose arm computes, of `live`: `.save(path)` writes it, `.open()` shows it in the browser.

    Attributes:
        scenes: by the names of their buttons. sliders: their paths, or labels where they move several.
        title: of the page. notes: what of it could not be made, and why.
    """

    def __init__(self, scenes: dict[str, Scene], sliders: list[Slider], notes: list[str], title: str) -> None:
        self.scenes, self._sliders, self.notes, self.title = scenes, sliders, notes, title
        self.sliders = [slider.label for slider in sliders]
        self._variants = _variants(self.scenes, self._sliders)

    def __repr__(self) -> str:
        return f"Live({', '.join(self.scenes)}; {len(self._sliders)} sliders; .save('arm.html'), .open())"

    def html(self) -> str:
        """The page as one HTML file.

        Raises:
            RuntimeError: this installation has no core in WebAssembly.
            ImportError: without `pip install 'flexarm[view]'`.
        """
        styles = ("view/viewer.css", "live/live.css")
        scripts = ("view/drawing.js", "live/core.js", "live/live.js")
        return page.assembled(self.title, self._told(), styles, scripts)

    def save(self, path: str | Path) -> None:
        """Writes the page (.html): one file, which needs no network.

        Raises:
            ValueError: another suffix, or a path that cannot be written. RuntimeError, ImportError: as of `html`.
        """
        file, content = named(path, ".html", ".htm"), self.html().encode()
        write_whole(file, lambda f: f.write(content), "path")

    def open(self) -> Path:
        """Shows the page in the browser, and returns its path; without a browser the path is also printed on stderr."""
        return browse(self.html(), "live.html")

    def _repr_html_(self) -> str:
        return framed(self.html(), 640)

    def _told(self) -> dict[str, Any]:
        """What the page reads in #data."""
        core = base64.b64encode(gzip.compress(core_file().read_bytes(), 9, mtime=0)).decode("ascii")
        first, variants = next(iter(self.scenes.values())), self._variants
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the run is for the picture alone
            run = first.run()
        track = make_track(first.arm, run.t, run.q, title=self.title)
        ends = len(first.arm.ends)
        loads = list(range(len(first.loads) - ends, len(first.loads)))
        about = {
            "core": core, "title": self.title, "nq": first.arm.nq, "nv": first.arm.nv, "body": page.drawn(track.body),
            "nodes": _nodes(first.arm, track.body), "bent": _bent(first.arm), "loads": loads, "ends": first.arm.ends,
            "stiffness": _BENT * _tip_stiffness(first.arm, first.start()), "variants": variants,
            "sliders": [_slider(k, slider, variants) for k, slider in enumerate(self._sliders)],
        }  # fmt: skip
        notes = ["drag the arm's end to push it"]
        return {**page.scenery([track]), "largest": {"force": 0, "moment": 0}, "notes": notes, "live": about}


def core_file() -> Path:
    """The core in WebAssembly.

    Raises:
        RuntimeError: this installation has none.
    """
    found = Path(str(resources.files("flexarm"))) / "live" / CORE
    if not found.is_file():
        raise RuntimeError(
            f"{CORE}: is not in this installation ({found.parent}), so that no page can compute; in a clone of the "
            "repository './setup.sh live' builds it, and installs flexarm with it"
        )
    return found


def live(
    scenes: Scene | Mapping[str, Scene],
    sliders: Mapping[str | tuple[str, ...], ArrayLike] | None = None,
    title: str | None = None,
) -> Live:
    """A page in which the arm computes, in the C++ core: one HTML file, without a network. The end of the arm can be
    pushed with the mouse, and a plot of the beams' deflection runs along.

    Args:
        scenes: a scene, whose moves the page then has three times, with buttons: as they are, shaped (`input_shaper`)
            and inverted (`invert`), where that can be done; or several scenes of arms with the same coordinates, by the
            names of their buttons. When a scene is over it begins again, from the state that it has reached, or, where
            a joint is made to move and does not come back, from its start.
        sliders: lowest and highest value by the path of a number, as `simulate_batch(parameters=)` has it, such as
            {"link.1.tip.mass": (0, 1)}; of a tuple of paths, factors of all their numbers. None: gains, payload,
            lengths and stiffness. A number that is moved acts from now on; a sampled controller begins anew then.
        title: of the page; None: the first scene's.

    Raises:
        ValueError: arms with other coordinates; a path that no scene has, or that does not move a number; a law that is
            Python code.
    """
    notes: list[str] = []
    if isinstance(scenes, Scene):
        buttons = _of_one(scenes, notes)
    elif not isinstance(scenes, Mapping) or not scenes:
        raise ValueError(f"scenes = {scenes!r}: must be a Scene, or scenes by the names of their buttons")
    else:
        buttons = {str(name): instance(f"scenes[{name!r}]", x, Scene, "a Scene") for name, x in scenes.items()}
    first = next(iter(buttons.values()))
    for name, scene in buttons.items():
        if scene.arm.q_names != first.arm.q_names:
            raise ValueError(f"scenes[{name!r}]: its arm has other coordinates than that of {next(iter(buttons))!r}")
    arms: dict[int, Arm] = {}  # scenes of one arm go on having one
    made = {name: _pushed(scene, arms) for name, scene in buttons.items()}
    first = next(iter(made.values()))
    found = chosen(first) if sliders is None else [given(made, paths, x) for paths, x in sliders.items()]
    return Live(made, found, notes, title or first.name)


def _of_one(scene: Scene, notes: list[str]) -> dict[str, Scene]:
    """The buttons of a scene alone."""
    own = "Control" if scene.control else "Motion" if moves(scene) else "Scene"
    if any(isinstance(one, PD) for one in scene.control):
        own = "PD"
    out = {own: scene}
    if moves(scene):
        for name, make in ((SHAPER, shaped), (INVERSION, inverted)):
            try:
                out[name] = make(scene)
            except ValueError as e:
                notes.append(f"without the button {name}: {e}")
    return out


def _pushed(scene: Scene, arms: dict[int, Arm]) -> Scene:
    """The scene with steps of its own, with a body at each end that a payload may grow on, and with loads there."""
    integrator = integrator_on(scene, scene.options)
    if isinstance(integrator, Ida) or getattr(integrator, "step", None) is None:
        integrator = Implicit(_STEP)
    arm = arms.get(id(scene.arm), scene.arm)
    bare = [k for k in arm.ends if arm.links[k].tip is None]
    if bare:
        links = [replace(link, tip=RigidBody()) if k in bare else link for k, link in enumerate(arm.links[: arm._own])]
        arms[id(scene.arm)] = arm = arm._alike(links, arm.gravity)
    pushes = tuple(Load(k, force=(0, 0, 0)) for k in arm.ends)
    return replace(scene, arm=arm, loads=(*scene.loads, *pushes), options={"integrator": integrator})


def _variants(scenes: Mapping[str, Scene], sliders: Sequence[Slider]) -> list[dict[str, Any]]:
    """What the page knows of each scene."""
    arms: dict[Any, ArmAlone] = {}
    out = []
    for name, scene in scenes.items():
        mine = [k for k, slider in enumerate(sliders) if has(scene, slider.paths)]
        used, key = [sliders[k] for k in mine], (id(scene.arm), *mine)
        if key not in arms:
            arms[key] = ArmAlone(scene, used)
        out.append({"name": name, "sliders": mine, **_variant(scene, Numbers(scene, used, arms[key]))})
    return out


def _variant(scene: Scene, numbers: Numbers) -> dict[str, Any]:
    tables = [
        {
            "sliders": table["sliders"],
            "at": page.text(table["at"].astype("<u4")),
            "values": page.text(table["values"].astype("<f8")),
        }
        for table in numbers.tables
    ]
    driven = [law for law in scene.drive.values() if isinstance(law, Motion)]
    ends = float(scene.t[0]), float(scene.t[-1])
    returns = all(abs(law(ends[1])[0] - law(ends[0])[0]) < 1e-9 for law in driven)  # or it begins again from its start
    return {
        "document": numbers.document, "stops": numbers.stops, "straight": numbers.straight, "tables": tables,
        "returns": returns,
    }  # fmt: skip


def _slider(k: int, slider: Slider, variants: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """What the page shows of a slider; it has stops if it needs them in one scene."""
    stops = None
    for of in variants:
        if k in of["sliders"] and not of["straight"][of["sliders"].index(k)]:
            stops = of["stops"][of["sliders"].index(k)]
    about = {name: getattr(slider, name) for name in ("label", "unit", "low", "high", "value")}
    return {**about, "title": ", ".join(slider.paths), "stops": stops}


def _nodes(arm: Chain, body: Body) -> list[tuple[int, float | None, list[float]]]:
    """Of each node its link, -1 in the world; the place on its beam, as a part of the length, None at the link's end;
    and what is added to that in its axes (m)."""
    out: list[tuple[int, float | None, list[float]]] = []
    for k, x in body.places:
        if k is None:
            out.append((-1, None, [0.0, 0.0, 0.0]))
            continue
        link = arm.links[k]
        if x is not None:
            out.append((k, None if np.isinf(x) or link.beam is None else x / link.beam.length, [0.0, 0.0, 0.0]))
            continue
        ends = [link.hub] if link.beam else [link.hub, link.tip]
        back = -sum((np.array(b.end) for b in ends if b is not None), np.zeros(3))
        out.append((k, 0.0 if link.beam else None, back.tolist()))
    return out


def _bent(arm: Arm) -> list[dict[str, Any]]:
    """Of each beam that bends, the axes of its clamp along which its end moves, and its place at rest, in lengths."""
    out = []
    for k, link in enumerate(arm.links):
        if link.beam is None:
            continue
        counts = link.beam.counts
        axes = [a for a, names in ((0, ["extension"]), (1, ["bending_y", "shear_y"]), (2, ["bending_z", "shear_z"]))
                if any(counts.get(name) for name in names)]  # fmt: skip
        if axes:
            (p0, R0), (p1, _) = (arm.frame(arm.zero, k, x) for x in (0.0, link.beam.length))
            labels = [arm.names[k] if len(axes) == 1 else f"{arm.names[k]} {'xyz'[a]}" for a in axes]
            rest = R0.T @ (p1 - p0) / link.beam.length
            out.append({"link": k, "axes": axes, "labels": labels, "rest": rest.tolist()})
    return out


def _tip_stiffness(arm: Arm, q: Array) -> float:
    """Of the end, in the softest direction, with the joints held (N/m); of a rigid arm a tenth of its weight per length
    that it has."""
    J = arm.jacobian(q)[:3]
    compliance = np.zeros((3, 3))
    for _, beam, _, at in arm.beams():
        compliance += J[:, at] @ np.linalg.solve(beam._core.stiffness, J[:, at].T)
    softest = float(np.linalg.eigvalsh(compliance).max()) if arm.nv else 0.0
    return 1 / softest if softest > 0 else 10.0 * max(sum(link.mass for link in arm.links), 1e-3)
