"""Messages about all people, the state of tracking and TF of the joints, without middleware."""

from dataclasses import replace

import numpy as np
import pytest
from detector_messages import detector_types
from messages import FRAME, camera_info, cloud, pixels_of_motion, rosbags_backend
from scipy.spatial.transform import Rotation

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.errors import ConfigurationError
from lassokin_ros.core.observation import CameraPose, Status
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.outputs.body_frames import LINKS, Naming
from lassokin_ros.pipeline.outputs.frame_messages import FrameMessages
from lassokin_ros.pipeline.outputs.scene_messages import (
    PeopleMessages,
    PresenceState,
    joints_report,
    person_report,
)
from lassokin_ros.pipeline.parameter_files import offline_settings
from lassokin_ros.pipeline.people.roster import Presence
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings
from lassokin_ros.replay.bags import register_types
from msg_adapters.backends import RosbagsBackend
from msg_adapters.output_messages.clouds import SKELETON_POINT, SKELETONS_POINT, SkeletonsCloudBuilder
from msg_adapters.output_messages.people import CLOUD_TYPE, DETECTIONS_TYPE, PEOPLE_TYPE, POINT, TYPES

START_NS, SECOND = 5_000_000_000, 1_000_000_000
PIXELS = pixels_of_motion(8)
BACKEND = rosbags_backend()
register_types(BACKEND._typestore)


@pytest.fixture(scope="module")
def frames():
    session = Session(TrackerConfig(height=1.75), NodeSettings())
    session.set_camera(camera_info(BACKEND))
    return [session.process(cloud(BACKEND, START_NS + i * 20_000_000, PIXELS[i]), 7) for i in range(8)]


def people_at(frames, message_type, stamp_ns):
    """The message at a time after the last frame, serialised and deserialised."""
    messages = PeopleMessages(BACKEND, message_type)
    messages.update(frames, None)
    store = BACKEND._typestore
    message = messages.build((stamp_ns, FRAME), lost_after=1.0, forget_after=3.0)
    return store.deserialize_cdr(store.serialize_cdr(message, message_type), message_type)


@pytest.mark.parametrize("message_type", TYPES)
@pytest.mark.parametrize("age_s, state", [(0, "tracking"), (2, "lost"), (4, "nobody")])
def test_each_people_type_contains_the_person_of_the_frame(frames, message_type, age_s, state):
    newest = frames[-1]
    message = people_at(frames, message_type, newest.stamp_ns + age_s * SECOND)
    assert message.header.frame_id == FRAME
    people = {
        CLOUD_TYPE: lambda m: np.frombuffer(m.data.tobytes(), POINT),
        DETECTIONS_TYPE: lambda m: m.detections,
        PEOPLE_TYPE: lambda m: m.people,
    }[message_type](message)
    assert len(people) == (state != "nobody")
    if state == "nobody":
        return
    sure = 1 - newest.likely_wrong if state == "tracking" else 0.0
    place, covariance = newest.estimate.pose.positions[0], newest.uncertainty.absolute.pelvis
    (person,) = people
    if message_type == CLOUD_TYPE:
        assert (person["person"], person["tracked"]) == (1, state == "tracking")
        assert np.allclose([person[name] for name in ("vx", "vy", "vz")], newest.velocity, atol=1e-6)
        given = [person[name] for name in "xyz"], person["confidence"], person["zz"]
    elif message_type == DETECTIONS_TYPE:
        (result,) = person.results
        box, at = person.bbox, result.pose.pose.position
        assert (person.id, result.hypothesis.class_id) == ("p1", "person")
        assert box.size.y > 1.3 and abs(box.center.position.y - at.y) < 0.5
        given = [at.x, at.y, at.z], result.hypothesis.score, result.pose.covariance.reshape(6, 6)[2, 2]
    else:
        tags, at = dict(zip(person.tagnames, person.tags)), person.position
        assert (person.name, tags["state"]) == ("p1", state)
        assert np.allclose([person.velocity.x, person.velocity.y, person.velocity.z], newest.velocity)
        given = [at.x, at.y, at.z], person.reliability, float(tags["zz"])
    assert np.allclose(given[0], place, atol=1e-6) and given[1] == pytest.approx(sure, abs=1e-6)
    walked = 0.0 if state == "tracking" else (0.7 * age_s) ** 2
    assert given[2] == pytest.approx(covariance[2, 2] + walked, rel=1e-5)


