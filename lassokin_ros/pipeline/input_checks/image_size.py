"""Whether camera_info is of an image of the size of the keypoints' image. Drivers publish both for several sizes.

A detector that brings 3D points, too (ZED, yolo_ros), tells it: their projection by camera_info is the keypoints,
apart from a factor. ZED's wrapper halves the images and camera_info by default, and not the keypoints. Without 3D
points, people who are outside of the image tell that it is another image.
"""

from __future__ import annotations

import numpy as np

from lassokin_ros.pipeline.camera.camera_selection import MARGIN, View
from lassokin_ros.pipeline.camera.lens import Lens
from lassokin_ros.pipeline.concerns.catalogue import SIZE_ADVICE, Raised, say
from msg_adapters.errors import AdapterError
from msg_adapters.keypoints import Keypoints

FACTORS = np.array([1 / 4, 1 / 3, 2 / 5, 1 / 2, 2 / 3, 3 / 4, 1.0, 4 / 3, 3 / 2, 2.0, 5 / 2, 3.0, 4.0])
"""Sizes of the keypoints' image, relative to that of camera_info, which are used."""
SAME = 0.15
"""Logarithm of the factor up to which the sizes are the same: a skeleton that is fitted to points differs from them."""
NEAR = 0.04
"""Logarithm of the ratio to one of FACTORS up to which that is used."""
LARGEST_RESIDUAL = 0.15
"""Median distance of the keypoints from the scaled projections, relative to the spread of the keypoints, up to which
they are those of the same points."""
FEWEST_POINTS, SMALLEST_PX = 6, 30.0
"""Keypoints with a 3D point, and their spread in px, from which on there is a factor."""
IN_A_ROW = 5
"""Messages with another factor than that in use after which it is used, and after which messages without 3D points have
it, too."""
MOST = 0.5
"""Share of a person's keypoints; if more are outside of the image, the person is."""
OUTSIDE_MESSAGES, FAR_OUTSIDE = 10, 1.25
"""Messages with a person outside of the image, as far as this multiple of its size, after which camera_info is that of
another image for certain."""
UNKNOWN_MARGIN = 0.5
"""Margin about an image of which only the principal point is known, as a fraction of its size."""
UNCERTAIN = 0.0
"""Stands for a factor that is not 1, and not near one of FACTORS."""


class ImageSize:
    """The size of the keypoints' image of one camera, relative to that of camera_info."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget what the messages have told."""
        self._use_camera(None)

    def _use_camera(self, info: View | None) -> None:
        self._info = self._scaled = info  # as camera_info tells it, and with the size that is used
        self._factor: float | None = None
        self._agreeing = self._others = self._outside = 0  # messages with this factor, another one; with people outside

    @property
    def concern(self) -> Raised | None:
        """That another size than that of camera_info is used."""
        if self._info is None or self._scaled is None or self._scaled is self._info:
            return None
        return say("image_size", size=self._info.size, own=self._scaled.size, factor=self._factor)

    def view(self, keypoints: Keypoints, view: View) -> View:
        """Return the camera of the keypoints' image: that of camera_info, in another size if that is certain.

        Raises AdapterError with the reason `other_size` if the sizes differ and it is not certain by how much.
        """
        if self._info is None or view.intrinsics is not self._info.intrinsics:
            self._use_camera(view)
        told = _factor(keypoints, view)
        self._use(told)
        if told is None and self._agreeing < IN_A_ROW:
            return view  # few messages have told, which may have been damaged
        if self._factor == UNCERTAIN:
            raise AdapterError(
                "other_size",
                f"the keypoints are not the projections of the detector's 3D points by camera_info of {view.size[0]} x "
                f"{view.size[1]} px, which is of an image of another size: {SIZE_ADVICE}",
            )
        assert self._scaled is not None
        return self._scaled

    def _use(self, factor: float | None) -> None:
        """Use the factor of a message if the first one has it, or as many in a row as had the last, up to IN_A_ROW."""
        if factor is None or factor == self._factor:
            self._agreeing += factor is not None
            self._others = 0
            return
        self._others += 1
        if self._factor is None or self._others >= min(IN_A_ROW, self._agreeing):
            assert self._info is not None
            self._factor, self._agreeing, self._others = factor, self._others, 0
            self._scaled = self._info.scaled(factor) if factor not in (UNCERTAIN, 1.0) else self._info

    def refuse_outside(self, keypoints: Keypoints, view: View, min_confidence: float, inside: bool) -> None:
        """Raise AdapterError with the reason `other_size` if people are outside of the image, or were so for certain.

        keypoints: without placeholders. view: as `view` has returned it. inside: whether it contains all keypoints.
        """
        if self._factor is not None or min(view.size) <= 0:
            return
        farthest = None if inside else person_outside(keypoints, view.size, MARGIN, min_confidence)
        self._outside += farthest is not None and bool((farthest > FAR_OUTSIDE * np.array(view.size)).any())
        if farthest is not None or self._outside >= OUTSIDE_MESSAGES:
            raise _other_image(farthest, view.size)


