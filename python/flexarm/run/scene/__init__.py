"""Scene files: an arm, the actions on it and its simulation, in TOML or in the same structure of dictionaries."""
