"""Mechanisms in the files of other programs.

==================== =========================================================================
``joint_tree``       the bodies in terms of the coordinates of a tree of joints
``linear_laws``      forces and constraints that are linear in coordinates, rates and inputs
``mjcf``             the files of MuJoCo
==================== =========================================================================
"""
