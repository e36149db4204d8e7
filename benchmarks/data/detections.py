"""Real detector output: the keypoints of one camera as input, the 3D of several cameras as reference.

A file contains `kp2d` (c, f, k, 3) px and confidence, `K`, `dist`, `fps`, `keypoint_names` and `ref_cam` (c, f, k, 3) m
in each camera's frame; MediaPipe's files also `world` (c, f, k, 3) m, its own 3D. The joints of the reference are the
triangulated points of the detector. Therefore landmarks are compared with landmarks, and only those at a joint: hips,
knees, ankles, shoulders, elbows, wrists.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Mapping, Sequence
from zipfile import BadZipFile
from zlib import error as DamagedArchive

import numpy as np

from benchmarks.accuracy_run import anatomy
from benchmarks.accuracy_run.experiment import FIGURES
from benchmarks.accuracy_run.metrics import figures, mpjpe
from benchmarks.accuracy_run.runs import Track, follow, follow_file
from benchmarks.common.report import Record
from benchmarks.data.body_lengths import landmark_lengths, rms_difference, skeleton_lengths
from benchmarks.data.recordings import recorded_person
from benchmarks.methods.baselines import FOLLOWERS
from benchmarks.methods.mediapipe_world import world_track
from lassokin_ros.core.body.landmarks import BODY, Layout, built_in_layouts
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.observation import Observation
from lassokin_ros.pipeline.camera.lens import Lens

JOINTS = {
    f"{side[0]}_{joint}": f"{side}_{joint}"
    for side in ("left", "right")
    for joint in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
}
"""Evaluated names and the landmarks at these joints, for every layout used here."""

NEEDED = {"K", "dist", "fps", "keypoint_names", "kp2d", "ref_cam"}
SIDES = ("left", "right")
BONES = (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist"))
TRUNK = ("left_shoulder", "right_shoulder", "left_hip", "right_hip")


@dataclass(frozen=True)
class DetectionJob:
    """One file, one camera, one method."""

    file: Path
    camera: int
    method: str
    measured_bones: bool
    settings: Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Recording:
    """One camera's keypoints of one person.

    points: (f, l, 2) normalised; confidence: (f, l); reference: (f, l, 3) m in the camera frame, NaN = unknown;
    focal: px; stamps: (f,) s; world: (f, l, 3) m, the detector's own 3D, None without.
    """

    name: str
    layout: str
    fps: float
    focal: float
    points: np.ndarray
    confidence: np.ndarray
    reference: np.ndarray
    stamps: np.ndarray
    world: np.ndarray | None = None

    @property
    def observations(self) -> list[Observation]:
        """All frames, in order."""
        return [
            Observation(float(stamp), points, confidence, self.focal)
            for stamp, points, confidence in zip(self.stamps, self.points, self.confidence)
        ]


def detection_jobs(
    files: Sequence[Path], methods: Sequence[str], measured_bones: bool, settings: Mapping[str, Any]
) -> list[DetectionJob]:
    """All cameras of all files with all methods; `mediapipe_world` only for files with the detector's own 3D."""
    jobs = []
    for file in files:
        cameras = _cameras(file)
        with np.load(file) as data:
            possible = [method for method in methods if method != "mediapipe_world" or "world" in data]
        for camera in range(cameras):
            jobs += [DetectionJob(file, camera, method, measured_bones, settings) for method in possible]
    return jobs


def _cameras(file: Path) -> int:
    """The number of cameras. Raises SystemExit if the file contains no detections."""
    expected = "expected detections in the format of the shared data's README"
    if not file.is_file():
        raise SystemExit(f"no file {file}; {expected}")
    try:
        with np.load(file, allow_pickle=False) as data:
            lacking = sorted(NEEDED - set(data))
            arrays = {name: data[name] for name in ("good", "world", *sorted(NEEDED)) if name in data}
    except (OSError, EOFError, BadZipFile, DamagedArchive, ValueError, TypeError, AttributeError):
        raise SystemExit(f"{file} is no npz file; {expected}") from None
    fault = f"has no {', '.join(lacking)}" if lacking else _fault(arrays)
    if fault:
        raise SystemExit(f"{file} {fault}; {expected}")
    return len(arrays["kp2d"])


