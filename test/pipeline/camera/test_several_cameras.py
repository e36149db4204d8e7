"""Several cameras, and a fixed frame: what the session publishes for a person whose motion is known in the map."""

import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from camera_rig import (
    LEFT,
    MAP,
    RIGHT,
    START_NS,
    TWO,
    Eye,
    Play,
    eye,
    keypoints,
    off,
    pixels,
    truth_at,
    turning_eye,
)
from depth_camera import depth_message
from messages import camera_info, crowd, rosbags_backend
from scipy.spatial.transform import Rotation

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.errors import ConfigurationError
from lassokin_ros.core.learned.vertical import Vertical
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.pipeline.answers import frames_of
from lassokin_ros.pipeline.camera.camera_places import PoseJumps
from lassokin_ros.pipeline.camera.camera_selection import Camera
from lassokin_ros.pipeline.camera.placement import JUMPS
from lassokin_ros.pipeline.depth.depth_images import MATCHED, RECEIVED, UNMATCHED
from lassokin_ros.pipeline.image_sets import LATE
from lassokin_ros.pipeline.outputs.saved_files import CamerasFileError, camera_commands, save_cameras
from lassokin_ros.pipeline.settings import NodeSettings

BACKEND = rosbags_backend()


def test_two_cameras_place_the_person_in_the_map():
    play = Play([LEFT, RIGHT]).run()
    assert len(play.results) == 60 and not play.refused
    assert {one.frame.frame_id for one in play.results} == {MAP}
    assert play.error() < 20  # one camera: more than 60
    assert play.results[-1].frame.estimate.cameras == 2
    (_, other) = play.results[-1].frame.images
    assert (play.results[-1].frame.camera.name, other.camera.name) == ("left", "right")
    assert not any(one.frame.doubt.likely_wrong for one in play.results)
    figures = play.line().values
    assert figures["left: keypoints age [s]"] == "0.0" and 0 < float(figures["right: residual median [px]"]) < 5
    assert np.median([one.error.mean() for one in Play([LEFT], NodeSettings(fixed_frame=MAP)).run().results]) > 0.04


def test_images_of_one_instant_share_a_lasso_and_others_have_their_own():
    together, alternating = Play([LEFT, RIGHT]).run(), Play([LEFT, RIGHT]).run(phase=1 / 60)
    assert len(together.results) == 60 and len(alternating.results) == 120
    assert together.session.counts[LATE] <= 2  # before the periods are known
    assert alternating.session.counts[LATE] == 0 and alternating.error() < 20


@pytest.mark.parametrize("wait", [0.05, 0.5])
def test_an_image_waits_for_that_of_another_camera_exactly_as_long_as_it_is_told(wait):
    play = Play([LEFT, RIGHT], NodeSettings(cameras=("left", "right"), fixed_frame=MAP, wait=wait)).run(0.5, hz=10)
    play.transforms(0, 0.5)
    play.image(0, 0.5)
    end_ns = START_NS + round(1e9 * (0.5 + 0.01 + wait))
    assert play.session.due_at_ns == end_ns and not play.session.due(end_ns - 1)
    assert len(play.session.due(end_ns)) == 1 and play.session.due_at_ns is None


def test_one_camera_in_a_fixed_frame_gives_the_pose_that_it_gives_in_its_own():
    own, fixed = Play([LEFT], NodeSettings()), Play([LEFT], NodeSettings(fixed_frame=MAP))
    own.session.tracker.learned.vertical = Vertical(given=np.array([0.0, -1.0, 0.0]))  # as the map's
    own.run(1.0), fixed.run(1.0)
    pose = LEFT.pose_at(0)
    for one, other in zip(own.results, fixed.results):
        mine, theirs = one.frame.estimate.pose.positions, other.frame.estimate.pose.positions
        assert np.abs(pose.into_camera(theirs) - mine).max() < 1e-4
        mine, theirs = one.frame.uncertainty.absolute.joints, other.frame.uncertainty.absolute.joints
        assert np.allclose(pose.rotation @ theirs @ pose.rotation.T, mine, rtol=0.05, atol=1e-4)
        assert np.allclose(one.frame.reprojected, other.frame.reprojected, atol=0.5)


