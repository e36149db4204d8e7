"""A skeleton by name or from any file that is understood."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from lassokin_ros.core.errors import SkeletonError
from lassokin_ros.core.skeleton import Skeleton
from lassokin_ros.skeleton_readers.bvh import read_bvh
from lassokin_ros.skeleton_readers.smpl import read_smpl
from lassokin_ros.skeleton_readers.urdf import read_urdf

READERS: dict[str, Callable[[Path, float], Skeleton]] = {".npz": read_smpl, ".bvh": read_bvh, ".urdf": read_urdf}


def load_skeleton(name_or_path: str, height: float) -> Skeleton:
    """A built-in skeleton by name, or one from a YAML, SMPL npz, BVH or URDF file, which the suffix tells.

    height: m, the person's. It scales a skeleton in fractions of the height, and the places of landmarks on any;
    a file in metres keeps its lengths. Raises SkeletonError.
    """
    path = Path(name_or_path)
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        return Skeleton.load(name_or_path, height)
    if not path.is_file():
        raise SkeletonError(f"there is no skeleton file '{name_or_path}'")
    return reader(path, height)
