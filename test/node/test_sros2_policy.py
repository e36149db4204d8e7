"""config/sros2_policy.xml allows what the running node does, and nothing else.

The middleware of the tests has no security plugins, so the policy is compared with the graph of a real node.
"""

from fnmatch import fnmatchcase
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

pytest.importorskip("rclpy")

from live import NodeProcess, Peer  # noqa: E402
from messages import pixels_of_motion  # noqa: E402
from rcl_interfaces.srv import GetParameters, SetParameters  # noqa: E402

from lassokin_ros.node.message_types import message_class  # noqa: E402
from lassokin_ros.pipeline.outputs import topics  # noqa: E402
from lassokin_ros.pipeline.outputs.topics import STATE_PUBLISHER  # noqa: E402

CONFIG = Path(__file__).resolve().parents[2] / "config"
POLICY = CONFIG / "sros2_policy.xml"
CAMERAS = ("", "left", "right")
DEPTH = yaml.safe_load((CONFIG / "realsense.yaml").read_text(encoding="utf-8"))["/**"]["ros__parameters"]["depth"]
CHILD = {"policy": {"enclaves"}, "enclaves": {"enclave"}, "enclave": {"profiles"}, "profiles": {"profile"},
         "profile": {"topics", "services"}, "topics": {"topic"}, "services": {"service"},
         "topic": set(), "service": set()}  # fmt: skip
ATTRIBUTES = {"policy": {"version"}, "enclave": {"path"}, "profile": {"ns", "node"}}
RULES = {"topics": {"publish", "subscribe"}, "services": {"reply", "request"}}
KINDS = {"publish": "publisher", "subscribe": "subscriber", "reply": "service", "request": "client"}
HRI = "hri_msgs/msg/Skeleton2D"
TREE = ElementTree.parse(POLICY).getroot()


def allowed(rule, namespace="", node="tracker"):
    """The full names, with wildcards, for which a rule (publish, subscribe, reply, request) is ALLOW."""
    names = []
    for block in TREE.iter():
        if block.get(rule) == "ALLOW":
            names += [expression.text for expression in block]
    return [f"{namespace}{topics.full_name(name, node)}" if name[0] != "/" else name for name in names]


def test_the_policy_has_the_form_of_sros2():
    assert TREE.tag == "policy" and TREE.get("version") == "0.2.0"
    for element in TREE.iter():
        assert {child.tag for child in element} <= CHILD[element.tag]
        if element.tag in RULES:
            assert len(element.attrib) == 1 and set(element.attrib) <= RULES[element.tag]
            assert set(element.attrib.values()) <= {"ALLOW", "DENY"} and len(element) > 0
        else:
            assert set(element.attrib) == ATTRIBUTES.get(element.tag, set())
        if not CHILD[element.tag]:
            assert element.text and element.text == element.text.strip()
    (profile,) = TREE.iter("profile")
    assert (profile.get("ns"), profile.get("node")) == ("/", "tracker")


def test_the_policy_allows_exactly_the_outputs_of_topics_py():
    outputs = [t.name for t in topics.person_outputs(False, hands=True)]
    people = [topics.of_person(t.name, "*", rep155) for rep155 in (False, True)
              for t in topics.person_outputs(rep155, hands=True)]  # fmt: skip
    others = [
        topics.DIAGNOSTICS,
        topics.PEOPLE,
        topics.SKELETONS,
        topics.STATE,
        topics.TF,
        topics.TRACKED_OUTPUT.name,
        topics.REP155_TRACKED_OUTPUT.name,
    ]
    everything = [topics.full_name(name, "tracker") for name in (*outputs, *people, *others)]
    assert sorted(allowed("publish")) == sorted([*everything, "/parameter_events", "/rosout"])


def test_the_policy_allows_exactly_the_inputs_of_topics_py():
    """And the depth topic of config/realsense.yaml, and those of two cameras."""
    bodies = (topics.REP155_TRACKED_OUTPUT.name, topics.of_person(topics.SKELETON2D, "*", True))
    cameras = [topics.of_camera(name, camera) for name in (topics.KEYPOINTS, topics.CAMERA_INFO) for camera in CAMERAS]
    inputs = (*cameras, DEPTH, topics.CLOCK, topics.TF, topics.TF_STATIC, *bodies)
    assert sorted(allowed("subscribe")) == sorted(topics.full_name(name, "tracker") for name in inputs)