@pytest.mark.parametrize("tf", ["60 ms late", "10 Hz"])
def test_a_robot_that_turns_does_not_move_the_person(tf):
    robot = turning_eye("camera", 0.5)
    moving = Play([robot], NodeSettings(), still=True).run(4.0)
    fixed = Play([robot], NodeSettings(fixed_frame=MAP), still=True)
    for index in range(120):
        now = index / 30
        if tf != "10 Hz" or index % 3 == 0:
            late = 2 / 30 if tf == "60 ms late" else 0.0
            if now >= late:
                fixed.transforms(0, now - late)
        fixed.image(0, now)
    speeds = [np.median([np.linalg.norm(one.frame.velocity) for one in play.results[30:]]) for play in (moving, fixed)]
    assert speeds[0] > 0.5 and speeds[1] < 0.05
    assert np.median([abs(one.root[0]) for one in fixed.results[30:]]) < 0.01


@pytest.mark.parametrize("hz, phase", [(10, 0.05), (30, 0.0)], ids=["in turn", "some images are lost"])
def test_cameras_on_a_robot_that_turns_are_where_they_are_at_each_image_of_the_others(hz, phase):
    """The keypoints of a camera without an image are predicted, and so is its pose."""
    robot, lost = [turning_eye("left", 0.5), turning_eye("right", 0.5, (1.0, 0.2, 1.5))], np.random.default_rng(1)
    play = Play(robot, still=True).run(4.0, hz, phase, silent=lambda *_: not phase and lost.random() < 0.4)
    assert len(play.results) > 60 and play.error() < 25  # with the poses of their last images: 89 and 52


def jumping(one, degrees, metres):
    """A camera in a frame that is turned about the vertical and shifted, (3,) m, after 1 s."""
    turn, before = Rotation.from_euler("z", degrees, degrees=True).as_matrix(), one.pose_at(0)
    after = CameraPose(one.name, before.rotation @ turn.T, before.translation - before.rotation @ turn.T @ metres)
    return Eye(one.name, lambda seconds: before if seconds < 1.0 else after)


@pytest.mark.parametrize(
    "eyes, phase, lag, degrees, metres",
    [
        ([LEFT], 0.0, 0.0, 20, (0.0, 0.0, 0.0)),
        ([LEFT], 0.0, 0.1, 115, (-5.0, -3.0, 0.0)),
        ([LEFT, RIGHT], 0.0, 0.1, 115, (-5.0, -3.0, 0.0)),
        ([LEFT, RIGHT], 1 / 60, 0.0, 0, (-5.0, -3.0, 0.0)),
    ],
    ids=["one camera", "one camera, smoothed", "two cameras, smoothed", "two cameras in turn"],
)
def test_a_jump_of_the_fixed_frame_moves_the_person_with_it(degrees, metres, eyes, phase, lag):
    """Odometry is reset: the person is before the robot as before, as fast as before, and not in doubt."""
    odometry, before = [jumping(one, degrees, metres) for one in eyes], eyes[0].pose_at(0)
    settings = TWO if len(eyes) > 1 else NodeSettings(fixed_frame=MAP)
    play = Play(eyes, settings, TrackerConfig(height=1.75, smoothing_lag=lag))
    play.in_tf = odometry
    play.run(phase=phase)
    assert not play.refused and play.session.counts[JUMPS] == 1
    for one in play.results[15:]:
        seen = odometry[0].pose_at(one.seconds).into_camera(one.frame.estimate.pose.positions)
        assert np.linalg.norm(seen - before.into_camera(play.truth(one.seconds).positions[0]), axis=1).mean() < 0.1
        assert np.linalg.norm(one.frame.velocity) < 0.5 and np.abs(one.frame.joint_velocities).max() < 3.0
        assert np.abs(one.frame.velocities).max() < 10.0 and not one.frame.doubt.likely_wrong
    assert play.session.placement.jumps.words in play.line().message


def test_a_camera_that_jumps_alone_was_moved_and_the_person_was_not():
    play = Play([LEFT, RIGHT])
    play.in_tf = [LEFT, jumping(RIGHT, 0, (-0.5, -0.5, 0.0))]
    play.run()
    assert not play.session.counts[JUMPS] and len(play.results) == 60


