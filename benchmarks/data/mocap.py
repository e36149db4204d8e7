"""Real motion for measuring: clips of joint trajectories, a camera's view of them, and SMPL-like ground truth.

A clip file is an npz with `joints`, `root_trans`, `local_rot_wxyz`, `offsets`, `parents`, `joint_names`, `fps`,
`std_index` and `std_names`, and a `label` if you like; metres, world Y up (the folder's README says more).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile
from zlib import error as DamagedArchive

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from benchmarks.data.depth_sensor import DepthSensor
from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.rotations import least_turn
from lassokin_ros.core.body.skeleton import Skeleton

EVALUATED = (
    "l_hip r_hip l_knee r_knee l_ankle r_ankle l_shoulder r_shoulder l_elbow r_elbow l_wrist r_wrist neck head".split()
)
SMPL_NAME = {
    "pelvis": "pelvis",
    "neck": "neck",
    "head": "head",
    **{
        f"{side[0]}_{joint}": f"{side}_{joint}"
        for side in ("left", "right")
        for joint in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
    },
}


@dataclass(frozen=True, eq=False)
class Clip:
    """One clip: `standard` (f, 20, 3) m world joints by standard name, `smpl` (f, 24, 3, 3) world orientations."""

    name: str
    label: str
    fps: float
    names: tuple[str, ...]
    standard: np.ndarray
    rest: np.ndarray
    orientations: np.ndarray

    def position(self, name: str) -> np.ndarray:
        """(f, 3) world trajectory of a standard joint."""
        return self.standard[:, self.names.index(name)]

    def rest_position(self, name: str) -> np.ndarray:
        """(3,) of a standard joint in the clip's own rest pose, pelvis at the origin."""
        return self.rest[self.names.index(name)]


def load_clips(folder: Path, names: list[str] | None = None) -> list[Clip]:
    """All clips of a folder, or those named."""
    files = sorted(folder.glob("*.npz"))
    if names:
        missing = sorted(set(names) - {file.stem for file in files})
        if missing:
            raise SystemExit(f"no clip {', '.join(missing)} in {folder}; it has: {', '.join(f.stem for f in files)}")
        files = [file for file in files if file.stem in names]
    if not files:
        raise SystemExit(f"no clips (*.npz) in {folder}; expected motion capture in the format of its README")
    return [load_clip(file) for file in files]


def load_clip(file: Path) -> Clip:
    """Read one clip and derive the orientations that SMPL's joints would have; SystemExit where the file is none."""
    data = _arrays(file)
    parents, offsets = data["parents"], data["offsets"]
    local = data["local_rot_wxyz"]
    frames, count = local.shape[:2]
    local_rotations = (
        Rotation.from_quat(local[..., [1, 2, 3, 0]].reshape(-1, 4)).as_matrix().reshape(frames, count, 3, 3)
    )
    world = np.zeros_like(local_rotations)
    rest = np.zeros((count, 3))
    for joint, parent in enumerate(parents):
        if parent < 0:
            world[:, joint] = local_rotations[:, joint]
        else:
            world[:, joint] = world[:, parent] @ local_rotations[:, joint]
            rest[joint] = rest[parent] + offsets[joint]
    index = {str(name): int(i) for name, i in zip(data["std_names"], data["std_index"])}
    index["thorax"] = int(parents[index["neck"]])
    orientations = _smpl_orientations(world, rest, parents, index)
    return Clip(
        file.stem,
        str(data.get("label", "")),
        float(data["fps"]),
        tuple(index),
        data["joints"][:, list(index.values())],
        rest[list(index.values())],
        orientations,
    )


NUMBERS = "joints root_trans local_rot_wxyz offsets parents fps std_index".split()
STANDARD = set(EVALUATED) | {"pelvis", "spine", "head_top", "l_toe", "r_toe"}


