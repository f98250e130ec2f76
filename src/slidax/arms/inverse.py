"""Inverse kinematics: the joint positions for a tool pose, and the equations that determine them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from slidax.core.errors import DefinitionError

from .arm import AbstractRobot
from .chain import KinematicChain, PlacedTool, Pose, kinematic_chain, numbers
from .curves import (
    AbstractCurve,
    Array,
    Series,
    TargetPose,
    constant_pose,
    cross,
    dot,
    product,
    scale_series,
    scale_vectors,
    sum_series,
)

HeldCoordinates = Literal["place", "axis", "pose"]

HOLDS = {"place": 3, "axis": 5, "pose": 6}
"""Number of prescribed tool coordinates: position only, position and direction of the z axis, or the whole pose."""

BARRIER = 0.02
"""Weight of the joint-limit barrier of a redundant arm, relative to the weight of the posture."""

SEED, DRAWN = 0, 8
"""Seed and number of random postures for the Jacobian's rank."""


@dataclass(frozen=True, eq=False)
class PoseTask:
    """Inverse kinematics as an optimisation: minimise `½ Σ ((q - q_0)/w)²` with the tool at its target.

    A logarithmic barrier with zero slope at q_0 keeps a redundant arm's joints inside their limits. The posture is then
    a smooth function of the tool's pose: a closed path of the tool gives a closed path of the joints.

    - `hold`: the prescribed tool coordinates, "place", "axis" or "pose", as in `inverse`.
    - `posture`: the preferred posture q_0 [n], rad or m.
    - `widths`: w [n], half of each joint's range; 1 for a joint without limits.
    - `lower`, `upper`: joint limits [n]; infinite for an arm that is not redundant.
    - `damping`: d, which permits a tool error of d² times the force on the tool (the Lagrange multiplier). It bounds
      this force near a singularity; 0 for no tool error.
    """

    chain: KinematicChain
    hold: HeldCoordinates
    posture: Array
    widths: Array
    lower: Array
    upper: Array
    damping: float = 0.0

    def residual(self, q: Series, force: Series, aim: TargetPose) -> Series:
        """Return the residual of the optimality conditions, a Taylor series [... n+m].

        Its first n entries are the gradient of the Lagrangian, the other m the tool's error.

        - `q`, `force`: posture, and forces on the m prescribed tool coordinates (Lagrange multipliers), Taylor series
          [... n], [... m].
        - `aim`: the target pose.
        """
        tool = self.chain.tool(q)
        gradient = sum_series(self._slope(q), self._joint_forces(tool, force, aim))
        error = sum_series(self.error(tool, aim), scale_series(force, -(self.damping**2)))
        return [_concatenate(a, b, q[0], force[0]) for a, b in zip(gradient, error, strict=True)]

    def error(self, tool: PlacedTool, aim: TargetPose) -> Series:
        """Return the tool's error in the prescribed coordinates, a Taylor series: position [m], small angles [rad]."""
        position = sum_series(tool.position, scale_series(aim.position, -1.0))
        if self.hold == "place":
            return position
        turned: Series
        if self.hold == "axis":
            tilts = [product(aim.y, tool.z, dot), scale_series(product(aim.x, tool.z, dot), -1.0)]
            turned = [_stack([tilt[k] for tilt in tilts]) for k in range(len(position))]
        else:
            pairs = zip((aim.x, aim.y, aim.z), (tool.x, tool.y, tool.z), strict=True)
            turned = scale_series(sum_series(*(product(a, b, cross) for a, b in pairs)), 0.5)
        return [_concatenate(a, b, position[0], turned[0]) for a, b in zip(position, turned, strict=True)]

    def _joint_forces(self, tool: PlacedTool, force: Series, aim: TargetPose) -> Series:
        """Return the joint forces from a force on the tool, a Taylor series [... n]."""
        pull = [None if c is None else c[..., :3] for c in force]
        moment: Series = scale_series(pull, 0.0)
        if self.hold == "pose":
            moment = [None if c is None else c[..., 3:] for c in force]
        if self.hold == "axis":
            first, second = ([None if c is None else c[..., k] for c in force] for k in (3, 4))
            about = sum_series(
                product(first, aim.y, scale_vectors), scale_series(product(second, aim.x, scale_vectors), -1.0)
            )
            moment = product(tool.z, about, cross)
        torques: dict[int, Series] = {}
        for axis in tool.axes:
            if axis.revolute:
                arm = sum_series(tool.position, scale_series(axis.position, -1.0))
                about = product(arm, pull, cross)
                torques[axis.joint] = product(axis.direction, sum_series(about, moment), dot)
            else:
                torques[axis.joint] = product(axis.direction, pull, dot)
        zero = np.zeros(force[0].shape[:-1])
        each = range(self.posture.size)
        return [
            np.stack(
                [zero if j not in torques or torques[j][k] is None else torques[j][k] + zero for j in each], axis=-1
            )
            for k in range(len(force))
        ]

    def _slope(self, q: Series) -> Series:
        """Return the gradient of the minimised function by q, a Taylor series [... n]."""
        slope = (q[0] - self.posture) / self.widths**2
        slope = slope + BARRIER * (self._barrier(q[0])[0] - self._barrier(self.posture)[0])
        series: Series = [slope]
        if len(q) > 1:
            _, once, twice = self._barrier(q[0])
            stiffness = 1.0 / self.widths**2 + BARRIER * once
            with np.errstate(invalid="ignore"):
                series.append(None if q[1] is None else stiffness * q[1])
            if len(q) > 2:
                bent = 0.0 if q[1] is None else 0.5 * BARRIER * twice * q[1] ** 2
                series.append(bent + (0.0 if q[2] is None else stiffness * q[2]))
        return series

    def _barrier(self, q: Array) -> tuple[Array, Array, Array]:
        """Return the slope of the barrier `-log((q - lower)(upper - q))`, with its first and second derivative."""
        # At a limit the slope is infinite, which ends the search.
        with np.errstate(divide="ignore", invalid="ignore"):
            up, down = 1.0 / (self.upper - q), 1.0 / (q - self.lower)
            return up - down, up**2 + down**2, 2.0 * (up**3 - down**3)


