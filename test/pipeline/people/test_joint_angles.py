"""Joint angles: exact, continuous, and consistent with the URDF as other libraries read it."""

import itertools
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from cases import body, random_body, random_state
from scipy.spatial.transform import Rotation

from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.errors import SkeletonError
from lassokin_ros.pipeline.outputs.urdf import check_names, joint_names, urdf
from lassokin_ros.pipeline.people.joint_angles import LOCK, JointAngleReader

ORDERS = tuple("".join(order) for order in itertools.permutations("xyz"))


def product(angles, orders):
    """R = product of the elementary rotations in each joint's intrinsic order, by scipy."""
    return np.array(
        [
            Rotation.from_euler(order.upper(), [row["xyz".index(axis)] for axis in order]).as_matrix()
            for row, order in zip(angles, orders)
        ]
    )


def by_axis(in_order, orders):
    """(n, 3) angles in each joint's order -> columns x, y, z."""
    return np.array([[row[order.index(axis)] for axis in "xyz"] for row, order in zip(in_order, orders)])


def test_every_rotation_is_reproduced():
    orders = ORDERS * 4
    reader, random = JointAngleReader(orders), np.random.default_rng(0)
    for _ in range(100):
        rotations = Rotation.from_quat(random.normal(size=(24, 4))).as_matrix()
        assert np.abs(product(reader.read(rotations), orders) - rotations).max() < 1e-13


@pytest.mark.parametrize("distance", [0, 1e-16, 1e-12, LOCK / 3, LOCK * 3, 1e-7, 1e-5, 1e-3])
def test_the_product_holds_at_and_near_gimbal_lock(distance):
    random = np.random.default_rng(1)
    reader = JointAngleReader(ORDERS * 4)
    for _ in range(30):
        angles = random.uniform(-3, 3, (24, 3))
        angles[:, 1] = random.choice([-1, 1], 24) * (np.pi / 2 + distance * random.choice([-1, 1], 24))
        rotations = product(by_axis(angles, ORDERS * 4), ORDERS * 4)
        assert np.abs(product(reader.read(rotations), ORDERS * 4) - rotations).max() < 2e-9


def test_at_gimbal_lock_the_first_angle_is_kept():
    reader = JointAngleReader(ORDERS)
    before = by_axis(np.tile([0.4, 1.2, -0.3], (6, 1)), ORDERS)
    assert np.abs(reader.read(product(before, ORDERS)) - before).max() < 1e-13
    locked = by_axis(np.tile([0.9, np.pi / 2, -0.3], (6, 1)), ORDERS)
    result = reader.read(product(locked, ORDERS))
    for row, order in zip(result, ORDERS):
        even = order in ("xyz", "yzx", "zxy")
        first, middle, last = (row["xyz".index(axis)] for axis in order)
        assert first == pytest.approx(0.4) and middle == pytest.approx(np.pi / 2)
        assert last == pytest.approx(-0.3 + (0.5 if even else -0.5))


def test_smooth_angles_are_reproduced_over_many_turns():
    """Away from gimbal lock there is no jump and no lost turn, for every order of the axes."""
    reader = JointAngleReader(ORDERS)
    for t in np.linspace(0, 10, 2001):
        turn = [7 * t * np.sin(0.3 * t), 1.3 * np.sin(t), -5 * t]
        angles = by_axis(np.tile(turn, (6, 1)), ORDERS)
        assert np.abs(reader.read(product(angles, ORDERS)) - angles).max() < 1e-9
    assert abs(angles).max() > 40


def test_angles_are_smooth_through_gimbal_lock():
    """The middle angle goes from 0 through 90 to 180 degrees, and the other angles do not change."""
    reader = JointAngleReader(ORDERS)
    for middle in np.linspace(0, np.pi, 1001):
        angles = by_axis(np.tile([0.2, middle, -0.5], (6, 1)), ORDERS)
        assert np.abs(reader.read(product(angles, ORDERS)) - angles).max() < 1e-9


def test_random_walks_never_step_by_more_than_half_a_turn():
    """Through every region of SO(3), gimbal lock included, the product is right and no angle jumps by 2 pi."""
    random = np.random.default_rng(3)
    reader = JointAngleReader(ORDERS)
    rotations = np.tile(np.eye(3), (6, 1, 1))
    last = reader.read(rotations)
    for _ in range(5000):
        rotations = rotations @ exponential(random.normal(size=(6, 3)) * 0.05)
        angles = reader.read(rotations)
        assert np.abs(angles - last).max() <= np.pi + 1e-9
        last = angles
    assert np.abs(product(last, ORDERS) - rotations).max() < 1e-10


def test_reset_forgets_full_turns():
    reader = JointAngleReader(("xyz",))
    for angle in np.linspace(0, 7, 100):
        angles = reader.read(product([[angle, 0, 0]], ("xyz",)))
    assert angles[0, 0] == pytest.approx(7)
    reader.reset()
    assert reader.read(product([[7, 0, 0]], ("xyz",)))[0, 0] == pytest.approx(7 - 2 * np.pi)


# The URDF ------------------------------------------------------------------------------------------------------------


def near_lock(random, kinematics):
    """A state with all joints within 1e-9 to 1e-3 rad of gimbal lock."""
    axes = kinematics.skeleton.axes
    angles = random.uniform(-3, 3, (len(axes), 3))
    away = 10 ** random.uniform(-9, -3, len(axes))
    angles[:, 1] = random.choice([-1, 1], len(axes)) * (np.pi / 2 - away)
    state = random_state(random, kinematics)
    state.rotations[:] = product(by_axis(angles, axes), axes)
    return state


