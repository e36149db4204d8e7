"""Keypoints of hri_msgs, yolo_msgs and zed_msgs: from messages of their real definitions to joints, through a bag."""

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags knows message types that are not installed")

from detector_messages import (  # noqa: E402
    HRI,
    YOLO,
    ZED,
    backend,
    detector_types,
    hri_skeleton,
    yolo_detections,
    zed_objects,
)
from messages import FRAME  # noqa: E402
from recordings import START_NS, read, synthetic_pixels, webcam_info, write_messages  # noqa: E402

from lassokin_ros.cli.replay import main  # noqa: E402
from lassokin_ros.core.body.kinematics import Kinematics  # noqa: E402
from lassokin_ros.core.body.landmarks import Layout  # noqa: E402
from lassokin_ros.core.body.skeleton import Skeleton  # noqa: E402
from lassokin_ros.demo.synthetic import WEBCAM, exact_pixels, motion  # noqa: E402
from msg_adapters.detectors.registry import keypoint_adapter  # noqa: E402
from msg_adapters.errors import AdapterError  # noqa: E402

BACKEND = backend()
SKELETON = Skeleton.load("anthropometric", 1.75)
SIZE = (640, 480)
XY = np.column_stack([np.arange(38) * 10.0 + 5, np.arange(38) * 7.0 + 3])
SCORES = np.linspace(0.5, 0.95, 38)


def decode(message_type, message, size=SIZE):
    """The message after serialisation, as from a bag."""
    types = detector_types()
    message = types.deserialize_cdr(types.serialize_cdr(message, message_type), message_type)
    return keypoint_adapter(message_type).decode(message, size)


def reason_of(call):
    with pytest.raises(AdapterError) as caught:
        call()
    return caught.value.reason


def test_an_hri_skeleton_gives_pixels():
    scores = SCORES[:18].copy()
    scores[4] = 0
    keypoints = decode(HRI, hri_skeleton(BACKEND, START_NS, FRAME, XY[:18], scores, SIZE))
    points, confidence = keypoints.as_landmarks(18)
    seen = np.arange(18) != 4
    assert np.allclose(points[seen], XY[:18][seen], atol=1e-3) and np.isnan(points[4]).all() and confidence[4] == 0
    assert (keypoints.stamp_ns, keypoints.frame_id, keypoints.persons) == (START_NS, FRAME, None)


def test_hri_eyes_and_ears_have_their_own_order():
    hri, openpose = (Layout.load(name, SKELETON).names for name in ("hri18", "openpose18"))
    assert hri[14:] == ("left_eye", "right_eye", "left_ear", "right_ear")
    assert openpose[14:] == ("right_eye", "left_eye", "right_ear", "left_ear") and hri[:14] == openpose[:14]


def test_yolo_detections_give_people_with_keypoints():
    half = np.where(np.arange(17) % 2, 0.0, SCORES[:17])
    people = [(XY[:17], half), (XY[:17] + 100, SCORES[:17]), (XY[:17], np.zeros(17))]
    keypoints = decode(YOLO, yolo_detections(BACKEND, START_NS, FRAME, people, ["7", "3", ""]))
    assert keypoints.persistent and set(keypoints.persons.tolist()) == {3, 7}
    points, confidence = keypoints.as_landmarks(17, person=7)
    assert np.array_equal(np.isfinite(points[:, 0]), half > 0) and np.allclose(confidence, half)
    assert np.allclose(points[half > 0], XY[:17][half > 0])
    assert np.allclose(keypoints.as_landmarks(17, person=3)[0], XY[:17] + 100)
    assert (keypoints.stamp_ns, keypoints.frame_id) == (START_NS, FRAME)


@pytest.mark.parametrize("ids", [["", ""], ["4", "4"], ["4", "x"], ["-1", "2"]])
def test_ambiguous_yolo_ids_are_used_for_one_message_only(ids):
    people = [(XY[:17], SCORES[:17]), (XY[:17] + 100, SCORES[:17])]
    keypoints = decode(YOLO, yolo_detections(BACKEND, START_NS, FRAME, people, ids))
    assert not keypoints.persistent
    assert np.allclose(keypoints.as_landmarks(17, person=1)[0], XY[:17] + 100)


def test_yolo_messages_may_be_empty_or_have_the_id_zero():
    assert len(decode(YOLO, yolo_detections(BACKEND, START_NS, FRAME, [], [])).ids) == 0
    message = yolo_detections(BACKEND, START_NS, FRAME, [(XY[:17], SCORES[:17])], ["1"])
    message.detections[0].keypoints.data[-1].id = 0
    assert reason_of(lambda: decode(YOLO, message)) == "unknown_id"


