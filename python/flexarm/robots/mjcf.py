"""MJCF files to trees, by MuJoCo's own compiler."""

from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from .._check import Array
from ..model.parts.look import Look
from .tree import BALL_FRICTION, Looks, Mass, Omissions, Pose, Tree, TreeJoint, TreeLoop, hex_colour
from .urdf import parse_xml, read_text

#: a model's count of each feature that an arm does not have
_COUNTS = {
    "nu": "actuators", "ntendon": "tendons", "nsensor": "sensors", "nkey": "keyframes", "nflex": "flexible objects",
    "nplugin": "plugins",
}  # fmt: skip


def import_mujoco(asked: str) -> ModuleType:
    """The module MuJoCo, or an error that tells how to install it."""
    try:
        import mujoco
    except ImportError:
        raise ImportError(f"{asked} needs MuJoCo: pip install 'flexarm[mjcf]'") from None
    return mujoco  # type: ignore[no-any-return]


def read_mjcf(path: Any, gravity: Any) -> Tree:
    """The tree of an MJCF file; gravity None: the file's."""
    root = parse_xml(read_text(path))
    if root.tag not in ("mujoco", "mujocoinclude"):
        raise ValueError(f"<{root.tag}>: must be <mujoco>" + (" (is this URDF?)" if root.tag == "robot" else ""))
    mujoco = import_mujoco("from_mjcf")
    try:
        model = mujoco.MjModel.from_xml_path(str(Path(path)))
    except ValueError as e:
        raise ValueError(" ".join(str(e).split())) from None
    return tree_of(mujoco, model, gravity, Path(path).parent)


def tree_of(mujoco: ModuleType, model: Any, gravity: Any, folder: Path = Path()) -> Tree:
    """The tree of a compiled model. Bodies stand to each other as at `qpos0`, where all coordinates are zero.

    Args:
        folder: of the file, from which its meshes are named.
    """

    def named(kind: str, k: int) -> str:
        return mujoco.mj_id2name(model, getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), k) or f"{kind}_{k}"

    left_out: Omissions = []
    bodies = {named("body", 0): Mass()}
    joints: list[TreeJoint] = []
    for k in range(1, model.nbody):
        name, parent = named("body", k), named("body", int(model.body_parentid[k]))
        at = Pose(model.body_pos[k].copy(), _rotation(model.body_quat[k]))
        own = [int(model.body_jntadr[k]) + i for i in range(int(model.body_jntnum[k]))]
        inertia = Mass(float(model.body_mass[k]), np.zeros(3), np.diag(model.body_inertia[k]))
        bodies[name] = inertia.placed(Pose(model.body_ipos[k].copy(), _rotation(model.body_iquat[k])))
        if not own:
            joints.append(TreeJoint(f"{name} (fixed)", "fixed", parent, name, at))
        for i in own:  # several joints of a body are a chain with massless bodies
            child = name if i == own[-1] else f"{name} on {named('joint', i)}"
            bodies.setdefault(child, Mass())
            joints.append(_joint(mujoco, model, i, (named("joint", i), parent, child), at, left_out))
            parent, at = child, Pose()
        if model.body_gravcomp[k]:
            left_out.append(("gravity compensation", name))
    for count, words in _COUNTS.items():
        if n := int(getattr(model, count, 0)):
            left_out.append((f"{n} {words if n > 1 else words[:-1]}", ""))
    found = [_loop(mujoco, model, k, named) for k in range(model.neq)]
    left_out += [("constraints (equality) that are no connect or weld", name) for name, loop in found if loop is None]
    if model.ngeom:
        left_out.append(("shapes to touch (geoms), but for the inertia that they give", ""))
    looks = _looks(mujoco, model, folder, [named("body", k) for k in range(model.nbody)], left_out)
    if model.opt.density or model.opt.viscosity:
        left_out.append(("the fluid around it (option density, viscosity)", ""))
    given = tuple(model.opt.gravity.tolist()) if gravity is None else gravity
    return Tree(bodies, joints, given, left_out, looks, [loop for _, loop in found if loop is not None])


