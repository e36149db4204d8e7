"""Landmark layouts: the body point of each index in a detector's output."""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Any, Mapping

import numpy as np

from lassokin_ros.core.body.roles import THICKNESS, without_side
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import LayoutError
from lassokin_ros.core.yaml_files import check_keys, finite_numbers, load_mapping, read_text, shipped_mapping, user_path

MOST_LANDMARKS = 1000
"""Memory grows with its square. A body with both hands and a face mesh has about 550."""


@dataclass(frozen=True, eq=False)
class Layout:
    """A detector's landmarks, tied to a skeleton.

    names: l landmark names; a keypoint's id is its index here. joints: (l,) index of the joint that each landmark is
    fixed to. offsets: (l, 3) m, q_i^0 of (1): position in that joint's frame (body axes at rest: x left, y up, z
    front). noise: (l,) factor on the detector's noise, above 1 for an unsteady landmark or one off its joint's centre.
    surface: (l,) m from the body's surface to the landmark, along the line of sight of a depth camera. By default it is
    the body's `THICKNESS` for a landmark at a joint's centre, and 0 for one with an offset (nose, ear, toe).
    """

    name: str
    names: tuple[str, ...]
    joints: np.ndarray
    offsets: np.ndarray
    noise: np.ndarray
    surface: np.ndarray

    @classmethod
    def load(cls, name_or_path: str, skeleton: Skeleton) -> Layout:
        """Read a built-in layout by name, or any from a YAML file, for a skeleton. Raises LayoutError."""
        if name_or_path in built_in_layouts():
            data = shipped_mapping("lassokin_ros.core.body", f"layouts/{name_or_path}.yaml")
            return cls.from_mapping(data, skeleton, f"layout '{name_or_path}'")
        if user_path(name_or_path).is_file():
            text = read_text(user_path(name_or_path), LayoutError)
            return cls.from_mapping(load_mapping(text, name_or_path, LayoutError), skeleton, name_or_path)
        raise LayoutError(
            f"landmark layout '{name_or_path}' is neither built in ({', '.join(built_in_layouts())}) nor a YAML file"
        )

    @classmethod
    def from_mapping(cls, data: Mapping[str, Any], skeleton: Skeleton, source: str = "layout") -> Layout:
        """Build from the parsed YAML form (see layouts/coco17.yaml). Raises LayoutError."""
        entries = data.get("landmarks")
        if not isinstance(entries, list) or not entries:
            raise LayoutError(f"{source}: 'landmarks' must be a list of landmarks with name, joint and offset")
        check_keys(data, ("name", "landmarks"), source, LayoutError)
        if len(entries) > MOST_LANDMARKS:
            raise LayoutError(f"{source}: {len(entries)} landmarks; expected at most {MOST_LANDMARKS}")
        names: list[str] = []
        joints, offsets, noise, surface = [], [], [], []
        for entry in entries:
            where = f"{source}: landmark {len(names)}"
            if not isinstance(entry, Mapping) or not isinstance(entry.get("name"), str):
                raise LayoutError(f"{where} is {entry!r}; expected a mapping with name, joint and offset")
            where = f"{source}: landmark '{entry['name']}'"
            check_keys(entry, ("name", "joint", "offset", "noise", "surface"), where, LayoutError)
            if entry["name"] in names:
                raise LayoutError(f"{where} is listed twice; names must be unique")
            if entry.get("joint") not in skeleton.joint_names:
                raise LayoutError(
                    f"{where} has joint '{entry.get('joint')}', which is not in skeleton '{skeleton.name}'; "
                    f"its joints are: {', '.join(skeleton.joint_names)}"
                )
            names.append(entry["name"])
            joints.append(skeleton.index(entry["joint"]))
            offsets.append(_numbers(entry.get("offset", [0, 0, 0]), 3, where, "offset"))
            noise.append(_numbers([entry.get("noise", 1.0)], 1, where, "noise")[0])
            if not 0.1 <= noise[-1] <= 100:
                raise LayoutError(f"{where} has noise {noise[-1]}; expected a factor from 0.1 to 100")
            inside = THICKNESS.get(without_side(entry["joint"]), 0.0) if not any(offsets[-1]) else 0.0
            surface.append(_numbers([entry.get("surface", inside)], 1, where, "surface")[0])
            if not 0 <= surface[-1] <= 0.2:
                raise LayoutError(f"{where} has surface {surface[-1]}; expected 0 to 0.2 of the height")
        arrays = np.array(joints), np.array(offsets), np.array(noise), np.array(surface)
        return cls(str(data.get("name", source)), tuple(names), *arrays).scaled(skeleton.height)

    def scaled(self, ratio: float) -> Layout:
        """The same landmarks on a body that is taller by a factor."""
        return replace(self, offsets=self.offsets * ratio, surface=self.surface * ratio)

    def index(self, landmark: str) -> int:
        """Index of a landmark by name; LayoutError with the names that exist if there is none."""
        if landmark not in self.names:
            raise LayoutError(f"landmark '{landmark}' is not in layout '{self.name}'; it has: {', '.join(self.names)}")
        return self.names.index(landmark)


def built_in_layouts() -> list[str]:
    """Names of the built-in layouts, for `Layout.load`."""
    folder = resources.files("lassokin_ros.core.body") / "layouts"
    return sorted(Path(entry.name).stem for entry in folder.iterdir() if entry.name.endswith(".yaml"))


def _numbers(value: Any, count: int, where: str, what: str) -> list[float]:
    numbers = finite_numbers(value, count)
    if numbers is None:
        raise LayoutError(f"{where} has {what} {value!r}; expected {count} finite number(s)")
    return numbers
