"""Which topics the log offers as keypoints: no lidar, and no output of a tracker."""

import pytest

pytest.importorskip("rclpy")

from lassokin_ros.node.missing_input import _may_be_keypoints  # noqa: E402

CLOUD = "sensor_msgs/msg/PointCloud2"


@pytest.mark.parametrize("name", ["/pose/keypoints", "/detector/people", "/Human_Pose/points", "/body_tracking"])
def test_topics_that_may_be_keypoints(name):
    assert _may_be_keypoints(name, CLOUD)


@pytest.mark.parametrize("name", ["/velodyne_points", "/camera/depth/color/points", "/tracker/joint_uncertainty"])
def test_lidars_and_outputs_of_trackers_are_not_offered(name):
    assert not _may_be_keypoints(name, CLOUD)


def test_a_type_that_only_detectors_have_is_always_offered():
    assert _may_be_keypoints("/yolo/detections", "yolo_msgs/msg/DetectionArray")
