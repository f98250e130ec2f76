"""Inverse kinematics: the joint positions for a pose of the tool."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from slidax._errors import DefinitionError
from slidax.robots import AbstractRobot

from .chain import Chain, chain_of
from .curve import standing
from .newton import converged
from .pose import Pose, numbers
from .series import Array, cross
from .task import HOLDS, Hold, Task, apart, least_motion, ways

TRIES, START_SEED = 16, 0
"""Starts of a search, and the seed of all but the first."""

AT_LIMIT = 1e-5
"""A joint within this part of its range from a limit counts as at the limit."""


@dataclass(frozen=True, eq=False)
class Solution:
    """A posture that has the tool at a pose.

    - `q`: positions [n], rad or m.
    - `place_error`, `turn_error`: error of the tool, m and rad.
    - `least_motion`: least singular value of the Jacobian, m or rad per rad or m of the joints; 0 at a singularity.
    - `starts`: number of postures from which the search started.
    """

    q: Array
    place_error: float
    turn_error: float
    least_motion: float
    starts: int


def inverse(
    robot: AbstractRobot, pose: Pose, *, start: object, hold: Hold = "pose", posture: object = None
) -> Solution:
    """Return the joint positions within the limits, near a start, that have the tool at a pose.

    A trust-region search (damped least squares with bounds) starts at `start`. If it fails, it starts again at random
    postures, and the solution nearest to `start` is taken. A redundant arm takes the solution nearest to `posture`,
    with each joint scaled by its range. The same arguments give the same bits.

    - `start`: posture from which to search [n], rad or m.
    - `hold`: "place" prescribes the position of the tip, "axis" also the direction of the tool's z axis, "pose" both
      position and orientation.
    - `posture`: preferred posture [n]; the start by default.

    Raises DefinitionError, with the nearest pose, if the search finds no posture.
    """
    require_hold(hold)
    chain = chain_of(robot)
    begin = numbers("start", start, chain.size)
    return at_pose(chain, pose, begin, begin if posture is None else numbers("posture", posture, chain.size), hold)


def at_pose(chain: Chain, pose: Pose, begin: Array, liked: Array, hold: Hold) -> Solution:
    """Solve `inverse` for a chain of joints, from `begin` and with the preferred posture `liked` [n].

    Raises DefinitionError if the search finds no posture.
    """
    lower, upper = chain.lower, chain.upper
    outside = (begin < lower) | (begin > upper)
    if outside.any():
        joint = int(np.argmax(outside))
        raise DefinitionError(
            f"`start` must be within the limits of the joints: {chain.names[joint]} is at {begin[joint]:.4g}, and "
            f"has {lower[joint]:.4g} to {upper[joint]:.4g}"
        )
    generator = np.random.default_rng(START_SEED)
    best: tuple[float, Array] | None = None
    nearest: tuple[float, Array] = (np.inf, begin)
    start = 0
    span = np.where(np.isfinite(upper - lower), upper - lower, 2 * np.pi)
    low = np.where(np.isfinite(lower), lower, begin - np.pi)
    for start in range(1, TRIES + 1):
        guess = begin if start == 1 else low + span * generator.random(chain.size)
        q = _searched(chain, pose, guess, hold)
        off = float(np.hypot(*_apart(chain, pose, q, hold)))
        if off < nearest[0]:
            nearest = (off, q)
        if off < 1e-6:
            away = float(np.linalg.norm((q - begin) / span))
            if best is None or away < best[0]:
                best = (away, q)
            if start == 1 or start >= TRIES // 4:
                break
    if best is None:
        raise DefinitionError(_refused(chain, pose, nearest[1], hold))
    task = task_of(chain, liked, hold)
    q = _polished(task, pose, best[1])
    return Solution(q, *_apart(chain, pose, q, hold), float(least_motion(task, q)), start)


def require_hold(hold: str) -> None:
    """Raise DefinitionError for an unknown name of the held coordinates."""
    if hold not in HOLDS:
        raise DefinitionError(f'must be "place", "axis" or "pose"; got "{hold}"', where="hold")


def task_of(chain: Chain, posture: Array, hold: Hold, damping: float = 0.0) -> Task:
    """Return the task for a preferred posture [n], with joint limits if the arm is redundant.

    Raises DefinitionError if the posture is outside a limit.
    """
    lower, upper = chain.lower, chain.upper
    half = 0.5 * (upper - lower)
    open_ended = np.full(chain.size, np.inf)
    widths = np.where(np.isfinite(half), half, 1.0)
    free = Task(chain, hold, posture, widths, -open_ended, open_ended, damping)
    if ways(free) >= chain.size:
        return free
    outside = (posture <= lower) | (posture >= upper)
    if outside.any():
        joint = int(np.argmax(outside))
        raise DefinitionError(
            f"`posture` must be inside of the limits of the joints: {chain.names[joint]} is at {posture[joint]:.4g}, "
            f"and has {lower[joint]:.4g} to {upper[joint]:.4g}"
        )
    return replace(free, lower=lower, upper=upper)


def _searched(chain: Chain, pose: Pose, guess: Array, hold: Hold) -> Array:
    """Damped least squares within the limits, on differences of positions and of axes."""
    from scipy.optimize import least_squares

    room = 1e-9 * np.where(np.isfinite(chain.upper - chain.lower), chain.upper - chain.lower, 1.0)
    kept = {"place": [], "axis": [2], "pose": [0, 1, 2]}[hold]

    def error(q: Array) -> Array:
        rotation, place = chain.frame(q)
        turned = ((rotation - pose.rotation)[:, kept] / np.sqrt(2.0)).T.ravel()
        return np.concatenate([place - pose.place, turned])

    def slope(q: Array) -> Array:
        tool = chain.tool([q])
        jacobian = np.zeros((3 + 3 * len(kept), chain.size))
        axes = (tool.x[0], tool.y[0], tool.z[0])
        for axis in tool.axes:
            direction = axis.direction[0]
            jacobian[:3, axis.joint] = cross(direction, tool.place[0] - axis.place[0]) if axis.turns else direction
            for row, k in enumerate(kept):
                if axis.turns:
                    jacobian[3 * row + 3 : 3 * row + 6, axis.joint] = cross(direction, axes[k]) / np.sqrt(2.0)
        return jacobian

    result = least_squares(
        error,
        np.clip(guess, chain.lower + room, chain.upper - room),
        jac=slope,
        bounds=(chain.lower, chain.upper),
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
        max_nfev=100,
    )
    return np.asarray(result.x)


def _apart(chain: Chain, pose: Pose, q: Array, hold: Hold) -> tuple[float, float]:
    place, turn = apart(*chain.frame(q), pose.rotation, pose.place, hold)
    return float(place), float(turn)


def _polished(task: Task, pose: Pose, q: Array) -> Array:
    """Refine a solution to the last digits, and for a redundant arm towards the preferred posture."""
    room = 1e-3 * task.widths
    begin = np.clip(q, task.lower + room, task.upper - room)
    refined = liked_most(replace(task, posture=begin), pose, begin, task.posture)
    q_refined = None if refined is None else refined[: q.size]
    if q_refined is None or np.hypot(*_apart(task.chain, pose, q_refined, task.hold)) > 1e-6:
        return q
    return q_refined


def liked_most(task: Task, pose: Pose, q: Array, liked: Array) -> Array | None:
    """Return posture and forces at a pose while the preferred posture moves from q to `liked`, or None."""
    z = np.concatenate([q, np.zeros(HOLDS[task.hold])])
    curve, at = standing(pose.rotation, pose.place), np.zeros(1)
    done, step = 0.0, 1.0 if (liked == q).all() else 0.25
    while done < 1.0:
        goal = min(done + step, 1.0)
        solution = converged(replace(task, posture=q + goal * (liked - q)), curve, z[None], at)
        if solution is None or np.abs(solution[0, : q.size] - z[: q.size]).max() > 0.5:
            step *= 0.5
            if step < 1e-4:
                return None
            continue
        z, done = solution[0], goal
    return z


def _refused(chain: Chain, pose: Pose, q: Array, hold: Hold) -> str:
    place, turn = _apart(chain, pose, q, hold)
    span = np.where(np.isfinite(chain.upper - chain.lower), chain.upper - chain.lower, 1.0)
    ends = [
        f"{name} at its {side} limit of {bound:.4g}"
        for i, name in enumerate(chain.names)
        for side, bound in (("lower", chain.lower[i]), ("upper", chain.upper[i]))
        if abs(q[i] - bound) < AT_LIMIT * span[i]
    ]
    where = f"[{', '.join(f'{x:.4g}' for x in pose.place)}] m"
    target = {"place": where, "axis": f"{where} with this direction", "pose": f"{where} in this orientation"}[hold]
    near = f"{place:.3g} m" + ("" if hold == "place" else f" and {np.rad2deg(turn):.3g} degrees")
    why = f", with {' and '.join(ends)}" if ends else ""
    return f"no posture was found that brings the tool to {target}: the nearest is {near} off{why}"
