"""Changes in a run: events, impacts, and modes of friction."""
