"""The targets of the guided fuzzing: seeds are read, damaged ones are read or refused, inputs that found faults too."""

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags makes messages and recordings")

from targets import TARGETS  # noqa: E402


@pytest.mark.parametrize("name", TARGETS)
def test_seeds_are_read_and_damaged_ones_read_or_refused(name):
    target, random = TARGETS[name], np.random.default_rng(0)
    for seed in target.seeds():
        target.read(seed)
        for _ in range(5):
            data = bytearray(seed)
            for place in random.integers(len(data), size=3):
                data[place] = random.integers(256)
            target.run(bytes(data))
        target.run(seed[: len(seed) // 2])
        target.run(b"")
