"""The values in the text of a calibration file: YAML, JSON, or TOML."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from lassokin_ros.core.errors import CameraError, LassokinError
from lassokin_ros.core.yaml_files import MAX_CHARACTERS, load_mapping, read_text

FORMS = (
    "expected ost.yaml of ROS, YAML of OpenCV's FileStorage, a camchain of Kalibr, or TOML of Pose2Sim, Anipose or "
    "caliscope"
)
BINARY = (".pkl", ".pickle", ".p", ".npz", ".npy", ".mat", ".h5")
"""Suffixes of files of programs, which are not read. A pickle can run code."""


def values_in(file: Path) -> dict[str, Any]:
    """Return the mapping in a calibration file. Raises CameraError."""
    if file.suffix.lower() in BINARY:
        raise CameraError(
            f"'{file}' holds arrays of a program, which are not read; {FORMS}: write K and D as YAML, such as "
            "'K: [[900, 0, 640], [0, 900, 360], [0, 0, 1]]' and 'D: [0, 0, 0, 0, 0]'"
        )
    try:
        text = read_text(file, CameraError)
    except CameraError as error:
        raise CameraError(f"{error}; {FORMS}" if "UTF-8" in str(error) else str(error)) from None
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
