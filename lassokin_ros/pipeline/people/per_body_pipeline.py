"""Several people whose keypoints come on a topic each (REP-155): a pipeline for each, under the detector's ids.

pipeline = PerBodyPipeline(TrackerConfig(), NodeSettings(rep155=True, max_people=4, keypoints_type="hri_msgs/Skeleton2D"))
pipeline.keep(["abcde"])                                     # who is there
frames = pipeline.frames_of("abcde", skeleton2d, arrival_ns)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from lassokin_ros.core.calibration import Calibration
from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.estimate import Status
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.people.presence import Presence, best
from lassokin_ros.pipeline.pipeline import Pipeline
from lassokin_ros.pipeline.settings import NodeSettings


class PerBodyPipeline(Pipeline):
    """Pipelines for one person each, made at the start and used again; camera and counts are everybody's."""

    def __init__(self, tracker_config: TrackerConfig, node_config: NodeSettings) -> None:
        """Raises a LassokinError when the configuration cannot be used."""
        super().__init__(tracker_config, _alone(node_config))
        self._idle = [Pipeline(tracker_config, self.config) for _ in range(node_config.max_people)]
        for pipeline in self._idle:
            pipeline.camera, pipeline.counts = self.camera, self.counts
        self._all = tuple(self._idle)
        self._present: dict[str, Pipeline] = {}
        self.config = node_config.checked()

    @property
    def ids(self) -> list[str]:
        """Of the people who are there."""
        return list(self._present)

    @property
    def status(self) -> Status:
        """The best of the people's."""
        return best(pipeline.status for pipeline in self._present.values())

    def presence_at(self, now_ns: int) -> Presence:
        """As Pipeline's; who is there the detector says, whether keypoints of them come or not."""
        return Presence(best(p.presence_at(now_ns).status for p in self._present.values()), self.ids)

    def calibrations(self) -> dict[str, Calibration]:
        """What is known of each person's lengths, by id."""
        return {person: pipeline.tracker.calibration for person, pipeline in self._present.items()}

    def keep(self, ids: Sequence[str]) -> None:
        """These are there now; others have left, and are forgotten. Of too many the first stay."""
        for person in [person for person in self._present if person not in ids]:
            pipeline = self._present.pop(person)
            self._reset_quietly([pipeline])
            self._idle.append(pipeline)
            self.counts["people left"] += 1
        for person in [person for person in dict.fromkeys(ids) if person not in self._present]:
            if not self._idle:
                self.counts["people beyond max_people"] += 1
                continue
            newcomer = self._idle.pop()
            newcomer.tracker.adopt_vertical(known.tracker for known in self._present.values())
            self._present[person] = newcomer
            self.counts["people come"] += 1

    def frames_of(self, person: str, message: Any, arrival_ns: int) -> list[FrameResult]:
        """One person's message; none for somebody who is not there."""
        pipeline = self._present.get(person)
        if pipeline is None:
            return []
        pipeline.enabled = self.enabled
        return [replace(frame, person=person) for frame in pipeline.frames(message, arrival_ns)]

    def reset(self) -> None:
        """Forget everybody's state; who is there, the camera and the counts stay."""
        self._reset_quietly(self._all)
        self.counts["resets"] += 1

    def tune(self, tracker_config: TrackerConfig, node_config: NodeSettings) -> None:
        """Take over live settings; they hold from the next frame on."""
        for pipeline in self._all:
            pipeline.tune(tracker_config, _alone(node_config))
        super().tune(tracker_config, node_config)

    def _reset_quietly(self, pipelines: Sequence[Pipeline]) -> None:
        resets = self.counts["resets"]
        for pipeline in pipelines:
            pipeline.reset()
        self.counts["resets"] = resets


def _alone(config: NodeSettings) -> NodeSettings:
    return replace(config, max_people=1, rep155=False)
