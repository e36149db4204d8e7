"""Calibrations of motion capture programs: EasyMocap, OpenCap, Panoptic and Qualisys, as tables like those of Anipose.

A table has `matrix`, `distortions`, `rotation` and `translation` (m, x_camera = R x + t), and `size` if it is known.
"""

from __future__ import annotations

import io
import pickle
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

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


def in_folder(folder: Path, values_in: Callable[[Path], Mapping[str, Any]]) -> Tables:
    """Return the cameras of a folder of EasyMocap or OpenCap; none if it has neither. values_in: reads a file."""
    if all((folder / name).is_file() for name in EASYMOCAP_FILES):
        intrinsics, extrinsics = (values_in(folder / name) for name in EASYMOCAP_FILES)
        return easymocap({**intrinsics, **extrinsics})
    found = sorted(path.parent for path in folder.glob(f"**/{OPENCAP_FILE}"))
    return {one.name: table for one in found if (table := opencap(one / OPENCAP_FILE)) is not None}


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
