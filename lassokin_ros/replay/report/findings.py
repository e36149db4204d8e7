"""What is worth saying about a replay, in plain words: each rule looks at the facts and says a sentence, or nothing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from lassokin_ros.pipeline.camera import OUTSIDE_IMAGE
from lassokin_ros.replay.report.absences import NO_MESSAGE, NOBODY, Span
from lassokin_ros.replay.report.facts import Facts, landmark_errors
from lassokin_ros.replay.report.rejection_advice import advice_for, words_for

PROBLEM, NOTE, GOOD = "problem", "note", "good"

MOST_SPANS = 6
"""Lost spans that are told one by one."""
FEW = 0.02
"""Share of the messages below which refused ones are a note, no problem."""
SELDOM_HARMFUL = ("too_few_landmarks", "stamp_jump")
"""Of these a few are usual: somebody turns away, a clock is set."""
LARGE_ERROR = 3.5
"""Times noise_px: a median reprojection error above this has another cause than noise."""
SMALL_ERROR = 0.3
"""Times noise_px: below this, noise_px may be lowered."""
SLOW_HZ = 12.0
SELDOM = 0.5
"""A landmark that is seen in fewer frames than this is worth a word."""
NEAREST_M, FARTHEST_M = 0.6, 25.0
LONG_DELAY_S = 1.0
BONE_CHANGE = 0.02


@dataclass(frozen=True)
class Finding:
    """A sentence, and whether it is a problem, a note or good news."""

    level: str
    text: str


def findings(facts: Facts) -> list[Finding]:
    """Problems first; a good word when there are none."""
    found = [finding for rule in RULES for finding in rule(facts)]
    problems = [finding for finding in found if finding.level == PROBLEM]
    if not problems:
        share = len(facts.tracks) and facts.counts.get("accepted", 0) / max(facts.counts.get("received", 0), 1)
        problems = [Finding(GOOD, f"No problem was noticed: {share:.1%} of the frames were tracked and certified.")]
    return problems + [finding for finding in found if finding.level == NOTE]


def _nothing_tracked(facts: Facts) -> Iterator[Finding]:
    if not facts.log.messages:
        yield Finding(PROBLEM, f"The topic {facts.topics[0]} has no messages.")
    elif not facts.tracks:
        yield Finding(PROBLEM, f"Nothing was tracked: none of {len(facts.log.messages)} messages gave a skeleton.")


def _refused(facts: Facts) -> Iterator[Finding]:
    """'37 frames refused: too few landmarks: ...'."""
    received = max(facts.counts.get("received", 0), 1)
    for key, count in facts.rejected.items():
        reason, _, of_person = key.partition(" (")
        level = PROBLEM if count > FEW * received or reason not in SELDOM_HARMFUL else NOTE
        what = "frames of single people" if of_person else "camera_info messages" if _of_camera(reason) else "frames"
        detail = facts.log.details.get(reason, "")
        first = f" The first: {detail}{_stop(detail)}" if detail else ""
        advice = advice_for(reason)
        rest = f": {advice}" if advice else ""
        yield Finding(level, f"{count} {_counted(what, count)} refused: {words_for(reason)}{rest}{_stop(rest)}{first}")


def _of_camera(reason: str) -> bool:
    return reason.startswith("camera_")


def _counted(what: str, count: int) -> str:
    return what.replace("messages", "message").replace("frames", "frame") if count == 1 else what


def _stop(text: str) -> str:
    return "" if text.endswith("?") else "."


def _lost(facts: Facts) -> Iterator[Finding]:
    """'Nobody was tracked between 3.2 and 4.6 s ...'."""
    for person in facts.people:
        if not facts.accepted(person):
            continue
        lost = [span for span in facts.spans[person] if span.lost]
        who = person or "Nobody"
        level = NOTE if person else PROBLEM  # of several people some come and go
        for span in lost[:MOST_SPANS]:
            yield Finding(level, _lost_sentence(span, who, bool(person)))
        if len(lost) > MOST_SPANS:
            seconds = sum(span.seconds for span in lost[MOST_SPANS:])
            yield Finding(level, f"{len(lost) - MOST_SPANS} more such spans, {seconds:.1f} s in all.")


def _lost_sentence(span: Span, who: str, named: bool) -> str:
    seen = f"{who} was not seen" if named else f"{who} was seen"
    until = f"before {span.end:.1f} s" if span.at_start else f"between {span.start:.1f} and {span.end:.1f} s"
    return f"{seen} {until} ({span.seconds:.1f} s): {_listed(span.reasons)}."


def _listed(reasons: Counter[str]) -> str:
    if NO_MESSAGE in reasons:
        return "no keypoints came"
    plain = {NOBODY: "nobody in the message"}
    return ", ".join(f"{n} x {plain.get(key, words_for(key))}" for key, n in sorted(reasons.items())) or "others were"


def _gaps(facts: Facts) -> Iterator[Finding]:
    for person in facts.people:
        short = [span for span in facts.spans[person] if not span.lost]
        if short:
            seconds, longest = sum(s.seconds for s in short), max(s.seconds for s in short)
            who = f"{person}: " if person else ""
            yield Finding(
                NOTE,
                f"{who}{len(short)} short gap{'s' * (len(short) > 1)}, {seconds:.1f} s in all, the "
                f"longest {longest:.1f} s; the person was taken up again where they were.",
            )


def _reprojection(facts: Facts) -> Iterator[Finding]:
    errors = [row.reprojection_px for row in facts.tracks]
    if not errors:
        return
    median, noise = float(np.median(errors)), facts.tracker.noise_px
    if median > LARGE_ERROR * noise:
        yield Finding(
            PROBLEM,
            f"Reprojection {median:.1f} px median, with noise_px {noise:g}: check `noise_px`, "
            "camera_info (another resolution? `rectified`?) and `landmarks`.",
        )
    elif median < SMALL_ERROR * noise:
        yield Finding(
            NOTE,
            f"Reprojection {median:.2f} px median is far below noise_px {noise:g}: a smaller noise_px "
            "follows the image more closely.",
        )


def _landmarks(facts: Facts) -> Iterator[Finding]:
    middle, seen = landmark_errors(facts.tracks, len(facts.landmarks))
    if not facts.tracks:
        return
    seldom = [f"{facts.landmarks[i]} {seen[i]:.0%}" for i in np.flatnonzero(seen < SELDOM)]
    if seldom:
        yield Finding(NOTE, f"Seen in fewer than half of the frames: {', '.join(seldom)}.")
    usual = float(np.nanmedian(middle)) if np.isfinite(middle).any() else np.nan
    far = np.flatnonzero(np.nan_to_num(middle) > max(4 * usual, LARGE_ERROR * facts.tracker.noise_px))
    if len(far):
        listed = ", ".join(f"{facts.landmarks[i]} {middle[i]:.0f} px" for i in far)
        yield Finding(
            PROBLEM,
            f"Landmarks far from where the skeleton has them: {listed} (the others {usual:.0f} px): "
            "is `landmarks` your detector's layout?",
        )


def _stamps(facts: Facts) -> Iterator[Finding]:
    jumps = facts.log.jumps
    if jumps:
        first = jumps[0]
        more = f", and {len(jumps) - 1} times more" if len(jumps) > 1 else ""
        yield Finding(
            PROBLEM,
            f"Stamps are not monotonic: at {first.time:.1f} s they jump {'ahead' if first.ahead > 0 else 'back'} by "
            f"{abs(first.ahead):.1f} s{more} (a bag played in a loop, another clock?); everybody was forgotten "
            "there, and time goes on in this page.",
        )
    unstamped = facts.counts.get("unstamped", 0)
    if unstamped:
        yield Finding(
            PROBLEM, f"Messages without a stamp: {unstamped}. The time of recording stands for it, with its jitter."
        )
    delays = [m.delay for m in facts.log.messages if np.isfinite(m.delay)]
    if delays and abs(np.median(delays)) > LONG_DELAY_S:
        yield Finding(
            NOTE,
            f"Keypoints were recorded {np.median(delays):.1f} s after their stamps: another clock, or a slow detector.",
        )


def _outside(facts: Facts) -> Iterator[Finding]:
    outside, received = facts.counts.get(OUTSIDE_IMAGE, 0), facts.counts.get("received", 0)
    if outside > FEW * max(received, 1):
        yield Finding(
            PROBLEM,
            f"In {outside} of {received} messages keypoints lie outside the image of camera_info: are they pixels of "
            "the raw image, in its full size?",
        )


def _rate(facts: Facts) -> Iterator[Finding]:
    if 0 < facts.rate < SLOW_HZ and len(facts.log.messages) > 3:
        yield Finding(
            NOTE,
            f"Keypoints come at {facts.rate:.1f} Hz; between frames so far apart much can happen, 20 Hz or "
            "more track better.",
        )


def _repeated(facts: Facts) -> Iterator[Finding]:
    repeated, received = facts.counts.get("duplicated", 0), facts.counts.get("received", 0)
    if repeated > FEW * max(received, 1):
        yield Finding(
            NOTE,
            f"{repeated} of {received} messages repeat the keypoints before them: a detector slower than the camera, "
            "or an image that stands still.",
        )


def _found_anew(facts: Facts) -> Iterator[Finding]:
    for person in facts.people:
        times = [row.time for row in facts.accepted(person) if row.initialised]
        if len(times) > 1:
            who = person or "The person"
            listed = ", ".join(f"{time:.1f}" for time in times[1 : 1 + MOST_SPANS])
            more = " ..." if len(times) > 1 + MOST_SPANS else ""
            yield Finding(
                NOTE,
                f"{who} was found anew {_times(len(times) - 1)}, at {listed} s{more}; the skeleton may jump there.",
            )


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def _place(facts: Facts) -> Iterator[Finding]:
    depths = [float(row.positions[0, 2]) for row in facts.tracks if row.positions is not None]
    if not depths:
        return
    depth = float(np.median(depths))
    if not NEAREST_M < depth < FARTHEST_M:
        yield Finding(PROBLEM, f"The person is {depth:.2g} m away: check camera_info (K) and `height`.")


def _upside_down(facts: Facts) -> Iterator[Finding]:
    groups = [[i for i, name in enumerate(facts.landmarks) if part in name] for part in ("shoulder", "ankle")]
    seen = [row.detected for person in facts.people for row in facts.rows(person) if row.detected is not None]
    if not seen or not all(groups):
        return
    heights = [np.array(seen)[:, group, 1].mean(axis=1) for group in groups]
    both = np.isfinite(heights[0]) & np.isfinite(heights[1])
    if both.any() and np.mean(heights[0][both] > heights[1][both]) > 0.5:
        yield Finding(
            PROBLEM, "In the image the shoulders are below the ankles most of the time: is the image upside down?"
        )


def _people(facts: Facts) -> Iterator[Finding]:
    beyond = facts.counts.get("people beyond max_people", 0)
    if beyond:
        yield Finding(NOTE, f"More people were there than max_people {facts.node.max_people} in {beyond} messages.")


def _bones(facts: Facts) -> Iterator[Finding]:
    for person in facts.people:
        lengths = [row.lengths for row in facts.accepted(person) if row.lengths is not None]
        if not lengths:
            continue
        given = np.linalg.norm(facts.skeleton.offsets, axis=-1)
        change = np.where(given > 1e-6, lengths[-1] / np.maximum(given, 1e-6) - 1, 0.0)
        worst = int(np.argmax(np.abs(change)))
        if abs(change[worst]) > BONE_CHANGE:
            who = f"{person}: " if person else ""
            yield Finding(
                NOTE,
                f"{who}calibration changed the bones, most the one to {facts.skeleton.joint_names[worst]}: "
                f"{1e3 * given[worst]:.0f} mm given, {1e3 * lengths[-1][worst]:.0f} mm at the end.",
            )


RULES: tuple[Callable[[Facts], Iterator[Finding]], ...] = (
    _nothing_tracked,
    _refused,
    _lost,
    _stamps,
    _reprojection,
    _outside,
    _landmarks,
    _place,
    _upside_down,
    _gaps,
    _found_anew,
    _rate,
    _repeated,
    _people,
    _bones,
)
