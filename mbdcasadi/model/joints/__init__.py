"""Joints and other constraints: one small class each."""
