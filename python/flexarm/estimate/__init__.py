"""Estimates of an arm in motion from what its sensors read."""
