"""Assembly: consistent positions and velocities, and the arguments that all analyses read."""