def _joint(
    mujoco: ModuleType, model: Any, i: int, names: tuple[str, str, str], at: Pose, left_out: Omissions
) -> TreeJoint:
    name, parent, child = names
    kinds = {mujoco.mjtJoint.mjJNT_HINGE: "revolute", mujoco.mjtJoint.mjJNT_SLIDE: "prismatic"}
    kinds |= {mujoco.mjtJoint.mjJNT_BALL: "spherical", mujoco.mjtJoint.mjJNT_FREE: "free"}
    kind = kinds[mujoco.mjtJoint(int(model.jnt_type[i]))]
    ball = kind in ("spherical", "free")  # its numbers hold for all its freedoms; its spring rests at qpos0
    adr, dof = int(model.jnt_qposadr[i]), int(model.jnt_dofadr[i])
    zero, pos = 0.0 if ball else float(model.qpos0[adr]), model.jnt_pos[i].copy()
    springs = {"stiffness": float(np.ravel(model.jnt_stiffness[i])[0])}
    if springs["stiffness"] and not ball:
        springs["rest"] = float(model.qpos_spring[adr]) - zero
    springs |= {"damping": float(np.ravel(model.dof_damping[dof])[0]), "coulomb": float(model.dof_frictionloss[dof])}
    springs["reflected_inertia"] = float(model.dof_armature[dof])
    if ball and springs.pop("coulomb"):
        left_out.append((BALL_FRICTION, name))
    if zero:
        left_out.append(("the joint's ref: the arm's q is qpos - ref", name))
    for field, k in (("jnt_stiffnesspoly", i), ("dof_dampingpoly", dof)):
        if np.any(getattr(model, field, np.zeros((k + 1, 1)))[k]):
            left_out.append(("springs and dampers that are not linear", name))
    limits = (model.jnt_range[i] - zero).tolist() if model.jnt_limited[i] else (None, None)
    if kind == "spherical":
        limits = (None, limits[1] if limits[1] is not None and limits[1] < np.pi else None)
    place = Pose(at.position + at.rotation @ pos, at.rotation)
    return TreeJoint(name, kind, parent, child, place, model.jnt_axis[i].copy(), Pose(-pos), springs, *limits)


def _loop(mujoco: ModuleType, model: Any, k: int, named: Callable[[str, int], str]) -> tuple[str, TreeLoop | None]:
    """The name of an equality constraint, and the loop that it closes: of active ones that connect or weld bodies or
    sites."""
    kinds = {mujoco.mjtEq.mjEQ_CONNECT: "spherical", mujoco.mjtEq.mjEQ_WELD: "fixed"}
    name, kind = named("equality", k), kinds.get(mujoco.mjtEq(int(model.eq_type[k])))
    ids = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
    if kind is None or not model.eq_active0[k]:
        return name, None
    if mujoco.mjtObj(int(model.eq_objtype[k])) == mujoco.mjtObj.mjOBJ_SITE:
        a, b = (
            (named("body", int(model.site_bodyid[i])), Pose(model.site_pos[i].copy(), _rotation(model.site_quat[i])))
            for i in ids
        )
    else:
        first, second, turn = model.eq_data[k][:3].copy(), model.eq_data[k][3:6].copy(), np.eye(3)
        if kind == "fixed":  # places on the second and the first body, turn of the second
            first, second, turn = second, first, _rotation(model.eq_data[k][6:10])
        a, b = (named("body", ids[0]), Pose(first, turn)), (named("body", ids[1]), Pose(second))
    return name, TreeLoop(name, kind, a, b)


def _rotation(quaternion: Array) -> Array:
    """Rotation matrix of a quaternion (w, x, y, z)."""
    from scipy.spatial.transform import Rotation  # slow to import

    return np.asarray(Rotation.from_quat(np.roll(quaternion, -1)).as_matrix())


def _looks(mujoco: ModuleType, model: Any, folder: Path, names: list[str], left_out: Omissions) -> Looks:
    """Looks of the bodies: their geoms of the groups 0 to 2, which MuJoCo itself shows."""
    out: Looks = {}
    for k in range(model.ngeom):
        if model.geom_group[k] > 2:
            continue
        name = names[int(model.geom_bodyid[k])]
        pose = Pose(model.geom_pos[k].copy(), _rotation(model.geom_quat[k]))
        for place, look in _geom(mujoco, model, k, folder, name, left_out):
            out.setdefault(name, []).append((pose @ place, look))
    return out


def _geom(
    mujoco: ModuleType, model: Any, k: int, folder: Path, body: str, left_out: Omissions
) -> list[tuple[Pose, Look]]:
    kinds, kind = mujoco.mjtGeom, mujoco.mjtGeom(int(model.geom_type[k]))
    material = int(model.geom_matid[k])
    colour = hex_colour(model.mat_rgba[material] if material >= 0 else model.geom_rgba[k])
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
    own = Pose(model.mesh_pos[mesh].copy(), _rotation(model.mesh_quat[mesh])).inverse
    return [(own, Look("mesh", model.mesh_scale[mesh].tolist(), file=str(file.resolve()), colour=colour))]
