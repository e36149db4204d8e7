"""A small network that estimates the depths of a body's joints from its keypoints of the last 0.8 s.

The network is a multilayer perceptron with residual blocks, in plain numpy. It serves every landmark layout: a layout's
landmarks map into one set of canonical points (`CANONICAL`), and a mask tells which of them are seen.

Input. The keypoints are turned into a virtual camera that looks at the middle of the body, and divided by their size in
the image. The same points at fixed times in the past (`TIMES`) follow, as differences, so that the detector's rate does
not matter. Three more inputs describe the scene: the angular size, the vertical in the virtual camera, and the person's
bone lengths relative to the height. Each has a mask for where it is unknown.

Output. For each of `TARGETS`, from the trunk outwards, the position relative to the middle of the hips, in the virtual
camera and in heights. The lower triangular matrix `whitening` makes the errors of the depths independent and of unit
scale.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.roles import NETWORK_JOINTS, SIDES, sided
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.image.projection import carried
from lassokin_ros.core.kernel import kernel
from lassokin_ros.core.observation import AXES

TIMES = np.array([0.0, 0.05, 0.1, 0.2, 0.4, 0.8])
"""s before the present: times of the keypoints in the input."""
LONGEST_GAP = 0.6
"""s: detections further apart are not interpolated."""
SAME_TIME = 1e-5
"""s: a detection nearer to a time than this is of that time; the rounding of stamps is 0.2 us."""

Offset = tuple[float, float, float]


def _sided(joint: str, on: str, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> list[tuple[str, str, Offset]]:
    """The entries of `CANONICAL` for both sides; x is mirrored."""
    return [(f"{side}_{joint}", f"{side}_{on}", (sign * x, y, z)) for side, sign in zip(SIDES, (1.0, -1.0))]


CANONICAL = (
    ("nose", "head", (0.0, 0.032, 0.072)),
    ("left_ear", "head", (0.041, 0.036, 0.005)),
    ("right_ear", "head", (-0.041, 0.036, 0.005)),
    ("head", "head", (0.0, 0.0, 0.0)),
    ("head_top", "head", (0.0, 0.112, 0.0)),
    ("neck", "spine3", (0.0, 0.057, -0.002)),
    ("mid_hip", "pelvis", (0.0, -0.055, 0.01)),
    *(entry for joint in "shoulder elbow wrist hip knee ankle".split() for entry in _sided(joint, joint)),
    *_sided("heel", "ankle", 0.0, -0.030, -0.035),
    *_sided("toe", "ankle", -0.008, -0.032, 0.105),
)
"""Canonical points: name, joint to which the point is fixed, and its position in that joint's frame, in heights."""
NAMES = tuple(name for name, _, _ in CANONICAL)

TARGETS = ("left_hip", "left_shoulder", "right_shoulder", "head", "nose", "left_knee", "right_knee", "left_elbow",
           "right_elbow", "left_ankle", "right_ankle", "left_wrist", "right_wrist")  # fmt: skip
"""Points whose positions are output. The right hip is the mirror image of the left hip at the middle of the hips."""
PLACES = (*TARGETS, "right_hip")
LENGTHS = ("hips", "thigh", "shank", "trunk", "shoulders", "upper arm", "forearm", "neck")
"""Lengths that are input, see `lengths_of`."""
TYPICAL_LENGTHS = np.array([0.105, 0.246, 0.256, 0.287, 0.225, 0.168, 0.13, 0.08])
"""In heights."""

