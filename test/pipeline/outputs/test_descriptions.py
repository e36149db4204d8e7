"""Names of topics and links, and the URDF of a small body, worked out by hand."""

from dataclasses import replace
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
from description_check import DescribedBody
from detector_messages import backend as detector_backend
from messages import rosbags_backend

from benchmarks.common.report import data_folder
from benchmarks.data.mocap import load_clip, true_state
from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.errors import SkeletonError
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.outputs.body_frames import Naming
from lassokin_ros.pipeline.outputs.frame_messages import id_list
from lassokin_ros.pipeline.outputs.robot_description import (
    LARGEST_ERROR,
    RobotDescription,
    farthest_move,
    urdf_from_settings,
)
from lassokin_ros.pipeline.outputs.saved_files import (
    check_skeleton_file,
    for_person,
)
from lassokin_ros.pipeline.outputs.urdf import RANGES, has_prefix, joint_names, range_of, urdf
from lassokin_ros.pipeline.people.joint_angles import JointAngleReader
from lassokin_ros.pipeline.settings import NodeSettings
from lassokin_ros.skeleton_readers import urdf as urdf_reader

BACKEND = rosbags_backend()


def small(**changes):
    """pelvis - left_hip - head, and one bone without length."""
    offsets = np.array([[0.0, 0, 0], [0.3, 0, -0.4], [0, 0.1, 0], [0, 0, 0]])
    names = ("pelvis", "left_hip", "head", "stub")
    given = Skeleton("small", names, np.array([-1, 0, 1, 0]), offsets, ("xzy", "zyx", "yxz", "xyz"), 2.0)
    return replace(given, **changes)


def test_topics_of_persons():
    assert topics.of_person("~/joints", "") == "~/joints"
    assert topics.of_person("~/joints", "p1") == "~/bodies/p1/joints"
    assert topics.of_person("~/joints", "p1", rep155=True) == "/humans/bodies/p1/joints"
    assert topics.of_person("~/robot_description", "p1", rep155=True) == "/humans/bodies/p1/urdf"
    assert topics.of_person("~/robot_description", "p1") == "~/bodies/p1/robot_description"
    assert topics.of_person("/tf", "p1") == "/tf"


def test_full_names_and_prefixes():
    assert topics.full_name("~/joints", "robot/tracker") == "/robot/tracker/joints"
    assert topics.full_name("/tf", "tracker") == "/tf" and topics.full_name("keypoints", "tracker") == "/keypoints"
    assert [
        Naming.of_person(NodeSettings(frame_prefix=prefix), "a/b", person).prefix
        for prefix, person in (("~/", ""), ("", ""), ("~/", "p1"))
    ] == ["a/b/", "", "a/b/p1/"]
    assert topics.people_output("a/msg/B") == topics.OutputTopic("~/people", "a/msg/B", False)


def test_latched_topics():
    outputs = (*topics.PERSON_OUTPUTS, *topics.OTHER_OUTPUTS, topics.TRACKED_OUTPUT, topics.TF)
    assert {output.name for output in outputs if output.latched} == {
        "~/robot_description",
        "~/state",
        "~/bodies/tracked",
    }


def test_the_joints_of_the_urdf_are_a_chain_for_each_ball_joint():
    root = ElementTree.fromstring(urdf(small(), "camera", "me/"))
    assert root.get("name") == "small"
    joints = {joint.get("name"): joint for joint in root.iter("joint")}
    assert list(joints)[:3] == ["root_x", "root_y", "root_z"] and sorted(joints) == sorted(joint_names(small()))

    def of(name):
        joint = joints[name]
        ends = joint.find("parent").get("link"), joint.find("child").get("link")
        return (*ends, joint.get("type"), joint.find("axis").get("xyz"), joint.find("origin").get("xyz"))

    zero = "0 0 0"
    assert of("root_x") == ("camera", "me/root_x_link", "prismatic", "1 0 0", zero)
    assert of("root_z") == ("me/root_y_link", "me/root_z_link", "prismatic", "0 0 1", zero)
    assert of("pelvis_x") == ("me/root_z_link", "me/pelvis_x_link", "revolute", "1 0 0", zero)
    assert of("pelvis_z") == ("me/pelvis_x_link", "me/pelvis_z_link", "revolute", "0 0 1", zero)
    assert of("pelvis_y") == ("me/pelvis_z_link", "me/pelvis", "revolute", "0 1 0", zero)
    assert of("left_hip_z") == ("me/pelvis", "me/left_hip_z_link", "revolute", "0 0 1", "0.3 0 -0.4")
    assert of("left_hip_x") == ("me/left_hip_y_link", "me/left_hip", "revolute", "1 0 0", zero)
    assert of("head_y")[0] == "me/left_hip" and of("head_y")[4] == "0 0.1 0"
    for name, joint in joints.items():
        limit, reach = joint.find("limit"), "1000" if name.startswith("root") else "628.319"
        if name.startswith(("root", "pelvis", "stub")):  # the others have a range of motion
            assert (limit.get("lower"), limit.get("upper")) == (f"-{reach}", reach)
        assert (limit.get("effort"), limit.get("velocity")) == ("1000", "1000")
        assert joint.find("origin").get("rpy") == zero


