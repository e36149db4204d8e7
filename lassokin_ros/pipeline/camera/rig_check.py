"""What the one person whom several cameras see says about them: their set-up, and their clocks. In words.

Files are checked before the first pass (`video/cameras/synchrony.py`), running cameras while they run (`RigCheck`).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from lassokin_ros.core.rig.clocks import Offset, offset_between, track_of
from lassokin_ros.core.rig.setup import SetUp, SetUpCheck
from lassokin_ros.pipeline.seen import Sight

OF_FILE = "expected x_camera = R x + t, with the camera's optical frame (z forward, x right, y down)"
OF_TF = "expected the pose of the camera, x_frame = R x_camera + t"
CHECK = "check the places (TF or a file, m), and that keypoints and lens are those of the camera"
PERIOD_NS, LONGEST_APART_NS = 90_000_000, 50_000_000
"""ns between two instants that are kept; largest difference of the stamps of two sights of one instant."""
KEPT, JUDGED_EVERY, SEARCHED_EVERY = 40, 10, 40
"""Instants that are kept; between two judgements; and between two searches for an explanation."""
SEARCHED_FROM = 0.04
"""Cost of the given set-up from which an explanation is searched for. With right places it is 0.02 to 0.06."""
CLOCKS_S, CLOCKS_EVERY_S, CLOCKS_SEARCHED_S = 10.0, 10.0, 0.3
"""s of keypoints whose stamps are compared; between two comparisons; largest difference."""
CLOCKS_APART_S = 0.025
"""s: difference of two cameras' stamps that is said. The keypoints of free-running cameras are predicted by as much
without a loss (docs/several-cameras.md)."""
CLOCKS_CLEARLY, CLOCKS_DEVIATION_S = 4.0, 0.01
"""Deviations from which a difference is no chance, and their largest value, s."""
SAME_S = 0.015
"""s: two comparisons that differ by less agree."""


def set_up_words(found: SetUp | None, names: Sequence[str], pose: str, frame: str = "") -> list[str]:
    """Return what is wrong with a set-up, a sentence each, without a full stop; none if it is right or unknown.

    names: of the cameras. pose: the pose that is expected. frame: in which z must be up; empty for any.
    """
    if found is None:
        return []
    listed = [f"'{name}'" for name in names]
    if found.wrong is not None:
        others = " and ".join(name for number, name in enumerate(listed) if number != found.wrong)
        return [f"camera {listed[found.wrong]} does not fit {others}, which fit each other: {CHECK}"]
    if found.found is None:
        return [f"the keypoints of {' and '.join(listed)} do not fit the given places: {CHECK}"]
    words, one = [], found.found
    if one.inverted:
        which = "all cameras" if len(one.inverted) == len(names) else listed[min(one.inverted)]
        words.append(f"the keypoints fit the inverse transform of {which}, not the given one: {pose}")
    if one.exchanged:
        pairs = ", ".join(f"those of {listed[c]} fit {listed[one.order.index(c)]}" for c in one.exchanged)
        words.append(f"the keypoints are exchanged between cameras: {pairs}: check topics, or the order of the files")
    if found.unit in ("cm", "mm"):
        words.append(f"the places of the cameras are in {found.unit}, as the person's size shows; expected m")
    if frame and one.is_given and found.axis not in ("", "+z"):
        words.append(f"the person stands upright along {found.axis} of '{frame}'; expected a frame with z up")
    return words


class RigCheck:
    """Follows the person in the images of running cameras."""

    def __init__(self, names: Sequence[str], landmarks: Sequence[str], rest: np.ndarray, frame: str = "") -> None:
        """names: of the cameras. landmarks: l names; rest: (l, 3) m, of the body at rest. frame: see set_up_words."""
        self._names, self._landmarks, self._rest, self._frame = list(names), landmarks, rest, frame
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._newest: dict[str, Sight] = {}
        self._instants: deque[dict[str, Sight]] = deque(maxlen=KEPT)
        self._kept_ns = self._count = self._searched = 0
        self._sights: dict[str, deque[Sight]] = {name: deque(maxlen=600) for name in self._names}
        self._clocks: dict[str, tuple[Offset, bool]] = {}  # the last comparison, and whether the one before agreed
        self._compared_ns = 0
        self.set_up: list[str] = []
        """What is wrong with the set-up, in words."""

    @property
    def clocks(self) -> list[str]:
        """Which cameras' stamps are off, in words."""
        words = []
        for name, (offset, confirmed) in self._clocks.items():
            if confirmed:
                way, ms = "late" if offset.seconds > 0 else "early", f"{1000 * abs(offset.seconds):.0f} ms"
                words.append(
                    f"the keypoints of '{name}' and '{self._names[0]}' fit best if the stamps of '{name}' are {ms} (+- "
                    f"{1000 * offset.deviation:.0f}) too {way}; nothing is changed: let the driver stamp the exposure, "
                    "by one clock"
                )
        return words

    def add(self, sights: Sequence[Sight]) -> None:
        """Use the sights of one person in the images of one instant."""
        for sight in sights:
            self._newest[sight.camera.name] = sight
            recent = self._sights[sight.camera.name]
            recent.append(sight)
            while recent[0].stamp_ns < sight.stamp_ns - 1e9 * CLOCKS_S:
                recent.popleft()
        if not sights:
            return
        now_ns = max(sight.stamp_ns for sight in sights)
        if abs(now_ns - self._compared_ns) >= 1e9 * CLOCKS_EVERY_S:
            if self._compared_ns:
                self._compare_clocks(now_ns)
            self._compared_ns = now_ns
        if abs(now_ns - self._kept_ns) < PERIOD_NS:
            return
        near = {name: one for name, one in self._newest.items() if abs(one.stamp_ns - now_ns) <= LONGEST_APART_NS}
        if len(near) < 2:
            return
        self._instants.append(near)
        self._kept_ns, self._count = now_ns, self._count + 1
        if self._count % JUDGED_EVERY == 0:
            self._judge()

    def _judge(self) -> None:
        """Judge the set-up. Explanations take time: they are looked for if the given one is bad, and not each time."""
        names = [name for name in self._names if any(name in instant for instant in self._instants)]
        count = len(self._landmarks)
        pixels, known, poses, lenses = [], [], [], []
        for name in names:
            sights = [instant.get(name) for instant in self._instants]
            last = next(sight for sight in reversed(sights) if sight is not None)
            points = np.full((len(sights), count, 2), np.nan)
            for row, one in zip(points, sights):
                if one is not None:
                    row[:] = one.lens.distort(one.seen.points) if one.seen.pixels is None else one.seen.pixels
            pixels.append(points)
            sure = [np.zeros(count, bool) if one is None else one.seen.confidence > 0 for one in sights]
            known.append(np.array(sure) & np.isfinite(points[..., 0]))
            cameras = [(last if one is None else one).camera for one in sights]
            poses.append((np.array([c.rotation for c in cameras]), np.array([c.translation for c in cameras])))
            lenses.append(last.lens.normalise)
        check = SetUpCheck(pixels, known, lenses, poses, self._landmarks, self._rest)
        searches = self._searched <= 0
        found = check.result(SEARCHED_FROM if searches else math.inf)
        searched = found is not None and len(found.costs) > 1
        self._searched = SEARCHED_EVERY if searched else self._searched - JUDGED_EVERY
        if found is None:
            self.set_up = []
        elif searched or next(iter(found.costs.values())) < SEARCHED_FROM or not self.set_up:
            self.set_up = set_up_words(found, names, OF_TF, self._frame)

    def _compare_clocks(self, now_ns: int) -> None:
        """Compare the stamps of each camera with those of the first one."""
        since_ns = now_ns - round(1e9 * CLOCKS_S)
        tracks = {}
        for name, sights in self._sights.items():
            recent = sorted((one for one in sights if one.stamp_ns >= since_ns), key=lambda one: one.stamp_ns)
            if len(recent) < 2:
                continue
            stamps = np.array([one.stamp_ns - since_ns for one in recent]) * 1e-9
            points = np.array([one.seen.points for one in recent])
            known = np.array([one.seen.confidence > 0 for one in recent]) & np.isfinite(points[..., 0])
            tracks[name] = track_of(stamps, points, known)
        first, *others = self._names
        for name in others:
            one, other = tracks.get(first), tracks.get(name)
            if one is None or other is None:
                continue
            offset = offset_between(one, other, CLOCKS_SEARCHED_S)
            if not offset.is_sure:
                continue
            before, _ = self._clocks.get(name, (None, False))
            clear = offset.deviation < CLOCKS_DEVIATION_S
            off = clear and abs(offset.seconds) > max(CLOCKS_APART_S, CLOCKS_CLEARLY * offset.deviation)
            agrees = before is not None and abs(before.seconds - offset.seconds) < SAME_S
            self._clocks[name] = offset, off and agrees
