"""Reasons why a tool cannot follow its path: position, cause and remedy."""

from __future__ import annotations

import numpy as np

from slidax._errors import DefinitionError, as_array
from slidax.trajectories import Tabulated

from .branch import Stuck
from .chain import Chain
from .inverse import at_pose
from .joint_path import JointPath
from .moves import Bound
from .series import Array
from .task import Task, jacobian, ways

NEAR_SINGULAR = 0.02
"""Least singular value of the Jacobian below which a posture is near a singularity."""

NEAR_LIMIT = 0.01
"""Distance from a limit, as a part of the range, within which the limit stops a redundant arm's joint."""

CHECKED_TIMES = 40
"""Times in a piece at which the joint limits are checked."""


def stuck(task: Task, move: Bound, caught: Stuck, now: float) -> str:
    """Return the message for a branch of postures that ends.

    - `now`: start of the move [s].
    """
    n = task.posture.size
    q = caught.z[:n]
    sizes = np.linalg.svd(jacobian(task, q))
    rank = ways(task)
    weak = sizes[0][:, rank - 1]
    held = _near_limits(task.chain, q)
    end = _can_reach_end(task, move, q)
    if float(sizes[1][rank - 1]) < NEAR_SINGULAR:
        why = f"{_stretched(task, move, weak)}; keep away from it, or give up a little of the pose there with `damping`"
    elif held:
        why = f"{' and '.join(held)}; begin in another posture, or give another `posture`"
    else:
        why = "its postures end there; begin in another posture, or ask less of the tool with `hold`"
    return f"the tool cannot follow {_place(move, caught.s, now)}: {why}{end}"


def beyond_limits(chain: Chain, move: Bound, path: JointPath, now: float) -> None:
    """Raise DefinitionError if a joint passes its position limit, with the first time and position."""
    motion = Tabulated(times=as_array(path.times), coefficients=as_array(path.coefficients))
    reach, lower, upper = motion.extremes(0), chain.lower, chain.upper
    room = 1e-9
    if not ((reach.least < lower - room) | (reach.largest > upper + room)).any():
        return
    width = np.diff(path.times)
    times = (path.times[:-1, None] + width[:, None] * np.linspace(0.0, 1.0, CHECKED_TIMES)).ravel()
    coefficients = path.coefficients
    x = (width[:, None] * np.linspace(0.0, 1.0, CHECKED_TIMES))[:, :, None]
    sampled = np.zeros((len(width), CHECKED_TIMES, path.joints))
    for power in coefficients:
        sampled = sampled * x + power[:, None, :]
    q = sampled.reshape(-1, path.joints)
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
        f"{chain.names[joint]} is at its limit of {bound:.4g} {_place(move, s, now + t, t)}, and would go to "
        f"{extreme:.4g}: begin in another posture, or move the path"
    )


def too_fast(chain: Chain, path: JointPath, fastest: Array, strongest: Array, now: float) -> None:
    """Raise DefinitionError if a joint exceeds its velocity or acceleration limit, with the duration that it needs.

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


def _place(move: Bound, s: float, now: float, into: float | None = None) -> str:
    """Time and position of a point on a move."""
    _, place = move.curve.at(s)
    where = ", ".join(f"{x:.4g}" for x in np.asarray(place))
    if into is None:
        law = move.law
        t = np.linspace(law.times[0], law.times[-1], 2001)
        when = now + float(t[int(np.searchsorted(law.at(t)[0], s - 1e-12).clip(0, 2000))])
        time = "" if move.free else f"t = {when:.4g} s, "
        return f"beyond {time}{s * move.length:.4g} {move.unit} along this move, with the tip at [{where}] m"
    return f"at t = {now:.4g} s, {s * move.length:.4g} {move.unit} along this move, with the tip at [{where}] m"


def _stretched(task: Task, move: Bound, weak: Array) -> str:
    """Describe a singularity by the direction in which the tool cannot move."""
    moved, turned = np.linalg.norm(weak[:3]), np.linalg.norm(weak[3:])
    direction = weak[:3] if moved >= turned else weak[3:]
    direction = direction / np.linalg.norm(direction)
    way = ", ".join(f"{x:.2f}" for x in direction)
    if moved >= turned:
        return f"a singularity, where the tip cannot move along [{way}]: there the arm is stretched out or folded"
    return f"a singularity, where the tool cannot turn about [{way}]: there two axes are in line"


def _near_limits(chain: Chain, q: Array) -> list[str]:
    lower, upper = chain.lower, chain.upper
    messages = []
    for joint, name in enumerate(chain.names):
        span = upper[joint] - lower[joint]
        for side, bound in (("lower", lower[joint]), ("upper", upper[joint])):
            if np.isfinite(span) and abs(q[joint] - bound) < NEAR_LIMIT * span:
                messages.append(f"{name} is at its {side} limit of {bound:.4g}")
    return messages


def _can_reach_end(task: Task, move: Bound, q: Array) -> str:
    """State if the arm has a posture for the end of the move."""
    try:
        at_pose(task.chain, move.end, np.clip(q, task.chain.lower, task.chain.upper), q, task.hold)
    except DefinitionError as error:
        return f". The end of the move is out of reach, too: {error.message}"
    return ". The end of the move can be reached, but not along it from here"
