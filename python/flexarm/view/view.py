"""Views: an arm in 3-D, still or in motion, as a page for a browser or a notebook, a picture, or a film."""

import html
import os
import sys
import tempfile
import webbrowser
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._check import Array, array, named, positive, within
from .._console import complain, progress_bar
from ..data.draw.style import Figure
from ..data.store.files import write_whole
from ..model.acting.load import Load
from ..model.parts.chain import Chain
from . import page
from .still import Still
from .track import Track, make_track

_DPI = 100


class View:
    """The arm in 3-D, over time if it moves, of `arm.show`, `result.animate` and `modes.animate`.

    In a notebook it shows itself. Elsewhere `.open()` shows it in the browser, and `.save(path)` writes it: as a page
    (.html: one file, which needs no network), a picture (.png) or a film (.gif, .mp4).

    Sections, hubs and tips are to scale: a rigid body is drawn as the uniform box of its mass and inertia, a point mass
    as a ball of steel, a section that is given by integrals or matrices as the rectangle of the same radii of gyration.
    Joints, axes and loads are symbols. Colours are the strain along the beam at its surface, eps - y K3 + z K2, red
    where it is stretched; they are never magnified.

    Attributes:
        tracks: the arms shown side by side. magnify: the factor of the elastic coordinates; None for a mode.
        speed: of playing; 1 is real time. cycle: whether it plays in a loop. notes: lines of text in the picture.
        steady: whether a picture shows all that the arm can reach, not only its present place. strain_scale: the
            least strain at the ends of a picture's colour scale.
    """

    def __init__(
        self, tracks: Sequence[Track], magnify: float | None, *, speed: float = 1.0, cycle: bool = False,
        notes: Sequence[str] = (), steady: bool = False, strain_scale: float = 0.0
    ) -> None:  # fmt: skip
        self.tracks, self.magnify, self.speed, self.cycle = list(tracks), magnify, speed, cycle
        self.steady, self.strain_scale = steady, strain_scale
        self._still: Still | None = None
        self.notes = list(notes)
        if magnify is not None and any(track.strain.any() for track in tracks):
            self.notes.insert(0, "bending to scale" if magnify == 1 else f"bending magnified {magnify:g} times")
        error = max(t.error for t in tracks)
        if error > 1e-3 * max(t.body.size for t in tracks):
            self.notes.append(f"between frames up to {error:.2g} m off")

    def __repr__(self) -> str:
        frames = max(len(t.t) for t in self.tracks)
        content = "1 picture" if frames == 1 else f"{frames} frames, t = {self.times[0]:g} to {self.times[1]:g} s"
        return f"View({content}; .open() shows it in a browser, .save('arm.html'), '.png', '.gif' or '.mp4' writes it)"

    @property
    def times(self) -> tuple[float, float]:
        """First and last time (s)."""
        return float(min(t.t[0] for t in self.tracks)), float(max(t.t[-1] for t in self.tracks))

    def html(self) -> str:
        """The page as one HTML file. Raises ImportError without `pip install 'flexarm[view]'`."""
        options = {"speed": self.speed, "cycle": self.cycle, "notes": self.notes}
        title = ", ".join(t.title for t in self.tracks if t.title) or "flexarm"
        return page.page(self.tracks, title, options)

    def _repr_html_(self) -> str:
        return framed(self.html(), 520)

    def open(self) -> Path:
        """Shows the page in the browser, and returns its path; without a browser the path is also printed on stderr."""
        return browse(self.html(), "view.html")

    def figure(self, t: float | None = None, size: Sequence[float] = (9.0, 6.0)) -> Figure:
        """A matplotlib figure at time t (s; None: the first time), size in inches."""
        self._check_time(t)
        return self._drawn(size).draw(self.times[0] if t is None else float(t))

    def image(self, t: float | None = None, size: Sequence[float] = (6.4, 4.8)) -> NDArray[np.uint8]:
        """The same as pixels, (height, width, 3), 100 to an inch."""
        return _pixels(self.figure(t, size))

    def _drawn(self, size: Sequence[float]) -> Still:
        width, height = array("size", size, (2,)).tolist()
        if not (1 <= width <= 100 and 1 <= height <= 100):
            raise ValueError(f"size = {tuple(size)}: must be from 1 to 100 inches")
        if self._still is None or tuple(self._still.figure.get_size_inches()) != (width, height):
            self._still = Still(self.tracks, self.notes, (width, height), self.steady, self.strain_scale)
        return self._still

    def _check_time(self, t: Any) -> None:
        if t is None:
            return
        within("t", t, *self.times, " s, the times of this view")

    def save(
        self, path: str | Path, *, t: float | None = None, fps: float = 30.0, size: Sequence[float] = (9.0, 6.0),
        progress: Any = False,
    ) -> None:  # fmt: skip
        """Writes a file, in the format of its suffix.

        Args:
            path: .html (or none): a page for a browser; .png: a picture; .gif or .mp4: a film at the view's speed.
            t: of a picture, its time (s); None: the first.
            fps: of a film, pictures in a second, from 1 to 100; of a .gif to 50, the most that browsers show.
            size: of a picture or a film (inches, 100 pixels each; a .png has 200).
            progress: of a film, shows a bar on stderr, or lines where that is no terminal; or a callable, which is
                given the share of the pictures that is drawn.

        Raises:
            ValueError: another suffix, a time outside the view, or a path that cannot be written; .mp4 without ffmpeg.
            ImportError: .html without `pip install 'flexarm[view]'`.
        """
        file = named(path, ".html", ".htm", ".png", ".gif", ".mp4")
        kind = file.suffix.lower()
        self._check_time(t)
        if kind in (".gif", ".mp4"):
            with progress_bar(progress, "drawing the film") as look:
                self._film(file, kind, fps, size, look)
            return
        if kind == ".png":
            figure = self.figure(t, size)
            write_whole(file, lambda f: figure.savefig(f, format="png", dpi=2 * _DPI), "path")
            return
        content = self.html().encode()
        write_whole(file, lambda f: f.write(content), "path")

    def _film(self, file: Path, kind: str, fps: Any, size: Sequence[float], look: Any) -> None:
        rate = float(within("fps", fps, 1, 50 if kind == ".gif" else 100, f" of {kind}"))
        low, high = self.times
        count = max(round((high - low) / self.speed * rate), 1)
        if count > 20_000:
            raise ValueError(f"fps = {fps:g}: makes {count} pictures; up to 20000 fit: set the view's speed higher")
        times = low + (high - low) * np.arange(count + (not self.cycle)) / count
        still = self._drawn(size)

        def pictures() -> Iterator[NDArray[np.uint8]]:
            for k, s in enumerate(times):
                if look:
                    look(k / len(times))
                yield _pixels(still.draw(float(s)))

        (_gif if kind == ".gif" else _mp4)(file, pictures(), rate)


