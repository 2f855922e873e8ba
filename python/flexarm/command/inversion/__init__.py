"""Inversion of the dynamics: forces and motions of the joints that carry the tip along a path."""
