"""The figures of the status, by their keys."""

from __future__ import annotations

import math

import numpy as np

from lassokin_ros.core.observation import Status
from lassokin_ros.pipeline.camera.camera_selection import OUTSIDE_IMAGE
from lassokin_ros.pipeline.camera_images import DEPTH_IN_MESSAGE, NOBODY, UNSCORED, UNUSED
from lassokin_ros.pipeline.concerns.period import Period
from lassokin_ros.pipeline.depth.depth_check import MISFIT
from lassokin_ros.pipeline.depth.depth_images import COUNTS as DEPTH_COUNTS
from lassokin_ros.pipeline.image_sets import LATE
from lassokin_ros.pipeline.input_checks.messages import LEADING_SLASH
from lassokin_ros.pipeline.input_checks.placeholders import PLACEHOLDERS
from lassokin_ros.pipeline.keypoint_queue import LOST, OVERTAKEN
from lassokin_ros.pipeline.outputs.status.calibration_status import calibration_figures, height_figures
from lassokin_ros.pipeline.people.presence import Presence

ALWAYS = "received", "accepted", "duplicated", "unstamped", "ignored while disabled", OVERTAKEN, LOST
"""Counts that are always shown."""
IF_COUNTED = LATE, MISFIT, OUTSIDE_IMAGE, PLACEHOLDERS, NOBODY, UNUSED, UNSCORED, DEPTH_IN_MESSAGE, LEADING_SLASH
"""Counts that are shown after the first such message."""


def figures(
    period: Period, seconds: float, ages: tuple[float, float | None], presence: Presence, state: str, as_of_ns: int
) -> dict[str, str]:
    """Return the figures. seconds: length of the period. ages: now and the arrival of camera_info, s; see also
    `Diagnostics.line`.
    """
    session, counts, recent = period.session, period.session.counts, period.recent
    now, camera_at = ages
    values = {
        "state": state,
        "input rate [Hz]": f"{recent['received'] / seconds:.2f}",
        "output rate [Hz]": f"{recent['accepted'] / seconds:.2f}",
        "keypoints age [s]": _age(now, period.keypoints_at),
        "camera_info age [s]": _age(now, camera_at),
        "keypoints delay median [s]": _percentile(period.delays, 50),
        "callback time median [ms]": _percentile(period.times_ms, 50),
        "callback time maximum [ms]": _percentile(period.times_ms, 100),
        **_of_pose(period, presence),
        **{f"{key} [messages]": str(counts[key]) for key in ALWAYS},
        "resets": str(counts["resets"]),
        "locked": session.locked or "nobody",
    }
    newest = (0, "") if session.config.topic_per_body else session.scene.image  # each body has its own
    if newest is not None:
        stamp_ns = session.scene.image_at(as_of_ns)[0] if as_of_ns else newest[0]
        values["people in view, not tracked"] = str(session.scene.untracked_at(stamp_ns))
    if presence.ids is not None:
        values["people"] = ", ".join(presence.ids) or "nobody"
        gone = len(set(session.ids or ()) - set(presence.ids))  # in a silence: the next message counts them
        values["people come"], values["people left"] = str(counts["people come"]), str(counts["people left"] + gone)
        values["people beyond max_people"] = str(counts["people beyond max_people"])
    if (above := session.placement.camera_height) is not None:
        values["camera height above the floor [m]"] = f"{above:.3f}"
    if session.first.depth is not None:
        values |= {f"{key} [messages]": str(counts[key]) for key in DEPTH_COUNTS}
    for key in sorted(key for key in counts if key.startswith("rejected: ") or key in IF_COUNTED):
        values[f"{key} [messages]"] = str(counts[key])
    if period.unused_confidence:
        values["largest unused confidence"] = f"{period.unused_confidence:.2f}"
    return {**values, **_of_bodies(period, presence)}


def _of_pose(period: Period, presence: Presence) -> dict[str, str]:
    """The figures of the newest poses; nan if nobody is tracked, because those of a lost person are outdated."""
    frames = period.newest if presence.status is Status.TRACKING else ()
    pixels = max((frame.estimate.reprojection_px for frame in frames if frame.estimate is not None), default=math.nan)
    metres = max((float(frame.uncertainty.deviation.max()) for frame in frames), default=math.nan)
    return {"reprojection error [px]": f"{pixels:.2f}", "largest joint deviation [m]": f"{metres:.3f}"}


def _of_bodies(period: Period, presence: Presence) -> dict[str, str]:
    """The figures of what is learned about the people who are present, and of the skeleton."""
    session, tracker = period.session, period.session.tracker
    values = {}

    def is_present(person: str) -> bool:
        return presence.ids is None or person in presence.ids

    if tracker.averaged:
        values["skeleton: left/right difference, averaged [%]"] = f"{100 * tracker.averaged:.1f}"
    for person, calibration in session.calibrations().items():
        if is_present(person):
            values |= calibration_figures(calibration, tracker.config.calibrate, person)
    if tracker.limitations:
        values["limitations"] = tracker.limitations
    values |= {f"evidence '{name}'": fault for name, fault in session.evidence_faults.items()}
    for person, one in session.trackers.items():
        if (ratio := one.learned.size_check.ratio) != 1.0 and is_present(person):
            values[f"{person} measured size / given size".strip()] = f"{ratio:.2f}"
    for person, height in session.heights().items():
        if is_present(person):
            values |= height_figures(height, person)
    return values


def _age(now: float, then: float | None) -> str:
    return "never" if then is None else f"{now - then:.3f}"


def _percentile(values: list[float], percentile: float) -> str:
    return f"{np.percentile(values, percentile):.3f}" if values else "nan"
