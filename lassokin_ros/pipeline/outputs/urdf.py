"""The skeleton as a URDF, which `joint_states` drives through robot_state_publisher.

Three prismatic joints `root_x`, `root_y`, `root_z` connect the base link (the camera's optical frame) with the body.
Each ball joint is three revolute joints `<joint>_x`, `<joint>_y`, `<joint>_z` in the order of its axes. The child link
of the third one is named `<joint>`: its pose is the joint's pose in the topic `joints`. Links have visual shapes and no
mass, because the URDF describes kinematics and not dynamics. Limits are people's ranges of motion:
American Academy of Orthopaedic Surgeons, Joint Motion: Method of Measuring and Recording, 1965; the rotation of the
shin, the forefoot, the carrying angle and the collar bone: A. Kapandji, The Physiology of the Joints.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from xml.etree import ElementTree

import numpy as np

from lassokin_ros.core.body.roles import is_finger
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import SkeletonError
from lassokin_ros.pipeline.outputs.body_frames import Naming, links_of
from lassokin_ros.skeleton_readers.naming import ROOT_JOINTS

FINGERS = ("index", "middle", "ring", "pinky")
MARGIN = 10.0
"""Degrees."""
SPINE = {"x": (-12.5, 40.0), "y": (-22.5, 22.5), "z": (-17.5, 17.5)}
"""Half of thorax and loin together (extension 25, flexion 80, rotation 45, bending to the side 35): the model's three
joints share a bend, and one of them may take half of it."""
NECK = {"x": (-45.0, 45.0), "y": (-60.0, 60.0), "z": (-45.0, 45.0)}
"""Extension, flexion; rotation; to the side. Neck and head share it, and one of them may take all."""
RANGES: dict[str, dict[str, tuple[float, float]]] = {
    "spine1": SPINE,
    "spine2": SPINE,
    "spine3": SPINE,
    "neck": NECK,
    "head": NECK,
    "hip": {"x": (-120.0, 30.0), "y": (-45.0, 45.0), "z": (-30.0, 45.0)},
    "knee": {"x": (0.0, 135.0), "y": (-30.0, 40.0), "z": (0.0, 0.0)},
    "ankle": {"x": (-20.0, 50.0), "y": (-20.0, 10.0), "z": (-35.0, 15.0)},
    "foot": {"x": (-70.0, 45.0), "y": (0.0, 0.0), "z": (0.0, 0.0)},
    "collar": {"x": (-45.0, 45.0), "y": (-30.0, 30.0), "z": (-10.0, 45.0)},
    "shoulder": {"x": (-90.0, 70.0), "y": (-135.0, 90.0), "z": (-135.0, 90.0)},
    "elbow": {"x": (-80.0, 80.0), "y": (-150.0, 0.0), "z": (0.0, 20.0)},
    "wrist": {"x": (0.0, 0.0), "y": (-20.0, 30.0), "z": (-80.0, 70.0)},
    "hand": {"x": (0.0, 0.0), "y": (0.0, 0.0), "z": (-90.0, 45.0)},
    **{f"{finger}1": {"x": (0.0, 0.0), "y": (-25.0, 25.0), "z": (-90.0, 45.0)} for finger in FINGERS},
    **{f"{finger}2": {"x": (0.0, 0.0), "y": (0.0, 0.0), "z": (-100.0, 0.0)} for finger in FINGERS},
    **{f"{finger}3": {"x": (0.0, 0.0), "y": (0.0, 0.0), "z": (-90.0, 10.0)} for finger in FINGERS},
    "thumb1": {"x": (-15.0, 70.0), "y": (-50.0, 50.0), "z": (-45.0, 45.0)},
    "thumb2": {"x": (0.0, 0.0), "y": (-10.0, 50.0), "z": (0.0, 0.0)},
    "thumb3": {"x": (0.0, 0.0), "y": (-15.0, 80.0), "z": (0.0, 0.0)},
}
"""Degrees about x (left), y (up) and z (front) of the T-pose, for the left side. The right side has y and z mirrored.

