"""The kinematic model of a robot: its URDF without the joints that do not move, and the frames at the 14 places."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from difflib import get_close_matches
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from lassokin_ros.robot.robot_file import ARM_BONES, BONES, CHAINS, PLACES, SIDES, RobotError, RobotFile

LEAST_LENGTH = 0.02
"""m: a limb's bone that is shorter has two places at one point."""
LONGEST_URDF = 20_000_000
"""Characters."""
MOVABLE = ("revolute", "prismatic", "continuous")
"""Types of joints of a URDF; a joint in a transmission has none."""
PREFIX = "place:"
"""Of the names of the places' frames: a link may have the name of a place."""
BASE_SPEED, BASE_ACCELERATION = (2.5, 6.0), (30.0, 100.0)
"""m/s and rad/s, m/s^2 and rad/s^2: largest ones of a free base."""


class RobotModel:
    """A robot's model. All arrays over joints have the order of `names`.

    model: of pinocchio. frames: index of the frame at each place. names: (m,) joints that move. lowest, highest: (m,)
    rad (m). speed, acceleration: (nv,) largest ones, rad/s (m/s) and rad/s^2 (m/s^2). rest: (nq,) configuration.
    axes: of base and torso in front, left, up at zero angles, (3, 3) each. lengths: m, of the bone to each place.
    offsets: (3,) m, of each first joint of a limb in the axes (front, left, up) of base or torso.
    """

    def __init__(self, urdf: str, robot: RobotFile, free: bool = False) -> None:
        """urdf: its text. free: the base moves; else only what moves the arms and the torso does.

        Raises RobotError with all that does not fit.
        """
        self.robot, self.free = robot, free
        xml = kinematic_tree(urdf)
        urdf = ElementTree.tostring(xml, encoding="unicode")
        whole = _parsed(urdf)
        _refuse(_unknown(whole, robot))
        moving = _moving(whole, robot, free)
        _refuse([*_unusable(whole, robot, moving), *_mimics(xml, {whole.names[joint] for joint in moving})])
        self.model = _reduced(urdf, robot, moving, free)
        self.frames = {place: self.model.getFrameId(PREFIX + place) for place in PLACES}
        self.names = tuple(self.model.names[2 if free else 1 :])
        #: All joints of the URDF that can move, in its order; those that are not in `names` stay at rest.
        self.all_names = tuple(str(joint.get("name")) for joint in xml.iter("joint") if joint.get("type") in MOVABLE)
        #: Index of the first joint in the configuration and in the velocity.
        self.at, self.v_at = (7, 6) if free else (0, 0)
        self.lowest = self.model.lowerPositionLimit[self.at :].copy()
        self.highest = self.model.upperPositionLimit[self.at :].copy()
        most = np.where(self.model.velocityLimit > 0, self.model.velocityLimit, robot.speed)
        self.speed, self.acceleration = np.minimum(most, robot.speed), np.full(self.model.nv, robot.acceleration)
        if free:
            self.speed[:6], self.acceleration[:6] = np.repeat(BASE_SPEED, 3), np.repeat(BASE_ACCELERATION, 3)
        self.rest = self.on_floor(self._configuration([robot.rest.get(name, 0.0) for name in self.names]))
        self._measure()

    def _configuration(self, positions: Sequence[float] | float) -> np.ndarray:
        """Return (nq,) with positions (m,) within the limits, and the base at the origin."""
        q = pin.neutral(self.model)
        q[self.at :] = np.clip(positions, self.lowest, self.highest)
        return q

    def on_floor(self, q: np.ndarray) -> np.ndarray:
        """Return a configuration with the lower sole of a robot with a free base on the floor, which is at z = 0."""
        if self.free:
            places = self.places(q)
            q[2] += self.robot.sole - min(places[f"{side}_ankle"][2] for side in SIDES)
        return q

    def whole(self, positions: np.ndarray) -> np.ndarray:
        """Return the positions of `all_names`. positions: of `names`."""
        moved = dict(zip(self.names, positions))
        return np.array([moved.get(name, self.robot.rest.get(name, 0.0)) for name in self.all_names])

    def places(self, q: np.ndarray) -> dict[str, np.ndarray]:
        """Return (3,) m of each place in the world of the robot. q: (nq,) configuration."""
        return {place: frame.translation.copy() for place, frame in self._placed(q).items()}

    def _placed(self, q: np.ndarray) -> dict[str, pin.SE3]:
        data = self.model.createData()
        pin.framesForwardKinematics(self.model, data, q)
        return {place: data.oMf[frame].copy() for place, frame in self.frames.items()}

    def _measure(self) -> None:
        """Set axes, lengths and offsets. Raises RobotError for a robot whose places are not where a person's are."""
        placed = self._placed(self._configuration(0.0))
        at = {place: frame.translation.copy() for place, frame in placed.items()}
        self.axes = {place: placed[place].rotation.T.copy() for place in ("base", "torso")}
        self.lengths, self.offsets, wrong = {}, {}, []
        for bone in BONES:
            self.offsets[bone.first] = at[bone.first] - at[bone.owner]
            self.lengths[bone.far] = float(np.linalg.norm(at[bone.far] - at[bone.near]))
            if self.lengths[bone.far] < LEAST_LENGTH:
                wrong.append(f"{bone.near} and {bone.far} are {self.lengths[bone.far]:.3f} m apart")
        for joint in (names[0] for names in CHAINS.values()):
            if not at[f"left_{joint}"][1] - at[f"right_{joint}"][1] > LEAST_LENGTH:
                wrong.append(f"left_{joint} is not to the left (y) of right_{joint}")
        if not min(at[f"{side}_hip"][2] for side in SIDES) > max(at[f"{side}_ankle"][2] for side in SIDES):
            wrong.append("the hips are not above (z) the ankles")
        _refuse([f"{each} at zero angles; expected a robot that stands, x front, y left, z up" for each in wrong])

    def remarks(self) -> list[str]:
        """Return what a user may want to know, a line each: few joints, limits that the robot's file sets."""
        lines = []
        for bone in BONES[1 : None if self.free else ARM_BONES : 2]:
            between = _support(self.model, self.frames[bone.far]) - _support(self.model, self.frames[bone.owner])
            count = len([joint for joint in between if self.model.names[joint] in self.names])
            if count < 4:
                limb = f"{bone.far.partition('_')[0]} {'arm' if bone.owner == 'torso' else 'leg'}"
                lines.append(f"the {limb} has {count} moving joints; with fewer than 4 it can only come near")
        return lines