def framed(page: str, height: int) -> str:
    """A page within a notebook's, so high (pixels)."""
    return (
        f'<iframe srcdoc="{html.escape(page)}" width="100%" height="{height}" '
        'style="display: block; box-sizing: border-box; border: 1px solid #ddd"></iframe>'
    )


def browse(page: str, name: str) -> Path:
    """Shows a page in the browser, and returns its path, of a file of this name; without a browser it is also told."""
    file = Path(tempfile.mkdtemp(prefix="flexarm-")) / name
    file.write_text(page, encoding="utf-8")
    if not (_has_display() and webbrowser.open(file.as_uri())):
        complain(f"no browser was found; the page is in {file}")
    return file


def _has_display() -> bool:
    """Whether a display is present; without one, Linux would open a browser for the terminal."""
    names = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER", "WSL_DISTRO_NAME")
    return not sys.platform.startswith("linux") or any(os.environ.get(name) for name in names)


def _pixels(figure: Figure) -> NDArray[np.uint8]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure.set_dpi(_DPI)
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _gif(file: Path, pictures: Any, rate: float) -> None:
    from PIL import Image

    rare = {"method": Image.Quantize.MAXCOVERAGE, "dither": Image.Dither.NONE}  # keeps rare colours, as of arrows
    frames = [Image.fromarray(p).quantize(256, **rare) for p in pictures]  # type: ignore[arg-type]
    ends = np.round(100 / rate * np.arange(len(frames) + 1))  # a GIF counts in hundredths of a second
    options: dict[str, Any] = {"save_all": True, "append_images": frames[1:], "loop": 0, "optimize": False}
    options["duration"] = (10 * np.diff(ends)).astype(int).tolist()
    write_whole(file, lambda f: frames[0].save(f, format="GIF", **options), "path")


