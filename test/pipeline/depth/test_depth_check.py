"""Depth images that do not show the person are noticed from the residuals, named, and left out."""

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags makes the messages")

from camera_rig import MAP, eye, keypoints, truth_at  # noqa: E402
from depth_camera import depth_message, render  # noqa: E402
from messages import FOCAL, HEIGHT, WIDTH, camera_info, cloud, rosbags_backend  # noqa: E402

from lassokin_ros.core.body.kinematics import BodyState, Kinematics  # noqa: E402
from lassokin_ros.core.body.landmarks import Layout  # noqa: E402
from lassokin_ros.core.body.skeleton import Skeleton  # noqa: E402
from lassokin_ros.core.config import TrackerConfig  # noqa: E402
from lassokin_ros.core.image.projection import project  # noqa: E402
from lassokin_ros.demo.synthetic import motion  # noqa: E402
from lassokin_ros.pipeline.depth.depth_check import MISFIT  # noqa: E402
from lassokin_ros.pipeline.outputs.diagnostics import Diagnostics  # noqa: E402
from lassokin_ros.pipeline.session import Session  # noqa: E402
from lassokin_ros.pipeline.settings import NodeSettings  # noqa: E402

BACKEND = rosbags_backend()
FRAMES, START_NS = 60, 10**12
SKELETON = Skeleton.load("anthropometric", 1.75)
TIMES = np.arange(FRAMES) / 30


@pytest.fixture(scope="module")
def scene():
    """Keypoints (f, 17, 2) px and depth images (f, h, w) m of a person who walks at 0.5 m/s."""
    kinematics = Kinematics(SKELETON, Layout.load("coco17", SKELETON))
    state = motion(SKELETON, TIMES)
    places = state.translation.copy()
    places[:, 0], places[:, 2] = 0.5 * TIMES - 0.5, 3.2
    pose = kinematics.pose(BodyState(state.rotations, places))
    noise = np.random.default_rng(0).normal(size=(FRAMES, 17, 2))
    pixels = project(pose.landmarks) * FOCAL + [WIDTH / 2, HEIGHT / 2] + noise
    return pixels, [render(SKELETON, positions) for positions in pose.positions], pose.positions


def play(session, pixels, images, start=0, encoding="16UC1"):
    """Process all images; return the fault after each message."""
    faults = []
    for i in range(FRAMES):
        stamp_ns = START_NS + round((start + TIMES[i]) * 1e9)
        session.first.depth.add(depth_message(BACKEND, stamp_ns, images[i], encoding), stamp_ns)
        assert session.process(cloud(BACKEND, stamp_ns, pixels[i]), stamp_ns).accepted
        faults.append(session.first.depth.check.fault)
    return faults


