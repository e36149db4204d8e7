"""What to install if a package cannot be imported."""

from __future__ import annotations

import sys

FROM_PIP = ("proxsuite", "qpsolvers", "numpy", "scipy", "yaml", "rosbags", "cv2", "matplotlib", "pink", "pinocchio")
"""Packages that pip installs, with any installation of ROS. The first two exist only for pip."""
PIP_NAMES = {"yaml": "PyYAML", "cv2": "opencv-python-headless", "pink": "pin-pink", "pinocchio": "pin-pink"}


def missing_package(error: ImportError) -> str:
    """Return one line for the user: which package is missing, and how to install it."""
    module = (error.name or "").partition(".")[0]
    if module in FROM_PIP:
        name = PIP_NAMES.get(module, module)
        return f"the Python package {name} is not installed: {pip_install()} {name}"
    return f"{error}; the node needs ROS 2's rclpy and common_interfaces, see the README"


def pip_install() -> str:
    """Return the command that installs a package. Only outside a virtual environment it needs an option."""
    in_environment = sys.prefix != sys.base_prefix
    return "pip install" if in_environment else "pip install --break-system-packages"
