"""`lassokin track left right --cameras FILE`: synchronised image folders, and a detector that knows the motion."""

import json
import os
import re
import signal
from itertools import count
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from camera_rig import eye, pixels, truth_at
from messages import FOCAL, HEIGHT, WIDTH
from scipy.spatial.transform import Rotation

from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import CameraError
from lassokin_ros.detector.backend import Detected
from lassokin_ros.pipeline.camera.calibration_file import Calibration, camera_names, read_cameras
from lassokin_ros.pipeline.session import Session
from lassokin_ros.video import track as track_module
from lassokin_ros.video.cameras import calibration_toml, found_poses, open_cameras
from lassokin_ros.video.command import main, parser
from lassokin_ros.video.output_video import HEIGHT_OF_SEVERAL
from lassokin_ros.video.people import largest_in
from lassokin_ros.video.rerun_scene import LONGEST_SIDE
from lassokin_ros.video.sources import open_source

cv2 = pytest.importorskip("cv2")

FRAMES, SHORT = 180, 60
"""Number of images with which places of cameras are found, and where they are known."""
EYES = [eye("left", 0), eye("right", 90)]
TRUTH = truth_at(np.arange(FRAMES) / 30)
ROBOT = """
/**:
  ros__parameters: {keypoints_type: zed_msgs/msg/ObjectsStamped, depth: depth, cameras: [front], rectified: true}
"""
"""A parameter file with topics that videos do not have."""


class Knowing:
    """A detector of one camera's images, in order."""

    landmarks = "coco17"
    several = False

    def __init__(self, camera):
        self._camera, self._frames, self._random = camera, count(), np.random.default_rng(1)
        self.closed = False

    def detect(self, image, seconds):
        landmarks = TRUTH.landmarks[next(self._frames)]
        return [Detected(pixels(self._camera, seconds, landmarks, self._random), np.full(17, 0.9))]

    def close(self):
        self.closed = True


@pytest.fixture
def rig(tmp_path, monkeypatch):
    """Image folders `left` and `right`, a calibration file, and detectors, in the order of the folders."""
    black = cv2.imencode(".png", np.zeros((HEIGHT, WIDTH, 3), np.uint8))[1].tobytes()
    for camera in EYES:
        (tmp_path / camera.name).mkdir()
        for number in range(FRAMES):
            (tmp_path / camera.name / f"{number:03}.png").write_bytes(black)
    write_calibration(tmp_path / "calib.toml", [camera.name for camera in EYES])
    made = []

    def make(name):
        made.append(Knowing(EYES[len(made)]))
        return made[-1]

    monkeypatch.setattr(track_module, "make_detector", make)
    monkeypatch.chdir(tmp_path)
    return made


@pytest.fixture
def short(rig, tmp_path):
    """`rig` with fewer images."""
    for camera in EYES:
        for file in sorted((tmp_path / camera.name).iterdir())[SHORT:]:
            file.unlink()
    return rig


def write_calibration(path, names, unit=1):
    lines = []
    for name, camera in zip(names, EYES):
        pose = camera.pose_at(0)
        lines += [f"[{name}]", f"size = [{WIDTH}.0, {HEIGHT}.0]",
                  f"matrix = [[{FOCAL}, 0.0, {WIDTH / 2}], [0.0, {FOCAL}, {HEIGHT / 2}], [0.0, 0.0, 1.0]]",
                  "distortions = [0.0, 0.0, 0.0, 0.0]",
                  f"rotation = {Rotation.from_matrix(pose.rotation).as_rotvec().tolist()}",
                  f"translation = {(unit * pose.translation).tolist()}"]  # fmt: skip
    path.write_text("\n".join(lines) + "\n")


