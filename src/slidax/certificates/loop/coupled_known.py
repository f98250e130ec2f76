"""Outputs of the coupled loop for known inputs, along a time-varying K: initial states and a set's disturbances."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from slidax.diagnosis.linear_loop import LinearLoop

from ..each import Floats
from .adjoint import Along, Back
from .kernels import ACCELERATION, ESTIMATE, OUTPUTS
from .signals import entries


def beginnings(along: Along, loops: Sequence[LinearLoop], follows: Floats, states: Floats) -> tuple[Floats, Floats]:
    """Return the possible initial states as columns [S m], and their remainder when a p is held.

    - `follows`: θ [n]; the held p is that of ŷ there.
    - `states`: as in `Entry` [m 8 + Q n].
    """
    n, columns, less = along.joints, [], []
    (rows,), led_to = along.at(np.zeros(1, int)).rows, along.led_to
    for j, loop in enumerate(loops):
        basis, reach = entries(loop, float(follows[j]), states[:, :, j])
        whole = np.zeros((n, along.own, basis.shape[1]))
        whole[j] = basis * reach
        column = whole.reshape(n * along.own, -1)[along.kept][:, reach > 0.0]
        columns.append(column)
        less.append(column - np.outer(led_to[:, j], follows[j] * (rows[2, j] @ column)))
    return np.concatenate(columns, axis=1), np.concatenate(less, axis=1)


class CoupledKnown:
    """Known outputs of each decision and of its neighbours.

    - `responses`: of the disturbances, from rest [Z W 9n M].
    - `free`, `held`: size of the initial states' effect, without p and with the first p held [Z W 9n].

    - `along`, `decisions`: the loops and outputs; `width`: W, samples, of which the middle one is carried back.
    - `pushes`: w* at the arm's samples, linear in between [M T n], units of periods.
    - `starts`: from `beginnings`.
    - `memory`: largest age.
    """

    def __init__(
        self,
        along: Along,
        decisions: NDArray[np.integer[Any]],
        width: int,
        pushes: Floats,
        starts: tuple[Floats, Floats],
        memory: int,
    ) -> None:
        self.along, self.decisions, self.memory = along, decisions, memory
        self.offsets = np.arange(width) - width // 2
        self.pushes, self.starts = np.moveaxis(pushes, 0, -1), starts
        # Time is the last axis. The initial states contain everything before the first sample.
        lasting = np.moveaxis(pushes, 1, -1).swapaxes(0, 1)
        before = np.zeros((*lasting.shape[:2], memory + 2 * width))
        after = np.repeat(lasting[..., -1:], decisions[-1] + width, axis=-1)
        self._before = before.shape[-1]
        self._now = np.concatenate([before, lasting, after], axis=-1)
        self._then = np.concatenate([before, lasting[..., 1:], after], axis=-1)
        count, outputs = len(decisions), OUTPUTS * along.joints
        self._answers = np.zeros((count, outputs, width * len(pushes)))
        self.free, self.held = np.zeros((2, count, width, outputs))
        self._resting = along.resting

    @property
    def responses(self) -> Floats:
        """As above."""
        count, outputs, _ = self._answers.shape
        return self._answers.reshape(count, outputs, -1, self.offsets.size).transpose(0, 3, 1, 2)

    def take(self, back: Back) -> None:
        """Add the inputs at one sample before each decision."""
        if back.age < self.memory:
            answers = np.concatenate([back.entering(3), back.entering(4)], axis=2)
            pushes_there = [self._around(pushes, back.samples - 1) for pushes in (self._now, self._then)]
            self._answers[back.which] += answers @ np.concatenate(pushes_there, axis=1)
            self._begun(back)
        else:
            rests = back.rows @ self._resting
            self._answers[back.which] += rests @ self._around(self._now, back.samples)

    def _around(self, pushes: Floats, samples: NDArray[np.integer[Any]]) -> Floats:
        """The disturbances around some samples [Z n M W]."""
        windows = sliding_window_view(pushes, self.offsets.size, axis=-1)
        around = windows[:, :, self._before + samples + self.offsets[0]]
        return np.moveaxis(around, 2, 0).reshape(len(samples), self.along.joints, -1)

    def _begun(self, back: Back) -> None:
        """Add the initial states for decisions whose state is at the first sample."""
        if back.samples[0] > self.offsets.size:
            return
        w = -back.samples - self.offsets[0]
        for k in np.flatnonzero((w >= 0) & (w < self.offsets.size)):
            at, rows = back.which.start + k, back.rows[k]
            self._answers[at].reshape(len(rows), -1, self.offsets.size)[..., w[k]] += (
                rows @ self._resting @ self.pushes[0]
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
        answers = self.responses.reshape(-1, OUTPUTS, n, self.pushes.shape[2])[:count]
        last = self.pushes.shape[0] - 1
        # When the torque of a decision sets in, and until the next does.
        at = np.arange(count) + late
        knots = np.array([self.pushes[np.minimum(at + k, last)] for k in range(2 + part)])
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
