"""A simulated camera in front of a clip, and a simulated detector: keypoints with the errors of a condition."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from benchmarks.data.depth_images import DepthCamera, DepthSensor
from benchmarks.data.mocap import EVALUATED, Clip, clip_fps, clip_height, floor_height, landmark_positions
from benchmarks.data.strangers import displaced, displacements
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton


@dataclass(frozen=True, eq=False)
class View:
    """A clip in the image of one camera.

    truth: (f, 14, 3) m and root: (f, 3) m in the camera frame; orientation: (3, 3), from the world to the camera;
    pixels: (f, l, 2); confidence: (f, l), 0 = missing; depth: (f, l) m, measured along the optical axis, None without a
    depth sensor. depth_of_surface: as in Observation.
    floor: (4,) n and h: a point p (3,) m in the camera frame is n p + h m above the floor.
    """

    clip: Clip
    fps: float
    focal: float
    centre: np.ndarray
    truth: np.ndarray
    root: np.ndarray
    orientation: np.ndarray
    pixels: np.ndarray
    confidence: np.ndarray
    depth: np.ndarray | None = None
    depth_of_surface: bool = False
    floor: np.ndarray = field(default_factory=lambda: np.zeros(4))

    @property
    def normalised(self) -> np.ndarray:
        """(f, l, 2) normalised image coordinates."""
        return (self.pixels - self.centre) / self.focal


@dataclass(frozen=True)
class Condition:
    """The errors of a simulated detector, and the set-up.

    noise_px: standard deviation of white noise, px. wander_px, offset_px: standard deviations of errors that last
    `WANDERS` s, and of constant errors, one per landmark and view, px. missing: share of missing points, in bursts.
    outliers: share of wrong points. swaps: share of the frames in which left and right are exchanged, in bursts;
    swapped: a limb drawn for each burst, or always the same (see `SWAPPED`); swap_s: duration of a burst, s, 0 for 1 to
    12 frames. fps: frame rate, Hz. camera_roll, camera_pitch: rad, the camera's mount, as the tracker's
    settings. lying: the person lies on a side drawn by the seed, and moves as if standing. depth: sensor that measures
    the depth of each landmark, camera whose depth images are sampled at the keypoints, or None. hidden: landmarks that
    are never detected. landmark_mm: standard deviation over people of the places of hips and shoulders on the body, mm,
    and of other landmarks in proportion; proportions: lengths drawn from people's in place of the capture's
    (`strangers`).
    """

    noise_px: float = 2.0
    missing: float = 0.0
    outliers: float = 0.0
    fps: float = 60.0
    swaps: float = 0.0
    camera_roll: float = 0.0
    camera_pitch: float = 0.0
    lying: bool = False
    wander_px: float = 0.0
    offset_px: float = 0.0
    depth: DepthSensor | DepthCamera | None = None
    hidden: tuple[str, ...] = ()
    landmark_mm: float = 0.0
    proportions: bool = False
    swapped: str = "limb"
    swap_s: float = 0.0


@dataclass(frozen=True)
class Told:
    """What the tracker is told of the camera's mount: its tilt, and with `floor` its height above the floor.

    tilt_off: rad by which the vertical is wrong, in a direction drawn by the clip. floor_off: m by which the height is
    too large.
    """

    floor: bool = False
    tilt_off: float = 0.0
    floor_off: float = 0.0

    def settings(self, view: View) -> dict[str, float]:
        """Settings of the tracker for a view."""
        direction = np.random.default_rng([7, *view.clip.name.encode()]).uniform(0, 2 * np.pi)
        axis = np.array([np.cos(direction), 0.0, np.sin(direction)])
        right, down, forward = Rotation.from_rotvec(self.tilt_off * axis).apply(view.floor[:3])
        found = {
            "camera_roll": float(np.arctan2(-right, -down)),
            "camera_pitch": float(np.arctan2(-forward, np.hypot(right, down))),
        }
        if self.floor:
            found["camera_height"] = max(float(view.floor[3]) + self.floor_off, 0.01)
        return found


def step_for(clip_fps: float, fps: float) -> int:
    """Step between the frames of a clip that are used, so that the rate is near `fps`; 1 if the clip is slower."""
    return max(1, round(clip_fps / fps))


def rate_of(file: Path, fps: float) -> float:
    """Frame rate, Hz, at which a clip is used if `fps` is requested."""
    own = clip_fps(file)
    return own / step_for(own, fps)


def view_of(
    clip: Clip, layout: Layout, skeleton: Skeleton, condition: Condition, view: int, seed: int, person: str = ""
) -> View:
    """One view: a camera that faces the middle of the clip, at 3-4 m, f 1000-1400 px, drawn by seed and view.

    person: the landmarks' places on the body are the same in all clips of a person.
    """
    random = np.random.default_rng([seed, view, *clip.name.encode()])
    step = step_for(clip.fps, condition.fps)
    centre = 0.5 * (clip.position("pelvis").min(0) + clip.position("pelvis").max(0))
    focal, distance = random.uniform(1000, 1400), random.uniform(3.0, 4.0)
    R = Rotation.from_euler("y", random.uniform(-np.pi, np.pi)).as_matrix()
    flip = np.diag([1.0, -1.0, -1.0])
    pitch = Rotation.from_euler("x", condition.camera_pitch + random.uniform(-0.15, 0.15)).as_matrix()
    # With scipy, not with the tracker's `level_from_camera`, which is measured here.
    mount = Rotation.from_euler("z", -condition.camera_roll).as_matrix() @ pitch
    spread = np.linalg.norm((clip.position("pelvis") - centre)[:, [0, 2]], axis=1).max()
    camera = np.array([0, 0, distance + spread])
    if condition.lying:
        R = R @ Rotation.from_euler("xy", [np.pi / 2, random.uniform(-np.pi, np.pi)]).as_matrix()
    orientation = mount @ flip @ R

    def to_camera(points: np.ndarray) -> np.ndarray:
        return (points - centre) @ orientation.T + camera

    frames = slice(None, None, step)
    truth = to_camera(np.stack([clip.position(name)[frames] for name in EVALUATED], axis=1))
    root = to_camera(clip.position("pelvis")[frames])
    landmarks = landmark_positions(clip, layout, skeleton)
    if condition.landmark_mm > 0:
        off = displacements(layout, person, condition.landmark_mm / 1000, clip_height(clip), seed)
        landmarks = displaced(landmarks, clip, layout, skeleton, off)
    points = to_camera(landmarks[frames])
    centre_px = np.array([640.0, 360.0])
    exact = points[..., :2] / points[..., 2:] * focal + centre_px
    own = np.random.default_rng([seed, view, 5, *clip.name.encode()])  # other draws do not change
    pixels, confidence = detected(exact, clip.fps / step, layout, condition, random, own)
    depth = None
    sensor = np.random.default_rng([seed, view, 9, *clip.name.encode()])
    if isinstance(condition.depth, DepthSensor):
        depth = condition.depth.measured(points[..., 2], sensor)
    elif condition.depth is not None:
        joints = {name: to_camera(clip.position(name)[frames]) for name in clip.names}
        size = (2 * int(centre_px[0]), 2 * int(centre_px[1]))
        depth = condition.depth.sampled(joints, clip_height(clip), focal, pixels, size, sensor)
    up = mount @ flip @ R @ np.array([0.0, 1.0, 0.0])
    floor = np.append(up, -up @ to_camera(np.array([0.0, floor_height(clip), 0.0])))
    measured = depth, isinstance(condition.depth, DepthCamera)
    return View(clip, clip.fps / step, focal, centre_px, truth, root, orientation, pixels, confidence, *measured, floor)


def detected(
    exact: np.ndarray,
    fps: float,
    layout: Layout,
    condition: Condition,
    random: np.random.Generator,
    of_lasting: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Return (f, l, 2) px and confidence (f, l), 0 = missing, of a detector that sees exact pixels (f, l, 2).

    of_lasting: draws the lasting errors. Raises LayoutError for a hidden landmark that the layout lacks.
    """
    pixels = exact + random.normal(size=exact.shape) * condition.noise_px
    pixels += _lasting(exact.shape, fps, condition, of_lasting)
    confidence = np.ones(exact.shape[:2])
    _spoil(pixels, confidence, condition, random)
    if condition.swaps > 0:
        length = round(condition.swap_s * fps)
        swap_sides(pixels, confidence, layout.names, condition.swaps, random, condition.swapped, length)
    confidence[:, [layout.index(name) for name in condition.hidden]] = 0
    return pixels, confidence


