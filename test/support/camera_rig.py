"""Cameras around a person who moves in a fixed frame with z up, for rclpy's and rosbags' message objects alike."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from messages import FOCAL, HEIGHT, WIDTH, cloud
from scipy.spatial.transform import Rotation
from transforms import tf_message

from lassokin_ros.core.body.kinematics import BodyPose, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.demo.synthetic import CAMERA_HEIGHT, DISTANCE, motion
from lassokin_ros.pipeline.camera.camera_places import LEVEL

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
