"""Topics of which many messages come and few matter: they are read when their content is needed.

To wake rclpy's executor for one message takes it 0.2 ms and more, a quarter of what the tracker needs for a frame.
camera_info comes with every image and hardly ever changes; a simulation's /clock comes up to 1000 times a second.
"""

from __future__ import annotations

from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.subscription import Subscription
from rosgraph_msgs.msg import Clock


class PolledCallbackGroup(CallbackGroup):
    """What no executor waits for."""

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
    """Wait no longer for the events of a publisher or subscription, which say that another endpoint does not match.

    Each is waited for with every message, and takes as long as a subscription does.
    """
    for event in endpoint.event_handlers:
        event.callback_group = UNATTENDED


def poll(subscription: Subscription, most: int) -> None:
    """Call a subscription's callback with what has come, in its order, `most` messages of it.

    From now on no executor waits for it. To be called from another callback of its callback group.
    """
    subscription.callback_group = UNATTENDED
    ignore_events(subscription)  # what waits for them is woken by its messages too
    handle = subscription.handle
    for _ in range(most):
        with handle:
            taken = handle.take_message(subscription.msg_type, subscription.raw)
        if taken is None:
            return
        subscription.callback(taken[0])


class SimulatedTime:
    """Lets a node's clock follow /clock when it is asked to, not with every message.

    The subscription is rclpy's own, and comes and goes with the parameter use_sim_time.
    """

    def __init__(self, node: Node) -> None:
        self._node = node

    def poll(self) -> None:
        """Set the clock to the last time that has come."""
        for subscription in self._node.subscriptions:
            if subscription.msg_type is Clock:
                poll(subscription, 1)