def _arrays(file: Path) -> dict[str, np.ndarray]:
    """What a clip's file holds, as it must be; SystemExit with one line where it is not."""
    expected = "expected motion capture in the form that benchmarks/data/mocap.py describes"
    try:
        with np.load(file, allow_pickle=False) as data:
            lacking = [name for name in (*NUMBERS, "std_names") if name not in data]
            arrays = {name: data[name] for name in data}
    except (OSError, EOFError, BadZipFile, DamagedArchive, ValueError, TypeError, AttributeError):
        raise SystemExit(f"{file} is no npz file of plain arrays; {expected}") from None
    fault = f"has no {', '.join(lacking)}" if lacking else _fault(arrays)
    if fault:
        raise SystemExit(f"{file} {fault}; {expected}")
    return arrays


def _fault(arrays: dict[str, np.ndarray]) -> str:
    """What makes a clip's arrays useless, in words; nothing when they are as they must be."""
    for name in NUMBERS:
        if arrays[name].dtype.kind not in "fiu" or not np.isfinite(arrays[name]).all():
            return f"has {name} that are not all finite numbers"
    frames, joints = len(np.atleast_1d(arrays["root_trans"])), len(np.atleast_1d(arrays["parents"]))
    shapes = {"joints": (frames, joints, 3), "root_trans": (frames, 3), "local_rot_wxyz": (frames, joints, 4)}
    shapes |= {"offsets": (joints, 3), "parents": (joints,), "fps": (), "std_index": arrays["std_names"].shape}
    for name, shape in shapes.items():
        if arrays[name].shape != shape:
            return f"has {name} of shape {arrays[name].shape}, not {shape}"
    if frames == 0 or not arrays["fps"] > 0:
        return f"has {frames} frames at {float(arrays['fps']):g} Hz"
    if not np.linalg.norm(arrays["local_rot_wxyz"], axis=-1).all():
        return "has rotations of length 0"
    if (arrays["parents"] >= np.arange(joints)).any() or not np.isin(arrays["std_index"], np.arange(joints)).all():
        return "has parents that come after their children, or std_index of joints that are not there"
    missing = sorted(STANDARD - {str(name) for name in arrays["std_names"]})
    return f"has no joint {', '.join(missing)} in std_names" if missing else ""


def _smpl_orientations(world: np.ndarray, rest: np.ndarray, parents: np.ndarray, index: dict[str, int]) -> np.ndarray:
    """(f, 24, 3, 3): the clip's segment orientations, turned so that limbs lie as in SMPL's T-pose at rest."""
    frames = world.shape[0]
    smpl = Skeleton.load("anthropometric", 1.75)
    result = np.repeat(world[:, index["pelvis"]][:, None], 24, axis=1)

    def segment(joint: str, start: str, end: str, direction: tuple[float, float, float] | None) -> None:
        turn = np.eye(3)
        if direction is not None:
            bone = rest[index[end]] - rest[index[start]]
            turn = least_turn(np.array(direction), bone)
        result[:, smpl.index(joint)] = world[:, index[start]] @ turn

    spine, neck, thorax = index["spine"], index["neck"], index["thorax"]
    result[:, smpl.index("spine1")] = world[:, int(parents[spine])]
    result[:, smpl.index("spine2")] = world[:, spine]
    for joint in ("spine3", "left_collar", "right_collar"):
        result[:, smpl.index(joint)] = world[:, thorax]
    for side in ("left", "right"):
        s = side[0]
        collar = int(parents[index[f"{s}_shoulder"]])
        result[:, smpl.index(f"{side}_collar")] = world[:, collar]
        outward = (1.0 if s == "l" else -1.0, 0.0, 0.0)
        segment(f"{side}_hip", f"{s}_hip", f"{s}_knee", (0, -1, 0))
        segment(f"{side}_knee", f"{s}_knee", f"{s}_ankle", (0, -1, 0))
        ankle = world[:, index[f"{s}_ankle"]]
        result[:, smpl.index(f"{side}_ankle")] = result[:, smpl.index(f"{side}_foot")] = ankle
        segment(f"{side}_shoulder", f"{s}_shoulder", f"{s}_elbow", outward)
        segment(f"{side}_elbow", f"{s}_elbow", f"{s}_wrist", outward)
        for joint in ("wrist", "hand"):
            result[:, smpl.index(f"{side}_{joint}")] = result[:, smpl.index(f"{side}_elbow")]
    result[:, smpl.index("neck")] = world[:, neck]
    result[:, smpl.index("head")] = world[:, index["head"]]
    assert result.shape == (frames, 24, 3, 3)
    return result