def _fault(arrays: Mapping[str, np.ndarray]) -> str:
    """The fault of a file's arrays, in words; empty if there is none."""
    layout, count = layout_of(arrays["keypoint_names"])
    if not layout:
        return f"has keypoint_names that no layout of {', '.join(built_in_layouts(BODY))} begins with"
    for name in ("kp2d", "ref_cam", "K", "dist", "fps"):
        if arrays[name].dtype.kind not in "fiu":
            return f"has {name} that are not numbers"
    if arrays["kp2d"].ndim != 4 or arrays["kp2d"].shape[2] < count or 0 in arrays["kp2d"].shape:
        return f"has kp2d of shape {arrays['kp2d'].shape}, not (cameras, frames, {count} of {layout}, 3)"
    cameras, frames, points = arrays["kp2d"].shape[:3]
    shapes = {"kp2d": (cameras, frames, points, 3), "ref_cam": (cameras, frames, points, 3)}
    shapes |= {"world": (cameras, frames, points, 3)}
    shapes |= {"K": (cameras, 3, 3), "good": (frames, points), "fps": ()}
    for name in shapes.keys() & arrays.keys():
        if arrays[name].shape != shapes[name]:
            return f"has {name} of shape {arrays[name].shape}, not {shapes[name]}"
    distortion = arrays["dist"].shape
    if len(distortion) != 2 or distortion[0] != cameras or distortion[1] > 5:
        return f"has dist of shape {distortion}, not ({cameras}, 5 or fewer)"
    if not (np.isfinite(arrays["fps"]) and arrays["fps"] > 0):
        return f"has {float(arrays['fps']):g} frames a second"
    return "has no reference" if not np.isfinite(arrays["ref_cam"]).any() else ""


def layout_of(names: np.ndarray) -> tuple[str, int]:
    """The built-in layout that agrees with most of the keypoints' names, and its number of points; "" if none does.

    Detectors write LHip, l_hip or left_hip. They agree on the points at joints (`JOINTS`), but not on those of the
    head.
    """
    given, skeleton = [_plain(str(name)) for name in np.atleast_1d(names)], Skeleton.load(BODY, 1.75)
    best = 0, "", 0
    for layout in built_in_layouts(BODY):
        landmarks = Layout.load(layout, skeleton).names
        agree = {theirs for theirs, ours in zip(landmarks, given) if _plain(theirs) == ours}
        if len(landmarks) <= len(given) and agree >= set(JOINTS.values()):
            best = max(best, (len(agree), layout, len(landmarks)))
    return best[1:]


def _plain(name: str) -> str:
    """A keypoint's name without differences of spelling: LHip, l_hip and left_hip become lhip."""
    letters = "".join(letter for letter in name.lower() if letter.isalnum())
    return letters.replace("left", "l").replace("right", "r")


def load_recording(file: Path, camera: int) -> Recording:
    """Read one camera of a file, with lens distortion removed."""
    data = np.load(file)
    layout, count = layout_of(data["keypoint_names"])
    keypoints = data["kp2d"][camera, :, :count].astype(float)
    confidence = np.where(np.isfinite(keypoints).all(-1), keypoints[..., 2], 0.0)
    reference = data["ref_cam"][camera, :, :count].astype(float)
    if "good" in data:
        reference = np.where(data["good"][:, :count, None], reference, np.nan)
    K = data["K"][camera]
    points = undistorted(keypoints[..., :2], K, data["dist"][camera])
    points = np.where(confidence[..., None] > 0, points, np.nan)
    world = data["world"][camera, :, :count].astype(float) if "world" in data else None
    focal = float(K[0, 0] + K[1, 1]) / 2
    fps, stamps = float(data["fps"]), _stamps(data, camera, len(points))
    return Recording(file.stem, layout, fps, focal, points, confidence, reference, stamps, world)


def _stamps(data: Mapping[str, np.ndarray], camera: int, frames: int) -> np.ndarray:
    """(f,) s: the camera's own, those of all cameras, or by the frame rate. A frame without image gets a stamp too."""
    regular = np.arange(frames) / float(data["fps"])
    if "stamps" not in data:
        return regular
    stamps = data["stamps"] if data["stamps"].ndim == 1 else data["stamps"][camera]
    known = np.isfinite(stamps)
    return np.asarray(regular + np.interp(regular, regular[known], (stamps - regular)[known]))


