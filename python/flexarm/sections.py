"""Sections of beams: their shapes, laminates, outlines of any form."""

from .model.parts.sections import Rectangle as Rectangle, Circle as Circle, Tube as Tube, Ellipse as Ellipse, Box as Box
from .model.parts.sections import IBeam as IBeam, GeneralSection as GeneralSection, SectionMatrix as SectionMatrix
from .model.parts.taper import Taper as Taper
from .model.parts.laminate import laminate as laminate, Ply as Ply, Orthotropic as Orthotropic
from .model.parts.polygon import polygon as polygon
