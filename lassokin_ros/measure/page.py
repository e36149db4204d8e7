"""A page about one person's walk, to be printed: two sheets of A4 with the figures, plots, and what they are worth."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from lassokin_ros.common.svg import Axes, document
from lassokin_ros.measure.gait import DEVIATIONS, LENGTH, TIME, Gait
from lassokin_ros.measure.poses import SIDES
from lassokin_ros.measure.report import COLOURS, UNITS, asymmetry_text, gait_plot, support_text

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
SIZE, PLACE, EXTENT = (860, 240), (70, 20), (760, 170)


def gait_page(gait: Gait, title: str, remarks: Sequence[str]) -> str:
    """Return the HTML text. remarks: sentences about what the figures rest on."""
    rows = [
        ("Cadence", f"{_number(gait.cadence, 0)} steps per minute"),
        ("Stride", f"{gait.stride_m:.2f} m in {gait.stride_s:.2f} s ({gait.strides} strides)"),
        ("Speed", f"{gait.speed:.2f} m/s"),
        ("Both feet on the floor", support_text(gait)),
    ]
    general = "".join(f"<tr><th>{name}</th><td>{words}</td></tr>" for name, words in rows)
    sides = "".join(_row(gait, name) for name in DEVIATIONS)
    knees = "".join(f'<td class="n {side}">{_number(gait.knee_range[side], 0)}&deg;</td>' for side in SIDES)
    notes = "".join(f"<li>{escape(one[0].upper() + one[1:])}.</li>" for one in remarks)
    plots = [f"<h2>{NAMES[name]}, step by step</h2>{_steps(gait, name)}" for name in (TIME, LENGTH) if _has(gait, name)]
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
    sides, (scale, digits, unit) = gait.sides[name], UNITS[name]
    cells = [
        f'<td class="n {side}">{_number(scale * mean, digits)} &plusmn; {_number(scale * deviation, digits + 1)} '
        f"{unit} ({count})</td>"
        for side, mean, deviation, count in zip(SIDES, sides.mean, sides.deviation, sides.count)
    ]
    return f"<tr><th>{NAMES[name]}</th>{''.join(cells)}<td>{escape(asymmetry_text(sides))}</td></tr>"


def _has(gait: Gait, name: str) -> bool:
    return any(gait.steps[name][side] for side in SIDES)


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
    axes = Axes(PLACE, EXTENT, (first, last), (low, 1.2 * float(every[:, 1].max())))
    axes.grid(most=8)
    axes.label("", "time (s)", unit)
    for side in SIDES:
        axes.dots(points[side], COLOURS[side], 6)
    return document(SIZE, [axes.svg()])


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if np.isfinite(value) else "-"
