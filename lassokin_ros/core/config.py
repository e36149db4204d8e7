"""All settings of the tracker: default, description, unit and range.

The node declares its parameters from these fields. Tests compare config/*.yaml and docs/reference.md with them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Any, Mapping

from lassokin_ros.core.errors import ConfigurationError

TYPICAL_HEIGHT = 1.70
"""m: assumed height of a person whose height is to be measured."""
GIVEN, CHECK, LEARN = "given", "check", "learn"
SHORTEST = 0.3
"""m: least height."""
PI = round(math.pi, 4)
"""rad: pi rounded up, for readable ranges."""


def setting(
    default: Any,
    description: str,
    unit: str = "",
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] = (),
    live: bool = False,
) -> Any:
    """A dataclass field with description, unit, range or choices. live: the value may change while running."""
    metadata = {"description": description, "unit": unit, "low": low, "high": high, "choices": choices, "live": live}
    return field(default=default, metadata=metadata)


live_setting = partial(setting, live=True)


@dataclass(frozen=True)
class TrackerConfig:
    """Settings of the tracker; `checked` raises ConfigurationError for a value out of its range."""

    height: float = live_setting(
        0.0,
        "height of the person (0.3 or more), if it is known; 0 = measured by depth, several cameras or feet on a known "
        "floor, and without them assumed, with the deviation of people and children",
        "m",
        0.0,
        2.6,
    )
    skeleton: str = setting("anthropometric", "built-in skeleton, or path of a YAML, SMPL npz, BVH or URDF file")
    landmarks: str = setting("coco17", "landmark layout of the detector, or path of a YAML file")
    depth_prior: bool = setting(True, "use the joint depths that the shipped network estimates from the keypoints")
    extrinsics: str = setting(
        CHECK,
        "poses of several cameras: as given; checked against the person they see; or corrected by what is learned from "
        "the person",
        choices=(GIVEN, CHECK, LEARN),
    )
    solver: str = setting("proxqp", "QP solver for the lasso's dual: proxqp, or any solver of qpsolvers")
    camera_roll: float = live_setting(
        0.0, "roll of the camera's mount, as in a URDF's rpy: positive if its right side is down", "rad", -PI, PI
    )
    camera_pitch: float = live_setting(
        0.0, "pitch of the camera's mount, as in a URDF's rpy: positive if it looks down", "rad", -PI / 2, PI / 2
    )
    camera_height: float = live_setting(
        0.0,
        "height of the camera above a flat floor, for one on a tripod with known roll and pitch; feet are then on this "
        "floor, or not near it; 0 = unknown",
        "m",
        0.0,
        100.0,
    )
    tilt_deviation: float = live_setting(
        0.01,
        "1-sigma tilt error of the camera above a known floor; with height 0, feet that stand on it give the height if "
        "their error by the tilt is below 5 %; 0 = they do not",
        "rad",
        0.0,
        0.2,
    )
    noise_px: float = live_setting(3.0, "standard deviation of a confident keypoint in the image", "px", 0.1, 100.0)
    depth_noise: float = live_setting(
        0.03,
        "standard deviation of measured depth; a larger noise, such as that of distant stereo, is estimated",
        "m",
        0.005,
        1.0,
    )
    min_confidence: float = live_setting(0.2, "keypoints below this confidence count as missing", "", 0.0, 1.0)
    sparsity: float = live_setting(
        0.02, "weight of the l1 term; a larger value moves fewer joints per frame", "", 1e-4, 100.0
    )
    min_landmarks: int = live_setting(4, "smallest number of visible landmarks for a frame to be used", "", 2, 100)
    lost_after: float = live_setting(
        1.0, "time without a usable frame after which the tracker initialises again", "s", 0.05, 3600.0
    )
    smoothing: float = live_setting(
        0.02,
        "time constant of the output filter; it has no lag in steady motion, and smooths longer at rest",
        "s",
        0.0,
        1.0,
    )
    smoothing_lag: float = live_setting(
        0.0, "publish the pose this much later, smoothed with the later frames", "s", 0.0, 0.25
    )
    hold_feet: bool = live_setting(
        True,
        "hold feet that stand still where they are; the camera stands still too, or fixed_frame tells how it moves",
    )
    calibrate: bool = live_setting(True, "learn the bone lengths while tracking; robot_description is updated")

    def checked(self) -> TrackerConfig:
        """Return self if every value has the right type and range; raise ConfigurationError otherwise."""
        for item in fields(self):
            check_setting(item.name, getattr(self, item.name), item.metadata, type(item.default))
        if 0 < self.height < SHORTEST:
            raise ConfigurationError(f"height is {self.height}; expected 0 (measured) or {SHORTEST} to 2.6 m")
        return self

    def with_live_of(self, other: TrackerConfig) -> TrackerConfig:
        """Return this configuration with the live settings of another one. Raises ConfigurationError like `checked`."""
        live = {item.name: getattr(other, item.name) for item in fields(self) if item.metadata["live"]}
        return replace(self, **live).checked()

    @property
    def assumed_height(self) -> float:
        """m: `height`, or that of a typical person if it is to be measured."""
        return self.height or TYPICAL_HEIGHT

    @property
    def height_text(self) -> str:
        """`height` in words: its value in m, or that it is to be measured."""
        return f"{self.height:g} m" if self.height else "to be measured"


OFF = "off"


def without_bool(value: Any, metadata: Mapping[str, Any]) -> Any:
    """Return the choice that a bool stands for, and any other value as it is. In YAML an unquoted `off` is false.

    This concerns settings whose first choice is `off`; the second one stands for true.
    """
    choices = metadata["choices"]
    return choices[int(value)] if isinstance(value, bool) and OFF in choices[:1] else value


def check_setting(name: str, value: Any, metadata: Mapping[str, Any], kind: type) -> None:
    """Raise ConfigurationError if a value has the wrong type or is out of range."""
    right_kind = isinstance(value, (int, float)) if kind is float else isinstance(value, kind)
    if kind is tuple:  # of names; YAML and ROS give lists
        right_kind = isinstance(value, (list, tuple)) and all(isinstance(name, str) for name in value)
    if not right_kind or (isinstance(value, bool) and kind is not bool):
        expected = "a list of names" if kind is tuple else f"a value of type {kind.__name__}"
        raise ConfigurationError(f"{name} is {value!r}; expected {expected}")
    if metadata["choices"] and value not in metadata["choices"]:
        raise ConfigurationError(f"{name} is {value!r}; expected one of: {', '.join(metadata['choices'])}")
    low, high = metadata["low"], metadata["high"]
    if low is not None and not low <= value <= high:
        in_cm = (
            f" ({value:g} cm are {value / 100:g} m)" if metadata["unit"] == "m" and 50 <= value <= 100 * high else ""
        )
        expected = f"expected {low:g} to {high:g} {metadata['unit']}".rstrip()
        raise ConfigurationError(f"{name} is {value}; {expected}{in_cm}")
