"""Keypoints and camera_info of images of different sizes: used where the messages tell the size, refused otherwise."""

import numpy as np
import pytest
from detector_messages import YOLO, ZED, backend, yolo_detections, zed_objects
from messages import FRAME, camera_info, cloud

from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.image.projection import project
from lassokin_ros.demo.synthetic import motion
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings

BACKEND = backend()
SIZE, FOCAL, HZ, COUNT = np.array([1920, 1080]), 1050.0, 30.0, 15
"""Of the image of the keypoints, px."""
SKELETON = Skeleton.load("anthropometric", 1.75)


def landmarks(layout, distance, aside=0.0):
    """(COUNT, l, 3) m in the optical frame; distance, aside: of the pelvis, m."""
    states = motion(SKELETON, np.arange(COUNT) / HZ)
    pose = Kinematics(SKELETON, Layout.load(layout, SKELETON)).pose(states)
    return pose.landmarks + [aside, 0, distance - pose.positions[0, 0, 2]]


def info(factor, **fields):
    """camera_info of an image `factor` times as large as that of the keypoints."""
    width, height = (int(side) for side in factor * SIZE)
    focal, cx, cy = FOCAL * factor, width / 2, height / 2
    k, p = np.array([focal, 0, cx, 0, focal, cy, 0, 0, 1]), np.array([focal, 0, cx, 0, 0, focal, cy, 0, 0, 0, 1.0, 0])
    return camera_info(BACKEND, width=width, height=height, k=k, p=p, **fields)


def zed(stamp_ns, points):
    """A message of ZED: points (38, 3) m; its skeleton has errors of 2 cm."""
    random = np.random.default_rng(stamp_ns)
    message = zed_objects(BACKEND, stamp_ns, [project(points) * FOCAL + SIZE / 2 + random.normal(size=(38, 2))], [4])
    for keypoint, (x, y, z) in zip(message.objects[0].skeleton_3d.keypoints, points + random.normal(0, 0.02, (38, 3))):
        keypoint.kp = np.array([z, -x, -y], dtype=np.float32)
    return message


def yolo(stamp_ns, points):
    """A message of yolo_ros with 3D points in the optical frame of the image, measured on the surface."""
    pixels = project(points) * FOCAL + SIZE / 2
    message = yolo_detections(BACKEND, stamp_ns, FRAME, [(pixels, np.full(17, 0.9))], ["4"])
    found = message.detections[0].keypoints3d
    found.frame_id = FRAME
    for index, (x, y, z) in enumerate(points - [0, 0, 0.05]):
        point = BACKEND.make("yolo_msgs/msg/KeyPoint3D")
        point.id, point.point.x, point.point.y, point.point.z = index + 1, x, y, z
        found.data.append(point)
    return message


def pixels_alone(stamp_ns, points):
    return cloud(BACKEND, stamp_ns, project(points) * FOCAL + SIZE / 2)


DETECTORS = {ZED: (zed, "zed38"), YOLO: (yolo, "coco17"), "sensor_msgs/msg/PointCloud2": (pixels_alone, "coco17")}


def run(kind, camera, distance, aside=0.0):
    """Return the session and the results of the messages."""
    make, layout = DETECTORS[kind]
    config = TrackerConfig(landmarks=layout, height=0.0 if kind == ZED else 1.75)
    session = Session(config, NodeSettings(keypoints_type=kind, rectified=kind == ZED))
    assert session.set_camera(camera) is None
    stamps = [int(1e9 * (5 + i / HZ)) for i in range(COUNT)]
    messages = (make(stamp_ns, points) for stamp_ns, points in zip(stamps, landmarks(layout, distance, aside)))
    return session, [session.process(message, stamp_ns) for message, stamp_ns in zip(messages, stamps)]


def pelvis(result):
    return result.estimate.pose.positions[0]


