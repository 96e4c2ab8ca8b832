"""Exact dry friction in optimal control: where it sticks and slides is found first, and then solved in phases."""
