"""Depth images at keypoints: sampling, matching by stamp, registration, and their effect on the track."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("rosbags", reason="rosbags makes the messages")

from depth_camera import BACKGROUND, compressed_message, depth_message, render  # noqa: E402
from messages import FOCAL, FRAME, HEIGHT, WIDTH, camera_info, cloud, rosbags_backend, with_depths  # noqa: E402

from lassokin_ros.core.body.kinematics import Kinematics  # noqa: E402
from lassokin_ros.core.body.landmarks import Layout  # noqa: E402
from lassokin_ros.core.body.skeleton import Skeleton  # noqa: E402
from lassokin_ros.core.config import TrackerConfig  # noqa: E402
from lassokin_ros.core.image.projection import project  # noqa: E402
from lassokin_ros.demo.synthetic import motion  # noqa: E402
from lassokin_ros.pipeline.depth.depth_images import (  # noqa: E402
    MATCHED,
    NOT_REGISTERED,
    REFUSED,
    UNMATCHED,
    DepthImages,
)
from lassokin_ros.pipeline.outputs.diagnostics import Diagnostics  # noqa: E402
from lassokin_ros.pipeline.outputs.figures import height_in_words  # noqa: E402
from lassokin_ros.pipeline.session import Session  # noqa: E402
from lassokin_ros.pipeline.settings import NodeSettings  # noqa: E402
from msg_adapters.keypoints import Keypoints  # noqa: E402

BACKEND = rosbags_backend()
SIZE = WIDTH, HEIGHT
PERIOD_NS = 33_333_333
START_NS = 10**12


@pytest.fixture(scope="module")
def scene():
    """(skeleton, pixels (f, l, 2) with noise, joints (f, n, 3), landmarks (f, l, 3)) of two seconds at 30 Hz."""
    skeleton = Skeleton.load("anthropometric", 1.75)
    kinematics = Kinematics(skeleton, Layout.load("coco17", skeleton))
    pose = kinematics.pose(motion(skeleton, 1.0 + np.arange(60) / 30))
    noise = np.random.default_rng(0).normal(size=(*pose.landmarks.shape[:-1], 2))
    pixels = project(pose.landmarks) * FOCAL + [WIDTH / 2, HEIGHT / 2] + 1.5 * noise
    return skeleton, pixels, pose.positions, pose.landmarks


@pytest.fixture(scope="module")
def images(scene):
    """Depth images of the scene, at half of the resolution, with 1 cm of noise and holes."""
    random, depths = np.random.default_rng(1), []
    for positions in scene[2]:
        depth = render(scene[0], positions, 0.5)
        depth += 0.01 * random.normal(size=depth.shape)
        depth[random.random(depth.shape) < 0.1] = 0.0
        depths.append(depth)
    return depths


def keypoints_of(xy, stamp_ns=START_NS, frame_id=FRAME):
    return Keypoints(stamp_ns, frame_id, np.arange(len(xy)), xy, np.ones(len(xy)))


def test_the_depth_image_with_the_keypoints_stamp_is_used():
    counts = Counter()
    images = DepthImages(counts)
    for number in range(5):
        depth = np.full((HEIGHT // 4, WIDTH // 4), 1.0 + number)
        assert images.add(depth_message(BACKEND, START_NS + number * PERIOD_NS, depth), 0) is None
    xy = np.full((17, 2), 100.0)
    for number, late in ((0, 0.0), (2, 0.4), (2, -0.4), (4, 0.49)):
        stamp_ns = START_NS + round((number + late) * PERIOD_NS)
        found = images.with_depth(keypoints_of(xy), stamp_ns, SIZE, FRAME)
        assert np.allclose(found.depth, 1.0 + number) and found.depth_of_surface
        assert found.depth_age == pytest.approx(late * PERIOD_NS * 1e-9, abs=1e-9)
    assert images.with_depth(keypoints_of(xy), START_NS + 6 * PERIOD_NS, SIZE, FRAME).depth is None
    assert images.may_receive(START_NS + 6 * PERIOD_NS) and not images.may_receive(START_NS + 4 * PERIOD_NS)
    assert (counts[MATCHED], counts[UNMATCHED]) == (4, 1)
    own = replace(keypoints_of(xy), depth=np.full(17, 9.0))
    assert images.with_depth(own, START_NS, SIZE, FRAME) is own


@pytest.mark.parametrize("codec", ["png", "rvl"])
def test_compressed_images_are_sampled_like_others(codec):
    if codec == "png":
        pytest.importorskip("cv2", reason="OpenCV reads PNG")
    counts = Counter()
    images = DepthImages(counts, "/depth/compressedDepth")
    depth = np.full((HEIGHT // 4, WIDTH // 4), 2.5)
    assert images.add(compressed_message(BACKEND, START_NS, depth, codec=codec), 0) is None
    xy = np.full((17, 2), 100.0)
    for _ in range(2):
        assert np.allclose(images.with_depth(keypoints_of(xy), START_NS, SIZE, FRAME).depth, 2.5)
    damaged = compressed_message(BACKEND, START_NS + PERIOD_NS, depth, codec=codec)
    damaged.data = damaged.data[:40]
    assert images.add(damaged, 0) is None  # unpacked only when it is needed
    assert images.with_depth(keypoints_of(xy), START_NS + PERIOD_NS, SIZE, FRAME).depth is None
    assert (counts[MATCHED], counts[REFUSED]) == (2, 1) and "damaged" in images.fault


@pytest.mark.parametrize(
    ("frame_id", "shape", "words"),
    [("depth_optical_frame", (120, 160), "frame_id 'depth_optical_frame'"), (FRAME, (90, 160), "160 x 90 px")],
)
def test_an_unregistered_image_is_reported_and_not_used(frame_id, shape, words):
    counts = Counter()
    images = DepthImages(counts)
    images.add(depth_message(BACKEND, START_NS, np.ones(shape), frame_id=frame_id), 0)
    assert images.with_depth(keypoints_of(np.full((17, 2), 50.0)), START_NS, SIZE, FRAME).depth is None
    assert words in images.fault and counts[NOT_REGISTERED] == 1
    images.add(depth_message(BACKEND, START_NS + PERIOD_NS, np.ones((120, 160))), 0)
    found = images.with_depth(keypoints_of(np.full((17, 2), 50.0)), START_NS + PERIOD_NS, SIZE, FRAME)
    assert found.depth is not None and images.fault == ""


def test_an_unknown_encoding_is_reported():
    counts = Counter()
    images = DepthImages(counts)
    assert images.add(depth_message(BACKEND, 1, np.ones((4, 4)), "8UC1"), 0) == "depth_encoding"
    assert "expected one of: 16UC1" in images.fault and counts[REFUSED] == 1


def test_a_jump_back_in_time_forgets_the_images():
    images = DepthImages(Counter())
    for stamp_ns in (START_NS, START_NS - PERIOD_NS):  # the second one was overtaken
        images.add(depth_message(BACKEND, stamp_ns, np.ones((4, 4))), 0)
    assert images.newest_ns == START_NS
    images.add(depth_message(BACKEND, START_NS - 10**10, np.ones((4, 4))), 0)
    assert images.newest_ns == START_NS - 10**10


def track(scene, images, settings=None, config=None, frames=60, change=lambda message: message):
    """Mean joint and root errors (m) of the last second, and the session; images: None for none."""
    _, pixels, truth, _ = scene
    session = Session(config or TrackerConfig(height=1.75), settings or NodeSettings(depth="depth"))
    session.set_camera(camera_info(BACKEND))
    errors = []
    for i in range(frames):
        stamp_ns = START_NS + i * PERIOD_NS
        if images is not None:
            session.first.depth.add(change(depth_message(BACKEND, stamp_ns, images[i])), 0)
        frame = session.process(cloud(BACKEND, stamp_ns, pixels[i]), 0)
        assert frame.accepted, frame.detail
        positions = frame.estimate.pose.positions
        errors.append(
            (
                np.linalg.norm((positions - positions[0]) - (truth[i] - truth[i, 0]), axis=-1).mean(),
                np.linalg.norm(positions[0] - truth[i, 0]),
            )
        )
    return np.mean(errors[frames // 2 :], axis=0), session


@pytest.fixture(scope="module")
def without_depth(scene):
    return track(scene, None)[0]


def test_depth_images_improve_the_track(scene, images, without_depth):
    with_depth, session = track(scene, images)
    assert session.counts[MATCHED] == 60 and session.counts[UNMATCHED] == 0
    assert with_depth[0] < 0.8 * without_depth[0] and with_depth[1] < 0.05


def test_unusable_depth_images_do_not_change_the_track(scene, without_depth):
    errors, session = track(scene, [np.zeros((24, 32))] * 60)
    assert np.array_equal(errors, without_depth) and session.counts[MATCHED] == 60


def test_a_wall_behind_and_an_occluder_in_front_do_not_increase_the_error(scene, images, without_depth):
    walls = [np.full_like(image, BACKGROUND) for image in images]
    assert np.all(track(scene, walls)[0] < without_depth + 0.01)
    hidden = []
    for image in images:  # everything below the hips is behind a desk
        image = image.copy()
        image[image.shape[0] * 6 // 10 :] = 1.5
        hidden.append(image)
    assert np.all(track(scene, hidden)[0] < without_depth + 0.01)


def test_height_0_measures_the_height(scene, images):
    skeleton, pixels, truth, _ = scene
    config = TrackerConfig(height=0.0)
    errors, session = track(scene, images, config=config)
    height = session.tracker.learned.height
    assert abs(height.height - 1.75) < 0.035 and 0.05 < height.deviation < 0.08
    assert abs(session.tracker.skeleton.height - 1.75) < 0.05 and errors[1] < 0.08
    values = Diagnostics(session, "tracker", 0.0).line(1.0).values
    assert float(values["height [m]"]) == pytest.approx(height.height, abs=6e-4)
    assert float(values["height: deviation [m]"]) == pytest.approx(height.deviation, abs=6e-4)
    assert session.roster.heights() == {"": height} and height_in_words(height).endswith("deviation 0.06 m")
    session.reset()
    assert height_in_words(height) == "1.70 m, a mean of people: no depth was measured"
    assert Session(TrackerConfig(height=1.75), NodeSettings()).roster.heights() == {}
    assert session.tracker.skeleton.height == pytest.approx(config.assumed_height) and not height.measured
    assert (TrackerConfig().height_text, TrackerConfig(height=1.75).height_text) == ("to be measured", "1.75 m")
    untold, session = track(scene, None, config=config, frames=20)
    assert session.tracker.skeleton.height == config.assumed_height


def test_a_height_that_nobody_has_is_not_measured(scene, images):
    """A wall 3 m behind the person implies 2.9 m. The images that follow are used as if they were the first."""
    config = TrackerConfig(height=0.0)
    walls = [np.full_like(image, BACKGROUND + 0.5) for image in images]
    assert not track(scene, walls, config=config)[1].tracker.learned.height.measured
    height = track(scene, walls[:10] + list(images[10:]), config=config)[1].tracker.learned.height
    assert abs(height.height - 1.75) < 0.05


def test_the_cloud_may_contain_the_depth(scene, images):
    skeleton, pixels, _, landmarks = scene
    depth = landmarks[0, :, 2].copy()
    depth[3] = np.nan
    message = with_depths(BACKEND, cloud(BACKEND, START_NS, pixels[0]), depth)
    session = Session(TrackerConfig(height=1.75), NodeSettings())
    session.set_camera(camera_info(BACKEND))
    keypoints, _ = session.first._decode(message)
    assert np.isnan(keypoints.depth[3]) and keypoints.depth_of_surface
    assert np.allclose(np.delete(keypoints.depth, 3), np.delete(landmarks[0, :, 2], 3), atol=1e-5)
    assert session.process(message, 0).accepted


SIZES = st.sampled_from([0, 1, 2, 3, 7, 16, 16385, 2**32 - 1])


@pytest.mark.filterwarnings("error::RuntimeWarning")
@settings(max_examples=300, deadline=None)
@given(
    st.sampled_from(["16UC1", "mono16", "32FC1", "", "8UC1", "\n" * 100]),
    st.sampled_from([0, 1, 255]),
    SIZES,
    SIZES,
    SIZES,
    st.binary(max_size=600),
    st.lists(st.floats(width=32), min_size=34, max_size=34),
)
def test_every_depth_image_is_sampled_or_refused(encoding, big_endian, height, width, step, data, points):
    message = BACKEND.make("sensor_msgs/msg/Image")
    message.encoding, message.is_bigendian, message.data = encoding, big_endian, np.frombuffer(data, np.uint8)
    message.height, message.width, message.step = height, width, step
    images = DepthImages(Counter())
    reason = images.add(message, START_NS)
    assert reason in (None, "depth_encoding", "depth_layout") and len(images.fault) < 500
    found = images.with_depth(keypoints_of(np.reshape(points, (17, 2))), START_NS, SIZE, FRAME)
    assert found.depth is None or (np.isnan(found.depth) | (found.depth > 0)).all()
