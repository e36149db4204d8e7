"""What the exports raise."""

from lassokin_ros.core.errors import LassokinError


class ExportError(LassokinError):
    """A motion cannot be written in a format, or a file cannot be made."""
