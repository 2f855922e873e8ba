"""Sensors that read a result or a state, their readings and spectra."""
