"""Findings about the result: where the pose is likely wrong, and what the keypoints do not show."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lassokin_ros.doubt.unseen_limbs import LIMBS
from lassokin_ros.replay.report.facts import Facts
from lassokin_ros.replay.report.finding import DOUBT, MOST_LISTED, NOTE, Finding
from lassokin_ros.replay.report.log import PersonRow
from lassokin_ros.replay.report.wrong_spans import WrongSpan

MOST_MARKED = 0.25
"""Share of the frames that may be marked by their figures alone before it is a doubt about the whole."""
BENT_DEG, BENT_SHARE, LEAST_BENT_S = 18.0, 0.8, 1.0
"""Bend of the straighter knee, and share of the frames in which it is larger, for this time at least. One leg of people
who stand or walk is nearly straight at any time."""
UPRIGHT_DEG = 25.0
"""Lean of the trunk up to which a person is upright; who leans further may well bend the knees."""
UNSEEN = 0.5
"""Share of the frames below which a limb's joints are observed for it to be reported as not seen."""
BONE_CHANGE, UNLIKELY_CHANGE = 0.02, 0.25
"""Relative change of a bone's length from which it is reported, and from which it is hardly a person's."""
UNCERTAIN_MM = 60.0
"""Mean stated deviation from which it is reported."""
HIDDEN_MM = 250.0
"""Stated deviation of a joint from which it is reported."""


def likely_wrong(facts: Facts) -> Iterator[Finding]:
    """Report the spans: 'The pose is likely wrong from 0.7 to 1.7 s: the pelvis jumps in depth.'."""
    share = facts.wrong_share
    for person in facts.people:
        spans = facts.wrong[person]
        signs = [span for span in spans if span.certain_sign]
        for span in signs[:MOST_LISTED]:
            yield Finding(DOUBT, _span_sentence(span, person))
        if len(signs) > MOST_LISTED:
            yield Finding(
                DOUBT, f"{len(signs) - MOST_LISTED} more such spans, {_seconds(signs[MOST_LISTED:])} in total."
            )
        weak = [span for span in spans if not span.certain_sign]
        if weak:
            level = DOUBT if share > MOST_MARKED else NOTE
            yield Finding(level, _uncertain_sentence(weak, person, facts))


def _span_sentence(span: WrongSpan, person: str) -> str:
    subject = f"The pose of {person}" if person else "The pose"
    return f"{subject} is likely wrong from {span.start:.1f} to {span.end:.1f} s: {', '.join(span.reasons)}."


def _uncertain_sentence(spans: list[WrongSpan], person: str, facts: Facts) -> str:
    who = f"{person}: in" if person else "In"
    rows = facts.accepted(person)
    marked = sum(any(span.contains(row.time) for span in spans) for row in rows) / max(len(rows), 1)
    return (
        f"{who} {marked:.0%} of the frames an error above 100 mm is likely by the tracker's own figures; "
        "they are marked on the slider and in the plots."
    )


def _seconds(spans: list[WrongSpan]) -> str:
    return f"{sum(span.seconds for span in spans):.1f} s"


def unseen_limbs(facts: Facts) -> Iterator[Finding]:
    """Report limbs that the keypoints do not show, whose pose is a guess."""
    hidden = hidden_limbs(facts)
    if hidden:
        yield Finding(
            NOTE,
            f"Hardly seen: {', '.join(f'{limb} (in {share:.0%} of the frames)' for limb, share in hidden.items())}. "
            "The skeleton's limb is a guess in the other frames.",
        )


def hidden_limbs(facts: Facts) -> dict[str, float]:
    """Return the limbs that are observed in fewer than `UNSEEN` of the frames, with that share."""
    rows = [row.observed for row in facts.tracks if row.observed is not None]
    if not rows:
        return {}
    share = dict(zip(facts.skeleton.joint_names, np.mean(rows, axis=0)))
    limbs = {limb: [share[joint] for joint in joints if joint in share] for limb, joints in LIMBS.items()}
    return {limb: float(min(seen)) for limb, seen in limbs.items() if seen and min(seen) < UNSEEN}


def bent_knees(facts: Facts) -> Iterator[Finding]:
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
        bent = bends > BENT_DEG
        if len(rows) > LEAST_BENT_S * facts.rate and bent.mean() > BENT_SHARE:
            who = f"{person}: even" if person else "Even"
            yield Finding(
                DOUBT,
                f"{who} the straighter knee stays bent, by {np.median(bends):.0f} degrees in the median. If the person "
                "stands or walks upright, this is an error: the skeleton bends its knees if its legs are longer than "
                "the person's, in relation to the trunk.",
            )


def _lean_deg(row: PersonRow, facts: Facts) -> float:
    """Return the angle between the trunk and the vertical."""
    names = facts.skeleton.joint_names
    if "neck" not in names or row.positions is None:
        return 0.0
    trunk = row.positions[names.index("neck")] - row.positions[0]
    up = -facts.level[1]
    return float(np.degrees(np.arccos(np.clip(trunk @ up / max(np.linalg.norm(trunk), 1e-9), -1.0, 1.0))))


def bones(facts: Facts) -> Iterator[Finding]:
    """Report the bone that calibration changed most."""
    for person in facts.people:
        lengths = [row.lengths for row in facts.accepted(person) if row.lengths is not None]
        if not lengths:
            continue
        given = np.linalg.norm(facts.skeleton.offsets, axis=-1)
        change = np.where(given > 1e-6, lengths[-1] / np.maximum(given, 1e-6) - 1, 0.0)
        worst = int(np.argmax(np.abs(change)))
        if abs(change[worst]) > BONE_CHANGE:
            who = f"{person}: calibration" if person else "Calibration"
            unlikely = (
                "; people differ less, so another error may hide in it" if abs(change[worst]) > UNLIKELY_CHANGE else ""
            )
            yield Finding(
                NOTE,
                f"{who} changed the bone lengths, most the bone to {facts.skeleton.joint_names[worst]}: "
                f"{1e3 * given[worst]:.0f} mm at the start, {1e3 * lengths[-1][worst]:.0f} mm at the end{unlikely}.",
            )


def uncertain(facts: Facts) -> Iterator[Finding]:
    """Report how far off the joints may be: 'The joints are off by about 80 mm ...'."""
    rows = [row.deviations for row in facts.tracks if row.deviations is not None]
    if not rows:
        return
    deviations = 1e3 * np.median(rows, axis=0)
    mean = float(deviations[1:].mean())
    if mean > UNCERTAIN_MM:
        yield Finding(
            NOTE,
            f"The joints are off by about {mean:.0f} mm relative to the pelvis, mostly in depth (mean of the stated "
            "deviations): measured depth or the person's bone lengths make them more exact.",
        )
    hidden = np.flatnonzero(deviations > HIDDEN_MM)
    if len(hidden):
        listed = ", ".join(f"{facts.skeleton.joint_names[i]} {deviations[i]:.0f} mm" for i in hidden)
        yield Finding(NOTE, f"Joints that the keypoints hardly show, with their deviations: {listed}.")
