"""Planned moves: fast, within limits, without vibration at their end.

From low to high: route (of the joints, and their course on it), rigid (the fastest move of the rigid arm), moved_arm
(its simulation and modes, and derivatives along a run), search (linear programmes, one after the other), move (the
result), plan.
"""
