"""Train the depth network, and write it with its provenance.

    python -m training.depth --data DIR --output lassokin_ros/core/network/depth_network.npz

DIR contains `mocap` and `corpus`, folders of motion capture (see training/motion.py). People of `--hold-out` are left
out (default: the people of the test and validation sets; an empty text leaves out nobody).
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import sys
import time
from collections import deque
from collections.abc import Iterator
from multiprocessing.pool import Pool
from pathlib import Path
from typing import Any

import numpy as np

from lassokin_ros.core.network.depth_network import Network, interpreted
from training.motion import TEST, VALIDATION, Motion, load_motion, sources, training_sources
from training.network import JITTER, Training, initial_weights, loss
from training.views import Batch, Views

LICENCES = (
    "The data used in this project was obtained from mocap.cs.cmu.edu. The database was created with funding from NSF "
    "EIA-0196217.",
    "ACCAD motion capture by The Ohio State University, CC BY 3.0.",
    "AnimatedDrawings example motion by Meta Platforms, MIT licence.",
    "UI-PRMD motion capture by the University of Idaho, public domain (PDDL 1.0).",
    "Ballet sample by Motek Entertainment, BSD 3-clause licence.",
)
WARM_UP = 200
"""Number of steps in which the learning rate rises."""
AHEAD = 32
"""Number of batches that a process draws in advance, or twice as many."""
LATER = 64
"""Number of batches after which one is used again."""
_views: Views | None = None


def _drawn(job: tuple[int, int, int]) -> Batch:
    """The batch with a number."""
    seed, number, size = job
    assert _views is not None
    return _views.batch(size, np.random.default_rng([seed, number]))


def batches(motion: Motion, seed: int, size: int, steps: int, processes: int) -> Iterator[Batch]:
    """Batches by seed and number, the same for any number of processes, which are started at once."""
    global _views
    _views = Views(motion)
    jobs = [(seed, number, size) for number in range(steps)]
    if processes == 0:
        return map(_drawn, jobs)
    return _from_pool(multiprocessing.get_context("fork").Pool(processes), jobs, AHEAD * processes)


def _from_pool(pool: Pool, jobs: list[tuple[int, int, int]], ahead: int) -> Iterator[Batch]:
    """Batches that processes draw, at most 2 `ahead` in advance."""
    with pool:
        parts = [jobs[first : first + ahead] for first in range(0, len(jobs), ahead)]
        drawn = [pool.imap(_drawn, part) for part in parts[:1]]
        for following in [*parts[1:], []]:
            drawn.append(pool.imap(_drawn, following))
            yield from drawn.pop(0)


def twice(drawn: Iterator[Batch]) -> Iterator[Batch]:
    """Each batch, and again `LATER` batches later. For a GPU, which learns faster than processes draw."""
    waiting: deque[Batch] = deque()
    for batch in drawn:
        yield batch
        waiting.append(batch)
        if len(waiting) > LATER:
            yield waiting.popleft()
    yield from waiting


def train(
    motion: Motion,
    steps: int,
    size: int,
    width: int,
    blocks: int,
    seed: int,
    processes: int,
    check: Motion | None = None,
    accelerated: bool = False,
) -> Network:
    """A network after the given number of steps. If `check` has motion, its loss on other people is printed."""
    if accelerated:
        drawn = twice(batches(motion, seed, size, -(-steps // 2), processes))
    else:
        drawn = batches(motion, seed, size, steps, processes)
    weights = initial_weights(width, blocks, np.random.default_rng([seed, 1]))
    training: Any = Training(weights)
    if accelerated:
        from training.accelerated import AcceleratedTraining

        training = AcceleratedTraining(weights)
    random = np.random.default_rng([seed, 2])
    begun, recent = time.perf_counter(), 0.0
    for number, batch in enumerate(drawn):
        share = min(1.0, (number + 1) / WARM_UP) * 0.5 * (1 + math.cos(math.pi * number / steps))
        places = batch.places.copy()
        places[..., 2] += JITTER * random.standard_normal(places.shape[:-1], dtype=np.float32)
        value = training.step(batch.inputs, places, share)
        recent += (value - recent) * max(0.01, 1 / (number + 1))
        if (number + 1) % 1000 == 0 or number + 1 == steps:
            passed = time.perf_counter() - begun
            report = "" if check is None else described(Network(training.averaged), check)
            print(f"{number + 1} steps, {passed:.0f} s, loss {float(recent):.2f} {report}", flush=True)
    return Network(training.averaged)


def described(network: Network, motion: Motion) -> str:
    """Figures on a motion: loss, mean error, and error of the depth alone, with and without augmentation."""
    parts = []
    for plain in (False, True):
        batch = Views(motion).batch(3000, np.random.default_rng([3, plain]), plain)
        outputs = network(batch.inputs)
        error = 1700 * (interpreted(outputs)[0] - batch.places)
        mean, depth = np.linalg.norm(error, axis=-1).mean(), np.abs(error[..., 2]).mean()
        name, value = "plain" if plain else "val", loss(outputs, batch.places)[0]
        parts.append(f"{name}: {value:.2f}, {mean:.1f} mm, depth {depth:.1f}")
    return "; ".join(parts)


def write(
    file: Path,
    network: Network,
    people: list[str],
    held_out: list[str],
    steps: int,
    seed: int,
    accelerated: bool = False,
) -> None:
    """Write weights as float16, with their provenance."""
    command = f"python -m training.depth --steps {steps}{' --accelerated' * accelerated}"
    arrays = {f"w{i}": w.astype(np.float16) for i, w in enumerate(network.weights)}
    np.savez_compressed(
        file, count=len(arrays), licences=np.array(LICENCES), people=np.array(people), held_out=np.array(held_out),
        steps=steps, seed=seed, numpy=np.__version__, command=command, **arrays,
    )  # fmt: skip


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder that holds mocap and corpus")
    parser.add_argument("--output", type=Path, required=True, help="npz file to write")
    parser.add_argument("--hold-out", default=",".join((*TEST, *VALIDATION)), help="people left out, comma-separated")
    parser.add_argument("--steps", type=int, default=18000)
    parser.add_argument("--batch", type=int, default=1024)
    parser.add_argument("--width", type=int, default=384)
    parser.add_argument("--blocks", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=1, help="processes that draw batches (1)")
    parser.add_argument("--accelerated", action="store_true", help="train with JAX (pip install jax), on a GPU if any")
    options = parser.parse_args()
    held_out = [person for person in options.hold_out.split(",") if person]
    chosen = training_sources(options.data, held_out)
    motion = load_motion(chosen)
    others = [s for s in sources(options.data) if s.person in VALIDATION and s.person in held_out]
    check = load_motion([s for s in others if not s.file.stem.startswith("131_03")]) if others else None
    people = sorted(set(motion.people))
    print(f"{len(chosen)} clips of {len(people)} people, {len(motion.points)} frames", flush=True)
    network = train(motion, options.steps, options.batch, options.width, options.blocks, options.seed,
                    options.processes, check, options.accelerated)  # fmt: skip
    write(options.output, network, people, held_out, options.steps, options.seed, options.accelerated)
    return 0


if __name__ == "__main__":
    sys.exit(main())
