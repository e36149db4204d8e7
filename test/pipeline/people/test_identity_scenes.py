"""A followed person is never exchanged for a bystander: scenes of two people who cross, leave and return."""

from itertools import groupby

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags makes the messages")

from messages import camera_info, crowd, rosbags_backend  # noqa: E402
from two_people import RATE, numbers_of, scene  # noqa: E402

from lassokin_ros.core.config import TrackerConfig  # noqa: E402
from lassokin_ros.pipeline.session import Session  # noqa: E402
from lassokin_ros.pipeline.settings import NodeSettings  # noqa: E402

BACKEND = rosbags_backend()
START_NS = 5_000_000_000
SEEDS = (0, 3, 6, 9, 12, 17)


def follow(seed, person_ids, **settings):
    """Play a scene; return per frame (label or None, whose detection, guessed), and whether the person was seen."""
    random = np.random.default_rng(1000 + seed)
    there = scene(seed)
    numbers = numbers_of(there.seen, random)
    session = Session(TrackerConfig(height=1.75), NodeSettings(person_ids=person_ids, **settings))
    session.set_camera(camera_info(BACKEND))
    results = []
    for i in range(there.seen.shape[1]):
        shown = [int(who) for who in random.permutation(2) if there.seen[who, i]]
        confidence = {0: 0.9 if i < 3 else 0.6, 1: 0.6 if i < 3 else 0.9}
        people = [(there.pixels[who, i], np.full(17, confidence[who])) for who in shown]
        stamp_ns = START_NS + round(i * 1e9 / RATE)
        message = crowd(BACKEND, stamp_ns, people, [numbers[who, i] for who in shown])
        frames = [frame for frame in session.frames(message, stamp_ns) if frame.accepted]
        if not frames:
            results.append((None, None, False))
            continue
        (frame,) = frames
        apart = {who: np.nanmedian(np.abs(there.pixels[who, i] - frame.detected)) for who in shown}
        results.append((frame.label, min(shown, key=apart.get), frame.guessed))
    return results, there.seen[0]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_bystander_is_never_followed_silently(seed):
    """By default another person is followed under another id only, and only after the first one was forgotten."""
    results, _ = follow(seed, ("message", "node")[seed // 5 % 2])
    assert not [i for i, (label, who, _) in enumerate(results) if who == 1 and label == "p1"]
    first = next((i for i, (label, _, _) in enumerate(results) if label not in (None, "p1")), None)
    if first is not None:
        absent_s = (first - max(i for i in range(first) if results[i][0] == "p1")) / RATE
        assert absent_s > NodeSettings().forget_after


@pytest.mark.parametrize("person_ids", ["message", "node"])
@pytest.mark.parametrize("seed", SEEDS)
def test_nobody_else_is_followed_while_a_person_is_locked(seed, person_ids):
    results, seen = follow(seed, person_ids, lock=True)
    assert {who for _, who, _ in results} <= {0, None}
    assert {label for label, _, _ in results} <= {"p1", None}
    found = [label == "p1" for (label, _, _), visible in zip(results, seen) if visible]
    absent = max(len(list(group)) for visible, group in groupby([*seen, False]) if not visible) / RATE
    if absent < 1.0:
        assert np.mean(found) > 0.95
