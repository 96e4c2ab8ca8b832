"""Controllers that plan again at every sample, as C that needs no library."""
