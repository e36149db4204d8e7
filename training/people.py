"""How people's bodies differ from the built-in proportions: a proposal for the built-in body and the lengths' prior.

    python -m training.people --data DIR --output FILE     # writes the proposal (YAML)
    python -m training.people --data DIR --body FILE       # gives these lengths to a skeleton file, the built-in one
    python -m training.people --data DIR --prior FILE      # writes the prior of the lengths about that skeleton

DIR holds `mocap`, `corpus` and `detections`. Seven lengths are compared, as log-lengths about the published proportions
(`PUBLISHED`), at the size at which legs and trunk together are as long. They come from two sources:

- Recordings whose licence permits it: the detectors' own points, triangulated by several cameras. These are the points
  that the tracker sees. People are few, so they give the mean, and the captures help with the hips' width.
- Captures whose skeletons are the people's own (UI-PRMD, CMU). Their ankles, shoulders, elbows and wrists are other
  points of the body than a detector's, so they give how people differ from each other, about their collection's mean.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.data.body_lengths import LENGTHS, landmark_lengths, log_ratios, seven_lengths, skeleton_lengths
from benchmarks.data.detections import load_recording
from benchmarks.data.mocap import Clip, load_clip
from benchmarks.data.recordings import recorded_person, recording_files
from lassokin_ros.core.body.kinematics import Kinematics
from lassokin_ros.core.body.landmarks import Layout
from lassokin_ros.core.body.proportions import Proportions
from lassokin_ros.core.body.roles import LENGTHS as BODY_LENGTHS
from lassokin_ros.core.body.roles import without_side
from lassokin_ros.core.body.skeleton import Skeleton
from training.motion import LEFT_OUT_CLIPS, TEST, VALIDATION, sources

PUBLISHED = (0.245, 0.246, 0.292, 0.102, 0.224, 0.160, 0.153)
"""Fractions of the height: Winter 2009 after Drillis and Contini 1966, Bell 1989, de Leva 1996 (tables in
skeletons/anthropometric.yaml)."""
WHOLE = {"trunk": ("trunk", "shoulder height", "hip drop")}
"""Lengths of `Proportions` that together make a measured one; they have its logarithm."""
OTHERS = {"foot": 0.05, "hand": 0.05, "neck": 0.06, "head": 0.06}
"""Lengths that are not measured, and their standard deviations: the landmarks of face, feet and hands differ more by
detector than people do."""
SPLIT = 0.03
"""Standard deviation with which the parts of `WHOLE` differ from each other."""
SHRINKAGE, FLOOR = 0.3, 0.02
"""Share of the covariance's diagonal that is mixed in, and smallest standard deviation: the people are few."""
PERMITTED = ("man who balances", "woman who talks", "wildflower, person 0", "wildflower, person 2")
"""Recorded people with legs in view. Pose2Sim's demo (BSD-3), Wildflower Schools (MIT)."""
CAPTURED = {"up": "UI-PRMD", "cy": "CMU", "mx": "CMU", "mu": "CMU"}
"""Collections in which each person has the own bone lengths."""
ODD_BODIES = ("prmd_05", "12")
"""People whose captured hips are 306 mm apart, or whose shoulders 456 mm: solved from few markers."""


@dataclass(frozen=True, eq=False)
class Person:
    """A person's seven log-lengths (7,), and where they come from."""

    name: str
    source: str
    logs: np.ndarray


def about_published(lengths: np.ndarray) -> np.ndarray:
    """(7,) log-lengths of measured lengths (7,) m, at the size at which legs and trunk are as long as published."""
    return log_ratios(lengths, np.array(PUBLISHED))


def captured_lengths(clip: Clip) -> np.ndarray:
    """(7,) m of a clip's skeleton."""
    joints = "hip knee ankle shoulder elbow wrist".split()
    return seven_lengths(
        {f"{s}_{j}": clip.rest_position(f"{s[0]}_{j}")[None] for s in ("left", "right") for j in joints}
    )


def recorded_people(folder: Path) -> list[Person]:
    """`PERMITTED`, each the mean over the own recordings. People of recordings with unknown terms are not used."""
    found = defaultdict(list)
    for file in recording_files([folder]):
        name = recorded_person(file.stem)
        if name in PERMITTED:
            recording = load_recording(file, 0)
            layout = Layout.load(recording.layout, Skeleton.load("anthropometric", 1.75))
            found[name].append(about_published(landmark_lengths(recording.reference, layout)))
    return [Person(name, "recording", np.mean(logs, axis=0)) for name, logs in found.items()]


