"""Sections of beams: their shapes, laminates, outlines of any form."""

from .model.parts.laminate import Orthotropic as Orthotropic
from .model.parts.laminate import Ply as Ply
from .model.parts.laminate import laminate as laminate
from .model.parts.polygon import polygon as polygon
from .model.parts.sections import (
    Box as Box,
)
from .model.parts.sections import (
    Circle as Circle,
)
from .model.parts.sections import (
    Ellipse as Ellipse,
)
from .model.parts.sections import (
    GeneralSection as GeneralSection,
)
from .model.parts.sections import (
    IBeam as IBeam,
)
from .model.parts.sections import (
    Rectangle as Rectangle,
)
from .model.parts.sections import (
    SectionMatrix as SectionMatrix,
)
from .model.parts.sections import (
    Tube as Tube,
)
from .model.parts.taper import Taper as Taper
