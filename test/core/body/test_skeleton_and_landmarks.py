"""Skeletons, layouts and settings: the built-in ones are valid, and bad ones are refused with a useful error."""

import dataclasses
import re

import numpy as np
import pytest

from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.landmarks import Layout, built_in_layouts, skeleton_of
from lassokin_ros.core.body.roles import THICKNESS
from lassokin_ros.core.body.skeleton import HEIGHT_RANGE, Skeleton, built_in_skeletons
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.errors import ConfigurationError, LassokinError, LayoutError, SkeletonError, SolverError
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.core.yaml_files import finite_numbers

SMPL_PARENTS = [-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21]
LANDMARKS = {
    "coco17": 17,
    "body25": 25,
    "body25b": 25,
    "halpe26": 26,
    "openpose18": 18,
    "mediapipe33": 33,
    "h36m17": 17,
    "smpl24": 24,
    "hri18": 18,
    "zed38": 38,
    "mediapipe75": 75,
    "coco133": 65,
    "openpose67": 67,
    "left_hand21": 21,
    "right_hand21": 21,
}
HAND = [*("hand_wrist", "thumb1", "thumb2", "thumb3", "thumb_tip"), *("index1", "index2", "index3", "index_tip")]
HAND += [f"{finger}{part}" for finger in ("middle", "ring", "pinky") for part in (1, 2, 3, "_tip")]


def joint(name, parent, position=(0, 0.1, 0), **more):
    return {"name": name, "parent": parent, "position": list(position), **more}


def tree(*joints, **more):
    return {"name": "test", "height_unit": "metre", "joints": list(joints), **more}


def test_the_built_in_tree_is_that_of_smpl():
    skeleton = Skeleton.load("anthropometric", 1.75)
    assert skeleton.parents.tolist() == SMPL_PARENTS
    assert skeleton.joint_count == 24
    assert skeleton.joint_names[0] == "pelvis" and skeleton.joint_names[23] == "right_hand"
    assert built_in_skeletons() == ["anthropometric", "body_hands", "left_hand", "right_hand"]


def test_the_built_in_body_has_human_proportions():
    skeleton = Skeleton.load("anthropometric", 2.0)
    place = dict(zip(skeleton.joint_names, skeleton.rest_positions))
    assert place["head"][1] > place["neck"][1] > place["spine3"][1] > 0 > place["left_hip"][1] > place["left_knee"][1]
    for name in skeleton.joint_names:
        if name.startswith("left_"):
            mirrored = place["right_" + name[5:]] * [-1, 1, 1]
            assert np.allclose(place[name], mirrored, rtol=0, atol=1e-12) and place[name][0] > 0
    span = place["left_hand"][0] - place["right_hand"][0]
    assert 1.9 < span + 2 * 0.054 * 2.0 < 2.25  # an arm span is about a height; the knuckles are half a hand short
    assert np.allclose(Skeleton.load("anthropometric", 1.0).offsets * 2, skeleton.offsets)


def test_offsets_are_read_only():
    skeleton = Skeleton.load("anthropometric", 1.75)
    with pytest.raises(ValueError):
        skeleton.offsets[3] = 0
    longer = skeleton.with_bone_scales(np.full(24, 1.1))
    assert np.allclose(longer.offsets, skeleton.offsets * 1.1) and longer.joint_names == skeleton.joint_names


def test_a_skeleton_is_loaded_from_a_file(tmp_path):
    file = tmp_path / "stick.yaml"
    file.write_text(
        "height_unit: metre\njoints:\n  - {name: a, parent: null, position: [1, 1, 1]}\n"
        '  - {name: b, parent: a, position: [1, 1.5, 1], axes: "zyx"}\n'
    )
    skeleton = Skeleton.load(str(file), 1.75)
    assert skeleton.axes == ("xzy", "zyx")
    assert np.allclose(skeleton.offsets, [[0, 0, 0], [0, 0.5, 0]])


