"""Linkages that pass through given positions."""
