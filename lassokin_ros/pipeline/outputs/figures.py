"""The figures of the status by their keys: of messages, people, cameras and the calibration."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from lassokin_ros.core.learned.bone_lengths import Calibration
from lassokin_ros.core.learned.height import HeightEstimator
from lassokin_ros.core.observation import Status
from lassokin_ros.pipeline.camera.camera_selection import OUTSIDE_IMAGE
from lassokin_ros.pipeline.camera_images import DEPTH_IN_MESSAGE, NOBODY, UNSCORED, UNUSED
from lassokin_ros.pipeline.concerns.period import Period
from lassokin_ros.pipeline.depth.depth_check import MISFIT
from lassokin_ros.pipeline.depth.depth_images import COUNTS as DEPTH_COUNTS
from lassokin_ros.pipeline.depth.depth_images import MATCHED, RECEIVED, UNMATCHED
from lassokin_ros.pipeline.image_sets import LATE
from lassokin_ros.pipeline.input_checks.messages import LEADING_SLASH
from lassokin_ros.pipeline.input_checks.placeholders import PLACEHOLDERS
from lassokin_ros.pipeline.keypoint_queue import LOST, OVERTAKEN
from lassokin_ros.pipeline.people.camera_agreement import LEFT_OUT
from lassokin_ros.pipeline.people.roster import Presence

ALWAYS = "received", "accepted", "duplicated", "unstamped", "ignored while disabled", OVERTAKEN, LOST
"""Counts that are always shown."""
IF_COUNTED = LATE, MISFIT, OUTSIDE_IMAGE, PLACEHOLDERS, NOBODY, UNUSED, UNSCORED, DEPTH_IN_MESSAGE, LEADING_SLASH
"""Counts that are shown after the first such message."""


def figures(
    period: Period, now: float, camera_at: float | None, presence: Presence, state: str, as_of_ns: int
) -> dict[str, str]:
    """Return the figures. camera_at: s, arrival of the last camera_info; see also `Diagnostics.line`."""
    session, counts, recent = period.session, period.session.counts, period.recent
    seconds = max(now - period.since, 1e-3)
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
        "locked": session.roster.locked or "nobody",
    }
    newest = (0, "") if session.config.topic_per_body else session.scene.image  # each body has its own
    if newest is not None:
        stamp_ns = session.scene.image_at(as_of_ns)[0] if as_of_ns else newest[0]
        values["people in view, not tracked"] = str(session.scene.untracked_at(stamp_ns))
    if presence.ids is not None:
        values["people"] = ", ".join(presence.ids) or "nobody"
        gone = len(set(session.roster.ids or ()) - set(presence.ids))  # in a silence: the next message counts them
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
    return {**values, **_of_bodies(period, presence), **dict(_of_cameras(period, now, seconds))}


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
    if tracker.averaged:
        values["skeleton: left/right difference, averaged [%]"] = f"{100 * tracker.averaged:.1f}"
    present = [one for one in session.roster.trackers if presence.ids is None or one in presence.ids]
    title = {person: f"{person} " if person else "" for person in present}
    for person, calibration in session.roster.calibrations().items():
        if (of := title.get(person)) is not None:
            learning = "learning" if tracker.config.calibrate else "off"
            values[f"{of}calibration"] = "final" if calibration.frozen else learning
            if calibration.kept_motion > 0:
                largest = 100 * float(np.max(calibration.deviation, initial=0))
                values[f"{of}calibration: motion seen [s]"] = f"{calibration.kept_motion:.2f}"
                values[f"{of}calibration: largest deviation [%]"] = f"{largest:.2f}"
                for name, change in length_changes(calibration).items():
                    values[f"{of}calibration: {name} [%]"] = f"{change:+.2f}"
    if tracker.limitations:
        values["limitations"] = tracker.limitations
    values |= {f"evidence '{name}'": fault for name, fault in session.roster.evidence_faults.items()}
    for person in present:
        if (ratio := session.roster.trackers[person].learned.size_check.ratio) != 1.0:
            values[f"{title[person]}measured size / given size"] = f"{ratio:.2f}"
    for person, height in session.roster.heights().items():
        if (of := title.get(person)) is not None:  # a mean of people before the first measured depth
            values[f"{of}height [m]"] = f"{height.height:.3f}"
            values[f"{of}height: deviation [m]"] = f"{height.deviation:.3f}"
    return values


def _age(now: float, then: float | None) -> str:
    return "never" if then is None else f"{now - then:.3f}"


def _percentile(values: list[float], percentile: float) -> str:
    return f"{np.percentile(values, percentile):.3f}" if values else "nan"


OF_DEPTH = RECEIVED, MATCHED, UNMATCHED
"""Counts of depth images that are shown of each camera."""


def _of_cameras(period: Period, now: float, seconds: float) -> Iterator[tuple[str, str]]:
    """Yield the figures of several cameras, or of one in a fixed frame."""
    session, recent, counts = period.session, period.recent, period.session.counts
    if session.placement.places is None:
        return
    extrinsics = session.roster.extrinsics
    for name, camera in session.cameras.items():
        prefix, received = f"{name}: " if name else "", camera.key("received")
        if name:
            age = period.silent_s(name, now) if counts[received] else math.inf
            yield f"{prefix}input rate [Hz]", f"{recent[received] / seconds:.2f}"
            yield f"{prefix}keypoints age [s]", f"{age:.1f}"
            residuals = session.placement.agreement.residuals.get(name)
            residual = np.median(residuals) if residuals else math.nan
            yield f"{prefix}residual median [px]", f"{residual:.2f}"
        yield f"{prefix}no transform [messages]", str(counts[f"no transform of {name}" if name else "no transform"])
        if left_out := counts[f"{name}: {LEFT_OUT}"]:
            yield f"{prefix}{LEFT_OUT} [messages]", str(left_out)
        for key in OF_DEPTH if name and camera.depth is not None else ():
            yield f"{prefix}{key} [messages]", str(counts[camera.key(key)])
        if extrinsics is not None and name in extrinsics.found:
            yield f"{prefix}pose", "found from the person"
        elif extrinsics is not None and (solution := extrinsics.solution(name)) is not None:
            yield f"{prefix}pose differs from the given one [deg]", f"{math.degrees(solution[0]):.2f}"
            yield f"{prefix}pose differs from the given one [m]", f"{solution[1]:.3f}"


def length_changes(calibration: Calibration) -> dict[str, float]:
    """Change of each length from the given skeleton, in %."""
    return dict(zip(calibration.proportions.names, (100 * np.expm1(calibration.lengths)).tolist()))


def averaged_sides(difference: float) -> str:
    """Text about the averaging of a given skeleton whose left and right differ by `difference`, of the logarithms."""
    return (
        f"left and right of the skeleton differ by {100 * difference:.1f} % on average, more than in a body: "
        "calibration starts with their mean; set calibrate: false to keep the given lengths"
    )


def height_in_words(height: HeightEstimator) -> str:
    """Return the measured height and its standard deviation as text."""
    if not height.measured:
        return f"{height.height:.2f} m, a mean of people: no depth was measured"
    return f"{height.height:.2f} m, measured, standard deviation {height.deviation:.2f} m"
