"""Sweeps over parameters: quantities (of each run), vary (the values), sweep (the runs and their table)."""
