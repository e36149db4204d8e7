"""The targets of a robot that imitates a person: weighted rows of position and rotation, and their quadratic objective.

Places of elbows and wrists in the axes of the torso, of knees and ankles in those of the base, the torso's rotation in
the base, limbs that come too near to each other; with a free base the base's rotation, the feet (those that stand are
held, the others stay above the floor), and the centre of mass, which stays over the feet.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from pink import Configuration

from lassokin_ros import joints
from lassokin_ros.core.body.rotations import hat
from lassokin_ros.core.learned.foot_contacts import FLOOR_GATE
from lassokin_ros.robot.clearance import Clearance
from lassokin_ros.robot.model import RobotModel
from lassokin_ros.robot.person import Person, Posture
from lassokin_ros.robot.robot_file import ARM_BONES, BONES, SIDES

WEIGHTS = {"elbow": 2.0, "wrist": 4.0, "knee": 4.0, "ankle": 4.0}
TORSO, BASE, POSTURE = 2.0, 4.0, 0.05
"""Weights: 1/m of places, 1/rad of rotations and of the rest angles."""
FOOT, FOOT_TURN, LEG_STANDS = 40.0, 4.0, 1.0
"""Of a foot that stands: 1/m and 1/rad of its place and rotation, 1/m of its place relative to the base."""
FOOT_LEVEL = 1.0
"""1/rad, of the rotation of a foot that does not stand: level."""
FOOT_GAIN = 0.4
"""Share of the way to its anchor that a step of a foot that stands aims at."""
FOOT_RAMP_S = 0.2
"""s, in which a foot that touches the floor is held, and one that leaves it is freed."""
ON_FLOOR = 0.005
"""m: at the start a foot whose sole is not higher stands."""
BALANCE, SUPPORT = 1.0, 0.05
"""1/m, of the centre of mass; m, how far it may be, on the floor, from the line between the ankles that stand."""
POSTURE_GAIN = 0.1
"""Share of the way to the rest angles that a step aims at."""


class Targets:
    """All targets of a tick. standing: the left and the right foot are held."""

    def __init__(self, configuration: Configuration, model: RobotModel) -> None:
        self._model = model
        self._bones = BONES if model.free else BONES[:ARM_BONES]
        self._frames = [model.frames[bone.far] for bone in self._bones]
        self._lengths = np.array([model.lengths[bone.far] for bone in self._bones])[:, None]
        self._weights = np.array([WEIGHTS[bone.far.partition("_")[2]] for bone in self._bones])
        self._starts = np.stack([model.offsets[bone.first] for bone in self._bones])
        self._used = [joints.INDEX[bone.far] for bone in self._bones]
        self._feet = [model.frames[f"{side}_ankle"] for side in SIDES]
        self._clearance, self._period = Clearance(model), np.inf
        self._heavy = model.free and sum(inertia.mass for inertia in model.model.inertias) > 0
        self.start(configuration)

    @property
    def standing(self) -> list[bool]:
        """Whether the left and the right foot are held where they are."""
        return [share == 1.0 for share in self._held]

    def start(self, configuration: Configuration) -> None:
        """Aim at the present configuration."""
        self._clearance.start()
        at, frames = configuration.data.oMf, self._model.frames
        owned = [(at[frames[bone.owner]], at[frames[bone.far]]) for bone in self._bones]
        self._places = np.stack([owner.actInv(place).translation for owner, place in owned])
        self._torso = at[frames["base"]].rotation.T @ at[frames["torso"]].rotation
        self._base = at[frames["base"]].rotation.copy()
        feet, floor = [at[foot] for foot in self._feet], self._model.robot.sole + ON_FLOOR
        self._anchors = [_flat(foot, foot.translation[2]) for foot in feet]
        self._held = [float(foot.translation[2] <= floor) for foot in feet]  # share, 0 to 1, of the weight of a foot

    def aim(
        self, configuration: Configuration, shown: Posture, person: Person, heading: np.ndarray, period: float
    ) -> None:
        """Aim at a posture. heading: (3, 3), from the frame of the person to the world of the robot. period: s."""
        axes, self._period = self._model.axes, period
        steps = self._lengths * shown.bones[: len(self._bones)]
        ends = self._starts + steps
        ends[1::2] += steps[::2]  # the second bone begins at the end of the first one
        turned = np.concatenate([ends[:ARM_BONES] @ axes["torso"].T, ends[ARM_BONES:] @ axes["base"].T])
        known = person.usable[self._used] & np.isfinite(turned).all(axis=1)
        known[1::2] &= known[::2]
        self._places = np.where(known[:, None], turned, self._places)
        base = shown.pelvis if self._model.free else shown.level
        self._torso = axes["base"] @ base.T @ shown.torso @ axes["torso"].T
        if self._model.free:
            self._base = heading @ shown.pelvis @ axes["base"].T
            heights = shown.heights - shown.heights.min()
            standing = person.contacts & (heights <= FLOOR_GATE)
            self._stand(configuration, standing if standing.any() else heights == 0, period / FOOT_RAMP_S)

    def _stand(self, configuration: Configuration, standing: np.ndarray, change: float) -> None:
        """Hold feet that stand where they are, on the floor, and keep the others above it.

        standing: (2,) bool. change: of the share to which a foot is held. While it changes, the
        weight only slows the foot down; a foot is held at its place at the end of the ramp.
        """
        at, sole = configuration.data.oMf, self._model.robot.sole
        base = at[self._model.frames["base"]]
        for side, stands in enumerate(standing.tolist()):
            foot, leg = at[self._feet[side]], ARM_BONES + 2 * side + 1
            if not (stands and self._held[side] == 1.0):
                self._anchors[side] = _flat(foot, sole)
            if not stands:
                goal = base.act(self._places[leg])
                goal[2] = max(goal[2], sole)
                self._places[leg] = base.actInv(goal)
            self._held[side] = min(max(self._held[side] + (change if stands else -change), 0.0), 1.0)

    def off(self, configuration: Configuration, far: str) -> np.ndarray:
        """Return (3,) m, see `Imitation.off_target`."""
        at, index = configuration.data.oMf, [bone.far for bone in self._bones].index(far)
        owner = at[self._model.frames[self._bones[index].owner]]
        place: np.ndarray = owner.actInv(at[self._frames[index]]).translation
        return place - self._places[index]

    def objective(self, configuration: Configuration) -> tuple[np.ndarray, np.ndarray]:
        """Return H (nv, nv) and c (nv,) of 1/2 d^T H d + c^T d, d the step."""
        jacobian, error = self._rows(configuration)
        hessian, linear = jacobian.T @ jacobian, jacobian.T @ error
        v_at, away = self._model.v_at, configuration.q[self._model.at :] - self._model.rest[self._model.at :]
        diagonal = np.arange(v_at, len(linear))
        hessian[diagonal, diagonal] += POSTURE**2
        linear[v_at:] += POSTURE**2 * POSTURE_GAIN * away
        return hessian, linear

    def _rows(self, configuration: Configuration) -> tuple[np.ndarray, np.ndarray]:
        """Return the weighted Jacobian (r, nv) and error (r,): J d = -e reaches the targets to first order."""
        model, data, frames = self._model.model, configuration.data, self._model.frames

        def jacobian_of(frame: int) -> np.ndarray:  # (6, nv), of a frame, in axes of the world
            return np.asarray(pin.getFrameJacobian(model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED))

        owners = {name: (data.oMf[frames[name]], jacobian_of(frames[name])) for name in ("base", "torso")}
        rows, errors = [], []
        ends = [jacobian_of(frame) for frame in self._frames]
        for name, part in (("torso", slice(0, ARM_BONES)), ("base", slice(ARM_BONES, len(self._bones)))):
            if part.start == part.stop:
                continue
            at, own = owners[name]
            away = np.stack([data.oMf[frame].translation for frame in self._frames[part]]) - at.translation
            moved = np.stack([end[:3] for end in ends[part]]) - own[:3] + hat(away) @ own[3:]
            weights = self._weights[part].copy()
            if name == "base":
                weights[1::2] += (LEG_STANDS - WEIGHTS["ankle"]) * np.array(self._held)
            rows.append((weights[:, None, None] * (at.rotation.T @ moved)).reshape(-1, model.nv))
            errors.append((weights[:, None] * (away @ at.rotation - self._places[part])).reshape(-1))
        (base, of_base), (torso, of_torso) = owners["base"], owners["torso"]
        rows.append(TORSO * (torso.rotation.T @ (of_torso[3:] - of_base[3:])))
        errors.append(-TORSO * pin.log3(torso.rotation.T @ base.rotation @ self._torso))
        if self._model.free:
            rows.append(BASE * of_base[3:])
            errors.append(-BASE * pin.log3(self._base @ base.rotation.T))
            for side, share in enumerate(self._held):
                foot, anchor, own = data.oMf[self._feet[side]], self._anchors[side], ends[ARM_BONES + 2 * side + 1]
                weight, turn = FOOT * share**3, FOOT_LEVEL + (FOOT_TURN - FOOT_LEVEL) * share
                rows.append(turn * own[3:])
                errors.append(-turn * pin.log3(anchor.rotation @ foot.rotation.T))
                if weight:
                    rows.append(weight * own[:3])
                    errors.append(weight * FOOT_GAIN * (foot.translation - anchor.translation))
            if self._heavy and max(self._held) > 0:
                row, error = self._balance(configuration)
                rows.append(row)
                errors.append(error)
        apart, too_near = self._clearance.rows(configuration, self._period)
        return np.concatenate([*rows, apart]), np.concatenate([*errors, too_near])

    def _balance(self, configuration: Configuration) -> tuple[np.ndarray, np.ndarray]:
        """Return the rows (2, nv) and errors (2,) of the centre of mass in the plane of the floor."""
        data, (first, other) = configuration.data, sorted((0, 1), key=lambda side: -self._held[side])
        moved = pin.jacobianCenterOfMass(self._model.model, data, configuration.q)
        start, end = (data.oMf[self._feet[side]].translation[:2] for side in (first, other))
        along = (end - start) * self._held[other] / self._held[first]
        away = data.com[0][:2] - start
        away = away - along * np.clip(along @ away / max(along @ along, 1e-9), 0.0, 1.0)
        beyond = max(1.0 - SUPPORT / max(float(np.linalg.norm(away)), 1e-9), 0.0)
        weight = BALANCE * self._held[first]
        return weight * moved[:2], weight * beyond * away


def _flat(foot: pin.SE3, height: float) -> pin.SE3:
    """Return a foot with a level sole, at a height, m."""
    yaw = np.arctan2(foot.rotation[1, 0], foot.rotation[0, 0])
    return pin.SE3(pin.utils.rotate("z", yaw), np.array([foot.translation[0], foot.translation[1], height]))
