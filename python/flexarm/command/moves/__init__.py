"""Planned moves: fast, within limits, without vibration at their end.

From low to high: move_limits, route (of the joints), rigid (the fastest move of the rigid arm), moved_arm (its
simulation and modes), response (derivatives along a run), profile (accelerations over time), search (linear programmes,
one after the other), move (the result), plan.
"""