@pytest.mark.parametrize("hz, metres, seen", [(10, 0.28, True), (30, 0.28, True), (10, 0.08, False)])
def test_a_jump_below_the_speed_of_a_robot_is_seen_if_the_camera_moved_steadily_before(hz, metres, seen):
    """A robot at 1 m/s; 0.28 m at 10 Hz are 3.8 m/s."""
    jumps, rotation = PoseJumps(), LEFT.pose_at(0).rotation
    for i in range(20):
        centre = np.array([i / hz + metres * (i >= 10), 0.0, 1.0])
        moved = jumps.update(round(1e9 * i / hz), [CameraPose("left", rotation, -rotation @ centre)])
        assert (moved is not None) == (seen and i == 10), i


@pytest.mark.parametrize("hz", [5, 10, 30])
def test_a_robot_that_starts_stops_and_turns_back_hard_is_no_jump(hz):
    jumps, rotation, place, speed = PoseJumps(), LEFT.pose_at(0).rotation, 0.0, 0.0
    for i in range(6 * hz):
        wanted = 2.0 if i // hz % 2 else -2.0
        speed += float(np.clip(wanted - speed, -10 / hz, 10 / hz))  # 10 m/s^2
        place += speed / hz
        centre = np.array([place, 0.0, 1.0])
        assert jumps.update(round(1e9 * i / hz), [CameraPose("left", rotation, -rotation @ centre)]) is None


def test_a_late_image_from_before_a_jump_is_no_second_jump():
    jumps, turned = PoseJumps(), jumping(LEFT, 90, (0.0, 0.0, 0.0))
    stamps = (0.9, 1.0, 0.95, 1.05)
    moved = [jumps.update(round(1e9 * s), [turned.pose_at(s)]) for s in stamps]
    assert [one is not None for one in moved] == [False, True, False, False]


def test_a_robot_that_is_elsewhere_after_a_reset_has_not_jumped():
    """Simulated time is set back by 2 s, and its old end is passed again."""
    play = Play([LEFT], NodeSettings(fixed_frame=MAP)).run(2.0)
    play.session.placement.transforms.clear()
    play.session.reset()
    away = jumping(LEFT, 30, (1.0, -2.0, 0.0)).pose_at(9.0)
    play.in_tf = [Eye("left", lambda _: away)]
    play.run(2.5)
    assert not play.session.counts[JUMPS] and not play.refused


def test_a_camera_without_a_transform_is_left_out_and_named():
    play = Play([LEFT, RIGHT]).run(1.0, tf=[0])
    assert len(play.results) == 30 and play.session.counts["no transform of right"] >= 28
    faults = play.session.placement.places.faults
    assert list(faults) == ["right"] and "right_optical" in faults["right"]
    nothing = Play([LEFT, RIGHT]).run(0.5, tf=False)
    assert not nothing.results and {one.rejection for one in nothing.refused} == {"no_transform"}
    assert MAP in nothing.refused[0].detail
    assert nothing.line().message.startswith("no images can be used: no pose of camera 'left' in fixed_frame 'map'")


@pytest.mark.parametrize("extrinsics", ["given", "check", "learn"])  # the pose of one camera is not found from a person
def test_a_transform_from_the_future_or_long_ago_is_none(extrinsics):
    play = Play([LEFT], NodeSettings(fixed_frame=MAP), TrackerConfig(height=1.75, extrinsics=extrinsics))
    play.transforms(0, 10.0)
    play.image(0, 0.0)
    play.transforms(0, 20.0)
    play.image(0, 20.0)
    play.image(0, 20.5)
    assert [one.rejection for one in play.refused] == ["no_transform"] * 2
    assert "0.2 s newer" in play.refused[0].detail and "0.2 s older" in play.refused[1].detail


@pytest.mark.parametrize("sees", [["left"], []], ids=["one sees somebody", "nobody"])
def test_a_camera_that_sees_nobody_is_a_rejection_only_if_no_other_sees_somebody(sees):
    play = Play([LEFT, RIGHT])
    for index in range(20):
        for number, one in enumerate(play.eyes):
            play.transforms(number, index / 30)
            if one.name in sees:
                play.image(number, index / 30)
                continue
            stamp_ns = START_NS + round(1e9 * index / 30)
            empty = crowd(BACKEND, stamp_ns, [], frame_id=one.frame)
            play.keep(play.session.frames(empty, stamp_ns, one.name))
    assert (len(play.results), bool(play.refused)) == ((20, False) if sees else (0, True))


