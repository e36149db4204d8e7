"""The person's height, measured with depth, with several cameras, or with feet on a floor.

One camera does not observe size: a body twice as tall at twice the distance gives the same keypoints. With several
cameras, the scale is the sum of the triangulated lengths of limbs and trunk, relative to the skeleton's. With depths,
scale and translation are fitted in each frame by robust least squares (docs/method.md, section 12). The logarithms of
the frames' scales are averaged over time, with a prior of people's heights; until there is one, the height of an adult
is assumed. A given height is checked by the same lengths; the check changes the stated uncertainty, not the poses.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.roles import sided
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TYPICAL_HEIGHT
from lassokin_ros.core.evidence.evidence import EvaluatedState
from lassokin_ros.core.evidence.feet import ANKLE_HEIGHT, FLOOR_DEVIATION
from lassokin_ros.core.image.measurement import Measurement
from lassokin_ros.core.observation import CameraPose, has_passed

PEOPLE_DEVIATION, ASSUMED_DEVIATION = 0.15, 0.24
"""Standard deviation of the logarithm of people's heights about that of `TYPICAL_HEIGHT`, children included; and while
nothing has measured the height: children of four years, 1.05 m, are two of it below."""
FEWEST_DEPTHS = 4
"""Smallest number of measured depths in a frame."""
FRAME_DEVIATION, LEAST_DEVIATION = 0.04, 0.035
"""Standard deviation of the logarithm of one frame's scale, in addition to that of the fit, for the pose's errors; and
lower limit of that of the average, because people's proportions differ from the skeleton's."""
CORRELATED_S, TIME_CONSTANT_S = 0.1, 5.0
"""s: frames closer than this count as one, because their errors are correlated; and time constant of the average. The
first frames' poses are the least exact."""
LARGEST_FLOOR_DEVIATION = 0.05
"""Standard deviation of the logarithm, by tilt and distance, above which feet on the floor do not measure the size."""
CHANGE, PAUSE_S = 0.01, 0.25
"""Change of the logarithm from which a new height is adopted; s between two adoptions."""
RANGE = 0.5, 2.3
"""m: limits of the height. A frame outside them is ignored: its depths are those of the wall behind, for example."""


@dataclass(eq=False)
class FloorSize:
    """ratio: size by the floor / size in use. deviation: standard deviation of its logarithm by tilt and distance."""

    ratio: float
    deviation: float


class HeightEstimator:
    """Averages the scales of one person's frames."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the person."""
        self._information = self._weighted = 0.0
        self._stamp = self._adopted_at = -np.inf
        self._floor_since = np.inf
        self.floor_deviation = 0.0
        """Standard deviation of the logarithm by the camera's tilt and the distance in the last frame with feet on the
        floor, whether it was used or not; 0 if there was none."""

    @property
    def measured(self) -> bool:
        """True after the first frame with enough depths."""
        return self._information > 0

    @property
    def height(self) -> float:
        """Best estimate of the height, m."""
        prior = PEOPLE_DEVIATION**-2
        return float(np.clip(TYPICAL_HEIGHT * np.exp(self._weighted / (self._information + prior)), *RANGE))

    @property
    def deviation(self) -> float:
        """Standard deviation of `height`, m. The camera's tilt is wrong by the same in all frames."""
        if not self.measured:
            return self.height * ASSUMED_DEVIATION
        floor = min(self.floor_deviation, LARGEST_FLOOR_DEVIATION)
        averaged = (self._information + PEOPLE_DEVIATION**-2) ** -0.5
        return self.height * float(np.sqrt(LEAST_DEVIATION**2 + averaged**2 + floor**2))

    def update(
        self,
        measurement: Measurement,
        solved: EvaluatedState,
        camera: CameraPose,
        height: float,
        lengths: tuple[np.ndarray, np.ndarray] | None = None,
        floor: FloorSize | None = None,
    ) -> bool:
        """Use a tracked frame. Returns True if the estimate should replace the height in use.

        camera: the one that measured. height: m, of the skeleton in use. lengths: (k,) m, as several cameras measure
        them, and those of that skeleton. floor: from feet on the floor; it is used in frames without measured depth.
        """
        stamp = measurement.stamp
        if lengths is not None and len(lengths[0]) >= FEWEST_DEPTHS:
            measured, given = (float(one.sum()) for one in lengths)
            self._add(stamp, measured / given * height, 0.1 / np.sqrt(len(lengths[0])))  # one limb's, with proportions
        elif measurement.depth is not None:
            if not measurement.repeated and measurement.depth_count >= FEWEST_DEPTHS:
                root = camera.into_camera(solved.state.translation)
                scale, deviation = fit_scale(measurement, camera.into_camera(solved.pose.landmarks) - root, root)
                if RANGE[0] < scale * height < RANGE[1]:
                    self._add(stamp, scale * height, deviation)
        elif floor is not None:
            self.floor_deviation, self._floor_since = floor.deviation, min(self._floor_since, stamp)
            usable = floor.deviation < LARGEST_FLOOR_DEVIATION and RANGE[0] < floor.ratio * height < RANGE[1]
            if usable and has_passed(stamp - self._floor_since, 0.5):  # s: the poses and lengths before are less exact
                self._add(stamp, floor.ratio * height, floor.deviation)
        changed = self.measured and abs(np.log(self.height / height)) >= CHANGE
        if not (changed and has_passed(stamp - self._adopted_at, PAUSE_S)):
            return False
        self._adopted_at = stamp
        return True

    def _add(self, stamp: float, height: float, deviation: float) -> None:
        """Average a frame's height, m, whose logarithm has this standard deviation by its fit."""
        elapsed, self._stamp = stamp - self._stamp, stamp
        fade = np.exp(-min(elapsed, 1e3) / TIME_CONSTANT_S)
        share = min(elapsed / CORRELATED_S, 1.0)
        information = share / (FRAME_DEVIATION**2 + deviation**2)
        self._information = fade * self._information + information
        self._weighted = fade * self._weighted + information * float(np.log(height / TYPICAL_HEIGHT))


