"""The node `camera` on real DDS: a video file made by the test, and a camera that is disconnected."""

import sys
import time
from functools import partial

import numpy as np
import pytest

pytest.importorskip("rclpy")
cv2 = pytest.importorskip("cv2")

import rclpy  # noqa: E402
from live import NO_HANDLERS, NodeProcess  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy  # noqa: E402
from sensor_msgs.msg import CameraInfo, Image  # noqa: E402

from lassokin_ros.camera import node as camera_module  # noqa: E402
from lassokin_ros.core.errors import CameraError  # noqa: E402
from lassokin_ros.video.sources import Image as SourceImage  # noqa: E402
from lassokin_ros.video.sources import Source, SourceError  # noqa: E402
from msg_adapters.image import decode_image  # noqa: E402

COMMAND = [sys.executable, "-m", "lassokin_ros.cli.lassokin", "camera"]
FRAMES, FPS, SIZE = 12, 20.0, (160, 120)
SIDE = 80
DEADLINE_S = 60.0
CALIBRATION = """
image_width: 8
image_height: 8
camera_matrix: {data: [9.0, 0, 4, 0, 9, 4, 0, 0, 1]}
distortion_coefficients: {data: [0.0, 0, 0, 0, 0]}
"""


class Log:
    """Records the node's log lines by level."""

    def __init__(self):
        self.lines = {"info": [], "warning": [], "error": []}
        for level, lines in self.lines.items():
            setattr(self, level, partial(self._add, lines))

    @staticmethod
    def _add(lines, text, throttle_duration_sec=0.0):
        lines.append(text)


@pytest.fixture
def ros():
    """A context and an executor; the nodes in it end with it."""
    context = rclpy.Context()
    rclpy.init(context=context, signal_handler_options=NO_HANDLERS)
    executor = SingleThreadedExecutor(context=context)
    yield context, executor
    for node in executor.get_nodes():
        node.destroy_node()
    executor.shutdown()
    context.try_shutdown()


@pytest.fixture
def log(monkeypatch):
    result = Log()
    monkeypatch.setattr(camera_module.CameraNode, "get_logger", lambda self: result)
    return result


def subscribe(context, executor, namespace):
    """Collects the received images and camera_infos."""
    images, infos = [], []
    node = rclpy.create_node("viewer", namespace=namespace, context=context)
    qos = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
    node.create_subscription(Image, "image_raw", images.append, qos)
    node.create_subscription(CameraInfo, "camera_info", infos.append, qos)
    executor.add_node(node)
    return images, infos


def spin_until(executor, condition, what):
    end = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < end, f"{what} did not come"
        executor.spin_once(timeout_sec=0.05)


def stamp_ns(message):
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


def camera(context, executor, namespace, **parameters):
    overrides = [Parameter(name, value=value) for name, value in parameters.items()]
    node = camera_module.CameraNode(context=context, namespace=namespace, parameter_overrides=overrides)
    executor.add_node(node)
    return node


def test_a_video_file_is_published_at_its_own_times(ros, log, tmp_path):
    file = tmp_path / "walk.avi"
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"MJPG"), FPS, SIZE)
    for number in range(FRAMES):
        writer.write(np.full((*SIZE[::-1], 3), (20 * number, 0, 0), np.uint8))  # BGR
    writer.release()
    node = camera(*ros, "/file", source=str(file), frame_id="lens", longest_side=SIDE)
    assert node.count_publishers("image_raw") == 1 and "starts when somebody subscribes" in log.lines["info"][-1]
    images, infos = subscribe(*ros, "/file")
    spin_until(ros[1], lambda: images and abs(stamp_ns(images[-1]) - stamp_ns(images[0])) >= 1e9 * 10 / FPS, "images")
    spin_until(ros[1], lambda: log.lines["info"][-1] == "walk.avi has ended", "the end")
    steps = np.diff([stamp_ns(image) for image in images]) / (1e9 / FPS)
    assert np.allclose(steps, np.round(steps), atol=1e-3) and steps.min() > 0.99
    assert {image.header.frame_id for image in images} == {"lens"} and infos[-1].header.frame_id == "lens"
    blue = decode_image(images[-1])[:, :, 2].mean()
    assert decode_image(images[-1])[:, :, 0].max() < 30 and blue > 150
    focal = SIDE / 2 / np.tan(np.radians(30))
    assert np.allclose(infos[0].k, [focal, 0, 39.5, 0, focal, 29.5, 0, 0, 1]) and infos[0].distortion_model
    assert (infos[0].width, infos[0].height) == (80, 60) and {stamp_ns(i) for i in infos} & {
        stamp_ns(i) for i in images
    }
    (warning,) = log.lines["warning"]
    assert "field of view of 60 degrees is assumed" in warning and "parameter fov or calibration" in warning


