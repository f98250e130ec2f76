"""Follow a tool path: the joint motion for a sequence of moves, or the reason why none exists."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slidax.arms.arm import AbstractRobot
from slidax.arms.chain import KinematicChain, Pose, kinematic_chain, numbers
from slidax.arms.curves import Array
from slidax.arms.inverse import (
    HOLDS,
    HeldCoordinates,
    PoseTask,
    inverse,
    inverse_of_chain,
    jacobian,
    least_motion,
    move_to_posture,
    pose_task,
    require_hold,
    task_rank,
)
from slidax.core.errors import DefinitionError, as_array, count_noun, locate_errors

from .joint_path import JointPath, PathEnd, evaluate_pieces, joint_path
from .limits import limit
from .moves import AbstractMove, TimedCurve
from .tabulated import Tabulated
from .trajectory import ToolMotion

NEAR_SINGULAR = 0.02
"""Least singular value of the Jacobian below which a posture is near a singularity."""

NEAR_LIMIT = 0.01
"""A joint that is closer to a limit than this fraction of its range counts as at the limit."""

CHECKED_TIMES = 40
"""Number of times in each piece at which the joint limits are checked."""


def path_end_message(task: PoseTask, move: TimedCurve, caught: PathEnd, now: float) -> str:
    """Return an error message: why the search for postures ended at a point of the move.

    - `task`: the arm and the prescribed coordinates of its tool.
    - `caught`: the last point for which a posture exists.
    - `now`: start of the move [s].
    """
    n = task.posture.size
    q = caught.z[:n]
    sizes = np.linalg.svd(jacobian(task, q))
    rank = task_rank(task)
    weak = sizes[0][:, rank - 1]
    held = _near_limits(task.chain, q)
    end = _can_reach_end(task, move, q)
    if float(sizes[1][rank - 1]) < NEAR_SINGULAR:
        why = f"{_stretched(weak)}; keep away from it, or accept a small pose error there with `damping`"
    elif held:
        why = f"{' and '.join(held)}; begin in another posture, or prefer another one with `posture`"
    else:
        why = "the arm has no posture beyond it; begin in another posture, or hold fewer coordinates with `hold`"
    return f"the tool cannot follow {_describe_position(move, caught.s, now)}: {why}{end}"


def require_within_range(chain: KinematicChain, move: TimedCurve, path: JointPath, now: float) -> None:
    """Raise DefinitionError, with the first time and the tool's position then, if a joint exceeds a position limit.

    - `now`: start of the move [s].
    """
    motion = Tabulated(times=as_array(path.times), coefficients=as_array(path.coefficients))
    reach, lower, upper = motion.extremes(0), chain.lower, chain.upper
    slack = 1e-9
    if not ((reach.least < lower - slack) | (reach.largest > upper + slack)).any():
        return
    width = np.diff(path.times)
    x = width[:, None] * np.linspace(0.0, 1.0, CHECKED_TIMES)
    times = (path.times[:-1, None] + x).ravel()
    q = evaluate_pieces(path.coefficients, x).reshape(-1, path.joints)
    outside = (q < lower) | (q > upper)
    row = int(np.argmax(outside.any(axis=1)))
    joint = (
        int(np.argmax(outside[row]))
        if outside.any()
        else int(np.argmax((reach.largest > upper) | (reach.least < lower)))
    )
    low = reach.least[joint] < lower[joint]
    bound, extreme = (lower[joint], reach.least[joint]) if low else (upper[joint], reach.largest[joint])
    t = float(times[row])
    s = float(path.law.at(np.array([t]))[0][0])
    raise DefinitionError(
        f"{chain.names[joint]} is at its limit of {bound:.4g} {_describe_position(move, s, now + t, t)}, and would go "
        f"to {extreme:.4g}: begin in another posture, or move the path"
    )


def require_within_rates(chain: KinematicChain, path: JointPath, fastest: Array, strongest: Array, now: float) -> None:
    """Raise DefinitionError, with the necessary duration, if a joint exceeds a velocity or acceleration limit.

    - `fastest`, `strongest`: velocity and acceleration limits [n].
    - `now`: start of the move [s].
    """
    motion = Tabulated(times=as_array(path.times), coefficients=as_array(path.coefficients))
    for order, name, limits in ((1, "velocity", fastest), (2, "acceleration", strongest)):
        extremes = motion.extremes(order)
        over = extremes.size / limits
        if (over > 1 + 1e-9).any():
            joint = int(np.argmax(over))
            forward = extremes.largest[joint] >= -extremes.least[joint]
            when = now + float((extremes.when_largest if forward else extremes.when_least)[joint])
            unit = chain.units[joint] + ("/s" if order == 1 else "/s²")
            slower = float(over[joint]) ** (1.0 / order)
            raise DefinitionError(
                f"{chain.names[joint]} would need {extremes.size[joint]:.4g} {unit} at t = {when:.4g} s, over its "
                f"limit of {limits[joint]:g} for {name}: make the move {slower:.3g} times as long"
            )


def _describe_position(move: TimedCurve, s: float, now: float, into: float | None = None) -> str:
    """Describe a point on a move by its time and the tip's position.

    - `s`: curve parameter of the point.
    - `now`: start of the move; time of the point if `into` is set [s].
    - `into`: time since the start of the move [s]; None for a point at which the postures end.
    """
    _, position = move.curve.at(s)
    where = ", ".join(f"{x:.4g}" for x in np.asarray(position))
    if into is None:
        law = move.law
        t = np.linspace(law.times[0], law.times[-1], 2001)
        when = now + float(t[int(np.searchsorted(law.at(t)[0], s - 1e-12).clip(0, 2000))])
        time = "" if move.free else f"t = {when:.4g} s, "
        return f"beyond {time}{s * move.length:.4g} {move.unit} along this move, with the tip at [{where}] m"
    return f"at t = {now:.4g} s, {s * move.length:.4g} {move.unit} along this move, with the tip at [{where}] m"


def _stretched(weak: Array) -> str:
    """Describe a singularity by the direction in which the tool cannot move."""
    translation, rotation = np.linalg.norm(weak[:3]), np.linalg.norm(weak[3:])
    direction = weak[:3] if translation >= rotation else weak[3:]
    direction = direction / np.linalg.norm(direction)
    components = ", ".join(f"{x:.2f}" for x in direction)
    if translation >= rotation:
        return (
            f"a singularity, where the tip cannot move along [{components}]: there the arm is stretched out or folded"
        )
    return f"a singularity, where the tool cannot turn about [{components}]: there two axes are in line"


def _near_limits(chain: KinematicChain, q: Array) -> list[str]:
    lower, upper = chain.lower, chain.upper
    messages = []
    for joint, name in enumerate(chain.names):
        span = upper[joint] - lower[joint]
        for side, bound in (("lower", lower[joint]), ("upper", upper[joint])):
            if np.isfinite(span) and abs(q[joint] - bound) < NEAR_LIMIT * span:
                messages.append(f"{name} is at its {side} limit of {bound:.4g}")
    return messages


def _can_reach_end(task: PoseTask, move: TimedCurve, q: Array) -> str:
    """Return the part of a message that states if the arm has a posture for the end of the move."""
    try:
        inverse_of_chain(task.chain, move.end, np.clip(q, task.chain.lower, task.chain.upper), q, task.hold)
    except DefinitionError as error:
        return f". The end of the move is out of reach, too: {error.message}"
    return ". The end of the move can be reached, but not along this move from here"


MOST_MOVES = 1000
"""Most moves in one path."""


@dataclass(frozen=True, eq=False)
class ToolPath:
    """A joint motion that moves the tool along a path, and its errors.

    - `trajectory`: quintics in time with continuous acceleration, at rest before and after.
    - `ends`: end of each move [moves], s.
    - `position_error`, `rotation_error`: largest errors of the tool at the knots and at five times in each piece, m and
      rad.
    - `least_motion`: smallest singular value of the tool's Jacobian at all knots, m or rad per rad or m; 0 at a
      singularity. It is the tool's motion in its worst direction, per unit of joint motion.
    - `worst_at`: time at which `least_motion` occurs [s].
    - `hold`: coordinates of the tool that the path prescribes: "place", "axis" or "pose".
    """

    trajectory: ToolMotion
    ends: Array
    position_error: float
    rotation_error: float
    least_motion: float
    worst_at: float
    hold: HeldCoordinates

    def __str__(self) -> str:
        turn = "" if self.hold == "place" else f" and {self.rotation_error:.1e} rad"
        return (
            f"{count_noun(len(self.ends), 'move')}, {float(self.trajectory.until):.4g} s, "
            f"{count_noun(self.trajectory.times.size - 1, 'quintic')}; "
            f"the tool is within {self.position_error:.1e} m{turn}; it is nearest to a singularity at "
            f"t = {self.worst_at:.4g} s, where the least singular value of its Jacobian is {self.least_motion:.3g}"
        )


def follow(
    robot: AbstractRobot,
    moves: Sequence[AbstractMove],
    *,
    start: object,
    pose: Pose | None = None,
    hold: HeldCoordinates = "pose",
    posture: object = None,
    velocity: object = np.inf,
    acceleration: object = np.inf,
    damping: float = 0.0,
    tolerance: float = 1e-6,
    begin: float = 0.0,
) -> ToolPath:
    """Return the joint motion for a path of the tool.

    A posture is the vector of joint positions. Of all postures with the tool at its target, the one nearest to a
    preferred posture is used, with distances relative to the joints' ranges. It is a smooth function of the tool's
    pose, so a closed path of the tool is also a closed path of the joints. Quintics interpolate the posture between
    knots, where its derivatives are exact. Pieces are halved until the tool's error is within the tolerance. The result
    is deterministic.

    - `robot`: the nominal arm.
    - `moves`: moves of the tool, in their order.
    - `start`: posture at the start [n], rad or m.
    - `pose`: pose of the tool at which the path starts; its posture is searched from `start`. By default, the tool's
      pose at `start`.
    - `hold`: prescribed coordinates of the tool: "place" (position), "axis" (also the direction of its z axis) or
      "pose".
    - `posture`: preferred posture of a redundant arm [n]; the start by default.
    - `velocity`, `acceleration`: joint limits, [n] or one number, rad/s and rad/s², or m/s and m/s². A move without
      `duration` and `speed` takes the shortest time within them.
    - `damping`: 0 for no tool error. Otherwise the tool deviates from its path near a singularity, by `damping²` times
      the Lagrange multipliers of its pose (damped least squares).
    - `tolerance`: largest error of the tool between knots, in addition to that due to `damping`, m and rad.
    - `begin`: start of the first move [s].

    Raises DefinitionError, with move, time, position and reason, if the tool cannot follow or a joint exceeds a limit.
    """
    require_hold(hold)
    _require_numbers(damping, tolerance, begin)
    if not 1 <= len(moves) <= MOST_MOVES:
        raise DefinitionError(f"`moves` must be 1 to {MOST_MOVES} moves; got {len(moves)}", where="moves")
    n = robot.joints
    fastest = limit("follow", "velocity", velocity, n, robot.joint_names)
    strongest = limit("follow", "acceleration", acceleration, n, robot.joint_names)
    q = numbers("start", start, n)
    if pose is not None:
        q = inverse(robot, pose, start=q, hold=hold, posture=posture).q
    chain = kinematic_chain(robot)
    task = pose_task(chain, q if posture is None else numbers("posture", posture, n), hold, damping)
    here = Pose.of_tip(robot, q)
    z = _solve_start(task, here, q)
    paths: list[JointPath] = []
    ends: list[float] = []
    now = begin
    for number, move in enumerate(moves):
        with locate_errors(f"moves.{number}"):
            curve = move.timed_curve(here)
            try:
                path = joint_path(task, curve, z, tolerance)
            except PathEnd as caught:
                raise DefinitionError(path_end_message(task, curve, caught, now)) from None
            path = _with_duration(path, curve, fastest, strongest)
            require_within_range(chain, curve, path, now)
            require_within_rates(chain, path, fastest, strongest, now)
        paths.append(path)
        z, here = path.branch.z[-1], curve.end
        now += float(path.times[-1])
        ends.append(now)
    return _join_paths(task, paths, np.array(ends), begin)


def _require_numbers(damping: float, tolerance: float, begin: float) -> None:
    for field, value, rule, holds in (
        ("damping", damping, "in [0, 1]", 0 <= damping <= 1),
        ("tolerance", tolerance, "in [1e-9, 1e-2]", 1e-9 <= tolerance <= 1e-2),
        ("begin", begin, ">= 0 and finite", 0 <= begin < np.inf),
    ):
        if not holds:
            raise DefinitionError(f"`{field}` must be {rule}; got {value:g}", where=field)


def _solve_start(task: PoseTask, here: Pose, q: Array) -> Array:
    """Return posture and forces on the tool at the start of the path, nearest to the preferred posture [n + m]."""
    if (task.posture == q).all():
        return np.concatenate([q, np.zeros(HOLDS[task.hold])])
    z = move_to_posture(task, here, q, task.posture)
    if z is None:
        raise DefinitionError(
            "no posture near `posture` has the tool where the path begins: set a `posture` that is nearer to `start`"
        )
    return z


def _with_duration(path: JointPath, move: TimedCurve, fastest: Array, strongest: Array) -> JointPath:
    """Return the path; a move without `duration` and `speed` gets the shortest duration within the joint limits."""
    if not move.free:
        return path
    motion = Tabulated(times=as_array(path.times), coefficients=as_array(path.coefficients))
    v, a = motion.extremes(1).size, motion.extremes(2).size
    factor = max(float((v / fastest).max()), float(np.sqrt(a / strongest).max()))
    if not factor > 0:
        raise DefinitionError(
            "the move needs a `duration`, or `speed` and `acceleration`; or, for the shortest duration, set the joint "
            "limits `velocity` and `acceleration` of the path"
        )
    return path.stretched(factor)


def _join_paths(task: PoseTask, paths: list[JointPath], ends: Array, begin: float) -> ToolPath:
    starts = np.concatenate([[begin], ends[:-1]])
    times = np.concatenate([[begin], *(start + path.times[1:] for start, path in zip(starts, paths, strict=True))])
    coefficients = np.concatenate([path.coefficients for path in paths], axis=1)
    sizes = [least_motion(task, path.branch.z[:, : path.joints]) for path in paths]
    which = int(np.argmin([size.min() for size in sizes]))
    knot = int(np.argmin(sizes[which]))
    return ToolPath(
        trajectory=ToolMotion(times=as_array(times), coefficients=as_array(coefficients)),
        ends=ends,
        position_error=max(path.position_error for path in paths),
        rotation_error=max(path.rotation_error for path in paths),
        least_motion=float(sizes[which][knot]),
        worst_at=float(starts[which] + paths[which].times[knot]),
        hold=task.hold,
    )
