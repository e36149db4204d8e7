"""The concerns of one period of a running tracker: each rule yields those that it finds."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from lassokin_ros.core.learned.height import LARGEST_FLOOR_DEVIATION
from lassokin_ros.core.observation import Rejection
from lassokin_ros.pipeline.camera.camera_selection import OUTSIDE_IMAGE
from lassokin_ros.pipeline.camera.placement import JUMPS
from lassokin_ros.pipeline.camera_images import DEPTH_IN_MESSAGE, NOBODY, UNSCORED, CameraImages
from lassokin_ros.pipeline.concerns.catalogue import CONCERNS, Raised, say
from lassokin_ros.pipeline.concerns.period import INTERVALS, Period
from lassokin_ros.pipeline.concerns.rejections import advice_for
from lassokin_ros.pipeline.depth.depth_images import MATCHED, UNMATCHED
from lassokin_ros.pipeline.input_checks.hands import EXCHANGED, FAR, ORDER, SAME
from lassokin_ros.pipeline.input_checks.messages import FROZEN_S
from lassokin_ros.pipeline.keypoint_queue import LOST, OVERTAKEN
from lassokin_ros.pipeline.people.roster import GONE
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import MESSAGE

FUTURE_S, LATE_S, LATEST_S, PAST_S = 1.0, 0.5, 60.0, 3600.0
"""s: stamps that lie further in the future are of another clock. Keypoints that are older than the second when they
arrive are late; older than the third, they are probably of a recording, and older than the last of another clock."""
UNUSED_SHARE = 0.02
"""Share of the messages that may be overtaken or lost without a warning."""
TURNOVER = 2
"""Number of people that may come, and leave, in one period. More are a sign of a detector that numbers people anew in
each image."""
LEAST_DEPTH_USED = 0.2
"""Share of the messages with a tracked person that use measured depth. Below it a warning is due, if most messages have
a depth image."""
NOT_SEEN = Rejection.TOO_FEW_LANDMARKS.value
NO_BODY = 0.06
"""As a fraction of the height: largest distance of keypoints from the best body that fits. Detectors have 0.02."""
MOST_MARKED = 0.5
"""Share of the frames of a period that may be marked by their figures alone without a warning."""
UNUSUAL_HANDS = 0.05
"""Share of the messages whose hands may be exchanged, alike or somebody else's without a warning."""
HANDS = {"hands_exchanged": EXCHANGED, "hands_alike": SAME, "hands_far": FAR, "hands_order": ORDER}

Rule = Callable[[Period], Iterator[Raised]]


def of_each_camera(session: Session, rule: Callable[[CameraImages], Iterator[Raised]]) -> Iterator[Raised]:
    """Yield what a rule finds about each camera, with the name of each one of several."""
    for name, camera in session.cameras.items():
        for raised in rule(camera):
            yield raised._replace(text=f"camera '{name}': {raised.text}") if name else raised


def passed_on(key: str, text: str) -> Iterator[Raised]:
    """Yield a concern whose text is made where it is found; nothing for an empty text."""
    if text:
        yield Raised(key, CONCERNS[key].level, text)


def camera_refused(session: Session) -> Iterator[Raised]:
    """Yield why the last camera_info of a camera was refused."""

    def refused(camera: CameraImages) -> Iterator[Raised]:
        if fault := camera.camera.fault:
            kept = "" if camera.camera.view is None else "; the last good one is used"
            yield say("camera_refused", fault=fault, kept=kept)

    return of_each_camera(session, refused)


def rejections(period: Period) -> Iterator[Raised]:
    """Yield why messages were not used. The figures of the diagnostics contain the numbers."""
    recent = period.recent
    refused = {key.partition(": ")[2]: n for key, n in recent.items() if key.startswith("rejected: ")}
    if NOT_SEEN in refused:
        refused[NOT_SEEN] -= recent[NOBODY]
    for reason in sorted(reason for reason, count in refused.items() if count > 0):
        what = "camera_info" if reason.startswith("camera_") else "keypoints"
        yield say("rejected", what=what, reason=reason, remedy=advice_for(reason.partition(" (")[0]))
    for key, count in (("overtaken", OVERTAKEN), ("lost_on_the_way", LOST)):
        if recent[count] > UNUSED_SHARE * recent["received"]:
            yield say(key)


def _cameras_fit(period: Period) -> Iterator[Raised]:
    def unlikely(camera: CameraImages) -> Iterator[Raised]:
        return passed_on("camera_unlikely", "" if camera.camera.view is None else camera.camera.warning)

    def outside(camera: CameraImages) -> Iterator[Raised]:
        count, received = period.recent[camera.key(OUTSIDE_IMAGE)], period.recent[camera.key("received")]
        if camera.camera.view is not None and 2 * count > received:
            width, height = camera.camera.view.size
            yield say("outside", width=width, height=height, when="")

    yield from of_each_camera(period.session, unlikely)
    yield from of_each_camera(period.session, outside)


