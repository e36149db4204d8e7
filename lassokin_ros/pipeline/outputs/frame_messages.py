"""The output messages of one accepted frame. A message is computed only if it is requested."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator
from typing import Any

import numpy as np

from lassokin_ros.core.body.roles import is_finger
from lassokin_ros.core.body.rotations import hat, to_quaternion
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.lasso.certificate import theorem1_literal, theorem1_projected
from lassokin_ros.core.lasso.solver import KKT_TOLERANCE
from lassokin_ros.core.output.hand_points import HandPoints
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.outputs import topics
from lassokin_ros.pipeline.outputs.body_frames import BodyFrames, MappedJoints
from lassokin_ros.pipeline.outputs.limbs_and_hands import Hands, Limbs
from lassokin_ros.pipeline.outputs.scene_messages import joints_report
from lassokin_ros.pipeline.outputs.urdf import joint_names
from lassokin_ros.pipeline.settings import OFF, NodeSettings
from msg_adapters.backends import Backend
from msg_adapters.output_messages.builders import (
    OK,
    WARN,
    DiagnosticArrayBuilder,
    IdsListBuilder,
    JointStateBuilder,
    PointStampedBuilder,
    PoseArrayBuilder,
    PoseWithCovarianceBuilder,
    RegionBuilder,
    StampedBuilder,
    StatusLine,
    StringBuilder,
    TransformsBuilder,
)
from msg_adapters.output_messages.clouds import (
    GestureBuilder,
    HandCloudBuilder,
    LimbCloudBuilder,
    SkeletonCloudBuilder,
    UncertaintyCloudBuilder,
)
from msg_adapters.output_messages.markers import (
    ImageMarkerBuilder,
    KeypointMarkerBuilder,
    SkeletonMarkersBuilder,
    UncertaintyMarkersBuilder,
)
from msg_adapters.output_messages.serialised_messages import SerialisedMessage

OF_IMAGE = (topics.IMAGE_MARKERS, topics.KEYPOINT_MARKERS, topics.ROI)
"""Topics about the image of the first camera; images of others have no such messages."""


class FrameMessages:
    """Makes the messages of one person. Message objects are reused: publish or serialise each before the next frame."""

    def __init__(
        self,
        backend: Backend,
        skeleton: Skeleton,
        name: str = "tracker",
        person: str = "",
        config: NodeSettings | None = None,
        serialised: bool = False,
        hands: HandPoints | None = None,
    ) -> None:
        """Make every message object once.

        backend: see msg_adapters.backends; name: of the node, in certificate and frames; person: id, empty for one
        person; config: of the node; serialised: return serialised messages where that is faster; hands: of skeleton
        and layout, None for no ~/hands.
        """
        self._backend, self._serialised = backend, serialised
        self._config = config or NodeSettings()
        self._first_camera = self._config.camera_names[0]
        self._builders: dict[str, Callable[[int, str, Any, Any], Any]] = {}
        self._gestures: Callable[[FrameResult], list[tuple[int, int]]] = lambda frame: []
        prefix = f"{person}/" if person else ""
        self._add_pose_outputs(skeleton, person, prefix)
        certificate, title = DiagnosticArrayBuilder(backend).fill, f"{name}: {person}" if person else name
        self._builders[topics.CERTIFICATE] = lambda t, f, frame, _: certificate(
            t, f, [certificate_status(frame, title, f)]
        )
        self._add_uncertainty_outputs(skeleton, prefix)
        self._add_image_outputs(skeleton, prefix)
        if hands is not None and hands.sides:
            cloud, own = self._fill(HandCloudBuilder(backend, len(hands.sides))), Hands(hands)
            self._builders[topics.HANDS] = lambda t, f, frame, _: cloud(t, f, own.report(frame))
            if self._config.detects_bodies:
                self._gestures, self._gesture = own.rep155_gestures, GestureBuilder(backend).fill
        if self._config.publish_tf != OFF:
            frames = BodyFrames(skeleton, self._config, name, person)
            transforms = self._fill(TransformsBuilder(backend, frames.names))
            self._builders[topics.TF] = lambda t, f, _, e: transforms(t, f, *frames.transforms(e))
        if self._config.detects_bodies:
            roi = RegionBuilder(self._backend).fill
            self._builders[topics.ROI] = lambda t, f, frame, _: roi(t, f, keypoint_region(frame))

    def build(self, frame: FrameResult, wanted: Container[str] | None = None) -> Iterator[tuple[str, Any]]:
        """Yield (topic, message) for the wanted topics of an accepted frame, in the order of topics.PERSON_OUTPUTS.

        wanted: None for all topics. The gesture's topic has one for each hand: use each message before the next.
        """
        if not frame.accepted or frame.estimate is None:
            return
        of_first = frame.camera.name == self._first_camera
        for topic, build in self._builders.items():
            if wanted is not None and topic not in wanted:
                continue
            if of_first or topic not in OF_IMAGE:
                yield topic, build(frame.stamp_ns, frame.frame_id, frame, frame.estimate)
        if wanted is None or topics.GESTURE in wanted:
            for gesture in self._gestures(frame):
                yield topics.GESTURE, self._gesture(frame.stamp_ns, frame.frame_id, *gesture)

    def _fill(self, builder: StampedBuilder) -> Callable[..., Any]:
        return SerialisedMessage(builder, self._backend).fill if self._serialised else builder.fill

    def _add_pose_outputs(self, skeleton: Skeleton, person: str, prefix: str) -> None:
        backend, parents = self._backend, skeleton.parents.tolist()
        names = joint_names(skeleton)
        mapped = MappedJoints(names, person) if self._config.rep155 and person else None
        joint_states = self._fill(JointStateBuilder(backend, names if mapped is None else mapped.names))
        extend = (lambda values: values) if mapped is None else mapped.extend
        translation = self._fill(PointStampedBuilder(backend))
        joints = self._fill(PoseArrayBuilder(backend, skeleton.joint_count))
        fingers = [joint for joint, name in enumerate(skeleton.joint_names) if is_finger(name)]
        markers = self._fill(SkeletonMarkersBuilder(backend, parents, prefix, fingers))
        self._builders |= {
            topics.JOINT_STATES: lambda t, f, frame, _: joint_states(
                t, f, extend(frame.positions), extend(frame.velocities)
            ),
            topics.TRANSLATION: lambda t, f, _, e: translation(t, f, e.state.translation),
            topics.JOINTS: lambda t, f, frame, e: joints(t, f, e.pose.positions, frame.quaternions[:-1]),
            topics.MARKERS: lambda t, f, _, e: markers(t, f, e.pose.positions),
        }

    def _add_uncertainty_outputs(self, skeleton: Skeleton, prefix: str) -> None:
        """Add what shares `FrameResult.uncertainty`, which is computed once per frame."""
        backend, count = self._backend, skeleton.joint_count
        cloud = self._fill(UncertaintyCloudBuilder(backend, count))
        pose = self._fill(PoseWithCovarianceBuilder(backend))
        joints = self._fill(SkeletonCloudBuilder(backend, count))
        limbs = Limbs(skeleton)
        ends = self._fill(LimbCloudBuilder(backend, limbs.ends, limbs.roots))
        ellipsoids = self._fill(UncertaintyMarkersBuilder(backend, count, prefix))
        self._builders |= {
            topics.JOINT_UNCERTAINTY: lambda t, f, frame, e: cloud(
                t, f, e.pose.positions, frame.uncertainty.covariance, frame.uncertainty.deviation
            ),
            topics.POSE: lambda t, f, frame, e: pose(
                t, f, e.pose.positions[0], frame.quaternions[-1], frame.uncertainty.absolute.pelvis
            ),
            topics.SKELETON: lambda t, f, frame, _: joints(t, f, joints_report(frame)),
            topics.LIMBS: lambda t, f, frame, _: ends(t, f, *limbs.read(frame)),
            topics.UNCERTAINTY_MARKERS: lambda t, f, frame, e: ellipsoids(
                t, f, e.pose.positions, *principal_axes(frame.uncertainty.covariance)
            ),
        }

    def _add_image_outputs(self, skeleton: Skeleton, prefix: str) -> None:
        image = self._fill(ImageMarkerBuilder(self._backend, skeleton.parents.tolist()))
        keypoints = self._fill(KeypointMarkerBuilder(self._backend, prefix))
        self._builders |= {
            topics.IMAGE_MARKERS: lambda t, f, frame, _: image(t, f, *image_points(frame)),
            topics.KEYPOINT_MARKERS: lambda t, f, frame, e: keypoints(
                t,
                f,
                frame.points,
                project(frame.camera.into_camera(e.pose.landmarks)),
                *(() if frame.camera.is_identity else (frame.camera.rotation, frame.camera.centre)),
            ),
        }


def id_list(backend: Backend, rep155: bool) -> Callable[[int, str, list[str]], Any]:
    """Return a function of stamp in ns, frame_id and ids: it makes an hri_msgs/IdsList, or text with commas."""
    if rep155:
        return IdsListBuilder(backend).fill
    text = StringBuilder(backend)
    return lambda stamp_ns, frame_id, ids: text.fill(",".join(ids))


def image_points(frame: FrameResult) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return, in px: joints (n, 2), landmarks as detected (l, 2), landmarks of the estimated pose (l, 2)."""
    assert frame.estimate is not None and frame.estimate.pose is not None and frame.detected is not None
    pose, n = frame.estimate.pose, len(frame.estimate.pose.positions)
    pixels = frame.images[0].project(np.concatenate([pose.positions, pose.landmarks]))  # one call of the lens is faster
    return pixels[:n], frame.detected, pixels[n:]


