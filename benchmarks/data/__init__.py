"""Motion capture, detector output and synthetic scenes as sequences of observations."""
