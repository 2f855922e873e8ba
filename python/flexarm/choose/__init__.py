"""Which model is cheapest within a tolerance: errors and times of models, measured."""
