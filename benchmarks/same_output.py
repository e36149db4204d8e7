"""Whether `replay` writes the same bytes with this revision and with another revision of this repository.

    python benchmarks/same_output.py REV [--people 1,3] [--seconds 10] [--json FILE]

Both revisions replay the same recordings: the motion of the demo with one person, and with several people in one
message. Two outputs of a topic are equal if they have the same messages (bytes and times) in the same order. The exit
code is 0 if all topics of all recordings are equal, else 1.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.common.report import Record, exit_code, table, write_json  # isort: skip  (threads, before numpy)
import numpy as np

from benchmarks.common import option_types
from benchmarks.common.revision import ROOT, check_out
from benchmarks.data.people_in_view import view
from lassokin_ros.demo.synthetic import WEBCAM
from lassokin_ros.replay.bag_writer import BagWriter
from lassokin_ros.replay.bags import BagReader, typestore
from lassokin_ros.replay.keypoint_recording import CAMERA_INFO, KEYPOINTS, KEYPOINTS_TYPE
from msg_adapters.backends import RosbagsBackend
from msg_adapters.inputs import camera_info, people_cloud

FPS, START_NS = 30.0, 1_700_000_000_000_000_000
FRAME_ID = "camera_optical_frame"
COMMANDS = ("cli/replay.py", "replay/command.py", "replay.py")
"""Where revisions have the command `replay`, newest first."""
COLUMNS = {"people": "d", "topic": "<", "this": "d", "other": "d", "result": "<"}

Messages = list[tuple[int, bytes]]
"""(time of recording in ns, serialised message)"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    options = parser().parse_args(arguments)
    records: list[Record] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        commit = check_out(options.revision, folder / "revision")
        for people in map(int, options.people):
            recording = folder / f"people_{people}"
            write_recording(recording, people, options.seconds)
            outputs = [
                replay(tree, recording, folder / f"{side}_{people}", people)
                for side, tree in (("this", ROOT), ("other", folder / "revision"))
            ]
            records += [{"people": people, **record} for record in compare(*outputs)]
    different = sum(record["result"] != "equal" for record in records)
    print(table(records, COLUMNS))
    print(f"this tree against {commit}: {len(records) - different} of {len(records)} topics are equal.")
    write_json(options.json, records)
    return 1 if different else 0


def parser() -> argparse.ArgumentParser:
    """The options of the command line."""
    result = option_types.command_line(__doc__)
    result.add_argument("revision", metavar="REV", help="commit, branch or tag to compare with")
    result.add_argument(
        "--people", type=option_types.some_of(tuple("123456789")), default=["1", "3"], help="recordings (1,3)"
    )
    result.add_argument("--seconds", type=option_types.positive, default=10.0, help="length of each recording (10)")
    return result


def write_recording(path: Path, people: int, seconds: float) -> None:
    """Write a recording of the demo's motion with `people` people in each message."""
    seen = view(0, max(round(seconds * FPS), 1), FPS, people)
    backend = RosbagsBackend(typestore())
    stamps = START_NS + np.round(np.arange(len(seen.pixels)) * 1e9 / FPS).astype(np.int64)
    with BagWriter(path, "mcap", typestore()) as writer:
        for stamp, pixels, confidence in zip(stamps.tolist(), seen.pixels, seen.confidence):
            camera = camera_info(backend, stamp, FRAME_ID, WEBCAM.K, WEBCAM.D, WEBCAM.size)
            writer.write(CAMERA_INFO, "sensor_msgs/msg/CameraInfo", stamp, camera)
            everybody = list(zip(range(people), pixels, confidence))
            writer.write(KEYPOINTS, KEYPOINTS_TYPE, stamp, people_cloud(backend, stamp, FRAME_ID, everybody))


def replay(tree: Path, recording: Path, output: Path, people: int) -> dict[str, Messages]:
    """Replay a recording with the code of a tree; return the messages of each topic of the output."""
    command = next((place for place in COMMANDS if (tree / "lassokin_ros" / place).is_file()), None)
    if command is None:
        raise SystemExit("the other revision has no command `replay`; expected a newer revision")
    module = "lassokin_ros." + command.removesuffix(".py").replace("/", ".")
    done = subprocess.run(
        [sys.executable, "-m", module, str(recording), "--output", str(output), "-p", f"max_people:={people}"],
        cwd=tree, env={**os.environ, "PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode:
        raise SystemExit(f"replay ends with code {done.returncode} in {tree}: {done.stderr.strip()}")
    messages: dict[str, Messages] = {}
    with BagReader(output) as bag:
        for topic, time_ns, data in bag.raw(bag.topics):
            messages.setdefault(topic, []).append((time_ns, bytes(data)))
    return messages


def compare(this: Mapping[str, Messages], other: Mapping[str, Messages]) -> list[Record]:
    """One record per topic: the numbers of messages, and "equal" or the first difference."""
    records: list[Record] = []
    for topic in sorted({*this, *other}):
        mine, theirs = this.get(topic, []), other.get(topic, [])
        record: Record = {"topic": topic, "this": len(mine), "other": len(theirs), "result": "equal"}
        if mine != theirs:
            pairs = zip(mine, theirs)
            first = next((i for i, (a, b) in enumerate(pairs) if a != b), min(len(mine), len(theirs)))
            record["result"] = f"different from message {first} on"
        records.append(record)
    return records


if __name__ == "__main__":
    sys.exit(exit_code(main))
