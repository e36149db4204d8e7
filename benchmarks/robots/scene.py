"""A robot among people: motion capture on paths, cameras that move in a fixed frame, a detector, and a `Session`.

The fixed frame has z up. TF is exact. Places are m, times s from 0.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from benchmarks.data.mocap import clip_height, clip_skeleton, floor_height, landmark_positions, load_clip
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.rotations import to_quaternion
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.image.projection import project
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.pipeline.answers import Answer
from lassokin_ros.pipeline.session import Session
from msg_adapters.camera_info import Intrinsics
from msg_adapters.keypoints import Keypoints

Place = tuple[float, float, float]
"""x, y, m, and yaw, rad."""
FIXED = "odom"
START_NS = 10_000_000_000
OPTICAL = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""(3, 3) from a frame with x forward and z up to the optical frame of a camera that looks along x."""
WHITE_PX, SLOW_PX, CONSTANT_PX, SLOW_S = 1.5, 2.5, 2.5, 0.1
"""px, s: errors of the detector at 3.5 m, as measured on real ones; they scale with the person's size in the image."""
SEEN_WHOLE_M = 3.5
FEWEST_POINTS = 4


def turn(angle: float) -> np.ndarray:
    """(3, 3): a turn about z, rad."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


class Walker:
    """A person of a clip. `at` gives landmarks (17, 3) and pelvis (3,), m."""

    def __init__(self, file: Path, place: Place | Callable[[float], Place]) -> None:
        """place: where the person starts and in which direction, to move as captured; or at each time."""
        clip = load_clip(file)
        layout = Layout.load("coco17", Skeleton.load("anthropometric", clip_height(clip)))
        points = landmark_positions(clip, layout, clip_skeleton(clip, generic=False))
        points = np.concatenate([points, clip.position("pelvis")[:, None]], axis=1) - [0.0, floor_height(clip), 0.0]
        points = np.stack([points[..., 0], -points[..., 2], points[..., 1]], axis=-1)
        self.height, self.fps = clip_height(clip), clip.fps
        way = points[-1, -1, :2] - points[0, -1, :2]
        ahead = np.arctan2(way[1], way[0]) if np.linalg.norm(way) > 0.5 else 0.0
        points = (points - [*points[0, -1, :2], 0.0]) @ turn(-ahead).T
        if callable(place):
            points[..., :2] -= points[:, -1:, :2]
        self._points, self._place = points, place if callable(place) else lambda t: place

    @property
    def seconds(self) -> float:
        """s: length of the clip."""
        return (len(self._points) - 1) / self.fps

    def at(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Landmarks (17, 3) and pelvis (3,), m, at a time; there and back, if the clip ends before."""
        count = len(self._points) - 1
        at = t * self.fps % (2 * count)
        at = at if at <= count else 2 * count - at
        i = min(int(at), count - 1)
        points = (1 - (at - i)) * self._points[i] + (at - i) * self._points[i + 1]
        x, y, yaw = self._place(t)
        points = points @ turn(yaw).T + [x, y, 0.0]
        return points[:-1], points[-1]


@dataclass
class Camera:
    """A camera on the robot, which is at (0, 0). yaw: rad, at a time."""

    name: str = ""
    yaw: Callable[[float], float] = lambda t: 0.0
    height: float = 1.2
    focal: float = 700.0
    size: tuple[int, int] = (1280, 720)

    @property
    def frame(self) -> str:
        """Its optical frame."""
        return f"{self.name or 'front'}_optical"

    def pose(self, t: float) -> CameraPose:
        """Where it is in the fixed frame."""
        rotation = OPTICAL @ turn(self.yaw(t)).T
        return CameraPose(self.name, rotation, -rotation @ np.array([0.0, 0.0, self.height]))


@dataclass
class Scene:
    """What happens, and the detectors. numbers: of the people at a time, by their order.

    silent: whether the detector is dead at a time. hidden: whether a person is hidden, of an index and a time.
    """

    people: Sequence[Walker]
    cameras: Sequence[Camera]
    seconds: float
    fps: float = 15.0
    seed: int = 0
    numbers: Callable[[float], Sequence[int]] = lambda t: (7, 8, 9)
    silent: Callable[[float], bool] = lambda t: False
    hidden: Callable[[int, float], bool] = lambda i, t: False

    def play(self, session: Session) -> Iterator[tuple[float, list[Answer]]]:
        """Send everything to a session. Yields the time and the answers after each image."""
        random = np.random.default_rng(self.seed)
        shape = len(self.cameras), len(self.people), 17, 2
        constant, slow = random.normal(0, CONSTANT_PX, shape), random.normal(0, SLOW_PX, shape)
        keep = np.exp(-1 / self.fps / SLOW_S)
        for camera in self.cameras:
            K = np.array([[camera.focal, 0, camera.size[0] / 2], [0, camera.focal, camera.size[1] / 2], [0, 0, 1.0]])
            P = np.column_stack([K, np.zeros(3)])
            session.set_camera(Intrinsics(K, np.zeros(0), "", np.eye(3), P, *camera.size, camera.frame), camera.name)
        for t in np.arange(0.0, self.seconds, 1 / self.fps):
            stamp_ns = START_NS + round(t * 1e9)
            slow = keep * slow + np.sqrt(1 - keep**2) * random.normal(0, SLOW_PX, shape)
            for c, camera in enumerate(self.cameras):
                session.push_transforms(transform(stamp_ns, camera.pose(t), camera.frame))
                errors = constant[c] + slow[c] + random.normal(0, WHITE_PX, shape[1:])
                found = self._detections(t, camera, errors)
                if not self.silent(t):
                    answers = session.push(Keypoints.of_people(stamp_ns, camera.frame, found), stamp_ns, camera.name)
                    yield t, answers
            yield t, session.due(stamp_ns + round(0.9e9 / self.fps))

    def _detections(self, t: float, camera: Camera, errors: np.ndarray) -> list[tuple[int, np.ndarray, np.ndarray]]:
        found = []
        for i, person in enumerate(self.people):
            inside = camera.pose(t).into_camera(person.at(t)[0])
            ahead = inside[:, 2] > 0.3
            pixels = camera.focal * project(np.where(ahead[:, None], inside, 1.0)) + np.array(camera.size) / 2
            pixels += errors[i] * SEEN_WHOLE_M / np.clip(np.median(inside[:, 2]), 1.5, 8.0)
            seen = ahead & (pixels > 2).all(axis=1) & (pixels < np.array(camera.size) - 2).all(axis=1)
            if seen.sum() >= FEWEST_POINTS and not self.hidden(i, t):
                found.append((self.numbers(t)[i], np.where(seen[:, None], pixels, 0.0), np.where(seen, 0.85, 0.0)))
        return found


def transform(stamp_ns: int, pose: CameraPose, frame: str) -> SimpleNamespace:
    """The fields of a TFMessage with the pose of a camera in the fixed frame."""
    seconds, nanoseconds = divmod(stamp_ns, 10**9)
    (x, y, z, w), place = to_quaternion(pose.rotation.T[None])[0], pose.centre
    header = SimpleNamespace(frame_id=FIXED, stamp=SimpleNamespace(sec=seconds, nanosec=nanoseconds))
    shift = SimpleNamespace(x=place[0], y=place[1], z=place[2])
    motion = SimpleNamespace(rotation=SimpleNamespace(x=x, y=y, z=z, w=w), translation=shift)
    one = SimpleNamespace(header=header, child_frame_id=frame, transform=motion)
    return SimpleNamespace(transforms=[one])
