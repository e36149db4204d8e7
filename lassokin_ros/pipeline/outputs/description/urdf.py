"""The skeleton as a URDF, which `joint_states` drives through robot_state_publisher.

Three prismatic joints `root_x`, `root_y`, `root_z` connect the base link (the camera's optical frame) with the body.
Each ball joint is three revolute joints `<joint>_x`, `<joint>_y`, `<joint>_z` in the order of its axes. The child link
of the third one is named `<joint>`: its pose is the joint's pose in the topic `joints`. Links have visual shapes and no
mass, because the URDF describes kinematics and not dynamics.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from xml.etree import ElementTree

import numpy as np

from lassokin_ros.core.body.joint_angles import ROOT_JOINTS
from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import SkeletonError
from lassokin_ros.pipeline.outputs import rep155
from lassokin_ros.pipeline.outputs.naming import Naming

_AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}
_TURNS = 200 * np.pi  # rad: published angles are continuous and grow with each turn
_REACH = 1000.0  # m
_COLOURS = {"left": "0.20 0.45 0.75 1", "right": "0.80 0.35 0.25 1", "": "0.55 0.55 0.58 1"}


def joint_names(skeleton: Skeleton) -> list[str]:
    """Names in JointState's order: the three of the root, then x, y, z of each ball joint (75 for SMPL's tree)."""
    return list(ROOT_JOINTS) + [f"{joint}_{axis}" for joint in skeleton.joint_names for axis in "xyz"]


def urdf(skeleton: Skeleton, base_frame: str, prefix: str = "", body_id: str = "") -> str:
    """The URDF of a skeleton as XML text.

    base_frame: name of the base link, the frame in which translations are given (the camera's optical frame). prefix,
    body_id: see `Naming`; several bodies fit into one TF tree. With a body_id, REP-155's links are added. Raises
    SkeletonError if the name of the base link is empty or the name of one of the body's links.
    """
    naming = Naming(prefix, body_id)
    if not base_frame:
        raise SkeletonError("base frame is empty; expected a name, such as camera_optical_frame (base_frame)")
    if base_frame in {*map(naming.link, _link_names(skeleton)), *map(naming.link_of_joint, skeleton.joint_names)}:
        raise SkeletonError(f"base frame is '{base_frame}'; expected a name that is not one of the skeleton's joints")
    robot = ElementTree.Element("robot", name=skeleton.name)
    for side, colour in _COLOURS.items():
        material = ElementTree.SubElement(robot, "material", name=_material(side))
        ElementTree.SubElement(material, "color", rgba=colour)
    ElementTree.SubElement(robot, "link", name=base_frame)
    above = base_frame
    for name, axis in zip(ROOT_JOINTS, "xyz"):
        link = naming.link(f"{name}_link")
        ElementTree.SubElement(robot, "link", name=link)
        _add_joint(robot, naming.joint(name), "prismatic", above, link, axis, np.zeros(3), _REACH)
        above = link
    for index, joint in enumerate(skeleton.joint_names):
        parent = skeleton.parents[index]
        parent_link = above if parent < 0 else naming.link_of_joint(skeleton.joint_names[parent])
        _add_ball_joint(robot, skeleton, index, parent_link, naming)
    if naming.body_id:
        _add_rep155_links(robot, skeleton, naming)
    ElementTree.indent(robot)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding="unicode") + "\n"


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


def _link_names(skeleton: Skeleton) -> list[str]:
    """Names of all links of the body without a prefix, including some that may be added."""
    return [*skeleton.joint_names, *(f"{name}_link" for name in joint_names(skeleton))]


def _add_rep155_links(robot: ElementTree.Element, skeleton: Skeleton, naming: Naming) -> None:
    """Add REP-155's links, with their own axes, at the joints of the skeleton."""
    for link, index, axes in rep155.links_of(skeleton.joint_names):
        ElementTree.SubElement(robot, "link", name=naming.link(link))
        joint = ElementTree.SubElement(robot, "joint", name=naming.joint(f"{link}_fixed"), type="fixed")
        ElementTree.SubElement(joint, "parent", link=naming.link_of_joint(skeleton.joint_names[index]))
        ElementTree.SubElement(joint, "child", link=naming.link(link))
        ElementTree.SubElement(joint, "origin", xyz="0 0 0", rpy=_text(_rpy(axes)))


def _rpy(rotation: np.ndarray) -> tuple[float, float, float]:
    """Return the fixed-axis angles, rad, of a rotation (3, 3); at a pitch of 90 degrees, the yaw is 0."""
    up, across = -float(rotation[2, 0]), float(np.hypot(rotation[0, 0], rotation[1, 0]))
    if across < 1e-9:
        roll, yaw = np.arctan2(-rotation[1, 2], rotation[1, 1]), 0.0
    else:
        roll, yaw = np.arctan2(rotation[2, 1], rotation[2, 2]), np.arctan2(rotation[1, 0], rotation[0, 0])
    return float(roll), float(np.arctan2(up, across)), float(yaw)


def _add_ball_joint(robot: ElementTree.Element, skeleton: Skeleton, index: int, above: str, naming: Naming) -> None:
    joint, offset = skeleton.joint_names[index], skeleton.offsets[index]
    for number, axis in enumerate(skeleton.axes[index]):
        last = number == 2
        child = naming.link_of_joint(joint) if last else naming.link(f"{joint}_{axis}_link")
        link = ElementTree.SubElement(robot, "link", name=child)
        if last:
            _add_visuals(link, skeleton, index)
        _add_joint(robot, naming.joint(f"{joint}_{axis}"), "revolute", above, child, axis, offset, _TURNS)
        above, offset = child, np.zeros(3)


def _add_joint(
    robot: ElementTree.Element,
    name: str,
    kind: str,
    parent: str,
    child: str,
    axis: str,
    offset: np.ndarray,
    limit: float,
) -> None:
    joint = ElementTree.SubElement(robot, "joint", name=name, type=kind)
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=child)
    ElementTree.SubElement(joint, "origin", xyz=_text(offset), rpy="0 0 0")
    ElementTree.SubElement(joint, "axis", xyz=_text(_AXES[axis]))
    ElementTree.SubElement(joint, "limit", lower=f"{-limit:.6g}", upper=f"{limit:.6g}", effort="1000", velocity="1000")


