"""The mirror symmetry of the depth network's inputs and outputs, and its projection of weights."""

from __future__ import annotations

import numpy as np

from lassokin_ros.core.body.proportions import partners
from lassokin_ros.core.network.depth_network import DEPTHS, INPUTS, NAMES, TARGETS, TIMES

OTHER = partners(NAMES)
"""Index of each canonical point's mirror image."""


def _input_symmetry() -> tuple[np.ndarray, np.ndarray]:
    """(index, sign), each (INPUTS,): the mirrored input is sign * input[index]. See `features` for the order."""
    index, sign = np.arange(INPUTS), np.ones(INPUTS, dtype=np.float32)
    values = len(TIMES) * len(NAMES)
    index[: 2 * values] = index[: 2 * values].reshape(len(TIMES), len(NAMES), 2)[:, OTHER].ravel()
    index[2 * values : 3 * values] = index[2 * values : 3 * values].reshape(len(TIMES), len(NAMES))[:, OTHER].ravel()
    sign[: 2 * values : 2] = -1.0  # x
    sign[3 * values + 1] = -1.0  # x of the vertical
    return index, sign


def _place_symmetry() -> tuple[np.ndarray, np.ndarray]:
    """(index, sign), each (3 DEPTHS,): the same for the places in the output.

    The mirror image of the left hip, relative to the middle of the hips, is the right hip with -x; and that is the left
    hip with -y and -z.
    """
    others = partners(TARGETS)
    index = np.concatenate([others, others + DEPTHS, others + 2 * DEPTHS])
    sign = np.repeat(np.array([-1.0, 1.0, 1.0], dtype=np.float32), DEPTHS)
    sign[TARGETS.index("left_hip") :: DEPTHS] *= -1.0
    return index, sign


INPUT, PLACE = _input_symmetry(), _place_symmetry()


def symmetrise_first(W: np.ndarray) -> None:
    """Make the even part of a first matrix (2, INPUTS, k) or of its gradient even, and the odd part odd, in place."""
    index, sign = INPUT
    mirrored = W[:, index] * sign[:, None]
    W[0] = 0.5 * (W[0] + mirrored[0])
    W[1] = 0.5 * (W[1] - mirrored[1])


def symmetrise_last(W: np.ndarray, b: np.ndarray) -> None:
    """The same for the columns of the places in a last matrix (2 k, OUTPUTS) and its bias (OUTPUTS,)."""
    index, sign = PLACE
    k, count = len(W) // 2, len(index)
    mirrored = W[:, index] * sign
    W[:k, :count] = 0.5 * (W[:k, :count] + mirrored[:k])
    W[k:, :count] = 0.5 * (W[k:, :count] - mirrored[k:])
    b[:count] = 0.5 * (b[:count] + b[index] * sign)
