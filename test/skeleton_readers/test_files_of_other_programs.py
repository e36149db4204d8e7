"""Skeletons as other programs write them: units, joint names, and files of other kinds."""

import re

import numpy as np
import pytest

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import SkeletonError
from lassokin_ros.skeleton_readers.load import CONVERT, load_skeleton
from lassokin_ros.skeleton_readers.naming import tables

HEIGHT = 1.8
BUILT_IN = Skeleton.load("anthropometric", HEIGHT)


def bvh(names, scale=1.0, without=()):
    """Write the built-in skeleton with other joint names {our joint: name}; joints without a name are left out."""
    names = {joint: name for joint, name in names.items() if joint not in without}

    def block(joint, parent):
        place = BUILT_IN.rest_positions[joint] - (0 if parent is None else BUILT_IN.rest_positions[parent])
        children = [child for child in range(24) if above(child) == joint]
        word = "ROOT" if parent is None else "JOINT"
        offset = " ".join(f"{value:.9f}" for value in scale * place)
        inside = "".join(block(child, joint) for child in children) or "End Site\n{\nOFFSET 0 1 0\n}\n"
        channels = "CHANNELS 3 Zrotation Xrotation Yrotation"
        return f"{word} {names[BUILT_IN.joint_names[joint]]}\n{{\nOFFSET {offset}\n{channels}\n{inside}}}\n"

    def above(joint):
        joint = BUILT_IN.parents[joint] if BUILT_IN.joint_names[joint] in names else -2
        while joint > 0 and BUILT_IN.joint_names[joint] not in names:
            joint = BUILT_IN.parents[joint]
        return joint

    return "HIERARCHY\n" + block(0, None) + "MOTION\nFrames: 0\nFrame Time: 0.1\n"


def loaded(tmp_path, text, height=HEIGHT):
    path = tmp_path / "theirs.bvh"
    path.write_text(text)
    return load_skeleton(str(path), height)


def same_where_named(skeleton, tolerance=1e-6):
    here = [BUILT_IN.index(joint) for joint in skeleton.joint_names]
    assert np.abs(skeleton.rest_positions - BUILT_IN.rest_positions[here]).max() < tolerance


@pytest.mark.parametrize("height", [1.6, 1.8, 2.0])
@pytest.mark.parametrize("units_per_metre, word", [(1, ""), (100, ""), (1000, ""), (1 / 0.0254, "inches")])
def test_the_unit_is_the_one_nearest_to_the_height(tmp_path, caplog, units_per_metre, word, height):
    skeleton = loaded(tmp_path, bvh(tables()["mixamo"], units_per_metre), height)
    same_where_named(skeleton)  # lengths in a known unit stay as they are
    assert len(caplog.records) == bool(word) and word in caplog.text


@pytest.mark.parametrize("units_per_metre", [1 / 0.3048, 17.7, 10.0, 0.1, 4321.0])
def test_a_skeleton_in_another_unit_is_scaled_to_the_height_and_it_is_stated(tmp_path, caplog, units_per_metre):
    skeleton = loaded(tmp_path, bvh(tables()["mixamo"], units_per_metre))
    same_where_named(skeleton)
    assert "is in no known unit: its skeleton is scaled to the height of 1.8 m" in caplog.text


def prefixed(program, prefix):
    return {joint: prefix + name for joint, name in tables()[program].items()}


CASES = {
    "Biped": prefixed("biped", "Bip01 "),
    "Biped of newer versions": prefixed("biped", "Bip001 "),
    "Biped with underscores": {joint: name.replace(" ", "_") for joint, name in prefixed("biped", "Bip01_").items()},
    "mixamorig with colon": prefixed("mixamo", "mixamorig:"),
    "mixamorig without colon": prefixed("mixamo", "mixamorig"),
    "mixamorig with number": prefixed("mixamo", "mixamorig1:"),
    "HumanIK": prefixed("mixamo", "Character1_"),
    "Perception Neuron": prefixed("mixamo", "Robot_"),
    "lower case": {joint: name.lower() for joint, name in tables()["mixamo"].items()},
    **{program: tables()[program] for program in tables() if program != "lassokin_ros"},
}


@pytest.mark.parametrize("case", sorted(CASES))
def test_names_of_other_programs_are_known(tmp_path, case):
    names = CASES[case]
    same_where_named(loaded(tmp_path, bvh(names, 100.0, without=set(BUILT_IN.joint_names) - set(names))))


@pytest.mark.parametrize("case", ["biovision", "xsens", "rokoko", "Biped", "mixamo"])
def test_a_missing_neck_is_placed_between_shoulders_and_head(tmp_path, case):
    names = CASES[case]
    skeleton = loaded(tmp_path, bvh(names, 100.0, without={"neck", *(set(BUILT_IN.joint_names) - set(names))}))
    neck = skeleton.rest_positions[skeleton.index("neck")]
    assert np.linalg.norm(neck - BUILT_IN.rest_positions[BUILT_IN.index("neck")]) < 0.02
    assert skeleton.joint_names[skeleton.parents[skeleton.index("head")]] == "neck"


def test_the_sentence_gives_the_mapping_that_makes_it_work(tmp_path):
    names = {**tables()["mixamo"], "left_hip": "Thigh of the left", "right_hip": "Thigh of the right"}
    text = bvh(names, 100.0)
    with pytest.raises(
        SkeletonError, match=r"not LeftUpLeg, RightUpLeg; write our names .* to theirs.names.yaml"
    ) as raised:
        loaded(tmp_path, text)
    assert "left_hip: ..., right_hip: ..." in str(raised.value) and "Thigh of the left" in str(raised.value)
    assert "\n" not in str(raised.value)
    mapping = "".join(f"{joint}: {name}\n" for joint, name in names.items())
    (tmp_path / "theirs.names.yaml").write_text(mapping)
    same_where_named(loaded(tmp_path, text))
    (tmp_path / "theirs.names.yaml").write_text(mapping.replace("left_knee", "left_kneee"))
    with pytest.raises(
        SkeletonError, match="theirs.names.yaml: joint 'left_kneee'; expected a name for each of pelvis"
    ):
        loaded(tmp_path, text)
    (tmp_path / "theirs.names.yaml").write_text(mapping.replace("Thigh of the left", "Thigh"))
    with pytest.raises(SkeletonError, match="has the joint names of theirs.names.yaml, but not Thigh;"):
        loaded(tmp_path, text)


@pytest.mark.parametrize("suffix", sorted(CONVERT))
def test_files_of_other_kinds_are_named_with_the_way_to_convert_them(tmp_path, suffix):
    path = tmp_path / f"body{suffix}"
    path.write_bytes(b"\x80\x04anything")
    for name in (path, path.with_suffix(suffix.upper())):
        with pytest.raises(SkeletonError, match=re.escape(f"{name}' is a") + "|is XML|is an") as raised:
            load_skeleton(str(name), HEIGHT)
        assert "\n" not in str(raised.value) and "expected .yaml, .npz, .bvh or .urdf" in str(raised.value)
