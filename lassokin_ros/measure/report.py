"""The measures as a table, as JSON, as a plot in SVG, and as a page about one person's walk, to be printed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from html import escape
from typing import Any

import numpy as np

from lassokin_ros.common.svg import Axes, document, text
from lassokin_ros.measure.exercises import JOINT, LUNGE, Repetition, Squat
from lassokin_ros.measure.gait import (
    ALONG,
    DEVIATIONS,
    LENGTH,
    OBLIQUE,
    POINTS,
    SEVERAL,
    SIDE,
    STANCE,
    SURE,
    TIME,
    Gait,
    Sides,
)
from lassokin_ros.measure.poses import SIDES, Poses
from lassokin_ros.replay.exports.named_angles import angles_of
from lassokin_ros.replay.motion import ASSUMED

COLOURS = {"left": "#1f77b4", "right": "#d62728"}
SIZE = (860, 380)
PLACE, EXTENT = (70, 50), (760, 260)
"""px: corner and size of the axes."""
HEADER = f"{'':>3} {'bottom':>8} {'time':>6} {'left knee':>10} {'right knee':>11} {'hips':>6} {'lean':>6} {'depth':>7}"


def gait_lines(gait: Gait) -> list[str]:
    """Return the lines of the table."""
    knees = ", ".join(f"{side} {_known(gait.knee_range[side])} deg" for side in SIDES)
    sides = {name: sides_text(name, sides) for name, sides in gait.sides.items()}
    lines = {"strides": f"{gait.strides}", **_general(gait), **sides, "knee range": knees}
    return [*(f"{name:<15} {words}" for name, words in lines.items()), *_doubt([gait.doubtful])]


def _general(gait: Gait) -> dict[str, str]:
    """Return the measures of both sides together, by name."""
    support = f"{_known(100 * gait.double_support)} % of a stride"
    if gait.double_support < 0:
        support = f"never; in the air for {-100 * gait.double_support:.0f} % of a stride"
    return {
        "cadence": f"{_known(gait.cadence)} steps/min",
        "stride": f"{gait.stride_m:.2f} m, {gait.stride_s:.2f} s",
        "speed": f"{gait.speed:.2f} m/s",
        "both feet down": support,
    }


FEW = 0.3
"""Share of the mean above which a limit of the asymmetry says nothing."""
UNITS = {TIME: (1.0, 2, "s"), LENGTH: (1.0, 2, "m"), STANCE: (100.0, 0, "%")}
"""Measure -> factor, digits and unit."""


def sides_text(name: str, sides: Sides) -> str:
    """Return a measure of both sides with deviations, and what it says of their difference."""
    words = [f"{side} {value}" for side, value in zip(SIDES, _values(name, sides))]
    return "; ".join([", ".join(words), asymmetry_text(sides)])


def _values(name: str, sides: Sides) -> list[str]:
    """Return a measure of each side: '0.55 +- 0.036 s (9)' with the number of steps, - without any."""
    scale, digits, unit = UNITS[name]
    return [
        f"{_known(scale * mean, digits)} +- {scale * deviation:.{digits + 1}f} {unit} ({count})" if count else "-"
        for mean, deviation, count in zip(sides.mean, sides.deviation, sides.count)
    ]


def asymmetry_text(sides: Sides) -> str:
    """Return whether the sides differ, at 95 %."""
    if not np.isfinite(sides.spread):
        return "sides not compared"
    if not sides.differs and sides.below > FEW:
        return "too few steps to compare the sides"
    if not sides.differs:
        return f"no asymmetry seen (below {max(sides.below, 0.01):.0%})"
    more = SIDES[sides.asymmetry < 0]
    off = SURE * sides.spread / float(np.mean(sides.mean))
    return f"{more} larger by {abs(sides.asymmetry):.0%} +- {off:.0%}"


SEEN_FROM = {SIDE: "the side", OBLIQUE: "about 45 degrees", ALONG: "the front or behind", SEVERAL: "several cameras"}


def trust_lines(gait: Gait, passes: Sequence[Poses]) -> list[str]:
    """Return what the figures rest on: lens and height, the view, steps that are left out, slow motion."""
    lines = [f"seen from {SEEN_FROM[gait.view]}"]
    if gait.view == ALONG:
        lines.append("step lengths are not measured along the line of sight; film from the side")
    if any(one.lens == ASSUMED for one in passes) and gait.view != SEVERAL:
        wrong = "the lengths hold" if gait.view == SIDE else "lengths and speed may be off by half"
        lines.append(f"the lens is assumed: times hold, seen from here {wrong}; set --fov or --camera-info")
    if any(one.height == ASSUMED for one in passes):
        lines.append("the height is assumed: lengths and speed scale with it; set --height")
    lines += [f"{number} step{'s' * (number > 1)} left out: {reason}" for reason, number in gait.left_out.items()]
    if gait.slow_motion:
        lines.append(
            f"the steps are long for their cadence, as in slow motion (about {gait.slow_motion:.1f} times): "
            "times and speed are then those of the file; set --slow-motion"
        )
    return lines


def repetition_lines(found: Sequence[Repetition], what: str) -> list[str]:
    """Return the lines of the table."""
    head = f"{'':>3} {'start':>8} {'time':>7} {JOINT[what] + 's':>9} {'lean':>6}" + "  front" * (what == LUNGE)
    rows = [
        f"{number:>3} {one.start:>6.1f} s {one.end - one.start:>5.1f} s {one.bend:>5.0f} deg {one.lean:>6.0f}"
        + (f"  {one.front}" if one.front else "")
        for number, one in enumerate(found, 1)
    ]
    lasts = f"{len(found)} in {found[-1].end - found[0].start:.1f} s"
    return [head, *rows, lasts, *_doubt([one.doubtful for one in found])]


def _known(value: float, digits: int = 0) -> str:
    """Return a rounded number; - for one that is unknown: of a leg or of a squat's end that is not seen."""
    return f"{value:.{digits}f}" if np.isfinite(value) else "-"