class LinearisedTask(NamedTuple):
    """Residual of a `PoseTask` at k points of a curve [k n+m], with derivatives by z [k n+m n+m] and by s [k n+m].

    z has the n joint positions and the m forces on the tool (Lagrange multipliers); s is the curve parameter.
    """

    residual: Array
    by_z: Array
    by_s: Array


def linearise_task(task: PoseTask, curve: AbstractCurve, z: Array, s: Array) -> LinearisedTask:
    """Return the residual of a task and its derivatives at points of a curve.

    - `z`: postures and forces [k n+m].
    - `s`: curve parameters [k].
    """
    n, size = task.posture.size, z.shape[1]
    # One direction for each unknown, and the last for the curve parameter.
    directions = np.concatenate([np.eye(size), np.zeros((1, size))])
    moves = np.append(np.zeros(size), 1.0)
    shape = (len(z), size + 1)
    values = np.broadcast_to(z[:, None], (*shape, size))
    slopes = np.broadcast_to(directions, (*shape, size))
    aim = curve.aim([np.broadcast_to(s[:, None], shape), np.broadcast_to(moves, shape)])
    value, slope = task.residual([values[..., :n], slopes[..., :n]], [values[..., n:], slopes[..., n:]], aim)
    return LinearisedTask(value[:, 0], np.swapaxes(slope[:, :-1], 1, 2), slope[:, -1])


def curvature(task: PoseTask, curve: AbstractCurve, z: Array, s: Array, along: Array) -> Array:
    """Return the second derivative of a task's residual by the curve parameter s, if z changes linearly, [k n+m].

    - `z`, `s`: as in `linearise_task`.
    - `along`: the constant derivative of z by s [k n+m].
    """
    n = task.posture.size
    aim = curve.aim([s, np.ones_like(s), None])
    *_, second = task.residual([z[:, :n], along[:, :n], None], [z[:, n:], along[:, n:], None], aim)
    return 2.0 * second


def tool_errors(task: PoseTask, curve: AbstractCurve, q: Array, s: Array) -> tuple[Array, Array]:
    """Return the tool's position and angle errors at postures q [k n], m and rad, [k] each.

    The angle is 0 if only the position is prescribed.

    - `s`: curve parameters of the targets [k].
    """
    return pose_error(*task.chain.frame(q), *curve.at(s), task.hold)


def pose_error(
    rotation: Array, position: Array, other_rotation: Array, other_position: Array, hold: HeldCoordinates
) -> tuple[Array, Array]:
    """Return distance and angle between two poses in the prescribed coordinates, m and rad, [...] each.

    - `rotation`, `position`: first pose [... 3 3], [... 3].
    - `other_rotation`, `other_position`: second pose.
    - `hold`: the prescribed coordinates, as in `inverse`; the angle is 0 for "place".
    """
    distance: Array = np.linalg.norm(position - other_position, axis=-1)
    if hold == "place":
        return distance, np.zeros_like(distance)
    # Differences of the axes keep the digits of a small angle.
    difference = rotation - other_rotation
    difference, scale = (difference, 8.0) if hold == "pose" else (difference[..., 2:], 4.0)
    size = np.sqrt(np.sum(difference**2, axis=(-2, -1)) / scale)
    return distance, 2.0 * np.arcsin(np.minimum(size, 1.0))


