"""Rendered depth images of a body of capsules."""

import numpy as np
import pytest

from benchmarks.data.depth_images import FURNITURE, SIZE, WALL, DepthCamera, render

HEIGHT, FOCAL = 1.75, 600.0
JOINTS = {
    "pelvis": (0, 0, 3), "neck": (0, -0.5, 3), "head": (0, -0.6, 3), "head_top": (0, -0.8, 3),
    "l_hip": (0.1, 0.05, 3), "r_hip": (-0.1, 0.05, 3), "l_knee": (0.1, 0.45, 3), "r_knee": (-0.1, 0.45, 2.6),
    "l_ankle": (0.1, 0.85, 3), "r_ankle": (-0.1, 0.85, 2.8), "l_toe": (0.1, 0.9, 2.9), "r_toe": (-0.1, 0.9, 2.7),
    "l_shoulder": (0.2, -0.45, 3), "r_shoulder": (-0.2, -0.45, 3), "l_elbow": (0.45, -0.45, 3),
    "r_elbow": (-0.3, -0.2, 2.9), "l_wrist": (0.7, -0.45, 3), "r_wrist": (-0.1, -0.2, 2.6),
}  # fmt: skip
JOINTS = {name: np.array(place, dtype=float) for name, place in JOINTS.items()}


def pixel(name):
    place = JOINTS[name]
    return FOCAL * place[:2] / place[2] + (np.array(SIZE) - 1) / 2


def at(image, name):
    column, row = np.round(pixel(name)).astype(int)
    return image[row, column]


def test_a_limb_across_the_view_is_its_radius_nearer_than_its_axis():
    image = render(JOINTS, HEIGHT, FOCAL)
    assert at(image, "l_elbow") == pytest.approx(3 - 0.045, abs=0.003)
    assert at(image, "l_knee") == pytest.approx(3 - 0.075, abs=0.003)
    assert image[5, 5] == pytest.approx(3 + WALL)


def test_the_wrist_in_front_hides_the_trunk_and_furniture_hides_the_feet():
    image = render(JOINTS, HEIGHT, FOCAL, covered=0.2)
    assert at(image, "r_wrist") < 2.6
    assert at(image, "l_ankle") == pytest.approx(3 - FURNITURE)
    assert at(image, "neck") > 2.8


def test_samples_are_those_of_the_node():
    places = np.array([[pixel(name) for name in ("l_elbow", "l_knee")]] * 20)
    joints = {name: np.repeat(place[None], 20, axis=0) for name, place in JOINTS.items()}
    camera = DepthCamera(noise=0.01, noise_z2=0.0, bias=0.0, holes=0.2)
    depth = camera.sampled(joints, HEIGHT, FOCAL, places, SIZE, np.random.default_rng(0))
    assert depth.mean(0) == pytest.approx([3 - 0.045, 3 - 0.075], abs=0.008)
    assert (depth.std(0) < 0.01).all()  # many pixels a sample
