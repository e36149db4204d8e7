"""Videos that begin at different times, and the options and sentences about it."""

import re

import numpy as np
import pytest
from camera_rig import eye, pixels, truth_at
from messages import FOCAL, HEIGHT, WIDTH

from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import CameraError
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.detector.backend import Detected
from lassokin_ros.pipeline.camera.calibration_file import Calibration
from lassokin_ros.video.synchrony import checked_places, given_offsets, shifted, synchronised

EYES = [eye("a", 0), eye("b", 80)]
LENS = Calibration(
    np.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1.0]]), np.zeros(0), size=(WIDTH, HEIGHT)
)


def filmed(camera, begin, end, still=False, beside=False):
    """The people in a video that begins and ends at times of the motion, s; its own times begin at 0."""
    times, random = np.arange(begin, end, 1 / 30), np.random.default_rng(EYES.index(camera))
    found = []
    for seconds, marks in zip(times, truth_at(times, still=still).landmarks):
        people = [Detected(pixels(camera, 0.0, marks, random, 2.0), np.full(17, 0.9))]
        people += [Detected(0.5 * people[0].pixels + [900.0, 0.0], np.full(17, 0.9))] * beside
        found.append((seconds - begin, people))
    return found


@pytest.mark.parametrize(
    "begin, words, lost",
    [
        ((0, 1.5), r"'b' begins 1\.50. s \(\+- \d+ ms\) after the first video", 0),
        ((1, 0), r"'b' begins (1\.0|0\.99)\d* s .* before the first video", 30),
        ((0, 0), "'b' is synchronised with the first video, as the keypoints show to ", 0),
    ],
    ids=["later", "earlier", "together"],
)
def test_a_second_video_is_put_on_the_clock_of_the_first_one(begin, words, lost):
    """It loses what is before the first one."""
    images = [filmed(one, start, 6) for one, start in zip(EYES, begin)]
    (first, second), (said,) = synchronised(["a", "b"], images, None)
    assert re.match(words, said) and shifted(first, images[0]) == images[0]
    late = shifted(second, images[1])
    assert abs(len(images[1]) - len(late) - lost) < 2 and late[-1][1] is images[1][-1][1]
    assert abs(late[-1][0] - images[1][-1][0] - (begin[1] - begin[0])) < 0.01


@pytest.mark.parametrize("images", [[filmed(one, 0, 4, still=True) for one in EYES], [filmed(EYES[0], 0, 1), []]])
def test_an_offset_that_the_keypoints_do_not_show_is_not_determinable(images):
    (first, second), (words,) = synchronised(["a", "b"], images, None)
    assert "is not determinable" in words and "set --offsets" in words
    assert shifted(second, images[1]) == images[1]


def test_given_offsets_are_used_and_others_refused():
    (_, second), remarks = synchronised(["a", "b"], [[(0.0, [])], [(0.0, []), (3.0, [])]], given_offsets("0,-2", 2))
    assert not remarks and shifted(second, [(0.0, []), (3.0, [])]) == [(1.0, [])]
    assert given_offsets("1.5", 2) == [0.0, 1.5]
    for text in ("1,2", "a", "0,nan", "0,1,2", "0,9999"):
        with pytest.raises(CameraError, match="expected 2 numbers, s by which each video begins after the first one"):
            given_offsets(text, 2)


def test_the_places_are_checked_and_put_into_metres():
    skeleton = Skeleton.load("anthropometric", 1.75)
    layout = Layout.load("coco17", skeleton)
    rest = skeleton.rest_positions[layout.joints] + layout.offsets
    images = [filmed(one, 0, 3, beside=one is EYES[1]) for one in EYES]
    poses = [CameraPose(one.name, one.pose_at(0).rotation, 1000 * one.pose_at(0).translation) for one in EYES]
    right, words = checked_places(images, [LENS, LENS], poses, layout.names, rest, "map")
    assert np.allclose(right[1].translation, EYES[1].pose_at(0).translation)
    assert words == ["The places of the cameras are in mm, as the person's size shows, and are used so."]
    with pytest.raises(CameraError, match="up to [0-9]+ m apart; expected metres, at most 50 m"):
        checked_places([[], []], [LENS, LENS], poses, layout.names, rest, "")
    assert checked_places([[], []], [LENS, LENS], right, layout.names, rest, "")[1] == []