def _refuse(wrong: Iterable[str]) -> None:
    words = "; ".join(wrong)
    if words:
        raise RobotError(words)


def kinematic_tree(urdf: str) -> ElementTree.Element:
    """Return the URDF without shapes: meshes need not be there. Raises RobotError."""
    if len(urdf) > LONGEST_URDF or "<!ENTITY" in urdf:
        raise RobotError(f"the URDF has {len(urdf)} characters; expected at most {LONGEST_URDF}, without entities")
    try:
        xml = ElementTree.fromstring(urdf)
    except ElementTree.ParseError as error:
        raise RobotError(f"the URDF is no XML ({error}); expected the text of a URDF file") from None
    for link in xml.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
    return xml


def _parsed(urdf: str) -> pin.Model:
    try:
        return pin.buildModelFromXML(urdf)
    except Exception as error:
        reason = " ".join(str(error).split())[:200]
        raise RobotError(f"the URDF cannot be read ({reason}); expected one tree of links, expanded by xacro") from None


def _unknown(model: pin.Model, robot: RobotFile) -> list[str]:
    """Return what the robot's file names and the URDF does not have."""
    links = [frame.name for frame in model.frames if frame.type == pin.FrameType.BODY]
    wrong = [f"{place}: {_nearest('link', link, links)}" for place, link in robot.links.items() if link not in links]
    joints = list(model.names)[1:]
    for key, names in (("lock", robot.lock), ("rest", robot.rest), ("limits", robot.limits)):
        wrong += [f"{key}: {_nearest('joint', name, joints)}" for name in names if name not in joints]
    return wrong