def test_the_followed_person_is_found_in_the_other_image_by_place_and_size():
    """A second person stands beside, and comes first in the messages of the second camera."""
    play = Play([LEFT, RIGHT])
    for index in range(60):
        now = index / 30
        me, other = truth_at([now]).landmarks[0], truth_at([now], shift=(1.2, 0.9, 0.0)).landmarks[0]
        for number, (name, one) in enumerate(zip(play.names, play.eyes)):
            play.transforms(number, now)
            seen = [pixels(one, now, body, play.random) for body in ((me, other) if number == 0 else (other, me))]
            people = [(xy, np.full(17, 0.9 if i == (0 if number == 0 else 1) else 0.8)) for i, xy in enumerate(seen)]
            stamp_ns = START_NS + round(1e9 * now)
            message = crowd(BACKEND, stamp_ns, people, [7 + number, 8 - number], frame_id=one.frame)
            play.keep(play.session.frames(message, stamp_ns, name))
    assert play.error() < 25 and play.results[-1].frame.estimate.cameras == 2


def test_depth_images_are_counted_for_each_camera():
    """Those of the left camera are of the keypoints' time, those of the right one 1 s older."""
    settings = NodeSettings(cameras=("left", "right"), fixed_frame=MAP, depth="depth")
    play, depth = Play([LEFT, RIGHT], settings), np.full((48, 64), 3.6)
    for index in range(30):
        for number, name in enumerate(play.names):
            stamp_ns = START_NS + round(1e9 * (index / 30 - number))
            message = depth_message(BACKEND, stamp_ns, depth, frame_id=play.eyes[number].frame)
            play.session.cameras[name].depth.add(message, 0)
            play.transforms(number, index / 30)
            play.image(number, index / 30)
    line = play.line()
    figures = {
        name: [line.values[f"{name}: {key} [messages]"] for key in (RECEIVED, MATCHED, UNMATCHED)]
        for name in play.names
    }
    assert figures == {"left": ["30", "30", "0"], "right": ["30", "0", "30"]}
    assert "camera 'right': most keypoint messages had no depth image of their time" in line.message
    assert "camera 'left'" not in line.message


@pytest.mark.parametrize("extrinsics", ["check", "learn"])
def test_a_camera_that_was_moved_is_noticed_and_with_learn_corrected(extrinsics):
    poses = {"left": LEFT.pose_at(0), "right": off(RIGHT, 3.0, 0.02)}
    play = Play([LEFT, RIGHT], TWO, TrackerConfig(height=1.75, extrinsics=extrinsics), poses=poses).run(6.0)
    angle, shift = play.session.tracker.learned.extrinsics.moved("right")
    assert np.degrees(angle) == pytest.approx(3.0, abs=0.7) and shift < 0.1
    stated = np.sqrt(play.results[-1].frame.uncertainty.absolute.pelvis[:3, :3].trace())
    if extrinsics == "check":
        assert play.error(5.0) > 100 and 2 * stated > np.linalg.norm(play.results[-1].root)
        return
    assert play.error(5.0) < 40 and stated < 0.1
    play.image(1, 6.01)  # the learned pose is that of the results
    play.keep(frames_of(play.session.due(START_NS + 7_000_000_000)))
    frame = play.results[-1].frame
    assert frame.camera.name == "right"
    assert np.nanmedian(np.linalg.norm(frame.reprojected - frame.detected, axis=1)) < 8.0
    play.session.roster.people[0].body.reset(same_camera=True)  # the next person has it, too
    play.run(0.5, begin=6.1)
    assert play.error(6.05) < 50


@pytest.mark.parametrize(
    "degrees, metres, walks, words",
    [
        (8, 0.5, True, "its pose is off by about 8 degrees and 0.5 m;"),
        (0, 0.5, False, "its pose is off by about 9 degrees or 0.5 m;"),  # they look alike from one place
    ],
)
def test_a_turn_and_a_shift_of_a_camera_are_told_apart_by_a_person_who_walks(degrees, metres, walks, words):
    poses = {"left": LEFT.pose_at(0), "right": off(RIGHT, degrees, metres)}
    play = Play([LEFT, RIGHT], poses=poses)
    walk = np.array([1.0, 1.2, 0.0]) * walks
    play.truth = lambda seconds: truth_at([seconds], shift=walk * np.sin([seconds, 0.7 * seconds, 0.0]))
    play.run(6.0)
    assert words in play.session.roster.extrinsics.in_words("right")


