"""A robot beside people: distances without a height, TF that is late, and a camera that was moved.

    python benchmarks/robots/places.py [--rows height,late,moved,right] [--seeds 2] [--validation-people] [--json FILE]

Motion capture of people of the test set, seen by cameras with a detector's errors; whole messages are processed, with
TF. Errors are those of the pelvis in the fixed frame, m: along the line of sight from the robot (depth), across it
(lateral), and in space. within2: share of them, %, within two of the standard deviations that `~/people` states.

height: people scaled to a height before the robot's camera, 1.2 m high; the height is not given. floor: it is known
that the frame's height 0 is the floor. late: a person who stands, the robot turns at up to 2 rad/s, TF 180 ms late.
moved: two cameras at 90 degrees, or three; one is turned and shifted at 6 s; from then on. doubt_s, named_s, camera_s:
s until the person is doubtful, until a warning names cameras, and until it names the one that was moved. right: nobody
moves the cameras, but the given pose of one is off. moved_percent: frames that are doubtful as if one was moved.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.common.report import Record, exit_code, table, write_json  # isort: skip  (threads, before numpy)
import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from benchmarks.accuracy_run.people import chosen_clips, person_of
from benchmarks.common import option_types
from benchmarks.data.mocap import Clip, clip_height, clip_skeleton, floor_height, landmark_positions, load_clip
from benchmarks.data.rig import Z_UP
from benchmarks.data.strangers import with_peoples_proportions
from benchmarks.robots.scene import transform
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.learned.learned import MOVED_CAMERA
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.pipeline.answers import Answer
from lassokin_ros.pipeline.camera.camera_places import LEVEL
from lassokin_ros.pipeline.concerns.live import wrong_cameras
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings
from msg_adapters.camera_info import Intrinsics
from msg_adapters.keypoints import Keypoints

SIZE, FOCAL = (1280, 720), 700.0
"""px, of the images and their focal length."""
RATE, TF_RATE = 30.0, 50.0
"""Hz, of keypoints and TF."""
NOISE_PX, WANDER_PX, OFFSET_PX, WANDERS = 1.5, 2.5, 2.5, 0.1
"""px at 3.5 m and a focal length of 920 px: errors that are white, that last WANDERS s, and that stay."""
ROBOT_CAMERA = 1.2
"""m: height of the robot's camera."""
START_NS = 1_700_000_000_000_000_000
SCORED_FROM = 2.0
"""s of a run that are not scored."""
MOVED_AT = 6.0
"""s at which a camera is moved."""
HEIGHTS = (1.15, 1.55, 1.95)
SHORTEST_S, FARTHEST, LOWEST, STANDS = 2.0, 1.5, 0.48, 0.08
"""s, m from the middle, heights of the pelvis above the floor: limits of the clips that are used. A toe is at most
STANDS heights above the floor in nine of ten frames, so that nobody hangs on a bar."""
COLUMNS = {"row": "<", "runs": "d", "error_m": ".3f", "depth_m": ".3f", "bias_m": "+.3f", "lateral_p95_m": ".3f",
           "speed_p95_m_s": ".2f", "stated_m": ".3f", "within2_percent": ".0f", "moved_percent": ".1f",
           "doubt_s": ".2f", "named_s": ".2f", "camera_s": ".2f"}  # fmt: skip


@dataclass(frozen=True)
class Eye:
    """A camera. turning: rad/s, of the robot that carries it; moved: its pose since a time, s, unknown to TF."""

    name: str
    pose: CameraPose
    turning: float = 0.0
    moved: CameraPose | None = None
    since: float = MOVED_AT

    def told(self, seconds: float) -> CameraPose:
        """The pose by TF at a time, s."""
        if not self.turning:
            return self.pose
        turn = Rotation.from_euler("z", yaw_at(seconds, self.turning)).as_matrix()
        return CameraPose(self.name, self.pose.rotation @ turn.T, self.pose.translation)

    def true(self, seconds: float) -> CameraPose:
        """Where the camera is."""
        return self.told(seconds) if self.moved is None or seconds < self.since else self.moved


