"""The joints together: what moves one with another is known as a matrix K that moves, and only the rest is a push."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from .coupled_kernels import CoupledKernels
from .kernels import OUTPUTS
from .propagation import Answers, Bounds, Course, First, Passing, carried_at_first, sampled

Floats = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Together:
    """The loops along time; units of periods.

    - `kernels`: of the decisions, `width` of them together.
    - `size`: |K| as it is taken to be in each decision's period [N n n].
    - `off`: by how much K may be another there [N n n].
    - `under_way`: bounds of `a + w*` of the commands that were decided before the first, the newest first [Q n].
    """

    kernels: CoupledKernels
    width: int
    size: Floats
    off: Floats
    under_way: Floats

    @property
    def which(self) -> NDArray[np.integer[Any]]:
        """The number of each decision's kernels [N]."""
        return np.arange(len(self.off)) // self.width

    def before(self, acceleration: Floats, stray: Floats, aims: Floats, changes: Floats, part: float) -> Floats:
        """What all that came in before each decision does [N 3 9 n], if it was no more than this.

        - `acceleration`: of each joint's `a + w*` [N n], `stray`: of w* beyond what is known [N n].
        - `aims`, `changes`: of p, and of its changes [N n].
        - `part`: of the delay that is not whole.
        """
        count, n = aims.shape
        found = np.empty((count, 3, OUTPUTS, n))
        pushes = np.einsum("kij,kj->ki", self.off, acceleration + stray) + np.einsum("kij,kj->ki", self.size, stray)
        if part > 0:
            pushes[1:] = np.maximum(pushes[1:], pushes[:-1])
        begun = self.under_way @ self.off[0].T
        for kind, (given, first) in enumerate(((pushes, begun), (aims, None), (changes, None))):
            recent = self._recent(given, first)
            most = np.maximum.accumulate(given, axis=0)
            if first is not None:
                most = np.maximum(most, first.max(axis=0))
            for number in range(len(self.kernels.tails)):
                at = slice(number * self.width, min((number + 1) * self.width, count))
                older = self.kernels.older[kind, number]
                answer = np.tensordot(recent[at], older, axes=([1, 2], [0, 2]))
                answer += most[at] @ self.kernels.tails[number].T
                found[at, kind] = answer.reshape(-1, OUTPUTS, n)
        return found

    def _recent(self, values: Floats, before: Floats | None) -> Floats:
        """The largest at the lags that are taken together, for each decision [N B n]."""
        longest = self.kernels.longest
        padded = np.concatenate([np.zeros((longest, values.shape[1])), values])
        if before is not None:
            padded[longest - len(before) : longest] = before[::-1]
        count = len(values)
        found, widest = [], {}
        for lags in self.kernels.lumps:
            width = len(lags)
            if width not in widest:
                # At i the largest of those from i on.
                widest[width] = np.max([padded[k : len(padded) - width + 1 + k] for k in range(width)], axis=0)
            first = longest - lags[-1]
            found.append(widest[width][first : first + count])
        return np.stack(found, axis=1)


def propagated(
    course: Course, together: Together, passing: Passing, first: First, before: Floats
) -> tuple[Bounds, Floats, Floats, Floats]:
    """The bounds of all samples, and what came in at them: each joint's `a + w*`, places, changes [N n].

    - `course`, `passing`: the loop.
    - `together`: of all joints.
    - `first`: how it begins.
    - `before`: from `Together.before`.
    """
    _, count, _, n = together.kernels.newest.shape
    newest = jnp.asarray(together.kernels.newest.reshape(3, count, OUTPUTS, n, n).swapaxes(0, 1))
    given = (together.size, together.which, together.off, before)
    found, came = _scanned(course, passing, first, newest, *(jnp.asarray(one) for one in given))
    bounds = Bounds(*(np.asarray(one) for one in found))
    acceleration, aims, changes = (np.asarray(one) for one in came)
    return bounds, acceleration, aims, changes


@functools.partial(jax.jit)
def _scanned(
    course: Course, passing: Passing, first: First, newest: Any, size: Any, which: Any, off: Any, before: Any
) -> Any:
    def step(carry: Any, given: Any) -> Any:
        k, carried = carry
        at, known_size, number, lacking, past = given
        known: list[Any] = []

        def pushed(acceleration: Any) -> tuple[Any, Any]:
            known.append(acceleration[:, 0])
            moved = acceleration[:, 0] + at.stray
            others = lacking @ moved
            return (others + known_size @ at.stray)[:, None], (others + known_size @ moved)[:, None]

        answers = Answers(
            before=(past[0][..., None], past[1][..., None], past[2][..., None]),
            newest=lambda kind, value: (newest[number, kind] @ value[:, 0])[..., None],
            pushed=pushed,
        )
        carried, entered, found = sampled(course, first, at, k > 0, carried, answers)
        return (k + 1, carried), (found, (known[0], entered[1][:, 0], entered[2][:, 0]))

    carry = (0, carried_at_first(passing, first, 1))
    return jax.lax.scan(step, carry, (passing, size, which, off, before))[1]
