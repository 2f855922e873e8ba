"""One run: integration in time, its result, and findings about it."""
