"""Bodies with separate keypoint topics (REP-155): the pipelines, and the node on real DDS.

The live tests need hri_msgs and tf2_msgs, which are not on PyPI; they run if these are installed or were built.
"""

from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest
from detector_messages import HRI, detector_types
from messages import FOCAL, FRAME, HEIGHT, WIDTH, camera_info, rosbags_backend
from transforms import OPTICAL, tf_message

from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.observation import Status
from lassokin_ros.demo.synthetic import motion
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.outputs.diagnostics import Diagnostics
from lassokin_ros.pipeline.outputs.scene_messages import id_of
from lassokin_ros.pipeline.people.choice import NoPersonError
from lassokin_ros.pipeline.people.roster import Presence
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings
from msg_adapters.backends import RclpyBackend, RosbagsBackend
from msg_adapters.output_messages.builders import set_header

pytest.importorskip("rosbags")
START_NS, PERIOD_NS = 5_000_000_000, 33_333_333
CONFIG = NodeSettings(keypoints_type=HRI, rep155=True, max_people=2)
TRACKER = TrackerConfig(height=1.75, landmarks="hri18")
live = pytest.mark.skipif(
    not all(find_spec(name) for name in ("rclpy", "hri_msgs", "tf2_msgs")), reason="hri_msgs and tf2_msgs are needed"
)


def fractions(count=40):
    """(count, 18, 2), fractions of the image: the points of Skeleton2D for the synthetic motion."""
    skeleton = Skeleton.load("anthropometric", 1.75)
    kinematics = Kinematics(skeleton, Layout.load("hri18", skeleton))
    points = project(kinematics.pose(motion(skeleton, np.arange(count) / 30)).landmarks) * FOCAL
    return (points + [WIDTH / 2, HEIGHT / 2]) / [WIDTH, HEIGHT]


POINTS = fractions()


def skeleton2d(backend, stamp_ns, index, aside=0.0, confidence=0.9):
    """A Skeleton2D, shifted by `aside` of the image's width to the right."""
    message = backend.make(HRI)
    set_header(message.header, stamp_ns, FRAME)
    for point, (x, y) in zip(message.skeleton, POINTS[index % len(POINTS)].tolist()):
        point.x, point.y, point.c = x + aside, y, confidence
    return message


@pytest.fixture
def session():
    result = Session(TRACKER, CONFIG)
    result.set_camera(camera_info(rosbags_backend()))
    return result


BACKEND = RosbagsBackend(detector_types())


def feed(session, person, index, aside=0.0):
    return session.frames(skeleton2d(BACKEND, START_NS + index * PERIOD_NS, index, aside), 7, body=person)


def test_each_body_is_tracked_separately_with_the_same_stamps(session):
    session.keep(["abc", "xyz"])
    for i in range(20):
        (left,), (right,) = feed(session, "abc", i, -0.2), feed(session, "xyz", i, 0.2)
        assert left.accepted and right.accepted and (left.person, right.person) == ("abc", "xyz")
        assert left.positions[0] < -0.3 < 0.3 < right.positions[0]
        assert left.estimate.initialised is right.estimate.initialised is (i == 0)
    assert session.counts["received"] == session.counts["accepted"] == 40 and session.counts["resets"] == 0
    assert set(session.roster.calibrations()) == {"abc", "xyz"} and session.roster.status.value == "tracking"


def test_each_body_has_the_detectors_id_in_the_messages_about_all_people(session):
    session.keep(["abc", "xyz"])
    assert [id_of(feed(session, person, 0)[0]) for person in ("abc", "xyz")] == ["abc", "xyz"]


def test_bodies_of_a_camera_with_a_name():
    session = Session(TRACKER, replace(CONFIG, cameras=("left",)))
    session.set_camera(camera_info(rosbags_backend()), "left")
    session.keep(["abc"])
    assert feed(session, "abc", 0)[0].accepted


def test_listed_bodies_appear_and_leave(session):
    assert session.roster.ids == [] and feed(session, "abc", 0) == []
    session.keep(["abc", "xyz", "third"])
    assert session.roster.ids == ["abc", "xyz"] and session.counts["people beyond max_people"] == 1
    feed(session, "abc", 0)
    assert not feed(session, "abc", 1)[0].estimate.initialised
    session.keep(["third", "xyz"])
    assert session.roster.ids == ["xyz", "third"] and feed(session, "abc", 2) == []
    assert feed(session, "third", 2)[0].estimate.initialised  # no state of abc is left
    counts = session.counts
    assert (counts["people come"], counts["people left"], counts["resets"]) == (3, 1, 0)


