"""How much of what comes into the loops of all joints arrives where, along a K that moves: responses in size."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .adjoint import Along, Back, carried_back
from .kernels import ERROR, LED, MISSED, OUTPUTS, largest_within

Floats = NDArray[np.floating[Any]]

MEMORIES = tuple(128 * k for k in range(1, 17))
"""Ages up to which responses are told [periods]: the first after which little is left."""

LITTLE = 1e-6
"""Of a state, after that."""

EVERY = 128
"""Samples from one at which it is looked at to the next."""

LUMPS = ((32, 4), (128, 8), (1 << 30, 16))
"""Up to which lag so many are taken together, with the largest of what came in at them."""


def lumped(longest: int) -> list[range]:
    """Lags from one on, those together that are taken together.

    - `longest`: the last.
    """
    found, lag = [], 1
    for end, width in LUMPS:
        while lag <= min(end, longest):
            found.append(range(lag, min(lag + width, longest + 1)))
            lag += width
    return found


class CoupledKernels:
    """Of all loops, for outputs of some decisions; units of periods. From the last axis's joint to each output.

    The outputs are those of `kernels`, but that of the acceleration is `a + w*` without K.

    - `newest`: what pushes, places and changes of place do at once [3 Z 9n n].
    - `older`: what they do from one period later on, lags together as of `lumped` [3 Z B 9n n].
    - `tails`: what is older than these does at most, times the largest that came in [Z 9n n].
    - `of_command`, `of_estimate`: sums of sizes, as in `Kernels` [Z 9n n].
    - `noise`, `noise_square`: the same of noise of position and velocity, and of squares [2 Z 9n n].

    - `along`, `decisions`: of which loops and outputs.
    - `memory`: from `memory_of`.
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
        self._kicked = [along.columns(k) for k in (0, 1)]
        self._estimate, self._led_to = along.columns(along.own - 4), along.led_to
        self._most, self._left, self._weights = 1.0, 0.0, np.zeros((count, OUTPUTS * n))
        leads = np.zeros((OUTPUTS, n, n))
        leads[[LED, ERROR]] = np.eye(n)
        self._leads = leads.reshape(-1, n)

    def take(self, back: Back) -> None:
        """What comes in at one sample.

        - `back`: the outputs as of its state.
        """
        ages, n, late = back.ages, self.along.joints, self.along.late
        size = np.abs(back.reached).sum(axis=2).max(axis=1)
        self._most = max(self._most, float(size.max()))
        cut = np.flatnonzero(ages == self.memory)
        if cut.size:
            self._left = max(self._left, float(size[cut].max()))
            self._weights[back.which.start + cut] = np.abs(back.rows[cut]).sum(axis=2)
        by_q, by_v = (back.rows @ one for one in self._kicked)
        self._add(0, back, ages + late + 1, largest_within(by_v, by_q))
        placed = back.entering(2)
        place = placed.copy()
        newest = np.flatnonzero(ages == -1)
        place[newest[:, None], MISSED * n + np.arange(n), np.arange(n)] -= 1.0
        self._add(1, back, ages + 1, np.abs(place))
        self._add(2, back, ages, np.abs(self._leads - back.rows @ self._led_to))
        for source in (0, 1):
            noisy = back.entering(source)
            self.noise[source, back.which] += np.abs(noisy)
            self.noise_square[source, back.which] += noisy**2
        decided = np.flatnonzero(ages >= -1)
        self.of_command[back.which][decided] += self.along.loop.horizon**2 * np.abs(placed[decided])
        known = np.flatnonzero(ages >= 0)
        self.of_estimate[back.which][known] += np.abs(back.rows[known] @ self._estimate)

    def _add(self, kind: int, back: Back, lags: NDArray[np.integer[Any]], sizes: Floats) -> None:
        first = back.which.start
        at = np.flatnonzero(lags == 0)
        self.newest[kind, first + at] = sizes[at]
        at = np.flatnonzero((lags > 0) & (lags <= self.longest))
        self.older[kind, first + at, self._lump[lags[at]]] += sizes[at]

    def finish(self) -> None:
        """What is older: `Σ |R Φ_1 Φ_2 ... x|`, each Φ over one memory, of which f is left; within one at most m."""
        here = self.along.at(0).step
        power = np.eye(len(here))
        for _ in range(int(np.ceil(self.along.ahead)) + 64):
            power = power @ here
            self._most = max(self._most, float(np.abs(power).sum(axis=1).max()))
        self.left = self._left
        self.later = self._weights * self._most
        total = self.later * self.memory / (1.0 - self._left)
        n = self.along.joints
        self.tails = np.repeat(total[:, :, None], n, axis=2)
        reach = self.along.reach
        self.of_command += self.along.loop.horizon**2 * reach * self.tails
        self.of_estimate += self.tails
        self.noise += reach * self.tails
        self.noise_square += (reach * self.tails) ** 2
        self.tails = max(1.0, reach) * self.tails


@dataclass(frozen=True)
class Forgetting:
    """How the loops forget along a motion.

    - `memory`: periods after which little is left of any state; None for too long.
    - `grown`: what an error of one joint has become in another at most, `apart` periods later, at sample `then`.
    """

    memory: int | None
    grown: float
    apart: int
    then: int


def forgetting(along: Along, samples: int) -> Forgetting:
    """How the loops forget.

    - `along`: the loops along the motion; `samples`: of it.
    """
    looked = np.arange(samples - 1, 0, -EVERY)[::-1]
    left = np.zeros(len(MEMORIES))
    error, placed = along.columns(0), along.led_to
    grown, apart, then = 0.0, 0, 0
    for back in carried_back(along, looked, MEMORIES[-1]):
        for k in np.flatnonzero(back.ages >= MEMORIES[0]):
            size = float(np.abs(error.T @ back.reached[k] @ placed).max())
            if size > grown:
                grown, apart, then = size, int(back.ages[k]), int(back.sample + back.ages[k])
            if back.ages[k] in MEMORIES:
                number = MEMORIES.index(int(back.ages[k]))
                left[number] = max(left[number], float(np.abs(back.reached[k]).sum(axis=1).max()))
    fits = [memory for memory, one in zip(MEMORIES, left, strict=True) if one < LITTLE]
    return Forgetting(min(fits) if fits else None, grown, apart, then)
