"""The exception of the exports."""

from lassokin_ros.core.errors import LassokinError


class ExportError(LassokinError):
    """A motion cannot be represented in a format, or a file cannot be written."""