WANDERS = 0.1
"""s: correlation time (1 / e) of a detector's wandering error, as on real recordings."""


def _lasting(shape: tuple[int, ...], fps: float, condition: Condition, random: np.random.Generator) -> np.ndarray:
    """(f, l, 2) px: lasting errors, the sum of a first-order Gauss-Markov process and an offset."""
    offset = condition.offset_px * random.normal(size=shape[1:])
    wander = condition.wander_px * random.normal(size=shape)
    kept = np.exp(-1 / (fps * WANDERS))
    wander[1:] *= np.sqrt(1 - kept**2)
    return np.asarray(offset + lfilter([1.0], [1.0, -kept], wander, axis=0))


SWAPPED = {
    "limb": (("hip", "knee", "ankle"), ("knee", "ankle"), ("shoulder", "elbow", "wrist"), ("elbow", "wrist")),
    "body": (("eye", "ear", "shoulder", "elbow", "wrist", "hip", "knee", "ankle"),),
    "legs": (("hip", "knee", "ankle"),),
    "hips": (("hip",),),
}
"""Points that a detector exchanges with the other side together; one of the groups is drawn for each burst."""
LONGEST_SWAP = 12
"""Longest duration of a swap, frames; the shortest is 1."""


def swap_sides(
    pixels: np.ndarray,
    confidence: np.ndarray,
    names: Sequence[str],
    share: float,
    random: np.random.Generator,
    swapped: str = "limb",
    frames_each: int = 0,
) -> None:
    """Exchange left and right of one of `SWAPPED[swapped]` per burst, in place, in a share of the frames.

    pixels: (f, l, 2). frames_each: duration of a burst; 0 for a random one of 1 to `LONGEST_SWAP`.
    """
    frames = len(pixels)
    untouched = np.arange(frames) > 0  # the first frame stays
    left = min(round(share * frames), frames - 1)
    while left > 0:
        groups = SWAPPED[swapped]
        limb, start = groups[random.integers(len(groups))], random.integers(1, frames)
        length = frames_each or random.integers(1, LONGEST_SWAP + 1)
        burst = start + np.flatnonzero(untouched[start : start + length])[:left]
        pairs = [joint for joint in limb if f"left_{joint}" in names]
        one, other = ([names.index(f"{side}_{joint}") for joint in pairs] for side in ("left", "right"))
        for values in (pixels, confidence):
            values[burst[:, None], one + other] = values[burst[:, None], other + one]
        untouched[burst] = False
        left -= len(burst)


def _spoil(pixels: np.ndarray, confidence: np.ndarray, condition: Condition, random: np.random.Generator) -> None:
    """Add bursts of 5-30 missing frames per landmark, and single wrong points 30-150 px away with full confidence.

    The last burst ends when the share is reached. A whole burst more would make 24 % instead of 10 % in a clip of 82
    frames.
    """
    frames, landmarks = confidence.shape
    for landmark in range(landmarks):
        left = round(condition.missing * frames)
        while left > 0:
            start, length = random.integers(0, frames), random.integers(5, 31)
            burst = start + np.flatnonzero(confidence[start : start + length, landmark])[:left]
            confidence[burst, landmark] = 0
            left -= len(burst)
    wrong = random.random((frames, landmarks)) < condition.outliers
    angle, size = random.uniform(0, 2 * np.pi, wrong.sum()), random.uniform(30, 150, wrong.sum())
    pixels[wrong] += np.stack([np.cos(angle), np.sin(angle)], axis=-1) * size[:, None]
