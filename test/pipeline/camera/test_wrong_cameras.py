"""One of several cameras is wrong: it is named, and not used if it can be told which one it is."""

import gc
import re
from collections import Counter
from types import BuiltinFunctionType, FunctionType, ModuleType

import numpy as np
import pytest
from camera_rig import LEFT, MAP, RIGHT, START_NS, Play, eye, off, pixels, tf_of, truth_at
from messages import camera_info, rosbags_backend

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.hypotheses.start import Starts
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.pipeline.concerns.live import of_cameras
from lassokin_ros.pipeline.concerns.period import Period
from lassokin_ros.pipeline.outputs.saved_files import CamerasFileError, save_cameras
from lassokin_ros.pipeline.outputs.scene_messages import CameraMarkers
from lassokin_ros.pipeline.people.camera_agreement import LEFT_OUT
from lassokin_ros.pipeline.seen import Seen, Sight
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings

BACKEND = rosbags_backend()
BACK = eye("back", 200, 4.0)


class Rig(Play):
    """With places that are given, and noise of 3 px."""

    def __init__(self, *eyes, poses=None, **settings):
        settings = NodeSettings(cameras=tuple(one.name for one in eyes), fixed_frame=MAP, **settings)
        given = {one.name: one.pose_at(0) for one in eyes} | (poses or {})
        super().__init__(list(eyes), settings, poses=given, noise_px=3.0)

    def send(self, begin, end, instead=None, silent=(), hz=30):
        """Images, from s to s. instead: whose images a camera sends."""
        swapped = {self.names.index(one): self.names.index(other) for one, other in (instead or {}).items()}
        quiet = [self.names.index(name) for name in silent]
        return self.run(end - begin, hz, tf=False, silent=lambda n, _: n in quiet, begin=begin, instead=swapped)

    @property
    def errors(self):
        return [one.error.mean() for one in self.results]

    @property
    def left_out(self):
        return set(self.session.placement.agreement.left_out)


def inverse(one):
    return CameraPose(one.name, one.pose_at(0).rotation.T, one.pose_at(0).centre)


WRONG = {
    "images of another camera": ({"instead": {"right": "back"}}, {}, "they are those of 'back': check its topics"),
    "inverse transform": ({}, {"right": inverse(RIGHT)}, "the keypoints fit the inverse transform of 'right'"),
}


@pytest.mark.parametrize("fault", WRONG)
def test_of_three_cameras_the_wrong_one_is_named_and_not_used_after_a_second(fault):
    how, poses, hint = WRONG[fault]
    rig = Rig(LEFT, RIGHT, BACK, poses=poses).send(0.0, 0.5, **how)
    assert not rig.left_out
    rig.send(0.5, 1.2, **how)
    assert rig.left_out == {"right"}
    used = rig.session.counts[f"right: {LEFT_OUT}"]
    rig.send(1.2, 3.0, **how)
    assert rig.session.counts[f"right: {LEFT_OUT}"] - used >= 53  # of 54 images; one may wait
    assert np.median(rig.errors[-20:]) < 0.03
    line = rig.line(3.0)
    assert "camera 'right' is not used: its keypoints do not fit those of 'left' and 'back'" in line.message
    assert hint in line.message and "camera 'left'" not in line.message
    assert int(line.values[f"right: {LEFT_OUT} [messages]"]) >= 53


def test_a_camera_whose_lens_is_not_its_own_is_named():
    rig = Rig(LEFT, RIGHT, BACK)
    info = camera_info(BACKEND, frame_id=RIGHT.frame)
    info.k[[0, 4]] *= 0.6
    rig.session.set_camera(info, "right")
    rig.send(0.0, 2.0)
    assert rig.left_out == {"right"} and "camera 'right' is not used" in rig.line(2.0).message


@pytest.mark.parametrize("poses", [{}, {"right": off(RIGHT, 2.0)}])
def test_good_cameras_and_a_small_error_of_a_pose_are_used(poses):
    rig = Rig(LEFT, RIGHT, BACK, poses=poses)
    rig.noise_px = 5.0
    rig.send(0.0, 3.0)
    assert not rig.left_out and not any(LEFT_OUT in key for key, count in rig.session.counts.items() if count)
    assert "not used" not in rig.line(3.0).message and "do not fit" not in rig.line(4.0).message


