"""The version of the installed package."""

from __future__ import annotations

from importlib import metadata


def version() -> str:
    """Return the version; "(not installed)" if the package runs from the source folder."""
    try:
        return metadata.version("lassokin_ros")
    except metadata.PackageNotFoundError:
        return "(not installed)"
