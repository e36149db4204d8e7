"""Skeletons from other programs' files: joints are read at their positions, and bad files are refused in one line."""

import re
import zipfile

import numpy as np
import pytest
from cases import random_body
from scipy.spatial.transform import Rotation

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.errors import SkeletonError
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.pipeline.outputs.saved_files import skeleton_text
from lassokin_ros.pipeline.outputs.urdf import urdf
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings
from lassokin_ros.replay.exports.bvh import hierarchy
from lassokin_ros.skeleton_readers import smpl
from lassokin_ros.skeleton_readers.load import load_skeleton
from lassokin_ros.skeleton_readers.naming import OWN_NAMES, ROOT_JOINTS, tables

BUILT_IN = Skeleton.load("anthropometric", 1.8)
VERTICES = 200


def same(a, b, tolerance=1e-8):
    assert a.joint_names == b.joint_names and a.axes == b.axes
    assert np.array_equal(a.parents, b.parents)
    assert np.abs(a.offsets - b.offsets).max() < tolerance


def smpl_like(path, shapes=3, **other):
    """An npz in SMPL's form that is not SMPL: random vertices, and joints that are weighted sums of them."""
    random = np.random.default_rng(1)
    joints = BUILT_IN.rest_positions + [0.01, -0.2, 0.03]  # SMPL's pelvis is not at the origin
    vertices = joints[random.integers(24, size=VERTICES)] + random.normal(size=(VERTICES, 3)) * 0.05
    # The least-norm weights that give these joints and sum to one.
    with_ones = np.hstack([vertices, np.ones((VERTICES, 1))])
    regressor = np.linalg.pinv(with_ones.T) @ np.vstack([joints.T, np.ones(24)])
    arrays = {
        "J_regressor": regressor.T,
        "v_template": vertices,
        "shapedirs": random.normal(size=(VERTICES, 3, shapes)) * 0.01,
        **other,
    }
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})
    return arrays


def test_an_smpl_file_gives_the_models_joints(tmp_path):
    smpl_like(tmp_path / "model.npz")
    for height in (1.5, 1.8):  # the model's lengths are in metres
        skeleton = load_skeleton(str(tmp_path / "model.npz"), height)
        same(skeleton, BUILT_IN)
        assert skeleton.height == height and skeleton.name == "model"


def test_the_shape_in_an_smpl_file_is_used(tmp_path):
    betas = np.array([1.5, -2.0])
    arrays = smpl_like(tmp_path / "model.npz", betas=betas)
    skeleton = load_skeleton(str(tmp_path / "model.npz"), 1.8)
    moved = arrays["v_template"] + betas[0] * arrays["shapedirs"][:, :, 0] + betas[1] * arrays["shapedirs"][:, :, 1]
    joints = arrays["J_regressor"] @ moved
    assert np.abs(skeleton.rest_positions - (joints - joints[0])).max() < 1e-9
    assert np.abs(skeleton.rest_positions - BUILT_IN.rest_positions).max() > 1e-3


BAD_SMPL = {
    "sparse": ({"J_regressor": np.array({"a": 1}, dtype=object)}, "'J_regressor' is a pickled object .*docs/files.md"),
    "none": ({"J_regressor": None}, "has no array 'J_regressor'; see docs/files.md"),
    "joints": (
        {"J_regressor": np.zeros((55, VERTICES))},
        r"J_regressor has the shape \(55, 200\); expected \(24, 200\)",
    ),
    "vertices": ({"v_template": np.zeros((3, VERTICES))}, r"v_template has the shape \(3, 200\); expected \(V, 3\)"),
    "empty": ({"v_template": np.zeros((0, 3))}, r"v_template has the shape \(0, 3\)"),
    "text": ({"v_template": np.array(["a", "b"])}, "'v_template' holds <U1; expected numbers"),
    "not finite": ({"v_template": np.full((VERTICES, 3), np.nan)}, "'v_template' has values that are not finite"),
    "betas": ({"betas": np.ones(4)}, r"4 betas, but shapedirs of the shape \(200, 3, 3\)"),
    "no shapes": ({"betas": np.ones(2), "shapedirs": None}, "2 betas, but no shapedirs"),
    "no body": ({"v_template": np.ones((VERTICES, 3))}, "a body 0.00 m along y"),
    "centimetres": ({"v_template": 100 * np.eye(VERTICES, 3)}, "expected SMPL's template, in metres"),
}


@pytest.mark.parametrize("case", sorted(BAD_SMPL))
def test_bad_smpl_files_are_refused(tmp_path, case):
    change, text = BAD_SMPL[case]
    smpl_like(tmp_path / "model.npz", **change)
    with pytest.raises(SkeletonError, match=text) as raised:
        load_skeleton(str(tmp_path / "model.npz"), 1.8)
    assert "\n" not in str(raised.value)