@dataclass(frozen=True)
class Run:
    """A person, cameras and settings. tf_late, detector_late: s; tracker: settings of the tracker; seconds: s."""

    row: str
    person: Clip
    eyes: tuple[Eye, ...]
    node: NodeSettings
    tracker: dict[str, float]
    seconds: float
    seed: int
    still: bool = False
    tf_late: float = 0.03
    detector_late: float = 0.05
    scored_from: float = SCORED_FROM


def yaw_at(seconds: float, fastest: float, amplitude: float = 0.5, acceleration: float = 4.0) -> float:
    """rad: the robot turns from one side to the other and back with a trapezoidal speed, `amplitude` to each side."""
    rise = min(fastest / acceleration, np.sqrt(2 * amplitude / acceleration))
    speed = acceleration * rise
    even = (2 * amplitude - speed * rise) / speed
    period = 2 * rise + even
    sweep, at = divmod(seconds, period)
    if at < rise:
        turned = 0.5 * acceleration * at**2
    elif at < rise + even:
        turned = 0.5 * acceleration * rise**2 + speed * (at - rise)
    else:
        turned = 2 * amplitude - 0.5 * acceleration * (period - at) ** 2
    return float(turned - amplitude if sweep % 2 == 0 else amplitude - turned)


def looking(name: str, place: Sequence[float], at: Sequence[float]) -> CameraPose:
    """The pose of a camera at a place that looks at another one, (3,) m in the fixed frame."""
    forward = np.subtract(at, place)
    yaw, pitch = np.arctan2(forward[1], forward[0]) - np.pi / 2, np.arctan2(forward[2], np.hypot(*forward[:2]))
    rotation = Rotation.from_euler("x", -pitch).as_matrix() @ LEVEL @ Rotation.from_euler("z", -yaw).as_matrix()
    return CameraPose(name, rotation, -rotation @ np.asarray(place, dtype=float))


class World:
    """The person of a run, and what the cameras see."""

    def __init__(self, run: Run) -> None:
        self._run, clip = run, run.person
        skeleton = clip_skeleton(clip, generic=False)
        self._layout = Layout.load("coco17", skeleton)
        pelvis = clip.position("pelvis")
        origin = np.array([*pelvis[:, [0]].mean(0), floor_height(clip), *pelvis[:, [2]].mean(0)])
        turn = Rotation.from_euler("z", 2.1 * run.seed).as_matrix()
        self._middle = np.array([3.2, 0.0, 0.0])
        self._marks = (landmark_positions(clip, self._layout, skeleton) - origin) @ Z_UP.T @ turn.T + self._middle
        self._pelvis = (pelvis - origin) @ Z_UP.T @ turn.T + self._middle

    def _frame_at(self, seconds: float) -> float:
        if self._run.still:
            return 0.0
        last = len(self._pelvis) - 1
        at = (seconds * self._run.person.fps) % (2 * last)  # there and back
        return float(min(at, 2 * last - at))

    def _between(self, values: np.ndarray, seconds: float) -> np.ndarray:
        at = self._frame_at(seconds)
        before = min(int(at), len(values) - 2)
        return np.asarray(values[before] + (at - before) * (values[before + 1] - values[before]))

    def pelvis(self, seconds: float) -> np.ndarray:
        """(3,) m: the truth."""
        return self._between(self._pelvis, seconds)

    def seen(self, eye: Eye, phase: float) -> Iterator[tuple[float, Keypoints]]:
        """The keypoints of a camera with a detector's errors, by time, s."""
        random = np.random.default_rng([self._run.seed, *eye.name.encode(), *self._run.person.name.encode()])
        times = np.arange(phase, self._run.seconds, 1 / RATE)
        count, kept = len(self._layout.names), np.exp(-1 / (RATE * WANDERS))
        wander = WANDER_PX * random.normal(size=(len(times), count, 2))
        wander[1:] *= np.sqrt(1 - kept**2)
        off = lfilter([1.0], [1.0, -kept], wander, axis=0) + OFFSET_PX * random.normal(size=(count, 2))
        off += NOISE_PX * random.normal(size=off.shape)
        for seconds, errors in zip(times, off):
            inside = eye.true(seconds).into_camera(self._between(self._marks, seconds))
            scale = FOCAL / 920 * 3.5 / max(float(np.median(inside[:, 2])), 1.0)
            pixels = inside[:, :2] / inside[:, 2:] * FOCAL + np.divide(SIZE, 2) + scale * errors
            ids = np.flatnonzero(((pixels > 2) & (pixels < np.subtract(SIZE, 2))).all(1) & (inside[:, 2] > 0.3))
            stamp_ns = START_NS + round(1e9 * seconds)
            yield seconds, Keypoints(stamp_ns, eye.name, ids, pixels[ids], np.full(len(ids), 0.9))


