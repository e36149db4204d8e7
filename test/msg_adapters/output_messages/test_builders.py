"""Every field that the output messages' builders set, against values worked out by hand."""

import zlib
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags makes the messages")

from messages import rosbags_backend  # noqa: E402

from lassokin_ros.replay.bags import register_types  # noqa: E402
from msg_adapters.inputs import POINT, camera_info, point_cloud, rgb_image  # noqa: E402
from msg_adapters.output_messages import builders, clouds, markers, people  # noqa: E402

STAMP, FRAME = 12_345_678_901, "camera"
POSITIONS = np.arange(6.0).reshape(2, 3)
QUATERNIONS = 10 + np.arange(8.0).reshape(2, 4)
COVARIANCE = 100 + np.arange(36.0).reshape(6, 6)
SYMMETRIC = np.array([[[1, 2, 3], [2, 4, 5], [3, 5, 6]], [[7, 8, 9], [8, 10, 11], [9, 11, 12]]], dtype=float)
UPPER = [[1, 2, 3, 4, 5, 6], [7, 8, 9, 10, 11, 12]]
"""xx, xy, xz, yy, yz, zz of each."""


@pytest.fixture(scope="module")
def backend():
    """With the types of packages that Jazzy's common interfaces lack."""
    backend = rosbags_backend()
    register_types(backend._typestore)
    return backend


def vector(message):
    return [getattr(message, axis) for axis in ("x", "y", "z", "w") if hasattr(message, axis)]


def colour(message):
    return (message.r, message.g, message.b, message.a)


def check_header(header, frame=FRAME):
    assert (header.stamp.sec, header.stamp.nanosec, header.frame_id) == (12, 345_678_901, frame)


def points(message, dtype):
    """A cloud's points, checked for what every reader needs."""
    check_header(message.header)
    assert (message.height, message.width, message.point_step) == (
        1,
        len(message.data) // dtype.itemsize,
        dtype.itemsize,
    )
    assert message.row_step == len(message.data) and not message.is_bigendian
    assert message.is_dense == (dtype != people.POINT)  # people without a place are NaN
    kinds = {np.dtype("<i4"): 5, np.dtype("<f4"): 7}
    for field, name in zip(message.fields, dtype.names, strict=True):
        kind, offset = dtype.fields[name]
        assert (field.name, field.offset, field.datatype, field.count) == (name, offset, kinds[kind], 1)
    return np.frombuffer(message.data.tobytes(), dtype)


def test_joint_states(backend):
    builder = builders.JointStateBuilder(backend, ("a", "b", "c"))
    message = builder.fill(STAMP, FRAME, np.array([1.0, 2, 3]), np.array([4.0, 5, 6]))
    check_header(message.header)
    assert message.name == ["a", "b", "c"] and len(message.effort) == 0
    assert (message.position.tolist(), message.velocity.tolist()) == ([1, 2, 3], [4, 5, 6])


def test_point_and_poses(backend):
    message = builders.PointStampedBuilder(backend).fill(STAMP, FRAME, np.array([1.0, 2, 3]))
    check_header(message.header)
    assert vector(message.point) == [1, 2, 3]
    message = builders.PoseArrayBuilder(backend, 2).fill(STAMP, FRAME, POSITIONS, QUATERNIONS)
    check_header(message.header)
    assert [vector(pose.position) for pose in message.poses] == POSITIONS.tolist()
    assert [vector(pose.orientation) for pose in message.poses] == QUATERNIONS.tolist()


def test_pose_with_covariance(backend):
    builder = builders.PoseWithCovarianceBuilder(backend)
    message = builder.fill(STAMP, FRAME, POSITIONS[1], QUATERNIONS[1], COVARIANCE)
    check_header(message.header)
    assert vector(message.pose.pose.position) == [3, 4, 5]
    assert vector(message.pose.pose.orientation) == [14, 15, 16, 17]
    assert message.pose.covariance.tolist() == COVARIANCE.reshape(-1).tolist()


