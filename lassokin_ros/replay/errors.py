"""The error of recordings."""

from lassokin_ros.core.errors import LassokinError


class BagError(LassokinError):
    """A recording cannot be read, lacks a required topic, or cannot be written."""
