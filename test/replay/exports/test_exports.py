"""`replay --export`: each format is read back by an independent library, or without our code."""

import csv
import os
import sys
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags reads and writes recordings")

from exported import motion_of  # noqa: E402
from messages import camera_info, crowd, pixels_of_motion, rosbags_backend  # noqa: E402
from recordings import START_NS, read, synthetic_pixels, write_messages, write_recording  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402

from lassokin_ros.cli.replay import main  # noqa: E402
from lassokin_ros.core.body.skeleton import Skeleton  # noqa: E402
from lassokin_ros.core.learned.vertical import vertical_of
from lassokin_ros.pipeline.outputs.urdf import joint_names  # noqa: E402
from lassokin_ros.replay.exports import markers  # noqa: E402
from lassokin_ros.replay.exports.amass import smpl_rotations, write_amass  # noqa: E402
from lassokin_ros.replay.exports.markers import Markers, markers_of  # noqa: E402
from lassokin_ros.replay.exports.sampling import Y_UP, ExportError, uniform  # noqa: E402
from lassokin_ros.skeleton_readers.load import load_skeleton  # noqa: E402

FRAMES = 45
SKELETON = Skeleton.load("anthropometric", 1.75)
C3D = (".c3d",) if find_spec("ezc3d") else ()
FORMATS = (".csv", ".npz", ".bvh", ".amass.npz", ".trc", *C3D)
FIXED_LENGTHS = ["-p", "calibrate:=false", "-p", "height:=1.75"]
EVERY_FORMAT = [word for suffix in FORMATS for word in ("--export", suffix)]


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return write_recording(tmp_path_factory.mktemp("in") / "walk", FRAMES)


@pytest.fixture(scope="module")
def tracked(recording, tmp_path_factory):
    output = tmp_path_factory.mktemp("out") / "tracked"
    assert main([str(recording), "--output", str(output), *EVERY_FORMAT, *FIXED_LENGTHS]) == 0
    return output


@pytest.fixture(scope="module")
def published(tracked):
    """Positions (f, 24, 3) m and joint_states (f, 75) in the bag."""
    poses = [message.poses for _, message in read(tracked, "/tracker/joints")]
    positions = np.array([[[p.position.x, p.position.y, p.position.z] for p in frame] for frame in poses])
    return positions, np.array([message.position for _, message in read(tracked, "/tracker/joint_states")])


def bvh_positions(path):
    """{joint: (f, 3)} and the frame time, by pybvh."""
    pybvh = pytest.importorskip("pybvh", reason="pybvh (pip install pybvh) is a test-only dependency")
    file = pybvh.Bvh.from_file(path)
    places = file.joint_positions()
    return {joint: places[:, index] for index, joint in enumerate(file.joint_names)}, file.frame_time


