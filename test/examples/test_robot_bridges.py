"""The examples that hand motions to simulations, arms and GMR: their parts without ROS, and loaders' forms."""

import re

import numpy as np
import pytest
import toy_robot
from scipy.spatial.transform import Rotation

from lassokin_ros import joints

pytest.importorskip("rclpy")

from robots import load  # noqa: E402


@pytest.fixture(scope="module")
def mujoco_example():
    pytest.importorskip("mujoco", reason="needs mujoco: pip install mujoco '.[robot]'")
    pytest.importorskip("pink", reason="needs the extra robot: pip install lassokin_ros[robot]")
    return load("humanoid_in_mujoco")


def test_mujoco_shows_commands_at_once(mujoco_example):
    simulation = mujoco_example.Simulation(toy_robot.urdf())
    simulation.command(["left_elbow", "of_another_robot", "waist"], [-1.0, 1.0, np.nan])
    simulation.advance(0.02)
    assert simulation.data.qpos[simulation.at["left_elbow"]] == -1.0 and np.isfinite(simulation.data.qpos).all()


def test_mujoco_follows_commands_with_torques(mujoco_example):
    simulation = mujoco_example.Simulation(toy_robot.urdf(), "pd")
    for step in range(60):
        simulation.command(["left_elbow", "right_shoulder_pitch"], [-min(step, 40) / 40, -min(step, 40) / 20])
        simulation.advance(0.02)
    off = np.degrees(simulation.target - simulation.data.qpos)
    assert np.abs(off).max() < 2.5 and simulation.data.qpos[simulation.at["left_elbow"]] < -0.9
    with pytest.raises(ValueError, match="expected kinematic or pd"):
        mujoco_example.Simulation(toy_robot.urdf(), "torque")


def test_an_arm_of_one_chain_goes_to_its_target_within_its_limits():
    pytest.importorskip("pink", reason="needs the extra robot: pip install lassokin_ros[robot]")
    example_of_arm = load("imitate_arm_joints")
    links = ['<robot name="arm"><link name="base"/>']
    for index, (axis, x) in enumerate((("0 0 1", 0.0), ("0 1 0", 0.0), ("0 1 0", 0.3), ("0 1 0", 0.25))):
        parent = f"link_{index - 1}" if index else "base"
        links.append(
            f'<link name="link_{index}"/><joint name="joint_{index}" type="revolute"><parent link="{parent}"/><child '
            f'link="link_{index}"/><origin xyz="{x} 0 0"/><axis xyz="{axis}"/>'
            '<limit lower="-1.5" upper="1.5" effort="1" velocity="3"/></joint>'
        )
    urdf = "".join([*links, "</robot>"])
    arm, place = example_of_arm.Arm(urdf, "link_3"), np.array([0.35, 0.15, -0.2])
    steps = [arm.step(place, 0.01).copy() for _ in range(300)]
    assert np.linalg.norm(arm.configuration.get_transform_frame_to_world("link_3").translation - place) < 2e-3
    assert np.abs(np.diff(steps, axis=0)).max() < 0.01 * (1 + 1e-3)  # 1 rad/s
    far = np.array([arm.step(np.array([-9.0, 0.0, 9.0]), 0.01) for _ in range(300)])
    assert np.isfinite(far).all() and np.abs(far).max() <= 1.5 + 1e-3
    with pytest.raises(ValueError, match="the URDF has no link 'tool0'"):
        example_of_arm.Arm(urdf, "tool0")


def seen_person(turn):
    """Points of ~/skeleton of a person who stands, in a frame that `turn` has turned."""
    from lassokin_ros.robot.check import people
    from msg_adapters.output_messages.clouds import SKELETON_POINT

    person, points = people()["arms down"], np.zeros(24, SKELETON_POINT)
    for index, name in enumerate("xyz"):
        points[name] = (person.places @ turn.as_matrix().T)[:, index]
        points[f"up_{name}"] = turn.apply(person.up)[index]
    for index, name in enumerate(("qx", "qy", "qz", "qw")):
        points[name] = turn.as_quat()[index]
    return points


