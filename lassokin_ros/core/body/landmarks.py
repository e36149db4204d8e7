"""Landmark layouts: which body point each index of a detector's output is."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, Mapping

import numpy as np

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import LayoutError
from lassokin_ros.core.yaml_files import check_keys, finite_numbers, load_mapping, read_text, user_path

MOST_LANDMARKS = 1000
"""What is made of them grows with their number's square; a body with both hands and a face mesh has about 550."""


@dataclass(frozen=True, eq=False)
class Layout:
    """A detector's landmarks, tied to a skeleton.

    Attributes
    ----------
    name: of the layout.
    names: l landmark names; a keypoint's id is its index here.
    joints: (l,) index of the joint on which each landmark rides.
    offsets: (l, 3) m, q_i^0 of (1): constant place in that joint's frame (body axes at rest: x left, y up, z front).
    noise: (l,) factor on the detector's noise: above 1 where its adaptive_mean is off the joint's centre (hips) or unsteady.
    """

    name: str
    names: tuple[str, ...]
    joints: np.ndarray
    offsets: np.ndarray
    noise: np.ndarray

    @classmethod
    def load(cls, name_or_path: str, skeleton: Skeleton) -> Layout:
        """Read a built-in layout by name, or any from a YAML file, for a skeleton. Raises LayoutError."""
        if name_or_path in built_in_layouts():
            file = resources.files("lassokin_ros.core.body") / "layouts" / f"{name_or_path}.yaml"
            source, text = f"layout '{name_or_path}'", file.read_text(encoding="utf-8")
        elif user_path(name_or_path).is_file():
            source, text = name_or_path, read_text(user_path(name_or_path), LayoutError)
        else:
            raise LayoutError(
                f"landmark layout '{name_or_path}' is neither built in ({', '.join(built_in_layouts())}) "
                "nor a YAML file"
            )
        return cls.from_mapping(load_mapping(text, source, LayoutError), skeleton, source)

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
        joints, offsets, noise = [], [], []
        for entry in entries:
            where = f"{source}: landmark {len(names)}"
            if not isinstance(entry, Mapping) or not isinstance(entry.get("name"), str):
                raise LayoutError(f"{where} is {entry!r}; expected a mapping with name, joint and offset")
            where = f"{source}: landmark '{entry['name']}'"
            check_keys(entry, ("name", "joint", "offset", "noise"), where, LayoutError)
            if entry["name"] in names:
                raise LayoutError(f"{where} stands twice; names must be unique")
            if entry.get("joint") not in skeleton.joint_names:
                raise LayoutError(
                    f"{where} rides on joint '{entry.get('joint')}', which is not in skeleton '{skeleton.name}'; "
                    f"its joints are: {', '.join(skeleton.joint_names)}"
                )
            names.append(entry["name"])
            joints.append(skeleton.index(entry["joint"]))
            offsets.append(_numbers(entry.get("offset", [0, 0, 0]), 3, where, "offset"))
            noise.append(_numbers([entry.get("noise", 1.0)], 1, where, "noise")[0])
            if not 0.1 <= noise[-1] <= 100:
                raise LayoutError(f"{where} has noise {noise[-1]}; expected a factor from 0.1 to 100")
        scale = skeleton.height
        return cls(
            str(data.get("name", source)), tuple(names), np.array(joints), np.array(offsets) * scale, np.array(noise)
        )

    def index(self, landmark: str) -> int:
        """Index of a landmark by name; LayoutError with the names that exist if there is none."""
        if landmark not in self.names:
            raise LayoutError(f"landmark '{landmark}' is not in layout '{self.name}'; it has: {', '.join(self.names)}")
        return self.names.index(landmark)


def built_in_layouts() -> list[str]:
    """Names that `Layout.load` knows without a file."""
    folder = resources.files("lassokin_ros.core.body") / "layouts"
    return sorted(Path(entry.name).stem for entry in folder.iterdir() if entry.name.endswith(".yaml"))


def _numbers(value: Any, count: int, where: str, what: str) -> list[float]:
    numbers = finite_numbers(value, count)
    if numbers is None:
        raise LayoutError(f"{where} has {what} {value!r}; expected {count} finite number(s)")
    return numbers
