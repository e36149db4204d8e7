"""Calibration files of ROS, OpenCV and Kalibr: the values that are read, and the errors for other files."""

import json
import sys

import numpy as np
import pytest
from messages import rosbags_backend

from lassokin_ros.core.errors import CameraError
from lassokin_ros.pipeline.camera.calibration_file import (
    Calibration,
    camera_names,
    read_calibration,
    read_cameras,
    split_camera,
)

K = [[600.0, 0, 320], [0, 610, 240], [0, 0, 1]]
FLAT = "[600, 0, 320, 0, 610, 240, 0, 0, 1]"
D5, D8 = [0.1, 0.2, 0.01, 0.02, 0.3], [0.1, 0.2, 0.01, 0.02, 0.3, 0.4, 0.5, 0.6]
OST = f"camera_matrix: {{data: {FLAT}}}\ndistortion_coefficients: {{data: {D5}}}\n"
SIZE = "image_width: 640\nimage_height: 480\n"
KALIBR = "intrinsics: [600, 610, 320, 240], resolution: [640, 480]"


@pytest.fixture
def read(tmp_path):
    def of(text, camera=""):
        file = tmp_path / "camera.yaml"
        file.write_text(text, encoding="utf-8")
        return read_calibration(tmp_path / f"camera.yaml{camera and ':' + camera}")

    return of


@pytest.mark.parametrize(
    ("text", "model", "D", "size"),
    [
        (OST + SIZE, "plumb_bob", D5, (640, 480)),
        (OST, "plumb_bob", D5, (0, 0)),
        (OST + SIZE + "distortion_model: rational_polynomial\n", "rational_polynomial", D5, (640, 480)),
        (f"K: {K}\nD: {D8}\nresolution: [640, 480]\n", "rational_polynomial", D8, (640, 480)),
        (f"mtx: {K}\ndist: [{D5}]\nsize: [640, 480]\n", "plumb_bob", D5, (640, 480)),
        (f"cameraMatrix: {K}\ndistCoeffs: {D5[:4]}\nfisheye_model: 1\n", "equidistant", D5[:4], (0, 0)),
        (f"cameraMatrix: {K}\ndistCoeffs: {D5[:4]}\nfisheye_model: 0\n", "plumb_bob", D5[:4], (0, 0)),
        (f"%YAML:1.0\n---\nk: !!opencv-matrix\n  {{data: {FLAT}}}\nd: {D5}\nsize: [9, 7]\n", "plumb_bob", D5, (9, 7)),
        (f"Intrinsic Matrix: {K}\nDistortion-Coeffs: {D5}\n---\n", "plumb_bob", D5, (0, 0)),
    ],
)  # fmt: skip
def test_every_format_is_read(read, text, model, D, size):
    found = read(text)
    assert np.array_equal(found.K, K) and found.D.tolist() == D
    assert (found.model, found.size, found.P) == (model, size, None)
    P = [500.0, 0, 300, -50, 0, 500, 200, 0, 0, 0, 1, 0]
    assert read(OST + f"projection_matrix: {{data: {P}}}\n").P.ravel().tolist() == P


def test_json_that_is_indented_by_tabs_is_read(read):
    """YAML allows no tabs. The matrices are those of OpenCV's FileStorage."""
    K_data, D_data = [600, 0, 320, 0, 610, 240, 0, 0, 1], D5
    matrices = {"camera_matrix": {"rows": 3, "cols": 3, "data": K_data}, "distortion_coefficients": {"data": D_data}}
    found = read(json.dumps({**matrices, "image_width": 640, "image_height": 480}, indent="\t"))
    assert found.K.tolist() == K and found.D.tolist() == D5 and found.size == (640, 480)


