"""The method. It imports numpy, scipy, proxsuite, qpsolvers and PyYAML, and is independent of ROS.

`tracker` is the entry point. Users import the public names from `lassokin_ros`; all others are internal.
"""
