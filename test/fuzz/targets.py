"""Targets of the fuzzing: every decoder of messages and every reader of files, each as a function of bytes.

A target gives seeds (good inputs), passes bytes to its decoder or reader, and lists the errors with which bad bytes may
be refused. Every other error is a fault, also a numpy warning.
"""

import io
import tempfile
import warnings
import zipfile
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from depth_camera import compressed_message
from faults.courses import BACKEND, LAYOUTS, NUMBERS, START_NS, TYPES, message_of, people
from faults.damage import WAYS, spoil
from faults.decoder_checks import outcome_of
from messages import HEIGHT, WIDTH, camera_info
from recordings import write_recording

from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import LassokinError
from lassokin_ros.pipeline.camera.calibration_file import read_calibration
from lassokin_ros.pipeline.camera.lens import Lens
from lassokin_ros.pipeline.input_checks.placeholders import without_placeholders
from lassokin_ros.pipeline.outputs.saved_files import skeleton_text
from lassokin_ros.pipeline.outputs.urdf import urdf
from lassokin_ros.pipeline.parameter_files import offline_settings
from lassokin_ros.replay.bags import BagReader
from lassokin_ros.replay.exports.bvh import hierarchy
from lassokin_ros.replay.record import record_of
from lassokin_ros.skeleton_readers.load import load_skeleton
from lassokin_ros.skeleton_readers.naming import tables
from msg_adapters.camera_info import decode_camera_info
from msg_adapters.depth_image import decode_compressed_depth, decode_depth_image
from msg_adapters.detectors.registry import ADAPTERS, keypoint_adapter
from msg_adapters.errors import AdapterError

BODY = Skeleton.load("anthropometric", 1.75)
WITH_HANDS = Skeleton.load("body_hands", 1.75)
PIXELS = np.array([[0.0, 0.0], [320.0, 240.0], [-5.0, 1e4], [1e6, -1e6], [np.nan, 3.0]])
SEPARATOR = b"--array--"
VERTICES = 40


@dataclass(frozen=True)
class Target:
    """seeds: good inputs. read: raises one of `refusals` for bytes that are refused."""

    seeds: Callable[[], list[bytes]]
    read: Callable[[bytes], object]
    refusals: tuple[type[Exception], ...]

    def run(self, data: bytes) -> bool:
        """Return whether the bytes were read; False if they were refused. Any other error is a fault."""
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            try:
                self.read(data)
            except self.refusals as error:
                assert str(error) and str(error).isprintable(), f"a refusal that is not one printable line: {error!r}"
                return False
        return True


@cache
def folder() -> Path:
    """A folder of this process for the files."""
    return Path(tempfile.mkdtemp(prefix="lassokin_fuzz_"))


def message_target(message_type, messages, use):
    """Target whose bytes are a serialised message; bytes that cannot be deserialised never reach a decoder."""

    def read(data):
        try:
            message = TYPES.deserialize_cdr(data, message_type)
        except Exception:  # the middleware drops it, the replay counts it
            return
        use(message)

    def seeds():
        return [bytes(TYPES.serialize_cdr(message, message_type)) for message in messages()]

    return Target(seeds, read, (AdapterError, LassokinError))


def keypoints_target(message_type):
    """Target of one detector's messages."""
    adapter = keypoint_adapter(message_type)

    def messages():
        alone, both = people(LAYOUTS[message_type])
        one = message_of(message_type, [alone[1][0]], START_NS, NUMBERS[:1])
        measured = [spoil(message_type, deepcopy(one), ["depth"], 1, START_NS)] if "depth" in WAYS[message_type] else []
        return [one, message_of(message_type, [pixels[0] for _, pixels in both], START_NS, NUMBERS), *measured]

    def use(message):
        outcome_of(adapter, message, (WIDTH, HEIGHT), people(LAYOUTS[message_type])[0][1].shape[1])
        without_placeholders(adapter.decode(message, (WIDTH, HEIGHT)), (WIDTH, HEIGHT))

    return message_target(message_type, messages, use)


def cameras():
    fisheye = {"distortion_model": "equidistant", "d": np.array([0.1, -0.02, 0.0, 0.0])}
    rational = {"distortion_model": "rational_polynomial", "d": np.array([0.1, -0.02, 0, 0, 0.01, 0.1, 0.0, 0.0])}
    lens = {"distortion_model": "plumb_bob", "d": np.array([-0.11, 0.06, 0.0008, -0.0006, 0.0])}
    return [camera_info(BACKEND, **fields) for fields in ({}, fisheye, rational, lens)]


def use_camera(message):
    lens = Lens.from_intrinsics(decode_camera_info(message), False)
    normalised = lens.normalise(PIXELS)
    assert not np.isinf(normalised).any() and np.isfinite(lens.focal) and lens.focal > 0


