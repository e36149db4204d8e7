"""A skeleton by name or from any file that is understood."""

from __future__ import annotations

from importlib import import_module

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import SkeletonError
from lassokin_ros.core.yaml_files import user_path

READERS = {".npz": "smpl", ".bvh": "bvh", ".urdf": "urdf"}
"""Suffix -> module here with `read(path, height)`; imported when such a file turns up."""


CONVERT = {
    ".pkl": "a Python pickle, which can run code when it is read; unpack SMPL's model to .npz as docs/files.md shows",
    ".xacro": "a xacro macro file; expand it with: xacro FILE > skeleton.urdf",
    ".fbx": "an Autodesk FBX scene; import it in Blender and export Motion Capture (.bvh)",
    ".glb": "a glTF scene; import it in Blender and export Motion Capture (.bvh)",
    ".gltf": "a glTF scene; import it in Blender and export Motion Capture (.bvh)",
    ".dae": "a COLLADA scene; import it in Blender and export Motion Capture (.bvh)",
    ".blend": "a Blender file; export Motion Capture (.bvh) from it",
    ".c3d": "a recording of markers without a skeleton; export .bvh from the program that solved it",
    ".asf": "an Acclaim skeleton; convert it to .bvh",
    ".sdf": "an SDF model of Gazebo; give its URDF",
    ".xml": "XML of another kind, such as MuJoCo's MJCF; give a .urdf",
}
"""Suffix of files that are not read -> what they are and how to convert them."""


def load_skeleton(name_or_path: str, height: float) -> Skeleton:
    """A built-in skeleton by name, or one from a YAML, SMPL npz, BVH or URDF file, which the suffix tells.

    height: m, the person's. It scales a skeleton in fractions of the height, and the places of landmarks on any;
    a file in metres keeps its lengths. Raises SkeletonError.
    """
    path = user_path(name_or_path)
    if (other := CONVERT.get(path.suffix.lower())) is not None:
        what = other.replace("FILE", path.name)
        raise SkeletonError(f"'{name_or_path}' is {what}; expected .yaml, .npz, .bvh or .urdf")
    module = READERS.get(path.suffix.lower())
    if module is None:
        return Skeleton.load(name_or_path, height)
    if not path.is_file():
        raise SkeletonError(f"there is no skeleton file '{name_or_path}'")
    skeleton: Skeleton = import_module(f"{__package__}.{module}").read(path, height)
    return skeleton
