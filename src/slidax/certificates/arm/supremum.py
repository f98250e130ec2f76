"""An upper bound of a trigonometric polynomial everywhere, from its values on a grid.

A polynomial of degree d in one angle whose largest |value| is S falls off from there no faster than `S cos(d x)`
(M. Riesz). One of N equidistant points is within π/N of the place, so that `S <= max on the grid / cos(d π/N)` for
`N > 2 d`; joint by joint this is a product. It holds for a matrix in the spectral norm as well, since it holds for each
`uᵀ f v`. Angles that matter little are left off the grid: what they add is bounded by a coarser grid of its own, or by
`Σ ‖c_k‖`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .evaluated import Flags, Floats
from .series import POINTS, Series

MOST_NUMBERS = 6_000_000
"""Of all entries on a grid."""

MOST_POINTS = 720
"""Of one joint."""

MOST_FACTOR = 20.0
"""Of a grid: with a coarser one `Σ ‖c_k‖` is better."""

WORTH = 0.02
"""Share of all that waves that a joint must add, for a grid of its own."""


@dataclass(frozen=True)
class Supremum:
    """What no value exceeds.

    - `upper`: the bound.
    - `seen`: the largest value on the grid, so that the truth is between the two, but for the joints off the grid.
    - `points`: of the grid, for each joint on it.
    - `factor`: of the grid.
    """

    upper: float
    seen: float
    points: int
    factor: float


def supremum(series: Series, degree: int, size: Callable[[Floats], Floats], terms: Callable[[Any], Floats]) -> Supremum:
    """A bound of `max_q ‖f(q)‖`.

    - `series`: f.
    - `degree`: of f in each joint, 1 or 2.
    - `size`: the norm, of each of some values [P ...].
    - `terms`: the norm of each of some complex coefficients [K ...].
    """
    joints = len(series.grid.joints)
    weights = terms(series.coefficients)
    degrees = np.abs(series.grid.degrees)
    entries = int(np.prod(series.coefficients.shape[1:], dtype=int))
    # The joints that take part in most come first.
    order = np.argsort([-float(weights[degrees[:, at] > 0].sum()) for at in range(joints)], kind="stable").tolist()
    # What each joint adds to those before it.
    added = [_of(degrees, order[: k + 1]) & (degrees[:, order[k]] > 0) for k in range(joints)]
    sums = [float(weights[one].sum()) for one in added]
    waves = sum(sums)
    count = min(range(joints + 1), key=lambda k: _factor(k, entries, degree) * 0.5 * sum(sums[:k]) + sum(sums[k:]))
    points, factor = _points(count, entries), _factor(count, entries, degree)
    seen = _largest(series, _of(degrees, order[:count]), sorted(order[:count]), points, size)
    upper = factor * seen
    for k in range(count, joints):
        here = _factor(k + 1, entries, degree)
        if sums[k] > WORTH * waves and here < MOST_FACTOR:
            largest = _largest(series, added[k], sorted(order[: k + 1]), _points(k + 1, entries), size)
            upper += min(here * largest, sums[k])
        else:
            upper += sums[k]
    return Supremum(upper, seen, points, factor)


def _of(degrees: Floats, joints: Sequence[int]) -> Flags:
    """Which coefficients are of these joints alone [K]."""
    others = [at for at in range(degrees.shape[1]) if at not in joints]
    return ~degrees[:, others].any(axis=1)


def _factor(count: int, entries: int, degree: int) -> float:
    points = _points(count, entries)
    return math.cos(degree * math.pi / points) ** -count if points > 2 * degree else math.inf


def _points(count: int, entries: int) -> int:
    if count == 0:
        return MOST_POINTS
    return min(MOST_POINTS, int((MOST_NUMBERS / entries) ** (1.0 / count)))


def _largest(series: Series, terms: Flags, kept: Sequence[int], points: int, size: Callable[[Floats], Floats]) -> float:
    """The largest size on the grid of some joints, of some terms in which the others take no part."""
    joints = len(series.grid.joints)
    shape = series.coefficients.shape[1:]
    coefficients = np.where(terms.reshape(-1, *[1] * len(shape)), series.coefficients, 0.0)
    coefficients = coefficients.reshape(*[POINTS] * joints, *shape)
    # Harmonic 0 stands first.
    picked = coefficients[tuple(slice(None) if at in kept else 0 for at in range(joints))]
    if not kept:
        return float(size(picked.real[None]).max())
    angles = 2.0 * np.pi * np.arange(points) / points
    waves = np.exp(1j * np.outer(angles, np.fft.fftfreq(POINTS, 1.0 / POINTS)))
    # One joint after the other; the first is done in the loop, so that not all postures are in memory at once.
    for axis in range(1, len(kept)):
        picked = np.moveaxis(np.tensordot(waves, picked, axes=(1, axis)), 0, axis)
    flat = picked.reshape(POINTS, -1)
    largest = 0.0
    for wave in waves:
        values = (wave.real @ flat.real - wave.imag @ flat.imag).reshape(-1, *shape)
        largest = max(largest, float(size(values).max()))
    return largest


def spectral(values: Any) -> Floats:
    """The spectral norm of each of some matrices [P n n].

    A Frobenius norm, which is never less, tells which of them need not be looked at.

    - `values`: the matrices.
    """
    frobenius: Floats = np.sqrt((np.abs(values) ** 2).sum(axis=(1, 2)))
    order = np.argsort(-frobenius)
    found = np.zeros(len(values))
    best = 0.0
    for k in range(0, len(order), 256):
        some = order[k : k + 256]
        if frobenius[some[0]] <= best:
            break
        found[some] = np.linalg.norm(values[some], ord=2, axis=(1, 2))
        best = max(best, float(found[some].max()))
    return found


def spectral_of_each(values: Any) -> Floats:
    """The spectral norm of each of some matrices [P n n], all of them.

    - `values`: the matrices, which may be complex.
    """
    return np.linalg.norm(values, ord=2, axis=(1, 2))
