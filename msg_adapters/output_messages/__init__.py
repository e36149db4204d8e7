"""Arrays to output messages, as message objects or already serialised (CDR)."""
