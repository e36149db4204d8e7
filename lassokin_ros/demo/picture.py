"""The picture of the demo: image plane, skeleton in two views at several times, and error over time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lassokin_ros.core.image.projection import project
from lassokin_ros.demo.synthetic import WEBCAM

if TYPE_CHECKING:
    from lassokin_ros.demo.result import DemoResult

COLUMNS = 6
LEFT, RIGHT, MIDDLE, TRUE, DETECTED = "#1f6fb4", "#d1495b", "#3c3c46", "#b9b9b9", "#2a9d4a"
HALF_WIDTH, HALF_HEIGHT = 0.8, 1.12  # m, of the views in space
PADDING_PX = 30


def draw(result: DemoResult, path: Path) -> None:
    """Write the picture as PNG."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure = plt.figure(figsize=(14, 12), layout="constrained")
    grid = figure.add_gridspec(5, COLUMNS, height_ratios=(2.3, 2.0, 2.0, 1.1, 0.8))
    rows = np.linspace(0, len(result.times) - 1, COLUMNS + 2).round().astype(int)[1:-1]
    for column, row in enumerate(rows):
        axes = [figure.add_subplot(grid[line, column]) for line in range(3)]
        _image(axes[0], result, row)
        _space(axes[1], result, row, 0)
        _space(axes[2], result, row, 2)
        if column == 0:
            for axis, label in zip(axes, ("image plane [px]", "front view [m]", "side view [m]")):
                axis.set_ylabel(label)
        else:
            for axis in axes[1:]:
                axis.tick_params(labelleft=False)
    _over_time(figure.add_subplot(grid[3, :]), result, rows)
    _support(figure.add_subplot(grid[4, :]), result, rows)
    _legend(figure)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _bones(result: DemoResult) -> list[tuple[int, int, str]]:
    """Return (joint, parent, colour) for every bone."""
    skeleton = result.tracker.skeleton
    colours = {"left": LEFT, "right": RIGHT}
    return [
        (joint, int(skeleton.parents[joint]), colours.get(skeleton.joint_names[joint].split("_")[0], MIDDLE))
        for joint in range(1, skeleton.joint_count)
    ]


def _image(axis: Any, result: DemoResult, row: int) -> None:
    """Draw the detected keypoints and the skeleton projected through the lens."""
    joints = WEBCAM.lens.distort(project(result.estimate[row]))
    for joint, parent, colour in _bones(result):
        axis.plot(*joints[[joint, parent]].T, color=colour, linewidth=2, solid_capstyle="round")
    seen = result.confidence[row] > 0
    axis.scatter(*result.pixels[row, seen].T, s=16, color=DETECTED, edgecolor="white", linewidth=0.5, zorder=3)
    centre = joints.mean(axis=0)
    reach = max(np.abs(joints - centre).max(), 230) + PADDING_PX
    width = HALF_WIDTH / (HALF_HEIGHT - 0.15) * reach
    axis.set(xlim=(centre[0] - width, centre[0] + width), ylim=(centre[1] + reach, centre[1] - reach))
    axis.set_aspect("equal")
    axis.set_title(f"{result.times[row]:.1f} s", fontsize=11)
    axis.tick_params(labelsize=8)


def _space(axis: Any, result: DemoResult, row: int, across: int) -> None:
    """Draw truth and estimate relative to the pelvis. across: horizontal axis, camera x (0) or depth z (2)."""
    for joints, true in ((result.truth[row], True), (result.estimate[row], False)):
        placed = joints - joints[0]
        for joint, parent, colour in _bones(result):
            ends = placed[[joint, parent]]
            style = {"color": TRUE, "linewidth": 5} if true else {"color": colour, "linewidth": 1.8}
            axis.plot(ends[:, across], -ends[:, 1], solid_capstyle="round", **style)
    axis.set(xlim=(-HALF_WIDTH, HALF_WIDTH), ylim=(-HALF_HEIGHT, HALF_HEIGHT - 0.3), xticks=(-0.5, 0, 0.5))
    axis.set_aspect("equal")
    axis.tick_params(labelsize=8)
    axis.grid(alpha=0.25)
    if across == 2:
        axis.set_xlabel("depth (camera on the left)", fontsize=8)


def _over_time(axis: Any, result: DemoResult, rows: np.ndarray) -> None:
    axis.plot(result.times, result.error_mm, color=LEFT, linewidth=1.5, label="joints, relative to the pelvis")
    axis.plot(result.times, result.root_error_mm, color=RIGHT, linewidth=1.2, label="pelvis in the camera frame")
    axis.set(ylabel="error [mm]", xlim=(0, result.times[-1]), ylim=(0, None))
    axis.legend(loc="upper right", fontsize=8, ncols=2, frameon=False)
    axis.tick_params(labelbottom=False)
    _marks(axis, result, rows)


def _support(axis: Any, result: DemoResult, rows: np.ndarray) -> None:
    axis.fill_between(result.times, result.support, step="mid", color=MIDDLE, alpha=0.35, linewidth=0)
    axis.set(ylabel="moving degrees\nof freedom, of 72", xlabel="time [s]", xlim=(0, result.times[-1]), ylim=(0, None))
    _marks(axis, result, rows)


def _marks(axis: Any, result: DemoResult, rows: np.ndarray) -> None:
    for row in rows:
        axis.axvline(result.times[row], color="#888888", linewidth=0.6, linestyle=":")
    axis.grid(alpha=0.25)


def _legend(figure: Any) -> None:
    from matplotlib.lines import Line2D

    entries = [
        Line2D([], [], marker="o", linestyle="", color=DETECTED, label="detected keypoints (input)"),
        Line2D([], [], color=LEFT, linewidth=2.5, label="left side, tracked"),
        Line2D([], [], color=RIGHT, linewidth=2.5, label="right side, tracked"),
        Line2D([], [], color=TRUE, linewidth=6, label="true motion"),
    ]
    figure.legend(handles=entries, loc="outside upper center", ncols=4, frameon=False, fontsize=11)
