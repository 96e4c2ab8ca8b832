"""Simulation with exact dry friction: pieces of motion in one mode each, joined where friction switches."""

from . import start  # noqa: F401 - tells assembly how to find the start of mechanisms with exact friction
