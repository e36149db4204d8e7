"""Gestures of synthetic hands: held ones are said, others are not; the floor where a hand points."""

import numpy as np
import pytest
from some_hands import POSTURES, SomeHand, bends, posture

from lassokin_ros.gestures import (
    GESTURES,
    HELD_S,
    GestureWatch,
    finger_bends,
    gesture_probabilities,
    hand_points,
    on_floor,
)
from msg_adapters.output_messages.hand_cloud import POINT

HZ, NOISE_M, OFFSET_M = 30, 0.006, 0.004


def sequence(seed, postures=40):
    """Points (f, 21, 3) m with a tracker's errors, the name of the posture in each frame, s for which it is held."""
    random = np.random.default_rng(seed)
    hand = SomeHand(("left", "right")[seed % 2], random)
    frames, names, held, last = [], [], [], bends("relaxed", random)
    for name in random.choice(list(POSTURES), postures):
        now = bends(name, random)
        for share in np.linspace(0, 1, round(HZ * random.uniform(0.25, 0.6))):
            smooth = share**2 * (3 - 2 * share)
            frames.append(hand.points(*(a + smooth * (b - a) for a, b in zip(last, now))))
            names.append("")
            held.append(0.0)
        for i in range(round(HZ * random.uniform(0.6, 1.2))):
            frames.append(hand.points(*now))
            names.append(str(name))
            held.append(i / HZ)
        last = now
    error, errors = random.normal(size=(21, 3)), []
    for _ in frames:
        error = 0.9 * error + np.sqrt(1 - 0.9**2) * random.normal(size=(21, 3))
        errors.append(error)
    lasting = random.normal(size=(21, 3)) * OFFSET_M / np.sqrt(3)
    return np.array(frames) + NOISE_M / np.sqrt(3) * np.array(errors) + lasting, names, np.array(held)


@pytest.mark.parametrize("name", POSTURES)
@pytest.mark.parametrize("side", ["left", "right"])
def test_each_posture_without_noise(name, side):
    found = gesture_probabilities(posture(name, side))
    assert found.sum() == pytest.approx(1) and (found >= 0).all()
    assert GESTURES[int(found.argmax())] == (name if name in GESTURES else "other")


def test_held_gestures_are_said_and_others_are_not():
    """The constants were chosen with other hands: those of another generator of postures."""
    said_right, said_wrong = [], []
    for seed in range(100, 104):
        points, names, held = sequence(seed)
        watch, probabilities = GestureWatch(), gesture_probabilities(points)
        for i, (name, seconds) in enumerate(zip(names, held)):
            said, confidence = watch.update(i / HZ, probabilities[i])
            assert 0 <= confidence <= 1
            if name in GESTURES and seconds >= 0.5:
                said_right.append(said == name)
            elif name and name not in GESTURES and seconds >= HELD_S:
                said_wrong.append(said != "other")
    assert len(said_right) > 400 and len(said_wrong) > 400
    assert np.mean(said_right) >= 0.95 and np.mean(said_wrong) <= 0.05


def test_frame_and_unit_do_not_matter():
    points = posture("victory")
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    assert np.allclose(gesture_probabilities(1000 * points @ turn.T + 5.0), gesture_probabilities(points))
    batch = np.stack([posture(name) for name in ("fist", "open_palm")])
    assert np.allclose(gesture_probabilities(batch)[1], gesture_probabilities(batch[1]))
    assert (finger_bends(batch)[0] > 150).all() and (finger_bends(batch)[1] < 30).all()


def test_a_thumb_must_point_up_if_the_vertical_is_given():
    points = posture("thumbs_up")
    along = points[4] - points[2]
    up = along / np.linalg.norm(along)
    for vertical, expected in ((up, "thumbs_up"), (-up, "other"), (None, "thumbs_up")):
        assert GESTURES[int(gesture_probabilities(points, vertical).argmax())] == expected


def test_a_gesture_is_said_after_a_while_and_forgotten_after_a_gap():
    fist, watch = gesture_probabilities(posture("fist")), GestureWatch()
    said = [watch.update(i / HZ, fist)[0] for i in range(8)]
    assert said[:4] == ["other"] * 4 and said[5:] == ["fist"] * 3
    assert watch.update(5.0, fist)[0] == "other"
    assert watch.update(4.0, fist)[0] == "other"  # time has jumped back
    name, confidence = [watch.update(4.0 + i / HZ, fist) for i in range(1, 8)][-1]
    assert name == "fist" and confidence > 0.9


def cloud_of(ray, deviation=0.1):
    """A hand of ~/hands whose axes are turned by 90 degrees about z, with its wrist at (1, 2, 1)."""
    hand = np.zeros(21, POINT)
    hand["x"][8], hand["wrist_x"], hand["wrist_y"], hand["wrist_z"] = 0.2, 1.0, 2.0, 1.0
    hand["qz"] = hand["qw"] = np.sqrt(0.5)
    hand["ray_x"], hand["ray_y"], hand["ray_z"] = ray
    hand["ray_deviation"] = deviation
    return hand


def test_places_in_the_frame_of_the_message():
    assert np.allclose(hand_points(cloud_of((0, 0, -1)))[[0, 8]], [[1, 2, 1], [1, 2.2, 1]])


def test_the_floor_where_a_hand_points():
    place, covariance = on_floor(cloud_of((0.6, 0.0, -0.8)))
    assert np.allclose(place, [1.75, 2.2]) and np.allclose(covariance, np.diag([0.15625**2, 0.125**2]), rtol=1e-5)
    place, covariance = on_floor(cloud_of((0.0, 0.0, -1.0)), floor=0.5)
    assert np.allclose(place, [1.0, 2.2]) and np.allclose(covariance, 0.05**2 * np.eye(2))
    for ray in ((1.0, 0.0, 0.0), (0.6, 0.0, 0.8)):
        assert np.isnan(on_floor(cloud_of(ray))[0]).all()
    assert np.isnan(on_floor(cloud_of((0, 0, -1.0)), floor=1.5)[1]).all()
