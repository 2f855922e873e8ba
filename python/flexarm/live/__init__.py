"""Pages in which an arm computes: numbers (a scene as a function of sliders), commands, live."""