def test_listed_bodies_that_were_never_tracked_are_counted(session):
    assert session.scene.untracked_at(START_NS) == 0
    session.keep(["abc", "xyz", "third"])
    assert session.scene.untracked_at(START_NS) == 3
    feed(session, "abc", 0)
    assert session.scene.untracked_at(START_NS) == 2
    session.keep(["abc"])
    assert session.scene.untracked_at(START_NS) == 0


def test_new_people_start_with_the_vertical_of_present_people(session):
    session.keep(["abc"])
    for i in range(10):
        feed(session, "abc", i)
    session.keep(["abc", "xyz"])
    one, two = (session.roster.trackers[person].learned.vertical for person in ("abc", "xyz"))
    assert two.learned_for == one.learned_for > 0 and np.array_equal(two.direction, one.direction)
    session.reset()
    assert two.learned_for == 0


def test_nobody_is_locked_because_the_detector_says_who_is_who(session):
    with pytest.raises(NoPersonError, match="each person has a topic of keypoints"):
        session.lock(START_NS)
    assert session.roster.locked is None


@pytest.mark.parametrize("event", ["height", "jump back"])
def test_the_parameter_lock_locks_nobody(event):
    session = Session(TRACKER, replace(CONFIG, lock=True))
    session.set_camera(camera_info(rosbags_backend()))
    session.keep(["abc"])
    assert all(feed(session, "abc", index)[0].accepted for index in (0, 41, 42, 43))
    if event == "height":
        session.tune(replace(session.tracker.config, height=1.9), session.config)
    first = 44 if event == "height" else 1
    assert all(feed(session, "abc", index + first)[0].accepted for index in range(5))
    assert "lock is true, but nobody is locked" in status_of(session).message


def test_the_number_of_bodies_without_a_track_is_in_the_diagnostics(session):
    session.keep(["abc", "xyz"])
    feed(session, "abc", 0)
    line = Diagnostics(session, "tracker", 0.0).line(1.0, session.scene.presence_at(START_NS), "")
    assert line.values["people in view, not tracked"] == "1"


def status_of(session, jump_after=100):
    """The status after 60 messages of the body abc; after `jump_after` of them, TF moves the camera by 3 m."""
    diagnostics = Diagnostics(session, "tracker", 0.0)
    diagnostics.count_camera_info(0.0)
    session.keep(["abc"])
    for i in range(60):
        if session.placement.transforms is not None:
            place = "map", FRAME, OPTICAL, (3.0 * (i > jump_after), 0.0, 1.0)
            session.placement.transforms.add(tf_message(BACKEND, START_NS + i * PERIOD_NS, place), static=False)
        diagnostics.count_message(feed(session, "abc", i), START_NS + i * PERIOD_NS, i / 30, 0.001)
    return diagnostics.line(2.0)


def test_a_jump_moves_people_once_also_if_it_is_seen_later_with_another_person():
    """People without an image since then are moved with the frame; see PeopleMessages.update."""
    session = Session(TRACKER, replace(CONFIG, fixed_frame="map"))
    session.set_camera(camera_info(BACKEND))
    session.keep(["abc", "xyz"])
    for i in range(30):
        place = "map", FRAME, OPTICAL, (4.0 * (i >= 20), 0.0, 1.0)
        session.placement.transforms.add(tf_message(BACKEND, START_NS + i * PERIOD_NS, place), static=False)
        assert feed(session, "abc", i, -0.2)[0].accepted
        if not 18 < i < 22:
            assert feed(session, "xyz", i, 0.2)[0].accepted
        assert i < 20 or session.placement.jumps.newest[0] == START_NS + 20 * PERIOD_NS
    assert "4.0 m and 0 degrees" in session.placement.jumps.words


def test_a_jump_of_the_fixed_frame_is_named_with_its_distance():
    session = Session(TRACKER, replace(CONFIG, fixed_frame="map"))
    session.set_camera(camera_info(rosbags_backend()))
    assert "in fixed_frame 'map' by 3.0 m and 0 degrees from" in status_of(session, jump_after=40).message


