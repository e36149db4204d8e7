"""What the frames of a recording tell together: the floor, and the body's capsules."""
