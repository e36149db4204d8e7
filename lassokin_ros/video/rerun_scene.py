"""The layout of the viewer Rerun: image with keypoints and skeleton, skeleton with its uncertainty, angles and errors.

`lassokin track --view` (`LiveView`) and the node `viewer` both log through `RerunScene`.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lassokin_ros.common.atomic_files import AtomicFiles
from lassokin_ros.common.command_line import one_line
from lassokin_ros.core.body.rotations import least_turn, logarithm, to_quaternion
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import LassokinError
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.pipeline.camera.calibration_file import Calibration
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.outputs.frame_messages import principal_axes
from lassokin_ros.replay.body import capsules
from lassokin_ros.video.sources import FIRST_STAMP_NS, Image

CAMERA, BODY = "camera", "body"
ANGLES, ERRORS = "angles", "errors"
PLOTS = {ANGLES: "angles, degrees", ERRORS: "errors"}
PLOTTED = ("left_knee", "right_knee", "left_elbow", "right_elbow")
REPROJECTION, UNCERTAINTY = "reprojection", "uncertainty"
FIGURES = {REPROJECTION: "reprojection error, px", UNCERTAINTY: "joint uncertainty, cm"}
COLOURS = {"left": (0, 114, 178), "right": (213, 94, 0), "middle": (77, 77, 77)}
"""Colours of the body's sides, as in the report."""
KEYPOINT, ELLIPSOID = (0, 158, 115), (86, 180, 233)
POINT_SIZE, LINE_SIZE, THIN_SIZE = -3.0, -1.5, -0.5
"""Radii; for Rerun a negative number is in points of the screen, independent of the zoom."""
LONGEST_SIDE = 960
"""px: of the logged images."""
JPEG_QUALITY = 80


class ViewError(LassokinError):
    """The live view cannot be opened or its recording cannot be written."""


