"""Refinement of meshes to a tolerance, and verification of solutions by simulation."""
