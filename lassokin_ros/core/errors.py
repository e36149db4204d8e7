"""Exceptions of the core. Each message contains what was wrong, what was expected and what to do."""


class LassokinError(Exception):
    """Base class of all exceptions of this package. Its text is one line without control characters."""

    def __str__(self) -> str:
        """Return the text. Unprintable characters, which names in files may have, are escaped as in Python."""
        text = super().__str__()
        return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


class SkeletonError(LassokinError, ValueError):
    """A skeleton's description cannot be used (file, tree, lengths)."""


class LayoutError(LassokinError, ValueError):
    """A landmark layout's description cannot be used (file, names, joints)."""


class CameraError(LassokinError, ValueError):
    """A camera's intrinsics, distortion or pose cannot be used."""


class ConfigurationError(LassokinError, ValueError):
    """A setting is out of its range or has the wrong type."""


class SolverError(LassokinError, RuntimeError):
    """A lasso was not posed correctly, or its solver is not available."""