@pytest.fixture
def file_source(monkeypatch):
    """A source like a file of three images."""

    def images():
        for number in range(3):
            yield SourceImage(number * 0.05, np.zeros((8, 8, 3), np.uint8))

    source = Source("walk.avi", (8, 8), (8, 8), 20.0, 3, images(), live=False)
    monkeypatch.setattr(camera_module, "open_source", lambda name: source)


@pytest.mark.parametrize("has_size", [True, False])
def test_the_calibration_of_the_source_is_scaled_with_its_images(ros, log, monkeypatch, tmp_path, has_size):
    """A file of OpenCV may have no size; it is for the images of the source, not for the smaller published ones."""
    source = Source("walk.avi", SIZE, SIZE, FPS, 3, iter(()), live=False)
    monkeypatch.setattr(camera_module, "open_source", lambda name: source)
    lines = CALIBRATION.replace("_width: 8", "_width: 160").replace("_height: 8", "_height: 120").strip().splitlines()
    file = tmp_path / "camera.yaml"
    file.write_text("\n".join(lines if has_size else lines[2:]), encoding="utf-8")
    node = camera(*ros, "/scaled", calibration=str(file), longest_side=SIDE)
    assert node._camera.size == (80, 60)
    assert np.allclose(node._camera.K, [[4.5, 0, 2], [0, 4.5, 2], [0, 0, 1]])


def test_the_home_folder_may_be_written_as_a_tilde(ros, log, file_source, monkeypatch, tmp_path):
    """The shell does not expand it in `source:=~/walk.mp4`."""
    opened, source = [], camera_module.open_source("")
    monkeypatch.setattr(camera_module, "open_source", lambda name: opened.append(name) or source)
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "ost.yaml").write_text(CALIBRATION, encoding="utf-8")
    given = {"source": "~/walk.mp4", "calibration": "~/ost.yaml"}
    assert camera(*ros, "/home", **given)._camera.K[0, 0] == 9.0
    assert opened == [str(tmp_path / "walk.mp4")]
    with pytest.raises(CameraError, match="calibration has the lens; expected no fov beside it"):
        camera(*ros, "/both", **given, fov=70.0)
    with pytest.raises(SourceError, match="longest_side is 0 px; expected 64 px or more"):
        camera(*ros, "/small", **given, longest_side=0)


def test_a_later_subscriber_receives_the_last_camera_info(ros, log, file_source):
    camera(*ros, "/late", fov=70.0)
    _, infos = subscribe(*ros, "/late")
    spin_until(ros[1], lambda: log.lines["info"][-1] == "walk.avi has ended", "the end")
    spin_until(ros[1], lambda: infos, "camera_info")
    node, received = rclpy.create_node("late", namespace="/late", context=ros[0]), []
    kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, reliability=ReliabilityPolicy.RELIABLE)
    node.create_subscription(CameraInfo, "camera_info", received.append, kept)
    ros[1].add_node(node)
    spin_until(ros[1], lambda: received, "the kept camera_info")


