"""Modules imported by tests that a machine with ROS 2 and rosdep's packages does not have."""

PIP_ONLY = {
    *("qpsolvers", "proxsuite", "rosbags", "hypothesis", "pinocchio", "yourdfpy", "matplotlib"),
    *("distributed", "clarabel", "daqp", "quadprog", "sklearn", "onnx", "onnxruntime", "playwright", "pybvh"),
    *("importlinter", "catkin_pkg", "colcon_core"),
}
"""Some of them (matplotlib, sklearn, catkin_pkg) have apt packages, but package.xml does not require these."""
