"""Simulation with exact dry friction: pieces of motion in one mode each, joined where friction switches."""

from . import start  # noqa: F401 - registers with assembly the start of mechanisms with exact friction
