"""The concerns of one period of a running tracker: each rule yields those that it finds."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from lassokin_ros.core.learned.height import LARGEST_FLOOR_DEVIATION
from lassokin_ros.core.observation import Rejection
from lassokin_ros.pipeline.camera.camera_selection import OUTSIDE_IMAGE
from lassokin_ros.pipeline.camera.placement import JUMPS
from lassokin_ros.pipeline.camera_images import DEPTH_IN_MESSAGE, NOBODY, UNSCORED
from lassokin_ros.pipeline.concerns.catalogue import Raised, say
from lassokin_ros.pipeline.concerns.period import INTERVALS, Period
from lassokin_ros.pipeline.concerns.rejections import advice_for
from lassokin_ros.pipeline.depth.depth_images import MATCHED, RECEIVED, UNMATCHED
from lassokin_ros.pipeline.frame_result import repeated_s
from lassokin_ros.pipeline.input_checks.hands import EXCHANGED, FAR, ORDER, SAME
from lassokin_ros.pipeline.input_checks.messages import FROZEN_S
from lassokin_ros.pipeline.keypoint_queue import LOST, OVERTAKEN
from lassokin_ros.pipeline.people.roster import GONE
from lassokin_ros.pipeline.people.tracked_person import FROZEN
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import MESSAGE

SILENCE_S = 2.0
"""s: a longer period without keypoints is a warning."""
FUTURE_S, LATE_S, LATEST_S, PAST_S = 1.0, 0.5, 60.0, 3600.0
"""s: stamps that lie further in the future are of another clock. Keypoints that are older than the second when they
arrive are late; older than the third, they are probably of a recording, and older than the last of another clock."""
APART_S = 0.06
"""s: difference of the delays of two cameras that is a warning. Prediction over it costs a quarter of the accuracy."""
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


def blocked(period: Period, now: float, tracking: bool) -> Iterator[Raised]:
    """Yield why nothing can be tracked, the most important reason first. now: s, steady clock."""
    session, places = period.session, period.session.placement.places
    if not session.enabled:
        yield say("disabled")
    refused = []
    for name, camera in session.cameras.items():
        if fault := camera.camera.fault:
            kept = "" if camera.camera.view is None else "; the last good one is used"
            refused.append(say("camera_refused", of=_named(name), fault=fault, kept=kept))
    if refused:
        yield refused[0]._replace(text="; ".join(raised.text for raised in refused))
    if places is not None and period.sending and places.faults.keys() >= set(period.sending):
        yield say("no_usable_image", fault=places.fault)
    if not session.inputs.has_camera:
        yield say("no_camera_info")
    elif not (session.config.silent_when_empty and session.scene.detector_connected):
        if period.keypoints_at is None:
            yield say("no_keypoints")
        elif now - period.keypoints_at > SILENCE_S:
            yield say("silent", limit=SILENCE_S)
    refusals = period.recent[f"rejected: {FROZEN}"] + period.recent[f"rejected: {FROZEN} (a person)"]
    if repeated_s(period.last) > FROZEN_S or (refusals and not tracking):
        yield say("frozen", limit=FROZEN_S)


def found(period: Period, now: float, tracking: bool, direction: Raised | None) -> Iterator[Raised]:
    """Yield the concerns in the order in which they are said. direction: that of the bodies. now: s, steady clock."""
    unused = list(_rejections(period))
    yield from unused
    for rule in OF_INPUTS:
        yield from rule(period)
    yield from _identity(period, tracking)
    if direction is not None:
        yield direction
    if not tracking and not unused:
        yield from _untrackable(period)
    yield from of_cameras(period, now)
    yield from _likely_wrong(period)
    if tracking:
        for frame in period.newest:
            if limbs := frame.doubt.unseen:
                yield say("unseen", of=frame.person, limbs=", ".join(limbs))


def _named(camera: str) -> str:
    return f"camera '{camera}'" if camera else ""


def _rejections(period: Period) -> Iterator[Raised]:
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
    recent = period.recent
    for name, camera in period.session.cameras.items():
        if warning := camera.camera.warning:
            yield say("camera_unlikely", of=_named(name), fault=warning)
        view = camera.camera.view
        if view is not None and 2 * recent[camera.key(OUTSIDE_IMAGE)] > recent[camera.key("received")]:
            yield say("outside", of=_named(name), width=view.size[0], height=view.size[1], when="")


def _fit(period: Period) -> Iterator[Raised]:
    if period.misfits and float(np.median(period.misfits)) >= NO_BODY:
        tracker = period.session.tracker
        yield say("no_body", distance=NO_BODY * tracker.skeleton.height, landmarks=tracker.config.landmarks)


def _turnover(period: Period) -> Iterator[Raised]:
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
    if recent[DEPTH_IN_MESSAGE] and unused or session.first.depth is None:
        return
    faults, unmatched, frozen = [], [], False
    for name, camera in session.cameras.items():
        if camera.depth is None:
            continue
        frozen = frozen or camera.depth.frozen  # `_inputs` says it
        if recent[camera.key(RECEIVED)] == 0:
            faults.append(say("no_depth_images", of=_named(name), topic=session.config.depth_topic(name)))
        elif fault := camera.depth.fault or camera.depth.check.fault:
            faults.append(say("depth_unused", of=_named(name), fault=fault))
        if recent[camera.key(UNMATCHED)] > recent[camera.key(MATCHED)]:
            unmatched.append(say("depth_unmatched", of=_named(name)))
    if faults or frozen:
        yield from faults
    elif unmatched:
        yield from unmatched
    elif recent[MATCHED] and unused:
        yield say("depth_not_near")


def _height(period: Period) -> Iterator[Raised]:
    """Yield that the height is assumed, or that measured depth contradicts it."""
    session, config = period.session, period.session.tracker.config
    if config.height > 0:
        checks = [tracker.learned.size_check for tracker in session.roster.trackers.values()]
        if (wrong := next((check for check in checks if check.wrong), None)) is not None:
            source, check = "measured depth does", "that camera_info is of their camera"
            if session.config.several_cameras:
                source, check = "limbs before several cameras do", "the places of the cameras"
            elif session.counts[session.first.key(MATCHED)] == 0 and session.tracker.floor is not None:
                source, check = "feet on the floor do", "the height and the tilt of the camera"
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
    for name, camera in session.cameras.items():
        for check in (camera.stamps.rate, camera.image_size, camera.own_depth, camera.landmark_ids):
            if (raised := check.concern) is not None:
                yield raised._replace(text=f"{_named(name)}: {raised.text}") if name else raised
        if camera.depth is not None and camera.depth.frozen:
            yield say("depth_frozen", topic=session.config.depth_topic(name), limit=FROZEN_S)
    for name, camera in session.cameras.items():
        of_keypoints, view = camera.last[1], camera.camera.view
        own = view.intrinsics.frame_id if view is not None and session.scene.image is not None else ""
        if of_keypoints and own and of_keypoints != own:
            topic = f"{name}/camera_info" if name else "camera_info"
            yield say("other_camera", topic=topic, camera=own[:40], keypoints=of_keypoints[:40])
            break
    for key, count in HANDS.items():
        if recent[count] > UNUSUAL_HANDS * recent["received"]:
            yield say(key)
    if recent[UNSCORED] and recent[UNSCORED] >= recent["received"]:
        yield say("unscored")
    if recent[JUMPS]:
        cameras, frame = "cameras have" if len(session.cameras) > 1 else "camera has", session.config.fixed_frame
        yield say("frame_jumped", cameras=cameras, frame=frame, step=session.placement.jumps.words)


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


def _identity(period: Period, tracking: bool) -> Iterator[Raised]:
    """Yield that somebody else may be followed or locked, or nobody is because of the lock; and unused numbers."""
    session, people = period.session, period.session.people
    one, locked = session.roster.ids is None, session.roster.locked
    here = period.newest if period.tracked else ()
    if any(frame.guessed and (one or frame.person == locked) for frame in here):
        yield say("somebody_else")
    elif locked is not None and not tracking:
        yield say("locked_forgotten") if locked == GONE else say("locked_absent", person=locked)
    if people.jumped_number is not None:
        yield say("numbers_jump", number=people.jumped_number)
    elif people.numbers_may_be_indices:
        yield say("numbers_index")
    if session.config.lock and session.config.topic_per_body:
        yield say("unused_lock")


OF_INPUTS: tuple[Rule, ...] = (_cameras_fit, _fit, _turnover, _depth, _height, _clock, _inputs, _interval)


def _untrackable(period: Period) -> Iterator[Raised]:
    """Yield why nobody of several people whom the images show is tracked. Of a single person the rejections tell it."""
    session, recent = period.session, period.recent
    several = session.config.several_people and not session.config.topic_per_body
    if several and not period.tracked and recent[NOBODY] < recent["received"]:
        config = session.tracker.config
        yield say("untrackable", landmarks=config.min_landmarks, confidence=config.min_confidence)


def _likely_wrong(period: Period) -> Iterator[Raised]:
    """Yield that poses of the period are likely wrong: by a sign, or most of them by their figures."""
    judged = [(person, pending.read()) for person, pending in period.judged]
    marked = [one for one in judged if one[1].doubt.likely_wrong]
    signs = [one for one in marked if one[1].doubt.has_sign]
    if signs or len(marked) > MOST_MARKED * period.tracked:
        person, judgement = (signs or marked)[-1]
        when = f"for the last {judgement.seconds:.1f} s"
        yield say("likely_wrong", of=person, when=when, reasons=", ".join(judgement.reasons))


def of_cameras(period: Period, now: float) -> Iterator[Raised]:
    """Yield what is wrong with several cameras, or with one in a fixed frame. now: s, steady clock."""
    session, placement = period.session, period.session.placement
    if placement.places is None:
        return
    for fault in placement.places.faults.values():
        yield say("camera_unplaced", fault=fault)
    for name in session.cameras:
        if placement.tf_offset is not None and (offset := placement.tf_offset.clear(name)):
            seconds, deviation = offset
            which, way = f" '{name}'" if name else "", "late" if seconds > 0 else "early"
            yield say("tf_clock", camera=which, ms=1e3 * abs(seconds), deviation=1e3 * deviation, way=way)
    if len(session.cameras) == 1:
        return
    if shared := placement.places.shared_frame:
        yield say("cameras_share_frame", fault=shared)
    empty = session.config.silent_when_empty and session.scene.detector_connected
    for name, camera in session.cameras.items():
        if camera.camera.view is None:
            yield say("camera_without_info", camera=name)
        elif not empty and period.silent_s(name, now) > SILENCE_S:
            yield say("camera_silent", camera=name, limit=SILENCE_S)
    delays = {n: delay_s for n in period.sending if (delay_s := session.cameras[n].stamps.delay_s) is not None}
    first, last = min(delays, key=delays.__getitem__, default=""), max(delays, key=delays.__getitem__, default="")
    if delays and (apart := delays[last] - delays[first]) > APART_S:
        yield say("camera_late", last=last, first=first, apart=apart)
    for fault in placement.rig.clocks:
        yield say("camera_clock", fault=fault)
    yield from wrong_cameras(session)


def wrong_cameras(session: Session, learned: bool = True) -> Iterator[Raised]:
    """Yield which cameras are wrong, as the person shows: they contradict the others, or their poses are off.

    learned: also yield poses whose error is small enough to be learned, unless the set-up is wrong.
    """
    agreement, extrinsics = session.placement.agreement, session.roster.extrinsics
    same = list(agreement.same_keypoints())
    words = [*agreement.left_out.values(), *(same or session.placement.rig.set_up)]
    if learned and not words and extrinsics is not None:
        lately = extrinsics.lately.in_words
        words = [lately] if lately else list(filter(None, map(extrinsics.in_words, session.cameras)))
    return (say("camera_wrong", fault=fault) for fault in words)
