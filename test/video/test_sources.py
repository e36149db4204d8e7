"""Videos made by the test: rotation metadata, variable frame rate, portrait, black bars; cameras, streams, folders."""

import os
import struct
import subprocess
import sys
import threading
import time
from fractions import Fraction
from functools import partial
from http.server import BaseHTTPRequestHandler, SimpleHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import pytest

from lassokin_ros.pipeline.camera.lens import Lens
from lassokin_ros.video import sources
from lassokin_ros.video.camera import content_size, from_fov
from lassokin_ros.video.sources import SourceError, natural_key, open_source

cv2 = pytest.importorskip("cv2")

SIZE, FPS, FRAMES = (160, 96), 25.0, 8
ONE = 1 << 16
W = 1 << 30


def record(file, *images, fps=FPS):
    """A video of images (BGR); of one image, FRAMES times."""
    fourcc = "MJPG" if file.suffix == ".avi" else "mp4v"
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*fourcc), fps, images[0].shape[1::-1])
    for image in images if len(images) > 1 else FRAMES * images:
        writer.write(image)
    writer.release()
    return file


def record_with_pyav(file, first=0, ratio=1):
    """A video by PyAV that begins with the time of image `first` at 25 Hz. ratio: width of a pixel by its height."""
    av = pytest.importorskip("av", reason="PyAV writes such a file")
    with av.open(str(file), "w") as container:
        stream = container.add_stream("mjpeg", rate=25)
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuvj420p"
        stream.codec_context.sample_aspect_ratio = Fraction(ratio)
        for number in range(FRAMES):
            frame = av.VideoFrame.from_ndarray(corner(), format="bgr24")
            frame.pts, frame.time_base = first + number, Fraction(1, 25)
            container.mux(stream.encode(frame.reformat(format="yuvj420p")))
        container.mux(stream.encode())
    return open_source(str(file))


def corner(size=SIZE):
    """A black image with a red upper left corner."""
    image = np.zeros((size[1], size[0], 3), np.uint8)
    image[:30, :40, 2] = 255
    return image


def write_matrix(file, matrix):
    """Set the transformation of an MP4's track (ISO 14496-12, tkhd), which gives the rotation."""
    data = bytearray(file.read_bytes())
    place = data.index(b"tkhd") + 44
    data[place : place + 36] = struct.pack(">9i", *matrix)
    file.write_bytes(data)


def write_durations(file, durations):
    """Set the durations of an MP4's images (ISO 14496-12, stts), in units of the track's own clock."""
    data = bytearray(file.read_bytes())
    place = data.index(b"stts") - 4
    assert data.index(b"mdat") < place  # the images keep their offsets
    table = b"".join(struct.pack(">2I", 1, duration) for duration in durations)
    box = struct.pack(">I4s2I", 16 + len(table), b"stts", 0, len(durations)) + table
    old = struct.unpack_from(">I", data, place)[0]
    for name in (b"moov", b"trak", b"mdia", b"minf", b"stbl"):
        parent = data.index(name) - 4
        struct.pack_into(">I", data, parent, struct.unpack_from(">I", data, parent)[0] + len(box) - old)
    data[place : place + old] = box
    data = data.replace(b"edts", b"free")  # otherwise the edit list ends the video at its old duration
    file.write_bytes(data)


def clock_of(file):
    """Units of the track's clock per second (mdhd)."""
    data = file.read_bytes()
    return struct.unpack_from(">I", data, data.index(b"mdhd") + 16)[0]


ROTATIONS = {
    0: ((ONE, 0, 0, 0, ONE, 0, 0, 0, W), SIZE, "upper left"),
    90: ((0, ONE, 0, -ONE, 0, 0, SIZE[1] * ONE, 0, W), SIZE[::-1], "upper right"),
    180: ((-ONE, 0, 0, 0, -ONE, 0, SIZE[0] * ONE, SIZE[1] * ONE, W), SIZE, "lower right"),
    270: ((0, -ONE, 0, ONE, 0, 0, 0, SIZE[0] * ONE, W), SIZE[::-1], "lower left"),
}


