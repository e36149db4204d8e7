"""Load a skeleton by name or from a file of any supported format."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import LayoutError, SkeletonError
from lassokin_ros.core.yaml_files import user_path
from lassokin_ros.skeleton_readers.naming import names_file

READERS = {".npz": "smpl", ".bvh": "bvh", ".urdf": "urdf"}
"""Suffix -> module here with `read(path, height)`, imported on first use."""
_SMPL = "unpack it once to .npz where you trust it: numpy.savez('smpl.npz', J_regressor=..., v_template=...)"
_BVH = "open it in Blender and export it as .bvh"
OTHERS = {
    ".pkl": ("a Python pickle, such as SMPL's model, and can run code", _SMPL),
    ".pickle": ("a Python pickle and can run code", _SMPL),
    ".xacro": ("a xacro macro of a URDF", "expand it with: xacro model.xacro > model.urdf"),
    ".sdf": ("an SDF of Gazebo", "convert it to .urdf, or describe the skeleton in YAML"),
    ".mjcf": ("a model of MuJoCo", "convert it to .urdf, or describe the skeleton in YAML"),
    ".xml": ("XML of another kind", "rename it to .urdf if it is one, or describe the skeleton in YAML"),
    **dict.fromkeys((".fbx", ".glb", ".gltf", ".dae", ".blend", ".usd", ".usda", ".usdz"), ("a 3D scene", _BVH)),
    ".vrm": ("a VRM avatar, a form of glTF", _BVH),
    ".c3d": ("a recording of markers", "export the solved skeleton as .bvh"),
    ".asf": ("a skeleton of Acclaim", "convert it to .bvh"),
}
"""Suffix -> (what such a file is, how to convert it) of files that are not read."""


def load_skeleton(name_or_path: str, height: float) -> Skeleton:
    """Return a built-in skeleton by name, or one from a YAML, SMPL npz, BVH or URDF file, by the suffix.

    height: m, the person's. It scales a skeleton in fractions of the height, and the landmarks' positions of any
    skeleton; a file in metres keeps its lengths. Raises SkeletonError.
    """
    path = user_path(name_or_path)
    suffix = path.suffix.lower()
    if suffix in OTHERS:
        what, conversion = OTHERS[suffix]
        raise SkeletonError(f"skeleton '{name_or_path}' is {what}, which is not read; {conversion} (see docs/files.md)")
    module = READERS.get(suffix)
    if module is None:
        return Skeleton.load(name_or_path, height)
    if not path.is_file():
        raise SkeletonError(f"there is no skeleton file '{name_or_path}'")
    skeleton: Skeleton = import_module(f"{__package__}.{module}").read(path, height)
    return skeleton


@contextmanager
def naming_help(name_or_path: str) -> Iterator[None]:
    """Add to a LayoutError the advice to name the joints, for a skeleton file whose own names are kept."""
    try:
        yield
    except LayoutError as error:
        path = user_path(name_or_path)
        if path.suffix.lower() != ".bvh":
            raise
        raise LayoutError(
            f"{error}; none of the known programs has these names: give a layout for them, or write "
            f"'{names_file(path).name}' beside the file, in lines such as 'left_hip: NAME'"
        ) from None
