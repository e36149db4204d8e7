"""The live view: image, keypoints, skeleton with its uncertainty, and angles over time, in the viewer Rerun."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lassokin_ros.common.atomic_files import refuse_existing
from lassokin_ros.core.body.rotations import logarithm, to_quaternion
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import LassokinError
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.video.camera import Calibration
from lassokin_ros.video.sources import Image

TIMELINE = "video"
CAMERA, IMAGE, BODY = "camera", "camera/image", "body"
ANGLES, ERRORS = "angles", "errors"
PLOTS = {ANGLES: "angles, degrees", ERRORS: "errors"}
PLOTTED = ("left_knee", "right_knee", "left_elbow", "right_elbow")
FIGURES = {"reprojection": "reprojection error, px", "uncertainty": "joint uncertainty, cm"}
COLOURS = {"left": (0, 114, 178), "right": (213, 94, 0), "middle": (77, 77, 77)}
"""Of the sides, as in the report."""
KEYPOINT, ELLIPSOID = (0, 158, 115), (86, 180, 233)
POINT_SIZE, LINE_SIZE, THIN_SIZE = -3.0, -1.5, -0.5
"""Radii; Rerun takes a negative number for points of the screen, whatever the zoom."""
BONE_M = 0.006
"""m: radius of a bone, less than the usual uncertainty of a joint."""
LONGEST_SIDE = 960
"""px: of the logged images."""
JPEG_QUALITY = 80


class ViewError(LassokinError):
    """The live view cannot be opened or its recording cannot be written."""


class LiveView:
    """Shows a run in a viewer window, or records it. A recording has its name only after `finish`."""

    def __init__(self, path: Path | None, name: str, camera: Calibration, size: tuple[int, int], replace: bool) -> None:
        """path: of the recording (.rrd); None opens a window. size: (width, height) px of the images.

        Raises ViewError.
        """
        self._rerun = _rerun()
        self._path, self._part = path, None if path is None else path.with_name(f".{path.stem}.{os.getpid()}.part.rrd")
        self._scale = min(1.0, LONGEST_SIDE / max(size))
        self._stream = self._rerun.RecordingStream("lassokin_track")
        self._stream.send_recording_name(name)
        self._open(replace)
        self._log_camera(camera, size)

    def add_image(self, image: Image) -> None:
        """Show an image at its time."""
        import cv2

        rgb = image.rgb
        if self._scale < 1.0:
            rgb = cv2.resize(rgb, None, fx=self._scale, fy=self._scale, interpolation=cv2.INTER_AREA)
        self._stream.set_time(TIMELINE, duration=image.seconds)
        self._stream.log(IMAGE, self._rerun.Image(rgb).compress(jpeg_quality=JPEG_QUALITY))

    def add(self, seconds: float, frames: Sequence[FrameResult]) -> None:
        """Show the results for the image of this time."""
        self._stream.set_time(TIMELINE, duration=seconds)
        for frame in frames:
            place = f"/{frame.person}" if frame.person else ""
            if frame.detected is not None:
                points = frame.detected[np.isfinite(frame.detected).all(axis=1)] * self._scale
                self._log(f"{IMAGE}/keypoints{place}", self._rerun.Points2D(points, colors=KEYPOINT, radii=POINT_SIZE))
            if frame.accepted and frame.estimate is not None and frame.estimate.pose is not None and frame.skeleton:
                self._log_body(place, frame, frame.skeleton, frame.estimate.pose.positions)
            else:
                for path in (f"{IMAGE}/skeleton{place}", f"{BODY}/skeleton{place}", f"{BODY}/uncertainty{place}"):
                    self._log(path, self._rerun.Clear(recursive=False))

    def finish(self) -> None:
        """End the recording and give it its name. Raises ViewError."""
        try:
            self._stream.flush()
        except Exception as error:  # RuntimeError of Rerun, such as for a full disk, or its own of newer releases
            reason = " ".join(str(error).split())[:200]
            raise ViewError(f"'{self._path or 'the view'}' cannot be written completely: {reason}") from None
        self._stream.disconnect()
        if self._part is not None and self._path is not None:
            try:
                self._part.replace(self._path)
            except OSError as error:
                raise ViewError(f"'{self._path}' cannot be written: {error.strerror}") from None

    def discard(self) -> None:
        """Remove what was recorded, unless `finish` has run."""
        self._stream.disconnect()
        if self._part is not None:
            self._part.unlink(missing_ok=True)

    def _open(self, replace: bool) -> None:
        if self._path is None or self._part is None:
            try:
                self._stream.spawn(default_blueprint=self._blueprint())
            except Exception as error:  # Rerun's own, of several kinds
                raise ViewError(f"the viewer cannot be started: {' '.join(str(error).split())[:200]}") from None
            return
        if self._path.suffix != ".rrd":
            raise ViewError(f"--view '{self._path}'; expected no value (a window), or a name that ends in .rrd")
        refuse_existing(self._path, replace, ViewError)
        try:
            self._stream.save(self._part, default_blueprint=self._blueprint())
        except Exception as error:
            raise ViewError(f"'{self._path}' cannot be written: {' '.join(str(error).split())[:200]}") from None

    def _blueprint(self) -> Any:
        from rerun import blueprint

        plots = [blueprint.TimeSeriesView(origin=place, name=name) for place, name in PLOTS.items()]
        image = blueprint.Spatial2DView(origin=IMAGE, name="image")
        space = blueprint.Spatial3DView(origin="/", contents=[f"/{CAMERA}/**", f"/{BODY}/**"], name="skeleton")
        return blueprint.Blueprint(
            blueprint.Vertical(blueprint.Horizontal(image, space), blueprint.Horizontal(*plots), row_shares=[2, 1]),
            collapse_panels=True,
        )

    def _log_camera(self, camera: Calibration, size: tuple[int, int]) -> None:
        rerun, scale = self._rerun, self._scale
        matrix = camera.K * np.array([[scale], [scale], [1.0]])
        resolution = [side * scale for side in size]
        self._log("/", rerun.ViewCoordinates.RDF, static=True)
        self._log(
            IMAGE, rerun.Pinhole(image_from_camera=matrix, resolution=resolution, image_plane_distance=0.5), static=True
        )
        for name in PLOTTED:
            colour = COLOURS[name.split("_")[0]]
            self._log(f"{ANGLES}/{name}", rerun.SeriesLines(colors=colour, names=name), static=True)
        for figure, name in FIGURES.items():
            self._log(f"{ERRORS}/{figure}", rerun.SeriesLines(names=name), static=True)

    def _log_body(self, place: str, frame: FrameResult, skeleton: Skeleton, joints: np.ndarray) -> None:
        rerun = self._rerun
        bones = np.array([(parent, joint) for joint, parent in enumerate(skeleton.parents) if parent >= 0])
        colours = [COLOURS[_side(skeleton.joint_names[joint])] for _, joint in bones]
        outline = frame.in_image(joints) * self._scale
        self._log(f"{IMAGE}/skeleton{place}", rerun.LineStrips2D(outline[bones], colors=colours, radii=LINE_SIZE))
        self._log(f"{BODY}/skeleton{place}", rerun.LineStrips3D(joints[bones], colors=colours, radii=BONE_M))
        half_sizes, quaternions = ellipsoids(frame.uncertainty.covariance)
        ellipsoid = rerun.Ellipsoids3D(
            centers=joints, half_sizes=half_sizes, quaternions=quaternions, colors=ELLIPSOID, line_radii=THIN_SIZE
        )
        self._log(f"{BODY}/uncertainty{place}", ellipsoid)
        self._log_plots(place, frame, skeleton)

    def _log_plots(self, place: str, frame: FrameResult, skeleton: Skeleton) -> None:
        assert frame.estimate is not None and frame.estimate.state is not None
        bends = np.degrees(np.linalg.norm(logarithm(frame.estimate.state.rotations), axis=1))
        for name in PLOTTED:
            if name in skeleton.joint_names:
                self._plot(f"{ANGLES}/{name}{place}", bends[skeleton.joint_names.index(name)])
        self._plot(f"{ERRORS}/reprojection{place}", frame.estimate.reprojection_px)
        self._plot(f"{ERRORS}/uncertainty{place}", 100 * frame.uncertainty.deviation[1:].mean())

    def _plot(self, path: str, value: float) -> None:
        self._log(path, self._rerun.Scalars(float(value)))

    def _log(self, path: str, what: Any, static: bool = False) -> None:
        self._stream.log(path, what, static=static)


def ellipsoids(covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the ellipsoids of one standard deviation: half axes (n, 3) m, and orientations (n, 4) x, y, z, w.

    covariance: (n, 3, 3) m^2.
    """
    variances, axes = np.linalg.eigh(covariance)
    axes[..., 0] *= np.sign(np.linalg.det(axes))[:, None]  # right-handed
    return np.sqrt(np.maximum(variances, 0.0)), to_quaternion(axes)


def _side(name: str) -> str:
    first = name.split("_")[0]
    return first if first in COLOURS else "middle"


def _rerun() -> Any:
    try:
        import rerun
    except ImportError:
        raise ViewError("--view needs rerun-sdk; install it with: pip install '.[view]'") from None
    return rerun
