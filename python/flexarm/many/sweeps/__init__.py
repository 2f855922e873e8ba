"""Runs over parameters that are varied, and the quantities that are kept of each."""