@pytest.mark.parametrize("factor, distance", [(0.5, 3.76), (2 / 3, 6.96), (1.0, 3.76), (2.0, 6.96)])
@pytest.mark.parametrize("kind", [ZED, YOLO])
def test_the_detectors_3d_points_tell_the_size_of_its_image(kind, factor, distance):
    session, results = run(kind, info(factor), distance, aside=-0.4 if distance > 5 else 0.0)
    assert all(result.accepted for result in results)
    assert pelvis(results[-1])[2] == pytest.approx(distance, rel=0.05)
    found = session.first.image_size.concern
    if factor == 1.0:
        assert found is None
    else:
        width, height = (factor * SIZE).astype(int)
        assert f"camera_info is of an image of {width} x {height} px" in found.text and "1920 x 1080 px" in found.text
        assert "pub_resolution: NATIVE" in found.text


@pytest.mark.parametrize(("factor", "used"), [(0.87, True), (0.57, False), (1.2, False)])
def test_an_uncertain_size_is_refused_with_the_remedy(factor, used):
    _, results = run(ZED, info(factor), 3.76)
    assert [result.accepted for result in results] == [used] * COUNT
    if not used:
        assert {result.rejection for result in results} == {"other_size"}
        assert "pub_resolution: NATIVE" in results[0].detail


@pytest.mark.parametrize("fields", [{"binning_x": 2, "binning_y": 2}, {}])
def test_binning_that_camera_info_names_and_the_image_has_not(fields):
    _, results = run(ZED, info(1.0, **fields), 3.76)
    assert all(result.accepted for result in results)
    assert pelvis(results[-1])[2] == pytest.approx(3.76, rel=0.05)


def test_another_camera_info_is_compared_anew():
    session, _ = run(ZED, info(0.5), 3.76)
    assert session.set_camera(info(1.0)) is None
    (result,) = [session.process(zed(int(6e9), landmarks("zed38", 3.76)[-1]), int(6e9))]
    assert result.accepted and pelvis(result)[2] == pytest.approx(3.76, rel=0.05)
    assert not session.first.image_size.concern


def test_a_single_message_with_other_3d_points_changes_nothing():
    session, _ = run(ZED, info(1.0), 3.76)
    points = landmarks("zed38", 3.76)[-1]
    for i in range(8):
        message = zed(int(6e9 + i * 3e7), points)
        if i % 5 < 4:  # at most four in a row
            for body in message.objects[0].skeleton_3d.keypoints:
                body.kp = body.kp * np.array([1, 2, 2], np.float32)
        result = session.process(message, int(6e9 + i * 3e7))
        assert result.accepted and pelvis(result)[2] == pytest.approx(3.76, rel=0.05)


def test_a_person_who_is_outside_of_the_image_is_refused():
    session, results = run("sensor_msgs/msg/PointCloud2", info(0.5), 3.76)  # the person is at 960 of 960 px
    refused = [result for result in results if not result.accepted]
    assert len(refused) > 10 and {result.rejection for result in refused} == {"other_size"}
    assert "are outside of camera_info's image of 960 x 540 px" in refused[0].detail
    assert "pub_resolution: NATIVE" in refused[0].detail
    inside = pixels_alone(int(6e9), landmarks("coco17", 6.96, -4.0)[0])
    after = session.process(inside, int(6e9))  # it is certain now, wherever people are
    assert after.rejection == "other_size"
    assert session.set_camera(info(1.0)) is None
    assert session.process(inside, int(6.1e9)).accepted


def test_limbs_outside_of_the_image_are_those_of_the_same_image():
    _, results = run("sensor_msgs/msg/PointCloud2", info(1.0), 1.3, aside=1.2)
    pixels = project(landmarks("coco17", 1.3, 1.2)) * FOCAL + SIZE / 2
    outside = (pixels > SIZE * 1.05).any(axis=2).sum(axis=1)  # of 17
    few = [result for result, count in zip(results, outside) if 6 <= count <= 8]
    assert few and all(result.rejection != "other_size" for result in few)