def test_two_videos_give_one_motion_in_the_frame_of_the_calibration(short, capsys, tmp_path, monkeypatch):
    """They are tracked backward, too; page and video show the images of both with the skeleton."""
    given, use = [], Session.use_backward
    monkeypatch.setattr(Session, "use_backward", lambda *both: (given.append(both[1]), use(*both)))
    files = ["--export", "walk.npz", "--report", "walk.html", "--video", "out.mp4"]
    (tmp_path / "robot.yaml").write_text(ROBOT, encoding="utf-8")
    robot = ["--params-file", "robot.yaml", "-p", "fixed_frame:=world"]
    assert main(["left", "right", "--cameras", "calib.toml", "--height", "1.75", *robot, *files]) == 0
    said, (frames,) = capsys.readouterr().out, given
    assert list(frames) == [None] and len(frames[None]) == SHORT
    assert "left (left), right (right)" in said and f"{2 * SHORT} in, " in said
    assert len(short) == 2 and all(detector.closed for detector in short)
    with np.load("walk.npz") as motion:
        places, stamps = motion["joint_positions"], motion["stamp_ns"]
        assert str(motion["frame_id"]) == "world"
    frames = np.round((stamps - stamps[0]) * 30e-9).astype(int) + SHORT - len(stamps)
    assert len(stamps) > SHORT - 4 and f"{2 * SHORT} in, {len(stamps)} instants tracked" in said
    assert np.median(np.linalg.norm(places - TRUTH.positions[frames], axis=-1)) < 0.02
    page = Path("walk.html").read_text(encoding="utf-8")
    images = json.loads(re.search(r'<script type="application/json" id="images">(.*?)</script>', page).group(1))
    assert min(len(images["time"]), *(len(other["time"]) for other in images["others"])) > SHORT - 4
    shown = [image.rgb for image in open_source("out.mp4").images]
    assert len(shown) == SHORT
    height = min(HEIGHT_OF_SEVERAL, HEIGHT)
    width = round(WIDTH * height / HEIGHT)
    assert abs(shown[0].shape[1] - (2 * width + height)) <= 2
    for number, camera in enumerate(EYES):
        points = pixels(camera, 0, TRUTH.landmarks[30], np.random.default_rng(0), 0.0) * height / HEIGHT
        half = shown[30][:height, number * width : (number + 1) * width]
        drawn = np.argwhere(half.max(axis=2) > 80)[:, ::-1]  # the images are black
        apart = np.linalg.norm(points[:, None] - drawn[None], axis=-1).min(axis=1)
        assert np.median(apart) < 3 and 300 < len(drawn) < 0.1 * half.shape[0] * half.shape[1]


def test_without_a_calibration_the_places_are_found_and_written(rig, capsys, tmp_path):
    """And read again, whatever the videos are called."""
    names = "vidéo accent", "./2.b"
    for camera, name in zip(EYES, names):
        Path(camera.name).rename(name)
    fov = np.degrees(2 * np.arctan(WIDTH / 2 / FOCAL))
    command = [*names, "--fov", f"{fov}", "--height", "1.75", "--export", "walk.npz"]
    assert main([*command, "--save-cameras", "found.toml"]) == 0
    assert "from the first camera, turned by" in capsys.readouterr().out
    written = camera_names(tmp_path / "found.toml")
    (_, found), truth = read_cameras(tmp_path / "found.toml", written)[written[1]], EYES[1].pose_at(0)
    first = EYES[0].pose_at(0)
    rotation = truth.rotation @ first.rotation.T
    assert np.degrees(Rotation.from_matrix(found.rotation @ rotation.T).magnitude()) < 3.0
    assert np.linalg.norm(found.centre - first.into_camera(truth.centre)) < 0.3
    with np.load("walk.npz") as motion:
        places, frames = motion["joint_positions"], np.round(motion["stamp_ns"] * 30e-9).astype(int)
    frames = frames - frames[-1] + FRAMES - 1
    apart = places - first.into_camera(TRUTH.positions[frames])
    assert np.median(np.linalg.norm(apart - apart[:, :1], axis=-1)) < 0.04
    again = open_cameras(parser().parse_args([*names, "--cameras", "found.toml"]))
    assert [camera.name for camera in again] == written and np.allclose(again[1].pose.centre, found.centre)


