"""Findings about the result: where the pose is likely wrong, and what the keypoints do not show."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lassokin_ros.doubt.unseen_limbs import LIMBS
from lassokin_ros.pipeline.concerns.catalogue import DOUBT, NOTE, Raised, say
from lassokin_ros.pipeline.concerns.live import of_person
from lassokin_ros.replay.report.facts import Facts, bone_changes
from lassokin_ros.replay.report.log import PersonRow

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
            yield say("likely_wrong", whose=of_person(person), when=when, reasons=reasons)
        if rest := signs[MOST_LISTED:]:
            yield say("more_spans", level=DOUBT, count=len(rest), seconds=sum(span.seconds for span in rest))
        if weak := [span for span in facts.wrong[person] if not span.certain_sign]:
            times = [row.time for row in facts.accepted(person)]
            share = sum(any(span.contains(time) for span in weak) for time in times) / max(len(times), 1)
            yield say("by_figures", of=person, level=DOUBT if facts.wrong_share > MOST_MARKED else NOTE, share=share)


def unseen_limbs(facts: Facts) -> Iterator[Raised]:
    """Report limbs that the keypoints do not show, whose pose is a guess."""
    if hidden := hidden_limbs(facts):
        limbs = ", ".join(f"{limb} (seen in {share:.0%} of the frames)" for limb, share in hidden.items())
        yield say("unseen", limbs=limbs)


def hidden_limbs(facts: Facts) -> dict[str, float]:
    """Return the limbs that are observed in fewer than `UNSEEN` of the frames, with that share."""
    rows = [row.observed for row in facts.tracks if row.observed is not None]
    if not rows:
        return {}
    share = dict(zip(facts.skeleton.joint_names, np.mean(rows, axis=0)))
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
        rows = [
            row
            for row in facts.accepted(person)
            if row.observed is not None and row.observed[places].all() and _lean_deg(row, facts) < UPRIGHT_DEG
        ]
        bends = np.array([row.bends[knees].min() for row in rows])
        if len(rows) < UNSEEN * len(facts.accepted(person)):
            continue
        if len(rows) > LEAST_BENT_S * facts.rate and np.mean(bends > BENT_DEG) > BENT_SHARE:
            yield say("bent_knees", of=person, degrees=np.median(bends))


def _lean_deg(row: PersonRow, facts: Facts) -> float:
    """Return the angle between the trunk and the vertical."""
    names = facts.skeleton.joint_names
    if "neck" not in names or row.positions is None:
        return 0.0
    trunk = row.positions[names.index("neck")] - row.positions[0]
    up = -facts.level[1]
    return float(np.degrees(np.arccos(np.clip(trunk @ up / max(np.linalg.norm(trunk), 1e-9), -1.0, 1.0))))


def bones(facts: Facts) -> Iterator[Raised]:
    """Report a bone that calibration changed by more than people differ. The page has a table of all changes."""
    for person in facts.people:
        if not (changes := bone_changes(facts, person)):
            continue
        joint, length, change = max(changes, key=lambda bone: abs(bone[2]))
        if abs(change) > UNLIKELY_CHANGE:
            yield say("bones", of=person, joint=joint, before=length / (1 + change), after=length)


def uncertain(facts: Facts) -> Iterator[Raised]:
    """Report how far off the joints may be: 'The joints are off by about 80 mm ...'."""
    rows = [row.deviations for row in facts.tracks if row.deviations is not None]
    if not rows:
        return
    deviations = 1e3 * np.median(rows, axis=0)
    if (mean := float(deviations[1:].mean())) > UNCERTAIN_MM:
        yield say("uncertain", millimetres=mean)
