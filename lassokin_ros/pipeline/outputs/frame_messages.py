"""A frame's output messages, made only when somebody listens."""

from __future__ import annotations

from typing import Any, Callable, Iterator

import numpy as np

from lassokin_ros.core.body.rotations import hat, to_quaternion
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.estimate import Estimate
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.lasso.recovery import theorem1_literal, theorem1_projected
from lassokin_ros.core.lasso.solver import KKT_TOLERANCE
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.outputs.urdf import joint_names
from msg_adapters.backends import Backend
from msg_adapters.output_messages.builders import (
    OK,
    WARN,
    IdsListBuilder,
    JointStateBuilder,
    PointStampedBuilder,
    PoseArrayBuilder,
    StampedBuilder,
    StatusLine,
    StringBuilder,
    TransformBuilder,
)
from msg_adapters.output_messages.image_markers import ImageMarkerBuilder, KeypointMarkerBuilder
from msg_adapters.output_messages.joint_uncertainty import UncertaintyCloudBuilder, UncertaintyMarkersBuilder
from msg_adapters.output_messages.markers import SkeletonMarkersBuilder
from msg_adapters.output_messages.serialised_messages import SerialisedMessage
from msg_adapters.output_messages.serialised_status import SerialisedStatus

BODY_FROM_ROOT = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""The root joint's frame (x to the person's left, y up, z front) in REP-103's for a body (x front, y left, z up): its
columns are the latter's axes in the former."""


class FrameMessages:
    """Turns accepted frames into messages. A message is re-used: publish or serialise it before the next frame."""

    def __init__(
        self,
        backend: Backend,
        skeleton: Skeleton,
        name: str = "tracker",
        person: str = "",
        tf: bool = False,
        tf_at_hips: bool = False,
        ready_made: bool = False,
        frame_prefix: str = "~/",
    ) -> None:
        """Make every message once.

        backend: of msg_adapters.backends; name: the node's, in the certificate; person: of several; tf: TF too;
        tf_at_hips: of the place midway between the hips, as in REP-155, in place of the pelvis; ready_made: give bytes
        in place of messages, where that is quicker (rclpy's publishers take both); frame_prefix: the parameter.
        """

        def fill(builder: StampedBuilder) -> Callable[..., Any]:
            return SerialisedMessage(builder, backend).fill if ready_made else builder.fill

        prefix = f"{person}/" if person else ""
        joint_states = fill(JointStateBuilder(backend, joint_names(skeleton)))
        translation = fill(PointStampedBuilder(backend))
        joints = fill(PoseArrayBuilder(backend, skeleton.joint_count))
        markers = fill(SkeletonMarkersBuilder(backend, skeleton.parents.tolist(), prefix))
        certificate = SerialisedStatus(backend, ready_made).fill
        cloud = fill(UncertaintyCloudBuilder(backend, skeleton.joint_count))
        ellipsoids = fill(UncertaintyMarkersBuilder(backend, skeleton.joint_count, prefix))
        image = fill(ImageMarkerBuilder(backend, skeleton.parents.tolist()))
        keypoints = fill(KeypointMarkerBuilder(backend, prefix))
        title = f"{name}: {person}" if person else name
        self._makers: dict[str, Callable[[int, str, Any, Any], Any]] = {
            topics.JOINT_STATES: lambda t, f, frame, _: joint_states(t, f, frame.positions, frame.velocities),
            topics.TRANSLATION: lambda t, f, _, e: translation(t, f, e.state.translation),
            topics.JOINTS: lambda t, f, _, e: joints(t, f, e.pose.positions, to_quaternion(e.pose.orientations)),
            topics.MARKERS: lambda t, f, _, e: markers(t, f, e.pose.positions),
            topics.CERTIFICATE: lambda t, f, frame, e: certificate(
                t, f, certificate_line(e, frame.uncertainty.failure_probability, title, f)
            ),
            topics.JOINT_UNCERTAINTY: lambda t, f, frame, e: cloud(
                t, f, e.pose.positions, frame.uncertainty.covariance, frame.uncertainty.deviation
            ),
            topics.UNCERTAINTY_MARKERS: lambda t, f, frame, e: ellipsoids(
                t, f, e.pose.positions, *principal_axes(frame.uncertainty.covariance)
            ),
            topics.IMAGE_MARKERS: lambda t, f, frame, _: image(t, f, *drawn(frame)),
            topics.KEYPOINT_MARKERS: lambda t, f, frame, e: keypoints(t, f, frame.points, project(e.pose.landmarks)),
        }
        if tf:
            transform = fill(TransformBuilder(backend, body_frame(name, person, tf_at_hips, frame_prefix)))
            origin = body_origin(skeleton, tf_at_hips)
            self._makers[topics.TF] = lambda t, f, _, e: transform(
                t, f, e.pose.positions[origin].mean(axis=0), body_turn(e)
            )

    def build(
        self, frame: FrameResult, wanted: Callable[[str], bool] = lambda topic: True
    ) -> Iterator[tuple[str, Any]]:
        """(topic, message) of each wanted output of an accepted frame, in the order of topics.PERSON_OUTPUTS."""
        if not frame.accepted or frame.estimate is None:
            return
        for topic, make in self._makers.items():
            if wanted(topic):
                yield topic, make(frame.stamp_ns, frame.frame_id, frame, frame.estimate)


