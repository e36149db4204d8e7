"""The .glb is read back by the rules of the specification: chunks, accessors, node tree, skin, and where joints are."""

import json
import struct
from io import BytesIO

import numpy as np
import pytest
from exported import motion_of
from scipy.spatial.transform import Rotation

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.replay.exports.gltf import write_gltf

SKELETON = Skeleton.load("anthropometric", 1.75)
COMPONENTS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}
NUMBERS = {5126: "<f4", 5123: "<u2", 5121: "u1"}


@pytest.fixture(scope="module")
def motion():
    """Three frames, 1 s after the recording begins, of a body that turns every joint; the camera is tilted."""
    n, random = SKELETON.joint_count, np.random.default_rng(0)
    turns = Rotation.from_rotvec(random.normal(size=(3 * n, 3)) * 0.8).as_matrix().reshape(3, n, 3, 3)
    turns[:, 0] = np.diag([1.0, -1.0, -1.0]) @ turns[:, 0]
    root, tilted = np.array([[0.1, 0.2, 4.0], [0.2, 0.2, 4.0], [0.3, 0.1, 3.9]]), Rotation.from_rotvec([0.2, 0, 0])
    stamps = 10**9 + np.array([0, 40, 80]) * 10**6
    return motion_of(SKELETON, stamps, turns, root, "p2", level=tilted.as_matrix(), floor=-1.1)


@pytest.fixture(scope="module")
def scene(motion):
    """The JSON, and a function that returns the array of an accessor."""
    file = BytesIO()
    write_gltf(motion, file)
    data = file.getvalue()
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    text_length, kind = struct.unpack_from("<I4s", data, 12)
    binary_length, binary_kind = struct.unpack_from("<I4s", data, 20 + text_length)
    assert (kind, binary_kind) == (b"JSON", b"BIN\0") and text_length % 4 == binary_length % 4 == 0
    document, binary = json.loads(data[20 : 20 + text_length]), data[28 + text_length :]
    assert document["buffers"] == [{"byteLength": len(binary)}] and len(binary) == binary_length

    def array(number):
        accessor = document["accessors"][number]
        view = document["bufferViews"][accessor["bufferView"]]
        assert view["byteOffset"] % 4 == 0
        columns = COMPONENTS[accessor["type"]]
        kind = NUMBERS[accessor["componentType"]]
        values = np.frombuffer(binary, kind, accessor["count"] * columns, view["byteOffset"]).reshape(-1, columns)
        assert values.nbytes == view["byteLength"]
        assert np.allclose(accessor["min"], values.min(axis=0)) and np.allclose(accessor["max"], values.max(axis=0))
        return values

    return document, array


def test_the_animated_nodes_are_where_the_joints_are(scene, motion):
    document, array = scene
    nodes, (animation,) = document["nodes"], document["animations"]
    parents = {child: number for number, node in enumerate(nodes) for child in node.get("children", [])}
    assert [node["name"] for node in nodes[:-1]] == list(SKELETON.joint_names)
    assert document["scenes"][document["scene"]]["nodes"] == [0, len(nodes) - 1] and set(parents) == set(range(1, 24))
    moved = {}
    for channel in animation["channels"]:
        sampler = animation["samplers"][channel["sampler"]]
        assert np.allclose(array(sampler["input"])[:, 0], motion.start + np.array([0.0, 0.04, 0.08]))
        moved[channel["target"]["node"], channel["target"]["path"]] = array(sampler["output"])
    world = np.diag([1.0, -1.0, -1.0]) @ motion.scene.level
    for frame in range(3):
        places, turns = np.zeros((24, 3)), [Rotation.identity()] * 24
        expected, matrices = np.zeros((24, 3)), np.zeros((24, 3, 3))
        for joint in range(24):
            own = Rotation.from_quat(moved[joint, "rotation"][frame])
            if joint == 0:
                places[0], turns[0] = moved[0, "translation"][frame], own
                expected[0], matrices[0] = motion["translation"][frame], motion["joint_rotations"][frame, 0]
                continue
            above = parents[joint]
            places[joint] = places[above] + turns[above].apply(nodes[joint]["translation"])
            turns[joint] = turns[above] * own
            expected[joint] = expected[above] + matrices[above] @ SKELETON.offsets[joint]
            matrices[joint] = matrices[above] @ motion["joint_rotations"][frame, joint]
        assert np.abs(places - (expected @ world.T - [0, motion.scene.floor, 0])).max() < 1e-5


def test_the_skin_is_at_rest_where_the_joints_are_and_its_faces_point_outwards(scene):
    document, array = scene
    (skin,), (mesh,) = document["skins"], document["meshes"]
    inverse = array(skin["inverseBindMatrices"]).reshape(-1, 4, 4).transpose(0, 2, 1)  # columns follow each other
    assert skin["joints"] == list(range(24)) and np.allclose(inverse[:, :3, 3], -SKELETON.rest_positions, atol=1e-6)
    assert document["nodes"][-1] | {"name": ""} == {"name": "", "mesh": 0, "skin": 0} and len(mesh["primitives"]) == 3
    everything = []
    for primitive in mesh["primitives"]:
        assert primitive["material"] < len(document["materials"])
        found = {name: array(number) for name, number in primitive["attributes"].items()}
        assert np.allclose(np.linalg.norm(found["NORMAL"], axis=1), 1, atol=1e-5)
        assert np.allclose(found["WEIGHTS_0"].sum(axis=1), 1) and found["JOINTS_0"].max() < 24
        faces = array(primitive["indices"]).reshape(-1, 3)
        assert faces.max() < len(found["POSITION"])
        a, b, c = (found["POSITION"][faces[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        solid = np.linalg.norm(normals, axis=1) > 1e-9  # at the poles some have no area
        outwards = (normals * found["NORMAL"][faces].sum(axis=1)).sum(axis=1)
        assert (outwards[solid] > 0).all() and solid.mean() > 0.6
        everything.append(found["POSITION"])
    size = np.ptp(np.concatenate(everything), axis=0)
    assert size[1] == pytest.approx(1.75, abs=0.12) and 1.5 < size[0] < 1.9 and size[2] < 0.5


def test_turns_between_frames_take_the_short_way(scene):
    document, array = scene
    for sampler in document["animations"][0]["samplers"][1:]:
        turns = array(sampler["output"])
        assert ((turns[1:] * turns[:-1]).sum(axis=1) >= 0).all()
