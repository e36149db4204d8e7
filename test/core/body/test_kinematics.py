"""Forward and differential kinematics compared with pinocchio and finite differences, at random poses and bodies."""

import numpy as np
import pytest
from cases import body, central_difference, posed, prior_rows, random_body, random_state, relative_error

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.rotations import exponential, logarithm, to_quaternion
from lassokin_ros.core.errors import LayoutError
from lassokin_ros.core.evidence.pose_prior import PoseDistribution, PosePrior
from lassokin_ros.core.image.projection import project, projection_jacobian, stacked_matrices


def bodies():
    """Built-in bodies by layout and random trees: (kinematics, random generator)."""
    for seed, layout in enumerate(("coco17", "body25", "smpl24")):
        yield body(layout), np.random.default_rng(seed)
    for seed in range(10, 20):
        random = np.random.default_rng(seed)
        yield random_body(random, joints=int(random.integers(1, 20))), random


BODIES = list(bodies())


@pytest.fixture(params=range(len(BODIES)))
def case(request):
    kinematics, random = BODIES[request.param]
    return kinematics, [random_state(random, kinematics) for _ in range(4)]


def one_by_one(kinematics, state):
    """Equations (1)-(2) as written, joint after joint."""
    skeleton, layout = kinematics.skeleton, kinematics.layout
    transforms = []
    for j, parent in enumerate(skeleton.parents):
        local = np.eye(4)
        local[:3, :3] = state.rotations[j]
        local[:3, 3] = state.translation if parent < 0 else skeleton.offsets[j]
        transforms.append(local if parent < 0 else transforms[parent] @ local)
    landmarks = [(transforms[j] @ np.append(q, 1))[:3] for j, q in zip(layout.joints, layout.offsets)]
    return np.array(transforms), np.array(landmarks)


def test_pose_is_the_product_of_transforms(case):
    kinematics, states = case
    for state in states:
        transforms, landmarks = one_by_one(kinematics, state)
        pose = kinematics.pose(state)
        assert np.abs(pose.orientations - transforms[:, :3, :3]).max() < 1e-13
        assert np.abs(pose.positions - transforms[:, :3, 3]).max() < 1e-12
        assert np.abs(pose.landmarks - landmarks).max() < 1e-12


def test_a_batch_equals_single_poses(case):
    kinematics, states = case
    batch = BodyState(np.stack([s.rotations for s in states]), np.stack([s.translation for s in states]))
    together = kinematics.pose(batch)
    L = kinematics.jacobian(together)
    for i, state in enumerate(states):
        alone = kinematics.pose(state)
        assert np.allclose(together.landmarks[i], alone.landmarks, rtol=0, atol=1e-13)
        assert np.allclose(L[i], kinematics.jacobian(alone), rtol=0, atol=1e-12)


def test_jacobian_agrees_with_finite_differences(case):
    kinematics, states = case
    n = 3 * kinematics.joint_count
    for state in states:
        L = kinematics.jacobian(kinematics.pose(state))

        def landmarks(omega, state=state):
            return kinematics.pose(state.retract(omega, np.zeros(3))).landmarks

        assert relative_error(L, central_difference(landmarks, n)) < 1e-8


def test_the_stacked_model_is_the_derivative_of_the_image(case):
    """(12): P L by the increment, P Gamma by the translation."""
    kinematics, states = case
    n, count = 3 * kinematics.joint_count, kinematics.landmark_count
    for state in states:
        far = BodyState(state.rotations, state.translation + [0, 0, 12])  # random trees are several metres across
        P, Gamma, L = stacked_matrices(kinematics, kinematics.pose(far))
        assert P.shape == (2 * count, 3 * count)

        def image(step, state=far):
            return project(kinematics.pose(state.retract(step[:n], step[n:])).landmarks)

        expected = central_difference(image, n + 3)
        assert relative_error(P @ L, expected[:, :n]) < 1e-8 and relative_error(P @ Gamma, expected[:, n:]) < 1e-8


def test_dead_columns_are_zero_in_every_pose(case):
    kinematics, states = case
    for state in states:
        L = kinematics.jacobian(kinematics.pose(state))
        assert np.abs(L[:, ~kinematics.live]).max(initial=0) < 1e-12
        assert np.abs(L[:, kinematics.live]).max(axis=0).min(initial=np.inf) > 1e-9


def test_the_live_columns_are_the_jacobians(case):
    """`point_columns` of the live degrees of freedom, for two rows per landmark and for three; then the translation."""
    kinematics, states = case
    random, live = np.random.default_rng(7), np.flatnonzero(kinematics.live)
    pose = kinematics.pose(states[0])
    L = kinematics.jacobian(pose).reshape(kinematics.landmark_count, 3, -1)
    moving = kinematics.live_twists(pose, pose.orientations)
    for per_landmark in (2, 3):
        rows = random.normal(size=(kinematics.landmark_count, per_landmark, 3))
        out = np.full((len(live) + 3, rows.shape[0] * per_landmark), np.nan)
        kinematics.point_columns(moving, pose.positions[0], pose.landmarks, kinematics.layout.joints, rows, out)
        expected = (rows @ L).reshape(out.shape[1], -1)[:, live]
        assert np.allclose(out[:-3].T, expected, rtol=0, atol=1e-11)
        assert np.array_equal(out[-3:].T, rows.reshape(-1, 3))
    root = live[live < 3]
    assert np.array_equal(kinematics.live_root, root)  # joint 0 is the root


