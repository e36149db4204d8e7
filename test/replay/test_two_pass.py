"""replay --two-pass: the lengths learned over the whole recording are used from its first frame on."""

import re
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags reads the recordings")

from camera_rig import eye, in_map, keypoints, pixels, tf_of, truth_at  # noqa: E402
from messages import (  # noqa: E402
    FOCAL,
    HEIGHT,
    WIDTH,
    camera_info,
    cloud,
    crowd,
    pixels_of_motion,
    rosbags_backend,
    with_depths,
)
from recordings import RATE, START_NS, contents, read, write_messages, write_recording  # noqa: E402
from sequences import CONFIG, observations  # noqa: E402

from lassokin_ros.cli.replay import main  # noqa: E402
from lassokin_ros.common.array_spool import SpoolError  # noqa: E402
from lassokin_ros.core.body.kinematics import Kinematics  # noqa: E402
from lassokin_ros.core.body.landmarks import Layout  # noqa: E402
from lassokin_ros.core.body.rotations import exponential  # noqa: E402
from lassokin_ros.core.body.skeleton import Skeleton  # noqa: E402
from lassokin_ros.core.config import TrackerConfig  # noqa: E402
from lassokin_ros.core.image.projection import project  # noqa: E402
from lassokin_ros.core.observation import CameraPose  # noqa: E402
from lassokin_ros.core.recording import WHOLE_FILE  # noqa: E402
from lassokin_ros.core.tracker import Tracker  # noqa: E402
from lassokin_ros.demo.synthetic import motion  # noqa: E402
from lassokin_ros.pipeline.frame_result import FrameResult  # noqa: E402
from lassokin_ros.pipeline.session import Session  # noqa: E402
from lassokin_ros.pipeline.settings import NodeSettings  # noqa: E402
from lassokin_ros.replay import passes  # noqa: E402
from lassokin_ros.replay.passes import KeptObservations  # noqa: E402
from msg_adapters.keypoints import Keypoints  # noqa: E402

FRAMES = 150


def arms(path, person=""):
    """(f,) m: length of the left upper arm in the joints of an output, of one of several people."""
    joints = [
        [(p.position.x, p.position.y, p.position.z) for p in message.poses]
        for _, message in read(path, f"/tracker/{person}joints")
    ]
    joints = np.array(joints)
    skeleton = Skeleton.load("anthropometric", 1.75)
    ends = [skeleton.index(f"left_{joint}") for joint in ("shoulder", "elbow")]
    return np.linalg.norm(joints[:, ends[1]] - joints[:, ends[0]], axis=-1), joints


def test_several_people_have_the_lengths_learned_by_the_last_frame(tmp_path, capsys):
    """Two people with long arms side by side; who is who is not told by the messages, whose rows change their order."""
    backend, random, times = rosbags_backend(), np.random.default_rng(3), np.arange(100) / 30
    skeleton = Skeleton.load("anthropometric", 1.75)
    scales = np.ones(skeleton.joint_count)
    scales[[skeleton.index(f"{side}_{joint}") for side in ("left", "right") for joint in ("elbow", "wrist")]] = 1.2
    own = skeleton.with_bone_scales(scales)
    body = in_map(Kinematics(own, Layout.load("coco17", own)).pose(motion(own, times))).landmarks
    eyes, sent = [eye("left", 0), eye("right", 70)], []
    for one in eyes:
        info = camera_info(backend, frame_id=one.frame)
        sent.append((f"/{one.name}/camera_info", info.__msgtype__, START_NS, info))
        sent.append(("/tf_static", "tf2_msgs/msg/TFMessage", START_NS, tf_of(backend, one, START_NS, 0.0)))
    for landmarks, now in zip(body, times):
        stamp_ns = START_NS + round(1e9 * now)
        for one in eyes:
            two = [(pixels(one, now, landmarks + [x, 0, 0], random), np.full(17, 0.9)) for x in (-0.7, 0.7)]
            message = crowd(backend, stamp_ns, [two[i] for i in random.permutation(2)], [-1, -2], one.frame)
            sent.append((f"/{one.name}/keypoints", message.__msgtype__, stamp_ns, message))
    settings = ("max_people:=2", "cameras:=[left, right]", "fixed_frame:=map")
    options = [word for setting in settings for word in ("-p", setting)]
    bag = write_messages(tmp_path / "in", sent)
    assert main([str(bag), "-o", str(tmp_path / "one"), *options]) == 0
    capsys.readouterr()
    assert main([str(bag), "-o", str(tmp_path / "two"), "--two-pass", *options]) == 0
    heights = re.findall(r"^height of (p\d) +1\.[78]\d m, measured", capsys.readouterr().out, re.M)
    assert heights == ["p1", "p2"]
    true = np.linalg.norm(np.subtract(*own.rest_positions[[16, 18]]))
    for person in ("p1", "p2"):
        one, two = (arms(tmp_path / name, f"bodies/{person}/")[0] for name in ("one", "two"))
        assert len(two) >= len(times) - 5 and abs(two[0] - true) < 0.5 * abs(one[0] - true)
        assert np.ptp(two) < 0.3 * np.ptp(one)