def test_transforms_have_their_parent_or_the_messages_frame(backend):
    builder = builders.TransformsBuilder(backend, [("", "pelvis"), ("pelvis", "head")])
    for frame in (FRAME, "another"):
        first, second = builder.fill(STAMP, frame, POSITIONS, QUATERNIONS).transforms
        check_header(first.header, frame)
        check_header(second.header, "pelvis")
        assert (first.child_frame_id, second.child_frame_id) == ("pelvis", "head")
        assert vector(first.transform.translation) == [0, 1, 2] and vector(second.transform.translation) == [3, 4, 5]
        assert vector(first.transform.rotation) == [10, 11, 12, 13]
        assert vector(second.transform.rotation) == [14, 15, 16, 17]


def test_texts_and_ids(backend):
    assert builders.StringBuilder(backend).fill("words").data == "words"
    message = builders.IdsListBuilder(backend).fill(STAMP, FRAME, ("p1", "p2"))
    check_header(message.header)
    assert message.ids == ["p1", "p2"]


def test_diagnostics_of_more_and_fewer_lines_and_values(backend):
    builder = builders.DiagnosticArrayBuilder(backend)
    lines = [
        builders.StatusLine(builders.OK, "first", "fine", "camera", {"a": "1", "b": "2"}),
        builders.StatusLine(builders.WARN, "second", "so so", values={"c": "3"}),
        builders.StatusLine(builders.ERROR, "third", "bad"),
    ]
    for chosen in (lines, lines[:1], lines[::-1], []):
        message = builder.fill(STAMP, FRAME, chosen)
        check_header(message.header)
        assert len(message.status) == len(chosen)
        for status, line in zip(message.status, chosen):
            assert (status.level, status.name, status.message) == (line.level, line.name, line.message)
            assert status.hardware_id == line.hardware_id
            assert {pair.key: pair.value for pair in status.values} == line.values
            assert len(status.values) == len(line.values)
    assert (builders.OK, builders.WARN, builders.ERROR) == (0, 1, 2)


def test_the_skeletons_cloud(backend):
    builder = clouds.SkeletonCloudBuilder(backend, 2)
    no, yes, turns = np.array([True, False]), np.array([False, True]), np.arange(8.0).reshape(2, 4)
    doubts, up = (np.array([0.5, 0.25]), np.array([0.125, 2.0])), np.array([7.0, 8.0, 9.0])
    report = clouds.JointsReport(3, POSITIONS, POSITIONS + 20, SYMMETRIC, no, yes, no, *doubts, turns, up)
    cloud = points(builder.fill(STAMP, FRAME, report), clouds.SKELETON_POINT)
    assert clouds.SKELETON_POINT.names[:12] == ("x", "y", "z", "vx", "vy", "vz", "xx", "xy", "xz", "yy", "yz", "zz")
    for joint, point in enumerate(cloud.tolist()):
        place = (*POSITIONS[joint], *POSITIONS[joint] + 20, *UPPER[joint])
        doubt = (doubts[0][joint], doubts[1][joint])
        assert point == (*place, joint, 1 - joint, joint, *doubt, *turns[joint], *up, 1 - joint)


def test_the_uncertaintys_cloud(backend):
    builder = clouds.UncertaintyCloudBuilder(backend, 2)
    message = builder.fill(STAMP, FRAME, POSITIONS, SYMMETRIC, np.array([0.5, 0.25]))
    cloud = points(message, clouds.UNCERTAINTY_POINT)
    assert len(cloud) == 2
    for joint, point in enumerate(cloud.tolist()):
        assert point == (*POSITIONS[joint], joint, (0.5, 0.25)[joint], *UPPER[joint])


def test_ellipsoids(backend):
    builder = markers.UncertaintyMarkersBuilder(backend, 2, "p1/")
    axes = np.array([[0.1, 0.2, 0.3], [0.0, 0.0004, 0.0006]])
    message = builder.fill(STAMP, FRAME, POSITIONS, QUATERNIONS, axes)
    assert len(message.markers) == 2
    for i, marker in enumerate(message.markers):
        check_header(marker.header)
        assert (marker.ns, marker.id, marker.type, marker.action) == ("p1/uncertainty", i, 2, 0)
        assert vector(marker.pose.position) == POSITIONS[i].tolist()
        assert vector(marker.pose.orientation) == QUATERNIONS[i].tolist()
        assert vector(marker.scale) == pytest.approx([[0.2, 0.4, 0.6], [0.001, 0.001, 0.0012]][i])  # at least 1 mm
        assert colour(marker.color) == markers.UNCERTAINTY_COLOUR and 0 < min(colour(marker.color)) < 1
        assert max(colour(marker.color)) <= 1
        assert (marker.lifetime.sec, marker.lifetime.nanosec) == (1, 0)


