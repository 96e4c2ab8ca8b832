"""Simulation with exact dry friction: pieces of motion in one mode each, joined where friction switches."""
