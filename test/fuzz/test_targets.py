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


HUGE, LONG = b"1e308", b"9" * 400
FOUND = {
    "control characters in the text of a refusal": ("message Image", b"16UC1", b"\n\x1b\x00\x00\x06"),
    "an overflow in SMPL's product": ("file smpl arrays", np.float64(1.0).tobytes(), np.float64(1e308).tobytes()),
    "an overflow in a sum of offsets": ("file bvh", b"0.0", HUGE),
    "an overflow in a sum of origins": ("file urdf", b"<origin xyz='", b"<origin xyz='1e308 1e308 1e308' was='"),
    "control characters in a joint's name": ("file bvh", b"CHANNELS", b"\x1b[2J"),
    "a scaled camera matrix that overflows": ("file calibration", b"600", HUGE),
    "a whole number without a float": ("file calibration", b"600", LONG),
    "a parameter without a float": ("file parameters", b"1.75", LONG),
}
"""Fault -> (target, bytes of a seed, bytes in their place)."""


@pytest.mark.parametrize("fault", FOUND)
def test_faults_that_were_found_stay_refusals(fault):
    name, old, new = FOUND[fault]
    seeds = [seed for seed in TARGETS[name].seeds() if old in seed]
    assert seeds and not any(TARGETS[name].run(seed.replace(old, new)) for seed in seeds)
