"""Derivatives of motions by parameters, starts and inputs; cost functions with gradients."""