Hip, x: flexion, extension; y: inwards, outwards; z: adduction, abduction. Knee, x: flexion. Ankle, x: dorsal, plantar;
z: inversion, eversion. Shoulder, x: rotation outwards, inwards; y: across the chest 135, back 45, but with a hanging
arm it is the arm's rotation, 90; z: down to the side 90 and on to the other side 45, up 90. Elbow, x: rotation of the
forearm; y: flexion; z: carrying angle. Wrist, y: to the thumb, to the little finger; z: flexion, extension. Fingers, z:
flexion, extension; y: to the thumb, to the little finger. Thumb, y: extension, flexion; x of its root: abduction."""


def range_of(joint: str, axis: str) -> tuple[float, float] | None:
    """Return the least and the largest angle, rad, of a joint about an axis; None for a joint without a range."""
    side, _, part = joint.partition("_")
    ranges = RANGES.get(part if side in ("left", "right") else joint)
    if ranges is None:
        return None
    low, high = ranges[axis]
    if side == "right" and axis in "yz":
        low, high = -high, -low
    return float(np.radians(low - MARGIN)), float(np.radians(high + MARGIN))


_AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}
_TURNS = -200 * np.pi, 200 * np.pi  # rad: published angles are continuous and grow with each turn
_REACH = -1000.0, 1000.0  # m
SHORTEST_BONE = 1e-6
"""m: a shorter bone has no cylinder."""
FINGER = 0.0045
"""/ height, radius of a finger and of its joints."""
_SIZE = "\0"
"""Placeholder of a size in the document; XML allows no such character in names."""
_HERE = "0 0 0"
_COLOURS = {"left": "0.20 0.45 0.75 1", "right": "0.80 0.35 0.25 1", "": "0.55 0.55 0.58 1"}


def joint_names(skeleton: Skeleton | Tree) -> list[str]:
    """Names in JointState's order: the three of the root, then x, y, z of each ball joint (75 for SMPL's tree)."""
    return list(ROOT_JOINTS) + [f"{joint}_{axis}" for joint in skeleton.joint_names for axis in "xyz"]


def urdf(skeleton: Skeleton, base_frame: str, prefix: str = "", body_id: str = "") -> str:
    """The URDF of a skeleton as XML text.

    base_frame: name of the base link, the frame in which translations are given (the camera's optical frame). prefix,
    body_id: see `Naming`; several bodies fit into one TF tree. With a body_id, REP-155's links are added. Raises
    SkeletonError if the name of the base link is empty or the name of one of the body's links.
    """
    bones = tuple(np.flatnonzero(bone_lengths(skeleton) >= SHORTEST_BONE).tolist())
    tree = Tree(skeleton.name, skeleton.joint_names, tuple(skeleton.parents.tolist()), skeleton.axes, bones)
    first, *others = _texts(tree, base_frame, Naming(prefix, body_id))
    pairs = zip(_sizes(skeleton, tree), others, strict=True)
    return "".join([first, *(part for pair in pairs for part in pair)])


@dataclass(frozen=True)
class Tree:
    """What all URDFs of a body have in common: names, parents and axes of the joints, see `Skeleton`.

    bones: indices of the joints at the end of a visible bone.
    """

    name: str
    joint_names: tuple[str, ...]
    parents: tuple[int, ...]
    axes: tuple[str, ...]
    bones: tuple[int, ...]

    def bones_of(self, joint: int) -> list[int]:
        """Return the indices of the joints at the end of the visible bones that begin at a joint."""
        return [bone for bone in self.bones if self.parents[bone] == joint]


@lru_cache(maxsize=32)
def _texts(tree: Tree, base_frame: str, naming: Naming) -> list[str]:
    """Return the parts of the URDF before, between and after the sizes of `_sizes`. Raises SkeletonError as `urdf`.

    Building the document takes ten times as long as filling in the sizes, which calibration changes.
    """
    if not base_frame:
        raise SkeletonError("base frame is empty; expected a name, such as camera_optical_frame")
    if base_frame in {*map(naming.link, _link_names(tree)), *map(naming.link_of_joint, tree.joint_names)}:
        raise SkeletonError(f"base frame is '{base_frame}'; expected a name that is not one of the skeleton's joints")
    if any(_SIZE in name for name in (tree.name, *tree.joint_names, base_frame, naming.prefix, naming.body_id)):
        raise SkeletonError(f"skeleton '{tree.name}' or base frame '{base_frame}': a name holds the character NUL")
    robot = ElementTree.Element("robot", name=tree.name)
    for side, colour in _COLOURS.items():
        material = ElementTree.SubElement(robot, "material", name=_material(side))
        ElementTree.SubElement(material, "color", rgba=colour)
    ElementTree.SubElement(robot, "link", name=base_frame)
    above = base_frame
    for name, axis in zip(ROOT_JOINTS, "xyz"):
        link = naming.link(f"{name}_link")
        ElementTree.SubElement(robot, "link", name=link)
        _add_joint(robot, naming.joint(name), "prismatic", above, link, axis, _HERE, _REACH)
        above = link
    for index, parent in enumerate(tree.parents):
        parent_link = above if parent < 0 else naming.link_of_joint(tree.joint_names[parent])
        _add_ball_joint(robot, tree, index, parent_link, naming)
    if naming.body_id:
        _add_rep155_links(robot, tree, naming)
    ElementTree.indent(robot)
    text = '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding="unicode") + "\n"
    return text.split(_SIZE)


def _sizes(skeleton: Skeleton, tree: Tree) -> Iterator[str]:
    """Yield the sizes in the URDF, as texts, in the document's order."""
    height, lengths = skeleton.height, bone_lengths(skeleton)
    # a cylinder's axis is z: pitch, then yaw, rotate z to the bone
    pitches = np.arccos(np.clip(skeleton.offsets[:, 2] / np.maximum(lengths, SHORTEST_BONE), -1, 1)).tolist()
    yaws = np.arctan2(skeleton.offsets[:, 1], skeleton.offsets[:, 0]).tolist()
    fingers = [is_finger(name) for name in tree.joint_names]
    radii = np.where(fingers, FINGER * height, np.clip(0.12 * lengths, 0.008 * height, 0.025 * height)).tolist()
    offsets, middles = skeleton.offsets.tolist(), (skeleton.offsets / 2).tolist()
    for joint, name in enumerate(tree.joint_names):
        yield "%.12g %.12g %.12g" % tuple(offsets[joint])
        yield f"{(FINGER if fingers[joint] else 0.02) * height:.6g}"
        if name == "head":
            yield f"0 {0.045 * height:.12g} {0.02 * height:.12g}"
            yield f"{0.055 * height:.6g}"
        for bone in tree.bones_of(joint):
            yield "%.12g %.12g %.12g" % tuple(middles[bone])
            yield f"0 {pitches[bone]:.12g} {yaws[bone]:.12g}"
            yield f"{radii[bone]:.6g}"
            yield f"{lengths[bone]:.6g}"


def bone_lengths(skeleton: Skeleton) -> np.ndarray:
    """(n,) m: distance of each joint from its parent at rest; 0 for the root."""
    return np.asarray(np.linalg.norm(skeleton.offsets, axis=1))


def has_prefix(text: str, prefix: str) -> bool:
    """True if a text is a URDF that `urdf` made with this prefix, of any skeleton and base frame."""
    try:
        links = {link.get("name") for link in ElementTree.fromstring(text.encode()).iter("link")}
    except ElementTree.ParseError:
        return False
    return {f"{prefix}{name}_link" for name in ROOT_JOINTS} <= links


def check_names(skeleton: Skeleton) -> None:
    """Raise SkeletonError if two joints or two links of the URDF would have the same name."""
    for kind, names in (("joints", joint_names(skeleton)), ("links", _link_names(skeleton))):
        name, count = Counter(names).most_common(1)[0]
        if count > 1:
            raise SkeletonError(
                f"skeleton '{skeleton.name}': two {kind} of its URDF would be called '{name}'; give the joint that it "
                "is made of another name"
            )


def _link_names(tree: Tree | Skeleton) -> list[str]:
    """Names of all links of the body without a prefix, including some that may be added."""
    return [*tree.joint_names, *(f"{name}_link" for name in joint_names(tree))]


def _add_rep155_links(robot: ElementTree.Element, tree: Tree, naming: Naming) -> None:
    """Add REP-155's links, with their own axes, at the joints of the skeleton."""
    for link, index, axes in links_of(tree.joint_names):
        ElementTree.SubElement(robot, "link", name=naming.link(link))
        joint = ElementTree.SubElement(robot, "joint", name=naming.joint(f"{link}_fixed"), type="fixed")
        ElementTree.SubElement(joint, "parent", link=naming.link_of_joint(tree.joint_names[index]))
        ElementTree.SubElement(joint, "child", link=naming.link(link))
        ElementTree.SubElement(joint, "origin", xyz=_HERE, rpy=_text(_rpy(axes)))


def _rpy(rotation: np.ndarray) -> tuple[float, float, float]:
    """Return the fixed-axis angles, rad, of a rotation (3, 3); at a pitch of 90 degrees, the yaw is 0."""
    up, across = -float(rotation[2, 0]), float(np.hypot(rotation[0, 0], rotation[1, 0]))
    if across < 1e-9:
        roll, yaw = np.arctan2(-rotation[1, 2], rotation[1, 1]), 0.0
    else:
        roll, yaw = np.arctan2(rotation[2, 1], rotation[2, 2]), np.arctan2(rotation[1, 0], rotation[0, 0])
    return float(roll), float(np.arctan2(up, across)), float(yaw)


def _add_ball_joint(robot: ElementTree.Element, tree: Tree, index: int, above: str, naming: Naming) -> None:
    joint, offset = tree.joint_names[index], _SIZE
    for number, axis in enumerate(tree.axes[index]):
        last = number == 2
        child = naming.link_of_joint(joint) if last else naming.link(f"{joint}_{axis}_link")
        link = ElementTree.SubElement(robot, "link", name=child)
        if last:
            _add_visuals(link, tree, index)
        limits = range_of(joint, axis) or _TURNS
        _add_joint(robot, naming.joint(f"{joint}_{axis}"), "revolute", above, child, axis, offset, limits)
        above, offset = child, _HERE


def _add_joint(
    robot: ElementTree.Element,
    name: str,
    kind: str,
    parent: str,
    child: str,
    axis: str,
    offset: str,
    limits: tuple[float, float],
) -> None:
    joint = ElementTree.SubElement(robot, "joint", name=name, type=kind)
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=child)
    ElementTree.SubElement(joint, "origin", xyz=offset, rpy="0 0 0")
    ElementTree.SubElement(joint, "axis", xyz=_text(_AXES[axis]))
    low, high = (f"{limit:.6g}" for limit in limits)
    ElementTree.SubElement(joint, "limit", lower=low, upper=high, effort="1000", velocity="1000")


