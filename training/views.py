"""Random views of motion capture, as a camera and a detector see a body: the training input of the depth network.

Lengths are in units of the person's height. The detector's rate, the camera, the person's proportions, the noise, the
missing points, and the tracker's knowledge of scene and person are drawn for each sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lassokin_ros.core.network.depth_network import NAMES, TARGETS, TIMES, Scene, features, interpolated
from training.bodies import Bodies, landmarks, reshaped, trunk_axes
from training.motion import Motion
from training.symmetry import OTHER

FASTEST, SLOWEST = 60.0, 2.0
"""Hz: rates of the detector, drawn uniformly in their logarithm. Above 60 Hz interpolation makes no difference."""
LAYOUTS = (
    (0.28, "nose left_ear right_ear"),
    (0.22, "nose left_ear right_ear heel toe"),
    (0.15, "nose left_ear right_ear head_top neck mid_hip heel toe"),
    (0.13, "nose left_ear right_ear neck mid_hip heel toe"),
    (0.10, "nose left_ear right_ear neck"),
    (0.06, "head_top neck"),
    (0.06, "head"),
)
"""Share of the samples, and canonical points besides those of the limbs: as in COCO, MediaPipe, Halpe, BODY_25, H36M,
SMPL."""
OTHER_ARMS = 0.35
"""Share of the samples with the arms of another clip."""
CORRELATION_S = 0.1
"""s: correlation time of a detector's wandering error."""

_INDEX = {name: point for point, name in enumerate(NAMES)}
_LIMB = [_INDEX[f"{s}_{j}"] for j in "shoulder elbow wrist hip knee ankle".split() for s in ("left", "right")]
_HIPS = [_INDEX["left_hip"], _INDEX["right_hip"]]
_SHOULDERS = [_INDEX["left_shoulder"], _INDEX["right_shoulder"]]
_TARGETS = [_INDEX[name] for name in TARGETS]
_LOWER = [p for p, name in enumerate(NAMES) if name.endswith(("knee", "ankle", "heel", "toe"))]
_UPPER = [p for p, name in enumerate(NAMES) if p not in _LOWER and not name.endswith("hip")]
_FEET = [p for p, name in enumerate(NAMES) if name.endswith(("ankle", "heel", "toe"))]
_UNSTEADY = np.array([1.5 if n.endswith(("hip", "heel", "toe", "head_top")) else 1.0 for n in NAMES], dtype=np.float32)
SWAPPED = ("hip knee ankle heel toe", "knee ankle heel toe", "shoulder elbow wrist", "elbow wrist")


@dataclass(frozen=True, eq=False)
class Batch:
    """inputs: (b, INPUTS). places: (b, TARGETS, 3) in heights, relative to the middle of the hips, virtual camera."""

    inputs: np.ndarray
    places: np.ndarray