@pytest.mark.parametrize(
    ("more", "model", "D"),
    [
        ("distortion_model: radtan, distortion_coeffs: [0.1, 0.2, 0, 0]", "plumb_bob", [0.1, 0.2, 0, 0]),
        ("distortion_model: equidistant, distortion_coeffs: [0.1, 0.2, 0, 0]", "equidistant", [0.1, 0.2, 0, 0]),
        ("camera_model: pinhole, distortion_model: none", "plumb_bob", []),
        ("camera_model: pinhole", "plumb_bob", []),
    ],
)
def test_a_camchain_of_kalibr_is_read(read, more, model, D):
    found = read(f"cam0: {{{KALIBR}, {more}}}\n")
    assert np.array_equal(found.K, K) and (found.model, found.D.tolist(), found.size) == (model, D, (640, 480))


TOML = pytest.mark.skipif(sys.version_info < (3, 11), reason="the standard library reads TOML from Python 3.11 on")
ANIPOSE = """
[cam_{name}]
name = "cam_{name}"
size = [ 640.0, 480.0]
matrix = [ [ 600.0, 0.0, 320.0], [ 0.0, 610.0, 240.0], [ 0.0, 0.0, 1.0]]
distortions = [ 0.1, 0.2, 0.01, 0.02]
rotation = [ 1.2, 0.1, 0.4]
translation = [ 0.0, 0.5, 3.0]
fisheye = {fisheye}
"""
METADATA = "\n[metadata]\nadjusted = false\nerror = 0.0\n"
CALISCOPE = ANIPOSE.replace("[cam_{name}]", "[cameras.{name}]").format(name=3, fisheye="false")


@TOML
@pytest.mark.parametrize("suffix", [".toml", ".txt"])
def test_toml_of_pose2sim_and_caliscope_is_read(tmp_path, suffix):
    file = tmp_path / f"Calib{suffix}"
    for text, model in (
        (ANIPOSE.format(name=1, fisheye="false") + METADATA, "plumb_bob"),
        (ANIPOSE.format(name=1, fisheye="true"), "equidistant"),
        (CALISCOPE, "plumb_bob"),
        (f"K = {K}\nD = {D5[:4]}\nsize = [640, 480]\n".replace("0.3", "0.3"), "plumb_bob"),
    ):
        file.write_text(text)
        found = read_calibration(file)
        assert np.array_equal(found.K, K) and (found.model, found.size) == (model, (640, 480))
        assert found.D.tolist() == D5[:4]


@TOML
def test_one_of_several_cameras_of_a_toml_file_must_be_selected(tmp_path):
    file = tmp_path / "Calib.toml"
    file.write_text("".join(ANIPOSE.format(name=n, fisheye="false") for n in (1, 2)).replace("600.0", "700.0", 1))
    with pytest.raises(CameraError, match="has several cameras: cam_1, cam_2; choose one"):
        read_calibration(file)
    assert read_calibration(tmp_path / "Calib.toml:cam_1").K[0, 0] == 700


def of_anipose(file, *cameras):
    """Write a file with cameras (key, name, focal length in px, x of the translation)."""
    text = "".join(
        ANIPOSE.format(name=key, fisheye="false")
        .replace(f'name = "cam_{key}"', f'name = "{name}"')
        .replace("600.0", f"{focal}")
        .replace("[ 0.0, 0.5", f"[ {x}, 0.5")
        for key, name, focal, x in cameras
    )
    file.write_text(text)
    return file


@TOML
@pytest.mark.parametrize("prefix", ["cam_", "cam"])
def test_the_cameras_of_anipose_have_the_names_in_their_tables(tmp_path, prefix):
    file = of_anipose(tmp_path / "c.toml", (0, "left", 700.0, 0.0), (1, "a/b", 800.0, 2.0))
    file.write_text(file.read_text().replace("[cam_", f"[{prefix}"))
    assert camera_names(file) == ["left", "a/b"]
    found = read_cameras(file, ["a/b", "left"])
    assert [lens.K[0, 0] for lens, _ in found.values()] == [800, 700]
    assert [pose.translation[0] for _, pose in found.values()] == [2, 0]
    assert read_calibration(tmp_path / "c.toml:left").K[0, 0] == 700
    repeated = of_anipose(tmp_path / "r.toml", (0, "left", 700.0, 0.0), (1, "left", 800.0, 2.0))
    assert camera_names(repeated) == ["cam_0", "cam_1"]


