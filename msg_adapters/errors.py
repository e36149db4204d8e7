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

    def __str__(self) -> str:
        """Return the text. Unprintable characters, which texts in messages may have, are escaped as in Python."""
        text = super().__str__()
        return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
