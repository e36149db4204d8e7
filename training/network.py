"""Training of the depth network in plain numpy: loss, backpropagation and Adam."""

from __future__ import annotations

import math

import numpy as np

from lassokin_ros.core.evidence.depth_network import DEPTHS, INPUTS, OUTPUTS, Network

TAIL = 4.0
"""Degrees of freedom of Student's t, the distribution of the errors."""
JITTER = 0.008
"""In heights: noise on the target depths, so that no combination of them is considered exact."""
PLANE = 0.5
"""Weight of x and y in the loss."""
_LOWER = np.tril_indices(DEPTHS, -1)


def initial_weights(width: int, blocks: int, random: np.random.Generator) -> list[np.ndarray]:
    """He's initialisation; each block starts as the identity."""

    def matrix(rows: int, columns: int, gain: float) -> np.ndarray:
        return (random.standard_normal((rows, columns)) * gain / math.sqrt(rows)).astype(np.float32)

    weights = [matrix(INPUTS, width, 1.0), np.zeros(width, dtype=np.float32)]
    for _ in range(blocks):
        weights += [matrix(width, width, math.sqrt(2)), np.zeros(width, dtype=np.float32)]
        weights += [matrix(width, width, 0.2), np.zeros(width, dtype=np.float32)]
    weights += [matrix(width, OUTPUTS, 0.1), np.zeros(OUTPUTS, dtype=np.float32)]
    weights[-1][3 * DEPTHS : 4 * DEPTHS] = 2.0
    weights[-1][-DEPTHS:] = -2.5
    return weights


def loss(outputs: np.ndarray, places: np.ndarray) -> tuple[float, np.ndarray]:
    """(mean negative log-likelihood, its derivative by outputs (b, OUTPUTS)); places: (b, TARGETS, 3).

    Depths: Student's t of each component of the whitened error r = D (I + L) e, with log D and L from the output. x and
    y: Student's t of each one separately.
    """
    d, size = DEPTHS, len(outputs)
    gradient = np.zeros_like(outputs)
    error = outputs[:, : 3 * d].reshape(size, 3, d) - places.swapaxes(-1, -2)
    raw = outputs[:, 3 * d : 4 * d]
    log_diagonal = np.clip(raw, -1.0, 5.0)
    D = np.exp(log_diagonal)
    lower = np.zeros((size, d, d), dtype=outputs.dtype)
    lower[:, _LOWER[0], _LOWER[1]] = outputs[:, 4 * d : -d]
    lower[:, np.arange(d), np.arange(d)] = 1.0
    depth = error[:, 2]
    r = D * (lower @ depth[..., None])[..., 0]
    value = (TAIL + 1) / 2 * np.log1p(r * r / TAIL) - log_diagonal
    g = (TAIL + 1) * r / (TAIL + r * r)
    by_product = g * D
    gradient[:, 2 * d : 3 * d] = (by_product[:, None] @ lower)[:, 0]
    gradient[:, 3 * d : 4 * d] = (g * r - 1) * (raw == log_diagonal)
    gradient[:, 4 * d : -d] = by_product[:, _LOWER[0]] * depth[:, _LOWER[1]]
    raw_scale = outputs[:, -d:]
    log_scale = np.clip(raw_scale, -5.0, 1.0)
    q = error[:, :2] * np.exp(-log_scale)[:, None]
    plane = (TAIL + 1) / 2 * np.log1p(q * q / TAIL) + log_scale[:, None]
    g = (TAIL + 1) * q / (TAIL + q * q)
    gradient[:, : 2 * d] = PLANE * (g * np.exp(-log_scale)[:, None]).reshape(size, -1)
    gradient[:, -d:] = PLANE * (1 - g * q).sum(1) * (raw_scale == log_scale)
    return float(value.sum() / size + PLANE * plane.sum() / size), gradient / size


def backpropagated(network: Network, inputs: np.ndarray, places: np.ndarray) -> tuple[float, list[np.ndarray]]:
    """The loss of a batch, and its derivatives by the weights, in their order."""
    w = network.weights
    kept: list[tuple[np.ndarray, np.ndarray]] = []
    first = np.maximum(inputs @ w[0] + w[1], 0)
    h = first
    for i in range(2, len(w) - 2, 4):
        inner = np.maximum(h @ w[i] + w[i + 1], 0)
        kept.append((h, inner))
        h = h + (inner @ w[i + 2] + w[i + 3])
    value, g = loss(h @ w[-2] + w[-1], places)
    gradients: list[np.ndarray] = [h.T @ g, g.sum(0)]
    g = g @ w[-2].T
    for i, (before, inner) in zip(range(len(w) - 6, 0, -4), reversed(kept)):
        own = [inner.T @ g, g.sum(0)]
        inside = (g @ w[i + 2].T) * (inner > 0)
        gradients = [before.T @ inside, inside.sum(0), *own, *gradients]
        g = g + inside @ w[i].T
    g = g * (first > 0)
    return value, [inputs.T @ g, g.sum(0), *gradients]


class Adam:
    """Adam with decoupled weight decay and an average of the weights (Kingma & Ba 2015; Loshchilov & Hutter 2019)."""

    def __init__(self, weights: list[np.ndarray], decay: float = 0.03, average: float = 0.9995) -> None:
        self.weights, self._decay, self._average = weights, decay, average
        self._first = [np.zeros_like(w) for w in weights]
        self._second = [np.zeros_like(w) for w in weights]
        self.averaged = [w.copy() for w in weights]
        self._step = 0

    def step(self, gradients: list[np.ndarray], rate: float, clip: float = 20.0) -> None:
        """One step; gradients longer than `clip` are shortened."""
        self._step += 1
        size = math.sqrt(sum(float(np.vdot(g, g)) for g in gradients))
        shrink = np.float32(min(1.0, clip / (size + 1e-9)))
        one, two = 1 - 0.9**self._step, 1 - 0.999**self._step
        kept = min(self._average, (1 + self._step) / (10 + self._step))
        for w, m, v, a, g in zip(self.weights, self._first, self._second, self.averaged, gradients):
            g = g * shrink
            m += np.float32(0.1) * (g - m)
            v += np.float32(0.001) * (g * g - v)
            if w.ndim == 2:
                w *= np.float32(1 - rate * self._decay)
            w -= np.float32(rate / one) * m / (np.sqrt(v / np.float32(two)) + np.float32(1e-8))
            a += np.float32(1 - kept) * (w - a)
