"""Scene files: an arm, what drives it and for how long, in TOML or in the same structure of dictionaries."""

from .scene import SCENES, Scene, load, scene_from_dict

__all__ = ["SCENES", "Scene", "load", "scene_from_dict"]
