"""A lock, places out of view, and places ahead, beside a robot: motion capture, simulated detectors, a real `Session`.

    python benchmarks/robots/identities.py [--data DIR] [--only restart,ring,away,ahead] [--seeds 4]

restart: the detector is silent for some seconds and then gives other numbers; a person is locked. Of two people who
stand 2 m apart the other one is a stranger; with `swap` they change places in the silence, with `close` from 0.7 m.
ring: four cameras with blind gaps of 20 degrees; a person walks around the robot once.
away: the robot turns away from a person at 2 m, and back after 15 s or never; with `left` the person has gone.
ahead: the place 0.4 s later of walking people (none of those on whom the filter's constants were chosen); `standing`
predicts no motion, `true` uses the true velocity: the rest is the error of the place and of a straight line.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.common.report import Record, data_folder, table, write_json  # isort: skip  (threads, before numpy)
import numpy as np

from benchmarks.common import option_types
from benchmarks.robots.scene import FIXED, START_NS, Camera, Scene, Walker
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.outputs.scene_messages import NOBODY, PresenceState
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings

RESTARTED_S, SWAP_S, CLOSE_M = 5.0, 2.0, 0.7
"""s: when the detector stops; the shortest silence in which two people can change places. m: between close ones."""
STANDING, OTHER, WALKING = "02_05", "14_20", "07_05"
WALKS = "02_01", "02_02", "07_05", "12_01", "exp_walking_1", "03_01"
WAYS = (4.0, -1.8, np.pi / 2), (5.5, 0.3, np.pi), (4.5, 1.6, -2.4)
"""Across, towards the camera, and between."""
AHEAD_S = 0.4
NAMES = "front", "left", "back", "right"
COLUMNS = {
    "restart": {"silence_s": ".1f", "people": "<", "max_people": "d", "runs": "d", "right_percent": ".0f",
                "guessed_percent": ".0f", "guessed_wrong_percent": ".0f", "absent_percent": ".0f",
                "silently_wrong": "d", "found_s": ".2f"},
    "ring": {"radius_m": ".1f", "speed_m_s": ".1f", "max_people": "d", "lock": "<", "ids": "<", "found_percent": ".0f"},
    "ahead": {"velocity": "<", "mean_m": ".3f", "p95_m": ".3f", "speed_error_m_s": ".2f",
              "within_twice_percent": ".0f"},
    "away": {"scene": "<", "max_people": "d", "lost_s": ".1f", "nobody_s": ".1f", "found_s": ".1f"},
}  # fmt: skip


def session_of(height: float, **settings: object) -> Session:
    """A session in the fixed frame."""
    return Session(TrackerConfig(height=round(height, 2)), NodeSettings(fixed_frame=FIXED, **settings))  # type: ignore


def accepted(scene: Scene, session: Session) -> Iterator[tuple[float, FrameResult]]:
    """The accepted results of a scene, with the time of each."""
    for t, answers in scene.play(session):
        for answer in answers:
            yield from ((t, frame) for frame in answer.accepted)


def distance(frame: FrameResult, place: np.ndarray) -> float:
    """m from the pelvis to a place (3,)."""
    assert frame.estimate is not None and frame.estimate.pose is not None
    return float(np.linalg.norm(frame.estimate.pose.positions[0] - place))


def restart(data: Path, seeds: int) -> Iterator[Record]:
    """A silence of the detector, after which all numbers are new."""
    for silence_s in (0.4, 0.6, 1.0, 2.0, 4.0):
        for people in ("one", "two", "swap", "close"):
            possible = {"swap": silence_s >= SWAP_S, "close": silence_s < 1.0}.get(people, True)
            for max_people in (1, 3) if possible else ():
                totals: dict[str, list[float]] = {}
                for seed in range(seeds):
                    for key, value in _restarted(data, silence_s, people, max_people, seed).items():
                        totals.setdefault(key, []).append(value)
                mean = {key: float(np.nanmean(values)) for key, values in totals.items() if key.endswith("percent")}
                found = np.array(totals["found_s"])
                yield {"silence_s": silence_s, "people": people, "max_people": max_people, "runs": seeds, **mean,
                       "silently_wrong": int(np.sum(totals["silently_wrong"])),
                       "found_s": float(np.max(found)) if np.isfinite(found).all() else np.nan}  # fmt: skip


def _restarted(data: Path, silence_s: float, people: str, max_people: int, seed: int) -> dict[str, float]:
    back_s = RESTARTED_S + silence_s
    sides = 1 - 2 * (seed % 2)

    def place(side: float) -> Callable[[float], tuple[float, float, float]]:
        side *= CLOSE_M / 2 if people == "close" else 1.0
        return lambda t: (3.0, side * (-1 if people in ("swap", "close") and t > RESTARTED_S + 0.2 else 1), np.pi)

    walkers = [Walker(data / f"{STANDING}.npz", place(sides)), Walker(data / f"{OTHER}.npz", place(-sides))]
    walkers = walkers[: 1 if people == "one" else 2]
    after = ((2, 1), (1, 2))[seed // 2 % 2]
    scene = Scene(
        walkers,
        [Camera()],
        back_s + 4.0,
        seed=seed,
        numbers=lambda t: (7, 8) if t <= RESTARTED_S else after,
        silent=lambda t: RESTARTED_S < t < back_s,
    )
    session = session_of(walkers[0].height, max_people=max_people, lock=True, follow="confident")
    locked, rows = None, []
    for t, frame in accepted(scene, session):
        if (frame.label or frame.person) != session.roster.locked:
            continue
        who = int(np.argmin([distance(frame, walker.at(t)[1]) for walker in walkers]))
        locked = who if locked is None else locked
        if t >= back_s:
            rows.append((t, who == locked, frame.guessed))
    count = len([t for t in np.arange(0.0, scene.seconds, 1 / scene.fps) if t >= back_s])

    def share(right: bool, guessed: bool) -> float:
        return 100 * sum(row[1] == right and row[2] == guessed for row in rows) / count

    return {
        "right_percent": share(True, False),
        "guessed_percent": share(True, True),
        "guessed_wrong_percent": share(False, True),
        "absent_percent": 100 * (1 - len(rows) / count),
        "silently_wrong": float(share(False, False) > 0),
        "found_s": min((t - back_s for t, right, _ in rows if right), default=np.nan),
    }


def ring(data: Path, seeds: int) -> Iterator[Record]:
    """Once around the robot."""
    for radius, speed in ((2.0, 1.2), (2.0, 0.7), (2.5, 0.6)):
        for max_people, lock in ((1, True), (1, False), (3, False)):

            def place(t: float, radius: float = radius, speed: float = speed) -> tuple[float, float, float]:
                angle = speed * t / radius
                return radius * np.cos(angle), radius * np.sin(angle), angle + np.pi / 2

            walker = Walker(data / f"{WALKING}.npz", place)
            cameras = [
                Camera(name, lambda t, k=k: k * np.pi / 2, focal=640 / np.tan(np.radians(35)))  # type: ignore[misc]
                for k, name in enumerate(NAMES)
            ]
            scene = Scene([walker], cameras, 2 * np.pi * radius / speed)
            session = session_of(walker.height, cameras=NAMES, max_people=max_people, lock=lock)
            ids: list[str] = []
            found = set()
            for t, frame in accepted(scene, session):
                found.add(round(t, 3))
                said = (frame.label or frame.person) + (" guessed" if frame.guessed else "")
                ids += [said] if said not in ids else []
            yield {"radius_m": radius, "speed_m_s": speed, "max_people": max_people, "lock": str(lock).lower(),
                   "ids": ", ".join(ids), "found_percent": 100 * len(found) / (scene.seconds * scene.fps)}  # fmt: skip


def away(data: Path, seeds: int) -> Iterator[Record]:
    """The robot turns by 160 degrees."""
    for scene_name in ("turns back", "turns back, left", "stays away"):
        for max_people in (1, 3):
            back = [] if scene_name == "stays away" else [18.0, 19.5]
            times, angles = [3.0, 4.5, *back], [0.0, 2.8, *([2.8, 0.0] if back else [])]
            walker = Walker(data / f"{STANDING}.npz", (2.0, 0.1, np.pi))
            scene = Scene([walker], [Camera(yaw=lambda t: float(np.interp(t, times, angles)))], 38.0, 10.0,
                          hidden=lambda i, t: scene_name.endswith("left") and t > 10.0)  # fmt: skip
            session, state = session_of(walker.height, max_people=max_people), PresenceState()
            states: list[tuple[float, str]] = []
            for t, _ in scene.play(session):
                now_ns = START_NS + round(t * 1e9)
                limits = session.scene.lost_after, session.config.forget_after
                state.update(session.scene.presence_at(now_ns), now_ns, *limits, session.scene_known_empty(now_ns))
                if t > 1.0 and (not states or states[-1][1] != state.value):
                    states.append((t, state.value))
            gone_s = next(t for t, name in states if name != "tracking")
            empty = next((t - gone_s for t, name in states if name == NOBODY), np.nan)
            found = next((t for t, name in states if name == "tracking" and t > gone_s), np.nan)
            yield {"scene": scene_name, "max_people": max_people, "lost_s": gone_s, "nobody_s": empty, "found_s": found}


def ahead(data: Path, seeds: int) -> Iterator[Record]:
    """The place 0.4 s later of people who walk before one camera, from 1 s on."""
    errors: dict[str, list[float]] = {"standing": [], "predicted": [], "true": []}
    speed_errors: list[float] = []
    within: list[bool] = []
    for index, name in enumerate(WALKS):
        for way in WAYS:
            walker = Walker(data / f"{name}.npz", way)
            scene = Scene([walker], [Camera()], min(walker.seconds, 6.0) - 0.01, 30.0, seed=index)
            for t, frame in accepted(scene, session_of(walker.height)):
                if not 1.0 <= t <= walker.seconds - AHEAD_S:
                    continue
                assert frame.estimate is not None and frame.estimate.pose is not None
                assert frame.velocity is not None and frame.velocity_covariance is not None
                place, later = frame.estimate.pose.positions[0], walker.at(t + AHEAD_S)[1]
                mean = (walker.at(t + 0.2)[1] - walker.at(t - 0.2)[1]) / 0.4
                for kind, velocity in (("standing", 0 * mean), ("predicted", frame.velocity), ("true", mean)):
                    errors[kind].append(float(np.linalg.norm((place + AHEAD_S * velocity - later)[:2])))
                speed_errors.append(float(np.linalg.norm((frame.velocity - mean)[:2])))
                covariance = frame.uncertainty.absolute.pelvis[:3, :3] + AHEAD_S**2 * frame.velocity_covariance
                variances, axes = np.linalg.eigh(covariance[:2, :2])
                apart = axes.T @ (place + AHEAD_S * frame.velocity - later)[:2]
                within += (np.abs(apart) <= 2 * np.sqrt(variances)).tolist()
    for kind, values in errors.items():
        more = {"speed_error_m_s": float(np.mean(speed_errors)), "within_twice_percent": 100 * float(np.mean(within))}
        yield {"velocity": kind, "mean_m": float(np.mean(values)), "p95_m": float(np.percentile(values, 95)),
               **(more if kind == "predicted" else {})}  # fmt: skip


KINDS: dict[str, Callable[[Path, int], Iterator[Record]]] = {
    "restart": restart,
    "ring": ring,
    "away": away,
    "ahead": ahead,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = option_types.command_line(__doc__, "data")
    parser.add_argument("--only", type=option_types.some_of(KINDS), default=list(KINDS), help="tables (all)")
    parser.add_argument("--seeds", type=option_types.count, default=4, help="runs of each kind (4)")
    options = parser.parse_args(arguments)
    clips = (options.data or data_folder()) / "mocap"
    if not clips.is_dir():
        parser.error(f"no folder {clips}; expected the motion capture of LASSOKIN_DATA")
    records: list[Record] = []
    for kind in options.only:
        rows = list(KINDS[kind](clips, options.seeds))
        print(f"\n{kind}\n{table(rows, COLUMNS[kind])}", flush=True)
        records += [{"kind": kind, **row} for row in rows]
    write_json(options.json, records)
    return 0


if __name__ == "__main__":
    sys.exit(main())