def test_the_summary_states_the_height_that_the_first_pass_measured(tmp_path, capsys):
    skeleton, backend, times = Skeleton.load("anthropometric", 1.9), rosbags_backend(), np.arange(90) / 15
    body = Kinematics(skeleton, Layout.load("coco17", skeleton)).pose(motion(skeleton, times)).landmarks
    stamps = (START_NS + np.round(times * 1e9)).astype(np.int64).tolist()
    pixels = project(body) * FOCAL + [WIDTH / 2, HEIGHT / 2]
    clouds = [with_depths(backend, cloud(backend, at, xy), xyz[:, 2]) for at, xy, xyz in zip(stamps, pixels, body)]
    messages = [("/camera_info", "sensor_msgs/msg/CameraInfo", START_NS, camera_info(backend))]
    messages += [("/keypoints", "sensor_msgs/msg/PointCloud2", at, one) for at, one in zip(stamps, clouds)]
    bag = write_messages(tmp_path / "in", messages)
    assert main([str(bag), "-o", str(tmp_path / "out"), "--two-pass", "-p", "height:=0.0"]) == 0
    assert re.search(r"^height +1\.[89]\d m, measured, standard deviation 0\.0\d m$", capsys.readouterr().out, re.M)


def smoothed():
    """Options for the smoothing of a file."""
    return [word for name, value in WHOLE_FILE.items() for word in ("-p", f"{name}:={value}")]


def test_a_short_recording_keeps_its_lengths_and_its_root_is_between_the_tracks_forward_and_backward(
    tmp_path, monkeypatch, capsys
):
    """It is too short for calibration; a second time it gives the same bytes."""
    bag, found, height = write_recording(tmp_path / "short", 20), [], ["-p", "height:=1.75"]
    assert main([str(bag), "-o", str(tmp_path / "nix"), "--two-pass", "-p", "calibrate:=false"]) == 2
    assert "needs calibration" in capsys.readouterr().err and not (tmp_path / "nix").exists()
    backward = passes._backward
    monkeypatch.setattr(passes, "_backward", lambda *given: found.append(backward(*given)) or found[0])
    assert main([str(bag), "-o", str(tmp_path / "one"), *height, *smoothed()]) == 0
    for name in ("two", "again"):
        assert main([str(bag), "-o", str(tmp_path / name), *height, "--two-pass"]) == 0
    assert contents(tmp_path / "two") == contents(tmp_path / "again")
    assert np.abs(arms(tmp_path / "one")[0] - arms(tmp_path / "two")[0]).max() < 1e-9
    frames = found[0][None]
    forward, both = arms(tmp_path / "one")[1][:, 0], arms(tmp_path / "two")[1][:, 0]
    stamps = [START_NS + round(frame / RATE * 1e9) for frame in range(20)]
    assert sorted(frames) == stamps
    way = np.array([frames[stamp].state.translation for stamp in stamps]) - forward
    share = np.sum((both - forward) * way, axis=1) / np.sum(way * way, axis=1)
    assert np.abs(both - forward - share[:, None] * way).max() < 1e-9 and (share > 0.01).all() and (share < 0.99).all()