def test_a_person_is_uncertain_along_the_same_line_when_the_frame_has_jumped(frames):
    frame, turn = frames[-1], Rotation.from_rotvec([0.3, -0.5, 1.0])
    moved = CameraPose("map", turn.as_matrix(), np.array([1.0, 2.0, 3.0]))
    before, after = person_report(frame, True), person_report(frame, True, moved=moved)
    assert np.allclose(after.position, turn.apply(before.position) + [1, 2, 3])
    assert np.allclose(after.velocity, turn.apply(before.velocity))
    for block in (slice(0, 3), slice(3, 6)):  # of the place, and of the rotation
        expected = turn.as_matrix() @ before.covariance[block, block] @ turn.as_matrix().T
        assert np.allclose(after.covariance[block, block], expected)
    now = Rotation.from_quat(after.quaternion) * Rotation.from_quat(before.quaternion).inv()
    assert np.allclose(now.as_matrix(), turn.as_matrix())


def test_covariances_are_computed_only_for_a_message(frames):
    messages = PeopleMessages(BACKEND, CLOUD_TYPE)
    fresh = Session(TrackerConfig(height=1.75), NodeSettings())
    fresh.set_camera(camera_info(BACKEND))
    frame = fresh.process(cloud(BACKEND, START_NS, PIXELS[0]), 7)
    messages.update([frame], None)
    assert "uncertainty" not in vars(frame)
    messages.build((frame.stamp_ns, FRAME), 1.0, 3.0)
    assert "uncertainty" in vars(frame)


def test_one_person_does_not_come_back_when_stamps_that_have_jumped_back_reach_the_old_time(frames):
    messages = PeopleMessages(BACKEND, CLOUD_TYPE)
    messages.update(frames, None)
    at = frames[-1].stamp_ns
    for stamp_ns in (at - 2 * SECOND, at, at + SECOND):
        assert messages.build((stamp_ns, FRAME), 1.0, 3.0).width == 0


@pytest.mark.parametrize("several_cameras", [True, False])
def test_a_late_image_of_one_camera_hides_nobody_whom_another_one_has_seen_later(frames, several_cameras):
    messages = PeopleMessages(BACKEND, CLOUD_TYPE, several_cameras=several_cameras)
    early, late = (replace(frames[i], person=f"p{n}", label=f"p{n}") for i, n in ((0, 2), (3, 1)))
    messages.update([late, early], ["p1", "p2"])
    message = messages.build((early.stamp_ns, FRAME), 1.0, 3.0)
    people, stamp = np.frombuffer(message.data.tobytes(), POINT), message.header.stamp
    assert sorted(people["person"]) == ([1, 2] if several_cameras else [2])
    newest = late if several_cameras else early
    assert stamp.sec * SECOND + stamp.nanosec == newest.stamp_ns
    assert people["age"].max() == pytest.approx((newest.stamp_ns - early.stamp_ns) * 1e-9)
    assert messages.build((early.stamp_ns - 2 * SECOND, FRAME), 1.0, 3.0).width == 0  # the stamps begin anew


@pytest.mark.parametrize("message_type", TYPES)
def test_people_who_are_not_tracked_have_no_place_in_point_clouds_alone(frames, message_type):
    messages = PeopleMessages(BACKEND, message_type)
    messages.update(frames, None)
    message = messages.build((frames[-1].stamp_ns, FRAME), 1.0, 3.0, untracked=2, locked="p1")
    if message_type == CLOUD_TYPE:
        people = np.frombuffer(message.data.tobytes(), POINT)
        assert not message.is_dense  # PCL then looks for NaN
        assert people["tracked"].tolist() == [1, 0, 0] == people["locked"].tolist()
        assert people["person"].tolist() == [1, -1, -1] and people["detector_id"].tolist() == [-1, -1, -1]
        assert np.isnan(people["x"]).tolist() == [False, True, True]
        alone = messages.build((frames[-1].stamp_ns + 9 * SECOND, FRAME), 1.0, 3.0, 1)
        assert alone.width == 1
    elif message_type == PEOPLE_TYPE:
        (person,) = message.people
        assert dict(zip(person.tagnames, person.tags))["locked"] == "1"
    else:
        assert len(message.detections) == 1