def squat_lines(squats: Sequence[Squat]) -> list[str]:
    """Return the lines of the table."""
    rows = [
        f"{number:>3} {one.bottom:>6.1f} s {_known(one.end - one.start, 1):>4} s {_known(one.knees[0]):>6} deg "
        f"{_known(one.knees[1]):>7} deg {one.hips:>6.0f} {one.lean:>6.0f} {_known(one.depth, 2):>5} m"
        for number, one in enumerate(squats, 1)
    ]
    return [HEADER, *rows, *_doubt([one.doubtful for one in squats])]


def _doubt(shares: Sequence[float]) -> list[str]:
    share = float(np.mean(shares))
    return [f"{share:.0%} of these frames are marked as likely wrong"] if share > 0 else []


def as_json(measured: Gait | Sequence[Squat] | Sequence[Repetition]) -> Any:
    """Return the figures as numbers, lists and dictionaries; None for NaN."""
    return _plain(asdict(measured) if isinstance(measured, Gait) else [asdict(one) for one in measured])


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [_plain(one) for one in value]
    if isinstance(value, (float, np.floating)):
        return round(float(value), 4) if np.isfinite(value) else None
    return value


def gait_plot(gait: Gait, title: str) -> str:
    """Return the flexion of the knees over the strides, each stride thin and the mean thick."""
    axes = _axes(title, "share of the stride, from strike to strike (%)", (0, 100), list(gait.knees.values()))
    share = np.linspace(0, 100, POINTS)
    for side in SIDES:
        for curve in gait.knees[side]:
            axes.line(np.column_stack([share, curve]), COLOURS[side] + "55", 1)
        if len(gait.knees[side]):
            axes.line(np.column_stack([share, gait.knees[side].mean(axis=0)]), COLOURS[side], 3)
    return document(SIZE, [axes.svg(), *_key()])


def squat_plot(squats: Sequence[Squat], poses: Poses, title: str) -> str:
    """Return the flexion of the knees over time where their leg is shown, with the bottoms of the squats."""
    dots = {
        COLOURS[side]: [(one.bottom, one.knees[number]) for one in squats if np.isfinite(one.knees[number])]
        for number, side in enumerate(SIDES)
    }
    return _flexion_plot(poses, "knee", title, dots, {side: poses.pieces(poses.shown(side)) for side in SIDES})


def repetition_plot(found: Sequence[Repetition], poses: Poses, what: str, title: str) -> str:
    """Return the flexion of elbows or knees over time, with a dot at each turn."""
    angles = angles_of(poses.names, poses.positions)
    mean = 0.5 * sum(angles[f"{side}_{JOINT[what]} flexion"] for side in SIDES)
    dots = {"#444": [(one.turn, float(np.interp(one.turn, poses.seconds, mean))) for one in found]}
    return _flexion_plot(poses, JOINT[what], title, dots, {side: [poses] for side in SIDES})


def _flexion_plot(
    poses: Poses,
    joint: str,
    title: str,
    dots: Mapping[str, Sequence[tuple[float, float]]],
    drawn: Mapping[str, Sequence[Poses]],
) -> str:
    """Return the plot of a joint over time. dots: s and degrees, by colour. drawn: the parts of each side."""
    angles = angles_of(poses.names, poses.positions)
    flexion = [angles[f"{side}_{joint} flexion"] for side in SIDES]
    axes = _axes(title, "time (s)", (0, float(poses.seconds[-1])), flexion, f"{joint}s")
    for side in SIDES:
        for piece in drawn[side]:
            bend = angles_of(piece.names, piece.positions)[f"{side}_{joint} flexion"]
            axes.line(np.column_stack([piece.seconds, bend]), COLOURS[side], 2)
    for colour, places in dots.items():
        axes.dots(np.array(places).reshape(-1, 2), colour, 5)
    return document(SIZE, [axes.svg(), *_key()])


