"""Parameters from measured motions."""