@pytest.mark.parametrize("degrees", ROTATIONS)
def test_images_are_turned_by_the_files_metadata(degrees, tmp_path):
    file = record(tmp_path / "turned.mp4", corner())
    matrix, size, where = ROTATIONS[degrees]
    write_matrix(file, matrix)
    source = open_source(str(file))
    images = list(source.images)
    assert source.size == size and len(images) == FRAMES
    for image in (images[0].rgb, images[-1].rgb):
        assert image.shape == (size[1], size[0], 3)
        y, x = np.argwhere(image[:, :, 0] > 128).mean(axis=0)
        assert ("upper" if y < size[1] / 2 else "lower") + (" left" if x < size[0] / 2 else " right") == where


def test_times_with_a_variable_frame_rate_are_those_of_the_container(tmp_path):
    file = record(tmp_path / "phone.mp4", corner())
    seconds = np.array([0.04, 0.04, 0.12, 0.04, 0.04, 0.5, 0.04, 0.04])
    write_durations(file, np.round(seconds * clock_of(file)).astype(int))
    times = [image.seconds for image in open_source(str(file)).images]
    assert np.allclose(times, np.concatenate([[0], np.cumsum(seconds)[:-1]]), atol=2e-3)


@pytest.mark.parametrize("fps", [25.0, 60.0, 1000 / 33])
def test_a_constant_frame_rate_gives_even_times(fps, tmp_path):
    source = open_source(str(record(tmp_path / "even.avi", corner(), fps=fps)))
    assert np.allclose([image.seconds for image in source.images], np.arange(FRAMES) / fps, atol=2e-3)
    assert np.isclose(source.fps, fps, rtol=1e-3) and source.count == FRAMES and not source.live


@pytest.mark.skipif(not hasattr(cv2, "CAP_PROP_PTS"), reason="this OpenCV does not tell when the images begin")
def test_a_file_whose_images_begin_late_counts_from_the_first_image(tmp_path):
    """As if its sound began 2 s before the images."""
    source = record_with_pyav(tmp_path / "late.mkv", first=50)
    seconds = [image.seconds for image in source.images]
    assert source.begin == pytest.approx(2.0, abs=0.04) and seconds[0] == 0 and len(seconds) == FRAMES
    assert source.seconds == pytest.approx(source.begin + FRAMES / 25, abs=0.1)


@pytest.mark.parametrize(
    "file, fps, slow_motion, rate, said",
    [
        ("fast.avi", None, 1.0, 30.0, "'fast.avi' has 600 images per second: 30 images per second are assumed"),
        ("fast.avi", 600.0, 1.0, 600.0, ""),
        ("raw.mjpeg", None, 1.0, 25.0, "'raw.mjpeg' has no times of its images: 25 images per second are assumed"),
        ("raw.mjpeg", 50.0, 1.0, 50.0, ""),
        ("even.avi", 50.0, 1.0, 50.0, ""),
        ("even.avi", None, 4.0, 100.0, ""),
        ("even.avi", 30.0, 8.0, 240.0, ""),
    ],
)
def test_times_that_no_camera_has_are_replaced_by_a_rate(file, fps, slow_motion, rate, said, tmp_path):
    path = tmp_path / file
    if file == "raw.mjpeg":  # images one after the other, without a container
        path.write_bytes(FRAMES * cv2.imencode(".jpg", corner())[1].tobytes())
    else:
        record(path, np.tile(corner(), (4, 4, 1)), fps=600.0 if file == "fast.avi" else FPS)
    source = open_source(str(path), fps, slow_motion)
    times = [image.seconds for image in source.images]
    assert np.allclose(times, np.arange(FRAMES) / rate, atol=1e-3) and source.fps == pytest.approx(rate)
    assert source.remark.startswith(said) and bool(source.remark) == bool(said)
    assert source.count in (0, FRAMES)


