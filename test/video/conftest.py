"""Images and a video without anybody, and the detector that `track` uses."""

import numpy as np
import pytest
from scripted import Scripted

FRAMES = 60
"""Images of `long_video`, at 15 Hz."""


@pytest.fixture(autouse=True)
def use(monkeypatch):
    """Set what is found in the images by their times, instead of one who stands, and return the detector."""
    track_module = pytest.importorskip("lassokin_ros.video.track")

    def use(*given):
        detector = Scripted(*given)
        monkeypatch.setattr(track_module, "make_detector", lambda name: detector)
        return detector

    use()
    return use


@pytest.fixture
def images(tmp_path):
    """A folder of six images."""
    cv2 = pytest.importorskip("cv2")
    folder = tmp_path / "images"
    folder.mkdir()
    for number in range(6):
        cv2.imwrite(str(folder / f"{number:03}.png"), np.full((240, 320, 3), 40 * number, np.uint8))
    return folder


@pytest.fixture
def long_video(tmp_path):
    """A video of 4 s."""
    cv2 = pytest.importorskip("cv2")
    file = tmp_path / "walk.avi"
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"MJPG"), 15.0, (320, 240))
    for number in range(FRAMES):
        writer.write(np.full((240, 320, 3), number, np.uint8))
    writer.release()
    return file
