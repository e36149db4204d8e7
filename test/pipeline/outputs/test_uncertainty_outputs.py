"""The joints' uncertainty as messages: the values of the core in a cloud and as ellipsoids."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from messages import FRAME, camera_info, cloud, pixels_of_motion, rosbags_backend
from scipy.spatial.transform import Rotation

from lassokin_ros import joints
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.outputs.frame_messages import FrameMessages
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings
from msg_adapters.output_messages.clouds import SKELETONS_POINT

START_NS = 5_000_000_000
FIELDS = ["x", "y", "z", "joint", "deviation", "xx", "xy", "xz", "yy", "yz", "zz"]


def points_of(message):
    """A PointCloud2 as a structured array, by its fields."""
    kinds = {5: "<i4", 7: "<f4"}
    dtype = np.dtype(
        {
            "names": [f.name for f in message.fields],
            "formats": [kinds[f.datatype] for f in message.fields],
            "offsets": [f.offset for f in message.fields],
            "itemsize": message.point_step,
        }
    )
    assert len(message.data) == message.row_step * message.height == message.point_step * message.width
    return np.frombuffer(bytes(message.data), dtype)


@pytest.fixture(scope="module")
def tracked():
    """A session, and its frame after a part of the motion."""
    backend = rosbags_backend()
    session = Session(TrackerConfig(height=1.75), NodeSettings())
    session.set_camera(camera_info(backend))
    pixels = pixels_of_motion(10)
    frames = [session.process(cloud(backend, START_NS + i * 16_666_667, xy), 7) for i, xy in enumerate(pixels)]
    return session, frames[-1]


BACKEND = rosbags_backend()


def test_the_cloud_contains_the_values_of_the_core(tracked):
    session, frame = tracked
    expected = session.tracker.uncertainty(frame.estimate)
    (message,) = (m for t, m in FrameMessages(BACKEND, frame.skeleton).build(frame) if t == topics.JOINT_UNCERTAINTY)
    assert [f.name for f in message.fields] == FIELDS and message.header.frame_id == FRAME
    points = points_of(message)
    assert points["joint"].tolist() == list(range(24))
    places = np.stack([points["x"], points["y"], points["z"]], axis=1)
    assert np.allclose(places, frame.estimate.pose.positions, atol=1e-5)
    for row, column in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        name = "xyz"[row] + "xyz"[column]
        assert np.allclose(points[name], expected.covariance[:, row, column], rtol=1e-5, atol=1e-9), name
    assert np.allclose(points["deviation"], expected.deviation, rtol=1e-5)
    trace = points["xx"] + points["yy"] + points["zz"]
    assert np.allclose(np.sqrt(trace), points["deviation"], rtol=1e-4) and points["deviation"][0] == 0
    assert points["deviation"].max() > 0.01


def test_the_skeleton_has_rotations_deviations_and_the_vertical_after_its_other_fields(tracked):
    session, frame = tracked
    message = dict(FrameMessages(BACKEND, frame.skeleton).build(frame))[topics.SKELETON]
    offsets = {field.name: field.offset for field in message.fields}
    assert (offsets["zz"], offsets["index"], offsets["contact"], offsets["rotation_deviation"]) == (44, 48, 56, 60)
    points, expected = points_of(message), session.tracker.uncertainty(frame.estimate)
    assert np.allclose(points["rotation_deviation"], expected.rotation_deviation, rtol=1e-6)
    assert points["observed"].tolist().count(1) > 10 and SKELETONS_POINT.fields["person"][1] == 60
    turns = Rotation.from_quat(np.stack([points[name] for name in ("qx", "qy", "qz", "qw")], axis=1)).as_matrix()
    assert np.allclose(turns, frame.estimate.pose.orientations, atol=1e-6)
    assert np.allclose(points["deviation"], expected.deviation, rtol=1e-6) and points["deviation"][0] == 0
    up = np.stack([points[name] for name in ("up_x", "up_y", "up_z")], axis=1)
    assert np.allclose(up, frame.estimate.up, atol=1e-6) and up[0] @ turns[joints.PELVIS][:, 1] > 0.9
    assert points["still"].sum() == frame.estimate.still.sum()


def test_deviations_of_rotations_are_not_computed_without_a_subscriber(tracked):
    _, frame = tracked
    fresh = replace(frame)
    list(FrameMessages(rosbags_backend(), frame.skeleton).build(fresh, {topics.JOINT_UNCERTAINTY, topics.POSE}))
    assert "absolute" in vars(fresh.uncertainty) and "rotation_deviation" not in vars(fresh.uncertainty)


def test_ellipsoids_are_one_standard_deviation_along_each_axis(tracked):
    _, frame = tracked
    built = dict(FrameMessages(BACKEND, frame.skeleton, person="p4").build(frame))
    markers = built[topics.UNCERTAINTY_MARKERS].markers
    assert [m.id for m in markers] == list(range(24)) and {m.ns for m in markers} == {"p4/uncertainty"}
    for marker, covariance in list(zip(markers, frame.uncertainty.covariance))[1:]:
        q, s = marker.pose.orientation, marker.scale
        axes = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
        shape = axes @ np.diag(np.square([s.x, s.y, s.z]) / 4) @ axes.T
        assert np.allclose(shape, covariance, rtol=1e-6, atol=1e-6)
    assert min(markers[0].scale.x, markers[0].scale.y, markers[0].scale.z) > 0  # 0 for the pelvis, but still a marker


def test_limbs_are_relative_to_their_roots_in_axes_of_chest_and_pelvis(tracked):
    _, frame = tracked
    (message,) = (m for t, m in FrameMessages(BACKEND, frame.skeleton).build(frame) if t == topics.LIMBS)
    limbs, places = points_of(message), frame.estimate.pose.positions
    named = {(joints.NAMES[limb["root"]], joints.NAMES[limb["index"]]): limb for limb in limbs}
    assert len(named) == 12 and ("left_shoulder", "left_hand") in named and ("right_hip", "right_foot") in named
    for (root, end), limb in named.items():
        owner = joints.PELVIS if root.endswith("hip") else joints.SPINE3
        forward, left, up = np.eye(3)[[2, 0, 1]] @ frame.estimate.pose.orientations[owner].T  # of the T-pose
        apart = places[joints.INDEX[end]] - places[joints.INDEX[root]]
        assert np.allclose([limb[axis] for axis in "xyz"], [forward @ apart, left @ apart, up @ apart], atol=1e-6)
        both = sum(frame.uncertainty.covariance[joints.INDEX[name]] for name in (root, end))
        assert limb["xx"] == pytest.approx(forward @ both @ forward, rel=1e-5)
        assert limb["yz"] == pytest.approx(left @ both @ up, rel=1e-4, abs=1e-7)
        assert limb["deviation"] == pytest.approx(np.sqrt(np.trace(both)), rel=1e-5)
    seen = {end for (_, end), limb in named.items() if limb["observed"]}
    assert seen == {f"{side}_{part}" for side in ("left", "right") for part in ("elbow", "wrist", "knee", "ankle")}


def test_uncertainty_is_computed_once_and_only_on_request(tracked):
    session, _ = tracked
    asked = []
    frame = session.process(cloud(rosbags_backend(), START_NS + 10**9, pixels_of_motion(1)[0]), 7)
    measure = frame.tracker.uncertainty
    frame.tracker = SimpleNamespace(
        uncertainty=lambda estimate: asked.append(1) or measure(estimate), observed=frame.tracker.observed
    )
    messages = FrameMessages(rosbags_backend(), frame.skeleton)
    uncertain = (
        topics.JOINT_UNCERTAINTY,
        topics.UNCERTAINTY_MARKERS,
        topics.POSE,
        topics.SKELETON,
        topics.CERTIFICATE,
        topics.LIMBS,
    )
    others = {topic.name for topic in topics.PERSON_OUTPUTS} - set(uncertain)
    assert len(list(messages.build(frame, others))) == 6 and not asked
    assert len(list(messages.build(frame, uncertain))) == 6 and len(asked) == 1


def test_a_rejected_frame_has_no_uncertainty(tracked):
    session, _ = tracked
    frame = session.process(cloud(rosbags_backend(), 0, np.full((17, 2), np.nan)), START_NS + 2 * 10**9)
    assert not frame.accepted
    with pytest.raises(ValueError, match="rejected"):
        frame.uncertainty
