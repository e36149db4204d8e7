"""The output video: it plays in browsers, and its pictures say time, state and doubt."""

import builtins
import os

import numpy as np
import pytest

from lassokin_ros.common.atomic_files import AtomicFiles
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.doubt.doubt import Doubt
from lassokin_ros.video.body_view import BACKGROUND, COLOURS, BodyView
from lassokin_ros.video.output_video import OutputVideo, VideoError, open_encoder
from lassokin_ros.video.sources import Image, open_source, stamp_of

cv2 = pytest.importorskip("cv2")
SIZE = 96, 64


def write(path, count=5, fps=30.0):
    encoder = open_encoder(path, SIZE, fps)
    for number in range(count):
        encoder.write(np.full((SIZE[1], SIZE[0], 3), 40 * number % 256, np.uint8))
    encoder.close()
    return encoder


@pytest.mark.parametrize("suffix", [".mp4", ".avi"])
def test_the_codec_is_h264(suffix, tmp_path):
    av = pytest.importorskip("av", reason="PyAV encodes H.264")
    path = tmp_path / f"out{suffix}"
    assert write(path).browsers_play
    with av.open(str(path)) as container:
        (stream,) = container.streams.video
        assert stream.codec_context.name == "h264" and stream.codec_context.pix_fmt == "yuv420p"
    if suffix == ".mp4":
        data = path.read_bytes()
        assert data.index(b"moov") < data.index(b"mdat")  # a browser can start before it has the whole file


@pytest.mark.parametrize("fps", [25.0, 30000 / 1001, 60.0])
def test_the_frame_rate_is_kept(fps, tmp_path):
    pytest.importorskip("av", reason="PyAV encodes H.264")
    write(tmp_path / "out.mp4", 8, fps)
    source = open_source(str(tmp_path / "out.mp4"))
    assert np.isclose(source.fps, fps, rtol=1e-4) and source.count == 8
    assert np.allclose([image.seconds for image in source.images], np.arange(8) / fps, atol=2e-3)


def test_without_pyav_opencv_writes_the_video(tmp_path, monkeypatch):
    plain = builtins.__import__

    def without_av(name, *arguments):
        if name == "av":
            raise ImportError(name)
        return plain(name, *arguments)

    monkeypatch.setattr(builtins, "__import__", without_av)
    encoder = write(tmp_path / "out.mp4")
    assert open_source(str(tmp_path / "out.mp4")).count == 5 and isinstance(encoder.browsers_play, bool)


def test_a_name_that_crashes_the_encoders_is_refused(tmp_path):
    with pytest.raises(VideoError, match="is not UTF-8; choose another name"):
        OutputVideo(tmp_path / os.fsdecode(b"w\xe4lk.mp4"), {"": SIZE}, 30.0, AtomicFiles(False, OSError), np.eye(3))


class Frame:
    """What BodyView reads of a FrameResult: a standing person."""

    accepted, images = True, ()

    def __init__(self, depth=3.0, observed=True, deviation=0.02, person=""):
        self.person, self.doubt = person, Doubt()
        self.skeleton = skeleton = Skeleton.load("anthropometric", 1.75)
        pose = type("Pose", (), {"positions": skeleton.rest_positions * (1, -1, -1) + (0, 0, depth)})
        self.estimate = type("Estimate", (), {"pose": pose})
        self.observed = np.full(skeleton.joint_count, observed)
        self.uncertainty = type("Uncertainty", (), {"deviation": np.full(skeleton.joint_count, deviation)})


def coloured(image, colour):
    return np.argwhere(np.abs(image.astype(int) - colour).max(axis=-1) < 12)


def view():
    return BodyView(cv2, 360, np.eye(3))


def test_the_body_stands_on_the_floor():
    image = view().draw(0.0, Frame())
    left, right = coloured(image, COLOURS["left"]), coloured(image, COLOURS["right"])
    assert len(left) > 300 and len(right) > 300
    lowest = max(left[:, 0].max(), right[:, 0].max())
    assert 0.8 * 360 < lowest < 0.95 * 360 and min(left[:, 0].min(), right[:, 0].min()) > 0.1 * 360


def test_limbs_without_keypoints_are_faint_and_uncertain_ones_wide():
    assert not len(coloured(view().draw(0.0, Frame(observed=False)), COLOURS["left"]))
    drawn = [(view().draw(0.0, Frame(deviation=d)) != BACKGROUND).any(axis=-1).sum() for d in (0.01, 0.1)]
    assert drawn[1] > 1.2 * drawn[0]


def test_the_path_stays_on_the_floor_while_the_view_follows():
    body = view()
    first = body.draw(0.0, Frame(depth=3.0))
    later = [body.draw(step / 10, Frame(depth=3.0 + step / 20)) for step in range(1, 11)][-1]
    assert abs(len(coloured(later, COLOURS["left"])) - len(coloured(first, COLOURS["left"]))) < 60
    trail = (150, 140, 130)
    assert len(coloured(later, trail)) > 20 > len(coloured(first, trail))


def test_the_path_is_that_of_one_person():
    body = view()
    body.draw(0.0, Frame(depth=3.0, person="p1"))
    fresh = view().draw(0.1, Frame(depth=4.0, person="p2"))
    assert (body.draw(0.1, Frame(depth=4.0, person="p2")) == fresh).all()


def test_the_same_person_is_shown_while_there(tmp_path, monkeypatch):
    shown = []
    output = OutputVideo(tmp_path / "out.mp4", {"": SIZE}, 10.0, AtomicFiles(False, OSError), np.eye(3))
    monkeypatch.setattr(BodyView, "draw", lambda self, seconds, frame: shown.append(frame) or self.picture)
    monkeypatch.setattr(BodyView, "picture", np.zeros((SIZE[1], SIZE[1], 3), np.uint8), raising=False)
    image = np.zeros((SIZE[1], SIZE[0], 3), np.uint8)
    for number, people in enumerate(["p1 p2", "p2", "p1 p2", "", "p1 p2", "p1"]):
        output.add_images({"": Image(number / 10, image)})
        output.add(stamp_of(number / 10), [Frame(person=person) for person in people.split()])
    output._encoder.close()
    assert [frame and frame.person for frame in shown] == ["p1", "p2", "p2", None, "p2", "p1"]


def test_an_image_is_held_until_the_time_of_the_next_one(tmp_path, monkeypatch):
    written = []
    output = OutputVideo(tmp_path / "out.mp4", {"": SIZE}, 10.0, AtomicFiles(False, OSError), np.eye(3))
    monkeypatch.setattr(output._encoder, "write", lambda picture: written.append(int(picture[20, 20, 0])))
    for number, seconds in enumerate([0.0, 0.1, 0.14, 0.2, 0.8, 0.9]):
        output.add_images({"": Image(seconds, np.full((SIZE[1], SIZE[0], 3), 10 * number, np.uint8))})
        output.add(stamp_of(seconds), [])
    output._write_until(np.inf)
    output._encoder.close()
    assert written == [0, 10, 30, 30, 30, 30, 30, 30, 40, 50]


def test_nobody_is_an_empty_view():
    assert (view().draw(0.0, None) == BACKGROUND).all()