@pytest.mark.parametrize("name", sorted(LANDMARKS))
def test_built_in_layouts_are_valid(name):
    assert built_in_layouts() == sorted(LANDMARKS)
    skeleton = Skeleton.load(skeleton_of(name), 1.75)
    layout = Layout.load(name, skeleton)
    assert len(layout.names) == len(set(layout.names)) == LANDMARKS[name]
    assert np.abs(layout.offsets).max() < 0.2 * 1.75 and layout.noise.min() > 0
    place = skeleton.rest_positions[layout.joints] + layout.offsets
    for left, landmark in enumerate(layout.names):
        if landmark.startswith("left_") and name != "left_hand21":
            right = layout.index("right_" + landmark[5:])
            assert place[left, 0] > 0 and np.allclose(place[left], place[right] * [-1, 1, 1], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "left", "right", "count"),
    [("mediapipe75", 33, 54, 75), ("openpose67", 25, 46, 67), ("coco133", 91, 112, 133), ("left_hand21", 0, None, 21)],
)
def test_the_hands_of_a_layout_begin_at_the_detectors_ids(name, left, right, count):
    layout = Layout.load(name, Skeleton.load(skeleton_of(name), 1.75))
    assert layout.detector_count == count
    named = dict(zip(layout.ids.tolist(), layout.names))
    for first, side in ((left, "left"), (right, "right")):
        if first is not None:
            assert [named[first + place] for place in range(21)] == [f"{side}_{part}" for part in HAND]


def test_the_face_of_coco133_is_skipped():
    layout = Layout.load("coco133", Skeleton.load("body_hands", 1.75))
    assert layout.ids.tolist() == [*range(23), *range(91, 133)]
    assert layout.names[:17] == Layout.load("coco17", Skeleton.load("anthropometric", 1.75)).names
    assert layout.names[17:20] == ("left_big_toe", "left_small_toe", "left_heel")


def test_a_layout_of_hands_names_its_skeleton():
    with pytest.raises(LayoutError, match="'left_thumb1', which is not in .* set skeleton to 'body_hands'"):
        Layout.load("mediapipe75", Skeleton.load("anthropometric", 1.75))


def test_coco17_is_in_cocos_order():
    names = Layout.load("coco17", Skeleton.load("anthropometric", 1.75)).names
    assert names[:5] == ("nose", "left_eye", "right_eye", "left_ear", "right_ear")
    assert names[5:9] == ("left_shoulder", "right_shoulder", "left_elbow", "right_elbow")
    assert names[15:] == ("left_ankle", "right_ankle")


BAD_SKELETONS = {
    "no joints": ({}, "'joints' must be a list"),
    "joints a mapping": ({"joints": {"a": 1}}, "'joints' must be a list"),
    "no name": (tree({"parent": None}), "joint 0 is .*expected a mapping with name, parent and position"),
    "twice": (tree(joint("a", None), joint("a", "a")), "joint 'a' is listed twice"),
    "no root": (tree(joint("a", "b")), "joint 'a' has parent 'b'; the first joint, and no other, is the root"),
    "two roots": (tree(joint("a", None), joint("b", None)), "joint 'b' has parent None"),
    "child first": (tree(joint("a", None), joint("b", "c"), joint("c", "a")), "'c', which is not listed before it: a"),
    "bad axes": (tree(joint("a", None, axes="xyx")), "joint 'a' has axes 'xyx'; expected one of xyz, xzy"),
    "bad free": (tree(joint("a", None, free="xw")), "joint 'a' has free 'xw'; expected the axes about which it turns"),
    "free a bool": (tree(joint("a", None, free=True)), "joint 'a' has free True"),
    "axes a bool": (tree(joint("a", None, axes=True)), "expected one of .* in quotes"),
    "two numbers": (tree(joint("a", None, (1, 2))), r"joint 'a' has position \[1, 2\]; expected three finite numbers"),
    "nan": (tree(joint("a", None, (0, 0, float("nan")))), "expected three finite numbers"),
    "text": (tree(joint("a", None, ("0", "0", "0"))), "expected three finite numbers"),
    "unit": (tree(joint("a", None), height_unit="inch"), "height_unit is 'inch'; expected 'fraction'"),
    "misspelt": (tree(joint("a", None), height_units="metre"), "the key 'height_units', .*mean 'height_unit'"),
    "misspelt in a joint": (tree({**joint("a", None), "axis": "xyz"}), "joint 'a' has the key 'axis', .*mean 'axes'"),
    "huge position": (tree({**joint("a", None), "position": [0, 10**400, 0]}), "expected three finite numbers"),
    "too many": (tree(*(joint(f"{i}", f"{i - 1}" if i else None) for i in range(301))), "301 joints; expected at most"),
    "joints a text": ({"joints": "pelvis"}, "'joints' must be a list"),
    "the second": (tree(joint("a", None), {"name": 1}), "joint 1 is .*expected a mapping"),
    "too far": (tree(joint("a", None, (0, -10.1, 0))), "three finite numbers, .* of at most 10"),
}


