"""What a frame's lasso is made of, one class per file, and what is learned to feed it."""
