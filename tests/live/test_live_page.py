"""The page that computes, in a real browser; only where Chromium is installed, and the core in WebAssembly built."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any

import flexarm as fa
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "bench"))
from chromium import BROWSER, Chromium

BUILT = (resources.files("flexarm") / "live" / "flexarm.wasm").is_file()
pytestmark = pytest.mark.skipif(BROWSER is None or not BUILT, reason="needs Chromium, and ./setup.sh live")
READY = 'document.body && document.body.classList.contains("ready")'
#: Where the arm's end is in the window.
END = """(() => { arm.look(); const p = hand.end(0).project(camera), b = renderer.domElement.getBoundingClientRect();
  return [b.left + (p.x + 1) / 2 * b.width, b.top + (1 - p.y) / 2 * b.height]; })()"""
TOLD = 'document.getElementById("told").textContent'
LEFT = """Math.max(...plot.rows.flatMap((row) =>
  row.filter((_, k) => plot.times[k] > arm.clock - 0.5).map(Math.abs)))"""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("live") / "page.html"
    fa.live(fa.load("two_links")).save(file)
    return file


@pytest.fixture
def browser(page: Path) -> Iterator[Any]:
    with Chromium() as browser:
        browser.open(page, READY)
        yield browser
        assert not browser.errors


def slide(browser: Any, k: int, value: float) -> None:
    browser.run(f"""(() => {{ const input = document.querySelectorAll(".slider input")[{k}];
      input.value = {value}; input.dispatchEvent(new Event("input")); }})()""")


def compute(browser: Any, seconds: float) -> None:
    """Seconds of the arm, however slow this machine is."""
    each = "{ owed = 0; compute(0.0401); }"
    browser.run(f"(() => {{ setPlaying(false); for (let k = 0; k < {25 * seconds}; k++) {each} }})()")


def test_it_moves_and_names_its_sliders(browser: Any) -> None:
    labels = browser.run('Array.from(document.querySelectorAll(".slider"), (l) => l.innerText.replace(/\\s+/g, " "))')
    assert [label.strip() for label in labels] == [
        "gain kp 1 ×", "gain kv 1 ×", "payload 0.1 kg", "length of upper 0.6 m", "length of fore 0.5 m",
        "stiffness of beams 1 ×",
    ]  # fmt: skip
    before = browser.run("Array.from(arm.run.q)")
    compute(browser, 0.4)
    assert abs(browser.run("arm.run.q[0]") - before[0]) > 0.1
    assert browser.run("plot.times.length") > 10 and browser.run(TOLD) == ""
    browser.run('document.getElementById("reset").click()')
    assert browser.run("plot.times.length") < 20 and abs(browser.run("arm.run.q[0]") + 0.6) < 0.1


def test_the_end_is_pulled_and_let_go(browser: Any) -> None:
    compute(browser, 2.4)  # it rests
    rest = browser.run(LEFT)
    x, y = browser.run(END)
    browser.mouse("mouseMoved", x, y)
    browser.mouse("mousePressed", x, y)
    browser.mouse("mouseMoved", x - 60, y + 60)
    assert browser.run("hand.tip") == 0
    browser.run("(() => { owed = 0; for (let k = 0; k < 5; k++) compute(0.0401); drawPanes(); hand.show(); })()")
    assert browser.run("hand.force") > 0.5 and browser.run("hand.text.textContent").endswith(" N")
    assert browser.run(LEFT) > 3 * rest
    browser.mouse("mouseReleased", x - 60, y + 60)
    assert browser.run("hand.tip") == -1
    eye = browser.run("camera.position.toArray()")
    browser.mouse("mousePressed", 100, 100)
    browser.mouse("mouseMoved", 160, 140)
    browser.mouse("mouseReleased", 160, 140)
    browser.wait(0.5)
    assert browser.run("camera.position.toArray()") != eye  # beside the arm it turns the view


def test_sliders_and_buttons_go_on_from_where_the_arm_is(browser: Any) -> None:
    compute(browser, 0.3)
    q, t = browser.run("Array.from(arm.run.q)"), browser.run("arm.run.t")
    slide(browser, 2, 0.3)
    slide(browser, 4, 0)
    assert browser.run("arm.scene.document.arm.links[1].tip.mass") == 0.3
    assert browser.run("arm.scene.document.arm.links[1].beam.length") == 0.3
    browser.run('document.querySelectorAll("#choice button")[2].click()')
    assert browser.run("live.variants[arm.choice].name") == "Inversion"
    assert browser.run("Array.from(arm.run.q)") == q and abs(browser.run("arm.run.t") - t) < 1e-12
    compute(browser, 6)  # past the scene's end
    assert browser.run(TOLD) == "" and browser.run("arm.run.t") < 6 < browser.run("arm.clock")


def test_inversion_leaves_less_than_the_shaper_and_that_less_than_the_move(browser: Any) -> None:
    left = []
    for k in range(3):
        browser.run(f'document.querySelectorAll("#choice button")[{k}].click()')
        browser.run('document.getElementById("reset").click()')
        compute(browser, 2)
        left.append(browser.run(LEFT))
    assert left[2] < 0.2 * left[1] < 0.2 * 0.5 * left[0]


def test_what_goes_wrong_is_told(browser: Any) -> None:
    browser.run("arm.run.advance = () => arm.core.c.flexarm_advance(arm.run.arm, -1) < 0 && arm.core.fail()")
    browser.run("compute(0.05)")
    assert "until" in browser.run(TOLD) and not browser.run("playing")
    browser.run('document.getElementById("reset").click()')
    assert browser.run(TOLD) == "" and browser.run("playing")


def test_on_a_phone_all_is_there(page: Path) -> None:
    with Chromium((390, 800)) as browser:
        browser.open(page, READY)
        seen = browser.run("""Array.from(document.querySelectorAll(
          "#choice button, .slider input, #controls button, #plot, #stage canvas"), (e) => {
          const b = e.getBoundingClientRect();
          return b.left >= 0 && b.right <= innerWidth && b.top >= 0 && b.width > 20;
        })""")
        assert len(seen) == 3 + 6 + 3 + 2 and all(seen)
        assert browser.run("document.documentElement.scrollWidth") <= 390
        assert not browser.errors
