"""The findings at the top of the page: each rule checks the facts of a whole recording and yields concerns."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from lassokin_ros.doubt.monitor import LIMBS
from lassokin_ros.pipeline.camera.camera_selection import OUTSIDE_IMAGE
from lassokin_ros.pipeline.concerns.catalogue import DOUBT, NOTE, PROBLEM, Raised, Seen, say
from lassokin_ros.pipeline.concerns.rejections import advice_for, reason_text
from lassokin_ros.replay.frames import DETECTED, OUTLINE
from lassokin_ros.replay.report.facts import Facts, bends, bone_changes, landmark_errors
from lassokin_ros.replay.spans import NO_MESSAGE, NOBODY, Span, marked

MOST_LISTED = 6
"""Maximum number of spans or times that a finding lists."""
MOST_MARKED = 0.25
"""Share of the frames that may be marked by their figures alone before it is a doubt about the whole."""
BENT_DEG, BENT_SHARE, LEAST_BENT_S = 18.0, 0.8, 1.0
"""Bend of the straighter knee, and share of the frames in which it is larger, for this time at least. One leg of people
who stand or walk is nearly straight at any time."""
UPRIGHT_DEG = 25.0
"""Lean of the trunk up to which a person is upright; who leans further may well bend the knees."""
UNSEEN = 0.5
"""Share of the frames below which a limb's joints are observed for it to be reported as not seen."""
UNLIKELY_CHANGE = 0.25
"""Relative change of a bone's length from which it is hardly a person's."""
UNCERTAIN_MM = 60.0
"""Mean stated deviation from which it is reported."""


def likely_wrong(facts: Facts) -> Iterator[Raised]:
    """Report the spans: 'The pose is likely wrong from 0.7 to 1.7 s: the pelvis jumps in depth.'."""
    for person in facts.people:
        signs = [span for span in facts.wrong[person] if span.certain_sign]
        for span in signs[:MOST_LISTED]:
            when, reasons = f"from {span.start:.1f} to {span.end:.1f} s", ", ".join(span.reasons)
            yield say("likely_wrong", of=person, when=when, reasons=reasons)
        if rest := signs[MOST_LISTED:]:
            yield say("more_spans", level=DOUBT, count=len(rest), seconds=sum(one.end - one.start for one in rest))
        if weak := [span for span in facts.wrong[person] if not span.certain_sign]:
            share = marked(facts.of("time", person), weak).mean()
            yield say("by_figures", of=person, level=DOUBT if facts.wrong_share > MOST_MARKED else NOTE, share=share)


def unseen_limbs(facts: Facts) -> Iterator[Raised]:
    """Report limbs that the keypoints do not show, whose pose is a guess."""
    if hidden := hidden_limbs(facts):
        limbs = ", ".join(f"{limb} (seen in {share:.0%} of the frames)" for limb, share in hidden.items())
        yield say("unseen", limbs=limbs)


def hidden_limbs(facts: Facts) -> dict[str, float]:
    """Return the limbs that are observed in fewer than `UNSEEN` of the frames, with that share."""
    if not facts.skeletons:
        return {}
    share = dict(zip(facts.skeleton.joint_names, facts.of("joint_observed").mean(axis=0)))
    limbs = {limb: [share[joint] for joint in joints if joint in share] for limb, joints in LIMBS.items()}
    return {limb: float(min(seen)) for limb, seen in limbs.items() if seen and min(seen) < UNSEEN}


