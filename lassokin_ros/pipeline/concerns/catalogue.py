"""Every concern about inputs and results: its level, its sentence, what to do, and who sees it.

The log, /diagnostics, the summary of a replay and the page of `--report` take their sentences from here:

found = say("camera_silent", camera="left", limit=2.0)   # found.text, found.level, found.key
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from enum import Flag, auto
from typing import Any, NamedTuple

ERROR, PROBLEM, DOUBT, NOTE, GOOD = "error", "problem", "doubt", "note", "good"
"""Levels. ERROR: nothing can be tracked. PROBLEM: something to repair. DOUBT: the result may be wrong. NOTE and GOOD
are no warnings."""


class Seen(Flag):
    """Who sees a concern. A replay has it in its summary and on its page."""

    LOG = auto()
    DIAGNOSTICS = auto()
    REPLAY = auto()


NOW = Seen.DIAGNOSTICS
"""What holds at this moment; a whole recording is judged by other figures."""
PAGE = Seen.REPLAY
LIVE = NOW | PAGE
LOGGED = LIVE | Seen.LOG


class Concern(NamedTuple):
    """One row. The words and the advice contain names of figures in braces; the advice says what to do."""

    words: str
    advice: str = ""
    level: str = PROBLEM
    seen: Seen = LIVE


class Raised(NamedTuple):
    """A concern that has been found, as text."""

    key: str
    level: str
    text: str

    @property
    def seen(self) -> Seen:
        """Who sees it."""
        return CONCERNS[self.key].seen

    @property
    def sentence(self) -> str:
        """The text with a capital, unless it begins with the id of a person, and a full stop."""
        first = self.text.partition(" ")[0]
        begin = self.text[:1] if re.search(r"\d", first) else self.text[:1].upper()
        return begin + self.text[1:] + "." * (not self.text.endswith("."))


FROZEN_ADVICE = "check that the camera's image changes and reaches the detector"
PIXELS_ADVICE = "pixels of the raw image at full resolution, and that camera_info is of their camera"
UPRIGHT_ADVICE = "check that the image is not upside down, and that y is counted from the top"
TURNED_ADVICE = "the person lies, or the image is turned, or the camera's pose in TF is not that of its optical frame"
SIZE_ADVICE = (
    "give camera_info of the detector's image, in its size (ZED: pub_resolution: NATIVE; a resized or binned image: "
    "its own camera_info)"
)
UNIT_ADVICE = "check that they are in mm (16UC1) or m (32FC1)"

CONCERNS: dict[str, Concern] = {
    # Nothing is tracked.
    "disabled": Concern("disabled by ~/set_enabled", level=NOTE, seen=NOW),
    "camera_refused": Concern("camera_info refused: {fault}{kept}", level=ERROR, seen=NOW),
    "no_usable_image": Concern("no images can be used: {fault}", level=ERROR, seen=NOW),
    "no_camera_info": Concern("waiting for camera_info", seen=NOW),
    "no_keypoints": Concern("waiting for keypoints", seen=NOW),
    "silent": Concern(
        "no keypoints for more than {limit:g} s",
        "check the detector; if it sends nothing while nobody is in view, set silent_when_empty",
        seen=NOW,
    ),
    "frozen": Concern("keypoints are frozen: the same ones for more than {limit:g} s", FROZEN_ADVICE, seen=NOW),
    "near_limit": Concern(
        "confidences nearly reach min_confidence", "lower it if somebody is in view", level=NOTE, seen=NOW
    ),
    "untrackable": Concern(
        "the keypoints show somebody who is not tracked: a person needs {landmarks} "
        "landmarks or more (min_landmarks) at or above min_confidence {confidence:g}",
        "step back until more of the body is in view, or lower min_confidence",
    ),
    "locked_absent": Concern(
        "{person} is locked and not seen: nobody else is followed until ~/lock is called with false"
    ),
    "locked_forgotten": Concern("the locked person was forgotten: nobody is followed until ~/lock is called"),
    "numbers_jump": Concern(
        "the detector's person numbers change owners (number {number} has moved to another person), and are not used",
        "turn on tracking in the detector, or set person_ids to node",
    ),
    "numbers_index": Concern(
        "the detector's person numbers have been 0, 1, ... or 1, 2, ... in each "
        "image: they may be places in a list, and identify nobody who was out of sight",
        "set person_ids to lasting if they identify people, else to node",
    ),
    "unused_lock": Concern(
        "lock is true, but nobody is locked: each person has a topic of keypoints, and the detector says who is who",
        "set lock to false",
    ),
    # Messages.
    "rejected": Concern("{what} rejected ({reason})", "{remedy}", seen=NOW),
    "overtaken": Concern(
        "messages overtaken by newer", "free the processor; with a detector in batches raise queue_depth", seen=NOW
    ),
    "lost_on_the_way": Concern("messages lost on the way", "check the network and the processor's load", seen=NOW),
    "unscored": Concern(
        "the keypoints have positions, but all confidences are 0 or NaN",
        "fill them in the detector (0 to 1; 1 if it has none)",
        seen=LOGGED,
    ),
    "turnover": Concern(
        "people come and leave within a second",
        "if the message's person numbers change from image to image, set person_ids to node",
    ),
    "ids_from_1": Concern(
        "landmark 0 ({landmark}) was in no message, all others were",
        "if the detector counts landmarks from 1, subtract 1 from the ids",
        seen=LOGGED,
    ),
    # Hands.
    "hands_exchanged": Concern(
        "hands lie at the wrist of the other side; they are used there",
        "exchange left and right of the hands in the detector: it may expect mirrored images",
    ),
    "hands_alike": Concern(
        "both hands have the same points; one of them is not used", "check the detector of the hands"
    ),
    "hands_far": Concern(
        "hands are far from the wrists of the body, and not used",
        "somebody else's hands, or check that both are pixels of the same image",
    ),
    "hands_order": Concern(
        "the hands' points are in another order: the thumb is not the first finger; they are taken as index, middle, "
        "ring, pinky and thumb, or not used if they do not fit this",
        "send the wrist, then thumb, index, middle, ring and pinky finger, each from its root to the tip",
    ),
    # Stamps and clocks.
    "future": Concern("stamps lie {seconds:.3g} s in the future", "synchronise the clocks of the machines"),
    "late": Concern(
        "keypoints are {seconds:.2g} s old when they arrive",
        "the detector queues images or is too slow; let it drop old images",
    ),
    "past": Concern(
        "stamps lie hours in the past",
        "synchronise the clocks of the machines, or play a recording with `ros2 bag play --clock` and set use_sim_time",
    ),
    "stamp_rate": Concern(
        "by their stamps the keypoints have {rate}, but they arrive at {arrivals:.3g} Hz",
        "check the unit of header.stamp (for a time t in ns, sec is t // 10**9 and nanosec is t % "
        "10**9); if a recording is played faster or slower, use `ros2 bag play --clock` and set use_sim_time",
        seen=LOGGED,
    ),
    "slow_for_stale_after": Concern(
        "keypoints come every {period:.2g} s, and {limits}: people are reported as lost in between",
        "set {which} to two or three periods",
    ),
    "unstamped": Concern(
        "keypoints without a stamp: outputs carry the time of their arrival{count}",
        "let the detector copy the stamp of the image",
        seen=Seen.LOG | PAGE,
    ),
    "stamps_jump": Concern(
        "The stamps are not monotonic: at {time:.1f} s they jump {way} by "
        "{seconds:.1f} s{more} (a looped bag, or a second clock?); tracking was reset there, and the time axis of this "
        "page continues",
        seen=PAGE,
    ),
    # Images and cameras.
    "camera_unlikely": Concern("{fault}"),
    "camera_silent": Concern(
        "no keypoints of camera '{camera}' for more than {limit:g} s",
        "check its detector, and the topic {camera}/keypoints",
    ),
    "camera_without_info": Concern("no camera_info of camera '{camera}'", "remap {camera}/camera_info to its topic"),
    "camera_unplaced": Concern("{fault}"),
    "cameras_share_frame": Concern("{fault}"),
    "image_size": Concern(
        "camera_info is of an image of {size[0]} x {size[1]} px, the keypoints are pixels of one of {own[0]} x "
        "{own[1]} px, as the detector's 3D points show: used is camera_info times {factor:.3g}",
        SIZE_ADVICE,
        seen=LOGGED,
    ),
    "camera_wrong": Concern("{fault}"),
    "camera_clock": Concern("{fault}"),
    "tf_clock": Concern(
        "while the camera{camera} turns, people move as if the stamps of its keypoints were {ms:.0f} ms (+- "
        "{deviation:.0f}) too {way} for TF; nothing is changed",
        "let the driver stamp the exposure, by the clock of those who publish TF",
    ),
    "camera_late": Concern(
        "keypoints of '{last}' arrive {apart:.2f} s later after their stamps than those of '{first}'",
        "its clock differs, or its detector is slower; then set wait to that",
    ),
    "other_camera": Concern(
        "{topic} is of another camera: its frame_id is '{camera}', that of the keypoints '{keypoints}'",
        "remap {topic} to the camera of the detector, or give both the frame_id of its optical frame",
        seen=LOGGED,
    ),
    "frame_jumped": Concern(
        "TF: the {cameras} jumped in fixed_frame '{frame}' by {step} from one "
        "image to the next, and people with it; expected a frame without jumps",
        "was odometry reset, or the robot localised anew?",
        seen=LOGGED,
    ),
    "outside": Concern(
        "keypoints lie outside the image of {width} x {height} px of camera_info{when}",
        "if the whole person is in view, check that they are " + PIXELS_ADVICE,
    ),
    "partly_outside": Concern(
        "In {share:.0%} of the images the person is partly outside of the image", level=NOTE, seen=PAGE
    ),
    "turned": Concern(
        "the body has pointed to the side in the image {when} (the depth network gets a turned image)",
        "the person lies, or the camera or the image is turned (then set camera_roll), or the detector's x and y are "
        "exchanged",
        level=NOTE,
        seen=NOW,
    ),
    "upside_down": Concern(
        "the body has pointed down in the image {when}",
        UPRIGHT_ADVICE + "; for a camera that hangs upside down set camera_roll to 3.14",
    ),
    "no_optical_frame": Concern(
        "people stand upright in the image of a camera that looks up or down in fixed_frame by TF",
        "expected keypoints and camera_info in the camera's optical frame (z forward, x right, y down), and a "
        "fixed_frame with z up; one of them is the other kind of frame",
    ),
    "turned_in_frame": Concern("the body has pointed to the side {when}", TURNED_ADVICE, level=NOTE, seen=NOW),
    "turned_down_in_frame": Concern("the body has pointed down {when}", TURNED_ADVICE),
    # Depth and size.
    "no_depth_images": Concern(
        "no depth images on {topic}: tracking without measured depth", "check that the depth camera publishes there"
    ),
    "depth_unused": Concern("{fault}"),
    "depth_unmatched": Concern(
        "most keypoint messages had no depth image of their time",
        "check that both have the stamp of the camera, and that depth images arrive before the keypoints",
    ),
    "depth_not_near": Concern(
        "the depth images have no depth near the person at the keypoints",
        UNIT_ADVICE + " and registered to the colour image, and that the person is within the camera's range",
    ),
    "own_depth_not_near": Concern(
        "the keypoints' own depths are not near the person",
        "check that they are in m, along the optical axis from the camera (not from the hips, as MediaPipe's z), and "
        "that the person is within its range",
    ),
    "depth_frozen": Concern(
        "the depth images on {topic} are frozen: the same one for more than "
        "{limit:g} s, with new stamps, so they are not used",
        "check the depth camera",
        seen=LOGGED,
    ),
    "own_depth_frozen": Concern(
        "the depths in the keypoint messages are frozen: the same ones for more than {limit:g} s, with new stamps",
        "check the depth camera of the detector",
        seen=LOGGED,
    ),
    "own_depth_unused": Concern("{fault}", seen=LOGGED),
    "height_assumed": Concern(
        "nothing measures the height: {height:g} m is assumed, so that distances are uncertain by a quarter",
        "set height, the topic of depth images, or floor with fixed_frame",
    ),
    "height_by_floor": Concern(
        "with a tilt known to {tilt:g} rad the floor gives the height "
        "to {percent:.0f} % from here, more than {limit:.0f} %: {height:g} m is assumed",
        "come nearer, raise the camera, or set height",
    ),
    "height_wrong": Concern(
        "{source} not fit the size of the given body (height {height:g} m), but one of about {measured:.1f} m",
        "set height to that of the person, or to 0 to measure it, and check {check}",
    ),
    # The pose.
    "no_body": Concern(
        "keypoints are more than {distance:.2f} m off the best body",
        "check that the detector's landmarks are those of `landmarks: {landmarks}`, in pixels of the raw image",
    ),
    "somebody_else": Concern(
        "the followed person was re-identified by position only, and may be somebody else",
        "check that it is the same person, and call ~/lock",
    ),
    "likely_wrong": Concern("the pose is likely wrong {when}: {reasons}", level=DOUBT),
    "unseen": Concern("not seen: {limbs}; without keypoints their pose is a guess", level=NOTE, seen=NOW | PAGE),
    "tracked": Concern(
        "{share:.1%} of the frames were tracked, and {where}nothing suggests a wrong pose{unjudged}",
        level=GOOD,
        seen=PAGE,
    ),
    "nothing_received": Concern("The topic {topic} has no messages", seen=PAGE),
    "nothing_tracked": Concern("Nothing was tracked: none of {count} messages produced a skeleton", seen=PAGE),
    "nobody_found": Concern(
        "Nobody was tracked in {count} images. The detector needs a person who is "
        "in view, and about a tenth of the image high or more",
        seen=PAGE,
    ),
    "probably_nobody": Concern(
        "probably nobody is in the images: a skeleton fits {share:.0%} of them, never for longer than {longest:.1f} s",
        level=DOUBT,
        seen=PAGE,
    ),
    "refused": Concern("{count} {what} rejected: {name}", "{remedy}", seen=PAGE),
    "untracked": Concern("{who} tracked {when}: {reasons}", seen=PAGE),
    "absent": Concern("{who} in view {when}", level=NOTE, seen=PAGE),
    "more_spans": Concern("{count} more such spans, {seconds:.1f} s in total", level=NOTE, seen=PAGE),
    "gaps": Concern(
        "{count}, {seconds:.1f} s in total, the longest {longest:.1f} s; tracking continued from the previous pose",
        level=NOTE,
        seen=PAGE,
    ),
    "reprojection": Concern(
        "The median reprojection error is {median:.1f} px, with noise_px {noise:g}",
        "check `noise_px`, camera_info (resolution, `rectified`) and `landmarks`",
        seen=PAGE,
    ),
    "poor_fit": Concern(
        "The skeleton lies {median:.0f} px from the detected points in the median, "
        "{share:.1%} of its size in the image: the pose follows them poorly",
        level=DOUBT,
        seen=PAGE,
    ),
    "far_landmarks": Concern(
        "Landmarks far from their reprojection: {listed} (median of all: {usual:.0f} px)",
        "check that `landmarks` is the layout of your detector",
        seen=PAGE,
    ),
    "distance": Concern("The median distance of the person is {metres:.2g} m", "check {what}", seen=PAGE),
    "slow": Concern("The keypoint rate is {rate:.1f} Hz", "20 Hz or more gives better tracking", level=NOTE, seen=PAGE),
    "repeated": Concern(
        "{count} of {received} {what}: {why}, or the image is frozen", FROZEN_ADVICE, level=NOTE, seen=PAGE
    ),
    "initialised_again": Concern(
        "{who} was re-initialised {times}, at {listed}; the skeleton may jump there", level=NOTE, seen=PAGE
    ),
    "too_many": Concern(
        "{count} {what} contain more people than max_people {most}", "raise it to follow them", level=NOTE, seen=PAGE
    ),
    "by_figures": Concern(
        "in {share:.0%} of the frames an error above 100 mm is likely by the tracker's "
        "own figures; they are marked on the slider and in the plots",
        level=NOTE,
        seen=PAGE,
    ),
    "bent_knees": Concern(
        "even the straighter knee stays bent, by {degrees:.0f} degrees in the median. "
        "If the person stands or walks upright, this is an error: legs that are too long for the trunk, or an "
        "ambiguous view of them",
        level=DOUBT,
        seen=PAGE,
    ),
    "bones": Concern(
        "calibration changed the bone to {joint} from {before:.0f} to {after:.0f} mm, and people differ less",
        "another error may hide in it; check height, and that the landmarks are the layout's",
        level=NOTE,
        seen=PAGE,
    ),
    "uncertain": Concern(
        "The joints are off by about {millimetres:.0f} mm relative to the pelvis, mostly "
        "in depth (mean of the stated deviations)",
        "measured depth or the person's bone lengths make them more exact",
        level=NOTE,
        seen=PAGE,
    ),
    "remark": Concern("{text}", level=NOTE, seen=PAGE),
}
"""The catalogue: one row per concern."""

NUMBER = re.compile(r"(?<!\w)-?\d[\d.,]*(e[+-]?\d+)?|\bnan\b|\binf\b")
"""A number, which may differ each time a concern is found. Digits in a name, as in 'camera2', are none."""


def say(key: str, of: str = "", level: str = "", **figures: Any) -> Raised:
    """Return a concern with its figures. of: whom or what it is about; level: instead of the row's."""
    concern = CONCERNS[key]
    advice = concern.advice.format(**figures)
    text = ": ".join(part for part in (of, concern.words.format(**figures), advice) if part)
    return Raised(key, level or concern.level, text)


def words_of(found: Iterable[Raised], who: Seen = Seen.DIAGNOSTICS) -> list[str]:
    """Return the texts that somebody sees."""
    return [raised.text for raised in found if who in raised.seen]


def without_numbers(text: str) -> str:
    """Return a text in which all numbers are alike: texts that differ in their numbers alone say the same."""
    return NUMBER.sub("#", text)
