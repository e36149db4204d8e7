"""The body as a robot description (URDF) and as a skeleton file."""