def wide(image):
    """As from a lens with a wider view, that is, not registered."""
    rows = np.clip((np.arange(HEIGHT) - HEIGHT // 2) * 5 // 4 + HEIGHT // 2, 0, HEIGHT - 1)
    columns = np.clip((np.arange(WIDTH) - WIDTH // 2) * 5 // 4 + WIDTH // 2, 0, WIDTH - 1)
    return image[rows][:, columns]


LIES = {
    "not registered": lambda images: [wide(image) for image in images],
    "beside the colour camera": lambda images: [np.roll(image, 40, axis=1) for image in images],
    "0.5 s older": lambda images: [images[max(i - 15, 0)] for i in range(FRAMES)],
    "of another camera": lambda images: [image[:, ::-1] for image in images],
}


def pipeline_with_depth():
    session = Session(TrackerConfig(height=1.75), NodeSettings(depth="aligned_depth_to_color"))
    assert session.set_camera(camera_info(BACKEND)) is None
    return session


@pytest.mark.parametrize("lie", LIES)
def test_depth_that_does_not_show_the_person_is_left_out_until_it_does(scene, lie):
    pixels, images, _ = scene
    session = pipeline_with_depth()
    faults = play(session, pixels, LIES[lie](images))
    assert "registered to the colour image, of the same camera, and of the same time" in faults[-1]
    assert not faults[5] and session.counts[MISFIT] > 10
    assert not session.process(cloud(BACKEND, START_NS + 21 * 10**8, pixels[-1]), 0).estimate.frame.depth_measured
    faults = play(session, pixels, images, start=3)
    assert not faults[-1]


def test_depth_in_mm_in_place_of_m_is_named(scene):
    """32FC1 is in m; nothing else is wrong with these images."""
    pixels, images, _ = scene
    fault = play(pipeline_with_depth(), pixels, [1000 * image for image in images], encoding="32FC1")[-1]
    assert "do not show the person" in fault and "registered" not in fault
    assert fault.endswith("in m (32FC1) or in mm (16UC1), because they are more than 100 times as large as expected")


def test_good_depth_and_hidden_legs_are_used(scene):
    pixels, images, _ = scene
    table = [np.where(np.arange(HEIGHT)[:, None] > 300, 1.5, image) for image in images]
    for shown in (images, table):
        session = pipeline_with_depth()
        assert not any(play(session, pixels, shown)) and session.counts[MISFIT] == 0


@pytest.mark.parametrize("max_people", [1, 3])
def test_of_several_cameras_the_one_whose_depth_does_not_fit_is_named_and_its_depth_left_out(max_people):
    """The right camera's depth images are mirrored."""
    eyes = {one.name: one for one in (eye("left", 0), eye("right", 90))}
    settings = NodeSettings(cameras=("left", "right"), fixed_frame=MAP, depth="depth_registered", max_people=max_people)
    poses = {name: one.pose_at(0) for name, one in eyes.items()}
    session, random = Session(TrackerConfig(height=1.75), settings, poses=poses), np.random.default_rng(0)
    for name, one in eyes.items():
        session.set_camera(camera_info(BACKEND, frame_id=one.frame), name)
    diagnostics = Diagnostics(session, "tracker", 0.0)
    for index in range(FRAMES):
        body, stamp_ns = truth_at([TIMES[index]]), START_NS + round(1e9 * TIMES[index])
        for name, one in eyes.items():
            image = render(SKELETON, poses[name].into_camera(body.positions[0]))
            message = depth_message(BACKEND, stamp_ns, image[:, :: 1 if name == "left" else -1], frame_id=one.frame)
            session.cameras[name].depth.add(message, stamp_ns)
            seen = keypoints(BACKEND, one, START_NS, TIMES[index], body.landmarks[0], random)
            frames = session.frames(seen, stamp_ns, name)
            diagnostics.count_message(frames, stamp_ns, 0.9, 0.001)
    left, right = (session.cameras[name].depth.check for name in eyes)
    assert right.fault and not left.fault and frames[0].estimate.frame.depth_measured
    assert np.linalg.norm(frames[0].estimate.pose.positions - body.positions[0], axis=1).mean() < 0.03
    diagnostics.count_camera_info(0.9)
    message = diagnostics.line(1.0).message
    assert "camera 'right': the depth images do not show the person" in message and "camera 'left'" not in message


def test_with_smoothing_nothing_is_left_out_because_nothing_is_compared(scene):
    """`smoothing_lag` is set while the images are left out: they must not stay so for ever."""
    pixels, images, _ = scene
    session = pipeline_with_depth()
    assert play(session, pixels, LIES["of another camera"](images))[-1]
    session.tune(TrackerConfig(height=1.75, smoothing_lag=0.1), session.config)
    left_out = session.counts[MISFIT]
    for i in range(FRAMES):
        stamp_ns = START_NS + round((3 + TIMES[i]) * 1e9)
        session.first.depth.add(depth_message(BACKEND, stamp_ns, images[i]), stamp_ns)
        found = session.frames(cloud(BACKEND, stamp_ns, pixels[i]), stamp_ns)
    assert session.counts[MISFIT] == left_out and found[-1].estimate.frame.depth_measured