def _fit(period: Period) -> Iterator[Raised]:
    """Yield that the keypoints do not fit a body."""
    if period.misfits and float(np.median(period.misfits)) >= NO_BODY:
        tracker = period.session.tracker
        yield say("no_body", distance=NO_BODY * tracker.skeleton.height, landmarks=tracker.config.landmarks)


def _turnover(period: Period) -> Iterator[Raised]:
    """Yield that more people came and left than is plausible."""
    config, recent = period.session.config, period.recent
    numbered = not config.topic_per_body and config.person_ids == MESSAGE
    if numbered and min(recent["people come"], recent["people left"]) > TURNOVER and not recent["resets"]:
        yield say("turnover")


def _depth(period: Period) -> Iterator[Raised]:
    """Yield why measured depth is not used."""
    session, recent = period.session, period.recent
    unused = period.with_depth < LEAST_DEPTH_USED * period.tracked
    if recent[DEPTH_IN_MESSAGE] and unused:
        yield say("own_depth_not_near")
    elif session.first.depth is not None:
        found = list(of_each_camera(session, lambda camera: _depth_fault(period, camera)))
        frozen = any(camera.depth is not None and camera.depth.frozen for camera in session.cameras.values())
        if not found and not frozen:  # `_inputs` names frozen ones
            found = list(of_each_camera(session, lambda camera: _unmatched_depth(period, camera)))
            if not found and recent[MATCHED] and unused:
                found = [say("depth_not_near")]
        yield from found


def _depth_fault(period: Period, camera: CameraImages) -> Iterator[Raised]:
    if camera.depth is None:
        return iter(())
    if period.depth_images(camera.name) == 0:
        return iter([say("no_depth_images", topic=period.session.config.depth_topic(camera.name))])
    return passed_on("depth_unused", camera.depth.fault or camera.depth_check.fault)


def _unmatched_depth(period: Period, camera: CameraImages) -> Iterator[Raised]:
    if period.recent[camera.key(UNMATCHED)] > period.recent[camera.key(MATCHED)]:
        yield say("depth_unmatched")


def _height(period: Period) -> Iterator[Raised]:
    """Yield that the height is assumed, or that measured depth contradicts it."""
    session, config = period.session, period.session.tracker.config
    if config.height > 0:
        checks = [tracker.learned.size_check for tracker in session.roster.trackers.values()]
        if (wrong := next((check for check in checks if check.wrong), None)) is not None:
            source, check = _size_source(session)
            measured = wrong.ratio * config.height
            yield say("height_wrong", height=config.height, source=source, measured=measured, check=check)
        return
    heights = session.roster.heights().values()
    if not period.tracked or any(height.measured for height in heights):
        return
    floor = max((height.floor_deviation for height in heights), default=0.0)
    if floor < LARGEST_FLOOR_DEVIATION:
        yield say("height_assumed", height=config.assumed_height)
    else:
        percent, limit = 100 * floor, 100 * LARGEST_FLOOR_DEVIATION
        tilt = config.tilt_deviation
        yield say("height_by_floor", height=config.assumed_height, tilt=tilt, percent=percent, limit=limit)


def _size_source(session: Session) -> tuple[str, str]:
    """Return what has measured the size of a person, and what else may be wrong with it, in words."""
    if session.config.several_cameras:
        return "limbs before several cameras do", "the places of the cameras"
    if session.counts[session.first.key(MATCHED)] == 0 and session.tracker.floor is not None:
        return "feet on the floor do", "the height and the tilt of the camera"
    return "measured depth does", "that camera_info is of their camera"


def _clock(period: Period) -> Iterator[Raised]:
    """Yield that the stamps are of another clock than the node's, or old."""
    delay = float(np.median(period.delays)) if period.delays else 0.0
    if delay < -FUTURE_S:
        yield say("future", seconds=-delay)
    elif LATE_S < delay < LATEST_S:
        yield say("late", seconds=delay)
    elif delay >= PAST_S:
        yield say("past")


def _inputs(period: Period) -> Iterator[Raised]:
    """Yield that inputs are not what they seem, see `pipeline/input_checks`."""
    session, recent = period.session, period.recent
    yield from of_each_camera(session, lambda camera: passed_on("stamp_rate", camera.stamp_rate.warning))
    yield from _other_camera(session)
    for key, count in HANDS.items():
        if recent[count] > UNUSUAL_HANDS * recent["received"]:
            yield say(key)
    if recent[UNSCORED] and recent[UNSCORED] >= recent["received"]:
        yield say("unscored")
    for name, camera in session.cameras.items():
        if camera.depth is not None and camera.depth.frozen:
            yield say("depth_frozen", topic=session.config.depth_topic(name), limit=FROZEN_S)
    if recent[JUMPS]:
        cameras, frame = "cameras have" if len(session.cameras) > 1 else "camera has", session.config.fixed_frame
        yield say("frame_jumped", cameras=cameras, frame=frame, step=session.placement.jumps.words)
    yield from of_each_camera(session, lambda camera: passed_on("image_size", camera.image_size.warning))
    yield from of_each_camera(session, lambda camera: passed_on("own_depth_unused", camera.own_depth.warning))
    yield from of_each_camera(session, lambda camera: passed_on("ids_from_1", camera.landmark_ids.warning))


