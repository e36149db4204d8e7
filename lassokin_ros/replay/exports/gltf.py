"""Export glTF 2.0 as one file (.glb): a skinned body of capsules and its motion, for Blender, browsers and Windows.

Units and axes are those of BVH. Times count from the begin of the recording. The joints are nodes, at rest in a T-pose.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from typing import Any, BinaryIO

import numpy as np
from scipy.spatial.transform import Rotation

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.image.gating import HEAD
from lassokin_ros.replay.body import capsules
from lassokin_ros.replay.exports.sampling import uniform
from lassokin_ros.replay.motion import Motion

AROUND, LATITUDES = 12, np.radians([-90.0, -60.0, -30.0, 0.0, 0.0, 30.0, 60.0, 90.0])
"""Points around a capsule, and its rings from one pole to the other; the first half is about its first end."""
COLOURS = {"left": (0.0, 0.168, 0.445, 1.0), "right": (0.665, 0.112, 0.0, 1.0), "middle": (0.33, 0.33, 0.33, 1.0)}
TYPES, NUMBERS = {1: "SCALAR", 3: "VEC3", 4: "VEC4", 16: "MAT4"}, {"<f4": 5126, "<u2": 5123, "u1": 5121}


def write_gltf(motion: Motion, file: BinaryIO) -> None:
    """Write one person. Raises ExportError for stamps that cannot be resampled (see sampling)."""
    track, skeleton, data = uniform(motion), motion.skeleton, bytearray()
    count, views, accessors = skeleton.joint_count, list[dict[str, Any]](), list[dict[str, Any]]()

    def add(values: np.ndarray, dtype: str = "<f4") -> int:
        """Append values (k, c) to the binary part and return the number of their accessor."""
        array = np.ascontiguousarray(values, dtype=dtype)
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": array.nbytes})
        data.extend(array.tobytes() + bytes(-array.nbytes % 4))
        kind = {"componentType": NUMBERS[dtype], "count": len(array), "type": TYPES[array.shape[1]]}
        limits = {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        accessors.append({"bufferView": len(views) - 1, **kind, **limits})
        return len(accessors) - 1

    turns, places = track.rotations, track.translations
    times = add(motion.start + track.period * np.arange(len(places))[:, None])
    moved = [add(places), *(add(_quaternions(turns[:, joint])) for joint in range(count))]
    paths = [{"node": 0, "path": "translation"}, *({"node": joint, "path": "rotation"} for joint in range(count))]
    inverse = np.tile(np.eye(4), (count, 1, 1))
    inverse[:, 3, :3] = -skeleton.rest_positions  # columns of a matrix follow each other, so this is its last one
    samplers = [{"input": times, "output": output} for output in moved]
    channels = [{"sampler": number, "target": path} for number, path in enumerate(paths)]
    document = {
        "asset": {"version": "2.0", "generator": "lassokin_ros"},
        "scene": 0,
        "scenes": [{"nodes": [0, count]}],
        "nodes": [*_joints(skeleton), {"name": "body", "mesh": 0, "skin": 0}],
        "meshes": [{"primitives": [mesh for n, side in enumerate(COLOURS) if (mesh := _mesh(skeleton, side, n, add))]}],
        "skins": [{"joints": [*range(count)], "skeleton": 0, "inverseBindMatrices": add(inverse.reshape(-1, 16))}],
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": c, "metallicFactor": 0}} for c in COLOURS.values()],
        "animations": [{"samplers": samplers, "channels": channels}],
        "bufferViews": views,
        "accessors": accessors,
        "buffers": [{"byteLength": len(data)}],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    file.write(struct.pack("<4sIIII", b"glTF", 2, 28 + len(text) + len(data), len(text), 0x4E4F534A) + text)
    file.write(struct.pack("<II", len(data), 0x004E4942) + data)


def _joints(skeleton: Skeleton) -> list[dict[str, Any]]:
    children = [np.flatnonzero(skeleton.parents == joint).tolist() for joint in range(skeleton.joint_count)]
    steps = [(offset * (parent >= 0)).tolist() for offset, parent in zip(skeleton.offsets, skeleton.parents)]
    nodes = zip(skeleton.joint_names, steps, children)
    return [{"name": name, "translation": step} | ({"children": of} if of else {}) for name, step, of in nodes]


def _quaternions(rotations: np.ndarray) -> np.ndarray:
    """Return (f, 4) x y z w, each on the side of the one before."""
    found = Rotation.from_matrix(rotations).as_quat()
    same = np.where((found[1:] * found[:-1]).sum(axis=1) < 0, -1.0, 1.0)
    return np.asarray(found * np.cumprod([1.0, *same])[:, None])


def _mesh(skeleton: Skeleton, side: str, material: int, add: Callable[..., int]) -> dict[str, Any]:
    """Return the capsules of one side; each end moves with the joint in whose segment it lies. Empty without any."""
    places, parents = skeleton.rest_positions, skeleton.parents
    ends = [
        (places[a], places[b], radius, (a, a) if parents[b] == a else (max(parents[a], 0), max(parents[b], 0)))
        for a, b, radius, own in capsules(skeleton)
        if own == side
    ]
    if side == "middle" and "head" in skeleton.joint_names:
        skull = places[head := skeleton.index("head")] + np.array(HEAD[0]) * skeleton.height
        ends.append((skull, skull + [0.0, 1e-4, 0.0], HEAD[1] * skeleton.height, (head, head)))
    if not ends:
        return {}
    points, normals = (np.concatenate(part) for part in zip(*(_capsule(a, b, radius) for a, b, radius, _ in ends)))
    each = len(LATITUDES) * AROUND
    joints = np.zeros((len(points), 4))
    joints[:, 0] = np.repeat([carrier for *_, carriers in ends for carrier in carriers], each // 2)
    row, column = np.meshgrid(np.arange(len(LATITUDES) - 1), np.arange(AROUND), indexing="ij")
    here, beside = row * AROUND + column, row * AROUND + (column + 1) % AROUND
    faces = np.stack([here, beside, beside + AROUND, here, beside + AROUND, here + AROUND], axis=-1).reshape(-1)
    attributes = {"POSITION": add(points), "NORMAL": add(normals), "JOINTS_0": add(joints, "u1")}
    attributes["WEIGHTS_0"] = add(np.tile([1.0, 0.0, 0.0, 0.0], (len(points), 1)))
    whole = (faces[None] + each * np.arange(len(ends))[:, None]).reshape(-1, 1)
    return {"attributes": attributes, "indices": add(whole, "<u2"), "material": material}


def _capsule(a: np.ndarray, b: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Return points (v, 3) m and normals (v, 3) of a capsule; the first half of them belongs to its first end."""
    axis = (b - a) / np.linalg.norm(b - a)
    u = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    around = 2 * np.pi * np.arange(AROUND)[:, None] / AROUND
    ring = (np.cos(around) * u + np.sin(around) * np.cross(axis, u)) / np.linalg.norm(u)
    normals = np.cos(LATITUDES)[:, None, None] * ring + np.sin(LATITUDES)[:, None, None] * axis
    middles = np.repeat([a, b], len(LATITUDES) // 2, axis=0)[:, None]
    return (middles + radius * normals).reshape(-1, 3), normals.reshape(-1, 3)
