"""Commands that move the tip as one wants: inversion of the dynamics."""
