"""All joints as one loop with a known coupling K, and its adjoint responses along the motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slidax.law.joint_loop import LinearLoop

from ..sampled_scenario import Floats
from .joint_responses import ACCELERATION, ERROR, ESTIMATE, LAPSE, LED, MISSED, OUTPUTS, SHIFT, SLIP, SPEED


@dataclass(frozen=True)
class CoupledMaps:
    """One period of all loops: `ë = K (a + w*)`, with a the command of each joint's law; units of periods.

    The states of the joints' own loops (`LinearLoop.maps`) follow each other, and `rows` has its rows for each joint.

    - `step`: [S S]; `rows`: [7 n S].
    - `enters`: from each joint's noise of position and velocity, target, disturbance and disturbance at the end [5 S
      n]; `direct`: the same to the rows [5 7 n n]. A disturbance w* acts through K.
    - `own`: number of states of one joint.
    """

    step: Floats
    rows: Floats
    enters: Floats
    direct: Floats
    own: int

    @classmethod
    def of(cls, loops: Sequence[LinearLoop], matrix: Floats, delay: float | None = None) -> CoupledMaps:
        """Maps of the joints' loops.

        - `loops`: with one horizon and delay.
        - `matrix`: K [n n].
        - `delay`: the true one [periods]; the law's own if None.
        """
        n = len(loops)
        still, moved = [loop.maps(0.0, delay) for loop in loops], [loop.maps(1.0, delay) for loop in loops]
        own = still[0].step.shape[0]
        step, rows = np.zeros((n, own, n, own)), np.zeros((7, n, n, own))
        enters, direct = np.zeros((5, n, own, n)), np.zeros((5, 7, n, n))
        for i in range(n):
            step[i, :, i], rows[:, i, i] = still[i].step, still[i].outputs
            enters[:3, i, :, i] = still[i].enters.T[:3]
            direct[:3, :, i, i] = still[i].direct.T[:3]
            for j in range(n):
                # Joint j's command moves joint i.
                share = matrix[i, j]
                step[i, :, j] += share * (moved[j].step - still[j].step)
                rows[:, i, j] += share * (moved[j].outputs - still[j].outputs)
                enters[:3, i, :, j] += share * (moved[j].enters - still[j].enters).T[:3]
                direct[:3, :, i, j] += share * (moved[j].direct - still[j].direct).T[:3]
                enters[3:, i, :, j] = share * still[i].enters.T[3:]
                direct[3:, :, i, j] = share * still[i].direct.T[3:]
        size = n * own
        return cls(step.reshape(size, size), rows.reshape(7, n, size), enters.reshape(5, size, n), direct, own)

    def states(self, which: NDArray[np.integer[Any]]) -> CoupledMaps:
        """The maps of some states only."""
        step, rows, enters = self.step[np.ix_(which, which)], self.rows[..., which], self.enters[:, which]
        return CoupledMaps(step, rows, enters, self.direct, self.own)

    @property
    def joints(self) -> int:
        return int(self.rows.shape[1])

    @property
    def radius(self) -> float:
        """The largest modulus of an eigenvalue over one period; below 1 the loops are stable."""
        return float(np.max(np.abs(np.linalg.eigvals(self.step))))

    def placed(self, states: Floats, joint: int) -> Floats:
        """States of one joint's loop [s m] as states of all [S m], with the others at rest."""
        placed = np.zeros((self.step.shape[0], states.shape[1]))
        placed[joint * self.own : (joint + 1) * self.own] = states
        return placed


AT_ONCE = 16
"""Decisions that are carried back together: what is known of them then stays near the processor."""