def jacobian(task: PoseTask, q: Array) -> Array:
    """Return the Jacobian of the prescribed tool coordinates [... m n] at postures [... n]."""
    n = q.shape[-1]
    values = np.broadcast_to(q[..., None, :], (*q.shape[:-1], n, n))
    tool = task.chain.tool([values, np.broadcast_to(np.eye(n), values.shape)])
    aim = TargetPose(*([axis[0], None] for axis in (tool.x, tool.y, tool.z, tool.position)))
    slope = task.error(tool, aim)[1]
    return np.swapaxes(slope, -1, -2)


def least_motion(task: PoseTask, q: Array) -> Array:
    """Return the least singular value of the Jacobian at postures [... n], in m or rad per rad or m of the joints.

    Directions in which the tool can never move, such as out of a planar arm's plane, do not count.
    """
    return np.linalg.svd(jacobian(task, q), compute_uv=False)[..., task_rank(task) - 1]


def task_rank(task: PoseTask) -> int:
    """Return the number of tool coordinates that the joints can move: the Jacobian's largest rank at 8 postures."""
    postures = task.posture + np.random.default_rng(SEED).uniform(-1.0, 1.0, (DRAWN, task.posture.size))
    return int(np.linalg.matrix_rank(jacobian(task, postures), tol=1e-6).max())


def _concatenate(a: Array | None, b: Array | None, like_a: Array, like_b: Array) -> Array | None:
    if a is None and b is None:
        return None
    return np.concatenate(
        [np.zeros_like(like_a) if a is None else a, np.zeros_like(like_b) if b is None else b], axis=-1
    )


def _stack(terms: list[Array | None]) -> Array | None:
    known = [term for term in terms if term is not None]
    if not known:
        return None
    return np.stack([np.zeros_like(known[0]) if term is None else term for term in terms], axis=-1)


NEWTON_STEPS = 15
"""Most Newton steps; near a solution three are enough."""

SMALL = 1e-9
"""Bound of the last Newton step, rad or m, and of the residual after it; a further step would be at rounding level."""

EMPTY = 1e-11
"""Smaller singular values, relative to the largest, belong to directions in which the tool can never move."""


def solve_task(task: PoseTask, curve: AbstractCurve, z: Array, s: Array) -> Array | None:
    """Return postures and forces that solve the task at k points of a curve [k n+m]; None unless all converge.

    - `z`: initial values [k n+m].
    - `s`: curve parameters [k].
    """
    n = task.posture.size
    lower, upper = task.lower, task.upper
    last = False
    for _ in range(NEWTON_STEPS):
        equations = linearise_task(task, curve, z, s)
        if not (np.isfinite(equations.residual).all() and np.isfinite(equations.by_z).all()):
            return None
        if last:
            return z if np.abs(equations.residual).max() < SMALL else None
        step = -solve_singular(equations.by_z, equations.residual)
        # Damp the step to stay inside the joint limits, where the barrier is finite.
        with np.errstate(divide="ignore", invalid="ignore"):
            q, dq = z[:, :n], step[:, :n]
            to_limit = np.where(dq > 0, (upper - q) / dq, np.where(dq < 0, (lower - q) / dq, np.inf))
        share = np.minimum(1.0, 0.9 * to_limit.min(axis=1))
        z = z + share[:, None] * step
        # Forces are not part of the test, since they are large near a singularity.
        last = bool(np.abs(step[:, :n]).max() < SMALL and (share == 1.0).all())
    return None


def solve_singular(matrices: Array, right: Array) -> Array:
    """Return `K⁻¹ r` for each matrix K [k m m] and vector r [k m], by the pseudo-inverse."""
    return np.einsum("kij,kj->ki", np.linalg.pinv(matrices, rcond=EMPTY), right)


TRIES, START_SEED = 16, 0
"""Largest number of starts of a search, and the seed of the random starts."""

AT_LIMIT = 1e-5
"""A joint counts as at a limit within this share of its range."""


