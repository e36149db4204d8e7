"""Train the hand network on synthetic hands, in some minutes on one processor.

python -m training.hand_network --output lassokin_ros/core/network/hand_network.npz
"""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path

import numpy as np

from lassokin_ros.core.network.hand_network import (
    DEPTHS,
    INPUTS,
    LEAST_SEEN,
    OUTPUTS,
    HandNetwork,
    features,
    interpreted,
)
from training.hands import FINGERS, POINTS, orientations, points_of, postures, somebody

WIDTH, BATCH = 224, 512
RATE, DISTANCE, TAIL = 2e-3, 3.0, 4.0
"""Rate of Adam; weight of the distances in the loss, as in training/network.py; degrees of freedom of Student's t."""
NEAREST, FARTHEST, ASIDE = 0.35, 3.5, 0.5
"""m, distance of the hand; and its largest tangent to the optical axis."""
NOISE, NOISE_SHARE, OFFSET = 0.001, 0.015, 0.003
"""Standard deviations of a keypoint: normalised, as a share of the hand's size in the image, and m."""
MEDIAN_OF_STUDENT = 0.7407
"""Median of the absolute value of Student's t with TAIL degrees of freedom."""


def shapes(random: np.random.Generator, people: int, each: int) -> np.ndarray:
    """(people each, 21, 3) m."""
    return np.concatenate([points_of(somebody(random), postures(random, each)) for _ in range(people)])


def views(random: np.random.Generator, hands: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(inputs (n, INPUTS), depths (n, DEPTHS)) of hands before a camera, some with hidden points."""
    count = len(hands)
    turn = orientations(random, count)
    z = np.exp(random.uniform(math.log(NEAREST), math.log(FARTHEST), count))
    place = np.concatenate([random.uniform(-ASIDE, ASIDE, (count, 2)), np.ones((count, 1))], axis=1) * z[:, None]
    true = hands @ turn.swapaxes(-1, -2) + place[:, None]
    seen_at = true + random.normal(size=true.shape) * OFFSET
    points = seen_at[..., :2] / seen_at[..., 2:]
    extent = np.linalg.norm(np.ptp(points, axis=1), axis=-1)[:, None, None]
    points = points + random.normal(size=points.shape) * (NOISE / z[:, None, None] + NOISE_SHARE * extent)
    hidden = (random.random((count, 1)) < 0.2) & (random.random((count, 21)) < 0.15)
    gone = (random.random((count, 1)) < 0.2) & (random.random((count, 5)) < 0.3)
    for number, finger in enumerate((*FINGERS, "thumb")):
        hidden[:, [point.startswith(finger) for point in POINTS]] |= gone[:, number : number + 1]
    hidden[hidden.sum(axis=1) > len(POINTS) - LEAST_SEEN] = False
    inputs, size, rotation = features(points, ~hidden)
    depth = (true @ rotation[:, 2, :, None])[..., 0]
    return inputs, (depth[:, 1:] - depth[:, :1]) / (depth[:, :1] * size[:, None])


def loss(outputs: np.ndarray, truth: np.ndarray) -> tuple[float, np.ndarray]:
    """(loss, its derivative): the likelihood of Student's t, and `DISTANCE` times the absolute errors."""
    depths, deviations = interpreted(outputs)
    error = depths - truth
    r = error / deviations
    away = np.sqrt(error * error + 1e-4)
    value = (TAIL + 1) / 2 * np.log1p(r * r / TAIL) + np.log(deviations) + DISTANCE * away
    g = (TAIL + 1) * r / (TAIL + r * r)
    gradient = np.concatenate([g / deviations + DISTANCE * error / away, 1 - g * r], axis=1)
    return float(value.mean()), gradient / error.size


def trained(random: np.random.Generator, hands: np.ndarray, steps: int) -> list[np.ndarray]:
    """Weights W0, b0, ... b2 after steps of Adam (Kingma and Ba 2015) at a rate that falls to 0 as a cosine."""
    sizes = (INPUTS, WIDTH, WIDTH, OUTPUTS)
    weights = []
    for rows, columns in zip(sizes, sizes[1:]):
        weights += [random.normal(size=(rows, columns)) * math.sqrt(2 / rows), np.zeros(columns)]
    weights[-2] *= 0.1
    weights = [one.astype(np.float32) for one in weights]
    first, second = [np.zeros_like(one) for one in weights], [np.zeros_like(one) for one in weights]
    began = time.process_time()
    for step in range(1, steps + 1):
        inputs, truth = views(random, hands[random.integers(len(hands), size=BATCH)])
        h0 = np.maximum(inputs @ weights[0] + weights[1], 0)
        h1 = np.maximum(h0 @ weights[2] + weights[3], 0)
        value, g = loss(h1 @ weights[4] + weights[5], truth.astype(np.float32))
        g = g.astype(np.float32)
        g1 = (g @ weights[4].T) * (h1 > 0)
        g0 = (g1 @ weights[2].T) * (h0 > 0)
        gradients = [inputs.T @ g0, g0.sum(0), h0.T @ g1, g1.sum(0), h1.T @ g, g.sum(0)]
        rate = RATE * 0.5 * (1 + math.cos(math.pi * step / steps)) * min(step / 200, 1.0)
        rate *= math.sqrt(1 - 0.999**step) / (1 - 0.9**step)
        for w, m, v, d in zip(weights, first, second, gradients):
            m += 0.1 * (d - m)
            v += 0.001 * (d * d - v)
            w -= rate * m / (np.sqrt(v) + 1e-8)
        if step % 500 == 0:
            print(f"step {step}, loss {value:.3f}, {time.process_time() - began:.0f} s", flush=True)
    return weights


def whitening(errors: np.ndarray) -> np.ndarray:
    """(DEPTHS, DEPTHS): makes errors over their deviations (n, DEPTHS) independent, with Student's median."""
    clipped = np.clip(errors, -4, 4)
    W = np.linalg.cholesky(np.linalg.inv(clipped.T @ clipped / len(clipped) + 0.01 * np.eye(DEPTHS))).T
    return np.asarray(W * (MEDIAN_OF_STUDENT / np.median(np.abs(errors @ W.T), axis=0))[:, None])


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, required=True, help="npz file to write")
    parser.add_argument("--steps", type=int, default=9000)
    arguments = parser.parse_args()
    random = np.random.default_rng(1)
    weights = trained(random, shapes(random, 300, 250), arguments.steps)
    named = {f"{kind}{i}": weights[2 * i + j].astype(np.float16) for i in range(3) for j, kind in enumerate("Wb")}
    network = HandNetwork(named | {"whitening": np.eye(DEPTHS)})
    others = np.random.default_rng(2)  # people that were not in training
    inputs, truth = views(others, shapes(others, 60, 200))
    depths, deviations = interpreted(network(inputs).astype(float))
    named["whitening"] = whitening((depths - truth) / deviations).astype(np.float32)
    np.savez_compressed(arguments.output, **named)
    error, size = depths - truth, np.sqrt((truth**2).mean())
    print(f"other people: error {np.sqrt((error**2).mean()):.3f}, median {np.median(np.abs(error)):.3f} of {size:.3f}; "
          f"wrong sign {((depths * truth).sum(1) < 0).mean():.3f}")  # fmt: skip


if __name__ == "__main__":
    main()