def test_a_file_waits_some_time_for_a_subscriber_of_camera_info(ros, log, file_source, monkeypatch):
    monkeypatch.setattr(camera_module, "CAMERA_INFO_WAIT_S", 1.0)
    camera(*ros, "/patient", fov=70.0)
    node, images = rclpy.create_node("detector", namespace="/patient", context=ros[0]), []
    node.create_subscription(Image, "image_raw", images.append, 10)
    ros[1].add_node(node)
    spin_until(ros[1], lambda: node.count_publishers("image_raw"), "the publisher")
    began = time.monotonic()
    spin_until(ros[1], lambda: images, "images without a subscriber of camera_info")
    assert time.monotonic() - began > 0.5


def test_a_disconnected_camera_is_reported_once_and_opened_again(ros, log, monkeypatch):
    opened = []

    def images(count):
        for number in range(count):
            yield SourceImage(number * 0.01, np.zeros((8, 8, 3), np.uint8))
        raise SourceError("camera 0 gives no more images")

    def open_source(name):
        opened.append(name)
        if len(opened) in (2, 3):
            raise SourceError("camera 0 cannot be opened")
        return Source("camera 0", (8, 8), (8, 8), 30.0, 0, images(3), live=True)

    monkeypatch.setattr(camera_module, "open_source", open_source)
    monkeypatch.setattr(camera_module, "RETRY_S", 0.02)
    node = camera(*ros, "/lost", fov=70.0)
    spin_until(ros[1], lambda: "camera 0 is back" in log.lines["info"], "the camera")
    spin_until(ros[1], lambda: len(log.lines["error"]) > 1, "the second loss")
    node.destroy_node()
    assert not node._thread.is_alive()
    assert set(log.lines["error"]) == {"camera 0 gives no more images; waiting for it"} and not log.lines["warning"]
    assert opened[:4] == ["0"] * 4


def test_a_node_that_is_stopped_does_not_say_that_its_camera_has_ended(ros, log, monkeypatch):
    images = iter(lambda: SourceImage(0.0, np.zeros((8, 8, 3), np.uint8)), None)
    source = Source("camera 0", (8, 8), (8, 8), 30.0, 0, images, live=True)
    monkeypatch.setattr(camera_module, "open_source", lambda name: source)
    node = camera(*ros, "/stopped", fov=70.0)
    node.destroy_node()
    assert not node._thread.is_alive()
    assert len(log.lines["info"]) == 1 and "publishes the images of camera 0" in log.lines["info"][0]


def test_another_camera_at_the_same_number_is_reported_and_not_used(ros, log, monkeypatch, tmp_path):
    """Its images have another aspect ratio than the calibration."""
    calibration = tmp_path / "camera.yaml"
    calibration.write_text(CALIBRATION, encoding="utf-8")
    sizes = iter([(8, 8), (16, 8), (16, 8)])

    def open_source(name):
        size = next(sizes, (8, 8))

        def images():
            yield SourceImage(0.0, np.zeros((*size[::-1], 3), np.uint8))
            raise SourceError("camera 0 gives no more images")

        return Source("camera 0", size, size, 30.0, 0, images(), live=True)

    monkeypatch.setattr(camera_module, "open_source", open_source)
    monkeypatch.setattr(camera_module, "RETRY_S", 0.02)
    node = camera(*ros, "/other", calibration=str(calibration))
    spin_until(ros[1], lambda: "camera 0 is back" in log.lines["info"], "the camera")
    node.destroy_node()
    assert not node._thread.is_alive()
    assert any("waiting for the camera" in line and "16 x 8" in line for line in log.lines["error"])


def test_an_unusable_source_is_one_line_and_exit_code_2():
    code, said = NodeProcess("/none", "-p", "source:=none.mp4", command=COMMAND).stop()
    assert code == 2 and said.strip() == "camera: there is no file or folder 'none.mp4'"
