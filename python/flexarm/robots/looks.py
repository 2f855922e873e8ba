"""Looks of bodies of a robot's file: URDF's <visual>, MJCF's geoms, and the paths of meshes."""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any
from urllib.parse import unquote, urlparse

import numpy as np

from .._check import Array
from ..model.parts.look import Look
from .tree import Pose

Looks = dict[str, list[tuple[Pose, Look]]]
Omissions = list[tuple[str, str]]


def rotation_of(rpy: Array) -> Array:
    """Roll, pitch, yaw (rad) about the fixed x, y, z; quarter turns are exact."""
    c, s = np.cos(rpy), np.sin(rpy)
    c, s = (np.where(np.abs(x) < 1e-15, 0.0, x) for x in (c, s))
    x = np.array([[1, 0, 0], [0, c[0], -s[0]], [0, s[0], c[0]]])
    y = np.array([[c[1], 0, s[1]], [0, 1, 0], [-s[1], 0, c[1]]])
    z = np.array([[c[2], -s[2], 0], [s[2], c[2], 0], [0, 0, 1]])
    return np.asarray(z @ y @ x)


def quaternion_rotation(quaternion: Array) -> Array:
    """Rotation matrix of a quaternion (w, x, y, z)."""
    from scipy.spatial.transform import Rotation  # slow to import

    return np.asarray(Rotation.from_quat(np.roll(quaternion, -1)).as_matrix())


# -- URDF --------------------------------------------------------------------------------------------------------------


def mesh_file(name: str, folder: Path) -> Path | None:
    """The file that a URDF names: package://PACKAGE/..., file://..., or a path from the URDF's folder; None if there is
    none. Packages are looked for in the folders above the URDF, in ROS_PACKAGE_PATH and AMENT_PREFIX_PATH."""
    url = urlparse(name)
    if url.scheme in ("package", "model"):
        candidates = _in_packages(unquote(url.netloc), unquote(url.path).lstrip("/"), folder)
    elif url.scheme == "file":
        candidates = iter([Path(unquote(url.netloc + url.path))])
    else:
        candidates = iter([folder / name])
    return next((path.resolve() for path in candidates if path.is_file()), None)


def _in_packages(package: str, rest: str, folder: Path) -> Iterator[Path]:
    for above in (folder.resolve(), *folder.resolve().parents):
        yield above / package / rest
        if above.name == package:
            yield above / rest
    for place in filter(None, os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)):
        yield Path(place) / package / rest
        if Path(place).name == package:
            yield Path(place) / rest
    for place in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        yield Path(place) / "share" / package / rest


def urdf_looks(root: ET.Element, folder: Path, left_out: Omissions) -> Looks:
    """Looks of the links from their <visual> elements. Elements that cannot be shown are left out and noted; they are
    no error."""
    colours = {m.get("name", ""): c for m in root.findall("material") if (c := _colour(m))}
    out: Looks = {}
    for link in root.findall("link"):
        name = link.get("name", "")
        for visual in link.findall("visual"):
            try:
                pose, look = _visual(visual, folder, colours)
            except (ValueError, KeyError) as e:
                why = f": {e}" if isinstance(e, ValueError) else ""
                left_out.append((f"a <visual> that cannot be read{why}", name))
                continue
            if look is not None:
                out.setdefault(name, []).append((pose, look))
                continue
            geometry = visual.find("geometry")
            mesh = None if geometry is None else geometry.find("mesh")
            missing = "" if mesh is None else mesh.get("filename", "")
            item = f"the mesh {missing}: there is no such file" if missing else "a <visual> that is no known shape"
            left_out.append((item, name))
    return out


def _colour(material: ET.Element | None) -> str | None:
    color = None if material is None else material.find("color")
    if color is None:
        return None
    return _hex([float(x) for x in color.get("rgba", "").split()])


def _hex(rgba: Any) -> str | None:
    rgb = np.asarray(rgba, dtype=float)[:3]
    if rgb.shape != (3,) or not np.isfinite(rgb).all():
        return None
    return "#" + "".join(f"{round(255 * float(c)):02X}" for c in rgb.clip(0.0, 1.0))


def _floats(element: ET.Element | None, key: str, default: str) -> Array:
    return np.array([float(x) for x in ((element is not None and element.get(key)) or default).split()])