def test_csv_contains_the_positions_and_angles_of_the_bag(tracked, published):
    positions, states = published
    with (tracked / "motion.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == FRAMES
    stamps, _, _ = synthetic_pixels(FRAMES)
    for row, stamp, places, state in zip(rows, stamps, positions, states):
        assert row["stamp [s]"].replace(".", "") == str(stamp) and row["person"] == ""
        for joint, place in zip(SKELETON.joint_names, places):
            assert np.abs([float(row[f"{joint} position {a} [m]"]) for a in "xyz"] - place).max() < 1e-6
        for name, angle in zip(joint_names(SKELETON)[3:], state[3:]):
            joint, _, axis = name.rpartition("_")
            assert abs(float(row[f"{joint} angle {axis} [rad]"]) - angle) < 1e-6
        assert 0 < float(row["reprojection [px]"]) < 30
        assert 0 < float(row["left_wrist deviation [m]"]) < 0.6 and row["likely wrong"] in ("0", "1")
        assert 0 <= float(row["left_knee flexion [deg]"]) < 120
    assert len(rows[0]) == 2 + 2 * 72 + 1 + 24 + 1 + 2 + 13 + 24 + 24 + 24
    turns = np.array(
        [[float(row[f"{joint} rotation deviation [rad]"]) for joint in SKELETON.joint_names] for row in rows]
    )
    assert np.all((turns > 0.02) & (turns < 2.3)) and np.all(turns[:, SKELETON.index("left_hand")] > 0.8)
    way = np.linalg.norm(positions[12, 20] - positions[10, 20])
    assert float(rows[11]["left_wrist speed [m/s]"]) == pytest.approx(way * 15, rel=1e-3)
    shown = {joint: {row[f"{joint} angles observed"] for row in rows} for joint in SKELETON.joint_names}
    assert shown["left_knee"] == {"1"} == shown["right_elbow"] and shown["left_hand"] == {"0"} == shown["left_foot"]
    assert {row["left_ankle stands"] for row in rows} <= {"0", "1"} and any(
        row["left_ankle stands"] == "1" for row in rows
    )


def test_every_array_of_the_npz_is_in_the_documentation(tracked):
    page = (Path(__file__).parents[3] / "docs" / "files.md").read_text(encoding="utf-8")
    with np.load(tracked / "motion.npz", allow_pickle=False) as file:
        assert not [name for name in file if f"`{name}`" not in page]


def test_npz_contains_the_motion_of_the_bag(tracked, published):
    positions, states = published
    with np.load(tracked / "motion.npz", allow_pickle=False) as file:
        arrays = dict(file)
    stamps, pixels, confidence = synthetic_pixels(FRAMES)
    assert np.array_equal(arrays["stamp_ns"], stamps)
    assert np.array_equal(arrays["joint_positions"], positions)
    assert np.array_equal(arrays["joint_angles"].reshape(FRAMES, -1), states[:, 3:])
    assert tuple(arrays["joint_names"]) == SKELETON.joint_names and str(arrays["frame_id"]) == "camera_optical_frame"
    found = confidence > 0
    assert np.abs(arrays["detected_px"][found] - pixels[found]).max() < 1e-3
    # rotations, offsets and parents agree with the positions
    parents, offsets = arrays["joint_parents"], arrays["rest_offsets"][0]
    assert np.abs(forward(arrays["joint_rotations"], offsets, parents, arrays["translation"]) - positions).max() < 1e-9


def forward(rotations, offsets, parents, root):
    """(f, n, 3) positions by scipy's rotations, of local rotations (f, n, 3, 3)."""
    local = [Rotation.from_matrix(rotations[:, joint]) for joint in range(len(parents))]
    turned, places = [local[0]], [root]
    for joint in range(1, len(parents)):
        above = parents[joint]
        places.append(places[above] + turned[above].apply(np.array(offsets[joint])))
        turned.append(turned[above] * local[joint])
    return np.stack(places, axis=1)


def floor_of(folder):
    """m above the camera."""
    with np.load(folder / "motion.npz", allow_pickle=False) as file:
        return float(file["floor"])


def test_the_exported_person_stands_on_the_floor(tracked):
    feet = [f"{side}_{joint}" for side in ("left", "right") for joint in ("ankle", "foot")]
    found, _ = bvh_positions(tracked / "motion.bvh")
    lowest = np.min([found[name][:, 1] for name in feet], axis=0)
    assert -0.03 < np.median(lowest) < 0.1 and -2.0 < floor_of(tracked) < -0.5
    with np.load(tracked / "motion.npz", allow_pickle=False) as file:
        assert file["joint_observed"][:, 4].all() and file["joint_deviations"].shape == (FRAMES, 24)
        assert not file["likely_wrong"].any()
        shown = file["angles_observed"]
        certain = file["rotation_deviations"] < 0.7
        assert certain[:, SKELETON.index("left_knee")].all() and not certain[:, SKELETON.index("left_hand")].any()
        assert (certain | ~shown)[:, [SKELETON.index(name) for name in ("pelvis", "left_hip", "right_elbow")]].all()


def test_bvh_is_the_same_motion_and_skeleton_in_another_library(tracked, published):
    positions, _ = published
    found, frame_time = bvh_positions(tracked / "motion.bvh")
    assert frame_time == pytest.approx(1 / 30, abs=1e-6) and set(found) == set(SKELETON.joint_names)
    for joint, places in enumerate(positions.transpose(1, 0, 2)):
        to_y_up = places * [1, -1, -1] - [0, floor_of(tracked), 0]
        assert np.abs(found[SKELETON.joint_names[joint]] - to_y_up).max() < 1e-4  # 0.1 mm
    again = load_skeleton(str(tracked / "motion.bvh"), 1.75)
    assert again.joint_names == SKELETON.joint_names and again.axes == SKELETON.axes
    assert np.abs(again.offsets - SKELETON.offsets).max() < 1e-8
    text = (tracked / "motion.bvh").read_text(encoding="utf-8")
    orders = {" ".join(line.split()[-3:]) for line in text.splitlines() if "CHANNELS" in line}
    assert orders == {"Zrotation Yrotation Xrotation"}  # loaders of LAFAN1 and Holden's take the first for all joints


def test_amass_poses_are_the_same_motion(tracked, published):
    """Axis-angle in SMPL's tree, by scipy only: in a world with z up, x to the right of the camera, y away from it."""
    positions, _ = published
    with np.load(tracked / "motion.amass.npz", allow_pickle=False) as file:
        data = dict(file)
    assert data["poses"].shape == (FRAMES, 72) and data["trans"].shape == (FRAMES, 3) and data["betas"].shape == (16,)
    assert data["mocap_framerate"] == pytest.approx(30, abs=1e-3) and str(data["gender"]) == "neutral"
    rotations = Rotation.from_rotvec(data["poses"].reshape(-1, 3)).as_matrix().reshape(FRAMES, 24, 3, 3)
    found = forward(rotations, SKELETON.offsets, SKELETON.parents, data["trans"])
    expected = np.stack([positions[..., 0], positions[..., 2], -positions[..., 1] - floor_of(tracked)], axis=-1)
    assert np.abs(found - expected).max() < 1e-6
    assert found[:, 15, 2].min() > found[:, 7, 2].max() + 1  # the head is above the ankle


def test_amass_has_the_keys_of_both_generations(tracked):
    """As in AMASS for SMPL+H and for SMPL-X, with their shapes; the rotations are the same."""
    with np.load(tracked / "motion.amass.npz", allow_pickle=False) as file:
        data = dict(file)
    frames = {"root_orient": 3, "pose_body": 63, "pose_hand": 90, "pose_jaw": 3, "pose_eye": 6, "trans": 3, "dmpls": 8}
    assert {name: data[name].shape for name in frames} == {name: (FRAMES, width) for name, width in frames.items()}
    assert np.array_equal(np.hstack([data["root_orient"], data["pose_body"]]), data["poses"][:, :66])
    assert np.abs(data["pose_body"]).max() > 0.1 and data["betas"].shape == (data["num_betas"],)
    assert data["mocap_frame_rate"] == data["mocap_framerate"] and str(data["surface_model_type"]) == "smpl"
    assert data["mocap_time_length"] == pytest.approx(FRAMES / 30, abs=1e-3)


def test_the_world_of_a_mounted_camera_is_level(recording, tmp_path):
    """With a camera configured as looking down, a standing person is vertical in the files."""
    options = ["-p", "camera_pitch:=0.4", "-p", "camera_roll:=0.3"]
    options += ["--export", ".amass.npz", "--export", ".bvh", "--export", ".npz"]
    assert main([str(recording), "--output", str(tmp_path / "out"), *options]) == 0
    joints = read(tmp_path / "out", "/tracker/joints")
    places = np.array([[m.poses[0].position.x, m.poses[0].position.y, m.poses[0].position.z] for _, m in joints])
    up = vertical_of(0.3, 0.4)
    with np.load(tmp_path / "out" / "motion.amass.npz", allow_pickle=False) as file:
        amass = file["trans"]
    motion = (tmp_path / "out" / "motion.bvh").read_text(encoding="utf-8").splitlines()[-FRAMES:]
    bvh = np.array([[float(word) for word in line.split()[:3]] for line in motion])
    amass[:, 2] += floor_of(tmp_path / "out")
    bvh[:, 1] += floor_of(tmp_path / "out")
    for found, axis, exact in ((amass, 2, 1e-6), (bvh, 1, 1e-5)):
        assert np.abs(found[:, axis] - places @ up).max() < exact
        assert np.abs(np.linalg.norm(found, axis=1) - np.linalg.norm(places, axis=1)).max() < exact
    sight = np.array([-np.sin(0.3) * np.sin(0.4), -np.cos(0.3) * np.sin(0.4), np.cos(0.4)])  # level, straight on
    assert np.abs(amass[:, 1] - places @ sight).max() < 1e-6 and np.abs(-bvh[:, 2] - places @ sight).max() < 1e-5


def test_loaders_that_take_every_nth_frame_get_30_hz_or_more():
    """n = rate // 30 of PHC and human2humanoid must not be 0."""
    for rate, expected in ((15.0, 30.0), (25.0, 30.0), (29.97, 30.0), (30.0, 30.0), (60.0, 60.0)):
        motion = some_motion(np.arange(41) / rate)
        file = BytesIO()
        write_amass(motion, file)
        file.seek(0)
        with np.load(file) as data:
            assert data["mocap_framerate"] // 30 >= 1 and abs(data["mocap_framerate"] - expected) < 1e-6
            seconds = (len(data["trans"]) - 1) / data["mocap_framerate"]
            assert abs(seconds - 40 / rate) < 1 / 30 and data["angles_observed"].shape == (len(data["trans"]), 24)
            deviations = data["rotation_deviations"]
            assert np.all(deviations[:, 0] == 0.25) and np.isnan(deviations[:, 1:]).all()  # joints that it lacks
            at = np.arange(len(data["trans"])) / data["mocap_framerate"]
            assert np.abs(data["trans"][:, 0] - at).max() < 1e-6


def test_amass_handles_a_skeleton_with_other_joints():
    """The rotation of a joint that SMPL lacks is added to the next joint below; a missing joint does not rotate."""
    random = np.random.default_rng(0)
    joints = [
        {"name": "pelvis", "parent": None, "position": [0, 0, 0]},
        {"name": "spine1", "parent": "pelvis", "position": [0, 0.1, 0]},
        {"name": "chest", "parent": "spine1", "position": [0, 0.2, 0]},
        {"name": "neck", "parent": "chest", "position": [0, 0.3, 0]},
    ]
    skeleton = Skeleton.from_mapping({"height_unit": "metre", "joints": joints}, 1.75)
    turns = Rotation.from_rotvec(random.normal(size=(8, 3))).as_matrix().reshape(2, 4, 3, 3)
    smpl = smpl_rotations(skeleton, turns)
    assert np.allclose(smpl[:, :1], turns[:, :1]) and np.allclose(smpl[:, 3], turns[:, 1])
    assert np.allclose(smpl[:, 12], turns[:, 2] @ turns[:, 3])
    still = [joint for joint in range(24) if joint not in (0, 3, 12)]
    assert np.allclose(smpl[:, still], np.eye(3))
    with pytest.raises(ExportError, match="the root of skeleton 'skeleton' is 'a', not 'pelvis'"):
        joints = [{"name": "a", "parent": None, "position": [0, 0, 0]}]
        smpl_rotations(Skeleton.from_mapping({"height_unit": "metre", "joints": joints}, 1.75), turns[:, :1])


MARKERS = {
    "RHip": "right_hip",
    "LKnee": "left_knee",
    "RAnkle": "right_ankle",
    "LElbow": "left_elbow",
    "RWrist": "right_wrist",
}


def trc(path):
    """Names, times (f,) s and positions (f, m, 3) of a TRC file, and its header."""
    lines = path.read_text(encoding="utf-8").split("\n")
    header = dict(zip(lines[1].split("\t"), lines[2].split("\t")))
    names = lines[3].rstrip("\t").split("\t")[2::3]
    rows = np.array([[float(word) for word in line.split("\t")] for line in lines[6:] if line])
    assert lines[5] == "" and np.array_equal(rows[:, 0], np.arange(1, len(rows) + 1))
    assert lines[4].split("\t")[2:] == [f"{axis}{i + 1}" for i in range(len(names)) for axis in "XYZ"]
    return names, rows[:, 1], rows[:, 2:].reshape(len(rows), -1, 3), header


def test_trc_has_the_joints_of_the_bag_with_the_names_of_pose2sim(tracked, published):
    positions, _ = published
    names, times, points, header = trc(tracked / "motion.trc")
    assert header["Units"] == "m" and header["NumFrames"] == str(FRAMES) and header["NumMarkers"] == "26"
    assert float(header["DataRate"]) == pytest.approx(30, abs=1e-3)
    assert np.allclose(times, np.arange(FRAMES) / 30, atol=1e-5)
    assert {"Hip", "Neck", "Head", "Nose", "LBigToe", "RSmallToe", "LHeel"} < set(names) and len(set(names)) == 26
    for marker, joint in MARKERS.items():
        expected = positions[:, SKELETON.joint_names.index(joint)] * [1, -1, -1] - [0, floor_of(tracked), 0]
        assert np.abs(points[:, names.index(marker)] - expected).max() < 1e-6
    assert -0.05 < np.median(points[:, names.index("LHeel"), 1]) < 0.1 < 1.2 < points[:, names.index("Head"), 1].min()


def test_c3d_has_the_markers_of_the_trc(tracked):
    ezc3d = pytest.importorskip("ezc3d", reason="a .c3d file needs ezc3d")
    data = ezc3d.c3d(str(tracked / "motion.c3d"))
    points = data["parameters"]["POINT"]
    names, _, expected, _ = trc(tracked / "motion.trc")
    assert points["LABELS"]["value"] == names and points["UNITS"]["value"] == ["mm"]
    assert points["RATE"]["value"][0] == pytest.approx(30, abs=1e-3)
    found = data["data"]["points"][:3].transpose(2, 1, 0)
    assert np.abs(found - 1e3 * expected[..., [0, 2, 1]] * [1, -1, 1]).max() < 1e-2  # z up; C3D has 32 bits


@pytest.mark.parametrize("frames", [65535, 65536])
def test_c3d_refuses_more_frames_than_it_counts(frames, tmp_path, monkeypatch):
    ezc3d = pytest.importorskip("ezc3d", reason="a .c3d file needs ezc3d")
    places = np.random.default_rng(0).normal(size=(frames, 1, 3))
    monkeypatch.setattr(markers, "markers_of", lambda motion, world: Markers(1 / 30, ("Hip",), places))
    if frames > markers.MOST_FRAMES:
        with pytest.raises(ExportError, match="counts up to 65535 frames, the motion has 65536; expected .trc"):
            markers.write_c3d(None, BytesIO())
        return
    with (tmp_path / "long.c3d").open("wb") as file:
        markers.write_c3d(None, file)
    read = ezc3d.c3d(str(tmp_path / "long.c3d"))["data"]["points"][:3, 0].T
    assert np.allclose(read, 1e3 * places[:, 0], atol=1e-2)


def test_a_missing_ezc3d_is_named_before_any_work(recording, tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    assert main([str(recording), "--output", str(tmp_path / "out"), "--export", str(tmp_path / "a.c3d")]) == 2
    assert capsys.readouterr().err == "lassokin replay: a .c3d file needs ezc3d; install it with: pip install ezc3d\n"
    assert not list(tmp_path.iterdir())


def test_a_skeleton_without_the_points_of_the_markers_is_refused():
    with pytest.raises(ExportError, match="needs the points of halpe26: .* export .csv or .npz"):
        markers_of(some_motion(np.arange(5) / 30), Y_UP)


def some_motion(stamps_s, turn_rate=2.0, speed=1.0):
    """A joint that rotates and moves at constant speed."""
    times = np.array(stamps_s, dtype=float)
    rotations = Rotation.from_rotvec(np.outer(times * turn_rate, [0.0, 0.6, 0.8])).as_matrix()[:, None]
    joints = [{"name": "pelvis", "parent": None, "position": [0, 0, 0]}]
    skeleton = Skeleton.from_mapping({"height_unit": "metre", "joints": joints}, 1.75)
    stamps = 10**18 + np.round(times * 1e9).astype(np.int64)
    return motion_of(skeleton, stamps, rotations, np.outer(times * speed, [1.0, 0.0, 0.0]))


def test_speeds_are_those_of_the_joints():
    assert np.allclose(some_motion([0.0, 0.1, 0.3, 0.4], speed=1.5)["joint_speeds"], 1.5)
    backwards = some_motion([0.0, 0.1, 0.2, 0.0, 0.1])["joint_speeds"][:, 0]
    assert np.isnan(backwards).tolist() == [False, False, True, True, False]
    assert np.isnan(some_motion([0.0])["joint_speeds"]).all()


def test_frames_with_regular_stamps_are_not_changed():
    motion = some_motion(np.arange(50) / 30 + np.random.default_rng(0).uniform(-4e-4, 4e-4, 50))
    track = uniform(motion)
    assert np.array_equal(track.translations, motion["translation"] * [1, -1, -1]) and track.period == pytest.approx(
        1 / 30, rel=1e-3
    )
    alone = uniform(some_motion([0.0]))
    assert len(alone.translations) == 1 and alone.period == pytest.approx(1 / 30)


def test_frames_with_irregular_stamps_are_resampled():
    """A motion of constant speed is reproduced exactly, between jittery frames and in a gap of a second."""
    times = np.arange(90) / 30 + np.random.default_rng(0).uniform(-8e-3, 8e-3, 90)
    times = times[(times < 1) | (times > 2)] - times[0]
    motion = some_motion(times)
    track = uniform(motion)
    samples = np.arange(len(track.translations)) * track.period
    expected = uniform(some_motion(samples))
    assert track.period == pytest.approx(1 / 30, rel=0.2) and samples[-1] > times[-1] - track.period
    assert np.abs(track.translations - expected.translations).max() < 1e-6
    assert np.abs(track.rotations - expected.rotations).max() < 1e-6
    track = uniform(some_motion(np.delete(np.arange(96) / 60, slice(30, 40))))  # 1/60 s is no whole number of ns
    assert len(track.translations) == 96 and abs(track.translations[-1, 0] - 95 / 60) < 1e-6


def test_stamps_without_a_constant_rate_are_refused():
    with pytest.raises(ExportError, match="the stamps jump back by 2.000 s at frame 3, .* export .csv or .npz"):
        uniform(some_motion([0.0, 1.0, 2.0, 0.0, 1.0]))
    with pytest.raises(ExportError, match="5 frames are spread over 1000000 s"):
        uniform(some_motion([0.0, 0.03, 0.06, 0.09, 1e6]))


def test_a_looped_recording_is_exported_to_tables_only(tmp_path, capsys):
    """If one of the files cannot be made, none is written."""
    write_people(tmp_path / "loop", 40, {4: 0.0}, lambda i: i if i < 20 else i - 150)
    wanted = ["--export", str(tmp_path / "a.csv"), "--export", str(tmp_path / "a.bvh")]
    assert main([str(tmp_path / "loop"), "-o", str(tmp_path / "out"), *wanted]) == 2
    assert "the stamps jump back by" in capsys.readouterr().err
    assert sorted(os.listdir(tmp_path)) == ["loop"]
    assert main([str(tmp_path / "loop"), "-o", str(tmp_path / "out"), *wanted[:2]]) == 0
    assert len((tmp_path / "a.csv").read_text().splitlines()) == 1 + int(frames_out(capsys))


def frames_out(capsys):
    (line,) = (line for line in capsys.readouterr().out.splitlines() if line.startswith("frames"))
    return line.split()[3]


BAD = {
    "walk.fbx": "--export 'walk.fbx': unknown suffix; expected one of: .csv, .npz, .bvh, .amass.npz, .trc, .c3d, .glb",
    "nowhere/walk.csv": "there is no folder 'nowhere' for 'walk.csv'",
    "folder.csv": "'folder.csv' is a folder; expected the name of a file",
}


@pytest.mark.parametrize("name", sorted(BAD))
def test_an_output_that_cannot_be_written_is_reported_at_once(recording, tmp_path, monkeypatch, capsys, name):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.csv").mkdir()
    assert main([str(recording), "--output", "out", "--export", name]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"lassokin replay: {BAD[name]}") and said.count("\n") == 1
    assert os.listdir() == ["folder.csv"]


def test_a_recording_without_a_person_gives_empty_exports(tmp_path, capsys):
    def nobody(stamps, pixels, confidence):
        confidence[:] = 0

    write_recording(tmp_path / "empty", 5, spoil=nobody)
    assert main([str(tmp_path / "empty"), "--output", str(tmp_path / "out"), *EVERY_FORMAT]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "exported        nothing: nobody was tracked"
    assert not list((tmp_path / "out").glob("motion*"))


def write_people(path, frames, places, stamp_of_frame=lambda i: i, enters=(0, 0)):
    """A recording of people with the same motion; places: px to the right, by number; stamps in frames.

    enters: first frame of each person.
    """
    backend, pixels, period = rosbags_backend(), pixels_of_motion(frames), 33_333_333
    messages = [("/camera_info", "sensor_msgs/msg/CameraInfo", START_NS - 1, camera_info(backend))]
    for i, frame in enumerate(pixels):
        present = [number for number, first in zip(places, enters) if i >= first]
        people = [(frame + [places[number], 0.0], np.full(17, 0.9)) for number in present]
        message = crowd(backend, START_NS + stamp_of_frame(i) * period, people, tuple(present))
        messages.append(("/keypoints", "sensor_msgs/msg/PointCloud2", START_NS + i * period, message))
    return write_messages(path, messages)


def test_several_people_are_in_one_table_or_in_separate_files(tmp_path, capsys):
    """Tables contain all people, with a column for the person; other formats have one file per person, who may enter
    late.
    """
    write_people(tmp_path / "in", 30, {4: -120.0, 9: 120.0}, enters=(0, 15))
    output, wanted = tmp_path / "out", ["--export", str(tmp_path / "walk.trc")]
    arguments = [str(tmp_path / "in"), "-p", "max_people:=2", *FIXED_LENGTHS, "--output"]
    assert main([*arguments, str(output), *EVERY_FORMAT, *wanted]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("files begin")]
    assert line.endswith("p9 0.500 s after the recording begins: shift .bvh and .amass.npz by it")
    with (output / "motion.csv").open(newline="", encoding="utf-8") as file:
        people = [row["person"] for row in csv.DictReader(file)]
    assert people == ["p4"] * 30 + ["p9"] * 15
    with np.load(output / "motion.npz") as file:
        assert list(file["person"]) == people and list(file["people"]) == ["p4", "p9"]
        positions = file["joint_positions"]
    for person, own, start in (("p4", positions[:30], 0.0), ("p9", positions[30:], 0.5)):
        found, _ = bvh_positions(output / f"motion_{person}.bvh")
        assert np.abs(found["head"] - (own[:, 15] * [1, -1, -1] - [0, floor_of(output), 0])).max() < 1e-4
        assert np.allclose(trc(output / f"motion_{person}.trc")[1][[0, -1]], [start, 29 / 30], atol=1e-5)
        with np.load(output / f"motion_{person}.amass.npz") as file:
            assert file["start_time"] == pytest.approx(start, abs=1e-6)
        if C3D:
            points = pytest.importorskip("ezc3d").c3d(str(output / f"motion_{person}.c3d"))["header"]["points"]
            assert (points["first_frame"], points["last_frame"]) == (round(30 * start), 29)
    assert sorted(os.listdir(tmp_path)) == ["in", "out", "walk_p4.trc", "walk_p9.trc"]
    assert (tmp_path / "walk_p9.trc").read_text().split("\n")[0].endswith("\twalk_p9.trc")
    assert main([*arguments, str(tmp_path / "b"), *wanted]) == 2
    assert f"'{tmp_path / 'walk_p4.trc'}' exists already" in capsys.readouterr().err
    (tmp_path / "wave_pose.trc").write_text("nobody's")
    assert main([*arguments, str(tmp_path / "b"), "--export", str(tmp_path / "wave.trc")]) == 0
    assert "files begin" not in capsys.readouterr().out  # the times of .trc are right


def test_a_calibrated_skeletons_last_lengths_are_exported(recording, tmp_path):
    output = tmp_path / "out"
    assert main([str(recording), "--output", str(output), "-p", "calibrate:=true", *EVERY_FORMAT[2:6]]) == 0
    with np.load(output / "motion.npz") as file:
        last, offsets = file["joint_positions"][-1], file["rest_offsets"][0]
    found, _ = bvh_positions(output / "motion.bvh")
    assert np.abs(found["head"][-1] - (last[15] * [1, -1, -1] - [0, floor_of(output), 0])).max() < 1e-4
    bones = last[1:] - last[SKELETON.parents[1:]]
    assert np.allclose(np.linalg.norm(bones, axis=1), np.linalg.norm(offsets[1:], axis=1))