def clip_height(clip: Clip) -> float:
    """The person's height, m: stretched out from ankle to head top, plus the 4 % that lie below the ankle."""
    length: float = 0.0
    for a, b in (("l_hip", "l_knee"), ("l_knee", "l_ankle")):
        length += float(np.linalg.norm(clip.rest_position(a) - clip.rest_position(b)))
    hips = 0.5 * (clip.rest_position("l_hip") + clip.rest_position("r_hip"))
    length += abs(hips[1])
    for a, b in (("pelvis", "neck"), ("neck", "head"), ("head", "head_top")):
        length += float(np.linalg.norm(clip.rest_position(a) - clip.rest_position(b)))
    return float(length / 0.96)


def clip_skeleton(clip: Clip, generic: bool) -> Skeleton:
    """What a user could measure of this person: the height alone, or also bone lengths and the trunk at rest.

    Limbs get the clip's bone lengths (along SMPL's T-pose); hips, neck and shoulders their place in the trunk.
    """
    skeleton = Skeleton.load("anthropometric", clip_height(clip))
    if generic:
        return skeleton
    place = {joint: skeleton.rest_positions[i] for i, joint in enumerate(skeleton.joint_names)}
    offsets = skeleton.offsets.copy()

    def set_offset(joint: str, value: np.ndarray) -> None:
        offsets[skeleton.index(joint)] = value

    neck, spine, chest = clip.rest_position("neck"), clip.rest_position("spine"), clip.rest_position("thorax")
    for joint, value in (("spine1", 0 * spine), ("spine2", spine), ("spine3", chest - spine)):
        set_offset(joint, value)
    set_offset("neck", neck - chest)
    set_offset("head", np.array([0, np.linalg.norm(clip.rest_position("head") - neck), 0]))
    for side in ("left", "right"):
        s, sign = side[0], 1 if side == "left" else -1
        set_offset(f"{side}_hip", clip.rest_position(f"{s}_hip"))
        shoulder = clip.rest_position(f"{s}_shoulder")
        collar = chest + place[f"{side}_collar"] - place["spine3"]
        collar[1] = neck[1] if clip.rest_position("neck")[1] > chest[1] else chest[1]
        set_offset(f"{side}_collar", collar - chest)
        set_offset(f"{side}_shoulder", shoulder - collar)
        for joint, a, b, direction in (
            ("knee", "hip", "knee", (0, -1, 0)),
            ("ankle", "knee", "ankle", (0, -1, 0)),
            ("elbow", "shoulder", "elbow", (sign, 0, 0)),
            ("wrist", "elbow", "wrist", (sign, 0, 0)),
        ):
            length = np.linalg.norm(clip.rest_position(f"{s}_{a}") - clip.rest_position(f"{s}_{b}"))
            set_offset(f"{side}_{joint}", length * np.array(direction, dtype=float))
    return skeleton.with_offsets(offsets)


@dataclass(frozen=True, eq=False)
class View:
    """A clip as one camera sees it.

    truth: (f, 14, 3) m and root: (f, 3) m in the camera frame; pixels: (f, l, 2); confidence: (f, l), 0 = missing;
    depth: (f, l) m, measured along the optical axis, None without a depth sensor.
    """

    clip: Clip
    fps: float
    focal: float
    centre: np.ndarray
    truth: np.ndarray
    root: np.ndarray
    pixels: np.ndarray
    confidence: np.ndarray
    depth: np.ndarray | None = None

    @property
    def normalised(self) -> np.ndarray:
        """(f, l, 2) normalised image coordinates."""
        return (self.pixels - self.centre) / self.focal


