"""Cuts and turning cameras that `lassokin track` finds in the background, in videos made from the shared ones.

    python benchmarks/videos/footage.py [--draws 40] [--seconds 2] [--videos FILE ...]

Each draw takes a part of a shared video (`video/`) and a window of it, perhaps mirrored, with another brightness, at 12
to 60 Hz. Cases: `still`; `flicker`, the brightness changes from image to image, with noise; `pan`, the window turns at
5 to 60 degrees/s, to one side or to and fro; `shake`, as in a hand; `zoom`, by 1.1 to 1.5; `cut`, to a video of
the other camera; `reframed`, to another window of the same view; `punch-in`, the next image is 1.2 to 2 times larger;
`dissolve`, to another video in 0.2 to 1 s. The boxes of people are those of the shared keypoints, of one person in each
video. `--videos`: what is found in other videos, without boxes.

Of the draws of a case, in %: `cuts`, all true cuts and no others are found (within 0.1 s); `false`, a cut is found that
there is not; `moves`, the camera is said to turn; `unknown`, it cannot be told; `degrees`, median error of the rotation
of the last image of the first shot.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.common.report import Record, data_folder, exit_code, table, write_json  # isort: skip  (before numpy)
import numpy as np

from benchmarks.common import option_types
from benchmarks.video import PAIRS
from lassokin_ros.core.body.rotations import exponential, logarithm
from lassokin_ros.detector.backend import Detected
from lassokin_ros.pipeline.camera.calibration_file import Calibration
from lassokin_ros.video.camera import from_fov
from lassokin_ros.video.shots import Footage
from lassokin_ros.video.sources import Image, open_source

CASES = ("still", "flicker", "pan", "shake", "zoom", "cut", "reframed", "punch-in", "dissolve")
COLUMNS = {"case": "<", "draws": "d", "cuts_percent": ".0f", "false_percent": ".0f", "moves_percent": ".0f",
           "unknown_percent": ".0f", "degrees": ".2f"}  # fmt: skip
SIDE, FOV = 640, 60.0
"""px: longer side of the images that are made; degrees: their field of view, as it is assumed without a calibration."""
SAME_CUT_S = 0.1


@dataclass(frozen=True, eq=False)
class Video:
    """A shared video at half its size: images, and the person's keypoints (f, l, 3) in px of them. view: its camera."""

    images: list[np.ndarray]
    keypoints: np.ndarray
    view: str


@dataclass(frozen=True, eq=False)
class Made:
    """A video that is made. cuts: s. rotation: true one of the last image of the first shot. people: in each image."""

    images: list[Image]
    people: list[list[Detected]]
    cuts: list[float]
    rotation: np.ndarray