def test_damaged_npz_files_are_refused(tmp_path):
    path = tmp_path / "model.npz"
    smpl_like(path)
    whole = path.read_bytes()
    random = np.random.default_rng(0)
    for cut in (0, 10, len(whole) // 2, len(whole) - 10):
        path.write_bytes(whole[:cut])
        with pytest.raises(SkeletonError):
            load_skeleton(str(path), 1.8)
    for attempt in range(80):
        damaged = bytearray(whole)
        for place in random.integers(len(whole) if attempt % 2 else 300, size=20):  # headers are in the first bytes
            damaged[place] = random.integers(256)
        path.write_bytes(bytes(damaged))
        try:
            load_skeleton(str(path), 1.8)  # with a changed digit it may still be a person
        except SkeletonError:
            pass


@pytest.mark.parametrize("member", ["J_regressor.npy", "J_regressor"])
def test_an_array_of_absurd_size_is_not_read(tmp_path, monkeypatch, member):
    monkeypatch.setattr(smpl, "LARGEST_BYTES", 2**20)
    with zipfile.ZipFile(tmp_path / "model.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(member, bytes(2**20 + 1))
    with pytest.raises(SkeletonError, match="'J_regressor' has more than 1 MB"):
        load_skeleton(str(tmp_path / "model.npz"), 1.8)


def test_npz_members_that_are_no_arrays_are_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "model.npz", "w") as archive:
        archive.writestr("J_regressor.npy", b"no array")
    with pytest.raises(SkeletonError, match="'J_regressor' is no numpy array; see docs/files.md"):
        load_skeleton(str(tmp_path / "model.npz"), 1.8)


def test_a_written_urdf_is_read_back_as_the_same_skeleton(tmp_path):
    for number, skeleton in enumerate([BUILT_IN, *(random_body(np.random.default_rng(i)).skeleton for i in range(5))]):
        path = tmp_path / f"{number}.urdf"
        path.write_text(urdf(skeleton, "camera", prefix="p1_" if number % 2 else ""))
        same(load_skeleton(str(path), 1.8), skeleton)


def test_a_written_bvh_is_read_back_as_the_same_skeleton(tmp_path):
    fingers = {"name": "left_finger", "parent": "left_hand", "position": [0.99, 0.4, 0.0], "axes": "zyx"}
    path = tmp_path / "body.bvh"
    for skeleton in (BUILT_IN, with_joint(BUILT_IN, fingers)):
        path.write_text(hierarchy(skeleton) + "MOTION\nFrames: 0\nFrame Time: 0.1\n")
        for height in (1.7, 1.8):
            same(load_skeleton(str(path), height), skeleton)


def test_names_may_have_a_namespace(tmp_path):
    """As written by a program that opened our BVH file under a name."""
    path = tmp_path / "body.bvh"
    names = re.sub(r"(ROOT|JOINT) ", r"\1 rig:", hierarchy(BUILT_IN))
    path.write_text(f"{names}MOTION\nFrames: 0\nFrame Time: 0.1\n")
    same(load_skeleton(str(path), 1.8), BUILT_IN)


def with_joint(skeleton, joint):
    tree = zip(skeleton.joint_names, skeleton.parents, skeleton.rest_positions.tolist(), skeleton.axes)
    joints = [
        {"name": name, "parent": skeleton.joint_names[parent] if parent >= 0 else None, "position": place, "axes": axes}
        for name, parent, place, axes in tree
    ]
    return Skeleton.from_mapping({"height_unit": "metre", "joints": [*joints, joint]}, skeleton.height)


def renamed_bvh(program, scale=1.0, turn=np.eye(3)):
    """The built-in skeleton as another program writes it: its names, unit and axes, all rotations in its order."""
    names = tables()[program]
    offsets = np.where(np.arange(24)[:, None] == 0, [[3.0, 90.0, 4.0]], scale * BUILT_IN.offsets @ turn.T)
    other = Skeleton(
        "other",
        tuple(names[joint] for joint in BUILT_IN.joint_names),
        BUILT_IN.parents,
        offsets,
        ("zyx",) * 24,
        1.8,
    )
    return hierarchy(other) + "MOTION\nFrames: 1\nFrame Time: 0.1\n0 0 0\n"


def test_the_bvh_of_another_program_is_read_in_other_axes(tmp_path):
    path = tmp_path / "theirs.bvh"
    path.write_text(renamed_bvh("smpl", turn=Rotation.from_euler("xyz", [90, 0, 90], degrees=True).as_matrix()))
    for height in (1.7, 1.8):
        same(load_skeleton(str(path), height), BUILT_IN, 1e-6)


def test_a_byte_order_mark_is_skipped(tmp_path):
    for suffix, text in ((".bvh", renamed_bvh("mixamo")), (".yaml", skeleton_text(BUILT_IN))):
        plain, marked = tmp_path / f"plain{suffix}", tmp_path / f"marked{suffix}"
        plain.write_text(text, encoding="utf-8")
        marked.write_text(text, encoding="utf-8-sig")
        assert np.array_equal(load_skeleton(str(marked), 1.8).offsets, load_skeleton(str(plain), 1.8).offsets)


def test_hanging_arms_and_splayed_legs_become_a_t_pose(tmp_path):
    """Lengths are kept; feet and hands rotate with their limbs."""
    rest = BUILT_IN.rest_positions.copy()
    for joint, degrees in (("left_shoulder", -70), ("right_shoulder", 70), ("left_hip", 20), ("right_hip", -20)):
        top = BUILT_IN.index(joint)
        below = BUILT_IN.ancestors[:, top] & (np.arange(24) != top)
        turn = Rotation.from_euler("z", degrees, degrees=True).as_matrix()
        rest[below] = rest[top] + (rest[below] - rest[top]) @ turn.T
    offsets = rest - rest[np.maximum(BUILT_IN.parents, 0)]
    path = tmp_path / "a_pose.bvh"
    path.write_text(hierarchy(BUILT_IN.with_offsets(offsets)) + "MOTION\n")
    same(load_skeleton(str(path), 1.8), BUILT_IN, 1e-6)


def test_a_skeleton_without_hands_or_collars_is_read(tmp_path):
    text = renamed_bvh("mixamo", 100.0).replace("LeftHandMiddle1", "Whatever").replace("LeftShoulder", "Other")
    path = tmp_path / "theirs.bvh"
    path.write_text(text)
    skeleton = load_skeleton(str(path), 1.8)
    assert set(BUILT_IN.joint_names) - set(skeleton.joint_names) == {"left_hand", "left_collar"}
    assert skeleton.joint_names[skeleton.parents[skeleton.index("left_shoulder")]] == "spine3"
    here = [BUILT_IN.index(joint) for joint in skeleton.joint_names]
    assert np.abs(skeleton.rest_positions - BUILT_IN.rest_positions[here]).max() < 1e-6


@pytest.mark.parametrize("program", ["smpl", OWN_NAMES])
def test_the_urdf_of_another_program_is_read(tmp_path, program):
    """Links with z up and x to the front as on robots, joints rotated at rest, names of SMPL or ours."""
    to_robot = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])  # our axes as columns
    names = tables()[program]
    random = np.random.default_rng(0)
    frames = Rotation.from_rotvec(random.normal(size=(24, 3)))  # each link's own, in the root's
    text = ['<robot name="human"><link name="base"/>']
    for joint, (name, parent) in enumerate(zip(BUILT_IN.joint_names, BUILT_IN.parents)):
        above = frames[parent] if parent >= 0 else Rotation.identity()
        xyz = above.inv().apply(to_robot @ BUILT_IN.offsets[joint])
        rpy = (above.inv() * frames[joint]).as_euler("xyz")
        link = names[BUILT_IN.joint_names[parent]] if parent >= 0 else "base"
        text.append(
            f'<link name="{names[name]}"/><joint name="j{joint}" type="floating"><parent link="{link}"/>'
            f'<child link="{names[name]}"/><origin xyz="{" ".join(map(repr, xyz.tolist()))}" '
            f'rpy="{" ".join(map(repr, rpy.tolist()))}"/></joint>'
        )
    path = tmp_path / "human.urdf"
    path.write_text("".join([*text, "</robot>"]))
    same(load_skeleton(str(path), 1.7), BUILT_IN, 1e-6)


