"""People who left the view while their place is not looked at: a robot turned away, or a gap between its cameras.

They are somewhere near their last place until a camera has looked there and seen nobody, or for `nobody_after`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lassokin_ros.core.observation import HERE, CameraPose
from lassokin_ros.pipeline.frame_result import FrameResult
from lassokin_ros.pipeline.seen import Image

BESIDE_M = 0.5
"""m: a camera looks at a place if it sees this much at both sides, too."""
NEAREST_M = 0.3
"""m: along the optical axis; a camera sees nobody who is nearer."""
LONGEST_STEP_NS = 300_000_000
"""ns: an image tells at most so much about the time before it."""
CONTINUED_S = 0.5
"""s: a person is expected to go on for so long."""
SAME_RAY = 0.01
"""Normalised: a strong distortion may bring a ray from outside into the image; its pixel then has another ray."""
EMPTY_AFTER_S = 1.0
"""s of images that look at a place and show nobody, after which nobody is there."""


@dataclass
class Absent:
    """A person's newest result. looked_s: s for which the place has been looked at since; looked_ns: when last.

    moved: what was at x in the result is at `into_camera(x)` of it now.
    """

    frame: FrameResult
    looked_ns: int
    looked_s: float = 0.0
    moved: CameraPose = HERE

    @property
    def out_of_view(self) -> bool:
        """Whether no camera has looked at the place since."""
        return self.looked_s == 0

    def expected(self, stamp_ns: int) -> np.ndarray:
        """(3,) m in the frame of the skeleton: the middle of the body, which goes on for CONTINUED_S."""
        estimate, velocity = self.frame.estimate, self.frame.velocity
        assert estimate is not None and estimate.pose is not None and velocity is not None
        later_s = min((stamp_ns - self.frame.stamp_ns) * 1e-9, CONTINUED_S)
        return self.moved.into_camera(estimate.pose.positions.mean(axis=0) + later_s * velocity)


class OutOfView:
    """Remembers everybody who was tracked, by id, until their place is known to be empty. Stamps are ns."""

    def __init__(self, up: np.ndarray) -> None:
        """up: (3,) unit vector in the frame of the skeleton."""
        self._up = up
        self.reset()

    def reset(self) -> None:
        """Forget everybody."""
        self._absent: dict[str, Absent] = {}
        self._images: dict[str, Image] = {}  # the newest one of each camera
        self._jump_ns = 0

    def update(
        self,
        frames: Iterable[FrameResult],
        images: Sequence[Image],
        empty_after_s: float,
        jump: tuple[int, CameraPose] | None,
    ) -> None:
        """Use the results of an instant and its images, with the poses of their cameras.

        empty_after_s: s, as EMPTY_AFTER_S, which is the upper limit. jump: see `PoseJumps.newest`.
        """
        if jump is not None and jump[0] != self._jump_ns:
            self._jump_ns = jump[0]
            for absent in self._absent.values():
                absent.moved = jump[1].after(absent.moved)
        for frame in frames:
            if frame.accepted:
                self._absent[frame.label or frame.person] = Absent(frame, frame.stamp_ns)
        for image in images:
            self._images[image.camera.name] = image
            for person, absent in list(self._absent.items()):
                step_ns = min(image.stamp_ns - absent.looked_ns, LONGEST_STEP_NS)
                if step_ns <= 0 or image.body not in ("", person):
                    continue
                if self._looks_at(image, absent.expected(image.stamp_ns)):
                    absent.looked_ns, absent.looked_s = image.stamp_ns, absent.looked_s + step_ns * 1e-9
                    if absent.looked_s >= min(empty_after_s, EMPTY_AFTER_S):
                        del self._absent[person]

    def keep(self, ids: Collection[str]) -> None:
        """Forget those who are not in the detector's list."""
        self._absent = {person: one for person, one in self._absent.items() if person in ids}

    def look(self, cameras: Iterable[CameraPose], stamp_ns: int, empty_after_s: float) -> None:
        """Use the silence of a detector that sends nothing while nobody is in view. cameras: where they are now."""
        for pose in cameras:
            if (image := self._images.get(pose.name)) is not None and image.stamp_ns < stamp_ns:
                self.update((), [replace(image, stamp_ns=stamp_ns, camera=pose, body="")], empty_after_s, None)

    @property
    def ids(self) -> list[str]:
        """Ids of people at whose place no camera has looked since their newest result."""
        return [person for person, one in self._absent.items() if one.out_of_view]

    def at(self, stamp_ns: int, longest_s: float) -> list[Absent]:
        """Return the people who may be at places that no image shows to be empty. longest_s: s, `nobody_after`."""
        return [one for one in self._absent.values() if 0 < stamp_ns - one.frame.stamp_ns <= longest_s * 1e9]

    def _looks_at(self, image: Image, place: np.ndarray) -> bool:
        """Return whether an image shows a place (3,) m and what is beside it."""
        camera, lens = image.camera, image.lens
        if not camera.known:
            return False
        inside = camera.into_camera(place)
        across = np.cross(camera.rotation @ self._up, inside)
        across *= BESIDE_M / max(float(np.linalg.norm(across)), 1e-9)
        points = inside + np.array([[-1.0], [0.0], [1.0]]) * across
        if (points[:, 2] < NEAREST_M).any():
            return False
        rays = points[:, :2] / points[:, 2:]
        pixels, size = lens.distort(rays), np.array(lens.size) if all(lens.size) else 2 * lens.K[:2, 2]
        inside_image = (pixels >= 0) & (pixels < size)
        return bool(inside_image.all() and np.allclose(lens.normalise(pixels), rays, atol=SAME_RAY))
