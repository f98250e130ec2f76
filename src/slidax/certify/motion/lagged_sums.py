"""Convolutions of kernels with bounds that are constant in cells of time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .loop_kernels import LoopKernel

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Lags:
    """Weights of past cells for several outputs at once, [J + 1 outputs]; the last row is for the largest value."""

    weights: Floats

    @classmethod
    def of(cls, kernel: Floats, cell: int, count: int) -> Lags:
        """Sum a kernel [L outputs] over cells; what is further back than `count` cells goes to the last row."""
        return cls(_summed(kernel, cell, count))

    def output(self, which: int) -> Lags:
        """Return the weights of one output."""
        return Lags(self.weights[:, which : which + 1])

    def past(self, values: Floats) -> Floats:
        """Return `Σ_j weights_j values_{m-j}` for each cell m, [N k outputs], for values in cells [N k].

        An instant that is between j and j+1 cells' lengths before one in cell m lies in cell m-j or in the one before,
        so the larger of the two counts. Before the first cell its value stands. The last cell stands for all times
        after it: its value covers any order of the values in its own past.
        """
        both = np.maximum(values, np.concatenate([values[:1], values[:-1]]))
        sums = self._sums(both, values[:1], values.max(axis=0))
        count = len(self.weights) - 1
        lasting = values[-count - 1 :].max(axis=0)[:, None] * self.weights[:-1].sum(axis=0)
        sums[-1] = np.maximum(sums[-1], lasting + values.max(axis=0)[:, None] * self.weights[-1])
        return sums

    def past_change(self, rates: Floats, sizes: Floats) -> Floats:
        """Return `Σ_j weights_j sizes_{m-j} rates` [N k] for one output, with the largest rate from then to now.

        - `rates`: [N k]; `sizes`: [N]. Both are taken as in `past`.
        """
        weights, count = self.weights[:, 0], len(self.weights) - 1
        older = np.maximum(np.arange(len(sizes))[:, None] - np.arange(count + 1), 0)
        both, sums, reach = np.maximum(sizes[older[:, :-1]], sizes[older[:, 1:]]), np.zeros_like(rates), rates
        for j in range(count):
            reach = np.maximum(reach, rates[older[:, j + 1]])
            sums = sums + (weights[j] * both[:, j])[:, None] * reach
        lasting = weights[:-1].sum() * sizes[-count - 1 :].max() * rates[-count - 1 :].max(axis=0)
        sums[-1] = np.maximum(sums[-1], lasting)
        return np.asarray(sums + weights[count] * sizes.max() * rates.max(axis=0))

    def since(self, sizes: Floats) -> Floats:
        """Return the same for steps, of which there is none before the first cell."""
        return self._sums(sizes, np.zeros_like(sizes[:1]), sizes.sum(axis=0))

    def _sums(self, values: Floats, before: Floats, rest: Floats) -> Floats:
        if not np.any(values):
            return np.zeros((*values.shape, self.weights.shape[1]))
        count = len(self.weights) - 1
        # Columns first, so that each window is a stretch of memory.
        padded = np.concatenate([np.repeat(before.T, count, axis=1), values.T], axis=1)
        columns, step = padded.strides
        windows = np.lib.stride_tricks.as_strided(padded[:, 1:], (*values.T.shape, count), (columns, step, step))
        flat = np.ascontiguousarray(windows).reshape(-1, count) @ self.weights[count - 1 :: -1]
        sums = flat.reshape(len(padded), len(values), -1) + rest[:, None, None] * self.weights[count]
        return sums.swapaxes(0, 1)


@dataclass(frozen=True, eq=False)
class LagTable:
    """Kernels of all outputs that the inequalities need, over cells."""

    any_form: Lags
    ramp: Lags
    pulse: Lags
    noise: Lags
    goal: Lags
    step: Lags
    start_error: Lags
    start_speed: Lags
    start_miss: Lags
    beyond: Floats


SUMMED = ("any_form", "ramp", "pulse", "noise", "goal")
STEPS = ("step", "start_error", "start_speed", "start_miss")


@dataclass(frozen=True, eq=False)
class KernelStack:
    """Kernels of several outputs as arrays [L kinds outputs]: those of `SUMMED`, and those of `STEPS`."""

    summed: Floats
    steps: Floats
    beyond: Floats

    @classmethod
    def of(cls, kernels: list[LoopKernel]) -> KernelStack:
        """Return the kernels of some outputs as arrays."""
        summed, steps = (
            np.stack([np.stack([getattr(kernel, kind) for kernel in kernels], axis=1) for kind in kinds], axis=1)
            for kinds in (SUMMED, STEPS)
        )
        return cls(summed, steps, np.array([kernel.beyond for kernel in kernels]))

    def over(self, cell: int, count: int) -> LagTable:
        """Return the kernels over cells."""
        summed, steps = _summed(self.summed, cell, count), _largest(self.steps, cell, count)
        lags = {kind: Lags(np.ascontiguousarray(summed[:, i])) for i, kind in enumerate(SUMMED)}
        lags |= {kind: Lags(np.ascontiguousarray(steps[:, i])) for i, kind in enumerate(STEPS)}
        return LagTable(**lags, beyond=self.beyond)


def _summed(values: Floats, cell: int, count: int) -> Floats:
    """Sums over cells of the first axis; the last row is for all that is further back than `count` cells."""
    sums = np.add.reduceat(values, np.arange(0, len(values), cell), axis=0)
    head = np.zeros((count + 1, *values.shape[1:]))
    head[: min(count, len(sums))] = sums[:count]
    head[count] = sums[count:].sum(axis=0)
    return head


def _largest(values: Floats, cell: int, count: int) -> Floats:
    """The largest responses to a step or a start in a cell, for each later one."""
    values = np.maximum.reduceat(values, np.arange(0, len(values), cell), axis=0)
    head = np.repeat(values[None, min(count, len(values) - 1) :].max(axis=1), count + 1, axis=0)
    head[: min(count, len(values))] = values[:count]
    # A step late in its cell is less than j cells ago; and what is to come counts now.
    head = np.maximum(head, np.concatenate([head[:1], head[:-1]]))
    return np.asarray(np.maximum.accumulate(head[::-1])[::-1])
