"""The skeleton: a tree of ball joints at rest.

The built-in tree has SMPL's joint numbers and parents (24 joints, gamma in the paper). Others are read from a YAML file
of the same form.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property
from importlib import resources
from pathlib import Path
from typing import Any, Mapping, Sequence

import numpy as np

from lassokin_ros.core.errors import SkeletonError
from lassokin_ros.core.yaml_files import check_keys, finite_numbers, load_mapping, read_text, shipped_mapping, user_path

AXIS_ORDERS = ("xyz", "xzy", "yxz", "yzx", "zxy", "zyx")
HEIGHT_RANGE = (0.3, 2.6)  # m: an infant to the tallest person measured
MOST_JOINTS = 300
"""Memory grows with its square. A body with both hands has 55."""
FARTHEST = 10.0
"""Largest coordinate of a joint at rest, in m or in heights."""


@dataclass(frozen=True, eq=False)
class Skeleton:
    """A tree of ball joints at rest.

    joint_names: n names; joint 0 is the root (SMPL: the pelvis). parents: (n,) index of each joint's parent, -1 for the
    root; a parent comes before its children. offsets: (n, 3) m, from the parent's centre to the joint's, in the body
    frame at rest (x left, y up, z front); zero for the root. axes: n orders such as "xzy": the three revolute joints
    that represent each ball joint in URDF and JointState. height: m, of the person. metric: whether the offsets were
    given in metres, so that another height does not change them. locked: degrees of freedom 3 joint + axis (0 to 2)
    that do not move: this component of the joint's rotation vector is 0. A hinge has two.
    """

    name: str
    joint_names: tuple[str, ...]
    parents: np.ndarray
    offsets: np.ndarray
    axes: tuple[str, ...]
    height: float
    metric: bool = False
    locked: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        for field in ("parents", "offsets"):
            array = np.array(getattr(self, field))
            array.flags.writeable = False
            object.__setattr__(self, field, array)

    @property
    def joint_count(self) -> int:
        """Number of ball joints, gamma in the paper."""
        return len(self.joint_names)

    @cached_property
    def ancestors(self) -> np.ndarray:
        """(n, n) bool: [i, j] is true where joint j is an ancestor of joint i, or i itself."""
        matrix = np.eye(self.joint_count, dtype=bool)
        for joint in range(1, self.joint_count):
            matrix[joint] |= matrix[self.parents[joint]]
        return matrix

    @cached_property
    def rest_positions(self) -> np.ndarray:
        """(n, 3) m: joint centres at rest, root at the origin, body frame."""
        return self.ancestors @ self.offsets

    def index(self, joint: str) -> int:
        """Index of a joint by name. Raises SkeletonError with the existing names if there is none."""
        try:
            return self.joint_names.index(joint)
        except ValueError:
            raise SkeletonError(
                f"joint '{joint}' is not in skeleton '{self.name}'; its joints are: {', '.join(self.joint_names)}"
            ) from None

    def with_offsets(self, offsets: np.ndarray) -> Skeleton:
        """The same tree with other rest offsets (n, 3) in m."""
        return replace(self, offsets=np.array(offsets, dtype=float))

    def scaled(self, ratio: float) -> Skeleton:
        """The same body, taller by a factor."""
        return replace(self, offsets=self.offsets * ratio, height=self.height * ratio)

    def at_height(self, height: float) -> Skeleton:
        """The same skeleton for a person of another height, m; lengths in metres stay. Raises SkeletonError like
        `load`.
        """
        _check_height(height)
        if self.metric:
            return replace(self, height=float(height))
        return self if height == self.height else replace(self.scaled(height / self.height), height=float(height))

    def with_bone_scales(self, scales: np.ndarray) -> Skeleton:
        """The same tree with the bone that ends in each joint scaled by (n,) factors."""
        return self.with_offsets(self.offsets * np.asarray(scales, dtype=float)[:, None])

    @classmethod
    def load(cls, name_or_path: str, height: float) -> Skeleton:
        """Read a built-in skeleton by name, or a YAML file, for a person of `height` m.

        Raises SkeletonError if the name or file does not exist, the tree is not valid, or the height is out of range.
        """
        _check_height(height)
        source, data = _read(name_or_path)
        return cls.from_mapping(data, height, source)

    @classmethod
    def from_mapping(cls, data: Mapping[str, Any], height: float, source: str = "skeleton") -> Skeleton:
        """Build from the parsed YAML form (see skeletons/anthropometric.yaml). Raises SkeletonError."""
        joints = data.get("joints")
        if not isinstance(joints, Sequence) or isinstance(joints, str) or not joints:
            raise SkeletonError(f"{source}: 'joints' must be a list of joints with name, parent and position")
        check_keys(data, ("name", "height_unit", "joints"), source, SkeletonError)
        if len(joints) > MOST_JOINTS:
            raise SkeletonError(f"{source}: {len(joints)} joints; expected at most {MOST_JOINTS}")
        unit = data.get("height_unit", "fraction")
        if unit not in ("fraction", "metre"):
            raise SkeletonError(f"{source}: height_unit is {unit!r}; expected 'fraction' (of the height) or 'metre'")
        names, parents, positions, axes, locked = _parse_joints(joints, source)
        scale = height if unit == "fraction" else 1.0
        offsets = positions - np.where(parents[:, None] >= 0, positions[np.maximum(parents, 0)], positions[0])
        name = str(data.get("name", source))
        return cls(name, names, parents, offsets * scale, axes, float(height), unit == "metre", locked)


def _check_height(height: float) -> None:
    if not (np.isfinite(height) and HEIGHT_RANGE[0] <= height <= HEIGHT_RANGE[1]):
        raise SkeletonError(f"height is {height}; expected {HEIGHT_RANGE[0]} to {HEIGHT_RANGE[1]} m")


def has_built_in_proportions(skeleton: Skeleton) -> bool:
    """Whether a skeleton has the built-in proportions at its height; it may have further joints."""
    built_in = _built_in()
    if not set(built_in.joint_names) <= set(skeleton.joint_names):
        return False
    own = skeleton.rest_positions[[skeleton.index(name) for name in built_in.joint_names]]
    return bool(np.allclose(own, skeleton.height * built_in.rest_positions, atol=1e-6))


@cache
def _built_in() -> Skeleton:
    """The built-in body in units of its height; it is read once."""
    return Skeleton.load("anthropometric", 1.0)


def built_in_skeletons() -> list[str]:
    """Names of the built-in skeletons, for `Skeleton.load`."""
    folder = resources.files("lassokin_ros.core.body") / "skeletons"
    return sorted(Path(entry.name).stem for entry in folder.iterdir() if entry.name.endswith(".yaml"))


def _read(name_or_path: str) -> tuple[str, dict[str, Any]]:
    """(name for messages, parsed YAML) of a built-in skeleton or a file. Raises SkeletonError if neither exists."""
    if name_or_path in built_in_skeletons():
        data = shipped_mapping("lassokin_ros.core.body", f"skeletons/{name_or_path}.yaml")
        return f"skeleton '{name_or_path}'", data
    path = user_path(name_or_path)
    if path.suffix.lower() in (".npz", ".bvh", ".urdf", ".pkl", ".xacro", ".fbx"):
        raise SkeletonError(
            f"{path}: the core reads skeletons from YAML only; read this one with "
            "lassokin_ros.skeleton_readers.load.load_skeleton, and give it to Tracker as `skeleton`"
        )
    if not path.is_file():
        raise SkeletonError(
            f"skeleton '{name_or_path}' is neither built in ({', '.join(built_in_skeletons())}) nor a file; expected a "
            ".yaml, .npz, .bvh or .urdf file"
        )
    return str(path), load_mapping(read_text(path, SkeletonError), str(path), SkeletonError)


def _parse_joints(
    joints: Sequence[Any], source: str
) -> tuple[tuple[str, ...], np.ndarray, np.ndarray, tuple[str, ...], tuple[int, ...]]:
    names: list[str] = []
    parents: list[int] = []
    positions: list[list[float]] = []
    axes: list[str] = []
    locked: list[int] = []
    for entry in joints:
        where = f"{source}: joint {len(names)}"
        if not isinstance(entry, Mapping) or not isinstance(entry.get("name"), str):
            raise SkeletonError(f"{where} is {entry!r}; expected a mapping with name, parent and position")
        name, parent = entry["name"], entry.get("parent")
        where = f"{source}: joint '{name}'"
        check_keys(entry, ("name", "parent", "position", "axes", "free"), where, SkeletonError)
        if name in names:
            raise SkeletonError(f"{where} is listed twice; names must be unique")
        if (parent is None) != (not names):
            raise SkeletonError(f"{where} has parent {parent!r}; the first joint, and no other, is the root (null)")
        if parent is not None and parent not in names:
            raise SkeletonError(f"{where} has parent '{parent}', which is not listed before it: {', '.join(names)}")
        order = entry.get("axes", "xzy")
        if order not in AXIS_ORDERS:
            raise SkeletonError(f"{where} has axes {order!r}; expected one of {', '.join(AXIS_ORDERS)} in quotes")
        free = entry.get("free", "xyz")
        if not isinstance(free, str) or set(free) - set("xyz"):
            raise SkeletonError(
                f'{where} has free {free!r}; expected the axes about which it turns, such as "z" or "yz"'
            )
        locked += [3 * len(names) + axis for axis, letter in enumerate("xyz") if letter not in free]
        positions.append(_position(entry.get("position"), where))
        parents.append(-1 if parent is None else names.index(parent))
        names.append(name)
        axes.append(order)
    return tuple(names), np.array(parents), np.array(positions), tuple(axes), tuple(locked)


def _position(value: Any, where: str) -> list[float]:
    numbers = finite_numbers(value, 3)
    if numbers is None or max(map(abs, numbers)) > FARTHEST:
        raise SkeletonError(
            f"{where} has position {value!r}; expected three finite numbers, [x, y, z], of at most {FARTHEST:g}"
        )
    return numbers
