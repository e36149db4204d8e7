"""The body in 3D for the output video: a fixed view from the side, with the floor and the person's path."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.image.gating import HEAD
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.replay.body import FEET, SOLE, capsules

SIDE_DEG, ABOVE_DEG = 55.0, 12.0
"""The view's direction: from the camera's right, and from above."""
NAME = "seen from the camera's right"
METRES = 2.6
"""Height of the view, m."""
FLOOR_AT = 0.86
"""Place of the floor below the person in the view, as a share of its height from the top."""
CELL_M, CELLS = 0.5, 7
"""Size of the floor's squares, and their number to each side of the person."""
TRAIL_S = 5.0
FLOOR_S = 5.0
"""s: time of which the path is shown, and of which the feet define the floor."""
BACKGROUND, GRID, TRAIL = (30, 28, 26), (62, 58, 54), (150, 140, 130)
COLOURS = {"left": (255, 170, 70), "right": (50, 130, 255), "middle": (205, 205, 205)}
"""BGR; of the limbs by side."""
FAINT, HALO = 0.35, 0.15
"""Share of a limb's colour where no keypoint shows it, and of the halo that shows the uncertainty."""
WIDEST_HALO_M = 0.25


def blended(colour: tuple[int, int, int], share: float) -> tuple[int, int, int]:
    """Return a colour mixed with the background."""
    blue, green, red = (round(share * c + (1 - share) * b) for c, b in zip(colour, BACKGROUND))
    return blue, green, red


class BodyView:
    """Draws one person at a time. The view moves with the pelvis; the floor's squares and the path stay in place."""

    def __init__(self, cv2: Any, side_px: int, level: np.ndarray) -> None:
        """side_px: width and height. level: (3, 3) rotation from the camera frame to that of a level camera."""
        self._cv2, self._px = cv2, side_px
        across, above = np.radians([SIDE_DEG, ABOVE_DEG])
        right = np.array([np.cos(across), 0.0, np.sin(across)])
        ahead = np.array([-np.sin(across), 0.0, np.cos(across)])
        down = np.array([0.0, np.cos(above), 0.0]) - np.sin(above) * ahead
        self._level, self._axes = level, np.stack([right, down, np.cos(above) * ahead + [0, np.sin(above), 0]])
        self._trail: deque[tuple[float, np.ndarray]] = deque()
        self._feet: deque[tuple[float, float]] = deque()
        self._person = ""

    def draw(self, seconds: float, frame: FrameResult | None) -> np.ndarray:
        """Return the view (side, side, 3), BGR. frame: accepted, or None if nobody is tracked."""
        image = np.full((self._px, self._px, 3), BACKGROUND, np.uint8)
        if frame is None or frame.estimate is None or frame.estimate.pose is None or frame.skeleton is None:
            return image
        if frame.person != self._person:
            self._person = frame.person
            self._trail.clear()
            self._feet.clear()
        joints = frame.estimate.pose.positions @ self._level.T
        floor = self._update_floor(seconds, joints, frame.skeleton)
        middle = np.array([joints[0, 0], floor, joints[0, 2]])
        self._trail.append((seconds, middle))
        while seconds - self._trail[0][0] > TRAIL_S:
            self._trail.popleft()
        self._draw_floor(image, middle)
        self._draw_body(image, joints, middle, frame)
        return image

    def _update_floor(self, seconds: float, joints: np.ndarray, skeleton: Skeleton) -> float:
        """Return the floor's place, m downwards: the median of the lowest foot over `FLOOR_S`; jumps count little."""
        names = skeleton.joint_names
        feet = [i for i, name in enumerate(names) if name.endswith(FEET)]
        lowest = float(joints[feet or slice(None), 1].max()) + SOLE * skeleton.height
        self._feet.append((seconds, lowest))
        while seconds - self._feet[0][0] > FLOOR_S:
            self._feet.popleft()
        return float(np.median([low for _, low in self._feet]))

    def _to_px(self, points: np.ndarray, middle: np.ndarray) -> np.ndarray:
        """Project points (..., 3) m of a level frame orthographically; px (..., 2)."""
        seen = (points - middle) @ self._axes[:2].T * self._px / METRES
        return np.asarray(seen + np.array([0.5, FLOOR_AT]) * self._px)

    def _draw_floor(self, image: np.ndarray, middle: np.ndarray) -> None:
        reach = CELL_M * CELLS
        origin = CELL_M * np.round(middle[[0, 2]] / CELL_M)
        for step in np.arange(-CELLS, CELLS + 1) * CELL_M:
            for axis in (0, 1):
                ends = np.repeat(origin[None], 2, axis=0)
                ends[:, axis] += step
                ends[:, 1 - axis] += (-reach, reach)
                self._line(image, np.insert(ends, 1, middle[1], axis=1), middle, GRID, 1)
        trail = np.array([place for _, place in self._trail])
        trail[:, 1] = middle[1]
        for index in range(len(trail) - 1):
            self._line(image, trail[index : index + 2], middle, TRAIL, 2)

    def _draw_body(self, image: np.ndarray, joints: np.ndarray, middle: np.ndarray, frame: FrameResult) -> None:
        """Draw the limbs, far ones first; each with a halo as wide as the deviation of its end."""
        assert frame.skeleton is not None
        names, height = frame.skeleton.joint_names, frame.skeleton.height
        limbs = capsules(frame.skeleton)
        limbs.sort(key=lambda limb: -float((joints[list(limb[:2])] @ self._axes[2]).mean()))
        deviation, observed = frame.uncertainty.deviation, frame.observed
        for a, b, radius, side in limbs:
            width = 2 * (radius + min(float(deviation[b]), WIDEST_HALO_M))
            self._limb(image, joints[[a, b]], middle, blended(COLOURS[side], HALO), width)
        for a, b, radius, side in limbs:
            seen = side == "middle" or (observed[a] and (observed[b] or names[b].endswith(("_foot", "_hand"))))
            self._limb(image, joints[[a, b]], middle, blended(COLOURS[side], 1.0 if seen else FAINT), 2 * radius)
        if {"head", "neck"} <= set(names):
            self._draw_head(image, joints[names.index("neck")], joints[names.index("head")], middle, HEAD[1] * height)

    def _draw_head(
        self, image: np.ndarray, neck: np.ndarray, head: np.ndarray, middle: np.ndarray, radius: float
    ) -> None:
        up = (head - neck) / max(float(np.linalg.norm(head - neck)), 1e-6)
        ends = np.stack([head + 0.9 * radius * up, head + 1.3 * radius * up])
        self._limb(image, ends, middle, COLOURS["middle"], 1.7 * radius)

    def _limb(
        self, image: np.ndarray, ends: np.ndarray, middle: np.ndarray, colour: tuple[int, int, int], width: float
    ) -> None:
        """Draw a capsule. width: m."""
        self._line(image, ends, middle, colour, max(round(width * self._px / METRES), 1))

    def _line(
        self, image: np.ndarray, ends: np.ndarray, middle: np.ndarray, colour: tuple[int, int, int], width: int
    ) -> None:
        points = self._to_px(ends, middle)
        if np.isfinite(points).all() and np.abs(points).max() < 20 * self._px:
            first, second = np.round(points).astype(int).tolist()
            self._cv2.line(image, first, second, colour, width, self._cv2.LINE_AA)
