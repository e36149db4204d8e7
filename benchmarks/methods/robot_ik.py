"""Robot inverse kinematics on the same body: the usual tools without this package.

The body is the URDF that the node publishes, 75 revolute and prismatic joints. There are three methods:
- pink and mink (differential inverse kinematics as a QP, with pinocchio and with MuJoCo): one position task per
  landmark, a light posture task. They have no camera model, so their input are the landmarks' true positions in 3D: an
  easier task.
- damped least squares on the image, one step per frame, with pinocchio's Jacobians.

Each starts in the true pose, which the tracker has to find.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.image.projection import project, projection_jacobian
from lassokin_ros.pipeline.outputs.urdf import joint_names, urdf
from lassokin_ros.pipeline.people.joint_angles import JointAngleReader

DAMPING = 30.0  # as in benchmarks/methods/baselines.py
PINK_SOLVERS = ("proxqp", "daqp")
TRUE_PLACES = "true places in 3D"


def available() -> list[str]:
    """Names of the peers that are installed."""
    if find_spec("pinocchio") is None:
        return []
    pink = [f"pink, {solver}" for solver in PINK_SOLVERS] if find_spec("pink") else []
    mink = ["mink, daqp"] if find_spec("mink") else []
    return [*pink, *mink, "pinocchio, damped least squares"]


class _Robot:
    """The body as a pinocchio model with one operational frame per landmark."""

    def __init__(self, kinematics: Kinematics, start: BodyState) -> None:
        import pinocchio

        self.pin = pinocchio
        skeleton, layout = kinematics.skeleton, kinematics.layout
        self.model = pinocchio.buildModelFromXML(urdf(skeleton, "camera"))
        self.frames = []
        for name, joint, offset in zip(layout.names, layout.joints, layout.offsets):
            link = self.model.getFrameId(skeleton.joint_names[joint])
            parent = self.model.frames[link]
            place = parent.placement * pinocchio.SE3(np.eye(3), offset)
            frame = pinocchio.Frame(f"landmark_{name}", parent.parentJoint, link, place, pinocchio.OP_FRAME)
            self.frames.append(self.model.addFrame(frame))
        self.data = self.model.createData()
        self.q = self.configuration(skeleton, start)

    def configuration(self, skeleton: Skeleton, state: BodyState) -> np.ndarray:
        """The model's joint vector of a state."""
        values = np.concatenate([state.translation, JointAngleReader(skeleton.axes).read(state.rotations).ravel()])
        by_name = dict(zip(joint_names(skeleton), values))
        q = self.pin.neutral(self.model)
        for name, joint in zip(list(self.model.names)[1:], list(self.model.joints)[1:]):
            q[joint.idx_q] = by_name[name]
        return q


class PinkTracker:
    """One pink step per frame towards the positions of the landmarks in 3D."""

    given = TRUE_PLACES

    def __init__(self, kinematics: Kinematics, start: BodyState, solver: str) -> None:
        import pink

        robot = _Robot(kinematics, start)
        self._pink, self._solver, self._robot = pink, solver, robot
        self._configuration = pink.Configuration(robot.model, robot.data, robot.q)
        names = [robot.model.frames[frame].name for frame in robot.frames]
        self._tasks = [pink.tasks.FrameTask(name, position_cost=1.0, orientation_cost=0.0) for name in names]
        posture = pink.tasks.PostureTask(cost=1e-3)
        posture.set_target(robot.q)
        self._all: list[Any] = [*self._tasks, posture]
        self._pin = robot.pin

    def track(self, landmarks: np.ndarray) -> None:
        """One frame; landmarks (l, 3) m."""
        for task, point in zip(self._tasks, landmarks):
            task.set_target(self._pin.SE3(np.eye(3), point))
        options = {"solver": self._solver, "limits": (), "safety_break": False}  # people exceed the URDF's limits
        velocity = self._pink.solve_ik(self._configuration, self._all, 1 / 60, **options)
        self._configuration.integrate_inplace(velocity, 1 / 60)

    def landmarks(self) -> np.ndarray:
        """(l, 3) m after the last frame."""
        return np.array([self._configuration.data.oMf[frame].translation for frame in self._robot.frames])


