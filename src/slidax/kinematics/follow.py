"""Joint motion that moves a tool along a path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from slidax._errors import DefinitionError, as_array, counted, located
from slidax.robots import AbstractRobot
from slidax.trajectories import Tabulated, ToolMotion
from slidax.trajectories.motion_limits import limit

from .branch import Stuck
from .chain import chain_of
from .inverse import inverse, liked_most, require_hold, task_of
from .joint_path import JointPath, joint_path
from .moves import AbstractMove, Bound
from .pose import Pose, numbers
from .refusal import beyond_limits, stuck, too_fast
from .series import Array
from .task import HOLDS, Hold, Task, least_motion

MOST_MOVES = 1000
"""Of one path."""


@dataclass(frozen=True, eq=False)
class Followed:
    """A joint motion that moves the tool along a path.

    - `trajectory`: quintics in time, continuous to the acceleration, at rest before and after.
    - `ends`: end of each move [moves], s.
    - `place_error`, `turn_error`: largest errors of the tool at the knots and at five times between any two, m and rad.
    - `least_motion`: least singular value of the Jacobian at all knots, m or rad per rad or m of the joints; 0 at a
      singularity.
    - `worst_at`: time of that value [s].
    - `hold`: the held coordinates of the tool.
    """

    trajectory: ToolMotion
    ends: Array
    place_error: float
    turn_error: float
    least_motion: float
    worst_at: float
    hold: Hold

    def __str__(self) -> str:
        turn = "" if self.hold == "place" else f" and {self.turn_error:.1e} rad"
        return (
            f"{counted(len(self.ends), 'move')}, {float(self.trajectory.until):.4g} s, "
            f"{counted(self.trajectory.times.size - 1, 'quintic')}; "
            f"the tool is within {self.place_error:.1e} m{turn}; it is nearest to a singularity at "
            f"t = {self.worst_at:.4g} s, where it moves by {self.least_motion:.3g} in its worst direction"
        )


def follow(
    robot: AbstractRobot,
    moves: Sequence[AbstractMove],
    *,
    start: object,
    pose: Pose | None = None,
    hold: Hold = "pose",
    posture: object = None,
    velocity: object = np.inf,
    acceleration: object = np.inf,
    damping: float = 0.0,
    tolerance: float = 1e-6,
    begin: float = 0.0,
) -> Followed:
    """Return the joint motion for a path of the tool.

    At each point the posture has the tool at its target and is nearest to a preferred posture, with each joint scaled
    by its range. This posture is a smooth function of the tool's pose, so a closed path of the tool is also a closed
    path of the joints. Its derivatives are exact. Between knots quintics interpolate positions, velocities and
    accelerations; pieces are halved until the tool's error is within the tolerance. The result is deterministic.

    - `robot`: the nominal arm.
    - `start`: posture at the start [n], rad or m.
    - `pose`: start of the path, if it is not the tool's pose at `start`; the search for it begins at `start`.
    - `hold`: "place", "axis" (position, and direction of the tool's z axis) or "pose".
    - `posture`: preferred posture of a redundant arm [n]; the start by default.
    - `velocity`, `acceleration`: joint limits, [n] or one number, rad/s and rad/s², or m/s and m/s². A move without a
      time takes the shortest that they allow.
    - `damping`: pose error accepted near a singularity, m or rad per unit of force; 0 for none.
    - `tolerance`: largest error of the tool between knots, in addition to that by `damping`, m and rad.
    - `begin`: start of the first move [s].

    Raises DefinitionError, with move, time, position and reason, if the tool cannot follow or a joint passes a limit.
    """
    require_hold(hold)
    _require_numbers(damping, tolerance, begin)
    if not 1 <= len(moves) <= MOST_MOVES:
        raise DefinitionError(f"`moves` must be 1 to {MOST_MOVES}; got {len(moves)}", where="moves")
    n = robot.joints
    fastest = limit("follow", "velocity", velocity, n, robot.joint_names)
    strongest = limit("follow", "acceleration", acceleration, n, robot.joint_names)
    q = numbers("start", start, n)
    if pose is not None:
        q = inverse(robot, pose, start=q, hold=hold, posture=posture).q
    chain = chain_of(robot)
    task = task_of(chain, q if posture is None else numbers("posture", posture, n), hold, damping)
    here = Pose.of_tip(robot, q)
    z = _begun(task, here, q)
    paths: list[JointPath] = []
    ends: list[float] = []
    now = begin
    for number, move in enumerate(moves):
        with located(f"moves.{number}"):
            bound = move.bound(here)
            try:
                path = joint_path(task, bound, z, tolerance)
            except Stuck as caught:
                raise DefinitionError(stuck(task, bound, caught, now)) from None
            path = _paced(path, bound, fastest, strongest)
            beyond_limits(chain, bound, path, now)
            too_fast(chain, path, fastest, strongest, now)
        paths.append(path)
        z, here = path.branch.z[-1], bound.end
        now += float(path.times[-1])
        ends.append(now)
    return _joined(task, paths, np.array(ends), begin)


def _require_numbers(damping: float, tolerance: float, begin: float) -> None:
    for field, value, rule, holds in (
        ("damping", damping, "in [0, 1]", 0 <= damping <= 1),
        ("tolerance", tolerance, "in [1e-9, 1e-2]", 1e-9 <= tolerance <= 1e-2),
        ("begin", begin, ">= 0 and finite", 0 <= begin < np.inf),
    ):
        if not holds:
            raise DefinitionError(f"`{field}` must be {rule}; got {value:g}", where=field)


def _begun(task: Task, here: Pose, q: Array) -> Array:
    """Posture and forces at the start, nearest to the preferred posture."""
    if (task.posture == q).all():
        return np.concatenate([q, np.zeros(HOLDS[task.hold])])
    z = liked_most(task, here, q, task.posture)
    if z is None:
        raise DefinitionError(
            "no posture near `posture` has the tool where the path begins: give one that is nearer to `start`"
        )
    return z


def _paced(path: JointPath, move: Bound, fastest: Array, strongest: Array) -> JointPath:
    """Give a move without a time the shortest duration within the joint limits."""
    if not move.free:
        return path
    motion = Tabulated(times=as_array(path.times), coefficients=as_array(path.coefficients))
    v, a = motion.extremes(1).size, motion.extremes(2).size
    factor = max(float((v / fastest).max()), float(np.sqrt(a / strongest).max()))
    if not factor > 0:
        raise DefinitionError(
            "needs a `duration`, or `speed` and `acceleration`; or give limits of the joints, `velocity` and "
            "`acceleration`, by which the shortest time is found"
        )
    return path.stretched(factor)


def _joined(task: Task, paths: list[JointPath], ends: Array, begin: float) -> Followed:
    starts = np.concatenate([[begin], ends[:-1]])
    times = np.concatenate([[begin], *(start + path.times[1:] for start, path in zip(starts, paths, strict=True))])
    coefficients = np.concatenate([path.coefficients for path in paths], axis=1)
    sizes = [least_motion(task, path.branch.z[:, : path.joints]) for path in paths]
    which = int(np.argmin([size.min() for size in sizes]))
    knot = int(np.argmin(sizes[which]))
    return Followed(
        trajectory=ToolMotion(times=as_array(times), coefficients=as_array(coefficients)),
        ends=ends,
        place_error=max(path.place_error for path in paths),
        turn_error=max(path.turn_error for path in paths),
        least_motion=float(sizes[which][knot]),
        worst_at=float(starts[which] + paths[which].times[knot]),
        hold=task.hold,
    )
