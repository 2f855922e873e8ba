"""One HTML file that holds everything: three.js, our viewer, and the frames as 16-bit numbers."""

import base64
import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._check import Array
from . import stage
from .body import Body
from .meshes import thinned
from .track import Track

_FULL = 32_767
_TRIANGLES = 50_000  # of the meshes of one page: 0.9 MB


def library() -> str:
    """three.js with its controls and thick lines, out of the wheel jupyter-threejs-sage (MIT)."""
    try:
        import jupyter_threejs_sage
    except ImportError:
        raise ImportError(
            "a page needs three.js: pip install 'flexarm[view]'; .save('arm.png'), .gif and .mp4 do without"
        ) from None
    found = [p / "three.min.js" for p in (resources.files(jupyter_threejs_sage) / "static").iterdir() if p.is_dir()]
    newest = max((p for p in found if p.is_file()), key=lambda p: str(p))
    return newest.read_text(encoding="utf-8")


def _plain(value: Any) -> Any:
    """For JSON, seven digits."""
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, Mapping):
        return {k: _plain(v) for k, v in value.items()}
    return float(f"{value:.7g}") if isinstance(value, float) else value


def _scaled(x: Array) -> tuple[NDArray[np.int16], Array, Array]:
    """Rows of numbers as 16-bit ones, and their scaling: x = centre + scale n."""
    flat = x.reshape(-1, x.shape[-1]) if x.size else np.zeros((1, x.shape[-1]))
    low, high = flat.min(axis=0), flat.max(axis=0)
    centre, scale = (low + high) / 2, np.maximum((high - low) / 2, 1e-30) / _FULL
    return np.round((x - centre) / scale).astype("<i2"), centre, scale


def _meshes(body: Body, most: int) -> list[dict[str, Any]]:
    """Corners as 16-bit numbers, as frames are."""
    out = []
    for mesh in thinned(body.meshes, most):
        numbers, centre, scale = _scaled(mesh.vertices)
        wide = len(mesh.vertices) > 65_536
        faces = mesh.faces.astype("<u4" if wide else "<u2")
        out.append(
            {
                "node": mesh.node, "colour": mesh.colour, "centre": centre, "scale": scale, "wide": wide,
                "vertices": text(numbers), "faces": text(faces),
            }
        )  # fmt: skip
    return out


def text(numbers: NDArray[Any]) -> str:
    """The bytes of numbers, in base64."""
    return base64.b64encode(numbers.tobytes()).decode("ascii")


def drawn(body: Body, triangles: int = _TRIANGLES) -> dict[str, Any]:
    """The shapes of an arm, for drawing.js."""
    fields = ("beams", "solids", "bars", "axes", "labels", "loads", "tips", "size")
    frames = [i for i, (_, x) in enumerate(body.places) if x is None]
    shapes = {**{name: getattr(body, name) for name in fields}, "frames": frames, "meshes": _meshes(body, triangles)}
    return {k: _plain(x) for k, x in shapes.items()}


def _packed(columns: Mapping[str, Array]) -> dict[str, Any]:
    """16-bit numbers, a row for each frame, and their scaling."""
    rows, about = [], {}
    for name, x in columns.items():
        numbers, centre, scale = _scaled(x)
        about[name] = {"centre": centre.tolist(), "scale": scale.tolist(), "count": x.shape[1]}
        rows.append(numbers.reshape(len(x), -1))
    return {"columns": about, "frames": text(np.hstack(rows))}


def _track(track: Track, triangles: int) -> dict[str, Any]:
    names = ("position", "quaternion", "strain", "force", "moment")
    packed = _packed({name: getattr(track, name) for name in names})
    about = {"t": track.t.tolist(), "title": track.title, "error": track.error, "body": drawn(track.body, triangles)}
    return {**about, **packed}


def scenery(tracks: Sequence[Track]) -> dict[str, Any]:
    """What is common to all drawn frames: camera, colours and their scale."""
    most = stage.round_up(stage.greatest_strain(tracks))
    factor, unit = stage.strain_label(most)
    view = stage.camera(tracks)
    return {
        "camera": _plain({**asdict(view), "field": stage.FIELD, "grid": stage.grid_step(view.radius)}),
        "strain": {"most": most, "factor": factor, "unit": unit, "colours": stage.COLOURS.tolist()},
        "colours": stage.PART_COLOURS | stage.SYMBOL_COLOURS,
        "widths": stage.BARS,
    }


def data(tracks: Sequence[Track], options: Mapping[str, Any]) -> dict[str, Any]:
    """All data of the viewer."""
    largest = {
        name: max((float(np.linalg.norm(getattr(t, name), axis=-1).max(initial=0.0)) for t in tracks), default=0.0)
        for name in ("force", "moment")
    }
    shown = [_track(t, _TRIANGLES // len(tracks)) for t in tracks]
    return {"tracks": shown, **scenery(tracks), "largest": largest, **options}


def page(tracks: Sequence[Track], title: str, options: Mapping[str, Any]) -> str:
    """The whole file. Raises ImportError without three.js."""
    return assembled(title, data(tracks, options), ("view/viewer.css",), ("view/drawing.js", "view/viewer.js"))


def assembled(title: str, told: Mapping[str, Any], styles: Sequence[str], scripts: Sequence[str]) -> str:
    """A page with three.js, and what is told in #data; `styles` and `scripts` are files of the package.

    Raises:
        ImportError: without three.js.
    """
    folder = resources.files("flexarm")
    # a browser reads "</script" and "<!--" even within strings of a script
    content = json.dumps(told, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    parts = {
        "TITLE": html.escape(title),
        "STYLE": "".join(folder.joinpath(name).read_text(encoding="utf-8") for name in styles),
        "THREE": library(),
        "DATA": content,
        "SCRIPTS": "\n".join(folder.joinpath(name).read_text(encoding="utf-8") for name in scripts),
    }
    return "".join(parts.get(piece, piece) for piece in _PAGE.split("@@"))


_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>@@TITLE@@</title>
<style>
@@STYLE@@</style>
</head>
<body>
<script>@@THREE@@</script>
<script id="data" type="application/json">@@DATA@@</script>
<script>
@@SCRIPTS@@</script>
</body>
</html>
"""