def fit_scale(measurement: Measurement, body: np.ndarray, root: np.ndarray) -> tuple[float, float]:
    """Return the scale and its standard deviation.

    body: (l, 3) m, landmarks relative to the root (3,) m, both in the frame of the camera that measured.
    """
    assert measurement.depth is not None and measurement.depth_weights is not None
    u, d = measurement.points, measurement.depth
    A = np.zeros((len(u), 3, 4))
    A[:, :2, 0] = body[:, :2] - u * body[:, 2:]
    A[:, 0, 1] = A[:, 1, 2] = 1.0
    A[:, :2, 3] = -u
    A[:, 2, 0], A[:, 2, 3] = body[:, 2], 1.0
    b = np.zeros((len(u), 3))
    b[:, 2] = d
    seen, near = measurement.weights > 0, np.median(d[measurement.depth_weights > 0])
    image = np.where(seen, measurement.weights, 0.0) / near
    given = np.column_stack([image, image, measurement.depth_weights])
    solution = np.array([1.0, *root])
    solution[0] = near / np.median((body[:, 2] + root[2])[measurement.depth_weights > 0])
    solution[1:] *= solution[0]
    H = np.eye(4)
    for _ in range(4):
        size = np.abs(A @ solution - b) * given
        weights = given / (1 + (size / 2.5) ** 2)  # of Geman and McClure's loss
        rows, right = (A * weights[..., None]).reshape(-1, 4), (b * weights).ravel()
        H = rows.T @ rows + 1e-9 * np.eye(4)
        solution = np.linalg.solve(H, rows.T @ right)
    return float(solution[0]), float(np.sqrt(np.linalg.inv(H)[0, 0]))


def floor_size(
    ankles: np.ndarray, floor: np.ndarray, centre: np.ndarray, height: float, tilt_deviation: float
) -> FloorSize | None:
    """Return the size by the ankles (k, 3) m of standing feet; None if they are not below the camera.

    Feet that stand are on the floor: the body is scaled about the camera until its ankles are at their height.

    floor: (4,) as in `FrameData`; centre: (3,) m, of the camera; height: m, of the body in use; tilt_deviation: rad, of
    the floor's normal. It moves a point at a distance d by d * tilt_deviation up or down.
    """
    up, camera_height = floor[:3], float(floor[:3] @ centre + floor[3])
    if camera_height <= 0 or not len(ankles):
        return None
    lower = ankles[np.argmin(ankles @ up)] - centre  # the heel of the other one may be raised
    rise = float(lower @ up)
    below = ANKLE_HEIGHT * height - rise
    if below <= 0:
        return None
    distance = float(np.linalg.norm(lower - rise * up))
    return FloorSize(camera_height / below, float(np.hypot(tilt_deviation * distance, FLOOR_DEVIATION)) / camera_height)