@pytest.mark.parametrize(
    "model, count", [("plumb_bob", 4), ("plumb_bob", 5), ("equidistant", 4), ("rational_polynomial", 8)]
)
def test_a_written_lens_is_read_again_as_it_was(tmp_path, model, count):
    K, pose = np.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1.0]]), EYES[1].pose_at(0)
    lens = Calibration(K, 0.01 * np.arange(1, count + 1), model, (WIDTH, HEIGHT))
    name = 'é "[a] b'  # no key of TOML without quotes
    (tmp_path / "lens.toml").write_text(calibration_toml([(name, lens)], {name: pose}), encoding="utf-8")
    read, where = read_cameras(tmp_path / "lens.toml", [name])[name]
    assert (read.model, read.size) == (model, lens.size) and np.allclose(read.K, K) and np.allclose(read.D, lens.D)
    assert np.allclose(where.rotation, pose.rotation) and np.allclose(where.centre, pose.centre)


def test_a_place_that_was_not_found_is_said():
    places, roster = SimpleNamespace(newest={"left": EYES[0].pose_at(0)}), SimpleNamespace(extrinsics=None)
    session = SimpleNamespace(cameras=["left", "right"], placement=SimpleNamespace(places=places), roster=roster)
    with pytest.raises(CameraError, match="the place of camera 'right' was not found; expected a person who moves"):
        found_poses(session)


def test_of_several_people_the_largest_in_each_video_is_tracked_all_the_time(short, capsys, monkeypatch):
    """The detector names the surest one first, which is now the one and now the other."""
    detect = Knowing.detect

    def both(self, image, seconds):
        (near,) = detect(self, image, seconds)
        far = Detected(0.5 * near.pixels + [20.0, 20.0], near.confidence)
        return [near, far] if round(seconds * 30) % 20 < 10 else [far, near]

    monkeypatch.setattr(Knowing, "detect", both)
    monkeypatch.setattr(Knowing, "several", True)
    command = ["left", "right", "--cameras", "calib.toml", "--height", "1.75", "--causal"]
    assert main([*command, "--export", "walk.npz"]) == 0
    assert "2 people in the images of right, the first, largest one is tracked: 0.0 to" in capsys.readouterr().out
    with np.load("walk.npz") as motion:
        frames, pelvis = np.round(motion["stamp_ns"] * 30e-9).astype(int), motion["joint_positions"][:, 0]
    assert len(frames) > SHORT - 4 and np.linalg.norm(np.diff(pelvis, axis=0), axis=1).max() < 0.06


def test_all_people_in_several_videos_have_their_motion(short, monkeypatch):
    """Two people side by side, whom the detectors name in changing order; tracked backward, too."""

    def both(self, image, seconds):
        landmarks = TRUTH.landmarks[next(self._frames)]
        places = [pixels(self._camera, seconds, landmarks + [x, 0.0, 0.0], self._random) for x in (-0.6, 0.6)]
        people = [Detected(place, np.full(17, 0.9)) for place in places]
        return people if round(seconds * 30) % 20 < 10 else people[::-1]

    monkeypatch.setattr(Knowing, "detect", both)
    monkeypatch.setattr(Knowing, "several", True)
    command = ["left", "right", "--cameras", "calib.toml", "--height", "1.75", "--person", "all"]
    assert main([*command, "--export", "walk.npz"]) == 0
    with np.load("walk.npz") as motion:
        for person in ("p1", "p2"):
            mine = motion["person"] == person
            frames = np.round(motion["stamp_ns"][mine] * 30e-9).astype(int)
            middle = EYES[0].pose_at(0).into_camera(TRUTH.positions[frames, 0])
            away = np.linalg.norm(motion["joint_positions"][mine, 0] - middle, axis=1)
            assert len(frames) > SHORT - 6 and np.abs(away - 0.6).max() < 0.1