def _other_camera(session: Session) -> Iterator[Raised]:
    """Yield that camera_info and keypoints of a camera have different frame_ids."""
    for name, one in session.cameras.items():
        if session.scene.image is None or (view := one.camera.view) is None:
            continue
        frame, camera = one.frame_id, view.intrinsics.frame_id
        if frame and camera and frame != camera:
            topic = f"{name}/camera_info" if name else "camera_info"
            yield say("other_camera", topic=topic, camera=camera[:40], keypoints=frame[:40])
            return


def _interval(period: Period) -> Iterator[Raised]:
    """Yield that people are reported as lost between two messages."""
    if len(period.intervals) < INTERVALS:
        return
    config, interval = period.session.config, float(np.median(period.intervals))
    limits = {"stale_after": config.stale_after, "lost_after": period.session.tracker.config.lost_after}
    short = [f"{name} is {limit:g} s" for name, limit in limits.items() if limit < interval]
    if short:
        which = "both" if len(short) > 1 else "it"
        yield say("slow_for_stale_after", period=interval, limits=" and ".join(short), which=which)


def _identity(period: Period) -> Iterator[Raised]:
    """Yield that the followed or locked person may be somebody else."""
    if _is_guess(period):
        yield say("somebody_else")


def _is_guess(period: Period) -> bool:
    one, locked = period.session.roster.ids is None, period.session.roster.locked
    here = period.newest if period.tracked else ()
    return any(frame.guessed and (one or frame.person == locked) for frame in here)


def _numbers(period: Period) -> Iterator[Raised]:
    """Yield why the detector's person numbers are not used."""
    people = period.session.people
    if people.jumped_number is not None:
        yield say("numbers_jump", number=people.jumped_number)
    elif people.numbers_may_be_indices:
        yield say("numbers_index")


def _lock(period: Period) -> Iterator[Raised]:
    """Yield that nobody is followed because somebody is locked."""
    if (locked := period.session.roster.locked) is not None and not _is_guess(period):
        yield say("locked_forgotten") if locked == GONE else say("locked_absent", person=locked)


def _unused_lock(period: Period) -> Iterator[Raised]:
    if period.session.config.lock and period.session.config.topic_per_body:
        yield say("unused_lock")


def untrackable(period: Period) -> Iterator[Raised]:
    """Yield why nobody of several people whom the images show is tracked. Of a single person the rejections tell it."""
    session, recent = period.session, period.recent
    several = session.config.several_people and not session.config.topic_per_body
    if several and not period.tracked and recent[NOBODY] < recent["received"]:
        config = session.tracker.config
        yield say("untrackable", landmarks=config.min_landmarks, confidence=config.min_confidence)


def likely_wrong(period: Period) -> Iterator[Raised]:
    """Yield that poses of the period are likely wrong: by a sign, or most of them by their figures."""
    judged = [(person, pending.read()) for person, pending in period.judged]
    marked = [one for one in judged if one[1].doubt.likely_wrong]
    signs = [one for one in marked if one[1].doubt.has_sign]
    if signs or len(marked) > MOST_MARKED * period.tracked:
        person, judgement = (signs or marked)[-1]
        when = f"for the last {judgement.seconds:.1f} s"
        yield say("likely_wrong", whose=of_person(person), when=when, reasons=", ".join(judgement.reasons))


def of_person(person: str) -> str:
    """Return ' of p1'; empty if one person is followed."""
    return f" of {person}" if person else ""


def unseen(period: Period) -> Iterator[Raised]:
    """Yield for each person which limbs are guessed."""
    for frame in period.newest:
        if limbs := frame.doubt.unseen:
            yield say("unseen", of=frame.person, limbs=", ".join(limbs))


OF_INPUTS: tuple[Rule, ...] = (_cameras_fit, _fit, _turnover, _depth, _height, _clock, _inputs, _interval)
WHILE_TRACKING: tuple[Rule, ...] = (_identity, _numbers, _unused_lock)
WHILE_NOT_TRACKING: tuple[Rule, ...] = (_identity, _lock, _numbers, _unused_lock)
WAITING = "no_camera_info", "no_keypoints", "silent"
"""Keys of concerns beside which the node's own concern is said."""
