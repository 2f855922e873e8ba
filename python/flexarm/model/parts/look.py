"""The look of a link, from a robot's file: meshes and simple solids, which are drawn and have no mass."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from os import PathLike, fspath
from typing import Annotated

from ..._check import array
from .joints import Placement
from .part import Part, one_of

#: Number of sizes of each shape.
SIZES = {"mesh": 3, "box": 3, "cylinder": 2, "ball": 1}


@dataclass(frozen=True)
class Look(Part):
    """A shape that is drawn with a link: a mesh of a file, a box, a cylinder, a ball.

    It has no mass and changes no motion.

    Args:
        shape: "mesh", "box", "cylinder" (about its z) or "ball".
        size: of a box its sides along x, y and z; of a cylinder its radius and its length; of a ball its radius, a list
            of one (m). Of a mesh three factors of its coordinates, 0.001 each where the file is in millimetres; a
            negative one mirrors; by default 1.
        file: of a mesh: the path of a file that trimesh reads, such as .stl, .obj or .dae.
        at: its frame: position and rotation in the frame given by `on`.
        on: the frame it moves with: "hub", the link's own axes; "tip", the end of the link's beam (or `hub.end`), as
            the tip's body; "base", the frame that the link's joint sits on: the end of its parent, or the world.
        colour: "#RRGGBB"; by default that of the mesh, or grey.
    """

    shape: Annotated[str, one_of(*SIZES)] = "mesh"
    size: Sequence[float] = ()
    _: KW_ONLY
    file: str | PathLike[str] | None = None
    at: Placement | None = None
    on: Annotated[str, one_of("hub", "tip", "base")] = "hub"
    colour: str | None = None

    def _made(self) -> None:
        if (self.file is not None) != (self.shape == "mesh"):
            raise ValueError(f"file = {self.file!r}: a mesh has a file, a {self.shape} has none")
        if self.file is not None:
            if not isinstance(self.file, (str, PathLike)):
                raise ValueError(f"file = {self.file!r}: must be a path")
            self._set("file", fspath(self.file))
        given = (1.0,) * 3 if self.shape == "mesh" and not len(self.size) else self.size
        size = array("size", given, (SIZES[self.shape],))
        if not (size.all() if self.shape == "mesh" else (size > 0).all()):
            raise ValueError(f"size = {size.tolist()}: must be " + ("not 0" if self.shape == "mesh" else "above 0"))
        self._set("size", tuple(size.tolist()))
        if self.colour is not None and not re.fullmatch(r"#[0-9a-fA-F]{6}", str(self.colour)):
            raise ValueError(f"colour = {self.colour!r}: must be '#RRGGBB', such as '#8A8F98'")
