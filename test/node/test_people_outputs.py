"""The topics of several people: of the running node on real DDS, and of the replay."""

import os
import time

import numpy as np
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")

from forked import Forked  # noqa: E402
from live import BACKEND, TRACKER, NodeProcess, Peer, stamp_of, values_of  # noqa: E402
from messages import FRAME, camera_info, crowd, pixels_of_motion, rosbags_backend  # noqa: E402
from rcl_interfaces.srv import SetParameters  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: E402
from recordings import read, write_messages  # noqa: E402
from std_srvs.srv import SetBool, Trigger  # noqa: E402

from lassokin_ros.cli.replay import main  # noqa: E402
from lassokin_ros.core.body.skeleton import Skeleton  # noqa: E402
from lassokin_ros.node.message_types import message_class  # noqa: E402
from lassokin_ros.pipeline.outputs import topics  # noqa: E402
from lassokin_ros.pipeline.outputs.urdf import urdf  # noqa: E402
from lassokin_ros.replay.bags import BagReader  # noqa: E402

PIXELS = pixels_of_motion(40)
RECORDED_NS, PERIOD_NS = 10**12, 33_333_333
SKELETON = Skeleton.load("anthropometric", 1.75)


def two(backend, start_ns, index, persons=(4, 9)):
    """A message of people who do the same motion side by side."""
    places = {4: -120.0, 9: 120.0}
    people = [(PIXELS[index % 40] + [places[p], 0.0], np.full(17, 0.9)) for p in persons]
    return crowd(backend, start_ns + index * PERIOD_NS, people, persons)


class PeerOfTwo:
    """The messages on the topics of p4 and p9, and on those of everybody."""

    def __init__(self, peer):
        self.peer, self.sent, self.sent_at = peer, 0, 0.0
        self.got = {}
        for person in ("p4", "p9"):
            for topic in topics.PERSON_OUTPUTS:
                self.listen(topics.of_person(topic.name, person), topic)
        self.listen(topics.MARKERS, topics.FRAME_OUTPUTS[3])
        self.listen(topics.TRACKED_OUTPUT.name, topics.TRACKED_OUTPUT)

    def complete(self):
        """True if each topic has a message, and the markers, of which each person has a message, are of both."""
        return all(self.got.values()) and {"p4/joints", "p9/joints"} <= self.namespaces()

    def namespaces(self):
        return {marker.ns for message in self.got["tracker/markers"] for marker in message.markers}

    def listen(self, name, topic):
        name = name.replace("~", "tracker")
        durability = DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE
        qos = QoSProfile(depth=1000, durability=durability)
        self.got[name] = []
        kind = message_class(topic.message_type)
        self.peer.node.create_subscription(kind, name, self.got[name].append, qos)

    def send_until(self, condition, what, persons=(4, 9), step=1):
        """step: periods from one message's stamp to the next one's."""

        def met():
            if time.monotonic() - self.sent_at > PERIOD_NS * 1e-9:  # faster ones would be overtaken: a silence
                self.peer.send_camera()
                self.peer.keypoints.publish(two(BACKEND, self.peer.start_ns, self.sent, persons))
                self.sent, self.sent_at = self.sent + step, time.monotonic()
            return condition()

        self.peer.spin_until(met, what=what)

    def lists(self):
        return [message.data for message in self.got["tracker/bodies/tracked"]]


