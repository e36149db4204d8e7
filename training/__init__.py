"""Training of what the product ships as learned: the depth network."""
