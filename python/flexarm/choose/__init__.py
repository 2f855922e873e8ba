"""Choice of the cheapest model within a tolerance: models are run, their errors and times measured, one is chosen.

From low to high: states (of one model in the coordinates of another), pieces (beams cut where strains jump), models (a
scene's models as data), measures (the compared quantity), trials (settings, timed runs in a budget).
`economize`: indicators (small motions along a run), sources (what each part of a rich model is worth),
economize_search, choices (its table), economize (the plan, and runs that switch models). `chart`: chart_search, chart.
`Result.error`: enrich (richer models, of `economize`, too), lacking (forces that a run lacks), error_estimate, error.
"""
