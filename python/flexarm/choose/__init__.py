"""Choice of the cheapest model within a tolerance: models are run, their errors and times measured, one is chosen.

From low to high: states (of one model in the coordinates of another), models (a scene's models as data), times and
measures (the compared quantity), integrators (settings), trials (timed runs in a budget).
`economize`: symmetry and indicators (estimates before a run), steps, evidence (estimates and errors so far), decisions
(parts that a model may lack; add new ones there), descent, economize_search, economize, adapt (switches models).
`chart`: chart_search, chart.
"""