def test_the_limits_are_those_of_people():
    built_in = Skeleton.load("anthropometric", 1.75)
    root = ElementTree.fromstring(urdf(built_in, "camera"))
    limits = {
        joint.get("name"): tuple(float(joint.find("limit").get(end)) for end in ("lower", "upper"))
        for joint in root.iter("joint")
    }
    assert np.allclose(np.degrees(limits["left_knee_x"]), [-10, 145], atol=1e-3) and limits["pelvis_y"][1] > 600
    assert np.allclose(np.degrees(limits["right_hip_x"]), [-130, 40], atol=1e-3)
    for name, (low, high) in limits.items():
        assert low <= 0 <= high, name  # the T-pose
        if name.startswith("left"):
            other = limits[name.replace("left", "right")]
            assert (low, high) == (other if name.endswith("x") else (-other[1], -other[0])), name
    degrees = {  # sitting with a hand at the mouth, arms down, a step
        "left_hip_x": -95, "left_knee_x": 100, "right_hip_x": 20, "right_hip_z": -30, "left_elbow_y": -140,
        "right_elbow_y": 140, "left_shoulder_z": -80, "right_shoulder_z": 80, "left_shoulder_y": -90, "spine1_x": 25,
    }  # fmt: skip
    assert all(limits[name][0] < np.radians(angle) < limits[name][1] for name, angle in degrees.items())
    impossible = {"left_knee_x": -40, "left_elbow_y": 30, "right_elbow_y": -30, "right_knee_x": 170, "neck_y": 100}
    assert not any(limits[name][0] < np.radians(angle) < limits[name][1] for name, angle in impossible.items())


def shapes(root, link):
    """(kind, sizes, xyz, rpy, material) of each shape of a link."""
    (found,) = (one for one in root.iter("link") if one.get("name") == link)
    for visual in found.iter("visual"):
        (shape,) = visual.find("geometry")
        origin = visual.find("origin")
        sizes = {name: float(value) for name, value in shape.attrib.items()}
        places = [np.array(origin.get(key).split(), dtype=float) for key in ("xyz", "rpy")]
        yield shape.tag, sizes, *places, visual.find("material").get("name")


def test_the_shapes_of_the_urdf():
    root = ElementTree.fromstring(urdf(small(), "camera"))
    ball, rod = shapes(root, "pelvis")  # the bone without length has no rod
    assert ball[:2] == ("sphere", {"radius": 0.04}) and not ball[2].any() and ball[4] == "middle"
    assert rod[0] == "cylinder" and rod[1] == pytest.approx({"radius": 0.05, "length": 0.5})  # the thickest
    assert (
        rod[2] == pytest.approx([0.15, 0, -0.2])
        and rod[3] == pytest.approx([0, np.arccos(-0.8), 0])
        and rod[4] == "left"
    )
    ball, rod = shapes(root, "left_hip")
    assert ball[4] == "left" and rod[4] == "middle"
    assert rod[1] == pytest.approx({"radius": 0.016, "length": 0.1})  # the thinnest
    assert rod[3] == pytest.approx([0, np.pi / 2, np.pi / 2])
    joint, skull = shapes(root, "head")
    assert skull[1] == pytest.approx({"radius": 0.11}) and skull[2] == pytest.approx([0, 0.09, 0.04])
    assert [material.get("name") for material in root.findall("material")] == ["left", "right", "middle"]
    (rod,) = [s for s in shapes(ElementTree.fromstring(urdf(small().scaled(0.5), "c")), "pelvis") if s[0] == "cylinder"]
    assert rod[1] == pytest.approx({"radius": 0.025, "length": 0.25})
    middle = small(offsets=np.array([[0.0, 0, 0], [0, 0, 0.3], [0, 0.1, 0], [0, 0, 0]]))
    assert list(shapes(ElementTree.fromstring(urdf(middle, "c")), "pelvis"))[1][1]["radius"] == pytest.approx(0.036)