@pytest.mark.parametrize(
    "settings, words",
    [
        ({"cameras": ("a", "a")}, "'a' twice"),
        ({"cameras": ("1a", "b")}, "not starting with a digit"),
        ({"cameras": ("a", 3)}, "a list of names"),
        ({"cameras": ("a", "b"), "depth": "/depth"}, "relative name"),
        ({"fixed_frame": "the map"}, "name of a TF frame"),
    ],
)
def test_wrong_settings_of_cameras_are_refused(settings, words):
    with pytest.raises(ConfigurationError, match=words):
        NodeSettings(**settings).checked()


def test_topics_of_depth_follow_the_names_of_the_cameras():
    settings = NodeSettings(cameras=["left", "right"], depth="depth/image").checked()
    assert settings.depth_topic("left") == "left/depth/image" and NodeSettings(depth="d").depth_topic("") == "d"
    assert NodeSettings(cameras=[""]).camera_names == ("",) and not NodeSettings().several_cameras


def test_a_repeated_or_a_wrong_stamp_of_a_camera_changes_nothing():
    play = Play([LEFT, RIGHT]).run(1.0)
    for _ in range(30):
        play.image(1, 29 / 30)
    play.image(1, 1000.0, late=-999.0)
    counts = play.session.counts
    assert counts["resets"] == 0 and counts["rejected: old_stamp"] == 30 and counts["rejected: stamp_jump"] == 1
    assert "camera 'right'" in play.refused[0].detail
    before = len(play.results)
    for index in range(30, 40):
        play.image(0, index / 30)
    assert len(play.results) > before + 5


def test_after_a_reset_the_poses_are_learned_anew(extrinsics="learn"):
    poses = {"left": LEFT.pose_at(0), "right": off(RIGHT, 3.0, 0.02)}
    play = Play([LEFT, RIGHT], TWO, TrackerConfig(height=1.75, extrinsics=extrinsics), poses=poses).run(4.0)
    learned = play.session.tracker.learned.extrinsics
    assert learned.moved("right") is not None and learned.in_words("right")
    play.session.reset()
    assert not learned.in_words("right")
    with pytest.raises(CamerasFileError, match="no pose of a camera was learned yet"):
        camera_commands(play.session)
    play.session.placement.places._given["right"] = RIGHT.pose_at(0)  # the pose is repaired
    play.run(200 / 30, begin=10.0)
    angle, _ = learned.solution("right")
    assert np.degrees(angle) < 0.3 and play.error(9.9) < 25
    assert max(one.error.mean() for one in play.results if one.seconds > 9.9) < 0.1


def test_without_the_first_camera_no_other_pose_is_corrected():
    back = eye("back", 180)
    poses = {"left": LEFT.pose_at(0), "right": off(RIGHT, 3.0, 0.0), "back": back.pose_at(0)}
    settings = NodeSettings(cameras=("left", "right", "back"), fixed_frame=MAP)
    play = Play([LEFT, RIGHT, back], settings, TrackerConfig(height=1.75, extrinsics="learn"), poses=poses)
    play.run(3.0, silent=lambda number, seconds: number == 0)
    assert not play.session.tracker.learned.extrinsics.corrections and len(play.results) > 80


def test_a_late_camera_is_counted_and_its_delay_is_said():
    play = Play([LEFT, RIGHT])
    sent = sorted((index / 30 + 0.12 * number, number, index / 30) for index in range(60) for number in range(2))
    for _, number, seconds in sent:
        play.transforms(number, seconds)
        play.image(number, seconds, late=0.12 * number)
    line = play.line()
    assert "keypoints of 'right' arrive 0.12 s later" in line.message and "rejected" not in line.message
    counts = play.session.counts
    assert counts[LATE] > 50 and counts["accepted"] + counts[LATE] == counts["received"] == 120