def test_files_of_keypoints_of_several_cameras_are_put_on_one_clock(tmp_path, monkeypatch, capsys):
    """The second one begins half a second later, and the places are in mm, as those of FreeMoCap are."""
    monkeypatch.chdir(tmp_path)
    write_calibration(tmp_path / "calib.toml", ["left", "right"], unit=1000)
    for camera, first in zip(EYES, (0, 15)):
        random = np.random.default_rng(0)
        points = [pixels(camera, 0.0, marks, random) for marks in TRUTH.landmarks[first:105]]
        names = Layout.load("coco17", Skeleton.load("anthropometric", 1.75)).names
        np.savez(f"{camera.name}.npz", kp2d=np.array(points), keypoint_names=np.array(names), fps=30.0)
    command = ["left.npz", "right.npz", "--cameras", "calib.toml", "--height", "1.75", "--causal"]
    assert main([*command, "--export", "walk.npz"]) == 0
    said, noted = capsys.readouterr()
    (late,) = re.findall(r"'right' begins (\d\.\d+) s \(\+- \d+ ms\) after the first video", said)
    assert abs(float(late) - 0.5) < 0.02 and "The places of the cameras are in mm" in noted
    with np.load("walk.npz") as motion:
        frames = np.round(motion["stamp_ns"] * 30e-9).astype(int)
        places = motion["joint_positions"]
    frames = frames - frames[0]
    middle = EYES[0].pose_at(0).into_camera(TRUTH.positions[frames, 0])
    assert np.median(np.linalg.norm(places[:, 0] - middle, axis=1)[30:]) < 0.05
    with pytest.raises(SystemExit):
        main(["--offsets"])
    assert main([*command, "--offsets", "0,a"]) == 2
    assert "expected 2 numbers, s by which each video begins after" in capsys.readouterr().err


@pytest.mark.parametrize("bystander", [False, True])
def test_a_person_who_was_out_of_view_for_a_while_is_tracked_again(bystander):
    """Longer than a person is remembered. Somebody else is small, and there all the time."""
    random, found = np.random.default_rng(0), []
    for index in range(120):
        near = Detected(pixels(EYES[0], 0.0, TRUTH.landmarks[index], random), np.full(17, 0.9))
        far = Detected(0.3 * near.pixels + [10.0, 10.0], near.confidence)
        found.append((index / 10, [near] * (not 30 <= index < 80) + [far] * bystander))
    kept, words = largest_in(found, "left", WIDTH)
    people = "1, 3" if bystander else "1, 2"
    assert f"{people} are never in view together and are tracked as one person" in words
    assert [(at, seen[:1]) for at, seen in found if len(seen) > bystander] == [(at, seen) for at, seen in kept if seen]


@pytest.mark.parametrize("at, placed, kept", [(SHORT + 30, True, 30), (30, True, 0), (SHORT + 30, False, 0)])
def test_after_an_interrupt_the_part_that_all_cameras_show_is_kept(short, capsys, monkeypatch, at, placed, kept):
    """In the second of two cameras that are known; or before any, or too early to find where the cameras are."""
    detect, images = Knowing.detect, count(1)

    def interrupted(self, image, seconds):
        if next(images) == at:
            os.kill(os.getpid(), signal.SIGINT)
        return detect(self, image, seconds)

    monkeypatch.setattr(Knowing, "detect", interrupted)
    lenses = ["--cameras", "calib.toml"] if placed else ["--fov", "60"]
    assert main(["left", "right", *lenses, "--height", "1.75", "--export", "walk.npz"]) == 130
    said = capsys.readouterr()
    assert ("interrupted; nothing was written" in said.err) == (kept == 0) and Path("walk.npz").exists() == (kept > 0)
    if kept:
        assert f"{2 * kept} in, " in said.out
        with np.load("walk.npz") as motion:
            assert np.isfinite(motion["detected_px_right"])[5:].any(axis=(1, 2)).all()


