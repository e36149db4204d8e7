"""The settings that follow from the options of `track`, and what a video has no use for."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from lassokin_ros.core.errors import LassokinError
from lassokin_ros.pipeline.settings import NodeSettings
from lassokin_ros.video.command import parser
from lassokin_ros.video.run_settings import settings_of

CONFIG = Path(__file__).resolve().parents[2] / "config"


def settings(*words, layout="coco17", several=False):
    options = parser().parse_args(["walk.mp4", *map(str, words)])
    return settings_of(options, [SimpleNamespace(name="", source=SimpleNamespace(live=False))], layout, several)


@pytest.mark.parametrize("file", sorted(CONFIG.glob("*.yaml")), ids=lambda file: file.stem)
def test_a_parameter_file_of_a_robot_is_used_without_its_topics(file):
    """The keypoints are this program's own, there are no depth images, and those of a video are raw."""
    config, node = settings("--params-file", file, "--height", "1.75", several=True)
    assert (config.height, config.landmarks) == (1.75, "coco17")
    assert (node.depth, node.keypoints_type, node.rectified) == ("", NodeSettings().keypoints_type, False)
    assert settings("--params-file", file, "--height", "1.75", "-p", "rectified:=true", several=True)[1].rectified


def test_what_one_video_has_no_use_for_is_said(capsys):
    config, node = settings("-p", "fixed_frame:=base_link", "-p", "max_people:=2")
    assert (node.fixed_frame, node.max_people) == ("", 1)
    said = capsys.readouterr().err.splitlines()
    assert said[0].startswith("lassokin track: fixed_frame is not used, since a video has no TF") and len(said) == 2
    assert "max_people and rep155 are not used, since mediapipe finds one person" in said[1]


@pytest.mark.parametrize(
    "words, text",
    [
        (["--height", "0"], "with camera_height and tilt_deviation above 0; expected both, or --height"),
        (
            ["--height", "0", "-p", "camera_height:=1.3", "-p", "tilt_deviation:=0.0"],
            "camera_height and tilt_deviation above 0; expected",
        ),
        (["-p", "height:=tall"], "height"),
        (["-p", "cameras:=[a]"], "cameras is a; expected no setting: one video has one camera"),
        (["-p", "cameras:=[a,b]"], "cameras is a, b; expected no setting"),
        (
            ["-p", "fixed_frame:=map", "-p", "floor:=true"],
            "a video has no TF to say where the floor is; set camera_height",
        ),
        (["--person", "nearest"], "--person nearest: mediapipe finds one person; expected YOLO-pose or RTMO"),
    ],
)
def test_unusable_settings_are_refused(words, text):
    with pytest.raises(LassokinError, match=text):
        settings(*words)


def test_track_takes_the_skeleton_of_the_detectors_layout(tmp_path):
    """Unless a parameter names another one."""
    mine = tmp_path / "mine.yaml"
    mine.write_text("tracker:\n  ros__parameters:\n    skeleton: left_hand\n")
    cases = {
        (): ("mediapipe", "mediapipe33", "anthropometric"),
        ("--hands",): ("mediapipe_hands", "mediapipe75", "body_hands"),
        ("--detector", "whole.onnx"): ("whole.onnx", "coco133", "body_hands"),
        ("--hands", "--params-file", str(mine)): ("mediapipe_hands", "mediapipe75", "left_hand"),
    }
    for words, (name, layout, skeleton) in cases.items():
        assert parser().parse_args(["walk.mp4", *words]).detector == name
        config, _ = settings("--height", "1.7", *words, layout=layout)
        assert (config.landmarks, config.skeleton) == (layout, skeleton)
