"""Names of a person's TF frames, URDF links and URDF joints."""

from __future__ import annotations

from dataclasses import dataclass

from lassokin_ros.pipeline.outputs.rep155 import LINKS, suffix
from lassokin_ros.pipeline.outputs.topics import link_prefix
from lassokin_ros.pipeline.settings import NodeSettings


@dataclass(frozen=True)
class Naming:
    """Names of one person's frames and joints.

    prefix: of frames and links. body_id: the person's id under REP-155, which allows no prefix; the names end with it.
    """

    prefix: str = ""
    body_id: str = ""

    @classmethod
    def of_person(cls, config: NodeSettings, node: str, person: str = "") -> Naming:
        """Return the naming of a person. node: the node's full name without the first slash; person: id or empty."""
        if config.rep155 and person:
            return cls(body_id=person)
        return cls(link_prefix(config.frame_prefix, node, person))

    def link(self, name: str) -> str:
        """Return the name of a TF frame or URDF link."""
        return f"{name}{suffix(self.body_id)}" if self.body_id else f"{self.prefix}{name}"

    def link_of_joint(self, joint: str) -> str:
        """Return the name of the frame of a joint of the skeleton. A frame of REP-155 may have the joint's name."""
        return self.link(f"{joint}_joint" if self.body_id and joint in LINKS else joint)

    def joint(self, name: str) -> str:
        """Return the name of a URDF joint."""
        return f"{name}{suffix(self.body_id)}" if self.body_id else name
