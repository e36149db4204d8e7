"""Camera calibration files: ost.yaml of ROS, OpenCV's FileStorage YAML or JSON, camchain of Kalibr, TOML of Anipose."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from lassokin_ros.core.body.rotations import exponential
from lassokin_ros.core.errors import CameraError
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.pipeline.camera import distortion
from lassokin_ros.pipeline.camera.calibration_formats import FORMS, easymocap, panoptic, values_in
from lassokin_ros.pipeline.camera.lens import Lens
from msg_adapters.backends import Backend
from msg_adapters.camera_info import Intrinsics, intrinsics_of
from msg_adapters.errors import AdapterError
from msg_adapters.inputs import camera_info

KALIBR_MODELS = {"radtan": "plumb_bob", "equidistant": "equidistant", "none": "plumb_bob"}
"""distortion_model of Kalibr -> distortion_model of ROS."""
MATRIX = ("cameramatrix", "k", "intrinsicmatrix", "intrinsicsmatrix", "mtx", "matrix")
COEFFICIENTS = ("distortioncoefficients", "distcoeffs", "distortioncoeffs", "d", "dist", "distortions")
WIDTH, HEIGHT = ("imagewidth", "width"), ("imageheight", "height")
SIZE = ("imagesize", "resolution", "size")
PROJECTION = ("projectionmatrix", "p")
MODEL = ("distortionmodel",)
FISHEYE = ("fisheyemodel", "fisheye")
"""Names of the values, in lower case and without underscores. OpenCV's own programs write several of them."""


ROTATION = ("rotation", "rvec", "r")
TRANSLATION = ("translation", "tvec", "t")
"""Names of the pose of a camera: x_camera = R x + t, R as a rotation vector, rad, or a matrix, and t in m."""

