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
    """One row. The text contains names of figures in braces; it ends with what to do, if there is something."""

    text: str
    level: str
    seen: Seen


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
SIZE_ADVICE = (
    "give camera_info of the detector's image, in its size (ZED: pub_resolution: NATIVE; a resized or binned image: "
    "its own camera_info)"
)


def _rows(level: str, seen: Seen, texts: dict[str, str]) -> dict[str, Concern]:
    return {key: Concern(text, level, seen) for key, text in texts.items()}


CONCERNS: dict[str, Concern] = {
    **_rows(ERROR, NOW, {
        "camera_refused": "camera_info refused: {fault}{kept}",
        "no_usable_image": "no images can be used: {fault}",
    }),
    **_rows(PROBLEM, NOW, {
        "no_camera_info": "waiting for camera_info",
        "no_keypoints": "waiting for keypoints",
        "silent": "no keypoints for more than {limit:g} s: check the detector; if it sends nothing while nobody is in "
        "view, set silent_when_empty",
        "frozen": "keypoints are frozen: the same ones for more than {limit:g} s: check that the camera's image "
        "changes and reaches the detector",
        "rejected": "{what} rejected ({reason}): {remedy}",
        "overtaken": "messages overtaken by newer: free the processor; with a detector in batches raise queue_depth",
        "lost_on_the_way": "messages lost on the way: check the network and the processor's load",
    }),
    **_rows(NOTE, NOW, {
        "disabled": "disabled by ~/set_enabled",
        "near_limit": "confidences nearly reach min_confidence: lower it if somebody is in view",
        "turned": "the body has pointed to the side in the image {when} (the depth network gets a turned image): the "
        "person lies, or the camera or the image is turned (then set camera_roll), or the detector's x and y are "
        "exchanged",
        "turned_in_frame": "the body has pointed to the side {when}: the person lies, or the image is turned, or the "
        "camera's pose in TF is not that of its optical frame",
    }),
    **_rows(PROBLEM, LIVE, {
        "untrackable": "the keypoints show somebody who is not tracked: a person needs {landmarks} landmarks or more "
        "(min_landmarks) at or above min_confidence {confidence:g}: step back until more of the body is in view, or "
        "lower min_confidence",
        "locked_absent": "{person} is locked and not seen: nobody else is followed until ~/lock is called with false",
        "locked_forgotten": "the locked person was forgotten: nobody is followed until ~/lock is called",
        "numbers_jump": "the detector's person numbers change owners (number {number} has moved to another person), "
        "and are not used: turn on tracking in the detector, or set person_ids to node",
        "numbers_index": "the detector's person numbers have been 0, 1, ... or 1, 2, ... in each image: they may be "
        "places in a list, and identify nobody who was out of sight: set person_ids to lasting if they identify "
        "people, else to node",
        "unused_lock": "lock is true, but nobody is locked: each person has a topic of keypoints, and the detector "
        "says who is who: set lock to false",
        "turnover": "people come and leave within a second: if the message's person numbers change from image to "
        "image, set person_ids to node",
        "hands_exchanged": "hands lie at the wrist of the other side; they are used there: exchange left and right of "
        "the hands in the detector: it may expect mirrored images",
        "hands_alike": "both hands have the same points; one of them is not used: check the detector of the hands",
        "hands_far": "hands are far from the wrists of the body, and not used: somebody else's hands, or check that "
        "both are pixels of the same image",
        "hands_order": "the hands' points are in another order: the thumb is not the first finger; they are taken as "
        "index, middle, ring, pinky and thumb, or not used if they do not fit this: send the wrist, then thumb, "
        "index, middle, ring and pinky finger, each from its root to the tip",
        "future": "stamps lie {seconds:.3g} s in the future: synchronise the clocks of the machines",
        "late": "keypoints are {seconds:.2g} s old when they arrive: the detector queues images or is too slow; let "
        "it drop old images",
        "past": "stamps lie hours in the past: synchronise the clocks of the machines, or play a recording with `ros2 "
        "bag play --clock` and set use_sim_time",
        "slow_for_stale_after": "keypoints come every {period:.2g} s, and {limits}: people are reported as lost in "
        "between: set {which} to two or three periods",
        "camera_unlikely": "{fault}",
        "camera_silent": "no keypoints of camera '{camera}' for more than {limit:g} s: check its detector, and the "
        "topic {camera}/keypoints",
        "camera_without_info": "no camera_info of camera '{camera}': remap {camera}/camera_info to its topic",
        "camera_unplaced": "{fault}",
        "cameras_share_frame": "{fault}",
        "camera_wrong": "{fault}",
        "camera_clock": "{fault}",
        "tf_clock": "while the camera{camera} turns, people move as if the stamps of its keypoints were {ms:.0f} ms "
        "(+- {deviation:.0f}) too {way} for TF; nothing is changed: let the driver stamp the exposure, by the clock "
        "of those who publish TF",
        "camera_late": "keypoints of '{last}' arrive {apart:.2f} s later after their stamps than those of '{first}': "
        "its clock differs, or its detector is slower; then set wait to that",
        "outside": "keypoints lie outside the image of {width} x {height} px of camera_info{when}: if the whole person"
        " is in view, check that they are pixels of the raw image at full resolution, and that camera_info is of "
        "their camera",
        "upside_down": "the body has pointed down in the image {when}: check that the image is not upside down, and "
        "that y is counted from the top; for a camera that hangs upside down set camera_roll to 3.14",
        "no_optical_frame": "people stand upright in the image of a camera that looks up or down in fixed_frame by TF:"
        " expected keypoints and camera_info in the camera's optical frame (z forward, x right, y down), and a "
        "fixed_frame with z up; one of them is the other kind of frame",
        "turned_down_in_frame": "the body has pointed down {when}: the person lies, or the image is turned, or the "
        "camera's pose in TF is not that of its optical frame",
        "no_depth_images": "no depth images on {topic}: tracking without measured depth: check that the depth camera "
        "publishes there",
        "depth_unused": "{fault}",
        "depth_unmatched": "most keypoint messages had no depth image of their time: check that both have the stamp of"
        " the camera, and that depth images arrive before the keypoints",
        "depth_not_near": "the depth images have no depth near the person at the keypoints: check that they are in mm "
        "(16UC1) or m (32FC1) and registered to the colour image, and that the person is within the camera's range",
        "own_depth_not_near": "the keypoints' own depths are not near the person: check that they are in m, along the "
        "optical axis from the camera (not from the hips, as MediaPipe's z), and that the person is within its range",
        "height_assumed": "nothing measures the height: {height:g} m is assumed, so that distances are uncertain by a "
        "quarter: set height, the topic of depth images, or floor with fixed_frame",
        "height_by_floor": "with a tilt known to {tilt:g} rad the floor gives the height to {percent:.0f} % from here,"
        " more than {limit:.0f} %: {height:g} m is assumed: come nearer, raise the camera, or set height",
        "height_wrong": "{source} not fit the size of the given body (height {height:g} m), but one of about "
        "{measured:.1f} m: set height to that of the person, or to 0 to measure it, and check {check}",
        "no_body": "keypoints are more than {distance:.2f} m off the best body: check that the detector's landmarks "
        "are those of `landmarks: {landmarks}`, in pixels of the raw image",
        "somebody_else": "the followed person was re-identified by position only, and may be somebody else: check that"
        " it is the same person, and call ~/lock",
    }),
    **_rows(DOUBT, LIVE, {
        "likely_wrong": "the pose is likely wrong {when}: {reasons}",
    }),
    **_rows(NOTE, LIVE, {
        "unseen": "not seen: {limbs}; without keypoints their pose is a guess",
    }),
    **_rows(PROBLEM, LOGGED, {
        "unscored": "the keypoints have positions, but all confidences are 0 or NaN: fill them in the detector (0 to "
        "1; 1 if it has none)",
        "ids_from_1": "landmark 0 ({landmark}) was in no message, all others were: if the detector counts landmarks "
        "from 1, subtract 1 from the ids",
        "stamp_rate": "by their stamps the keypoints have {rate}, but they arrive at {arrivals:.3g} Hz: check the unit"
        " of header.stamp (for a time t in ns, sec is t // 10**9 and nanosec is t % 10**9); if a recording is played "
        "faster or slower, use `ros2 bag play --clock` and set use_sim_time",
        "image_size": "camera_info is of an image of {size[0]} x {size[1]} px, the keypoints are pixels of one of "
        "{own[0]} x {own[1]} px, as the detector's 3D points show: used is camera_info times {factor:.3g}: give "
        "camera_info of the detector's image, in its size (ZED: pub_resolution: NATIVE; a resized or binned image: "
        "its own camera_info)",
        "other_camera": "{topic} is of another camera: its frame_id is '{camera}', that of the keypoints "
        "'{keypoints}': remap {topic} to the camera of the detector, or give both the frame_id of its optical frame",
        "frame_jumped": "TF: the {cameras} jumped in fixed_frame '{frame}' by {step} from one image to the next, and "
        "people with it; expected a frame without jumps: was odometry reset, or the robot localised anew?",
        "depth_frozen": "the depth images on {topic} are frozen: the same one for more than {limit:g} s, with new "
        "stamps, so they are not used: check the depth camera",
        "own_depth_frozen": "the depths in the keypoint messages are frozen: the same ones for more than {limit:g} s, "
        "with new stamps: check the depth camera of the detector",
        "own_depth_unused": "{fault}",
    }),
    **_rows(PROBLEM, Seen.LOG | PAGE, {
        "unstamped": "keypoints without a stamp: outputs carry the time of their arrival{count}: let the detector copy"
        " the stamp of the image",
    }),
    **_rows(PROBLEM, PAGE, {
        "stamps_jump": "The stamps are not monotonic: at {time:.1f} s they jump {way} by {seconds:.1f} s{more} (a "
        "looped bag, or a second clock?); tracking was reset there, and the time axis of this page continues",
        "nothing_received": "The topic {topic} has no messages",
        "nothing_tracked": "Nothing was tracked: none of {count} messages produced a skeleton",
        "nobody_found": "Nobody was tracked in {count} images. The detector needs a person who is in view, and about a"
        " tenth of the image high or more",
        "refused": "{count} {what} rejected: {name}: {remedy}",
        "untracked": "{who} tracked {when}: {reasons}",
        "reprojection": "The median reprojection error is {median:.1f} px, with noise_px {noise:g}: check `noise_px`, "
        "camera_info (resolution, `rectified`) and `landmarks`",
        "far_landmarks": "Landmarks far from their reprojection: {listed} (median of all: {usual:.0f} px): check that "
        "`landmarks` is the layout of your detector",
        "distance": "The median distance of the person is {metres:.2g} m: check {what}",
    }),
    **_rows(DOUBT, PAGE, {
        "probably_nobody": "probably nobody is in the images: a skeleton fits {share:.0%} of them, never for longer "
        "than {longest:.1f} s",
        "poor_fit": "The skeleton lies {median:.0f} px from the detected points in the median, {share:.1%} of its size"
        " in the image: the pose follows them poorly",
        "bent_knees": "even the straighter knee stays bent, by {degrees:.0f} degrees in the median. If the person "
        "stands or walks upright, this is an error: legs that are too long for the trunk, or an ambiguous view of "
        "them",
    }),
    **_rows(NOTE, PAGE, {
        "partly_outside": "In {share:.0%} of the images the person is partly outside of the image",
        "absent": "{who} in view {when}",
        "more_spans": "{count} more such spans, {seconds:.1f} s in total",
        "gaps": "{count}, {seconds:.1f} s in total, the longest {longest:.1f} s; tracking continued from the previous "
        "pose",
        "slow": "The keypoint rate is {rate:.1f} Hz: 20 Hz or more gives better tracking",
        "repeated": "{count} of {received} {what}: {why}, or the image is frozen: check that the camera's image "
        "changes and reaches the detector",
        "initialised_again": "{who} was re-initialised {times}, at {listed}; the skeleton may jump there",
        "too_many": "{count} {what} contain more people than max_people {most}: raise it to follow them",
        "by_figures": "in {share:.0%} of the frames an error above 100 mm is likely by the tracker's own figures; they"
        " are marked on the slider and in the plots",
        "bones": "calibration changed the bone to {joint} from {before:.0f} to {after:.0f} mm, and people differ less:"
        " another error may hide in it; check height, and that the landmarks are the layout's",
        "uncertain": "The joints are off by about {millimetres:.0f} mm relative to the pelvis, mostly in depth (mean "
        "of the stated deviations): measured depth or the person's bone lengths make them more exact",
        "remark": "{text}",
    }),
    **_rows(GOOD, PAGE, {
        "tracked": "{share:.1%} of the frames were tracked, and {where}nothing suggests a wrong pose{unjudged}",
    }),
}  # fmt: skip
"""The catalogue, by level and by who sees a concern."""

NUMBER = re.compile(r"(?<!\w)-?\d[\d.,]*(e[+-]?\d+)?|\bnan\b|\binf\b")
"""A number, which may differ each time a concern is found. Digits in a name, as in 'camera2', are none."""


def say(key: str, of: str = "", level: str = "", **figures: Any) -> Raised:
    """Return a concern with its figures. of: whom or what it is about; level: instead of the row's."""
    concern = CONCERNS[key]
    text = ": ".join(filter(None, [of, concern.text.format(**figures).removesuffix(": ")]))
    return Raised(key, level or concern.level, text)


def words_of(found: Iterable[Raised], who: Seen = Seen.DIAGNOSTICS) -> list[str]:
    """Return the texts that somebody sees."""
    return [raised.text for raised in found if who in raised.seen]


def without_numbers(text: str) -> str:
    """Return a text in which all numbers are alike: texts that differ in their numbers alone say the same."""
    return NUMBER.sub("#", text)
