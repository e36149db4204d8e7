"""Polled subscriptions, for topics with many messages of which few are needed. No executor waits for them.

Waking rclpy's executor for one message takes 0.2 ms or more, a quarter of the tracker's time for a frame. camera_info
is published with every image and hardly ever changes. A simulation publishes /clock up to 1000 times per second.
"""

from __future__ import annotations

from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.subscription import Subscription
from rosgraph_msgs.msg import Clock


class PolledCallbackGroup(CallbackGroup):
    """A callback group for which no executor waits."""

    def can_execute(self, entity: Any) -> bool:
        """See CallbackGroup."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """See CallbackGroup."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """See CallbackGroup."""


UNATTENDED = PolledCallbackGroup()


def ignore_events(endpoint: Any) -> None:
    """Stop waiting for the events of a publisher or subscription, such as incompatible QoS.

    The executor waits for each event together with each message; an event costs as much as a subscription.
    """
    for event in endpoint.event_handlers:
        event.callback_group = UNATTENDED


def poll(subscription: Subscription, most: int) -> None:
    """Call a subscription's callback with the messages received so far, in order, at most `most`.

    From then on no executor waits for the subscription. Call this from another callback of its callback group.
    """
    subscription.callback_group = UNATTENDED
    ignore_events(subscription)  # waiting for its events would also wake the executor for its messages
    handle = subscription.handle
    for _ in range(most):
        with handle:
            taken = handle.take_message(subscription.msg_type, subscription.raw)
        if taken is None:
            return
        subscription.callback(taken[0])


class SimulatedTime:
    """Polls /clock, so that the node does not wake up for every message.

    The subscription belongs to rclpy. It exists while the parameter use_sim_time is true.
    """

    def __init__(self, node: Node) -> None:
        self._node = node

    def poll(self) -> None:
        """Set the clock to the last time received."""
        for subscription in self._node.subscriptions:
            if subscription.msg_type is Clock:
                poll(subscription, 1)