def _mp4(file: Path, pictures: Any, rate: float) -> None:
    import shutil
    import subprocess

    tool = shutil.which("ffmpeg")
    if tool is None:
        raise ValueError(f"path = {str(file)!r}: .mp4 needs the program ffmpeg, which is not here; .gif does without")
    with tempfile.TemporaryDirectory(prefix="flexarm-") as folder:
        film = Path(folder) / "film.mp4"
        first = next(pictures)
        height, width = first.shape[:2]
        command = [tool, "-loglevel", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}"]
        command += ["-r", f"{rate:g}", "-i", "-", "-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p"]
        command.append(str(film))
        with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as p:
            assert p.stdin is not None and p.stderr is not None
            try:
                p.stdin.write(first.tobytes())
                for picture in pictures:
                    p.stdin.write(picture.tobytes())
                p.stdin.close()
            except BrokenPipeError:
                pass
            error = p.stderr.read().decode(errors="replace").strip()
        if p.returncode or not film.exists():
            raise ValueError(f"path = {str(file)!r}: ffmpeg failed: {error[-300:]}")
        content = film.read_bytes()
    write_whole(file, lambda f: f.write(content), "path")


# -- functions called by methods -------------------------------------------------------------------------------------


def show(
    arm: Chain, q: Array, magnify: float, loads: Sequence[Load] = (), t: float = 0.0, title: str = "",
    marks: Sequence[Any] = (), **options: Any
) -> View:  # fmt: skip
    """See Arm.show; q (nq,). Marks are positions in world axes (m), shown as small balls. Options are those of View."""
    magnify = positive("magnify", magnify, "1 is to scale")
    track = make_track(arm, np.array([t]), q[None], loads=loads, magnify=magnify, title=title)
    for place in marks:
        track.body.solid("goal", 0, "ball", np.array(place), np.eye(3), [0.02 * track.body.size])
    return View([track], magnify, **options)


def animate(
    runs: Sequence[tuple[Chain, Array, Array, Sequence[Load] | None]],
    magnify: float,
    speed: float,
    titles: Sequence[str],
) -> View:
    """See Result.animate; runs of (arm, t, q, loads), with loads None if unknown."""
    magnify, rate = positive("magnify", magnify, "1 is to scale"), positive("speed", speed, "1 is real time")
    tracks = []
    for (arm, t, q, loads), title in zip(runs, titles, strict=True):
        t, q = array("t", t), array("q", q)
        if not len(t):
            raise ValueError("result: has no rows, so there is nothing to show")
        if t.ndim != 1 or q.shape != (len(t), arm.nq) or (np.diff(t) < 0).any():
            raise ValueError(f"result: has t {t.shape} and q {q.shape}: t must increase, and q be ({len(t)}, {arm.nq})")
        tracks.append(make_track(arm, t, q, loads=loads or (), magnify=magnify, title=title, share=1 / len(runs)))
    lost = ["without its loads, which the file does not keep"] if any(run[3] is None for run in runs) else []
    return View(tracks, magnify, speed=rate, notes=lost)


def animate_mode(
    arm: Chain, q0: Array, shape: NDArray[Any], frequency: float, damping: float, k: int, reach: float
) -> View:
    """See Modes.animate; `shape` (nv,) at the displayed scale, `reach` its largest displacement (m)."""
    turn = np.linspace(0.0, 2 * np.pi, 49)
    _, _, E = arm._core.rates(q0, np.zeros(arm.nv))  # dq = E v
    q = q0 + np.real(np.exp(1j * turn)[:, None] * shape) @ E.T
    for _, at in arm.quaternions():
        q[:, at] /= np.linalg.norm(q[:, at], axis=1, keepdims=True)
    period = 2 * np.pi / frequency if frequency > 0 else 1.0
    if frequency > 0:
        title = f"mode {k}: {frequency / (2 * np.pi):.4g} Hz, damping ratio {damping:.3g}"
    else:
        title = f"mode {k}: a motion without frequency"
    track = make_track(arm, period * turn / (2 * np.pi), q, title=title)
    notes = [f"largest displacement {reach:.3g} m, chosen for the picture: a mode has no size of its own"]
    speed = float(f"{period / 2:.2g}")
    return View([track], None, speed=speed, cycle=True, notes=notes)


def in_notebook() -> bool:
    """Whether this runs in a notebook, which displays the value of a cell."""
    ipython = sys.modules.get("IPython")
    kinds = () if ipython is None else type(ipython.get_ipython()).__mro__
    return any(kind.__name__ == "ZMQInteractiveShell" for kind in kinds)
