"""Impulse responses of single joints' loops, and their exact response to known disturbances."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.law.joint_loop import LinearLoop, LoopMaps

from ..sampled_scenario import Floats

STEP = 1.1
"""Largest ratio of two neighbouring κ: deviations in between count as a disturbance."""


def kappa_grid(kappa: Floats, step: float = STEP) -> tuple[Floats, Floats]:
    """Return some κ for each joint [n j], and the relative deviation of κ around each [n j].

    They divide the range evenly in its logarithm, so that each κ of it is within `1 ± spread` of one of them.

    - `kappa`: least and largest [2 n].
    - `step`: largest ratio of the ends of a cell.
    """
    low, high = np.log(np.asarray(kappa, float))
    count = max(1, math.ceil(float(np.max(high - low)) / math.log(step) - 1e-9))
    half = (high - low) / (2 * count)
    centres = low[:, None] + half[:, None] * (2 * np.arange(count) + 1)
    return np.exp(centres), np.broadcast_to(np.expm1(half)[:, None], centres.shape)


LED, ERROR, MISSED, SHIFT, SLIP, ACCELERATION, ESTIMATE, SPEED, LAPSE = range(9)
"""Outputs: ŷ; e when the torque starts; ω of `ŷ⁺ = (1 - r) ŷ + r (p + ω)`; y - ŷ; deviation of the velocity from the
plan; the joint's acceleration `κ (a + w*)`; the estimate ŵ; ė when the torque starts; its prediction error."""

OUTPUTS = 9

TINY = np.finfo(float).tiny

LENGTHS = (256, 512, 1024, 2048, 4096)
"""Lengths of impulse responses [periods]: the first with a sufficiently decayed state."""

LITTLE = 0.05
"""Share of a loop's state that may remain after one length."""


@dataclass(frozen=True)
class JointResponses:
    """Responses of the joints' loops, each for some κ; in units of periods. The last axis is the lag, in periods.

    - `of_disturbance`: largest effect on each output of an acceleration within [-1, 1] over one period, by the lag from
      the decision of that period's torque [9 n j L].
    - `of_place`: effect of p on each output, in size, by the lag from its decision; `of_change`: effect of a lasting
      change of p [9 n j L].
    - `disturbance_tail`, `place_tail`, `change_tail`: bounds of the effect beyond L, times the largest input, each
      faded by `fading` a period.
    - `fading`: of old inputs [n j].
    - `of_command`: sums of the sizes of the effect of a command error that the prediction shares [9 n j];
      `of_estimate`: of a step of ŵ that w* did not make.
    - `noise`: sums of the sizes of the effect of measurement noise [2 9 n j], position and velocity; `noise_square`: of
      their squares.
    """

    of_disturbance: Floats
    of_place: Floats
    of_change: Floats
    disturbance_tail: Floats
    place_tail: Floats
    change_tail: Floats
    fading: Floats
    of_command: Floats
    of_estimate: Floats
    noise: Floats
    noise_square: Floats

    @classmethod
    def of(cls, loops: Sequence[LinearLoop], kappas: Floats) -> JointResponses | None:
        """Responses of all joints; None if one loop is not stable.

        - `kappas`: κ [n j].
        """
        every = [[(loop, float(kappa)) for kappa in row] for loop, row in zip(loops, kappas, strict=True)]
        length = 0
        for row in every:
            for loop, kappa in row:
                length = max(length, _length(loop.maps(kappa).step))
        if length > LENGTHS[-1]:
            return None
        responses = [[_of_one(loop, kappa, length) for loop, kappa in row] for row in every]
        joined = {
            name: np.array([[response[name] for response in row] for row in responses]) for name in responses[0][0]
        }
        # The output goes first, then joint and κ.
        return cls(**{name: np.moveaxis(value, (0, 1), _places(name)) for name, value in joined.items()})


def _places(name: str) -> tuple[int, int]:
    return (0, 1) if name == "fading" else (2, 3) if name.startswith("noise") else (1, 2)


def _length(step: Floats) -> int:
    """Periods after which any state has decayed; more than the longest length if that takes longer."""
    for length in LENGTHS:
        left = np.max(np.sum(np.abs(np.linalg.matrix_power(step, length)), axis=1))
        if left < LITTLE:
            return length
    return LENGTHS[-1] + 1


