"""2D pose detectors behind one interface. Each backend is imported only when it is used."""
