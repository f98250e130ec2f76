"""Exact response of a joint's loop to known disturbances, in blocks of samples."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from slidax.diagnosis.linear_loop import LinearLoop, LoopMaps

from ..each import Floats
from .kernels import MISSED, OUTPUTS, outputs_of

BLOCK = 16
"""Samples that are computed at once."""


@dataclass(frozen=True)
class Followed:
    """Signals of a loop.

    - `outputs`: as of `kernels` [7 m N]; of the acceleration the commanded part `κ a`.
    - `least`, `most`: w* in the period after each torque starts [m N]; `change`: within it, or a part of it.
    """

    outputs: Floats
    least: Floats
    most: Floats
    change: Floats


def followed(
    loop: LinearLoop, kappa: float, push: Floats, place: float, start: Floats, samples: int, quiet: int = 0
) -> Followed:
    """Simulate a loop with disturbances and constant p.

    - `push`: w* at each sample of the arm, linear in between [m K], K > N + delay + 2, units of periods.
    - `place`: p [rad or m].
    - `start`: the loop's state [s], or of each member [s m].
    - `samples`: N.
    - `quiet`: periods before the first disturbance.
    """
    maps, whole = loop.maps(kappa), int(loop.believed)
    members, steps = push.shape[0], samples + whole + 2 - quiet
    blocks = -(-steps // BLOCK)
    padded = np.concatenate([push, np.repeat(push[:, -1:], max(blocks * BLOCK + 1 - push.shape[1], 0), axis=1)], axis=1)
    lifted = _Lifted(maps, kappa)
    state = np.repeat(start[:, None], members, axis=1) if start.ndim == 1 else start
    rows = np.empty((7, quiet + blocks * BLOCK, members))
    held = np.zeros((5, members))
    held[2] = place
    for k in range(quiet):
        rows[:, k] = maps.outputs @ state + maps.direct @ held
        state = maps.step @ state + maps.enters @ held
    for i in range(blocks):
        inputs = np.concatenate([state, padded[:, i * BLOCK : (i + 1) * BLOCK + 1].T, np.full((1, members), place)])
        rows[:, quiet + i * BLOCK : quiet + (i + 1) * BLOCK] = (lifted.outputs @ inputs).reshape(7, BLOCK, members)
        state = lifted.state @ inputs
    at = np.arange(samples)
    outputs = np.empty((OUTPUTS, members, samples))
    for member in range(members):
        outputs[:, member] = outputs_of(rows[:, :, member], at, whole, loop, kappa)
    outputs[MISSED] -= place
    first = whole - quiet
    knots = [padded[:, first + k : first + k + samples] for k in range(2 + (loop.believed % 1.0 > 0))]
    change = np.max([np.abs(later - now) for now, later in pairwise(knots)], axis=0)
    return Followed(outputs, np.min(knots, axis=0), np.max(knots, axis=0), change)


def steady(loop: LinearLoop, push: Floats) -> Floats:
    """Return the states [s m] of a loop at rest under constant disturbances [m]."""
    queue = _queue(loop)
    state = np.zeros((2 + queue + 6, push.size))
    state[2 : 2 + queue] = -push
    state[4 + queue] = push
    return state


def entries(loop: LinearLoop, follows: float, states: Floats) -> tuple[Floats, Floats]:
    """Return directions of a loop's state at a decision [s 8 + Q], and the reach of some states in each [8 + Q].

    The directions: e with the ė at which a plan for `p = θ ŷ` commands no acceleration; ė; the planned effect `a + ŵ`
    of each pending command, the newest first; the prediction errors of e and ė; `ŵ - w*` and ŵ's rate; the deviation of
    the last measurement from e and ė.

    - `follows`: θ.
    - `states`: as in `Entry` [m 8 + Q].
    """
    queue = _queue(loop)
    drift = -(1.0 - follows) / (loop.horizon + (loop.horizon - 0.5) * (1.0 - follows))
    basis = np.eye(2 + queue + 6)
    basis[2 + queue, 0] = basis[3 + queue, 1] = 1.0
    basis[2 : 2 + queue, 4 + queue] = -1.0
    if loop.measures_velocity and loop.follows is not None:
        basis[-2, 0] = basis[-1, 1] = 1.0
        basis[-2, 1] = -1.0
    else:
        basis[-2:] = 0.0
    basis[:, 0] += drift * basis[:, 1]
    reach = states.copy()
    reach[:, 1] -= drift * reach[:, 0]
    return basis, np.max(np.abs(reach), axis=0)


def _queue(loop: LinearLoop) -> int:
    return max(1, math.ceil(loop.believed))


class _Lifted:
    """A block of samples as one map, from the state, w* at its samples and its end, and p."""

    def __init__(self, maps: LoopMaps, kappa: float) -> None:
        size = maps.step.shape[0]
        width = size + BLOCK + 2
        state = np.zeros((size, width))
        state[:, :size] = np.eye(size)
        rows = []
        for k in range(BLOCK):
            inputs = np.zeros((5, width))
            inputs[2, -1] = 1.0
            inputs[3, size + k] = kappa
            inputs[4, size + k + 1] = kappa
            rows.append(maps.outputs @ state + maps.direct @ inputs)
            state = maps.step @ state + maps.enters @ inputs
        self.outputs = np.stack(rows, axis=1).reshape(7 * BLOCK, width)
        self.state = state
