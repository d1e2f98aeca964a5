"""Which partition of the tracks into motions is taken, and how it is searched."""