def test_an_empty_message_is_no_problem_to_report(session):
    session.keep(["abc"])
    message = skeleton2d(BACKEND, START_NS, 0)
    for point in message.skeleton:
        point.c = 0.0
    (frame,) = session.frames(message, 7, body="abc")
    assert frame.rejection == "too_few_landmarks" and session.inputs.nobody_in_view
    feed(session, "abc", 1)
    assert not session.inputs.nobody_in_view


def test_listed_bodies_are_lost_in_silence_but_stay(session):
    session.keep(["abc", "xyz"])
    feed(session, "abc", 0), feed(session, "xyz", 0)
    assert session.scene.presence_at(7) == Presence(Status.TRACKING, ["abc", "xyz"])
    assert session.scene.presence_at(60 * 10**9) == Presence(Status.LOST, ["abc", "xyz"])
    assert not feed(session, "abc", 1)[0].estimate.initialised


def test_only_skeletons_have_a_topic_for_each_body():
    assert CONFIG.topic_per_body
    assert not NodeSettings(rep155=True).topic_per_body and not NodeSettings(keypoints_type=HRI).topic_per_body


# On real DDS, with the true hri_msgs and tf2_msgs -------------------------------------------------------------------


class Humans:
    """A detector as in REP-155, and a subscriber of the outputs."""

    def __init__(self, peer):
        from hri_msgs.msg import IdsList, Skeleton2D

        self.peer, self.sent, self.got, self.out = peer, 0, {}, {}
        self.ids = peer.node.create_publisher(IdsList, "/humans/bodies/tracked", 1)
        self.list_type, self.type = IdsList, Skeleton2D

    def say(self, *ids):
        self.ids.publish(self.list_type(ids=ids))

    def listen(self, name, kind):
        self.got.setdefault(name, [])
        self.peer.node.create_subscription(kind, name, self.got[name].append, 100)

    def send(self, **aside):
        """Send a frame of each body; by id, its shift."""
        self.peer.send_camera()
        for person, shift in aside.items():
            if person not in self.out:
                name = f"/humans/bodies/{person}/skeleton2d"
                self.out[person] = self.peer.node.create_publisher(self.type, name, 10)
            self.out[person].publish(skeleton2d(RclpyBackend(), START_NS + self.sent * PERIOD_NS, self.sent, shift))
        self.sent += 1


def started(namespace, **settings):
    from live import NodeProcess

    settings = {"keypoints_type": HRI, "landmarks": "hri18", "rep155": "true", "max_people": 2, **settings}
    return NodeProcess(namespace, *(word for item in settings.items() for word in ("-p", "{}:={}".format(*item))))


def test_accepted_ids_are_valid_in_topic_names():
    rclpy = pytest.importorskip("rclpy.validate_full_topic_name")
    from lassokin_ros.node.inputs.rep155_inputs import ID

    for person in ("abc", "_", "a" * 100):
        assert ID.fullmatch(person)
        for topic in topics.PERSON_OUTPUTS:
            rclpy.validate_full_topic_name(topics.of_person(topic.name, person, True))  # raises for an invalid one
    assert not any(map(ID.fullmatch, ("", "9a", "a/b", "a b", "a\n", "\u00e4", "a" * 101, "a" * 10_000)))


