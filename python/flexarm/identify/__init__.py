"""Identification: unknown numbers of a scene, fitted to measured runs.

From low to high: unknown (numbers with bounds and priors), runs (inputs and outputs of the data), residuals (simulated
less measured, and derivatives), statistics, search (least squares from several starts), fit (the result), identify.
"""
