"""The depth network: its input is the same for all rates and layouts, alone and in a batch; its file has provenance."""

from dataclasses import replace
from importlib import resources

import numpy as np
import pytest

from lassokin_ros.core.body.landmarks import Layout, built_in_layouts
from lassokin_ros.core.body.proportions import other_side
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.network.depth_network import (
    DEPTHS,
    LEAST_SEEN,
    NAMES,
    TIMES,
    History,
    Scene,
    canonical_index,
    features,
    interpreted,
    lengths_of,
    load_weights,
    shipped_network,
)

SKELETON = Skeleton.load("anthropometric", 1.75)


def history(rate, seconds=1.2):
    """Points with constant velocity, sampled at a rate in Hz; the newest sample has the same time for each rate."""
    filled, random = History(), np.random.default_rng(0)
    place, speed = random.normal(size=(len(NAMES), 2)), random.normal(size=(len(NAMES), 2))
    for stamp in np.arange(round(seconds * rate), -1, -1) / rate:
        filled.add(10.0 - stamp, place - stamp * speed, np.ones(len(NAMES), bool))
    return filled.sampled(), place, speed


@pytest.mark.parametrize("rate", [2.0, 5.0, 10.0, 30.0, 240.0, 260.0, 490.0, 1000.0])
@pytest.mark.parametrize("seconds", [1.2, 6.0])
def test_the_past_is_sampled_at_the_same_times_for_each_rate(rate, seconds):
    (points, seen), place, speed = history(rate, seconds)
    assert seen[0].all() and seen.all(axis=1).sum() >= 5
    assert rate < 5 or seen.all()
    expected = place - TIMES[:, None, None] * speed
    assert np.allclose(points[seen], expected[seen])


@pytest.mark.parametrize("rate", [240.0, 249.0, 260.0, 490.0, 1000.0, 5000.0])
def test_the_frames_that_are_kept_always_cover_all_times(rate):
    """At 240 Hz, and at any other rate, the oldest time is known in each frame after the first 0.8 s."""
    filled, points, everything = History(), np.zeros((len(NAMES), 2)), np.ones(len(NAMES), bool)
    for frame in range(round(3.0 * rate)):
        points[0, 0] = frame / rate
        filled.add(100 + frame / rate, points, everything)
        if frame / rate > TIMES[-1] + 0.01 and frame % 7 == 0:
            past, seen = filled.sampled()
            assert seen.all() and np.allclose(past[:, 0, 0], frame / rate - TIMES, rtol=0, atol=1e-6)


def test_a_gap_in_the_past_is_unknown():
    filled = History()
    for stamp in (0.0, 0.9, 1.0):
        filled.add(stamp, np.zeros((len(NAMES), 2)), np.ones(len(NAMES), bool))
    _, seen = filled.sampled()
    assert seen[0].all() and seen[TIMES == 0.1].all() and not seen[TIMES == 0.4].any()


@pytest.mark.parametrize("name", built_in_layouts("anthropometric"))
def test_every_layout_has_enough_canonical_points(name):
    layout = Layout.load(name, SKELETON)
    index = canonical_index(layout, SKELETON)
    assert np.count_nonzero(index >= 0) >= max(LEAST_SEEN, 12)
    assert len(set(index[index >= 0])) == np.count_nonzero(index >= 0)
    found = {point: layout.names[landmark] for point, landmark in zip(NAMES, index) if landmark >= 0}
    assert {other_side(point): other_side(landmark) for point, landmark in found.items()} == found


def scene(count):
    random = np.random.default_rng(1)
    points = random.normal(size=(count, len(TIMES), len(NAMES), 2)) * 0.2
    seen = random.random((count, len(TIMES), len(NAMES))) < 0.8
    up, lengths = np.tile([0.0, -1.0, 0.0], (count, 1)), np.tile(lengths_of(SKELETON), (count, 1))
    return Scene(points, seen, up, np.ones(count, bool), lengths, np.zeros(count, bool))


def predicted(given):
    """The decoded outputs of the network for a scene, or for several."""
    return interpreted(shipped_network()(features(given)[0]))


def test_a_batch_gives_the_same_results_as_single_people():
    several = scene(3)
    places, whitening = predicted(several)
    for person in range(3):
        alone = Scene(*(value[person] for value in vars(several).values()))
        own_places, own_whitening = predicted(alone)
        assert np.allclose(own_places, places[person], atol=1e-4)
        assert np.allclose(own_whitening, whitening[person], rtol=1e-3, atol=1e-3)


def test_a_missing_point_has_no_influence():
    given = scene(1)
    moved = replace(given, points=np.where(given.seen[..., None], given.points, 99.0))
    assert np.array_equal(features(given)[0], features(moved)[0])


def test_the_file_is_small_and_names_its_sources():
    file = resources.files("lassokin_ros.core.network") / "depth_network.npz"
    with resources.as_file(file) as path:
        assert path.stat().st_size <= 2_000_000
        network, provenance = load_weights(path)
    assert network.weights[-1].shape == (4 * DEPTHS + DEPTHS * (DEPTHS - 1) // 2 + DEPTHS,)
    assert any("mocap.cs.cmu.edu" in licence for licence in provenance["licences"])
    assert provenance["held_out"] and not set(provenance["people"]) & set(provenance["held_out"])


def test_the_virtual_camera_looks_at_the_newest_points():
    points = np.tile(np.linspace(-0.1, 0.1, len(NAMES))[:, None], (len(TIMES), 1, 2))
    points[0] += [0.5, -0.3]
    known = np.ones(points.shape[:2], bool)
    scene = Scene(points, known, np.zeros(3), np.array(False), lengths_of(SKELETON), np.array(True))
    _, rotation = features(scene)
    sight = rotation @ np.append(points[0].mean(axis=0), 1.0)
    assert np.allclose(sight[:2] / sight[2], 0.0, atol=0.02)
