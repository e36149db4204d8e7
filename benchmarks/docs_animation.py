"""Draw the README's animation: keypoints in the image and, next to it, the slowly rotating tracked skeleton.

.venv/bin/python benchmarks/docs_animation.py [--output docs/demo.gif]
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from benchmarks.common.refusals import exit_code
from lassokin_ros import Observation, Tracker, TrackerConfig
from lassokin_ros.demo.synthetic import WEBCAM, detections, exact_pixels, motion

RATE, SECONDS, EVERY = 30.0, 9.0, 3
BLUE, RED, GREY = "#2b6cb0", "#c0492f", "#777777"


def tracked() -> tuple[Tracker, np.ndarray, np.ndarray, np.ndarray]:
    """(tracker, pixels (f, l, 2), confidence (f, l), positions (f, n, 3) m) of the synthetic motion."""
    tracker = Tracker(TrackerConfig(height=1.75))
    times = np.arange(round(RATE * SECONDS)) / RATE
    exact = exact_pixels(tracker.kinematics, motion(tracker.skeleton, times))
    pixels, confidence = detections(exact, RATE)
    positions = []
    for time, points, sure in zip(times, pixels, confidence):
        rays = WEBCAM.lens.normalise(points.astype(float))
        estimate = tracker.track(Observation(float(time), rays, sure.astype(float), WEBCAM.lens.focal))
        positions.append(estimate.pose.positions if estimate.pose is not None else positions[-1])
    return tracker, pixels, confidence, np.array(positions)


def main() -> int:
    """Write the animation; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("docs/demo.gif"))
    options = parser.parse_args()
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.animation import FuncAnimation, PillowWriter

    tracker, pixels, confidence, positions = tracked()
    figure = plt.figure(figsize=(6.4, 3.2), dpi=80)
    image, space = figure.add_subplot(1, 2, 1), figure.add_subplot(1, 2, 2, projection="3d")
    bones = [(joint, parent) for joint, parent in enumerate(tracker.skeleton.parents) if parent >= 0]
    names = tracker.skeleton.joint_names

    def draw(step: int) -> None:
        frame = step * EVERY
        image.clear()
        seen = confidence[frame] > 0.2
        image.scatter(*pixels[frame][seen].T, s=14, color=BLUE)
        image.set(xlim=(0, WEBCAM.size[0]), ylim=(WEBCAM.size[1], 0), xticks=[], yticks=[], aspect="equal")
        image.set_title("2D keypoints in", fontsize=10)
        space.clear()
        body = positions[frame]
        for joint, parent in bones:
            side = names[joint]
            colour = BLUE if side.startswith("left") else RED if side.startswith("right") else GREY
            x, y, z = body[[parent, joint]].T
            space.plot(x, z, -y, color=colour, linewidth=2.5)
        x, y, z = positions[:, 0].mean(axis=0)
        space.set(xlim=(x - 0.9, x + 0.9), ylim=(z - 0.9, z + 0.9), zlim=(-y - 1.0, -y + 0.8))
        space.set_box_aspect((1, 1, 1))
        space.set_xticklabels([]), space.set_yticklabels([]), space.set_zticklabels([])
        space.view_init(elev=12, azim=-60 + 60 * np.sin(2 * np.pi * frame / len(positions)))
        space.set_title("3D skeleton out", fontsize=10)

    animation = FuncAnimation(figure, draw, frames=len(positions) // EVERY)
    animation.save(options.output, writer=PillowWriter(fps=round(RATE / EVERY)))
    print(f"{options.output}: {options.output.stat().st_size / 1000:.0f} kB")
    return 0


if __name__ == "__main__":
    sys.exit(exit_code(main))