@dataclass(frozen=True, eq=False)
class InverseSolution:
    """Joint positions that put the tool at a pose.

    - `q`: positions [n], rad or m.
    - `position_error`, `rotation_error`: error of the tool, m and rad.
    - `least_motion`: least singular value of the Jacobian, m or rad per rad or m of the joints; 0 at a singularity.
    - `starts`: number of postures from which the search started.
    """

    q: Array
    position_error: float
    rotation_error: float
    least_motion: float
    starts: int


def inverse(
    robot: AbstractRobot, pose: Pose, *, start: object, hold: HeldCoordinates = "pose", posture: object = None
) -> InverseSolution:
    """Return joint positions within the limits, near a start, that put the tool at a pose.

    A trust-region search (damped least squares with bounds) starts at `start`. If it fails, it starts again at random
    postures, and the solution nearest to `start` counts. For a redundant arm, this solution is then moved towards
    `posture`, with each joint scaled by its range. The result is deterministic.

    - `start`: posture from which to search [n], rad or m.
    - `hold`: "place" prescribes the position of the tip, "axis" also the direction of the tool's z axis, "pose" both
      position and orientation.
    - `posture`: preferred posture [n]; the start by default.

    Raises DefinitionError if `start` is outside the limits, `posture` is not inside those of a redundant arm, or the
    search finds no posture; the message then states the smallest error.
    """
    require_hold(hold)
    chain = kinematic_chain(robot)
    begin = numbers("start", start, chain.size)
    return inverse_of_chain(
        chain, pose, begin, begin if posture is None else numbers("posture", posture, chain.size), hold
    )


def inverse_of_chain(
    chain: KinematicChain, pose: Pose, begin: Array, preferred: Array, hold: HeldCoordinates
) -> InverseSolution:
    """Solve `inverse` for a chain of joints, from `begin`; a redundant arm stays near the posture `preferred` [n].

    Raises DefinitionError if `begin` is outside the joint limits, or if the search finds no posture.
    """
    lower, upper = chain.lower, chain.upper
    outside = (begin < lower) | (begin > upper)
    if outside.any():
        joint = int(np.argmax(outside))
        raise DefinitionError(
            f"`start` must be within the limits of the joints: {chain.names[joint]} is at {begin[joint]:.4g}, its "
            f"limits are {lower[joint]:.4g} and {upper[joint]:.4g}"
        )
    generator = np.random.default_rng(START_SEED)
    best: tuple[float, Array] | None = None
    nearest: tuple[float, Array] = (np.inf, begin)
    start = 0
    span = np.where(np.isfinite(upper - lower), upper - lower, 2 * np.pi)
    low = np.where(np.isfinite(lower), lower, begin - np.pi)
    for start in range(1, TRIES + 1):
        guess = begin if start == 1 else low + span * generator.random(chain.size)
        q = _search(chain, pose, guess, hold)
        off = float(np.hypot(*_pose_errors(chain, pose, q, hold)))
        if off < nearest[0]:
            nearest = (off, q)
        if off < 1e-6:
            distance = float(np.linalg.norm((q - begin) / span))
            if best is None or distance < best[0]:
                best = (distance, q)
            if start == 1 or start >= TRIES // 4:
                break
    if best is None:
        raise DefinitionError(_failure_message(chain, pose, nearest[1], hold))
    task = pose_task(chain, preferred, hold)
    q = _refine(task, pose, best[1])
    return InverseSolution(q, *_pose_errors(chain, pose, q, hold), float(least_motion(task, q)), start)


def require_hold(hold: str) -> None:
    """Raise DefinitionError unless `hold` is "place", "axis" or "pose"."""
    if hold not in HOLDS:
        raise DefinitionError(f'must be "place", "axis" or "pose"; got "{hold}"', where="hold")


def pose_task(chain: KinematicChain, posture: Array, hold: HeldCoordinates, damping: float = 0.0) -> PoseTask:
    """Return the task for a preferred posture [n], with joint limits if the arm is redundant.

    Raises DefinitionError if the arm is redundant and the posture is not strictly inside the limits.
    """
    lower, upper = chain.lower, chain.upper
    half = 0.5 * (upper - lower)
    open_ended = np.full(chain.size, np.inf)
    widths = np.where(np.isfinite(half), half, 1.0)
    free = PoseTask(chain, hold, posture, widths, -open_ended, open_ended, damping)
    if task_rank(free) >= chain.size:
        return free
    outside = (posture <= lower) | (posture >= upper)
    if outside.any():
        joint = int(np.argmax(outside))
        raise DefinitionError(
            f"`posture` (by default the start) must be strictly inside the joint limits: {chain.names[joint]} is at "
            f"{posture[joint]:.4g}, its limits are {lower[joint]:.4g} and {upper[joint]:.4g}"
        )
    return replace(free, lower=lower, upper=upper)


