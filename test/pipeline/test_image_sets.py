"""Which images of several cameras are processed together, and which wait."""

from dataclasses import replace

import numpy as np
import pytest

from lassokin_ros.core.observation import CameraPose
from lassokin_ros.pipeline.camera.lens import Lens
from lassokin_ros.pipeline.image_sets import MOST_FAILED_WAITS, MOST_HELD, ImageSets
from lassokin_ros.pipeline.seen import Image

MS = 1_000_000
NOTHING = Image((), 0, "", Lens(np.eye(3)))


class Arrivals:
    def __init__(self, wait_s=0.03):
        self.sets = ImageSets(wait_s)

    def add(self, name, stamp_ms, arrival_ms):
        image = replace(NOTHING, stamp_ns=round(stamp_ms * MS), camera=CameraPose(name))
        return told(self.sets.add(name, image, round(arrival_ms * MS)))

    def due(self, now_ms):
        return told(self.sets.due(round(now_ms * MS)))


def told(sets):
    return [[f"{image.camera.name}{image.stamp_ns / MS:g}" for image in images] for images in sets]


@pytest.fixture
def known():
    """Two cameras that take images together every 30 ms, up to 60 ms."""
    arrivals = Arrivals()
    for stamp in (0, 30, 60):
        arrivals.add("a", stamp, stamp + 10)
        arrivals.add("b", stamp, stamp + 12)
    return arrivals


def test_images_of_one_instant_are_one_set(known):
    assert known.add("a", 90, 100) == [] and known.sets.due_at_ns == 130 * MS
    assert known.add("b", 92, 104) == [["a90", "b92"]] and known.sets.due_at_ns is None
    assert known.add("b", 120, 130) == [] and known.add("a", 124, 131) == [["b120", "a124"]]


def test_the_first_images_and_those_of_free_cameras_do_not_wait():
    arrivals = Arrivals()
    assert arrivals.add("a", 0, 10) == [["a0"]]
    for stamp in range(15, 300, 30):
        assert arrivals.add("b", stamp, stamp + 10) == [[f"b{stamp}"]]
        assert arrivals.add("a", stamp + 15, stamp + 25) == [[f"a{stamp + 15}"]]


def test_an_image_waits_no_longer_than_camera_wait(known):
    assert known.add("a", 90, 100) == []
    assert known.due(129) == [] and known.due(130) == [["a90"]]
    assert known.add("b", 90, 135) == [["b90"]]  # late: the tracker uses it for its track only


def test_an_image_waits_no_longer_if_the_clock_is_set_back(known):
    assert known.add("a", 90, 100) == []
    known.sets.set_clock_back(60_000 * MS)
    assert known.sets.due_at_ns == -59_870 * MS and known.due(-59_875) == []
    assert known.due(-59_870) == [["a90"]]


def test_a_camera_that_is_always_late_is_not_waited_for_until_it_is_in_time(known):
    for count in range(MOST_FAILED_WAITS + 3):
        stamp = 90 + 30 * count
        at_once = known.add("a", stamp, stamp + 10)
        known.due(stamp + 40)
        known.add("b", stamp, stamp + 45)
        assert bool(at_once) == (count >= MOST_FAILED_WAITS)
    for count in range(3):
        stamp = 90 + 30 * (MOST_FAILED_WAITS + 3 + count)
        waited = known.add("a", stamp, stamp + 10) == []
        known.add("b", stamp, stamp + 12)
    assert waited


def test_a_silent_camera_is_not_waited_for(known):
    waits = [known.add("a", stamp, stamp + 10) == [] and bool(known.due(stamp + 40)) for stamp in range(90, 300, 30)]
    assert waits[:2] == [True, True] and not any(waits[3:])


def test_memory_is_limited_and_nothing_is_lost():
    arrivals = Arrivals(wait_s=1.0)
    for stamp in (0, 30, 60):
        arrivals.add("a", stamp, 0)
        arrivals.add("b", stamp, 0)
    found = [one for stamp in range(62, 62 + 3 * MOST_HELD, 3) for one in arrivals.add("a", stamp, 0)]
    assert len(arrivals.sets._held) < MOST_HELD
    found += told(arrivals.sets.flush())
    assert sorted(float(name[1:]) for names in found for name in names) == list(range(62, 62 + 3 * MOST_HELD, 3))


def test_without_a_wait_every_image_is_processed_at_once():
    arrivals = Arrivals(wait_s=0.0)
    for stamp in range(0, 300, 30):
        assert arrivals.add("a", stamp, stamp) == [[f"a{stamp}"]] and arrivals.add("b", stamp, stamp + 1) == [
            [f"b{stamp}"]
        ]
