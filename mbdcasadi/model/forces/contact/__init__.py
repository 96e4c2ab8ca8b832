"""Unilateral contact: outlines, where they touch, and the force there."""
