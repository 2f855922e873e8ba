"""One run: integration in time, its result, and what is found in it."""
