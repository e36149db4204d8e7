"""Small helpers that several packages share: files, progress, interrupts."""