def test_the_joints_columns_are_the_derivatives_of_their_centres(case):
    kinematics, states = case
    random, live = np.random.default_rng(8), np.flatnonzero(kinematics.live)
    joints = random.integers(kinematics.joint_count, size=3)
    rows = random.normal(size=(3, 2, 3))
    pose = kinematics.pose(states[0])
    out = np.full((len(live) + 3, 6), np.nan)
    moving = kinematics.live_twists(pose, pose.orientations)
    kinematics.point_columns(moving, pose.positions[0], pose.positions[joints], joints, rows, out)

    def values(omega):
        centres = kinematics.pose(states[0].retract(omega, np.zeros(3))).positions[joints]
        return (rows @ centres[..., None])[..., 0]

    expected = central_difference(values, 3 * kinematics.joint_count)[:, live]
    assert np.allclose(out[:-3].T, expected, rtol=0, atol=1e-7)


def test_other_offsets_are_another_skeleton(case):
    """As an argument, and as the kinematics' own."""
    kinematics, states = case
    skeleton = kinematics.skeleton.with_offsets(kinematics.skeleton.offsets * 1.3)
    other = Kinematics(skeleton, kinematics.layout)
    expected = other.pose(states[0])
    reshaped = Kinematics(kinematics.skeleton, kinematics.layout)
    reshaped.set_skeleton(skeleton)
    assert reshaped.skeleton is skeleton
    for pose in (posed(kinematics, states[0], skeleton.offsets), reshaped.pose(states[0])):
        assert np.allclose(pose.positions, expected.positions, rtol=0, atol=1e-13)
        assert np.allclose(pose.landmarks, expected.landmarks, rtol=0, atol=1e-13)


def test_landmarks_are_scaled_with_the_height_and_do_not_drift():
    """A thousand changes of the height leave the landmarks as they were."""
    kinematics, random = body("coco17"), np.random.default_rng(9)
    skeleton, layout = kinematics.skeleton, kinematics.layout
    state = random_state(random, kinematics)
    for height in random.uniform(1.0, 2.2, 1000):
        kinematics.set_skeleton(skeleton.at_height(height))
    taller = Kinematics(skeleton.at_height(height), Layout.load("coco17", skeleton.at_height(height)))
    assert np.allclose(kinematics.layout.offsets, taller.layout.offsets, rtol=1e-14, atol=0)
    assert np.allclose(kinematics.layout.surface, taller.layout.surface, rtol=1e-14, atol=0)
    assert np.allclose(kinematics.pose(state).landmarks, taller.pose(state).landmarks, rtol=0, atol=1e-14)
    kinematics.set_skeleton(skeleton)
    assert np.array_equal(kinematics.layout.offsets, layout.offsets)
    assert np.array_equal(kinematics.layout.surface, layout.surface)


def test_other_lengths_at_the_same_height_keep_the_landmarks():
    kinematics = body("coco17")
    layout, longer = kinematics.layout, kinematics.skeleton.with_bone_scales(np.full(24, 1.1))
    kinematics.set_skeleton(longer)
    assert kinematics.layout is layout and kinematics.skeleton is longer


def test_coco17_has_the_expected_live_degrees_of_freedom():
    kinematics = body("coco17")
    live = {
        f"{name}_{axis}"
        for i, name in enumerate(kinematics.skeleton.joint_names)
        for k, axis in enumerate("xyz")
        if kinematics.live[3 * i + k]
    }
    assert {"pelvis_x", "pelvis_y", "pelvis_z", "left_elbow_y", "left_elbow_z", "left_knee_x", "head_y"} <= live
    assert "left_elbow_x" not in live  # rotation about the forearm moves no landmark
    assert not {name for name in live if "wrist" in name or "hand" in name or "ankle" in name or "foot" in name}


def test_points_at_and_behind_the_camera_stay_finite():
    points = np.array([[0.1, 0.2, 0.0], [0.1, 0.2, -3.0], [0.0, 0.0, 1e-9]])
    assert np.isfinite(project(points)).all() and np.isfinite(projection_jacobian(points)).all()


def pinocchio_model(kinematics: Kinematics, pin):
    """The same tree of pinocchio's joints: a translation, then spherical joints; landmarks as frames."""
    model, skeleton, layout = pin.Model(), kinematics.skeleton, kinematics.layout
    root = model.addJoint(0, pin.JointModelTranslation(), pin.SE3.Identity(), "root")
    joints = []
    for j, parent in enumerate(skeleton.parents):
        placement = pin.SE3(np.eye(3), np.array(skeleton.offsets[j]))
        above = root if parent < 0 else joints[parent]
        joints.append(model.addJoint(above, pin.JointModelSpherical(), placement, skeleton.joint_names[j]))
    frames = [
        model.addFrame(
            pin.Frame(name, joints[j], pin.SE3(np.eye(3), np.array(offset)), pin.FrameType.OP_FRAME),
        )
        for name, j, offset in zip((f"landmark_{name}" for name in layout.names), layout.joints, layout.offsets)
    ]
    return model, joints, frames


