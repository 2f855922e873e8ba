"""The parts of an arm, from the section to the chain, and the indices of its coordinates."""
