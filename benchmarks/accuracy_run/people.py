"""The people whose motion the shipped network was trained with; they are no test people."""

from __future__ import annotations

from collections.abc import Collection
from functools import cache
from pathlib import Path

from lassokin_ros.core.network.depth_network import load_weights
from training.motion import LEFT_OUT_CLIPS, LEFT_OUT_KINDS, TEST, sources


@cache
def _people(folder: Path) -> dict[str, str]:
    """Person of each clip, by the clip's name, for a folder with `mocap` and `corpus`; empty for other folders."""
    if not all((folder / part / "clips.json").is_file() for part in ("mocap", "corpus")):
        return {}
    return {source.file.stem: source.person for source in sources(folder)}


@cache
def _network_people() -> frozenset[str]:
    return frozenset(load_weights()[1]["people"])


def seen_by_network(file: Path) -> bool:
    """Whether the network was trained with takes of this clip's person."""
    return _people(file.resolve().parent.parent).get(file.stem) in _network_people()


def test_clips(folder: Path) -> list[Path]:
    """The clips of the test people. No take of them was used to train the network or the pose prior."""
    return clips_of(TEST, folder)


def clips_of(people: Collection[str], folder: Path) -> list[Path]:
    """The usable clips of some people."""
    return [
        source.file
        for source in sources(folder)
        if source.person in people
        and source.kind not in LEFT_OUT_KINDS
        and not source.file.stem.startswith(LEFT_OUT_CLIPS)
    ]
