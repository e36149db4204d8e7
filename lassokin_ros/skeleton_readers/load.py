"""A skeleton by name or from any file that is understood."""

from __future__ import annotations

from importlib import import_module

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import SkeletonError
from lassokin_ros.core.yaml_files import user_path

READERS = {".npz": "smpl", ".bvh": "bvh", ".urdf": "urdf"}
"""Suffix -> module here with `read(path, height)`; imported when such a file turns up."""


def load_skeleton(name_or_path: str, height: float) -> Skeleton:
    """A built-in skeleton by name, or one from a YAML, SMPL npz, BVH or URDF file, which the suffix tells.

    height: m, the person's. It scales a skeleton in fractions of the height, and the places of landmarks on any;
    a file in metres keeps its lengths. Raises SkeletonError.
    """
    path = user_path(name_or_path)
    module = READERS.get(path.suffix.lower())
    if module is None:
        return Skeleton.load(name_or_path, height)
    if not path.is_file():
        raise SkeletonError(f"there is no skeleton file '{name_or_path}'")
    skeleton: Skeleton = import_module(f"{__package__}.{module}").read(path, height)
    return skeleton