def shared_videos() -> list[Video]:
    """Return the shared videos. Raises SystemExit without them."""
    import cv2

    videos = []
    for name, (keypoints, camera) in PAIRS.items():
        path, detections = (data_folder() / part for part in (f"video/{name}.mp4", "detections"))
        if not path.is_file():
            raise SystemExit(f"no file {path}; expected the shared data (LASSOKIN_DATA)")
        images = [cv2.resize(one.rgb, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
                  for one in open_source(str(path)).images]  # fmt: skip
        with np.load(detections / f"{keypoints}_mediapipe_full.npz") as data:
            points = data["kp2d"][camera].astype(float)
            points[..., :2] *= images[0].shape[1] / data["image_size"][camera][0]
        count = min(len(images), len(points))
        videos.append(Video(images[:count], points[:count], name.rsplit("_", 1)[1]))
    return videos


class Window:
    """A camera that sees a part of a video, and that may turn, zoom, and change its brightness."""

    def __init__(self, video: Video, random: np.random.Generator) -> None:
        height, width = video.images[0].shape[:2]
        self._video, share = video, random.uniform(0.6, 0.9)
        size = share * np.array([width, height])
        self.size = tuple(np.round(size * SIDE / size.max()).astype(int).tolist())
        corner = random.uniform(0.03, 0.97 - share, 2) * [width, height]
        scale = self.size[0] / size[0]
        mirror = np.diag([random.choice([-1.0, 1.0]), 1.0, 1.0])
        self.lens = from_fov(FOV, self.size)
        to_window = np.array([[scale, 0, -scale * corner[0]], [0, scale, -scale * corner[1]], [0, 0, 1.0]])
        self._rays = mirror @ np.linalg.inv(self.lens.K) @ to_window
        self._gain = random.uniform(0.6, 1.2)

    def image(self, number: int, turn: np.ndarray, zoom: float = 1.0, gain: float = 1.0) -> tuple[np.ndarray, Detected]:
        """Return an image (RGB) and the keypoints in it. turn: (3, 3) of the rays; gain: of the brightness."""
        import cv2

        number = min(number, len(self._video.images) - 1)
        H = self.lens.K @ np.diag([zoom, zoom, 1.0]) @ turn @ self._rays
        source = self._video.images[number]
        shown = cv2.warpPerspective(source, H, self.size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
        points = self._video.keypoints[number]
        homogeneous = np.column_stack([points[:, :2], np.ones(len(points))]) @ H.T
        pixels = homogeneous[:, :2] / homogeneous[:, 2:]
        bright = np.clip(shown * (self._gain * gain), 0, 255).astype(np.uint8)
        return bright, Detected(pixels, points[:, 2])


def made(case: str, videos: Sequence[Video], seconds: float, random: np.random.Generator) -> tuple[Made, Calibration]:
    """Return a video of a case, and its lens."""
    rate = float(random.choice([12.0, 25.0, 30.0, 60.0]))
    count = max(int(seconds * rate), 20)
    number = int(random.integers(len(videos)))
    video = videos[number]
    first = Window(video, random)
    begin, step = int(random.integers(0, 20)), min(60 / rate, (len(video.images) - 21) / count)
    at = [begin + int(step * k) for k in range(count)]
    turns, zooms, gains = np.zeros((count, 3)), np.ones(count), np.ones(count)
    times, cut = np.arange(count) / rate, int(random.integers(count // 4, 3 * count // 4))
    if case == "pan":
        axis = random.normal(size=3) * [0.4, 1.0, 0.05]
        speed, way = np.radians(random.uniform(5, 60)), times
        if random.uniform() < 0.5 or speed * times[-1] > np.radians(25):
            way = np.sin(way * random.uniform(2, 6)) / 4
        turns = speed * way[:, None] * axis / np.linalg.norm(axis)
    elif case == "shake":
        for speed, size in ((0.7, 0.6), (1.9, 0.35), (4.3, 0.15)):
            turns += np.radians(size) * np.sin(2 * np.pi * (speed * times[:, None] + random.uniform(size=3)))
    elif case == "zoom":
        zooms = np.exp(np.log(random.uniform(1.1, 1.5)) * times / times[-1])
    elif case == "flicker":
        gains = random.uniform(0.8, 1.2, count)
    shown = [first.image(i, exponential(turn[None])[0], zoom, gain)
             for i, turn, zoom, gain in zip(at, turns, zooms, gains)]  # fmt: skip
    noise = 4.0 if case == "flicker" else 0.0
    images = [np.clip(image + random.normal(0, noise, image.shape), 0, 255).astype(np.uint8) if noise else image
              for image, _ in shown]  # fmt: skip
    people, cuts = [[one] for _, one in shown], []
    if case in ("cut", "reframed", "dissolve", "punch-in"):
        same = [k for k, one in enumerate(videos) if (one.view == video.view) == (case == "reframed")]
        second = first if case == "punch-in" else Window(videos[int(random.choice(same))], random)
        zoom = random.uniform(1.2, 2.0) if case == "punch-in" else 1.0
        fading = max(int(random.uniform(0.2, 1.0) * rate), 3) if case == "dissolve" else 1
        for k in range(cut, count):
            image, person = second.image(at[k], np.eye(3), zoom)
            share = min((k - cut + 1) / fading, 1.0)
            images[k] = _mixed(images[k], image, share)
            people[k] = [person] if share >= 0.5 else people[k]
        cuts = [float(times[cut])] if case != "dissolve" else []
    last = cut - 1 if cuts else count - 1
    rotation = exponential(turns[last][None])[0] @ exponential(turns[0][None])[0].T
    made_images = [Image(float(second), image) for second, image in zip(times, images)]
    return Made(made_images, people, cuts, rotation), first.lens


def _mixed(one: np.ndarray, other: np.ndarray, share: float) -> np.ndarray:
    import cv2

    other = cv2.resize(other, one.shape[1::-1])
    return np.asarray(other if share >= 1 else cv2.addWeighted(one, 1 - share, other, share, 0))


def one_draw(case: str, videos: Sequence[Video], seconds: float, random: np.random.Generator) -> Record:
    """Return what is found in one made video."""
    video, lens = made(case, videos, seconds, random)
    found = followed(video.images, video.people, lens)
    near = [min((abs(cut - at) for at in found.cuts), default=9.0) < SAME_CUT_S for cut in video.cuts]
    false = [at for at in found.cuts if min((abs(cut - at) for cut in video.cuts), default=9.0) >= SAME_CUT_S]
    apart = found.shots[0].rotations[-1] @ video.rotation.T
    return {"case": case, "cuts": all(near) and not false, "false": bool(false), "moves": found.moves,
            "unknown": not all(shot.is_known for shot in found.shots),
            "degrees": float(np.degrees(np.linalg.norm(logarithm(apart[None]))))}  # fmt: skip


def followed(images: Sequence[Image], people: Sequence[Sequence[Detected]], lens: Calibration) -> Footage:
    """Return the footage after all images."""
    size = images[0].rgb.shape[1], images[0].rgb.shape[0]
    found = Footage(lens, size, size)
    for image, persons in zip(images, people):
        found.add(image, persons)
    found.finish()
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    options = parser().parse_args(arguments)
    if options.videos:
        for file in options.videos:
            source = open_source(str(file))
            images = list(source.images)
            found = followed(images, [[]] * len(images), from_fov(FOV, source.size, source.content))
            print(file.name, *(found.remarks() + found.unknown() or ["stands"]), sep="\n    ")
        return 0
    videos, records = shared_videos(), list[Record]()
    for case in options.case:
        for number in range(options.draws):
            random = np.random.default_rng([options.seed, CASES.index(case), number])
            records.append(one_draw(case, videos, options.seconds, random))
    rows = []
    for case in options.case:
        own = [record for record in records if record["case"] == case]
        row: Record = {"case": case, "draws": len(own), "degrees": float(np.median([one["degrees"] for one in own]))}
        names = ("cuts", "false", "moves", "unknown")
        rows.append(row | {f"{name}_percent": 100 * float(np.mean([one[name] for one in own])) for name in names})
    print(table(rows, COLUMNS))
    write_json(options.json, records)
    return 0


def parser() -> argparse.ArgumentParser:
    """The command line's options."""
    result = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = result.add_argument
    add("--case", type=option_types.some_of(CASES), default=list(CASES), help=f"some of {', '.join(CASES)}")
    add("--draws", type=option_types.count, default=40, help="videos per case (40)")
    add("--seconds", type=option_types.positive, default=2.0, help="of each video (2)")
    add("--videos", type=Path, nargs="+", metavar="FILE", help="say what is found in these videos instead")
    add("--seed", type=option_types.seed, default=0)
    add("--json", type=option_types.output_file, metavar="FILE", help="write the records as a JSON list")
    return result


if __name__ == "__main__":
    sys.exit(exit_code(main))
