"""Names and units of an arm's coordinates, as tables and figures show them."""

from __future__ import annotations

from .chain import Chain


def joint_coordinates(arm: Chain) -> list[tuple[int, str, str]]:
    """(index into q, label, unit) of every joint coordinate of an arm; units are rad or m, or 1 of a quaternion."""
    out, names = [], arm.q_names
    for k, link in enumerate(arm.links):
        first = arm._core.first_q(k)
        out += [(first + n, names[first + n], unit) for n, unit in enumerate(link.joint.q_units)]
    return out


def joint_rates(arm: Chain) -> list[tuple[int, str, str]]:
    """(index into v and tau, label, unit of the coordinate, rad or m) of every joint rate of an arm."""
    firsts = [(arm._core.first(k), link.joint.units) for k, link in enumerate(arm.links)]
    return [(i, arm.coordinates[i], unit) for first, units in firsts for i, unit in enumerate(units, first)]


def deflections(arm: Chain) -> list[tuple[int, int, str]]:
    """(link, component, label) of every tip deflection an arm's beams can have; component 0 is x, 1 is y, 2 is z."""
    out = []
    for k, link in enumerate(arm.links):
        if link.beam is None or not link.beam.ne:
            continue
        for component, names in enumerate(({"extension"}, {"bending_y", "shear_y"}, {"bending_z", "shear_z"})):
            if link.beam.curvature is not None or names & set(link.beam.counts):
                out.append((k, component, f"{arm.names[k]} tip {'xyz'[component]}"))
    return out


def ends(arm: Chain) -> list[tuple[int, str]]:
    """(link, label) of every end of an arm: "end" of a chain, "end of NAME" of each branch of a tree."""
    return [(k, "end" if len(arm.ends) == 1 else f"end of {arm.names[k]}") for k in arm.ends]
