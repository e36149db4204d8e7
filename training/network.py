"""Training of the depth network in plain numpy: loss, backpropagation and optimiser."""

from __future__ import annotations

import math

import numpy as np

from lassokin_ros.core.network.depth_network import DEPTHS, INPUTS, OUTPUTS, Network, activated, linear
from training.symmetry import symmetrise_first, symmetrise_last

TAIL = 4.0
"""Degrees of freedom of Student's t, the distribution of the errors."""
JITTER = 0.008
"""In heights: noise on the target depths, so that no combination of them is considered exact."""
PLANE = 0.5
"""Weight of x and y in the loss."""
DISTANCE = 30.0
"""Per height: weight of the distances in the loss. The likelihood alone teaches the means too little where the network
is unsure (Seitzer et al. 2022, On the pitfalls of heteroscedastic uncertainty estimation)."""
ADAM_RATE, ADAM_DECAY = 1.5e-3, 0.03
MUON_RATE, MUON_DECAY, MOMENTUM = 0.02, 0.01, 0.95
NEWTON_SCHULZ = 3.4445, -4.7750, 2.0315
"""Coefficients of Muon's polynomial."""
CLIP = 20.0
"""Gradients longer than this are shortened."""
AVERAGE = 0.9995
"""Share of the average of the weights that stays in a step."""
_LOWER = np.tril_indices(DEPTHS, -1)


def initial_weights(width: int, blocks: int, random: np.random.Generator) -> list[np.ndarray]:
    """He's initialisation, with the symmetry; each block starts near the identity. width: of both parts together."""
    k = width // 2

    def matrix(rows: int, columns: int, gain: float) -> np.ndarray:
        return (random.standard_normal((rows, columns)) * gain / math.sqrt(rows)).astype(np.float32)

    def pair(rows: int, columns: int, gain: float) -> np.ndarray:
        return np.array([matrix(rows, columns, gain) for _ in range(2)])

    weights = [pair(INPUTS, k, 1.0), np.zeros(k, dtype=np.float32)]
    for _ in range(blocks):
        weights += [pair(k, k, math.sqrt(2)), np.zeros(k, dtype=np.float32)]
        weights += [pair(k, k, 0.2), np.zeros(k, dtype=np.float32)]
    weights += [matrix(2 * k, OUTPUTS, 0.14), np.zeros(OUTPUTS, dtype=np.float32)]
    weights[-1][3 * DEPTHS : 4 * DEPTHS] = 2.0
    weights[-1][-DEPTHS:] = -2.5
    symmetrise_first(weights[0])
    symmetrise_last(weights[-2], weights[-1])
    return weights


