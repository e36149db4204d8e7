"""Several cameras in one lasso: the same answers in every frame, better ones with two, and cameras that come and go."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sequences import CONFIG, FOCAL, RATE

from lassokin_ros.core import increment
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.cameras import Camera
from lassokin_ros.core.image.frame_data import FrameData, View
from lassokin_ros.core.image.projection import carried, huber_weights, project
from lassokin_ros.core.observation import CameraPose, Observation, Rejection
from lassokin_ros.core.output import uncertainty
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import motion

LEVEL_UP = np.array([0.0, -1.0, 0.0])
SIDE_TURN = Rotation.from_euler("y", 90, degrees=True).as_matrix()


def scene(seconds, noise_px=2.0, seed=0, **others):
    """(true poses, function that gives what a camera sees in a frame): a person before camera "front".

    Camera 'side' looks at the person's place from 90 degrees to the side, from the same distance; others: angles of
    further cameras, which come after it.
    """
    tracker = Tracker(CONFIG)
    times = np.arange(round(seconds * RATE)) / RATE
    truth = tracker.kinematics.pose(motion(tracker.skeleton, times))
    middle = truth.positions[:, 0].mean(0)
    front = CameraPose("front")
    turns = {name: Rotation.from_euler("y", angle, degrees=True).as_matrix() for name, angle in others.items()}
    around = [
        CameraPose(name, turn, np.array([0.0, 0.0, middle[2]]) - turn @ middle)
        for name, turn in {"side": SIDE_TURN, **turns}.items()
    ]
    random = np.random.default_rng(seed)
    seen = {}
    for camera in (front, *around):
        points = project(camera.into_camera(truth.landmarks))
        seen[camera.name] = points + random.normal(size=points.shape) * noise_px / FOCAL

    def observe(camera, frame, stamp=None):
        points = seen[camera.name][frame]
        return Observation(times[frame] if stamp is None else stamp, points, np.ones(len(points)), FOCAL, camera=camera)

    return truth, front, *around, observe


@pytest.mark.parametrize("settings", [{}, {"depth_prior": False}, {"depth": True}, {"depth": True, "height": 0.0}])
def test_the_answer_does_not_depend_on_the_frame_in_which_the_skeleton_is_kept(settings, centre=(100.0, -70.0, 30.0)):
    """With the depths of a depth camera, too, which measure the height if it is not given (1.75 m, not 1.7)."""
    truth, front, _, observe = scene(1.0)
    rotation = Rotation.from_euler("zyx", [0.7, -0.5, 0.9]).as_matrix()
    placed = CameraPose("front", rotation, -rotation @ centre)
    measured = settings.get("depth", False)
    config = replace(CONFIG, **{name: value for name, value in settings.items() if name != "depth"})
    own, other = Tracker(config, up=LEVEL_UP), Tracker(config, up=rotation.T @ LEVEL_UP)
    for frame in range(len(truth.positions)):
        seen = observe(front, frame)
        seen = replace(seen, depth=truth.landmarks[frame, :, 2]) if measured else seen
        one, two = own.track(seen), other.track(replace(seen, camera=placed))
        assert one.accepted and two.accepted and two.certificate.kkt_residual < 1e-6
        assert np.abs(placed.into_camera(two.pose.positions) - one.pose.positions).max() < 2e-5  # float32
        assert two.reprojection_px == pytest.approx(one.reprojection_px, rel=1e-3)
    assert other.skeleton.height == pytest.approx(own.skeleton.height)
    assert (other.skeleton.height > 1.73) == (settings.get("height", 1.75) > 0 or measured)


def from_moving_camera(turn, drive, frame_moves=False):
    """(contacts (f, 2), jitter of the pelvis, m) with a person who stands still before a camera that moves.

    turn: rad/s to and fro; drive: m/s. frame_moves: also the fixed frame, half way, by 0.3 rad and 2 m.
    """
    tracker = Tracker(CONFIG, up=LEVEL_UP)
    places = tracker.kinematics.pose(motion(tracker.skeleton, np.array([5.0]))).landmarks[0]
    random, contacts, roots = np.random.default_rng(0), [], []
    ankles = [tracker.skeleton.index(f"{side}_ankle") for side in ("left", "right")]
    moved = Rotation.from_euler("y", 0.3).as_matrix(), np.array([2.0, 0.0, -1.0])
    for frame in range(150):
        stamp = frame / RATE
        rotation = Rotation.from_euler("y", turn * np.sin(stamp)).as_matrix()
        pose = CameraPose("head", rotation, -rotation @ [drive * np.sin(stamp), 0.0, 0.0])
        points = project(pose.into_camera(places)) + 0.003 * random.normal(size=(len(places), 2))
        if frame_moves and frame == 75:
            tracker.move_frame(*moved)
        if frame_moves and frame >= 75:
            turned = pose.rotation @ moved[0].T
            pose = CameraPose("head", turned, pose.translation - turned @ moved[1])
        estimate = tracker.track(Observation(stamp, points, np.ones(len(points)), FOCAL, camera=pose))
        contacts.append(estimate.contacts[ankles])
        roots.append(estimate.pose.positions[0])
    jitter = np.linalg.norm(np.diff(roots[80:], axis=0), axis=1).mean()
    return np.array(contacts), jitter


def test_the_motion_of_the_camera_is_none_of_the_person(turn=0.4, drive=0.4):
    still, expected = from_moving_camera(0.0, 0.0)
    contacts, jitter = from_moving_camera(turn, drive)
    assert still[30:].mean() > 0.8 and contacts[30:].mean() > 0.8
    assert jitter < 1.2 * expected


def test_a_jump_of_the_fixed_frame_is_no_motion_of_the_camera():
    (_, expected), (contacts, jitter) = (from_moving_camera(0.3, 0.0, jump) for jump in (False, True))
    assert jitter < 1.2 * expected and contacts[85:].mean() > 0.8


@pytest.mark.parametrize("moves", [True, False])
def test_a_corrected_pose_does_not_move_the_keypoints(moves):
    truth, front, side, observe = scene(0.3)
    tracker = Tracker(CONFIG, up=LEVEL_UP)
    for frame in range(len(truth.positions)):
        tracker.track([observe(front, frame), observe(side, frame)])
    camera = tracker._cameras[1]
    before = camera.predicted_view(0.3, tracker._solved.pose, 0.0).points
    turn = exponential(np.array([0.0, 0.02, 0.0]))
    camera.pose = replace(camera.pose, rotation=turn @ camera.pose.rotation, translation=turn @ camera.pose.translation)
    camera.given = camera.pose if moves else camera.given
    after = camera.predicted_view(0.3, tracker._solved.pose, 0.0).points
    assert (np.abs(after - before).max() > 0.01) == moves


def test_rows_of_a_second_camera_are_derivatives_of_its_image():
    truth, front, side, observe = scene(0.1)
    tracker = Tracker(CONFIG)
    tracker.frame_model.add_camera()
    model, state = tracker.frame_model, motion(tracker.skeleton, np.array([0.0]))
    state = type(state)(state.rotations[0], state.translation[0])
    count = tracker.kinematics.landmark_count
    points = project(side.into_camera(tracker.kinematics.pose(state).landmarks)) + 0.001
    frame = FrameData((View(points, np.zeros(count)), View(points, np.full(count, 300.0), camera=side)))
    linearised = model.linearise(model.evaluate(state), frame, huber_weights)
    own = linearised.rows["image 2"]
    assert own.stop - own.start == 2 * count and not linearised.columns[:, linearised.rows["image"]].any()
    random = np.random.default_rng(1)
    omega, x = np.zeros(3 * tracker.kinematics.joint_count), random.normal(size=3)
    omega[model.live] = random.normal(size=len(model.live))
    step = 1e-6

    def image(sign):
        moved = state.retract(sign * step * omega, sign * step * x)
        return project(side.into_camera(tracker.kinematics.pose(moved).landmarks)).ravel() * 300.0

    numeric = (image(1) - image(-1)) / (2 * step)
    analytic = linearised.columns[:, own].T @ np.append(omega[model.live], x)
    assert np.allclose(analytic, numeric, rtol=1e-5, atol=1e-4)


def test_two_cameras_observe_depth():
    truth, front, side, observe = scene(2.0)
    errors, stated = [], []
    for cameras in ([front], [front, side]):
        tracker, own = Tracker(CONFIG), []
        for frame in range(len(truth.positions)):
            estimate = tracker.track([observe(camera, frame) for camera in cameras])
            assert estimate.accepted and estimate.certificate.kkt_residual < 1e-6
            assert estimate.cameras == len(cameras)
            own.append(np.linalg.norm(estimate.pose.positions - truth.positions[frame], axis=-1).mean())
        errors.append(np.median(own))
        stated.append(tracker.uncertainty(estimate).deviation[1:].mean())
    apart = estimate.pose.positions - truth.positions[frame]
    relative = np.linalg.norm(apart - apart[0], axis=1)[1:].mean()
    assert errors[1] < 0.03 and errors[1] < 0.5 * errors[0]
    assert stated[1] < 0.65 * stated[0] and 0.5 * relative < stated[1] < 8 * relative


def test_images_in_turn_are_a_lasso_each_and_the_other_camera_is_predicted():
    truth, front, side, observe = scene(2.0)
    tracker, errors = Tracker(CONFIG), []
    for frame in range(len(truth.positions)):
        for camera, later in ((front, 0.0), (side, 0.004)):
            stamp = frame / RATE + later
            estimate = tracker.track(observe(camera, frame, stamp))
            assert estimate.accepted and estimate.stamp == stamp
            if frame:
                assert estimate.cameras == 2
        errors.append(np.linalg.norm(estimate.pose.positions - truth.positions[frame], axis=-1).mean())
    assert np.median(errors) < 0.03


def test_a_camera_that_falls_silent_and_returns_does_not_make_the_body_jump():
    truth, front, side, observe = scene(4.0, noise_px=1.0)
    tracker, places = Tracker(CONFIG), []
    for frame in range(len(truth.positions)):
        silent = 40 <= frame < 80
        estimate = tracker.track([observe(front, frame)] if silent else [observe(front, frame), observe(side, frame)])
        places.append(estimate.state.translation - truth.positions[frame, 0])
    jumps = np.linalg.norm(np.diff(places[5:], axis=0), axis=-1)
    assert jumps.max() < 0.02
    assert np.linalg.norm(places[-1]) < 0.03


def test_depths_of_the_only_camera_that_sees_the_person_have_their_own_deviations(monkeypatch):
    """The rows of the network have more weight than its deviations say, also if they are those of the second camera."""
    _, front, side, observe = scene(2.0)
    tracker = Tracker(CONFIG)
    for frame in range(60):
        estimate = tracker.track([observe(side, frame)] if frame else [observe(front, frame), observe(side, frame)])
    assert estimate.cameras == 1 and "learned depth 2" in estimate.increment.rows
    before = tracker.uncertainty(estimate).deviation
    monkeypatch.setattr(uncertainty, "WEIGHT", 1.0)
    after = tracker.uncertainty(estimate).deviation
    assert np.all(after[1:] <= before[1:]) and after.mean() < 0.95 * before.mean()


def test_a_late_message_only_updates_its_track():
    truth, front, side, observe = scene(1.0)
    tracker = Tracker(CONFIG)
    for frame in range(5):
        tracker.track([observe(front, frame), observe(side, frame)])
    tracker.track(observe(front, 6))
    before = tracker.state
    late = tracker.track(observe(side, 5))
    assert late.rejection is Rejection.LATE and tracker.state is before
    assert tracker.track([observe(front, 7), observe(side, 7)]).accepted


def test_bad_observations_of_one_camera_do_not_stop_the_others():
    truth, front, side, observe = scene(1.0)
    tracker = Tracker(replace(CONFIG, extrinsics="given"))
    for frame in range(3):
        assert tracker.track([observe(front, frame), observe(side, frame)]).accepted
    nothing = replace(observe(side, 3), points=np.full((17, 2), np.nan), confidence=np.zeros(17))
    assert tracker.track([observe(front, 3), nothing]).accepted
    wrong = replace(observe(side, 4), points=np.zeros((5, 2)), confidence=np.zeros(5))
    assert tracker.track([wrong, observe(front, 4)]).accepted
    assert tracker.track([wrong]).rejection is Rejection.WRONG_SHAPE
    assert tracker.track([]).rejection is Rejection.TOO_FEW_LANDMARKS
    assert tracker.track([observe(front, 5), observe(front, 5)]).accepted  # the same camera twice: the first counts


def test_two_cameras_doubt_a_given_height_that_is_wrong():
    truth, front, side, observe = scene(2.5)  # a person of 1.75 m
    tracker = Tracker(replace(CONFIG, height=1.35))
    for frame in range(len(truth.positions)):
        estimate = tracker.track([observe(front, frame), observe(side, frame)])
    assert tracker.learned.doubts == ("the height of 1.35 m does not fit",)
    assert estimate.size_deviation == pytest.approx(np.log(1.75 / 1.35), rel=0.3)


def test_nothing_is_learned_from_frozen_images_of_two_cameras():
    """Neither the height nor the cameras' poses: one image would count as much as a minute of motion."""
    truth, front, side, observe = scene(1.0)
    last = len(truth.positions) - 1
    tracker = Tracker(replace(CONFIG, height=0.0, extrinsics="learn"), up=LEVEL_UP)
    for frame in range(last + 1):
        tracker.track([observe(front, frame), observe(side, frame)])
    height, extrinsics = tracker.learned.height, tracker.learned.extrinsics
    information, correction = height._information, extrinsics.corrections["side"]
    for frozen in range(1, 31):
        stamp = observe(front, last).stamp + frozen / RATE
        assert tracker.track([observe(front, last, stamp), observe(side, last, stamp)]).repeated > 0
    assert information > 0 and height._information == information
    assert np.array_equal(extrinsics.corrections["side"], correction) and correction.any()


