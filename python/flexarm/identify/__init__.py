"""From measured data to a model: unknown numbers of a scene, fitted to runs."""