def _nearest(kind: str, name: str, known: Collection[str]) -> str:
    near = get_close_matches(name, known, 1, 0.0) if known else []
    return f"the URDF has no {kind} '{name}'" + (f", the nearest name is '{near[0]}'" if near else "")


def _support(model: pin.Model, frame: int) -> set[int]:
    """Return the joints, without the universe, between the root and a frame."""
    return set(list(model.supports[model.frames[frame].parentJoint])[1:])


def _moving(model: pin.Model, robot: RobotFile, free: bool) -> set[int]:
    """Return the joints that move a place: of the torso and the arms, with a free base of the legs, too."""
    ends = ["torso", *(f"{side}_wrist" for side in SIDES), *(f"{side}_ankle" for side in SIDES if free)]
    moving = set().union(*(_support(model, model.getFrameId(robot.links[end])) for end in ends))
    return {joint for joint in moving if model.names[joint] not in robot.lock}


def _unusable(model: pin.Model, robot: RobotFile, moving: set[int]) -> list[str]:
    """Return which moving joints cannot be used, and limits that rest does not obey."""
    wrong = []
    above = _support(model, model.getFrameId(robot.links["base"]))
    if above:
        names = ", ".join(model.names[joint] for joint in sorted(above))
        wrong.append(f"the link of base hangs on joints ({names}); expected a URDF that begins at the base, fixed")
    for joint in sorted(moving - above):
        name, one = model.names[joint], model.joints[joint]
        if one.nq != 1 or one.nv != 1:
            kind = "continuous" if (one.nq, one.nv) == (2, 1) else f"of {one.nv} degrees of freedom"
            wrong.append(f"the joint '{name}' is {kind}; expected limits (type revolute), or its name in lock")
            continue
        low, high = robot.limits.get(name, (model.lowerPositionLimit[one.idx_q], model.upperPositionLimit[one.idx_q]))
        if not high - low > 0:
            wrong.append(
                f"the joint '{name}' has limits {low:g} to {high:g}; expected a range, in limits or in the URDF"
            )
        elif not low <= robot.rest.get(name, np.clip(0.0, low, high)) <= high:
            wrong.append(f"rest of '{name}' is {robot.rest[name]:g}; expected {low:g} to {high:g}, its limits")
    return wrong


def _mimics(xml: ElementTree.Element, names: Collection[str]) -> list[str]:
    """Return which of the joints follow another one."""
    followers = [joint.get("name") for joint in xml.iter("joint") if joint.find("mimic") is not None]
    return [f"the joint '{name}' mimics another one; expected its name in lock" for name in followers if name in names]


def _reduced(urdf: str, robot: RobotFile, moving: set[int], free: bool) -> pin.Model:
    """Return the model with the moving joints alone, the limits of the robot's file, and a frame for each place."""
    plain = pin.buildModelFromXML(urdf)
    keep = {plain.names[joint] for joint in moving}
    model = pin.buildModelFromXML(urdf, pin.JointModelFreeFlyer()) if free else plain
    for place in PLACES:
        link = model.frames[model.getFrameId(robot.links[place])]
        shift = pin.SE3(np.eye(3), np.array(robot.offsets.get(place, (0.0, 0.0, 0.0))))
        model.addFrame(pin.Frame(PREFIX + place, link.parentJoint, link.placement * shift, pin.FrameType.OP_FRAME))
    for name, (low, high) in robot.limits.items():
        joint = model.joints[model.getJointId(name)]
        if joint.nq == 1:
            model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q] = low, high
    q = pin.neutral(model)
    for name, value in robot.rest.items():
        joint = model.joints[model.getJointId(name)]
        if joint.nq == 1:
            q[joint.idx_q] = value
    fixed = [model.getJointId(name) for name in list(model.names)[2 if free else 1 :] if name not in keep]
    return pin.buildReducedModel(model, fixed, q)
