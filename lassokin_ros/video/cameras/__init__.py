"""Several videos: where their cameras are, and their clocks."""
