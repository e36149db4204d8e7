"""An accepted frame, in the form in which all that is learned from it, and the estimate, read it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, reduce
from itertools import repeat

import numpy as np

from lassokin_ros.core.body.kinematics import BodyPose
from lassokin_ros.core.cameras import Camera, Cameras
from lassokin_ros.core.evidence.evidence import EvaluatedState
from lassokin_ros.core.hypotheses.start import Start
from lassokin_ros.core.image.frame_data import FrameData
from lassokin_ros.core.image.measurement import Measurement
from lassokin_ros.core.increment import Increment


@dataclass(eq=False)
class Answer:
    """What was measured, the state about which it was linearised, and its lasso's answer.

    cameras: all; measured: of each one with an image; together: of all, see `Cameras.together`. start: the state before
    the increment. solved: the state after the increment.
    """

    cameras: Cameras
    measured: Mapping[Camera, Measurement]
    together: Measurement
    frame: FrameData
    start: Start
    increment: Increment
    solved: EvaluatedState

    @property
    def stamp(self) -> float:
        """s, of the frame."""
        return self.together.stamp

    @property
    def repeated(self) -> bool:
        """Whether the keypoints are those of the frame before, and no new evidence."""
        return self.together.repeated > 0

    @cached_property
    def several(self) -> bool:
        """Whether several cameras observe where the body is."""
        return self.frame.seen_by > 1

    @property
    def place_covariance(self) -> np.ndarray | None:
        """(3, 3) m^2: what the deviations of the cameras' poses add to that of the place; None if they have none.

        Those of cameras on one robot are the same, so that they do not average out.
        """
        if not any(any(camera.pose.deviation) for camera in self.measured):
            return None
        found = np.zeros((3, 3))
        for camera in self.measured:
            turn, shift = camera.pose.deviation
            sight = self.solved.state.translation - camera.pose.centre
            found += turn**2 * (sight @ sight * np.eye(3) - np.outer(sight, sight)) + shift**2 * np.eye(3)
        return found / len(self.measured)

    @property
    def visible(self) -> np.ndarray:
        """(l,) bool: landmarks that a camera has shown and that have a weight."""
        return np.asarray(reduce(np.logical_or, [one.visible & one.used for one in self.measured.values()]))

    def seen(self, frame: FrameData | None = None, predicted: Iterable[bool] = repeat(False)) -> FrameData:
        """The frame, or the one given in its place, without landmarks that were extrapolated and not seen.

        predicted: by camera, whether the points predicted for it without an image stay.
        """
        views = (frame or self.frame).views
        measured = (self.measured.get(camera) for camera in self.cameras)
        return self.frame.with_weights(
            [
                (stay if one is None else one.visible) * view.weights
                for view, one, stay in zip(views, measured, predicted)
            ]
        )

    @property
    def reprojection_px(self) -> Callable[[BodyPose], float]:
        """Gives the error of a pose in px, over the cameras with an image, see `Measurement.reprojection_px`."""
        placed = [(one, camera.pose) for camera, one in self.measured.items()]  # they may move before it is published

        def error(pose: BodyPose) -> float:
            errors = [one.reprojection_px(pose, camera) for one, camera in placed]
            return errors[0] if len(errors) == 1 else math.sqrt(sum(e * e for e in errors) / len(errors))

        return error
