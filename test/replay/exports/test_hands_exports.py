"""Fingers in the exports and the pictures: the same motion in all, bends under the names of hand surgeons."""

from importlib.util import find_spec
from io import BytesIO

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")

from exported import motion_of  # noqa: E402

from lassokin_ros.core.body.kinematics import BodyState, Kinematics  # noqa: E402
from lassokin_ros.core.body.landmarks import Layout  # noqa: E402
from lassokin_ros.core.body.rotations import exponential  # noqa: E402
from lassokin_ros.core.body.skeleton import Skeleton  # noqa: E402
from lassokin_ros.pipeline.people.joint_angles import JointAngleReader  # noqa: E402
from lassokin_ros.replay.body import capsules  # noqa: E402
from lassokin_ros.replay.exports.amass import write_amass  # noqa: E402
from lassokin_ros.replay.exports.bvh import write_bvh  # noqa: E402
from lassokin_ros.replay.exports.exports import PERSONS, TABLES  # noqa: E402
from lassokin_ros.replay.exports.named_angles import finger_angles  # noqa: E402
from lassokin_ros.replay.exports.tables import write_csv  # noqa: E402

SKELETON = Skeleton.load("body_hands", 1.75)
BODY = Kinematics(SKELETON, Layout.load("mediapipe75", SKELETON))
COUNT, FRAMES = 54, 6
BENDS = {  # rotation vectors of the left side, degrees; the right one has y and z mirrored
    "wrist": (0, -10, -30),
    "index1": (0, 8, -50),
    "index2": (0, 0, -70),
    "index3": (0, 0, -20),
    "thumb1": (25, 15, 0),
    "thumb2": (0, 30, 0),
    "thumb3": (0, 40, 0),
}
NAMED = {
    "wrist flexion": 30,
    "wrist radial deviation": 10,
    "index MCP flexion": 50,
    "index MCP deviation": -8,
    "index PIP flexion": 70,
    "index DIP flexion": 20,
    "thumb CMC palmar abduction": 25,
    "thumb CMC flexion": 15,
    "thumb MCP flexion": 30,
    "thumb IP flexion": 40,
    "ring PIP flexion": 0,
}


def turns():
    """(54, 3) rad, rotation vectors."""
    vectors = np.zeros((COUNT, 3))
    for part, vector in BENDS.items():
        vectors[SKELETON.index(f"left_{part}")] = np.radians(vector)
        vectors[SKELETON.index(f"right_{part}")] = np.radians(vector) * [1, -1, -1]
    vectors[0] = np.pi, 0, 0
    return vectors


def motion():
    rotations = np.tile(exponential(turns()), (FRAMES, 1, 1, 1))
    rotations[:, 20] = Rotation.from_rotvec(np.outer(np.arange(FRAMES), [0, 0.05, 0.1])).as_matrix()
    translations = np.tile([0.1, 0.2, 2.5], (FRAMES, 1))
    pose = BODY.pose(BodyState(rotations, translations))
    reader = JointAngleReader(SKELETON.axes)
    angles = np.array([reader.read(frame) for frame in rotations])
    stamps = np.arange(FRAMES) * 40_000_000
    return motion_of(SKELETON, stamps, rotations, translations, joint_positions=pose.positions, joint_angles=angles)


MOTION = motion()


@pytest.mark.parametrize("suffix", [s for s in (*TABLES, *PERSONS) if s != ".c3d" or find_spec("ezc3d")])
def test_equal_motions_give_equal_bytes_and_are_not_changed(suffix):
    before, files = {name: values.copy() for name, values in MOTION.frames.items()}, []
    for _ in range(2):
        files.append(BytesIO())
        (TABLES[suffix]([MOTION], files[-1]) if suffix in TABLES else PERSONS[suffix](MOTION, files[-1]))
    assert files[0].getvalue() == files[1].getvalue() != b""
    assert all(np.array_equal(MOTION[name], values, equal_nan=True) for name, values in before.items())


def test_bends_have_the_names_of_hand_surgeons():
    found = finger_angles(SKELETON.joint_names, exponential(turns())[None])
    assert len(found) == 2 * (2 + 4 * 4 + 4)
    for side in ("left", "right"):
        for name, degrees in NAMED.items():
            exact = 1e-6 if "thumb CMC" not in name and "wrist" not in name else 3.0
            assert found[f"{side}_{name}"][0] == pytest.approx(degrees, abs=exact), name


def test_flexion_brings_the_fingertip_to_the_palm():
    """The signs, by places: a finger that bends comes nearer to the wrist and to the palm's side, y down at rest."""
    straight, bent = (exponential(np.zeros((COUNT, 3))) for _ in range(2))
    for side, sign in (("left", 1), ("right", -1)):
        bent[SKELETON.index(f"{side}_middle1")] = exponential(np.array([0, 0, -1.2 * sign]))
    before, after = (BODY.pose(BodyState(r, np.zeros(3))).landmarks for r in (straight, bent))
    for side in ("left", "right"):
        tip, wrist = (BODY.layout.index(f"{side}_{part}") for part in ("middle_tip", "hand_wrist"))
        assert after[tip, 1] < before[tip, 1] - 0.05
        assert np.linalg.norm(after[tip] - after[wrist]) < np.linalg.norm(before[tip] - before[wrist]) - 0.02


def test_the_csv_has_bends_and_seen_fingertips():
    file = BytesIO()
    write_csv([MOTION], file)
    head, first, *_ = file.getvalue().decode().splitlines()
    row = dict(zip(head.split(","), first.split(",")))
    assert float(row["left_index PIP flexion [deg]"]) == pytest.approx(70, abs=0.01)
    assert row["left_index3 angles observed"] == "1" and row["left_hand angles observed"] == "0"


def test_amass_has_the_hands_of_smplh():
    file = BytesIO()
    write_amass(MOTION, file)
    with np.load(BytesIO(file.getvalue())) as data:
        assert data["poses"].shape == (len(data["trans"]), 156) and str(data["surface_model_type"]) == "smplh"
        assert np.array_equal(data["pose_hand"], data["poses"][:, 66:]) and data["pose_body"].shape[1] == 63
        hands = data["pose_hand"][0].reshape(2, 15, 3)
        assert data["angles_observed"].shape == (len(data["trans"]), 52)
    left = [np.radians(BENDS.get(f"{finger}{k}", (0, 0, 0))) for finger in ORDER for k in (1, 2, 3)]
    assert np.allclose(hands[0], left) and np.allclose(hands[1], np.array(left) * [1, -1, -1])


ORDER = ("index", "middle", "pinky", "ring", "thumb")


def test_bvh_is_the_same_tree_whose_fingers_end_along_themselves():
    file = BytesIO()
    write_bvh(MOTION, file)
    text = file.getvalue().decode()
    assert text.count("JOINT ") == COUNT - 1
    lines = text[text.index("JOINT left_index3") :].splitlines()
    offset, tip = (np.array(line.split()[1:], float) for line in (lines[2], lines[6]))
    assert np.cross(offset, tip) == pytest.approx(0, abs=1e-9) and offset @ tip > 0


def test_pictures_show_fingers_in_place_of_the_hand():
    found = {(SKELETON.joint_names[a], SKELETON.joint_names[b]) for a, b, _, _ in capsules(SKELETON)}
    assert ("left_wrist", "left_index1") in found and ("right_thumb2", "right_thumb3") in found
    assert not any(b.endswith("_hand") for _, b in found)
    body = Skeleton.load("anthropometric", 1.75)
    assert any(body.joint_names[b] == "left_hand" for _, b, _, _ in capsules(body))
