"""Cameras around a person who moves in a fixed frame with z up, and a session that gets what they see (rosbags)."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from messages import FOCAL, HEIGHT, WIDTH, camera_info, cloud, rosbags_backend
from scipy.spatial.transform import Rotation
from transforms import tf_message

from lassokin_ros.core.body.kinematics import BodyPose, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.demo.synthetic import CAMERA_HEIGHT, DISTANCE, motion
from lassokin_ros.pipeline.camera.camera_places import LEVEL
from lassokin_ros.pipeline.outputs.diagnostics import Diagnostics
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings

MAP = "map"
PERSON = np.array([0.0, DISTANCE, 0.0])
"""m: where the synthetic motion takes place in the map."""


@dataclass(frozen=True)
class Eye:
    """A camera of the rig: name, and its pose as a function of the time, s."""

    name: str
    pose_at: object

    @property
    def frame(self):
        return f"{self.name}_optical"


def looking_at(centre, target, name=""):
    """The level pose of a camera at `centre` that looks at `target`, (3,) m in the map."""
    forward = np.asarray(target, dtype=float) - centre
    forward[2] = 0.0
    forward /= np.linalg.norm(forward)
    down = np.array([0.0, 0.0, -1.0])
    rotation = np.stack([np.cross(down, forward), down, forward])
    return CameraPose(name, rotation, -rotation @ centre)


def eye(name, degrees, distance=DISTANCE):
    """A camera that stands still, turned by an angle around the person."""
    angle = np.radians(degrees)
    centre = PERSON + distance * np.array([np.sin(angle), -np.cos(angle), 0.0]) + [0, 0, CAMERA_HEIGHT]
    pose = looking_at(centre, PERSON, name)
    return Eye(name, lambda seconds: pose)


def turning_eye(name, rad_s, centre=(0.0, 0.0, CAMERA_HEIGHT)):
    """A camera on a robot that turns to and fro about the vertical, rad/s at most."""

    def pose_at(seconds):
        turn = Rotation.from_euler("z", 0.3 * np.sin(rad_s / 0.3 * seconds)).as_matrix()
        rotation = LEVEL @ turn.T
        return CameraPose(name, rotation, -rotation @ np.array(centre))

    return Eye(name, pose_at)


def in_map(pose: BodyPose) -> BodyPose:
    """A pose in the frame of the demo's level camera, in the map."""
    lift = np.array([0.0, 0.0, CAMERA_HEIGHT])
    return BodyPose(LEVEL.T @ pose.orientations, pose.positions @ LEVEL + lift, pose.landmarks @ LEVEL + lift)


def truth_at(times, still=False, shift=(0.0, 0.0, 0.0), height=1.75) -> BodyPose:
    """The synthetic motion in the map at times (f,) s; still: its first pose."""
    times = np.asarray(times, dtype=float)
    pose = _truth(tuple(0 * times if still else times), height)
    return BodyPose(pose.orientations, pose.positions + shift, pose.landmarks + shift)


@lru_cache(maxsize=1000)  # tests ask for the same times again and again
def _truth(times, height) -> BodyPose:
    skeleton, kinematics = _body(height)
    return in_map(kinematics.pose(motion(skeleton, np.array(times))))


@lru_cache
def _body(height):
    skeleton = Skeleton.load("anthropometric", height)
    return skeleton, Kinematics(skeleton, Layout.load("coco17", skeleton))


def pixels(camera: Eye, seconds, landmarks, random, noise_px=1.0):
    """(l, 2) px: what a camera sees of landmarks (l, 3) m at a time, with a detector's noise."""
    points = project(camera.pose_at(seconds).into_camera(landmarks)) * FOCAL + [WIDTH / 2, HEIGHT / 2]
    return points + noise_px * random.normal(size=points.shape)


def keypoints(backend, camera: Eye, start_ns, seconds, landmarks, random, noise_px=1.0):
    """The keypoint message of a camera's image."""
    stamp_ns = start_ns + round(1e9 * seconds)
    return cloud(backend, stamp_ns, pixels(camera, seconds, landmarks, random, noise_px), frame_id=camera.frame)


def tf_of(backend, camera: Eye, start_ns, seconds, base=MAP):
    """The TF message of a camera's pose at a time."""
    pose = camera.pose_at(seconds)
    link = base, camera.frame, Rotation.from_matrix(pose.rotation.T), pose.centre
    return tf_message(backend, start_ns + round(1e9 * seconds), link)


