"""Coupled bound: the time-varying coupling K is known, and only its uncertainty enters as a disturbance."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from ..each import Floats
from .coupled_kernels import CoupledKernels
from .kernels import OUTPUTS
from .propagation import Answers, Bounds, Course, First, Passing, carried_at_first, sampled


@dataclass(frozen=True)
class Together:
    """The coupled loop along time; units of periods.

    - `kernels`: of the decisions, one for each `width` of them.
    - `size`: |K| of the model in each decision's period [N n n].
    - `off`: deviation of K from it [N n n].
    - `under_way`: bounds of `a + w*` of the commands decided before the first, the newest first [Q n].
    """

    kernels: CoupledKernels
    width: int
    size: Floats
    off: Floats
    under_way: Floats

    @property
    def which(self) -> NDArray[np.integer[Any]]:
        """The number of each decision's responses [N]."""
        return np.arange(len(self.off)) // self.width

    def before(self, acceleration: Floats, stray: Floats, aims: Floats, changes: Floats, part: float) -> Floats:
        """Effect of all inputs before each decision [N 3 9 n], for bounds of these inputs.

        - `acceleration`: of each joint's `a + w*` [N n]; `stray`: of the unknown part of w* [N n].
        - `aims`, `changes`: of p, and of its changes [N n].
        - `part`: fractional part of the delay.
        """
        count, n = aims.shape
        answers = np.empty((count, 3, OUTPUTS, n))
        pushes = np.einsum("kij,kj->ki", self.off, acceleration + stray) + np.einsum("kij,kj->ki", self.size, stray)
        if part > 0:
            pushes[1:] = np.maximum(pushes[1:], pushes[:-1])
        begun = self.under_way @ self.off[0].T
        for kind, (values, first) in enumerate(((pushes, begun), (aims, None), (changes, None))):
            recent = self._recent(values, first)
            most = np.maximum.accumulate(values, axis=0)
            if first is not None:
                most = np.maximum(most, first.max(axis=0))
            for number in range(len(self.kernels.tails)):
                at = slice(number * self.width, min((number + 1) * self.width, count))
                older = self.kernels.older[kind, number]
                answer = np.tensordot(recent[at], older, axes=([1, 2], [0, 2]))
                answer += most[at] @ self.kernels.tails[number].T
                answers[at, kind] = answer.reshape(-1, OUTPUTS, n)
        return answers

    def _recent(self, values: Floats, before: Floats | None) -> Floats:
        """The largest value in each group of lags, for each decision [N B n]."""
        longest = self.kernels.longest
        padded = np.concatenate([np.zeros((longest, values.shape[1])), values])
        if before is not None:
            padded[longest - len(before) : longest] = before[::-1]
        count = len(values)
        recent, widest = [], {}
        for lags in self.kernels.lumps:
            width = len(lags)
            if width not in widest:
                # At i the largest of those from i on.
                widest[width] = np.max([padded[k : len(padded) - width + 1 + k] for k in range(width)], axis=0)
            first = longest - lags[-1]
            recent.append(widest[width][first : first + count])
        return np.stack(recent, axis=1)


def propagated(
    course: Course, together: Together, passing: Passing, first: First, before: Floats
) -> tuple[Bounds, Floats, Floats, Floats]:
    """Return the bounds of all samples, and their inputs: each joint's `a + w*`, targets, changes [N n].

    - `before`: from `Together.before`.
    """
    _, count, _, n = together.kernels.newest.shape
    newest = jnp.asarray(together.kernels.newest.reshape(3, count, OUTPUTS, n, n).swapaxes(0, 1))
    inputs = (together.size, together.which, together.off, before)
    rows, came = _scanned(course, passing, first, newest, *(jnp.asarray(value) for value in inputs))
    bounds = Bounds(*(np.asarray(value) for value in rows))
    acceleration, aims, changes = (np.asarray(value) for value in came)
    return bounds, acceleration, aims, changes


@functools.partial(jax.jit)
def _scanned(
    course: Course, passing: Passing, first: First, newest: Any, size: Any, which: Any, off: Any, before: Any
) -> Any:
    def step(carry: Any, inputs: Any) -> Any:
        k, carried = carry
        at, known_size, number, lacking, past = inputs
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
        carried, entered, bounds = sampled(course, first, at, k > 0, carried, answers)
        return (k + 1, carried), (bounds, (known[0], entered[1][:, 0], entered[2][:, 0]))

    carry = (0, carried_at_first(passing, first, 1))
    return jax.lax.scan(step, carry, (passing, size, which, off, before))[1]