class Views:
    """Draws batches from a motion."""

    def __init__(self, motion: Motion) -> None:
        self._motion = motion
        self._last = np.cumsum(motion.weight)
        self._bodies = Bodies(motion)

    def batch(self, size: int, random: np.random.Generator, plain: bool = False) -> Batch:
        """plain: COCO's points, all visible, at 30 Hz, with a detector's usual noise, for evaluation."""
        m = self._motion
        clip, now = self._drawn(size, random)
        times, slots, share = _slots(size, random, plain)
        age = np.where(random.random(size) < 0.2, random.random(size) * 0.8, 10.0)
        age[random.random(size) < 0.08] = 0.0
        pace = np.exp(0.2 * random.standard_normal(size)) * np.where(random.random(size) < 0.2, -1.0, 1.0)
        shown = now[:, None] - pace[:, None] * times
        exists = (times <= age[:, None]) & (shown >= 0) & (shown <= (m.count[clip] / m.fps[clip])[:, None])
        points = self._points(clip, shown)
        if not plain:
            self._exchange_arms(points, times, random)
            _twist(points, random)
        factors, height, lengths = self._bodies.drawn(clip, random)
        points = reshaped(points, factors) / height.astype(np.float32)[:, None, None, None]
        mirrored = random.random(size) < 0.5
        points[mirrored] = points[mirrored][:, :, OTHER] * np.array([-1.0, 1.0, 1.0])
        turn, up = _cameras(size, random)
        points = _placed(points, turn, times, random)
        image = _detected(points, times, random)
        seen = _seen(size, times.shape[1], random, plain) & exists[..., None]
        if not plain:
            _swap(image, seen, random)
        places, known = _resampled(image, seen, times, slots, share)
        vertical, up_known = _input_vertical(up, turn, random)
        lengths_known = random.random(size) < 0.4
        lengths = lengths * np.exp(0.02 * random.standard_normal(lengths.shape))
        inputs, rotation = features(Scene(places, known, vertical, up_known, lengths, lengths_known))
        relative = points[:, 0] - points[:, 0, _HIPS].mean(1, keepdims=True)
        target = relative[:, _TARGETS] @ rotation.swapaxes(-1, -2)
        return Batch(inputs, target.astype(np.float32))

    def _drawn(self, size: int, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Clips (size,) by their weights, and times in them, s."""
        m = self._motion
        clip = np.minimum(np.searchsorted(self._last, random.random(size) * self._last[-1]), len(m.start) - 1)
        return clip, random.random(size) * (m.count[clip] - 1) / m.fps[clip]

    def _exchange_arms(self, points: np.ndarray, times: np.ndarray, random: np.random.Generator) -> None:
        """Replace the arms of some of the bodies, in place, by those of other clips, relative to the trunk."""
        rows = np.flatnonzero(random.random(len(points)) < OTHER_ARMS)
        clip, now = self._drawn(len(rows), random)
        others = self._points(clip, now[:, None] - times[rows])
        turn = trunk_axes(others).swapaxes(-1, -2) @ trunk_axes(points[rows])
        for side in ("left", "right"):
            shoulder = _INDEX[f"{side}_shoulder"]
            arm = [_INDEX[f"{side}_elbow"], _INDEX[f"{side}_wrist"]]
            relative = others[:, :, arm] - others[:, :, shoulder, None]
            moved = points[rows][:, :, shoulder, None] + relative @ turn
            for place, joint in enumerate(arm):
                points[rows, :, joint] = moved[:, :, place]

    def _points(self, clip: np.ndarray, shown: np.ndarray) -> np.ndarray:
        """(b, slots, canonical, 3) m at times `shown` (b, slots), s from the beginning of each clip."""
        m = self._motion
        frame = np.clip(shown * m.fps[clip][:, None], 0, m.count[clip][:, None] - 1)
        first = np.minimum(frame.astype(int), m.count[clip][:, None] - 2).clip(0)
        share = (frame - first).astype(np.float32)[..., None, None]
        first += m.start[clip][:, None]
        return m.points[first] * (1 - share) + m.points[first + 1] * share


def _slots(size: int, random: np.random.Generator, plain: bool) -> tuple[np.ndarray, list[tuple[int, int]], np.ndarray]:
    """The detections that are used: (b, slots) s before now, and for each of `TIMES` the pair of slots around it."""
    rate = np.exp(random.uniform(np.log(SLOWEST), np.log(FASTEST), size))
    if plain:
        rate[:] = 30.0
    number = np.floor(TIMES[1:] * rate[:, None] + 1e-6)
    share = TIMES[1:] * rate[:, None] - number
    index = np.concatenate([np.zeros((size, 1)), np.stack([number, number + 1], axis=-1).reshape(size, -1)], axis=1)
    return index / rate[:, None], [(1 + 2 * i, 2 + 2 * i) for i in range(len(TIMES) - 1)], share


def _twist(points: np.ndarray, random: np.random.Generator) -> None:
    """Rotate the upper bodies about the middle of the hips, in place, by a constant rotation in the trunk's axes."""
    rows = np.flatnonzero(random.random(len(points)) < 0.5)
    x, y, z = 0.1 * random.standard_normal((3, len(rows)))
    turn = (_about(0, x) @ _about(1, 1.5 * y) @ _about(2, z)).astype(np.float32)
    chosen = points[rows]
    axes, middle = trunk_axes(chosen), chosen[:, :, _HIPS].mean(2, keepdims=True)
    world = axes.swapaxes(-1, -2) @ turn[:, None] @ axes
    for point in _UPPER:
        chosen[:, :, point] = ((chosen[:, :, point] - middle[:, :, 0])[:, :, None] @ world)[:, :, 0] + middle[:, :, 0]
    points[rows] = chosen


def _about(axis: int, angle: np.ndarray) -> np.ndarray:
    """(b, 3, 3): rotations about a coordinate axis."""
    c, s = np.cos(angle), np.sin(angle)
    result = np.zeros((len(angle), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    result[:, axis, axis] = 1.0
    result[:, i, i], result[:, i, j], result[:, j, i], result[:, j, j] = c, -s, s, c
    return result


def _cameras(size: int, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Rotations from world to camera (b, 3, 3), and the vertical (b, 3) in the camera frame; some bodies lie."""
    flip = np.diag([1.0, -1.0, -1.0])
    pitch = np.where(random.random(size) < 0.5, 0.14 * random.standard_normal(size), random.uniform(-0.5, 0.85, size))
    roll = 0.08 * random.standard_normal(size)
    mount = _about(2, roll) @ _about(0, -pitch) @ flip
    body = _about(1, random.uniform(-np.pi, np.pi, size))
    lying = random.random(size) < 0.04
    laid = _about(1, random.uniform(-np.pi, np.pi, size)) @ _about(0, np.full(size, np.pi / 2)) @ body
    body = np.where(lying[:, None, None], laid, body)
    lean = 0.06 * random.standard_normal((2, size))
    body = body @ _about(0, lean[0]) @ _about(2, lean[1])
    return mount @ body, mount[:, :, 1]


def _placed(points: np.ndarray, turn: np.ndarray, times: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Points in the camera frame: the trunk near the optical axis, at 0.9 to 6 heights; some cameras move."""
    size = len(points)
    middle = points[:, 0, _HIPS + _SHOULDERS].mean(1)
    distance = np.exp(random.uniform(np.log(0.9), np.log(6.0), size))
    points = (points - middle[:, None, None]) @ turn[:, None].swapaxes(-1, -2).astype(np.float32)
    place = np.stack([random.uniform(-0.35, 0.35, size), random.uniform(-0.2, 0.2, size), np.ones(size)], axis=-1)
    velocity = 0.2 * random.standard_normal((size, 3)) * (random.random(size) < 0.25)[:, None]
    shift = (place * distance[:, None])[:, None] + velocity[:, None] * times[..., None]
    return (points + shift[:, :, None]).astype(np.float32)


def _log_uniform(low: float, high: float, size: int, random: np.random.Generator) -> np.ndarray:
    return np.exp(random.uniform(np.log(low), np.log(high), size)).astype(np.float32)


def _detected(points: np.ndarray, times: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """(b, slots, canonical, 2) normalised: projections with the detector's constant, wandering and white errors."""
    size, slots, count = points.shape[:3]

    def normal(*shape: int) -> np.ndarray:
        return random.standard_normal(shape, dtype=np.float32)

    body = landmarks(points, random)
    white, wander = _log_uniform(0.0004, 0.010, size, random), _log_uniform(0.0005, 0.008, size, random)
    image = body[..., :2] / np.maximum(body[..., 2:], 0.15)
    errors = np.empty_like(image)
    lasting = normal(size, count, 2)
    order = np.argsort(times, axis=1)
    rows = np.arange(size)
    previous = fresh = None
    for position in range(slots):
        slot = order[:, position]
        time = times[rows, slot]
        new = normal(size, count, 2)
        if previous is not None:
            kept = np.exp(-(time - previous) / CORRELATION_S).astype(np.float32)[:, None, None]
            same = (time == previous)[:, None, None]
            lasting = kept * lasting + np.sqrt(1 - kept**2) * normal(size, count, 2)
            new = np.where(same, fresh, new)
        previous, fresh = time, new
        errors[rows, slot] = lasting * wander[:, None, None] + new * white[:, None, None]
    constant = _UNSTEADY * _log_uniform(0.001, 0.015, size, random)[:, None]
    errors += (normal(size, count, 2) * constant[..., None])[:, None]
    wrong = random.random((size, slots, count), dtype=np.float32) < 0.004
    errors[wrong] *= 15.0
    return np.asarray(image + errors / np.maximum(points[:, :1, _HIPS, 2].mean(2), 0.3)[..., None, None])


def _seen(size: int, slots: int, random: np.random.Generator, plain: bool) -> np.ndarray:
    """(b, slots, canonical) bool: visible by layout, without missing limbs, points outside the image, single misses."""
    table = np.zeros((len(LAYOUTS), len(NAMES)), dtype=bool)
    for row, (_, extra) in zip(table, LAYOUTS):
        row[_LIMB] = True
        row[[p for p, name in enumerate(NAMES) if name in extra.split() or name.split("_")[-1] in extra.split()
             and name.endswith(("heel", "toe"))]] = True  # fmt: skip
    shares = np.array([share for share, _ in LAYOUTS])
    layout = random.choice(len(LAYOUTS), size, p=shares / shares.sum())
    if plain:
        return np.repeat(table[np.zeros(size, dtype=int)][:, None], slots, axis=1)
    seen = table[layout]

    def drop(share: float, points: list[int], kept: float = 0.0) -> None:
        rows = random.random(size) < share
        lost = random.random((size, len(points))) >= kept
        seen[np.ix_(np.flatnonzero(rows), points)] &= ~lost[rows]

    drop(0.08, _LOWER)
    drop(0.04, _LOWER + _HIPS, 0.3)
    drop(0.04, _FEET)
    for side in ("left", "right"):
        drop(0.04, [_INDEX[f"{side}_{j}"] for j in ("elbow", "wrist")])
        drop(0.05, [_INDEX[f"{side}_wrist"]])
        drop(0.03, [_INDEX[f"{side}_{j}"] for j in ("knee", "ankle", "heel", "toe")])
    drop(0.08, [_INDEX[n] for n in ("nose", "left_ear", "right_ear")])
    drop(0.25, list(range(len(NAMES))), 0.9)
    single = random.random((size, slots, len(NAMES)), dtype=np.float32)
    often = np.where(random.random(size) < 0.3, 0.1, 0.005)[:, None, None]
    result: np.ndarray = seen[:, None] & (single >= often)
    return result


def _swap(image: np.ndarray, seen: np.ndarray, random: np.random.Generator) -> None:
    """Exchange left and right of limbs for a while, in place, in a few samples."""
    for sample in np.flatnonzero(random.random(len(image)) < 0.03):
        limb = SWAPPED[random.integers(len(SWAPPED))].split()
        one, other = ([_INDEX[f"{side}_{joint}"] for joint in limb] for side in ("left", "right"))
        slots = np.flatnonzero(random.random(image.shape[1]) < 0.35)[:, None]
        for values in (image, seen):
            values[sample, slots, one + other] = values[sample, slots, other + one]


def _resampled(
    image: np.ndarray, seen: np.ndarray, times: np.ndarray, slots: list[tuple[int, int]], share: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The points at `TIMES`, as in the tracker's history."""
    after, before = [0, *(a for a, _ in slots)], [0, *(b for _, b in slots)]
    wanted = np.broadcast_to(-TIMES, (len(image), len(TIMES)))
    pairs = (np.stack([array[:, before], array[:, after]]) for array in (-times, image, seen))
    return interpolated(wanted, *pairs)


def _input_vertical(up: np.ndarray, turn: np.ndarray, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """The vertical in the tracker's input: nearly right, that of a level camera, or none."""
    size = len(up)
    draw = random.random(size)
    level = np.broadcast_to([0.0, -1.0, 0.0], up.shape)
    spread = _log_uniform(0.02, 0.2, size, random)[:, None]
    vertical = np.where((draw < 0.12)[:, None], level, up) + spread * random.standard_normal(up.shape)
    vertical /= np.linalg.norm(vertical, axis=1, keepdims=True)
    return vertical, draw < 0.7
