"""Scene files: an arm, the actions on it and its simulation, in TOML or in the same structure of dictionaries."""

from .scene import SCENES, Scene, load, scene_from_dict

__all__ = ["SCENES", "Scene", "load", "scene_from_dict"]
