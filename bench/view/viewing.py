"""The pictures and numbers of docs/viewing.md: three links that swing a payload; the size of pages, the time of frames.

    python bench/view/viewing.py [--browser]

Writes docs/figures/viewing.png (matplotlib). With --browser, where Chromium is installed, it also writes
docs/figures/viewing-page.png, and prints how long a frame of ten links takes there, and how many a second has.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import threading
import time
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import flexarm as fa
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from chromium import BROWSER

FIGURES = Path(__file__).parents[2] / "docs" / "figures"
ALUMINIUM = fa.Material(2700, 70e9, 0.33)
BENDING = {"bending_y": 3, "bending_z": 3}
PROBE = """<script>setTimeout(() => {
  let frames = 0, began = performance.now();
  const count = () => { if (++frames < 120) return requestAnimationFrame(count);
    const rate = 1000 * frames / (performance.now() - began), a = performance.now();
    for (let k = 0; k < 200; k++) panes[0].update(last * k / 200);
    const b = performance.now();
    fetch("/told", { method: "POST", body: `${((b - a) / 200).toFixed(2)} ms for a frame without graphics, ` +
      `${rate.toFixed(0)} frames/s with graphics in software` }); };
  count();
}, 1000);</script></body>"""


def crane() -> fa.Result:
    """Three links in space with a payload, and a quick move of theirs."""
    hub = fa.RigidBody(1.0, (0.0, 0, 0.04), (7e-4, 7e-4, 9e-4), (0, 0, 0.1))
    upper = fa.Beam(0.5, fa.Rectangle(0.03, 0.006), ALUMINIUM, {**BENDING, "torsion": 1}, "legendre")
    lower = fa.Beam(0.4, fa.Tube(0.008, 0.001), ALUMINIUM, BENDING, "legendre")
    shoulder = fa.RigidBody(0.3, inertia=(6e-5, 6e-5, 6e-5), end=(0.03, 0, 0))
    elbow = fa.RigidBody(0.2, inertia=(4e-5, 4e-5, 4e-5), end=(0.02, 0, 0))
    links = [
        fa.Link(fa.Revolute("z"), hub),
        fa.Link(fa.Revolute("y"), shoulder, upper),
        fa.Link(fa.Revolute("y"), elbow, lower, fa.RigidBody(0.4)),
    ]
    arm = fa.Arm(links, (0, 0, -9.81))
    moves = {0: (0.0, 1.6), 1: (-0.9, -0.4), 2: (1.3, 0.5)}
    start = arm.zero
    for link, (a, _) in moves.items():
        start[arm.coordinate_of(arm.joint_rate(link))] = a
    q0 = arm.equilibrium(start, lock=moves)
    drive = {k: fa.Motion([0, 0.5, 2], [a, b, b], [0, 0, 0], [0, 0, 0]) for k, (a, b) in moves.items()}
    return fa.simulate(arm, np.linspace(0, 2, 1001), q0, drive=drive)


def ten() -> fa.Result:
    """Ten links that fall for ten seconds, damped."""
    beam = fa.Beam(0.2, fa.Tube(0.008, 0.001), ALUMINIUM, BENDING, "legendre", kelvin_voigt=1e-3)
    links = [fa.Link(fa.Revolute("yz"[k % 2], damping=0.02), beam=beam) for k in range(10)]
    arm = fa.Arm(links, (0, 0, -9.81))
    return fa.simulate(arm, np.linspace(0, 10, 2001), integrator="implicit", step=2e-3)


def browser() -> list[str] | None:
    flags = "--headless=new --no-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader --hide-scrollbars"
    return None if BROWSER is None else [BROWSER, *flags.split(), "--window-size=1000,640"]


def measure(page: str, command: list[str], folder: str) -> str:
    """What the page itself measures, which it tells a server here."""
    told: list[str] = []

    class Server(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(page.replace("</body>", PROBE).encode())

        def do_POST(self) -> None:
            told.append(self.rfile.read(int(self.headers["Content-Length"])).decode())
            self.send_response(204)
            self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    server = HTTPServer(("127.0.0.1", 0), Server)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    url = f"http://127.0.0.1:{server.server_port}/"
    with subprocess.Popen([*command, f"--user-data-dir={folder}/p", url], stderr=subprocess.DEVNULL) as process:
        for _ in range(600):
            time.sleep(0.1)
            if told:
                break
        process.terminate()
    server.shutdown()
    return told[0] if told else "the browser told nothing"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else None)
    parser.add_argument("--browser", action="store_true", help="also what needs Chromium")
    args = parser.parse_args()
    view = crane().animate(magnify=3, titles=["a payload is swung round"])
    view.save(FIGURES / "viewing.png", t=0.42)
    began = time.perf_counter()
    many = ten().animate()
    made = time.perf_counter() - began
    page = many.html()
    print(f"ten links, 10 s: {len(page.encode()) / 1e6:.2f} MB, {len(many.tracks[0].t)} frames, "
          f"off by {1e3 * many.tracks[0].error:.2g} mm at most, simulated and made in {made:.1f} s")  # fmt: skip
    command = browser()
    if not args.browser or command is None:
        return
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        print(measure(page, command, folder))
        view.save(f"{folder}/view.html")
        shot = [f"--user-data-dir={folder}/q", "--virtual-time-budget=950"]
        shot.append(f"--screenshot={FIGURES / 'viewing-page.png'}")
        subprocess.run([*command, *shot, f"file://{folder}/view.html"], stderr=subprocess.DEVNULL, check=True)


if __name__ == "__main__":
    main()