def test_each_of_several_people_has_a_set_of_topics():
    namespace = "/several"
    # Stamps alone decide that a person has left, because this test sends nothing at times. Lengths stay those given.
    settings = [f"-p {item}" for item in ("max_people:=3", "forget_after:=300.0", "calibrate:=false", "height:=1.75")]
    with NodeProcess(namespace, *" ".join(settings).split()) as node, Peer(namespace, outputs=False) as peer:
        them = PeerOfTwo(peer)
        them.send_until(them.complete, "every topic of both people")
        joints = {p: them.got[f"tracker/bodies/{p}/joints"][-1] for p in ("p4", "p9")}
        assert {m.header.frame_id for m in joints.values()} == {FRAME}
        assert joints["p4"].poses[0].position.x < -0.3 < 0.3 < joints["p9"].poses[0].position.x
        for person in ("p4", "p9"):
            states = them.got[f"tracker/bodies/{person}/joint_states"]
            assert len(set(map(stamp_of, states))) == len(states)
            description = them.got[f"tracker/bodies/{person}/robot_description"][-1].data
            assert description == urdf(SKELETON, FRAME, f"several/tracker/{person}/")
            certificate = them.got[f"tracker/bodies/{person}/certificate"][-1].status[0]
            assert certificate.name.startswith(f"several/tracker: {person}: certificate")
        assert them.namespaces() == {"p4/bones", "p4/joints", "p9/bones", "p9/joints"}
        peer.spin_until(lambda: them.lists()[-1] == "p4,p9", what=f"the list of both {them.lists()}")
        status = peer.next_diagnostics()
        assert values_of(status)["people"] == "p4, p9"
        them.send_until(lambda: them.lists()[-1] == "p9", "the list without who has left", (9,), step=300)
        gone = "/several/tracker/bodies/p4/joint_states"
        peer.spin_until(lambda: not peer.node.get_publishers_info_by_topic(gone), what="the end of p4's topics")
        peer.call(Trigger, "reset", Trigger.Request())
        peer.spin_until(lambda: them.lists()[-1] == "", what="the empty list")
        # After the silence, the detector's numbers may be those of others: the ids are new.
        them.send_until(lambda: them.lists()[-1].count(",") == 1, "both again")
        with Peer(namespace, outputs=False) as late:
            again = PeerOfTwo(late)
            late.spin_until(lambda: again.lists() == them.lists()[-1:], what="the latched list")
    assert "Traceback" not in node.said


def test_the_locked_person_has_the_topics_of_one_person_too():
    namespace = "/locked"
    # Nobody is forgotten: on a busy machine, many messages without p9 are sent before the word that p9 is lost.
    settings = [f"-p {item}" for item in ("max_people:=3", "follow:=p9", "forget_after:=300.0")]
    with NodeProcess(namespace, *" ".join(settings).split()) as node:
        with Peer(namespace, outputs=False) as peer:
            them = PeerOfTwo(peer)
            for topic in (topics.FRAME_OUTPUTS[2], topics.ROBOT_DESCRIPTION):
                them.listen(topic.name, topic)
            refused = peer.call(SetBool, "lock", SetBool.Request(data=True))
            assert not refused.success and "no usable keypoints" in refused.message
            them.send_until(lambda: them.got["tracker/bodies/p9/joints"], "both people")
            assert not them.got["tracker/joints"]
            answer = peer.call(SetBool, "lock", SetBool.Request(data=True))
            assert (answer.success, answer.message) == (True, "locked: p9")
            one, of_p9 = them.got["tracker/joints"], them.got["tracker/bodies/p9/joints"]
            them.send_until(lambda: len(one) > 3 and them.got["tracker/robot_description"], "the locked person")
            by_stamp = {stamp_of(message): message.poses for message in of_p9}
            assert all(by_stamp[stamp_of(message)] == message.poses for message in one if stamp_of(message) in by_stamp)
            peer.listen(topics.STATE)
            states = peer.got[topics.STATE]
            them.send_until(lambda: [m.data for m in states[-1:]] == ["lost"], "lost, beside p4", (4,), step=6)
            assert peer.call(SetBool, "lock", SetBool.Request(data=False)).success
            them.send_until(lambda: states[-1].data == "tracking", "tracking of anybody", (4,))
            known = len(of_p9)
            them.send_until(lambda: len(of_p9) > known, "p9 again")
            assert peer.call(SetBool, "lock", SetBool.Request(data=True)).success
            request = SetParameters.Request(parameters=[Parameter("height", value=1.8).to_parameter_msg()])
            assert peer.call(SetParameters, "set_parameters", request).results[0].successful
    assert node.said.count("the locked person was forgotten: nobody is followed until ~/lock is called") == 1
    assert "Traceback" not in node.said