def test_ticks_are_not_the_rate_of_images(tmp_path):
    """WebM of browsers: a rate of 1000 Hz, and times 40 ms apart."""
    file = record(tmp_path / "even.avi", corner())
    capture = cv2.VideoCapture(str(file))

    class Ticks:
        def get(self, name):
            return 1000.0 if name == cv2.CAP_PROP_FPS else capture.get(name)

    assert sources._fault_of_times(cv2, Ticks(), file) == ""
    assert sources._rate_and_count(cv2, Ticks())[0] == 30.0


@pytest.mark.parametrize(
    "ratio, size", [(Fraction(4, 3), (213, 96)), (Fraction(8, 9), (160, 108)), (Fraction(1, 50), (160, 96))]
)
def test_pixels_that_are_not_square_are_made_so(ratio, size, tmp_path):
    source = record_with_pyav(tmp_path / "hdv.mkv", ratio=ratio)
    assert source.size == size and {image.rgb.shape for image in source.images} == {(size[1], size[0], 3)}


@pytest.mark.parametrize(
    "options, said",
    [((None, factor), "--slow-motion .*; expected a factor") for factor in (0.0, -2.0, float("nan"), 1e6)]
    + [((fps,), "expected a rate above 0 and up to 1000 Hz") for fps in (-5.0, 0.0, float("nan"), float("inf"), 1e6)],
)
def test_an_impossible_rate_is_refused(options, said, tmp_path):
    with pytest.raises(SourceError, match=said):
        open_source(str(tmp_path), *options)


def test_a_camera_has_its_own_times(tmp_path, monkeypatch):
    (tmp_path / "video0").touch()
    monkeypatch.setattr(sources, "DEVICES", tmp_path)
    live = sources.Source("camera 0", SIZE, SIZE, 30.0, 0, iter(()), live=True)
    monkeypatch.setattr(sources, "_webcam", lambda number, name: live)
    with pytest.raises(SourceError, match="camera 0 is live, .* expected no --fps"):
        open_source("0", 30.0)


def test_a_fisheye_has_its_field_of_view_between_the_sides():
    """A point at the right side is seen 59 degrees from the axis, one in the middle of the half 29.5."""
    camera = from_fov(118.0, (801, 601), fisheye=True)
    lens = Lens(camera.K, camera.D, camera.model)
    right = lens.normalise(np.array([[400.0 + 400.5, 300.0], [400.0 + 200.25, 300.0]]))
    assert np.allclose(np.degrees(np.arctan(right[:, 0])), [59.0, 29.5], atol=1e-6)


def test_a_folder_whose_name_is_a_number_is_no_webcam(tmp_path, monkeypatch):
    (tmp_path / "2024").mkdir()
    cv2.imwrite(str(tmp_path / "2024" / "0.png"), corner())
    monkeypatch.chdir(tmp_path)
    assert not open_source("2024").live
    monkeypatch.setattr(sources, "DEVICES", tmp_path)
    monkeypatch.setattr(sources, "_webcam", lambda number, name: (number, name))
    (tmp_path / "video2024").touch()
    assert open_source("2024") == (2024, "camera 2024") and open_source("5") == (5, "camera 5")


def test_names_that_crash_opencv_are_refused(tmp_path):
    folder = tmp_path / "images"
    folder.mkdir()
    strange = os.fsdecode(b"w\xe4lk.png")
    cv2.imwrite(str(folder / "a.png"), corner())
    (folder / "a.png").rename(folder / strange)
    for name in (folder, folder / strange):
        with pytest.raises(SourceError, match="is not UTF-8, which OpenCV needs; rename the file") as error:
            open_source(str(name))
        assert str(error.value).encode()
    with pytest.raises(SourceError, match="there is no file or folder"):
        open_source("x" * 300 + ".mp4")


