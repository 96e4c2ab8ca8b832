"""Geometry: shapes, curves, cam outlines, splines, motion programs, quadrature."""