@TOML
def test_cameras_whose_places_are_in_mm_are_refused(tmp_path):
    file = of_anipose(tmp_path / "mm.toml", (0, "a", 700.0, 0.0), (1, "b", 700.0, 1500.0))
    with pytest.raises(CameraError, match="'a' and 'b' are 1500 m apart; expected metres, .* divide .* by 1000"):
        read_cameras(file, ["a", "b"])
    far = of_anipose(tmp_path / "m.toml", (0, "a", 700.0, 0.0), (1, "b", 700.0, 49.0))
    assert list(read_cameras(far, ["a", "b"])) == ["a", "b"]


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("camera.pkl", b"\x80\x04K\x01.", "holds arrays of a program, which are not read; expected ost.yaml of ROS"),
        ("calibration.npz", b"PK\x03\x04", "write K and D as YAML, such as 'K: [[900, 0, 640]"),
        ("camera.bin", b"\xff\xfe\x00", "is no UTF-8 text: "),
        ("camera.py", b"D = np.array([0.1, 0.2])\n", "is neither YAML nor TOML"),
        ("camera.toml", b"[cam_1\n", "is neither YAML nor TOML"),
        ("camera.toml", b"a = " + b"[" * 100_000, "is neither YAML nor TOML"),
        ("camera.txt", b"fx 900 fy 900\n", "expected a mapping at the top level; expected ost.yaml"),
        ("camera.toml", b"[cam_1]\nmatrix = [[1, 2], [3, 4]]\ndistortions = []\n", "a list has 4 values in place of 9"),
    ],
)
def test_other_files_name_the_accepted_forms(tmp_path, name, content, words):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(CameraError) as error:
        read_calibration(tmp_path / name)
    text = str(error.value)
    assert words in text and name in text and "TOML of Pose2Sim, Anipose or caliscope" in text and "\n" not in text


@pytest.mark.parametrize("more", ["camera_model: cata", "distortion_model: fov"])
def test_unknown_models_of_kalibr_are_refused(read, more):
    with pytest.raises(CameraError, match="expected pinhole with radtan, equidistant, none, or omni, ds, eucm with"):
        read(f"cam0: {{{KALIBR}, {more}}}\n")


def test_one_of_several_cameras_must_be_selected(read, tmp_path):
    (tmp_path / "b:c").touch()
    assert split_camera(tmp_path / "b:c") == (tmp_path / "b:c", "")
    assert split_camera(tmp_path / ":cam1") == (tmp_path / ":cam1", "")
    chain = f"cam0: {{{KALIBR}}}\ncam1: {{{KALIBR.replace('600', '700')}}}\n"
    assert read(chain, "cam1").K[0, 0] == 700 and read(chain, "cam0").K[0, 0] == 600
    with pytest.raises(CameraError, match="has several cameras: cam0, cam1; choose one, such as .*camera.yaml:cam0"):
        read(chain)
    with pytest.raises(CameraError, match="has no camera 'cam2'; expected one of: cam0, cam1"):
        read(chain, "cam2")
    stereo = f"M1: {K}\nD1: {D5}\nM2: {K}\nD2: {D8}\nimage_width: 640\nimage_height: 480\n"
    assert read(stereo, "M1").D.tolist() == D5 and read(stereo, "M2").D.tolist() == D8
    assert read(stereo, "M2").size == (640, 480)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<?xml version='1.0'?>", "is XML or INI; expected ost.yaml"),
        ("# x\n[image]\nwidth\n", "is XML or INI"),
        ("fps: 30\n", "is no camera calibration: it has no camera_matrix; expected ost.yaml"),
        (f"K: {K}\n", "it has no distortion_coefficients"),
        (f"K: [1, 2, 3]\nD: {D5}\n", "a list has 3 values in place of 9"),
        (f"K: {K}\nD: [0.1, .nan]\n", "a value is not finite"),
        (f"K: text\nD: {D5}\n", "is no camera calibration"),
        (f"K: {{rows: 3}}\nD: {D5}\n", "it has no data"),
        (f"K: {K}\nD: {D5}\nsize: [640, 0]\n", "is for an image of 640 x 0 px"),
        (f"K: {K}\nD: {D5}\nwidth: 640\n", "is for an image of 640 x 0 px"),
        ("cam0: {intrinsics: [600, 610, 320]}\n", "a list has 3 values in place of 4"),
        (f"cam0: {{{KALIBR}, distortion_model: radtan}}\n", "it has no distortioncoeffs"),
    ],
)
def test_a_file_without_calibration_is_refused(read, text, words):
    with pytest.raises(CameraError) as error:
        read(text)
    assert words in str(error.value) and "camera.yaml" in str(error.value)