def test_people_without_keypoints_are_counted():
    """A person who is too near, or hidden. Other things and people who have left do not count."""
    message = yolo_detections(BACKEND, START_NS, FRAME, 3 * [(XY[:17], np.zeros(17))], ["1", "2", "3"])
    message.detections[2].class_name = "chair"
    assert decode(YOLO, message).unplaced == 2
    message = zed_objects(BACKEND, START_NS, [XY, XY, XY, XY], [1, 2, 3, 4])
    assert decode(ZED, message).unplaced == 0
    message.objects[0].tracking_state, message.objects[1].tracking_state = 2, 3
    message.objects[2].skeleton_available = False
    keypoints = decode(ZED, message)
    assert keypoints.unplaced == 2 and set(keypoints.persons.tolist()) == {4}


def test_zed_objects_give_people_with_keypoints():
    found = XY.copy()
    found[5], found[6], found[7] = np.nan, -1, 0
    keypoints = decode(ZED, zed_objects(BACKEND, START_NS, [found, XY + 50], [2, 9]))
    points, confidence = keypoints.as_landmarks(38, person=2)
    assert np.flatnonzero(np.isnan(points[:, 0])).tolist() == [5, 6, 7]
    assert np.allclose(np.delete(points, [5, 6, 7], axis=0), np.delete(XY, [5, 6, 7], axis=0))
    assert np.allclose(confidence[[0, 37]], 0.9)
    assert np.allclose(keypoints.as_landmarks(38, person=9)[0], XY + 50)
    assert keypoints.persistent and keypoints.frame_id == "" and keypoints.stamp_ns == START_NS


def test_zed_bodies_that_are_not_visible_are_left_out():
    message = zed_objects(BACKEND, START_NS, [XY] * 4, [1, 2, 3, 4])
    message.objects[0].tracking_state = 2  # state "searching": its points are a guess
    message.objects[1].tracking_state = 0
    message.objects[2].skeleton_available = False
    assert set(decode(ZED, message).persons.tolist()) == {4}
    untracked = decode(ZED, zed_objects(BACKEND, START_NS, [XY] * 2, [-1, -1], tracked=False))
    assert not untracked.persistent and set(untracked.persons.tolist()) == {0, 1}


def pixels_of(layout, frames):
    """(f, l, 2) px of the synthetic motion."""
    kinematics = Kinematics(SKELETON, Layout.load(layout, SKELETON))
    return exact_pixels(kinematics, motion(SKELETON, np.arange(frames) / 30.0))


def test_zed38_is_in_body38s_order():
    names = Layout.load("zed38", SKELETON).names
    assert names[5] == "nose" and names[18:20] == ("left_hip", "right_hip") and names[24] == "left_big_toe"
    assert names[30:] == tuple(
        f"{side}_hand_{part}" for part in ("thumb_4", "index_1", "middle_4", "pinky_1") for side in ("left", "right")
    )


@pytest.mark.parametrize(("message_type", "storage"), [(HRI, "mcap"), (YOLO, "sqlite3"), (ZED, "mcap")])
def test_a_recording_of_each_is_tracked(tmp_path, message_type, storage):
    """The joints in the output of `replay` are those of the person; frame_id is the name of the optical frame."""
    frames, layout = 20, {HRI: "hri18", YOLO: "coco17", ZED: "zed38"}[message_type]
    stamps, _, _ = synthetic_pixels(frames)
    pixels = pixels_of(layout, frames)
    scores = np.full(pixels.shape[1], 0.9)
    make = {
        HRI: lambda t, xy: hri_skeleton(BACKEND, t, "camera_optical_frame", xy, scores, WEBCAM.size),
        YOLO: lambda t, xy: yolo_detections(BACKEND, t, "camera_optical_frame", [(xy, scores)], ["1"]),
        ZED: lambda t, xy: zed_objects(BACKEND, t, [xy], [1]),
    }[message_type]
    types = detector_types()
    messages = [("/camera_info", "sensor_msgs/msg/CameraInfo", START_NS - 1, webcam_info())]
    messages += [("/detector", message_type, t, make(t, xy)) for t, xy in zip(stamps.tolist(), pixels)]
    recording = write_messages(tmp_path / "in", messages, storage, types)
    options = ["-p", f"keypoints_type:={message_type}", "-p", f"landmarks:={layout}"]
    assert main([str(recording), "-o", str(tmp_path / "out"), *options]) == 0
    outputs = [m for _, m in read(tmp_path / "out", "/tracker/translation")]
    truth = motion(SKELETON, np.arange(frames) / 30.0).translation
    places = np.array([[m.point.x, m.point.y, m.point.z] for m in outputs])
    assert len(places) == frames and np.abs(places - truth).max() < 0.25
    assert {m.header.frame_id for m in outputs} == {"camera_optical_frame"}
