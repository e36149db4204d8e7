"""The images of a recording under the image plane of the report: those that are kept, and those that the page draws."""

import base64

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")
cv2 = pytest.importorskip("cv2")

from browser import Page, browser, held  # noqa: E402
from recordings import START_NS, synthetic_pixels, webcam_info, write_messages  # noqa: E402

from lassokin_ros.cli.replay import main  # noqa: E402
from lassokin_ros.demo.synthetic import WEBCAM  # noqa: E402
from lassokin_ros.replay.bags import typestore  # noqa: E402
from lassokin_ros.replay.report import images as module  # noqa: E402
from lassokin_ros.replay.report.images import LONGEST_SIDE, MOST, ReportImages  # noqa: E402
from msg_adapters.backends import RosbagsBackend  # noqa: E402
from msg_adapters.inputs import point_cloud, rgb_image  # noqa: E402

FRAMES = 8
RAW, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"


def grey(number):
    """The grey value of an image, which identifies it."""
    return 60 + 20 * number


def picture(number):
    return np.full((72, 128, 3), grey(number), np.uint8)


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """Keypoints, raw images of which two have an unknown encoding, and compressed images of every second frame."""
    backend = RosbagsBackend(typestore())
    messages = [("/camera_info", "sensor_msgs/msg/CameraInfo", START_NS, webcam_info())]
    for number, (stamp, pixels, confidence) in enumerate(zip(*synthetic_pixels(FRAMES))):
        stamp = int(stamp)
        image = rgb_image(backend, stamp, "camera_optical_frame", picture(number))
        compressed = backend.make(COMPRESSED)
        compressed.header, compressed.format = image.header, "jpeg"
        compressed.data = cv2.imencode(".jpg", picture(number))[1].reshape(-1)
        if number in (5, 6):
            image.encoding = "bayer_rggb16"
        messages.append(("/image_raw", RAW, stamp, image))
        between = rgb_image(backend, stamp + 9, "camera_optical_frame", picture(number))
        messages.append(("/image_raw", RAW, stamp, between))  # the detector has dropped it
        if number % 2 == 0:
            messages.append(("/image_raw/compressed", COMPRESSED, stamp, compressed))
        cloud = point_cloud(backend, stamp, "camera_optical_frame", pixels, confidence)
        messages.append(("/keypoints", "sensor_msgs/msg/PointCloud2", stamp, cloud))
    return write_messages(tmp_path_factory.mktemp("images") / "walk", messages)


def test_an_archive_says_that_a_page_is_kept_without_the_images(bag, tmp_path, capsys, tasks_here):
    command = [str(bag), str(bag / "none"), "--output", str(tmp_path), "--report", str(tmp_path / "pages")]
    main([*command])
    page = tmp_path / "pages" / f"{bag.name}.html"
    before = page.read_bytes()
    capsys.readouterr()
    for export, outcome in (([], "done before"), (["--export", ".csv"], "tracked")):
        main([*command, *export, "--image-topic", "image_raw"])
        kept = f"{outcome}: the page exists and is kept, with the images it has; add --force"
        assert kept in capsys.readouterr().out and page.read_bytes() == before
    main([*command, "--image-topic", "image_raw", "--force"])
    assert "the page exists" not in capsys.readouterr().out and page.read_bytes() != before


def report(bag, topic):
    page = bag.parent / f"{topic.replace('/', '_')}.html"
    out = bag.parent / f"{page.stem}_out"
    assert main([str(bag), "--output", str(out), "--report", str(page), "--image-topic", topic, "--force"]) == 0
    return page


def test_of_a_long_recording_every_nth_image_is_kept():
    images, read = ReportImages(), []
    for number in range(700):
        images.add(1000 + number, lambda number=number: read.append(number) or picture(0))
    kept = images.data({1000 + number: number / 10 for number in range(700)})
    assert kept["time"] == [number / 10 for number in range(0, 700, 4)] and len(kept["time"]) <= MOST
    assert len(read) < 500  # what is not kept is not decoded


