"""The same picture by matplotlib, without a display: faces in perspective, the far ones first."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._check import Array
from ..data.draw.style import BLUE, GREEN, INK, ORANGE, PURPLE, Axes, Figure, new_figure
from . import stage
from .body import along
from .meshes import Mesh, thinned
from .track import Track

_TRIANGLES = 12_000  # of meshes, drawn in a third of a second


class Eye:
    """Perspective: world points to places in the picture, whose upper and lower edges are 1 and -1."""

    def __init__(self, camera: stage.Camera, aspect: float) -> None:
        self.camera, self.aspect, self.axes = camera, aspect, camera.axes
        self.distance = camera.distance(aspect)
        self.scale = 1 / np.tan(np.radians(stage.FIELD / 2))
        self.light = self.axes.T @ np.array([0.3, 0.5, 0.81])

    def __call__(self, points: Array) -> tuple[Array, Array]:
        """Places (..., 2) and distances from the eye (...)."""
        placed = (points - self.camera.centre) @ self.axes.T
        depth = self.distance - placed[..., 2]
        return placed[..., :2] * (self.scale / depth)[..., None], depth

    def sees(self, faces: Array) -> NDArray[np.bool_]:
        """Whether faces (n, 4, 3), whose corners run counterclockwise as seen from outside, turn to the eye."""
        normal = np.cross(faces[:, 2] - faces[:, 0], faces[:, 3] - faces[:, 1])
        eye = self.camera.centre + self.distance * self.axes[2]
        return np.asarray(np.einsum("ni,ni->n", normal, eye - faces.mean(axis=1)) > 0)


def _quads(rings: Array) -> Array:
    """Faces (n, 4, 3) between rings of corners (k, m, 3)."""
    after = np.roll(rings, -1, axis=1)
    return np.stack([rings[:-1], after[:-1], after[1:], rings[1:]], axis=2).reshape(-1, 4, 3)


def _round(length: float, radii: Sequence[float], places: Sequence[float], sides: int = 14) -> Array:
    """Faces of a body of revolution about x: radii at places, shares of its length from its middle."""
    turn = 2 * np.pi * np.arange(sides) / sides
    ring = np.column_stack([np.zeros(sides), np.cos(turn), np.sin(turn)])
    rings = [ring * (0, r, r) + (p * length, 0, 0) for r, p in zip(radii, places, strict=True)]
    return _quads(np.array(rings))


def _divided(faces: Array, n: int = 8) -> Array:
    """Faces (k, 4, 3) in n times n parts, so that boxes that touch can be sorted by distance."""
    s = np.linspace(0.0, 1.0, n + 1)[:, None]
    a, b, c, d = np.moveaxis(faces, 1, 0)
    low, high = a[:, None] + s * (b - a)[:, None], d[:, None] + s * (c - d)[:, None]  # (k, n + 1, 3)
    grid = low[:, None] + s[:, :, None] * (high - low)[:, None]  # (k, n + 1, n + 1, 3)
    parts = [grid[:, :-1, :-1], grid[:, :-1, 1:], grid[:, 1:, 1:], grid[:, 1:, :-1]]
    return np.stack(parts, axis=3).reshape(-1, 4, 3)


def _solid_faces(solid: dict[str, Any]) -> Array:
    """Faces (n, 4, 3) in the axes of its node; corners run counterclockwise as seen from outside."""
    size = solid["size"]
    if solid["kind"] == "ball":
        turn = np.linspace(0.0, np.pi, 9)
        faces = _round(2 * size[0], list(size[0] * np.sin(turn)), list(-np.cos(turn) / 2))
    elif solid["kind"] == "cylinder":
        faces = _round(size[0], [0, size[1], size[1], 0], [-0.5, -0.5, 0.5, 0.5])
    else:
        corner = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) / 2
        box = np.array([[(x, *c) for c in corner] for x in (-0.5, 0.5)]) * np.array(size)
        faces = _divided(np.concatenate([_quads(box), box]))
    normal = np.cross(faces[:, 2] - faces[:, 0], faces[:, 3] - faces[:, 1])
    inwards = np.einsum("ni,ni->n", normal, faces.mean(axis=1)) < 0  # solids are convex, about their middle
    faces = np.where(inwards[:, None, None], faces[:, ::-1], faces)
    return np.asarray(faces @ np.array(solid["axes"]).T + solid["at"])


def arrow(start: Array, end: Array, radius: float) -> Array:
    """Faces of an arrow."""
    length = float(np.linalg.norm(end - start))
    if length < 1e-12:
        return np.zeros((0, 4, 3))
    head = min(5 * radius, 0.5 * length) / length
    faces = _round(length, [radius / 2, radius / 2, 1.6 * radius, 0], [-0.5, 0.5 - head, 0.5 - head, 0.5], 10)
    return np.asarray(faces @ along((end - start) / length).T + (start + end) / 2)


class _Faces:
    """Collects faces with their colours, and draws them from far to near."""

    def __init__(self) -> None:
        self.faces: list[Array] = []
        self.colours: list[Array] = []
        self.nearer: list[Array] = []

    def add(self, faces: Array, colour: Any, nearer: float = 0.0) -> None:
        """Adds faces; they are sorted as if `nearer` (m) closer to the eye, for a face that lies on another one."""
        from matplotlib.colors import to_rgb

        rgb = np.array(to_rgb(colour)) if isinstance(colour, str) else colour
        self.faces.append(faces)
        self.colours.append(np.broadcast_to(rgb, (len(faces), 3)))
        self.nearer.append(np.full(len(faces), nearer))

    def add_polygon(self, polygon: Array, colour: Any) -> None:
        """Adds a cap of any outline, as a fan about its centre."""
        middle = np.broadcast_to(polygon.mean(axis=0), polygon.shape)
        self.add(np.stack([polygon, np.roll(polygon, -1, axis=0), middle, middle], axis=1), colour)

    def draw(self, ax: Axes, eye: Eye) -> None:
        from matplotlib.collections import PolyCollection

        faces, colours = np.concatenate(self.faces), np.concatenate(self.colours)
        normal = np.cross(faces[:, 2] - faces[:, 0], faces[:, 3] - faces[:, 1])
        size = np.linalg.norm(normal, axis=1, keepdims=True)
        normal = normal / np.maximum(size, 1e-300)
        shade = 0.62 + 0.38 * np.abs(normal @ eye.light)
        places, depth = eye(faces)
        order = np.argsort(np.concatenate(self.nearer) - depth.mean(axis=1))
        rgb = np.clip(colours * shade[:, None], 0, 1)[order]
        ax.add_collection(PolyCollection(list(places[order]), facecolors=rgb, edgecolors=rgb, linewidths=0.8, zorder=3))


def _finer(outlines: Array) -> Array:
    """Outlines (n, m, 2) with additional corners if they have few, since a face has one colour."""
    parts = 4 if outlines.shape[1] < 12 else 2 if outlines.shape[1] < 20 else 1
    after = np.roll(outlines, -1, axis=1)
    between = [outlines + k / parts * (after - outlines) for k in range(parts)]
    return np.stack(between, axis=2).reshape(len(outlines), -1, 2)


def _finer_ends(rings: Array, ends: int = 2, parts: int = 6) -> Array:
    """Rings or their values (k, ...) with more near both ends, where beams enter boxes: long faces make saw teeth."""
    last = len(rings) - 1
    ends = min(ends, last // 2)
    near = np.arange(ends * parts) / parts
    places = np.concatenate([near, np.arange(ends, last - ends + 1), last - near[::-1]])
    below = np.minimum(places.astype(int), last - 1)
    share = (places - below).reshape(-1, *[1] * (rings.ndim - 1))
    return np.asarray((1 - share) * rings[below] + share * rings[below + 1])


def _beam_colours(values: Array, most: float) -> Array:
    u = np.clip(values / most if most else 0.0 * values, -1, 1)
    stops = np.linspace(-1, 1, len(stage.COLOURS))
    return np.stack([np.interp(u, stops, stage.COLOURS[:, c]) for c in range(3)], axis=-1)


def _add_track(
    faces: _Faces, track: Track, meshes: Sequence[Mesh], pose: Any, most: float, largest: tuple[float, float], eye: Eye
) -> None:
    p, R, strain, force, moment = pose
    body, radius = track.body, eye.camera.radius
    symbol = 0.016 * radius

    def point(node: int, at: Any) -> Array:
        return np.asarray(p[node] + R[node] @ np.asarray(at))

    for beam in body.beams:
        nodes = slice(beam["first"], beam["first"] + beam["count"])
        outlines = _finer(np.asarray(beam["outlines"]))
        corners = np.concatenate([np.zeros((*outlines.shape[:2], 1)), outlines], axis=2)
        rings = np.einsum("nij,nmj->nmi", R[nodes], corners) + p[nodes, None]
        values = stage.surface_strain(strain[nodes], outlines)
        rings, values = _finer_ends(rings), _finer_ends(values)
        after = np.roll(values, -1, axis=1)
        mean = (values[:-1] + after[:-1] + after[1:] + values[1:]) / 4
        plain = None if beam["part"] == "beam" else stage.PART_COLOURS[beam["part"]]
        sides, colours = _quads(rings), _beam_colours(mean.ravel(), most)
        visible = eye.sees(sides)
        towards = (rings.mean(axis=(0, 1)) - p[nodes].mean(axis=0)) @ eye.axes[2]  # towards the patch's face
        lift = float(np.sign(towards) * np.linalg.norm(rings[1, 0] - rings[0, 0])) if plain else 0.0
        faces.add(sides[visible], plain or colours[visible], lift)
        for k in (0, -1):
            faces.add_polygon(rings[k], plain or _beam_colours((values[k] + np.roll(values[k], -1)) / 2, most))
    for solid in body.solids:
        node = solid["node"]
        if not solid.get("under"):
            colour = solid.get("colour") or stage.PART_COLOURS[solid["part"]]
            sides = _solid_faces(solid) @ R[node].T + p[node]
            faces.add(sides[eye.sees(sides)], colour)
    for mesh in meshes:
        corners = mesh.vertices[mesh.faces[:, [0, 1, 2, 2]]] @ R[mesh.node].T + p[mesh.node]
        faces.add(corners, mesh.colour)
    for line in body.bars:
        start, end = (point(*place) for place in line["ends"])
        length = float(np.linalg.norm(end - start))
        if length > 1e-9:
            width = stage.BARS[line["part"]] * symbol
            bar = _round(length, [width] * 2, [-0.5, 0.5], 10) @ along((end - start) / length).T
            faces.add(bar + (start + end) / 2, stage.PART_COLOURS[line["part"]])
    for axis in body.axes:
        start = point(axis["node"], axis["at"])
        direction = R[axis["node"]] @ axis["direction"]
        faces.add(arrow(start, start + axis["length"] * direction, 0.45 * symbol), ORANGE)
    for i, node in enumerate(body.loads):
        for vector, most_of, colour, pushes in (
            (force[i], largest[0], GREEN, True),
            (moment[i], largest[1], PURPLE, False),
        ):
            if most_of and np.linalg.norm(vector) > 1e-3 * most_of:
                reach = 0.5 * radius * vector / most_of
                start = p[node] - reach if pushes else p[node]
                faces.add(arrow(start, start + reach, 0.03 * float(np.linalg.norm(reach))), colour)


def _floor(ax: Axes, eye: Eye) -> None:
    from matplotlib.collections import LineCollection

    camera, step = eye.camera, stage.grid_step(eye.camera.radius)
    right = np.roll(np.abs(camera.up), 1)
    ahead = np.cross(camera.up, right)
    reach = np.ceil(1.3 * camera.radius / step) * step
    base = camera.floor * camera.up + sum(np.round(camera.centre @ a / step) * step * a for a in (right, ahead))
    lines = []
    for s in np.arange(-reach, reach * (1 + 1e-9), step):
        for one, other in ((right, ahead), (ahead, right)):
            lines.append(eye(np.array([base + s * other - reach * one, base + s * other + reach * one]))[0])
    ax.add_collection(LineCollection(lines, colors="#E2E2E2", linewidths=0.6, zorder=1))


def _trace(ax: Axes, eye: Eye, track: Track, t: float) -> None:
    if len(track.t) < 2:
        return
    many = np.linspace(track.t[0], track.t[-1], int(np.clip(6 * len(track.t), 100, 3000)))
    done = many <= t + 1e-12
    for tip in track.tips(many):
        places = eye(tip)[0]
        ax.plot(*places.T, color=BLUE, linewidth=0.8, alpha=0.35, zorder=2)
        ax.plot(*places[done].T, color=BLUE, linewidth=1.6, zorder=2)


class Still:
    """A matplotlib figure of tracks side by side, drawn anew for each time."""

    def __init__(
        self, tracks: Sequence[Track], notes: Sequence[str], size: tuple[float, float], steady: bool, scale: float
    ) -> None:
        self.tracks = tracks
        self.meshes = [thinned(track.body.meshes, _TRIANGLES // len(tracks)) for track in tracks]
        self.most = stage.round_up(max(stage.greatest_strain(tracks), scale))
        self.largest = (_largest(tracks, "force"), _largest(tracks, "moment"))
        self.figure: Figure = new_figure(*size)
        self.figure.set_layout_engine("none")
        bottom = 0.16 if self.most else 0.07
        width = 1 / len(tracks)
        self.axes = [
            self.figure.add_axes((i * width, bottom, width, 0.92 - bottom)) for i in range(len(tracks))
        ]
        self.eye = Eye(stage.camera(tracks, steady), width * size[0] / ((0.92 - bottom) * size[1]))
        self.clock = self.figure.text(0.985, 0.975, "", ha="right", va="top", fontsize=11, color=INK)
        for i, track in enumerate(tracks):
            self.figure.text(i * width + 0.015, 0.975, track.title, va="top", fontsize=11, color=INK, weight="bold",
                             parse_math=False)  # fmt: skip
        note = [*notes, f"grid {stage.grid_step(self.eye.camera.radius):g} m"]
        self.figure.text(0.015, 0.02, " · ".join(note), fontsize=8.5, color="#555555", parse_math=False)
        if self.most:
            self._bar()

    def _bar(self) -> None:
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import LinearSegmentedColormap, Normalize

        factor, unit = stage.strain_label(self.most)
        place = self.figure.add_axes((0.62, 0.115, 0.35, 0.022))
        colours = LinearSegmentedColormap.from_list("strain", [tuple(c) for c in stage.COLOURS])
        mappable = ScalarMappable(Normalize(-self.most * factor, self.most * factor), colours)
        bar = self.figure.colorbar(mappable, cax=place, orientation="horizontal")
        bar.set_ticks([-self.most * factor, 0, self.most * factor])
        bar.ax.tick_params(labelsize=8.5)
        bar.outline.set_visible(False)
        place.set_title(f"strain at the surface, along x ({unit})", fontsize=8.5, pad=3, loc="right")

    def draw(self, t: float) -> Figure:
        """The figure at time t (s)."""
        for ax, track, meshes in zip(self.axes, self.tracks, self.meshes, strict=True):
            ax.clear()
            ax.set_axis_off()
            ax.set_xlim(-self.eye.aspect, self.eye.aspect)
            ax.set_ylim(-1, 1)
            _floor(ax, self.eye)
            _trace(ax, self.eye, track, t)
            faces = _Faces()
            _add_track(faces, track, meshes, track.at(t), self.most, self.largest, self.eye)
            if faces.faces:
                faces.draw(ax, self.eye)
        if any(len(track.t) > 1 for track in self.tracks):
            self.clock.set_text(f"t = {t:.4g} s")
        return self.figure


def _largest(tracks: Sequence[Track], name: str) -> float:
    return max(float(np.linalg.norm(getattr(t, name), axis=-1).max(initial=0.0)) for t in tracks)
