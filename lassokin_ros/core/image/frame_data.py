"""The measurements of one frame, in the form that all pieces of evidence read."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from lassokin_ros.core.observation import HERE, CameraPose

WITHOUT_DEPTH = 4.0
"""Factor on the noise from which measured depth is not used, see `FrameData.with_larger_noise`."""
LEVEL_CAMERA_UP = np.array([0.0, -1.0, 0.0])
"""(3,) the vertical in the optical frame of a level camera."""


NEARBY, NARROW = 0.5, np.radians(5.0)
"""m, rad: distance of two cameras, and angle between their rays to the person, below which they observe depth and size
no better than one."""


@dataclass(eq=False)
class JointDepths:
    """Depths of k joints relative to the middle of the hips, as the depth network estimates them.

    sight: (3,) unit vector along which depths are measured, in the frame of the skeleton. depths: (k,) m.
    whitening: (k, k) 1/m: whitening @ (depths - truth) has independent errors of unit scale.
    """

    sight: np.ndarray
    depths: np.ndarray
    whitening: np.ndarray


@dataclass(eq=False)
class HandDepths:
    """Depths of a hand's points relative to its wrist, as the hand network estimates them.

    sight: (3,) unit vector along which depths are measured, in the frame of the skeleton. ratios: (k,) difference to
    the wrist's depth from the camera, as a share of it. whitening: (k, k): whitening @ (ratios - truth) has independent
    errors of unit scale.
    """

    sight: np.ndarray
    ratios: np.ndarray
    whitening: np.ndarray


NO_HANDS: tuple[HandDepths | None, HandDepths | None] = (None, None)


@dataclass(eq=False)
class View:
    """What one camera sees of the person.

    points: (l, 2) normalised image coordinates, any finite value where the weight is 0.
    weights: (l,) 1 / standard deviation in that unit, 0 = missing.
    depth: (l,) m, of each landmark along the optical axis, and depth_weights: (l,) 1 / standard deviation, 0 = not
    measured; None in a frame without any. joint_depths: the network's estimate; None without one. camera: its pose.
    hands: the network's estimates of the left and the right hand.
    """

    points: np.ndarray
    weights: np.ndarray
    depth: np.ndarray | None = None
    depth_weights: np.ndarray | None = None
    joint_depths: JointDepths | None = None
    camera: CameraPose = HERE
    hands: tuple[HandDepths | None, HandDepths | None] = NO_HANDS

    @cached_property
    def point_count(self) -> int:
        """Number of image points with weight."""
        return int(np.count_nonzero(self.weights))

    def ray_rows(self) -> np.ndarray:
        """(l, 2, 3) weighted rows x - u z and y - v z of each landmark; they are 0 for places in the camera that the
        keypoint shows.
        """
        rows = np.zeros((len(self.points), 2, 3))
        rows[:, 0, 0] = rows[:, 1, 1] = 1.0
        rows[:, :, 2] = -self.points
        rows *= self.weights[:, None, None]
        return rows

    def for_size(self, ratio: float) -> View:
        """The view with the network's depths for a body that is taller by a factor."""
        given = self.joint_depths
        if given is None:
            return self
        return replace(
            self, joint_depths=replace(given, depths=ratio * given.depths, whitening=given.whitening / ratio)
        )

    def with_larger_noise(self, factor: float) -> View:
        """See `FrameData.with_larger_noise`."""
        depth_weights = self.depth_weights
        if depth_weights is not None:
            depth_weights = depth_weights / factor if factor < WITHOUT_DEPTH else np.zeros_like(depth_weights)
        return replace(self, weights=self.weights / factor, depth_weights=depth_weights)


