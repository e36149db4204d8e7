"""The people of the clips: those the shipped network was trained with, those of the validation, those of the test."""

from __future__ import annotations

import argparse
from collections.abc import Collection
from functools import cache
from pathlib import Path

from benchmarks.common.report import data_folder
from lassokin_ros.core.network.depth_network import load_weights
from training.motion import LEFT_OUT_CLIPS, LEFT_OUT_KINDS, TEST, VALIDATION, sources
from training.pose_prior import SEEN


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


def person_of(file: Path) -> str:
    """The person of a clip; empty for a folder without `clips.json`."""
    return _people(file.resolve().parent.parent).get(file.stem, "")


def test_clips(folder: Path) -> list[Path]:
    """The clips of the test people. No take of them was used to train the network or the pose prior."""
    return _clips_of(folder, TEST)


def validation_clips(folder: Path) -> list[Path]:
    """The clips of the people of the validation set, with which the design is chosen.

    The network was trained without these people. Takes that the pose prior was learned from are left out.
    """
    return [file for file in _clips_of(folder, VALIDATION) if file.stem not in SEEN]


def chosen_clips(options: argparse.Namespace) -> list[Path]:
    """The clips of the test people, with --validation-people of those; --data: folder of the shared data."""
    return (validation_clips if options.validation_people else test_clips)(options.data or data_folder())


def _clips_of(folder: Path, people: Collection[str]) -> list[Path]:
    return [
        source.file
        for source in sources(folder)
        if source.person in people
        and source.kind not in LEFT_OUT_KINDS
        and not source.file.stem.startswith(LEFT_OUT_CLIPS)
    ]