@pytest.mark.parametrize(
    "how, poses, words",
    [
        ({"instead": {"right": "left"}}, {}, "cameras 'left' and 'right' have the same keypoints"),
        ({}, {"right": inverse(RIGHT)}, "the keypoints fit the inverse transform of 'right', not the given one"),
        ({}, {"right": off(RIGHT, 40)}, "the keypoints of 'left' and 'right' do not fit the given places"),
    ],
)
def test_of_two_cameras_both_are_named_and_used_because_it_cannot_be_told_which_is_wrong(how, poses, words, tmp_path):
    """The poses of such cameras are not saved."""
    rig, path = Rig(LEFT, RIGHT, poses=poses).send(0.0, 3.0, **how), tmp_path / "cameras.sh"
    assert words in rig.line(3.0).message and not rig.left_out
    path.write_text("the last good one")
    with pytest.raises(CamerasFileError, match=f"nothing is written, because .*{words}.* Correct that"):
        save_cameras(rig.session, path)
    assert path.read_text() == "the last good one"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda R, t: (R, 1000 * t), "the places of the cameras are in mm, as the person's size shows; expected m"),
        (lambda R, t: (R, 100 * t), "the places of the cameras are in cm"),
        (lambda R, t: (R @ np.diag([1.0, -1, -1]), t), "the person stands upright along -z of 'map'; expected a frame"),
    ],
)
def test_the_unit_and_the_vertical_of_the_places_are_said(change, words):
    poses = {one.name: CameraPose(one.name, *change(p.rotation, p.translation)) for one in (LEFT, RIGHT)
             for p in [one.pose_at(0)]}  # fmt: skip
    rig = Rig(LEFT, RIGHT, poses=poses).send(0.0, 1.5)
    assert [words in said for said in rig.session.placement.rig.set_up] == [True]


@pytest.mark.parametrize("late", [0.05, 0.0])
def test_stamps_of_a_camera_that_are_off_are_said_in_ms(late):
    """A webcam that stamps its images 50 ms too early; nothing is changed."""
    rig = Rig(LEFT, RIGHT)
    check, random = rig.session.placement.rig, np.random.default_rng(0)
    for index in range(21 * 30):
        now, sights = index / 30, []
        for one in rig.eyes:
            points = pixels(one, now, truth_at([now % 12.0]).landmarks[0], random, 2.0)
            stamp_ns = START_NS + round(1e9 * (now - late * (one is RIGHT)))
            lens = rig.session.cameras[one.name].camera.view.lens
            seen = Seen(lens.normalise(points), np.ones(17), pixels=points)
            sights.append(Sight(stamp_ns, seen, lens, one.pose_at(0)))
        check.add(sights)
        if index == 15 * 30:
            assert not check.clocks  # one comparison is not enough
    assert not check.set_up
    if late:
        (words,) = check.clocks
        (ms,) = re.findall(r"are (\d+) ms \(\+- \d+\) too early; nothing is changed", words)
        assert 44 <= int(ms) <= 56
        assert words in [raised.text for raised in of_cameras(Period(rig.session, 0.0), 0.0)]
    else:
        assert not check.clocks


def test_cameras_that_contradict_each_other_do_not_need_a_search_in_each_frame(monkeypatch):
    """It takes a hundred times as long as a frame, and its answer is rejected again."""
    searches, search = [], Starts._first_fit
    monkeypatch.setattr(Starts, "_first_fit", lambda *args: (searches.append(1), search(*args))[1])
    rig = Rig(LEFT, RIGHT, poses={"right": inverse(RIGHT)}).send(0.0, 2.0)
    rejected = sum(count for key, count in rig.session.counts.items() if key.startswith("rejected: "))
    assert rejected > 30 and len(searches) < 0.4 * rejected


def test_cameras_with_exchanged_images_are_named():
    near = eye("near", 90, 2.6)
    rig = Rig(LEFT, near).send(0.0, 3.0, instead={"left": "near", "near": "left"})
    assert "those of 'left' fit 'near', those of 'near' fit 'left': check topics" in rig.line(3.0).message


