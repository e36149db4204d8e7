"""Before several videos are tracked: the offsets of their clocks, and whether the given places of the cameras fit.

Both are found from the keypoints of one person whom all cameras see (`core/rig/`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.errors import CameraError
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.core.rig.clocks import (
    STEP_S,
    UNKNOWN,
    Course,
    Offset,
    Track,
    course_of,
    offset_between,
    offsets_of,
    track_of,
)
from lassokin_ros.core.rig.setup import UNITS, SetUp, SetUpCheck
from lassokin_ros.detector.backend import Detected
from lassokin_ros.pipeline.camera.calibration_file import FARTHEST_APART_M, Calibration
from lassokin_ros.pipeline.camera.rig_check import OF_FILE, set_up_words
from lassokin_ros.video.people import Found, people_in

SURE = TrackerConfig().min_confidence
MOST_PEOPLE = 2
"""People of each camera, the largest, who are compared with those of the others."""
NEGLIGIBLE_S = 0.008
"""s: an offset that is smaller, or smaller than CLEARLY deviations, is none: the videos were synchronised."""
CLEARLY = 3.0
INSTANT_S, MOST_INSTANTS = 0.1, 300
"""s between the instants of the set-up's check, and their largest number."""
LARGEST_GIVEN_S = 3600.0
UNKNOWN_OFFSET = (
    "has an offset to the first video that is not determinable from the keypoints (little motion, or a short time in "
    "view of both): they are taken to begin together; set --offsets"
)


SAME_CLOCK = Course(np.zeros(1), np.zeros(1))
"""Of a video whose clock is taken to be that of the first one."""


def on_first_clock(course: Course, seconds: float | np.ndarray) -> np.ndarray:
    """Return the times on the clock of the first video for those of another one, s. course: the other's offset."""
    return np.asarray(seconds - course.at(np.asarray(seconds)))


def shifted(course: Course, found: Sequence[Found]) -> list[Found]:
    """Return the images of a video on the clock of the first one, without those before it begins."""
    times = on_first_clock(course, np.array([seconds for seconds, _ in found]))
    return [(at, people) for at, (_, people) in zip(times.tolist(), found) if at >= 0.0]


def given_offsets(text: str, count: int) -> list[float]:
    """Return the value of --offsets: s by which each video begins after the first one. Raises CameraError."""
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) == count - 1:
        values = [0.0, *values]
    if len(values) != count or values[0] or not all(abs(value) < LARGEST_GIVEN_S for value in values):
        raise CameraError(
            f"--offsets '{text}'; expected {count} numbers, s by which each video begins after the first one, such as "
            f"{','.join(['0', *('1.25' for _ in range(count - 1))])}"
        )
    return values


def synchronised(
    names: Sequence[str], found: Sequence[Sequence[Found]], given: Sequence[float] | None
) -> tuple[list[Course], list[str]]:
    """Return the clocks of videos by the people in their images, and a sentence about each but the first one.

    given: see given_offsets, and without sentences; None to find them.
    """
    if given is not None or len(names) == 1:
        return [_constant(-value) for value in given or [0.0]], []
    tracks = [tracks_in(images) for images in found]
    others = [_course(tracks[0], own, offset) for own, offset in zip(tracks[1:], offsets_of(tracks)[1:])]
    remarks = [f"'{name}' {words}" for name, (_, words) in zip(names[1:], others)]
    return [SAME_CLOCK, *(course for course, _ in others)], remarks


def tracks_in(images: Sequence[Found]) -> list[Track]:
    """Return the tracks of the largest people in the images, px."""
    if all(len(people) <= 1 for _, people in images):
        rows = [[(seconds, people[0]) for seconds, people in images if people]]
    else:
        rows = [list(zip(one.seconds.tolist(), one.detected)) for one in people_in(images)[:MOST_PEOPLE]]
    return [track for one in rows if (track := _track(one)) is not None]


def _track(rows: Sequence[tuple[float, Detected]]) -> Track | None:
    if not rows:
        return None
    known = np.array([one.confidence >= SURE for _, one in rows])
    points = np.array([one.pixels for _, one in rows])
    return track_of(np.array([seconds for seconds, _ in rows]), points, known & np.isfinite(points[..., 0]))


def _constant(seconds: float) -> Course:
    return Course(np.zeros(1), np.array([seconds]))