def test_people_whose_heights_are_not_given_are_tracked_backward_with_those_of_the_first_pass():
    """With one camera, who moved too little to be calibrated is as tall in both tracks as the first pass has assumed;
    who was never tracked has no height.
    """
    body = np.random.default_rng(0).normal(pixels_of_motion(12), 1.0)
    images = [(START_NS + round(n * 1e9 / 30), xy) for n, xy in enumerate(body)]
    few = np.where(np.arange(17) < 3, 0.9, 0.0)

    def play(playback, title):
        playback.camera_info(camera_info(rosbags_backend()), START_NS)
        for at_ns, xy in images:
            people = [(1, xy - [150, 0], np.full(17, 0.9)), (2, xy + [150, 0], np.full(17, 0.9)), (7, xy, few)]
            playback.keypoints(Keypoints.of_people(at_ns, "camera", people), at_ns)
        playback.finish()

    settings = NodeSettings(max_people=2)

    def make(config, bodies=None):
        return Session(config, settings, bodies=bodies)

    known = passes.learn(make, play, TrackerConfig())
    assert {number: list(frames) for number, frames in known.backward.items()} == {
        number: sorted((at_ns for at_ns, _ in images), reverse=True) for number in (1, 2)
    }
    assert set(known.heights) == {"p1", "p2"} and "a mean of people" in known.heights["p1"]
    session = known.session(make)
    assert [one.tracker.config.height for one in session.roster.bodies] == [1.7, 1.7]
    assert passes._backward(Kept([None, 7]), make, session, TrackerConfig(), known.bodies) == {}


class Kept:
    """Observations of people who were never accepted."""

    usable = True

    def __init__(self, numbers):
        self.numbers = numbers


def frame(stamp_ns, label="p1"):
    """A result with what was seen at a stamp."""
    _, seen = next(iter(observations(Tracker(CONFIG), 0.03)))
    return FrameResult(stamp_ns, "camera", label=label, observations=(replace(seen, stamp=1e-9 * (stamp_ns % 10**9)),))


def times_backward(kept):
    """Whether each frame was initialised, by stamp, of a track backward; and the states."""
    tracker, initialised = Tracker(CONFIG), {}
    track = tracker.track

    def noted(instant):
        estimate = track(instant)
        initialised[estimate.stamp] = estimate.initialised
        return estimate

    tracker.track = noted
    return kept.track_backward(None, tracker, list), initialised


def test_each_person_is_tracked_backward_alone():
    kept, step = KeptObservations(), 33_333_333
    kept.add([frame(START_NS + n * step, "p1" if n < 3 else "p2") for n in range(6)], 0, 0.0)
    kept.add([FrameResult(START_NS + 6 * step, "camera", rejection="no_camera_info")], 0, 0.0)
    states, initialised = times_backward(kept)
    assert sorted(states) == [START_NS + n * step for n in range(6)]
    assert [round(-stamp * 1e9 / step) for stamp, first in initialised.items() if first] == [5, 2]


def test_a_recording_whose_stamps_go_back_is_not_tracked_backward():
    kept = KeptObservations()
    for stamp_ns in (START_NS, START_NS + 10**8, START_NS):
        kept.add([frame(stamp_ns)], 0, 0.0)
    assert not kept.usable


def test_frames_that_were_refused_for_their_stamps_do_no_harm():
    kept, step = KeptObservations(), 33_333_333
    stamps = [START_NS + n * step for n in range(4)]
    kept.add([frame(stamps[0]), replace(frame(stamps[0]), rejection="old_stamp")], 0, 0.0)
    kept.add([replace(frame(stamps[0] + 10**12), rejection="too_few_landmarks")], 0, 0.0)
    for stamp in stamps[1:]:
        kept.add([frame(stamp)], 0, 0.0)
    states, _ = times_backward(kept)
    assert kept.usable and set(stamps) <= set(states)


@pytest.mark.parametrize(("step_m", "together", "usable"), [(0.0, False, True), (0.1, False, False), (0.1, True, True)])
def test_several_cameras_that_move_must_be_in_step(step_m, together, usable):
    """Nothing in an image of one camera says where the other one was then."""
    kept = KeptObservations()
    for n in range(4):
        seen = [
            replace(
                frame(START_NS).observations[0], camera=CameraPose(name, translation=np.array([step_m * n, 0, side]))
            )
            for name, side in (("left", 0.0), ("right", 1.0))
        ]
        seen = seen if together else [seen[n % 2]]
        kept.add([FrameResult(START_NS + n * 10**8, "map", label="p1", observations=seen)], 0, 0.0)
    assert kept.usable == usable