def test_a_camera_without_a_pose_is_not_found_by_a_frozen_image():
    truth, front, _, observe = scene(1.0)
    tracker = Tracker(replace(CONFIG, extrinsics="learn"))
    for frame in range(len(truth.positions)):
        unplaced = replace(observe(front, 0, frame / RATE), camera=CameraPose("side", known=False))
        tracker.track([observe(front, frame), unplaced])
    assert tracker.learned.extrinsics._finders["side"]._count <= 1


class RecordingNetwork:
    """Stands in for `DepthEstimator`: keeps what it was told."""

    joint_depths = None

    def __init__(self):
        self.told, self.resets = [], 0

    def reset(self):
        self.resets += 1

    def update(self, stamp, points, seen, up, mount):
        self.told.append((up, mount))


def test_the_network_of_each_camera_is_told_the_vertical_in_its_own_frame():
    tracker = Tracker(CONFIG, up=np.array([0.0, 0.0, 1.0]))
    _, front, side, observe = scene(0.2)
    network = RecordingNetwork()
    camera = Camera(tracker.kinematics, network, None)
    observation = observe(side, 0)
    weights = np.ones(len(observation.points))
    measurement = camera.measure(observation, weights, None, 0.0, tracker.config, alone=True)
    camera.view(measurement, tracker.learned.vertical, sized=True)
    (up, mount) = network.told[-1]
    assert np.allclose(mount, side.rotation @ [0.0, 0.0, 1.0]) and (up is None or np.allclose(up, mount))
    before = network.resets
    camera.reset()
    assert network.resets == before + 1


