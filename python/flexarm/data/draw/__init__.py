"""Figures of arrays: no pyplot, no display, no global state."""
