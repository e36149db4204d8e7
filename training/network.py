"""Training of the depth network in plain numpy: loss, backpropagation and optimiser."""

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
ADAM_RATE, ADAM_DECAY = 1.5e-3, 0.03
MUON_RATE, MUON_DECAY, MOMENTUM = 0.02, 0.01, 0.95
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


class Optimiser:
    """Muon for the matrices of the blocks, Adam for the other weights, and an average of the weights.

    Muon (Jordan 2024) replaces the momentum of a matrix by the nearest orthogonal matrix, so that all directions are
    learned at the same rate. Adam: Kingma & Ba 2015. Both with decoupled decay (Loshchilov & Hutter 2019).
    """

    def __init__(self, weights: list[np.ndarray], average: float = 0.9995) -> None:
        self.weights, self._average = weights, average
        self._first = [np.zeros_like(w) for w in weights]
        self._second = [np.zeros_like(w) for w in weights]
        self.averaged = [w.copy() for w in weights]
        self._step = 0

    def step(self, gradients: list[np.ndarray], share: float, clip: float = 20.0) -> None:
        """One step at a share of the full rates; gradients longer than `clip` are shortened."""
        self._step += 1
        size = math.sqrt(sum(float(np.vdot(g, g)) for g in gradients))
        shrink = np.float32(min(1.0, clip / (size + 1e-9)))
        kept = min(self._average, (1 + self._step) / (10 + self._step))
        for i, (w, a, g) in enumerate(zip(self.weights, self.averaged, gradients)):
            if w.ndim == 2 and w.shape[0] == w.shape[1]:
                self._muon(i, w, g * shrink, share)
            else:
                self._adam(i, w, g * shrink, share)
            a += np.float32(1 - kept) * (w - a)

    def _muon(self, i: int, w: np.ndarray, g: np.ndarray, share: float) -> None:
        momentum = self._first[i]
        momentum += np.float32(1 - MOMENTUM) * (g - momentum)
        w *= np.float32(1 - MUON_RATE * share * MUON_DECAY)
        w -= np.float32(MUON_RATE * share) * orthogonalised(g + np.float32(MOMENTUM) * (momentum - g))

    def _adam(self, i: int, w: np.ndarray, g: np.ndarray, share: float) -> None:
        m, v = self._first[i], self._second[i]
        one, two = 1 - 0.9**self._step, 1 - 0.999**self._step
        if w.ndim == 2:
            w *= np.float32(1 - ADAM_RATE * share * ADAM_DECAY)
        m += np.float32(0.1) * (g - m)
        v += np.float32(0.001) * (g * g - v)
        w -= np.float32(ADAM_RATE * share / one) * m / (np.sqrt(v / np.float32(two)) + np.float32(1e-8))


def orthogonalised(matrix: np.ndarray) -> np.ndarray:
    """About U V' of a square matrix U S V', by five Newton-Schulz steps: its singular values become 0.7 to 1.2."""
    a, b, c = np.float32(3.4445), np.float32(-4.7750), np.float32(2.0315)
    X = matrix / np.float32(np.linalg.norm(matrix) + 1e-7)
    for _ in range(5):
        A = X @ X.T
        X = a * X + (b * A + c * (A @ A)) @ X
    return np.asarray(X)
