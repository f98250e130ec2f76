"""The joints together: what moves one with another is known as one matrix K at a time, and only the rest is a push."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from .coupled_kernels import LAGS, CoupledKernels
from .kernels import OUTPUTS
from .propagation import Answers, Bounds, Course, First, Passing, carried_at_first, sampled

Floats = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Together:
    """The loops along time, in segments with one K each; units of periods.

    - `edges`: of the segments, in decisions [S + 1].
    - `matrices`: K of each [S n n]; `kernels`: of each.
    - `low`, `high`: the least and the largest of each entry of K of all arms in each decision's period [N n n].
    - `wider`: by how much each entry may be otherwise, beside the planned run [N n n].
    - `under_way`: bounds of `a + w*` of the commands that were decided before the first, the newest first [Q n].
    """

    edges: tuple[int, ...]
    matrices: Floats
    kernels: list[CoupledKernels]
    low: Floats
    high: Floats
    wider: Floats
    under_way: Floats

    def off(self, segment: int, span: slice) -> Floats:
        """By how much K may be another than a segment's [K n n].

        - `segment`: its number.
        - `span`: of the decisions.
        """
        middle = self.matrices[segment]
        found: Floats = np.maximum(self.high[span] - middle, middle - self.low[span]) + self.wider[span]
        return found

    def before(self, acceleration: Floats, stray: Floats, aims: Floats, changes: Floats, part: float) -> Floats:
        """What all that came in before each decision does [N 3 9 n], if it was no more than this.

        - `acceleration`: of each joint's `a + w*` [N n], `stray`: of w* beyond what is known [N n].
        - `aims`, `changes`: of p, and of its changes [N n].
        - `part`: of the delay that is not whole.
        """
        count, n = aims.shape
        found = np.empty((count, 3, OUTPUTS, n))
        largest = np.maximum.accumulate(np.stack([aims, changes]), axis=1)
        padded = [_padded(one, self.reach) for one in (aims, changes)]
        for i, (start, stop) in enumerate(pairwise(self.edges)):
            off, size = self.off(i, slice(0, stop)), np.abs(self.matrices[i])
            pushes = np.einsum("kij,kj->ki", off, acceleration[:stop] + stray[:stop]) + stray[:stop] @ size.T
            if part > 0:
                pushes[1:] = np.maximum(pushes[1:], pushes[:-1])
            kernels = self.kernels[i]
            given = (_padded(pushes, self.reach, self.under_way @ off[0].T), *padded)
            for kind, one in enumerate(given):
                windows = self._windows(one, start, stop)
                answer = (windows @ kernels.older[kind].T).reshape(stop - start, OUTPUTS, n)
                # What is older came in before these decisions.
                most = given[0].max(axis=0) if kind == 0 else largest[kind - 1, stop - 1]
                found[start:stop, kind] = answer + kernels.tails[kind] @ most
        return found

    @property
    def reach(self) -> int:
        """Periods that the responses last beyond the first."""
        n = self.matrices.shape[1]
        return int(self.kernels[0].older.shape[2] // n) * LAGS

    def _windows(self, padded: Floats, start: int, stop: int) -> Floats:
        """The largest of LAGS samples each, from the one before a decision back, for each joint [K nB]."""
        recent = np.max([padded[LAGS - 1 - k : len(padded) - k] for k in range(LAGS)], axis=0)
        blocks = self.reach // LAGS
        # recent[i] is of the samples up to i + LAGS - 1 of what is padded by `reach`.
        newest = np.arange(start, stop)[:, None] - 1 + self.reach - (LAGS - 1)
        at = newest - LAGS * np.arange(blocks)[None]
        found: Floats = recent[at].reshape(stop - start, -1)
        return found


def _padded(values: Floats, reach: int, before: Floats | None = None) -> Floats:
    """Values with as many zeros before them, or before what was just before them."""
    found = np.concatenate([np.zeros((reach, values.shape[1])), values])
    if before is not None:
        found[reach - len(before) : reach] = before[::-1]
    return found


def propagated(
    course: Course, together: Together, passing: Passing, first: First, before: Floats
) -> tuple[Bounds, Floats, Floats, Floats]:
    """The bounds of all samples, and what came in at them: each joint's `a + w*`, places, changes [N n].

    - `course`, `passing`: the loop.
    - `together`: of all joints.
    - `first`: how it begins.
    - `before`: from `Together.before`.
    """
    which = np.repeat(np.arange(len(together.kernels)), np.diff(together.edges))
    newest = jnp.asarray(np.array([one.newest for one in together.kernels]))
    off = np.concatenate([together.off(i, slice(*ends)) for i, ends in enumerate(pairwise(together.edges))])
    size = np.abs(together.matrices)
    if course.part > 0:
        # A part of a period is still the last command's, also where another K begins to be taken.
        for i, edge in enumerate(together.edges[1:-1]):
            off[edge - 1] = np.maximum(off[edge - 1], together.off(i + 1, slice(edge - 1, edge))[0])
        size[:-1] = np.maximum(size[:-1], size[1:])
    found, came = _scanned(
        course, passing, first, newest, jnp.asarray(size), jnp.asarray(which), jnp.asarray(off), jnp.asarray(before)
    )
    bounds = Bounds(*(np.asarray(one) for one in found))
    acceleration, aims, changes = (np.asarray(one) for one in came)
    return bounds, acceleration, aims, changes


@functools.partial(jax.jit)
def _scanned(
    course: Course, passing: Passing, first: First, newest: Any, size: Any, which: Any, off: Any, before: Any
) -> Any:
    def step(carry: Any, given: Any) -> Any:
        k, carried = carry
        at, segment, lacking, past = given
        known: list[Any] = []

        def pushed(acceleration: Any) -> tuple[Any, Any]:
            known.append(acceleration[:, 0])
            moved = acceleration[:, 0] + at.stray
            others = lacking @ moved
            return (others + size[segment] @ at.stray)[:, None], (others + size[segment] @ moved)[:, None]

        answers = Answers(
            before=(past[0][..., None], past[1][..., None], past[2][..., None]),
            newest=lambda kind, value: (newest[segment, kind] @ value[:, 0])[..., None],
            pushed=pushed,
        )
        carried, entered, found = sampled(course, first, at, k > 0, carried, answers)
        return (k + 1, carried), (found, (known[0], entered[1][:, 0], entered[2][:, 0]))

    carry = (0, carried_at_first(passing, first, 1))
    return jax.lax.scan(step, carry, (passing, which, off, before))[1]
