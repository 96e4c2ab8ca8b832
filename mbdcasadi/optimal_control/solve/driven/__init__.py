"""Mechanisms with an input for each coordinate: any motion is one of theirs, and its inputs follow from it."""