def test_a_depth_of_the_surface_may_be_announced_and_missing():
    tracker = Tracker(CONFIG)
    _, front, _, observe = scene(0.2)
    for number in range(2):
        assert tracker.track(replace(observe(front, number), depth_of_surface=True)).accepted


def test_the_line_of_sight_is_that_of_the_camera_that_sees_the_person():
    """Also in the first frame, which needs no search: the network of that camera sees the pose."""
    _, front, side, observe = scene(0.1)
    tracker = Tracker(CONFIG)
    tracker._starts.initialiser.fit = lambda frame: pytest.fail("searched")
    nothing = replace(observe(front, 0), confidence=np.zeros(tracker.kinematics.landmark_count))
    estimate = tracker.track([nothing, observe(side, 0)])
    assert estimate.accepted and estimate.cameras == 1 and len(tracker._cameras) == 2
    view, sight = estimate.frame.seeing, estimate.pose.positions[0] - side.centre
    assert np.allclose(view.camera.centre, side.centre)
    assert view.joint_depths.sight @ sight > 0.99 * np.linalg.norm(sight)


def test_a_camera_that_joins_late_has_the_given_lengths_and_not_the_learned_ones():
    """`reset` forgets the learned ones, and the network was told that its lengths are given."""
    _, front, side, observe = scene(0.1)
    scales = np.ones(24)
    scales[[4, 5]] = 1.1
    tracker = Tracker(CONFIG, Tracker(CONFIG).skeleton.with_bone_scales(scales))
    tracker.track(observe(front, 0))
    tracker.learned.lengths.lengths = np.linspace(-0.1, 0.1, len(tracker.learned.lengths.lengths))
    tracker._use_body()
    tracker.track([observe(front, 1), observe(side, 1)])
    first, second = (camera.network for camera in tracker._cameras)
    assert np.array_equal(first._lengths, second._lengths) and first._lengths_known and second._lengths_known


