"""A headless Chromium that is told what to do through a pipe, by the DevTools protocol: pages in real time."""

from __future__ import annotations

import base64
import contextlib
import json
import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


class Chromium:
    """One page, in software graphics; as a context. `errors` are those of its scripts.

    Args:
        size: of the window (pixels).
    """

    def __init__(self, size: tuple[int, int] = (1280, 800)) -> None:
        self.size, self.errors = size, list[str]()

    def __enter__(self) -> Chromium:
        assert BROWSER
        self._folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        theirs_in, self._write = os.pipe()
        self._read, theirs_out = os.pipe()
        command = [BROWSER, "--headless=new", "--no-sandbox", "--disable-dev-shm-usage"]
        command += ["--enable-unsafe-swiftshader", "--hide-scrollbars", "--mute-audio", "--remote-debugging-pipe"]
        command += [f"--window-size={self.size[0]},{self.size[1]}", f"--user-data-dir={self._folder.name}"]
        # Chromium reads from descriptor 3 and writes to 4
        shell = f'exec 3<&{theirs_in} 4>&{theirs_out}; exec "$@"'
        self._process = subprocess.Popen(
            ["bash", "-c", shell, "_", *command, "about:blank"], pass_fds=(theirs_in, theirs_out),
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(theirs_in)
        os.close(theirs_out)
        self._count, self._left, self._session = 0, b"", None
        pages = self.call("Target.getTargets")["targetInfos"]
        page = next(p["targetId"] for p in pages if p["type"] == "page")
        self._session = self.call("Target.attachToTarget", targetId=page, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime"):
            self.call(f"{domain}.enable")
        wide, high = self.size
        self.call("Emulation.setDeviceMetricsOverride", width=wide, height=high, deviceScaleFactor=1, mobile=False)
        return self

    def __exit__(self, *_: Any) -> None:
        self._process.terminate()
        self._process.wait(timeout=30)
        os.close(self._write)
        os.close(self._read)
        self._folder.cleanup()

    def _message(self) -> Any:
        while b"\0" not in self._left:
            more = os.read(self._read, 1 << 20)
            if not more:
                raise RuntimeError("Chromium has ended")
            self._left += more
        one, _, self._left = self._left.partition(b"\0")
        return json.loads(one)

    def call(self, method: str, **given: Any) -> Any:
        """A method of the protocol, and its result."""
        self._count += 1
        about = {"id": self._count, "method": method, "params": given}
        if self._session:
            about["sessionId"] = self._session
        os.write(self._write, json.dumps(about).encode() + b"\0")
        while True:
            told = self._message()
            if told.get("method") == "Runtime.exceptionThrown":
                self.errors.append(json.dumps(told["params"]["exceptionDetails"])[:500])
            if told.get("method") == "Runtime.consoleAPICalled" and told["params"]["type"] == "error":
                self.errors.append(json.dumps(told["params"]["args"])[:500])
            if told.get("id") == self._count:
                if "error" in told:
                    raise RuntimeError(f"{method}: {told['error']}")
                return told["result"]

    def open(self, page: Path, ready: str) -> None:
        """A page, until an expression is true there."""
        self.call("Page.navigate", url=page.absolute().as_uri())
        self.run(f"""new Promise((done, failed) => {{
          const again = (left) => left ? setTimeout(look, 100, left - 1) : failed(new Error("is not ready"));
          const look = (left) => ({ready}) ? done(true) : again(left);
          look(600);
        }})""")

    def run(self, script: str) -> Any:
        """The value of an expression; a promise is awaited."""
        told = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in told:
            raise RuntimeError(json.dumps(told["exceptionDetails"])[:1000])
        return told["result"].get("value")

    def wait(self, seconds: float) -> None:
        self.run(f"new Promise((done) => setTimeout(done, {1000 * seconds}))")

    def mouse(self, kind: str, x: float, y: float) -> None:
        """One of "mousePressed", "mouseMoved" or "mouseReleased", with the left button."""
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)

    def processor(self) -> float:
        """Time of processors that all of its processes have taken (s); of Linux."""
        found: dict[int, tuple[int, int]] = {}
        for one in Path("/proc").glob("[0-9]*/stat"):
            with contextlib.suppress(OSError):
                words = one.read_text().rpartition(")")[2].split()
                found[int(one.parent.name)] = int(words[1]), int(words[11]) + int(words[12])
        mine = {self._process.pid}
        for _ in found:
            more = {k for k, (parent, _) in found.items() if parent in mine} - mine
            if not more:
                break
            mine |= more
        return sum(found[k][1] for k in mine if k in found) / os.sysconf("SC_CLK_TCK")

    def picture(self, file: Path) -> None:
        """What it shows, as a .png."""
        file.write_bytes(base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"]))
