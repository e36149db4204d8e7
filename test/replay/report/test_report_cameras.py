"""The report of several cameras: each has its image with its own keypoints and the body as it sees it."""

import base64
import re
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")
cv2 = pytest.importorskip("cv2")

from browser import Page, browser, held, unpacked  # noqa: E402
from camera_rig import MAP, Eye, eye, keypoints, pixels, tf_of, truth_at  # noqa: E402
from messages import HEIGHT, WIDTH, camera_info, rosbags_backend  # noqa: E402
from recordings import write_messages  # noqa: E402

from lassokin_ros.cli.replay import main  # noqa: E402
from lassokin_ros.demo.synthetic import DISTANCE  # noqa: E402
from msg_adapters.inputs import rgb_image  # noqa: E402

BACKEND, START_NS, FRAMES = rosbags_backend(), 1_700_000_000_000_000_000, 30
EYES, GREY = [eye("left", 0), eye("right", 90)], {"left": 90, "right": 200}
INFO, CLOUD, TF = "sensor_msgs/msg/CameraInfo", "sensor_msgs/msg/PointCloud2", "tf2_msgs/msg/TFMessage"
CAMERAS = ("-p", "cameras:=[left, right]", "-p", f"fixed_frame:={MAP}")
PHASES = {"together": 0.0, "one at a time": 1 / 60}


@pytest.fixture(scope="module", params=PHASES)
def rig(request, tmp_path_factory):
    """The phase of the second camera, s, and the page of a recording with the images of both."""
    phase, folder = PHASES[request.param], tmp_path_factory.mktemp("rig")
    bag, page = write_messages(folder / "bag", recorded(EYES, phase)), folder / "page.html"
    command = [str(bag), "-o", str(folder / "out"), "--report", str(page), "--image-topic", "image_raw", *CAMERAS]
    assert main(command) == 0
    return phase, page


def recorded(placed, phase=0.0, seeing=EYES):
    """The messages of the cameras `seeing`, whose places in the map are those of `placed`."""
    messages, random = [], np.random.default_rng(0)
    for one in placed:
        messages.append(("/tf_static", TF, START_NS, tf_of(BACKEND, one, START_NS, 0.0)))
        messages.append((f"/rig/{one.name}/camera_info", INFO, START_NS, camera_info(BACKEND, frame_id=one.frame)))
    for index in range(FRAMES):
        for number, one in enumerate(seeing):
            now = index / 30 + number * phase
            stamp_ns = START_NS + round(1e9 * now)
            image = rgb_image(
                BACKEND, stamp_ns, one.frame, np.full((HEIGHT, WIDTH, 3), GREY.get(one.name, 0), np.uint8)
            )
            messages.append((f"/rig/{one.name}/image_raw", "sensor_msgs/msg/Image", stamp_ns + number, image))
            seen = keypoints(BACKEND, one, START_NS, now, truth_at([now]).landmarks[0], random)
            messages.append((f"/rig/{one.name}/keypoints", CLOUD, stamp_ns + 10**6 + number, seen))
    return sorted(messages, key=lambda message: message[2])


def test_each_camera_has_its_own_keypoints_and_reprojection(rig):
    phase, page = rig
    data = held(page.read_text(), "data")
    assert [one["name"] for one in data["cameras"]] == ["left", "right"]
    assert [one["image"] for one in data["cameras"]] == [[WIDTH, HEIGHT]] * 2
    (person,) = data["people"]
    times = np.array(person["time"])
    for number, (one, view) in enumerate(zip(EYES, [person, *person["others"]])):
        true = np.array([pixels(one, t, truth_at([t]).landmarks[0], np.random.default_rng(0), 0.0) for t in times])
        detected, reprojected = unpacked(view["detected"]), unpacked(view["reprojected"])
        seen = np.isfinite(detected[..., 0]).all(axis=1)
        assert (seen.mean() > 0.9) if phase == 0 else (0.4 < seen.mean() < 0.6)
        assert np.abs(detected[seen] - true[seen]).mean() < 1.2  # noise of 1 px
        shown = np.isfinite(reprojected[..., 0]).all(axis=1)
        assert shown.mean() > 0.9  # also between the images of the camera
        assert np.abs(reprojected[shown] - true[shown])[10:].mean() < 6
        assert unpacked(view["outline"]).shape == (len(times), 24, 2)