START_NS = 1_700_000_000_000_000_000
LEFT, RIGHT = eye("left", 0), eye("right", 90)
TWO = NodeSettings(cameras=("left", "right"), fixed_frame=MAP)


@dataclass
class Result:
    """Stamp in s, and errors of an accepted frame: of the joints (n,) m, of the pelvis (3,) m; its velocity, m/s."""

    seconds: float
    error: np.ndarray
    root: np.ndarray
    frame: object


backend = lru_cache(rosbags_backend)


class Play:
    """A session with its diagnostics. late: s by which messages arrive later; px: shifts of the images, by number."""

    def __init__(
        self, eyes, settings=TWO, config=None, still=False, poses=None, height=1.75, noise_px=1.0, late=0.0, px=None
    ):
        self.eyes, self.still, self.height, self.noise_px, self.late, self.px = eyes, still, height, noise_px, late, px
        self.session = Session(config or TrackerConfig(height=1.75), settings, poses=poses)
        self.names, self.in_tf = self.session.config.camera_names, eyes
        self.follows_tf = self.session.placement.transforms is not None
        self.random, self.results, self.refused, self.shown = np.random.default_rng(0), [], [], {}
        self.diagnostics, self.now = Diagnostics(self.session, "tracker", 0.0), 0.0
        self.diagnostics.count_camera_info(0.0)
        for name, one in zip(self.names, eyes):
            assert self.session.set_camera(camera_info(backend(), frame_id=one.frame), name) is None

    def truth(self, seconds):
        return truth_at([seconds], self.still, height=self.height)

    def image(self, number, seconds, late=0.0, seen_by=None):
        """seen_by: number of the camera whose image it is; None for this one."""
        source = number if seen_by is None else seen_by
        if (source, seconds) not in self.shown:  # one image may come from two cameras
            body = self.truth(seconds).landmarks[0]
            self.shown[source, seconds] = pixels(self.eyes[source], seconds, body, self.random, self.noise_px)
        xy = self.shown[source, seconds] + (self.px or {}).get(number, 0.0)
        stamp_ns = START_NS + round(1e9 * seconds)
        message = cloud(backend(), stamp_ns, xy, frame_id=self.eyes[number].frame)
        arrival_ns = stamp_ns + round(1e9 * (0.01 + late + self.late))
        self.keep(self.session.frames(message, arrival_ns, self.names[number]), seconds, arrival_ns)

    def keep(self, frames, now=None, arrival_ns=0):
        self.now = self.now if now is None else now
        self.diagnostics.count_message(frames, arrival_ns, self.now, 0.001)
        for frame in frames:
            if not frame.accepted:
                self.refused.append(frame)
                continue
            seconds = (frame.stamp_ns - START_NS) * 1e-9
            apart = frame.estimate.pose.positions - self.truth(seconds).positions[0]
            self.results.append(Result(seconds, np.linalg.norm(apart, axis=1), apart[0], frame))

    def transforms(self, number, seconds):
        self.session.placement.transforms.add(tf_of(backend(), self.in_tf[number], START_NS, seconds), static=False)

    def run(self, seconds=2.0, hz=30, phase=0.0, tf=True, silent=lambda number, seconds: False, begin=0.0, instead={}):
        """tf: numbers of the cameras that TF places, True for all. instead: number -> that of whose images it sends."""
        for index in range(round(begin * hz), round((begin + seconds) * hz)):
            for number in range(len(self.eyes)):
                now = index / hz + number * phase
                for placed in ([*range(len(self.eyes))] if tf is True else tf or []) * self.follows_tf:
                    self.transforms(placed, now)
                if not silent(number, now):
                    self.image(number, now, seen_by=instead.get(number))
        return self

    def line(self, now=None):
        """The status, now or at a time, s."""
        return self.diagnostics.line(self.now + 0.05 if now is None else now)

    def error(self, since=0.5):
        return 1000 * float(np.median([one.error.mean() for one in self.results if one.seconds > since]))


def off(camera, degrees, metres=0.0):
    """The pose of a camera, turned about its vertical and shifted to its right."""
    pose, angle = camera.pose_at(0), np.radians(degrees)
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    return CameraPose(pose.name, turn @ pose.rotation, turn @ pose.translation + [metres, 0, 0])