class RerunScene:
    """Logs to a viewer window, or records for the viewer.

    `place` in the methods is empty for one person, else "/" and the person's id. `camera` is empty for one camera, else
    its name.
    """

    def __init__(
        self,
        path: Path | None,
        name: str,
        option: str,
        files: AtomicFiles,
        timeline: str,
        cameras: Sequence[str] = ("",),
        z_up: bool = False,
    ) -> None:
        """path: of the recording (.rrd); None opens a window. name: of the recording in the viewer.

        option: the option or command that asks for the scene, for errors. files: takes the recording. cameras: their
        names. z_up: whether the body's frame has z up, and is not the optical frame of a camera.
        Raises ViewError.
        """
        self._rerun = _rerun(option)
        self._path, self._option, self._timeline = path, option, timeline
        self._cameras, self._scales = tuple(cameras), dict[str, float]()
        self._stream = self._rerun.RecordingStream("lassokin")
        self._stream.send_recording_name(name)
        self._open(files)
        self.set_axes(z_up)
        lines = self._rerun.SeriesLines
        for joint in PLOTTED:
            self._log(f"{ANGLES}/{joint}", lines(colors=COLOURS[joint.split("_")[0]], names=joint), static=True)
        for figure, title in FIGURES.items():
            self._log(f"{ERRORS}/{figure}", lines(names=title), static=True)

    def set_axes(self, z_up: bool) -> None:
        """Set whether the body's frame has z up, see `__init__`."""
        axes = self._rerun.ViewCoordinates
        self._log("/", axes.RIGHT_HAND_Z_UP if z_up else axes.RDF, static=True)

    def set_time(self, **time: Any) -> None:
        """Set the time of what is logged next: duration in s, or timestamp in s or as datetime64."""
        self._stream.set_time(self._timeline, **time)

    def set_camera(self, K: np.ndarray, size: tuple[int, int], camera: str = "") -> None:
        """Log a camera. K: (3, 3) px; size: (width, height) px of the images."""
        scale = self._scales[camera] = min(1.0, LONGEST_SIDE / max(size))
        matrix = K * np.array([[scale], [scale], [1.0]])
        resolution = [side * scale for side in size]
        pinhole = self._rerun.Pinhole(image_from_camera=matrix, resolution=resolution, image_plane_distance=0.5)
        self._log(_image(camera), pinhole, static=True)

    def add_place(self, camera: str, pose: CameraPose) -> None:
        """Log where a camera is in the body's frame."""
        self._log(_camera(camera), self._rerun.Transform3D(translation=pose.centre, mat3x3=pose.rotation.T))

    def add_image(self, rgb: np.ndarray, camera: str = "") -> None:
        """Log an image (height, width, 3), uint8 RGB."""
        import cv2

        scale = min(1.0, LONGEST_SIDE / max(rgb.shape[:2]))
        self._scales.setdefault(camera, scale)
        if scale < 1.0:
            rgb = cv2.resize(rgb, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        self._log(_image(camera), self._rerun.Image(rgb).compress(jpeg_quality=JPEG_QUALITY))

    def add_keypoints(self, place: str, pixels: np.ndarray, camera: str = "") -> None:
        """Log keypoints (l, 2) px, NaN = missing."""
        points = pixels[np.isfinite(pixels).all(axis=1)] * self._scales.get(camera, 1.0)
        self._log(f"{_image(camera)}/keypoints{place}", self._rerun.Points2D(points, colors=KEYPOINT, radii=POINT_SIZE))

    def add_skeleton(self, place: str, skeleton: Skeleton, joints: np.ndarray) -> None:
        """Log the body at joints (n, 3) m."""
        self._log(f"{BODY}/skeleton{place}", self._capsules(skeleton, joints))

    def add_outline(self, place: str, skeleton: Skeleton, pixels: np.ndarray, camera: str = "") -> None:
        """Log the body in an image. pixels: its joints (n, 2) px."""
        bones = np.array([(parent, joint) for joint, parent in enumerate(skeleton.parents) if parent >= 0])
        colours = [COLOURS.get(skeleton.joint_names[joint].split("_")[0], COLOURS["middle"]) for _, joint in bones]
        points = pixels[bones] * self._scales.get(camera, 1.0)
        lines = self._rerun.LineStrips2D(points, colors=colours, radii=LINE_SIZE)
        self._log(f"{_image(camera)}/skeleton{place}", lines)

    def _capsules(self, skeleton: Skeleton, joints: np.ndarray) -> Any:
        """Return the body as capsules. Rerun's capsule lies along z from its translation."""
        first, last, radii, sides = zip(*capsules(skeleton))
        axes = joints[list(last)] - joints[list(first)]
        turns = [least_turn(np.array([0.0, 0.0, 1.0]), axis) for axis in axes]
        return self._rerun.Capsules3D(
            lengths=np.linalg.norm(axes, axis=1),
            radii=np.array(radii),
            translations=joints[list(first)],
            quaternions=to_quaternion(np.array(turns)),
            colors=[COLOURS[side] for side in sides],
        )

    def add_uncertainty(self, place: str, joints: np.ndarray, covariance: np.ndarray, deviation: np.ndarray) -> None:
        """Log an ellipsoid about each joint. joints: (n, 3) m, covariance: (n, 3, 3) m^2, deviation: (n,) m."""
        quaternions, half_sizes = principal_axes(covariance)
        ellipsoid = self._rerun.Ellipsoids3D(
            centers=joints, half_sizes=half_sizes, quaternions=quaternions, colors=ELLIPSOID, line_radii=THIN_SIZE
        )
        self._log(f"{BODY}/uncertainty{place}", ellipsoid)
        self.add_error(place, UNCERTAINTY, 100 * float(deviation[1:].mean()))

    def add_angles(self, place: str, skeleton: Skeleton, rotations: np.ndarray) -> None:
        """Log how far some joints are bent. rotations: (n, 3, 3), of each joint relative to its parent."""
        bends = np.degrees(np.linalg.norm(logarithm(rotations), axis=1))
        for name in PLOTTED:
            if name in skeleton.joint_names:
                self._plot(f"{ANGLES}/{name}{place}", bends[skeleton.joint_names.index(name)])

    def add_error(self, place: str, figure: str, value: float) -> None:
        """Log a figure of FIGURES, in its unit."""
        self._plot(f"{ERRORS}/{figure}{place}", value)

    def clear(self, place: str) -> None:
        """Remove the skeleton from the view."""
        images = (f"{_image(camera)}/skeleton{place}" for camera in self._cameras)
        for path in (*images, f"{BODY}/skeleton{place}", f"{BODY}/uncertainty{place}"):
            self._log(path, self._rerun.Clear(recursive=False))

    def finish(self) -> None:
        """End the recording. A second call does nothing. Raises ViewError."""
        try:
            self._stream.flush()
        except Exception as error:  # RuntimeError of Rerun, such as for a full disk, or its own of newer releases
            reason = one_line(error, 200)
            raise ViewError(f"'{self._path or 'the view'}' cannot be written completely: {reason}") from None
        self._stream.disconnect()

    def _open(self, files: AtomicFiles) -> None:
        display = sys.platform != "linux" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
        if self._path is None and not display:
            raise ViewError(
                f"{self._option} opens a window, and this machine has no display; record for the viewer instead, with "
                "a name that ends in .rrd"
            )
        if self._path is not None and self._path.suffix != ".rrd":
            raise ViewError(f"{self._option} '{self._path}'; expected a name that ends in .rrd, or none (a window)")
        part = None if self._path is None else files.part(self._path)
        try:
            if part is None:
                self._stream.spawn(default_blueprint=self._blueprint())
            else:
                self._stream.save(part, default_blueprint=self._blueprint())
        except Exception as error:  # Rerun's own, of several kinds
            failed = "the viewer cannot be started" if part is None else f"'{self._path}' cannot be written"
            raise ViewError(f"{failed}: {one_line(error, 200)}") from None

    def _blueprint(self) -> Any:
        from rerun import blueprint

        plots = [blueprint.TimeSeriesView(origin=place, name=name) for place, name in PLOTS.items()]
        images = [blueprint.Spatial2DView(origin=_image(name), name=name or "image") for name in self._cameras]
        space = blueprint.Spatial3DView(origin="/", contents=[f"/{CAMERA}/**", f"/{BODY}/**"], name="skeleton")
        return blueprint.Blueprint(
            blueprint.Vertical(blueprint.Horizontal(*images, space), blueprint.Horizontal(*plots), row_shares=[2, 1]),
            collapse_panels=True,
        )

    def _plot(self, path: str, value: float) -> None:
        self._log(path, self._rerun.Scalars(float(value)))

    def _log(self, path: str, what: Any, static: bool = False) -> None:
        self._stream.log(path, what, static=static)


class LiveView(RerunScene):
    """Shows a run of `track` in a viewer window, or records it."""

    def __init__(
        self,
        path: Path | None,
        name: str,
        cameras: Mapping[str, tuple[Calibration, tuple[int, int]]],
        files: AtomicFiles,
        z_up: bool = False,
    ) -> None:
        """cameras: by name, empty if there is one, the lens and (width, height) px of the images. Raises ViewError.

        path, name, files, z_up: see RerunScene.
        """
        super().__init__(path, name, "--view", files, "video", tuple(cameras), z_up)
        for camera, (calibration, size) in cameras.items():
            self.set_camera(calibration.K, size, camera)

    def add_images(self, images: Mapping[str, Image]) -> None:
        """Show the images of one instant, by camera, at the time of the first one."""
        self.set_time(duration=next(iter(images.values())).seconds)
        for camera, image in images.items():
            self.add_image(image.rgb, camera)

    def add(self, stamp_ns: int, frames: Sequence[FrameResult]) -> None:
        """Show the results for the images of this stamp."""
        self.set_time(duration=(stamp_ns - FIRST_STAMP_NS) * 1e-9)
        several = len(self._cameras) > 1
        for frame in frames:
            place = f"/{frame.person}" if frame.person else ""
            views = [(image.camera.name if several else "", image) for image in frame.images]
            for camera, image in views:
                if several:
                    self.add_place(camera, image.camera)
                if image.detected is not None:
                    self.add_keypoints(place, image.detected, camera)
            estimate, skeleton = frame.estimate, frame.skeleton
            if not frame.accepted or estimate is None or estimate.pose is None or skeleton is None:
                self.clear(place)
                continue
            assert estimate.state is not None
            joints, uncertainty = estimate.pose.positions, frame.uncertainty
            self.add_skeleton(place, skeleton, joints)
            for camera, image in views:
                self.add_outline(place, skeleton, image.project(joints), camera)
            self.add_uncertainty(place, joints, uncertainty.covariance, uncertainty.deviation)
            self.add_angles(place, skeleton, estimate.state.rotations)
            self.add_error(place, REPROJECTION, estimate.reprojection_px)


def _camera(name: str) -> str:
    return f"{CAMERA}/{name}" if name else CAMERA


def _image(camera: str) -> str:
    return f"{_camera(camera)}/image"


def _rerun(option: str) -> Any:
    try:
        import rerun
    except ImportError as error:
        if isinstance(error, ModuleNotFoundError) and error.name == "rerun":
            raise ViewError(f"{option} needs rerun-sdk; install it with: pip install '.[view]'") from None
        raise ViewError(f"{option} needs rerun-sdk, which is installed but cannot be imported: {error}") from None
    return rerun
