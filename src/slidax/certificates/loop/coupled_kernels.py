"""Responses of the coupled loop in size, along a time-varying K."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..each import Floats
from .adjoint import Along, Back, bunches, reached_back
from .kernels import ERROR, LED, MISSED, OUTPUTS, largest_within

MEMORIES = tuple(128 * k for k in range(1, 17))
"""Ages up to which responses are computed [periods]: the first with a sufficiently decayed state."""

LITTLE = 1e-6
"""Share of a state that may remain then."""

EVERY = 128
"""Samples between two checks of it."""

LUMPS = ((32, 4), (128, 8), (1 << 30, 16))
"""Lags up to which so many are grouped, with the largest input among them."""


def lumped(longest: int) -> list[range]:
    """Return groups of lags from one to `longest`."""
    groups, lag = [], 1
    for end, width in LUMPS:
        while lag <= min(end, longest):
            groups.append(range(lag, min(lag + width, longest + 1)))
            lag += width
    return groups


class CoupledKernels:
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

    def __init__(self, along: Along, count: int, memory: int) -> None:
        n, self.along, self.memory = along.joints, along, memory
        self.longest = memory + along.late
        self.lumps = lumped(self.longest)
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

    def take(self, back: Back) -> None:
        """Add the inputs at one sample before each decision."""
        age, n, late = back.age, self.along.joints, self.along.late
        sizes = (np.abs(back.reached) @ self._ones).max(axis=1)
        self._most[back.which] = np.maximum(self._most[back.which], sizes)
        if age == self.memory:
            self._left[back.which] = sizes
            self._weights[back.which] = np.abs(back.rows).sum(axis=2)
        by_q, by_v = (back.rows[..., state] for state in self._kicked)
        self._add(0, back, age + late + 1, largest_within(by_v, by_q))
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

    def _add(self, kind: int, back: Back, lag: int, sizes: Floats) -> None:
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
class Forgetting:
    """Decay of the coupled loop along a motion.

    - `memory`: periods after which any state has decayed; None if that takes too long.
    - `grown`: largest growth of one joint's error into another's, `apart` periods later, at sample `then`.
    """

    memory: int | None
    grown: float
    apart: int
    then: int


def forgetting(along: Along, samples: int) -> Forgetting:
    """Return the decay of the coupled loop.

    - `samples`: number of samples of the motion.
    """
    looked = np.arange(samples - 1, 0, -EVERY)[::-1]
    left = np.zeros(len(MEMORIES))
    error, placed = along.columns(0), along.led_to
    grown, apart, then = 0.0, 0, 0
    for which in bunches(looked):
        for age, samples_back, reached in reached_back(along, looked, which, MEMORIES[-1]):
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
    return Forgetting(min(fits) if fits else None, grown, apart, then)