_GAINS = np.array([4.0, 3.0, 2.0, 1.2, 0.8])
"""Factors on the differences between the past points and the present ones, which give them a similar size."""
_IS_TRUNK = np.isin(NAMES, sided("shoulder", "hip")).astype(float)
INPUTS = len(TIMES) * len(NAMES) * 3 + 1 + 4 + len(LENGTHS) + 1
DEPTHS = len(TARGETS)
_LOWER = np.tril_indices(DEPTHS, -1)
OUTPUTS = 3 * DEPTHS + DEPTHS + len(_LOWER[0]) + DEPTHS
"""Positions x, y, z; logarithms of the whitening's diagonal; its lower part; logarithms of the scales of x and y."""
_FROM_OUTPUTS = np.zeros((DEPTHS, DEPTHS), dtype=int)
_FROM_OUTPUTS[_LOWER] = np.arange(4 * DEPTHS, OUTPUTS - DEPTHS)
_STRICTLY_LOWER, _UNIT = np.tri(DEPTHS, k=-1, dtype=np.float32), np.eye(DEPTHS, dtype=np.float32)
LEAST_SEEN = 5
"""Smallest number of canonical points that must be visible now."""


def canonical_index(layout: Layout, skeleton: Skeleton) -> np.ndarray:
    """(canonical points,) index of the layout's landmark at each canonical point, -1 if there is none."""
    index = np.full(len(NAMES), -1)
    for point, (_, joint, offset) in enumerate(CANONICAL):
        if joint not in skeleton.joint_names:
            continue
        distance = np.linalg.norm(layout.offsets / skeleton.height - offset, axis=1)
        distance[layout.joints != skeleton.index(joint)] = np.inf
        if distance.min() <= 0.02:  # of the height
            index[point] = int(np.argmin(distance))
    return index


def lengths_of(skeleton: Skeleton) -> np.ndarray:
    """(len(LENGTHS),) of a skeleton at rest, in heights."""
    place = {name: skeleton.rest_positions[joint] for joint, name in enumerate(skeleton.joint_names)}
    return lengths_between({name: place[name] for name in NETWORK_JOINTS}) / skeleton.height


def lengths_between(place: dict[str, np.ndarray]) -> np.ndarray:
    """(len(LENGTHS),) of named points (3,) of a body at rest."""

    def apart(a: str, b: str) -> float:
        return float(np.mean([np.linalg.norm(place[f"{side}_{a}"] - place[f"{side}_{b}"]) for side in SIDES]))

    hips, shoulders = (0.5 * (place[f"left_{j}"] + place[f"right_{j}"]) for j in ("hip", "shoulder"))
    across = [float(np.linalg.norm(place[f"left_{j}"] - place[f"right_{j}"])) for j in ("hip", "shoulder")]
    trunk, neck = np.linalg.norm(shoulders - hips), np.linalg.norm(place["head"] - shoulders)
    limbs = apart("hip", "knee"), apart("knee", "ankle"), apart("shoulder", "elbow"), apart("elbow", "wrist")
    return np.array([across[0], limbs[0], limbs[1], trunk, across[1], limbs[2], limbs[3], neck])


@dataclass(eq=False)
class Scene:
    """The input of the network, with any leading axes; all points are normalised image coordinates.

    points: (..., times, canonical points, 2), any finite value if not visible; seen: the same shape without the last
    axis, bool; up: (..., 3) unit vector in the camera frame, and (...,) bool up_known; lengths: (..., LENGTHS) in
    heights, and (...,) bool lengths_known.
    """

    points: np.ndarray
    seen: np.ndarray
    up: np.ndarray
    up_known: np.ndarray
    lengths: np.ndarray
    lengths_known: np.ndarray


