"""Inversion of the dynamics: forces and motions of the joints that carry the tip along a path.

From low to high: path (of the tip), equations (joints that keep to it, balance, dynamics of the other coordinates),
solve (the motion on one grid), window (grids, and times ahead of the path and after it), inversion (the result),
invert.
"""
