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
    def of(cls, kernels: list[Floats], cell: int, count: int) -> Lags:
        """Sum kernels over cells; what is further back than `count` cells goes to the last row."""
        values = np.stack(kernels, axis=1)
        values = np.pad(values, ((0, -len(values) % cell), (0, 0))).reshape(-1, cell, values.shape[1]).sum(axis=1)
        head = np.zeros((count + 1, values.shape[1]))
        head[: min(count, len(values))] = values[:count]
        head[count] = values[count:].sum(axis=0)
        return cls(head)

    @classmethod
    def of_steps(cls, kernels: list[Floats], cell: int, count: int) -> Lags:
        """The largest responses to a step or a start in a cell, for each later one."""
        values = np.stack(kernels, axis=1)
        values = np.pad(values, ((0, -len(values) % cell), (0, 0)), mode="edge")
        values = values.reshape(-1, cell, values.shape[1]).max(axis=1)
        head = np.tile(values[min(count, len(values) - 1) :].max(axis=0), (count + 1, 1))
        head[: min(count, len(values))] = values[:count]
        # A step late in its cell is less than j cells ago; and what is to come counts now.
        head = np.maximum(head, np.concatenate([head[:1], head[:-1]]))
        return cls(np.maximum.accumulate(head[::-1])[::-1])

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

    def since(self, sizes: Floats) -> Floats:
        """Return the same for steps, of which there is none before the first cell."""
        return self._sums(sizes, np.zeros_like(sizes[:1]), sizes.sum(axis=0))

    def _sums(self, values: Floats, before: Floats, rest: Floats) -> Floats:
        if not np.any(values):
            return np.zeros((*values.shape, self.weights.shape[1]))
        count = len(self.weights) - 1
        # Columns first, so that each window is a stretch of memory.
        padded = np.concatenate([np.repeat(before.T, count, axis=1), values.T], axis=1)
        windows = np.lib.stride_tricks.sliding_window_view(padded, count, axis=1)[:, 1:]
        flat = np.ascontiguousarray(windows).reshape(-1, count) @ self.weights[count - 1 :: -1]
        sums = flat.reshape(len(padded), len(values), -1) + rest[:, None, None] * self.weights[count]
        return sums.swapaxes(0, 1)


@dataclass(frozen=True, eq=False)
class LagTable:
    """Kernels of all outputs that the inequalities need, over cells."""

    any_form: Lags
    ramp: Lags
    step: Lags
    pulse: Lags
    noise: Lags
    start_error: Lags
    start_speed: Lags
    start_miss: Lags
    beyond: Floats

    @classmethod
    def of(cls, kernels: list[LoopKernel], cell: int, count: int) -> LagTable:
        def sums(name: str) -> Lags:
            return Lags.of([getattr(kernel, name) for kernel in kernels], cell, count)

        def steps(name: str) -> Lags:
            return Lags.of_steps([getattr(kernel, name) for kernel in kernels], cell, count)

        return cls(
            any_form=sums("any_form"),
            ramp=sums("ramp"),
            step=steps("step"),
            pulse=sums("pulse"),
            noise=sums("noise"),
            start_error=steps("start_error"),
            start_speed=steps("start_speed"),
            start_miss=steps("start_miss"),
            beyond=np.array([kernel.beyond for kernel in kernels]),
        )
