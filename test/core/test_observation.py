"""What the tracker is given: poses of cameras, and stamps whose unit is wrong."""

import warnings

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lassokin_ros.core.errors import CameraError
from lassokin_ros.core.observation import IN_A_ROW, CameraPose, StampUnit


def test_a_camera_pose_maps_points_and_knows_its_centre():
    camera = CameraPose("c", Rotation.from_euler("xyz", [0.3, -0.8, 0.1]).as_matrix(), np.array([0.2, -0.4, 3.0]))
    points = np.random.default_rng(0).normal(size=(4, 5, 3))
    expected = np.einsum("ij,abj->abi", camera.rotation, points) + camera.translation
    assert np.allclose(camera.into_camera(points), expected, atol=1e-14)
    assert np.allclose(camera.into_camera(camera.centre), 0.0, atol=1e-14)
    assert not camera.is_identity and CameraPose("other").is_identity


NOT_ROTATIONS = {
    "slightly scaled": 1.02 * np.eye(3),
    "mirrored": np.diag([1.0, 1.0, -1.0]),
    "an axis exchanged": np.eye(3)[[1, 0, 2]],
    "NaN": np.full((3, 3), np.nan),
    "2 x 2": np.eye(2),
    "sheared": np.array([[1.0, 0, 0], [0.6, 0.8, 0], [0, 0, 0.8]]),
    "a list": np.eye(3).tolist(),
    "nothing": None,
}


@pytest.mark.parametrize("what", NOT_ROTATIONS)
def test_a_matrix_that_is_no_rotation_is_refused_at_construction(what):
    with pytest.raises(CameraError, match=r"camera 'c' has the rotation .*; expected arrays, a rotation \(3, 3\)"):
        CameraPose("c", NOT_ROTATIONS[what], np.zeros(3))


@pytest.mark.parametrize(
    "place", [np.full(3, np.nan), np.array([0, np.inf, 0]), np.zeros(2), np.zeros((3, 1)), [0, 0, 0]]
)
def test_a_place_that_is_none_is_refused_at_construction(place):
    with pytest.raises(CameraError, match=r"and \(3,\) finite m"):
        CameraPose("c", np.eye(3), place)


def test_rotations_as_files_have_them_are_accepted():
    for turn in Rotation.random(200, random_state=0).as_matrix():
        assert CameraPose("c", turn).rotation is turn
        CameraPose("c", np.round(turn, 3), np.array([100, -2, 3]))
        CameraPose("c", turn.astype(np.float32))
    CameraPose("c", np.eye(3, dtype=int), np.arange(3))


@pytest.mark.parametrize("step, remedy", [(33.0, "in ms by 1000"), (1.0, "number of a frame by the frame rate")])
def test_stamps_in_another_unit_are_named_once(step, remedy):
    unit = StampUnit()
    for number in range(3 * IN_A_ROW):
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always")
            unit.add(number * step)
        assert len(found) == (number == IN_A_ROW) and all(remedy in str(one.message) for one in found)


@pytest.mark.parametrize("step", [1 / 30, 1.5, 300.0, 0.0])
def test_stamps_in_s_and_gaps_among_them_are_not_named(step):
    unit, stamp = StampUnit(), 0.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for number in range(4 * IN_A_ROW):
            stamp += step if number % IN_A_ROW else 20.0 + step
            unit.add(stamp)