def captured_people(data: Path) -> list[Person]:
    """People of the captures, without those of test and validation."""
    found = defaultdict(list)
    for source in sources(data):
        name = source.person
        odd = name in (*TEST, *VALIDATION, *ODD_BODIES) or source.file.stem.startswith(LEFT_OUT_CLIPS)
        if source.collection in CAPTURED and not odd and (name, CAPTURED[source.collection]) not in found:
            logs = about_published(captured_lengths(load_clip(source.file)))
            found[name, CAPTURED[source.collection]].append(logs)
    return [Person(name, source, np.mean(logs, axis=0)) for (name, source), logs in found.items()]


def mean_person(recorded: Sequence[Person], captured: Sequence[Person]) -> np.ndarray:
    """(7,) mean log-lengths: of the recorded people; the hips' width half of it from the captured ones."""
    mean = np.mean([person.logs for person in recorded], axis=0)
    hips = LENGTHS.index("hip width")
    collections = [[p.logs[hips] for p in captured if p.source == source] for source in sorted(set(CAPTURED.values()))]
    mean[hips] = 0.5 * mean[hips] + 0.5 * float(np.mean([np.mean(widths) for widths in collections if widths]))
    return np.asarray(mean)


def people_covariance(people: Sequence[Person]) -> np.ndarray:
    """(7, 7) of people about the mean of their source, shrunk to the diagonal."""
    sources_of = {person.source for person in people}
    deviations = []
    for source in sources_of:
        logs = np.array([person.logs for person in people if person.source == source])
        deviations.append(logs - logs.mean(0))
    stacked = np.concatenate(deviations)
    covariance = stacked.T @ stacked / (len(stacked) - len(sources_of))
    variances = np.diag(covariance)
    return np.asarray((1 - SHRINKAGE) * covariance + np.diag(SHRINKAGE * variances + FLOOR**2))


def model_names() -> tuple[str, ...]:
    """Names of the lengths of lassokin_ros/core/body/proportions.py that the proposal has."""
    measured = [part for name in LENGTHS for part in WHOLE.get(name, (name,))]
    return (*measured, *OTHERS)


