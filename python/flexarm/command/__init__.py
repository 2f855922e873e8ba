"""Commands of an arm's joints for a wanted motion of its end, without residual vibration."""