def _of_one(loop: LinearLoop, kappa: float, length: int) -> dict[str, Floats]:
    maps = loop.maps(kappa)
    size, whole = maps.step.shape[0], int(loop.believed)
    steps = length + whole + 3
    kick_q, kick_v = np.eye(size)[0], np.eye(size)[1]
    place = maps.enters[:, 2]
    # Of p held from some time on, less where it leads in the end.
    held = -np.linalg.solve(np.eye(size) - maps.step, place)
    noise = [maps.enters[:, i] for i in range(2)]
    kick_estimate = np.eye(size)[-4]
    powers = np.empty((steps, size, 6))
    powers[0] = np.stack([kick_q, kick_v, place, *noise, kick_estimate], axis=1)
    for i in range(1, steps):
        powers[i] = maps.step @ powers[i - 1]
    # raw[row, k, source]: k periods after it came; at 0 what goes through at once.
    raw = np.concatenate([np.zeros((7, 1, 6)), np.einsum("rm,kms->rks", maps.outputs, powers)], axis=1)
    raw[:, 0, 2], raw[:, 0, 3], raw[:, 0, 4] = maps.direct[:, 2], maps.direct[:, 0], maps.direct[:, 1]

    shifted = np.arange(length) - whole
    by_q, by_v = (loop_outputs(raw[:, :, i], shifted, whole, loop, kappa) for i in range(2))
    placed = loop_outputs(raw[:, :, 2], np.arange(length), whole, loop, kappa)
    placed[MISSED, 0] -= 1.0
    jumped = loop_outputs(raw[:, 1:, 5], np.arange(length), whole, loop, kappa)
    noisy = np.arange(-whole - 1, length)
    by_noise = np.array([loop_outputs(raw[:, :, i], noisy, whole, loop, kappa) for i in (3, 4)])

    beyond = _Beyond(maps, loop, kappa, length)
    noise_tail = np.array([beyond(source, length) for source in noise])
    size_of_noise = np.sum(np.abs(by_noise), axis=2)
    return {
        "of_disturbance": largest_over_period(by_v, by_q),
        "of_place": np.abs(placed),
        "of_change": np.abs(np.cumsum(placed, axis=1)),
        "disturbance_tail": beyond(kick_v, length - whole) + beyond(kick_q, length - whole),
        "place_tail": beyond(place, length),
        "change_tail": beyond(held, length),
        "fading": np.asarray(max(beyond.left, 1e-300) ** (0.5 / length)),
        "of_estimate": np.sum(np.abs(jumped), axis=1) + beyond(kick_estimate, length),
        "of_command": loop.horizon**2 * _summed(placed, beyond(place, length)),
        "noise": size_of_noise + noise_tail,
        "noise_square": np.sum(by_noise**2, axis=2) + noise_tail**2,
    }


def _summed(placed: Floats, tail: Floats) -> Floats:
    """Effect of a command error of 1, which equals an error of p of H² without being a part of p [9]."""
    whole = placed.copy()
    whole[MISSED, 0] += 1.0
    return np.sum(np.abs(whole), axis=1) + tail


def loop_outputs(raw: Floats, at: NDArray[np.integer[Any]], whole: int, loop: LinearLoop, kappa: float) -> Floats:
    """Return the outputs [9 L ...] from a loop's rows [7 K ...], from sample 0 on; all rows before are zero.

    - `at`: numbers of the decisions [L]; the torque of each starts `whole` samples later.
    - `whole`: whole periods of delay.
    """
    lead, r = loop.horizon - 0.5, 1.0 / loop.horizon

    more = raw.shape[2:]

    def row(i: int, k: NDArray[np.integer[Any]]) -> Floats:
        return np.where((k >= 0).reshape(-1, *[1] * len(more)), raw[i, np.maximum(k, 0)], 0.0)

    led = row(2, at)
    outputs = np.empty((OUTPUTS, at.size, *more))
    outputs[LED] = led
    outputs[ERROR] = row(0, at + whole)
    outputs[MISSED] = (row(2, at + 1) - (1.0 - r) * led) / r
    outputs[SHIFT] = row(0, at + whole) + lead * row(1, at + whole) - led
    outputs[SLIP] = row(3, at + 1) - row(3, at) - row(5, at)
    outputs[ACCELERATION] = kappa * row(4, at)
    outputs[ESTIMATE] = row(6, at)
    outputs[SPEED] = row(1, at + whole)
    outputs[LAPSE] = outputs[SPEED] - row(3, at)
    return outputs


