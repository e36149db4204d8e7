"""camera_info on real DDS: read when asked, handed on when it says something new, never a reason to wake up."""

import time

import pytest

pytest.importorskip("rclpy")

from live import BACKEND, START_NS, Peer  # noqa: E402
from messages import FOCAL, camera_info  # noqa: E402

from lassokin_ros.camera_topic import CameraTopic  # noqa: E402
from msg_adapters.outputs import set_header  # noqa: E402


class Camera:
    """A CameraTopic in the peer's own node, what it has seen and handed on, and the answers it is given."""

    def __init__(self, peer):
        self.peer, self.seen, self.taken, self.usable, self.sent = peer, 0, [], True, 0
        self.topic = CameraTopic(peer.node, self._saw, self._take)
        peer.spin_until(lambda: peer.camera.get_subscription_count() == 1, what="the subscription")

    def _saw(self):
        self.seen += 1

    def _take(self, message):
        self.taken.append(message)
        return self.usable

    def send(self, **fields):
        """Publish one, of another stamp than all before, and look until it has come."""
        message, before = camera_info(BACKEND, **fields), self.seen
        self.sent += 1
        set_header(message.header, START_NS + self.sent, message.header.frame_id)
        self.peer.camera.publish(message)
        deadline = time.monotonic() + 10.0
        while self.seen == before:
            assert time.monotonic() < deadline, "no camera_info came"
            self.topic.look()


@pytest.fixture
def camera():
    with Peer("/camera_topic", outputs=False) as peer:
        yield Camera(peer)


def test_only_what_says_something_new_is_handed_on(camera):
    camera.send()
    camera.send()
    camera.send(focal=2 * FOCAL)
    camera.send(focal=2 * FOCAL)
    camera.send(d=[0.1, 0.0, 0.0, 0.0, 0.0], focal=2 * FOCAL)
    camera.send(frame_id="other_camera")
    camera.send()
    assert camera.seen == 7
    assert [m.k[0] / FOCAL for m in camera.taken] == [1, 2, 2, 1, 1]
    assert [m.header.frame_id == "other_camera" for m in camera.taken] == [False, False, False, True, False]
    assert list(camera.taken[2].d) == [0.1, 0, 0, 0, 0]


def test_what_was_refused_is_handed_on_again(camera):
    camera.usable = False
    camera.send()
    camera.send()
    camera.usable = True
    camera.send()
    camera.send()
    assert len(camera.taken) == 3


def test_the_executor_does_not_wake_up_for_it_and_the_newest_counts(camera):
    for factor in (1, 2, 3):
        camera.peer.camera.publish(camera_info(BACKEND, focal=factor * FOCAL))
    for _ in range(20):
        camera.peer.executor.spin_once(timeout_sec=0.02)
    assert camera.seen == 0
    deadline = time.monotonic() + 10.0
    while not camera.taken or camera.taken[-1].k[0] != 3 * FOCAL:
        assert time.monotonic() < deadline, "the newest camera_info did not come"
        camera.topic.look()
    seen = camera.seen
    camera.topic.look()
    assert camera.seen == seen
