"""Every message is read or refused with a reason; a tracker can use every message that is read."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("rosbags", reason="rosbags makes the messages")

from faults.courses import BACKEND, LAYOUTS, NUMBERS, START_NS, TYPES, message_of, over_the_wire, people  # noqa: E402
from faults.damage import WAYS, spoil  # noqa: E402
from faults.decoder_checks import LONGEST_TEXT, outcome_of, refusal  # noqa: E402
from faults.fuzzing import count, fuzz  # noqa: E402
from messages import HEIGHT, WIDTH, camera_info  # noqa: E402

from lassokin_ros.core.errors import CameraError  # noqa: E402
from lassokin_ros.pipeline.camera.lens import Lens  # noqa: E402
from msg_adapters.camera_info import decode_camera_info  # noqa: E402
from msg_adapters.detectors.registry import ADAPTERS, keypoint_adapter  # noqa: E402
from msg_adapters.errors import AdapterError  # noqa: E402


def faults(message_type):
    """Up to three kinds of damage, and the seed of their draws."""
    ways = st.lists(st.sampled_from(sorted(WAYS[message_type])), min_size=1, max_size=3)
    return st.tuples(ways, st.integers(0, 2**32 - 1))


def spoilt(message_type, message, fault):
    return over_the_wire(message_type, spoil(message_type, message, *fault, START_NS))


def good(message_type, seed):
    alone, both = people(LAYOUTS[message_type])
    if seed % 2 and message_type in ("sensor_msgs/msg/PointCloud2", "yolo_msgs/msg/DetectionArray"):
        return message_of(message_type, [pixels[0] for _, pixels in both], START_NS, NUMBERS)
    return message_of(message_type, [alone[1][0]], START_NS, NUMBERS[:1])


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("message_type", list(ADAPTERS))
def test_all_keypoints_are_read_or_refused(message_type):
    adapter, layout = keypoint_adapter(message_type), LAYOUTS[message_type]
    landmarks = people(layout)[0][1].shape[1]
    name = f"decode {message_type.split('/')[-1]}"

    @fuzz(0.05 if "Cloud" not in message_type else 0.15)
    @given(faults(message_type), st.sampled_from([None, (WIDTH, HEIGHT), (0, 0)]))
    def case(fault, size):
        message = spoilt(message_type, good(message_type, fault[1]), fault)
        count(name, outcome_of(adapter, message, size, landmarks))

    case()


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("message_type", list(ADAPTERS))
def test_all_bytes_are_read_or_refused(message_type):
    """A message with changed, missing or additional bytes, if it can be deserialised."""
    adapter, layout = keypoint_adapter(message_type), LAYOUTS[message_type]
    landmarks = people(layout)[0][1].shape[1]
    whole = bytes(TYPES.serialize_cdr(good(message_type, 0), message_type))
    name = f"bytes {message_type.split('/')[-1]}"

    @fuzz(0.03)
    @given(st.integers(0, 2**32 - 1))
    def case(seed):
        random = np.random.default_rng(seed)
        data = bytearray(whole)
        for _ in range(random.integers(1, 6)):
            data[random.integers(4, len(data))] = random.integers(256)
        data = bytes(data[: random.integers(4, len(data))]) if seed % 4 == 0 else bytes(data)
        try:
            message = TYPES.deserialize_cdr(data, message_type)
        except Exception:  # the replay counts it as not_deserialised, the middleware drops it
            count(name, "no message")
            return
        count(name, outcome_of(adapter, message, (WIDTH, HEIGHT), landmarks))

    case()


PIXELS = np.concatenate([people("coco17")[0][1][0], [[-5.0, 1e4], [np.nan, 3.0], [-1e6, 1e6]]])


@pytest.mark.filterwarnings("error::RuntimeWarning")
@fuzz(0.15)
@given(faults("sensor_msgs/msg/CameraInfo"), st.booleans())
def test_every_camera_info_is_a_camera_or_refused(fault, rectified):
    """An accepted camera converts every pixel to finite coordinates or NaN."""
    message = spoilt("sensor_msgs/msg/CameraInfo", camera_info(BACKEND), fault)
    try:
        lens = Lens.from_intrinsics(decode_camera_info(message), rectified)
    except AdapterError as error:
        count("camera_info", refusal(error))
        return
    except CameraError as error:
        assert 0 < len(str(error)) < LONGEST_TEXT
        count("camera_info", "camera_unusable")
        return
    normalised = lens.normalise(PIXELS)
    assert normalised.shape == PIXELS.shape and not np.isinf(normalised).any()
    assert np.isfinite(lens.focal) and lens.focal > 0
    count("camera_info", "read")