def undistorted(pixels: np.ndarray, K: np.ndarray, distortion: np.ndarray) -> np.ndarray:
    """(f, l, 2) px -> normalised image coordinates, by the lens model that the node uses."""
    lens = Lens(K, np.pad(distortion, (0, 5 - len(distortion))), "plumb_bob")
    return lens.normalise(pixels.reshape(-1, 2)).reshape(pixels.shape)


def height_of(reference: np.ndarray, layout: Layout) -> float:
    """Height, m, for which the visible limbs and the trunk of the built-in skeleton have the reference's median
    lengths.
    """
    unit = Skeleton.load("anthropometric", 1.0)
    place = unit.rest_positions[[unit.index(name) for name in TRUNK]]
    pairs = [(float(_trunk(place)), _median(_trunk(reference[:, [layout.index(name) for name in TRUNK]])))]
    for a, b in BONES:
        model = float(np.linalg.norm(unit.offsets[unit.index(f"left_{b}")]))
        pairs += [(model, _length(reference, layout, f"{side}_{a}", f"{side}_{b}")) for side in SIDES]
    seen = [(model, length) for model, length in pairs if np.isfinite(length)]
    if not seen:
        raise SystemExit("the reference has no limb in a tenth of the frames; expected one that gives the height")
    return sum(length for _, length in seen) / sum(model for model, _ in seen)


def measured(skeleton: Skeleton, reference: np.ndarray, layout: Layout) -> Skeleton:
    """The skeleton with the reference's lengths of visible limbs, trunk, shoulders and hips, equal left and right."""
    offsets = skeleton.offsets.copy()
    place = skeleton.rest_positions[[skeleton.index(name) for name in TRUNK]]
    trunk = _median(_trunk(reference[:, [layout.index(name) for name in TRUNK]]))
    if np.isfinite(trunk):
        for joint in ("spine1", "spine2", "spine3", "left_collar", "right_collar"):
            offsets[skeleton.index(joint)] *= 1 + (trunk - _trunk(place)) / place[0, 1]
        place = skeleton.with_offsets(offsets).rest_positions[[skeleton.index(name) for name in TRUNK]]
    for pair, (left, right) in (("shoulder", place[:2]), ("hip", place[2:])):
        length = _length(reference, layout, f"left_{pair}", f"right_{pair}")
        if np.isfinite(length):
            change = 0.5 * (length - np.linalg.norm(left - right))
            offsets[skeleton.index(f"left_{pair}"), 0] += change
            offsets[skeleton.index(f"right_{pair}"), 0] -= change
    for a, b in BONES:
        lengths = [_length(reference, layout, f"{side}_{a}", f"{side}_{b}") for side in SIDES]
        for index in [skeleton.index(f"{side}_{b}") for side in SIDES if np.isfinite(lengths).any()]:
            offsets[index] *= np.nanmean(lengths) / np.linalg.norm(offsets[index])
    return skeleton.with_offsets(offsets)


def _trunk(points: np.ndarray) -> np.ndarray:
    """(...,) m: from the middle of the shoulders to that of the hips; points (..., 4, 3) in the order of `TRUNK`."""
    shoulders, hips = points[..., :2, :].mean(-2), points[..., 2:, :].mean(-2)
    return np.asarray(np.linalg.norm(shoulders - hips, axis=-1))


def _length(reference: np.ndarray, layout: Layout, a: str, b: str) -> float:
    length = np.linalg.norm(reference[:, layout.index(a)] - reference[:, layout.index(b)], axis=-1)
    return _median(length)


def _median(length: np.ndarray) -> float:
    """Median of the known values; NaN if less than a tenth is known."""
    known = np.isfinite(length)
    return float(np.median(length[known])) if known.mean() > 0.1 else float("nan")


