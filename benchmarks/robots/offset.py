"""The offset between the stamps of a robot's camera and TF, found from people while the robot turns.

    python benchmarks/robots/offset.py [--clips 1] [--seconds 30] [--validation-people] [--json FILE]

Motion capture of people of the test set, seen by a camera with a detector's errors (see places.py); whole messages are
processed, with TF. A person stands, moves as captured, or also walks to and fro at up to 1 m/s; the robot turns to and
fro, or follows the walking person with its camera, 0.3 s late. Columns: the offset that was found, its mean error and
the stated deviation, and the share of runs in which it is said; with a true offset of 0 that is a false alarm.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.common.report import Record, data_folder, exit_code, table, write_json  # isort: skip  (before numpy)
import numpy as np

from benchmarks.accuracy_run.people import test_clips, validation_clips
from benchmarks.common import option_types
from benchmarks.data.mocap import Clip, clip_height
from benchmarks.robots import places
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings

OFFSETS_S = (0.0, 0.04, 0.12, -0.06)
WALK_M, WALK_RAD_S, FOLLOWS_S = 1.4, 0.7, 0.3
"""m and rad/s of the walk to and fro across the line of sight; s by which a robot that follows is late."""
SCENES = {"stands, 1 rad/s": (1.0, True, False), "moves, 0.5 rad/s": (0.5, False, False),
          "walks, 2 rad/s": (2.0, False, True), "walks, robot follows": (0.0, False, True)}  # fmt: skip
COLUMNS = {"scene": "<", "true_ms": "+.0f", "runs": "d", "found_ms": "+.0f", "error_ms": ".1f", "stated_ms": ".1f",
           "said_percent": ".0f"}  # fmt: skip


def walk_at(seconds: float) -> float:
    """m: where the walking person is across the line of sight."""
    return WALK_M * float(np.sin(WALK_RAD_S * seconds))


class Following(places.Eye):
    """A camera that a robot turns towards the walking person."""

    def told(self, seconds: float) -> places.CameraPose:
        """See Eye."""
        yaw = np.arctan2(walk_at(seconds - FOLLOWS_S), 3.2)
        turn = places.Rotation.from_euler("z", yaw).as_matrix()
        return places.CameraPose(self.name, self.pose.rotation @ turn.T, self.pose.translation)


class Walking(places.World):
    """The person of a run, who also walks to and fro."""

    def _between(self, values: np.ndarray, seconds: float) -> np.ndarray:
        return super()._between(values, seconds) + np.array([0.0, walk_at(seconds), 0.0])


def found(clip: Clip, scene: str, offset_s: float, seconds: float, seed: int = 0) -> Record:
    """Process all messages of a run; return what is found."""
    turning, still, walks = SCENES[scene]
    kind = places.Eye if turning else Following
    eye = kind("camera", places.looking("camera", (0.0, 0.0, places.ROBOT_CAMERA), (3.0, 0.0, 1.05)), turning or 1.0)
    settings = NodeSettings(fixed_frame="odom")
    run = places.Run(scene, clip, (eye,), settings, {"height": clip_height(clip)}, seconds, seed, still)
    session = Session(TrackerConfig(**run.tracker), settings)
    for _ in places.played(run, (Walking if walks else places.World)(run), session, offset_s):
        pass
    assert session.placement.tf_offset is not None
    offset, deviation = session.placement.tf_offset.of("") or (np.nan, np.nan)
    said = session.placement.tf_offset.clear("") is not None
    return {"scene": scene, "true_ms": 1e3 * offset_s, "clip": clip.name, "found_ms": 1e3 * offset,
            "error_ms": 1e3 * abs(offset - offset_s), "stated_ms": 1e3 * deviation,
            "said_percent": 100.0 * said}  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--data", type=Path, help="folder of the data (default: LASSOKIN_DATA)")
    add("--only", default="", metavar="TEXT", help="only the scenes whose name contains this")
    add("--clips", type=option_types.count, default=1, help="clips of each person (1)")
    add("--seconds", type=option_types.positive, default=30.0, help="s of each run (30)")
    add("--validation-people", action="store_true", help="the people with whom the design was chosen, not the test's")
    add("--json", type=option_types.output_file, metavar="FILE", help="write the records as a JSON list")
    options = parser.parse_args(arguments)
    files = (validation_clips if options.validation_people else test_clips)(options.data or data_folder())
    clips = places.people(files, options.clips, 0)
    runs = [(scene, offset_s) for scene in SCENES for offset_s in OFFSETS_S if options.only in scene]
    records = [found(clip, *run, options.seconds) for run in runs for clip in clips]
    rows = []
    for scene, offset_s in runs:
        own = [one for one in records if (one["scene"], one["true_ms"]) == (scene, 1e3 * offset_s)]
        known = [one for one in own if np.isfinite(one["found_ms"])]
        figures = {
            key: float(np.mean([one[key] for one in known])) if known else np.nan for key in COLUMNS if "ms" in key
        }
        rows.append({**figures, "scene": scene, "true_ms": 1e3 * offset_s, "runs": len(own),
                     "said_percent": float(np.mean([one["said_percent"] for one in own]))})  # fmt: skip
    print(table(rows, COLUMNS))
    write_json(options.json, records)
    return 0


if __name__ == "__main__":
    sys.exit(exit_code(main))
