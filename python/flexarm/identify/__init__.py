"""Identification: unknown numbers of a scene, fitted to measured runs."""