def _course(first: Sequence[Track], other: Sequence[Track], offset: Offset) -> tuple[Course, str]:
    """Return the clock of a video, and what to say about it."""
    pairs = [(one, two) for one in first for two in other]
    if not pairs:
        return SAME_CLOCK, UNKNOWN_OFFSET
    if not offset.is_sure:  # images may have been lost in between: the offset of each part may be sure
        guesses = [(offset_between(*pair), pair) for pair in pairs]
        offset, pair = min(guesses, key=lambda guess: guess[0].residual)
        course = course_of(*pair, offset) if offset is not UNKNOWN else None
        if course is None or not course.lost:
            return SAME_CLOCK, UNKNOWN_OFFSET
    else:
        pair = min(pairs, key=lambda two: _misfit_at(two[0], two[1], offset))
        course = course_of(*pair, offset)
    if course.lost:
        ((at, seconds),) = course.lost
        lost = f"lacks {seconds:.2f} s of images" if seconds > 0 else f"has {-seconds:.2f} s more images than the first"
        return course, (
            f"begins {-course.offsets[0]:.3f} s after the first video, and {lost} near {at:.1f} s of it, as the "
            "keypoints show; this is used (--offsets)"
        )
    if course.drift:
        return course, (
            f"begins {-float(course.at(np.zeros(1))[0]):.3f} s after the first video, and its clock is "
            f"{1000 * abs(course.drift):.1f} ms per s {'fast' if course.drift > 0 else 'slow'}, as the keypoints show; "
            "this is used (--offsets)"
        )
    said = f"{1000 * offset.deviation:.0f} ms"
    if abs(offset.seconds) < max(NEGLIGIBLE_S, CLEARLY * offset.deviation):
        return SAME_CLOCK, f"is synchronised with the first video, as the keypoints show to {said}"
    way = "after" if offset.seconds < 0 else "before"
    return _constant(offset.seconds), (
        f"begins {abs(offset.seconds):.3f} s (+- {said}) {way} the first video, as the keypoints show; this is used "
        "(--offsets)"
    )


def _misfit_at(first: Track, other: Track, offset: Offset) -> float:
    """Return how badly two tracks fit at an offset."""
    return offset_between(first, replace(other, begin=other.begin - offset.seconds), 0.05).residual


def _set_up(
    found: Sequence[Sequence[Found]],
    lenses: Sequence[Calibration],
    poses: Sequence[CameraPose],
    landmarks: Sequence[str],
    rest: np.ndarray,
) -> SetUp | None:
    """Return what the largest person shows about the places of the cameras; None for too little in common."""
    people = [tracks_in(images) for images in found]
    if not all(people):
        return None
    first = people[0][0]
    nowhere = Offset(0.0, 0.0, 1.0, 0.0)
    tracks = [first]
    for others in people[1:]:
        tracks.append(min(others, key=lambda one: _misfit_at(first, one, nowhere)) if len(others) > 1 else others[0])
    end = first.begin + len(first) * STEP_S
    count = max(2, min(MOST_INSTANTS, int((end - first.begin) / INSTANT_S)))
    shown = [one.at(np.linspace(first.begin, end, count)) for one in tracks]
    pixels, known = [points for points, _ in shown], [seen for _, seen in shown]
    given = [(pose.rotation, pose.translation) for pose in poses]
    return SetUpCheck(pixels, known, [lens.lens().normalise for lens in lenses], given, landmarks, rest).result()


def checked_places(
    found: Sequence[Sequence[Found]],
    lenses: Sequence[Calibration],
    poses: Sequence[CameraPose],
    landmarks: Sequence[str],
    rest: np.ndarray,
    frame: str,
) -> tuple[list[CameraPose], list[str]]:
    """Return the places in m, and sentences about what is wrong with them.

    found: the images of each camera, on one clock. lenses, poses: of each camera. landmarks, rest: see SetUpCheck.
    frame: in which z is up; empty for any. Raises CameraError for places that are too far apart to be in m.
    """
    set_up = _set_up(found, lenses, poses, landmarks, rest)
    names = [pose.name for pose in poses]
    words = set_up_words(set_up, names, OF_FILE, frame)
    unit = "" if set_up is None else set_up.unit
    if unit in ("cm", "mm"):
        poses = [CameraPose(one.name, one.rotation, one.translation / UNITS[unit]) for one in poses]
        words = [text.replace("; expected m", ", and are used so") for text in words]
    apart = max((float(np.linalg.norm(a.centre - b.centre)) for a in poses for b in poses), default=0.0)
    if not math.isfinite(apart) or apart > FARTHEST_APART_M:
        raise CameraError(
            f"the cameras are up to {apart:.0f} m apart; expected metres, at most {FARTHEST_APART_M:g} m; divide the "
            "translations by 1000 if they are in mm"
        )
    return list(poses), [f"{text[0].upper()}{text[1:]}." for text in words]
