"""Motion capture for the benchmarks: clips of joint trajectories, with bone lengths and SMPL-like ground truth.

A clip file is an npz with `joints`, `root_trans`, `local_rot_wxyz`, `offsets`, `parents`, `joint_names`, `fps`,
`std_index`, `std_names` and optionally `label`; metres, world y up. `simulated_camera` shows a clip to a camera.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile
from zlib import error as DamagedArchive

import numpy as np
from scipy.spatial.transform import Rotation

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
    """Read one clip and compute the orientations of SMPL's joints. Raises SystemExit if the file is no clip."""
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


def clip_fps(file: Path) -> float:
    """Frame rate of a clip's file, Hz."""
    return float(_arrays(file)["fps"])


NUMBERS = "joints root_trans local_rot_wxyz offsets parents fps std_index".split()
STANDARD = set(EVALUATED) | {"pelvis", "spine", "head_top", "l_toe", "r_toe"}


def _arrays(file: Path) -> dict[str, np.ndarray]:
    """The arrays of a clip's file. Raises SystemExit with one line if they are missing or wrong."""
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
    """The fault of a clip's arrays, in words; empty if there is none."""
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
        return "has parents after their children, or std_index of joints that do not exist"
    missing = sorted(STANDARD - {str(name) for name in arrays["std_names"]})
    return f"has no joint {', '.join(missing)} in std_names" if missing else ""


def _smpl_orientations(world: np.ndarray, rest: np.ndarray, parents: np.ndarray, index: dict[str, int]) -> np.ndarray:
    """(f, 24, 3, 3): orientations of the clip's segments, such that the rest pose is SMPL's T-pose."""
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
    """The person's height, m: the straightened body from ankle to head top, plus 4 % for the part below the ankle."""
    length: float = 0.0
    for a, b in (("l_hip", "l_knee"), ("l_knee", "l_ankle")):
        length += float(np.linalg.norm(clip.rest_position(a) - clip.rest_position(b)))
    hips = 0.5 * (clip.rest_position("l_hip") + clip.rest_position("r_hip"))
    length += abs(hips[1])
    for a, b in (("pelvis", "neck"), ("neck", "head"), ("head", "head_top")):
        length += float(np.linalg.norm(clip.rest_position(a) - clip.rest_position(b)))
    return float(length / 0.96)


SOLE = 0.018
"""Height of the toe joint of a standing person above the floor, in heights."""


def floor_height(clip: Clip) -> float:
    """World y of the floor, m: that of the lowest toe in the lowest frames, less `SOLE`. Captures do not state it."""
    toes = np.minimum(clip.position("l_toe")[:, 1], clip.position("r_toe")[:, 1])
    return float(np.percentile(toes, 5)) - SOLE * clip_height(clip)


def clip_skeleton(clip: Clip, generic: bool) -> Skeleton:
    """A skeleton from what a user could measure: only the height (generic), or also bone lengths and the trunk at rest.

    Limbs have the clip's bone lengths (along SMPL's T-pose); hips, neck and shoulders their positions in the trunk.
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


def landmark_positions(clip: Clip, layout: Layout, skeleton: Skeleton) -> np.ndarray:
    """(f, l, 3) m, world: the clip's joints; face, feet and hands by the layout's offsets on the clip's segments."""
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
            raise SystemExit(f"the clips have no position for landmark '{layout.names[i]}' on joint '{name}'")
        result[:, i] = base + clip.orientations[:, joint] @ layout.offsets[i]
    return result


def true_state(clip: Clip, kinematics: Kinematics) -> BodyState:
    """(f, 24, 3, 3) local rotations in SMPL's tree, and the pelvis, world frame. For learning, never for tracking."""
    parents = kinematics.skeleton.parents
    local = clip.orientations.copy()
    for joint in range(1, 24):
        local[:, joint] = np.swapaxes(clip.orientations[:, parents[joint]], -1, -2) @ clip.orientations[:, joint]
    return BodyState(local, clip.position("pelvis"))
