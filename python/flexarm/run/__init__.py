"""One run: integration in time, its result, and what watches it."""
