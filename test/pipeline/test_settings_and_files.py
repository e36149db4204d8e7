"""The node's settings and their sources without ROS: parameter files and `-p`."""

import pytest

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.errors import ConfigurationError
from lassokin_ros.pipeline.parameter_files import offline_settings
from lassokin_ros.pipeline.settings import NodeSettings


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"keypoints_type": "std_msgs/String"}, "keypoints_type is 'std_msgs/String'; expected one of: sensor_msgs"),
        ({"people_type": "std_msgs/String"}, "people_type is 'std_msgs/String'; expected one of: sensor_msgs"),
        ({"frame_prefix": "/human/"}, "frame_prefix is '/human/'; expected a prefix without spaces"),
        ({"frame_prefix": "my human/"}, "frame_prefix is 'my human/'"),
        ({"depth": "depth image"}, "depth is 'depth image'; expected the name of a topic"),
        ({"cameras": ("left cam", "right")}, "cameras has the name 'left cam'; expected letters from a to z"),
        ({"cameras": ("kamera_\u00fc", "right")}, "cameras has the name 'kamera_\u00fc'; expected letters from a to z"),
        ({"cameras": ("left\u0663", "right")}, "expected letters from a to z, digits and _"),  # an Arabic digit
        ({"max_people": 0}, "max_people is 0; expected 1 to 20"),
        ({"max_people": 21}, "max_people is 21; expected 1 to 20"),
        ({"queue_depth": 0}, "queue_depth is 0; expected 1 to 1000"),
        ({"queue_depth": 1001}, "queue_depth is 1001; expected 1 to 1000"),
        ({"forget_after": 0.05}, "forget_after is 0.05; expected 0.1 to 3600 s"),
        ({"forget_after": 3601.0}, "expected 0.1 to 3600 s"),
        ({"person_ids": "nobody"}, "person_ids is 'nobody'; expected"),
        ({"publish_tf": "some"}, "publish_tf is 'some'; expected"),
        ({"rectified": "no"}, "rectified is 'no'; expected a value of type bool"),
    ],
)
def test_bad_settings_are_refused(changes, text):
    with pytest.raises(ConfigurationError) as error:
        NodeSettings(**changes).checked()
    assert text in str(error.value)


def test_settings_at_their_limits_are_accepted():
    assert NodeSettings().checked() == NodeSettings()
    for changes in (
        {"keypoints_type": "sensor_msgs/PointCloud2", "people_type": "people_msgs/People"},
        {"max_people": 1, "queue_depth": 1, "forget_after": 0.1},
        {"max_people": 20, "queue_depth": 1000, "forget_after": 3600.0},
        {"publish_tf": "root"},
        {"publish_tf": "all"},
        {"frame_prefix": "", "depth": "/camera/depth"},
    ):
        settings = NodeSettings(**changes)
        assert settings.checked() is settings


def test_the_defaults_of_the_node_are_those_of_the_reference():
    """A change of a default affects every user."""
    settings = NodeSettings()
    assert (settings.keypoints_type, settings.people_type) == ("sensor_msgs/msg/PointCloud2",) * 2
    assert (settings.depth, settings.rectified, settings.root_frame) == ("", False, "camera_optical_frame")
    assert (settings.frame_prefix, settings.queue_depth) == ("~/", 5)
    assert (settings.max_people, settings.person_ids, settings.forget_after) == (1, "message", 3.0)
    assert (settings.rep155, settings.publish_tf) == (False, "off")


@pytest.mark.parametrize(
    ("people", "rep155", "kind", "several", "per_body"),
    [
        (1, False, "sensor_msgs/msg/PointCloud2", False, False),
        (2, False, "sensor_msgs/msg/PointCloud2", True, False),
        (1, True, "sensor_msgs/msg/PointCloud2", True, False),
        (1, True, "hri_msgs/Skeleton2D", True, True),
        (1, True, "hri_msgs/msg/Skeleton2D", True, True),
        (2, False, "hri_msgs/msg/Skeleton2D", True, False),
    ],
)
def test_topics_of_several_people_have_their_namespace(people, rep155, kind, several, per_body):
    settings = NodeSettings(max_people=people, rep155=rep155, keypoints_type=kind)
    assert (settings.several_people, settings.topic_per_body) == (several, per_body)


