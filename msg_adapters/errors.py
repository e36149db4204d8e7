"""Error of the message decoders."""


class AdapterError(Exception):
    """A message is unusable.

    Attributes
    ----------
    reason: short key in snake_case, counted in diagnostics.
    """

    def __init__(self, reason: str, message: str) -> None:
        super().__init__(message)
        self.reason = reason
