"""State estimation of an arm in motion from its sensors' readings."""
