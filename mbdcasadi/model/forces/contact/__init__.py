"""Unilateral contact: outlines, the places at which they touch, and the forces there."""
