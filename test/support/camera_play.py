"""Cameras that send what they see of a person to a session; the results, and the status once per second."""

from dataclasses import dataclass

import numpy as np
from camera_rig import MAP, eye, pixels, tf_of, truth_at
from messages import camera_info, cloud, rosbags_backend

from lassokin_ros.core.config import TrackerConfig
from lassokin_ros.core.observation import CameraPose
from lassokin_ros.pipeline.outputs.diagnostics import Diagnostics
from lassokin_ros.pipeline.session import Session
from lassokin_ros.pipeline.settings import NodeSettings

BACKEND, START_NS = rosbags_backend(), 1_700_000_000_000_000_000
LEFT, RIGHT = eye("left", 0), eye("right", 90)
TWO = NodeSettings(cameras=("left", "right"), fixed_frame=MAP)


@dataclass
class Result:
    """Stamp in s, and errors of an accepted frame: of the joints (n,) m, of the pelvis (3,) m; its velocity, m/s."""

    seconds: float
    error: np.ndarray
    root: np.ndarray
    frame: object


class Play:
    """A session with its diagnostics. late: s by which messages arrive later; px: shifts of the images, by number."""

    def __init__(
        self, eyes, settings=TWO, config=None, still=False, poses=None, height=1.75, noise_px=1.0, late=0.0, px=None
    ):
        self.eyes, self.still, self.height, self.noise_px, self.late, self.px = eyes, still, height, noise_px, late, px
        self.session = Session(config or TrackerConfig(height=1.75), settings, poses=poses)
        self.names = self.session.config.camera_names
        self.random, self.results, self.refused, self.shown = np.random.default_rng(0), [], [], {}
        self.diagnostics, self.now = Diagnostics(self.session, "tracker", 0.0), 0.0
        self.diagnostics.count_camera_info(0.0)
        for name, one in zip(self.names, eyes):
            assert self.session.set_camera(camera_info(BACKEND, frame_id=one.frame), name) is None

    def truth(self, seconds):
        return truth_at([seconds], self.still, height=self.height)

    def image(self, number, seconds, late=0.0, seen_by=None):
        """seen_by: number of the camera whose image it is; None for this one."""
        source = number if seen_by is None else seen_by
        if (source, seconds) not in self.shown:  # one image may come from two cameras
            body = self.truth(seconds).landmarks[0]
            self.shown[source, seconds] = pixels(self.eyes[source], seconds, body, self.random, self.noise_px)
        xy = self.shown[source, seconds] + (self.px or {}).get(number, 0.0)
        stamp_ns = START_NS + round(1e9 * seconds)
        message = cloud(BACKEND, stamp_ns, xy, frame_id=self.eyes[number].frame)
        arrival_ns = stamp_ns + round(1e9 * (0.01 + late + self.late))
        self.keep(self.session.frames(message, arrival_ns, self.names[number]), seconds, arrival_ns)

    def keep(self, frames, now=None, arrival_ns=0):
        self.now = self.now if now is None else now
        self.diagnostics.count_message(frames, arrival_ns, self.now, 0.001)
        for frame in frames:
            if not frame.accepted:
                self.refused.append(frame)
                continue
            seconds = (frame.stamp_ns - START_NS) * 1e-9
            apart = frame.estimate.pose.positions - self.truth(seconds).positions[0]
            self.results.append(Result(seconds, np.linalg.norm(apart, axis=1), apart[0], frame))

    def transforms(self, number, seconds):
        self.session.placement.transforms.add(tf_of(BACKEND, self.eyes[number], START_NS, seconds), static=False)

    def run(self, seconds=2.0, hz=30, phase=0.0, tf=True, silent=lambda number, seconds: False, begin=0.0, instead={}):
        """instead: number of a camera -> number of the one whose images it sends."""
        for index in range(round(begin * hz), round((begin + seconds) * hz)):
            for number in range(len(self.eyes)):
                now = index / hz + number * phase
                if tf and self.session.placement.transforms is not None:
                    self.transforms(number, now)
                if not silent(number, now):
                    self.image(number, now, seen_by=instead.get(number))
        return self

    def line(self, now=None):
        """The status, now or at a time, s."""
        return self.diagnostics.line(self.now + 0.05 if now is None else now)

    def error(self, since=0.5):
        return 1000 * float(np.median([one.error.mean() for one in self.results if one.seconds > since]))


def off(camera, degrees, metres=0.0):
    """The pose of a camera, turned about its vertical and shifted to its right."""
    pose, angle = camera.pose_at(0), np.radians(degrees)
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    return CameraPose(pose.name, turn @ pose.rotation, turn @ pose.translation + [metres, 0, 0])
