"""Warnings about inputs that are not what they seem, see `pipeline/input_checks`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from lassokin_ros.pipeline.camera_images import UNSCORED
from lassokin_ros.pipeline.input_checks.repeats import FROZEN_S
from lassokin_ros.pipeline.outputs.status.camera_status import of_each_camera
from lassokin_ros.pipeline.pipeline import JUMPS, Pipeline


def input_concerns(pipeline: Pipeline, recent: Counter[str]) -> Iterator[str]:
    """Yield what is unusual about the inputs of a period, in words; recent: counts of the period."""
    yield from filter(
        None,
        (
            of_each_camera(pipeline, lambda camera: camera.stamp_rate.warning),
            _other_camera(pipeline),
            _unscored(recent),
            _frozen_depth(pipeline),
            _jump(pipeline, recent),
            of_each_camera(pipeline, lambda camera: camera.image_size.warning),
            of_each_camera(pipeline, lambda camera: camera.own_depth.warning),
            of_each_camera(pipeline, lambda camera: camera.landmark_ids.warning),
        ),
    )


def _other_camera(pipeline: Pipeline) -> str:
    """Return that camera_info and keypoints of a camera have different frame_ids."""
    for name, one in pipeline.cameras.items():
        if pipeline.image is None or (view := one.camera.view) is None:
            continue
        frame, camera = one.frame_id, view.intrinsics.frame_id
        if frame and camera and frame != camera:
            topic = f"{name}/camera_info" if name else "camera_info"
            return (
                f"{topic} is of another camera: its frame_id is '{camera[:40]}', that of the keypoints '{frame[:40]}'; "
                f"remap {topic} to the camera of the detector, or give both the frame_id of its optical frame"
            )
    return ""


def _unscored(recent: Counter[str]) -> str:
    if not recent[UNSCORED] or recent[UNSCORED] < recent["received"]:
        return ""
    return (
        "the keypoints have positions, but all confidences are 0 or NaN: fill them in the detector (0 to 1; 1 if it "
        "has none)"
    )


def _frozen_depth(pipeline: Pipeline) -> str:
    for name, one in pipeline.cameras.items():
        if one.depth is not None and one.depth.frozen:
            return (
                f"the depth images on {pipeline.config.depth_topic(name)} are frozen: the same one for more than "
                f"{FROZEN_S:g} s, with new stamps, so they are not used; check the depth camera"
            )
    return ""


def _jump(pipeline: Pipeline, recent: Counter[str]) -> str:
    if not recent[JUMPS]:
        return ""
    cameras = "cameras have" if len(pipeline.cameras) > 1 else "camera has"
    return (
        f"TF: the {cameras} jumped in fixed_frame '{pipeline.config.fixed_frame}' by {pipeline.jumps.words} from one "
        "image to the next, and people with it; expected a frame without jumps: was odometry reset, or the robot "
        "localised anew?"
    )
