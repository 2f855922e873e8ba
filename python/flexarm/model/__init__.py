"""An arm as its user describes it: its parts, from the section to the chain, and the actions on it."""
