"""The limits of the URDF's joints hold for recorded people."""

import numpy as np
import pytest

from benchmarks.common.report import data_folder
from benchmarks.data.mocap import load_clip, true_state
from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.pipeline.outputs.urdf import RANGES, range_of
from lassokin_ros.pipeline.people.joint_angles import JointAngleReader

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