def bent_knees(facts: Facts) -> Iterator[Raised]:
    """Report knees that stay bent: people who stand are shown sitting if their proportions differ."""
    names = facts.skeleton.joint_names
    legs = [joint for limb in ("left leg", "right leg") for joint in LIMBS[limb]]
    if not set(legs) <= set(names):
        return
    places, knees = [names.index(joint) for joint in legs], [names.index("left_knee"), names.index("right_knee")]
    for person in facts.people:
        judged = facts.of("joint_observed", person)[:, places].all(axis=1)
        judged &= _lean_deg(facts.of("joint_positions", person), facts) < UPRIGHT_DEG
        if judged.sum() <= LEAST_BENT_S * facts.rate or judged.mean() < UNSEEN:
            continue
        straighter = bends(facts.of("joint_rotations", person)[judged][:, knees]).min(axis=1)
        if np.mean(straighter > BENT_DEG) > BENT_SHARE:
            yield say("bent_knees", of=person, degrees=np.median(straighter))


def _lean_deg(positions: np.ndarray, facts: Facts) -> np.ndarray:
    """Return (f,) the angle between the trunk and the vertical; 0 for a skeleton without a neck."""
    names = facts.skeleton.joint_names
    if "neck" not in names:
        return np.zeros(len(positions))
    trunk = positions[:, names.index("neck")] - positions[:, 0]
    rise = -(trunk @ facts.level[1]) / np.maximum(np.linalg.norm(trunk, axis=1), 1e-9)
    return np.degrees(np.arccos(np.clip(rise, -1.0, 1.0)))


def bones(facts: Facts) -> Iterator[Raised]:
    """Report a bone that calibration changed by more than people differ. The page has a table of all changes."""
    for person in facts.people:
        changes = bone_changes(facts, [person])
        _, joint, length, change = max(changes, key=lambda bone: abs(bone[3]), default=("", "", 0.0, 0.0))
        if abs(change) > UNLIKELY_CHANGE:
            yield say("bones", of=person, joint=joint, before=length / (1 + change), after=length)


def uncertain(facts: Facts) -> Iterator[Raised]:
    """Report how far off the joints may be: 'The joints are off by about 80 mm ...'."""
    if facts.skeletons:
        deviations = 1e3 * np.median(facts.of("joint_deviations"), axis=0)
        if (mean := float(deviations[1:].mean())) > UNCERTAIN_MM:
            yield say("uncertain", millimetres=mean)


FEW = 0.02
"""Share of the messages below which rejections are a note instead of a problem."""
SELDOM_HARMFUL = ("too_few_landmarks", "stamp_jump")
"""Reasons of which a few are normal: a person turns away, a clock is set."""
ABSENT = (NOBODY, "too_few_landmarks", "person_absent")
"""Reasons that say that this program's own detector found nobody."""
LARGE_ERROR = 3.5
"""Multiple of noise_px: a larger median reprojection error has a cause other than noise."""
LARGE_SHARE = 0.03
"""Median reprojection error, as a share of the person's size in the image, from which it is reported."""
SELDOM, SHORT_S = 0.35, 1.0
"""Share of the images with a skeleton, and s without a break, below which the detector probably sees no person."""
NEAREST_M, FARTHEST_M = 0.6, 25.0
SLOW_HZ = 12.0


def findings(facts: Facts, warnings: Sequence[Raised] = ()) -> list[Raised]:
    """Return problems, doubts and notes, in this order; a GOOD finding replaces problems and doubts if there are none.

    warnings: those of the diagnostics during the replay. Where a rule about the whole recording has the same concern,
    the rule counts.
    """
    rules = VIDEO_RULES if facts.own_keypoints else RULES
    found = [raised for rule in rules for raised in rule(facts)]
    known = {raised.key for raised in found} | ({"outside"} if any(r.key == "partly_outside" for r in found) else set())
    found += [raised for raised in warnings if Seen.REPLAY in raised.seen and raised.key not in known]
    serious = [raised for level in (PROBLEM, DOUBT) for raised in found if raised.level == level]
    return [*(serious or [_good(facts)]), *(raised for raised in found if raised.level == NOTE)]