def test_what_is_assumed_of_several_videos_is_on_the_page(short, monkeypatch):
    """Not with --cameras, which has the lenses and shows the size."""
    made, own = [], track_module.TrackOutputs
    monkeypatch.setattr(track_module, "TrackOutputs", lambda *args: made.append(own(*args)) or 1 / 0)
    monkeypatch.setattr(track_module, "make_detector", lambda name: Knowing(EYES[0]))
    for lenses in ([], ["--cameras", "calib.toml"]):
        with pytest.raises(ZeroDivisionError):
            main(["left", "right", *lenses])
    (height, lens), nothing = (outputs.remarks for outputs in made)
    assert not nothing and "is taken to be 1.75 m tall" in height and "a field of view of 60 degrees is assumed" in lens


def test_the_view_shows_the_skeleton_in_the_image_of_each_camera_and_where_the_cameras_are(short, tmp_path):
    pytest.importorskip("rerun", reason="--view needs rerun-sdk")
    command = ["left", "right", "--cameras", "calib.toml", "--height", "1.75", "--causal", "--view", "walk.rrd"]
    assert main([*command, "-p", "fixed_frame:=world"]) == 0
    reader = pytest.importorskip("rerun.chunk", reason="this rerun-sdk cannot read recordings").RrdReader
    counts, columns = {}, {}
    for chunk in reader(tmp_path / "walk.rrd").stream().to_chunks():
        path = chunk.entity_path
        counts[path] = counts.get(path, 0) + (0 if chunk.is_static else chunk.num_rows)
        batch = chunk.to_record_batch()
        shown = [name for name in batch.schema.names if name.startswith(("Transform3D", "LineStrips2D:strips"))]
        columns.setdefault(path, {}).update({name: batch.column(name).to_pylist() for name in shown})
    assert counts["/body/skeleton"] > SHORT - 4
    for camera in EYES:
        path = f"/camera/{camera.name}"
        assert counts[f"{path}/image"] == SHORT
        assert min(counts[f"{path}/image/{part}"] for part in ("keypoints", "skeleton")) > SHORT - 4
        pose = camera.pose_at(0)
        centre, axes = (columns[path][f"Transform3D:{part}"][-1][0] for part in ("translation", "mat3x3"))
        assert np.allclose(centre, pose.centre, atol=1e-3)
        assert np.allclose(np.reshape(axes, (3, 3)), pose.rotation, atol=1e-3)  # Rerun's matrices are column-major
        outline = np.array(columns[f"{path}/image/skeleton"]["LineStrips2D:strips"][-1])
        joints = pixels(camera, 0, TRUTH.positions[SHORT - 1], np.random.default_rng(0), 0.0)
        scale = min(1.0, LONGEST_SIDE / max(WIDTH, HEIGHT))
        assert np.median(np.linalg.norm(outline[:, None, 1] - scale * joints, axis=-1).min(axis=1)) < 6


@pytest.mark.parametrize(
    "options, words",
    [
        (["--fov", "60", "--height", "0"], "nothing shows the size; give --height"),
        (["--cameras", "calib.toml", "--person", "2"], "--person 2 with several videos; expected largest or all"),
        (["--cameras", "calib.toml", "-p", "max_people:=2"], "finds one person; expected YOLO-pose or RTMO"),
        (["--cameras", "calib.toml", "-p", "cameras:=[left]"], "cameras is left; expected no setting: the videos name"),
        (["--cameras", "calib.toml", "--fov", "60"], "expected neither --camera-info nor --fov"),
        (["--cameras", "others.toml"], "has no camera 'left'; its cameras are: right, lft"),
        (["--cameras", "one.toml"], "expected one for each of 2 videos"),
        (["--cameras", "same.toml"], "a-1, a_1 are not different"),
        (["--cameras", "nothing.toml"], "nothing.toml"),
    ],
)
def test_unusable_input_is_one_line(short, capsys, tmp_path, options, words):
    write_calibration(tmp_path / "others.toml", ["right", "lft"])
    write_calibration(tmp_path / "one.toml", ["a"])
    write_calibration(tmp_path / "same.toml", ["a-1", "a_1"])
    assert main(["left", "right", *options]) == 2
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1 and words in said[0]
