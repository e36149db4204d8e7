"""Measuring scripts: each prints a table and takes --json FILE. They use the public tracker only."""
