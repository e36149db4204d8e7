"""`track --view`: image, keypoints, skeleton with its uncertainty, and angles over time, in the viewer Rerun."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.video.camera import Calibration
from lassokin_ros.video.rerun_scene import REPROJECTION, RerunScene
from lassokin_ros.video.sources import Image


class LiveView:
    """Shows a run in a viewer window, or records it. A recording has its name only after `finish`."""

    def __init__(self, path: Path | None, name: str, camera: Calibration, size: tuple[int, int], replace: bool) -> None:
        """path: of the recording (.rrd); None opens a window. size: (width, height) px of the images.

        Raises ViewError.
        """
        self._scene = RerunScene(path, name, "--view", replace, "video")
        self._scene.set_camera(camera.K, size)

    def add_image(self, image: Image) -> None:
        """Show an image at its time."""
        self._scene.set_time(duration=image.seconds)
        self._scene.add_image(image.rgb)

    def add(self, seconds: float, frames: Sequence[FrameResult]) -> None:
        """Show the results for the image of this time."""
        self._scene.set_time(duration=seconds)
        for frame in frames:
            place = f"/{frame.person}" if frame.person else ""
            if frame.detected is not None:
                self._scene.add_keypoints(place, frame.detected)
            if frame.accepted and frame.estimate is not None and frame.estimate.pose is not None:
                self._add_body(place, frame)
            else:
                self._scene.clear(place)

    def _add_body(self, place: str, frame: FrameResult) -> None:
        estimate, skeleton, uncertainty = frame.estimate, frame.skeleton, frame.uncertainty
        assert estimate is not None and estimate.pose is not None and estimate.state is not None
        assert skeleton is not None
        joints = estimate.pose.positions
        self._scene.add_skeleton(place, skeleton, joints, frame.in_image(joints))
        self._scene.add_uncertainty(place, joints, uncertainty.covariance, uncertainty.deviation)
        self._scene.add_angles(place, skeleton, estimate.state.rotations)
        self._scene.add_error(place, REPROJECTION, estimate.reprojection_px)

    def finish(self) -> None:
        """End the recording and give it its name. Raises ViewError."""
        self._scene.finish()

    def discard(self) -> None:
        """Remove what was recorded, unless `finish` has run."""
        self._scene.discard()