def keypoint_region(frame: FrameResult) -> np.ndarray:
    """Return the region of a person's keypoints: xmin, ymin, xmax, ymax, 0 to 1 of the image, and the confidence."""
    assert frame.detected is not None and frame.lens is not None
    found = frame.detected[np.isfinite(frame.detected).all(axis=1)]
    if not len(found) or not all(frame.lens.size):
        return np.zeros(5)
    corners = np.concatenate([found.min(axis=0), found.max(axis=0)]) / np.tile(frame.lens.size, 2)
    return np.append(corners.clip(0.0, 1.0), 1.0 - frame.likely_wrong)


def principal_axes(covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the one-sigma ellipsoids of covariances (n, 3, 3) m^2: quaternions (n, 4) and half axes (n, 3) m."""
    variances, axes = np.linalg.eigh(covariance)
    axes[:, :, :1] = hat(axes[:, :, 1]) @ axes[:, :, 2:]  # right-handed: x = y x z
    return to_quaternion(axes), np.sqrt(np.maximum(variances, 0.0))


def certificate_status(frame: FrameResult, name: str, hardware_id: str) -> StatusLine:
    """Return KKT residuals, duality gap, support, reprojection error, Theorem 1's margins, and the doubt.

    Theorem 1 is evaluated at the support and signs of the solution: it shows whether the lasso would recover them if
    they were the truth. frame: an accepted one; name: of the node, and of the person if there are several; hardware_id:
    the camera frame.
    """
    estimate = frame.estimate
    assert estimate is not None and estimate.increment is not None
    problem, solution = estimate.increment.problem, estimate.increment.solution
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
        "solved by": solution.method,
        "likely wrong": frame.likely_wrong,
        "doubtful": str(bool(frame.doubtful)).lower(),
        "doubtful because": ", ".join(frame.doubtful),
        "doubtful for [s]": frame.doubtful_s,
        "limbs not seen": ", ".join(frame.doubt.unseen),
    }
    level, message = (OK, "certified") if solution.certified else (WARN, "not certified")
    text = {key: value if isinstance(value, str) else f"{value:.6g}" for key, value in values.items()}
    return StatusLine(level, f"{name}: certificate", f"{message} to {KKT_TOLERANCE:g} of alpha", hardware_id, text)
