"""Empty: the Buffer beside it transforms points without registration."""