def play(run: Run) -> Record:
    """Process all messages of a run in the order of their arrival; return its figures."""
    session, world = Session(TrackerConfig(**run.tracker), run.node), World(run)
    answers: list[tuple[float, Answer]] = []
    said = Said(run.eyes)
    for at, found in played(run, world, session):
        answers += [(at, one) for one in found]
        if len(run.eyes) > 1:
            said.note(at, session)
    return {**figures(run, world, answers), **said.record()}


def played(run: Run, world: World, session: Session, offset_s: float = 0.0) -> Iterator[tuple[float, list[Answer]]]:
    """Send all messages of a run in the order of their arrival. Yields the time, s, and the answers after each.

    offset_s: s by which the stamps of images are too late.
    """
    K = np.array([[FOCAL, 0, SIZE[0] / 2], [0, FOCAL, SIZE[1] / 2], [0, 0, 1.0]])
    several, events = len(run.eyes) > 1, []
    for number, eye in enumerate(run.eyes):
        intrinsics = Intrinsics(K, np.zeros(0), "", np.eye(3), np.hstack([K, np.zeros((3, 1))]), *SIZE, eye.name)
        session.set_camera(intrinsics, eye.name if several else "")
        if not eye.turning:
            session.push_transforms(transform(START_NS, eye.told(0.0), eye.name), static=True)
        times = np.arange(0, run.seconds, 1 / TF_RATE) if eye.turning else ()
        events += [
            (t + run.tf_late, 0, eye, transform(START_NS + round(1e9 * t), eye.told(t), eye.name)) for t in times
        ]
        events += [(t + run.detector_late, 1, eye, seen) for t, seen in world.seen(eye, number * 0.4 / RATE)]
    for at, kind, eye, content in sorted(events, key=lambda event: event[:2]):
        now_ns = START_NS + round(1e9 * at)
        while (due_ns := session.due_at_ns) is not None and due_ns <= now_ns:
            yield (due_ns - START_NS) * 1e-9, session.due(due_ns)
        if kind == 0:
            session.push_transforms(content)
        else:
            content = replace(content, stamp_ns=content.stamp_ns + round(1e9 * offset_s))
            yield at, session.push(content, now_ns, eye.name if several else "")


class Said:
    """When a warning has named the cameras, s after one was moved."""

    def __init__(self, eyes: Sequence[Eye]) -> None:
        self._moved = next((eye.name for eye in eyes if eye.moved is not None), "")
        self._named = self._camera = np.nan

    def note(self, seconds: float, session: Session) -> None:
        """Use what is said at a time, s."""
        if seconds < MOVED_AT or not self._moved:
            return
        for raised in wrong_cameras(session):
            self._named = np.fmin(self._named, seconds - MOVED_AT)
            if raised.text.startswith(f"camera '{self._moved}'"):
                self._camera = np.fmin(self._camera, seconds - MOVED_AT)

    def record(self) -> Record:
        """The figures."""
        return {"named_s": float(self._named), "camera_s": float(self._camera)} if self._moved else {}