def _add_visuals(link: ElementTree.Element, skeleton: Skeleton, index: int) -> None:
    """Add a sphere at the joint, a cylinder along each of its bones, and a sphere above a joint named head."""
    height, name = skeleton.height, skeleton.joint_names[index]
    _add_shape(link, name, np.zeros(3), (0.0, 0.0), "sphere", radius=0.02 * height)
    if name == "head":
        _add_shape(link, name, np.array([0.0, 0.045, 0.02]) * height, (0.0, 0.0), "sphere", radius=0.055 * height)
    for child in np.flatnonzero(skeleton.parents == index):
        bone = skeleton.offsets[child]
        length = float(np.linalg.norm(bone))
        if length < 1e-6:
            continue
        # a cylinder's axis is z: pitch, then yaw, rotate z to the bone
        direction = float(np.arccos(np.clip(bone[2] / length, -1, 1))), float(np.arctan2(bone[1], bone[0]))
        radius = float(np.clip(0.12 * length, 0.008 * height, 0.025 * height))
        side = skeleton.joint_names[child]
        _add_shape(link, side, bone / 2, direction, "cylinder", radius=radius, length=length)


def _add_shape(
    link: ElementTree.Element,
    side_of: str,
    centre: np.ndarray,
    direction: tuple[float, float],
    shape: str,
    **sizes: float,
) -> None:
    visual = ElementTree.SubElement(link, "visual")
    ElementTree.SubElement(visual, "origin", xyz=_text(centre), rpy=_text((0.0, *direction)))
    geometry = ElementTree.SubElement(visual, "geometry")
    ElementTree.SubElement(geometry, shape, {name: f"{size:.6g}" for name, size in sizes.items()})
    side = next((side for side in ("left", "right") if side_of.startswith(side)), "")
    ElementTree.SubElement(visual, "material", name=_material(side))


def _material(side: str) -> str:
    return side or "middle"


def _text(numbers: Sequence[float] | np.ndarray) -> str:
    return " ".join(f"{number:.12g}" for number in numbers)
