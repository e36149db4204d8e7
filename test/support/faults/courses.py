"""A session that processes good messages, with bad ones in between.

The frames of an undisturbed session are known. Therefore each good frame after a bad message can be compared with
them, byte by byte.
"""

from functools import lru_cache

import numpy as np
from detector_messages import HRI, YOLO, ZED, backend, hri_skeleton, yolo_detections, zed_objects
from faults.damage import STEP_NS
from messages import FOCAL, FRAME, HEIGHT, WIDTH, camera_info, cloud, crowd, multi_array, polygon
from sequences import TRACKED_WITHIN, aligned_error

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.image.projection import project
from lassokin_ros.demo.synthetic import motion
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings

CLOUD, POLYGON, ARRAY = (
    "sensor_msgs/msg/PointCloud2",
    "geometry_msgs/msg/PolygonStamped",
    "std_msgs/msg/Float32MultiArray",
)
DOUBLES = "std_msgs/msg/Float64MultiArray"
LAYOUTS = {
    CLOUD: "coco17",
    POLYGON: "coco17",
    ARRAY: "coco17",
    DOUBLES: "coco17",
    HRI: "hri18",
    YOLO: "coco17",
    ZED: "zed38",
}
BACKEND = backend()
TYPES = BACKEND._typestore
START_NS = 1_700_000_000_000_000_000
FRAMES = 24
NUMBERS = (3, 8)
"""Number of the tracked one of two people."""


def over_the_wire(message_type, message):
    """The message after serialisation and deserialisation, as it arrives."""
    return TYPES.deserialize_cdr(TYPES.serialize_cdr(message, message_type), message_type)


def stamp_of(index):
    return START_NS + index * STEP_NS


@lru_cache
def people(layout):
    """(true joints (FRAMES, n, 3) m, pixels (FRAMES, l, 2)) of one person, and of two side by side."""
    skeleton = Skeleton.load("anthropometric", 1.75)
    kinematics = Kinematics(skeleton, Layout.load(layout, skeleton))
    found = []
    for seed, (phase, aside) in enumerate(((0.0, 0.0), (0.0, -0.7), (5.0, 0.8))):
        states = motion(skeleton, phase + np.arange(FRAMES) * STEP_NS * 1e-9)
        pose = kinematics.pose(BodyState(states.rotations, states.translation + [aside, 0.0, 0.0]))
        noise = np.random.default_rng(seed).normal(size=pose.landmarks.shape[:-1] + (2,))
        found.append((pose.positions, project(pose.landmarks) * FOCAL + [WIDTH / 2, HEIGHT / 2] + noise))
    return found[0], found[1:]


def message_of(message_type, pixels, stamp_ns, numbers):
    """A good message of one person or more; pixels: (l, 2) each."""
    (xy, *_), scores = pixels, np.full(len(pixels[0]), 0.9)
    if message_type == CLOUD:
        several = [(points, scores) for points in pixels]
        return crowd(BACKEND, stamp_ns, several, numbers) if len(pixels) > 1 else cloud(BACKEND, stamp_ns, xy)
    if message_type == POLYGON:
        return polygon(BACKEND, stamp_ns, xy)
    if message_type in (ARRAY, DOUBLES):
        return multi_array(BACKEND, stamp_ns, xy, kind=message_type)
    if message_type == HRI:
        return hri_skeleton(BACKEND, stamp_ns, FRAME, xy, scores, (WIDTH, HEIGHT))
    if message_type == YOLO:
        return yolo_detections(BACKEND, stamp_ns, FRAME, [(p, scores) for p in pixels], list(map(str, numbers)))
    return zed_objects(BACKEND, stamp_ns, pixels, numbers)


def fingerprint(frame, person):
    """All published messages of a frame, as bytes; person: its id."""
    state = frame.estimate.state
    arrays = (frame.positions, frame.velocities, state.rotations, state.translation, frame.estimate.pose.positions)
    certificate = frame.estimate.certificate
    words = f"{person} {frame.stamp_ns} {frame.frame_id} {certificate} {frame.estimate.reprojection_px!r}"
    return b"".join(a.tobytes() for a in arrays) + words.encode()


class Course:
    """One type of message, one person or two, and the position of the session in the course."""

    backend = BACKEND

    def __init__(self, message_type, several=False, person_ids="message", **settings):
        self.message_type = message_type
        self.several, self._ids_here = several, person_ids == "node"
        alone, both = people(LAYOUTS[message_type])
        chosen = both if several else [alone]
        self.truth = [joints for joints, _ in chosen]
        self._pixels = [pixels for _, pixels in chosen]
        self.settings = (
            TrackerConfig(height=1.75, landmarks=LAYOUTS[message_type]),
            NodeSettings(
                keypoints_type=message_type, max_people=3 if several else 1, person_ids=person_ids, **settings
            ),  # noqa: E501
        )
        self.camera = camera_info(BACKEND)
        self.start_anew()
        self.expected = [self._fingerprints(self.send_good()) for _ in range(FRAMES)]
        self.restart()

    def start_anew(self):
        """Start with a new session."""
        self.session = Session(*self.settings)
        assert self.session.set_camera(self.camera) is None
        self.index = 0

    def restart(self):
        """Start from the first frame, without known people."""
        self.session.reset()
        assert self.session.set_camera(self.camera) is None
        self.index = 0

    def good(self, index):
        """The good message at a position."""
        index = min(index, FRAMES - 1)
        numbers = NUMBERS if self.several else (7,)
        return message_of(self.message_type, [p[index] for p in self._pixels], stamp_of(index), numbers)

    def send_good(self):
        """The frames of the next good message."""
        index, self.index = self.index, self.index + 1
        return self.session.frames(self.good(index), stamp_of(index))

    def lead_in(self, frames):
        """Continue until `frames` good messages have been accepted."""
        if self.index > frames:
            self.restart()
        while self.index < frames:
            self.same_as_ever()

    def same_as_ever(self):
        """Check that the next good message gives the bytes of the undisturbed session."""
        index = self.index
        assert self._fingerprints(self.send_good()) == self.expected[index], f"frame {index} differs"

    def same_or_tracked(self):
        """Like `same_as_ever`; but if the bytes differ, the next frame must be certified and near the truth.

        The points of a frame that reached the tracker may have been filtered before it was rejected.
        """
        index = self.index
        frames = self.send_good()
        if all(frame.accepted for frame in frames) and self._fingerprints(frames) == self.expected[index]:
            return
        assert self.tracked(self.send_good(), index + 1)
        self.restart()

    def _fingerprints(self, frames):
        assert all(frame.accepted for frame in frames), [frame.detail for frame in frames]
        # Ids are never given twice, so they differ after a restart; only their order is compared.
        names = [str(i) if self._ids_here else frame.person for i, frame in enumerate(frames)]
        return [fingerprint(frame, name) for frame, name in zip(frames, names)]

    def tracked(self, frames, index):
        """True if each frame is certified and near one of the people."""
        wanted = len(self.truth)
        near = 0
        for frame in frames:
            if frame.accepted:
                assert frame.estimate.certificate.kkt_residual <= 1e-6
                near += min(aligned_error(frame.estimate, t[index]) for t in self.truth) < TRACKED_WITHIN
        return near >= wanted