def test_later_values_override_earlier_ones(tmp_path):
    first, second = tmp_path / "first.yaml", tmp_path / "second.yaml"
    first.write_text("/**:\n  ros__parameters: {height: 1.6, max_people: 2, noise_px: 4, use_sim_time: true}\n")
    second.write_text("/robot/tracker:\n  ros__parameters: {height: 1.7, qos_overrides.x: 1}\nother:\n  x: 1\n")
    tracker, node = offline_settings([first, second], [])
    assert (tracker.height, tracker.noise_px, node.max_people) == (1.7, 4.0, 2)
    assert isinstance(tracker.noise_px, float)  # an integer where a float is expected
    tracker, node = offline_settings([first, second], ["height:=1.8", "max_people:=3", "frame_prefix:='a:=b'"])
    assert (tracker.height, node.max_people, node.frame_prefix) == (1.8, 3, "a:=b")
    assert offline_settings([], []) == (TrackerConfig(), NodeSettings())


@pytest.mark.parametrize(
    ("assignment", "text"),
    [
        ("height", "-p 'height'; expected name:=value, such as height:=1.80"),
        (":=1", "-p ':=1'; expected name:=value"),
        ("heigth:=1.8", "-p: there is no parameter 'heigth'; did you mean 'height'?"),
        ("qqqqqq:=1", "-p: there is no parameter 'qqqqqq'; expected one of: height, "),
        ("height:=[1", "-p height:=[1 is no valid YAML"),
        ("max_people:=true", "max_people is True; expected a value of type int"),
        ("height:=true", "height is True; expected a value of type float"),
        ("max_people:=2.5", "max_people is 2.5; expected a value of type int"),
    ],
)
def test_bad_assignments_are_refused(assignment, text):
    with pytest.raises(ConfigurationError) as error:
        offline_settings([], [assignment])
    assert text in str(error.value)


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ("camera:\n  ros__parameters: {}\n", "has parameters for camera; expected 'tracker' or '/**' at the top level"),
        ("{}\n", "has parameters for no node; expected"),
        ("tracker:\n  height: 1.8\n", "has no mapping 'ros__parameters' under 'tracker'"),
        ("tracker: 1\n", "has no mapping 'ros__parameters' under 'tracker'"),
        ("tracker:\n  ros__parameters: [1]\n", "has no mapping 'ros__parameters' under 'tracker'"),
        ("tracker:\n  ros__parameters: {heigth: 1.8}\n", "there is no parameter 'heigth'; did you mean 'height'?"),
    ],
)
def test_bad_parameter_files_are_refused(tmp_path, content, text):
    file = tmp_path / "parameters.yaml"
    file.write_text(content)
    with pytest.raises(ConfigurationError) as error:
        offline_settings([file], [])
    assert text in str(error.value) and str(file) in str(error.value)


def test_of_several_trackers_in_a_file_the_named_one_is_used(tmp_path):
    file = tmp_path / "two.yaml"
    file.write_text(
        "/**:\n  ros__parameters: {noise_px: 4.0}\n"
        "/left/tracker:\n  ros__parameters: {camera_pitch: 0.2, height: 1.6}\n"
        "/right/tracker:\n  ros__parameters: {camera_pitch: 0.9}\n"
    )
    for node, pitch, height in (("/left/tracker", 0.2, 1.6), ("right/tracker", 0.9, TrackerConfig().height)):
        tracker, _ = offline_settings([file], [], node=node)
        assert (tracker.camera_pitch, tracker.height, tracker.noise_px) == (pitch, height, 4.0)
    with pytest.raises(ConfigurationError, match="several trackers: /left/tracker, /right/tracker; expected those of"):
        offline_settings([file], [])


@pytest.mark.parametrize("name", ["use_sim_time", "qos_overrides./x.depth", "start_type_description_service"])
def test_parameters_of_every_node_have_no_effect(name):
    assert offline_settings([], [f"{name}:=true"]) == (TrackerConfig(), NodeSettings())
