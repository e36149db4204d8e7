"""The values in a calibration file: YAML, JSON, TOML, or those of EasyMocap, OpenCap, Panoptic and Qualisys.

Cameras of motion capture programs are tables like those of Anipose, with `matrix`, `distortions`, `rotation`,
`translation` (m, x_camera = R x + t), and `size` if it is known.
"""

from __future__ import annotations

import io
import json
import pickle
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from lassokin_ros.core.errors import CameraError, LassokinError
from lassokin_ros.core.yaml_files import MAX_CHARACTERS, load_mapping, read_text

Table = dict[str, Any]
Tables = dict[str, Table]

OPENCAP_FILE = "cameraIntrinsicsExtrinsics.pickle"
LARGEST_BYTES = 1_000_000
EASYMOCAP_FILES = ("intri.yml", "extri.yml")
SUBPIXELS = 64.0
"""Units of Qualisys's focal length and principal point, per px. The coefficients of the distortion have no unit."""
MM, CM = 1e-3, 1e-2
TO_OPTICAL = np.diag([1.0, -1.0, -1.0])
"""From the camera's frame of Qualisys (y up, z backward) to the optical frame."""
HARMLESS = {
    ("numpy", "ndarray"), ("numpy", "dtype"), ("_codecs", "encode"),
    *((f"numpy.{core}.multiarray", name) for core in ("core", "_core") for name in ("_reconstruct", "scalar")),
}  # fmt: skip
"""What the arrays in a pickle are made of. Anything else in it could run code, and is refused."""


class _Arrays(pickle.Unpickler):
    """Reads arrays, numbers and texts, and nothing else."""

    def find_class(self, module: str, name: str) -> Any:
        """Return a name that arrays need. Raises UnpicklingError for others."""
        if (module, name) not in HARMLESS:
            raise pickle.UnpicklingError(f"it contains {module}.{name}")
        return super().find_class(module, name)


def easymocap(values: Mapping[str, Any]) -> Tables:
    """Return the cameras of intri.yml and extri.yml. Raises KeyError for a missing value."""
    tables = {}
    for name in map(str, values.get("names", [])):
        rotation = values.get(f"Rot_{name}", values.get(f"R_{name}"))
        tables[name] = {
            "matrix": values[f"K_{name}"],
            "distortions": values.get(f"dist_{name}", values.get(f"D_{name}")),
        }
        if rotation is not None:
            tables[name] |= {"rotation": rotation, "translation": values[f"T_{name}"]}
        if f"H_{name}" in values and f"W_{name}" in values:
            tables[name]["size"] = [values[f"W_{name}"], values[f"H_{name}"]]
    return tables


def panoptic(values: Mapping[str, Any]) -> Tables:
    """Return the cameras of CMU Panoptic's JSON, whose translations are in cm; none if it is no such list."""
    cameras = values.get("cameras")
    wanted = {"K", "distCoef"}
    if not isinstance(cameras, list) or not all(isinstance(one, dict) and wanted <= one.keys() for one in cameras):
        return {}
    tables = {}
    for number, one in enumerate(cameras):
        table = {"matrix": one["K"], "distortions": one["distCoef"], "size": one.get("resolution", [0, 0])}
        if "R" in one and "t" in one:
            table |= {"rotation": one["R"], "translation": (CM * np.array(one["t"], dtype=float)).ravel().tolist()}
        tables[str(one.get("name", number))] = table
    return tables


def opencap(file: Path) -> Table | None:
    """Return the camera of OpenCap's pickle, whose translations are in mm; None if it is no such file."""
    if file.stat().st_size > LARGEST_BYTES:
        return None
    try:
        values = _Arrays(io.BytesIO(file.read_bytes())).load()
        K = np.array(values["intrinsicMat"], dtype=float).reshape(3, 3)
        table = {"matrix": K.tolist(), "distortions": np.ravel(values["distortion"]).tolist()}
        sides = np.ravel(values["imageSize"]).astype(int).tolist()
        sizes = [sides, sides[::-1]]  # some versions write the height first
        table["size"] = min(sizes, key=lambda size: float(np.abs(np.array(size) / 2 - K[:2, 2]).sum()))
        if "rotation" in values:
            table["rotation"] = np.array(values["rotation"], dtype=float).tolist()
            table["translation"] = (MM * np.ravel(values["translation"]).astype(float)).tolist()
        return table
    except Exception:  # a damaged pickle raises anything
        return None