LINK = '<joint name="{0}" type="fixed"><parent link="{1}"/><child link="{2}"/>{3}</joint>'
BOMB = '<!DOCTYPE r [<!ENTITY a "aaaaaaaa"><!ENTITY b "&a;&a;&a;">]><robot name="&b;"></robot>'
BAD_URDF = {
    "no XML": ("robot", "is no valid XML: syntax error"),
    "another root": ("<sdf/>", "its root is <sdf>; expected <robot>"),
    "entities": (BOMB, "has a document type"),
    "outside": ('<!DOCTYPE r SYSTEM "http://localhost/x"><robot name="a"/>', "has a document type"),
    "no joints": ("<robot name='a'/>", "0 root links"),
    "a loop": (f"<robot>{LINK.format('j', 'a', 'b', '')}{LINK.format('k', 'b', 'a', '')}</robot>", "0 root links"),
    "twice": (
        f"<robot>{LINK.format('j', 'a', 'b', '')}{LINK.format('k', 'c', 'b', '')}</robot>",
        "'b' is the child of two",
    ),  # noqa: E501
    "a robot": (f"<robot>{LINK.format('j', 'a', 'b', '')}</robot>", "has none of the known link names"),
    "numbers": (
        "<robot>" + LINK.format("j", "a", "b", '<origin xyz="1 2 x"/>') + "</robot>",
        "joint 'j' has '1 2 x'; expected three finite numbers",
    ),
    "the root alone": (
        "<robot>" + "".join(LINK.format(j, f"l{i}", f"l{i + 1}", "") for i, j in enumerate(ROOT_JOINTS)) + "</robot>",
        "has only the joints of the root",
    ),
    "too long": ("<robot>" + " " * 1_000_000, "is too long; expected at most 1000000 characters"),
    "lacking": ("<robot><joint name='j'/></robot>", "joint 'j' lacks a name, parent or child"),
}
HEAD = "HIERARCHY\nROOT a\n{\n"
BAD_BVH = {
    "empty": ("", "is no BVH file"),
    "no motion": (HEAD + "}", "is no BVH file; expected HIERARCHY at its beginning and MOTION behind"),
    "open": (HEAD + "OFFSET 0 0 0\nMOTION", "its HIERARCHY is broken"),
    "word": (HEAD + "OFSET 0 0 0\n}\nMOTION", "'OFSET' in HIERARCHY"),
    "number": (HEAD + "OFFSET 0 0\n}\nMOTION", "its HIERARCHY is broken near joint a"),
    "not finite": (HEAD + "OFFSET 0 0 0 JOINT b { OFFSET 0 nan 0 } }\nMOTION", "an OFFSET is not finite"),
    "two roots": (HEAD + "}\nROOT b { }\nMOTION", "expected one ROOT"),
    "channels": (HEAD + "CHANNELS 99999999999 a }\nMOTION", "its HIERARCHY is broken"),
    "too many": (HEAD + "JOINT b { " * 2000 + "\nMOTION", "has more than 1000 joints"),
    "no person": (
        HEAD + "OFFSET 0 0 0 JOINT b { OFFSET 0 30 0 } }\nMOTION",
        "30 units large, which is no person in m,",
    ),
    "half a person": (
        renamed_bvh("mixamo").replace("RightForeArm", "x"),
        "has the joint names of mixamo, but not Right",
    ),
    "no hips": (
        renamed_bvh("mixamo").replace("0.109800000 -0.106", "0.0 -0.106").replace("-0.0 ", "0 "),
        "on one spot",
    ),
}
BAD_FILES = [(".urdf", name, *case) for name, case in BAD_URDF.items()]
BAD_FILES += [(".bvh", name, *case) for name, case in BAD_BVH.items()]


