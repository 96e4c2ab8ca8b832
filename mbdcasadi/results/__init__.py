"""States and trajectories: evaluation, tables, files."""
