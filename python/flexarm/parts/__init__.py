"""The parts of an arm, from the section to the chain: what an arm is made of, and its indices."""