LARGEST_NUMBER = 1e9
"""Largest absolute value of a number in a file."""
LARGEST_SKEW = 1e-3
"""Largest difference of a rotation matrix times its transpose from the identity, by rounding in a file."""
FARTHEST_APART_M = 50.0
"""m: cameras on opposite sides of a person at the largest distance that the report accepts, 25 m."""
Pose = tuple[np.ndarray, np.ndarray]
"""Rotation (3, 3) into the camera and translation (3,) m."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """Intrinsics of an image. K: (3, 3) px. D: coefficients of `model`. size: (width, height) px, zeros if unknown.

    P: (3, 4) px of the rectified image, None if the file has none.
    """

    K: np.ndarray
    D: np.ndarray
    model: str = "plumb_bob"
    size: tuple[int, int] = (0, 0)
    P: np.ndarray | None = None

    def scaled_to(self, size: tuple[int, int], source: str) -> Calibration:
        """Return the calibration of the same image with another size (width, height) px.

        source: the file, for messages. Raises CameraError for another aspect ratio.
        """
        if self.size == (0, 0):
            return replace(self, size=size)
        scale = np.array(size) / np.array(self.size)
        if abs(scale[0] / scale[1] - 1) > 0.01:
            raise CameraError(
                f"'{source}' is for {self.size[0]} x {self.size[1]} px, the images have {size[0]} x {size[1]} px; "
                "expected the same aspect ratio"
            )
        scale = np.append(scale, 1.0)[:, None]
        return replace(self, K=self.K * scale, P=None if self.P is None else self.P * scale, size=size)

    def message(self, backend: Backend, stamp_ns: int, frame_id: str, rectified: bool = False) -> Any:
        """Return the calibration as sensor_msgs/CameraInfo. Raises CameraError if no lens can be made of it."""
        self.intrinsics(frame_id, rectified)
        message = camera_info(backend, stamp_ns, frame_id, self.K, self.D, self.size, self.model)
        if self.P is not None:
            message.p = self.P.reshape(12)
        return message

    def intrinsics(self, frame_id: str, rectified: bool = False) -> Intrinsics:
        """Return the calibration as the tracker takes it. Raises CameraError if no lens can be made of it."""
        P = np.hstack([self.K, np.zeros((3, 1))]) if self.P is None else self.P
        try:
            intrinsics = intrinsics_of(self.K, self.D, self.model, P, self.size, frame_id, rectified)
        except AdapterError as error:
            raise CameraError(str(error)) from None
        Lens.from_intrinsics(intrinsics, rectified)
        return intrinsics

    def lens(self) -> Lens:
        """Return the lens of the raw image. Raises CameraError if there is none."""
        return Lens.from_intrinsics(self.intrinsics(""))


def read_calibration(path: Path) -> Calibration:
    """Read a calibration file. Of a file with several cameras one is chosen by its name: `camchain.yaml:cam1`.

    Raises CameraError.
    """
    file, chosen = split_camera(path)
    cameras = _cameras(values_in(file))
    if not chosen and len(cameras) == 1:
        (chosen,) = cameras
    names = ", ".join(cameras)
    if not chosen:
        raise CameraError(f"'{file}' has several cameras: {names}; choose one, such as {file}:{next(iter(cameras))}")
    if chosen not in cameras:
        raise CameraError(f"'{file}' has no camera '{chosen}'; expected one of: {names}")
    return _calibration(cameras[chosen], file)


def _calibration(camera: Mapping[str, Any], file: Path) -> Calibration:
    """Return the calibration in the values of one camera. Raises CameraError."""
    values = {re.sub(r"[\s_-]", "", str(key)).lower(): value for key, value in camera.items()}
    try:
        calibration = _from_kalibr(values, file) if "intrinsics" in values else _from_opencv(values)
    except CameraError:
        raise
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise CameraError(f"'{file}' is no camera calibration: {_what(error)}; {FORMS}") from None
    if calibration.size != (0, 0) and min(calibration.size) < 1:
        raise CameraError(f"'{file}' is for an image of {calibration.size[0]} x {calibration.size[1]} px")
    return calibration


def camera_names(file: Path) -> list[str]:
    """Return the names of the cameras in a file. Raises CameraError."""
    return list(_cameras(values_in(file)))


def read_cameras(file: Path, names: Sequence[str], any_unit: bool = False) -> dict[str, tuple[Calibration, CameraPose]]:
    """Read the calibrations and the poses of several cameras of one file, by name.

    any_unit: the places may be in another unit than m, which the caller finds out.

    TOML of Pose2Sim, Anipose or caliscope; a camchain of Kalibr, whose poses are relative to the camera before; a file
    of OpenCV's stereo calibration with R and T; or those of `calibration_formats`. Raises CameraError.
    """
    data = values_in(file)
    cameras = _cameras(data)
    missing = [name for name in names if name not in cameras]
    if missing:
        raise CameraError(f"'{file}' has no camera '{missing[0]}'; expected the names of: {', '.join(cameras)}")
    try:
        poses = _poses(cameras, data)
    except (KeyError, TypeError, ValueError) as error:
        raise CameraError(
            f"'{file}' has no poses of its cameras: {_what(error)}; expected rotation and translation of each (TOML of "
            "Pose2Sim, Anipose or caliscope), T_cn_cnm1 (Kalibr), or R and T (OpenCV's stereo calibration)"
        ) from None
    found = {name: (_calibration(cameras[name], file), CameraPose(name, *poses[name])) for name in names}
    if not any_unit:
        _refuse_other_units([pose for _, pose in found.values()], file)
    return found


def _refuse_other_units(poses: Sequence[CameraPose], file: Path) -> None:
    """Raise CameraError for cameras that are too far apart, as those of a file in mm are."""
    for one, other in combinations(poses, 2):
        apart = float(np.linalg.norm(one.centre - other.centre))
        if apart > FARTHEST_APART_M:
            raise CameraError(
                f"'{file}': the cameras '{one.name}' and '{other.name}' are {apart:.0f} m apart; expected metres, at "
                f"most {FARTHEST_APART_M:g} m; divide the translations by 1000 if they are in mm"
            )


def _poses(cameras: Mapping[str, Mapping[str, Any]], data: Mapping[str, Any]) -> dict[str, Pose]:
    """Return rotation and translation of each camera. Raises KeyError, TypeError or ValueError."""
    first: Pose = np.eye(3), np.zeros(3)
    if "M1" in cameras:
        return {"M1": first, "M2": (_rotation(data["R"]), _numbers(data["T"], 3))}
    poses: dict[str, Pose] = {}
    before = first
    for name, values in cameras.items():
        if "T_cn_cnm1" in values:
            step = _numbers(values["T_cn_cnm1"], 16).reshape(4, 4)
            before = step[:3, :3] @ before[0], step[:3, :3] @ before[1] + step[:3, 3]
            poses[name] = before
        elif "intrinsics" in values:
            if poses:
                raise KeyError(f"T_cn_cnm1 of '{name}'")
            poses[name] = first
        else:
            found = {str(key).lower(): value for key, value in values.items()}
            rotation = _one_of(found, ROTATION, f"rotation of '{name}'")
            translation = _one_of(found, TRANSLATION, f"translation of '{name}'")
            poses[name] = _rotation(rotation), _numbers(translation, 3)
    return poses


def _rotation(value: Any) -> np.ndarray:
    """Return a rotation matrix (3, 3) from a matrix or a rotation vector, rad. Raises ValueError."""
    numbers = _numbers(value)
    if len(numbers) == 3:
        return np.asarray(exponential(numbers[None])[0])
    if len(numbers) != 9:
        raise ValueError(f"a rotation has {len(numbers)} values; expected 3 or 9")
    matrix = numbers.reshape(3, 3)
    if np.abs(matrix @ matrix.T - np.eye(3)).max() > LARGEST_SKEW or np.linalg.det(matrix) < 0:
        raise ValueError("a rotation matrix is not orthonormal")
    return matrix


def _what(error: Exception) -> str:
    return f"it has no {error.args[0]}" if isinstance(error, KeyError) else str(error)


def split_camera(path: Path) -> tuple[Path, str]:
    """Return (file, name of a camera in it, empty if none is chosen)."""
    name, colon, chosen = path.name.rpartition(":")
    return (path.with_name(name), chosen) if colon and name and not path.exists() else (path, "")


def _cameras(data: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """Return {name: values} of the cameras in a file."""
    tables = {name: data[name] for name in data if re.fullmatch(r"cam\d+", str(name)) and isinstance(data[name], dict)}
    if not tables:  # not Kalibr, but Anipose, Pose2Sim or caliscope
        all_tables = data["cameras"] if isinstance(data.get("cameras"), dict) else data
        tables = {str(key): one for key, one in all_tables.items() if isinstance(one, dict) and "matrix" in one}
    if tables:  # by their `name`; Anipose counts the keys: `[cam_0]` with `name = "left"`
        names = [str(table.get("name", "")) for table in tables.values()]
        return dict(zip(names, tables.values())) if all(names) and len(set(names)) == len(names) else tables
    if others := panoptic(data) or easymocap(data):
        return dict(others)
    stereo = [number for number in "12" if f"M{number}" in data]
    if stereo:  # OpenCV's stereo_calib
        sides = {*WIDTH, *HEIGHT, *SIZE}
        sizes = {key: value for key, value in data.items() if re.sub("_", "", str(key)).lower() in sides}
        return {f"M{n}": {"k": data[f"M{n}"], "d": data.get(f"D{n}"), **sizes} for n in stereo}
    return {"camera": data}


def _from_kalibr(values: Mapping[str, Any], file: Path) -> Calibration:
    camera, model = str(values.get("cameramodel", "pinhole")), str(values.get("distortionmodel", "none"))
    wide = distortion.WIDE_PARAMETERS.get(camera)
    if (wide is None and (camera != "pinhole" or model not in KALIBR_MODELS)) or (wide and model == "equidistant"):
        raise CameraError(
            f"'{file}' has camera_model {camera} with distortion_model {model}; expected pinhole with "
            f"{', '.join(KALIBR_MODELS)}, or {', '.join(distortion.WIDE_PARAMETERS)} with none or radtan"
        )
    *parameters, fx, fy, cx, cy = _numbers(values["intrinsics"], 4 + (wide or 0))
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    D = np.zeros(0) if model == "none" else _numbers(values["distortioncoeffs"])
    width, height = _numbers(values["resolution"], 2)
    size = int(width), int(height)
    if wide is None:
        return Calibration(K, D, KALIBR_MODELS[model], size)
    farthest = float(np.hypot(max(cx, width - cx), max(cy, height - cy)))
    factor, D = distortion.nearest_equidistant(
        camera, parameters, D.tolist(), float(np.sqrt(fx * fy)), farthest, str(file)
    )
    return Calibration(K * np.array([[factor, 1, 1], [1, factor, 1], [1, 1, 1]]), D, "equidistant", size)


def _from_opencv(values: Mapping[str, Any]) -> Calibration:
    """Return the calibration of a file of ROS or OpenCV. Raises KeyError, TypeError or ValueError."""
    K = _numbers(_one_of(values, MATRIX, "camera_matrix"), 9).reshape(3, 3)
    D = _numbers(_one_of(values, COEFFICIENTS, "distortion_coefficients"))
    model = _one_of(values, MODEL, "", "")
    if not model:
        model = "plumb_bob" if len(D) <= 5 else "rational_polynomial"
        model = "equidistant" if _one_of(values, FISHEYE, "", 0) else model
    if (size := _one_of(values, SIZE, "", None)) is None:
        size = [_one_of(values, WIDTH, "", 0), _one_of(values, HEIGHT, "", 0)]
    width, height = _numbers(size, 2)
    P = _one_of(values, PROJECTION, "", None)
    return Calibration(
        K, D, str(model), (int(width), int(height)), None if P is None else _numbers(P, 12).reshape(3, 4)
    )


_REQUIRED = object()


def _one_of(values: Mapping[str, Any], names: Iterable[str], wanted: str, default: Any = _REQUIRED) -> Any:
    """Return the value of the first name that exists, else `default`. Raises KeyError(wanted) if there is neither."""
    found = next((values[name] for name in names if values.get(name) is not None), default)
    if found is _REQUIRED:
        raise KeyError(wanted)
    return found


def _numbers(value: Any, count: int | None = None) -> np.ndarray:
    """Return the numbers of a list, of nested lists, or of an OpenCV matrix. Raises ValueError, KeyError, TypeError."""
    numbers = np.array(value["data"] if isinstance(value, dict) else value, dtype=float).ravel()
    if count is not None and len(numbers) != count:
        raise ValueError(f"a list has {len(numbers)} values in place of {count}")
    if not (np.abs(numbers) < LARGEST_NUMBER).all():  # NaN too
        raise ValueError(f"a value is not finite, or larger than {LARGEST_NUMBER:g}")
    return numbers
