"""Read a skeleton from an SMPL model file of the user. This package contains nothing of the model.

The joints are J = J_regressor (v_template + shapedirs betas), equations (8)-(10) of the SMPL paper at rest.
"""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np

from lassokin_ros.core.body.skeleton import HEIGHT_RANGE, Skeleton
from lassokin_ros.core.errors import SkeletonError
from lassokin_ros.skeleton_readers.rest_pose import OURS, RestTree, to_skeleton

LARGEST_BYTES = 2**28
"""bytes of one array. The largest array read from SMPL, 6890 vertices by 300 shapes, has 50 MB."""
LARGEST_VALUE = 1e9
"""Largest absolute value in an array, in its own unit. It keeps products of three arrays finite."""
MOST_VERTICES = 100_000
ADVICE = "see docs/files.md for how to make the file from SMPL's own"


def read(path: Path, height: float) -> Skeleton:
    """Return the skeleton of an npz with J_regressor (24, V), v_template (V, 3) m, optional shapedirs and betas.

    shapedirs: (V, 3, b); betas: (k,), k <= b, the shape of the person, default 0. Lengths are those of the model, in
    metres; `height` does not change them. Raises SkeletonError.
    """
    source = str(path)
    arrays = _read(path, ("J_regressor", "v_template", "shapedirs", "betas"))
    for name in ("J_regressor", "v_template"):
        if name not in arrays:
            raise SkeletonError(f"{source} has no array '{name}'; {ADVICE}")
    regressor, vertices = arrays["J_regressor"], arrays["v_template"]
    ours = Skeleton.load(OURS, 1.0)
    count = len(vertices) if vertices.ndim == 2 else 0
    if vertices.shape != (count, 3) or not 0 < count <= MOST_VERTICES:
        raise SkeletonError(f"{source}: v_template has the shape {vertices.shape}; expected (V, 3)")
    if regressor.shape != (ours.joint_count, count):
        raise SkeletonError(
            f"{source}: J_regressor has the shape {regressor.shape}; expected ({ours.joint_count}, {count}), SMPL's 24 "
            "joints; SMPL-H and SMPL-X have others, of which the first 22 are the same"
        )
    vertices = vertices + _shape(arrays, count, source)
    positions = regressor @ vertices
    _check_posture(positions, vertices, ours, source)
    return to_skeleton(RestTree(ours.joint_names, tuple(ours.parents.tolist()), positions, ours.axes), height, source,
                       path.stem)  # fmt: skip


def _read(path: Path, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Return the arrays present in the file, as float64. Raises SkeletonError. Nothing is unpickled."""
    arrays: dict[str, np.ndarray] = {}
    try:
        with zipfile.ZipFile(path) as archive:
            sizes = {info.filename: info.file_size for info in archive.infolist()}
        with np.load(path, allow_pickle=False) as file:
            for name in names:
                if name not in file:
                    continue
                if sizes.get(f"{name}.npy", sizes.get(name, 0)) > LARGEST_BYTES:
                    raise SkeletonError(f"{path}: array '{name}' has more than {LARGEST_BYTES >> 20} MB")
                arrays[name] = _numbers(file, name, path)
    except SkeletonError:
        raise
    except Exception as problem:  # numpy and zipfile raise many kinds of errors for broken files
        raise SkeletonError(f"{path} cannot be read as an npz: {problem or type(problem).__name__}") from None
    return arrays


def _numbers(file: np.lib.npyio.NpzFile, name: str, path: Path) -> np.ndarray:
    try:
        array = file[name]
    except ValueError as problem:
        if "pickle" not in str(problem):
            raise
        raise SkeletonError(
            f"{path}: '{name}' is a pickled object (probably a sparse matrix). It is not read because it can run "
            f"code. Store it as a dense array: {ADVICE}"
        ) from None
    if not isinstance(array, np.ndarray):  # bytes: the member is not an array
        raise SkeletonError(f"{path}: '{name}' is no numpy array; {ADVICE}")
    if array.dtype.kind not in "fiu":
        raise SkeletonError(f"{path}: '{name}' holds {array.dtype}; expected numbers")
    with np.errstate(over="ignore"):
        array = array.astype(np.float64)
    if not (np.abs(array) < LARGEST_VALUE).all():  # NaN too
        raise SkeletonError(f"{path}: '{name}' has values that are not finite, or larger than {LARGEST_VALUE:g}")
    return array


def _shape(arrays: dict[str, np.ndarray], count: int, source: str) -> np.ndarray | float:
    """Return the displacement (V, 3) m of the template by the shape."""
    betas = arrays.get("betas")
    if betas is None or not betas.any():
        return 0.0
    betas = betas.reshape(-1)
    shapes = arrays.get("shapedirs")
    if shapes is None or shapes.ndim != 3 or shapes.shape[:2] != (count, 3) or shapes.shape[2] < len(betas):
        found = "no shapedirs" if shapes is None else f"shapedirs of the shape {shapes.shape}"
        raise SkeletonError(f"{source}: {len(betas)} betas, but {found}; expected ({count}, 3, {len(betas)} or more)")
    return shapes[:, :, : len(betas)] @ betas


def _check_posture(positions: np.ndarray, vertices: np.ndarray, ours: Skeleton, source: str) -> None:
    """Raise SkeletonError unless the body is upright along y and in metres."""
    stature = float(np.ptp(vertices[:, 1]))
    upright = positions[ours.index("head"), 1] > positions[0, 1] > positions[ours.index("left_ankle"), 1]
    if not upright or not HEIGHT_RANGE[0] <= stature <= HEIGHT_RANGE[1]:
        raise SkeletonError(
            f"{source}: a body {stature:.2f} m along y, head, pelvis and ankles {'' if upright else 'not '}above one "
            f"another; expected SMPL's template, in metres, y up, {HEIGHT_RANGE[0]} to {HEIGHT_RANGE[1]} m tall"
        )
