"""A humanoid that imitates a person: a reference for its joints. Needs the extra `robot` (pin-pink); node.py needs ROS."""
