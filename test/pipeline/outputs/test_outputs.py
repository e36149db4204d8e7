"""The topics of people and of the scene, with a sink that keeps what is written."""

import numpy as np
from messages import FRAME, camera_info, crowd, pixels_of_motion, rosbags_backend

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.pipeline.outputs.outputs import LINK_AS_FRAME, Outputs
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings

BACKEND = rosbags_backend()
PIXELS = pixels_of_motion(10)
START_NS, PERIOD_NS = 10**12, 33_333_333


class Shelf:
    """A sink: open topics, and the number of messages on each."""

    def __init__(self):
        self.open_topics, self.counts = set(), {}

    def open(self, topic, name, lasting):
        self.open_topics.add(name)
        return name

    def close(self, out):
        self.open_topics.remove(out)

    def wanted(self, out):
        return True

    def write(self, out, message):
        self.counts[out] = self.counts.get(out, 0) + 1


def run(settings, frame_id=FRAME, count=3, persons=(4, 9)):
    """The outputs of people with lasting numbers side by side, in some images; then one without anybody."""
    session, sink = Session(TrackerConfig(height=1.75), settings), Shelf()
    session.set_camera(camera_info(BACKEND))
    outputs = Outputs(session, sink, BACKEND, "tracker")
    outputs.start(START_NS)
    places = {4: -120.0, 9: 120.0}
    for index in range(count):
        stamp_ns = START_NS + index * PERIOD_NS
        people = [(PIXELS[index] + [places[p], 0.0], np.full(17, 0.9)) for p in persons]
        for answer in session.push(crowd(BACKEND, stamp_ns, people, persons, frame_id=frame_id), stamp_ns):
            outputs.publish(answer, stamp_ns)
    return session, sink, outputs


def test_each_of_several_people_has_topics_until_they_leave():
    session, sink, outputs = run(NodeSettings(max_people=3))
    of_p4 = {name for name in sink.open_topics if name.startswith("~/bodies/p4/")}
    assert sink.counts["~/bodies/p4/joints"] == sink.counts["~/bodies/p9/joints"] == 3
    assert sink.counts["~/people"] == sink.counts["~/skeletons"] == 3 and sink.counts["~/markers"] == 6
    assert sink.counts["~/bodies/tracked"] == 2 and sink.counts["~/state"] == 2 and outputs.state == "tracking"
    outputs.keep(["p9"], START_NS)
    assert of_p4 and not of_p4 & sink.open_topics and sink.counts["~/bodies/tracked"] == 3
    outputs.keep(["p9"], START_NS)
    assert sink.counts["~/bodies/tracked"] == 3  # it has not changed


def test_the_locked_one_of_several_people_has_the_topics_of_one_person_too():
    session, sink, outputs = run(NodeSettings(max_people=3, follow="p9", lock=True))
    assert session.roster.locked == "p9"
    assert 0 < sink.counts["~/joints"] <= sink.counts["~/bodies/p9/joints"]
    assert sink.counts["~/markers"] == 6  # everybody's


def test_a_frame_id_that_is_a_links_name_stops_nobody():
    told = []
    session, sink, outputs = run(NodeSettings(max_people=3), frame_id="tracker/p4/head", count=1)
    assert session.counts[LINK_AS_FRAME] == 1
    assert sink.counts["~/bodies/p4/joints"] == sink.counts["~/bodies/p9/joints"] == 1
    outputs.on_fault = told.append
    outputs._people["p4"]._description._base_frame = None
    message = crowd(BACKEND, START_NS + PERIOD_NS, [(PIXELS[1], np.full(17, 0.9))], (4,), frame_id="tracker/p4/head")
    for answer in session.push(message, START_NS + PERIOD_NS):
        outputs.publish(answer, START_NS + PERIOD_NS)
    assert len(told) == 1 and "tracker/p4/head" in told[0]


def test_one_person_has_topics_from_the_start_and_a_reset_is_no_news():
    session, sink, outputs = run(NodeSettings(), persons=(4,))
    assert "~/joints" in sink.open_topics and "~/bodies/tracked" not in sink.counts
    assert sink.counts["~/joints"] == 3 and sink.counts["~/robot_description"] >= 1
    news = []
    outputs.on_state = news.append
    session.reset()
    outputs.forget(START_NS + 10**9)
    assert news == [] and outputs.state != "tracking"


def test_whoever_is_not_tracked_is_counted_by_the_clock_of_the_images():
    """The clock of arrivals is an hour ahead of that of the stamps."""
    session, sink = Session(TrackerConfig(height=1.75), NodeSettings(max_people=1)), Shelf()
    session.set_camera(camera_info(BACKEND))
    outputs, rows = Outputs(session, sink, BACKEND, "tracker"), []
    outputs.start(START_NS)

    def write(out, message):
        if out == "~/people":
            rows.append(BACKEND._typestore.deserialize_cdr(message, "sensor_msgs/msg/PointCloud2").width)

    sink.write = write
    for index in range(3):
        people = [(PIXELS[index] + [x, 0.0], np.full(17, 0.9)) for x in (-120.0, 120.0)]
        stamp_ns = START_NS + index * PERIOD_NS
        arrival_ns = stamp_ns + 3600 * 10**9
        for answer in session.push(crowd(BACKEND, stamp_ns, people, (4, 9)), arrival_ns):
            outputs.publish(answer, arrival_ns)
    outputs.repeat(arrival_ns + 10**8, 1e9)
    assert rows == [2, 2, 2, 2]  # one of them is not tracked
