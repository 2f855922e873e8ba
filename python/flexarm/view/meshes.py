"""Meshes of files, as triangles in the axes of a link, simplified for a picture or a page."""

import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._check import Array
from ..model.parts.look import Look

LOOK_COLOUR = "#9AA3AE"  # of a mesh without a colour
Triangles = NDArray[np.int64]


@dataclass
class Mesh:
    """Triangles that move with a node: corners (m), (n, 3), numbers of corners (k, 3), and a colour."""

    node: int
    vertices: Array
    faces: Triangles
    colour: str


def meshes_of(look: Look, node: int, at: Array, axes: Array) -> list[Mesh]:
    """A mesh's parts, one for each of its colours, placed in a node by `axes` and `at`. An empty list if it cannot be
    read, with a warning that names the file.

    Warns:
        UserWarning: no such file, one that cannot be read, or no trimesh.
    """
    file = str(look.file)
    try:
        parts = _read(file, os.stat(file).st_mtime_ns)
    except ImportError as e:
        missing = "pycollada" if "ollada" in str(e) else "trimesh"
        _warn(f"meshes are not drawn: {missing} is missing; pip install 'flexarm[view]'")
        return []
    except OSError as e:
        _warn(f"the mesh {file} is not drawn: {e.strerror or e}")
        return []
    except Exception as e:  # trimesh's readers raise many kinds
        _warn(f"the mesh {file} is not drawn: {' '.join(str(e).split()) or repr(e)}")
        return []
    factors = np.array(look.size)
    return [
        Mesh(node, (vertices * factors) @ axes.T + at, faces, look.colour or colour)
        for vertices, faces, colour in parts
    ]


def _warn(text: str) -> None:
    warnings.warn(text, UserWarning, stacklevel=2)


@lru_cache(maxsize=128)
def _read(file: str, _: int) -> list[tuple[Array, Triangles, str]]:
    """Corners (m), triangles and colour of each part of a file."""
    import trimesh

    scene: Any = trimesh.load(file, force="scene", process=False)
    out: dict[str, list[tuple[Array, Triangles]]] = {}
    for part in scene.dump():
        faces = getattr(part, "faces", None)
        if faces is not None and len(faces):
            pair = np.asarray(part.vertices, dtype=float), np.asarray(faces, dtype=np.int64)
            out.setdefault(_colour(part), []).append(pair)
    if not out:
        raise ValueError("it holds no triangles")
    return [(*welded(*_joined(pairs)), colour) for colour, pairs in out.items()]


def _colour(part: Any) -> str:
    visual = part.visual
    rgba = getattr(getattr(visual, "material", None), "main_color", None)
    if rgba is None and getattr(visual, "defined", False):
        rgba = getattr(visual, "main_color", None)
    return LOOK_COLOUR if rgba is None else "#" + "".join(f"{int(c):02X}" for c in np.asarray(rgba)[:3])


def _joined(pairs: Sequence[tuple[Array, Triangles]]) -> tuple[Array, Triangles]:
    starts = np.cumsum([0, *(len(v) for v, _ in pairs)])
    return np.concatenate([v for v, _ in pairs]), np.concatenate(
        [f + start for (_, f), start in zip(pairs, starts, strict=False)]
    )


def welded(vertices: Array, faces: Triangles, cell: float = 0.0) -> tuple[Array, Triangles]:
    """The corners of each cell (m) merged at their mean, and the remaining triangles; cell 0 merges equal ones only."""
    low, size = vertices.min(axis=0), float(np.ptp(vertices, axis=0).max()) or 1.0
    step = cell or 1e-7 * size
    steps = np.floor((vertices - low) / step + (0.0 if cell else 0.5)).astype(np.int64)
    n = steps.max(axis=0) + 1
    _, of, count = np.unique((steps[:, 0] * n[1] + steps[:, 1]) * n[2] + steps[:, 2], return_inverse=True,
                             return_counts=True)  # fmt: skip
    middles = np.column_stack([np.bincount(of, x) for x in vertices.T]) / count[:, None]
    left = of[faces]
    a, b, c = left.T
    left = left[(a != b) & (b != c) & (a != c)]
    _, first = np.unique(np.sort(left, axis=1), axis=0, return_index=True)
    left = left[np.sort(first)]
    used, numbers = np.unique(left, return_inverse=True)
    return middles[used], numbers.reshape(-1, 3)


def thinned(meshes: Sequence[Mesh], most: int) -> list[Mesh]:
    """The meshes with about `most` triangles; cells have one size for all, so that large parts keep more."""
    whole = sum(len(m.faces) for m in meshes)
    if whole <= most:
        return list(meshes)
    size = max(float(np.ptp(m.vertices, axis=0).max()) for m in meshes)
    cell = 1e-3 * size
    while True:
        fewer = [Mesh(m.node, *welded(m.vertices, m.faces, cell), m.colour) for m in meshes]
        count = sum(len(m.faces) for m in fewer)
        if count <= most or cell > size:
            return [m for m in fewer if len(m.faces)]
        cell *= min(max((count / most) ** 0.5, 1.05), 4.0)  # the number of triangles is inverse to a cell's area