def for_the_model(mean: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean (p,) and covariance (p, p) of `model_names` from those of the seven lengths."""
    names = model_names()
    index = [LENGTHS.index(name) for name in LENGTHS for _ in WHOLE.get(name, (name,))]
    measured = len(index)
    result, spread = np.zeros(len(names)), np.diag([OTHERS.get(name, 0.0) ** 2 for name in names])
    result[:measured], spread[:measured, :measured] = mean[index], covariance[np.ix_(index, index)]
    parts = [names.index(part) for whole in WHOLE.values() for part in whole]
    spread[parts, parts] += SPLIT**2
    return result, spread


HEADER = """\
# A proposal: log-lengths of people about the published proportions (0 = Winter, Bell, de Leva) at the same size, and
# their covariance (lower triangle by rows). Written by training/people.py; do not edit.
"""
PROVENANCE = """\
# Recordings: {recorded}.
# Captures: {captured}.
# The data used in this project was obtained from mocap.cs.cmu.edu. The database was created with funding from NSF
# EIA-0196217. UI-PRMD is in the public domain (PDDL 1.0), Pose2Sim's demo is BSD-3, Wildflower Schools' recording MIT.
"""


def provenance(recorded: Sequence[Person], captured: Sequence[Person]) -> str:
    """Comment lines that name the sources."""
    people = {source: sorted(p.name for p in captured if p.source == source) for source in sorted({*CAPTURED.values()})}
    return PROVENANCE.format(
        recorded="; ".join(sorted(person.name for person in recorded)),
        captured="; ".join(f"{source} {' '.join(names)}" for source, names in people.items()),
    )


def write(file: Path, recorded: Sequence[Person], captured: Sequence[Person]) -> None:
    """Write the proposal."""
    mean, covariance = for_the_model(mean_person(recorded, captured), people_covariance([*recorded, *captured]))
    names = model_names()
    text = HEADER + provenance(recorded, captured)
    text += f"names: [{', '.join(names)}]\nmean: {row(mean)}\n"
    text += "covariance:\n" + "".join(f"  - {row(line[: i + 1], '.5f')}\n" for i, line in enumerate(covariance))
    file.write_text(text, encoding="utf-8")


def row(values: np.ndarray, form: str = ".3f") -> str:
    """A list in YAML."""
    return "[" + ", ".join(f"{value:{form}}" for value in values) + "]"


PRIOR_HEADER = """\
# Log-lengths of people (0 = the built-in proportions of the same height): mean, and covariance, lower triangle by rows.
# The names are those of lassokin_ros/core/body/proportions.py. Written by training/people.py; do not edit.
"""


def write_prior(file: Path, recorded: Sequence[Person], captured: Sequence[Person]) -> None:
    """Write the prior of the lengths about a built-in skeleton that has the proposed mean."""
    _, covariance = for_the_model(np.zeros(len(LENGTHS)), people_covariance([*recorded, *captured]))
    names = model_names()
    text = PRIOR_HEADER + provenance(recorded, captured)
    text += f"names: [{', '.join(names)}]\nmean: {row(np.zeros(len(names)))}\ncovariance:\n"
    text += "".join(f"  - {row(line[: i + 1], '.5f')}\n" for i, line in enumerate(covariance))
    file.write_text(text, encoding="utf-8")


def with_lengths(skeleton: Skeleton, mean: np.ndarray) -> Skeleton:
    """The skeleton with seven log-lengths (7,) about the published ones, and its distance from ankle to head."""
    proportions = Proportions(Kinematics(skeleton, Layout.load("smpl24", skeleton)))
    change = dict(zip(LENGTHS, mean - about_published(skeleton_lengths(skeleton))))
    parts = {part: change[name] for name in LENGTHS for part in WHOLE.get(name, (name,))}
    changed = proportions.skeleton(np.array([parts.get(name, 0.0) for name in proportions.names]))

    def tall(body: Skeleton) -> float:
        return float(body.rest_positions[body.index("head"), 1] - body.rest_positions[body.index("left_ankle"), 1])

    return changed.with_offsets(changed.offsets * tall(skeleton) / tall(changed))


def part_lengths(skeleton: Skeleton) -> dict[str, float]:
    """Length, m, of each part of `Proportions`, of one side if there are two; widths are of both."""
    proportions = Proportions(Kinematics(skeleton, Layout.load("smpl24", skeleton)))
    total = {name: np.linalg.norm(part, axis=1).sum() for name, part in zip(proportions.names, proportions.parts)}
    paired = {name for name, (joints, _) in BODY_LENGTHS.items() if without_side(joints[0]) != joints[0]}
    halved = {name for name in paired if not name.endswith("width")}
    return {name: float(length / (2 if name in halved else 1)) for name, length in total.items()}


def write_body(file: Path, mean: np.ndarray) -> None:
    """Change the positions in a skeleton file in fractions of the height; its comments stay."""
    skeleton = Skeleton.load(str(file), 1.0)
    place = with_lengths(skeleton, mean).rest_positions
    lines = []
    for line in file.read_text(encoding="utf-8").splitlines():
        joint = re.search(r"name: (\w+),.*position: ", line)
        if joint:
            position = ", ".join(f"{value:6.3f}" for value in place[skeleton.index(joint[1])])
            line = re.sub(r"position: \[[^]]*\]", f"position: [{position}]", line)
        lines.append(line)
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder that holds mocap, corpus and detections")
    action = parser.add_mutually_exclusive_group(required=True)
    action.add_argument("--output", type=Path, metavar="FILE", help="YAML file to write")
    action.add_argument("--body", type=Path, metavar="FILE", help="YAML file of a skeleton to change")
    action.add_argument("--prior", type=Path, metavar="FILE", help="YAML file of the lengths' prior to write")
    options = parser.parse_args(arguments)
    recorded, captured = recorded_people(options.data / "detections"), captured_people(options.data)
    if options.output:
        write(options.output, recorded, captured)
    elif options.prior:
        write_prior(options.prior, recorded, captured)
    else:
        write_body(options.body, mean_person(recorded, captured))
    file = options.output or options.prior or options.body
    print(f"{len(recorded)} recorded and {len(captured)} captured people -> {file}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