class LoopsAlongMotion:
    """The loops of all joints along a motion, one K in each period; states that nothing reads are left out.

    - `loops`: of the joints, with one horizon and delay.
    - `matrices`: K in the period from each of the arm's samples on [T n n]; before and after them the nearest is taken.
    """

    def __init__(self, loops: Sequence[LinearLoop], matrices: Floats) -> None:
        self.loop, self.matrices = loops[0], matrices
        n = self.joints = len(loops)
        # Linear in K: what there is without it, and what each entry adds.
        still, moved = CoupledMaps.of(loops, np.zeros((n, n))), CoupledMaps.of(loops, np.ones((n, n)))
        self.own = still.own
        used = sum(np.abs(own.step).sum(axis=0) + np.abs(own.rows).sum(axis=(0, 1)) for own in (still, moved))
        self.kept = np.flatnonzero(used > 0.0)
        self._still = still = still.states(self.kept)
        moved = moved.states(self.kept)
        self._adds = CoupledMaps(
            moved.step - still.step,
            moved.rows - still.rows,
            moved.enters - still.enters,
            moved.direct - still.direct,
            self.own,
        )
        # Whose state each is.
        self._whose = self.kept // self.own
        self.late = int(self.loop.believed)

    @property
    def states(self) -> int:
        """Number of states."""
        return int(self.kept.size)

    @property
    def ahead(self) -> int:
        """Samples after a decision at which its outputs are read."""
        return max(1, self.late)

    def at(self, samples: NDArray[np.integer[Any]]) -> CoupledMaps:
        """The maps of the periods from some samples [T], along the first axis."""
        matrix, still, adds = self._matrices(samples), self._still, self._adds
        return CoupledMaps(
            self.step(samples),
            still.rows + matrix[..., self._whose][:, None] * adds.rows,
            self.enters(samples),
            still.direct + matrix[:, None, None] * adds.direct,
            self.own,
        )

    def step(self, samples: NDArray[np.integer[Any]]) -> Floats:
        """The state maps alone [T S S]."""
        matrix = self._matrices(samples)[:, self._whose[:, None], self._whose]
        return self._still.step + matrix * self._adds.step

    def enters(self, samples: NDArray[np.integer[Any]]) -> Floats:
        """The input maps alone [T 5 S n]."""
        matrix = self._matrices(samples)[:, self._whose]
        return self._still.enters + matrix[:, None] * self._adds.enters

    def _matrices(self, samples: NDArray[np.integer[Any]]) -> Floats:
        return self.matrices[np.clip(samples, 0, len(self.matrices) - 1)]

    def columns(self, *places: int) -> Floats:
        """States that are one in some places of each joint's own [S n], as far as they are kept."""
        result = np.zeros((self.joints, self.own, self.joints))
        for place in places:
            result[:, place] += np.eye(self.joints)
        return result.reshape(-1, self.joints)[self.kept]

    def places(self, place: int) -> NDArray[np.integer[Any]]:
        """Index of a joint's own state among all kept states [n]."""
        result = np.searchsorted(self.kept, np.arange(self.joints) * self.own + place)
        assert (self.kept[result] == np.arange(self.joints) * self.own + place).all()
        return result

    @property
    def noisy(self) -> list[int]:
        """Kinds of noise with an effect, as numbers of `CoupledMaps.enters`."""
        maps = (self._still, self._adds)
        return [k for k in (0, 1) if any(own.enters[k].any() or own.direct[k].any() for own in maps)]

    @property
    def reach(self) -> float:
        """Bound of the states after a unit of measurement noise or of a target has entered."""
        widest = np.abs(self.matrices).max(axis=0)[self._whose]
        most = np.abs(self._still.enters[:3]) + widest * np.abs(self._adds.enters[:3])
        return max(1.0, float(most.max()))

    @property
    def resting(self) -> Floats:
        """The states of all loops at rest under constant disturbances, whatever K is [S n]."""
        queue = self.own - 8
        return self.columns(4 + queue) - self.columns(*range(2, 2 + queue))

    @property
    def led_to(self) -> Floats:
        """The states of all loops at rest with constant targets, whatever K is [S n]."""
        queue = self.own - 8
        return self.columns(0, 2 + queue, self.own - 2)


