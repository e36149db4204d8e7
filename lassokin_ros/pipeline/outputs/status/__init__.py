"""Status of tracking: /diagnostics, ~/state, reasons for rejected frames."""
