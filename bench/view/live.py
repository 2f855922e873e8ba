"""Pictures a second of the page that computes, in a headless Chromium, and its steps beside native ones: docs/live.md.

    python bench/view/live.py [--scene two_links] [--seconds 10] [--shot page.png]

Needs the core in WebAssembly (./setup.sh live), Chromium and node. The page runs in real time and tells this program
what it found; Chromium draws in software here, so that a computer with a graphics card is faster.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from http.server import BaseHTTPRequestHandler, HTTPServer
from importlib import resources
from pathlib import Path
from typing import Any

import flexarm as fa
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from reporting import replace_table

PAGE = Path(__file__).parents[2] / "docs" / "live.md"
#: Times between pictures, and of each picture its computing and its drawing (ms), after a second to warm up.
PROBE = """<script>
window.addEventListener("error", (e) => { (window.wrong = window.wrong || []).push(e.message); });
setTimeout(() => {
  const between = [], computing = [], drawing = [];
  let last = performance.now();
  const timed = (work, into) => (...given) => { const t = performance.now(); work(...given); into.push(performance.now() - t); };
  compute = timed(compute, computing);
  drawPanes = timed(drawPanes, drawing);
  const each = (now) => { between.push(now - last); last = now; requestAnimationFrame(each); };
  requestAnimationFrame((now) => { last = now; requestAnimationFrame(each); });
  setTimeout(() => fetch("http://127.0.0.1:PORT/", { method: "POST", mode: "no-cors", body: JSON.stringify({
    between, computing, drawing, real, wrong: window.wrong || [], told: document.getElementById("told").textContent,
    software: slow, size: [innerWidth, innerHeight],
  }) }), 1000 * SECONDS);
}, 2000);
</script></body>"""
STEPS = """
const fs = require("fs"), { Core, Run, Numbers, unpacked } = require(process.argv[1]);
const live = JSON.parse(fs.readFileSync(0, "utf-8")).live;
(async () => {
  const core = await Core.load(await unpacked(live.core)), n = new Numbers(live.variants[0]), own = n.sliders.map((k) => live.sliders[k].value);
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


def found(page: Path, seconds: float, shot: Path | None) -> dict[str, Any]:
    """What the page tells after so many seconds in a headless Chromium."""
    told: list[Any] = []

    class Ear(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            told.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(200)
            self.end_headers()

        def log_message(self, *_: Any) -> None:
            pass

    server = HTTPServer(("127.0.0.1", 0), Ear)
    probe = PROBE.replace("PORT", str(server.server_port)).replace("SECONDS", str(seconds))
    page.write_text(page.read_text(encoding="utf-8").replace("</body>", probe), encoding="utf-8")
    threading.Thread(target=server.serve_forever, daemon=True).start()
    browser = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))))
    command = [browser, "--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--use-angle=swiftshader"]
    command += ["--enable-unsafe-swiftshader", "--hide-scrollbars", "--window-size=1280,800", "--mute-audio"]
    command += [f"--user-data-dir={page.parent / 'profile'}", "--remote-debugging-port=0", page.as_uri()]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as running:
        end = time.monotonic() + seconds + 60
        while not told and time.monotonic() < end:
            time.sleep(0.2)
        running.terminate()
    server.shutdown()
    if not told:
        raise SystemExit("the page told nothing")
    return dict(told[0])


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
        told = found(page, args.seconds, args.shot)
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
    between, computing, drawing = (np.array(told[k]) for k in ("between", "computing", "drawing"))
    rows = [
        f"| pictures a second, {told['size'][0]} x {told['size'][1]} pixels, drawn in software: {told['software']} "
        f"| {1000 / between.mean():.1f} |",
        f"| time between two pictures: median, 95 % below | {np.median(between):.1f}, {np.percentile(between, 95):.1f} ms |",
        f"| of each picture, computing: median | {np.median(computing):.2f} ms |",
        f"| of each picture, drawing: median | {np.median(drawing):.2f} ms |",
        f"| the arm's time by the clock's | {told['real']:.2f} |",
        f"| a step in WebAssembly, in node | {step:.1f} µs |",
        f"| a step of the native core | {1e6 * min(times):.1f} µs |",
        f"| flexarm.wasm, and packed in the page | {(core / 'flexarm.wasm').stat().st_size / 1e6:.2f} MB, "
        f"{len(json.loads(data[1])['live']['core']) / 1e6:.2f} MB |",
        f"| the page | {size / 1e6:.2f} MB |",
        f"| making the page, of a processor | {made:.1f} s |",
    ]
    print("\n".join(rows))
    print("errors:", told["wrong"], told["told"] or "none")
    if args.write:
        replace_table(PAGE, "bench/view/live.py", ["| two links | |", "|-|-|", *rows])


if __name__ == "__main__":
    main()
