"""Pictures a second of the page that computes, in a headless Chromium, and its steps beside native ones: docs/live.md.

    python bench/view/live.py [--scene two_links] [--seconds 10] [--write] [--shot docs/figures/live.png]

Needs the core in WebAssembly (./setup.sh live), Chromium and node. Chromium draws in software here: a computer with a
graphics card takes less time of its processor.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
import time
from importlib import resources
from pathlib import Path

import flexarm as fa
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from chromium import Chromium
from reporting import replace_table

PAGE = Path(__file__).parents[2] / "docs" / "live.md"
READY = 'document.body && document.body.classList.contains("ready")'
#: Times between pictures (ms).
WATCH = """new Promise((done) => {
  const between = [];
  let last = null;
  const each = (now) => {
    if (last !== null) between.push(now - last);
    last = now;
    if (between.length < COUNT) requestAnimationFrame(each); else done(between);
  };
  requestAnimationFrame(each);
})"""
#: So many pictures, each a sixtieth of a second later, as fast as can be.
DRAWN = """(() => {
  setPlaying(false);
  const gl = renderer.getContext();
  for (let k = 0; k < COUNT; k++) {
    WORK
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4)); // waits until it is drawn
  }
  setPlaying(true);
})()"""
STEPS = """
const fs = require("fs"), { Core, Run, Numbers, unpacked } = require(process.argv[1]);
const live = JSON.parse(fs.readFileSync(0, "utf-8")).live;
(async () => {
  const core = await Core.load(await unpacked(live.core)), n = new Numbers(live.variants[0]);
  const own = n.sliders.map((k) => live.sliders[k].value);
  const { t, q0, v0 } = n.document, json = n.json(own, own), times = [];
  for (let k = 0; k < 5; k++) {
    const run = new Run(core, json, { t: t[0], q: q0, v: v0 }), begun = process.cpuUsage();
    for (let i = 0; i < 4000; i++) run.step();
    times.push(process.cpuUsage(begun).user / 4000);
    run.free();
  }
  console.log(Math.min(...times));
})();
"""


def of_processor(browser: Chromium, work: str, count: int = 300) -> float:
    """Time of processors for a picture (ms)."""
    begun = browser.processor()
    browser.run(DRAWN.replace("COUNT", str(count)).replace("WORK", work))
    return 1000 * (browser.processor() - begun) / count


def shoot(live: fa.results.Live, file: Path) -> None:
    """A picture of the page: the arm has moved there, and is pulled."""
    with tempfile.TemporaryDirectory() as folder, Chromium((1100, 680)) as browser:
        page = Path(folder) / "page.html"
        live.save(page)
        browser.open(page, READY)
        go = "(() => { setPlaying(false); for (let k = 0; k < COUNT; k++) { owed = 0; compute(0.0401); } LOOK })()"
        go = go.replace("LOOK", "hand.show(); drawPanes(); plot.draw();")
        browser.run(go.replace("COUNT", "60"))
        x, y = browser.run("""(() => {
          const p = hand.end(0).project(camera), b = renderer.domElement.getBoundingClientRect();
          return [b.left + (p.x + 1) / 2 * b.width, b.top + (1 - p.y) / 2 * b.height]; })()""")
        browser.mouse("mouseMoved", x, y)
        browser.mouse("mousePressed", x, y)
        browser.mouse("mouseMoved", x + 150, y + 20)
        browser.run(go.replace("COUNT", "14"))
        browser.run('document.getElementById("clock").textContent = `${arm.clock.toFixed(2)} s`')
        browser.wait(0.5)
        browser.picture(file)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", default="two_links")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--shot", type=Path)
    parser.add_argument("--write", action="store_true", help="into docs/live.md")
    args = parser.parse_args()
    scene = fa.load(args.scene)
    begun = time.process_time()
    live = fa.live(scene)
    made = time.process_time() - begun
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "page.html"
        live.save(page)
        size = page.stat().st_size
        data = re.search(r'<script id="data" type="application/json">(.*?)</script>', page.read_text(encoding="utf-8"))
        assert data
        with Chromium() as browser:
            browser.open(page, READY)
            browser.wait(3)
            between = np.array(browser.run(WATCH.replace("COUNT", str(round(60 * args.seconds)))))
            real = browser.run("real")
            whole = of_processor(browser, "compute(1 / 60); hand.show(); drawPanes(); plot.draw();")
            computed = of_processor(browser, "compute(1 / 60);")
            wrong = [*browser.errors, browser.run('document.getElementById("told").textContent')]
    core = resources.files("flexarm") / "live"
    step = float(subprocess.run(["node", "-e", STEPS, str(core / "core.js")], input=data[1], capture_output=True,
                                text=True, check=True).stdout)  # fmt: skip
    first = next(iter(live.scenes.values()))
    times = []
    for _ in range(5):
        run = fa.Simulation(first, first.options["integrator"])
        begun = time.process_time()
        run.step(until=run.t + 4.0)
        times.append((time.process_time() - begun) / run.steps)
    spread = np.percentile(between, [50, 95])
    rows = [
        f"| pictures a second, 1280 x 800 pixels | {1000 / between.mean():.1f} |",
        f"| time between two pictures: median, 95 % below | {', '.join(f'{x:.1f}' for x in spread)} ms |",
        f"| the arm's time by the clock's | {real:.2f} |",
        f"| of processors for a picture, with its steps; for the steps alone | {whole:.1f}, {computed:.1f} ms |",
        f"| a step in WebAssembly, in node | {step:.1f} µs |",
        f"| a step of the native core | {1e6 * min(times):.1f} µs |",
        f"| flexarm.wasm, and packed in the page | {(core / 'flexarm.wasm').stat().st_size / 1e6:.2f} MB, "
        f"{len(json.loads(data[1])['live']['core']) / 1e6:.2f} MB |",
        f"| the page | {size / 1e6:.2f} MB |",
        f"| making the page, of a processor | {made:.1f} s |",
    ]
    print("\n".join(rows))
    if args.shot:
        shoot(live, args.shot)
    print("errors:", *wrong)
    if args.write:
        replace_table(PAGE, "bench/view/live.py", "\n".join(["| two links | |", "|-|-|", *rows]))


if __name__ == "__main__":
    main()