def depth_images():
    for encoding, dtype in (("16UC1", "<u2"), ("32FC1", "<f4")):
        message = BACKEND.make("sensor_msgs/msg/Image")
        message.header.stamp.sec, message.header.frame_id = 5, "camera"
        message.height, message.width, message.encoding = 6, 8, encoding
        data = np.full((6, 8), 2, dtype)
        message.step, message.data = data.strides[0], np.frombuffer(data.tobytes(), np.uint8)
        yield message


def use_depth(message):
    check_depth(decode_depth_image(message))


def check_depth(image):
    width, height = image.size
    depth = image.metres(np.array([0, height - 1]), np.array([0, width - 1]))
    assert not (depth <= 0).any() and not np.isinf(depth).any()


def compressed_images():
    depth = np.full((6, 8), 2.0)
    depth[2, 3:5] = np.nan
    for encoding, codec in (("16UC1", "png"), ("32FC1", "png"), ("16UC1", "rvl")):
        yield compressed_message(BACKEND, START_NS, depth, encoding, codec)


def use_compressed(message):
    check_depth(decode_compressed_depth(message).unpacked())


def file_target(name, seeds, read):
    """Target whose bytes are a file of this name."""

    def read_file(data):
        path = folder() / name
        path.write_bytes(data)
        read(path)

    return Target(seeds, read_file, (LassokinError,))


def use_skeleton(path):
    skeleton = load_skeleton(str(path), 1.75)
    assert np.isfinite(skeleton.offsets).all() and skeleton.joint_names
    of_hand = f"{skeleton.joint_names[0].partition('_')[0]}_hand21"
    Layout.load("coco17" if "head" in skeleton.joint_names else of_hand, skeleton)


def bvh_files():
    own = hierarchy(BODY) + "MOTION\nFrames: 0\nFrame Time: 0.1\n"
    mixamo = own
    for joint, name in sorted(tables()["mixamo"].items(), key=lambda pair: -len(pair[0])):
        mixamo = mixamo.replace(f" {joint}\n", f" mixamorig:{name}\n")
    return [own.encode(), mixamo.encode()]


def urdf_files():
    foreign = "".join(
        f"<joint name='j{n}' type='fixed'><parent link='{BODY.joint_names[BODY.parents[n]]}'/>"
        f"<child link='{name}'/><origin xyz='{' '.join(map(str, BODY.offsets[n]))}' rpy='0 0 0'/></joint>"
        for n, name in enumerate(BODY.joint_names)
        if n
    )
    return [urdf(BODY, "camera").encode(), f"<robot name='r'>{foreign}</robot>".encode()]


def smpl_arrays():
    """The arrays of a small model, as .npy."""
    random = np.random.default_rng(1)
    places = BODY.rest_positions
    vertices = np.vstack([places, places[random.integers(24, size=VERTICES - 24)]])
    regressor = np.eye(24, VERTICES)
    arrays = (regressor, vertices, random.normal(size=(VERTICES, 3, 2)) * 0.01, np.array([1.0, -1.0]))
    return [SEPARATOR.join(npy(array) for array in arrays)]


def npy(array):
    stream = io.BytesIO()
    np.lib.format.write_array(stream, array)
    return stream.getvalue()