@pytest.mark.parametrize("case", sorted(BAD_SKELETONS))
def test_bad_skeletons_are_refused(case):
    data, text = BAD_SKELETONS[case]
    with pytest.raises(SkeletonError, match=text) as error:
        Skeleton.from_mapping(data, 1.75, "body.yaml")
    assert "\n" not in str(error.value) and str(error.value).startswith("body.yaml")


def test_a_missing_file_is_named_with_the_existing_names():
    with pytest.raises(
        SkeletonError, match="'nobody.yaml' is neither built in .anthropometric, .*left_hand.* nor a file; expected"
    ):
        Skeleton.load("nobody.yaml", 1.75)
    with pytest.raises(LayoutError, match="'nothing' is neither built in .body25, .*coco17.* nor a YAML file"):
        Layout.load("nothing", Skeleton.load("anthropometric", 1.75))


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (b"joints: [", "no valid YAML: .*line"),
        (b"- 1\n- 2\n", "holds list; expected a mapping"),
        (b"", "holds NoneType; expected a mapping"),
        (b"joints: !!python/object/apply:os.system ['true']", "no valid YAML: .*could not determine a constructor"),
        (b"#" * 1_000_001, "is too long; expected at most 1000000 characters"),
        (b"joints: \xff\xfe\xfa", "is no UTF-8 text: .* at byte 8"),
        (b"joints: " + b"[" * 1000, "nested too deeply|no valid YAML"),
    ],
    ids=["broken", "list", "empty", "code", "huge", "not text", "deep"],
)
def test_bad_files_are_refused(tmp_path, content, text):
    file = tmp_path / "bad.yaml"
    file.write_bytes(content)
    with pytest.raises(SkeletonError, match=text) as error:
        Skeleton.load(str(file), 1.75)
    assert "bad.yaml" in str(error.value) and "\n" not in str(error.value)
    with pytest.raises(LayoutError, match=text):
        Layout.load(str(file), Skeleton.load("anthropometric", 1.75))


BAD_LAYOUTS = {
    "none": ({}, "'landmarks' must be a list"),
    "unknown joint": (
        {"landmarks": [{"name": "nose", "joint": "nose"}]},
        "landmark 'nose' has joint 'nose', which is not in skeleton 'anthropometric'; its joints are: pelvis",
    ),
    "no name": ({"landmarks": [{"joint": "head"}]}, "landmark 0 is .*expected a mapping with name, joint and offset"),
    "twice": ({"landmarks": [{"name": "a", "joint": "head"}] * 2}, "landmark 'a' is listed twice"),
    "offset": ({"landmarks": [{"name": "a", "joint": "head", "offset": [1]}]}, r"has offset \[1\]; expected 3 finite"),
    "noise": ({"landmarks": [{"name": "a", "joint": "head", "noise": 0}]}, "has noise 0.0; expected a factor from 0.1"),
    "noise text": ({"landmarks": [{"name": "a", "joint": "head", "noise": "x"}]}, "expected 1 finite"),
    "huge offset": ({"landmarks": [{"name": "a", "joint": "head", "offset": [10**400, 0, 0]}]}, "expected 3 finite"),
    "misspelt": (
        {"landmarks": [{"name": "a", "joint": "head", "nois": 5.0}]},
        "'a' has the key 'nois', which is none of: name, joint, offset, noise, surface; did you mean 'noise'",
    ),
    "unknown": ({"landmarks": [{"name": "a", "joint": "head"}], "of": "us"}, "the key 'of', which is none of: name, s"),
    "too many": ({"landmarks": [{"name": f"{i}", "joint": "head"} for i in range(1001)]}, "1001 .*expected at most"),
    "include": ({"landmarks": [{"include": "coco18"}]}, "include is 'coco18'; expected a built-in layout: body25, "),
    "skip": ({"landmarks": [{"skip": 3}]}, "skip is 3; expected a list of names"),
    "all skipped": ({"landmarks": [{"skip": ["a", "b"]}]}, "all landmarks are skipped; expected some"),
    "no list": ({"landmarks": {"name": "a", "joint": "head"}}, "'landmarks' must be a list"),
    "empty list": ({"landmarks": []}, "'landmarks' must be a list"),
    "the second": ({"landmarks": [{"name": "a", "joint": "head"}, {"name": 1}]}, "landmark 1 is .*expected a mapping"),
    "noise too large": ({"landmarks": [{"name": "a", "joint": "head", "noise": 100.1}]}, "has noise 100.1; expected"),
    "surface too deep": ({"landmarks": [{"name": "a", "joint": "head", "surface": 0.21}]}, "has surface 0.21; exp"),
    "surface outside": ({"landmarks": [{"name": "a", "joint": "head", "surface": -0.01}]}, "has surface -0.01; exp"),
}


