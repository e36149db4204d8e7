"""Several cameras of which some see nobody: what is taken from which camera, and at which pose of it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sequences import CONFIG, FOCAL, RATE

from lassokin_ros.core.image.projection import project
from lassokin_ros.core.observation import CameraPose, Observation
from lassokin_ros.core.output.smoothing import Smoothing
from lassokin_ros.core.recording import WHOLE_FILE, track_recording
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import motion
from lassokin_ros.doubt.doubt import signs_of
from lassokin_ros.doubt.monitor import DoubtMonitor

UP, MIDDLE = np.array([0.0, -1.0, 0.0]), np.array([0.0, 0.0, 3.6])
NOBODY = np.zeros(17)


def beside(name, degrees, distance=3.6):
    """A camera that looks at the person from the side, by an angle from the first one's direction."""
    rotation = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
    return CameraPose(name, rotation, np.array([0.0, 0.0, distance]) - rotation @ MIDDLE)


A, B, C = beside("a", 0), beside("b", 90), beside("c", -90)
BEHIND = CameraPose("behind", np.diag([-1.0, 1.0, -1.0]), np.zeros(3))


class Scene:
    """A person of a height who moves, and what cameras see of them."""

    def __init__(self, seconds, height=1.75, rate=RATE, still=False):
        self.times, self.random = np.arange(round(seconds * rate)) / rate, np.random.default_rng(0)
        kinematics = Tracker(replace(CONFIG, height=height)).kinematics
        self.truth = kinematics.pose(motion(kinematics.skeleton, 0 * self.times + 5.0 if still else self.times))

    def seen(self, index, camera, shown=True, depth=False, stamp=None, given=None):
        """The observation of a camera; given: its pose as the tracker is told."""
        places = camera.into_camera(self.truth.landmarks[index])
        points = project(places) + 2 / FOCAL * self.random.normal(size=(17, 2))
        measured = places[:, 2] + 0.03 * self.random.normal(size=17) if depth else None
        confidence = np.ones(17) if shown else NOBODY
        stamp = self.times[index] if stamp is None else stamp
        return Observation(float(stamp), points, confidence, FOCAL, depth=measured, camera=given or camera)

    def off(self, index, estimate):
        """m: how far the root is from the truth."""
        return np.linalg.norm(estimate.pose.positions[0] - self.truth.positions[index, 0])


@pytest.mark.parametrize("depth_prior", [True, False])
def test_a_person_behind_the_first_camera_is_found_by_another_one(depth_prior):
    scene, tracker = Scene(0.5), Tracker(replace(CONFIG, depth_prior=depth_prior), up=UP)
    for index in range(len(scene.times)):
        estimate = tracker.track([scene.seen(index, BEHIND, shown=False), scene.seen(index, A)])
        assert estimate.accepted and scene.off(index, estimate) < 0.1
        if index == 5:
            tracker.reset()
        tracker.place_cameras([BEHIND])


def test_the_networks_pose_is_of_a_camera_that_sees_the_person_now():
    distances = []
    for seen_first in (True, False):
        scene, tracker = Scene(3.0), Tracker(CONFIG, up=UP)
        for index in range(len(scene.times)):
            first = [scene.seen(index, A)] if seen_first and index < RATE else []
            estimate = tracker.track([*first, scene.seen(index, B)])
        distances.append(estimate.network_distance)
    assert distances[0] == pytest.approx(distances[1], abs=0.02)


@pytest.mark.parametrize("degrees, depth_on", [(35, ""), (90, "a"), (35, "b")])
def test_the_height_is_measured_by_cameras_that_run_freely(degrees, depth_on):
    scene, tracker = Scene(3.0, 1.55, 2 * RATE), Tracker(replace(CONFIG, height=0.0))
    cameras = A, beside("b", degrees)
    for index in range(len(scene.times)):
        camera = cameras[index % 2]
        tracker.track(scene.seen(index, camera, depth=camera.name == depth_on))
    assert tracker.learned.height.measured and tracker.skeleton.height == pytest.approx(1.55, abs=0.06)


@pytest.mark.parametrize("depth_on", ["a", "b"])
def test_the_depth_of_any_camera_measures_the_size(depth_on):
    near = CameraPose("b", np.eye(3), np.array([-0.06, 0.0, 0.0]))
    scene, tracker = Scene(3.0, 1.55), Tracker(replace(CONFIG, height=0.0))
    too_large = Tracker(replace(CONFIG, height=1.9))
    for index in range(len(scene.times)):
        images = [scene.seen(index, one, depth=one.name == depth_on) for one in (CameraPose("a"), near)]
        tracker.track(images)
        too_large.track(images)
    assert tracker.skeleton.height == pytest.approx(1.55, abs=0.06)
    assert too_large.learned.size_check.wrong


