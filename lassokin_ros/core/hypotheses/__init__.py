"""Where a frame may start other than from the tracked state: first fit, and the pose of the depth network."""
