"""The method. It imports numpy, scipy, proxsuite, qpsolvers and PyYAML, and is independent of ROS."""