def test_people_leave_when_the_detector_is_silent():
    namespace, refused = "/silent_people", "rejected: old_stamp [messages]"
    settings = [f"-p {item}" for item in ("max_people:=3", "forget_after:=1.0", "lost_after:=0.5")]
    with NodeProcess(namespace, *" ".join(settings).split()) as node, Peer(namespace, outputs=False) as peer:
        them = PeerOfTwo(peer)
        them.send_until(lambda: them.complete() and them.lists()[-1] == "p4,p9", "every topic of both people")
        peer.spin_until(lambda: them.lists()[-1] == "", what="the empty list, without a message")
        for person in ("p4", "p9"):
            gone = f"{namespace}/tracker/bodies/{person}/joint_states"
            peer.spin_until(lambda: not peer.node.get_publishers_info_by_topic(gone), what="its end")  # noqa: B023
        values = values_of(peer.next_diagnostics())
        assert (values["people"], values["state"]) == ("nobody", "lost")
        assert values["people left"] == values["people come"] != "0"
        lists = len(them.lists())
        peer.keypoints.publish(two(BACKEND, peer.start_ns, them.sent - 1))
        peer.next_diagnostics(lambda s: values_of(s).get(refused) == "1")
        assert len(them.lists()) == lists  # a rejected message does not bring anybody back
        them.send_until(lambda: them.lists()[-1] == "p4,p9", "both again")
        answered = topics.of_person(topics.JOINT_STATES, "p4").replace("~", "tracker")
        them.got[answered].clear()
        them.send_until(lambda: them.got[answered], "an answer")
    assert "Traceback" not in node.said


@pytest.mark.parametrize("parameter, package, people", [("rep155", "hri_msgs", 2), ("publish_tf", "tf2_msgs", 1)])
def test_a_missing_package_is_reported_at_the_start(parameter, package, people, tmp_path):
    (tmp_path / f"{package}.py").write_text("raise ModuleNotFoundError")  # it may be installed
    paths = filter(None, [str(tmp_path), os.environ.get("PYTHONPATH")])
    command = [*TRACKER, "--ros-args", "-p", f"{parameter}:=true", "-p", f"max_people:={people}"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    done = Forked(command, env=environment)
    lines = done.communicate(timeout=120)[1].strip().splitlines()
    word = f"ros-$ROS_DISTRO-{package.replace('_', '-')}"
    assert done.returncode == 2 and len(lines) == 1 and word in lines[0], lines


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    backend = rosbags_backend()
    messages = [("/camera_info", "sensor_msgs/msg/CameraInfo", RECORDED_NS - 1, camera_info(backend))]
    for i in range(30):
        persons = (4, 9) if i < 10 else (9,)
        stamp = RECORDED_NS + i * PERIOD_NS
        messages.append(("/keypoints", "sensor_msgs/msg/PointCloud2", stamp, two(backend, RECORDED_NS, i, persons)))
    return write_messages(tmp_path_factory.mktemp("two") / "in", messages)


@pytest.mark.parametrize("rep155", [False, True], ids=["bodies", "rep155"])
def test_replay_writes_each_persons_topics(recording, tmp_path, rep155):
    settings = ["max_people:=2", "forget_after:=0.3", "publish_tf:=true"]
    options = [word for setting in [*settings, f"rep155:={str(rep155).lower()}"] for word in ("-p", setting)]
    assert main([str(recording), "-o", str(tmp_path / "out"), *options]) == 0
    folder, description = ("/humans/bodies", "urdf") if rep155 else ("/tracker/bodies", "robot_description")
    with BagReader(tmp_path / "out") as bag:
        found = {topic.name: topic.count for topic in bag.topics}
    for person, frames, described in (("p4", 10, 1), ("p9", 30, 4)):  # p9 stays, and is calibrated
        for topic in topics.FRAME_OUTPUTS:
            assert found.pop(f"{folder}/{person}/{topic.name.removeprefix('~/')}") == frames
        assert found.pop(f"{folder}/{person}/{description}") == described
        assert found.pop(f"{folder}/{person}/roi", 0) == frames * rep155
    assert found == {
        f"{folder}/tracked": 3,
        "/tf": 40,
        "/tracker/markers": 40,  # everybody's
        "/tracker/people": 30,
        "/tracker/skeletons": 30,
        "/tracker/state": 2,
    }
    frames = {m.transforms[0].child_frame_id for _, m in read(tmp_path / "out", "/tf")}
    assert frames == {"body_p4", "body_p9"} if rep155 else {"tracker/p4/body", "tracker/p9/body"}
    lists = [m.ids if rep155 else m.data.split(",") for _, m in read(tmp_path / "out", f"{folder}/tracked")]
    assert [list(filter(None, ids)) for ids in lists] == [[], ["p4", "p9"], ["p9"]]
