"""Landmark layouts: the body point of each index in a detector's output."""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Any, Mapping, Sequence

import numpy as np

from lassokin_ros.core.body.roles import THICKNESS, without_side
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import LayoutError
from lassokin_ros.core.yaml_files import check_keys, finite_numbers, load_mapping, read_text, shipped_mapping, user_path

BODY = "anthropometric"
"""Skeleton of the layouts that name none."""
SKIPPED = "skipped"
"""In place of a landmark that the detector has, and that is not used."""
MOST_LANDMARKS = 1000
"""Memory grows with its square. A body with both hands and a face mesh has about 550."""


@dataclass(frozen=True, eq=False)
class Layout:
    """A detector's landmarks, tied to a skeleton.

    names: l landmark names. ids: (l,) the detector's id of each; it is the index here unless the layout skips points.
    detector_count: number of the detector's points, with those that are skipped. joints: (l,) index of the joint that
    each landmark is fixed to. offsets: (l, 3) m, q_i^0 of (1): position in that joint's frame (body axes at rest: x
    left, y up, z front). noise: (l,) factor on the detector's noise, above 1 for an unsteady landmark or one off its
    joint's centre. surface: (l,) m from the body's surface to the landmark, along the line of sight of a depth camera.
    By default it is the body's `THICKNESS` for a landmark at a joint's centre, and 0 for one with an offset (nose, ear,
    toe).
    """

    name: str
    names: tuple[str, ...]
    joints: np.ndarray
    offsets: np.ndarray
    noise: np.ndarray
    surface: np.ndarray
    ids: np.ndarray
    detector_count: int

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
        check_keys(data, ("name", "skeleton", "landmarks"), source, LayoutError)
        entries = _flat(entries, source)
        if len(entries) > MOST_LANDMARKS:
            raise LayoutError(f"{source}: {len(entries)} landmarks; expected at most {MOST_LANDMARKS}")
        names: list[str] = []
        joints, offsets, noise, surface, ids = [], [], [], [], []
        for number, entry in enumerate(entries):
            if entry is SKIPPED:
                continue
            where = f"{source}: landmark {number}"
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
                    + (f"; set skeleton to '{data['skeleton']}'" if "skeleton" in data else "")
                )
            names.append(entry["name"])
            ids.append(number)
            joints.append(skeleton.index(entry["joint"]))
            offsets.append(_numbers(entry.get("offset", [0, 0, 0]), 3, where, "offset"))
            noise.append(_numbers([entry.get("noise", 1.0)], 1, where, "noise")[0])
            if not 0.1 <= noise[-1] <= 100:
                raise LayoutError(f"{where} has noise {noise[-1]}; expected a factor from 0.1 to 100")
            inside = THICKNESS.get(without_side(entry["joint"]), 0.0) if not any(offsets[-1]) else 0.0
            surface.append(_numbers([entry.get("surface", inside)], 1, where, "surface")[0])
            if not 0 <= surface[-1] <= 0.2:
                raise LayoutError(f"{where} has surface {surface[-1]}; expected 0 to 0.2 of the height")
        if not names:
            raise LayoutError(f"{source}: all landmarks are skipped; expected some with name, joint and offset")
        arrays = np.array(joints), np.array(offsets), np.array(noise), np.array(surface), np.array(ids)
        return cls(str(data.get("name", source)), tuple(names), *arrays, len(entries)).scaled(skeleton.height)

    def scaled(self, ratio: float) -> Layout:
        """The same landmarks on a body that is taller by a factor."""
        return replace(self, offsets=self.offsets * ratio, surface=self.surface * ratio)

    def index(self, landmark: str) -> int:
        """Index of a landmark by name; LayoutError with the names that exist if there is none."""
        if landmark not in self.names:
            raise LayoutError(f"landmark '{landmark}' is not in layout '{self.name}'; it has: {', '.join(self.names)}")
        return self.names.index(landmark)


def built_in_layouts(skeleton: str = "") -> list[str]:
    """Names of the built-in layouts, for `Layout.load`. skeleton: only those for this one, see `skeleton_of`."""
    folder = resources.files("lassokin_ros.core.body") / "layouts"
    names = sorted(Path(entry.name).stem for entry in folder.iterdir() if entry.name.endswith(".yaml"))
    return [name for name in names if not skeleton or skeleton_of(name) == skeleton]


def skeleton_of(layout: str) -> str:
    """Name of the built-in skeleton that has the joints of a built-in layout: `anthropometric`, or one with hands."""
    return str(shipped_mapping("lassokin_ros.core.body", f"layouts/{layout}.yaml").get("skeleton", BODY))


def _flat(entries: Sequence[Any], source: str) -> list[Any]:
    """Replace `{include: name}` by the landmarks of a built-in layout, and `{skip: [names]}` by SKIPPED for each."""
    flat: list[Any] = []
    for entry in entries:
        if isinstance(entry, Mapping) and set(entry) == {"include"}:
            if entry["include"] not in built_in_layouts():
                raise LayoutError(
                    f"{source}: include is {entry['include']!r}; expected a built-in layout: "
                    f"{', '.join(built_in_layouts())}"
                )
            data = shipped_mapping("lassokin_ros.core.body", f"layouts/{entry['include']}.yaml")
            flat += _flat(data["landmarks"], source)
        elif isinstance(entry, Mapping) and set(entry) == {"skip"}:
            if not isinstance(entry["skip"], list):
                raise LayoutError(f"{source}: skip is {entry['skip']!r}; expected a list of names")
            flat += [SKIPPED] * len(entry["skip"])
        else:
            flat.append(entry)
    return flat


def _numbers(value: Any, count: int, where: str, what: str) -> list[float]:
    numbers = finite_numbers(value, count)
    if numbers is None:
        raise LayoutError(f"{where} has {what} {value!r}; expected {count} finite number(s)")
    return numbers
