"""The tables of docs/reference.md are compared with the running node on real DDS."""

import re
from pathlib import Path

import pytest
import yaml

pytest.importorskip("rclpy")

from live import NodeProcess, Peer, complaints  # noqa: E402
from rcl_interfaces.msg import ParameterType  # noqa: E402
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters  # noqa: E402
from rclpy.node import NodeNameNonExistentError  # noqa: E402
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy  # noqa: E402

from lassokin_ros.core.body.landmarks import Layout  # noqa: E402
from lassokin_ros.core.body.skeleton import Skeleton  # noqa: E402
from lassokin_ros.pipeline.settings import NodeSettings  # noqa: E402
from msg_adapters.detectors.registry import ADAPTERS, full_type_name  # noqa: E402

REFERENCE = (Path(__file__).parents[2] / "docs" / "reference.md").read_text(encoding="utf-8")
NAMESPACE = "/readme"
OWN_TOPICS = {"/rosout", "/parameter_events"}
OWN_SERVICES = re.compile(r".*/(describe_|get_|list_|set_)parameter(s|_types|s_atomically)|.*/get_type_description")
OWN_PARAMETERS = {"use_sim_time", "start_type_description_service"}
FIELDS = {
    ParameterType.PARAMETER_BOOL: "bool_value",
    ParameterType.PARAMETER_INTEGER: "integer_value",
    ParameterType.PARAMETER_DOUBLE: "double_value",
    ParameterType.PARAMETER_STRING: "string_value",
    ParameterType.PARAMETER_STRING_ARRAY: "string_array_value",
}


def table(first_header):
    """The rows, as lists of cells, of the only table whose first column has this header."""
    (block,) = re.findall(rf"(?m)^\| {first_header} \|.*\n\|[-|]+\n((?:\|.*\n)+)", REFERENCE)
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in block.splitlines()]


TOPICS, PARAMETERS = table("direction"), table("parameter")


@pytest.fixture(scope="module")
def peer():
    with NodeProcess(NAMESPACE), Peer(NAMESPACE, outputs=False) as peer:
        peer.next_diagnostics()
        yield peer


def full(name):
    """A relative or private name in the node's namespace."""
    name = name.strip("`").replace("~", "tracker")
    return name if name.startswith("/") else f"{NAMESPACE}/{name}"


def of_node(peer, question, own, complete):
    """Name -> types of one kind of endpoint of the node, after everything in `complete` has been discovered."""
    found = {}

    def known():
        try:
            found.update(dict(getattr(peer.node, f"get_{question}_names_and_types_by_node")("tracker", NAMESPACE)))
        except NodeNameNonExistentError:
            return False
        return complete <= set(found)

    peer.spin_until(known, what=f"every {question} of {complete - set(found)}")
    return {name: types for name, types in found.items() if not own(name)}


def rows(direction):
    """Full name -> (type, remark) of the table's rows of one direction."""
    return {full(name): (*kind.split(", "), "")[:2] for where, name, kind, _ in TOPICS if where == direction}


def test_the_table_of_topics_has_known_directions():
    assert {row[0] for row in TOPICS} == {"in", "in, optional", "out", "service"}
    assert all(len(row) == 4 and row[3] for row in TOPICS)


def test_outputs_are_those_of_the_table(peer):
    expected = {
        name: (NodeSettings().people_type if kind == "parameter `people_type`" else kind, remark)
        for name, (kind, remark) in rows("out").items()
        if name != full("~/hands")  # this node's layout has none
    }
    found = of_node(peer, "publisher", OWN_TOPICS.__contains__, set(expected))
    assert {name: [full_type_name(kind)] for name, (kind, _) in expected.items()} == found
    for name, (_, remark) in expected.items():
        infos = [i for i in peer.node.get_publishers_info_by_topic(name) if i.node_namespace == NAMESPACE]
        latched = [i.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL for i in infos]
        assert latched == [remark == "latched"], name
        assert remark in ("", "latched")
        assert [i.qos_profile.reliability for i in infos] == [ReliabilityPolicy.RELIABLE], name


def test_inputs_are_those_of_the_table(peer):
    expected = {
        name: NodeSettings().keypoints_type if kind == "parameter `keypoints_type`" else kind
        for name, (kind, _) in rows("in").items()
    }
    found = of_node(peer, "subscriber", OWN_TOPICS.__contains__, set(expected))
    assert {name: [full_type_name(kind)] for name, kind in expected.items()} == found
    for name in expected:
        (info,) = [i for i in peer.node.get_subscriptions_info_by_topic(name) if i.node_namespace == NAMESPACE]
        assert info.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT  # matches every publisher


def test_services_are_those_of_the_table(peer):
    expected = rows("service")
    found = of_node(peer, "service", lambda name: OWN_SERVICES.fullmatch(name), set(expected))
    assert {name: [kind.replace("/", "/srv/")] for name, (kind, _) in expected.items()} == found


def test_parameters_are_those_of_the_table(peer):
    names = [row[0].strip("`") for row in PARAMETERS]
    listed = peer.call(ListParameters, "list_parameters", ListParameters.Request()).result.names
    assert {n for n in listed if not n.startswith("qos_overrides")} - OWN_PARAMETERS == set(names)
    values = peer.call(GetParameters, "get_parameters", GetParameters.Request(names=names)).values
    request = DescribeParameters.Request(names=names)
    descriptors = peer.call(DescribeParameters, "describe_parameters", request).descriptors
    for (name, default, unit, limits, live, meaning), value, descriptor in zip(PARAMETERS, values, descriptors):
        expected = yaml.safe_load(default)
        actual = getattr(value, FIELDS[value.type])
        assert (actual, type(actual)) == (expected, type(expected)), name
        assert descriptor.type == value.type and not descriptor.dynamic_typing
        assert descriptor.description == meaning + (f" [{unit}]" if unit else ""), name
        assert descriptor.read_only is (live == ""), name
        assert live in ("", "yes")
        numbers = [*descriptor.floating_point_range, *descriptor.integer_range]
        if limits.startswith("one of: "):
            assert descriptor.additional_constraints == limits and not numbers
        elif limits:
            low, high = map(float, limits.split(" to "))
            assert [(r.from_value, r.to_value) for r in numbers] == [(low, high)], name
        else:
            assert not numbers and not descriptor.additional_constraints, name


def test_topics_of_several_people_are_as_documented(peer):
    """The sentence below the table."""
    assert "under `~/bodies/<id>/`, the ids are on `~/bodies/tracked` (std_msgs/String, latched)" in REFERENCE
    namespace = f"{NAMESPACE}_several"
    with NodeProcess(namespace, "-p", "max_people:=2") as node:
        tracked, markers = f"{namespace}/tracker/bodies/tracked", f"{namespace}/tracker/markers"
        peer.spin_until(lambda: peer.node.get_publishers_info_by_topic(tracked), what="the list of people")
        (info,) = peer.node.get_publishers_info_by_topic(tracked)
        assert info.topic_type == "std_msgs/msg/String"
        assert info.qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL
        peer.spin_until(lambda: peer.node.get_publishers_info_by_topic(markers), what="everybody's markers")
    assert not complaints(node.said)


def test_keypoint_messages_and_layouts_exist():
    """keypoints_type and landmarks of every detector in the table."""
    skeleton = Skeleton.load("anthropometric", 1.75)
    kinds = set()
    for _, kind, landmarks, _ in table("from"):
        kinds.add(full_type_name(kind))
        for layout in landmarks.split(", ") if landmarks != "any" else ():
            assert Layout.load(layout, skeleton).name == layout
    assert kinds == set(ADAPTERS)
