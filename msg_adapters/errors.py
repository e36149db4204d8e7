"""What a decoder says of a message that it cannot use."""


class AdapterError(Exception):
    """A message cannot be used.

    Attributes
    ----------
    reason: short key in snake_case, for counting in diagnostics.
    """

    def __init__(self, reason: str, message: str) -> None:
        super().__init__(message)
        self.reason = reason
