"""Open mcap files that also have topics of other encodings, such as JSON or protobuf.

rosbags decodes the schema of every topic when it opens a file, and refuses the file at the first that is no message
definition of ROS 2. Topics that are not needed may have any encoding.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

CDR = "cdr"
"""Encoding of the messages of ROS 2."""


@contextmanager
def any_schema() -> Iterator[None]:
    """Within this context rosbags opens an mcap file whatever the encodings of its schemas are, and without a profile.

    A schema that is no message definition of ROS 2 counts as absent. The profile is a note of the file's writer; many
    programs leave it empty.
    """
    from rosbags.rosbag2 import storage_mcap

    module: Any = storage_mcap
    kept = module.get_msgdef, module.read_string
    first = iter([True])  # the first text that is read is the profile

    def get_msgdef(schema: Any) -> Any:
        try:
            return kept[0](schema)
        except KeyError:
            return kept[0](None)

    def read_string(stream: Any) -> str:
        text = str(module.read_bytes(stream).decode(errors="replace"))
        return text or "ros2" if next(first, False) else text

    module.get_msgdef, module.read_string = get_msgdef, read_string
    try:
        yield
    finally:
        module.get_msgdef, module.read_string = kept


def encoding_of(connection: Any) -> str:
    """Return the encoding of a topic's messages, in lower case; connection: of rosbags."""
    return str(getattr(connection.ext, "serialization_format", "") or CDR).lower()
