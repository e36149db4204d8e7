"""The body's URDF from the node's parameters, before the node runs.

robot_state_publisher of Jazzy does not start without its parameter robot_description, so the launch file makes it from
the same parameters as the node.
"""

from __future__ import annotations

from pathlib import Path

from lassokin_ros.pipeline.outputs.urdf import urdf
from lassokin_ros.pipeline.parameter_files import offline_settings
from lassokin_ros.skeleton_readers.load import load_skeleton


def urdf_from_parameters(parameter_file: Path, base_frame: str = "") -> str:
    """The URDF as XML text; base_frame: instead of the parameter's. Raises a LassokinError."""
    tracker, node = offline_settings([parameter_file], [])
    return urdf(load_skeleton(tracker.skeleton, tracker.height), base_frame or node.base_frame)