def _axes(title: str, x: str, limits: tuple[float, float], values: Sequence[np.ndarray], joints: str = "knees") -> Axes:
    highest = max((float(np.nanmax(one)) for one in values if one.size), default=90.0)
    axes = Axes(PLACE, EXTENT, limits, (0, 10 * np.ceil(highest / 10)))
    axes.grid(most=10)
    axes.label(title, x, f"flexion of the {joints} (deg)")
    return axes


def _key() -> list[str]:
    """Return the key of the colours."""
    parts = []
    for number, side in enumerate(SIDES):
        x = PLACE[0] + 90 * number
        parts.append(f'<path d="M{x} 358h24" stroke="{COLOURS[side]}" stroke-width="3"/>')
        parts.append(text((x + 30, 362), side))
    return parts


STYLE = """
@page { size: A4; margin: 16mm }
body { font: 11pt/1.4 sans-serif; color: #222; max-width: 178mm; margin: 8mm auto }
h1 { font-size: 18pt; margin: 0 } h2 { font-size: 13pt; margin: 7mm 0 2mm }
table { border-collapse: collapse; width: 100% }
th, td { text-align: left; padding: 1.5mm 2mm; border-bottom: 1px solid #ccc }
td.n { text-align: right; white-space: nowrap } .left { color: #1f77b4 } .right { color: #d62728 }
.small { font-size: 9pt; color: #555 }
.sheet + .sheet { break-before: page } svg { width: 100%; height: auto }
"""
NAMES = {"step time": "Time of a step", "step length": "Length of a step", "stance": "Foot on the floor"}
PAGE_SIZE, PAGE_PLACE, PAGE_EXTENT = (860, 240), (70, 20), (760, 170)


def gait_page(gait: Gait, title: str, remarks: Sequence[str]) -> str:
    """Return the HTML text. remarks: sentences about what the figures rest on."""
    rows = {**_general(gait), "strides": f"{gait.strides}"}
    general = "".join(f"<tr><th>{name.capitalize()}</th><td>{words}</td></tr>" for name, words in rows.items())
    sides = "".join(_row(gait, name) for name in DEVIATIONS)
    knees = "".join(f'<td class="n {side}">{_known(gait.knee_range[side])}&deg;</td>' for side in SIDES)
    notes = "".join(f"<li>{escape(one[0].upper() + one[1:])}.</li>" for one in remarks)
    seen = [name for name in (TIME, LENGTH) if any(gait.steps[name].values())]
    plots = [f"<h2>{NAMES[name]}, step by step</h2>{_steps(gait, name)}" for name in seen]
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{escape(title)} - gait</title><style>{STYLE}</style></head><body>
<div class="sheet"><h1>Gait</h1><p>{escape(title)}</p><table>{general}</table>
<h2>Left and right</h2>
<table><tr><th></th><th class="left">left</th><th class="right">right</th><th>difference</th></tr>{sides}
<tr><th>Range of the knee</th>{knees}<td></td></tr></table>
<p class="small">Mean and standard deviation of the measurement, with the number of steps. A difference is named if it
is larger than what the camera's errors explain in 95 % of such recordings; otherwise the page says its limit.</p>
<h2>What the figures rest on</h2><ul>{notes}</ul></div>
<div class="sheet">{"".join(plots)}<h2>Flexion of the knees over a stride</h2>{gait_plot(gait, "")}
<p class="small">Measured by lassokin_ros from a video, without markers. It is no medical device: do not base a
treatment on it, and compare only recordings that were filmed in the same way.</p></div>
</body></html>
"""


def _row(gait: Gait, name: str) -> str:
    sides = gait.sides[name]
    cells = [
        f'<td class="n {side}">{value.replace("+-", "&plusmn;")}</td>'
        for side, value in zip(SIDES, _values(name, sides))
    ]
    return f"<tr><th>{NAMES[name]}</th>{''.join(cells)}<td>{escape(asymmetry_text(sides))}</td></tr>"


def _steps(gait: Gait, name: str) -> str:
    """Return the plot of each step's value."""
    scale, _, unit = UNITS[name]
    points = {
        side: np.array([(at, scale * value) for at, value, _ in gait.steps[name][side]]).reshape(-1, 2)
        for side in SIDES
    }
    every = np.concatenate(list(points.values()))
    low = min(0.0, float(every[:, 1].min())) if name == LENGTH else 0.0
    first, last = float(every[:, 0].min()) - 0.5, float(every[:, 0].max()) + 0.5
    axes = Axes(PAGE_PLACE, PAGE_EXTENT, (first, last), (low, 1.2 * float(every[:, 1].max())))
    axes.grid(most=8)
    axes.label("", "time (s)", unit)
    for side in SIDES:
        axes.dots(points[side], COLOURS[side], 6)
    return document(PAGE_SIZE, [axes.svg()])
