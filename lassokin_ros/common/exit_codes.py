"""Exit codes of the commands."""

USAGE_ERROR = 2
"""The command cannot be run as it was given; one line on stderr says why."""
INTERRUPTED = 130
"""Ended by Ctrl-C; what was written until then is complete."""
