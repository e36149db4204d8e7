"""Through how many modules a keypoint message comes before the estimate begins, and how often it comes back to one.

    PYTHONPATH=TREE python benchmarks/rooms.py [--path]

One person is tracked in the images of one camera; the last message is followed from the session's input to
`Tracker.track`. Rooms are the modules of `lassokin_ros` outside of the core, and of `msg_adapters`, in which it calls a
function. A call is a return if its module was left for another one before. Comprehensions, lambdas and properties do
not count. --path prints the calls. TREE: this checkout of the repository, or another one.
"""

from __future__ import annotations

import inspect
import sys
from functools import cached_property
from importlib import import_module
from pathlib import Path
from types import FrameType
from typing import Any

import lassokin_ros
from benchmarks.common.report import table
from benchmarks.data.people_in_view import view
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.tracker import Tracker
from lassokin_ros.demo.synthetic import WEBCAM
from lassokin_ros.pipeline.settings import NodeSettings
from lassokin_ros.replay.bags import typestore
from msg_adapters import inputs
from msg_adapters.backends import RosbagsBackend

TREE = Path(lassokin_ros.__file__).parents[1]
FRAMES, FPS, START_NS, FRAME_ID = 40, 30.0, 1_700_000_000_000_000_000, "camera_optical_frame"


def calls_of_last_message(numbered: bool) -> list[tuple[str, str]]:
    """Return module and name of each function that counts, in the order of the calls."""
    calls: list[tuple[str, str]] = []

    def note(frame: FrameType, event: str, _: Any) -> None:
        """Add a call to those that count, until the tracker's step begins."""
        code, path = frame.f_code, Path(frame.f_code.co_filename)
        if code is Tracker.track.__code__:
            sys.setprofile(None)
        elif event == "call" and path.is_relative_to(TREE) and not code.co_name.startswith("<"):
            module = str(path.relative_to(TREE))
            owner = type(frame.f_locals["self"]) if "self" in frame.f_locals else None
            is_property = isinstance(inspect.getattr_static(owner, code.co_name, None), (property, cached_property))
            if module.startswith(("lassokin_ros", "msg_adapters")) and "/core/" not in module and not is_property:
                calls.append((module, f"{owner.__name__}.{code.co_name}" if owner else code.co_name))

    # Before there was a session, `Pipeline.frames` took the messages.
    older = not (TREE / "lassokin_ros/pipeline/session.py").is_file()
    engine = import_module("lassokin_ros.pipeline." + ("pipeline" if older else "session"))
    session: Any = (engine.Pipeline if older else engine.Session)(TrackerConfig(), NodeSettings())
    push = session.frames if older else session.push
    seen, backend = view(0, FRAMES, FPS, 1), RosbagsBackend(typestore())
    session.set_camera(inputs.camera_info(backend, START_NS, FRAME_ID, WEBCAM.K, WEBCAM.D, WEBCAM.size))
    for index in range(FRAMES):
        stamp_ns, person = START_NS + round(1e9 * index / FPS), (seen.pixels[index, 0], seen.confidence[index, 0])
        message = inputs.point_cloud(backend, stamp_ns, FRAME_ID, *person)
        if numbered:
            message = inputs.people_cloud(backend, stamp_ns, FRAME_ID, [(0, *person)])
        sys.setprofile(note if index == FRAMES - 1 else None)
        push(message, stamp_ns)
    return calls


if __name__ == "__main__":
    rows = []
    for numbered in (False, True):
        entered = calls_of_last_message(numbered)
        rooms = [one for (one, _), (before, _) in zip(entered, [("", ""), *entered]) if one != before]
        kind, count = "numbered" if numbered else "without numbers", len(set(rooms))
        rows.append({"messages": kind, "rooms": count, "returns": len(rooms) - count})
        if "--path" in sys.argv:
            print(f"{kind}:", *(f"  {module} {function}" for module, function in entered), sep="\n")
    print(table(rows, {"messages": "<", "rooms": "d", "returns": "d"}))
