"""What the loops of all joints put out, as of the state at each sample before: carried back along a K that moves."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.diagnosis.linear_loop import LinearLoop

from .coupled_maps import CoupledMaps
from .kernels import ACCELERATION, ERROR, ESTIMATE, LAPSE, LED, MISSED, OUTPUTS, SHIFT, SLIP, SPEED

Floats = NDArray[np.floating[Any]]


class Along:
    """The loops of all joints along a motion, one K in each period; states that nothing reads are left out.

    - `loops`: of the joints, with one horizon and delay.
    - `matrices`: K in the period from each of the arm's samples on [T n n]; before and after them the nearest is taken.
    """

    def __init__(self, loops: Sequence[LinearLoop], matrices: Floats) -> None:
        self.loop, self.matrices = loops[0], matrices
        n = self.joints = len(loops)
        # Linear in K: what there is without it, and what each entry adds.
        self._still, moved = CoupledMaps.of(loops, np.zeros((n, n))), CoupledMaps.of(loops, np.ones((n, n)))
        self._adds = [
            getattr(moved, name) - getattr(self._still, name) for name in ("step", "asked", "enters", "direct")
        ]
        self.own = self._still.own
        used = [np.abs(one).sum(axis=0) for one in (self._still.step, self._adds[0])]
        asked = [np.abs(one).sum(axis=(0, 1)) for one in (self._still.asked, self._adds[1])]
        self.kept = np.flatnonzero(sum(used) + sum(asked) > 0.0)
        self.late = int(self.loop.believed)

    @property
    def states(self) -> int:
        """How many."""
        return int(self.kept.size)

    @property
    def ahead(self) -> int:
        """Samples after a decision at which its outputs are read."""
        return max(1, self.late)

    def at(self, sample: int) -> CoupledMaps:
        """The maps of a period.

        - `sample`: from which on.
        """
        matrix = self.matrices[min(max(sample, 0), len(self.matrices) - 1)]
        still, kept = self._still, self.kept
        wide = np.repeat(matrix, self.own, axis=1)
        step = still.step + np.repeat(wide, self.own, axis=0) * self._adds[0]
        asked = still.asked + wide * self._adds[1]
        enters = still.enters + np.repeat(matrix, self.own, axis=0) * self._adds[2]
        direct = still.direct + matrix * self._adds[3]
        return CoupledMaps(step[np.ix_(kept, kept)], asked[..., kept], enters[:, kept], direct, self.own)

    def columns(self, *places: int) -> Floats:
        """States that are one in some places of each joint's own [S n], as far as they are kept.

        - `places`: numbers of a joint's states.
        """
        found = np.zeros((self.joints, self.own, self.joints))
        for place in places:
            found[:, place] += np.eye(self.joints)
        return found.reshape(-1, self.joints)[self.kept]

    @property
    def reach(self) -> float:
        """No state is larger after a measurement's noise or a place of one has come in."""
        widest = np.repeat(np.abs(self.matrices).max(axis=0), self.own, axis=0)
        most = np.abs(self._still.enters[:3]) + widest * np.abs(self._adds[2][:3])
        return max(1.0, float(most.max()))

    @property
    def resting(self) -> Floats:
        """The states in which all loops rest under constant pushes, whatever K is [S n]."""
        queue = self.own - 8
        return self.columns(4 + queue) - self.columns(*range(2, 2 + queue))

    @property
    def led_to(self) -> Floats:
        """The states in which all loops rest with constant places, whatever K is [S n]."""
        queue = self.own - 8
        return self.columns(0, 2 + queue, self.own - 2)


@dataclass(frozen=True)
class Back:
    """Some decisions' outputs as of one sample's state, with K of the periods between.

    - `sample`: which, counted as the decisions are.
    - `which`: the decisions' numbers.
    - `ages`: samples from it to each decision [Z]; negative where it is later.
    - `rows`: of the outputs [Z 9n S]; `reached`: of the states at the decision [Z S S].
    - `maps`: of the period that ends at this sample.
    - `read`: from the rows that a loop is asked for at the sample before to the outputs, by its age [9 7].
    """

    sample: int
    which: slice
    ages: NDArray[np.integer[Any]]
    rows: Floats
    reached: Floats
    maps: CoupledMaps
    read: dict[int, Floats]

    def entering(self, source: int) -> Floats:
        """What comes in during the period that ends at this sample does to the outputs [Z 9n n].

        - `source`: number of `CoupledMaps.enters`.
        """
        found: Floats = self.rows @ self.maps.enters[source]
        n = found.shape[-1]
        for age, read in self.read.items():
            # What comes in at a sample goes through to what is read there.
            at = np.flatnonzero(self.ages + 1 == -age)
            if at.size:
                through = np.einsum("or,rij->oij", read, self.maps.direct[source]).reshape(-1, n)
                found[at] += through
        return found


def carried_back(along: Along, decisions: NDArray[np.integer[Any]], oldest: int) -> Iterator[Back]:
    """From the latest sample at which an output is read to the first, or the oldest that counts.

    - `along`: the loops along the motion.
    - `decisions`: their samples, in ascending order.
    - `oldest`: ages that are looked at.
    """
    n, size = along.joints, along.states
    read = _read(along)
    outputs = OUTPUTS * n
    rows = np.zeros((len(decisions), outputs + size, size))
    first, last = len(decisions), len(decisions)
    half = int(np.max(np.diff(decisions, prepend=0)))
    maps = along.at(int(decisions[-1]) + along.ahead)
    for sample in range(int(decisions[-1]) + along.ahead, -half - 1, -1):
        while first > 0 and decisions[first - 1] + along.ahead >= sample:
            first -= 1
        while last > first and decisions[last - 1] - sample > oldest:
            last -= 1
        if last == 0:
            return
        ages = decisions[first:last] - sample
        for ahead, one in read.items():
            for k in first + np.flatnonzero(ages == -ahead):
                rows[k, :outputs] += np.einsum("or,ris->ois", one, maps.asked).reshape(outputs, size)
        for k in first + np.flatnonzero(ages == 0):
            rows[k, outputs:] = np.eye(size)
        maps = along.at(sample - 1)
        now = rows[first:last]
        yield Back(sample, slice(first, last), ages, now[:, :outputs], now[:, outputs:], maps, read)
        rows[first:last] = (now.reshape(-1, size) @ maps.step).reshape(now.shape)


def _read(along: Along) -> dict[int, Floats]:
    """From the rows that a loop is asked for so many samples after a decision to the outputs [9 7]."""
    lead, r, late = along.loop.horizon - 0.5, 1.0 / along.loop.horizon, along.late
    read: dict[int, Floats] = {ahead: np.zeros((OUTPUTS, 7)) for ahead in {0, 1, late}}
    read[0][LED, 2] = 1.0
    read[late][ERROR, 0] += 1.0
    read[1][MISSED, 2] += 1.0 / r
    read[0][MISSED, 2] -= (1.0 - r) / r
    read[late][SHIFT, 0] += 1.0
    read[late][SHIFT, 1] += lead
    read[0][SHIFT, 2] -= 1.0
    read[1][SLIP, 3] += 1.0
    read[0][SLIP, 3] -= 1.0
    read[0][SLIP, 5] -= 1.0
    read[0][ACCELERATION, 4] = 1.0
    read[0][ESTIMATE, 6] = 1.0
    read[late][SPEED, 1] += 1.0
    read[late][LAPSE, 1] += 1.0
    read[0][LAPSE, 3] -= 1.0
    return read
