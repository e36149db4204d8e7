"""The values in a calibration file: YAML, JSON, TOML, or those of motion capture programs."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from lassokin_ros.core.errors import CameraError, LassokinError
from lassokin_ros.core.yaml_files import MAX_CHARACTERS, load_mapping, read_text
from lassokin_ros.pipeline.camera import motion_capture_files

FORMS = (
    "expected ost.yaml of ROS, YAML of OpenCV's FileStorage, a camchain of Kalibr, TOML of Pose2Sim, Anipose or "
    "caliscope, JSON of Panoptic, .qca.txt of Qualisys, or a folder of EasyMocap or OpenCap"
)
BINARY = (".pkl", ".pickle", ".p", ".npz", ".npy", ".mat", ".h5")
"""Suffixes of files of programs, which are not read. A pickle can run code."""


def values_in(file: Path) -> dict[str, Any]:
    """Return the mapping in a calibration file, or in those of a folder. Raises CameraError."""
    if file.is_dir():
        try:
            tables = motion_capture_files.in_folder(file, values_in)
        except KeyError as error:
            raise CameraError(f"the files of EasyMocap in '{file}' have no {error.args[0]}; {FORMS}") from None
        if not tables:
            raise CameraError(f"'{file}' is a folder without intri.yml and extri.yml, or OpenCap's pickles; {FORMS}")
        return {"cameras": tables}
    if file.name == motion_capture_files.OPENCAP_FILE and file.is_file():
        table = motion_capture_files.opencap(file)
        if table is not None:
            return {"cameras": {file.parent.name: table}}
    if file.suffix.lower() in BINARY:
        raise CameraError(
            f"'{file}' holds arrays of a program, which are not read; {FORMS}: write K and D as YAML, such as "
            "'K: [[900, 0, 640], [0, 900, 360], [0, 0, 1]]' and 'D: [0, 0, 0, 0, 0]'"
        )
    try:
        text = read_text(file, CameraError)
    except CameraError as error:
        raise CameraError(f"{error}; {FORMS}" if "UTF-8" in str(error) else str(error)) from None
    if text.lstrip().startswith("<") and (tables := motion_capture_files.qualisys(text)):
        return {"cameras": tables}
    if file.suffix.lower() == ".toml":
        return _toml(text, file)
    if text.lstrip().startswith("{") and len(text) <= MAX_CHARACTERS:  # YAML, too, unless it is indented by tabs
        try:
            values = json.loads(text)
        except (ValueError, RecursionError):
            pass
        else:
            return values if isinstance(values, dict) else {}
    try:
        return load_mapping(_plain_yaml(text, file), str(file), CameraError)
    except LassokinError as error:
        if not re.search(r"^\s*\w+\s*=", text, re.MULTILINE):
            raise CameraError(f"{error}; {FORMS}") from None
        return _toml(text, file)


def _plain_yaml(text: str, file: Path) -> str:
    """Return the text without syntax that only OpenCV's reader has. Raises CameraError for XML and INI."""
    if re.search(r"\A\s*<|^\[image\]", text, re.MULTILINE):
        raise CameraError(f"'{file}' is XML or INI")
    text = re.sub(r"\A\s*%YAML:.*\n", "", text)
    return re.sub(r"!!opencv-[\w-]+", "", text).rstrip().removesuffix("\n---")


def _toml(text: str, file: Path) -> dict[str, Any]:
    """Return the values of a TOML file. Raises CameraError."""
    try:
        import tomllib
    except ImportError:  # Python 3.10
        raise CameraError(f"'{file}' is TOML, which needs Python 3.11 or newer; {FORMS}") from None
    if len(text) > MAX_CHARACTERS:
        raise CameraError(f"'{file}' is too long; expected at most {MAX_CHARACTERS} characters")
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())[:200]
        raise CameraError(f"'{file}' is neither YAML nor TOML ({reason}); {FORMS}") from None
