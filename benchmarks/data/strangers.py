"""Simulated strangers: landmarks that lie elsewhere on the body than in the layout, and people's own proportions.

Both are constant in the body, not in the image, the same in all clips and views of a person, and symmetric. The sizes
were measured on recordings of eleven people, by four detectors, whose landmarks were triangulated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.data.mocap import Clip, clip_height
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton

LARGEST = "hip", "shoulder"
"""Landmarks to whose places the given deviation applies. `SHARES` has those of the others, as a share of it."""
SHARES = {"knee": 0.6, "ankle": 0.7, "elbow": 0.5, "wrist": 0.5, "heel": 0.8, "toe": 0.8, "foot": 0.8, "ear": 0.5}
SMALLEST = 0.33
"""Share of all other landmarks, such as eyes, nose and hands."""
CARRIERS = {
    "hip": "pelvis",
    "knee": "hip",
    "ankle": "knee",
    "shoulder": "spine3",
    "elbow": "shoulder",
    "wrist": "elbow",
}
"""Joint in whose segment a landmark at a joint's centre stays. Others stay in the segment of their own joint."""
DETECTORS: Mapping[str, Mapping[str, tuple[float, float, float]]] = {
    "mediapipe33": {"ear": (-0.011, 0.011, 0.049), "knee": (0.0, 0.0, -0.009)}
}
"""m, by layout: what all people's landmarks of a detector have in common, beyond the layout; x to the outside, y up, z
to the front."""
TALLNESS = 1.7
"""m: height of a person whose landmarks are off by these sizes; they grow with the height."""


def displacements(layout: Layout, person: str, deviation: float, height: float, seed: int) -> np.ndarray:
    """(l, 3) m in the carriers' frames: how far a person's landmarks are from those of the layout.

    deviation: m along each axis, standard deviation over people for `LARGEST`. The draw depends on person and seed.
    """
    random = np.random.default_rng([seed, 131, *person.encode()])
    kinds = {kind: random.normal(size=3) for kind in sorted({_unsided(name) for name in layout.names})}
    result = np.zeros((len(layout.names), 3))
    for i, name in enumerate(layout.names):
        common = next((c for part, c in DETECTORS.get(layout.name, {}).items() if part in name), (0.0, 0.0, 0.0))
        own = np.array(common) + deviation * _share(name) * kinds[_unsided(name)]
        result[i] = own * [_outwards(name), 1.0, 1.0]
    return result * height / TALLNESS


def displaced(points: np.ndarray, clip: Clip, layout: Layout, skeleton: Skeleton, by: np.ndarray) -> np.ndarray:
    """(f, l, 3) m: landmarks (f, l, 3) of a clip moved by (l, 3) m in the frames of their carriers."""
    carriers = [
        skeleton.index(carrier_of(skeleton.joint_names[joint], offset))
        for joint, offset in zip(layout.joints, layout.offsets)
    ]
    return points + np.einsum("flij,lj->fli", clip.orientations[:, carriers], by)


def carrier_of(joint: str, offset: np.ndarray) -> str:
    """The joint in whose segment a landmark of a joint, at an offset of it, stays."""
    kind = _unsided(joint)
    if np.any(offset) or kind not in CARRIERS:
        return joint
    carrier = CARRIERS[kind]
    return carrier if carrier in ("pelvis", "spine3") else joint.replace(kind, carrier)


def _share(name: str) -> float:
    if name.endswith(LARGEST):
        return 1.0
    return next((share for part, share in SHARES.items() if part in name), SMALLEST)


def _unsided(name: str) -> str:
    return "_".join(part for part in name.split("_") if part not in ("left", "right"))


def _outwards(name: str) -> float:
    """Sign of x to the outside: positive on the left; 0 for a landmark in the middle of the body."""
    parts = name.split("_")
    return float("left" in parts) - float("right" in parts)


