"""The doubt about a person's pose in words, for the diagnostics."""

from __future__ import annotations

from collections.abc import Sequence

from lassokin_ros.doubt.live import Judgement
from lassokin_ros.pipeline.frame_result import FrameResult


def doubt_words(person: str, judgement: Judgement) -> str:
    """Return since when and why the pose of a doubtful result is doubtful. person: as in FrameResult."""
    who = f" of {person}" if person else ""
    return f"the pose{who} has been doubtful for {judgement.seconds:.1f} s: {', '.join(judgement.reasons)}"


def unseen_words(frames: Sequence[FrameResult]) -> list[str]:
    """Return for each person which limbs are guessed; frames: the newest result of each person."""
    return [_unseen(frame) for frame in frames if frame.doubt.unseen]


def _unseen(frame: FrameResult) -> str:
    who = f"{frame.person}: " if frame.person else ""
    return f"{who}{', '.join(frame.doubt.unseen)} not seen, so their pose is a guess"
