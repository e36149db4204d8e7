"""Findings for a video whose keypoints this program detected: there is no message and no topic to check."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lassokin_ros.pipeline.camera.camera_selection import OUTSIDE_IMAGE
from lassokin_ros.replay.report.absences import NO_MESSAGE, NOBODY, Span
from lassokin_ros.replay.report.facts import Facts
from lassokin_ros.replay.report.finding import DOUBT, MOST_LISTED, NOTE, PROBLEM, Finding
from lassokin_ros.replay.report.rejection_advice import reason_text

LARGE_ERROR = 0.03
"""Median reprojection error, as a share of the person's height in the image, from which it is reported."""
NEAREST_M, FARTHEST_M = 0.6, 25.0
FEW = 0.02
"""Share of the images below which something is not reported."""
ABSENT = (NOBODY, "too_few_landmarks", "person_absent")
"""Reasons that say that the detector found nobody."""
NO_IMAGES = "the file has no images there"


def nothing_tracked(facts: Facts) -> Iterator[Finding]:
    """Report a video without a skeleton."""
    if not facts.tracks:
        yield Finding(
            PROBLEM,
            f"Nobody was tracked in {len(facts.log.messages)} images. The detector needs a person who is in view, and "
            "about a tenth of the image high or more.",
        )


def absences(facts: Facts) -> Iterator[Finding]:
    """Report when nobody was in view; this is normal."""
    for person in facts.people:
        if not facts.accepted(person):
            continue
        lost = [span for span in facts.spans[person] if span.lost]
        for span in lost[:MOST_LISTED]:
            yield Finding(NOTE, _absence(span, person))
        if len(lost) > MOST_LISTED:
            seconds = sum(span.seconds for span in lost[MOST_LISTED:])
            yield Finding(NOTE, f"{len(lost) - MOST_LISTED} more such spans, {seconds:.1f} s in total.")


def _absence(span: Span, person: str) -> str:
    when = f"before {span.end:.1f} s" if span.at_start else f"from {span.start:.1f} to {span.end:.1f} s"
    reasons = [key for key in sorted(span.reasons) if key not in ABSENT]
    others = [NO_IMAGES if key == NO_MESSAGE else reason_text(key) for key in reasons]
    if others:
        return f"{person or 'Nobody'} was {'not ' if person else ''}tracked {when}: {', '.join(others)}."
    return f"{person} was not in view {when}." if person else f"Nobody was in view {when}."


def outside(facts: Facts) -> Iterator[Finding]:
    """Report a person who is partly outside of the image; this is normal."""
    count, received = facts.counts.get(OUTSIDE_IMAGE, 0), max(facts.counts.get("received", 0), 1)
    if count > FEW * received:
        yield Finding(NOTE, f"In {count / received:.0%} of the images the person is partly outside of the image.")


def reprojection(facts: Facts) -> Iterator[Finding]:
    """Report a skeleton that does not lie on the person in the image."""
    rows = [row for row in facts.tracks if row.outline is not None]
    if not rows:
        return
    heights = [float(np.ptp(row.outline[:, 1])) for row in rows]
    shares = [row.reprojection_px / max(height, 1.0) for row, height in zip(rows, heights)]
    if np.median(shares) > LARGE_ERROR:
        yield Finding(
            DOUBT,
            f"The skeleton lies {np.median([row.reprojection_px for row in rows]):.0f} px from the detected points in "
            f"the median, {np.median(shares):.1%} of its height in the image: the pose follows them poorly.",
        )


def place(facts: Facts) -> Iterator[Finding]:
    """Report a distance that no video has."""
    depth = unlikely_distance(facts)
    check = "the field of view (`--fov` or `--camera-info`) and `--height`"
    if len(facts.cameras) > 1:
        check = (
            "`--cameras` (translations are m, each video is that of its camera) or, without it, `--fov` and `--height`"
        )
    if depth is not None:
        yield Finding(PROBLEM, f"The median distance of the person is {depth:.2g} m: check {check}.")


def unlikely_distance(facts: Facts) -> float | None:
    """Return the median distance of the pelvis, m, if no person is so near or so far; otherwise None."""
    depth = float(np.median([row.depth for row in facts.tracks])) if facts.tracks else None
    return None if depth is None or NEAREST_M < depth < FARTHEST_M else depth


def upside_down(facts: Facts) -> Iterator[Finding]:
    """Report a person whose shoulders are below the ankles in the image."""
    if heads_below(facts):
        yield Finding(
            NOTE,
            "The shoulders are below the ankles in most images. If the person does not stand on the hands, the video "
            "is upside down.",
        )


def heads_below(facts: Facts) -> bool:
    """Return whether the shoulders are below the ankles in most images that show both."""
    groups = [[i for i, name in enumerate(facts.landmarks) if part in name] for part in ("shoulder", "ankle")]
    seen = [row.detected for person in facts.people for row in facts.rows(person) if row.detected is not None]
    if not seen or not all(groups):
        return False
    heights = [np.array(seen)[:, group, 1].mean(axis=1) for group in groups]
    both = np.isfinite(heights[0]) & np.isfinite(heights[1])
    return bool(both.any() and np.mean(heights[0][both] > heights[1][both]) > 0.5)
