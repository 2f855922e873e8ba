"""Sweeps over parameters: vary (their values), quantities (of each run), result (the table), sweep."""
