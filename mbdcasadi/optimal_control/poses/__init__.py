"""Poses at the ends of phases and at waypoints, and kinematic motions between them."""