@pytest.mark.parametrize("suffix, name, text, message", BAD_FILES, ids=lambda value: str(value)[:20])
def test_bad_files_are_refused_in_one_line(tmp_path, suffix, name, text, message):
    path = tmp_path / f"bad{suffix}"
    path.write_text(text)
    with pytest.raises(SkeletonError, match=re.escape(message)) as raised:
        load_skeleton(str(path), 1.8)
    assert "\n" not in str(raised.value) and str(raised.value).startswith(str(path))


def test_a_missing_file_is_refused(tmp_path):
    for suffix in (".npz", ".bvh", ".urdf"):
        with pytest.raises(SkeletonError, match="there is no skeleton file"):
            load_skeleton(str(tmp_path / f"nix{suffix}"), 1.8)


def test_the_core_names_the_reader_of_the_file(tmp_path):
    smpl_like(tmp_path / "model.npz")
    config = TrackerConfig(height=1.75, skeleton=str(tmp_path / "model.npz"))
    with pytest.raises(SkeletonError, match="reads skeletons from YAML only; .* give it to Tracker"):
        Tracker(config)
    assert Tracker(config, load_skeleton(config.skeleton, config.height)).skeleton.name == "model"


def test_node_and_replay_read_a_skeleton_file(tmp_path):
    smpl_like(tmp_path / "model.npz")
    config = TrackerConfig(height=1.75, skeleton=str(tmp_path / "model.npz"))
    session = Session(config, NodeSettings(max_people=2))
    same(session.tracker.skeleton, BUILT_IN)


def test_node_and_replay_refuse_a_skeleton_without_a_valid_urdf(tmp_path):
    """As it may be in a BVH file with its own names."""
    (tmp_path / "own.yaml").write_text(skeleton_text(BUILT_IN).replace('"pelvis"', '"root"'))
    with pytest.raises(SkeletonError, match="two joints of its URDF would be called 'root_x'"):
        Session(TrackerConfig(height=1.75, skeleton=str(tmp_path / "own.yaml")), NodeSettings())
