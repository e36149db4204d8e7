"""Files of keypoints: each kind gives the points that were written, and unusable files are one line."""

import csv
import json

import numpy as np
import pytest

from lassokin_ros.core.body.landmarks import Layout, skeleton_of
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.video.command import main, parser
from lassokin_ros.video.keypoint_files.source import open_input
from lassokin_ros.video.sources import SourceError

SIZE = (640, 480)
FRAMES = 4
COUNTS = {"coco17": 17, "body25": 25, "halpe26": 26, "mediapipe33": 33, "openpose67": 67}


def points(layout, person=0):
    """(f, l, 3): x, y in px and confidence; the first point of the second image is missing."""
    rng = np.random.default_rng(person)
    found = rng.uniform([10, 10, 0.3], [*SIZE, 1.0], (FRAMES, COUNTS[layout], 3))
    found[1, 0] = 0.0
    return found


def names(layout):
    return Layout.load(layout, Skeleton.load("anthropometric", 1.75)).names


def write_openpose(folder, layout="body25"):
    names = ("pose_keypoints_2d", "hand_left_keypoints_2d", "hand_right_keypoints_2d")
    for number in range(FRAMES):
        parts = [np.split(points(layout, person)[number], [25, 46]) for person in (0, 1)]
        people = [{name: part.ravel().tolist() for name, part in zip(names, own)} for own in parts]
        (folder / f"walk_{number:012d}_keypoints.json").write_text(json.dumps({"version": 1.3, "people": people}))
    return folder, layout, 2


def write_alphapose(folder, key="{}.jpg", extra=110):
    rows = []
    for number in range(FRAMES):
        whole = np.concatenate([points("halpe26")[number], np.zeros((extra, 3))])  # face and hands
        rows.append({"image_id": key.format(number), "category_id": 1, "keypoints": whole.ravel().tolist(), "score": 2})
    (folder / "alphapose-results.json").write_text(json.dumps(rows))
    return folder / "alphapose-results.json", "halpe26", 1


def write_coco(folder):
    rows = [
        {"image_id": 7 + number, "id": number, "keypoints": points("coco17")[number].ravel().tolist()}
        for number in range(FRAMES)
    ]
    images = [
        {"id": 7 + number, "file_name": f"{number:06d}.png", "width": 640, "height": 480} for number in range(FRAMES)
    ]
    (folder / "keypoints.json").write_text(json.dumps({"images": images, "annotations": rows}, indent="\t"))
    return folder / "keypoints.json", "coco17", 1


def write_table(file, header, rows):
    with file.open("w", newline="") as text:
        csv.writer(text).writerows([*header, *rows])
    return file


def write_deeplabcut(folder):
    spelled = [f"{name.split('_')[-1]}_{name[0].upper()}" if "_" in name else name for name in names("coco17")]
    header = [
        ["scorer", *["net"] * 51],
        ["bodyparts", *np.repeat(spelled, 3)],
        ["coords", *["x", "y", "likelihood"] * 17],
    ]
    rows = [[number, *points("coco17")[number].ravel()] for number in range(FRAMES)]
    return write_table(folder / "walk.csv", header, rows), "coco17", 1


def write_mediapipe(folder, numbered=False):
    """Shares of the image's sides, with a depth, and times in ms."""
    header = ["timestamp_ms"]
    for number, name in enumerate(names("mediapipe33")):
        header += [f"{v}{number + 1}" if numbered else f"{name.upper()}_{v}" for v in ("x", "y", "z", "v")]
    rows = []
    for number in range(FRAMES):
        x, y, confidence = (points("mediapipe33")[number] / [*SIZE, 1]).T
        rows.append([40 * number, *np.stack([x, y, 0 * x - 0.2, confidence], axis=1).ravel()])
    return write_table(folder / "landmarks.csv", [header], rows), "mediapipe33", 1


def write_arrays(folder):
    arrays = {"kp2d": points("coco17"), "keypoint_names": names("coco17"), "stamp_s": 5 + 0.04 * np.arange(FRAMES)}
    np.savez(folder / "walk.npz", image_size=SIZE, **arrays)
    return folder / "walk.npz", "coco17", 1


KINDS = {
    "OpenPose": write_openpose,
    "OpenPose, hands": lambda folder: write_openpose(folder, "openpose67"),
    "AlphaPose": write_alphapose,
    "COCO": write_coco,
    "DeepLabCut": write_deeplabcut,
    "MediaPipe": write_mediapipe,
    "MediaPipe, numbered": lambda folder: write_mediapipe(folder, numbered=True),
    "arrays": write_arrays,
}


