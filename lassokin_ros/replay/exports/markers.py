"""The body as markers, for biomechanics: the points of Halpe-26 with the names of Pose2Sim's OpenSim model.

Pose2Sim's marker set and inverse kinematics `Halpe26` take these names, so its scaling and OpenSim's read the files.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lassokin_ros.core.body.kinematics import BodyState, Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import LayoutError
from lassokin_ros.replay.exports.errors import ExportError
from lassokin_ros.replay.exports.sampling import uniform
from lassokin_ros.replay.motion import Motion

LAYOUT = "halpe26"
NAMES = {"mid_hip": "Hip", "head_top": "Head"}
"""Names of Pose2Sim that do not follow the rule `left_big_toe` to `LBigToe`."""
SIDES = {"left": "L", "right": "R"}


@dataclass(frozen=True, eq=False)
class Markers:
    """Markers at a constant rate. period: s. positions: (f, m, 3) m; y up, x to the camera's right, z towards it.

    The floor under the feet is at y = 0. start: s from the begin of the recording to the first frame.
    """

    period: float
    names: tuple[str, ...]
    positions: np.ndarray
    start: float = 0.0


def markers_of(motion: Motion) -> Markers:
    """Return the markers of one person. Raises ExportError, see `uniform` and `marker_layout`."""
    layout = marker_layout(motion.skeleton)
    track = uniform(motion)
    state = BodyState(track.rotations, track.translations)
    points = Kinematics(motion.skeleton, layout).pose(state).landmarks @ motion.level.T
    names = tuple(marker_name(landmark) for landmark in layout.names)
    return Markers(track.period, names, points * [1.0, -1.0, -1.0] - [0.0, motion.floor, 0.0], motion.start)


def marker_layout(skeleton: Skeleton) -> Layout:
    """Return the places of the markers on a skeleton. Raises ExportError for a skeleton without these points."""
    try:
        return Layout.load(LAYOUT, skeleton)
    except LayoutError as error:
        raise ExportError(f"a .trc or .c3d file needs the points of {LAYOUT}: {error}; export .csv or .npz") from None


def marker_name(landmark: str) -> str:
    """Return Pose2Sim's name of a landmark: `left_big_toe` is LBigToe."""
    if landmark in NAMES:
        return NAMES[landmark]
    return "".join(SIDES.get(word, word.capitalize()) for word in landmark.split("_"))
