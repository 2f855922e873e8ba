"""An arm as its user describes it: its parts, from the section to the chain, and what acts on it."""