@dataclass(frozen=True)
class Condition:
    """What happens to the exact projections: pixels of noise, shares missing (in bursts) and wrong, frame rate.

    swaps: share of the frames in which some limb's left and right are taken for each other, in bursts.
    duplicates: frames for which each detection stands, under stamps of their own: a detector slower than the camera.
    camera_roll, camera_pitch: rad, of the camera's mount, as the tracker's settings of that name. lying: the person is
    laid down, on a side drawn by the seed, and moves as if standing. wander_px, offset_px: standard deviations of what
    a detector is off by for `WANDERS` s on end, and for ever (a place of its own for each landmark of a view). depth:
    what measures the depth of each landmark; None: nothing does.
    """

    noise_px: float = 2.0
    missing: float = 0.0
    outliers: float = 0.0
    fps: float = 60.0
    swaps: float = 0.0
    duplicates: int = 1
    camera_roll: float = 0.0
    camera_pitch: float = 0.0
    lying: bool = False
    wander_px: float = 0.0
    offset_px: float = 0.0
    depth: DepthSensor | None = None


def step_for(clip_fps: float, fps: float) -> int:
    """Every which frame of a clip is used to come near `fps`; all of one that has no more."""
    return max(1, round(clip_fps / fps))


def rate_of(file: Path, fps: float) -> float:
    """Hz at which a clip's frames are used when `fps` are asked for."""
    own = float(_arrays(file)["fps"])
    return own / step_for(own, fps)


def view_of(clip: Clip, layout: Layout, skeleton: Skeleton, condition: Condition, view: int, seed: int) -> View:
    """Render one view: a camera that faces the clip's middle, 3-4 m away, f 1000-1400 px, by a seeded draw per view."""
    random = np.random.default_rng([seed, view, *clip.name.encode()])
    step = step_for(clip.fps, condition.fps)
    centre = 0.5 * (clip.position("pelvis").min(0) + clip.position("pelvis").max(0))
    focal, distance = random.uniform(1000, 1400), random.uniform(3.0, 4.0)
    yaw = random.uniform(-np.pi, np.pi)
    R = Rotation.from_euler("y", yaw).as_matrix()
    flip = np.diag([1.0, -1.0, -1.0])
    pitch = Rotation.from_euler("x", condition.camera_pitch + random.uniform(-0.15, 0.15)).as_matrix()
    # By scipy's angles, not the tracker's `level_from_camera`, which this is to measure.
    mount = Rotation.from_euler("z", -condition.camera_roll).as_matrix() @ pitch
    spread = np.linalg.norm((clip.position("pelvis") - centre)[:, [0, 2]], axis=1).max()
    camera = np.array([0, 0, distance + spread])
    if condition.lying:
        R = R @ Rotation.from_euler("xy", [np.pi / 2, random.uniform(-np.pi, np.pi)]).as_matrix()

    def to_camera(points: np.ndarray) -> np.ndarray:
        return ((points - centre) @ R.T) @ (mount @ flip).T + camera

    frames = slice(None, None, step)
    truth = to_camera(np.stack([clip.position(name)[frames] for name in EVALUATED], axis=1))
    root = to_camera(clip.position("pelvis")[frames])
    points = to_camera(landmark_positions(clip, layout, skeleton)[frames])
    centre_px = np.array([640.0, 360.0])
    exact = points[..., :2] / points[..., 2:] * focal + centre_px
    pixels = exact + random.normal(size=exact.shape) * condition.noise_px
    own = np.random.default_rng([seed, view, 5, *clip.name.encode()])  # so that all else stays as it was drawn
    pixels += _lasting(exact.shape, clip.fps / step, condition, own)
    confidence = np.ones(exact.shape[:2])
    _spoil(pixels, confidence, condition, random)
    if condition.swaps > 0:
        swap_sides(pixels, confidence, layout.names, condition.swaps, random)
    detected = np.arange(len(pixels)) // condition.duplicates * condition.duplicates
    pixels, confidence = pixels[detected], confidence[detected]
    depth = None
    if condition.depth is not None:
        sensor = np.random.default_rng([seed, view, 9, *clip.name.encode()])
        depth = condition.depth.measured(points[..., 2], sensor)[detected]
    return View(clip, clip.fps / step, focal, centre_px, truth, root, pixels, confidence, depth)


