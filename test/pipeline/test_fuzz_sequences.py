"""Sequences of messages that are wrong as a whole: repeats, stamps in another unit, other cameras, placeholders.

During the sequence nothing is raised, and every accepted frame is certified. After it the person is tracked again.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("rosbags", reason="rosbags makes the messages")

from faults.courses import BACKEND, FRAMES, START_NS, people  # noqa: E402
from faults.damage import STEP_NS, one_coordinate  # noqa: E402
from faults.fuzzing import count, fuzz  # noqa: E402
from messages import FRAME, HEIGHT, WIDTH, camera_info, cloud, with_depths  # noqa: E402
from sequences import TRACKED_WITHIN, aligned_error  # noqa: E402

from lassokin_ros.core.config import TrackerConfig  # noqa: E402
from lassokin_ros.pipeline.camera.camera_selection import STEADY  # noqa: E402
from lassokin_ros.pipeline.outputs.diagnostics import Diagnostics  # noqa: E402
from lassokin_ros.pipeline.session import Session  # noqa: E402
from lassokin_ros.pipeline.settings import NodeSettings  # noqa: E402

TRUTH, PIXELS = people("coco17")[0]
BEFORE, AFTER = 6, 6
SIZE = np.array([WIDTH, HEIGHT])
UNITS = {
    "nanosec in us": lambda t: t // 10**9 * 10**9 + t % 10**9 // 1000,
    "nanosec in ms": lambda t: t // 10**9 * 10**9 + t % 10**9 // 10**6,
    "us": lambda t: t // 1000,
    "ms": lambda t: t // 10**6,
    "100 ns": lambda t: t // 100,
    "number of the frame": lambda t: (t - START_NS) // STEP_NS,
}


def index_at(number):
    """The frame of a message: the motion forward and back."""
    return FRAMES - 1 - abs(number % (2 * FRAMES - 2) - (FRAMES - 1))


def good(number, stamp_ns):
    return cloud(BACKEND, stamp_ns, PIXELS[index_at(number)] + 0.001 * number)  # no message equals another


class Sequence:
    """The wrong messages of one kind; random: a generator."""

    def __init__(self, session, random):
        self.session, self.random = session, random
        self.unit = UNITS[sorted(UNITS)[random.integers(len(UNITS))]]
        self.focal, self.other = float(random.uniform(250, 3000)), [FRAME, "other", "/" + FRAME][random.integers(3)]
        self.depth = random.uniform(2, 5, 17)
        self.coordinate = random.integers(2**32)

    def repeats(self, number, stamp_ns):
        return cloud(BACKEND, stamp_ns, PIXELS[index_at(BEFORE)])

    def stamps(self, number, stamp_ns):
        return good(number, self.unit(stamp_ns))

    def cameras(self, number, stamp_ns):
        if number % 2:
            self.session.set_camera(camera_info(BACKEND, self.focal, self.other))
        else:
            self.session.set_camera(camera_info(BACKEND))
        return good(number, stamp_ns)

    def coordinates(self, number, stamp_ns):
        xy = PIXELS[index_at(number)].copy()
        one_coordinate(xy, np.random.default_rng(self.coordinate))
        return cloud(BACKEND, stamp_ns, xy)

    def units(self, number, stamp_ns):
        """Positions as fractions or percent of the image, none in every other image, or all at one place."""
        xy, kind = PIXELS[index_at(number)], self.coordinate % 4
        if kind == 1 and number % 2:
            return cloud(BACKEND, stamp_ns, xy[:0])
        return cloud(BACKEND, stamp_ns, (xy / SIZE, xy, np.full_like(xy, 87.0), 100 * xy / SIZE)[kind])

    def depths(self, number, stamp_ns):
        return with_depths(BACKEND, good(number, stamp_ns), self.depth)

    def scores(self, number, stamp_ns):
        scores = self.random.normal(1.5, 1.0, 17) * [1.0, 100.0][self.coordinate % 2]
        return cloud(BACKEND, stamp_ns, PIXELS[index_at(number)], scores)


KINDS = ("repeats", "stamps", "cameras", "coordinates", "units", "depths", "scores")
PIPELINE = Session(TrackerConfig(height=1.75, depth_prior=False), NodeSettings())


def send(diagnostics, number, message):
    arrival_ns = START_NS + number * STEP_NS
    frames = PIPELINE.frames(message, arrival_ns)
    diagnostics.count_message(frames, arrival_ns, number * STEP_NS * 1e-9, 0.001)
    for frame in frames:
        assert frame.rejection or frame.estimate.increment.solution.certified
        assert not frame.accepted or (np.abs(frame.velocities) < 1e4).all()
    if number % 15 == 14:
        assert diagnostics.line(number * STEP_NS * 1e-9).message.isprintable()
    return frames


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("kind", KINDS)
def test_the_person_is_tracked_after_a_wrong_sequence(kind):
    @fuzz(0.01)
    @given(st.integers(0, 2**32 - 1), st.integers(1, 40))
    def case(seed, length):
        random = np.random.default_rng(seed)
        PIPELINE.reset()
        PIPELINE.set_camera(camera_info(BACKEND))
        diagnostics = Diagnostics(PIPELINE, "tracker", 0.0)
        sequence = Sequence(PIPELINE, random)
        for number in range(BEFORE):
            send(diagnostics, number, good(number, START_NS + number * STEP_NS))
        accepted = 0
        for number in range(BEFORE, BEFORE + length):
            message = getattr(sequence, kind)(number, START_NS + number * STEP_NS)
            accepted += send(diagnostics, number, message)[0].accepted
        for _ in range(STEADY + 2):  # until the other camera is forgotten
            PIPELINE.set_camera(camera_info(BACKEND))
        for number in range(BEFORE + length, BEFORE + length + AFTER):
            (frame,) = send(diagnostics, number, good(number, START_NS + number * STEP_NS))
        assert frame.accepted, frame.detail
        assert aligned_error(frame.estimate, TRUTH[index_at(number)]) < TRACKED_WITHIN
        count(
            f"sequence of {kind}", "all accepted" if accepted == length else "some refused" if accepted else "refused"
        )

    case()
