"""The same training steps as training/network.py, by JAX on its default device, such as a GPU.

JAX is not needed for training: it is imported by `--accelerated` only. The loss is that of `training.network.loss`, its
derivative is JAX's own.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from lassokin_ros.core.network.depth_network import DEPTHS
from training.network import (
    ADAM_DECAY,
    ADAM_RATE,
    AVERAGE,
    CLIP,
    DISTANCE,
    MOMENTUM,
    MUON_DECAY,
    MUON_RATE,
    NEWTON_SCHULZ,
    PLANE,
    TAIL,
)
from training.symmetry import INPUT, PLACE

Weights = list[jax.Array]
_LOWER = np.tril_indices(DEPTHS, -1)


def outputs_of(weights: Weights, inputs: jax.Array) -> jax.Array:
    """(b, OUTPUTS) of the network with these weights, see `Network`."""
    h = _activated(_linear(inputs, weights[0], weights[1]))
    for i in range(2, len(weights) - 2, 4):
        A, a, B, b = weights[i : i + 4]
        h = h + _linear(_activated(_linear(h, A, a)), B, b)
    return jnp.concatenate((h[0], h[1]), axis=-1) @ weights[-2] + weights[-1]


def _linear(h: jax.Array, W: jax.Array, b: jax.Array) -> jax.Array:
    return (h @ W).at[0].add(b)


def _activated(h: jax.Array) -> jax.Array:
    one, other = jax.nn.silu(h[0] + h[1]), jax.nn.silu(h[0] - h[1])
    return 0.5 * jnp.stack((one + other, one - other))


def loss(weights: Weights, inputs: jax.Array, places: jax.Array) -> jax.Array:
    """`training.network.loss` of the network's outputs."""
    d, outputs = DEPTHS, outputs_of(weights, inputs)
    error = outputs[:, : 3 * d].reshape(-1, 3, d) - places.swapaxes(-1, -2)
    log_diagonal = jnp.clip(outputs[:, 3 * d : 4 * d], -1.0, 5.0)
    lower = jnp.zeros((len(outputs), d, d)).at[:, _LOWER[0], _LOWER[1]].set(outputs[:, 4 * d : -d]) + jnp.eye(d)
    r = jnp.exp(log_diagonal) * (lower @ error[:, 2, :, None])[..., 0]
    log_scale = jnp.clip(outputs[:, -d:], -5.0, 1.0)[:, None]
    q = error[:, :2] * jnp.exp(-log_scale)
    student = (TAIL + 1) / 2
    total = (student * jnp.log1p(r * r / TAIL) - log_diagonal).sum()
    total += PLANE * (student * jnp.log1p(q * q / TAIL) + log_scale).sum()
    total += DISTANCE * jnp.sqrt((error * error).sum(1) + 1e-6).sum()
    return total / len(outputs)


def symmetric(gradients: Weights) -> Weights:
    """Gradients with the symmetry of the weights, see training/symmetry.py."""
    index, sign = INPUT
    first = gradients[0]
    mirrored = first[:, index] * sign[:, None]
    first = 0.5 * jnp.stack((first[0] + mirrored[0], first[1] - mirrored[1]))
    index, sign = PLACE
    W, b, count = gradients[-2], gradients[-1], len(index)
    sides = np.repeat([1.0, -1.0], len(W) // 2)[:, None].astype(np.float32)
    W = W.at[:, :count].set(0.5 * (W[:, :count] + sides * W[:, index] * sign))
    return [first, *gradients[1:-2], W, b.at[:count].set(0.5 * (b[:count] + b[index] * sign))]


def _orthogonalised(matrix: jax.Array) -> jax.Array:
    a, b, c = NEWTON_SCHULZ
    X = matrix / (jnp.linalg.norm(matrix, axis=(-2, -1), keepdims=True) + 1e-7)
    for _ in range(5):
        A = X @ X.swapaxes(-1, -2)
        X = a * X + (b * A + c * (A @ A)) @ X
    return X


@jax.jit
def _step(state: tuple, inputs: jax.Array, places: jax.Array, share: float) -> tuple:
    """(state, loss) after a step at a share of the full rates, as `Optimiser.step`."""
    weights, firsts, seconds, averaged, count = state
    value, gradients = jax.value_and_grad(loss)(weights, inputs, places)
    gradients = symmetric(gradients)
    size = jnp.sqrt(sum((g * g).sum() for g in gradients))
    shrink = jnp.minimum(1.0, CLIP / (size + 1e-9))
    count = count + 1
    kept = jnp.minimum(AVERAGE, (1 + count) / (10 + count))
    new: tuple[Weights, Weights, Weights, Weights] = ([], [], [], [])
    for w, m, v, a, g in zip(weights, firsts, seconds, averaged, gradients):
        g = g * shrink
        if w.ndim == 3 and w.shape[1] == w.shape[2]:
            m = m + (1 - MOMENTUM) * (g - m)
            w = w * (1 - MUON_RATE * share * MUON_DECAY)
            w = w - MUON_RATE * share * _orthogonalised(g + MOMENTUM * (m - g))
        else:
            m, v = m + 0.1 * (g - m), v + 0.001 * (g * g - v)
            if w.ndim > 1:
                w = w * (1 - ADAM_RATE * share * ADAM_DECAY)
            root = jnp.sqrt(v / (1 - 0.999**count)) + 1e-8
            w = w - ADAM_RATE * share / (1 - 0.9**count) * m / root
        for kind, value_of in zip(new, (w, m, v, a + (1 - kept) * (w - a))):
            kind.append(value_of)
    return (*new, count), value


class AcceleratedTraining:
    """A network in training on the device; used as `training.network.Training`."""

    def __init__(self, weights: Sequence[np.ndarray]) -> None:
        own = [jnp.asarray(w) for w in weights]
        zero = [jnp.zeros_like(w) for w in own]
        self._state = (own, zero, zero, own, jnp.zeros((), dtype=jnp.float32))

    def step(self, inputs: np.ndarray, places: np.ndarray, share: float) -> jax.Array:
        """One step on a batch at a share of the full rates; its loss, for which nobody has waited yet."""
        self._state, value = _step(self._state, inputs, places, share)
        return value

    @property
    def averaged(self) -> list[np.ndarray]:
        """The average of the weights."""
        return [np.asarray(w) for w in self._state[3]]