def test_the_field_of_view_is_along_the_longer_side_without_black_bars(tmp_path):
    source = open_source(str(record(tmp_path / "portrait.mp4", corner((96, 160)))))
    assert source.size == source.content == (96, 160)
    K = from_fov(90.0, source.size, source.content).K
    assert np.allclose([K[0, 0], K[0, 2], K[1, 2]], [80, 47.5, 79.5])
    image = np.random.default_rng(0).integers(0, 255, (96, 160, 3), dtype=np.uint8)
    image[:, :53] = image[:, -53:] = 0
    source = open_source(str(record(tmp_path / "bars.mp4", image)))
    assert source.size == (160, 96) and abs(source.content[0] - 54) <= 4 and source.content[1] == 96
    K = from_fov(90.0, source.size, source.content).K
    assert np.allclose([K[0, 0], K[0, 2], K[1, 2]], [48, 79.5, 47.5])


@pytest.mark.parametrize("folder", [False, True])
@pytest.mark.parametrize("case, expected", [("spot", (160, 96)), ("fade", (54, 96)), ("stage", (160, 96))])
def test_bars_are_what_is_black_in_the_whole_file(tmp_path, folder, case, expected):
    images = np.random.default_rng(0).integers(60, 255, (20, 96, 160, 3), dtype=np.uint8)
    if case == "spot":  # the first image shows a lit part in the middle, as wide as high
        images[0, :24] = images[0, -24:] = 0
        images[0, :, :40] = images[0, :, -40:] = 0
    elif case == "stage":  # lit to both sides, and later everywhere
        images[:5, :24] = images[:5, -24:] = 0
    else:  # bars, and a first image that is black
        images[:, :, :53] = images[:, :, -53:] = 0
        images[0] = 0
    path = tmp_path / ("images" if folder else "video.mp4")
    if folder:
        path.mkdir()
        for number, image in enumerate(images):
            cv2.imwrite(str(path / f"{number}.png"), image)
    else:
        record(path, *images)
    source = open_source(str(path))
    assert np.abs(np.subtract(source.content, expected)).max() <= 4
    assert [int(image.seconds * FPS + 0.5) for image in source.images][:3] == [0, 1, 2] or folder


def test_dark_areas_are_no_bars():
    bright = np.full((96, 160, 3), 200, np.uint8)
    assert content_size(bright) == content_size(np.zeros_like(bright)) == (160, 96)
    bright[:, :60] = 0  # on one side only
    assert content_size(bright) == (160, 96)
    stage = np.zeros_like(bright)
    stage[30:-30, 50:-50] = 200  # lit in the middle
    assert content_size(stage) == (160, 96)
    wide = np.zeros((720, 1280, 3), np.uint8)
    wide[100:-100, 420:-420] = 90
    assert content_size(wide) == (1280, 720)


class Camera:
    """Replaces cv2.VideoCapture: a device that gives three images and disconnects."""

    def __init__(self, _):
        self.left = 3

    def isOpened(self):
        return True

    def read(self):
        self.left -= 1
        return self.left >= 0, np.zeros((4, 6, 3), np.uint8)

    def get(self, _):
        return 0.0

    def release(self):
        self.left = 0


def test_a_disconnected_camera_is_one_line(monkeypatch):
    monkeypatch.setattr(cv2, "VideoCapture", Camera)
    source = open_source("0")
    assert source.live and source.count == 0 and source.fps == 30.0
    assert [next(source.images).rgb.shape for _ in range(3)] == [(4, 6, 3)] * 3
    with pytest.raises(SourceError, match="^camera 0 gives no more images$"):
        next(source.images)