def test_the_joints_of_all_people_of_an_image_are_one_message(frames):
    builder, frame, at = SkeletonsCloudBuilder(BACKEND, 24), frames[-1], (frames[-1].stamp_ns, FRAME)
    assert builder.fill(*at, []).width == 0
    message = builder.fill(*at, [joints_report(replace(frame, label=label)) for label in ("p7", "p2")])
    points = np.frombuffer(message.data.tobytes(), SKELETONS_POINT)
    assert points["person"].tolist() == [7] * 24 + [2] * 24 and points["index"].tolist() == [*range(24)] * 2
    alone = dict(FrameMessages(BACKEND, frame.skeleton).build(frame))[topics.SKELETON]
    expected = np.frombuffer(alone.data.tobytes(), SKELETON_POINT)
    for part in points[:24], points[24:]:
        assert all(np.array_equal(part[name], expected[name]) for name in SKELETON_POINT.names)


def test_the_state_of_one_person_is_lost_and_then_nobody():
    state = PresenceState()
    course = [
        (0, Status.SEARCHING, "nobody"),
        (1, Status.TRACKING, "tracking"),
        (2, Status.TRACKING, "tracking"),
        (3, Status.LOST, "lost"),
        (4, Status.LOST, "lost"),
        (5, Status.LOST, "nobody"),  # forget_after - lost_after later
        (9, Status.LOST, "nobody"),
        (10, Status.TRACKING, "tracking"),
        (11, Status.SEARCHING, "nobody"),  # reset
    ]
    for seconds, status, expected in course:
        before = state.value
        changed = state.update(Presence(status), seconds * SECOND, lost_after=1.0, forget_after=3.0)
        assert state.value == expected and changed == (before != expected), seconds


def test_the_state_of_several_people_is_the_best_one():
    state = PresenceState()
    for status, ids, expected in (
        (Status.SEARCHING, [], "nobody"),
        (Status.TRACKING, ["p1", "p2"], "tracking"),
        (Status.LOST, ["p1"], "lost"),
        (Status.LOST, [], "nobody"),
    ):
        state.update(Presence(status, ids), 0, 1.0, 3.0)
        assert state.value == expected


def test_tf_of_all_joints_gives_the_joints_of_the_pose(frames):
    """Chained from the camera, each frame has the position and orientation of its joint."""
    frame = frames[-1]
    for rep155 in (False, True):
        config = NodeSettings(publish_tf="all", rep155=rep155)
        person = "p4" if rep155 else ""
        backend = RosbagsBackend(detector_types())
        message = dict(FrameMessages(backend, frame.skeleton, "tracker", person, config).build(frame))[topics.TF]
        known = {FRAME: (np.zeros(3), Rotation.identity())}
        for transform in message.transforms:
            assert transform.child_frame_id not in known
            place, turn = known[transform.header.frame_id]
            t, q = transform.transform.translation, transform.transform.rotation
            there = place + turn.apply([t.x, t.y, t.z])
            known[transform.child_frame_id] = there, turn * Rotation.from_quat([q.x, q.y, q.z, q.w])
        pose, naming = frame.estimate.pose, Naming(body_id=person) if rep155 else Naming("tracker/")
        assert len(known) == 26 + len(LINKS) * rep155
        for joint, place, turn in zip(frame.skeleton.joint_names, pose.positions, pose.orientations):
            there, turned = known[naming.link_of_joint(joint)]
            assert np.allclose(there, place) and np.allclose(turned.as_matrix(), turn)
        assert ("body_p4" if rep155 else "tracker/body") in known


@pytest.mark.parametrize("text, expected", [("off", "off"), ("false", "off"), ("true", "root"), ("all", "all")])
def test_publish_tf_accepts_the_booleans_of_yaml(text, expected):
    assert offline_settings([], [f"publish_tf:={text}"])[1].publish_tf == expected


def test_wrong_settings_of_outputs_are_refused():
    with pytest.raises(ConfigurationError, match="people_type"):
        NodeSettings(people_type="std_msgs/String").checked()
    with pytest.raises(ConfigurationError, match="publish_tf"):
        offline_settings([], ["publish_tf:=limbs"])