@live
def test_the_node_tracks_the_bodies_of_the_list():
    from live import Peer, stamp_of, values_of
    from sensor_msgs.msg import JointState
    from std_msgs.msg import String
    from tf2_msgs.msg import TFMessage
    from visualization_msgs.msg import MarkerArray

    namespace = "/per_body"
    with started(namespace, publish_tf="all") as node, Peer(namespace, outputs=False) as peer:
        humans = Humans(peer)
        for person in ("abc", "xyz"):
            humans.listen(f"/humans/bodies/{person}/joint_states", JointState)
            humans.listen(f"/humans/bodies/{person}/urdf", String)
        humans.listen("/tf", TFMessage)
        humans.listen("tracker/markers", MarkerArray)

        def until(condition, what, ids, **aside):
            peer.spin_until(lambda: [humans.say(*ids), humans.send(**aside)] and condition(), what=what)

        until(lambda: all(humans.got.values()), "everything of both", ["abc", "xyz"], abc=-0.2, xyz=0.2)
        places = [humans.got[f"/humans/bodies/{person}/joint_states"][-1].position[0] for person in ("abc", "xyz")]
        assert places[0] < -0.3 < 0.3 < places[1]
        stamps = [stamp_of(m) for m in humans.got["/humans/bodies/xyz/joint_states"]]
        assert len(set(stamps)) == len(stamps) and min(stamps) >= START_NS
        assert 'link name="l_hip_abc"' in humans.got["/humans/bodies/abc/urdf"][-1].data
        assert not peer.node.count_publishers("/humans/bodies/abc/roi")  # it is the detector's
        until(lambda: {m.transforms[0].child_frame_id for m in humans.got["/tf"]} == {"body_abc", "body_xyz"}, "TF",
              ["abc", "xyz"], abc=-0.2, xyz=0.2)  # fmt: skip
        parents = {t.child_frame_id: t.header.frame_id for m in humans.got["/tf"] for t in m.transforms}
        assert parents["body_xyz"] == FRAME and all(name.endswith(("_abc", "_xyz")) for name in parents)
        assert parents["pelvis_abc"] == "body_abc" and parents["l_wrist_abc"] == "left_wrist_abc"
        assert "l_knee_xyz" in humans.got["/humans/bodies/xyz/joint_states"][-1].name
        (tracked,) = peer.node.get_publishers_info_by_topic("/humans/bodies/tracked")
        assert tracked.node_name == "peer"  # the list is that of the detector
        assert values_of(peer.next_diagnostics())["people"] == "abc, xyz"
        gone = "/humans/bodies/abc/joint_states"
        until(lambda: not peer.node.get_publishers_info_by_topic(gone), "the end of abc", ["xyz"], xyz=0.2)
        until(lambda: not peer.node.count_subscribers("/humans/bodies/abc/skeleton2d"), "no ear for abc", ["xyz"])
        before = len(humans.got["/humans/bodies/xyz/joint_states"])
        until(lambda: len(humans.got["/humans/bodies/xyz/joint_states"]) > before, "more of xyz", ["xyz"], xyz=0.2)
        humans.say("9 is no name", "xyz")
        assert values_of(peer.next_diagnostics())["people"] == "xyz"
    assert "Traceback" not in node.said


@live
def test_existing_topics_are_found_without_a_list():
    from live import Peer
    from sensor_msgs.msg import JointState

    namespace = "/no_list"
    with started(namespace) as node, Peer(namespace, outputs=False) as peer:
        humans = Humans(peer)
        humans.listen("/humans/bodies/abc/joint_states", JointState)
        peer.spin_until(lambda: humans.send(abc=0.0) or all(humans.got.values()), what="abc without a list")
    assert "Traceback" not in node.said


@live
def test_several_people_of_one_message_have_the_names_of_rep155():
    """PointCloud2 in, hri_msgs/IdsList out, latched."""
    from hri_msgs.msg import IdsList, NormalizedRegionOfInterest2D
    from live import Peer
    from messages import crowd, pixels_of_motion
    from rclpy.qos import DurabilityPolicy, QoSProfile

    namespace, pixels = "/rep155", pixels_of_motion(40)
    settings = {"keypoints_type": "sensor_msgs/PointCloud2", "landmarks": "coco17"}
    with started(namespace, **settings) as node, Peer(namespace, outputs=False) as peer:
        lists, sent, regions = [], [], []
        peer.node.create_subscription(NormalizedRegionOfInterest2D, "/humans/bodies/p9/roi", regions.append, 10)
        qos = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        peer.node.create_subscription(IdsList, topics.REP155_TRACKED_OUTPUT.name, lists.append, qos)

        def both():
            peer.send_camera()
            people = [(pixels[len(sent) % 40] + [shift, 0], np.full(17, 0.9)) for shift in (-120, 120)]
            sent.append(1)
            peer.keypoints.publish(crowd(RclpyBackend(), START_NS + len(sent) * PERIOD_NS, people, (4, 9)))
            return lists and list(lists[-1].ids) == ["p4", "p9"]

        peer.spin_until(both, what="the list")
        assert list(lists[0].ids) == []
        peer.spin_until(lambda: peer.node.get_publishers_info_by_topic("/humans/bodies/p9/joint_states"), what="p9")
        peer.spin_until(lambda: both() and regions, what="the region of p9")
        assert 0 <= regions[0].xmin < regions[0].xmax < 1 and 0 < regions[0].c <= 1
    assert "Traceback" not in node.said
