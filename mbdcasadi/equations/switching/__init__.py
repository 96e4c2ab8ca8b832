"""Switches of the equations: where they jump, when they do in time, and equations held on one side."""
