"""Skeletons of other programs: joint names, units, and kinds of files that are not read."""

import logging
import re

import numpy as np
import pytest

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.errors import LayoutError, SkeletonError
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings
from lassokin_ros.replay.exports.bvh import hierarchy
from lassokin_ros.skeleton_readers.load import load_skeleton
from lassokin_ros.skeleton_readers.naming import OWN_NAMES, REQUIRED, tables

HEIGHT = 1.8
OURS = Skeleton.load("anthropometric", HEIGHT)
FIRST_DATA = "MOTION\nFrames: 0\nFrame Time: 0.1\n"


def bvh(names, scale=1.0, prefix="", without=()):
    """The built-in skeleton as another program writes it.

    names: {our joint: its name}; other joints have names of no program. without: joints left out, whose children are
    attached to the joint above.
    """
    kept = [joint for joint in OURS.joint_names if joint not in without]
    parents, offsets = [], []
    for joint in kept:
        above = int(OURS.parents[OURS.index(joint)])
        while above >= 0 and OURS.joint_names[above] in without:
            above = int(OURS.parents[above])
        parents.append(kept.index(OURS.joint_names[above]) if above >= 0 else -1)
        start = OURS.rest_positions[above] if above >= 0 else OURS.rest_positions[0]
        offsets.append(scale * (OURS.rest_positions[OURS.index(joint)] - start))
    theirs = tuple(prefix + names.get(joint, f"other{number}") for number, joint in enumerate(kept))
    marked = tuple(name.replace(" ", "~") for name in theirs)  # our writer removes blanks
    skeleton = Skeleton("theirs", marked, tuple(parents), np.array(offsets), ("zxy",) * len(kept), HEIGHT)
    return hierarchy(skeleton).replace("~", " ") + FIRST_DATA


def written(tmp_path, text):
    (tmp_path / "theirs.bvh").write_text(text)
    return str(tmp_path / "theirs.bvh")


def check_places(skeleton, tolerance=1e-6):
    """Every joint of the skeleton has the position of the built-in skeleton."""
    assert set(REQUIRED) <= set(skeleton.joint_names)
    places = [OURS.index(joint) for joint in skeleton.joint_names]
    assert np.abs(skeleton.rest_positions - OURS.rest_positions[places]).max() < tolerance


@pytest.mark.parametrize("program", [name for name in tables() if name != OWN_NAMES])
def test_the_names_of_every_program_are_read(tmp_path, program):
    names = tables()[program]
    skeleton = load_skeleton(written(tmp_path, bvh(names, 100.0)), HEIGHT)
    check_places(skeleton)
    assert set(skeleton.joint_names) == set(names)


@pytest.mark.parametrize(
    "program, prefix, change",
    [
        ("mixamo", "mixamorig:", str),
        ("mixamo", "mixamorig1:", str),
        ("mixamo", "mixamorig", str),
        ("mixamo", "mixamorig_", str),
        ("mixamo", "Robot_", str),
        ("mixamo", "", str.upper),
        ("biped", "Bip01 ", str),
        ("biped", "Bip001_", lambda name: name.replace(" ", "_")),
        ("xsens", "", lambda name: re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)),
        ("cmu", "armature|", str.lower),
    ],
)
def test_prefixes_blanks_and_case_are_ignored(tmp_path, program, prefix, change):
    names = {joint: change(name) for joint, name in tables()[program].items()}
    check_places(load_skeleton(written(tmp_path, bvh(names, 100.0, prefix)), HEIGHT))


def test_a_missing_neck_or_pelvis_is_derived(tmp_path):
    text = bvh(tables()["mixamo"], 100.0, "mixamorig:", without=("neck",))
    check_places(load_skeleton(written(tmp_path, text), HEIGHT), 0.03)
    names = {**{joint: f"Bip01 {name}" for joint, name in tables()["biped"].items()}, "pelvis": "Bip01"}
    check_places(load_skeleton(written(tmp_path, bvh(names, 100.0)), HEIGHT))


def test_a_file_of_names_next_to_the_skeleton_is_used(tmp_path):
    names = {**tables()["mixamo"], "left_elbow": "Ellbogen links", "right_elbow": "Ellbogen rechts"}
    path = written(tmp_path, bvh(names, 100.0))
    with pytest.raises(SkeletonError) as raised:
        load_skeleton(path, HEIGHT)
    said = str(raised.value)
    assert "has the joint names of mixamo, but not LeftForeArm, RightForeArm; write their names" in said
    assert "to 'theirs.names.yaml' beside it, in lines such as 'left_elbow: NAME', 'right_elbow: NAME'" in said
    assert "its joints are: Hips, " in said and "Ellbogen links" in said and "\n" not in said
    (tmp_path / "theirs.names.yaml").write_text("left_elbow: Ellbogen links\nright_elbow: Ellbogen rechts\n")
    check_places(load_skeleton(path, HEIGHT))


