"""REP-155: names, axes and joints as in the package human_description, the frames below body_<id>, and the region."""

from xml.etree import ElementTree

import numpy as np
import pytest
from detector_messages import detector_types
from messages import HEIGHT, WIDTH, camera_info, crowd, pixels_of_motion
from scipy.spatial.transform import Rotation

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.outputs.body_frames import JOINTS, LINKS, MappedJoints
from lassokin_ros.pipeline.outputs.frame_messages import FrameMessages
from lassokin_ros.pipeline.outputs.urdf import joint_names, urdf
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings
from msg_adapters.backends import RosbagsBackend

BACKEND = RosbagsBackend(detector_types())
SKELETON = Skeleton.load("anthropometric", 1.75)
CONFIG = NodeSettings(rep155=True, max_people=2, publish_tf="all")
PIXELS = pixels_of_motion(6)
OF_REP155 = {"waist", "torso", "head", *(f"{side}_{name}" for side in "lr" for name in
             ("shoulder", "elbow", "wrist", "hip", "knee", "ankle"))}  # fmt: skip


@pytest.fixture(scope="module")
def built():
    """A frame, and its messages by topic."""
    session = Session(TrackerConfig(height=1.75), CONFIG)
    session.set_camera(camera_info(BACKEND))
    for i in range(6):
        image = crowd(BACKEND, 1_000_000_000 + i * 33_000_000, [(PIXELS[i], np.full(17, 0.9))])
        frames = session.frames(image, 0)
    messages = FrameMessages(BACKEND, session.tracker.skeleton, "tracker", "abc", CONFIG)
    return frames[0], dict(messages.build(frames[0]))


def test_all_links_of_rep155_are_there():
    assert set(LINKS) == OF_REP155
    root = ElementTree.fromstring(urdf(SKELETON, "camera", body_id="abc"))
    links = [link.get("name") for link in root.iter("link")]
    joints = [joint.get("name") for joint in root.iter("joint")]
    assert {f"{name}_abc" for name in OF_REP155} <= set(links) and len(set(links)) == len(links)
    assert all(name.endswith("_abc") for name in (*links, *joints) if name != "camera")
    assert len(set(joints)) == len(joints)


def pose_of_hanging_arms():
    """World axes are those of the camera: x right, y down, z forward; a person who faces the camera, standing."""
    facing = Rotation.from_matrix([[1, 0, 0], [0, -1, 0], [0, 0, -1]]).as_matrix()
    rotations = np.tile(np.eye(3), (SKELETON.joint_count, 1, 1))
    names = list(SKELETON.joint_names)
    rotations[0] = facing
    for side, angle in (("left", -np.pi / 2), ("right", np.pi / 2)):
        rotations[names.index(f"{side}_shoulder")] = Rotation.from_rotvec([0, 0, angle]).as_matrix()
    kinematics = Kinematics(SKELETON, Layout.load("coco17", SKELETON))
    return kinematics.pose(BodyState(rotations, np.array([0.0, 0.0, 3.0]))), facing


def test_axes_are_those_of_human_description():
    """Standing with hanging arms, all frames have x to the front and z up."""
    pose, facing = pose_of_hanging_arms()
    names = list(SKELETON.joint_names)
    for link, (joint, axes) in LINKS.items():
        found = pose.orientations[names.index(joint)] @ axes
        assert np.linalg.det(axes) == pytest.approx(1.0)
        assert np.allclose(found[:, 0], facing @ [0, 0, 1], atol=1e-9), link
        assert np.allclose(found[:, 2], facing @ [0, 1, 0], atol=1e-9), link


def test_knees_and_elbows_bend_as_those_of_human_description():
    """There, the axes are (0, -1, 0): a knee's angles are negative, an elbow's positive."""
    names, mapped = joint_names(SKELETON), MappedJoints(joint_names(SKELETON), "abc")
    assert mapped.names[-4:] == ["l_knee_abc", "r_knee_abc", "l_elbow_abc", "r_elbow_abc"]
    assert mapped.names[0] == "root_x_abc"
    for link, (angle, _) in JOINTS.items():
        axes = LINKS[link][1]
        for value in (-0.4, 1.1):
            positions = np.zeros(len(names))
            positions[names.index(angle)] = value
            turn = Rotation.from_rotvec(value * np.eye(3)["xyz".index(angle[-1])]).as_matrix()
            expected = Rotation.from_rotvec([0, -mapped.extend(positions)[mapped.names.index(f"{link}_abc")], 0])
            assert np.allclose(axes.T @ turn @ axes, expected.as_matrix())


def test_tf_is_that_of_the_urdf(built):
    """The frames of the node's TF are those that robot_state_publisher makes of joint_states and urdf."""
    frame, messages = built
    states = messages[topics.JOINT_STATES]
    pin = pytest.importorskip("pinocchio", reason="pinocchio (pip install pin) is a test-only dependency")
    model = pin.buildModelFromXML(urdf(frame.skeleton, "camera", body_id="abc"))
    data, q = model.createData(), np.zeros(model.nq)
    for name, value in zip(states.name, states.position):
        if model.existJointName(name):
            q[model.joints[model.getJointId(name)].idx_q] = value
    pin.framesForwardKinematics(model, data, q)
    transforms = {t.child_frame_id: (t.header.frame_id, t.transform) for t in messages[topics.TF].transforms}

    def place(name):
        if name not in transforms:
            return np.eye(4)
        parent, t = transforms[name]
        own = np.eye(4)
        q, p = t.rotation, t.translation
        own[:3, :3], own[:3, 3] = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix(), [p.x, p.y, p.z]
        return place(parent) @ own

    for name in ("l_wrist_abc", "head_abc", "r_knee_abc", "left_hand_abc", "head_joint_abc"):
        placed = data.oMf[model.getFrameId(name, pin.FrameType.BODY)].homogeneous
        assert np.allclose(place(name), placed, atol=1e-4), name


def test_the_region_is_that_of_the_keypoints(built):
    frame, messages = built
    region = messages[topics.ROI]
    seen = frame.detected[np.isfinite(frame.detected).all(axis=1)] / [WIDTH, HEIGHT]
    found = [region.xmin, region.ymin, region.xmax, region.ymax]
    assert np.allclose(found, [*seen.min(axis=0).clip(0, 1), *seen.max(axis=0).clip(0, 1)], atol=1e-6)
    assert 0 < region.c <= 1 and region.header.stamp.nanosec > 0
    assert all(isinstance(value, float) for value in found)


def test_without_rep155_nothing_changes():
    messages = FrameMessages(BACKEND, SKELETON, "tracker", "abc", NodeSettings(max_people=2))
    assert topics.ROI not in messages._builders
    assert topics.person_outputs(False) == topics.PERSON_OUTPUTS