def test_each_urdf_of_one_tree_has_its_own_sizes():
    lengths = []
    for length in (0.5, 0.25, 0.0):
        bones = np.array([[0.0, 0, 0], [0.0, 0, length], [0, 0.1, 0], [0, 0, 0]])
        root = ElementTree.fromstring(urdf(small(offsets=bones), "camera"))
        lengths.append([float(bone.get("length")) for bone in root.iter("cylinder")])
    assert lengths == [[0.5, 0.1], [0.25, 0.1], [0.1]]
    with pytest.raises(SkeletonError, match="NUL"):
        urdf(small(joint_names=("pelvis", "left\0hip", "head", "stub")), "camera")


def test_a_urdf_knows_its_prefix():
    text = urdf(small(), "camera", "me/")
    assert has_prefix(text, "me/") and not has_prefix(text, "") and not has_prefix("<robot", "me/")


def test_the_description_follows_base_frame_and_lengths():
    description = RobotDescription(BACKEND, small(), "fallback", Naming(prefix="me/"))

    def frame(skeleton=None, frame_id="camera"):
        return SimpleNamespace(skeleton=skeleton, frame_id=frame_id)

    assert description.first().data == urdf(small(), "fallback", "me/")
    assert description.follow(frame(frame_id="")) is None
    given = small()
    assert description.follow(frame(given)).data == urdf(small(), "camera", "me/")
    assert description.follow(frame(given)) is None and description.follow(frame(frame_id="")) is None
    near = small(offsets=given.offsets + [0, 0, 0.2 * LARGEST_ERROR])
    assert description.follow(frame(near)) is None  # three bones in a row are 0.6 of the error off
    far = small(offsets=given.offsets + [0, 0, 0.5 * LARGEST_ERROR])
    assert description.follow(frame(far)).data == urdf(far, "camera", "me/")
    assert description.follow(frame(given)).data == urdf(given, "camera", "me/")  # and back
    with pytest.raises(SkeletonError, match="base frame is 'me/head'"):
        description.follow(frame(given, "me/head"))
    assert description.follow(frame(given, "me/head")) is None  # reported once


def test_how_far_a_joint_moves_with_other_lengths():
    longer = small().offsets + [[0, 0, 0], [0.01, 0, 0], [0, 0.02, 0], [0, 0, 0.005]]
    assert farthest_move(small(), small(offsets=longer)) == pytest.approx(0.03)
    assert farthest_move(small(), small()) == 0


def test_the_urdf_from_the_settings():
    settings = NodeSettings(fixed_frame="map", frame_prefix="~/x/")
    text = urdf_from_settings(TrackerConfig(height=1.6), settings, "robot/tracker")
    assert text == urdf(Skeleton.load("anthropometric", 1.6), "map", "robot/tracker/x/")
    assert has_prefix(urdf_from_settings(TrackerConfig(height=1.75), NodeSettings()), "tracker/")


def test_the_list_of_people_is_text_or_rep155s_message():
    text = id_list(BACKEND, False)
    assert text(5, "camera", ["p1", "p2"]).data == "p1,p2" and text(5, "camera", []).data == ""
    message = id_list(detector_backend(), True)(5_000_000_001, "camera", ["p1", "p2"])
    assert message.ids == ["p1", "p2"]
    assert (message.header.stamp.sec, message.header.stamp.nanosec, message.header.frame_id) == (5, 1, "camera")


def test_names_of_skeleton_files(tmp_path, monkeypatch):
    path = tmp_path / "me.yaml"
    assert for_person(path, "p1") == tmp_path / "me_p1.yaml" and for_person(path, "") == path
    assert for_person(path.parent / "", "") == path.parent
    check_skeleton_file(path, False, False)
    check_skeleton_file(tmp_path / "no" / "me.YML", True, False)
    with pytest.raises(SkeletonError, match="is no name for a skeleton; expected one that ends in .yaml or .yml"):
        check_skeleton_file(tmp_path / "me.bvh", False, True)
    (tmp_path / "me_p1.yaml").touch()
    check_skeleton_file(path, False, False)
    with pytest.raises(SkeletonError, match="me_p1.yaml"):
        check_skeleton_file(path, True, False)
    check_skeleton_file(path, True, True)
    path.touch()
    monkeypatch.setenv("HOME", str(tmp_path))
    for name in (path, type(path)("~/me.yaml")):
        with pytest.raises(SkeletonError, match="me.yaml"):
            check_skeleton_file(name, False, False)
        check_skeleton_file(name, False, True)