def test_large_images_are_scaled_down_and_stay_within_the_budget(monkeypatch):
    monkeypatch.setattr(module, "BUDGET", 500_000)
    noise = np.random.default_rng(0).integers(0, 255, (960, 1280, 3), dtype=np.uint8)
    images = ReportImages()
    for number in range(8):
        images.add(number, lambda: noise)
    kept = images.data({number: float(number) for number in range(7)})  # the last one has no keypoints
    decoded = [cv2.imdecode(np.frombuffer(base64.b64decode(image), np.uint8), 1) for image in kept["jpeg"]]
    assert {image.shape for image in decoded} == {(LONGEST_SIDE * 3 // 4, LONGEST_SIDE, 3)}
    assert 1 <= len(decoded) < 8 and sum(map(len, kept["jpeg"])) < 500_000 * 4 / 3


@pytest.mark.parametrize("topic, numbers", [("/image_raw", [0, 1, 2, 3, 4, 7]), ("image_raw/compressed", [0, 2, 4, 6])])
def test_the_page_holds_the_images_of_the_frames(topic, numbers, bag, capsys):
    page = report(bag, topic).read_text(encoding="utf-8")
    output = capsys.readouterr().out
    assert ("not shown: image_encoding 2" in output) == (5 not in numbers and 1 in numbers)
    assert f"{8 if 1 in numbers else 4} have the stamp of keypoints" in output
    images = held(page, "images")
    assert np.allclose(images["time"], np.array(numbers) / 30, atol=1e-3)
    decoded = [cv2.imdecode(np.frombuffer(base64.b64decode(image), np.uint8), 1) for image in images["jpeg"]]
    assert np.abs([image.mean() - grey(number) for image, number in zip(decoded, numbers)]).max() < 3


@pytest.mark.parametrize(
    "options, text",
    [
        (["--image-topic", "image_raw"], "--image-topic shows the images in the report; add --report HTML"),
        (["--image-topic", "other", "--report", "page.html"], "walk has no topic 'other'; its topics are"),
        (["--image-topic", "keypoints", "--report", "page.html"], "holds sensor_msgs/msg/PointCloud2; expected"),
    ],
)
def test_what_cannot_be_used_is_one_line_and_writes_nothing(options, text, bag, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main([str(bag), "--output", "out", *options]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert text in line and not list(tmp_path.iterdir())


def colour_at(page, x, y):
    """The grey value of the screen at a point of the image, px."""
    screen = cv2.imdecode(np.frombuffer(page.page.locator("#image").screenshot(), np.uint8), 1)
    column, row = page.value(
        "(() => { const l = document.getElementById('image')._fullLayout; return "
        f"[l.xaxis.l2p({x}) + l.xaxis._offset, l.yaxis.l2p({y}) + l.yaxis._offset]; }})()"
    )
    return float(screen[round(row), round(column)].mean())


def test_the_browser_draws_the_image_of_the_frame_in_its_place(bag):
    path = report(bag, "/image_raw")
    width, height = WEBCAM.size
    with browser() as running:
        page = Page(running, path)
        page.page.select_option("#view", "image")
        for frame, shown, note in ((3, 3, ""), (5, 4, "The image is 0.03 s older than the skeleton."), (7, 7, "")):
            page.page.fill("#slider", str(frame))
            page.reach(f"document.body.dataset.frame === '{frame}'", f"frame {frame}")
            assert page.page.inner_text("#photo-time") == note
            corners = [colour_at(page, x, y) for x in (15, width - 15) for y in (15, height - 15)]
            assert np.allclose(corners, 0.8 * grey(shown) + 0.2 * 252, atol=3)
            assert min(colour_at(page, width + 15, 15), colour_at(page, 15, height + 15)) > 230
        page.page.uncheck("#photo")
        assert colour_at(page, 15, 15) > 240
        assert page.errors == [] and page.requests == [f"file://{path}"]
        page.page.close()
