"""Pages that compute: the core in WebAssembly beside the native one, sliders, and what is refused."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from importlib import resources
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np
import pytest
from flexarm.cli import main

from tests.messages import refuses

PACKAGE = resources.files("flexarm") / "live"
BUILT = (PACKAGE / "flexarm.wasm").is_file() and shutil.which("node") is not None
built = pytest.mark.skipif(not BUILT, reason="needs flexarm.wasm, which ./setup.sh live builds, and node")
CLOSE = 1e-9


def told(page: fa.results.Live) -> dict[str, Any]:
    """What a page holds for its scripts."""
    found = re.search(r'<script id="data" type="application/json">(.*?)</script>', page.html(), re.DOTALL)
    assert found
    return dict(json.loads(found[1]))


def in_page(folder: Path, told: Any, **asked: Any) -> dict[str, Any]:
    """What the core of a page reaches; see drive.js."""
    data = folder / "told.json"
    data.write_text(json.dumps(told), encoding="utf-8")
    command = ["node", str(Path(__file__).with_name("drive.js")), str(PACKAGE / "core.js"), str(data)]
    done = subprocess.run(
        command, input=json.dumps({"variant": 0, "steps": 300, **asked}), capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout))


def native(scene: fa.Scene, steps: int = 300, push: Any = None) -> tuple[list[float], list[Any]]:
    run = fa.Simulation(scene, scene.options["integrator"])
    if push:
        run.set_load(len(scene.loads) - 1, push)
    rows: tuple[list[float], list[Any]] = ([], [])
    for _ in range(steps):
        run.step()
        rows[0].append(run.t)
        rows[1].append(run.q.tolist())
    return rows


def off(found: Any, right: Any) -> float:
    return float(np.abs(np.array(found) - np.array(right)).max())


@pytest.fixture(scope="module")
def two_links() -> fa.results.Live:
    return fa.live(fa.load("two_links"))


@built
@pytest.mark.parametrize("variant", range(3))
def test_the_page_computes_what_the_native_core_computes(
    two_links: fa.results.Live, variant: int, tmp_path: Path
) -> None:
    assert list(two_links.scenes) == ["PD", "Shaper", "Inversion"] and not two_links.notes
    scene = list(two_links.scenes.values())[variant]
    found = in_page(tmp_path, told(two_links), variant=variant)
    t, q = native(scene)
    assert found["version"] == fa.__version__
    assert off(found["t"], t) < CLOSE and off(found["q"], q) < CLOSE
    assert np.ptp(np.array(q)[:, 0]) > 0.1
    place, _ = scene.arm.frame(q[-1], 0, scene.arm.links[0].beam.length)
    assert off(found["slice"][-1][:3], place) < CLOSE
    assert off(found["slice"][-1][12:], scene.arm.strain(q[-1], 0, scene.arm.links[0].beam.length)) < CLOSE


@built
def test_a_push_is_the_native_one(two_links: fa.results.Live, tmp_path: Path) -> None:
    found = in_page(tmp_path, told(two_links), push=[1.0, 3.0, 0.0])
    assert off(found["q"], native(two_links.scenes["PD"], push=(1.0, 3.0, 0.0))[1]) < CLOSE


@built
@pytest.mark.parametrize("scene", ["ist_control", "ist"])
def test_steps_that_are_chosen_friction_and_motions(scene: str, tmp_path: Path) -> None:
    page = fa.live(fa.load(scene))
    (first, *_) = page.scenes.values()
    found = in_page(tmp_path, told(page), steps=60)
    assert off(found["q"], native(first, 60)[1]) < CLOSE


@built
def test_sliders_move_the_scenes_own_numbers(tmp_path: Path) -> None:
    """The scene's file with other numbers is the page with sliders there, however many are moved."""
    text = (resources.files("flexarm") / "scenes" / "two_links.toml").read_text(encoding="utf-8")
    scene = fa.load("two_links")
    lengths = {"link.1.beam.length": (0.4, 0.6), "link.fore.tip.mass": (0, 0.5), "control.0.kp": (50, 400)}
    page = fa.live(scene, {**lengths, ("control.0.kv", "control.1.kv"): (0.5, 2)})
    data = told(page)
    stop = min(data["live"]["sliders"][0]["stops"], key=lambda x: abs(x - 0.45))
    other = text.replace("length = 0.5,", f"length = {stop!r},").replace("mass = 0.1 ", "mass = 0.37 ")
    other = other.replace("kp = 200.0", "kp = 123.0").replace("kv = 12.0", "kv = 18.0").replace("kv = 2.0", "kv = 3.0")
    (tmp_path / "other.toml").write_text(other, encoding="utf-8")
    changed = fa.load(tmp_path / "other.toml")
    assert changed.arm.links[1].tip.mass == 0.37 and changed.control[1].kv == 3.0
    found = in_page(tmp_path, data, values=[stop, 0.37, 123.0, 1.5])
    right = native(next(iter(fa.live(changed, {"gravity.1": (-1, 1)}).scenes.values())))[1]
    assert off(found["q"], right) < CLOSE
    own = native(page.scenes["PD"])[1]
    assert off(right, own) > 1e-3


