"""Draws the figures of the documentation: `python benchmarks/pictures/figures.py [NAME ...] [--folder docs/figures]`.

`joints` shows the skeleton with the index and name of each joint. Every other figure shows the effect of one parameter
on synthetic motion with a simulated detector, which anybody can repeat.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np

from benchmarks.common.report import exit_code
from benchmarks.data.figure_scenes import (
    NO_GAPS,
    averages,
    error,
    far_off,
    follow_people,
    given,
    people_crossing,
    run,
    scene,
    shake,
    support,
    with_gap,
    with_poor_points,
)
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.demo.synthetic import Detector

TRUE, COLOURS = "#8a8a8a", ("#d1495b", "#1f6fb4", "#2a9d4a", "#e08d20")
LEFT_KNEE = 4
SEEDS = (0, 1, 2)
"""Seeds of the detector's noise. Figures in the text are means over them."""

LABEL_OFFSETS = {
    "shoulder": (0, 7),
    "elbow": (0, 7),
    "wrist": (-2, 7),
    "hand": (3, -8),
    "collar": (7, -8),
    "foot": (7, -3),
}
"""Points between a joint and its number, for the joints whose names contain the key; x to the outside of the body."""


def joints(axes: Any) -> None:
    """The skeleton at rest, seen from the front, with the index and the name of each joint."""
    skeleton = Skeleton.load("anthropometric", 1.75)
    places = skeleton.rest_positions[:, :2]
    for joint, parent in enumerate(skeleton.parents):
        if parent >= 0:
            axes[0].plot(*places[[joint, parent]].T, color=TRUE, lw=2, zorder=1)
    axes[0].plot(*places.T, "o", color=COLOURS[1], ms=4, zorder=2)
    for joint, name in enumerate(skeleton.joint_names):
        x, y = next((offset for part, offset in LABEL_OFFSETS.items() if part in name), (7, 0))
        side = -1 if name.startswith("right") else 1
        axes[0].annotate(
            str(joint), places[joint], xytext=(side * x, y), textcoords="offset points", fontsize=7, ha="center",
            va="center",
        )  # fmt: skip
    for direction, name, colour in ((np.array([0.2, 0.0]), "x", COLOURS[0]), (np.array([0.0, 0.2]), "y", COLOURS[2])):
        origin = np.array([0.45, -0.7])
        axes[0].annotate("", origin + direction, origin, arrowprops={"arrowstyle": "->", "color": colour})
        axes[0].annotate(name, origin + 1.15 * direction, color=colour, fontsize=9, ha="center", va="center")
    axes[0].annotate("z to the front", (0.47, -0.82), fontsize=8)
    axes[0].set(aspect="equal", xlabel="to the person's left [m]", ylabel="up [m]")
    for joint, name in enumerate(skeleton.joint_names):
        axes[1].text(0.5 * (joint // 12), 1 - (joint % 12 + 0.5) / 12, f"{joint:2d}  {name}", fontsize=9, va="center")
    axes[1].axis("off")


def knee_depth(joints: np.ndarray) -> np.ndarray:
    """(f,) mm: depth of the left knee relative to the pelvis. One camera measures depth worst."""
    return 1e3 * (joints[:, LEFT_KNEE, 2] - joints[:, 0, 2])


def height(axes: Any) -> None:
    """The effect of `height`: a wrong height scales everything."""
    seen = scene(6, 30)
    axes[0].plot(seen.times, seen.joints[:, 0, 2], color=TRUE, lw=3, label="true (height 1.75 m)")
    heights = (1.60, 1.75, 1.90)
    for value, colour in zip(heights, COLOURS):
        axes[0].plot(seen.times, run(seen, height=value).joints[:, 0, 2], color=colour, label=f"height {value:.2f}")
    axes[0].set(xlabel="time [s]", ylabel="pelvis' distance [m]", ylim=(2.9, 4.9))
    axes[0].legend(fontsize=8)
    values = np.linspace(1.5, 2.0, 6)
    ratio = [np.nanmedian(run(seen, height=v).joints[:, 0, 2] / seen.joints[:, 0, 2]) for v in values]
    axes[1].plot(100 * (values / 1.75 - 1), 100 * (np.array(ratio) - 1), "o-", color=COLOURS[1])
    axes[1].set(xlabel="height wrong by [%]", ylabel="distance wrong by [%]")


def noise_px(axes: Any) -> None:
    """The effect of `noise_px`: too small follows the noise, too large is slow."""
    seen = scene(12, 30)
    part = (seen.times > 3.0) & (seen.times < 6.0)
    axes[0].plot(seen.times[part], knee_depth(seen.joints)[part], color=TRUE, lw=3, label="true")
    for value, colour in zip((0.3, 3.0, 30.0), COLOURS):
        depth = knee_depth(run(seen, noise_px=value).joints)
        axes[0].plot(seen.times[part], depth[part], color=colour, lw=1, label=f"noise_px {value:g}")
    axes[0].set(xlabel="time [s]", ylabel="left knee's depth\nfrom the pelvis [mm]")
    axes[0].legend(fontsize=8)
    values = (0.3, 1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 40.0)
    scenes = [scene(12, 30, seed=seed) for seed in SEEDS]
    _two_curves(
        axes[1],
        values,
        ("mean error [mm]", "acceleration [m/s²]"),
        averages(scenes, "noise_px", values, error, shake),
    )
    axes[1].axvline(NO_GAPS.noise_px, color=TRUE, ls=":")
    axes[1].set(xlabel="noise_px (the detector's own noise: dotted)")


def sparsity(axes: Any) -> None:
    """The effect of `sparsity`: a larger value moves fewer joints per frame."""
    seen = scene(12, 30)
    part = (seen.times > 3.0) & (seen.times < 6.0)
    for value, colour in zip((0.005, 0.05, 1.0), COLOURS):
        moving = run(seen, sparsity=value).moving
        axes[0].plot(seen.times[part], moving[part], color=colour, lw=1, label=f"sparsity {value:g}")
    axes[0].set(xlabel="time [s]", ylabel="degrees of freedom\nthat move in a frame", ylim=(0, 60))
    axes[0].legend(fontsize=8)
    values = (0.002, 0.01, 0.05, 0.2, 0.5, 1.0, 2.0, 5.0, 20.0)
    scenes = [scene(12, 30, seed=seed) for seed in SEEDS]
    _two_curves(
        axes[1],
        values,
        ("mean error [mm]", "degrees of freedom that move"),
        averages(scenes, "sparsity", values, error, support),
    )
    axes[1].set(xlabel="sparsity")


def smoothing(axes: Any) -> None:
    """The effect of `smoothing`: a longer time is steadier, but later."""
    values = (0.0, 0.01, 0.02, 0.03, 0.05, 0.1)
    for noise, colour in zip((2.0, 6.0), COLOURS):
        scenes = [scene(12, 30, replace(NO_GAPS, noise_px=noise), seed=seed) for seed in SEEDS]
        for axis, curve in zip(axes, averages(scenes, "smoothing", values, shake, error)):
            axis.plot(values, curve, "o-", color=colour, label=f"detector's noise {noise:.0f} px")
    axes[0].set(xlabel="smoothing [s]", ylabel="acceleration [m/s²]", ylim=(0, None))
    axes[1].set(xlabel="smoothing [s]", ylabel="mean error [mm]", ylim=(0, None))
    axes[0].legend(fontsize=8)


def min_confidence(axes: Any) -> None:
    """The effect of `min_confidence`: guessed points are left out, as long as enough others remain."""
    seen = with_poor_points(scene(12, 30))
    for value, colour in zip((0.0, 0.4), COLOURS):
        axes[0].plot(
            seen.times, run(seen, min_confidence=value).error_mm, color=colour, label=f"min_confidence {value}"
        )
    for start in (0.0, 4.0, 8.0):
        axes[0].axvspan(start, start + 2, color="#eeeeee", zorder=0)
    axes[0].set(xlabel="time [s] (grey: an arm and a leg are guessed)", ylabel="error [mm]")
    axes[0].legend(fontsize=8)
    values = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95])
    scenes = [with_poor_points(scene(12, 30, seed=seed)) for seed in SEEDS]
    _two_curves(
        axes[1],
        values,
        ("mean error [mm]", "frames with an output [%]"),
        averages(scenes, "min_confidence", values, error, given),
        logarithmic=False,
    )
    axes[1].set(xlabel="min_confidence")