def _add_visuals(link: ElementTree.Element, tree: Tree, index: int) -> None:
    """Add a sphere at the joint, a cylinder along each of its bones, and a sphere above a joint named head."""
    name = tree.joint_names[index]
    _add_shape(link, name, _HERE, "0 0 0", "sphere", "radius")
    if name == "head":
        _add_shape(link, name, _SIZE, "0 0 0", "sphere", "radius")
    for child in tree.bones_of(index):
        _add_shape(link, tree.joint_names[child], _SIZE, _SIZE, "cylinder", "radius", "length")


def _add_shape(link: ElementTree.Element, side_of: str, centre: str, direction: str, shape: str, *sizes: str) -> None:
    visual = ElementTree.SubElement(link, "visual")
    ElementTree.SubElement(visual, "origin", xyz=centre, rpy=direction)
    geometry = ElementTree.SubElement(visual, "geometry")
    ElementTree.SubElement(geometry, shape, dict.fromkeys(sizes, _SIZE))
    side = next((side for side in ("left", "right") if side_of.startswith(side)), "")
    ElementTree.SubElement(visual, "material", name=_material(side))


def _material(side: str) -> str:
    return side or "middle"


def _text(numbers: Sequence[float] | np.ndarray) -> str:
    return " ".join(f"{number:.12g}" for number in numbers)