def test_camera_info_of_the_other_camera_is_named():
    play = Play([LEFT, RIGHT])
    play.session.cameras["right"].camera = Camera(rectified=False)
    assert "no camera_info of camera 'right'" in play.run(0.1).line().message
    play.session.set_camera(camera_info(BACKEND, frame_id=LEFT.frame), "right")
    play.run(1.0, begin=0.1)
    assert "right/camera_info is of another camera" in play.line().message


@pytest.mark.parametrize("fixed_frame", [MAP, ""])
def test_two_cameras_with_one_frame_id_are_named(fixed_frame):
    play = Play([LEFT, replace(RIGHT, name="left")], replace(TWO, fixed_frame=fixed_frame)).run(1.0)
    assert "the images of 'left' and 'right' have one frame_id, 'left_optical'" in play.line().message
    if not fixed_frame:
        return
    assert "one frame_id" not in Play([LEFT, RIGHT]).run(1.0).line().message
    placed = {"left": LEFT.pose_at(0), "right": RIGHT.pose_at(0)}  # given poses need no frame_id
    assert "one frame_id" not in Play([LEFT, LEFT], poses=placed).run(1.0).line().message


def test_the_poses_are_checked_with_several_people_too():
    settings = NodeSettings(cameras=("left", "right"), fixed_frame=MAP, max_people=3)
    poses = {"left": LEFT.pose_at(0), "right": off(RIGHT, 5.0, 0.0)}
    play = Play([LEFT, RIGHT], settings, poses=poses).run(6.0)
    assert "cameras 'left' and 'right' contradict each other" in play.line().message
    assert len(camera_commands(play.session)) == 1


def test_the_learned_poses_are_saved_as_static_transforms_with_the_frames_of_the_images(tmp_path):
    name, poses = "right cam; touch x #", {"left": LEFT.pose_at(0), "right": off(RIGHT, 3.0, 0.02)}
    play = Play([LEFT, eye(name, 90)], TWO, poses=poses)
    with pytest.raises(CamerasFileError, match="no pose of a camera was learned yet"):
        save_cameras(play.session, tmp_path / "cameras.sh")
    play.run(6.0)
    refused = keypoints(BACKEND, eye("refused", 90), START_NS, 5.8, play.truth(5.8).landmarks[0], play.random)
    assert not play.session.frames(refused, START_NS + 6 * 10**9, "right")[0].accepted
    path = save_cameras(play.session, tmp_path / "new" / "cameras.sh")
    command, wait = path.read_text().splitlines()
    words = shlex.split(command)
    assert words[-5:] == ["--frame-id", MAP, "--child-frame-id", f"{name}_optical", "&"] and wait == "wait"
    numbers = {word: float(words[i + 1]) for i, word in enumerate(words) if word[:2] == "--" and "frame" not in word}
    centre = np.array([numbers[f"--{axis}"] for axis in "xyz"])
    turn = Rotation.from_quat([numbers[f"--q{axis}"] for axis in "xyzw"])
    truth = RIGHT.pose_at(0)
    assert np.linalg.norm(centre - truth.centre) < 0.1
    assert np.degrees((turn * Rotation.from_matrix(truth.rotation)).magnitude()) < 0.7
    for impossible in (path / "below_a_file", "~nobody_of_this_name/cameras.sh", "no\0name.sh"):
        with pytest.raises(CamerasFileError, match="cannot be written"):
            save_cameras(play.session, Path(impossible))
    with pytest.raises(CamerasFileError, match="there is one camera"):
        save_cameras(Play([LEFT], NodeSettings()).session, path)


LEARN = TrackerConfig(height=1.75, extrinsics="learn")


def without_tf_of_right(settings, config=LEARN, seconds=6.0, phase=0.0):
    """A play in which nobody tells where the right camera is."""
    return Play([LEFT, RIGHT], settings, config).run(seconds, phase=phase, tf=[0])


