"""Small helpers shared by several packages: files, progress, interrupts."""