def npz_of(data):
    """The .npz of arrays as in `smpl_arrays`: with right checksums, so that a change reaches the arrays."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, array in zip(("J_regressor", "v_template", "shapedirs", "betas"), data.split(SEPARATOR)):
            archive.writestr(f"{name}.npy", array)
    return stream.getvalue()


def use_smpl_arrays(path):
    path.write_bytes(npz_of(path.read_bytes()))
    use_skeleton(path)


def use_names(path):
    """A file of names next to a BVH file with unknown names."""
    text = bvh_files()[0].decode()
    for number, joint in enumerate(sorted(BODY.joint_names, key=len, reverse=True)):
        text = text.replace(f" {joint}\n", f" other{number}\n")
    (folder() / "named.bvh").write_text(text)
    use_skeleton(folder() / "named.bvh")


def names_file_text():
    ordered = sorted(BODY.joint_names, key=len, reverse=True)
    return ["".join(f"{joint}: other{number}\n" for number, joint in enumerate(ordered)).encode()]


def package_files(package_folder):
    root = Path(__file__).resolve().parents[2] / "lassokin_ros" / "core" / "body" / package_folder
    return [file.read_bytes() for file in sorted(root.glob("*.yaml"))]


CALIBRATIONS = (
    "image_width: 640\nimage_height: 480\ncamera_name: c\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
    "  data: [600, 0, 320, 0, 600, 240, 0, 0, 1]\ndistortion_model: plumb_bob\ndistortion_coefficients:\n"
    "  rows: 1\n  cols: 5\n  data: [-0.1, 0.06, 0.001, -0.001, 0]\n",
    "%YAML:1.0\n---\ncameraMatrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
    "   data: [600., 0., 320., 0., 600., 240., 0., 0., 1.]\ndistCoeffs: !!opencv-matrix\n   rows: 4\n   cols: 1\n"
    "   dt: d\n   data: [ 0.1, 0.01, 0., 0. ]\nfisheye_model: 1\nimageSize: [ 640, 480 ]\n",
    "[cam_1]\nname = 'cam_1'\nsize = [640, 480]\nmatrix = [[600.0, 0.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]]\n"
    "distortions = [-0.1, 0.06, 0.001, -0.001]\nfisheye = false\n",
    "cam0:\n  camera_model: pinhole\n  distortion_coeffs: [0.1, 0.01, 0, 0]\n  distortion_model: radtan\n"
    "  intrinsics: [600, 600, 320, 240]\n  resolution: [640, 480]\n",
)


def use_calibration(path):
    calibration = read_calibration(path).scaled_to((1280, 960), str(path))
    use_camera(calibration.message(BACKEND, START_NS, "camera"))


def config_files():
    root = Path(__file__).resolve().parents[2] / "config"
    return [file.read_bytes() for file in sorted(root.glob("*.yaml"))]


@cache
def recording(storage):
    return write_recording(folder() / f"good_{storage}", 4, storage)


def data_file(storage):
    return next(file for file in recording(storage).iterdir() if file.suffix in (".db3", ".mcap"))


def use_recording(path):
    with BagReader(path) as bag:
        for _ in bag.messages([topic for topic in bag.topics if topic.encoding == "cdr"]):
            pass


def use_metadata(path):
    """metadata.yaml in a folder with good data."""
    place = folder() / "bag"
    if not place.exists():
        place.mkdir()
        (place / data_file("sqlite3").name).write_bytes(data_file("sqlite3").read_bytes())
    (place / "metadata.yaml").write_bytes(path.read_bytes())
    record_of(place)
    use_recording(place)


def use_log(path):
    """A write-ahead log next to a good database."""
    database = path.with_name(path.name.removesuffix("-wal"))
    if not database.exists():
        database.write_bytes(database_and_log()[0])
    use_recording(database)


@cache
def database_and_log():
    """A database and the log of a killed recorder, as bytes."""
    import shutil
    import sqlite3

    file = folder() / "killed.db3"
    shutil.copyfile(data_file("sqlite3"), file)
    connection = sqlite3.connect(file, isolation_level=None)
    connection.execute("PRAGMA journal_mode=WAL")
    connection.execute("PRAGMA wal_autocheckpoint=0")
    connection.execute("UPDATE messages SET timestamp = timestamp + 1")
    result = file.read_bytes(), file.with_name(f"{file.name}-wal").read_bytes()
    connection.close()
    return result


def mcap_files():
    """A good file, and the same with a schema of another encoding."""
    good = data_file("mcap").read_bytes()
    return [good, good.replace(b"ros2msg", b"ros1msg"), good.replace(b"\x03\0\0\0cdr", b"\x03\0\0\0cbo")]


MESSAGES = {
    **{f"message {name.split('/')[-1]}": keypoints_target(name) for name in ADAPTERS},
    "message CameraInfo": message_target("sensor_msgs/msg/CameraInfo", cameras, use_camera),
    "message Image": message_target("sensor_msgs/msg/Image", depth_images, use_depth),
    "message CompressedImage": message_target("sensor_msgs/msg/CompressedImage", compressed_images, use_compressed),
}
FILES = {
    "file bvh": file_target("body.bvh", bvh_files, use_skeleton),
    "file urdf": file_target("body.urdf", urdf_files, use_skeleton),
    "file smpl": file_target("body.npz", lambda: [npz_of(smpl_arrays()[0])], use_skeleton),
    "file smpl arrays": file_target("arrays.npz", smpl_arrays, use_smpl_arrays),
    "file skeleton": file_target(
        "body.yaml", lambda: [*package_files("skeletons"), skeleton_text(BODY).encode()], use_skeleton
    ),
    "file names": file_target("named.names.yaml", names_file_text, use_names),
    "file layout": file_target(
        "layout.yaml", lambda: package_files("layouts"), lambda path: Layout.load(str(path), WITH_HANDS)
    ),
    "file calibration": file_target("c.yaml", lambda: [text.encode() for text in CALIBRATIONS], use_calibration),
    "file parameters": file_target("p.yaml", config_files, lambda path: offline_settings([path], [])),
}
BAGS = {
    "bag sqlite3": file_target("a.db3", lambda: [data_file("sqlite3").read_bytes()], use_recording),
    "bag mcap": file_target("a.mcap", mcap_files, use_recording),
    "bag metadata": file_target(
        "m.yaml", lambda: [(recording("sqlite3") / "metadata.yaml").read_bytes()], use_metadata
    ),
    "bag log": file_target("b.db3-wal", lambda: [database_and_log()[1]], use_log),
}
TARGETS = {**MESSAGES, **FILES, **BAGS}
