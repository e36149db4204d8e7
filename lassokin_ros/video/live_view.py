"""`track --view`: images, keypoints, skeleton with its uncertainty, and angles over time, in the viewer Rerun."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from lassokin_ros.pipeline.frame_result import FrameResult, ImageOfPerson
from lassokin_ros.video.camera import Calibration
from lassokin_ros.video.rerun_scene import REPROJECTION, RerunScene
from lassokin_ros.video.sources import Image


class LiveView:
    """Shows a run in a viewer window, or records it. A recording has its name only after `finish`."""

    def __init__(
        self,
        path: Path | None,
        name: str,
        cameras: Mapping[str, tuple[Calibration, tuple[int, int]]],
        replace: bool,
        z_up: bool = False,
    ) -> None:
        """path: of the recording (.rrd); None opens a window.

        cameras: by name, empty if there is one, the lens and (width, height) px of the images. z_up: whether the body's
        frame has z up. Raises ViewError.
        """
        self._several = len(cameras) > 1
        self._scene = RerunScene(path, name, "--view", replace, "video", tuple(cameras), z_up)
        for camera, (calibration, size) in cameras.items():
            self._scene.set_camera(calibration.K, size, camera)

    def add_images(self, images: Mapping[str, Image]) -> None:
        """Show the images of one instant, by camera, at the time of the first one."""
        self._scene.set_time(duration=next(iter(images.values())).seconds)
        for camera, image in images.items():
            self._scene.add_image(image.rgb, camera)

    def add(self, seconds: float, frames: Sequence[FrameResult]) -> None:
        """Show the results for the images of this time."""
        self._scene.set_time(duration=seconds)
        for frame in frames:
            place = f"/{frame.person}" if frame.person else ""
            for image in frame.images:
                self._add_image_of(place, image)
            if frame.accepted and frame.estimate is not None and frame.estimate.pose is not None:
                self._add_body(place, frame)
            else:
                self._scene.clear(place)

    def _add_image_of(self, place: str, image: ImageOfPerson) -> None:
        if self._several:
            self._scene.add_place(image.camera.name, image.camera)
        if image.detected is not None:
            self._scene.add_keypoints(place, image.detected, self._name(image))

    def _add_body(self, place: str, frame: FrameResult) -> None:
        estimate, skeleton, uncertainty = frame.estimate, frame.skeleton, frame.uncertainty
        assert estimate is not None and estimate.pose is not None and estimate.state is not None
        assert skeleton is not None
        joints = estimate.pose.positions
        self._scene.add_skeleton(place, skeleton, joints)
        for image in frame.images:
            self._scene.add_outline(place, skeleton, image.project(joints), self._name(image))
        self._scene.add_uncertainty(place, joints, uncertainty.covariance, uncertainty.deviation)
        self._scene.add_angles(place, skeleton, estimate.state.rotations)
        self._scene.add_error(place, REPROJECTION, estimate.reprojection_px)

    def _name(self, image: ImageOfPerson) -> str:
        return image.camera.name if self._several else ""

    def finish(self) -> None:
        """End the recording and give it its name. Raises ViewError."""
        self._scene.finish()

    def discard(self) -> None:
        """Remove what was recorded, unless `finish` has run."""
        self._scene.discard()