def lost_after(axes: Any) -> None:
    """The effect of `lost_after`: maximum age of the state from which tracking continues."""
    seen = with_gap(scene(6, 30, start=6.0), 2.0, 3.5)
    axes[0].axvspan(2.0, 3.5, color="#eeeeee", zorder=0)
    for value, colour in zip((10.0, 0.5), COLOURS):
        tracked = run(seen, lost_after=value)
        axes[0].plot(seen.times, tracked.error_mm, color=colour, label=f"lost_after {value:g} s")
        if tracked.lost.any():
            start, end = seen.times[tracked.lost][[0, -1]]
            axes[0].axvspan(start, end, color="#d5e3f2", zorder=0, label="state: lost")
    axes[0].set(xlabel="time [s] (grey and blue: no keypoints)", ylabel="error [mm]", ylim=(0, 150))
    axes[0].legend(fontsize=8)
    gaps = (0.3, 0.6, 1.0, 2.0, 4.0)
    for value, label, colour in ((60.0, "goes on from the old state", 0), (0.05, "found anew", 1)):
        errors = []
        for gap in gaps:
            scenes = [with_gap(scene(gap + 2.5, 30, seed=n, start=1.5 * n), 2.0, 2.0 + gap) for n in range(8)]
            errors.append(np.mean([np.nanmean(run(s, lost_after=value).error_mm[-15:]) for s in scenes]))
        axes[1].plot(gaps, errors, "o-", color=COLOURS[colour], label=label)
    axes[1].set(xlabel="time without keypoints [s]", ylabel="error in the 0.5 s\nafterwards [mm]", ylim=(0, None))
    axes[1].legend(fontsize=8)


