"""Which model is cheapest within a tolerance: models are run, their errors and times measured, and one is chosen.

Shared, from low to high: coordinates (states of one arm in those of another), models (a scene's models as data), times
and measures (when and what is compared), integrators (their settings), trials (runs, timed, within a budget).
`economize`: symmetry and indicators (estimates before a run), steps, findings (what is known), decisions (what can be
left out: a new one goes there), descent (leaving it out), economize_search, economize, adapt (runs that change over).
`chart`: chart_search, chart.
"""