def test_kinematics_and_jacobians_agree_with_pinocchio(case):
    pin = pytest.importorskip("pinocchio", reason="pinocchio (pip install pin) is a test-only dependency")
    kinematics, states = case
    model, joints, frames = pinocchio_model(kinematics, pin)
    data = model.createData()
    for state in states:
        q = np.zeros(model.nq)
        q[:3] = state.translation
        for joint, quaternion in zip(joints, to_quaternion(state.rotations)):
            start = model.joints[joint].idx_q
            q[start : start + 4] = quaternion
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        pose = kinematics.pose(state)
        for j, joint in enumerate(joints):
            assert np.abs(data.oMi[joint].translation - pose.positions[j]).max() < 1e-12
            assert np.abs(data.oMi[joint].rotation - pose.orientations[j]).max() < 1e-12
        columns = np.concatenate([model.joints[joint].idx_v + np.arange(3) for joint in joints])
        L = kinematics.jacobian(pose).reshape(len(frames), 3, -1)
        for i, frame in enumerate(frames):
            assert np.abs(data.oMf[frame].translation - pose.landmarks[i]).max() < 1e-12
            theirs = pin.getFrameJacobian(model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)[:3]
            assert np.abs(L[i] - theirs[:, columns]).max() < 1e-11
            assert np.abs(theirs[:, :3] - np.eye(3)).max() < 1e-12  # Gamma's block


def test_prior_rows_agree_with_finite_differences():
    kinematics = body()
    rows = PosePrior(PoseDistribution.load(kinematics.skeleton), kinematics)
    for seed in range(5):
        state = random_state(np.random.default_rng(seed), kinematics)
        A, z = prior_rows(rows, state.rotations)

        def residual(omega, state=state):
            return -rows.posture(state.retract(omega, np.zeros(3)).rotations).residual

        assert relative_error(A, central_difference(residual, 72)) < 1e-7
        assert np.array_equal(z, rows.posture(state.rotations).residual)
    assert rows.count == len(rows.W) == 3 * len(rows.joints)


def test_a_layout_moved_by_the_root_only_is_refused():
    kinematics = body()
    points = [{"name": f"{i}", "joint": "pelvis", "offset": [0.1 * i, 0, 0]} for i in range(4)]
    layout = Layout.from_mapping({"name": "belt", "landmarks": points}, kinematics.skeleton)
    with pytest.raises(LayoutError, match="layout 'belt' has no landmark that a joint but the root moves; expected"):
        PosePrior(PoseDistribution.load(kinematics.skeleton), Kinematics(kinematics.skeleton, layout))


def test_prior_rows_measure_the_mahalanobis_distance():
    kinematics = body()
    prior = PoseDistribution.load(kinematics.skeleton)
    rows = PosePrior(prior, kinematics)
    random = np.random.default_rng(6)
    vectors = prior.mean + random.normal(size=(24, 3)) * 0.2
    chosen = (3 * rows.joints[:, None] + np.arange(3)).reshape(-1)
    difference = (vectors - prior.mean).reshape(-1)[chosen]
    expected = difference @ np.linalg.solve(prior.covariance[np.ix_(chosen, chosen)], difference)
    residual = rows.posture(exponential(vectors)).residual
    assert residual @ residual == pytest.approx(expected, rel=1e-9)


def test_live_rows_equal_the_rows_of_live_degrees_of_freedom():
    kinematics = body()
    rows = PosePrior(PoseDistribution.load(kinematics.skeleton), kinematics)
    live = np.flatnonzero(kinematics.live)
    vectors = np.random.default_rng(22).normal(size=(3, kinematics.joint_count, 3))
    A, z = prior_rows(rows, exponential(vectors))
    posture = rows.posture(exponential(vectors))
    columns = rows.live_columns(posture)
    assert np.array_equal(z, posture.residual)
    assert np.allclose(np.swapaxes(columns, -1, -2), A[..., live[rows.first :]], rtol=0, atol=1e-12)
    assert not A[..., live[: rows.first]].any()


def test_the_way_to_another_state_is_the_same_from_both_sides():
    random = np.random.default_rng(5)
    one, other = (BodyState(exponential(0.9 * random.normal(size=(24, 3))), random.normal(size=3)) for _ in range(2))
    found, back = one.towards(other, 0.3), other.towards(one, 0.7)
    angle = np.linalg.norm(logarithm(np.swapaxes(one.rotations, -1, -2) @ other.rotations), axis=-1)
    part = np.linalg.norm(logarithm(np.swapaxes(one.rotations, -1, -2) @ found.rotations), axis=-1)
    assert np.abs(part - 0.3 * angle).max() < 1e-9 and angle.max() > 1.5
    assert np.abs(found.rotations - back.rotations).max() < 1e-9
    assert np.abs(found.translation - (0.7 * one.translation + 0.3 * other.translation)).max() < 1e-12