def opened(path, *more):
    options = parser().parse_args([str(path), *more])
    return open_input(options.sources[0], options)


@pytest.mark.parametrize("kind", KINDS)
def test_the_points_are_those_of_the_file(kind, tmp_path):
    path, layout, people = KINDS[kind](tmp_path)
    source, detector = opened(path, "--fps", "25", "--image-size", "640x480")
    images = list(source.images)
    assert np.allclose([image.seconds for image in images], np.arange(FRAMES) / 25) and source.count == FRAMES
    assert source.size == SIZE == images[0].rgb.shape[1::-1]
    assert detector.landmarks == layout and detector.several == (people > 1)
    for number, image in enumerate(images):
        found = detector.detect(image.rgb, image.seconds)
        assert len(found) == people
        for person, one in enumerate(found):
            expected = points(layout, person)[number]
            assert np.allclose(one.pixels, expected[:, :2]) and np.allclose(one.confidence, expected[:, 2])


@pytest.mark.parametrize(
    "kind, said", [("MediaPipe", ""), ("arrays", ""), ("COCO", "'keypoints.json' has no times: 30 ")]
)
def test_times_and_size_are_those_of_the_file(kind, said, tmp_path):
    path = KINDS[kind](tmp_path)[0]
    source, _ = opened(path, *(["--image-size", "640x480"] if kind == "MediaPipe" else []))
    assert source.fps == pytest.approx(30 if said else 25) and source.size == SIZE
    assert source.remark.startswith(said) and bool(source.remark) == bool(said)


def test_hands_of_openpose_are_tracked_with_fingers(tmp_path):
    """A hand that one image lacks is missing there; broken lists of hands are as if there were none."""
    write_openpose(tmp_path, "openpose67")
    file = tmp_path / "walk_000000000001_keypoints.json"
    data = json.loads(file.read_text())
    data["people"][0] |= {"hand_left_keypoints_2d": [], "hand_right_keypoints_2d": ["x"]}
    file.write_text(json.dumps(data))
    source, detector = opened(tmp_path, "--fps", "10", "--image-size", "640x480")
    found = [detector.detect(image.rgb, image.seconds)[0] for image in source.images]
    assert [int((one.confidence[25:] > 0).sum()) for one in found] == [42, 0, 42, 42]
    assert skeleton_of(detector.landmarks) == "body_hands"
    _, detector = opened(tmp_path, "--fps", "10", "--image-size", "640x480", "-p", "landmarks:=body25b")
    assert (detector.landmarks, len(detector.detect(None, 0.0)[0].pixels)) == ("body25", 25)


def test_images_without_a_person_are_kept(tmp_path):
    write_openpose(tmp_path)
    (tmp_path / "walk_000000000002_keypoints.json").unlink()
    source, detector = opened(tmp_path, "--fps", "10", "--image-size", "640x480")
    counts = [len(detector.detect(image.rgb, image.seconds)) for image in source.images]
    assert counts == [2, 2, 0, 2]


@pytest.mark.parametrize(
    "name, text, said",
    [
        ("a.json", "{", "is no JSON"),
        ("a.json", "[]", "holds no people with image_id and keypoints"),
        ("a.json", '[{"image_id": 1, "keypoints": [1, 2]}]', "without a list keypoints of x, y and confidence"),
        ("a.json", json.dumps([{"image_id": 1, "keypoints": [1.0] * 30}]), "has 10 points per person; expected 17 "),
        ("a.csv", "time,speed\n1,2\n", "has the columns time, speed; expected a table of DeepLabCut"),
        ("a.csv", "paw_x,paw_y\n1,2\n", "has the points paw, and no left_shoulder"),
        ("a.npz", "nothing", "is no .npz file"),
        ("a.h5", "", "holds objects of Python; expected keypoints as .json, .csv, .npz"),
    ],
)
def test_a_file_without_keypoints_is_one_line(name, text, said, tmp_path, capsys):
    (tmp_path / name).write_text(text)
    assert main([str(tmp_path / name), "--height", "1.7"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


def test_the_size_of_the_images_must_be_known(tmp_path):
    path, _, _ = write_alphapose(tmp_path)
    with pytest.raises(SourceError, match="does not say how large the images are; set --image-size"):
        opened(path)
    with pytest.raises(SourceError, match="--image-size 'large'; expected width and height"):
        opened(path, "--image-size", "large")
