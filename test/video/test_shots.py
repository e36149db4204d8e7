"""Moving cameras and cuts: the background of made images, and the command on them."""

import re

import numpy as np
import pytest
from camera_rig import eye, truth_at
from messages import FOCAL, WIDTH

from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.detector.backend import Detected
from lassokin_ros.pipeline.camera.calibration_file import Calibration
from lassokin_ros.video import track as track_module
from lassokin_ros.video.command import main
from lassokin_ros.video.people import people_of_shots
from lassokin_ros.video.shots import Footage, LiveFootage
from lassokin_ros.video.sources import Image

cv2 = pytest.importorskip("cv2")

SIZE = (480, 270)
SCALE = SIZE[0] / WIDTH
K = np.array([[FOCAL * SCALE, 0, SIZE[0] / 2], [0, FOCAL * SCALE, SIZE[1] / 2], [0, 0, 1.0]])
LENS = Calibration(K, np.zeros(0), size=SIZE)


def room(seed):
    """A large picture of a room: patches of colour."""
    random = np.random.default_rng(seed)
    patches = random.integers(0, 255, (40 + 7 * seed, 60 - 13 * seed, 3)).astype(np.uint8)
    if seed % 2:
        patches[..., 0] //= 3  # other colours
    return cv2.resize(patches, (1200, 800), interpolation=cv2.INTER_NEAREST)


ROOMS = room(0), room(1)


def shown(picture, turn=np.eye(3), zoom=1.0):
    """The image of a camera that is turned: points x are at turn x."""
    there = np.array([[K[0, 0], 0, 600], [0, K[1, 1], 400], [0, 0, 1.0]])
    view = K @ np.diag([zoom, zoom, 1.0]) @ turn @ np.linalg.inv(there)
    return cv2.warpPerspective(picture, view, SIZE, flags=cv2.INTER_LINEAR)


def yaw(degrees):
    return exponential(np.array([[0.0, np.radians(degrees), 0.0]]))[0]


def followed(images, people=(), content=SIZE, make=Footage):
    found = make(LENS, SIZE, content)
    for number, image in enumerate(images):
        found.add(Image(number / 30, image), people)
    if make is Footage:
        found.finish()
    return found


def test_the_rotation_of_a_panning_camera_is_found():
    angles = 6 * np.sin(np.arange(40) / 8)
    found = followed([shown(ROOMS[0], yaw(angle)) for angle in angles])
    (shot,) = found.shots
    errors = [np.degrees(np.linalg.norm(R - yaw(angle - angles[0]))) for R, angle in zip(shot.rotations, angles)]
    assert found.moves and not found.cuts and max(errors) < 0.2 and 10 < shot.degrees < 12.5
    pose = found.pose(1_000_000_000 + round(1e9 * 10 / 30))
    assert np.array_equal(pose.rotation, shot.rotations[10]) and not pose.translation.any()
    assert "The camera turns by 1" in found.remarks()[0] and "Its rotation is taken out" in found.remarks()[0]


@pytest.mark.parametrize("noise", [0.0, 4.0])
def test_a_still_camera_stands_whoever_moves_before_it(noise):
    """The person hides a third of the image, and has a pattern of its own."""
    random, images = np.random.default_rng(0), []
    picture = shown(ROOMS[0])
    for number in range(30):
        image = np.clip(picture + noise * random.normal(size=picture.shape), 0, 255).astype(np.uint8)
        image[40:250, 100 + 4 * number : 240 + 4 * number] = ROOMS[1][200:410, 300:440]
        images.append(image)
    low, high = np.array([110.0, 60.0]), np.array([340.0, 240.0])
    box = Detected(np.array([low, high, low, high, low]), np.ones(5))
    found = followed(images, [box])
    assert not found.moves and not found.cuts and found.shots[0].is_known and not found.remarks()
    assert found.pose(1_000_000_000).is_identity and found.shots[0].degrees < 0.1


