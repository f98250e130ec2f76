"""Responses of the coupled loop along the motion, and its outputs for known disturbances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from slidax.law.joint_loop import LinearLoop

from ..sampled_scenario import Floats
from .coupled_loop import AdjointResponse, LoopsAlongMotion, decision_batches, state_transitions
from .joint_responses import (
    ACCELERATION,
    ERROR,
    ESTIMATE,
    LED,
    MISSED,
    OUTPUTS,
    initial_directions,
    largest_over_period,
)

MEMORIES = tuple(128 * k for k in range(1, 17))
"""Ages up to which responses are computed [periods]: the first with a sufficiently decayed state."""

LITTLE = 1e-6
"""Share of a state that may remain then."""

EVERY = 128
"""Samples between two checks of it."""

LUMPS = ((32, 4), (128, 8), (1 << 30, 16))
"""Lags up to which so many are grouped, with the largest input among them."""


def lag_groups(longest: int) -> list[range]:
    """Return groups of lags from one to `longest`."""
    groups, lag = [], 1
    for end, width in LUMPS:
        while lag <= min(end, longest):
            groups.append(range(lag, min(lag + width, longest + 1)))
            lag += width
    return groups


class CoupledResponses:
    """Responses of the coupled loop from each joint (last axis) to outputs of some decisions; units of periods.

    The outputs are those of `kernels`, but that of the acceleration is `a + w*` without K.

    - `newest`: immediate effect of disturbances, targets and changes of target [3 Z 9n n].
    - `older`: their effect from one period later on, in groups of lags [3 Z B 9n n].
    - `tails`: bound of the effect of older inputs, times their largest [Z 9n n].
    - `of_command`, `of_estimate`: sums of sizes, as in `Kernels` [Z 9n n].
    - `noise`, `noise_square`: the same for noise of position and velocity, and for squares [2 Z 9n n].

    - `along`, `decisions`: the loops and outputs.
    - `memory`: from `forgetting`.
    """

    def __init__(self, along: LoopsAlongMotion, count: int, memory: int) -> None:
        n, self.along, self.memory = along.joints, along, memory
        self.longest = memory + along.late
        self.lumps = lag_groups(self.longest)
        self._lump = np.full(self.longest + 1, -1)
        for k, lags in enumerate(self.lumps):
            self._lump[list(lags)] = k
        shape = (count, OUTPUTS * n, n)
        self.newest = np.zeros((3, *shape))
        self.older = np.zeros((3, count, len(self.lumps), *shape[1:]))
        self.of_command, self.of_estimate = np.zeros((2, *shape))
        self.noise, self.noise_square = np.zeros((2, 2, *shape))
        *self._kicked, self._estimate = (along.places(k) for k in (0, 1, along.own - 4))
        self._led_to, self._ones = along.led_to, np.ones(along.states)
        self._noisy = along.noisy
        self._most, self._left = np.ones(count), np.zeros(count)
        self._weights = np.zeros((count, OUTPUTS * n))
        leads = np.zeros((OUTPUTS, n, n))
        leads[[LED, ERROR]] = np.eye(n)
        self._leads = leads.reshape(-1, n)

    def take(self, back: AdjointResponse) -> None:
        """Add the inputs at one sample before each decision."""
        age, n, late = back.age, self.along.joints, self.along.late
        sizes = (np.abs(back.reached) @ self._ones).max(axis=1)
        self._most[back.which] = np.maximum(self._most[back.which], sizes)
        if age == self.memory:
            self._left[back.which] = sizes
            self._weights[back.which] = np.abs(back.rows).sum(axis=2)
        by_q, by_v = (back.rows[..., state] for state in self._kicked)
        self._add(0, back, age + late + 1, largest_over_period(by_v, by_q))
        placed = back.entering(2)
        place = placed.copy()
        if age == -1:
            place[:, MISSED * n + np.arange(n), np.arange(n)] -= 1.0
        self._add(1, back, age + 1, np.abs(place))
        self._add(2, back, age, np.abs(self._leads - back.rows @ self._led_to))
        for source in self._noisy:
            noisy = back.entering(source)
            self.noise[source, back.which] += np.abs(noisy)
            self.noise_square[source, back.which] += noisy**2
        if age >= -1:
            self.of_command[back.which] += np.abs(placed)
        if age >= 0:
            self.of_estimate[back.which] += np.abs(back.rows[..., self._estimate])

    def _add(self, kind: int, back: AdjointResponse, lag: int, sizes: Floats) -> None:
        if lag == 0:
            self.newest[kind, back.which] = sizes
        elif 0 < lag <= self.longest:
            self.older[kind, back.which, self._lump[lag]] += sizes

    def finish(self) -> None:
        """Bound older inputs: `Σ |R Φ_1 Φ_2 ... x|`, each Φ over one memory with remainder f, at most m within one."""
        (here,) = self.along.step(np.zeros(1, int))
        power, most, left = np.eye(len(here)), float(self._most.max()), float(self._left.max())
        for _ in range(int(np.ceil(self.along.ahead)) + 64):
            power = power @ here
            most = max(most, float(np.abs(power).sum(axis=1).max()))
        self.left = left
        self.later = self._weights * most
        total = self.later * self.memory / (1.0 - left)
        n = self.along.joints
        self.tails = np.repeat(total[:, :, None], n, axis=2)
        reach = self.along.reach
        self.of_command = self.along.loop.horizon**2 * (self.of_command + reach * self.tails)
        self.of_estimate += self.tails
        self.noise += reach * self.tails
        self.noise_square += (reach * self.tails) ** 2
        self.tails = max(1.0, reach) * self.tails


@dataclass(frozen=True)
class LoopMemory:
    """Decay of the coupled loop along a motion.

    - `memory`: periods after which any state has decayed; None if that takes too long.
    - `grown`: largest growth of one joint's error into another's, `apart` periods later, at sample `then`.
    """

    memory: int | None
    grown: float
    apart: int
    then: int


def loop_memory(along: LoopsAlongMotion, samples: int) -> LoopMemory:
    """Return the decay of the coupled loop.

    - `samples`: number of samples of the motion.
    """
    looked = np.arange(samples - 1, 0, -EVERY)[::-1]
    left = np.zeros(len(MEMORIES))
    error, placed = along.columns(0), along.led_to
    grown, apart, then = 0.0, 0, 0
    for which in decision_batches(looked):
        for age, samples_back, reached in state_transitions(along, looked, which, MEMORIES[-1]):
            if age < MEMORIES[0]:
                continue
            sizes = np.abs(error.T @ reached @ placed).max(axis=(1, 2))
            k = int(np.argmax(sizes))
            if sizes[k] > grown:
                grown, apart, then = float(sizes[k]), age, int(samples_back[k]) + age
            if age in MEMORIES:
                number, size = MEMORIES.index(age), float(np.abs(reached).sum(axis=2).max())
                left[number] = max(left[number], size)
                # A response this small cannot become the largest one later.
                if size < min(LITTLE, grown):
                    break
    fits = [memory for memory, rest in zip(MEMORIES, left, strict=True) if rest < LITTLE]
    return LoopMemory(min(fits) if fits else None, grown, apart, then)


def initial_columns(
    along: LoopsAlongMotion, loops: Sequence[LinearLoop], follows: Floats, states: Floats
) -> tuple[Floats, Floats]:
    """Return the possible initial states as columns [S m], and their remainder when a p is held.

    - `follows`: θ [n]; the held p is that of ŷ there.
    - `states`: as in `Entry` [m 8 + Q n].
    """
    n, columns, less = along.joints, [], []
    (rows,), led_to = along.at(np.zeros(1, int)).rows, along.led_to
    for j, loop in enumerate(loops):
        basis, reach = initial_directions(loop, float(follows[j]), states[:, :, j])
        whole = np.zeros((n, along.own, basis.shape[1]))
        whole[j] = basis * reach
        column = whole.reshape(n * along.own, -1)[along.kept][:, reach > 0.0]
        columns.append(column)
        less.append(column - np.outer(led_to[:, j], follows[j] * (rows[2, j] @ column)))
    return np.concatenate(columns, axis=1), np.concatenate(less, axis=1)


class KnownOutputs:
    """Known outputs of each decision and of its neighbours.

    - `responses`: of the disturbances, from rest [Z W 9n M].
    - `free`, `held`: size of the initial states' effect, without p and with the first p held [Z W 9n].

    - `along`, `decisions`: the loops and outputs; `width`: W, samples, of which the middle one is carried back.
    - `disturbances`: w* at the arm's samples, linear in between [M T n], units of periods.
    - `starts`: from `beginnings`.
    - `memory`: largest age.
    """

    def __init__(
        self,
        along: LoopsAlongMotion,
        decisions: NDArray[np.integer[Any]],
        width: int,
        disturbances: Floats,
        starts: tuple[Floats, Floats],
        memory: int,
    ) -> None:
        self.along, self.decisions, self.memory = along, decisions, memory
        self.offsets = np.arange(width) - width // 2
        self.disturbances, self.starts = np.moveaxis(disturbances, 0, -1), starts
        # Time is the last axis. The initial states contain everything before the first sample.
        lasting = np.moveaxis(disturbances, 1, -1).swapaxes(0, 1)
        before = np.zeros((*lasting.shape[:2], memory + 2 * width))
        after = np.repeat(lasting[..., -1:], decisions[-1] + width, axis=-1)
        self._before = before.shape[-1]
        self._now = np.concatenate([before, lasting, after], axis=-1)
        self._then = np.concatenate([before, lasting[..., 1:], after], axis=-1)
        count, outputs = len(decisions), OUTPUTS * along.joints
        self._answers = np.zeros((count, outputs, width * len(disturbances)))
        self.free, self.held = np.zeros((2, count, width, outputs))
        self._resting = along.resting

    @property
    def responses(self) -> Floats:
        """As above."""
        count, outputs, _ = self._answers.shape
        return self._answers.reshape(count, outputs, -1, self.offsets.size).transpose(0, 3, 1, 2)

    def take(self, back: AdjointResponse) -> None:
        """Add the inputs at one sample before each decision."""
        if back.age < self.memory:
            answers = np.concatenate([back.entering(3), back.entering(4)], axis=2)
            disturbances_there = [
                self._around(disturbances, back.samples - 1) for disturbances in (self._now, self._then)
            ]
            self._answers[back.which] += answers @ np.concatenate(disturbances_there, axis=1)
            self._begun(back)
        else:
            rests = back.rows @ self._resting
            self._answers[back.which] += rests @ self._around(self._now, back.samples)

    def _around(self, disturbances: Floats, samples: NDArray[np.integer[Any]]) -> Floats:
        """The disturbances around some samples [Z n M W]."""
        windows = sliding_window_view(disturbances, self.offsets.size, axis=-1)
        around = windows[:, :, self._before + samples + self.offsets[0]]
        return np.moveaxis(around, 2, 0).reshape(len(samples), self.along.joints, -1)

    def _begun(self, back: AdjointResponse) -> None:
        """Add the initial states for decisions whose state is at the first sample."""
        if back.samples[0] > self.offsets.size:
            return
        w = -back.samples - self.offsets[0]
        for k in np.flatnonzero((w >= 0) & (w < self.offsets.size)):
            at, rows = back.which.start + k, back.rows[k]
            self._answers[at].reshape(len(rows), -1, self.offsets.size)[..., w[k]] += (
                rows @ self._resting @ self.disturbances[0]
            )
            self.free[at, w[k]], self.held[at, w[k]] = (np.abs(rows @ columns).sum(axis=1) for columns in self.starts)

    def finish(self, later: Floats) -> None:
        """Bound the effect of inputs beyond the largest age.

        - `later`: bound of the remaining effect of a state of that age [Z 9n].
        """
        sizes = [float(np.abs(columns).sum(axis=1).max(initial=0.0)) for columns in self.starts]
        old = (self.decisions[:, None] + self.offsets) >= self.memory
        for into, size in zip((self.free, self.held), sizes, strict=True):
            into += np.where(old[..., None], size * later[:, None], 0.0)

    def told(self, count: int, corners: int, late: int, part: bool) -> tuple[Floats, Floats]:
        """Return the effect of a set's disturbances, below and above zero [N 2 9 n], and their bend of e [N n]."""
        n = self.along.joints
        answers = self.responses.reshape(-1, OUTPUTS, n, self.disturbances.shape[2])[:count]
        last = self.disturbances.shape[0] - 1
        # When the torque of a decision sets in, and until the next does.
        at = np.arange(count) + late
        knots = np.array([self.disturbances[np.minimum(at + k, last)] for k in range(2 + part)])
        answers[:, ESTIMATE] -= knots[0]
        corner, effect = answers[..., :corners], answers[..., corners:]
        moves, adds = knots[..., :corners], knots[..., corners:]
        more = np.abs(effect)
        more[:, ACCELERATION] = np.max(np.abs(effect[:, ACCELERATION] + adds), axis=0)
        above, below = corner.copy(), -corner
        above[:, ACCELERATION] += moves.max(axis=0)
        below[:, ACCELERATION] -= moves.min(axis=0)
        sizes = np.stack([below.max(axis=-1), above.max(axis=-1)], axis=1) + more.sum(axis=-1)[:, None]
        matrix = np.abs(self.along.matrices[np.minimum(at, len(self.along.matrices) - 1)])
        turned = np.abs(np.diff(knots, axis=0)).max(axis=0)
        widest = turned[..., :corners].max(axis=-1) + turned[..., corners:].sum(axis=-1)
        return sizes, np.einsum("kij,kj->ki", matrix, widest)
