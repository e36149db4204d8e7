"""Training of the depth network that the package ships."""