def test_a_camera_without_a_transform_is_found_from_the_person():
    play = without_tf_of_right(TWO, phase=1 / 60)
    assert len(play.results) >= 178 and not play.refused
    found = play.session.placement.places.newest["right"]
    assert np.linalg.norm(found.centre - RIGHT.pose_at(0).centre) < 0.3
    turn = Rotation.from_matrix(found.rotation @ RIGHT.pose_at(0).rotation.T)
    assert np.degrees(turn.magnitude()) < 3.0
    before = np.median([one.error.mean() for one in play.results if 1.0 < one.seconds < 4.5])
    assert play.results[-1].frame.estimate.cameras == 2 and play.error(5.5) < 1000 * before
    line = play.line()
    assert line.values["right: pose"] == "found from the person" and "right" not in line.message
    assert play.session.counts["no transform of right"] <= 1
    assert "--child-frame-id right_optical" in camera_commands(play.session)[0]


def test_until_it_is_found_the_other_camera_goes_on_and_diagnostics_says_why():
    play = without_tf_of_right(TWO, seconds=2.0)
    assert len(play.results) == 60 and play.results[-1].frame.estimate.cameras == 1
    said = play.line().message
    assert "no pose of camera 'right'" in said and "found from the person" in said
    checked = without_tf_of_right(TWO, TrackerConfig(height=1.75, extrinsics="check"))
    assert "right" not in checked.session.placement.places.newest and checked.results[-1].frame.estimate.cameras == 1


def test_a_camera_whose_place_was_found_from_the_person_does_not_measure_the_height():
    play = without_tf_of_right(TWO, TrackerConfig(height=0.0, extrinsics="learn"))
    assert "right" in play.session.placement.places.newest and play.results[-1].frame.estimate.cameras == 2
    (height,) = play.session.roster.heights().values()
    assert not height.measured and "1.7 m is assumed" in play.line().message


SHIFTS = np.array([[0.0, 0.0, 0.0], [1.0, 0.8, 0.0]])
"""m: of two people."""


def two_people_without_tf_of_right(in_view, seconds, max_people=4):
    """Two people, whose images nobody numbers. in_view: whether a camera sees a person at a time, s."""
    settings = NodeSettings(cameras=("left", "right"), fixed_frame=MAP, max_people=max_people)
    play = Play([LEFT, RIGHT], settings, LEARN)
    for index in range(round(30 * seconds)):
        now = index / 30
        play.transforms(0, now)
        for number, (name, one) in enumerate(zip(play.names, play.eyes)):
            shifts = [shift for person, shift in enumerate(SHIFTS) if in_view(number, person, now)]
            bodies = [truth_at([now + 3 * shift[0]], shift=shift).landmarks[0] for shift in shifts]
            people = [(pixels(one, now, body, play.random), np.full(17, 0.9)) for body in bodies]
            stamp_ns = START_NS + round(1e9 * now)
            play.keep(play.session.frames(crowd(BACKEND, stamp_ns, people, frame_id=one.frame), stamp_ns, name))
    return play


def test_of_several_people_the_one_who_is_alone_in_view_shows_where_a_camera_is():
    play = two_people_without_tf_of_right(lambda _, person, now: person == 0 or not 1.0 < now < 7.0, 8.5)
    found = play.session.placement.places.newest["right"]
    assert np.linalg.norm(found.centre - RIGHT.pose_at(0).centre) < 0.3
    turn = Rotation.from_matrix(found.rotation @ RIGHT.pose_at(0).rotation.T)
    assert np.degrees(turn.magnitude()) < 3.0
    last = {one.frame.person: one.frame.estimate for one in play.results[-4:]}
    assert len(last) == 2 and all(estimate.cameras == 2 for estimate in last.values())
    assert not play.refused and not any("rejected" in name for name in play.session.counts)


@pytest.mark.parametrize(
    "in_view, max_people",
    [(lambda *_: True, 1), (lambda number, person, _: number == person, 4)],
    ids=["both", "another one in each camera"],
)
def test_nothing_is_found_from_people_who_may_be_exchanged(in_view, max_people):
    play = two_people_without_tf_of_right(in_view, 7.0, max_people=max_people)
    assert "right" not in play.session.placement.places.newest
    assert "found from the person" in play.session.placement.places.fault and len(play.results) > 180


def test_without_fixed_frame_and_tf_two_cameras_need_no_calibration():
    play = without_tf_of_right(NodeSettings(cameras=("left", "right")))
    assert play.results[-1].frame.frame_id == LEFT.frame and play.results[-1].frame.estimate.cameras == 2
    assert not play.session.placement.places.faults
