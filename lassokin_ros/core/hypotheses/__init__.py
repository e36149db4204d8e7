"""Where a frame may start other than from the tracked state: a fit, the network's pose, mirrored limbs."""