def _search(chain: KinematicChain, pose: Pose, guess: Array, hold: HeldCoordinates) -> Array:
    """Return a posture by damped least squares within the limits; the residual has differences of position and axes."""
    from scipy.optimize import least_squares

    inset = 1e-9 * np.where(np.isfinite(chain.upper - chain.lower), chain.upper - chain.lower, 1.0)
    columns = {"place": [], "axis": [2], "pose": [0, 1, 2]}[hold]

    def error(q: Array) -> Array:
        rotation, position = chain.frame(q)
        turned = ((rotation - pose.rotation)[:, columns] / np.sqrt(2.0)).T.ravel()
        return np.concatenate([position - pose.position, turned])

    def slope(q: Array) -> Array:
        tool = chain.tool([q])
        jacobian = np.zeros((3 + 3 * len(columns), chain.size))
        axes = (tool.x[0], tool.y[0], tool.z[0])
        for axis in tool.axes:
            direction = axis.direction[0]
            jacobian[:3, axis.joint] = (
                cross(direction, tool.position[0] - axis.position[0]) if axis.revolute else direction
            )
            for row, k in enumerate(columns):
                if axis.revolute:
                    jacobian[3 * row + 3 : 3 * row + 6, axis.joint] = cross(direction, axes[k]) / np.sqrt(2.0)
        return jacobian

    result = least_squares(
        error,
        np.clip(guess, chain.lower + inset, chain.upper - inset),
        jac=slope,
        bounds=(chain.lower, chain.upper),
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
        max_nfev=100,
    )
    return np.asarray(result.x)


def _pose_errors(chain: KinematicChain, pose: Pose, q: Array, hold: HeldCoordinates) -> tuple[float, float]:
    position, turn = pose_error(*chain.frame(q), pose.rotation, pose.position, hold)
    return float(position), float(turn)


def _refine(task: PoseTask, pose: Pose, q: Array) -> Array:
    """Refine a solution to the last digits, and for a redundant arm towards the preferred posture."""
    inset = 1e-3 * task.widths
    begin = np.clip(q, task.lower + inset, task.upper - inset)
    refined = move_to_posture(replace(task, posture=begin), pose, begin, task.posture)
    q_refined = None if refined is None else refined[: q.size]
    if q_refined is None or np.hypot(*_pose_errors(task.chain, pose, q_refined, task.hold)) > 1e-6:
        return q
    return q_refined


def move_to_posture(task: PoseTask, pose: Pose, q: Array, preferred: Array) -> Array | None:
    """Move the preferred posture from q to `preferred` in steps, with the tool at the pose.

    Return the resulting posture and forces [n+m]; None if a step does not converge.
    """
    z = np.concatenate([q, np.zeros(HOLDS[task.hold])])
    curve, at = constant_pose(pose.rotation, pose.position), np.zeros(1)
    done, step = 0.0, 1.0 if (preferred == q).all() else 0.25
    while done < 1.0:
        goal = min(done + step, 1.0)
        solution = solve_task(replace(task, posture=q + goal * (preferred - q)), curve, z[None], at)
        if solution is None or np.abs(solution[0, : q.size] - z[: q.size]).max() > 0.5:
            step *= 0.5
            if step < 1e-4:
                return None
            continue
        z, done = solution[0], goal
    return z


def _failure_message(chain: KinematicChain, pose: Pose, q: Array, hold: HeldCoordinates) -> str:
    position, turn = _pose_errors(chain, pose, q, hold)
    span = np.where(np.isfinite(chain.upper - chain.lower), chain.upper - chain.lower, 1.0)
    ends = [
        f"{name} at its {side} limit of {bound:.4g}"
        for i, name in enumerate(chain.names)
        for side, bound in (("lower", chain.lower[i]), ("upper", chain.upper[i]))
        if abs(q[i] - bound) < AT_LIMIT * span[i]
    ]
    where = f"[{', '.join(f'{x:.4g}' for x in pose.position)}] m"
    target = {"place": where, "axis": f"{where} with this direction", "pose": f"{where} in this orientation"}[hold]
    near = f"{position:.3g} m" + ("" if hold == "place" else f" and {np.rad2deg(turn):.3g} degrees")
    why = f", with {' and '.join(ends)}" if ends else ""
    return f"no posture found with the tool at {target}: the nearest is {near} off{why}"
