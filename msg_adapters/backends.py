"""Create messages of rclpy and of rosbags. They differ in how messages are created and in the types of array fields."""

from __future__ import annotations

from array import array
from importlib import import_module
from typing import Any

import numpy as np


class RclpyBackend:
    """Messages for publishers. Needs the message packages of rclpy."""

    def make(self, message_type: str) -> Any:
        """Return a message with default values; message_type: long form, "std_msgs/msg/String"."""
        package, _, name = message_type.split("/")
        return getattr(import_module(f"{package}.msg"), name)()

    def float64(self, values: np.ndarray) -> array:
        """Return the value of a float64[] field. The conversion from bytes is much faster than from a list."""
        return array("d", np.ascontiguousarray(values, dtype=np.float64).tobytes())

    def byte(self, value: int) -> bytes:
        """Return the value of a byte field."""
        return bytes([value])

    def uint8(self, content: bytes) -> array:
        """Return the value of a uint8[] field."""
        return array("B", content)

    def serialise(self, message: Any) -> bytes:
        """Return the message serialised as CDR, the format of transport and recordings."""
        serialised: bytes = import_module("rclpy.serialization").serialize_message(message)
        # The middleware adds four bytes of alignment after an empty sequence of doubles at the end of a message, such
        # as joint_states. Strict readers refuse them. With these bytes, a message that ends with doubles and the length
        # of the empty sequence has a length of 8 k + 4, including the four bytes of the CDR header.
        *_, before, last = (None, *(getattr(message, name) for name in message.get_fields_and_field_types()))
        if _doubles(last) == 0 and _doubles(before) > 0 and len(serialised) % 8 == 4:
            serialised = serialised[:-4]
        return serialised

    def alike(self, serialised: bytes, message: Any) -> bool:
        """Return True if a serialised message equals a message. Padding bytes are random: both are deserialised."""
        read = import_module("rclpy.serialization").deserialize_message
        try:
            there = read(serialised, type(message))
        except Exception:  # the middleware raises its own errors for invalid bytes
            return False
        return bool(there == read(self.serialise(message), type(message)))


def _doubles(value: Any) -> int:
    """Return the length of a field of doubles; -1 for another field."""
    return len(value) if isinstance(value, array) and value.typecode == "d" else -1


class RosbagsBackend:
    """Messages for `typestore.serialize_cdr`. Needs rosbags."""

    _ZEROS = {"string": "", "wstring": "", "bool": False, "float32": 0.0, "float64": 0.0}

    def __init__(self, typestore: Any) -> None:
        """typestore: a typestore of rosbags, e.g. get_typestore(Stores.ROS2_JAZZY)."""
        self._typestore = typestore

    def make(self, message_type: str) -> Any:
        """See RclpyBackend.make."""
        _, fields = self._typestore.fielddefs[message_type]
        return self._typestore.types[message_type](*[self._blank(description) for _, description in fields])

    def _blank(self, description: Any) -> Any:
        """Return the default of a field from its rosbags description: (1 base, 2 name, 3 array, 4 sequence)."""
        kind, detail = int(description[0]), description[1]
        if kind == 2:
            return self.make(detail)
        if kind == 1:
            return self._ZEROS.get(detail[0], 0)
        element, length = detail
        if int(element[0]) == 1 and element[1][0] not in ("string", "wstring"):
            dtype = {"bool": np.bool_, "byte": np.uint8, "octet": np.uint8, "char": np.uint8}
            return np.zeros(length if kind == 3 else 0, dtype.get(element[1][0], element[1][0]))
        return [self._blank(element) for _ in range(length if kind == 3 else 0)]

    def float64(self, values: np.ndarray) -> np.ndarray:
        """See RclpyBackend.float64."""
        return np.ascontiguousarray(values, dtype=np.float64)

    def byte(self, value: int) -> int:
        """See RclpyBackend.byte."""
        return value

    def uint8(self, content: bytes) -> np.ndarray:
        """See RclpyBackend.uint8."""
        return np.frombuffer(content, dtype=np.uint8)

    def serialise(self, message: Any) -> bytes:
        """See RclpyBackend.serialise."""
        return bytes(self._typestore.serialize_cdr(message, message.__msgtype__))

    def alike(self, serialised: bytes, message: Any) -> bool:
        """See RclpyBackend.alike."""
        return serialised == self.serialise(message)


Backend = RclpyBackend | RosbagsBackend
"""Creates empty messages and converts the field types in which rclpy and rosbags differ."""
