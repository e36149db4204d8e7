"""Everything that the page is made of: the replay's log, counts and settings, and what follows from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.pipeline.settings import NodeSettings
from lassokin_ros.replay.report.absences import Span, spans_of, usual_period
from lassokin_ros.replay.report.log import PersonRow, ReplayLog


@dataclass(frozen=True, eq=False)
class Facts:
    """A replay that has ended.

    title: the recording's name; topics: of the keypoints and of camera_info; counts: of the pipeline; landmarks: names
    in the layout's order; skeleton: as it was given; image_size: (width, height) px, None without camera_info.
    """

    title: str
    topics: tuple[str, str]
    log: ReplayLog
    counts: Mapping[str, int]
    tracker: TrackerConfig
    node: NodeSettings
    skeleton: Skeleton
    landmarks: tuple[str, ...]
    image_size: tuple[int, int] | None

    @cached_property
    def people(self) -> list[str]:
        """Ids, in the order in which they came; one empty id when one person is followed."""
        return [""] if not self.node.several_people else list(self.log.people)

    def rows(self, person: str) -> list[PersonRow]:
        """One person's rows, refused ones too."""
        return self.log.people.get(person, [])

    def accepted(self, person: str) -> list[PersonRow]:
        """One person's rows with a skeleton."""
        return [row for row in self.rows(person) if row.rejection is None]

    @cached_property
    def tracks(self) -> list[PersonRow]:
        """Everybody's rows with a skeleton."""
        return [row for person in self.people for row in self.accepted(person)]

    @cached_property
    def spans(self) -> dict[str, list[Span]]:
        """Each person's gaps."""
        whole = not self.node.several_people
        return {
            person: spans_of(self.rows(person), self.log.messages, self.tracker.lost_after, whole)
            for person in self.people
        }

    @cached_property
    def times(self) -> np.ndarray:
        """(messages,) s."""
        return np.array([message.time for message in self.log.messages])

    @property
    def duration(self) -> float:
        """s from the first message to the last."""
        return float(self.times.max()) if len(self.times) else 0.0

    @cached_property
    def rate(self) -> float:
        """Hz, of the keypoints: one over the usual pause between two of them; 0 where there is none."""
        period = usual_period(self.times)
        return 1 / period if period > 0 else 0.0

    @property
    def rejected(self) -> dict[str, int]:
        """How many messages, frames of people and camera_infos were refused, by reason."""
        found = {key.partition(": ")[2]: n for key, n in self.counts.items() if key.startswith("rejected: ") and n}
        return dict(sorted(found.items(), key=lambda item: (-item[1], item[0])))

    @property
    def initialisations(self) -> int:
        """How often somebody was found."""
        return sum(row.initialised for row in self.tracks)


def landmark_errors(rows: list[PersonRow], count: int) -> tuple[np.ndarray, np.ndarray]:
    """(l,) px, the median distance of detected and reprojected point; (l,) the share of frames in which it was seen."""
    pairs = [
        (row.detected, row.reprojected) for row in rows if row.detected is not None and row.reprojected is not None
    ]
    if not pairs:
        return np.full(count, np.nan), np.zeros(count)
    distance = np.linalg.norm(np.array([a for a, _ in pairs]) - np.array([b for _, b in pairs]), axis=-1)
    seen = np.isfinite(distance).mean(axis=0)
    middle = np.full(count, np.nan)
    middle[seen > 0] = np.nanmedian(distance[:, seen > 0], axis=0)
    return middle, seen