def test_an_observation_is_given_back_as_it_was():
    kept, (seen,) = KeptObservations(), frame(START_NS).observations
    depth = np.where(np.arange(len(seen.points)) % 2, np.nan, 3.0)
    turned = CameraPose("left", exponential(np.array([[0.1, 0.2, 0.3]]))[0], np.array([1.0, 2.0, 3.0]))
    given = [
        replace(seen, camera=turned, depth=depth, depth_of_surface=True, depth_age=0.02),
        replace(seen, camera=CameraPose("right", known=False)),
    ]
    kept.add([FrameResult(START_NS, "map", label="p1", observations=given)], 0, 0.0)
    (found,) = kept._latest_first(kept._people[None]["p1"])
    for one, other in zip(found, given):
        assert one.stamp == 0.0
        for name in ("points", "confidence", "focal", "depth", "depth_of_surface", "depth_age"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
        for name in ("name", "rotation", "translation", "known"):
            np.testing.assert_array_equal(getattr(one.camera, name), getattr(other.camera, name))


def test_the_track_backward_has_the_places_learned_forward_and_leaves_them(monkeypatch):
    """Nobody told where the right camera is: it was found after the first instant, and corrected then."""
    session = Session(TrackerConfig(height=1.75, extrinsics="learn"), NodeSettings(cameras=("left", "right")))
    extrinsics, kept, used = session.tracker.learned.extrinsics, KeptObservations(), []
    found = CameraPose("right", exponential(np.array([[0.0, 1.5, 0.0]]))[0], np.array([0.0, 0.0, 3.0]))
    extrinsics.found["right"], extrinsics.corrections["right"] = found, np.array([0.0, 0.0, 0.0, 0.1, 0.0, 0.0])
    for n, right in enumerate([CameraPose("right", known=False), found]):
        (seen,) = frame(START_NS + n * 10**8).observations
        both = [replace(seen, camera=camera) for camera in (CameraPose("left"), right)]
        kept.add([FrameResult(START_NS + n * 10**8, "left", label="p1", observations=both)], 0, 0.0)

    def track_backward(self, number, _, placed):
        used.extend(placed(instant) for instant in self._latest_first(self._people[number]["p1"]))

    monkeypatch.setattr(KeptObservations, "track_backward", track_backward)
    make = partial(Session, node_config=session.config)
    passes._backward(kept, lambda config, bodies: make(config), session, session.tracker.config, {})
    places = [[one.camera.translation.tolist() for one in instant] for instant in used]
    assert places == 2 * [[[0.0, 0.0, 0.0], [0.1, 0.0, 3.0]]]
    assert extrinsics.found == {"right": found} and extrinsics.corrections


def test_the_last_pass_begins_with_the_places_learned_before(tmp_path, monkeypatch):
    """Nobody tells where the right camera is."""
    times, backend, random, sent = np.arange(112) / 20, rosbags_backend(), np.random.default_rng(0), []
    eyes, landmarks = [eye("left", 0), eye("right", 90)], truth_at(times).landmarks
    for camera in eyes:
        info = camera_info(backend, frame_id=camera.frame)
        sent.append((f"/{camera.name}/camera_info", info.__msgtype__, START_NS, info))
    for now, body in zip(times, landmarks):
        for camera in eyes:
            seen = keypoints(backend, camera, START_NS, now, body, random)
            sent.append((f"/{camera.name}/keypoints", seen.__msgtype__, START_NS + round(1e9 * now), seen))
    bag, tracked, track = write_messages(tmp_path / "two", sent), [], Tracker.track

    def noted(tracker, seen):
        tracked.append((tracker, track(tracker, seen)))
        return tracked[-1][1]

    monkeypatch.setattr(Tracker, "track", noted)
    settings = ["-p", "cameras:=[left, right]", "-p", "extrinsics:=learn"]
    assert main([str(bag), "-o", str(tmp_path / "out"), "--two-pass", *settings]) == 0
    last = [estimate.cameras for tracker, estimate in tracked if tracker is tracked[-1][0]]
    assert 2 in last[:4] and last.count(2) > len(times) - 4


class FullDisk:
    """A file on a full disk."""

    def write(self, _):
        raise OSError(28, "No space left on device")


def test_a_full_disk_is_named(monkeypatch):
    kept = KeptObservations()
    monkeypatch.setattr(kept._spool, "_file", FullDisk())
    with pytest.raises(SpoolError, match="No space left on device; free space there"):
        kept.add([frame(START_NS)], 0, 0.0)
