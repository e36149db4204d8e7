"""One clip seen by one camera, tracked with one method, and scored: the unit of work of benchmarks/accuracy.py."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Mapping

import numpy as np

from benchmarks.accuracy_run import anatomy
from benchmarks.accuracy_run.metrics import figures, mpjpe
from benchmarks.accuracy_run.people import person_of
from benchmarks.accuracy_run.runs import Follower, Track, follow, follow_file
from benchmarks.common.report import Record
from benchmarks.data.mocap import EVALUATED, SMPL_NAME, Clip, clip_height, clip_skeleton, load_clip
from benchmarks.data.simulated_camera import Condition, Told, View, view_of
from benchmarks.data.strangers import with_peoples_proportions
from benchmarks.methods.baselines import FOLLOWERS
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.observation import Observation

FILE = "file"
METHODS = (*FOLLOWERS, FILE, "mediapipe_world")
"""`file` is the tracker as for a file, whose later frames are known. `mediapipe_world` is for real recordings only."""


@dataclass(frozen=True)
class Job:
    """What to run; all inputs of a worker process.

    bone_error: standard deviation of the bones' relative error; symmetric: left and right bones get the same one.
    settings: of TrackerConfig, beside height, landmarks and noise_px. score_from: s, earlier frames are not scored.
    told: of the camera's mount, None for nothing.
    """

    file: Path
    view: int
    method: str
    condition: Condition = Condition()
    landmarks: str = "coco17"
    seed: int = 0
    generic_skeleton: bool = False
    bone_error: float = 0.0
    symmetric: bool = True
    settings: Mapping[str, Any] | None = None
    score_from: float = 0.0
    told: Told | None = None


@dataclass(frozen=True, eq=False)
class Scene:
    """A job's clip, the camera's view of it, and the inputs of the method: skeleton and settings."""

    clip: Clip
    view: View
    skeleton: Skeleton
    config: TrackerConfig

    @property
    def observations(self) -> list[Observation]:
        """All frames, in order."""
        v, points = self.view, self.view.normalised
        depth = [None] * len(points) if v.depth is None else v.depth
        return [
            Observation(f / v.fps, points[f], v.confidence[f], v.focal, depth[f], depth_of_surface=v.depth_of_surface)
            for f in range(len(points))
        ]

    @property
    def evaluated(self) -> list[int]:
        """Joint indices of `EVALUATED`."""
        return [self.skeleton.index(SMPL_NAME[name]) for name in EVALUATED]

    def follower(self, method: str) -> Follower:
        """A new tracker or baseline."""
        return FOLLOWERS[method](self.config, self.skeleton)

    def follow(self, method: str, observations: list[Observation] | None = None) -> Track:
        """Run one method over the clip, or over `observations`."""
        observations = self.observations if observations is None else observations
        landmarks = len(Layout.load(self.config.landmarks, self.skeleton).names)
        if method == FILE:
            return follow_file(self.config, self.skeleton, observations, landmarks)
        return follow(self.follower(method), observations, self.skeleton.joint_count, landmarks)


def scene_of(job: Job) -> Scene:
    """Load the clip and render the view of the job, always with the clip's own body."""
    clip, person = load_clip(job.file), person_of(job.file) or job.file.stem
    if job.condition.proportions:
        clip = with_peoples_proportions(clip, person, job.seed)
    own = clip_skeleton(clip, generic=False)
    given = clip_skeleton(clip, generic=job.generic_skeleton)
    if job.bone_error > 0:
        given = given.with_bone_scales(bone_scales(given, job))
    settings = {"noise_px": max(1.0, job.condition.noise_px), **(job.settings or {})}
    config = TrackerConfig(**{"height": clip_height(clip), "landmarks": job.landmarks, **settings}).checked()
    if config.height == 0:
        given = Skeleton.load(config.skeleton, config.assumed_height)
    view = view_of(clip, Layout.load(job.landmarks, own), own, job.condition, job.view, job.seed, person)
    if job.told is not None:
        config = replace(config, **job.told.settings(view)).checked()
    return Scene(clip, view, given, config)


