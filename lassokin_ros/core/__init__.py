"""The method. It imports numpy, scipy, proxsuite, qpsolvers and PyYAML, and knows no ROS."""