def test_gmr_gets_places_with_z_up_and_a_scale_from_the_pelvis():
    pytest.importorskip("pink", reason="needs the extra robot: pip install lassokin_ros[robot]")
    gmr = load("gmr_live")
    images = [gmr.human(seen_person(Rotation.from_rotvec([0.4, 0.1, 2.0])))] * 3
    floor, pelvis = gmr.pelvis_height(images)
    assert 0.8 < pelvis < 1.0  # m, of a person of 1.7 m
    place, turn = images[0]["head"]
    assert place[2] - floor > 1.4 and np.linalg.norm(turn) == pytest.approx(1)
    assert gmr.height_for_gmr(0.9 * pelvis, pelvis) == pytest.approx(1.8)  # GMR's table shrinks it so already
    # The frame of each joint is turned as the person is: its y is up.
    assert np.allclose(Rotation.from_quat(turn, scalar_first=True).apply([0, 1, 0]), [0, 0, 1], atol=1e-6)


def test_a_bvh_with_nokovs_names_has_what_gmr_reads():
    """GMR's form nokov: LeftFoot for the place and LeftToeBase for the turn; cm; y up, which it turns to z."""
    from lassokin_ros.core.body.skeleton import Skeleton
    from lassokin_ros.core.config import TrackerConfig
    from lassokin_ros.replay.exports.bvh import hierarchy
    from lassokin_ros.skeleton_readers.bvh import parse_hierarchy

    skeleton = Skeleton.load(TrackerConfig(height=1.75).skeleton, 1.7)
    angles = np.zeros((2, 3 * skeleton.joint_count))
    angles[1, 3 * 1] = 30.0  # the first rotation, about z, of the joint after the root
    rows = "\n".join(" ".join(str(v) for v in (0.1, 0.9, -3.0, *frame)) for frame in angles)
    text = f"{hierarchy(skeleton)}MOTION\nFrames: 2\nFrame Time: 0.033333333\n{rows}\n"
    renamed = load("nokov_bvh").renamed(text)
    tree = parse_hierarchy(renamed, "walk.bvh")
    names, parents, offsets = list(tree.names), tree.parents, tree.positions - tree.positions[list(tree.parents)]
    frames = np.array([line.split() for line in renamed.partition("Frame Time")[2].splitlines()[1:]], float)
    assert {"Hips", "LeftUpLeg", "LeftFoot", "LeftToeBase", "RightToeBase", "LeftForeArm", "Head"} <= set(names)
    assert not {name for name in names if "_" in name or name in joints.NAMES}
    # The loaders of LAFAN1 take words alone for names, three or six channels, and the order of the first joint for all.
    assert all(re.match(r"\s*(ROOT|JOINT) \w+$", line) for line in renamed.splitlines() if "JOINT" in line)
    channels = [line.split() for line in renamed.splitlines() if "CHANNELS" in line]
    assert {int(one[1]) for one in channels} <= {3, 6}
    assert {"".join(word[0] for word in one[-3:]) for one in channels} == {"ZYX"}
    assert np.allclose(frames[:, :3], [10.0, 90.0, -300.0]) and np.allclose(frames[:, 3:], angles)
    assert offsets[names.index("LeftLeg")] == pytest.approx(
        100 * skeleton.offsets[skeleton.index("left_knee")], abs=1e-3
    )
    turns, places = [], []
    for joint, parent in enumerate(parents):
        own = Rotation.from_euler("ZYX", frames[1, 3 + 3 * joint : 6 + 3 * joint], degrees=True)
        turns.append(own if parent < 0 else turns[parent] * own)
        places.append(frames[1, :3] if parent < 0 else places[parent] + turns[parent].apply(offsets[joint]))
    to_z_up = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    metres = np.array(places) @ to_z_up.T / 100
    assert metres[names.index("Head"), 2] > 1.3 > metres[names.index("LeftFoot"), 2]
