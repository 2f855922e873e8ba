"""`Arm`, and arms that differ in parameters."""
