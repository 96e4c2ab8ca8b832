"""Simulation: runs under given forces, with events, impacts, friction and contacts."""