def refuse_outside(keypoints: Keypoints, lens: Lens) -> None:
    """Raise AdapterError with the reason `other_size` if a person is outside of the image of the lens."""
    margin = MARGIN if min(lens.size) > 0 else UNKNOWN_MARGIN
    if (farthest := person_outside(keypoints, lens.extent, margin, 0.0)) is not None:
        raise _other_image(farthest, lens.extent)


def _other_image(farthest: np.ndarray | None, size: tuple[float, float]) -> AdapterError:
    """farthest: (2,) px, see `person_outside`; None if earlier people were outside."""
    reach = "" if farthest is None else f", which reach x = {farthest[0]:.0f}, y = {farthest[1]:.0f} px,"
    return AdapterError(
        "other_size",
        f"most keypoints of a person{reach} are outside of camera_info's image of {size[0]:g} x {size[1]:g} px: the "
        f"keypoints are of an image of another size, or from another origin than its upper left corner; {SIZE_ADVICE}",
    )


def person_outside(
    keypoints: Keypoints, size: tuple[float, float], margin: float, min_confidence: float
) -> np.ndarray | None:
    """Return the largest x and y (2,) px of a person most of whose keypoints are outside; None if there is none.

    Detectors place people inside of the image, apart from limbs. size: (width, height) px. margin: as a fraction of it.
    """
    xy, limit = keypoints.xy, np.asarray(size, dtype=float)
    beyond = (xy > (1 + margin) * limit) | (xy < -margin * limit)
    if np.count_nonzero(beyond) < FEWEST_POINTS:  # the usual case
        return None
    seen = keypoints.present & (keypoints.confidence >= min_confidence)
    outside = seen & beyond.any(axis=1)
    if np.count_nonzero(outside) < FEWEST_POINTS:
        return None
    people = np.zeros(len(xy)) if keypoints.persons is None else keypoints.persons
    for person in np.unique(people[outside]):
        own = people == person
        if FEWEST_POINTS <= np.count_nonzero(own & outside) > MOST * np.count_nonzero(own & seen):
            return np.asarray(xy[own & seen].max(axis=0))
    return None


def _factor(keypoints: Keypoints, view: View) -> float | None:
    """Return the size of the keypoints' image relative to that of camera_info; None if the message does not tell."""
    if keypoints.rays is None:
        return None
    usable = keypoints.present & np.isfinite(keypoints.rays).all(axis=1)
    if np.count_nonzero(usable) < FEWEST_POINTS:
        return None
    # From the corner of the image: the middle of the first pixel is (0, 0).
    seen, shown = keypoints.xy[usable] + 0.5, view.lens.distort(keypoints.rays[usable]) + 0.5
    spread = float(np.linalg.norm(seen.std(axis=0)))
    squares = (shown**2).sum(axis=1)
    factor = float(np.median((seen * shown).sum(axis=1) / np.maximum(squares, 1.0)))
    if spread < SMALLEST_PX or not factor > 0:
        return None
    if np.median(np.linalg.norm(seen - factor * shown, axis=1)) > LARGEST_RESIDUAL * spread:
        return None  # not the projections of these points, whatever the size
    if abs(np.log(factor)) <= SAME:
        return 1.0
    apart = np.abs(np.log(FACTORS / factor))
    return float(FACTORS[apart.argmin()]) if apart.min() <= NEAR else UNCERTAIN
