"""Steps of the tests of the running node: send frames, wait for outputs or rejections, get and set parameters."""

import time

from live import values_of
from messages import pixels_of_motion
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from std_srvs.srv import Trigger

from lassokin_ros.pipeline.outputs import topics

PIXELS = pixels_of_motion(200)


def feed(peer, count=1, **options):
    """Send the next frames, and wait for the outputs of each one; return their stamps."""
    outputs = [
        peer.got[topic] for topic in (topics.CERTIFICATE, topics.JOINT_STATES, topics.TRANSLATION, topics.JOINTS)
    ]
    stamps = []
    for _ in range(count):
        answers = [len(messages) for messages in outputs]
        stamps.append(send_next(peer, **options))
        peer.spin_until(lambda: all(len(m) > n for m, n in zip(outputs, answers)), what="the outputs")  # noqa: B023
    return stamps


def feed_in_time(peer, condition):
    """Feed frames, each at the time of its stamp, until `condition()` holds; a slow machine skips frames.

    The motion repeats after `len(PIXELS)` frames, where the person jumps.
    """
    began, first = time.monotonic(), peer.frames_sent

    def due():
        return first + int(60 * (time.monotonic() - began))

    while not condition():
        peer.spin_until(lambda: due() >= peer.frames_sent, what="the time of the next frame")
        peer.frames_sent = due()
        feed(peer)


def restart(peer):
    """Reset the node, and start again with the first frame."""
    assert peer.call(Trigger, "reset", Trigger.Request()).success
    peer.frames_sent = 0


def send_next(peer, **options):
    """Send the next frame; return its stamp."""
    stamp = peer.start_ns + peer.frames_sent * 16_666_667
    peer.send(stamp, PIXELS[peer.frames_sent % len(PIXELS)], **options)
    peer.frames_sent += 1
    return stamp


def rejected(peer, reason):
    """Number of messages that the node has rejected for this reason so far."""
    return int(values_of(peer.next_diagnostics()).get(f"rejected: {reason} [messages]", 0))


def send_until_rejected(peer, reason, send):
    """`send` once, and wait for the rejection in the diagnostics; nothing may be published for it."""
    before, outputs = rejected(peer, reason), len(peer.got[topics.JOINT_STATES])
    send()
    peer.next_diagnostics(lambda s: int(values_of(s).get(f"rejected: {reason} [messages]", 0)) == before + 1)
    assert len(peer.got[topics.JOINT_STATES]) == outputs


def parameter(name, value):
    """A Parameter message."""
    kinds = {bool: "bool", int: "integer", float: "double", str: "string"}
    kind = kinds[type(value)]
    message = ParameterValue(type=getattr(ParameterType, f"PARAMETER_{kind.upper()}"))
    setattr(message, f"{kind}_value", value)
    return Parameter(name=name, value=message)


def set_parameters(peer, **values):
    """Set parameters one by one; return the results."""
    request = SetParameters.Request(parameters=[parameter(*item) for item in values.items()])
    return peer.call(SetParameters, "set_parameters", request).results


def get_parameter(peer, name):
    """The value of one parameter."""
    value = peer.call(GetParameters, "get_parameters", GetParameters.Request(names=[name])).values[0]
    kinds = {ParameterType.PARAMETER_DOUBLE: "double", ParameterType.PARAMETER_INTEGER: "integer"}
    kinds |= {ParameterType.PARAMETER_BOOL: "bool", ParameterType.PARAMETER_STRING: "string"}
    kinds |= {ParameterType.PARAMETER_STRING_ARRAY: "string_array"}
    return getattr(value, f"{kinds[value.type]}_value")