def features(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """(inputs (..., INPUTS) float32, rotation (..., 3, 3) from the camera frame into the virtual camera)."""
    if kernel.active and scene.points.ndim == 3:
        result, rotation = np.empty(INPUTS, dtype=np.float32), np.empty((3, 3))
        rest = np.concatenate(([scene.up_known], _length_inputs(scene)))
        given = scene.points.copy(), scene.seen, _IS_TRUNK, _GAINS, scene.up * scene.up_known, rest
        if kernel.features(*given, result, rotation):
            return result, rotation
    seen = scene.seen.astype(np.float32)
    rotation = _virtual_camera(scene.points[..., 0, :, :], seen[..., 0, :])
    points = scene.points @ rotation[..., None, :, :2].swapaxes(-1, -2) + rotation[..., None, None, :, 2]
    places = points[..., :2] / np.maximum(points[..., 2:], 0.1)
    places *= seen[..., None]
    present, now = places[..., 0, :, :], seen[..., 0, :]
    size = np.sqrt((present * present).sum((-1, -2)) / np.maximum(now.sum(-1), 1.0)) + 1e-6
    places /= size[..., None, None, None]
    past = places[..., 1:, :, :]
    past -= present[..., None, :, :] * seen[..., 1:, :, None]
    past *= _GAINS[:, None, None]
    lead = places.shape[:-3]
    result = np.empty((*lead, INPUTS), dtype=np.float32)
    values = len(TIMES) * len(NAMES)
    np.minimum(np.maximum(places, -6.0, out=places), 6.0, out=places)
    result[..., : 2 * values] = places.reshape(*lead, -1)
    result[..., 2 * values : 3 * values] = seen.reshape(*lead, -1)
    rest = result[..., 3 * values :]
    rest[..., 0] = np.log(size) + 2.0
    known = np.asarray(scene.up_known, dtype=np.float32)[..., None]
    rest[..., 1:4] = (rotation @ scene.up[..., None])[..., 0] * known
    rest[..., 4:5] = known
    rest[..., 5:] = _length_inputs(scene)
    return result, rotation


def _length_inputs(scene: Scene) -> np.ndarray:
    """(..., LENGTHS + 1): the lengths, 0 if they are not known, and whether they are known."""
    known = np.asarray(scene.lengths_known, dtype=float)[..., None]
    return np.concatenate(((scene.lengths - TYPICAL_LENGTHS) / 0.02 * known, known), axis=-1)


def _virtual_camera(points: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """(..., 3, 3): the smallest rotation that brings the middle of the body onto the optical axis.

    The middle is that of the visible shoulders and hips, or of all points if fewer than two of those are visible.
    """
    on_trunk = seen * _IS_TRUNK
    weights = np.where(on_trunk.sum(-1, keepdims=True) >= 2, on_trunk, seen)
    weights = weights / np.maximum(weights.sum(-1, keepdims=True), 1.0)
    return camera_towards((weights[..., None, :] @ points)[..., 0, :])


def camera_towards(centre: np.ndarray) -> np.ndarray:
    """(..., 3, 3): the smallest rotation that brings a normalised point of the image (..., 2) onto the optical axis."""
    x, y = centre[..., 0], centre[..., 1]
    z = 1 / np.sqrt(1 + x * x + y * y)
    across = centre * z[..., None]
    rotation = np.empty((*z.shape, 3, 3))
    moved = across[..., :, None] * across[..., None, :] * (1 / (1 + z))[..., None, None]
    np.subtract(AXES[:2, :2], moved, out=rotation[..., :2, :2])
    rotation[..., :2, 2], rotation[..., 2, :2], rotation[..., 2, 2] = -across, across, z
    return rotation


def interpreted(outputs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Decode the network's outputs (..., OUTPUTS), in the virtual camera and in heights.

    Returns places (..., DEPTHS, 3) of `TARGETS` relative to the middle of the hips; and whitening (..., DEPTHS, DEPTHS)
    lower triangular, so that whitening @ (depths - truth) has independent errors of unit scale.
    """
    d = DEPTHS
    places = outputs[..., : 3 * d].reshape(*outputs.shape[:-1], 3, d).swapaxes(-1, -2)
    diagonal = np.exp(np.minimum(np.maximum(outputs[..., 3 * d : 4 * d], -1.0), 5.0))
    whitening = outputs.take(_FROM_OUTPUTS, axis=-1) * _STRICTLY_LOWER + _UNIT
    return places, whitening * diagonal[..., None]


def linear(h: np.ndarray, W: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(2, n, k): even and odd part of h times their matrices W (2, m, k), with the bias b (k,) of the even part.

    h: (2, n, m), or (n, m) for the inputs, which both matrices multiply.
    """
    result = h @ W
    result[0] += b
    return result


HUGE_PAGE = 1 << 21
"""bytes. numpy asks the kernel for huge pages for arrays of twice this size or more."""


def in_huge_pages(arrays: Sequence[np.ndarray]) -> list[np.ndarray]:
    """float32 copies, one after another in huge pages of memory.

    The weights are read once per frame, mostly from outside the caches. From huge pages this is a fifth faster.
    """
    places = np.cumsum([0, *(-(-array.size // 16) * 16 for array in arrays)])  # each begins a cache line
    block = np.empty(max(4 * places[-1], 2 * HUGE_PAGE) + HUGE_PAGE, dtype=np.uint8)
    values = block[-block.ctypes.data % HUGE_PAGE :][: 4 * places[-1]].view(np.float32)
    copies = [values[at : at + array.size].reshape(array.shape) for at, array in zip(places, arrays)]
    for copy, array in zip(copies, arrays):
        copy[...] = array
    return copies


_HALF_SIDES = np.array([[0.5, 0.5], [0.5, -0.5]], dtype=np.float32)
"""Half the sum and half the difference of an even and an odd part, or of the values for both sides."""


def activated(h: np.ndarray) -> np.ndarray:
    """SiLU of even + odd and of even - odd, as an even and an odd part again; h: (2, n, k).

    silu(x) = x / (1 + exp(-x)) (Elfwing et al. 2018), as x/2 (1 + tanh(x/2)), which does not overflow.
    """
    half = _HALF_SIDES @ h.reshape(2, -1)
    sides = np.tanh(half)
    sides += 1
    sides *= half
    return (_HALF_SIDES @ sides).reshape(h.shape)


def layer(h: np.ndarray, W: np.ndarray, b: np.ndarray) -> np.ndarray:
    """`activated` of `linear`."""
    if kernel.active:
        result = h @ W
        if kernel.activate(result, b):
            return result
    return activated(linear(h, W, b))


class Network:
    """A perceptron with residual blocks. For the mirror image of a person it gives the mirror image of its places.

    A hidden layer h has an even part, which stays if the input is mirrored, and an odd part, which changes its sign.
    Each has its own matrix: h W is (h_even W_even, h_odd W_odd). A bias is added to the even part. `activated` mixes
    the parts and keeps the symmetry.

        h = activated(x W + b);  h += activated(h A + a) B + b, per block;  y = (h_even, h_odd) W + b

    The first and the last W have the symmetry of inputs and places (training/symmetry.py). The columns for the
    whitening have none, because a triangular matrix depends on the order of the targets.
    """

    def __init__(self, weights: Sequence[np.ndarray]) -> None:
        """weights: W (2, INPUTS, k), b (k,); per block A (2, k, k), a, B, b; W (2 k, OUTPUTS), b (OUTPUTS,)."""
        self.weights = in_huge_pages(weights)

    def __call__(self, inputs: np.ndarray) -> np.ndarray:
        """(..., OUTPUTS) of inputs (..., INPUTS), float32."""
        w = self.weights
        h = layer(inputs.reshape(-1, INPUTS), w[0], w[1])
        for block in range(2, len(w) - 2, 4):
            A, a, B, b = w[block : block + 4]
            h += linear(layer(h, A, a), B, b)
        outputs = np.concatenate((h[0], h[1]), axis=-1) @ w[-2] + w[-1]
        return outputs.reshape(*inputs.shape[:-1], OUTPUTS)

    def estimate(self, scene: Scene, height: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """For one scene and a person of this height, m: places of `PLACES` (k, 3) m, depths (DEPTHS,) m, whitening
        (DEPTHS, DEPTHS) 1/m, and the rotation (3, 3) into the virtual camera.
        """
        inputs, rotation = features(scene)
        found, whitening = interpreted(self(inputs))
        targets = height * found.astype(float)
        places = np.concatenate((targets, -targets[:1]))  # left_hip is the first target
        return places, targets[:, 2].copy(), whitening.astype(float) / height, rotation


def load_weights(file: Path | None = None) -> tuple[Network, dict[str, Any]]:
    """The network of an npz file (default: the shipped one) and its provenance."""
    source = file or resources.files("lassokin_ros.core.network") / "depth_network.npz"
    with source.open("rb") as stream, np.load(stream, allow_pickle=False) as data:
        names = [f"w{i}" for i in range(int(data["count"]))]
        weights = [data[name] for name in names]
        provenance = {name: data[name].tolist() for name in data if name not in names}
    return Network(weights), provenance


@cache
def shipped_network() -> Network:
    """The network that is shipped with the package, read once."""
    return load_weights()[0]


MOST_FRAMES, LEAST_STEP = 512, 0.004
"""Frames that are kept, and s between two of them. Half of them cover all `TIMES` at any rate of the detector."""


class History:
    """The canonical points of the last frames, and their interpolation at `TIMES`."""

    def __init__(self) -> None:
        self._stamps = np.empty(MOST_FRAMES)
        self._points = np.zeros((MOST_FRAMES, len(NAMES), 2))
        self._seen = np.zeros((MOST_FRAMES, len(NAMES)), dtype=bool)
        self.reset()

    def reset(self) -> None:
        """Forget all frames."""
        self._count = 0

    def add(self, stamp: float, points: np.ndarray, seen: np.ndarray) -> None:
        """Append a frame: stamp s, later than the last; points (canonical, 2); seen (canonical,)."""
        last = self._stamps[: self._count][-2:]
        if len(last) == 2 and last[1] - last[0] < LEAST_STEP:
            self._count -= 1  # the newest frame takes the place of the last one
        elif self._count == MOST_FRAMES:
            half = MOST_FRAMES // 2
            for array in (self._stamps, self._points, self._seen):
                array[:half] = array[half:].copy()
            self._count = half
        self._stamps[self._count], self._points[self._count], self._seen[self._count] = stamp, points, seen
        self._count += 1

    def carry(self, rotation: np.ndarray, shift: np.ndarray) -> None:
        """Continue in the image of the camera after it has moved; see `projection.carried`. shift: (canonical, 3)."""
        if self._count:
            stamps = self._stamps[: self._count]
            recent = slice(stamps.searchsorted(stamps[-1] - TIMES[-1] - LONGEST_GAP), self._count)
            self._points[recent] = carried(self._points[recent], rotation, shift)

    def sampled(self) -> tuple[np.ndarray, np.ndarray]:
        """(points (times, canonical, 2), seen (times, canonical)) at `TIMES` before the newest frame."""
        stamps = self._stamps[: self._count]
        wanted = stamps[-1] - TIMES
        later = np.minimum(np.maximum(stamps.searchsorted(wanted - SAME_TIME), 1), self._count - 1)
        frames = np.maximum([later - 1, later], 0)
        return interpolated(wanted, stamps.take(frames), self._points.take(frames, 0), self._seen.take(frames, 0))


def interpolated(
    wanted: np.ndarray, stamps: np.ndarray, points: np.ndarray, seen: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Points (..., times, canonical, 2) at the wanted times (..., times), s, and whether each is known.

    stamps, points, seen: of the detections before and after each time, on a further first axis. A point is known if
    both contain it, at most `LONGEST_GAP` apart, and the time is between them; or if the time is that of one detection.
    """
    before, after = stamps
    gap = after - before
    share = np.minimum(np.maximum((wanted - before) / np.maximum(gap, 1e-6), 0.0), 1.0)
    share[wanted <= before + SAME_TIME] = 0.0
    share[wanted >= after - SAME_TIME] = 1.0
    inside = (wanted >= before - SAME_TIME) & (gap <= LONGEST_GAP + SAME_TIME)
    s = share[..., None]
    known = (inside | (share >= 1)) & (wanted <= after + SAME_TIME)
    seen = (seen[0] | (s >= 1)) & (seen[1] | (s <= 0)) & known[..., None]
    return (points[1] - points[0]) * s[..., None] + points[0], seen