def states_with_joint_values(kinematics, seed):
    """States of every kind with the values of JointState, by joint name."""
    random = np.random.default_rng(seed)
    reader = JointAngleReader(kinematics.skeleton.axes)
    states = [random_state(random, kinematics, spread) for spread in (0.2, 0.8, 3.0)] + [near_lock(random, kinematics)]
    for state in states:
        values = np.concatenate([state.translation, reader.read(state.rotations).reshape(-1)])
        yield state, dict(zip(joint_names(kinematics.skeleton), values))


CASES = {"person": lambda: body(), "tree": lambda: random_body(np.random.default_rng(4), 12)}


@pytest.mark.parametrize("which", sorted(CASES))
def test_the_urdf_reproduces_the_joints_through_pinocchio(which):
    pin = pytest.importorskip("pinocchio", reason="pinocchio (pip install pin) is a test-only dependency")
    kinematics = CASES[which]()
    model = pin.buildModelFromXML(urdf(kinematics.skeleton, "camera"))
    assert model.nq == 3 + 3 * kinematics.joint_count
    data = model.createData()
    for seed in range(5):
        for state, values in states_with_joint_values(kinematics, seed):
            q = np.zeros(model.nq)
            for name, value in values.items():
                q[model.joints[model.getJointId(name)].idx_q] = value
            pin.framesForwardKinematics(model, data, q)
            pose = kinematics.pose(state)
            for j, name in enumerate(kinematics.skeleton.joint_names):
                placement = data.oMf[model.getFrameId(name, pin.FrameType.BODY)]
                assert np.abs(placement.translation - pose.positions[j]).max() < 1e-7
                angle = np.linalg.norm(pin.log3(placement.rotation.T @ pose.orientations[j]))
                assert angle < 1e-7


def test_the_urdf_reproduces_the_joints_through_yourdfpy(tmp_path):
    yourdfpy = pytest.importorskip("yourdfpy", reason="yourdfpy is a test-only dependency")
    kinematics = body()
    file = tmp_path / "body.urdf"
    file.write_text(urdf(kinematics.skeleton, "camera"))
    robot = yourdfpy.URDF.load(str(file), load_meshes=False, build_scene_graph=True)
    assert robot.validate()
    for state, values in states_with_joint_values(kinematics, 7):
        robot.update_cfg(values)
        pose = kinematics.pose(state)
        for j, name in enumerate(kinematics.skeleton.joint_names):
            transform = robot.get_transform(name, "camera")
            assert np.abs(transform[:3, 3] - pose.positions[j]).max() < 1e-7
            assert np.abs(transform[:3, :3] - pose.orientations[j]).max() < 1e-7


def test_the_urdf_is_a_tree_with_the_joint_names():
    skeleton = body().skeleton
    root = ElementTree.fromstring(urdf(skeleton, "camera/optical <1>"))
    links = [link.get("name") for link in root.iter("link")]
    joints = {joint.get("name"): joint for joint in root.iter("joint")}
    assert len(links) == len(set(links)) == 1 + 3 + 72 and links[0] == "camera/optical <1>"
    assert set(joints) == set(joint_names(skeleton)) and len(joint_names(skeleton)) == 75
    assert joint_names(skeleton)[:6] == ["root_x", "root_y", "root_z", "pelvis_x", "pelvis_y", "pelvis_z"]
    for name, joint in joints.items():
        assert joint.get("type") == ("prismatic" if name.startswith("root_") else "revolute")
        lower, upper = (float(joint.find("limit").get(end)) for end in ("lower", "upper"))
        free = name.startswith(("root_", "pelvis_"))
        assert upper == -lower > 100 if free else -4 < lower < upper < 4
    children = [joint.find("child").get("link") for joint in joints.values()]
    assert sorted(children) == sorted(links[1:])  # a tree: each link except the base is the child of one joint
    assert root.find("link").find("inertial") is None and len(list(root.iter("visual"))) > 40
    colours = {material.get("name") for material in root.findall("material")}
    assert {visual.find("material").get("name") for visual in root.iter("visual")} == colours


@pytest.mark.parametrize("name, twice", [("root", "joints .* 'root_x'"), ("head_x_link", "links .* 'head_x_link'")])
def test_joint_names_that_collide_in_the_urdf_are_refused(name, twice):
    """`root` would give two joints with each of the names root_x, root_y and root_z, a prismatic and a revolute one."""
    skeleton = body().skeleton
    check_names(skeleton)
    with pytest.raises(SkeletonError, match=f"two {twice}; give the joint"):
        check_names(replace(skeleton, joint_names=(name, *skeleton.joint_names[1:])))


def test_bones_in_the_urdf_end_at_the_next_joint():
    skeleton = body().skeleton
    root = ElementTree.fromstring(urdf(skeleton, "camera"))
    links = {link.get("name"): link for link in root.iter("link")}
    for child in range(1, 24):
        ends = []
        for visual in links[skeleton.joint_names[skeleton.parents[child]]].iter("visual"):
            cylinder = visual.find("geometry").find("cylinder")
            if cylinder is not None:
                origin = visual.find("origin")
                centre = np.array(origin.get("xyz").split(), dtype=float)
                turn = Rotation.from_euler("xyz", np.array(origin.get("rpy").split(), dtype=float)).as_matrix()
                ends.append(centre + turn[:, 2] * float(cylinder.get("length")) / 2)
        assert np.linalg.norm(np.array(ends) - skeleton.offsets[child], axis=1).min() < 1e-5


@pytest.mark.parametrize("frame, what", [("", "empty; expected a name"), ("pelvis", "'pelvis'; expected a name that")])
def test_an_impossible_base_frame_is_refused(frame, what):
    with pytest.raises(SkeletonError, match=f"base frame is {what}"):
        urdf(body().skeleton, frame)