def _good(facts: Facts) -> Raised:
    """Return the finding of a recording without problems and doubts. It does not say that the pose is right."""
    names = list(hidden_limbs(facts))
    listed = " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))
    unjudged = f". The {listed} cannot be judged: hardly seen" if names else ""
    where = "outside of the marked spans " * (facts.wrong_share > 0)
    share = facts.tracked / max(facts.received, 1)
    return say("tracked", share=share, where=where, unjudged=unjudged)


def _nothing_tracked(facts: Facts) -> Iterator[Raised]:
    count = len(facts.table.messages)
    if facts.own_keypoints:
        yield from [] if facts.skeletons else [say("nobody_found", count=count)]
    elif not count:
        yield say("nothing_received", topic=facts.topics[0])
    elif not facts.skeletons:
        yield say("nothing_tracked", count=count)


def _probably_nobody(facts: Facts) -> Iterator[Raised]:
    """Report skeletons in a few images, never for long: a detector finds people in patterns."""
    shown = np.array([message.people > 0 for message in facts.table.messages], dtype=int)
    if facts.node.several_people or not shown.any() or shown.mean() > SELDOM:
        return
    edges = np.flatnonzero(np.diff(np.concatenate([[0], shown, [0]])))
    times = np.append(facts.times, facts.duration)
    longest = max(float(times[end] - times[begin]) for begin, end in zip(edges[::2], edges[1::2]))
    if len(edges) > 2 and longest < SHORT_S:
        yield say("probably_nobody", share=shown.mean(), longest=longest)


def _refused(facts: Facts) -> Iterator[Raised]:
    """Report rejections: '37 frames rejected: too few landmarks: ...'."""
    for key, count in facts.rejected.items():
        reason, _, of_person = key.partition(" (")
        level = PROBLEM if count > FEW * max(facts.received, 1) or reason not in SELDOM_HARMFUL else NOTE
        what = "per-person frame" if of_person else "camera_info message" if reason.startswith("camera_") else "frame"
        remedy, detail = advice_for(reason), facts.table.details.get(reason, "")
        if detail := detail.removesuffix(f": {remedy}"):
            remedy += f". First occurrence: {detail}"
        what += "s" * (count > 1)
        yield say("refused", level=level, count=count, what=what, name=reason_text(reason), remedy=remedy)


def _untracked(facts: Facts) -> Iterator[Raised]:
    """Report lost spans: 'Nobody was tracked from 3.2 to 4.6 s ...'."""
    for person in facts.people:
        if not len(facts.of("time", person)):
            continue
        level = NOTE if person or facts.own_keypoints else PROBLEM  # people may enter and leave
        lost = [span for span in facts.spans[person] if span.lost]
        for span in lost[:MOST_LISTED]:
            when = f"before {span.end:.1f} s" if span.at_start else f"from {span.start:.1f} to {span.end:.1f} s"
            who = f"{person} was not" if person else "Nobody was"
            reasons = _reasons(span, facts.own_keypoints)
            if reasons:
                when += "" if facts.own_keypoints else f" ({span.seconds:.1f} s)"
                yield say("untracked", level=level, who=who, when=when, reasons=reasons)
            else:
                yield say("absent", who=who, when=when)
        if rest := lost[MOST_LISTED:]:
            yield say("more_spans", level=level, count=len(rest), seconds=sum(span.seconds for span in rest))


def _reasons(span: Span, own_keypoints: bool) -> str:
    """Return why nobody was tracked; empty if nobody was in view, as far as this program's own detector tells."""
    reasons: Counter[str] = span.reasons
    if own_keypoints:
        others = [key for key in sorted(reasons) if key not in ABSENT]
        return ", ".join("the file has no images there" if key == NO_MESSAGE else reason_text(key) for key in others)
    if NO_MESSAGE in reasons:
        return NO_MESSAGE
    plain = {NOBODY: "nobody in the message"}
    listed = ", ".join(f"{n} x {plain.get(key, reason_text(key))}" for key, n in sorted(reasons.items()))
    return listed or "only other people in the messages"


