"""A humanoid that imitates a person: a reference for its joints. It needs the extra `robot`; node.py needs ROS."""