def qualisys(text: str) -> Tables:
    """Return the cameras of Qualisys's calibration (.qca.txt, XML), those of videos; none if it is no such file."""
    if "<!" in text.replace("<!--", ""):  # no entities
        return {}
    try:
        cameras = list(ElementTree.fromstring(text.encode()).iter("camera"))
    except ElementTree.ParseError:
        return {}
    tables = {}
    for number, camera in enumerate(cameras):
        parts = [camera.find(tag) for tag in ("intrinsic", "transform", "fov_video")]
        if any(part is None for part in parts):
            continue
        lens, place, view = ({k.lower(): v for k, v in part.attrib.items()} for part in parts if part is not None)
        low, high = (np.array([float(view[a]), float(view[b])]) for a, b in (("left", "top"), ("right", "bottom")))
        focal, centre = (
            np.array([float(lens[f"{what}{axis}"]) for axis in "uv"]) / SUBPIXELS
            for what in ("focallength", "centerpoint")
        )
        R = TO_OPTICAL @ np.array([[float(place[f"r{i}{j}"]) for j in "123"] for i in "123"])
        middle = MM * np.array([float(place[axis]) for axis in "xyz"])
        tables[camera.get("serial", str(number))] = {
            "matrix": [[focal[0], 0.0, centre[0] - low[0]], [0.0, focal[1], centre[1] - low[1]], [0.0, 0.0, 1.0]],
            "distortions": [float(lens[name]) for name in (
                "radialdistortion1", "radialdistortion2", "tangentaldistortion1", "tangentaldistortion2",
                "radialdistortion3")],
            "size": (high - low + 1).tolist(),
            "rotation": R.tolist(),
            "translation": (-R @ middle).tolist(),
        }  # fmt: skip
    return tables


FORMS = (
    "expected ost.yaml of ROS, YAML of OpenCV's FileStorage, a camchain of Kalibr, TOML of Pose2Sim, Anipose or "
    "caliscope, JSON of Panoptic, .qca.txt of Qualisys, or a folder of EasyMocap or OpenCap"
)
BINARY = (".pkl", ".pickle", ".p", ".npz", ".npy", ".mat", ".h5")
"""Suffixes of files of programs, which are not read. A pickle can run code."""


def values_in(file: Path) -> dict[str, Any]:
    """Return the mapping in a calibration file, or in those of a folder. Raises CameraError."""
    if file.is_dir():
        return {"cameras": _in_folder(file)}
    if file.name == OPENCAP_FILE and file.is_file() and (table := opencap(file)) is not None:
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
    if text.lstrip().startswith("<") and (tables := qualisys(text)):
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


def _in_folder(folder: Path) -> Tables:
    """Return the cameras of a folder of EasyMocap or OpenCap. Raises CameraError."""
    if all((folder / name).is_file() for name in EASYMOCAP_FILES):
        intrinsics, extrinsics = (values_in(folder / name) for name in EASYMOCAP_FILES)
        try:
            tables = easymocap({**intrinsics, **extrinsics})
        except KeyError as error:
            raise CameraError(f"the files of EasyMocap in '{folder}' have no {error.args[0]}; {FORMS}") from None
    else:
        files = sorted(folder.glob(f"**/{OPENCAP_FILE}"))
        tables = {file.parent.name: table for file in files if (table := opencap(file)) is not None}
    if not tables:
        raise CameraError(f"'{folder}' is a folder without intri.yml and extri.yml, or OpenCap's pickles; {FORMS}")
    return tables


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