def test_a_file_in_the_home_directory_is_found(tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "body.yaml").write_text(
        "height_unit: metre\njoints:\n  - {name: a, parent: null, position: [0, 0, 0]}\n"
    )
    (tmp_path / "points.yaml").write_text("landmarks:\n  - {name: nose, joint: head}\n")
    assert Skeleton.load("~/body.yaml", 1.75).joint_names == ("a",)
    assert Layout.load("~/points.yaml", Skeleton.load("anthropometric", 1.75)).names == ("nose",)


@pytest.mark.parametrize("case", sorted(BAD_LAYOUTS))
def test_bad_layouts_are_refused(case):
    data, text = BAD_LAYOUTS[case]
    with pytest.raises(LayoutError, match=text):
        Layout.from_mapping(data, Skeleton.load("anthropometric", 1.75))


def test_the_limits_themselves_are_allowed():
    for height in HEIGHT_RANGE:
        assert Skeleton.load("anthropometric", height).height == height
    chain = tree(*(joint(f"{i}", f"{i - 1}" if i else None, (10, -10, 0)) for i in range(300)))
    skeleton = Skeleton.from_mapping(chain, 1.75)
    assert skeleton.joint_count == 300
    ends = [{"noise": 0.1, "surface": 0}, {"noise": 100, "surface": 0.2}]
    points = [{"name": f"{i}", "joint": "0", **ends[i % 2]} for i in range(1000)]
    layout = Layout.from_mapping({"landmarks": points}, skeleton)
    assert layout.noise[:2].tolist() == [0.1, 100] and layout.surface[:2] == pytest.approx([0, 0.2 * 1.75])


def test_what_a_file_leaves_out_has_a_default():
    data = {"joints": [joint("a", None, (0, 1, 0)), joint("left_knee", "a", (0, 0.5, 0))]}
    skeleton = Skeleton.from_mapping(data, 2.0, "file.yaml")
    assert skeleton.name == "file.yaml" and skeleton.height == 2.0
    assert skeleton.offsets.tolist() == [[0, 0, 0], [0, -1, 0]]  # fractions of the height
    centre = {"name": "centre", "joint": "left_knee"}
    points = [centre, {**centre, "name": "patella", "offset": [0, 0.1, 0]}]
    layout = Layout.from_mapping({"landmarks": points}, skeleton, "points.yaml")
    assert layout.name == "points.yaml" and layout.noise.tolist() == [1, 1]
    assert layout.offsets.tolist() == [[0, 0, 0], [0, 0.2, 0]]
    # Half of a knee's depth from its centre to the surface; a landmark with an offset is on it.
    assert layout.surface == pytest.approx([THICKNESS["knee"] * 2.0, 0.0])


@pytest.mark.parametrize("suffix", ["npz", "bvh", "urdf", "pkl", "xacro", "fbx", "BVH"])
def test_another_format_is_distinguished_from_a_missing_file(suffix):
    with pytest.raises(SkeletonError, match=f"body.{suffix}: the core reads skeletons from YAML only"):
        Skeleton.load(f"body.{suffix}", 1.75)


def test_a_taller_skeleton_is_the_same_body():
    skeleton = Skeleton.load("anthropometric", 1.6)
    taller = skeleton.scaled(1.25)
    assert taller.height == 2.0 and np.allclose(taller.offsets, skeleton.offsets * 1.25)
    assert (taller.name, taller.joint_names, taller.axes) == (skeleton.name, skeleton.joint_names, skeleton.axes)


def test_a_skeleton_in_fractions_is_scaled_to_another_height():
    skeleton = Skeleton.load("anthropometric", 1.6)
    taller = skeleton.at_height(1.9)
    assert not skeleton.metric and not taller.metric and taller.height == 1.9
    assert np.allclose(taller.offsets, Skeleton.load("anthropometric", 1.9).offsets, rtol=1e-14, atol=0)
    assert skeleton.at_height(1.6) is skeleton
    assert np.allclose(taller.at_height(1.6).offsets, skeleton.offsets, rtol=1e-14, atol=0)