FEWEST_FRAMES = 20
"""Frames until there is a result, the median over the limbs of the last 100."""
LARGEST_RATIO = 1.6
"""Ratio of a limb from which on, or from the inverse, one of its ends is considered to be on an occluder."""
LIMIT = 0.12
"""Logarithm of the ratio from which on the given height is considered wrong; with the right one it is at most 0.11."""


class SizeCheck:
    """Finds the ratio of measured and given lengths of one person."""

    def __init__(self, kinematics: Kinematics) -> None:
        """kinematics: with the given skeleton."""
        self._kinematics = kinematics
        self.use(kinematics.skeleton)

    def use(self, given: Skeleton) -> None:
        """Use another given skeleton with the same tree, and forget the person."""
        layout = self._kinematics.layout.scaled(given.height / self._kinematics.skeleton.height)
        joints, rest = layout.joints, given.rest_positions[layout.joints] + layout.offsets
        # Pairs of landmarks: one of a joint, one of a child of that joint.
        limbs = np.argwhere(given.parents[joints] == joints[:, None])
        limbs = limbs[np.linalg.norm(rest[limbs[:, 0]] - rest[limbs[:, 1]], axis=1) > 0.08 * given.height]
        sides = [pair for pair in zip(sided("shoulder"), sided("hip")) if set(pair) <= set(given.joint_names)]
        trunk = [np.argwhere(np.outer(*(joints == given.index(name) for name in side))) for side in sides]
        self._limbs, self._ends = limbs.T, np.concatenate([limbs, *trunk])
        self._lengths = np.linalg.norm(rest[self._ends[:, 0]] - rest[self._ends[:, 1]], axis=1)
        self.reset()

    def reset(self) -> None:
        """Forget the person."""
        self._newest = -math.inf
        self._ratios: deque[np.ndarray] = deque(maxlen=100)

    def is_due(self, stamp: float) -> bool:
        """Return whether a frame at a stamp, s, is used."""
        return has_passed(stamp - self._newest, CORRELATED_S)

    def add(self, stamp: float, ratios: np.ndarray) -> None:
        """Use the ratios (k,) of measured and given lengths of a frame. stamp: s."""
        if len(ratios) and self.is_due(stamp):
            self._newest = stamp
            self._ratios.append(ratios)

    @property
    def ratio(self) -> float:
        """Measured size / given size; 1 until enough frames were used."""
        return float(np.median(np.concatenate(self._ratios))) if len(self._ratios) >= FEWEST_FRAMES else 1.0

    @property
    def wrong(self) -> bool:
        """True if the given height is probably wrong."""
        return abs(math.log(self.ratio)) > LIMIT

    def ratios(self, places: np.ndarray, usable: np.ndarray) -> np.ndarray:
        """Ratios of the limbs' measured and given lengths, of all bodies. places: (..., l, 3) m; usable: (..., l)."""
        above, below = self._limbs
        measured = np.linalg.norm(places[..., above, :] - places[..., below, :], axis=-1)
        found = (measured / self._lengths[: len(above)])[usable[..., above] & usable[..., below]]
        return np.asarray(found[(found > 1 / LARGEST_RATIO) & (found < LARGEST_RATIO)])

    def lengths(self, places: np.ndarray, usable: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Measured and given lengths (k,) m of the limbs and of both sides of the trunk, without implausible ones.

        places: (l, 3) m; usable: (l,).
        """
        seen = usable[self._ends].all(axis=1)
        a, b = places[self._ends[seen]].swapaxes(0, 1)
        measured, given = np.linalg.norm(a - b, axis=1), self._lengths[seen]
        plausible = (measured < LARGEST_RATIO * given) & (given < LARGEST_RATIO * measured)
        return measured[plausible], given[plausible]

    def limb_count(self, usable: np.ndarray) -> int:
        """Number of limbs between usable landmarks (..., l), of all bodies."""
        return int(np.count_nonzero(usable[..., self._limbs].all(axis=-2)))

    def update(self, measurement: Measurement) -> None:
        """Use the measured depths of a tracked frame."""
        if measurement.depth is None or measurement.depth_weights is None or measurement.repeated:
            return
        if not self.is_due(measurement.stamp):
            return
        usable = (measurement.depth_weights > 0) & measurement.visible & (measurement.weights > 0)
        places = measurement.depth[:, None] * np.column_stack([measurement.points, np.ones(len(usable))])
        self.add(measurement.stamp, self.ratios(places, usable))
