"""Read the rest pose of a URDF: the positions of its links at zero joint angles.

The XML parser of the standard library loads no external entities. A document type is refused before entities are
expanded, since entities can grow exponentially.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from lassokin_ros.core.body.skeleton import Skeleton
from lassokin_ros.core.errors import SkeletonError
from lassokin_ros.core.yaml_files import MAX_CHARACTERS, read_text
from lassokin_ros.skeleton_readers.naming import ROOT_JOINTS, in_our_names, with_our_orders
from lassokin_ros.skeleton_readers.rest_pose import LARGEST_OFFSET, RestTree, in_our_pose, to_skeleton

MOST_LINKS = 4000


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint of the file.

    number: position in the file; parent, child: links; xyz: m; axis: "x", "y" or "z", empty for another axis.
    """

    number: int
    name: str
    parent: str
    child: str
    xyz: np.ndarray
    rotation: np.ndarray
    axis: str


def read(path: Path, height: float) -> Skeleton:
    """Return the skeleton of a URDF file, see `parse`."""
    return parse(read_text(path, SkeletonError), str(path), height, path.stem)


def parse(text: str, source: str, height: float, name: str = "robot") -> Skeleton:
    """Return the skeleton of a URDF, for a person of `height` m. Lengths are in metres, as in URDF.

    source: for messages. name: of the skeleton, if the URDF has none.

    A URDF written by this package gives the original skeleton. In another URDF the links are identified by name (see
    naming), and the zero pose is turned into a T-pose. Raises SkeletonError.
    """
    robot = _root(text, source)
    joints = _joints(robot, source)
    name = robot.get("name") or name
    if set(ROOT_JOINTS) <= {joint.name for joint in joints}:
        return to_skeleton(_joints_of_our_urdf(joints, source), height, source, name)
    named = in_our_names(with_our_orders(_links(joints)), source)
    if named is None:
        raise SkeletonError(
            f"{source} has none of the known link names (see skeleton_readers/names.yaml); rename the links "
            "to pelvis, left_hip, ..., or describe the skeleton in YAML"
        )
    return to_skeleton(in_our_pose(named, source), height, source, name)


class _NoDoctype(ElementTree.TreeBuilder):
    def doctype(self, name: str, public: str | None, system: str | None) -> None:
        raise SkeletonError("has a document type (DOCTYPE); remove it, a URDF does not need it")


def _root(text: str, source: str) -> ElementTree.Element:
    if len(text) > MAX_CHARACTERS:
        raise SkeletonError(f"{source} is too long; expected at most {MAX_CHARACTERS} characters")
    try:
        robot = ElementTree.fromstring(text, ElementTree.XMLParser(target=_NoDoctype()))
    except SkeletonError as problem:
        raise SkeletonError(f"{source} {problem}") from None
    except (ElementTree.ParseError, ValueError) as problem:
        raise SkeletonError(f"{source} is no valid XML: {problem}") from None
    if robot.tag != "robot":
        raise SkeletonError(f"{source} is no URDF: its root is <{robot.tag}>; expected <robot>")
    return robot


def _joints(robot: ElementTree.Element, source: str) -> list[Joint]:
    """Return all joints, parents first. Raises SkeletonError if they form no tree."""
    waiting: dict[str, list[Joint]] = {}
    children: set[str] = set()
    for number, element in enumerate(robot.findall("joint")):
        joint = _joint(number, element, source)
        if joint.child in children:
            raise SkeletonError(f"{source}: link '{joint.child}' is the child of two joints; expected a tree")
        children.add(joint.child)
        waiting.setdefault(joint.parent, []).append(joint)
    if len(children) > MOST_LINKS:
        raise SkeletonError(f"{source} has {len(children)} links; expected at most {MOST_LINKS}")
    roots = [parent for parent in waiting if parent not in children]
    if len(roots) != 1:
        raise SkeletonError(f"{source}: {len(roots)} root links (parents that are no child); expected one")
    order: list[Joint] = []
    links = list(roots)
    for link in links:  # grows
        order += waiting.get(link, [])
        links += [joint.child for joint in waiting.get(link, [])]
    return order


def _joint(number: int, element: ElementTree.Element, source: str) -> Joint:
    name = element.get("name", "")
    parent, child = (None if link is None else link.get("link") for link in map(element.find, ("parent", "child")))
    if not name or not parent or not child:
        raise SkeletonError(f"{source}: joint '{name}' lacks a name, parent or child")
    origin = element.find("origin")
    xyz, rpy = (_numbers(None if origin is None else origin.get(key), source, name) for key in ("xyz", "rpy"))
    axis = element.find("axis")
    about = _numbers(None if axis is None else axis.get("xyz"), source, name)
    letters = {(1, 0, 0): "x", (0, 1, 0): "y", (0, 0, 1): "z"}
    rotation = Rotation.from_euler("xyz", rpy).as_matrix() if rpy.any() else np.eye(3)
    return Joint(number, name, parent, child, xyz, rotation, letters.get(tuple(about.tolist()), ""))


def _numbers(text: str | None, source: str, joint: str) -> np.ndarray:
    try:
        numbers = np.array([float(word) for word in (text or "0 0 0").split()])
    except ValueError:
        numbers = np.zeros(0)
    if numbers.shape != (3,) or not (np.abs(numbers) < LARGEST_OFFSET).all():  # NaN too
        raise SkeletonError(
            f"{source}: joint '{joint}' has '{text}'; expected three finite numbers, smaller than {LARGEST_OFFSET:g}"
        )
    return numbers


def _placed(joints: list[Joint]) -> dict[str, np.ndarray]:
    """Return the position (3,) m of each link at zero, in the frame of the root link."""
    poses = {joints[0].parent: (np.zeros(3), np.eye(3))}
    for joint in joints:
        place, turn = poses[joint.parent]
        poses[joint.child] = place + turn @ joint.xyz, turn @ joint.rotation
    return {link: place for link, (place, _) in poses.items()}


def _links(joints: list[Joint]) -> RestTree:
    """Return the tree with one joint per link."""
    places = _placed(joints)
    names = list(places)
    parents = {joint.child: names.index(joint.parent) for joint in joints}
    return RestTree(
        tuple(names),
        tuple(parents.get(name, -1) for name in names),
        np.array([places[name] for name in names]),
        ("xzy",) * len(names),
    )


def _joints_of_our_urdf(joints: list[Joint], source: str) -> RestTree:
    """Return the ball joints, each written as three revolute joints, see `pipeline.outputs.urdf`."""
    places = _placed(joints)
    ball_of: dict[str, str] = {}  # link -> the ball joint that it belongs to
    parents: dict[str, str] = {}
    orders: dict[str, str] = {}
    at: dict[str, np.ndarray] = {}
    for joint in sorted(joints, key=lambda joint: joint.number):  # the file's order is the skeleton's
        if joint.name in ROOT_JOINTS:
            continue
        ball = joint.name.rpartition("_")[0]
        if ball not in orders:
            parents[ball] = ball_of.get(joint.parent, "")
            orders[ball], at[ball] = "", places[joint.child]
        orders[ball] += joint.axis
        ball_of[joint.child] = ball
    if not orders:
        raise SkeletonError(f"{source} has only the joints of the root; expected a body below them")
    names = list(orders)
    above = tuple(names.index(parents[name]) if parents[name] else -1 for name in names)
    return RestTree(tuple(names), above, np.array([at[name] for name in names]), tuple(orders.values()))
