"""The picture of the demo: image plane, skeleton in two views at several times, and error over time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lassokin_ros.common.svg import Axes, document, text
from lassokin_ros.core.image.projection import project
from lassokin_ros.demo.synthetic import WEBCAM

if TYPE_CHECKING:
    from lassokin_ros.demo.result import DemoResult

SIZE = (1270, 1240)  # px
COLUMNS = 6
LEFT_EDGE, TOP, COLUMN, GAP = 80, 60, 168, 34  # px: left edge, upper edge, width of a column, and between two
TALL, PLOT, SUPPORT = 252, 140, 90  # px: heights of the views, of the errors, of the moving degrees of freedom
LEFT, RIGHT, MIDDLE, TRUE, DETECTED = "#1f6fb4", "#d1495b", "#3c3c46", "#b9b9b9", "#2a9d4a"
HALF_WIDTH, BELOW, ABOVE = 0.8, -1.22, 0.92  # m, of the views in space
PADDING_PX = 30


def draw(result: DemoResult, path: Path) -> None:
    """Write the picture as SVG."""
    rows = np.linspace(0, len(result.times) - 1, COLUMNS + 2).round().astype(int)[1:-1]
    parts = _legend()
    for column, row in enumerate(rows):
        left, first = LEFT_EDGE + column * (COLUMN + GAP), column == 0
        parts.append(_image(result, row, (left, TOP), "image plane [px]" if first else ""))
        parts.append(_space(result, row, 0, (left, TOP + TALL + 34), "front view [m]" if first else ""))
        parts.append(_space(result, row, 2, (left, TOP + 2 * (TALL + 34)), "side view [m]" if first else ""))
    top = TOP + 3 * (TALL + 34) + 24
    parts += [_over_time(result, rows, top), _support(result, rows, top + PLOT + 12)]
    path.write_text(document(SIZE, parts), encoding="utf-8")


def _bones(result: DemoResult) -> list[tuple[int, int, str]]:
    """Return (joint, parent, colour) for every bone."""
    skeleton = result.skeleton
    colours = {"left": LEFT, "right": RIGHT}
    return [
        (joint, int(skeleton.parents[joint]), colours.get(skeleton.joint_names[joint].split("_")[0], MIDDLE))
        for joint in range(1, skeleton.joint_count)
    ]


def _image(result: DemoResult, row: int, corner: tuple[float, float], label: str) -> str:
    """Draw the detected keypoints and the skeleton projected through the lens."""
    joints = WEBCAM.lens.distort(project(result.estimate[row]))
    centre = joints.mean(axis=0)
    reach = max(np.abs(joints - centre).max(), 230) + PADDING_PX
    x, y = centre[0] + np.array([-1, 1]) * reach * COLUMN / TALL, centre[1] + np.array([1, -1]) * reach
    axes = Axes(corner, (COLUMN, TALL), (x[0], x[1]), (y[0], y[1]))
    for joint, parent, colour in _bones(result):
        axes.line(joints[[joint, parent]], colour, 2.5)
    axes.dots(result.pixels[row, result.confidence[row] > 0], DETECTED, 3.5)
    axes.grid()
    axes.label(f"{result.times[row]:.1f} s", y=label)
    return axes.svg()


def _space(result: DemoResult, row: int, across: int, corner: tuple[float, float], label: str) -> str:
    """Draw truth and estimate relative to the pelvis. across: horizontal axis, camera x (0) or depth z (2)."""
    axes = Axes(corner, (COLUMN, TALL), (-HALF_WIDTH, HALF_WIDTH), (BELOW, ABOVE))
    for joints, true in ((result.truth[row], True), (result.estimate[row], False)):
        placed = joints - joints[0]
        for joint, parent, colour in _bones(result):
            ends = placed[[joint, parent]]
            points = np.stack([ends[:, across], -ends[:, 1]], axis=1)
            axes.line(points, TRUE if true else colour, 6 if true else 2.2)
    axes.grid(y_labels=bool(label))
    axes.label(x="depth (camera on the left)" if across == 2 else "", y=label)
    return axes.svg()


def _over_time(result: DemoResult, rows: np.ndarray, top: float) -> str:
    curves = (
        (result.error_mm, LEFT, "joints, relative to the pelvis"),
        (result.root_error_mm, RIGHT, "pelvis in the camera frame"),
    )
    axes = _axes_over_time(result, top, PLOT, 1.15 * max(values.max() for values, _, _ in curves))
    for number, (values, colour, name) in enumerate(curves):
        axes.line(np.stack([result.times, values], axis=1), colour, 1.6)
        axes.around.append(text((axes.size[0] - 240 * (2 - number) + 40, 16), name, more=f' style="fill:{colour}"'))
    _marks(axes, result, rows)
    axes.grid(x_labels=False)
    axes.label(y="error [mm]")
    return axes.svg()


def _support(result: DemoResult, rows: np.ndarray, top: float) -> str:
    axes = _axes_over_time(result, top, SUPPORT, 1.1 * max(result.support.max(), 1.0))
    times, step = result.times, np.diff(result.times, append=2 * result.times[-1] - result.times[-2])
    corners = np.stack([times, result.support, times + step, result.support], axis=1).reshape(-1, 2)
    axes.area(corners, "#c8c8cc")
    _marks(axes, result, rows)
    axes.grid(most=4)
    axes.label(x="time [s]", y="moving degrees\nof freedom, of 72")
    return axes.svg()


def _axes_over_time(result: DemoResult, top: float, height: float, most: float) -> Axes:
    width = COLUMNS * COLUMN + (COLUMNS - 1) * GAP
    return Axes((LEFT_EDGE, top), (width, height), (0.0, float(result.times[-1])), (0.0, float(most)))


def _marks(axes: Axes, result: DemoResult, rows: np.ndarray) -> None:
    """Mark the times of the views."""
    for row in rows:
        axes.line(np.array([[result.times[row], axes.y[0]], [result.times[row], axes.y[1]]]), "#999999", 0.8)


def _legend() -> list[str]:
    entries = (
        ("detected keypoints (input)", DETECTED, 8),
        ("left side, tracked", LEFT, 3),
        ("right side, tracked", RIGHT, 3),
        ("true motion", TRUE, 7),
    )
    parts = []
    for number, (name, colour, width) in enumerate(entries):
        left = 200 + 230 * number
        length = 0 if colour == DETECTED else 26
        parts.append(f'<path d="M{left} 20h{length}" stroke="{colour}" stroke-width="{width}" stroke-linecap="round"/>')
        parts.append(text((left + 36, 25), name, size=14))
    return parts