@built
def test_what_the_core_refuses_is_told(two_links: fa.results.Live, tmp_path: Path) -> None:
    data = told(two_links)
    document = data["live"]["variants"][0]["document"]
    document["feedback"][0]["by_q"][0] = -1e9  # the loop runs away
    error = in_page(tmp_path, data, document=json.dumps(document), steps=3000, advance=4e-3)["error"]
    assert "t =" in error or "step" in error or "ran away" in error, error
    document["step"] = -1
    assert "step" in in_page(tmp_path, data, document=json.dumps(document))["error"]
    document["q0"] = [0.0]
    assert "q0" in in_page(tmp_path, data, document=json.dumps(document))["error"]


@built
def test_the_page_is_one_small_file(two_links: fa.results.Live, tmp_path: Path) -> None:
    two_links.save(tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert len(text.encode()) < 6e6
    assert not re.search(r"<(script|link|img|iframe)[^>]*\b(src|href)=", text)
    with refuses("page.pdf", ".html"):
        two_links.save(tmp_path / "page.pdf")


@built
def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["live", "ist", "--slider", "link.0.beam.length=0.4:0.6", "-o", "ist.html", "--json"]) == 0
    about = json.loads(capsys.readouterr().out)
    assert about["file"] == "ist.html" and about["sliders"] == ["link.0.beam.length"]
    assert (tmp_path / "ist.html").stat().st_size > 1e5


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"link.0.tip.mas": (0, 1)}, ("link.0.tip.mas",)),
        ({"link.0.tip.mass": (1, 0)}, ("link.0.tip.mass", "lowest", "highest")),
        ({"link.0.beam.length": (1, 2)}, ("link.0.beam.length", "0.6", "own")),
        ({"link.0.beam.material.poisson_ratio": (0.1, 0.4)}, ("link.0.beam.material.poisson_ratio",)),
    ],
)
def test_sliders_that_are_wrong(given: Any, named: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    with refuses(*named):
        fa.live(fa.load("two_links"), given).html()


def test_scenes_that_do_not_belong_together() -> None:
    with refuses("scenes", "ist"):
        fa.live({"two": fa.load("two_links"), "ist": fa.load("ist")})
    with refuses("scenes", "Scene"):
        fa.live({"ist": "ist"})  # type: ignore[dict-item]
    with refuses("scenes"):
        fa.live({})


def test_without_the_core_the_error_names_the_remedy(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(sys.modules[fa.results.Live.__module__], "CORE", "missing.wasm")
    with refuses("missing.wasm", "./setup.sh live", error=RuntimeError):
        fa.live(fa.load("two_links")).html()
    assert main(["live", "two_links", "-o", str(tmp_path / "page.html")]) == 2
    assert "./setup.sh live" in capsys.readouterr().err


def test_a_bad_option_of_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["live", "ist", "--slider", "link.0.tip.mass=heavy"]) == 2
    assert "PATH=LOW:HIGH" in capsys.readouterr().err


def test_moves_are_shaped_and_inverted() -> None:
    """After each the arm rests better than after the move itself; with moves that joints are made to do, too."""
    scene = fa.load("two_links")
    for page in (fa.live(scene), fa.live(fa.Scene(scene.arm, dict(enumerate(c.reference for c in scene.control)),
                                                  t=scene.t, q0=scene.q0))):  # fmt: skip
        left = []
        for one in page.scenes.values():
            run = one.run()
            rest = (run.t > 1.2) & (run.t < 2.4)
            left.append(float(np.ptp(run.tip_deflection("fore")[rest, 1])))
        assert left[1] < 0.4 * left[0] and left[2] < 0.01 * left[0]


def test_a_scene_that_cannot_be_inverted_says_why() -> None:
    link = fa.Link(fa.Revolute("y"), beam=fa.load("two_links").arm.links[1].beam)
    turn = fa.Motion([0, 0.5, 2], [0, 1, 1], [0, 0, 0], [0, 0, 0])
    page = fa.live(fa.Scene(fa.Arm([link]), {0: turn}, t=np.linspace(0, 2, 201)))
    assert list(page.scenes) == ["Motion", "Shaper"] and len(page.notes) == 1
    assert "Inversion" in page.notes[0] and "joint" in page.notes[0]
