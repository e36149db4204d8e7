"""The node on real DDS and `replay` give the same joints."""

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="the node needs rclpy")
pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")

from live import complaints  # noqa: E402
from recordings import FRAME_TOPICS, read, write_recording  # noqa: E402

from lassokin_ros.cli.replay import main  # noqa: E402
from lassokin_ros.core.errors import LassokinError  # noqa: E402
from lassokin_ros.demo.live_playback import LiveNode  # noqa: E402
from lassokin_ros.pipeline.outputs import topics  # noqa: E402


def stamp(message):
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


def poses(message):
    return [
        [getattr(p.position, k) for k in "xyz"] + [getattr(p.orientation, k) for k in "xyzw"] for p in message.poses
    ]


def test_replay_and_the_live_node_give_the_same_joints(tmp_path):
    recording = write_recording(tmp_path / "walk", 60)
    assert main([str(recording), "-o", str(tmp_path / "replayed")]) == 0
    with LiveNode(namespace="/same") as live:
        live.play(recording, rate=None, ahead=2)
    assert live.exit_code == 0 and not complaints(live.stderr)
    assert len(live.sent) == len(live.latencies_ms()) == 60
    live.record(tmp_path / "live")
    for topic in FRAME_TOPICS:
        ours, theirs = ([m for _, m in read(tmp_path / name, topic)] for name in ("live", "replayed"))
        assert len(ours) == len(theirs) == 60, topic
    pairs = zip(live.messages("~/joints"), read(tmp_path / "replayed", "/tracker/joints"))
    for mine, (_, theirs) in pairs:
        assert stamp(mine) == stamp(theirs) and mine.header.frame_id == theirs.header.frame_id
        assert np.abs(np.array(poses(mine)) - np.array(poses(theirs))).max() < 1e-9
    pairs = zip(live.messages("~/joint_states"), read(tmp_path / "replayed", "/tracker/joint_states"))
    for mine, (_, theirs) in pairs:
        assert mine.name == theirs.name
        assert np.abs(mine.position - theirs.position).max() < 1e-9
        assert np.abs(mine.velocity - theirs.velocity).max() < 1e-6
    (description,) = {m.data for m in live.messages("~/robot_description")[-1:]}
    replayed = read(tmp_path / "replayed", "/tracker/robot_description")[-1][1].data
    assert description == replayed.replace("tracker/", "same/tracker/")


class HeardBeforeItsCamera(LiveNode):
    """A node that receives keypoints before camera_info, for example because DDS discovers that topic first."""

    def _warm_up(self, frames):
        keypoints = next(data for is_keypoints, _, data in frames if is_keypoints)

        def unnoticed():
            self._publishers[1].publish(keypoints)
            return not self._got[topics.DIAGNOSTICS] or not self._counts()["rejected: no_camera_info"]

        self._spin_while(unnoticed, "a rejection")
        super()._warm_up(frames)


def test_rejections_before_the_recording_are_not_counted(tmp_path):
    with HeardBeforeItsCamera(namespace="/early") as live:
        live.play(write_recording(tmp_path / "walk", 10), rate=None, ahead=2)
        assert int(live._counts()["rejected: no_camera_info"]) > 0
    assert live.rejected() == 0 and len(live.latencies_ms()) == 10


def test_a_node_that_cannot_start_is_reported():
    with pytest.raises(LassokinError, match="the node has exited: tracker: skeleton 'nobody' is neither built in"):
        with LiveNode({"skeleton": "nobody"}, "/broken") as live:
            live._spin_while(lambda: True, "an answer")
