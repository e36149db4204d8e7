"""What a single message tells: the number of landmarks, a leading slash."""

from types import SimpleNamespace

import numpy as np
import pytest

from lassokin_ros.pipeline.input_checks.messages import check_layout, has_leading_slash
from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import Keypoints

LAYOUT = SimpleNamespace(names=("a", "b", "c"))


def keypoints(landmarks):
    return Keypoints(1, "", np.arange(2), np.ones((2, 2)), np.ones(2), landmarks=landmarks)


def test_another_number_of_landmarks_is_refused():
    check_layout(keypoints(None), LAYOUT, "abc")
    check_layout(keypoints(3), LAYOUT, "abc")
    for count in (2, 4):
        with pytest.raises(AdapterError, match=f"bodies of {count} keypoints; `landmarks: abc` has 3") as error:
            check_layout(keypoints(count), LAYOUT, "abc")
        assert error.value.reason == "other_layout"


def test_a_leading_slash():
    for frame, found in (("/camera", True), ("camera/", False), ("", False), ("/", True)):
        assert has_leading_slash(SimpleNamespace(header=SimpleNamespace(frame_id=frame))) is found
    assert not has_leading_slash(SimpleNamespace())