def id_list(backend: Any, rep155: bool) -> Callable[[int, str, list[str]], Any]:
    """A maker of the list of ids from stamp, frame_id and ids: hri_msgs/IdsList, or text with commas between."""
    if rep155:
        return IdsListBuilder(backend).fill
    text = StringBuilder(backend)
    return lambda stamp_ns, frame_id, ids: text.fill(",".join(ids))


def drawn(frame: FrameResult) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """px: joints (n, 2), landmarks (l, 2) as detected, and as the skeleton has them. The lens is asked once for all."""
    assert frame.estimate is not None and frame.estimate.pose is not None and frame.detected is not None
    pose, n = frame.estimate.pose, len(frame.estimate.pose.positions)
    pixels = frame.in_image(np.concatenate([pose.positions, pose.landmarks]))
    return pixels[:n], frame.detected, pixels[n:]


def principal_axes(covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n, 4) quaternions and (n, 3) m: the axes of the ellipsoids of covariances (n, 3, 3) m^2, and half their lengths.

    Along each axis one standard deviation.
    """
    variances, axes = np.linalg.eigh(covariance)
    axes[:, :, :1] = hat(axes[:, :, 1]) @ axes[:, :, 2:]  # the same axis, in the sense that makes them a rotation
    return to_quaternion(axes), np.sqrt(np.maximum(variances, 0.0))


def body_frame(name: str, person: str, rep155: bool, frame_prefix: str) -> str:
    """Return the TF frame of a body: `<prefix>body`, with REP-155 `body_<id>`, which allows no prefix."""
    return f"body_{person}" if rep155 and person else f"{topics.link_prefix(frame_prefix, name, person)}body"


def body_origin(skeleton: Skeleton, at_hips: bool) -> list[int]:
    """The joints whose mean is the origin of the frame `body`: both hips, if asked for and there, or the root."""
    hips = [i for i, name in enumerate(skeleton.joint_names) if name in ("left_hip", "right_hip")]
    return hips if at_hips and len(hips) == 2 else [0]


def body_turn(estimate: Estimate) -> np.ndarray:
    """(4,) quaternion of the frame `body` in the camera's."""
    assert estimate.pose is not None
    turn: np.ndarray = to_quaternion(estimate.pose.orientations[0] @ BODY_FROM_ROOT)
    return turn


def certificate_line(estimate: Estimate, failure_probability: float, name: str, hardware_id: str) -> StatusLine:
    """KKT residuals, duality gap, support, reprojection error and Theorem 1's margins of a frame's last lasso.

    Theorem 1 is evaluated at the solution's own support and signs: would the lasso, were these the truth, find them?
    """
    problem, solution = estimate.problem, estimate.solution
    assert problem is not None and solution is not None
    certificate = solution.certificate
    support = solution.support
    signs = np.sign(solution.omega[support])
    literal = theorem1_literal(problem, solution.x, support, signs)
    projected = theorem1_projected(problem, support, signs)
    values = {
        "kkt1 [alpha]": certificate.kkt1,
        "kkt2 [alpha]": certificate.kkt2,
        "kkt3 [alpha]": certificate.kkt3,
        "duality gap": certificate.duality_gap,
        "relative duality gap": certificate.relative_gap,
        "support size": certificate.support_size,
        "certified": str(solution.certified).lower(),
        "reprojection error [px]": estimate.reprojection_px,
        "theorem 1, condition 1 (< 1)": projected.condition1,
        "theorem 1, condition 2 (> 0) [rad]": projected.condition2,
        "theorem 1, condition 3 (= 0)": projected.condition3,
        "theorem 1 literal, condition 1 (< 1)": literal.condition1,
        "theorem 1 literal, condition 2 (> 0) [rad]": literal.condition2,
        "theorem 1 literal, condition 3 (= 0)": literal.condition3,
        "initialised": str(estimate.initialised).lower(),
        "start's confidence": estimate.confidence,
        "likely wrong": failure_probability,
    }
    level, message = (OK, "certified") if solution.certified else (WARN, "not certified")
    text = {key: value if isinstance(value, str) else f"{value:.6g}" for key, value in values.items()}
    return StatusLine(level, f"{name}: certificate", f"{message} to {KKT_TOLERANCE:g} of alpha", hardware_id, text)