@pytest.mark.parametrize("metres, degrees, cameras", [(0.0, 0, 1), (0.06, 0, 1), (0.06, 180, 1), (0.45, 0, 2)])
def test_a_camera_beside_another_one_does_not_observe_the_distance(metres, degrees, cameras):
    """The stated height is 9 % too large, and so is the distance; its stated deviation is that of one camera."""
    roll = Rotation.from_euler("z", degrees, degrees=True).as_matrix()
    near = CameraPose("b", roll, roll @ [-metres, 0.0, 0.0])
    scene, tracker = Scene(1.0), Tracker(replace(CONFIG, height=1.9))
    for index in range(len(scene.times)):
        estimate = tracker.track([scene.seen(index, CameraPose("a")), scene.seen(index, near)])
    assert estimate.cameras == cameras
    stated = np.sqrt(tracker.uncertainty(estimate).absolute.joints[0, 2, 2])
    assert (stated > 0.15) == (cameras == 1) and scene.off(index, estimate) < 2.5 * stated


def test_the_distance_of_a_person_of_unknown_height_is_as_uncertain_as_that_height():
    """1.7 m is assumed, children included, until something measures it."""
    scene, stated = Scene(0.2), []
    for height in (1.7, 0.0):
        tracker = Tracker(replace(CONFIG, height=height))
        estimate = tracker.track(scene.seen(0, CameraPose("a")))
        stated.append(np.sqrt(tracker.uncertainty(estimate).absolute.joints[0, 2, 2]) / MIDDLE[2])
    assert (
        0.04 < stated[0] < 0.06 and stated[1] == pytest.approx(estimate.size_deviation, abs=0.02) and stated[1] > 0.12
    )