def _gaps(facts: Facts) -> Iterator[Raised]:
    for person in facts.people:
        times = facts.of("time", person)
        first, last = (times[0], times[-1]) if len(times) else (np.inf, -np.inf)
        short = [span for span in facts.spans[person] if not span.lost and first <= span.start <= span.end <= last]
        if seconds := [span.seconds for span in short]:
            count = f"{len(short)} short gap{'s' * (len(short) > 1)}"
            yield say("gaps", of=person, count=count, seconds=sum(seconds), longest=max(seconds))


def _reprojection(facts: Facts) -> Iterator[Raised]:
    median, noise = facts.median("reprojection_px"), facts.tracker.noise_px
    if median > LARGE_ERROR * noise:
        yield say("reprojection", median=median, noise=noise)


def _poor_fit(facts: Facts) -> Iterator[Raised]:
    """Report a skeleton that does not lie on the person in the image."""
    outline, errors = facts.of(OUTLINE), facts.of("reprojection_px")
    known = np.isfinite(outline).all(axis=(1, 2))
    sizes = np.linalg.norm(np.ptp(outline[known], axis=1), axis=1)
    shares = errors[known] / np.maximum(sizes, 1.0)
    if len(shares) and np.median(shares) > LARGE_SHARE:
        yield say("poor_fit", median=np.median(errors[known]), share=np.median(shares))


def _landmarks(facts: Facts) -> Iterator[Raised]:
    middle, _ = landmark_errors(facts)
    usual = float(np.nanmedian(middle)) if np.isfinite(middle).any() else np.nan
    far = np.flatnonzero(np.nan_to_num(middle) > max(4 * usual, LARGE_ERROR * facts.tracker.noise_px))
    if len(far):
        listed = ", ".join(f"{facts.landmarks[i]} {middle[i]:.0f} px" for i in far)
        yield say("far_landmarks", listed=listed, usual=usual)


def _stamps(facts: Facts) -> Iterator[Raised]:
    if jumps := facts.table.jumps:
        first, others = jumps[0], len(jumps) - 1
        way, more = "ahead" if first.ahead > 0 else "back", f", and {others} more times" if others else ""
        yield say("stamps_jump", time=first.time, way=way, seconds=abs(first.ahead), more=more)
    if unstamped := facts.counts.get("unstamped", 0):
        yield say("unstamped", count=f" ({unstamped} messages)")


def _outside(facts: Facts) -> Iterator[Raised]:
    outside, received = facts.counts.get(OUTSIDE_IMAGE, 0), max(facts.counts.get("received", 0), 1)
    if outside <= FEW * received:
        return
    if facts.own_keypoints or _mostly_inside(facts):
        yield say("partly_outside", share=outside / received)
    else:
        width, height = facts.image_size or (0, 0)
        yield say("outside", width=width, height=height, when=f" in {outside} of {received} messages")


def _mostly_inside(facts: Facts) -> bool:
    """Return whether more than half of the keypoints of the usual message are in the image."""
    points = _detected(facts)
    if not len(points) or facts.image_size is None:
        return False
    inside = ((points >= 0) & (points <= facts.image_size)).all(axis=-1).sum(axis=1)
    known = np.isfinite(points[..., 0]).sum(axis=1)
    return bool(np.median(inside / np.maximum(known, 1)) > 0.5)


def _detected(facts: Facts) -> np.ndarray:
    """Return (k, l, 2) px, the landmarks in the images of the first camera that have any, also of rejected frames."""
    points = facts.rows(DETECTED)
    return points[np.isfinite(points).any(axis=(1, 2))]


