"""Applied forces: one small class each, given by their virtual work."""