@pytest.mark.parametrize("turn", [0.0, 0.5])
def test_learned_poses_do_not_hide_that_a_camera_turns(turn):
    steps = []
    for extrinsics in ("check", "learn"):
        scene, tracker, places = Scene(3.0, still=True), Tracker(replace(CONFIG, extrinsics=extrinsics), up=UP), []
        for index, seconds in enumerate(scene.times):
            head = CameraPose("head", Rotation.from_euler("y", turn * np.sin(seconds)).as_matrix(), np.zeros(3))
            estimate = tracker.track([scene.seen(index, head), scene.seen(index, beside("other", -60))])
            places.append(estimate.pose.positions)
        steps.append(np.linalg.norm(np.diff(places[len(places) // 3 :], axis=0), axis=-1).mean())
        assert estimate.contacts.sum() == 2
    assert steps[1] < 1.1 * steps[0]


def test_a_camera_that_sees_nobody_does_not_stop_the_learning_of_poses():
    turn = Rotation.from_euler("y", 3, degrees=True).as_matrix()
    wrong = CameraPose("b", turn @ B.rotation, turn @ B.translation)
    scene, tracker = Scene(6.0), Tracker(replace(CONFIG, extrinsics="learn"))
    for index in range(len(scene.times)):
        images = [scene.seen(index, A), scene.seen(index, B, given=wrong), scene.seen(index, C, shown=False)]
        estimate = tracker.track(images)
    assert scene.off(index, estimate) < 0.05
    assert tracker.learned.extrinsics.solution("b")[0] == pytest.approx(np.radians(3), abs=0.01)


def test_a_camera_is_found_although_the_first_one_sees_nobody():
    scene, tracker = Scene(6.0), Tracker(replace(CONFIG, extrinsics="learn"))
    for index in range(len(scene.times)):
        unplaced = scene.seen(index, C, given=CameraPose("c", known=False))
        tracker.track([scene.seen(index, A, shown=False), scene.seen(index, B), unplaced])
    assert "c" in tracker.learned.extrinsics.found


def test_the_distance_of_a_found_camera_follows_from_the_measured_height():
    """Two placed cameras measure a person of 1.95 m, of whom a camera by itself does not know the size."""
    scene, tracker = Scene(6.0, height=1.95, rate=10), Tracker(replace(CONFIG, extrinsics="learn", height=0.0))
    for index in range(len(scene.times)):
        unplaced = scene.seen(index, C, given=CameraPose("c", known=False))
        tracker.track([scene.seen(index, A), scene.seen(index, B), unplaced])
    assert np.linalg.norm(tracker.learned.extrinsics.found["c"].centre - C.centre) < 0.1  # 0.3 with 1.70 m


def test_a_measured_height_moves_the_person_along_the_rays_of_the_camera_that_sees_them():
    scene, tracker = Scene(0.1, height=1.95), Tracker(replace(CONFIG, height=0.0), up=UP)
    estimate = tracker.track([scene.seen(0, A, shown=False), scene.seen(0, B, depth=True)])
    ratio = tracker.skeleton.height / tracker.given_skeleton.height
    expected = B.centre + ratio * (estimate.solved.translation - B.centre)
    assert ratio > 1.05 and np.allclose(tracker.state.translation, expected)


def test_the_networks_places_are_those_at_the_time_of_the_image():
    scene, tracker = Scene(0.1), Tracker(CONFIG, up=UP)
    tracker.track(scene.seen(0, B))
    before = tracker._cameras[0].network_places()
    turn = Rotation.from_euler("y", 20, degrees=True).as_matrix()
    tracker.place_cameras([CameraPose("b", turn @ B.rotation, turn @ B.translation)])
    assert np.array_equal(tracker._cameras[0].network_places(), before)


def test_a_camera_that_was_found_stays_where_it_is_when_the_frame_jumps():
    turn, shift = Rotation.from_euler("y", 0.5).as_matrix(), np.array([2.0, 0.0, -1.0])
    scene, tracker = Scene(7.0), Tracker(replace(CONFIG, extrinsics="learn"), up=UP)
    jump, moved, off = 6 * len(scene.times) // 7, CameraPose("", turn, shift), []
    for index in range(len(scene.times)):
        if index == jump:
            assert "c" in tracker.learned.extrinsics.found
            tracker.move_frame(turn, shift)
        given = A.after(moved.inverse) if index >= jump else A
        unplaced = scene.seen(index, C, given=CameraPose("c", known=False))
        estimate = tracker.track([scene.seen(index, A, given=given), unplaced])
        assert estimate.accepted
        place = estimate.pose.positions[0] if index < jump else moved.inverse.into_camera(estimate.pose.positions[0])
        off.append(np.linalg.norm(place - scene.truth.positions[index, 0]))
    assert np.mean(off[jump:]) < np.mean(off[jump - 10 : jump]) + 0.02 and estimate.cameras == 2


@pytest.mark.parametrize("height", [0.0, 7.0])
def test_the_floor_is_below_the_first_camera_wherever_that_is_in_the_frame(height):
    scene, tracker = Scene(0.1), Tracker(replace(CONFIG, camera_height=1.1), up=UP)
    tracker.track(scene.seen(0, CameraPose("a"), given=CameraPose("a", np.eye(3), -height * UP)))
    assert np.allclose(tracker.floor, [*UP, 1.1 - height])


def test_frozen_keypoints_of_several_cameras_are_no_new_person():
    scene, tracker, begun = Scene(2.5), Tracker(replace(CONFIG, lost_after=1.0)), 0
    for index, seconds in enumerate(scene.times):
        if index < RATE:
            images = [scene.seen(index, camera) for camera in (A, B)]
        begun += tracker.track([replace(one, stamp=float(seconds)) for one in images]).initialised
    assert begun == 1


def test_a_frame_has_its_backward_one_whichever_camera_saw_the_person():
    scene, found = Scene(1.0), []
    instants = [
        [scene.seen(index, A), scene.seen(index, B, shown=index % 2 == 0, stamp=seconds + 0.001)]
        for index, seconds in enumerate(scene.times)
    ]
    publish = Smoothing.publish

    def watched(smoothing, estimate, answer, lag, backward):
        found.append(backward is not None)
        return publish(smoothing, estimate, answer, lag, backward)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Smoothing, "publish", watched)
        track_recording(replace(CONFIG, **WHOLE_FILE), instants)
    assert len(found) == 3 * len(instants) and sum(found) == len(instants) and all(found[2 * len(instants) :])


def test_a_person_before_a_turning_wide_lens_does_not_jump():
    """The depth along the optical axis changes by more than a quarter in 0.1 s, the distance does not."""
    scene, tracker = Scene(1.2, still=True), Tracker(CONFIG, up=UP)
    monitor, events = DoubtMonitor(tracker.layout.names, tracker.skeleton.joint_names), []
    for index, seconds in enumerate(scene.times):
        turn = Rotation.from_euler("y", np.radians(60) - 2.0 * seconds).as_matrix()
        seen = scene.seen(index, CameraPose("head", turn, np.zeros(3)))
        estimate = tracker.track(seen)
        assert estimate.accepted
        events += monitor.update(signs_of(estimate, seen.points, FOCAL, 1.75, seen.camera)).events
    assert not events


@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), (100.0, -1.0, 70.0)])
def test_frames_kept_for_calibration_stay_before_the_camera_when_the_size_is_measured(origin):
    scene = Scene(3.0, 1.55)
    camera = CameraPose("a", np.eye(3), -np.array(origin))
    scene.truth = replace(scene.truth, landmarks=scene.truth.landmarks + origin)
    tracker = Tracker(replace(CONFIG, height=0.0), up=UP)
    for index in range(len(scene.times)):
        tracker.track(scene.seen(index, camera, depth=index > 1.5 * RATE))
    assert tracker.skeleton.height < 1.65
    kept = [frame.state.translation for frame in tracker.learned.lengths._frames]
    assert kept and np.linalg.norm(np.array(kept) - origin - MIDDLE, axis=1).max() < 1.0
