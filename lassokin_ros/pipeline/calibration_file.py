"""Camera calibration files of ROS (ost.yaml), OpenCV (FileStorage YAML) and Kalibr (camchain YAML)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from lassokin_ros.core.errors import CameraError
from lassokin_ros.core.yaml_files import load_mapping, read_text
from lassokin_ros.pipeline.camera import Camera
from msg_adapters.backends import Backend
from msg_adapters.errors import AdapterError
from msg_adapters.inputs import camera_info

FRAME = "camera_optical_frame"
"""frame_id of a camera that is known from a file."""
FORMS = (
    "camera_matrix, distortion_coefficients, image_width and image_height (ROS's ost.yaml, OpenCV's FileStorage), or "
    "cam0 with intrinsics, distortion_coeffs and resolution (Kalibr's camchain.yaml)"
)
KALIBR_MODELS = {"radtan": "plumb_bob", "equidistant": "equidistant", "none": "plumb_bob"}
"""Kalibr's distortion model -> that of camera_info. radtan has the coefficients k1, k2, p1, p2 in OpenCV's order."""
MATRIX = ("cameramatrix", "k")
DISTORTION = ("distortioncoefficients", "distcoeffs", "distortioncoeffs", "d")
PROJECTION = ("projectionmatrix", "p")
"""Names of the entries in OpenCV's files, in lower case and without underscores."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """Intrinsics of an image. K: (3, 3) px. D: coefficients of `model`. size: (width, height) px.

    P: (3, 4) px, of the rectified image, None if unknown. source: the file, for messages. note: what a user must know.
    """

    K: np.ndarray
    D: np.ndarray
    model: str = "plumb_bob"
    size: tuple[int, int] = (0, 0)
    P: np.ndarray | None = None
    source: str = ""
    note: str = ""

    def scaled(self, size: tuple[int, int]) -> Calibration:
        """Return the calibration for images of another size (width, height) px of the same camera.

        Raises CameraError for another aspect ratio.
        """
        scale = np.array(size) / np.array(self.size)
        if abs(scale[0] / scale[1] - 1) > 0.01:
            raise CameraError(
                f"'{self.source}' is for {self.size[0]} x {self.size[1]} px, the images have {size[0]} x {size[1]} px; "
                "expected the same aspect ratio"
            )
        factors = np.array([*scale, 1.0])[:, None]
        return replace(self, K=factors * self.K, P=None if self.P is None else factors * self.P, size=size)

    def message(self, backend: Backend, stamp_ns: int, rectified: bool = False) -> Any:
        """Return the calibration as sensor_msgs/CameraInfo in the frame FRAME.

        rectified: the keypoints are pixels of the rectified image. Raises CameraError if no camera has these values.
        """
        if rectified and self.P is None and self.D.any():
            raise CameraError(f"'{self.source}' has no projection_matrix; expected one because of `rectified`")
        message = camera_info(backend, stamp_ns, FRAME, self.K, self.D, self.size, self.model)
        if self.P is not None:
            message.p = self.P.reshape(12)
        try:
            Camera(rectified).update(message)
        except AdapterError as error:
            raise CameraError(f"'{self.source}' is not usable: {error}") from None
        return message


def read_calibration(path: Path) -> Calibration:
    """Read a calibration file; its content tells the form. Raises CameraError."""
    text = read_text(path, CameraError)
    if text.lstrip().startswith(("<", "{")):
        raise CameraError(f"'{path}' is XML or JSON; expected YAML with {FORMS}")
    text = re.sub(r"\A\s*%YAML:[\d.]+", "", text).replace("!!opencv-matrix", "")
    data = load_mapping(text, f"'{path}'", CameraError)
    chain = sorted(key for key in data if re.fullmatch(r"cam\d+", str(key)))
    read = _kalibr if chain or "intrinsics" in data else _opencv
    try:
        found = read(data[chain[0]] if chain else data)
    except CameraError as error:
        raise CameraError(f"'{path}': {error}") from None
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        what = f"it lacks {error}" if isinstance(error, KeyError) else str(error)
        raise CameraError(f"'{path}' is not a calibration file: {what}; expected {FORMS}") from None
    if min(found.size) < 1:
        raise CameraError(f"'{path}' is for an image of {found.size[0]} x {found.size[1]} px; expected the image size")
    note = f"{chain[0]} of {', '.join(chain)} is used" if len(chain) > 1 else ""
    return replace(found, source=str(path), note=note)


def _kalibr(data: Any) -> Calibration:
    if not isinstance(data, Mapping):
        raise TypeError("cam0 is not a mapping")
    lens = str(data.get("camera_model", "pinhole"))
    if lens != "pinhole":
        raise CameraError(f"camera_model is {lens[:40]}; expected pinhole: run Kalibr with --models pinhole-radtan")
    name = str(data.get("distortion_model", "none"))
    if name not in KALIBR_MODELS:
        raise CameraError(f"distortion_model is {name[:40]}; expected {' or '.join(KALIBR_MODELS)}")
    fx, fy, cx, cy = _numbers(data["intrinsics"], 4)
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    D = np.zeros(5) if name == "none" else _numbers(data["distortion_coeffs"], 4)
    return Calibration(K, D, KALIBR_MODELS[name], _size(*data["resolution"]))


def _opencv(data: Mapping[Any, Any]) -> Calibration:
    entries = {str(key).lower().replace("_", ""): value for key, value in data.items()}
    K = _numbers(_first(entries, MATRIX, "camera_matrix"), 9).reshape(3, 3)
    D = _numbers(_first(entries, DISTORTION, "distortion_coefficients"))
    if "imagesize" in entries:
        size = _size(*entries["imagesize"])
    else:
        size = _size(
            _first(entries, ("imagewidth", "width"), "image_width"),
            _first(entries, ("imageheight", "height"), "image_height"),
        )
    usual = "equidistant" if entries.get("fisheyemodel") else "rational_polynomial" if len(D) > 5 else "plumb_bob"
    P = next((_numbers(entries[name], 12).reshape(3, 4) for name in PROJECTION if name in entries), None)
    return Calibration(K, D, str(entries.get("distortionmodel", usual)), size, P)


def _first(entries: Mapping[str, Any], names: tuple[str, ...], usual: str) -> Any:
    for name in names:
        if name in entries:
            return entries[name]
    raise KeyError(usual)


def _numbers(value: Any, count: int | None = None) -> np.ndarray:
    """Return the numbers of a list, or of a matrix with `data`."""
    numbers = np.array(value["data"] if isinstance(value, Mapping) else value, dtype=float).ravel()
    if count is not None and len(numbers) != count:
        raise ValueError(f"{len(numbers)} numbers where {count} are expected")
    return numbers


def _size(width: Any, height: Any) -> tuple[int, int]:
    return int(width), int(height)
