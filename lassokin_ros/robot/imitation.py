"""A robot's joints from a person's: directions of the bones are kept, lengths are the robot's.

Each tick solves one quadratic program of inverse kinematics (pink, any solver of qpsolvers) over the step of the
configuration: places of elbows and wrists in the axes of the torso, of knees and ankles in those of the base, the
torso's rotation in the base; with a free base the base's rotation and the feet that stand. Its only constraints are one
box of limits of angles, speeds and accelerations, which is never empty, so that it always has a solution.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import qpsolvers
from pink import Configuration

from lassokin_ros.robot.model import RobotModel
from lassokin_ros.robot.person import Course, Person, Posture, posture
from lassokin_ros.robot.robot_file import SIDES
from lassokin_ros.robot.targets import Targets

RAMP_S = 2.0
"""s: in which the speeds grow from 0 to their limits after a hold."""
DOUBT_S = 3.5
"""s: of a hold after a motion that no person makes."""
SHORTEST_S = 0.01
"""s between two images: a shorter interval counts as this one."""
TURN, SWING = 10.0, 30.0
"""rad/s: largest speeds of a person's heading and of a limb's bone."""
DAMPING, SMOOTH, SMOOTH_BASE = 1e-6, 0.7, 4.0
"""Weights: of the step; of its change, 1/rad, of joints and of a free base (1/m, too)."""


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
        self._smoothing = np.full(model.model.nv, SMOOTH**2)
        self._smoothing[: model.v_at] = SMOOTH_BASE**2
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
        """Return (3,) m: how far the joint at the end of a bone, of BONES, is from its target."""
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
        if last is not None and too_fast(last, shown, max(interval, SHORTEST_S)):
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

    def trust(self) -> None:
        """Follow the next person, however far from the last one."""
        self._shown, self._doubt = None, 0.0

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
        shown, person = posture(self._course.advance(self.period), self._person.up), self._person
        self._targets.aim(self.configuration, shown, person, self._heading, self.period)
        self.engaged += self.period
        low, high = self.box(self.share)
        hessian, linear = self._targets.objective(self.configuration)
        hessian.flat[:: len(linear) + 1] += DAMPING + self._smoothing  # of the step, and of its change
        linear -= self._smoothing * self.speed * self.period
        problem = qpsolvers.Problem(hessian, linear, lb=low * self.period, ub=high * self.period)
        self._move(np.clip(self._solve(problem), low, high))
        return self.configuration.q

    def _solve(self, problem: qpsolvers.Problem) -> np.ndarray:
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
        low = np.minimum(np.maximum(-share * model.speed, slowest), fastest)
        high = np.minimum(np.maximum(share * model.speed, slowest), fastest)
        at = slice(model.v_at, None)
        change = change[at] * period  # of the step
        for sign, room, bound in ((1, model.highest - self.positions, high), (-1, self.positions - model.lowest, low)):
            room = np.maximum(room, 0.0)
            # The longest step from which steps that shrink by `change` still end within the room.
            count = np.floor((np.sqrt(1 + 8 * room / change) - 1) / 2)
            brake = count * change + (room - change * count * (count + 1) / 2) / (count + 1)
            bound[at] = sign * np.minimum(sign * bound[at], np.minimum(brake, room) / period)
        low[at], high[at] = np.minimum(low[at], high[at]), np.maximum(high[at], low[at])
        room_low, room_high = (model.lowest - self.positions) / period, (model.highest - self.positions) / period
        low[at] = np.minimum(np.maximum(low[at], room_low), room_high)
        high[at] = np.minimum(np.maximum(high[at], room_low), room_high)
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