LENGTHS = ("thigh", "shank", "trunk", "hips", "shoulders", "upper arm", "forearm")
MEAN = (-0.03, -0.05, 0.07, 0.27, -0.07, 0.05, -0.03)
SPREAD = (0.03, 0.04, 0.05, 0.12, 0.09, 0.03, 0.04)
"""Log-lengths of people about the proportions of Winter and de Leva, at the height that their limbs have: mean and
standard deviation over nine recorded people (arms and shoulders: eleven)."""
PUBLISHED = (0.245, 0.246, 0.292, 0.102, 0.224, 0.160, 0.153)
"""These proportions, as fractions of the height. The simulation does not change with the tracker's built-in body."""
PELVIS = (0.0, 0.055, -0.010)
"""Place of the pelvis from the middle of the hips, fraction of the height, in the pelvis' frame. Captures place it up
to 12 cm away from there, and MPJPE is aligned at it."""
BONES = {"thigh": ("hip", "knee"), "shank": ("knee", "ankle"), "upper arm": ("shoulder", "elbow"),
         "forearm": ("elbow", "wrist")}  # fmt: skip


def with_peoples_proportions(clip: Clip, person: str, seed: int) -> Clip:
    """The clip with lengths drawn for the person from those of people; its rotations, height, neck and head stay.

    The path of the hips is scaled with the legs, so that standing feet stand still.
    """
    random = np.random.default_rng([seed, 137, *person.encode()])
    drawn = np.exp(np.array(MEAN) + np.array(SPREAD) * random.normal(size=len(MEAN)))
    wanted = dict(zip(LENGTHS, clip_height(clip) * np.array(PUBLISHED) * drawn))
    factors = {name: wanted[name] / own for name, own in _own_lengths(clip).items()}
    pelvis = clip_height(clip) * np.array(PELVIS)
    rest = _reshaped(clip.rest[None], clip.names, factors, pelvis[None])[0]
    rest -= rest[clip.names.index("pelvis")]
    standard = _reshaped(clip.standard, clip.names, factors, clip.orientations[:, 0] @ pelvis)
    return replace(clip, standard=standard, rest=rest)


def _own_lengths(clip: Clip) -> dict[str, float]:
    def apart(a: np.ndarray, b: np.ndarray) -> float:
        return float(np.linalg.norm(a - b))

    place = clip.rest_position
    hips, shoulders = ([place(f"{side}_{joint}") for side in "lr"] for joint in ("hip", "shoulder"))
    bones = {
        name: float(np.mean([apart(place(f"{side}_{a}"), place(f"{side}_{b}")) for side in "lr"]))
        for name, (a, b) in BONES.items()
    }
    trunk = apart(np.mean(hips, axis=0), np.mean(shoulders, axis=0))
    return {**bones, "trunk": trunk, "hips": apart(*hips), "shoulders": apart(*shoulders)}


def _reshaped(points: np.ndarray, names: Sequence[str], factors: Mapping[str, float], pelvis: np.ndarray) -> np.ndarray:
    """(f, j, 3) m: standard joints (f, j, 3) with each length multiplied by its factor.

    pelvis: (f, 3) m from the middle of the hips to the pelvis.
    """
    at = {name: points[:, i] for i, name in enumerate(names)}
    legs = (factors["thigh"] + factors["shank"]) / 2
    hips, shoulders = (0.5 * (at[f"l_{joint}"] + at[f"r_{joint}"]) for joint in ("hip", "shoulder"))
    new = {"pelvis": legs * hips + pelvis}

    def on_trunk(point: np.ndarray) -> np.ndarray:
        return np.asarray(legs * hips + factors["trunk"] * (point - hips))

    for name in ("spine", "thorax", "neck"):
        new[name] = on_trunk(at[name])
    for name, below in (("head", "neck"), ("head_top", "head")):
        new[name] = new[below] + at[name] - at[below]
    for side in "lr":
        new[f"{side}_hip"] = legs * hips + factors["hips"] * (at[f"{side}_hip"] - hips)
        new[f"{side}_shoulder"] = on_trunk(shoulders) + factors["shoulders"] * (at[f"{side}_shoulder"] - shoulders)
        for bone, (a, b) in BONES.items():
            start, end = f"{side}_{a}", f"{side}_{b}"
            new[end] = new[start] + factors[bone] * (at[end] - at[start])
        new[f"{side}_toe"] = new[f"{side}_ankle"] + at[f"{side}_toe"] - at[f"{side}_ankle"]
    return np.stack([new[name] for name in names], axis=1)