def figures(run: Run, world: World, answers: Sequence[tuple[float, Answer]]) -> Record:
    """Errors of the places of a run, and the deviations that are stated."""
    rows, doubt = [], np.nan
    for at, answer in answers:
        for frame in answer.accepted:
            seconds = (frame.stamp_ns - START_NS) * 1e-9
            estimate = frame.estimate
            if seconds < run.scored_from or estimate is None or estimate.pose is None:
                continue
            place, covariance = estimate.pose.positions[0], frame.uncertainty.absolute.pelvis[:3, :3]
            error = place - world.pelvis(seconds)
            sight = world.pelvis(seconds) - run.eyes[0].told(seconds).centre
            sight[2] = 0.0
            sight /= np.linalg.norm(sight)
            across = np.array([-sight[1], sight[0], 0.0])
            stated = float(np.sqrt(error @ covariance @ error) / max(np.linalg.norm(error), 1e-9))
            assert frame.velocity is not None
            true = (world.pelvis(seconds + 0.05) - world.pelvis(seconds - 0.05)) / 0.1
            rows.append([np.linalg.norm(error), error @ sight, abs(error @ across), stated,
                         np.linalg.norm(frame.velocity - true), MOVED_CAMERA in frame.doubts])  # fmt: skip
            if frame.doubtful and run.eyes[-1].moved is not None:
                doubt = np.fmin(doubt, seconds - MOVED_AT)
    errors, depths, lateral, stated_m, speeds, as_moved = np.array(rows, dtype=float).T
    return {
        "row": run.row, "clip": run.person.name, "error_m": float(errors.mean()),
        "depth_m": float(np.abs(depths).mean()),
        "bias_m": float(depths.mean()),
        "lateral_p95_m": float(np.percentile(lateral, 95)), "speed_p95_m_s": float(np.percentile(speeds, 95)),
        "stated_m": float(stated_m.mean()), "within2_percent": float(100 * np.mean(errors <= 2 * stated_m)),
        "moved_percent": float(100 * as_moved.mean()), "doubt_s": float(doubt),
    }  # fmt: skip


def heights(clips: Sequence[Clip], seed: int) -> Iterator[Run]:
    """People of other heights before the camera of a robot."""
    eye = Eye("camera", looking("camera", (0.0, 0.0, ROBOT_CAMERA), (3.0, 0.0, 1.05)), turning=0.5)
    for floor in (True, False):
        node = NodeSettings(fixed_frame="odom", floor=floor)
        for height in HEIGHTS:
            row = f"height {height:.2f} m, {'floor' if floor else 'no floor'}"
            for clip in clips:
                yield Run(row, _scaled(clip, height / clip_height(clip)), (eye,), node, {}, 10.0, seed)


def late(clips: Sequence[Clip], seed: int) -> Iterator[Run]:
    """A person who stands, seen from a robot that turns, with TF that is on time or late."""
    for turning in (0.5, 2.0):
        eye = Eye("camera", looking("camera", (0.0, 0.0, ROBOT_CAMERA), (3.0, 0.0, 1.05)), turning=turning)
        for delay in (0.0, 0.18):
            row = f"TF {1000 * delay:.0f} ms late, {turning:g} rad/s"
            for clip in clips:
                own = {"height": clip_height(clip)}
                node = NodeSettings(fixed_frame="odom")
                yield Run(row, clip, (eye,), node, own, 10.0, seed, True, delay, 0.03)


def moved(clips: Sequence[Clip], seed: int) -> Iterator[Run]:
    """Cameras in a room, the last of which is moved."""
    for count in (2, 3):
        for degrees, shift in ((0, 0.0), (3, 0.05), (6, 0.14), (15, 0.0)):
            row = f"{count} cameras, one moved by {degrees} degrees, {shift:g} m" if degrees else f"{count} cameras"
            yield from _in_room(row, clips, seed, count, degrees, shift, MOVED_AT)


def right(clips: Sequence[Clip], seed: int) -> Iterator[Run]:
    """Cameras in a room that nobody moves, and the last of which is given as exactly as a real rig's."""
    for count in (2, 3):
        for degrees, shift in ((0, 0.0), (2, 0.03)):
            row = f"{count} cameras, one off by {degrees} degrees, {shift:g} m"
            yield from _in_room(row, clips, seed, count, degrees, shift, 0.0)


