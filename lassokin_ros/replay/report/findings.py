"""The findings at the top of the page: each rule checks the facts and yields sentences with a severity."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from lassokin_ros.pipeline.camera.camera_selection import OUTSIDE_IMAGE
from lassokin_ros.replay.report import doubt_findings, video_findings
from lassokin_ros.replay.report.absences import NO_MESSAGE, NOBODY, Span
from lassokin_ros.replay.report.facts import Facts, landmark_errors
from lassokin_ros.replay.report.finding import DOUBT, GOOD, MOST_LISTED, NOTE, PROBLEM, Finding, times_listed
from lassokin_ros.replay.report.log import PersonRow
from lassokin_ros.replay.report.rejection_advice import advice_for, reason_text

FEW = 0.02
"""Share of the messages below which rejections are a note instead of a problem."""
SELDOM_HARMFUL = ("too_few_landmarks", "stamp_jump")
"""Reasons of which a few are normal: a person turns away, a clock is set."""
LARGE_ERROR = 3.5
"""Multiple of noise_px: a larger median reprojection error has a cause other than noise."""
SMALL_ERROR = 0.3
"""Multiple of noise_px: below this, noise_px can be reduced."""
SLOW_HZ = 12.0
SELDOM = 0.5
"""Share of frames below which a landmark is reported as rarely detected."""
LONG_DELAY_S = 1.0


def findings(facts: Facts) -> list[Finding]:
    """Return the findings: problems, doubts, notes; a GOOD finding replaces problems and doubts if there are none."""
    rules = VIDEO_RULES if facts.own_keypoints else RULES
    found = [finding for rule in rules for finding in rule(facts)]
    serious = [finding for level in (PROBLEM, DOUBT) for finding in found if finding.level == level]
    notes = [finding for finding in found if finding.level == NOTE]
    return [*(serious or [_good(facts)]), *notes]


def _good(facts: Facts) -> Finding:
    """Return the finding of a recording without problems and doubts. It does not say that the pose is right."""
    share = facts.tracked / max(facts.received, 1)
    hidden = doubt_findings.hidden_limbs(facts)
    besides = f" The {_joined(list(hidden))} cannot be judged: hardly seen." if hidden else ""
    where = "outside of the marked spans " * (facts.wrong_share > 0)
    return Finding(GOOD, f"{share:.1%} of the frames were tracked, and {where}nothing suggests a wrong pose.{besides}")


def _joined(names: list[str]) -> str:
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))


def _nothing_tracked(facts: Facts) -> Iterator[Finding]:
    if not facts.log.messages:
        yield Finding(PROBLEM, f"The topic {facts.topics[0]} has no messages.")
    elif not facts.tracks:
        yield Finding(PROBLEM, f"Nothing was tracked: none of {len(facts.log.messages)} messages produced a skeleton.")


def _refused(facts: Facts) -> Iterator[Finding]:
    """Report rejections: '37 frames rejected: too few landmarks: ...'."""
    received = max(facts.received, 1)
    for key, count in facts.rejected.items():
        reason, _, of_person = key.partition(" (")
        level = PROBLEM if count > FEW * received or reason not in SELDOM_HARMFUL else NOTE
        what = "per-person frames" if of_person else "camera_info messages" if _of_camera(reason) else "frames"
        detail = facts.log.details.get(reason, "")
        first = f" First occurrence: {detail}." if detail else ""
        advice = advice_for(reason)
        rest = f": {advice}" if advice else ""
        text = f"{count} {_counted(what, count)} rejected: {reason_text(reason)}{rest}.{first}"
        yield Finding(level, text)


def _of_camera(reason: str) -> bool:
    return reason.startswith("camera_")


def _counted(what: str, count: int) -> str:
    return what.replace("messages", "message").replace("frames", "frame") if count == 1 else what


def _lost(facts: Facts) -> Iterator[Finding]:
    """Report lost spans: 'Nobody was tracked from 3.2 to 4.6 s ...'."""
    for person in facts.people:
        if not facts.accepted(person):
            continue
        lost = [span for span in facts.spans[person] if span.lost]
        level = NOTE if person else PROBLEM  # several people may enter and leave
        for span in lost[:MOST_LISTED]:
            yield Finding(level, _lost_sentence(span, person))
        if len(lost) > MOST_LISTED:
            seconds = sum(span.seconds for span in lost[MOST_LISTED:])
            yield Finding(level, f"{len(lost) - MOST_LISTED} more such spans, {seconds:.1f} s in total.")


def _lost_sentence(span: Span, person: str) -> str:
    subject = f"{person} was not tracked" if person else "Nobody was tracked"
    when = f"before {span.end:.1f} s" if span.at_start else f"from {span.start:.1f} to {span.end:.1f} s"
    return f"{subject} {when} ({span.seconds:.1f} s): {_listed(span.reasons)}."


def _listed(reasons: Counter[str]) -> str:
    if NO_MESSAGE in reasons:
        return NO_MESSAGE
    plain = {NOBODY: "nobody in the message"}
    listed = ", ".join(f"{n} x {plain.get(key, reason_text(key))}" for key, n in sorted(reasons.items()))
    return listed or "only other people in the messages"


def _gaps(facts: Facts) -> Iterator[Finding]:
    for person in facts.people:
        short = [span for span in facts.spans[person] if not span.lost and _is_between(span, facts.accepted(person))]
        if short:
            seconds, longest = sum(s.seconds for s in short), max(s.seconds for s in short)
            who = f"{person}: " if person else ""
            yield Finding(
                NOTE,
                f"{who}{len(short)} short gap{'s' * (len(short) > 1)}, {seconds:.1f} s in total, the "
                f"longest {longest:.1f} s; tracking continued from the previous pose.",
            )


def _is_between(span: Span, rows: Sequence[PersonRow]) -> bool:
    """Return whether a span is between two skeletons. rows: with a skeleton, in order of time."""
    return bool(rows) and rows[0].time <= span.start and span.end <= rows[-1].time


def _reprojection(facts: Facts) -> Iterator[Finding]:
    errors = [row.reprojection_px for row in facts.tracks]
    if not errors:
        return
    median, noise = float(np.median(errors)), facts.tracker.noise_px
    if median > LARGE_ERROR * noise:
        yield Finding(
            PROBLEM,
            f"The median reprojection error is {median:.1f} px, with noise_px {noise:g}: check `noise_px`, "
            "camera_info (resolution, `rectified`) and `landmarks`.",
        )
    elif median < SMALL_ERROR * noise:
        yield Finding(
            NOTE,
            f"The median reprojection error, {median:.2f} px, is far below noise_px {noise:g}: with a smaller "
            "noise_px the skeleton follows the image more closely.",
        )


def _landmarks(facts: Facts) -> Iterator[Finding]:
    middle, seen = landmark_errors(facts, facts.tracks)
    if not facts.tracks:
        return
    seldom = [f"{facts.landmarks[i]} {seen[i]:.0%}" for i in np.flatnonzero(seen < SELDOM)]
    if seldom:
        yield Finding(NOTE, f"Landmarks detected in fewer than half of the frames: {', '.join(seldom)}.")
    usual = float(np.nanmedian(middle)) if np.isfinite(middle).any() else np.nan
    far = np.flatnonzero(np.nan_to_num(middle) > max(4 * usual, LARGE_ERROR * facts.tracker.noise_px))
    if len(far):
        listed = ", ".join(f"{facts.landmarks[i]} {middle[i]:.0f} px" for i in far)
        yield Finding(
            PROBLEM,
            f"Landmarks far from their reprojection: {listed} (median of all: {usual:.0f} px): check that "
            "`landmarks` is the layout of your detector.",
        )


def _stamps(facts: Facts) -> Iterator[Finding]:
    jumps = facts.log.jumps
    if jumps:
        first = jumps[0]
        more = f", and {len(jumps) - 1} more times" if len(jumps) > 1 else ""
        yield Finding(
            PROBLEM,
            f"The stamps are not monotonic: at {first.time:.1f} s they jump {'ahead' if first.ahead > 0 else 'back'} "
            f"by {abs(first.ahead):.1f} s{more} (a looped bag, or a second clock?); tracking was reset there, and the "
            "time axis of this page continues.",
        )
    unstamped = facts.counts.get("unstamped", 0)
    if unstamped:
        yield Finding(
            PROBLEM, f"{unstamped} messages have no stamp; the recording time, with its jitter, is used instead."
        )
    delays = [m.delay for m in facts.log.messages if np.isfinite(m.delay)]
    if delays and abs(np.median(delays)) > LONG_DELAY_S:
        yield Finding(
            NOTE,
            f"The keypoints were recorded {np.median(delays):.1f} s after their stamps (median): different clocks, or "
            "a slow detector.",
        )


def _outside(facts: Facts) -> Iterator[Finding]:
    outside, received = facts.counts.get(OUTSIDE_IMAGE, 0), facts.counts.get("received", 0)
    if outside <= FEW * max(received, 1):
        return
    if _mostly_inside(facts):
        yield Finding(
            NOTE,
            f"In {outside} of {received} messages the person is partly outside of the image. If the whole person was "
            "in view, the keypoints are no pixels of the raw image at full resolution.",
        )
    else:
        yield Finding(
            PROBLEM,
            f"In {outside} of {received} messages keypoints lie outside the image of camera_info: check that they are "
            "pixels of the raw image at full resolution.",
        )


def _mostly_inside(facts: Facts) -> bool:
    """Return whether more than half of the keypoints of the usual message are in the image."""
    seen = [row.detected for person in facts.people for row in facts.rows(person) if row.detected is not None]
    if not seen or facts.image_size is None:
        return False
    points = np.array(seen)
    inside = ((points >= 0) & (points <= facts.image_size)).all(axis=-1).sum(axis=1)
    known = np.isfinite(points[..., 0]).sum(axis=1)
    return bool(np.median(inside / np.maximum(known, 1)) > 0.5)


def _rate(facts: Facts) -> Iterator[Finding]:
    if 0 < facts.rate < SLOW_HZ and len(facts.log.messages) > 3:
        yield Finding(
            NOTE,
            f"The keypoint rate is {facts.rate:.1f} Hz; 20 Hz or more gives better tracking.",
        )


def _repeated(facts: Facts) -> Iterator[Finding]:
    repeated, received = facts.counts.get("duplicated", 0), facts.received
    if repeated > FEW * max(received, 1):
        what, why = "messages repeat the previous keypoints", "the detector is slower than the camera"
        if facts.own_keypoints:
            what, why = "images have the keypoints of the one before", "the file has images twice"
        yield Finding(NOTE, f"{repeated} of {received} {what}: {why}, or the image is frozen.")


def _reinitialised(facts: Facts) -> Iterator[Finding]:
    for person in facts.people:
        times = [row.time for row in facts.accepted(person) if row.initialised]
        if len(times) > 1:
            who = person or "The person"
            yield Finding(
                NOTE,
                f"{who} was re-initialised {_times(len(times) - 1)}, at {times_listed(times[1:])}; the skeleton may "
                "jump there.",
            )


def _times(count: int) -> str:
    return {1: "once", 2: "twice"}.get(count, f"{count} times")


def _place(facts: Facts) -> Iterator[Finding]:
    depth = video_findings.unlikely_distance(facts)
    if depth is not None:
        text = f"The median distance of the person is {depth:.2g} m: check camera_info (K) and `height`."
        yield Finding(PROBLEM, text)


def _upside_down(facts: Facts) -> Iterator[Finding]:
    if video_findings.heads_below(facts):
        yield Finding(
            PROBLEM,
            "The shoulders are below the ankles in most images: check whether the image is upside down, or y is "
            "counted from the bottom.",
        )


def _people(facts: Facts) -> Iterator[Finding]:
    beyond = facts.counts.get("people beyond max_people", 0)
    if beyond:
        what = "images" if facts.own_keypoints else "messages"
        yield Finding(NOTE, f"{beyond} {what} contain more people than max_people {facts.node.max_people}.")


Rule = Callable[[Facts], Iterator[Finding]]
RULES: tuple[Rule, ...] = (
    _nothing_tracked,
    _refused,
    _lost,
    _stamps,
    _reprojection,
    _outside,
    _landmarks,
    _place,
    _upside_down,
    doubt_findings.likely_wrong,
    doubt_findings.bent_knees,
    doubt_findings.unseen_limbs,
    _gaps,
    _reinitialised,
    _rate,
    _repeated,
    _people,
    doubt_findings.bones,
    doubt_findings.uncertain,
)
"""For recorded keypoints."""
VIDEO_RULES: tuple[Rule, ...] = (
    video_findings.nothing_tracked,
    video_findings.reprojection,
    video_findings.place,
    video_findings.upside_down,
    video_findings.absences,
    doubt_findings.likely_wrong,
    doubt_findings.bent_knees,
    doubt_findings.unseen_limbs,
    video_findings.outside,
    _gaps,
    _reinitialised,
    _rate,
    _repeated,
    _people,
    doubt_findings.bones,
    doubt_findings.uncertain,
)
"""For a video whose keypoints this program detected."""