SKELETON = Skeleton.load("body_hands", 1.75)
BENT = {"index1": (0, 0.2, -1.2), "index2": (0, 0, -1.6), "ring3": (0, 0, -1.0), "thumb1": (0.5, 0.4, 0.1)}
BENT |= {"thumb3": (0, 1.0, 0), "wrist": (0, 0.2, -0.8)}


@pytest.fixture(scope="module")
def pose():
    """Rotations (54, 3, 3) and positions (54, 3) of a body with bent fingers, and its angles (54, 3)."""
    vectors = np.zeros((54, 3))
    for part, vector in BENT.items():
        vectors[SKELETON.index(f"left_{part}")] = vector
        vectors[SKELETON.index(f"right_{part}")] = np.array(vector) * [1, -1, -1]
    vectors[0] = np.pi, 0, 0
    rotations = exponential(vectors)
    body = Kinematics(SKELETON, Layout.load("mediapipe75", SKELETON))
    positions = body.pose(BodyState(rotations, np.array([0.1, 0.2, 2.5]))).positions
    return positions, JointAngleReader(SKELETON.axes).read(rotations)


def test_the_urdf_is_read_back_as_the_same_tree():
    again = urdf_reader.parse(urdf(SKELETON, "camera", "person/"), "robot_description", height=1.75)
    assert again.joint_names == SKELETON.joint_names and again.axes == SKELETON.axes
    assert np.allclose(again.offsets, SKELETON.offsets, atol=1e-9)


def test_the_urdf_is_driven_by_the_joint_states(pose):
    positions, angles = pose
    state = SimpleNamespace(
        name=joint_names(SKELETON),
        position=np.array([0.1, 0.2, 2.5, *angles.reshape(-1)]),
    )
    assert np.allclose(DescribedBody(urdf(SKELETON, "camera", "person/")).positions(state), positions, atol=1e-6)


def test_locked_axes_have_a_range_about_zero_and_bends_lie_inside(pose):
    for joint, name in enumerate(SKELETON.joint_names[24:], 24):
        for axis, letter in enumerate("xyz"):
            low, high = range_of(name, letter)
            if 3 * joint + axis in SKELETON.locked:
                assert high == pytest.approx(-low) and high < 0.2
            assert low <= pose[1][joint, axis] <= high, (name, letter)


CLIPS = sorted((data_folder() / "corpus").glob("*.npz"))[::18]


def test_sides_are_mirrored_and_other_joints_have_no_range():
    low, high = range_of("left_hip", "z")
    assert range_of("right_hip", "z") == (-high, -low) and range_of("right_hip", "x") == range_of("left_hip", "x")
    assert range_of("pelvis", "x") is None and range_of("tail", "y") is None and range_of("left_wing", "y") is None
    assert all(low <= high for ranges in RANGES.values() for low, high in ranges.values())


@pytest.mark.skipif(not CLIPS, reason=f"there is no motion capture in {data_folder() / 'corpus'}")
def test_recorded_angles_lie_within_the_limits():
    """Over all angles of 30 clips; feet and wrists of motion capture hardly move."""
    skeleton = Skeleton.load("anthropometric", 1.75)
    kinematics = Kinematics(skeleton, Layout.load("coco17", skeleton))
    angles = []
    for clip in CLIPS:
        for rotations in true_state(load_clip(clip), kinematics).rotations[::10]:
            angles.append(JointAngleReader(skeleton.axes).read(rotations))
    found = np.array(angles)
    inside = {}
    for joint, name in enumerate(skeleton.joint_names):
        for axis, letter in enumerate("xyz"):
            if (limits := range_of(name, letter)) is not None:
                values = found[:, joint, axis]
                inside[f"{name}_{letter}"] = np.mean((limits[0] <= values) & (values <= limits[1]))
    assert len(found) > 500 and np.mean(list(inside.values())) > 0.98, inside
    sure = [name for name in inside if "ankle" not in name and "collar" not in name]
    assert min(inside[name] for name in sure) > 0.9, inside
