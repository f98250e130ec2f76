"""What the loops of all joints do with what is known, along a K that moves: where they begin, and a set's pushes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.diagnosis.linear_loop import LinearLoop

from .adjoint import Along, Back
from .kernels import ACCELERATION, ESTIMATE, OUTPUTS
from .signals import entries

Floats = NDArray[np.floating[Any]]


def beginnings(along: Along, loops: Sequence[LinearLoop], follows: Floats, states: Floats) -> tuple[Floats, Floats]:
    """Where the arms of a set may be at the first sample: columns [S m], and what is left of them when a p is held.

    - `along`, `loops`: of all joints.
    - `follows`: θ [n]; held is the p that ŷ has there.
    - `states`: as in `Entry` [m 8 + Q n].
    """
    n, columns, less = along.joints, [], []
    asked, led_to = along.at(0).asked, along.led_to
    for j, loop in enumerate(loops):
        basis, reach = entries(loop, float(follows[j]), states[:, :, j])
        whole = np.zeros((n, along.own, basis.shape[1]))
        whole[j] = basis * reach
        column = whole.reshape(n * along.own, -1)[along.kept][:, reach > 0.0]
        columns.append(column)
        less.append(column - np.outer(led_to[:, j], follows[j] * (asked[2, j] @ column)))
    return np.concatenate(columns, axis=1), np.concatenate(less, axis=1)


class CoupledKnown:
    """What is known of the outputs of each decision, some decisions around each that is carried back at a time.

    - `found`: what the pushes do to loops that they have brought to rest [Z W 9n M].
    - `free`, `held`: what the beginning does in size, without p and with the first p held [Z W 9n].

    - `along`, `decisions`: of which loops and outputs; `width`: W, samples, of which the middle one is carried back.
    - `pushes`: w* at the arm's samples, linear in between [M T n], units of periods.
    - `starts`: from `beginnings`.
    - `memory`: ages that are looked at.
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
        shape = (len(decisions), width, OUTPUTS * along.joints)
        self.found = np.zeros((*shape, len(pushes)))
        self.free, self.held = np.zeros((2, *shape))
        self._resting = along.resting

    def take(self, back: Back) -> None:
        """What comes in at one sample.

        - `back`: the outputs as of its state.
        """
        before = back.sample - 1 + self.offsets
        inside = np.flatnonzero(before >= 0)
        going = np.flatnonzero(back.ages < self.memory)
        if inside.size and going.size:
            last = self.pushes.shape[0] - 1
            ends = [self.pushes[np.minimum(before[inside] + k, last)] for k in (0, 1)]
            answers = [back.entering(source) for source in (3, 4)]
            whole = np.concatenate(answers, axis=2)[going].reshape(-1, 2 * self.along.joints)
            given = np.concatenate(ends, axis=1).transpose(1, 0, 2).reshape(2 * self.along.joints, -1)
            added = (whole @ given).reshape(going.size, -1, inside.size, self.pushes.shape[2]).swapaxes(1, 2)
            first, start = back.which.start + going[0], inside[0]
            self.found[first : first + going.size, start:] += added
        for k in np.flatnonzero(back.ages == self.memory):
            for w in np.flatnonzero(back.sample + self.offsets >= 0):
                rests = back.rows[k] @ self._resting @ self.pushes[back.sample + self.offsets[w]]
                self.found[back.which.start + k, w] += rests
        w = -back.sample - self.offsets[0]
        if 0 <= w < self.offsets.size:
            # Of these decisions this sample is the first that there is.
            begins = np.flatnonzero(back.ages < self.memory)
            at = back.which.start + begins
            self.found[at, w] += back.rows[begins] @ self._resting @ self.pushes[0]
            self.free[at, w], self.held[at, w] = (np.abs(back.rows[begins] @ one).sum(axis=2) for one in self.starts)

    def finish(self, later: Floats) -> None:
        """What is older counts as it was when it became so.

        - `later`: of a state of one as old as that, at most what is left in the outputs [Z 9n].
        """
        sizes = [float(np.abs(one).sum(axis=1).max(initial=0.0)) for one in self.starts]
        old = (self.decisions[:, None] + self.offsets) >= self.memory
        for into, size in zip((self.free, self.held), sizes, strict=True):
            into += np.where(old[..., None], size * later[:, None], 0.0)

    def told(self, count: int, corners: int, late: int, part: bool) -> tuple[Floats, Floats]:
        """What the pushes of a set do, below and above zero [N 2 9 n], and by how much they bend e, for K [N n].

        - `count`: N.
        - `corners`: how many of the pushes are extreme ones; the others are added, each to either side.
        - `late`: periods of delay that are whole; `part`: whether there is more.
        """
        n = self.along.joints
        found = self.found.reshape(-1, OUTPUTS, n, self.pushes.shape[2])[:count]
        last = self.pushes.shape[0] - 1
        # When the torque of a decision sets in, and until the next does.
        at = np.arange(count) + late
        knots = np.array([self.pushes[np.minimum(at + k, last)] for k in range(2 + part)])
        found[:, ESTIMATE] -= knots[0]
        corner, effect = found[..., :corners], found[..., corners:]
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
