"""config/sros2_policy.xml allows what the running node does, and nothing else.

The middleware of the tests has no security plugins, so the policy is compared with the graph of a real node.
"""

from fnmatch import fnmatchcase
from pathlib import Path
from xml.etree import ElementTree

import pytest

pytest.importorskip("rclpy")

from live import START_NS, NodeProcess, Peer  # noqa: E402
from messages import pixels_of_motion  # noqa: E402

from lassokin_ros.pipeline.outputs import topics  # noqa: E402

POLICY = Path(__file__).resolve().parents[2] / "config" / "sros2_policy.xml"
CHILD = {"policy": {"enclaves"}, "enclaves": {"enclave"}, "enclave": {"profiles"}, "profiles": {"profile"},
         "profile": {"topics", "services"}, "topics": {"topic"}, "services": {"service"},
         "topic": set(), "service": set()}  # fmt: skip
ATTRIBUTES = {"policy": {"version"}, "enclave": {"path"}, "profile": {"ns", "node"}}
RULES = {"topics": {"publish", "subscribe"}, "services": {"reply", "request"}}
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
    outputs = [t.name for t in topics.PERSON_OUTPUTS]
    people = [topics.of_person(t.name, "*", rep155) for rep155 in (False, True) for t in topics.person_outputs(rep155)]
    others = [
        topics.DIAGNOSTICS,
        topics.PEOPLE,
        topics.STATE,
        topics.TF,
        topics.TRACKED_OUTPUT.name,
        topics.REP155_TRACKED_OUTPUT.name,
    ]
    everything = [topics.full_name(name, "tracker") for name in (*outputs, *people, *others)]
    assert sorted(allowed("publish")) == sorted([*everything, "/parameter_events", "/rosout"])


def graph_of(peer):
    """Rule -> names in the graph of the node."""
    kinds = {"publish": "publisher", "subscribe": "subscriber", "reply": "service", "request": "client"}
    ask = {rule: getattr(peer.node, f"get_{kind}_names_and_types_by_node") for rule, kind in kinds.items()}
    return {rule: {name for name, _ in by_node("tracker", peer.namespace)} for rule, by_node in ask.items()}


def matches(names, patterns):
    """(names that no pattern allows, patterns that allow none of the names)."""
    unheard = {name for name in names if not any(fnmatchcase(name, p) for p in patterns)}
    return unheard, {p for p in patterns if not any(fnmatchcase(name, p) for name in names)}


def never_done(done, namespace):
    """Rule -> patterns that were not used, except those of message packages that may be missing."""
    unused = {rule: matches(names, allowed(rule, namespace))[1] for rule, names in done.items()}
    left_out = (topics.TF, topics.REP155_BODIES)
    return {rule: {p for p in patterns if not p.startswith(left_out)} for rule, patterns in unused.items()}


def watch(peer, done, everything):
    """Add the node's endpoints to `done`, with a visible person, until `everything` or all endpoints of one person
    exist.
    """
    pixels, sent = pixels_of_motion(1)[0], 0

    def seen():
        nonlocal sent
        sent += 1
        peer.send_camera()
        peer.send(START_NS + sent * 33_000_000, pixels)
        for rule, names in graph_of(peer).items():
            done.setdefault(rule, set()).update(names)
        missing = set().union(*never_done(done, peer.namespace).values())
        return not (missing if everything else {name for name in missing if "/tracker/bodies/" not in name})

    peer.spin_until(seen, what="all that the policy allows")


def test_the_running_node_uses_exactly_what_the_policy_allows():
    done, namespace = {}, "/secured"
    one = {"state_publisher": "human_state_publisher", "use_sim_time": "true"}
    for parameters in (one, {"max_people": 2}):
        arguments = [text for item in parameters.items() for text in ("-p", f"{item[0]}:={item[1]}")]
        with NodeProcess(namespace, *arguments), Peer(namespace, outputs=False) as peer:
            peer.next_diagnostics()
            peer.spin_until(lambda: "tracker" in peer.node.get_node_names(), what="the node's name")  # noqa: B023
            watch(peer, done, everything="max_people" in parameters)
    for rule, names in done.items():
        beyond, _ = matches(names, allowed(rule, namespace))
        assert not beyond, rule
