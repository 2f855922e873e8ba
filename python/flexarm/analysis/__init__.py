"""What is computed of an arm without a run: equilibrium, linear models, modes, places for patches, findings."""
