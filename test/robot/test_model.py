"""The model of a robot: URDFs that do not fit are refused, with what to do."""

from dataclasses import replace

import numpy as np
import pytest
import toy_robot

pytest.importorskip("pink", reason="needs the extra robot: pip install lassokin_ros[robot]")

from lassokin_ros.robot.model import RobotModel  # noqa: E402
from lassokin_ros.robot.robot_file import RobotError  # noqa: E402

URDF, ROBOT = toy_robot.urdf(), toy_robot.robot()
CONTINUOUS = toy_robot._joint("left_elbow", "left_shoulder_yaw_link", (0, 0, -0.2), "0 1 0", (0, 0), "continuous")
STILL = toy_robot._joint("left_elbow", "left_shoulder_yaw_link", (0, 0, -0.2), "0 1 0", (0, 0))
MIMIC = toy_robot._joint(
    "left_elbow", "left_shoulder_yaw_link", (0, 0, -0.2), "0 1 0", (-2, 0), more='<mimic joint="right_elbow"/>'
)


def test_a_fixed_base_moves_arms_and_torso_and_a_free_one_the_legs_too():
    fixed, free = RobotModel(URDF, ROBOT), RobotModel(URDF, ROBOT, free=True)
    assert len(fixed.names) == 9 and not any("hip" in name for name in fixed.names) and len(free.names) == 21
    assert len(fixed.all_names) == 21 and fixed.model.nq == 9 and free.model.nq == 28
    assert fixed.lengths["left_elbow"] == pytest.approx(0.25) and fixed.lengths["left_wrist"] == pytest.approx(0.2)
    assert free.places(free.rest)["left_ankle"][2] == pytest.approx(0.05)
    whole = dict(zip(fixed.all_names, fixed.whole(np.full(9, 0.1))))
    assert whole["waist"] == 0.1 and whole["left_knee"] == 0.2  # which stays at rest


def test_a_link_that_has_the_name_of_a_place_is_no_place():
    renamed = URDF.replace('"pelvis"', '"torso"')
    model = RobotModel(renamed, replace(ROBOT, links={**ROBOT.links, "base": "torso"}))
    assert model.places(model.rest)["torso"][2] == pytest.approx(0.1)


def test_a_locked_joint_and_its_rest_stay():
    model = RobotModel(URDF, replace(ROBOT, lock=("waist",), rest={"waist": 0.5}))
    assert "waist" not in model.names and len(model.names) == 8
    shoulder = model.places(model.rest)["left_shoulder"]
    assert np.arctan2(shoulder[1], shoulder[0]) == pytest.approx(np.pi / 2 + 0.5)


@pytest.mark.parametrize(
    ("urdf", "robot", "words"),
    [
        ("no xml", ROBOT, "the URDF is no XML"),
        ("<robot/>", ROBOT, "cannot be read"),
        ('<!DOCTYPE r [<!ENTITY a "b">]><robot/>', ROBOT, "without entities"),
        (URDF, replace(ROBOT, links={**ROBOT.links, "base": "pelvi"}), "no link 'pelvi', the nearest name is 'pelvis'"),
        (URDF, replace(ROBOT, lock=("wrist",)), "no joint 'wrist'"),
        (toy_robot.urdf(left_elbow=CONTINUOUS), ROBOT, "'left_elbow' is continuous; expected limits"),
        (toy_robot.urdf(left_elbow=STILL), replace(ROBOT, rest={}), "limits 0 to 0; expected a range"),
        (toy_robot.urdf(left_elbow=MIMIC), ROBOT, "'left_elbow' mimics another one; expected its name in lock"),
        (URDF, replace(ROBOT, rest={"left_elbow": 1.0}), "rest of 'left_elbow' is 1; expected -2.4 to 0"),
        (
            URDF.replace('<robot name="toy">', '<robot name="toy"><link name="world"/>').replace(
                '<link name="chest"/>',
                '<joint name="fly" type="floating"><parent link="world"/><child link="pelvis"/></joint>'
                '<link name="chest"/>',
            ),
            ROBOT,
            "hangs on joints (fly); expected a URDF that begins at the base",
        ),
        (
            URDF,
            replace(ROBOT, links={**ROBOT.links, "left_wrist": "left_elbow_link"}),
            "left_elbow and left_wrist are 0.000 m apart",
        ),
        (
            URDF,
            replace(
                ROBOT, links={**ROBOT.links, "left_hip": "right_hip_pitch_link", "right_hip": "left_hip_pitch_link"}
            ),
            "left_hip is not to the left (y) of right_hip",
        ),
    ],
    ids=range(12),
)
def test_what_does_not_fit_is_said_in_one_line(urdf, robot, words):
    with pytest.raises(RobotError) as refused:
        RobotModel(urdf, robot, free=True)
    assert words in str(refused.value) and "\n" not in str(refused.value)


def test_two_joints_of_an_arm_are_too_few_and_said():
    model = RobotModel(URDF, replace(ROBOT, lock=("left_shoulder_yaw", "left_shoulder_roll")))
    assert model.remarks() == ["the left arm has 2 moving joints; with fewer than 4 it can only come near"]