def person_ids(axes: Any) -> None:
    """The effect of `person_ids`, with a detector that exchanges the numbers of two people."""
    scenes, numbers = people_crossing()
    for axis, lasting in zip(axes, (True, False)):
        for person in scenes:
            axis.plot(person.times, person.joints[:, 0, 0], color=TRUE, lw=4, label="true" * (person is scenes[0]))
        for colour, (name, path) in zip(COLOURS, follow_people(scenes, numbers, lasting).items()):
            axis.plot(scenes[0].times, path, color=colour, label=f"bodies/{name}")
        axis.set(xlabel="time [s]", ylabel="pelvis' x [m]", title=f"person_ids: {'lasting' if lasting else 'node'}")
        axis.legend(fontsize=8)


def frame_rate(axes: Any) -> None:
    """The same motion at other frame rates, and with other detectors."""
    rates = (5, 10, 15, 30, 60)
    for noise, colour in zip((1.0, 3.0, 8.0), COLOURS):
        points = []
        for rate in rates:
            scenes = [scene(12, rate, Detector(noise, 0.0, 0.0), seed) for seed in SEEDS]
            points.append(averages(scenes, "noise_px", (noise,), error, far_off))
        for axis, curve in zip(axes, np.concatenate(points, axis=1)):
            axis.plot(rates, curve, "o-", color=colour, label=f"detector's noise {noise:g} px")
    axes[0].set(xlabel="frames a second", ylabel="mean error [mm]", ylim=(0, None))
    axes[1].set(xlabel="frames a second", ylabel="frames off by more\nthan 100 mm [%]", ylim=(0, None))
    axes[0].legend(fontsize=8)


FIGURES: dict[str, Callable[[Any], None]] = {
    drawing.__name__: drawing
    for drawing in (
        joints, height, noise_px, smoothing, sparsity, min_confidence, lost_after, person_ids,
        frame_rate,
    )
}  # fmt: skip


def _two_curves(axis: Any, values: Any, labels: Sequence[str], curves: Any, logarithmic: bool = True) -> None:
    """Two measures over a parameter, each with its own axis."""
    for side, label, figures, colour in zip((axis, axis.twinx()), labels, curves, COLOURS):
        side.plot(values, figures, "o-", color=colour, ms=4)
        side.set_ylabel(label, color=colour)
        side.tick_params(axis="y", labelcolor=colour)
        side.set_ylim(0, 1.1 * np.nanmax(figures))
    if logarithmic:
        axis.set_xscale("log")


def draw(name: str, folder: Path) -> Path:
    """Write one figure; return its file."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(9, 3.2), layout="constrained")
    FIGURES[name](axes)
    for axis in axes:
        axis.grid(alpha=0.3)
    path = folder / f"{name}.png"
    figure.savefig(path, dpi=80)
    plt.close(figure)
    return path


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(FIGURES)}; all by default")
    parser.add_argument("--folder", type=Path, default=Path("docs/figures"))
    options = parser.parse_args()
    unknown = sorted(set(options.names) - set(FIGURES))
    if unknown:
        parser.error(f"no figure is called {', '.join(unknown)}; there are: {', '.join(FIGURES)}")
    options.folder.mkdir(parents=True, exist_ok=True)
    for name in options.names or FIGURES:
        print(draw(name, options.folder))
    return 0


if __name__ == "__main__":
    sys.exit(exit_code(main))
