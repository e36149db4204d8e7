"""The URDF of a body from the node's settings, before the node runs.

robot_state_publisher of Jazzy does not start without its parameter robot_description. The launch file makes the URDF
from the settings that it starts the node with.
"""

from __future__ import annotations

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.pipeline.outputs.description.urdf import urdf
from lassokin_ros.pipeline.outputs.topics import link_prefix
from lassokin_ros.pipeline.parameter_files import NODE_NAME
from lassokin_ros.pipeline.settings import NodeSettings
from lassokin_ros.skeleton_readers.load import load_skeleton


def urdf_from_settings(tracker: TrackerConfig, settings: NodeSettings, node: str = NODE_NAME) -> str:
    """Return the URDF as XML text. node: the full name of the node without the first slash. Raises a LassokinError."""
    prefix = link_prefix(settings.frame_prefix, node)
    return urdf(load_skeleton(tracker.skeleton, tracker.assumed_height), settings.root_frame, prefix)