def prepared(job: DetectionJob) -> tuple[Recording, TrackerConfig, Skeleton]:
    """A job's recording, and the inputs of the method: settings and skeleton."""
    recording = load_recording(job.file, job.camera)
    layout = Layout.load(recording.layout, Skeleton.load("anthropometric", 1.75))
    height = height_of(recording.reference, layout)
    config = TrackerConfig(height=height, landmarks=recording.layout, **job.settings).checked()
    skeleton = Skeleton.load("anthropometric", height)
    return recording, config, measured(skeleton, recording.reference, layout) if job.measured_bones else skeleton


def run_detections(job: DetectionJob) -> Record:
    """Track one camera's keypoints and score them."""
    recording, config, skeleton = prepared(job)
    layout = Layout.load(recording.layout, skeleton)
    track = _followed(job.method, recording, config, skeleton, layout)
    return {
        "clip": recording.name,
        "view": job.camera,
        "fps": recording.fps,
        "landmarks": recording.layout,
        "method": job.method,
        "person": recorded_person(recording.name),
        "height_m": config.height,
        "skeleton": "reference bones" if job.measured_bones else "height",
        **score(track, recording, layout),
        **_lengths(track, skeleton, landmark_lengths(recording.reference, layout)),
    }


def _lengths(track: Track, given: Skeleton, own: np.ndarray) -> Record:
    """How far the log-lengths given and those learned are from the person's own (7,) m, root mean square."""
    learned = float("nan") if track.skeleton is None else rms_difference(skeleton_lengths(track.skeleton), own)
    return {"lengths_given": rms_difference(skeleton_lengths(given), own), "lengths_learned": learned}


def _followed(method: str, recording: Recording, config: TrackerConfig, skeleton: Skeleton, layout: Layout) -> Track:
    """The method's track of a recording."""
    if method == "mediapipe_world":
        assert recording.world is not None
        world = recording.world * config.height / height_of(recording.world, layout)
        hips = [layout.index(f"{side}_hip") for side in SIDES]
        return world_track(world, recording.points, recording.confidence, hips, recording.focal)
    if method == "file":
        return follow_file(config, skeleton, recording.observations, len(layout.names))
    follower = FOLLOWERS[method](config, skeleton)
    return follow(follower, recording.observations, skeleton.joint_count, len(layout.names))


def score(track: Track, recording: Recording, layout: Layout) -> Record:
    """The same figures as for clips. Frames without a reference of the root are left out."""
    index = [layout.index(landmark) for landmark in JOINTS.values()]
    hips = np.isfinite(recording.reference[:, [layout.index("left_hip"), layout.index("right_hip")], 0]).mean() > 0.5
    root = [layout.index(f"{side}_{'hip' if hips else 'shoulder'}") for side in ("left", "right")]
    scored = np.isfinite(track.landmarks[:, 0, 0]) & np.isfinite(recording.reference[:, root, 0]).all(1)
    known = np.where(scored[:, None, None], recording.reference, np.nan)
    truth, estimate = known[:, index], track.landmarks[:, index]
    own_root, true_root = track.landmarks[:, root].mean(1), known[:, root].mean(1)
    if not scored.any():  # nobody was found, or only in frames without a reference
        none = {**dict.fromkeys((*FIGURES, *anatomy.FIGURES), float("nan")), "rejected": int(track.rejected.sum())}
        return {"frames": 0, **none, "ends_lost": bool(track.rejected[-1])}
    first = slice(int(np.argmax(scored)), int(np.argmax(scored)) + 1)
    return {
        **figures(estimate, truth, own_root, true_root, list(JOINTS), recording.stamps, recording.fps),
        "reprojection_px": float(np.nanmean(track.reprojection_px)),
        "init_ms": track.init_ms,
        "init_mpjpe_mm": float(mpjpe(estimate[first], truth[first], own_root[first], true_root[first])[0]),
        "frame_ms_p50": _percentile(track.frame_ms, 50),
        "frame_ms_p99": _percentile(track.frame_ms, 99),
        "rejected": int(track.rejected.sum()),
        "ends_lost": bool(track.rejected[-1]),
    }


def _percentile(values: np.ndarray, share: float) -> float:
    """Percentile of the known values; NaN if there is none."""
    return float(np.nanpercentile(values, share)) if np.isfinite(values).any() else float("nan")