def test_a_skeleton_in_metres_keeps_its_lengths_at_another_height():
    """Its file gives lengths, which do not depend on the height; the landmarks do."""
    data = tree(joint("a", None), joint("b", "a", (0, 0.6, 0)))
    skeleton = Skeleton.from_mapping(data, 1.6)
    taller = skeleton.at_height(1.9)
    assert skeleton.metric and taller.metric and taller.height == 1.9
    assert np.array_equal(taller.offsets, skeleton.offsets)
    assert np.array_equal(taller.offsets, Skeleton.from_mapping(data, 1.9).offsets)
    assert taller.with_offsets(2 * skeleton.offsets).metric
    points = {"landmarks": [{"name": "tip", "joint": "b", "offset": [0, 0.1, 0]}]}
    kinematics = Kinematics(skeleton, Layout.from_mapping(points, skeleton))
    kinematics.set_skeleton(taller)
    assert np.allclose(kinematics.layout.offsets, [[0, 0.19, 0]])


@pytest.mark.parametrize("height", [0.29, 2.61, 0.0, -1.7, 17.5, float("nan"), float("inf")])
def test_a_height_out_of_range_is_refused(height):
    data = tree(joint("a", None), joint("b", "a", (0, 0.6, 0)))
    scaled = [Skeleton.load("anthropometric", 1.75).at_height, Skeleton.from_mapping(data, 1.75).at_height]
    for made in (lambda height: Skeleton.load("anthropometric", height), *scaled):
        with pytest.raises(SkeletonError, match=f"height is .*; expected {HEIGHT_RANGE[0]} to {HEIGHT_RANGE[1]} m"):
            made(height)


def test_errors_for_unknown_names_list_the_existing_ones():
    skeleton = Skeleton.load("anthropometric", 1.75)
    with pytest.raises(SkeletonError, match="joint 'tail' is not in skeleton 'anthropometric'; its joints are: pelvis"):
        skeleton.index("tail")
    with pytest.raises(LayoutError, match="landmark 'tail' is not in layout 'coco17'; it has: nose"):
        Layout.load("coco17", skeleton).index("tail")


BAD_SETTINGS = [
    ({"noise_px": 0.0}, "noise_px is 0.0; expected 0.1 to 100 px"),
    ({"noise_px": float("nan")}, "noise_px is nan; expected 0.1 to 100 px"),
    ({"noise_px": "3"}, "noise_px is '3'; expected a value of type float"),
    ({"min_landmarks": 1}, "min_landmarks is 1; expected 2 to 100"),
    ({"min_landmarks": 4.5}, "min_landmarks is 4.5; expected a value of type int"),
    ({"min_landmarks": True}, "min_landmarks is True; expected a value of type int"),
    ({"skeleton": 3}, "skeleton is 3; expected a value of type str"),
    ({"height": 3.0}, "height is 3.0; expected 0 to 2.6 m"),
    ({"height": 172.0}, "height is 172.0; expected 0 to 2.6 m (172 cm are 1.72 m)"),
]


@pytest.mark.parametrize(("change", "text"), BAD_SETTINGS, ids=lambda value: str(value)[:30])
def test_bad_settings_are_refused(change, text):
    with pytest.raises(ConfigurationError, match=re.escape(text)):
        TrackerConfig(**change).checked()
    with pytest.raises(ConfigurationError, match=re.escape(text)):
        Tracker(TrackerConfig(**change))


def test_every_setting_has_a_description():
    for field in dataclasses.fields(TrackerConfig):
        metadata = field.metadata
        assert len(metadata["description"]) > 10, field.name
        if isinstance(field.default, float) or type(field.default) is int:
            assert metadata["low"] < metadata["high"], field.name
            assert metadata["low"] <= field.default <= metadata["high"], field.name
    assert TrackerConfig().checked() == TrackerConfig()
    assert TrackerConfig(noise_px=3).checked().noise_px == 3  # an integer is a valid float


def test_all_errors_have_a_common_base_class():
    for error in (ConfigurationError, LayoutError, SkeletonError, SolverError):
        assert issubclass(error, LassokinError)
    with pytest.raises(SolverError, match="'gurobi2' is not available"):
        Tracker(TrackerConfig(solver="gurobi2"))


@pytest.mark.parametrize(
    "value", [[1.0, 2.0], [1.0, 2.0, 3.0, 4.0], [1, "2", 3], [1, float("nan"), 3], [10**400, 1, 1], 3]
)
def test_only_a_list_of_the_right_length_is_numbers(value):
    assert finite_numbers(value, 3) is None and finite_numbers([1, 2.5, -3], 3) == [1.0, 2.5, -3.0]
