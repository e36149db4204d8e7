"""The node on real DDS and `replay` give the same joints; and real detector output, played into the node."""

import os
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="the node needs rclpy")
pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")

from live import complaints  # noqa: E402
from recordings import FRAME_TOPICS, read, write_recording  # noqa: E402

from lassokin_ros.cli.replay import main  # noqa: E402
from lassokin_ros.core.body.landmarks import Layout  # noqa: E402
from lassokin_ros.core.body.skeleton import Skeleton  # noqa: E402
from lassokin_ros.core.errors import LassokinError  # noqa: E402
from lassokin_ros.demo.live_playback import LiveNode  # noqa: E402
from lassokin_ros.pipeline.outputs import topics  # noqa: E402
from lassokin_ros.replay.keypoint_recording import write_keypoint_recording  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("LASSOKIN_DATA", ROOT.parent / "shared" / "data"))
DETECTIONS = DATA / "detections" / "openpose_balancing.npz"


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
            return not self.got[topics.DIAGNOSTICS] or not self._counts()["rejected: no_camera_info"]

        self._spin_while(unnoticed, "a rejection")
        super()._warm_up(frames)


def test_rejections_before_the_recording_are_not_counted(tmp_path):
    with HeardBeforeItsCamera(namespace="/early") as live:
        live.play(write_recording(tmp_path / "walk", 10), rate=None, ahead=2)
        assert int(live.last_diagnostics()["rejected: no_camera_info [messages]"]) > 0
    assert live.rejected() == 0 and len(live.latencies_ms()) == 10


def test_a_node_that_cannot_start_is_reported():
    with pytest.raises(LassokinError, match="the node has exited: tracker: skeleton 'nobody' is neither built in"):
        with LiveNode({"skeleton": "nobody"}, "/broken") as live:
            live._spin_while(lambda: True, "an answer")


# Real detector output ------------------------------------------------------------------------------------------------

BONES = ("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist")
EVALUATED = [
    f"{side}_{j}" for side in ("left", "right") for j in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
]


def person_height(reference, layout):
    """Height, m, for which the built-in proportions give the person's median limb lengths; an input of the tracker."""
    unit = Skeleton.load("anthropometric", 1.0)
    limbs = [(f"{side}_{a}", f"{side}_{b}") for side in ("left", "right") for a, b in BONES]
    lengths = [
        np.nanmedian(np.linalg.norm(reference[:, layout.index(a)] - reference[:, layout.index(b)], axis=-1))
        for a, b in limbs
    ]
    return float(sum(lengths) / sum(np.linalg.norm(unit.offsets[unit.index(b)]) for _, b in limbs))


@pytest.mark.skipif(not DETECTIONS.is_file(), reason=f"no real detections at {DETECTIONS} (set LASSOKIN_DATA)")
def test_real_detector_output_is_tracked_in_all_frames(tmp_path, camera=0):
    """OpenPose BODY_25B, 60 Hz, one camera, compared with the 3D of four cameras. Only the height is given."""
    data = np.load(DETECTIONS)
    layout = Layout.load("body25b", Skeleton.load("anthropometric", 1.75))
    keypoints, reference = data["kp2d"][camera].astype(float), data["ref_cam"][camera].astype(float)
    stamps = 1_700_000_000_000_000_000 + np.round(np.arange(len(keypoints)) / float(data["fps"]) * 1e9).astype(np.int64)
    size = tuple(int(v) for v in data["image_size"][camera])
    distortion = np.append(data["dist"][camera], 0.0)
    recording = tmp_path / "openpose"
    write_keypoint_recording(
        recording, stamps, keypoints[..., :2], keypoints[..., 2], data["K"][camera], distortion, size
    )
    height = round(person_height(reference, layout), 3)
    parameters = {"height": height, "landmarks": "body25b", "queue_depth": 60}
    with LiveNode(parameters, f"/openpose_{camera}") as live:
        live.play(recording, rate=1.0)
    joints = live.messages("~/joints")
    usable = (keypoints[..., 2] >= 0.2).sum(axis=1) >= 4
    assert usable.all() and [stamp(m) for m in joints] == stamps.tolist()
    assert live.state() == "tracking"
    places = np.array(poses_positions(joints))
    skeleton = Skeleton.load("anthropometric", height)
    mine = places[:, [skeleton.index(name) for name in EVALUATED]]
    true = reference[:, [layout.index(name) for name in EVALUATED]]
    middle = [EVALUATED.index(f"{side}_hip") for side in ("left", "right")]
    error = (mine - mine[:, middle].mean(1, keepdims=True)) - (true - true[:, middle].mean(1, keepdims=True))
    size_mm = 1000 * np.nanmean(np.linalg.norm(error, axis=-1), axis=1)
    root_mm = 1000 * np.linalg.norm(mine[:, middle].mean(1) - true[:, middle].mean(1), axis=-1)
    print(
        f"\ncamera {camera}: height {height} m, {len(joints)} of {len(stamps)} frames; 12 limb joints, hips on hips: "
        f"median {np.nanmedian(size_mm):.0f} mm, mean {np.nanmean(size_mm):.0f} mm, first {size_mm[0]:.0f} mm, largest "
        f"{np.nanmax(size_mm):.0f} mm; hips in the camera's frame {np.nanmedian(root_mm):.0f} mm"
    )
    assert np.nanmedian(size_mm) < 200  # a person who faces the right way; benchmarks/accuracy.py measures the accuracy


def poses_positions(messages):
    return [[[p.position.x, p.position.y, p.position.z] for p in m.poses] for m in messages]
