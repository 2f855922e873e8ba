"""The page in a real browser, headless, with graphics in software; only where Chromium or Chrome is installed."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import flexarm as fa
import numpy as np
import pytest

from tests.view.test_view import chain, swing

sys.path.insert(0, str(Path(__file__).parents[2] / "bench"))
from chromium import BROWSER

pytestmark = pytest.mark.skipif(BROWSER is None, reason="no Chromium")

#: Added to the page: what the viewer has at given times, and what it shows.
PROBE = """<script>
window.addEventListener("error", (e) => { document.title = "ERROR " + e.message; });
setTimeout(() => {
  const began = clock;
  const track = panes[0].track, found = TIMES.map((t) => { track.seek(t); return Array.from(track.now); });
  const shown = Array.from(document.querySelectorAll(".label"), (l) => l.textContent);
  const legend = document.getElementById("legend").innerText;
  const result = { found, clock: began, shown, start: track.start, legend };
  make("pre", null, { id: "probe", textContent: JSON.stringify(result) });
}, 900);
</script></body>"""


def browse(page: Path, *options: str) -> str:
    command = [BROWSER, "--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--use-angle=swiftshader"]
    command += ["--enable-unsafe-swiftshader", "--hide-scrollbars", "--window-size=1000,700", "--mute-audio"]
    command += [f"--user-data-dir={page.parent / 'profile'}", "--virtual-time-budget=2000", *options, page.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    return done.stdout


def test_a_page_plays_and_shows_what_python_says(tmp_path: Path) -> None:
    pytest.importorskip("jupyter_threejs_sage")
    view = swing(chain(10), np.linspace(0.0, 3.0, 601)).animate(titles=["ten links"])
    times = [0.0, 0.123, 1.7, 2.999]
    page = tmp_path / "probe.html"
    page.write_text(view.html().replace("</body>", PROBE.replace("TIMES", json.dumps(times))), encoding="utf-8")
    dom = browse(page, "--dump-dom")
    assert "<title>ERROR" not in dom
    told = re.search(r'<pre id="probe">(.*?)</pre>', dom, re.DOTALL)
    assert told, dom[-2000:]
    told = json.loads(told[1].replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&"))
    assert told["clock"] > 0.1  # it plays by itself
    assert told["shown"] == [f"link {k} revolute" for k in range(10)]
    assert "Surface strain" in told["legend"] and "path of the tip" in told["legend"]
    made = view.tracks[0]
    for t, values in zip(times, told["found"], strict=True):
        p, _, strain, *_ = made.at(t)
        n = len(p)
        for name, x in (("position", p), ("strain", strain)):
            start = told["start"][name]
            rounding = 5e-5 * np.ptp(getattr(made, name))
            assert np.allclose(np.reshape(values[start : start + 3 * n], (n, 3)), x, atol=rounding)


def test_a_narrow_page_keeps_its_boxes_and_buttons(tmp_path: Path) -> None:
    pytest.importorskip("jupyter_threejs_sage")
    page = tmp_path / "narrow.html"
    probe = """<script>setTimeout(() => {
      const seen = (e) => {
        const box = e.getBoundingClientRect(), at = document.elementFromPoint((box.left + box.right) / 2, box.top + box.height / 2);
        return at === e && box.left >= 0 && box.right <= innerWidth && box.bottom <= innerHeight;
      };
      const found = Array.from(document.querySelectorAll("button, select, input"), (e) => [e.id || e.parentNode.textContent, seen(e)]);
      make("pre", null, { id: "probe", textContent: JSON.stringify([innerWidth, found]) });
    }, 500);</script></body>"""  # noqa: E501
    page.write_text(swing(chain(2), np.linspace(0, 1, 20)).animate().html().replace("</body>", probe), encoding="utf-8")
    told = re.search(r'<pre id="probe">(.*?)</pre>', browse(page, "--window-size=500,800", "--dump-dom"), re.DOTALL)
    assert told
    width, found = json.loads(told[1])
    assert width <= 500 and len(found) >= 4 + 5  # what stands below the picture, and what chooses what is drawn
    assert not [name for name, seen in found if not seen]


def test_a_screenshot_shows_the_arm(tmp_path: Path) -> None:
    pytest.importorskip("jupyter_threejs_sage")
    from PIL import Image

    arm = fa.Arm(chain(2).links, (0, 0, -9.81))
    page, picture = tmp_path / "arm.html", tmp_path / "arm.png"
    arm.show([0.3, 0, 0, 0.02, 0, 0.4, 0, 0, 0.02, 0], open=False).save(page)
    browse(page, f"--screenshot={picture}")
    pixels = np.asarray(Image.open(picture).convert("RGB"), int)[:600, :760]  # without the legend
    blue, red = pixels[..., 2] - pixels[..., 0] > 60, pixels[..., 0] - pixels[..., 2] > 60
    assert blue.sum() > 100 and red.sum() > 100  # both sides of bent beams


def test_a_screenshot_shows_meshes(tmp_path: Path) -> None:
    """A red ball of a file at the end of a link, and a blue box at its base."""
    pytest.importorskip("jupyter_threejs_sage")
    trimesh = pytest.importorskip("trimesh")
    from PIL import Image

    trimesh.creation.icosphere(subdivisions=4, radius=100.0).export(tmp_path / "ball.stl")
    at = fa.Placement((0.5, 0, 0))
    looks = [
        fa.Look("mesh", [1e-3] * 3, file=tmp_path / "ball.stl", at=at, colour="#FF0000"),
        fa.Look("box", (0.2, 0.1, 0.1), on="base", colour="#0000FF"),
    ]
    arm = fa.Arm([fa.Link(fa.Revolute("z"), fa.RigidBody(1.0, (0.5, 0, 0)), looks=looks)])
    page, picture = tmp_path / "arm.html", tmp_path / "arm.png"
    arm.show([0.3], open=False).save(page)
    browse(page, f"--screenshot={picture}")
    pixels = np.asarray(Image.open(picture).convert("RGB"), int)[:600, :760]
    red, blue = pixels[..., 0] - pixels[..., 2] > 60, pixels[..., 2] - pixels[..., 0] > 60
    assert red.sum() > 2000 and blue.sum() > 500
