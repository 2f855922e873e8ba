"""The parts that browser and matplotlib share, apart from bodies and tracks: camera, colours, strain at the surface."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .._check import Array
from ..data.draw.style import BLUE, GREEN, ORANGE, PURPLE
from .track import Track

#: between blue and red, light in the middle: Moreland, "Diverging color maps for scientific visualization", 2009
COLOURS = np.array([(59, 76, 192), (124, 159, 249), (221, 221, 221), (245, 156, 125), (180, 4, 38)]) / 255
PART_COLOURS = {"hub": "#8A8F98", "tip": "#5B616B", "rod": "#8A8F98", "joint": "#3A3F47"}
PART_COLOURS |= {"patch": "#D9A300", "goal": GREEN, "strut": "#6B5B95", "tendon": "#A0522D"}
PART_COLOURS |= {"surface": "#C9C2B4", "toucher": "#7A6A53"}
SYMBOL_COLOURS = {"axis": ORANGE, "force": GREEN, "moment": PURPLE, "trace": BLUE}
BARS = {"rod": 0.5, "strut": 0.5, "tendon": 0.2}  # their radii, in the radius of an arrow's head
_LARGE = 1.5  # of the arm's length: larger surfaces may lie outside a picture
FIELD = 28.0  # degrees, from the picture's lower edge to its upper


@dataclass
class Camera:
    """A camera.

    Attributes:
        centre: of the scene (m). half: half of its width, height and depth in the picture's axes (m).
        axes: of the picture: to the right, upwards, towards the eye; rows of unit length, (3, 3).
        up: world axis that points up. floor: height of the lowest point along it (m). radius: half its width or height.
    """

    centre: Array
    half: Array
    axes: Array
    up: Array
    floor: float
    radius: float

    def distance(self, aspect: float) -> float:
        """Distance of the eye from the centre (m) that fits all into a picture of this aspect (width / height)."""
        most = 1.1 * max(self.half[1], self.half[0] / aspect)
        return float(most / np.tan(np.radians(FIELD / 2)) + self.half[2])


def camera(tracks: Sequence[Track], steady: bool = False) -> Camera:
    """A camera that sees all tracks; if `steady`, also all that the arm can reach about its base."""
    points = np.concatenate([_points(track) for track in tracks])
    size = max(track.body.size for track in tracks)
    gravity = tracks[0].gravity
    up = np.zeros(3)
    axis = int(np.abs(gravity).argmax()) if gravity.any() else 2
    up[axis] = -np.sign(gravity[axis]) if gravity.any() else 1.0
    eye = _towards_eye(points, up, steady)
    right = np.cross(up, eye)
    right /= np.linalg.norm(right)
    axes = np.array([right, np.cross(eye, right), eye])
    if steady:
        points = np.concatenate([points, size * axes[:2], -size * axes[:2]])
    seen = points @ axes.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    half = np.maximum((high - low) / 2, 0.05 * size)
    return Camera((low + high) / 2 @ axes, half, axes, up, float((points @ up).min()), float(max(half[:2])))


def _towards_eye(points: Array, up: Array, steady: bool) -> Array:
    """Direction towards the eye: from ahead and above; perpendicular to the plane of a plane motion."""
    right = np.roll(np.abs(up), 1)
    ahead = np.cross(up, right)
    eye = 0.55 * right - ahead + 0.5 * up
    _, spread, directions = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    if spread[2] < 0.12 * spread[1] and not steady:
        normal = directions[2] if directions[2] @ eye > 0 else -directions[2]
        level = abs(normal @ up) > 0.9
        eye = 0.7 * up - 0.9 * ahead if level else normal + 0.28 * up + 0.2 * np.cross(up, normal)
    return np.asarray(eye / np.linalg.norm(eye))


def _points(track: Track) -> Array:
    """Six points about each node in each frame, at the distance that solids and sections reach there, the corners of
    meshes, the points of struts in the world, and surfaces there that are not far larger than the arm, (n, 3)."""
    from scipy.spatial.transform import Rotation

    reach = np.full(track.position.shape[1], 0.02 * track.body.size)
    for beam in track.body.beams:
        nodes = slice(beam["first"], beam["first"] + beam["count"])
        reach[nodes] = np.maximum(reach[nodes], np.linalg.norm(beam["outlines"], axis=2).max(axis=1))
    for solid in (s for s in track.body.solids if not s.get("under")):
        far = float(np.linalg.norm(solid["at"])) + float(np.linalg.norm(solid["size"])) / 2
        reach[solid["node"]] = max(reach[solid["node"]], far)
    offsets = reach[:, None, None] * np.vstack([np.eye(3), -np.eye(3)])
    stride = max(len(track.t) // 200, 1)
    some = track.position[::stride, 1:]  # without the world
    parts = [(some[:, :, None] + offsets[1:]).reshape(-1, 3)]
    fixed = [at for bar in track.body.bars for node, at in bar["ends"] if not node]
    for solid in track.body.solids:
        if not solid["node"] and solid["part"] == "surface" and max(solid["size"]) <= _LARGE * track.body.size:
            sides = np.array(solid["size"] if len(solid["size"]) == 3 else [2 * solid["size"][0]] * 3)
            fixed += list(solid["at"] + _corners(np.array([-0.5 * sides, 0.5 * sides])) @ np.array(solid["axes"]).T)
    parts.append(np.reshape(fixed, (-1, 3)))
    for mesh in track.body.meshes:
        turns = Rotation.from_quat(track.quaternion[::stride, mesh.node]).as_matrix()
        moved = _corners(mesh.vertices) @ turns.swapaxes(1, 2) + track.position[::stride, mesh.node, None]
        parts.append(moved.reshape(-1, 3))
    return np.concatenate(parts)


def _corners(points: Array) -> Array:
    """The corners of the box about them, (8, 3)."""
    ends = np.stack([points.min(axis=0), points.max(axis=0)])
    return np.array([ends[(i, j, k), (0, 1, 2)] for i in (0, 1) for j in (0, 1) for k in (0, 1)])


def surface_strain(strain: Array, outline: Array) -> Array:
    """Strain along the beam at corners (..., m, 2), from eps, K2, K3 (..., 3): eps - y K3 + z K2, (..., m)."""
    e, k2, k3 = strain[..., None, 0], strain[..., None, 1], strain[..., None, 2]
    return np.asarray(e - outline[..., 0] * k3 + outline[..., 1] * k2)


def greatest_strain(tracks: Sequence[Track]) -> float:
    """The largest strain of all beams and times; 0 without strain."""
    most = 0.0
    for track in tracks:
        for beam in track.body.beams:
            nodes = slice(beam["first"], beam["first"] + beam["count"])
            most = max(most, float(np.abs(surface_strain(track.strain[:, nodes], beam["outlines"])).max()))
    return most if most > 1e-12 else 0.0


def round_up(x: float) -> float:
    """The next 1, 1.5, 2, 3, 5 or 7 times a power of ten."""
    if not x > 0:
        return 0.0
    power = 10 ** np.floor(np.log10(x))
    return float(next(f * power for f in (1, 1.5, 2, 3, 5, 7, 10) if f * power >= x * (1 - 1e-9)))


def grid_step(radius: float) -> float:
    """Distance of the floor's lines (m): 1, 2 or 5 times a power of ten."""
    power = 10 ** np.floor(np.log10(radius / 2))
    return float(next(f * power for f in (5, 2, 1) if f * power <= radius / 2 * (1 + 1e-9)))


def strain_label(most: float) -> tuple[float, str]:
    """The factor for displayed strain, and its unit."""
    return (1e2, "%") if most >= 0.01 else (1e6, "µm/m")
