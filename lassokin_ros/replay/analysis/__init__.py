"""What the frames of a recording tell together: doubts about the pose, and the floor."""