def test_skeleton_markers(backend):
    builder = markers.SkeletonMarkersBuilder(backend, [-1, 0, 1], "p1/")
    positions = np.arange(9.0).reshape(3, 3)
    message = builder.fill(STAMP, FRAME, positions)
    bones, joints = message.markers
    kinds = {"p1/bones": (5, 0.025), "p1/joints": (7, 0.05)}
    for marker in message.markers:
        check_header(marker.header)
        kind, size = kinds[marker.ns]
        assert (marker.type, marker.action, vector(marker.scale)) == (kind, 0, [size] * 3)
        assert vector(marker.pose.orientation) == [0, 0, 0, 1]
        assert (marker.lifetime.sec, marker.lifetime.nanosec) == (1, 0) and marker.color.a == 1
    assert [marker.id for marker in message.markers] == [0, 1]
    assert [vector(point) for point in bones.points] == positions[[0, 1, 1, 2]].tolist()
    assert [vector(point) for point in joints.points] == positions.tolist()
    seen = [colour(marker.color) for marker in (bones, joints)]
    assert seen == [markers.BONE_COLOUR, markers.JOINT_COLOUR] and len(set(seen)) == 2
    assert all(0 <= part <= 1 for colours in seen for part in colours)
    plain = markers.SkeletonMarkersBuilder(backend, [-1, 0]).fill(STAMP, FRAME, positions[:2])
    assert [marker.ns for marker in plain.markers] == ["bones", "joints"]


def test_fingers_are_thin_lines_without_spheres(backend):
    positions = np.arange(12.0).reshape(4, 3)
    message = markers.SkeletonMarkersBuilder(backend, [-1, 0, 1, 2], "", (2, 3)).fill(STAMP, FRAME, positions)
    bones, joints, fingers = message.markers
    assert (fingers.ns, fingers.id, fingers.type, fingers.scale.x) == ("fingers", 2, 5, markers.FINGER_SIZE)
    assert [vector(point) for point in bones.points] == positions[[0, 1]].tolist()
    assert [vector(point) for point in joints.points] == positions[[0, 1]].tolist()
    assert [vector(point) for point in fingers.points] == positions[[1, 2, 2, 3]].tolist()


def test_image_and_keypoint_markers(backend):
    detected, back = np.array([[10.0, 20], [np.nan, 0]]), np.array([[30.0, 40], [50, 60]])
    marker = markers.ImageMarkerBuilder(backend, [-1, 0]).fill(STAMP, FRAME, back, detected, back)
    check_header(marker.header)
    assert (marker.ns, marker.type, marker.action, marker.scale) == ("skeleton", 2, 0, 2.0)
    assert colour(marker.outline_color) == markers.BONE_COLOUR
    assert (marker.lifetime.sec, marker.lifetime.nanosec) == (1, 0)
    bone, upright = [[30, 40], [50, 60]], [[5, 20], [15, 20], [10, 15], [10, 25]]
    oblique = [[x + dx, y + dy] for x, y in back for dx, dy in ((-5, -5), (5, 5), (-5, 5), (5, -5))]
    assert [vector(point)[:2] for point in marker.points] == bone + upright + oblique
    colours = [markers.BONE_COLOUR] + [markers.DETECTED] * 2 + [markers.REPROJECTED] * 4
    assert [colour(one) for one in marker.outline_colors] == colours and len(set(colours)) == 3
    assert all(0 <= part <= 1 for one in colours for part in one)


