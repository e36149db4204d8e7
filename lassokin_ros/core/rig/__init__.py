"""Several cameras that see one person: the offsets of their clocks, and whether the given set-up can be right."""