def test_unknown_names_are_read_with_a_file_of_names(tmp_path):
    path = written(tmp_path, bvh({joint: f"j{number}" for number, joint in enumerate(OURS.joint_names)}, 100.0))
    with pytest.raises(LayoutError, match="has joint .*; none of the known programs .* 'theirs.names.yaml'"):
        Session(TrackerConfig(height=1.75, skeleton=path), NodeSettings())
    lines = [f"{joint}: j{OURS.index(joint)}\n" for joint in REQUIRED]
    (tmp_path / "theirs.names.yaml").write_text("".join(lines))
    check_places(load_skeleton(path, HEIGHT))
    for text, reason in (
        ("left_elbow: nix\n", "left_elbow is 'nix', which is no joint of"),
        ("elbow: j1\n", "has the key 'elbow', which is none of"),
        ("- 1\n", "holds list; expected a mapping"),
    ):
        (tmp_path / "theirs.names.yaml").write_text(text)
        with pytest.raises(SkeletonError, match=reason):
            load_skeleton(path, HEIGHT)


INCHES, FEET, DECIMETRES = 1 / 0.0254, 1 / 0.3048, 10.0


@pytest.mark.parametrize("scale, said", [(INCHES, "inches"), (FEET, "feet"), (DECIMETRES, "dm")])
@pytest.mark.parametrize("height", [1.65, 1.8, 2.0])
def test_the_unit_nearest_to_the_height_is_used_and_logged(tmp_path, caplog, scale, said, height):
    skeleton = load_skeleton(written(tmp_path, bvh(tables()["mixamo"], scale)), height)
    check_places(skeleton)
    assert f"theirs.bvh: lengths are read in {said}, which is nearest to height {height:.2f} m" in caplog.text


@pytest.mark.parametrize("scale", [1.0, 100.0, 1000.0])
@pytest.mark.parametrize("height", [1.65, 1.8, 2.0])
def test_metric_lengths_are_kept_without_a_warning(tmp_path, caplog, scale, height):
    check_places(load_skeleton(written(tmp_path, bvh(tables()["mixamo"], scale)), height))
    assert caplog.text == ""


@pytest.mark.parametrize("scale", [0.35, 17.7, 2.0, 1e-4, 1e5, 1 / 0.082, 1 / 0.018, 1 / 0.0125, 1 / 0.008, 1 / 0.8])
def test_a_body_in_an_unknown_unit_is_scaled_to_the_height(tmp_path, caplog, scale):
    caplog.set_level(logging.WARNING)
    check_places(load_skeleton(written(tmp_path, bvh(tables()["mixamo"], scale)), HEIGHT))
    assert "no unit makes a person of 1.80 m of it, so it is scaled to that height" in caplog.text


@pytest.mark.parametrize("height, scaled", [(1.61, False), (1.60, True), (2.01, False), (2.03, True)])
def test_a_body_of_another_size_than_the_height_is_scaled_with_the_height_that_keeps_it(
    tmp_path, caplog, height, scaled
):
    """More than 12 % from `height`, in centimetres, too: the unit may be another one."""
    skeleton = load_skeleton(written(tmp_path, bvh(tables()["mixamo"], 100.0)), height)
    length = np.linalg.norm(skeleton.offsets[skeleton.index("left_knee")])
    whole = np.linalg.norm(OURS.offsets[OURS.index("left_knee")])
    assert length / whole == pytest.approx(height / HEIGHT if scaled else 1.0, abs=0.01)
    assert ("to keep its lengths, set height to 1.80 (if they are in cm)" in caplog.text) is scaled


@pytest.mark.parametrize(
    "name, expected",
    [
        ("SMPL_NEUTRAL.pkl", "is a Python pickle, such as SMPL's model, and can run code, which is not read; unpack"),
        (
            "human.xacro",
            "is a xacro macro of a URDF, which is not read; expand it with: xacro model.xacro >",
        ),
        ("human.urdf.xacro", "expand it with: xacro"),
        ("walk.FBX", "is a 3D scene, which is not read; open it in Blender and export it as .bvh"),
        ("avatar.glb", "export it as .bvh"),
    ],
)
def test_files_of_other_kinds_are_named_with_their_conversion(tmp_path, name, expected):
    (tmp_path / name).write_bytes(b"\x80\x04K\x01.")
    with pytest.raises(SkeletonError) as raised:
        Session(TrackerConfig(height=1.75, skeleton=str(tmp_path / name)), NodeSettings())
    assert expected in str(raised.value) and "\n" not in str(raised.value)