def test_keypoints_on_a_plane_before_the_camera(backend):
    rays, back = np.array([[0.1, 0.2], [np.nan, 0]]), np.array([[0.3, 0.4], [0.5, 0.6]])
    marker = markers.KeypointMarkerBuilder(backend, "p1/").fill(STAMP, FRAME, rays, back)
    check_header(marker.header)
    assert (marker.ns, marker.type, marker.id, vector(marker.scale)) == ("p1/keypoints", 7, 0, [0.008] * 3)
    assert vector(marker.pose.orientation) == [0, 0, 0, 1] and marker.color.a == 1
    assert [vector(point) for point in marker.points] == [[0.1, 0.2, 1], [0.3, 0.4, 1], [0.5, 0.6, 1]]
    assert [colour(one) for one in marker.colors] == [markers.DETECTED] + [markers.REPROJECTED] * 2
    assert (marker.lifetime.sec, marker.lifetime.nanosec) == (1, 0)


PLACE = POSITIONS[1], QUATERNIONS[1], POSITIONS[1] + 20, COVARIANCE
CORNERS = np.array([[0, 7, 2], [1, 1, 10], [4, 2, 3.0]])
FLAGS = {"age": 0.25, "detector_id": 12, "guessed": True, "doubtful": True}
PEOPLE = [
    people.PersonReport("p7", True, 0.75, *PLACE, CORNERS, **FLAGS, velocity_covariance=np.arange(9.0).reshape(3, 3)),
    people.PersonReport("x", False, 0.0, POSITIONS[0], QUATERNIONS[0], POSITIONS[0], COVARIANCE, np.zeros((2, 3))),
]
PERSON_COVARIANCE = [100, 101, 102, 107, 108, 114]


@pytest.mark.parametrize(
    ("id", "number"),
    [
        ("p0", 0),
        ("p123456789", 123456789),
        ("123456789", 0xCBF43926 & 0x7FFFFFFF),  # CRC-32's check value
        ("p1234567890", zlib.crc32(b"p1234567890") & 0x7FFFFFFF),  # too long for int32
        ("P7", zlib.crc32(b"P7") & 0x7FFFFFFF),
    ],
)
def test_people_have_numbers(id, number):
    assert people.PersonReport(id, *([True] + [None] * 6)).number == number


def test_people_as_detections(backend):
    builder = people.people_builder(backend, "vision_msgs/msg/Detection3DArray")
    message = builder.fill(STAMP, FRAME, PEOPLE)
    check_header(message.header)
    found, lost = message.detections
    check_header(found.header)
    assert (found.id, lost.id) == ("p7", "x")
    (result,) = found.results
    assert (result.hypothesis.class_id, result.hypothesis.score) == ("person", 0.75)
    assert vector(result.pose.pose.position) == [3, 4, 5]
    assert vector(result.pose.pose.orientation) == [14, 15, 16, 17]
    assert result.pose.covariance.tolist() == COVARIANCE.reshape(-1).tolist()
    assert vector(found.bbox.center.position) == [2, 4, 6] and vector(found.bbox.size) == [4, 6, 8]
    assert vector(found.bbox.center.orientation) == [0, 0, 0, 1]
    assert builder.fill(STAMP, FRAME, []).detections == []


def test_people_as_people_msgs(backend):
    message = people.people_builder(backend, "people_msgs/msg/People").fill(STAMP, FRAME, PEOPLE)
    check_header(message.header)
    found, lost = message.people
    assert (found.name, found.reliability) == ("p7", 0.75)
    assert vector(found.position) == [3, 4, 5] and vector(found.velocity) == [23, 24, 25]
    assert found.tagnames[:7] == ["state", "xx", "xy", "xz", "yy", "yz", "zz"]
    assert found.tagnames[7:] == ["age", "detector_id", "guessed", "doubtful", "locked", "out_of_view"]
    assert found.tags == ["tracking", *map(str, PERSON_COVARIANCE), "0.250", "12", "1", "1", "0", "0"]
    assert (lost.tags[0], lost.tags[-6:]) == ("lost", ["0.000", "-1", "0", "0", "0", "0"])