def _visual(visual: ET.Element, folder: Path, colours: dict[str, str]) -> tuple[Pose, Look | None]:
    origin, material = visual.find("origin"), visual.find("material")
    at = _floats(origin, "xyz", "0 0 0"), _floats(origin, "rpy", "0 0 0")
    if at[0].shape != (3,) or at[1].shape != (3,) or not np.isfinite(at).all():
        raise ValueError("its origin must have three numbers of each")
    pose = Pose(at[0], rotation_of(at[1]))
    named = colours.get(material.get("name", "")) if material is not None else None
    colour = _colour(material) or named
    shape = next(iter(visual.find("geometry") or []), None)
    if shape is None:
        return pose, None
    if shape.tag == "mesh":
        file = mesh_file(shape.get("filename", ""), folder)
        scale = _floats(shape, "scale", "1 1 1").tolist()
        return pose, None if file is None else Look("mesh", scale, file=str(file), colour=colour)
    if shape.tag == "box":
        return pose, Look("box", _floats(shape, "size", "").tolist(), colour=colour)
    if shape.tag == "cylinder":
        return pose, Look("cylinder", [float(shape.attrib[k]) for k in ("radius", "length")], colour=colour)
    if shape.tag == "sphere":
        return pose, Look("ball", [float(shape.attrib["radius"])], colour=colour)
    return pose, None


# -- MJCF --------------------------------------------------------------------------------------------------------------


def mjcf_looks(mujoco: ModuleType, model: Any, folder: Path, names: list[str], left_out: Omissions) -> Looks:
    """Looks of the bodies: their geoms of the groups 0 to 2, which MuJoCo itself shows."""
    out: Looks = {}
    for k in range(model.ngeom):
        if model.geom_group[k] > 2:
            continue
        name = names[int(model.geom_bodyid[k])]
        pose = Pose(model.geom_pos[k].copy(), quaternion_rotation(model.geom_quat[k]))
        for place, look in _geom(mujoco, model, k, folder, name, left_out):
            out.setdefault(name, []).append((pose @ place, look))
    return out


def _geom(
    mujoco: ModuleType, model: Any, k: int, folder: Path, body: str, left_out: Omissions
) -> list[tuple[Pose, Look]]:
    kinds, kind = mujoco.mjtGeom, mujoco.mjtGeom(int(model.geom_type[k]))
    material = int(model.geom_matid[k])
    colour = _hex(model.mat_rgba[material] if material >= 0 else model.geom_rgba[k])
    a, b, c = (float(x) for x in model.geom_size[k])
    if kind == kinds.mjGEOM_BOX:
        return [(Pose(), Look("box", [2 * a, 2 * b, 2 * c], colour=colour))]
    if kind == kinds.mjGEOM_SPHERE:
        return [(Pose(), Look("ball", [a], colour=colour))]
    if kind in (kinds.mjGEOM_CYLINDER, kinds.mjGEOM_CAPSULE):
        ends = [np.array([0.0, 0.0, z]) for z in (-b, b)] if kind == kinds.mjGEOM_CAPSULE else []
        tube = (Pose(), Look("cylinder", [a, 2 * b], colour=colour))
        return [tube, *((Pose(end), Look("ball", [a], colour=colour)) for end in ends)]
    if kind != kinds.mjGEOM_MESH:
        left_out.append((f"the look of geoms that are {kind.name.removeprefix('mjGEOM_').lower()}s", body))
        return []
    mesh = int(model.geom_dataid[k])
    path = bytes(model.paths[int(model.mesh_pathadr[mesh]) :]).partition(b"\0")[0].decode()
    if int(model.mesh_pathadr[mesh]) < 0 or not (file := folder / path).is_file():
        left_out.append((f"the mesh {path}: there is no such file" if path else "meshes without a file", body))
        return []
    # MuJoCo stores a mesh in the axes of its inertia; this pose restores the file's axes
    own = Pose(model.mesh_pos[mesh].copy(), quaternion_rotation(model.mesh_quat[mesh])).inverse
    return [(own, Look("mesh", model.mesh_scale[mesh].tolist(), file=str(file.resolve()), colour=colour))]