def _messages(facts: Facts) -> Iterator[Raised]:
    """Report a slow detector, and messages that repeat the keypoints or have too many people."""
    if 0 < facts.rate < SLOW_HZ and len(facts.table.messages) > 3:
        yield say("slow", rate=facts.rate)
    repeated, received = facts.counts.get("duplicated", 0), facts.received
    if repeated > FEW * max(received, 1):
        what, why = "messages repeat the previous keypoints", "the detector is slower than the camera"
        if facts.own_keypoints:
            what, why = "images have the keypoints of the one before", "the file has images twice"
        yield say("repeated", count=repeated, received=received, what=what, why=why)
    if count := facts.counts.get("people beyond max_people", 0):
        what = "images" if facts.own_keypoints else "messages"
        yield say("too_many", count=count, what=what, most=facts.node.max_people)


def _initialised_again(facts: Facts) -> Iterator[Raised]:
    for person in facts.people:
        again = facts.of("time", person)[facts.of("initialised", person)].tolist()[1:]
        if again:
            times = {1: "once", 2: "twice"}.get(len(again), f"{len(again)} times")
            yield say("initialised_again", who=person or "The person", times=times, listed=_listed(again))


def _listed(times: list[float]) -> str:
    """Return '1.2, 3.4 and 5.6 s', shortened if there are many."""
    shown = [f"{time:.1f}" for time in times[:MOST_LISTED]]
    if len(times) > MOST_LISTED:
        return f"{', '.join(shown)} s and {len(times) - MOST_LISTED} more times"
    return " and ".join(filter(None, (", ".join(shown[:-1]), shown[-1]))) + " s"


def distance(facts: Facts) -> Iterator[Raised]:
    """Report a median distance of the pelvis at which no person is seen."""
    metres = facts.median("depth")
    if not facts.skeletons or NEAREST_M < metres < FARTHEST_M:
        return
    what = "camera_info (K) and `height`"
    if facts.own_keypoints:
        what = "the field of view (`--fov` or `--camera-info`) and `--height`"
        if len(facts.sizes) > 1:
            what = (
                "`--cameras` (translations are m, each video is that of its camera) or, without it, `--fov` and "
                "`--height`"
            )
    yield say("distance", metres=metres, what=what)


def _upside_down(facts: Facts) -> Iterator[Raised]:
    """Report shoulders below hips below ankles in most images that show them: not people who lie, or bridge.

    In a video, people may stand on the hands.
    """
    parts = ("shoulder", "hip", "ankle")
    groups = [[i for i, name in enumerate(facts.landmarks) if part in name] for part in parts]
    seen = _detected(facts)
    if not len(seen) or not all(groups):
        return
    places = [seen[:, group].mean(axis=1) for group in groups]
    known = np.isfinite(places).all(axis=(0, 2))
    shoulders, hips, ankles = (place[known] for place in places)
    down = (shoulders[:, 1] > hips[:, 1]) & (hips[:, 1] > ankles[:, 1])
    down &= shoulders[:, 1] - ankles[:, 1] > np.abs(shoulders[:, 0] - ankles[:, 0])
    if known.any() and down.mean() > 0.5:
        yield say("upside_down", level=NOTE if facts.own_keypoints else PROBLEM, when="in most images")


Rule = Callable[[Facts], Iterator[Raised]]
OF_INPUTS: tuple[Rule, ...] = (_refused, _untracked, _stamps, _reprojection, _outside, _landmarks)
OF_POSES: tuple[Rule, ...] = (distance, _upside_down, likely_wrong, bent_knees, unseen_limbs)
OF_TRACKS: tuple[Rule, ...] = (_gaps, _initialised_again, _messages, bones, uncertain)
RULES: tuple[Rule, ...] = (_nothing_tracked, *OF_INPUTS, *OF_POSES, *OF_TRACKS)
"""For recorded keypoints."""
OF_VIDEOS: tuple[Rule, ...] = (_nothing_tracked, _probably_nobody, _poor_fit, _untracked, _outside)
VIDEO_RULES: tuple[Rule, ...] = (*OF_VIDEOS, *OF_POSES, *OF_TRACKS)
"""For a video whose keypoints this program detected: there is no message and no topic to check."""
