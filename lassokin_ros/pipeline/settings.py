"""Settings that only the node and the replay have; the tracker's own are in core/config.py."""

from __future__ import annotations

import re
from dataclasses import dataclass, fields

from lassokin_ros.core.config import OFF, TrackerConfig, check_setting, setting
from lassokin_ros.core.errors import ConfigurationError
from lassokin_ros.pipeline.people.choice import CONFIDENT, RULES, number_named
from msg_adapters.detectors.registry import ADAPTERS, full_type_name
from msg_adapters.output_messages.people import TYPES

OPTICAL_FRAME = "camera_optical_frame"
"""Name of the camera's optical frame (z forward, x right, y down) if nothing else gives one."""
DEPTH_WAIT, CAMERA_WAIT, TF_WAIT = 0.005, 0.03, 0.1
"""s: the waiting times if `wait` is 0."""
SHORTEST_WAIT = 0.001
"""s: shortest period of a timer."""
MESSAGE, NODE, LASTING = "message", "node", "lasting"
ROOT, ALL = "root", "all"
SKELETON_SUFFIXES = (".yaml", ".yml")
"""Suffixes of skeletons that are written. One with another suffix would be read as another format."""
PEOPLE_TYPES = TYPES
CAMERA_NAME = re.compile(r"[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)
"""Name of a camera: the beginning of a topic's name."""
PER_BODY_TYPE = "hri_msgs/msg/Skeleton2D"
"""Message type with the keypoints of one person; the name of the topic contains the id of the person."""


@dataclass(frozen=True)
class NodeSettings:
    """Settings of the node; `checked` raises ConfigurationError for a value out of its range."""

    keypoints_type: str = setting(
        "sensor_msgs/msg/PointCloud2", f"message type of the topic keypoints, one of: {', '.join(ADAPTERS)}"
    )
    cameras: tuple[str, ...] = setting(
        ("",),
        "names of several cameras, whose topics are <name>/keypoints and <name>/camera_info, with poses from TF; empty "
        "for one camera, with the topics keypoints and camera_info",
    )
    fixed_frame: str = setting(
        "",
        "frame with z up, such as odom or base_footprint, in which the skeleton is kept and published; TF gives each "
        "camera's pose in it at its image's stamp; empty: the optical frame of the camera, or of the first one",
    )
    wait: float = setting(
        0.0,
        "longest time for which a keypoint message waits for the depth image of its time, for keypoints of other "
        "cameras that are due, and for TF of a camera that moves; more for slow drivers or detectors, at the cost of "
        "latency; 0 = 0.005 for depth, 0.03 for cameras, 0.1 for TF",
        "s",
        0.0,
        1.0,
    )
    depth: str = setting(
        "",
        "topic of depth images (sensor_msgs/Image, or CompressedImage if it ends in /compressedDepth) that are "
        "registered to the colour image; if their frame_id differs, its name must say so (depth_registered, "
        "aligned_depth_to_color or depth_to_rgb); empty for none; with several cameras: <name>/<depth>",
    )
    rectified: bool = setting(
        False, "keypoints are pixels of the rectified image: camera_info's P is used in place of K and D"
    )
    floor: bool = setting(
        False,
        "a flat floor is at height 0 of fixed_frame; feet are then on it, or not near it",
        live=True,
    )
    frame_prefix: str = setting(
        "~/", "precedes the names of TF frames and URDF links; ~ is the node's name; <id>/ follows with several people"
    )
    queue_depth: int = setting(
        5,
        "keypoint messages that may wait and are all processed; if more wait, only the newest is processed and the "
        "others are counted",
        "",
        1,
        1000,
    )
    max_people: int = setting(1, "people followed at once; above 1, topics are under ~/bodies/<id>/", "", 1, 20)
    person_ids: str = setting(
        MESSAGE,
        "what identifies people over time: the message's person numbers if they persist, near the expected place; the "
        "node's own matching; or lasting: numbers that are people's, wherever they are",
        choices=(MESSAGE, NODE, LASTING),
    )
    follow: str = setting(
        CONFIDENT,
        f"who is followed, or locked by ~/lock: the rule {', '.join(RULES)}, or the number of a person from the "
        "detector, such as p7",
        live=True,
    )
    lock: bool = setting(
        False,
        "the first person who is tracked stays the only one until ~/lock is called with false; otherwise another "
        "person is followed, under a new id, forget_after after the first one has left",
        live=True,
    )
    stale_after: float = setting(
        0.4,
        "a person without a result for this long is reported as lost, and so is the state without keypoints; the "
        "tracker keeps the person until lost_after",
        "s",
        0.05,
        3600.0,
        live=True,
    )
    silent_when_empty: bool = setting(
        False,
        "the detector sends nothing while nobody is in view: silence is reported as nobody; otherwise as lost",
        live=True,
    )
    forget_after: float = setting(3.0, "a person who is not seen for this long has left", "s", 0.1, 3600.0, live=True)
    nobody_after: float = setting(
        30.0,
        "longest time for which somebody who left the view may be where no camera has looked since; ~/state is not "
        "nobody then; needs the places of the cameras (fixed_frame, cameras)",
        "s",
        0.0,
        3600.0,
        live=True,
    )
    rep155: bool = setting(
        False, "several people's topics and frames as in REP-155: /humans/bodies/<id>/, the list as hri_msgs/IdsList"
    )
    publish_tf: str = setting(
        OFF,
        "TF of each person: the root (<frame_prefix>body, rep155: body_<id> between the hips; x front, z up), or all "
        "joints too",
        choices=(OFF, ROOT, ALL),
    )
    people_type: str = setting(
        PEOPLE_TYPES[0],
        f"message type of ~/people, one of: {', '.join(PEOPLE_TYPES)}; the last two need their packages",
    )

    @property
    def camera_names(self) -> tuple[str, ...]:
        """The names of the cameras; one empty name for one camera with the topics keypoints and camera_info."""
        return tuple(name for name in self.cameras if name) or ("",)

    @property
    def several_cameras(self) -> bool:
        """True if the keypoints of several cameras are solved jointly."""
        return len(self.camera_names) > 1

    @property
    def root_frame(self) -> str:
        """The base link of robot_description before the first result."""
        return self.fixed_frame.lstrip("/") or OPTICAL_FRAME

    @property
    def depth_wait(self) -> float:
        """s: longest time for which keypoints wait for the depth image of their time."""
        return max(self.wait or DEPTH_WAIT, SHORTEST_WAIT)

    @property
    def camera_wait(self) -> float:
        """s: longest time for which keypoints wait for those of other cameras."""
        return self.wait or CAMERA_WAIT

    @property
    def tf_wait(self) -> float:
        """s: longest time for which keypoints wait for the poses of moving cameras from TF."""
        return self.wait or TF_WAIT

    def depth_topic(self, camera: str) -> str:
        """Return the topic of the depth images of a camera; empty if there is none."""
        return f"{camera}/{self.depth}" if self.depth and camera and not self.depth.startswith("/") else self.depth

    @property
    def several_people(self) -> bool:
        """True if each person has a separate set of topics."""
        return self.max_people > 1 or self.rep155

    @property
    def topic_per_body(self) -> bool:
        """True when the keypoints of each person have a separate topic."""
        return self.rep155 and full_type_name(self.keypoints_type) == PER_BODY_TYPE

    @property
    def detects_bodies(self) -> bool:
        """True when this node has the part of REP-155's body detector: it publishes the list of ids and the regions."""
        return self.rep155 and not self.topic_per_body

    def checked(self) -> NodeSettings:
        """Return self if every value has the right type and range; else raise ConfigurationError."""
        for item in fields(self):
            check_setting(item.name, getattr(self, item.name), item.metadata, type(item.default))
        if full_type_name(self.keypoints_type) not in ADAPTERS:
            raise ConfigurationError(
                f"keypoints_type is '{self.keypoints_type}'; expected one of: {', '.join(ADAPTERS)}; publish keypoints "
                "in another message as PointCloud2 (README: Feed your own detector), or write an adapter "
                "(docs/extending.md)"
            )
        if full_type_name(self.people_type) not in PEOPLE_TYPES:
            raise ConfigurationError(f"people_type is '{self.people_type}'; expected one of: {', '.join(PEOPLE_TYPES)}")
        if self.frame_prefix.startswith("/") or any(character.isspace() for character in self.frame_prefix):
            raise ConfigurationError(
                f"frame_prefix is '{self.frame_prefix}'; expected a prefix without spaces and not starting with /, "
                "such as human/ (tf2 refuses both)"
            )
        self._check_cameras()
        if any(character.isspace() for character in self.depth):
            raise ConfigurationError(f"depth is '{self.depth}'; expected the name of a topic, or nothing")
        if self.follow not in RULES and number_named(self.follow) is None:
            raise ConfigurationError(
                f"follow is '{self.follow}'; expected {', '.join(RULES)}, or the number of a person, such as p7"
            )
        return self

    def check_with(self, tracker: TrackerConfig) -> None:
        """Raise ConfigurationError if these settings and the tracker's contradict each other."""
        if tracker.camera_height and self.fixed_frame:
            raise ConfigurationError(
                f"camera_height is {tracker.camera_height:g} and fixed_frame '{self.fixed_frame}'; expected one of "
                "them: with fixed_frame, TF gives the camera's height, and floor says that its height 0 is the floor"
            )

    def _check_cameras(self) -> None:
        names = self.camera_names
        for name in names:
            if name and CAMERA_NAME.fullmatch(name) is None:
                raise ConfigurationError(
                    f"cameras has the name '{name}'; expected letters from a to z, digits and _, not starting with a "
                    "digit, as in the topic <name>/keypoints"
                )
            if names.count(name) > 1:
                raise ConfigurationError(f"cameras has the name '{name}' twice; expected one name for each camera")
        if any(character.isspace() for character in self.fixed_frame):
            raise ConfigurationError(
                f"fixed_frame is '{self.fixed_frame}'; expected the name of a TF frame, or nothing"
            )
        if self.floor and not self.fixed_frame:
            raise ConfigurationError(
                "floor is true, but no frame is named whose height 0 it is; expected fixed_frame, or camera_height in "
                "place of floor"
            )
        if self.several_cameras and self.topic_per_body:
            raise ConfigurationError(
                f"cameras are {', '.join(names)}, and each person has a topic of keypoints ({PER_BODY_TYPE}); expected "
                "one camera, or messages with all people of an image"
            )
        if self.several_cameras and self.depth.startswith("/"):
            raise ConfigurationError(
                f"depth is '{self.depth}' with several cameras; expected a relative name, which follows that of the "
                "camera: <name>/<depth>"
            )