def test_people_as_a_cloud(backend):
    builder = people.people_builder(backend, people.CLOUD_TYPE)
    cloud = points(builder.fill(STAMP, FRAME, PEOPLE), people.POINT)
    place = [*POSITIONS[1], *POSITIONS[1] + 20, *PERSON_COVARIANCE]
    assert cloud[0].tolist() == (*place, 0.75, 0.25, 7, 1, 12, 1, 1, 0, 0, 0, 1, 2, 4, 5, 8)
    assert cloud[1].tolist()[12:21] == (0, 0, PEOPLE[1].number, 0, -1, 0, 0, 0, 0)
    assert len(points(builder.fill(STAMP, FRAME, []), people.POINT)) == 0


@pytest.mark.parametrize(("number", "in_field"), [(2**31 - 1, 2**31 - 1), (2**31, -1), (10**17, -1)])
def test_a_detectors_number_that_has_no_room_in_the_cloud_is_none(backend, number, in_field):
    builder = people.people_builder(backend, people.CLOUD_TYPE)
    message = builder.fill(STAMP, FRAME, [replace(PEOPLE[0], detector_id=number)])
    assert points(message, people.POINT)["detector_id"].tolist() == [in_field]


def test_inputs(backend):
    """What recordings and examples are made of."""
    pixels = np.array([[1.0, 2], [3, 4], [5, 6]])
    cloud = points(point_cloud(backend, STAMP, FRAME, pixels, np.array([0.5, 0, 1])), POINT)
    assert cloud.tolist() == [(1, 2, 0.5, 0), (5, 6, 1, 2)]
    K = np.array([[600.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    info = camera_info(backend, STAMP, FRAME, K, [0.1, 0.2, 0, 0, 0.3], (640, 480))
    check_header(info.header)
    assert (info.width, info.height, info.distortion_model) == (640, 480, "plumb_bob")
    assert info.d.tolist() == [0.1, 0.2, 0, 0, 0.3] and info.k.tolist() == K.reshape(-1).tolist()
    assert info.r.tolist() == [1, 0, 0, 0, 1, 0, 0, 0, 1]
    assert info.p.tolist() == [600, 0, 320, 0, 0, 500, 240, 0, 0, 0, 1, 0]
    assert camera_info(backend, STAMP, FRAME, K, [0.1] * 4, (640, 480), "equidistant").distortion_model == "equidistant"
    rgb = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    image = rgb_image(backend, STAMP, FRAME, rgb)
    check_header(image.header)
    assert (image.height, image.width, image.encoding, image.step, image.is_bigendian) == (2, 4, "rgb8", 12, 0)
    assert image.data.tolist() == list(range(24))


def test_hands_have_the_points_and_what_all_points_of_a_hand_share(backend):
    def hand(side, first):
        numbers = first + np.arange(63.0).reshape(21, 3)
        return clouds.HandReport(
            side, 7, numbers, np.tile(SYMMETRIC[0], (21, 1, 1)), np.arange(21) % 2 == 0, numbers[0], np.arange(4.0),
            numbers[1], 0.5, 3, 0.25,
        )  # fmt: skip

    message = clouds.HandCloudBuilder(backend, 2).fill(STAMP, FRAME, [hand(0, 0.0), hand(1, 500.0)])
    cloud = points(message, clouds.HAND_POINT).reshape(2, 21)
    assert [cloud[name][1, 20] for name in "xyz"] == [560, 561, 562]
    assert [cloud[name][0, 3] for name in ("xx", "xy", "xz", "yy", "yz", "zz")] == UPPER[0]
    assert cloud["deviation"][0, 0] == pytest.approx(np.sqrt(1 + 4 + 6))
    assert cloud["index"].tolist() == [list(range(21))] * 2 and cloud["side"][:, 0].tolist() == [0, 1]
    assert cloud["observed"][1, :3].tolist() == [1, 0, 1] and (cloud["person"] == 7).all()
    shared = {name: cloud[name][1] for name in clouds.OF_HAND}
    assert all((values == values[0]).all() for values in shared.values())
    assert [values[0] for values in shared.values()] == [500, 501, 502, 0, 1, 2, 3, 503, 504, 505, 0.5, 0.25]
    assert (cloud["gesture"] == 3).all()