def graph_of(peer):
    """Rule -> names in the graph of the node."""
    ask = {rule: getattr(peer.node, f"get_{kind}_names_and_types_by_node") for rule, kind in KINDS.items()}
    return {rule: {name for name, _ in by_node("tracker", peer.namespace)} for rule, by_node in ask.items()}


def matches(names, patterns):
    """(names that no pattern allows, patterns that allow none of the names)."""
    unheard = {name for name in names if not any(fnmatchcase(name, p) for p in patterns)}
    return unheard, {p for p in patterns if not any(fnmatchcase(name, p) for name in names)}


def endpoints(namespace, expected, detector=(), **settings):
    """Run a node with a visible person until it has used every rule that is expected; check that it uses no others.

    expected: from (rule, pattern) to whether this node uses it. detector: (type, name) of each topic that exists.
    """
    arguments, pixels, sent, done = [], pixels_of_motion(40), 0, {}
    for item in settings.items():
        arguments += ["-p", "{}:={}".format(*item)]
    hands = topics.HANDS[1:], topics.GESTURE[1:]  # are not used by this skeleton
    awaited = {rule: {p for p in allowed(rule, namespace) if expected(rule, p) and not p.endswith(hands)}
               for rule in KINDS}  # fmt: skip
    assert any(awaited.values())

    def all_used():
        nonlocal sent
        sent += 1
        peer.send_camera()
        peer.send(peer.start_ns + sent * 33_000_000, pixels[sent % 40])
        for rule, names in graph_of(peer).items():
            done.setdefault(rule, set()).update(names)
        return not any(matches(done[rule], awaited[rule])[1] for rule in KINDS)

    with NodeProcess(namespace, *arguments), Peer(namespace, outputs=False) as peer:
        for kind, name in detector:
            peer.node.create_publisher(message_class(kind), name, 10)
        for kind, name in ((GetParameters, "get"), (SetParameters, "set")):
            peer.node.create_service(kind, f"{STATE_PUBLISHER}/{name}_parameters", lambda _, response: response)
        peer.next_diagnostics()
        peer.spin_until(lambda: "tracker" in peer.node.get_node_names(), what="the node's name")
        peer.spin_until(all_used, what=f"all of {awaited}")
    for rule, names in done.items():
        assert not matches(names, allowed(rule, namespace))[0], rule


def of_cameras(pattern):
    return any(f"/{camera}/" in pattern for camera in CAMERAS if camera)


def of_bodies(pattern):
    return "/tracker/bodies/" in pattern or pattern.startswith(topics.REP155_BODIES)


def test_one_person_with_depth_uses_exactly_what_the_policy_allows():
    """But TF and several people: see the next tests."""
    one = {"depth": DEPTH, "use_sim_time": "true"}

    def expected(_, name):
        return not of_bodies(name) and not of_cameras(name) and not name.startswith(topics.TF)

    endpoints("/secured", expected, **one)


def test_two_cameras_use_exactly_what_the_policy_allows():
    pytest.importorskip("tf2_msgs", reason="tf2_msgs is not installed: apt, or `make messages`")
    endpoints("/secured_cameras", lambda _, name: of_cameras(name), cameras="[left, right]", fixed_frame="map")


def test_several_people_use_exactly_what_the_policy_allows():
    endpoints("/secured_people", lambda _, name: "/tracker/bodies/" in name, max_people=2)


def test_tf_is_used_exactly_as_the_policy_allows():
    pytest.importorskip("tf2_msgs", reason="tf2_msgs is not installed: apt, or `make messages`")
    endpoints("/secured_tf", lambda _, name: name.startswith(topics.TF), publish_tf="root", fixed_frame="base")


def test_the_bodies_of_a_detector_are_read_exactly_as_the_policy_allows():
    pytest.importorskip("hri_msgs", reason="hri_msgs is not installed: its source, or `make messages`")

    def expected(rule, name):
        return rule == "subscribe" and name.startswith(topics.REP155_BODIES)

    detector = [(HRI, topics.of_person(topics.SKELETON2D, "abc", True))]
    settings = {"keypoints_type": HRI, "landmarks": "hri18", "rep155": "true", "max_people": 2}
    endpoints("/secured_detector", expected, detector, **settings)


def test_bodies_of_the_tracker_use_exactly_what_the_policy_allows():
    pytest.importorskip("hri_msgs", reason="hri_msgs is not installed: its source, or `make messages`")

    def expected(rule, name):
        return rule == "publish" and name.startswith(topics.REP155_BODIES)

    endpoints("/secured_rep155", expected, rep155="true", max_people=2)