def test_every_instant_counts_once(rig):
    phase, page = rig
    text = page.read_text(encoding="utf-8")
    tracked = float(re.search(r"([\d.]+)% of the frames were tracked", text).group(1))
    assert tracked > 95 and "Instants of 2 cameras" in text


def moved(one, shift):
    """A camera that is elsewhere in the map."""
    pose = one.pose_at(0)
    there = replace(pose, translation=pose.translation - pose.rotation @ shift)
    return Eye(one.name, lambda seconds: there)


def test_a_person_far_from_the_origin_of_the_map_is_drawn_and_has_the_distance_to_the_camera(tmp_path):
    far = [moved(one, [50.0, -DISTANCE, 0.0]) for one in EYES]
    bag, page = write_messages(tmp_path / "bag", recorded(far)), tmp_path / "page.html"
    options = ["-p", "camera_pitch:=0.3", "-p", "smoothing_lag:=0.25"]  # a fixed frame gives the vertical
    assert main([str(bag), "-o", str(tmp_path / "out"), "--report", str(page), *CAMERAS, *options]) == 0
    data, text = held(page.read_text(), "data"), page.read_text(encoding="utf-8")
    assert data["level"] == np.eye(3).tolist()
    joints = unpacked(data["people"][0]["positions"])
    assert np.abs(joints[:, 0] - [50.0, -0.9, 0.0]).max() < 0.3 and np.ptp(joints[5], axis=0).min() > 0.2
    middle = float(re.search(r"<td>Distance of the pelvis</td><td>([-.\d]+) m median", text).group(1))
    assert abs(middle - DISTANCE) < 0.2 and "The median distance of the person" not in text
    assert f"<td>With a skeleton</td><td>{FRAMES} (100.0%)</td>" in text
    assert "<td>Without a skeleton</td><td>0</td>" in text


def test_each_camera_has_its_own_images(rig):
    _, page = rig
    images = held(page.read_text(), "images")
    for name, own in zip(GREY, [images, *images["others"]]):
        assert len(own["time"]) >= FRAMES - 2
        decoded = [cv2.imdecode(np.frombuffer(base64.b64decode(image), np.uint8), 1) for image in own["jpeg"]]
        assert np.abs([image.mean() - GREY[name] for image in decoded]).max() < 3


@pytest.mark.parametrize("rig", ["together"], indirect=True)
def test_the_browser_switches_between_the_cameras(rig):
    _, path = rig
    with browser() as running:
        page = Page(running, path)
        page.page.fill("#slider", "20")
        page.reach("document.body.dataset.frame === '20'", "frame 20")
        drawn = []
        for number, grey in enumerate(GREY.values()):
            page.page.select_option("#camera", str(number))
            source = page.value("document.getElementById('image').layout.images[0].source.split(',')[1]")
            shown = cv2.imdecode(np.frombuffer(base64.b64decode(source), np.uint8), 1)
            assert abs(shown.mean() - grey) < 3
            drawn.append(page.value("document.getElementById('image').data[5].x"))
        assert np.abs(np.subtract(*np.array(drawn, dtype=float))).max() > 20  # the body from the side
        assert page.page.is_visible("#camera") and page.errors == []
        page.page.close()


def test_a_missing_image_topic_of_a_camera_is_named(rig, tmp_path, capsys):
    command = [str(rig[1].parent / "bag"), "-o", str(tmp_path / "out"), "--report", str(tmp_path / "page.html")]
    assert main([*command, "--image-topic", "other", *CAMERAS]) == 2
    assert "no topic 'left/other'" in capsys.readouterr().err