def test_numbers_in_names_are_in_natural_order(tmp_path):
    for number in range(12):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((8, 8, 3), 20 * number, np.uint8))
    (tmp_path / "._1.png").write_bytes(b"\0\5\26\7")  # macOS writes such files on other file systems
    shown = [int(image.rgb[0, 0, 0]) // 20 for image in open_source(str(tmp_path)).images]
    assert shown == list(range(12))
    names = ["b2", "B10", "a", "frame_9_2", "frame_10_1", "09", "9", "10", ""]
    assert sorted(names, key=natural_key) == ["", "09", "9", "10", "a", "b2", "B10", "frame_9_2", "frame_10_1"]


def test_a_device_is_opened_by_its_number(tmp_path, monkeypatch):
    opened = []

    class Device(Camera):
        def __init__(self, number):
            opened.append(number)
            super().__init__(number)

    monkeypatch.setattr(cv2, "VideoCapture", Device)
    monkeypatch.setattr(sources, "DEVICES", tmp_path)
    (tmp_path / "v4l" / "by-id").mkdir(parents=True)
    (tmp_path / "video7").touch()
    link = tmp_path / "v4l" / "by-id" / "usb-webcam-index0"
    link.symlink_to("../../video7")
    for name in (tmp_path / "video7", link):
        source = open_source(str(name))
        assert source.live and source.name == str(name) and len([next(source.images) for _ in range(3)]) == 3
    assert opened == [7, 7]
    for name in (tmp_path / "video8", tmp_path / "v4l"):
        with pytest.raises(SourceError, match=f"is no camera; those of this machine: {tmp_path}/video7$"):
            open_source(str(name))


@pytest.fixture
def serve():
    """Serve with a handler; the address of the server."""
    servers = []

    def start(handler):
        server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        servers.append(server)
        return f"http://127.0.0.1:{server.server_port}"

    yield start
    for server in servers:
        server.shutdown()
        server.server_close()


class Silent(SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass


class MotionJpeg(BaseHTTPRequestHandler):
    """What phones and network cameras send: 40 JPEG images at 100 Hz, each with its number as grey value."""

    def do_GET(self):  # noqa: N802
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
        self.end_headers()
        for number in range(40):
            jpeg = cv2.imencode(".jpg", np.full((96, 160, 3), 6 * number, np.uint8))[1].tobytes()
            head = b"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % len(jpeg)
            self.wfile.write(head + jpeg + b"\r\n")
            time.sleep(0.01)

    def log_message(self, *_):
        pass


def test_a_file_on_a_server_is_a_file(tmp_path, serve):
    record(tmp_path / "walk.mp4", corner())
    source = open_source(f"{serve(partial(Silent, directory=str(tmp_path)))}/walk.mp4")
    assert not source.live and source.count == FRAMES
    assert np.allclose([image.seconds for image in source.images], np.arange(FRAMES) / FPS, atol=2e-3)


def test_a_stream_gives_the_newest_image_and_its_end_is_one_line(serve):
    address = serve(MotionJpeg)
    source = open_source(address.replace("//", "//user:secret@"))
    assert source.live and source.name == address and source.size == (160, 96)
    stamps, greys = [], []
    with pytest.raises(SourceError, match="gives no more images$"):
        for image in source.images:
            stamps.append(image.seconds)
            greys.append(int(image.rgb[0, 0, 0]))
            time.sleep(0.05)  # slower than the stream: images in between are left out
    assert stamps == sorted(stamps) and greys == sorted(greys) and len(greys) < 30


@pytest.mark.parametrize("last", ["", "images.close()"])
def test_the_thread_of_a_stream_ends_before_the_interpreter(last):
    """A call of OpenCV that returns while the interpreter ends would abort the process."""
    script = f"""
import numpy as np
from time import sleep
from types import SimpleNamespace
from lassokin_ros.video.sources import _newest_images
def read():
    sleep(0.05)
    return True, np.zeros((4, 4, 3), np.uint8)
capture = SimpleNamespace(read=read, release=lambda: print("released", flush=True))
cv2 = SimpleNamespace(cvtColor=lambda image, code: image, COLOR_BGR2RGB=0)
images = _newest_images(cv2, capture, "stream")
next(images)
{last}
print("end", flush=True)
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=True)
    assert sorted(done.stdout.split()) == ["end", "released"] and not done.stderr


def test_an_address_without_a_camera_is_one_line():
    with pytest.raises(SourceError, match="^'rtsp://127.0.0.1:9/cam' gives no images: check the address"):
        open_source("rtsp://admin:secret@127.0.0.1:9/cam")