WANDERS = 0.1
"""s: after this, a detector's wandering error has 1 / e of its correlation left; so on real recordings."""


def _lasting(shape: tuple[int, ...], fps: float, condition: Condition, random: np.random.Generator) -> np.ndarray:
    """px (f, l, 2): errors that last, a first-order Gauss-Markov process and an offset, of the condition's sizes."""
    offset = condition.offset_px * random.normal(size=shape[1:])
    wander = condition.wander_px * random.normal(size=shape)
    kept = np.exp(-1 / (fps * WANDERS))
    wander[1:] *= np.sqrt(1 - kept**2)
    return np.asarray(offset + lfilter([1.0], [1.0, -kept], wander, axis=0))


SWAPPED = (("hip", "knee", "ankle"), ("knee", "ankle"), ("shoulder", "elbow", "wrist"), ("elbow", "wrist"))
"""What a detector takes for the other side's together."""
LONGEST_SWAP = 12
"""frames: swaps last 1 to this many."""


def swap_sides(
    pixels: np.ndarray, confidence: np.ndarray, names: Sequence[str], share: float, random: np.random.Generator
) -> None:
    """Change left and right of one of `SWAPPED` in each burst, in place, in a share of the frames; pixels (f, l, 2)."""
    frames = len(pixels)
    untouched = np.arange(frames) > 0  # the first frame stays
    left = min(round(share * frames), frames - 1)
    while left > 0:
        limb, start = SWAPPED[random.integers(len(SWAPPED))], random.integers(1, frames)
        length = random.integers(1, LONGEST_SWAP + 1)
        burst = start + np.flatnonzero(untouched[start : start + length])[:left]
        one, other = ([names.index(f"{side}_{joint}") for joint in limb] for side in ("left", "right"))
        for values in (pixels, confidence):
            values[burst[:, None], one + other] = values[burst[:, None], other + one]
        untouched[burst] = False
        left -= len(burst)


def landmark_positions(clip: Clip, layout: Layout, skeleton: Skeleton) -> np.ndarray:
    """(f, l, 3) world: the clip's own joints; face, feet and hands as the layout's offsets on the clip's segments."""
    result = np.empty((len(clip.standard), len(layout.names), 3))
    standard = {smpl: name for name, smpl in SMPL_NAME.items()}
    for i, joint in enumerate(layout.joints):
        name = skeleton.joint_names[joint]
        if name in standard:
            base = clip.position(standard[name])
        elif name in ("left_foot", "right_foot"):
            base = clip.position(f"{name[0]}_toe")
        elif name == "spine3":
            base = clip.position("neck") - clip.orientations[:, joint] @ skeleton.offsets[skeleton.index("neck")]
        elif name == "spine2":
            base = clip.position("spine")
        else:
            raise SystemExit(f"the clips have no place for landmark '{layout.names[i]}' on joint '{name}'")
        result[:, i] = base + clip.orientations[:, joint] @ layout.offsets[i]
    return result


def _spoil(pixels: np.ndarray, confidence: np.ndarray, condition: Condition, random: np.random.Generator) -> None:
    """Bursts of 5-30 missing frames per landmark, and single wrong points 30-150 px away at full confidence.

    The last burst ends where the share is reached: a whole one more makes 24 % of 10 % in a clip of 82 frames.
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


def true_state(clip: Clip, kinematics: Kinematics) -> BodyState:
    """(f, 24, 3, 3) local rotations in SMPL's tree and the pelvis, world frame: for learning, never for tracking."""
    parents = kinematics.skeleton.parents
    local = clip.orientations.copy()
    for joint in range(1, 24):
        local[:, joint] = np.swapaxes(clip.orientations[:, parents[joint]], -1, -2) @ clip.orientations[:, joint]
    return BodyState(local, clip.position("pelvis"))
