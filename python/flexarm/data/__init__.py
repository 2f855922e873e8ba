"""Measured and simulated signals: columns over time with names and units, in and out of files."""