def test_a_camera_without_a_place_does_not_get_the_mount_of_the_first_one():
    _, front, side, observe = scene(0.1)
    tracker = Tracker(replace(CONFIG, extrinsics="learn", camera_pitch=0.5, camera_height=1.2))
    unplaced = replace(observe(side, 0), camera=CameraPose("side", known=False))
    tracker.track([observe(front, 0), unplaced])
    alone = tracker._unplaced.trackers["side"]
    assert alone.floor is None and np.allclose(alone.learned.vertical.mount, LEVEL_UP)


def test_a_large_motion_is_linearised_again_if_any_camera_measures_depth(monkeypatch):
    truth, front, side, observe = scene(0.1)
    depth = side.into_camera(truth.landmarks)[..., 2]
    asked = []
    monkeypatch.setattr(increment, "_is_large", lambda *_: asked.append(True))
    for measured in (None, depth[0]):
        tracker = Tracker(CONFIG)
        asked.clear()
        tracker.track([observe(front, 0), replace(observe(side, 0), depth=measured)])
        assert bool(asked) == (measured is not None)


@pytest.mark.parametrize(("degrees", "least", "most"), [(0.0, 0.0, 0.5), (3.0, 0.9, 1.1)])
def test_a_correction_is_used_as_far_as_it_is_larger_than_those_of_exact_poses(degrees, least, most):
    _, front, side, observe = scene(6.0)
    turned = Rotation.from_euler("y", degrees, degrees=True).as_matrix() @ side.rotation
    given = CameraPose("side", turned, side.translation)
    tracker = Tracker(replace(CONFIG, extrinsics="learn"))
    for frame in range(round(6.0 * RATE)):
        seen = observe(side, frame)
        tracker.track([observe(front, frame), replace(seen, camera=given)])
    extrinsics = tracker.learned.extrinsics
    found, used = extrinsics.solution("side")[0], np.linalg.norm(extrinsics.corrections["side"][:3])
    assert least * found <= used <= most * found
    assert np.degrees(found) == pytest.approx(degrees, abs=1.0)