class MinkTracker:
    """One mink step per frame towards the positions of the landmarks in 3D."""

    given = TRUE_PLACES

    def __init__(self, kinematics: Kinematics, start: BodyState, solver: str) -> None:
        import mink
        import mujoco

        skeleton, layout = kinematics.skeleton, kinematics.layout
        # MuJoCo refuses bodies without mass.
        more = '<mujoco><compiler boundmass="0.001" boundinertia="0.001" fusestatic="false"/></mujoco></robot>'
        for name, joint, (x, y, z) in zip(layout.names, layout.joints, layout.offsets):
            ends = f'<parent link="{skeleton.joint_names[joint]}"/><child link="landmark_{name}"/>'
            fixed = f'<joint name="to_{name}" type="fixed">{ends}<origin xyz="{x} {y} {z}"/></joint>'
            more = f'<link name="landmark_{name}"/>{fixed}{more}'
        model = mujoco.MjModel.from_xml_string(urdf(skeleton, "camera").replace("</robot>", more))
        values = np.concatenate([start.translation, JointAngleReader(skeleton.axes).read(start.rotations).ravel()])
        q = np.zeros(model.nq)
        for name, value in zip(joint_names(skeleton), values):
            q[model.joint(name).qposadr[0]] = value
        self._mink, self._solver = mink, solver
        self._configuration = mink.Configuration(model)
        self._configuration.update(q)
        self._bodies = [model.body(f"landmark_{name}").id for name in layout.names]
        self._tasks = [
            mink.FrameTask(f"landmark_{name}", "body", position_cost=1.0, orientation_cost=0.0) for name in layout.names
        ]
        posture = mink.PostureTask(model, cost=1e-3)
        posture.set_target(q)
        self._all: list[Any] = [*self._tasks, posture]

    def track(self, landmarks: np.ndarray) -> None:
        """One frame; landmarks (l, 3) m."""
        for task, point in zip(self._tasks, landmarks):
            task.set_target(self._mink.SE3.from_translation(point))
        velocity = self._mink.solve_ik(self._configuration, self._all, 1 / 60, solver=self._solver, limits=[])
        self._configuration.integrate_inplace(velocity, 1 / 60)

    def landmarks(self) -> np.ndarray:
        """(l, 3) m after the last frame."""
        return np.array(self._configuration.data.xpos[self._bodies])


class PinocchioLeastSquares:
    """(J^T J + lambda^2 I)^-1 J^T e on the image, the rotations damped."""

    given = "image"

    def __init__(self, kinematics: Kinematics, start: BodyState) -> None:
        self._robot = _Robot(kinematics, start)
        self._damping = np.full(self._robot.model.nv, DAMPING**2)
        self._damping[:3] = 1e-6

    def track(self, points: np.ndarray, weight: float) -> None:
        """One frame; points (l, 2) normalised, weight 1 / standard deviation."""
        robot, pin = self._robot, self._robot.pin
        pin.computeJointJacobians(robot.model, robot.data, robot.q)
        pin.updateFramePlacements(robot.model, robot.data)
        places = np.array([robot.data.oMf[frame].translation for frame in robot.frames])
        aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        jacobians = np.array([pin.getFrameJacobian(robot.model, robot.data, f, aligned)[:3] for f in robot.frames])
        J = (projection_jacobian(places) @ jacobians).reshape(-1, robot.model.nv) * weight
        error = (points - project(places)).reshape(-1) * weight
        H = J.T @ J
        H.flat[:: len(H) + 1] += self._damping
        robot.q = pin.integrate(robot.model, robot.q, np.linalg.solve(H, J.T @ error))

    def landmarks(self) -> np.ndarray:
        """(l, 3) m after the last frame."""
        robot = self._robot
        robot.pin.framesForwardKinematics(robot.model, robot.data, robot.q)
        return np.array([robot.data.oMf[frame].translation for frame in robot.frames])
