"""Computations without a run: equilibrium, linear models, modes, places for patches, findings."""
