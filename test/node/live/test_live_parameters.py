"""`ros2 param dump`, `load` and `list` on real DDS, as ros2cli does them, and the node's INFO lines."""

import pytest
import yaml

pytest.importorskip("rclpy")

from live import NodeProcess, Peer, node_in_this_process  # noqa: E402
from rclpy.parameter import parameter_value_to_python  # noqa: E402
from rclpy.parameter_client import AsyncParameterClient  # noqa: E402
from std_srvs.srv import SetBool, Trigger  # noqa: E402

OVERRIDE = "qos_overrides./dumped/camera_info.subscription"


class Parameters:
    """The parameters of the node `tracker` in a peer's namespace."""

    def __init__(self, peer):
        self.peer, self.client = peer, AsyncParameterClient(peer.node, "tracker")
        peer.spin_until(self.client.services_are_ready, what="the parameter services")

    def answer(self, future):
        self.peer.spin_until(future.done, what="an answer")
        return future.result()

    def names(self):
        return sorted(self.answer(self.client.list_parameters([], 0)).result.names)

    def dump(self, file):
        """Write the output of `ros2 param dump`; return the values by name."""
        names = self.names()
        values = map(parameter_value_to_python, self.answer(self.client.get_parameters(names)).values)
        found, nested = dict(zip(names, values)), {}
        for name, value in found.items():
            *path, last = name.split(".")
            place = nested
            for part in path:
                place = place.setdefault(part, {})
            place[last] = value
        content = {f"{self.peer.namespace}/tracker": {"ros__parameters": nested}}
        file.write_text(yaml.dump(content, default_flow_style=False))
        return found

    def load(self, file):
        """Do the same as `ros2 param load`; return the reasons of failures."""
        results = self.answer(self.client.load_parameter_file(str(file))).results
        assert results
        return [result.reason for result in results if not result.successful]


def test_an_empty_list_of_cameras_in_a_file_is_one_camera_without_a_name(tmp_path):
    """ROS gives an empty list without the type of its elements."""
    namespace, file, written = "/no_names", tmp_path / "empty.yaml", tmp_path / "dump.yaml"
    file.write_text("/**:\n  ros__parameters:\n    cameras: []\n    height: 1.62\n")
    with NodeProcess(namespace, "--params-file", str(file)) as node, Peer(namespace, outputs=False) as peer:
        found = Parameters(peer).dump(written)
        assert (found["cameras"], found["height"]) == ([""], 1.62)
    assert "reads /no_names/keypoints, /no_names/camera_info" in node.said


def test_a_dump_can_be_loaded(tmp_path):
    """Also with settings that are read at the start, a QoS policy, and `off`, which is a bool in YAML."""
    namespace, file = "/dumped", tmp_path / "tracker.yaml"
    given = "-p", "height:=1.62", "-p", "max_people:=2", "-p", f"{OVERRIDE}.reliability:=reliable"
    with NodeProcess(namespace, *given) as node, Peer(namespace, outputs=False) as peer:
        parameters = Parameters(peer)
        found = parameters.dump(file)
        assert (found["height"], found["max_people"], found["publish_tf"]) == (1.62, 2, "off")
        assert parameters.load(file) == []
        assert parameters.dump(tmp_path / "again.yaml") == found
        file.write_text(
            file.read_text().replace("max_people: 2", "max_people: 3").replace("height: 1.62", "height: 1.7")
        )
        (reason,) = parameters.load(file)
        assert "max_people" in reason and "read-only" in reason
        assert parameters.dump(file) == {**found, "height": 1.7}
    assert node.said.count("height is now") == 1, node.said  # the height of the dump is not changed
    with NodeProcess(namespace, "--params-file", str(file)), Peer(namespace, outputs=False) as peer:
        assert Parameters(peer).dump(file) == {**found, "height": 1.7}


def test_listed_parameters_are_those_of_the_node_or_of_rclpy(tmp_path):
    from lassokin_ros.pipeline.parameter_files import all_settings

    namespace = "/listed"
    with NodeProcess(namespace, "-p", "use_sim_time:=true") as node, Peer(namespace, outputs=False) as peer:
        names = Parameters(peer).names()
        own = [item.name for item in all_settings()]
        assert names == sorted([*own, "use_sim_time", "start_type_description_service"])
        peer.call(Trigger, "reset", Trigger.Request())
        for value in (False, False, True):
            peer.call(SetBool, "set_enabled", SetBool.Request(data=value))
    lines = [line.partition("]: ")[2] for line in node.said.splitlines() if "[INFO]" in line]
    assert [line.partition(":")[0] for line in lines if line.startswith(("reset", "enabled", "disabled"))] == [
        "reset",
        "disabled",
        "enabled",
    ]


def test_the_first_line_has_the_topics_of_several_people():
    with node_in_this_process("/first_of_many", max_people=3) as (node, _):
        assert node._start_text().endswith("publishes /first_of_many/tracker/bodies/<id>/...")


def test_the_first_line_has_version_height_layout_and_the_topics_after_remapping():
    from lassokin_ros.common.command_line import version

    namespace = "/first_line"
    given = "-p", "height:=1.6", "-p", "landmarks:=body25", "-r", "keypoints:=/detector/points", "-r", "__node:=human"
    with NodeProcess(namespace, *given) as node, Peer(namespace, outputs=False) as peer:
        peer.spin_until(lambda: "human" in peer.node.get_node_names(), what="the node")
    first = next(line for line in node.said.splitlines() if "[INFO]" in line).partition("]: ")[2]
    assert first == (
        f"lassokin_ros {version()}: height 1.6 m, landmarks body25, reads /detector/points, /first_line/camera_info, "
        "publishes /first_line/human/..."
    )