def bone_scales(skeleton: Skeleton, job: Job) -> np.ndarray:
    """(n,) factors 1 + error, one draw per seed and clip."""
    random = np.random.default_rng([job.seed, 77, *job.file.stem.encode()])
    scales = 1 + job.bone_error * random.normal(size=skeleton.joint_count)
    if job.symmetric:
        for joint, name in enumerate(skeleton.joint_names):
            if name.startswith("right_"):
                scales[joint] = scales[skeleton.index("left_" + name.removeprefix("right_"))]
    return scales


def run(job: Job) -> Record:
    """Track the clip and score it."""
    scene = scene_of(job)
    track = scene.follow(job.method)
    height = {"height_percent": abs(100 * (track.height_m / clip_height(scene.clip) - 1))}
    return {**described(job, scene), **score(track, scene, job.score_from), **height}


def described(job: Job, scene: Scene) -> Record:
    """The fields of the record that describe the run."""
    return {
        **asdict(job.condition),
        "clip": scene.clip.name,
        "view": job.view,
        "fps": scene.view.fps,
        "landmarks": job.landmarks,
        "method": job.method,
        "seed": job.seed,
        "skeleton": "height" if job.generic_skeleton else "bones",
        "bone_error": job.bone_error,
        "height_m": clip_height(scene.clip),
    }


def score(track: Track, scene: Scene, score_from: float = 0.0) -> Record:
    """The figures of one track, over the frames from its first estimate (or `score_from` s) on.

    A rejected frame counts with the last estimate, because a subscriber still has that one. If there is no frame to
    score, all figures are NaN: the clip ends before `score_from`, or nobody was found (`ends_lost`).
    """
    view = scene.view
    first, begin = track.first, int(round(score_from * view.fps))
    scored = slice(max(first, begin), None)
    joints, root = track.positions[:, scene.evaluated], track.positions[:, 0]
    estimate, truth, own_root, true_root = joints[scored], view.truth[scored], root[scored], view.root[scored]
    if len(estimate) == 0:
        return {
            "frames": 0,
            **dict.fromkeys((*FIGURES, *anatomy.FIGURES), float("nan")),
            "rejected": int(track.rejected.sum()),
            "ends_lost": begin < len(view.truth),
        }
    start = mpjpe(joints[first : first + 1], view.truth[first : first + 1], root[first, None], view.root[first, None])
    return {
        **figures(estimate, truth, own_root, true_root, EVALUATED, np.arange(len(truth)) / view.fps, view.fps),
        "reprojection_px": _mean(track.reprojection_px[scored]),
        "init_ms": track.init_ms,
        "init_mpjpe_mm": float(start[0]),
        "frame_ms_p50": float(np.percentile(track.frame_ms[first:], 50)),
        "frame_ms_p99": float(np.percentile(track.frame_ms[first:], 99)),
        "rejected": int(np.sum(track.rejected[scored])),
        "ends_lost": bool(track.rejected[-1]),
        "before_first": first,
        "penetration_mm": penetration_mm(track, scene, scored),
    }


def penetration_mm(track: Track, scene: Scene, scored: slice) -> float:
    """Mean over frames and feet of how far an ankle is below the true ankles' lowest place, mm.

    That place is the 5th percentile of the height of the lower one.
    """
    up = scene.view.floor[:3]
    ankles = [EVALUATED.index(f"{side}_ankle") for side in "lr"]
    lowest = np.percentile((scene.view.truth[:, ankles] @ up).min(axis=1), 5)
    found = track.positions[scored][:, scene.evaluated][:, ankles] @ up
    return 1000 * _mean(np.maximum(lowest - found, 0.0))


FIGURES = (
    "mpjpe_mm pa_mpjpe_mm root_mm accel_error reprojection_px frames_over_100mm over_100mm_percent flips flips_percent "
    "init_ms init_mpjpe_mm frame_ms_p50 frame_ms_p99 penetration_mm"
).split()


def _mean(values: np.ndarray) -> float:
    return float(np.nanmean(values)) if np.isfinite(values).any() else float("nan")


def with_gap(observations: list[Observation], start: int, length: int) -> list[Observation]:
    """The same frames with every landmark missing in `length` of them."""
    return [
        replace(o, points=np.full_like(o.points, np.nan), confidence=np.zeros_like(o.confidence))
        if start <= frame < start + length
        else o
        for frame, o in enumerate(observations)
    ]
