"""Motion capture as the depth network's training uses it: canonical points of all clips in one array."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.data.mocap import Clip, clip_height, clip_skeleton, landmark_positions, load_clip
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.network.depth_network import CANONICAL, LENGTHS, NAMES, lengths_between

TEST = ("03", "05", "12", "29", "55", "127")
"""People of the final test. None of their clips is among the training clips of the shipped pose prior."""
VALIDATION = ("09", "13", "43", "94", "131", "prmd_05")
"""People of the validation set, with which the design was chosen."""
LEFT_OUT_KINDS = ("mime of animals",)
LEFT_OUT_CLIPS = ("ad_jumping_jacks", "131_03", "exp_", "11_01", "gs_backflip")
"""Prefixes of clip names: clips with a trunk that is 11 cm too short, and two with optical glitches."""
OTHER_PEOPLE = {"gs_lambada": "55", "gs_charleston1": "93", "gs_charleston2": "93"}
LESS_TRUSTED = {"ju": 0.4, "pa": 0.4, "ex": 0.6, "ne": 0.6, "up": 0.4}
"""Factors on the weights of clips with a generic or reduced skeleton."""
LONGEST = 60.0
"""s: largest duration of a person's clips of one kind that counts, before the square root."""


@dataclass(frozen=True)
class Source:
    """A clip's file, person, kind of motion and collection."""

    file: Path
    person: str
    kind: str
    collection: str


def sources(folder: Path) -> list[Source]:
    """All clips in `mocap` and `corpus` below a folder that are suitable for training or testing."""
    found = []
    for part in ("mocap", "corpus"):
        entries = {entry["id"]: entry for entry in json.loads((folder / part / "clips.json").read_text())}
        for file in sorted((folder / part).glob("*.npz")):
            entry, name = entries.get(file.stem, {}), file.stem
            person = entry.get("subject") or OTHER_PEOPLE.get(name) or name.split("_")[0]
            kind = entry.get("kind") or entry.get("label", "")
            found.append(Source(file, str(person), kind, name.split("_")[0] if part == "corpus" else "mocap"))
    return found


def training_sources(folder: Path, held_out: Collection[str]) -> list[Source]:
    """Clips for training: all except those of held-out people and those with known faults."""
    return [
        source
        for source in sources(folder)
        if source.person not in held_out
        and source.kind not in LEFT_OUT_KINDS
        and not source.file.stem.startswith(LEFT_OUT_CLIPS)
    ]


@dataclass(frozen=True, eq=False)
class Motion:
    """Concatenated clips.

    points: (frames, canonical, 3) m, world, y up; start, count, fps, weight: (clips,); parts: (clips, 6) m, the parts
    that add up to the height (`HEIGHT_PARTS`); lengths: (clips, LENGTHS) m; people: of each clip.
    """

    points: np.ndarray
    start: np.ndarray
    count: np.ndarray
    fps: np.ndarray
    weight: np.ndarray
    parts: np.ndarray
    lengths: np.ndarray
    people: tuple[str, ...]


HEIGHT_PARTS = ("thigh", "shank", "hips", "trunk", "neck", "head")


def _height_parts(clip: Clip) -> np.ndarray:
    """(6,) m, the parts of the height, as in `clip_height`."""

    def apart(a: str, b: str) -> float:
        return float(np.linalg.norm(clip.rest_position(a) - clip.rest_position(b)))

    drop = abs(0.5 * (clip.rest_position("l_hip") + clip.rest_position("r_hip"))[1])
    return np.array([apart("l_hip", "l_knee"), apart("l_knee", "l_ankle"), drop, apart("pelvis", "neck"),
                     apart("neck", "head"), apart("head", "head_top")]) / 0.96  # fmt: skip


def canonical_layout(skeleton: Skeleton) -> Layout:
    """The canonical points as a landmark layout."""
    landmarks = [{"name": name, "joint": joint, "offset": list(offset)} for name, joint, offset in CANONICAL]
    return Layout.from_mapping({"name": "canonical", "landmarks": landmarks}, skeleton)


def load_motion(chosen: list[Source]) -> Motion:
    """Read clips. A person's clips of one kind share a weight that grows with the square root of their duration."""
    points, parts, lengths, fps = [], [], [], []
    seconds: dict[tuple[str, str], float] = defaultdict(float)
    for source in chosen:
        clip = load_clip(source.file)
        skeleton = clip_skeleton(clip, generic=False)
        points.append(landmark_positions(clip, canonical_layout(skeleton), skeleton).astype(np.float32))
        parts.append(_height_parts(clip))
        assert abs(parts[-1].sum() - clip_height(clip)) < 1e-6
        joints = "hip knee ankle shoulder elbow wrist".split()
        rest = {f"{s}_{j}": clip.rest_position(f"{s[0]}_{j}") for s in ("left", "right") for j in joints}
        rest["head"] = clip.rest_position("head")
        lengths.append(lengths_between(rest))
        fps.append(clip.fps)
        seconds[source.person, source.kind] += len(points[-1]) / clip.fps
    weight = []
    for source, frames, rate in zip(chosen, points, fps):
        total = seconds[source.person, source.kind]
        share = len(frames) / rate / total
        weight.append(share * np.sqrt(min(total, LONGEST)) * LESS_TRUSTED.get(source.collection, 1.0))
    count = np.array([len(frames) for frames in points])
    assert len(CANONICAL) == len(NAMES) and len(lengths[0]) == len(LENGTHS)
    return Motion(
        np.concatenate(points), np.cumsum(count) - count, count, np.array(fps), np.array(weight) / np.sum(weight),
        np.array(parts), np.array(lengths), tuple(source.person for source in chosen),
    )  # fmt: skip