def test_a_mirrored_person_shows_that_cameras_at_equal_distances_are_exchanged(angle=60):
    """The places fit: a standing person has the same heights in both images."""
    other = eye("right", angle)
    exchanged = Rig(LEFT, other).send(0.0, 2.0, instead={"left": "right", "right": "left"})
    assert "the keypoints are exchanged between cameras: those of 'left' fit 'right'" in exchanged.line(2.0).message
    assert "exchanged" not in Rig(LEFT, other).send(0.0, 2.0).line(2.0).message


def test_poses_are_saved_when_the_fault_is_mended(tmp_path):
    rig = Rig(LEFT, RIGHT, BACK).send(0.0, 2.5, instead={"right": "back"})
    with pytest.raises(CamerasFileError, match="camera 'right' is not used"):
        save_cameras(rig.session, tmp_path / "cameras.sh")
    rig.send(2.5, 6.0)
    assert not rig.left_out and rig.session.placement.agreement.residuals["right"]
    assert "is not used" not in rig.line(6.0).message and np.median(rig.errors[-20:]) < 0.03
    assert len(save_cameras(rig.session, tmp_path / "cameras.sh").read_text().splitlines()) == 3


def test_cameras_that_alternate_are_no_turn_of_the_person():
    """Each image is a lasso of its own; the person stands 90 degrees apart, and further away, for the other camera."""
    far = eye("far", 90, 5.0)
    rig = Rig(LEFT, far)
    for index in range(60):
        rig.image(index % 2, index / 60)
    assert not any(one.frame.doubt.has_sign or one.frame.doubt.reversed for one in rig.results)
    assert len(rig.errors) > 55


def test_a_camera_whose_place_nobody_knows_is_not_left_out():
    """Its place is found from the person; TF has those of the others."""
    rig = Rig(LEFT, RIGHT, BACK)
    config = TrackerConfig(height=1.75, extrinsics="learn")
    rig.session = Session(config, NodeSettings(cameras=rig.names, fixed_frame=MAP))
    for name, one in zip(rig.names, rig.eyes):
        rig.session.set_camera(camera_info(BACKEND, frame_id=one.frame), name)
        if name != "back":
            rig.session.placement.transforms.add(tf_of(BACKEND, one, START_NS, 0.0), static=True)
    rig.send(0.0, 2.0)
    assert not rig.left_out and rig.errors
    message = CameraMarkers(BACKEND, rig.session).build(START_NS, 0.0)
    assert {one.text for one in message.markers if one.text} == {"left", "right"}


def test_with_several_people_no_camera_is_left_out():
    """Each camera may see somebody else."""
    rig = Rig(LEFT, RIGHT, BACK, poses={"right": off(RIGHT, 40)}, max_people=3).send(0.0, 2.0)
    assert not rig.left_out


def reachable(root):
    """Number of objects by type that an object holds, directly or not, arrays among them."""
    seen, waiting = {}, [root]
    while waiting:
        one = waiting.pop()
        if id(one) in seen or isinstance(one, (type, ModuleType, FunctionType, BuiltinFunctionType)):
            continue
        seen[id(one)] = one
        waiting += gc.get_referents(one)
    return Counter(type(one).__name__ for one in seen.values())


def test_memory_is_constant_while_cameras_come_and_go():
    """Five minutes, in short periods; each camera is silent for a while, and one sends another's images."""
    rig, counts = Rig(LEFT, RIGHT, BACK), []
    for cycle in range(30):
        begin, wrong = 10.0 * cycle, cycle % 10 == 5
        rig.send(begin, begin + 0.5, hz=10)
        rig.send(begin + 2.5, begin + 3.0, hz=10, silent=[rig.names[cycle % 3]])
        rig.send(begin + 5.0, begin + (6.5 if wrong else 5.5), hz=10, instead={"right": "back"} if wrong else None)
        rig.line(begin + 9.0)
        rig.results.clear()
        if cycle in (19, 29):  # all windows are full, and the last cycles were alike
            counts.append(reachable([rig.session, rig.diagnostics]))
    assert rig.session.counts[f"right: {LEFT_OUT}"] > 0 and counts[0]["ndarray"] > 100
    assert not {name: (n, counts[1][name]) for name, n in counts[0].items() if counts[1][name] > 1.05 * n + 20}
