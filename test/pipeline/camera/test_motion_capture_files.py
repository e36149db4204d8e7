"""Calibrations of EasyMocap, OpenCap, Panoptic and Qualisys, and Kalibr's wide lenses."""

import json
import os
import pickle
from pathlib import Path

import numpy as np
import pytest

from lassokin_ros.core.errors import CameraError
from lassokin_ros.pipeline.camera import distortion
from lassokin_ros.pipeline.camera.calibration_file import camera_names, read_calibration, read_cameras
from lassokin_ros.pipeline.camera.lens import Lens

K = [[900.0, 0, 640], [0, 910.0, 350], [0, 0, 1]]
D = [-0.1, 0.02, 0.001, 0.002, 0.0]
R = [[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]
T = [0.5, -0.25, 3.0]


def check(file, names, size=(1280, 720)):
    """The second of two cameras has the values above."""
    assert camera_names(file) == names
    lens, pose = read_cameras(file, names)[names[1]]
    assert lens.K.tolist() == K and np.allclose(lens.D, D) and lens.size == size
    assert np.allclose(pose.rotation, R) and np.allclose(pose.translation, T)


def opencv(name, values):
    rows = np.atleast_2d(values)
    data = ", ".join(map(str, rows.ravel().tolist()))
    return f"{name}: !!opencv-matrix\n   rows: {len(rows)}\n   cols: {rows.shape[1]}\n   dt: d\n   data: [ {data} ]\n"


@pytest.mark.parametrize("vectors", [False, True])
def test_easymocap(tmp_path, vectors):
    head = '%YAML:1.0\n---\nnames:\n  - "01"\n  - "02"\n'
    intrinsics = "".join(
        opencv(f"K_{n}", K) + opencv(f"dist_{n}", D) + f"H_{n}: 720\nW_{n}: 1280\n" for n in ("01", "02")
    )
    rotation = {"01": np.zeros((3, 1)), "02": [[0], [0], [np.pi / 2]]}
    matrix = {"01": np.eye(3), "02": R}
    extrinsics = "".join(
        opencv(f"R_{n}", rotation[n]) + ("" if vectors else opencv(f"Rot_{n}", matrix[n])) + opencv(f"T_{n}", np.c_[T])
        for n in ("01", "02")
    )
    (tmp_path / "intri.yml").write_text(head + intrinsics)
    (tmp_path / "extri.yml").write_text(head + extrinsics)
    check(tmp_path, ["01", "02"])
    assert read_calibration(tmp_path / "intri.yml:02").K.tolist() == K
    (tmp_path / "extri.yml").write_text(head + extrinsics.replace("T_02", "X_02"))
    with pytest.raises(CameraError, match="the files of EasyMocap in .* have no T_02; expected ost.yaml"):
        camera_names(tmp_path)
    (tmp_path / "extri.yml").unlink()
    with pytest.raises(CameraError, match="is a folder without intri.yml and extri.yml, or OpenCap's pickles"):
        camera_names(tmp_path)


def test_panoptic_whose_places_are_in_cm(tmp_path):
    cameras = [{"name": name, "type": "hd", "resolution": [1280, 720], "K": K, "distCoef": D, "R": R,
                "t": [[100 * one] for one in T]} for name in ("00_00", "00_01")]  # fmt: skip
    file = tmp_path / "calibration_171026_pose3.json"
    file.write_text(json.dumps({"calibDataSource": "x", "cameras": cameras}))
    check(file, ["00_00", "00_01"])


class Harm:
    def __reduce__(self):
        return os.mkdir, ("harm",)


@pytest.mark.parametrize("sides", [[[1280.0], [720.0]], [[720.0], [1280.0]]])
def test_opencap_whose_pickles_are_read_as_arrays_only(tmp_path, monkeypatch, sides):
    monkeypatch.chdir(tmp_path)
    values = {"intrinsicMat": np.array(K), "distortion": np.array([D]), "imageSize": np.array(sides),
              "rotation": np.array(R), "translation": 1000 * np.c_[T]}  # fmt: skip
    for name in ("Cam0", "Cam1"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "cameraIntrinsicsExtrinsics.pickle").write_bytes(pickle.dumps(values))
    check(tmp_path, ["Cam0", "Cam1"])
    one = tmp_path / "Cam1" / "cameraIntrinsicsExtrinsics.pickle"
    assert read_calibration(one).size == (1280, 720)
    one.write_bytes(pickle.dumps({**values, "more": Harm()}))
    with pytest.raises(CameraError, match="holds arrays of a program, which are not read"):
        read_calibration(one)
    assert not Path("harm").exists()


QUALISYS = """<?xml version="1.0"?>
<calibration><cameras>
 <camera active="1" serial="a" viewrotation="0">
  <fov_video bottom="719" left="0" right="1279" top="0"/><fov_marker bottom="719" left="0" right="1279" top="0"/>
  <transform x="0" y="0" z="0" r11="1" r12="0" r13="0" r21="0" r22="1" r23="0" r31="0" r32="0" r33="1"/>
  <intrinsic focallength="9" focalLengthU="{fu}" focalLengthV="{fv}" centerPointU="{cu}" centerPointV="{cv}"
   radialDistortion1="-0.1" radialDistortion2="0.02" radialDistortion3="0" tangentalDistortion1="0.001"
   tangentalDistortion2="0.002"/>
 </camera>
 <camera active="1" serial="marker"><fov_marker bottom="1" left="0" right="1" top="0"/></camera>
 <camera active="1" serial="b" viewrotation="0">
  <fov_video bottom="719" left="0" right="1279" top="0"/>
  <transform x="{x}" y="{y}" z="{z}" r11="0" r12="-1" r13="0" r21="-1" r22="0" r23="0" r31="0" r32="0" r33="-1"/>
  <intrinsic focallength="9" focalLengthU="{fu}" focalLengthV="{fv}" centerPointU="{cu}" centerPointV="{cv}"
   radialDistortion1="-0.1" radialDistortion2="0.02" radialDistortion3="0" tangentalDistortion1="0.001"
   tangentalDistortion2="0.002"/>
 </camera>
</cameras></calibration>
"""


def test_qualisys_in_subpixels_and_mm(tmp_path):
    x, y, z = (1000 * -np.array(R).T @ T).tolist()
    file = tmp_path / "Calib.qca.txt"
    file.write_text(QUALISYS.format(fu=64 * 900, fv=64 * 910, cu=64 * 640, cv=64 * 350, x=x, y=y, z=z))
    check(file, ["a", "b"])
    file.write_text('<!DOCTYPE x [<!ENTITY a "b">]>' + file.read_text())
    with pytest.raises(CameraError, match="is neither YAML nor TOML"):
        camera_names(file)


def projected(model, theta, parameters):
    """Distance from the principal point by the models' definitions, on a point (sin, cos) of the unit circle."""
    x, z = np.sin(theta), np.cos(theta)
    if model == "omni":
        return x / (z + parameters[0])
    if model == "eucm":
        alpha, beta = parameters
        return x / (alpha * np.sqrt(beta * x * x + z * z) + (1 - alpha) * z)
    xi, alpha = parameters
    return x / (alpha * np.sqrt(x * x + (xi + z) ** 2) + (1 - alpha) * (xi + z))


@pytest.mark.parametrize(
    ("model", "parameters", "focal"), [("omni", [0.9], 800.0), ("ds", [-0.2, 0.6], 350.0), ("eucm", [0.6, 1.1], 400.0)]
)
def test_wide_lenses_of_kalibr_are_read(tmp_path, model, parameters, focal):
    file = tmp_path / "camchain.yaml"
    numbers = [*parameters, focal, focal, 640, 360]
    lens = f"camera_model: {model}, distortion_model: none, intrinsics: {numbers}, resolution: [1280, 720]"
    file.write_text(f"cam0: {{{lens}}}\n")
    lens = read_calibration(file).lens()
    assert isinstance(lens, Lens) and lens.model == "equidistant"
    theta = np.radians([1.0, 10.0, 30.0, 45.0])
    radius = focal * projected(model, theta, parameters)
    found = lens.normalise(np.column_stack([640 + radius, np.full(4, 360.0)]))
    assert np.abs(np.degrees(np.arctan(found[:, 0]) - theta)).max() < 0.1 and np.abs(found[:, 1]).max() < 1e-9
    file.write_text(file.read_text().replace(str(numbers), "[1, 2, 3]"))
    with pytest.raises(CameraError, match=f"a list has 3 values in place of {4 + len(parameters)}"):
        read_calibration(file)


def test_a_lens_that_no_equidistant_one_is_near_is_refused():
    with pytest.raises(CameraError, match="is no lens that can be used"):
        distortion.nearest_equidistant("omni", [0.9], [0.0, 0.0, 0.1, 0.0], 800.0, 700.0, "a")
    with pytest.raises(CameraError, match="px from an equidistant lens"):
        distortion.nearest_equidistant("eucm", [0.99, 20.0], [], 8000.0, 1700.0, "a")
