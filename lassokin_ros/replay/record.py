"""What a replay's output says of itself: of which input, with which settings, by which version, and its figures.

The record stands in the output's metadata.yaml (rosbag2's `custom_data`), so that it comes into being with the output,
all or nothing, and goes where the output goes. It names no path and no time: same input and settings, same bytes.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

from lassokin_ros.core.errors import LassokinError
from lassokin_ros.core.yaml_files import load_mapping, read_text
from lassokin_ros.pipeline.parameter_files import offline_settings

KEY = "lassokin_ros"
"""Of the record among a recording's custom data."""
READ_WHOLE = 64 * 2**20
"""bytes: larger files are known by their size and by SAMPLES pieces of SAMPLE bytes, spread evenly from end to end."""
SAMPLE, SAMPLES = 2**20, 16
FILES = (".mcap", ".db3", ".zstd")


@dataclass(frozen=True)
class Figures:
    """What became of a recording.

    frames_in, frames_out: keypoint messages read, and accepted ones; lost: how often somebody was lost, or found anew;
    reprojection_px: median over accepted frames, None without any.
    """

    frames_in: int
    frames_out: int
    lost: int
    reprojection_px: float | None


@dataclass(frozen=True)
class Origin:
    """Of what an output is made: the version that made it, and digests of its input and of its settings."""

    version: str
    input: str
    settings: str


@dataclass(frozen=True)
class Record:
    """The whole record."""

    origin: Origin
    figures: Figures

    @property
    def text(self) -> str:
        """As it is stored: JSON."""
        return json.dumps({**asdict(self.origin), **asdict(self.figures)})


def origin_of(options: argparse.Namespace) -> Origin:
    """Of the output that the command line's options lead to. Raises a LassokinError for settings that cannot be used.

    Files are known by their content: a parameter file and the same values on the command line are the same settings.
    """
    configs = offline_settings(options.params_file, options.p)
    settings: dict[str, Any] = {name: value for config in configs for name, value in asdict(config).items()}
    for name in ("skeleton", "landmarks"):
        path = Path(settings[name])
        settings[name] = _digest([path]) if path.is_file() else settings[name]
    for name in ("keypoints_topic", "camera_info_topic", "storage"):
        settings[f"--{name}"] = getattr(options, name)
    # Exports have no part in it: with them or without, the recording is the same (see archive_files for their absence).
    text = json.dumps(settings, sort_keys=True)
    return Origin(_version(), _digest(_files(options.bag)), hashlib.sha256(text.encode()).hexdigest())


def record_of(path: Path) -> Record | None:
    """The record of a recording, None where there is none, or none that is understood."""
    try:
        data = load_mapping(read_text(path / "metadata.yaml", LassokinError), str(path), LassokinError)
        values = json.loads(data["rosbag2_bagfile_information"]["custom_data"][KEY])
        origin = Origin(*(values[name] for name in Origin.__dataclass_fields__))
        return Record(origin, Figures(*(values[name] for name in Figures.__dataclass_fields__)))
    except (LassokinError, KeyError, TypeError, ValueError):
        return None


def _version() -> str:
    try:
        return metadata.version("lassokin_ros")
    except metadata.PackageNotFoundError:  # run from its folder, not installed
        return "unknown"


def _files(bag: Path) -> list[Path]:
    """The files that make up a recording; none when there is no recording."""
    if not bag.is_dir():
        return [bag] if bag.is_file() else []
    return sorted(file for file in bag.iterdir() if file.name == "metadata.yaml" or file.suffix in FILES)


def _digest(files: list[Path]) -> str:
    """Of the files' contents; empty when one cannot be read, which whoever opens it will say better."""
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