def loss(outputs: np.ndarray, places: np.ndarray) -> tuple[float, np.ndarray]:
    """(loss, its derivative by outputs (b, OUTPUTS)); places: (b, TARGETS, 3).

    The loss is the mean of a negative log-likelihood and of `DISTANCE` times the sum of the targets' errors (distances
    in 3D). The likelihood of the depths is Student's t of each component of the whitened error r = D (I + L) e, with
    log D and L from the output; that of x and y is Student's t of each one separately.
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
    distance = np.sqrt((error * error).sum(1) + 1e-6)
    gradient[:, : 3 * d] += DISTANCE * (error / distance[:, None]).reshape(size, -1)
    total = value.sum() + PLANE * plane.sum() + DISTANCE * distance.sum()
    return float(total) / size, gradient / size


def backpropagated(network: Network, inputs: np.ndarray, places: np.ndarray) -> tuple[float, list[np.ndarray]]:
    """The loss of a batch, and its derivatives by the weights, in their order, with the symmetry of the weights."""
    w = network.weights
    kept: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    first = linear(inputs, w[0], w[1])
    h = activated(first)
    for i in range(2, len(w) - 2, 4):
        before = linear(h, w[i], w[i + 1])
        inner = activated(before)
        kept.append((h, before, inner))
        h = h + linear(inner, w[i + 2], w[i + 3])
    joined = np.concatenate((h[0], h[1]), axis=-1)
    value, g = loss(joined @ w[-2] + w[-1], places)
    gradients: list[np.ndarray] = [joined.T @ g, g.sum(0)]
    symmetrise_last(*gradients)
    k = len(w[1])
    g = g @ w[-2].T
    g = np.array([g[:, :k], g[:, k:]])
    for i, (entered, before, inner) in zip(range(len(w) - 6, 0, -4), reversed(kept)):
        own = [inner.swapaxes(-1, -2) @ g, g[0].sum(0)]
        inside = _activation_gradient(before, g @ w[i + 2].swapaxes(-1, -2))
        gradients = [entered.swapaxes(-1, -2) @ inside, inside[0].sum(0), *own, *gradients]
        g = g + inside @ w[i].swapaxes(-1, -2)
    g = _activation_gradient(first, g)
    gradients = [inputs.T @ g, g[0].sum(0), *gradients]
    symmetrise_first(gradients[0])
    return value, gradients


def _activation_gradient(h: np.ndarray, g: np.ndarray) -> np.ndarray:
    """Gradient by the argument h (2, b, k) of `activated`, from the gradient g by its value."""
    x = np.stack((h[0] + h[1], h[0] - h[1]))
    s = 0.5 + 0.5 * np.tanh(0.5 * x)
    by_side = 0.5 * np.stack((g[0] + g[1], g[0] - g[1])) * (s * (1 + x * (1 - s)))
    return np.stack((by_side[0] + by_side[1], by_side[0] - by_side[1]))


class Optimiser:
    """Muon for the matrices of the blocks, Adam for the other weights, and an average of the weights.

    Muon (Jordan 2024) replaces the momentum of a matrix by the nearest orthogonal matrix, so that all directions are
    learned at the same rate. Adam: Kingma & Ba 2015. Both with decoupled decay (Loshchilov & Hutter 2019).
    """

    def __init__(self, weights: list[np.ndarray]) -> None:
        self.weights = weights
        self._first = [np.zeros_like(w) for w in weights]
        self._second = [np.zeros_like(w) for w in weights]
        self.averaged = [w.copy() for w in weights]
        self._step = 0

    def step(self, gradients: list[np.ndarray], share: float) -> None:
        """One step at a share of the full rates."""
        self._step += 1
        size = math.sqrt(sum(float(np.vdot(g, g)) for g in gradients))
        shrink = np.float32(min(1.0, CLIP / (size + 1e-9)))
        kept = min(AVERAGE, (1 + self._step) / (10 + self._step))
        for i, (w, a, g) in enumerate(zip(self.weights, self.averaged, gradients)):
            if w.ndim == 3 and w.shape[1] == w.shape[2]:
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
        if w.ndim > 1:
            w *= np.float32(1 - ADAM_RATE * share * ADAM_DECAY)
        m += np.float32(0.1) * (g - m)
        v += np.float32(0.001) * (g * g - v)
        w -= np.float32(ADAM_RATE * share / one) * m / (np.sqrt(v / np.float32(two)) + np.float32(1e-8))


class Training:
    """A network in training on the processor."""

    def __init__(self, weights: list[np.ndarray]) -> None:
        self._network = Network(weights)
        self._optimiser = Optimiser(self._network.weights)

    def step(self, inputs: np.ndarray, places: np.ndarray, share: float) -> float:
        """One step on a batch at a share of the full rates; its loss."""
        value, gradients = backpropagated(self._network, inputs, places)
        self._optimiser.step(gradients, share)
        return value

    @property
    def averaged(self) -> list[np.ndarray]:
        """The average of the weights."""
        return self._optimiser.averaged


def orthogonalised(matrix: np.ndarray) -> np.ndarray:
    """About U V' of square matrices U S V' (..., k, k), by five Newton-Schulz steps: singular values 0.7 to 1.2."""
    a, b, c = np.float32(NEWTON_SCHULZ)
    X = matrix / (np.linalg.norm(matrix, axis=(-2, -1), keepdims=True) + np.float32(1e-7))
    for _ in range(5):
        A = X @ X.swapaxes(-1, -2)
        X = a * X + (b * A + c * (A @ A)) @ X
    return np.asarray(X)
