"""A robot's file: which links are at the places of a person's joints. docs/humanoids.md has its table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

from lassokin_ros.core.errors import LassokinError
from lassokin_ros.core.yaml_files import check_keys, finite_numbers, load_mapping, read_text, user_path

SIDES = ("left", "right")
CHAINS = {"arm": ("shoulder", "elbow", "wrist"), "leg": ("hip", "knee", "ankle")}
"""Joints of a limb, from the trunk outwards."""
PLACES = ("base", "torso", *(f"{side}_{joint}" for chain in CHAINS.values() for side in SIDES for joint in chain))
"""The 14 places: pelvis and chest, whose axes are used, and joints, whose positions are used."""


class Bone(NamedTuple):
    """A bone of a limb, by places: its ends, where the limb begins, and in whose axes it is."""

    far: str
    near: str
    first: str
    owner: str


BONES = tuple(
    Bone(f"{side}_{names[at + 1]}", f"{side}_{names[at]}", f"{side}_{names[0]}", owner)
    for (names, owner) in zip(CHAINS.values(), ("torso", "base"))
    for side in SIDES
    for at in range(2)
)
"""The four bones of the arms, and those of the legs; two in a row are a limb."""
ARM_BONES = len(BONES) // 2
SETTINGS = {"sole": 0.0, "speed": 6.0, "acceleration": 100.0}
"""m, rad/s, rad/s^2: the numbers of a robot's file, and what they are without it."""
NUMBERS = ("rest", "radii")
"""Keys of a robot's file with a number for each of several names."""
PARTS = ("trunk", "forearm", "thigh", "shin")
"""Capsules that are kept apart."""
SHIPPED = ("g1", "h1", "h1_2", "talos")


class RobotError(LassokinError, ValueError):
    """A robot's file or its URDF cannot be used."""


@dataclass(frozen=True)
class RobotFile:
    """A robot's file.

    links: the link at each of PLACES. offsets: m, (3,) in the axes of the link, of places that are not at its origin.
    lock: joints that do not move; joints that move none of the places never do. rest: rad (m) of joints; 0 for others.
    limits: rad (m), lowest and highest position of joints, in place of the URDF's. sole: m, height of the ankles above
    the floor. speed, acceleration: rad/s and rad/s^2, largest ones of all joints; the URDF's speeds hold too. radii: m,
    of the capsules of PARTS that are kept apart.
    """

    name: str
    links: Mapping[str, str]
    offsets: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    lock: tuple[str, ...] = ()
    rest: Mapping[str, float] = field(default_factory=dict)
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    sole: float = SETTINGS["sole"]
    speed: float = SETTINGS["speed"]
    acceleration: float = SETTINGS["acceleration"]
    radii: Mapping[str, float] = field(default_factory=dict)


def load_robot(name: str) -> RobotFile:
    """Return a robot's file. name: one of SHIPPED, or a path. Raises RobotError."""
    if name in SHIPPED:
        text, source = (resources.files(__package__) / "robots" / f"{name}.yaml").read_text(encoding="utf-8"), name
    else:
        path = user_path(name)
        if not path.is_file():
            raise RobotError(
                f"there is no robot file '{name}'; expected {', '.join(SHIPPED)}, or the path of a YAML file"
            )
        text, source = read_text(path, RobotError), str(path)
    return parse_robot(text, source)


def parse_robot(text: str, source: str) -> RobotFile:
    """Return the robot of a file's text. source: its name, for errors. Raises RobotError."""
    data = load_mapping(text, source, RobotError)
    check_keys(data, (*PLACES, "lock", "rest", "limits", "radii", *SETTINGS), source, RobotError)
    lacking = [place for place in PLACES if place not in data]
    if lacking:
        raise RobotError(f"{source} has no {', '.join(lacking)}; expected the name of a link for each of 14 places")
    links, offsets = {}, {}
    for place in PLACES:
        links[place], offset = _link(data[place], f"{source}: {place}")
        if offset is not None:
            offsets[place] = offset
    lock = data.get("lock") or []
    if not isinstance(lock, list) or not all(isinstance(joint, str) for joint in lock):
        raise RobotError(f"{source}: lock is {lock!r}; expected a list of names of joints")
    rest, radii = ({name: _number(value, where) for name, value, where in _of(data, key, source)} for key in NUMBERS)
    limits = {name: _range(value, where) for name, value, where in _of(data, "limits", source)}
    check_keys(radii, PARTS, f"{source}: radii", RobotError)
    settings = {name: _number(data.get(name, value), f"{source}: {name}") for name, value in SETTINGS.items()}
    for name in ("speed", "acceleration"):
        if settings[name] <= 0:
            raise RobotError(f"{source}: {name} is {settings[name]:g}; expected more than 0")
    return RobotFile(Path(source).stem, links, offsets, tuple(lock), rest, limits, radii=radii, **settings)


def _link(value: Any, where: str) -> tuple[str, tuple[float, ...] | None]:
    if isinstance(value, str):
        return value, None
    if isinstance(value, dict) and set(value) == {"link", "offset"} and isinstance(value["link"], str):
        return value["link"], tuple(_numbers(value["offset"], 3, f"{where}: offset"))
    raise RobotError(f"{where} is {value!r}; expected the name of a link, or {{link: NAME, offset: [x, y, z]}}")


def _of(data: Mapping[str, Any], key: str, source: str) -> list[tuple[str, Any, str]]:
    """Return name, value and place, for errors, of each entry of a mapping."""
    value = data.get(key) or {}
    if not isinstance(value, dict) or not all(isinstance(name, str) for name in value):
        raise RobotError(f"{source}: {key} is {value!r}; expected names of joints, each with its value")
    return [(name, each, f"{source}: {key} of {name}") for name, each in value.items()]


def _number(value: Any, where: str) -> float:
    if (numbers := finite_numbers([value], 1)) is None:
        raise RobotError(f"{where} is {value!r}; expected a finite number")
    return numbers[0]


def _numbers(value: Any, count: int, where: str) -> list[float]:
    if (numbers := finite_numbers(value, count)) is None:
        raise RobotError(f"{where} is {value!r}; expected {count} finite numbers")
    return numbers


def _range(value: Any, where: str) -> tuple[float, float]:
    low, high = _numbers(value, 2, where)
    if low >= high:
        raise RobotError(f"{where} are {low:g} and {high:g}; expected a lower and a higher one; lock joints that stay")
    return low, high
