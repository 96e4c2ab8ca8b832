"""Driven motions, degrees of freedom, and singular poses."""