def _in_room(
    row: str, clips: Sequence[Clip], seed: int, count: int, degrees: float, shift: float, since: float
) -> Iterator[Run]:
    eyes = []
    for number in range(count):
        angle = np.pi + np.radians(90.0) * number
        place = (3.0 + 3.4 * np.cos(angle), 3.4 * np.sin(angle), 1.5)
        eyes.append(Eye(f"eye{number}", looking(f"eye{number}", place, (3.0, 0.0, 0.9))))
    random = np.random.default_rng([seed, 7])
    turn = Rotation.from_euler("y", np.radians(degrees) * random.choice((-1, 1))).as_matrix()
    off = random.normal(size=3) * [1, 0.2, 1]
    pose, off = eyes[-1].pose, shift * off / np.linalg.norm(off)
    if degrees:
        other = CameraPose(pose.name, turn @ pose.rotation, turn @ pose.translation + off)
        eyes[-1] = replace(eyes[-1], moved=other, since=since)
    node = NodeSettings(cameras=tuple(eye.name for eye in eyes), fixed_frame="odom")
    for clip in clips:
        own = {"height": clip_height(clip)}
        yield Run(row, clip, tuple(eyes), node, own, 14.0, seed, scored_from=max(SCORED_FROM, degrees and since))


def _scaled(clip: Clip, factor: float) -> Clip:
    return replace(clip, standard=factor * clip.standard, rest=factor * clip.rest)


ROWS = {"height": heights, "late": late, "moved": moved, "right": right}


def people(files: Sequence[Path], count: int, seed: int) -> list[Clip]:
    """Clips of upright people who stay near one place, of each person the longest ones, with people's proportions."""
    found: dict[str, list[tuple[float, Clip]]] = {}
    for file in files:
        clip = load_clip(file)
        pelvis, seconds = clip.position("pelvis"), len(clip.standard) / clip.fps
        far = float(np.linalg.norm((pelvis - pelvis.mean(0))[:, [0, 2]], axis=1).max())
        lowest = float((pelvis[:, 1] - floor_height(clip)).min() / clip_height(clip))
        toes = np.minimum(clip.position("l_toe")[:, 1], clip.position("r_toe")[:, 1]) - floor_height(clip)
        stands = float(np.percentile(toes, 90)) < STANDS * clip_height(clip)
        if seconds >= SHORTEST_S and far < FARTHEST and lowest > LOWEST and stands:
            person = person_of(file) or file.stem
            found.setdefault(person, []).append((seconds, with_peoples_proportions(clip, person, seed)))
    return [clip for own in found.values() for _, clip in sorted(own, key=lambda one: -one[0])[:count]]


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    options = parser().parse_args(arguments)
    files, records = chosen_clips(options), []
    for seed in range(options.seeds):
        clips = people(files, options.clips, seed)
        for row in options.rows:
            records += [play(run) for run in ROWS[row](clips, seed) if options.only in run.row]
    rows = []
    for name in dict.fromkeys(record["row"] for record in records):
        own = [record for record in records if record["row"] == name]
        known = {
            key: [one[key] for one in own if np.isfinite(one.get(key, np.nan))]
            for key in COLUMNS
            if key not in ("row", "runs")
        }
        rows.append(
            {"row": name, "runs": len(own), **{k: float(np.mean(v)) if v else np.nan for k, v in known.items()}}
        )
    print(table(rows, COLUMNS))
    write_json(options.json, records)
    return 0


def parser() -> argparse.ArgumentParser:
    """The command line's options."""
    result = option_types.command_line(__doc__, "data", "validation-people")
    add = result.add_argument
    add(
        "--rows", type=option_types.names, default=tuple(ROWS), help="comma-separated: height, late, moved, right (all)"
    )
    add("--only", default="", metavar="TEXT", help="only the rows whose name contains this")
    add("--clips", type=option_types.count, default=2, help="clips of each person (2)")
    add("--seeds", type=option_types.count, default=1, help="number of seeds, each with its own errors (1)")
    return result


if __name__ == "__main__":
    sys.exit(exit_code(main))
