"""Two makers of messages: rclpy's and rosbags' differ in how a message is made and in what arrays it takes."""

from __future__ import annotations

from array import array
from importlib import import_module
from typing import Any, Protocol

import numpy as np


class Backend(Protocol):
    """Makes blank messages and converts the few field types in which rclpy and rosbags differ."""

    def make(self, message_type: str) -> Any:
        """A message with every field at its default; message_type in the long form, "std_msgs/msg/String"."""
        ...

    def float64(self, values: np.ndarray) -> Any:
        """The content of a float64[] field."""
        ...

    def byte(self, value: int) -> Any:
        """The content of a byte field."""
        ...

    def uint8(self, content: bytes) -> Any:
        """The content of a uint8[] field."""
        ...

    def serialise(self, message: Any) -> bytes:
        """The message as it goes over the wire and into recordings: CDR."""
        ...

    def alike(self, serialised: bytes, message: Any) -> bool:
        """Whether a serialised message says the same as a message."""
        ...


class RclpyBackend:
    """Messages for publishers; needs rclpy's message packages."""

    def make(self, message_type: str) -> Any:
        """See Backend.make."""
        package, _, name = message_type.split("/")
        return getattr(import_module(f"{package}.msg"), name)()

    def float64(self, values: np.ndarray) -> array:
        """See Backend.float64. From bytes, which costs a fraction of a list."""
        return array("d", np.ascontiguousarray(values, dtype=np.float64).tobytes())

    def byte(self, value: int) -> bytes:
        """See Backend.byte."""
        return bytes([value])

    def uint8(self, content: bytes) -> array:
        """See Backend.uint8."""
        return array("B", content)

    def serialise(self, message: Any) -> bytes:
        """See Backend.serialise."""
        serialised: bytes = import_module("rclpy.serialization").serialize_message(message)
        # Behind an empty sequence of doubles, with which joint_states end, the middleware leaves room for their
        # alignment: four bytes of no meaning, which strict readers refuse. What ends with doubles and the length of
        # the empty sequence is, with the four bytes of CDR's header, a multiple of eight.
        *_, before, last = (None, *(getattr(message, name) for name in message.get_fields_and_field_types()))
        if _doubles(last) == 0 and _doubles(before) > 0 and len(serialised) % 8 == 4:
            serialised = serialised[:-4]
        return serialised

    def alike(self, serialised: bytes, message: Any) -> bool:
        """See Backend.alike. Read, not compared: between the fields are bytes of no meaning, which are random."""
        read = import_module("rclpy.serialization").deserialize_message
        try:
            there = read(serialised, type(message))
        except Exception:  # the middleware's own, for bytes that are no message
            return False
        return bool(there == read(self.serialise(message), type(message)))


def _doubles(value: Any) -> int:
    """How many there are in a field of doubles; -1 for another field."""
    return len(value) if isinstance(value, array) and value.typecode == "d" else -1


class RosbagsBackend:
    """Messages for `typestore.serialize_cdr`; needs rosbags."""

    _ZEROS = {"string": "", "wstring": "", "bool": False, "float32": 0.0, "float64": 0.0}

    def __init__(self, typestore: Any) -> None:
        """typestore: of rosbags, e.g. get_typestore(Stores.ROS2_JAZZY)."""
        self._typestore = typestore

    def make(self, message_type: str) -> Any:
        """See Backend.make."""
        _, fields = self._typestore.fielddefs[message_type]
        return self._typestore.types[message_type](*[self._blank(description) for _, description in fields])

    def _blank(self, description: Any) -> Any:
        """A field's default from rosbags' description: (1 base, 2 name, 3 array, 4 sequence)."""
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
        """See Backend.float64."""
        return np.ascontiguousarray(values, dtype=np.float64)

    def byte(self, value: int) -> int:
        """See Backend.byte."""
        return value

    def uint8(self, content: bytes) -> np.ndarray:
        """See Backend.uint8."""
        return np.frombuffer(content, dtype=np.uint8)

    def serialise(self, message: Any) -> bytes:
        """See Backend.serialise."""
        return bytes(self._typestore.serialize_cdr(message, message.__msgtype__))

    def alike(self, serialised: bytes, message: Any) -> bool:
        """See Backend.alike."""
        return serialised == self.serialise(message)
