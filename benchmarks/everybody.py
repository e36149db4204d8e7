"""Who is who in several cameras, on real detections of several people with known identities.

    python benchmarks/everybody.py DATA/detections/wildflower_everybody_openpose.npz [--cameras 0,1,2,3]

All cameras' detections of one instant are given together, without any identity. Printed: the share of the frames of a
tracked person in which the detections of all cameras are of one true person; the share of the frames of a true person
in which all detections have one id; the share of the detections of true people that were assigned; the number of ids.
"""

from __future__ import annotations

import sys
from collections import Counter, defaultdict
from pathlib import Path
from typing import Sequence

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.common.report import Record, exit_code, table, write_json  # isort: skip  (threads, before numpy)
import numpy as np

from benchmarks.common import option_types
from benchmarks.data.detections import layout_of
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.pipeline.camera.lens import Lens
from lassokin_ros.pipeline.people.people_tracker import PeopleTracker
from lassokin_ros.pipeline.people.roster import Roster
from lassokin_ros.pipeline.people.tracked_person import TrackedPerson
from lassokin_ros.pipeline.seen import Image, people_in
from lassokin_ros.pipeline.settings import NodeSettings
from msg_adapters.keypoints import Keypoints

COLUMNS = {"file": "<", "cameras": "<", "one_person_percent": ".1f", "one_id_percent": ".1f", "assigned_percent": ".1f",
           "ids": "d", "people": "d"}  # fmt: skip
MOST_PEOPLE, FORGET_AFTER_S = 8, 3.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    result = option_types.command_line(__doc__)
    result.add_argument(
        "files", type=Path, nargs="+", metavar="FILE", help="detections of everybody, with person_index"
    )
    result.add_argument("--cameras", metavar="A,B", help="cameras that are used (default: all)")
    options = result.parse_args(arguments)
    records = [run(file, options.cameras) for file in options.files]
    print(table(records, COLUMNS))
    write_json(options.json, records)
    return 0


def run(file: Path, chosen: str | None) -> Record:
    """Track everybody in one recording, and compare ids with the true people."""
    with np.load(file) as data:
        keypoints, identity, stamps = data["kp2d_all"], data["person_index"], data["stamps"]
        K, dist, R, t, names = data["K"], data["dist"], data["R"], data["t"], data["keypoint_names"]
    cameras = [int(part) for part in chosen.split(",")] if chosen else list(range(len(K)))
    lenses = {c: Lens(K[c], np.pad(dist[c], (0, 5 - len(dist[c]))), "plumb_bob") for c in cameras}
    poses = {c: CameraPose(str(c), R[c].astype(float), t[c].astype(float)) for c in cameras}
    layout, count = layout_of(names)
    config = TrackerConfig(landmarks=layout, height=1.7)
    bodies = [TrackedPerson(config) for _ in range(MOST_PEOPLE)]
    tracker = PeopleTracker(Roster(bodies, Counter(), NodeSettings(forget_after=FORGET_AFTER_S)))
    found: list[tuple[int, int, int]] = []  # frame, id, true person
    for frame, stamp in enumerate(stamps.tolist()):
        stamp_ns = 1_000_000_000 + round(1e9 * stamp)
        images = []
        for c in cameras:
            seen = [p for p, body in enumerate(keypoints[c, frame]) if np.isfinite(body).all() and body[:, 2].max() > 0]
            rows = keypoints[c, frame, seen, :count].reshape(-1, 3).astype(float)
            ids, persons = np.tile(np.arange(count), len(seen)), np.repeat(np.array(seen, dtype=int), count)
            message = Keypoints(stamp_ns, "", ids, rows[:, :2], rows[:, 2], persons)
            images.append(Image(people_in(message, count, lenses[c], config), stamp_ns, "", lenses[c], camera=poses[c]))
        tracker.update(images, "")
        for one in tracker.roster.people:
            for camera, track in one.tracks.items():
                true = np.flatnonzero(identity[:, int(camera), frame] == track.detection.number)
                found += [(frame, one.number, int(person)) for person in true if track.seen_ns == stamp_ns]
    labelled = int(np.count_nonzero(identity[:, cameras] >= 0))
    return {
        "file": file.stem,
        "cameras": ",".join(map(str, cameras)),
        "one_person_percent": _agreeing((frame, number, person) for frame, number, person in found),
        "one_id_percent": _agreeing((frame, person, number) for frame, number, person in found),
        "assigned_percent": 100 * len(found) / labelled,
        "ids": len({number for _, number, _ in found}),
        "people": len({person for _, _, person in found}),
    }


def _agreeing(entries) -> float:  # type: ignore[no-untyped-def]
    """Share of (frame, key) with several values whose values are all equal, %."""
    values = defaultdict(list)
    for frame, key, value in entries:
        values[frame, key].append(value)
    several = [len(set(own)) == 1 for own in values.values() if len(own) > 1]
    return 100 * float(np.mean(several)) if several else float("nan")


if __name__ == "__main__":
    sys.exit(exit_code(main))
