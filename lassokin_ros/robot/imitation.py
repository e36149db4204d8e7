"""A robot's joints from a person's: directions of the bones are kept, lengths are the robot's.

Each tick solves one quadratic program of inverse kinematics (pink, any solver of qpsolvers) over the step of the
configuration: places of elbows and wrists in the axes of the torso, of knees and ankles in those of the base, the
torso's rotation in the base; with a free base the base's rotation and the feet that stand. Its only constraints are one
box of limits of angles, speeds and accelerations, which is never empty, so that it always has a solution.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import qpsolvers
from pink import Configuration
from pink.solve_ik import build_ik
from pink.tasks import Task

from lassokin_ros import joints
from lassokin_ros.core.body.rotations import hat
from lassokin_ros.robot.model import RobotModel, owner_of
from lassokin_ros.robot.person import FARS, Course, Person, Posture, posture
from lassokin_ros.robot.robot_file import CHAINS, SIDES

RAMP_S = 2.0
"""s: in which the speeds grow from 0 to their limits after a hold."""
DOUBT_S = 3.0
"""s: of a hold after a motion that no person makes."""
TURN, SWING = 10.0, 30.0
"""rad/s: largest speeds of a person's heading and of a limb's bone."""
DAMPING = 1e-6
WEIGHTS = {"elbow": 2.0, "wrist": 4.0, "knee": 4.0, "ankle": 4.0}
TORSO, BASE, POSTURE, SMOOTH = 2.0, 4.0, 0.05, 0.3
"""Weights: 1/m of places, 1/rad of rotations, of the rest angles, and of changes of the step."""
CHAIN_OF = {joint: chain for chain, names in CHAINS.items() for joint in names}
FOOT, FOOT_TURN = 40.0, 4.0
"""1/m, 1/rad: weights of a foot that stands."""
LEG_STANDS, FOOT_LEVEL = 1.0, 1.0
"""1/m: weight of the place of an ankle relative to the base while the foot stands; 1/rad, of the level of one that
does not."""
POSTURE_GAIN = 0.1
"""Share of the way to the rest angles that a step aims at."""


class Imitation:
    """One robot. configuration: pink's, with q. speed: (nv,) rad/s (m/s) of the last tick. holding: nobody is followed.

    engaged: s since the last hold. unsolved: ticks without a solution.
    """

    def __init__(self, model: RobotModel, rate: float = 100.0, solver: str = "proxqp") -> None:
        """rate: Hz, of `step`. solver: of qpsolvers."""
        self.model, self.period, self.solver = model, 1.0 / rate, solver
        self.configuration = Configuration(model.model, model.model.createData(), model.rest)
        self.speed = np.zeros(model.model.nv)
        self.holding, self.engaged, self.unsolved = True, 0.0, 0
        self._course = Course()
        self._person: Person | None = None
        self._targets = Targets(self.configuration, model)
        self._heading = np.eye(3)
        self._shown: Posture | None = None
        self._doubt = 0.0  # s for which the person must not be followed

    @property
    def positions(self) -> np.ndarray:
        """(m,) rad (m), of the joints of `RobotModel.names`."""
        return self.configuration.q[self.model.at :]

    @property
    def speeds(self) -> np.ndarray:
        """(m,) rad/s (m/s), of the same joints."""
        return self.speed[self.model.v_at :]

    @property
    def base(self) -> np.ndarray:
        """(7,) place, m, and quaternion x, y, z, w of a free base; the floor is at z = 0."""
        return self.configuration.q[:7]

    @property
    def standing(self) -> list[bool]:
        """Whether the left and the right foot are held on the floor."""
        return list(self._targets.standing)

    def off_target(self, far: str) -> np.ndarray:
        """Return (3,) m: how far the joint at the end of a bone, one of FARS, is from its target."""
        return self._targets.off(self.configuration, far)

    @property
    def share(self) -> float:
        """Share, 0 to 1, of the largest speeds that is allowed now: it grows after a hold."""
        return 0.0 if self.holding else min(1.0, self.engaged / RAMP_S)

    def place(self, positions: np.ndarray) -> None:
        """Begin at measured joints (m,) rad (m), within the limits, at rest."""
        q = self.configuration.q.copy()
        q[self.model.at :] = np.clip(positions, self.model.lowest, self.model.highest)
        self.configuration.update(self.model.on_floor(q))
        self.speed = np.zeros_like(self.speed)
        self.holding, self.engaged = True, 0.0

    def see(self, person: Person, interval: float) -> str:
        """Follow a person from now on; or hold, and return why.

        interval: s since the image before, in which the robot's targets reach the person.

        A person who has turned, or whose limb has, faster than people do between two images is somebody else or has
        exchanged sides. The robot then holds for DOUBT_S.
        """
        if not person.usable_as_a_whole:
            self.hold()
            return "the person's joints have no directions"
        shown = posture(person.places, person.up)
        last, self._shown = self._shown, shown
        self._doubt = max(self._doubt - interval, 0.0)
        if last is not None and interval > 0 and too_fast(last, shown, interval):
            self._doubt = DOUBT_S
        if self._doubt > 0:
            self._stop()
            return "the person turned faster than people do"
        if self.holding:
            self._course.reset()
            self._targets.start(self.configuration)
            forward = self.configuration.data.oMf[self.model.frames["base"]].rotation @ self.model.axes["base"]
            yaw = np.arctan2(forward[1, 0], forward[0, 0])
            self._heading = pin.utils.rotate("z", yaw) @ shown.level.T
            self.holding, self.engaged = False, 0.0
        self._course.add(person.places, interval)
        self._person = person
        return ""

    def hold(self) -> None:
        """Stop within the limits of acceleration, and stay. The next person is approached slowly from there."""
        self._shown = None
        self._stop()

    def _stop(self) -> None:
        self.holding, self.engaged = True, 0.0

    def step(self) -> np.ndarray:
        """Return the configuration (nq,) one period later."""
        if self.holding or self._person is None:
            change = self.model.acceleration * self.period
            self._move(self.speed - np.clip(self.speed, -change, change))
            return self.configuration.q
        places = self._course.advance(self.period)
        self._targets.aim(self.configuration, posture(places, self._person.up), self._person, self._heading)
        self.engaged += self.period
        low, high = self.box(self.share)
        problem = build_ik(self.configuration, [self._targets], self.period, DAMPING, limits=[])
        self._smooth(problem)
        problem.lb, problem.ub = low * self.period, high * self.period
        self._move(np.clip(self._solve(problem), low, high))
        return self.configuration.q

    def _smooth(self, problem: Any) -> None:
        """Add the weight of a change of the joints' steps."""
        at = slice(self.model.v_at, None)
        problem.P[at, at] += SMOOTH**2 * np.eye(len(self.speeds))
        problem.q[at] -= SMOOTH**2 * self.speeds * self.period

    def _solve(self, problem: Any) -> np.ndarray:
        """Return the speeds (nv,) of the solution; without one those that brake, counted in `unsolved`."""
        try:
            solution = qpsolvers.solve_problem(problem, solver=self.solver)
            if solution.found and solution.x is not None and np.isfinite(solution.x).all():
                return np.asarray(solution.x / self.period)
        except (qpsolvers.exceptions.QPError, ArithmeticError, ValueError):
            pass
        self.unsolved += 1
        return np.zeros_like(self.speed)

    def box(self, share: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the lowest and the highest speed (nv,) of this tick. share: of the largest speeds, 0 to 1.

        Where limits conflict, those of angles hold before those of accelerations, and these before those of speeds.
        """
        model, period = self.model, self.period
        change = model.acceleration * period
        slowest, fastest = self.speed - change, self.speed + change
        low = np.clip(-share * model.speed, slowest, fastest)
        high = np.clip(share * model.speed, slowest, fastest)
        at = slice(model.v_at, None)
        change = change[at] * period  # of the step
        for sign, room, bound in ((1, model.highest - self.positions, high), (-1, self.positions - model.lowest, low)):
            room = np.maximum(room, 0.0)
            count = np.floor((np.sqrt(1 + 8 * room / change) - 1) / 2)  # full changes with which it can still stop
            brake = count * change + (room - change * count * (count + 1) / 2) / (count + 1)
            bound[at] = sign * np.minimum(sign * bound[at], np.minimum(brake, room) / period)
        low[at], high[at] = np.minimum(low[at], high[at]), np.maximum(high[at], low[at])
        room_low, room_high = (model.lowest - self.positions) / period, (model.highest - self.positions) / period
        low[at], high[at] = np.clip(low[at], room_low, room_high), np.clip(high[at], room_low, room_high)
        return low, high

    def _move(self, speed: np.ndarray) -> None:
        """Move for one period. Joints stay in their limits; a free base is lifted until no sole is below the floor."""
        q = pin.integrate(self.model.model, self.configuration.q, speed * self.period)
        at = self.model.at
        q[at:] = np.clip(q[at:], self.model.lowest, self.model.highest)
        speed = speed.copy()
        speed[self.model.v_at :] = (q[at:] - self.positions) / self.period
        self.speed = speed
        self.configuration.update(q)
        if self.model.free:
            at_ankles = [self.configuration.data.oMf[self.model.frames[f"{side}_ankle"]] for side in SIDES]
            below = self.model.robot.sole - min(ankle.translation[2] for ankle in at_ankles)
            if below > 0:
                q[2] += below
                self.configuration.update(q)


def too_fast(last: Posture, shown: Posture, interval: float) -> bool:
    """Return True if a person does not turn, or move a limb, so fast. interval: s."""
    heading = np.arccos(np.clip(last.level[:, 1] @ shown.level[:, 1], -1.0, 1.0))
    cosines = np.clip(np.sum(last.bones * shown.bones, axis=1), -1.0, 1.0)
    return bool(heading > TURN * interval or np.nanmax(np.arccos(cosines), initial=0.0) > SWING * interval)


class Targets(Task):  # type: ignore[misc]
    """All targets of a tick as one task of pink: rows of position and rotation, computed together."""

    def __init__(self, configuration: Configuration, model: RobotModel) -> None:
        super().__init__(cost=1.0, gain=1.0, lm_damping=0.0)
        self._model, self._free = model, model.free
        count = len(FARS) if model.free else len(FARS) // 2
        self._fars = FARS[:count]
        self._frames = [model.frames[far] for far in self._fars]
        self._owners = [owner_of(far) for far in self._fars]
        self._lengths = np.array([model.lengths[far] for far in self._fars])[:, None]
        self._weights = np.array([WEIGHTS[far.partition("_")[2]] for far in self._fars])
        starts = [
            model.offsets[f"{far.partition('_')[0]}_{CHAINS[CHAIN_OF[far.partition('_')[2]]][0]}"] for far in self._fars
        ]
        self._starts = np.stack(starts)
        self._used = [joints.INDEX[far] for far in self._fars]
        self._feet = [model.frames[f"{side}_ankle"] for side in SIDES]
        self.standing = [False, False]
        self._anchors = [pin.SE3.Identity(), pin.SE3.Identity()]
        self.start(configuration)

    def start(self, configuration: Configuration) -> None:
        """Aim at the present configuration."""
        at, frames = configuration.data.oMf, self._model.frames
        pairs = zip(self._owners, self._frames)
        self._places = np.stack([at[frames[owner]].actInv(at[frame]).translation for owner, frame in pairs])
        self._torso = at[frames["base"]].rotation.T @ at[frames["torso"]].rotation
        self._base = at[frames["base"]].rotation.copy()
        self.standing = [False, False]

    def aim(self, configuration: Configuration, shown: Posture, person: Person, heading: np.ndarray) -> None:
        """Aim at a posture. heading: (3, 3), from the frame of the person to the world of the robot."""
        axes = self._model.axes
        steps = self._lengths * shown.bones[: len(self._fars)]
        ends = self._starts + steps
        ends[1::2] += steps[::2]  # the second bone begins at the end of the first one
        half = len(FARS) // 2
        turned = np.concatenate([ends[:half] @ axes["torso"].T, ends[half:] @ axes["base"].T])
        known = person.usable[self._used] & np.isfinite(turned).all(axis=1)
        known[1::2] &= known[::2]
        self._places = np.where(known[:, None], turned, self._places)
        base = shown.pelvis if self._free else shown.level
        self._torso = axes["base"] @ base.T @ shown.torso @ axes["torso"].T
        if self._free:
            self._base = heading @ shown.pelvis @ axes["base"].T
            lower = shown.heights == shown.heights.min()
            self._stand(configuration, person.contacts if person.contacts.any() else lower)

    def _stand(self, configuration: Configuration, standing: np.ndarray) -> None:
        """Hold feet that stand where they are, on the floor, and keep the others above it. standing: (2,) bool."""
        at, sole = configuration.data.oMf, self._model.robot.sole
        base = at[self._model.frames["base"]]
        for side, stands in enumerate(standing.tolist()):
            foot, leg = at[self._feet[side]], len(FARS) // 2 + 2 * side + 1
            if not (stands and self.standing[side]):
                yaw = np.arctan2(foot.rotation[1, 0], foot.rotation[0, 0])
                place = np.array([foot.translation[0], foot.translation[1], sole])
                self._anchors[side] = pin.SE3(pin.utils.rotate("z", yaw), place)
            if not stands:
                goal = base.act(self._places[leg])
                goal[2] = max(goal[2], sole)
                self._places[leg] = base.actInv(goal)
            self.standing[side] = stands

    def off(self, configuration: Configuration, far: str) -> np.ndarray:
        """Return (3,) m, see `Imitation.off_target`."""
        at, index = configuration.data.oMf, self._fars.index(far)
        owner = at[self._model.frames[self._owners[index]]]
        place: np.ndarray = owner.actInv(at[self._frames[index]]).translation
        return place - self._places[index]

    def compute_error(self, configuration: Configuration) -> np.ndarray:
        """See pink's Task: weighted, as in `_rows`."""
        return self._rows(configuration)[1]

    def compute_jacobian(self, configuration: Configuration) -> np.ndarray:
        """See pink's Task: weighted, as in `_rows`."""
        return self._rows(configuration)[0]

    def compute_qp_objective(self, configuration: Configuration) -> tuple[np.ndarray, np.ndarray]:
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
        half = len(FARS) // 2
        for name, part in (("torso", slice(0, half)), ("base", slice(half, len(self._fars)))):
            if part.start == part.stop:
                continue
            at, own = owners[name]
            away = np.stack([data.oMf[frame].translation for frame in self._frames[part]]) - at.translation
            moved = np.stack([end[:3] for end in ends[part]]) - own[:3] + hat(away) @ own[3:]
            weights = self._weights[part].copy()
            if name == "base":
                weights[1::2] = np.where(self.standing, LEG_STANDS, WEIGHTS["ankle"])
            rows.append((weights[:, None, None] * (at.rotation.T @ moved)).reshape(-1, model.nv))
            errors.append((weights[:, None] * (away @ at.rotation - self._places[part])).reshape(-1))
        (base, of_base), (torso, of_torso) = owners["base"], owners["torso"]
        rows.append(TORSO * (torso.rotation.T @ (of_torso[3:] - of_base[3:])))
        errors.append(-TORSO * pin.log3(torso.rotation.T @ base.rotation @ self._torso))
        if self._free:
            rows.append(BASE * of_base[3:])
            errors.append(-BASE * pin.log3(self._base @ base.rotation.T))
            for side, stands in enumerate(self.standing):
                foot, anchor, own = data.oMf[self._feet[side]], self._anchors[side], ends[half + 2 * side + 1]
                turn = FOOT_TURN if stands else FOOT_LEVEL
                rows.append(turn * own[3:])
                errors.append(-turn * pin.log3(anchor.rotation @ foot.rotation.T))
                if stands:
                    rows.append(FOOT * own[:3])
                    errors.append(FOOT * (foot.translation - anchor.translation))
        return np.concatenate(rows), np.concatenate(errors)

    def __repr__(self) -> str:
        return f"Targets({', '.join(self._fars)})"