def test_a_calibration_is_scaled_to_another_image_size():
    P = np.array([[500.0, 0, 300, -50], [0, 500, 200, 0], [0, 0, 1, 0]])
    given = Calibration(np.array(K), np.array(D5), size=(640, 480), P=P)
    half = given.scaled_to((320, 240), "file")
    assert half.K.tolist() == [[300, 0, 160], [0, 305, 120], [0, 0, 1]] and half.size == (320, 240)
    assert half.P.tolist() == [[250, 0, 150, -25], [0, 250, 100, 0], [0, 0, 1, 0]] and half.D.tolist() == D5
    assert given.scaled_to((1282, 960), "file").size == (1282, 960)  # rounding of the encoder
    with pytest.raises(
        CameraError, match="'file' is for 640 x 480 px, the images have 640 x 360 px; expected the same"
    ):
        given.scaled_to((640, 360), "file")
    for size in ((1294, 960), (1266, 960)):
        with pytest.raises(CameraError, match="same aspect ratio"):
            given.scaled_to(size, "file")
    unknown = Calibration(np.array(K), np.array(D5)).scaled_to((1000, 10), "file")
    assert unknown.size == (1000, 10) and np.array_equal(unknown.K, K) and unknown.P is None


def test_a_calibration_is_converted_to_camera_info():
    backend = rosbags_backend()
    given = Calibration(np.array(K), np.array(D5), size=(640, 480))
    message = given.message(backend, 5_000_000_001, "optical")
    assert (message.header.stamp.sec, message.header.stamp.nanosec, message.header.frame_id) == (5, 1, "optical")
    assert (message.width, message.height, message.distortion_model) == (640, 480, "plumb_bob")
    assert message.k.tolist() == np.ravel(K).tolist() and message.d.tolist() == D5
    assert message.p.tolist() == [600, 0, 320, 0, 0, 610, 240, 0, 0, 0, 1, 0]
    P = np.array([[500.0, 0, 300, -50], [0, 500, 200, 0], [0, 0, 1, 0]])
    own = Calibration(np.array(K), np.array(D5), size=(640, 480), P=P)
    assert own.message(backend, 0, "").p.tolist() == P.ravel().tolist()
    with pytest.raises(CameraError, match="plumb_bob with 3 coefficients"):
        Calibration(np.array(K), np.array(D5[:3]), size=(640, 480)).message(backend, 0, "")
    none = Calibration(np.array(K), np.array(D5), size=(640, 480), P=np.zeros((3, 4)))
    with pytest.raises(CameraError, match="rectified"):
        none.message(backend, 0, "", rectified=True)
    assert none.message(backend, 0, "").p.tolist() == [0.0] * 12
