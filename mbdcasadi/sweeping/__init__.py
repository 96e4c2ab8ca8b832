"""Many runs of one compiled simulation."""