def largest_over_period(by_v: Floats, by_q: Floats) -> Floats:
    """`∫ |a + b (1 - t)| dt` over a period: a is the effect of a velocity step, b of a position step."""
    end = by_v + by_q
    sizes = np.abs(by_v) + np.abs(end)
    # Of what changes its sign within the period, a part of the trapezoid is taken away.
    crossed = np.minimum(by_v * end, 0.0)
    return 0.5 * sizes + crossed / np.maximum(sizes, TINY)


class _Beyond:
    """`Σ_{k >= K} |c step^k x| X_k` for each output's row c, from the share f of a state that remains after L periods.

    The sum of one length is S, that of the b-th after it at most `f^b S`. With `D = max X_k f^(k/2L)` the whole sum is
    at most `Σ_b f^b S f^(-b/2) D = S D/(1 - √f)`.
    """

    def __init__(self, maps: LoopMaps, loop: LinearLoop, kappa: float, length: int) -> None:
        step, outputs = maps.step, maps.outputs
        lead, r, whole = loop.horizon - 0.5, 1.0 / loop.horizon, int(loop.believed)
        later = np.linalg.matrix_power(step, whole)
        rows = np.empty((OUTPUTS, step.shape[0]))
        rows[LED] = outputs[2]
        rows[ERROR] = outputs[0] @ later
        rows[MISSED] = (outputs[2] @ step - (1.0 - r) * outputs[2]) / r
        rows[SHIFT] = (outputs[0] + lead * outputs[1]) @ later - outputs[2]
        rows[SLIP] = outputs[3] @ step - outputs[3] - outputs[5]
        rows[ACCELERATION] = kappa * outputs[4]
        rows[ESTIMATE] = outputs[6]
        rows[SPEED] = outputs[1] @ later
        rows[LAPSE] = rows[SPEED] - outputs[3]
        self.step, self.length = step, length
        self.weight = np.sum(np.abs(rows), axis=1)
        self.left = float(np.max(np.sum(np.abs(np.linalg.matrix_power(step, length)), axis=1)))

    def __call__(self, x: Floats, after: int) -> Floats:
        """The bound for each output [9].

        - `after`: K, periods from when the state is x; an early output counts from one less.
        """
        now = np.linalg.matrix_power(self.step, max(after - 2, 0)) @ x
        total = 0.0
        for _ in range(self.length):
            total += float(np.max(np.abs(now)))
            now = self.step @ now
        return self.weight * total / (1.0 - math.sqrt(self.left))


BLOCK = 16
"""Samples that are computed at once."""


@dataclass(frozen=True)
class LoopSignals:
    """Signals of a loop.

    - `outputs`: as of `kernels` [7 m N]; of the acceleration the commanded part `κ a`.
    - `least`, `most`: w* in the period after each torque starts [m N]; `change`: within it, or a part of it.
    """

    outputs: Floats
    least: Floats
    most: Floats
    change: Floats


def simulate_loop(
    loop: LinearLoop, kappa: float, disturbance: Floats, place: float, start: Floats, samples: int, quiet: int = 0
) -> LoopSignals:
    """Simulate a loop with disturbances and constant p.

    - `disturbance`: w* at each sample of the arm, linear in between [m K], K > N + delay + 2, units of periods.
    - `place`: p [rad or m].
    - `start`: the loop's state [s], or of each member [s m].
    - `samples`: N.
    - `quiet`: periods before the first disturbance.
    """
    maps, whole = loop.maps(kappa), int(loop.believed)
    members, steps = disturbance.shape[0], samples + whole + 2 - quiet
    blocks = -(-steps // BLOCK)
    padded = np.concatenate(
        [disturbance, np.repeat(disturbance[:, -1:], max(blocks * BLOCK + 1 - disturbance.shape[1], 0), axis=1)], axis=1
    )
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
        outputs[:, member] = loop_outputs(rows[:, :, member], at, whole, loop, kappa)
    outputs[MISSED] -= place
    first = whole - quiet
    knots = [padded[:, first + k : first + k + samples] for k in range(2 + (loop.believed % 1.0 > 0))]
    change = np.max([np.abs(later - now) for now, later in pairwise(knots)], axis=0)
    return LoopSignals(outputs, np.min(knots, axis=0), np.max(knots, axis=0), change)


def steady_states(loop: LinearLoop, disturbance: Floats) -> Floats:
    """Return the states [s m] of a loop at rest under constant disturbances [m]."""
    queue = _queue(loop)
    state = np.zeros((2 + queue + 6, disturbance.size))
    state[2 : 2 + queue] = -disturbance
    state[4 + queue] = disturbance
    return state


def initial_directions(loop: LinearLoop, follows: float, states: Floats) -> tuple[Floats, Floats]:
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