@pytest.mark.parametrize("moved", ["front", "back"])
def test_of_three_cameras_the_one_that_contradicts_the_others_was_moved(moved):
    """Also the first one, whose pose is never corrected."""
    _, *cameras, observe = scene(2.7, back=150)
    tracker, turn = Tracker(CONFIG), exponential(np.array([[0.0, np.radians(6.0), 0.0]]))[0]
    for frame in range(round(2.7 * RATE)):
        seen = {camera.name: observe(camera, frame) for camera in cameras}
        if frame >= 60:
            seen[moved] = replace(seen[moved], points=carried(seen[moved].points, turn, np.zeros((17, 3))))
        tracker.track(list(seen.values()))
    words = tracker.learned.extrinsics.lately.in_words
    assert words.startswith(f"camera '{moved}' contradicts the others: it was moved, by about ")


def test_a_camera_that_was_moved_is_in_the_numbers_at_once():
    """By 6 degrees about the vertical after 3 s; two cameras do not show which one it was."""
    truth, front, side, observe = scene(4.2)
    tracker, turn = Tracker(CONFIG), exponential(np.array([[0.0, np.radians(6.0), 0.0]]))[0]
    stated, doubted = [], []
    for frame in range(len(truth.positions)):
        seen = observe(side, frame)
        if frame >= 90:
            seen = replace(seen, points=carried(seen.points, turn, np.zeros((17, 3))))
        estimate = tracker.track([observe(front, frame), seen])
        stated.append(np.sqrt(tracker.uncertainty(estimate).absolute.pelvis[:3, :3].trace()))
        doubted.append("a camera was moved" in tracker.learned.doubts)
    assert not any(doubted[:90]) and any(doubted[90:120])
    error = np.linalg.norm(estimate.pose.positions[0] - truth.positions[-1][0])
    assert max(stated[60:90]) < 0.08 < error < 2 * stated[-1]
    assert "one of them was moved" in tracker.learned.extrinsics.lately.in_words
