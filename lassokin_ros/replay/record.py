"""The record in a replay's output: digests of input and settings, software version, and result figures.

The record is stored in the output's metadata.yaml (rosbag2 `custom_data`), so it is written and moved together with
the output. It contains no path and no time: the same input and settings give the same bytes.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from lassokin_ros.common.command_line import version
from lassokin_ros.core.errors import LassokinError
from lassokin_ros.core.recording import WHOLE_FILE
from lassokin_ros.core.yaml_files import load_mapping, read_text, user_path
from lassokin_ros.pipeline.camera.calibration_file import split_camera
from lassokin_ros.pipeline.parameter_files import offline_settings
from lassokin_ros.replay.recording_files import journals_of
from lassokin_ros.skeleton_readers.naming import names_file

KEY = "lassokin_ros"
"""Key of the record in the custom data."""
READ_WHOLE = 64 * 2**20
"""bytes: the digest of a larger file covers its size and SAMPLES evenly spaced pieces of SAMPLE bytes."""
SAMPLE, SAMPLES = 2**20, 16
FILES = (".mcap", ".db3", ".zstd")


@dataclass(frozen=True)
class Figures:
    """Result figures of one replay.

    frames_in: keypoint messages read. frames_out: those with a skeleton. lost: number of tracking losses and
    re-initialisations. reprojection_px: median over the accepted frames, None if there are none.
    """

    frames_in: int
    frames_out: int
    lost: int
    reprojection_px: float | None


@dataclass(frozen=True)
class Origin:
    """The origin of an output: software version, digest of the input and digest of the settings."""

    version: str
    input: str
    settings: str


@dataclass(frozen=True)
class Record:
    """The record of one output."""

    origin: Origin
    figures: Figures

    @property
    def text(self) -> str:
        """The stored form: JSON."""
        return json.dumps({**asdict(self.origin), **asdict(self.figures)})


def origin_of(options: argparse.Namespace) -> Origin:
    """Return the origin of the output that these options produce. Raises a LassokinError for unusable settings.

    Files are identified by their content: a parameter file and the same values on the command line are equal.
    """
    configs = offline_settings(options.params_file, options.p, WHOLE_FILE if options.two_pass else {})
    settings: dict[str, Any] = {name: value for config in configs for name, value in asdict(config).items()}
    for name in ("skeleton", "landmarks"):
        path = user_path(settings[name])
        files = [path, *(file for file in [names_file(path)] if file.is_file())]
        settings[name] = _digest(files) if path.is_file() else settings[name]
    for name in ("keypoints_topic", "camera_info_topic", "storage"):
        settings[f"--{name}"] = getattr(options, name)
    if options.two_pass:
        settings["--two_pass"] = True
    if options.camera_info is not None:  # absent without the option: earlier records stay valid
        settings["--camera_info"] = _digest([split_camera(options.camera_info)[0]]), options.camera_info.name
    # Exports do not change the recording, so they are not part of the settings (see archive/tasks.py).
    text = json.dumps(settings, sort_keys=True)
    return Origin(version(), _digest(_files(options.bag)), hashlib.sha256(text.encode()).hexdigest())


def record_of(path: Path) -> Record | None:
    """Return the record of a recording, or None if there is none or it cannot be parsed."""
    try:
        data = load_mapping(read_text(path / "metadata.yaml", LassokinError), str(path), LassokinError)
        values = json.loads(data["rosbag2_bagfile_information"]["custom_data"][KEY])
        origin = Origin(*(values[name] for name in Origin.__dataclass_fields__))
        return Record(origin, Figures(*(values[name] for name in Figures.__dataclass_fields__)))
    except (LassokinError, KeyError, TypeError, ValueError):
        return None


def _files(bag: Path) -> list[Path]:
    """Return the files of a recording; empty if there is no recording."""
    if not bag.is_dir():
        return [bag, *journals_of(bag)] if bag.is_file() else []
    files = [file for file in bag.iterdir() if file.name == "metadata.yaml" or file.suffix in FILES]
    return sorted([*files, *(journal for file in files for journal in journals_of(file))])


def _digest(files: list[Path]) -> str:
    """Return a digest of the files' contents, empty if a file cannot be read: opening it gives a better error."""
    digest = hashlib.sha256()
    try:
        for file in files:
            size = file.stat().st_size
            digest.update(f"{size}:".encode())
            with file.open("rb") as stream:
                if size <= READ_WHOLE:
                    digest.update(stream.read())
                else:
                    for sample in range(SAMPLES):
                        stream.seek(sample * (size - SAMPLE) // (SAMPLES - 1))
                        digest.update(stream.read(SAMPLE))
    except OSError:
        return ""
    return digest.hexdigest()