def test_a_cut_begins_a_shot_and_a_flash_or_a_dissolve_none():
    first, second = shown(ROOMS[0]), shown(ROOMS[1])
    found = followed([first] * 12 + [second] * 12)
    assert found.cuts == [12 / 30] and [len(shot.times) for shot in found.shots] == [12, 12]
    assert found.begins_at(12 / 30) and not found.begins_at(11 / 30)
    assert found.remarks()[0].startswith("A new shot begins at 0.40 s.")
    dark = [first // 7, second // 7]  # with nearly the same colours
    assert followed([dark[0]] * 10 + [dark[1]] * 10).cuts == [10 / 30]
    white, black = np.full_like(first, 255), np.zeros_like(first)
    assert not followed([black] * 5 + [first] * 10).cuts
    for other in (white, black, second):
        assert not followed([first] * 10 + [other] + [first] * 10).cuts
    mixed = [cv2.addWeighted(first, 1 - step / 11, second, step / 11, 0) for step in range(1, 11)]
    assert not followed([first] * 8 + mixed + [second] * 8).cuts
    assert followed([first] * 10 + [second] * 2).cuts == [10 / 30]  # the video ends soon after


def test_a_zoom_is_no_pan():
    found = followed([shown(ROOMS[0], zoom=1 + 0.01 * step) for step in range(30)])
    assert not found.moves and "zooms, or comes nearer, from 0.0 to 1.0 s by a factor of 1.2" in found.remarks()[0]


def test_without_a_background_it_cannot_be_told():
    grey = np.full((SIZE[1], SIZE[0], 3), 90, np.uint8)
    found = followed([grey + 20 * (number % 3) for number in range(12)])
    assert not found.moves and not found.cuts and "It cannot be told whether the camera moves" in found.unknown()[0]


def test_black_bars_are_no_background():
    images = []
    for step in range(20):
        image = shown(ROOMS[0], yaw(0.5 * step))
        image[:, :40] = image[:, -40:] = 0
        images.append(image)
    assert followed(images, content=(400, 270)).shots[0].degrees > 8


def test_images_that_come_one_by_one_keep_nothing_of_the_past():
    still = followed([shown(ROOMS[0])] * 12, make=LiveFootage)
    assert not still.moves and still.pose(0).is_identity and len(still.shots[0].times) == 1
    moving = followed([shown(ROOMS[0], yaw(0.3 * step)) for step in range(12)], make=LiveFootage)
    assert moving.moves and np.degrees(np.linalg.norm(moving.pose(0).rotation - yaw(3.3))) < 0.2


def test_people_of_several_shots_are_in_the_order_of_their_sizes():
    def person(x, size):
        return Detected(np.array([[x, 0.0], [x + size, size], [x, size], [x + size, 0]] * 3), np.full(12, 0.9))

    before, after = [person(0, 100), person(400, 50)], [person(0, 60), person(400, 200)]
    images = [(n / 10, before if n < 15 else after) for n in range(30)]
    first, second = people_of_shots(images, [1.5])
    assert len(first.seconds) == len(second.seconds) == 30
    assert [one.pixels[0, 0] for one in (first.detected[0], first.detected[-1])] == [0, 400]


def test_a_still_camera_changes_no_byte_of_the_outputs(tmp_path, monkeypatch, use):
    (tmp_path / "images").mkdir()
    body, random = eye("a", 0).pose_at(0).into_camera(truth_at([0.0]).landmarks[0]), np.random.default_rng(0)
    points = body[:, :2] / body[:, 2:] * K[0, 0] + [SIZE[0] / 2, SIZE[1] / 2]
    found = [[Detected(points + 0.5 * random.normal(size=points.shape), np.full(17, 0.9))] for _ in range(12)]
    for number in range(12):
        cv2.imwrite(str(tmp_path / "images" / f"{number:03}.png"), shown(ROOMS[0]))
    monkeypatch.chdir(tmp_path)
    use(lambda seconds: found[round(30 * seconds)])
    command = ["images", "--height", "1.75", "--fov", "60", "--causal"]
    own = track_module.Session
    assert main([*command, "--export", "with.npz"]) == 0
    monkeypatch.setattr(track_module, "Session", lambda *args, poses=None, **more: own(*args, **more))
    assert main([*command, "--export", "without.npz"]) == 0
    followed_, plain = np.load("with.npz"), np.load("without.npz")
    assert set(followed_) == set(plain)
    assert all(followed_[name].tobytes() == plain[name].tobytes() for name in plain)


def test_the_command_takes_out_a_pan_and_begins_a_take_at_a_cut(tmp_path, monkeypatch, use, capsys):
    """Somebody stands; the camera pans to and fro. Then another camera stands beside, with another room behind."""
    count, cut = 60, 36
    angles = np.where(np.arange(count) < cut, 8 * np.sin(np.arange(count) / 6), 0)
    body = truth_at([0.0]).landmarks[0]
    views = [eye("a", 0).pose_at(0).into_camera(body), eye("b", 80, 3.2).pose_at(0).into_camera(body)]
    random = np.random.default_rng(0)
    (tmp_path / "images").mkdir()
    found = []
    for number, angle in enumerate(angles):
        later = number >= cut
        seen = views[later] @ yaw(angle).T
        points = seen[:, :2] / seen[:, 2:] * K[0, 0] + [SIZE[0] / 2, SIZE[1] / 2]
        found.append([Detected(points + 0.5 * random.normal(size=points.shape), np.full(17, 0.9))])
        image = shown(ROOMS[int(later)], yaw(angle))
        cv2.imwrite(str(tmp_path / "images" / f"{number:03}.png"), image[..., ::-1])

    use(lambda seconds: found[round(30 * seconds)])
    monkeypatch.chdir(tmp_path)
    fov = str(np.degrees(2 * np.arctan(0.5 * SIZE[0] / K[0, 0])))
    assert main(["images", "--height", "1.75", "--fov", fov, "--export", "out.npz"]) == 0
    noted = capsys.readouterr().err
    assert "A new shot begins at 1.20 s." in noted
    assert float(re.search(r"The camera turns by (\d+\.\d) degrees from 0.0 to 1.2 s", noted)[1]) > 13
    with np.load("out.npz") as motion:
        frames, root = np.round(motion["stamp_ns"] * 30e-9).astype(int), motion["joint_positions"][:, 0]
    frames -= frames[0]
    assert len(frames) > count - 4
    across = root[frames < cut - 1, 0]
    assert np.ptp(across[3:]) < 0.1  # the pan alone moves it by 0.9 m
    assert abs(np.median(root[frames > cut + 2, 2]) - 3.2) < 0.5