@dataclass(eq=False)
class FrameData:
    """The measurements of one frame, as arrays.

    views: of all cameras, at least one. up: (3,) unit vector, the vertical in the frame of the skeleton.
    extra: data for the user's own evidence, by name, as in `Observation.extra`.
    anchors: (2, 3) m, where the left and the right ankle stand still, any finite value for one that does not; None if
    neither does. stiffness: (2,) 1/m, 1 / standard deviation of these ankles about their anchors in each direction, 0
    for one that does not stand.
    floor: (4,) n and h: a point p (3,) m is n p + h m above a flat floor; None if it is not known.
    """

    views: tuple[View, ...]
    up: np.ndarray = field(default_factory=lambda: LEVEL_CAMERA_UP)
    extra: Mapping[str, Any] = field(default_factory=dict)
    anchors: np.ndarray | None = None
    stiffness: np.ndarray | None = None
    floor: np.ndarray | None = None

    @cached_property
    def observes_depth(self) -> bool:
        """Whether the depth of half of the landmarks is measured, or several cameras see the person."""
        return self.depth_covers or self.seen_by > 1

    @property
    def depth_measured(self) -> bool:
        """Whether measured depths are used."""
        return any(view.depth_weights is not None for view in self.views)

    @cached_property
    def depth_covers(self) -> bool:
        """Whether half of a camera's used keypoints or more have a measured depth."""
        return any(
            2 * np.count_nonzero(view.depth_weights) >= view.point_count
            for view in self.views
            if view.depth_weights is not None
        )

    @cached_property
    def seen_by(self) -> int:
        """Number of cameras whose rows have weight, without those beside one that is counted, see `NARROW`."""
        counted: list[View] = []
        for view in self.views:
            if view.point_count and not any(_beside(view, other) for other in counted):
                counted.append(view)
        return len(counted)

    @property
    def point_count(self) -> int:
        """Number of image points with weight, of all cameras."""
        return sum(view.point_count for view in self.views)

    @property
    def count(self) -> int:
        """Number of image points and measured depths with weight, of all cameras."""
        depths = (view.depth_weights for view in self.views if view.depth_weights is not None)
        return self.point_count + sum(int(np.count_nonzero(weights)) for weights in depths)

    @cached_property
    def seeing(self) -> View:
        """The first view with any point that has weight; the first one if there is none."""
        return next((view for view in self.views if view.point_count), self.views[0])

    def held(self, anchors: np.ndarray, stiffness: np.ndarray) -> FrameData:
        """The frame with feet that stand still."""
        held = FrameData.__new__(FrameData)  # with the cached properties, other than by `replace`
        held.__dict__.update(self.__dict__, anchors=anchors, stiffness=stiffness)
        return held

    def with_weights(self, weights: Iterable[np.ndarray]) -> FrameData:
        """The frame with other weights (l,) of each view."""
        return replace(self, views=tuple(replace(view, weights=one) for view, one in zip(self.views, weights)))

    def for_size(self, ratio: float) -> FrameData:
        """The frame with the network's depths for a body that is taller by a factor."""
        return replace(self, views=tuple(view.for_size(ratio) for view in self.views))

    def with_larger_noise(self, factor: float) -> FrameData:
        """The frame with the keypoints' noise made larger by a factor.

        Depth is not used while the factor is `WITHOUT_DEPTH` or more: the image places the body first. Otherwise the
        body could settle between an occluder and the person.
        """
        return replace(self, views=tuple(view.with_larger_noise(factor) for view in self.views))


def _beside(one: View, other: View) -> bool:
    """Whether two cameras see the person from nearly the same place."""
    if math.dist(one.camera.centre, other.camera.centre) > NEARBY:
        return False
    both = (one.weights > 0) & (other.weights > 0)
    if not both.any():
        return True
    a, b = (np.append(view.points[both].mean(axis=0), 1.0) @ view.camera.rotation for view in (one, other))
    return bool(a @ b > math.cos(NARROW) * math.sqrt((a @ a) * (b @ b)))


LEAST_CONDITION = 1e-3
"""Ratio of the smallest to the largest eigenvalue of a landmark's normal equations below which its place is unknown."""


def triangulate(given: Sequence[View]) -> np.ndarray:
    """(l, 3) m, by weighted least squares on x_i + t_i = u (z + t_z) of the given views; NaN if fewer than two see a
    landmark, or from the same direction.
    """
    count = len(given[0].points)
    H, g, views = np.zeros((count, 3, 3)), np.zeros((count, 3)), np.zeros(count)
    for view in given:
        rows = view.ray_rows()
        right = -(rows @ view.camera.translation)
        rows = rows @ view.camera.rotation
        H += rows.swapaxes(-1, -2) @ rows
        g += (rows.swapaxes(-1, -2) @ right[..., None])[..., 0]
        views += view.weights > 0
    values = np.linalg.eigvalsh(H)
    known = (views > 1) & (values[:, 0] > LEAST_CONDITION * values[:, 2])
    places = np.full((count, 3), np.nan)
    places[known] = np.linalg.solve(H[known], g[known][..., None])[..., 0]
    return places
