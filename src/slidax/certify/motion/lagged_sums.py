"""Convolutions of kernels with inputs of which each time cell has a bound.

A kernel is an output's largest response to a unit input at each lag, the input's age (loop_kernels.py). Here kernels
are summed over time cells of equal length, and multiplied by the bounds of the input in these cells.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .loop_kernels import LoopKernel

Floats = NDArray[np.float64]

NEGLIGIBLE = 2e-4
"""Share of a kernel that is old enough to be charged to the largest value of the whole motion."""


@dataclass(frozen=True, eq=False)
class Lags:
    """Kernels of several outputs, summed over cells: weights [J + 1 outputs].

    Row j < J weighs the input's bound of j cells ago. The last row weighs the largest bound of the whole motion, in
    place of all cells further back.
    """

    weights: Floats

    @classmethod
    def of(cls, kernel: Floats, cell: int, count: int) -> Lags:
        """Sum a kernel [L outputs] over cells of `cell` periods; lags beyond `count` cells go to the last row."""
        return cls(_summed(kernel, cell, count))

    def output(self, which: int) -> Lags:
        """Return the weights of one output alone, [J + 1, 1].

        - `which`: index of the output.
        """
        return Lags(self.weights[:, which : which + 1])

    def past(self, values: Floats) -> Floats:
        """Return the outputs' bounds `Σ_j weights_j values_{m-j}` for each cell m [cells k outputs].

        An instant between j and j+1 cell lengths before another one in cell m lies in cell m-j or m-j-1. So the larger
        of the two values counts. The first cell's value also holds before that cell. The last cell is for all later
        times: its sum takes the largest of the last J + 1 values at every lag up to J cells.

        - `values`: bounds of k inputs in each cell [cells k].
        """
        both = np.maximum(values, np.concatenate([values[:1], values[:-1]]))
        sums = self._sums(both, values[:1], values.max(axis=0))
        count = len(self.weights) - 1
        lasting = values[-count - 1 :].max(axis=0)[:, None] * self.weights[:-1].sum(axis=0)
        sums[-1] = np.maximum(sums[-1], lasting + values.max(axis=0)[:, None] * self.weights[-1])
        return sums

    def past_change(self, rates: Floats, sizes: Floats) -> Floats:
        """Return the bound of one output's response to an input times a matrix's change since then [cells k].

        It is `Σ_j weights_j sizes_{m-j} rate_j` for cell m. rate_j is the largest rate from cell m-j to cell m, and the
        weights contain the input's age. Of two neighbouring cells the larger size counts, as in `past`.

        - `rates`: rates of the matrix's k rows [cells k]; `sizes`: bounds of the input [cells].
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
        """Return the bounds of the response to steps of the inputs in any cells [cells k outputs].

        They are `Σ_j weights_j sizes_{m-j}` for cell m; there is no step before the first cell.

        - `sizes`: sizes of the steps of k inputs in each cell [cells k].
        """
        return self._sums(sizes, np.zeros_like(sizes[:1]), sizes.sum(axis=0))

    def _sums(self, values: Floats, before: Floats, rest: Floats) -> Floats:
        if not np.any(values):
            return np.zeros((*values.shape, self.weights.shape[1]))
        count = len(self.weights) - 1
        # Columns first, so that each window is contiguous in memory.
        padded = np.concatenate([np.repeat(before.T, count, axis=1), values.T], axis=1)
        columns, step = padded.strides
        windows = np.lib.stride_tricks.as_strided(padded[:, 1:], (*values.T.shape, count), (columns, step, step))
        flat = np.ascontiguousarray(windows).reshape(-1, count) @ self.weights[count - 1 :: -1]
        sums = flat.reshape(len(padded), len(values), -1) + rest[:, None, None] * self.weights[count]
        return sums.swapaxes(0, 1)


@dataclass(frozen=True, eq=False)
class LagTable:
    """Kernels over cells: the fields of `LoopKernel` as `Lags`, each for the outputs of a `KernelStack`."""

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
    """Kernels of several outputs as arrays [L kinds outputs], for L lags and the kinds of input of `LoopKernel`.

    - `summed`: the kinds in `SUMMED`, which are summed over a cell. `steps`: the kinds in `STEPS`, whose largest value
      in a cell counts. `beyond`: as in `LoopKernel` [outputs].
    """

    summed: Floats
    steps: Floats
    beyond: Floats

    @classmethod
    def of(cls, kernels: list[LoopKernel]) -> KernelStack:
        """Return the kernels as arrays; `kernels` has one for each output."""
        summed, steps = (
            np.stack([np.stack([getattr(kernel, kind) for kernel in kernels], axis=1) for kind in kinds], axis=1)
            for kinds in (SUMMED, STEPS)
        )
        return cls(summed, steps, np.array([kernel.beyond for kernel in kernels]))

    def over(self, cell: int, count: int) -> LagTable:
        """Return the kernels over `count` cells of `cell` periods each; the last row of `Lags` has all longer lags."""
        summed, steps = _summed(self.summed, cell, count), _largest(self.steps, cell, count)
        lags = {kind: Lags(np.ascontiguousarray(summed[:, i])) for i, kind in enumerate(SUMMED)}
        lags |= {kind: Lags(np.ascontiguousarray(steps[:, i])) for i, kind in enumerate(STEPS)}
        return LagTable(**lags, beyond=self.beyond)


def _summed(values: Floats, cell: int, count: int) -> Floats:
    """Return sums of the first axis over cells; the last row is for all lags beyond `count` cells."""
    sums = np.add.reduceat(values, np.arange(0, len(values), cell), axis=0)
    head = np.zeros((count + 1, *values.shape[1:]))
    head[: min(count, len(sums))] = sums[:count]
    head[count] = sums[count:].sum(axis=0)
    return head


def _largest(values: Floats, cell: int, count: int) -> Floats:
    """Return bounds of the response to a step or an initial state, by the number of cells since it."""
    values = np.maximum.reduceat(values, np.arange(0, len(values), cell), axis=0)
    head = np.repeat(values[None, min(count, len(values) - 1) :].max(axis=1), count + 1, axis=0)
    head[: min(count, len(values))] = values[:count]
    # A step late in its cell is less than j cells old. Each bound also covers all later responses.
    head = np.maximum(head, np.concatenate([head[:1], head[:-1]]))
    return np.asarray(np.maximum.accumulate(head[::-1])[::-1])


def remembered(kernel: LoopKernel) -> int:
    """Return the lag from which on a kernel's sum is at most the share `NEGLIGIBLE` of its whole sum [periods]."""
    left = np.cumsum(kernel.any_form[::-1])[::-1]
    return int(np.count_nonzero(left > NEGLIGIBLE * left[0])) + 1