@dataclass(frozen=True)
class AdjointResponse:
    """Outputs of some decisions as functions of earlier states, with K of the periods in between.

    - `age`: samples from the state to the decision; negative if the state is later.
    - `which`: the decisions' numbers; `samples`: of their states [Z].
    - `rows`: of the outputs [Z 9n S]; `reached`: of the states at the decision [Z S S].
    - `enters`: inputs of the periods that end at these samples [Z 5 S n].
    - `direct`: direct effect on outputs read one sample before the states [Z 5 9n n]; None if nothing is read there.
    """

    age: int
    which: slice
    samples: NDArray[np.integer[Any]]
    rows: Floats
    reached: Floats
    enters: Floats
    direct: Floats | None

    def entering(self, source: int) -> Floats:
        """Effect on the outputs of an input in the period that ends with the state [Z 9n n].

        - `source`: number of `CoupledMaps.enters`.
        """
        result: Floats = self.rows @ self.enters[:, source]
        # Inputs of a sample act directly on the rows of that sample.
        return result if self.direct is None else result + self.direct[:, source]


def decision_batches(decisions: NDArray[np.integer[Any]]) -> list[slice]:
    """Return batches of decisions."""
    return [slice(begin, min(begin + AT_ONCE, len(decisions))) for begin in range(0, len(decisions), AT_ONCE)]


def adjoint_responses(
    along: LoopsAlongMotion, decisions: NDArray[np.integer[Any]], oldest: int
) -> Iterator[AdjointResponse]:
    """Yield responses from the latest sample that an output reads to the first, or the oldest age; batch by batch.

    - `decisions`: their samples, ascending and evenly spaced.
    - `oldest`: largest age.
    """
    for which in decision_batches(decisions):
        yield from _carried(along, decisions, which, oldest)


def _carried(
    along: LoopsAlongMotion, decisions: NDArray[np.integer[Any]], which: slice, oldest: int
) -> Iterator[AdjointResponse]:
    apart = _apart(decisions)
    own, size, outputs = decisions[which], along.states, OUTPUTS * along.joints
    first = max(int(own[0]) - oldest - 1, -apart - 1)
    stretch = np.arange(first, int(own[-1]) + along.ahead)
    step, enters, read = along.step(stretch), along.enters(stretch), _read(along)
    rows, reached = np.zeros((len(own), outputs, size)), np.zeros((len(own), size, size))
    for age in range(-along.ahead, oldest + 1):
        # Of the decisions that are far enough from the first sample.
        begun = int(np.searchsorted(own, age - apart))
        if begun == len(own):
            return
        rows, reached, which, own = rows[begun:], reached[begun:], slice(which.start + begun, which.stop), own[begun:]
        samples, direct = own - age, None
        if -age in read:
            rows = rows + np.einsum("or,zris->zois", read[-age], along.at(samples).rows).reshape(rows.shape)
        if age == 0:
            reached = reached + np.eye(size)
        if -age - 1 in read:
            direct = np.einsum("or,zcrij->zcoij", read[-age - 1], along.at(samples - 1).direct)
            direct = direct.reshape(*direct.shape[:2], outputs, -1)
        # Their periods lie as far apart as they do.
        at = slice(int(samples[0]) - 1 - first, int(samples[-1]) - first, apart)
        yield AdjointResponse(age, which, samples, rows, reached, enters[at], direct)
        rows, reached = rows @ step[at], reached @ step[at]


def state_transitions(
    along: LoopsAlongMotion, decisions: NDArray[np.integer[Any]], which: slice, oldest: int
) -> Iterator[tuple[int, NDArray[np.integer[Any]], Floats]]:
    """Yield the transition from the states of some samples to the decisions: age, samples, and map [Z S S]."""
    apart, own = _apart(decisions), decisions[which]
    first = max(int(own[0]) - oldest - 1, -apart - 1)
    step = along.step(np.arange(first, int(own[-1])))
    reached = np.repeat(np.eye(along.states)[None], len(own), axis=0)
    for age in range(oldest + 1):
        begun = int(np.searchsorted(own, age - apart))
        if begun == len(own):
            return
        reached, own = reached[begun:], own[begun:]
        samples = own - age
        yield age, samples, reached
        reached = reached @ step[int(samples[0]) - 1 - first : int(samples[-1]) - first : apart]


def _apart(decisions: NDArray[np.integer[Any]]) -> int:
    return int(np.max(np.diff(decisions, prepend=0)))


def _read(along: LoopsAlongMotion) -> dict[int, Floats]:
    """From the rows of a loop at some samples after a decision to the outputs [9 7]."""
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
