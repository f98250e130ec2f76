"""An upper bound of a trigonometric polynomial everywhere, from its values on a grid.

A polynomial of degree d in one angle whose largest |value| is S falls off from there no faster than `S cos(d x)`
(M. Riesz). One of N equidistant points is within π/N of the place, so `S <= max on the grid / cos(d π/N)` for
`N > 2 d`; over several joints this is a product. It holds for a matrix in the spectral norm as well, because it holds
for each `uᵀ f v`. Angles with little effect are left off the grid: a coarser grid of their own, or `Σ ‖c_k‖`, bounds
what they add.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..each import Flags, Floats
from .series import POINTS, Series

MOST_NUMBERS = 6_000_000
"""Largest number of entries on a grid."""

MOST_POINTS = 720
"""Largest number of points of one joint."""

MOST_FACTOR = 20.0
"""Largest factor of a grid: for a coarser one `Σ ‖c_k‖` is better."""

WORTH = 0.02
"""Share of the whole variation that a joint must add to get a grid of its own."""


@dataclass(frozen=True)
class Supremum:
    """An upper bound.

    - `upper`: the bound.
    - `sampled`: the largest value on the grid; the supremum lies between both, but for the joints off the grid.
    - `points`: points of the grid for each joint on it.
    - `factor`: of the grid.
    """

    upper: float
    sampled: float
    points: int
    factor: float


def supremum(series: Series, degree: int, size: Callable[[Floats], Floats], terms: Callable[[Any], Floats]) -> Supremum:
    """Return a bound of `max_q ‖f(q)‖`.

    - `degree`: of f in each joint, 1 or 2.
    - `size`: the norm of each of some values [P ...].
    - `terms`: the norm of each of some complex coefficients [K ...].
    """
    joints = len(series.grid.joints)
    weights = terms(series.coefficients)
    degrees = np.abs(series.grid.degrees)
    entries = int(np.prod(series.coefficients.shape[1:], dtype=int))
    # Joints with the largest effect come first.
    order = np.argsort([-float(weights[degrees[:, at] > 0].sum()) for at in range(joints)], kind="stable").tolist()
    # Coefficients that each joint adds to those before it.
    added = [_of(degrees, order[: k + 1]) & (degrees[:, order[k]] > 0) for k in range(joints)]
    sums = [float(weights[terms].sum()) for terms in added]
    waves = sum(sums)
    count = min(range(joints + 1), key=lambda k: _factor(k, entries, degree) * 0.5 * sum(sums[:k]) + sum(sums[k:]))
    points, factor = _points(count, entries), _factor(count, entries, degree)
    largest_seen = _largest(series, _of(degrees, order[:count]), sorted(order[:count]), points, size)
    upper = factor * largest_seen
    for k in range(count, joints):
        here = _factor(k + 1, entries, degree)
        if sums[k] > WORTH * waves and here < MOST_FACTOR:
            largest = _largest(series, added[k], sorted(order[: k + 1]), _points(k + 1, entries), size)
            upper += min(here * largest, sums[k])
        else:
            upper += sums[k]
    return Supremum(upper, largest_seen, points, factor)


def _of(degrees: Floats, joints: Sequence[int]) -> Flags:
    """True for coefficients of these joints alone [K]."""
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
    """The largest size on the grid of some joints, over terms without the other joints."""
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
    # Joint by joint; the first in the loop below, so that not all postures are in memory at once.
    for axis in range(1, len(kept)):
        picked = np.moveaxis(np.tensordot(waves, picked, axes=(1, axis)), 0, axis)
    flat = picked.reshape(POINTS, -1)
    largest = 0.0
    for wave in waves:
        values = (wave.real @ flat.real - wave.imag @ flat.imag).reshape(-1, *shape)
        largest = max(largest, float(size(values).max()))
    return largest


def spectral(values: Any) -> Floats:
    """Return the spectral norm of matrices [P n n], or 0 where another one is larger.

    A Frobenius norm is never less, so it shows which matrices need no evaluation.
    """
    frobenius: Floats = np.sqrt((np.abs(values) ** 2).sum(axis=(1, 2)))
    order = np.argsort(-frobenius)
    norms = np.zeros(len(values))
    best = 0.0
    for k in range(0, len(order), 256):
        some = order[k : k + 256]
        if frobenius[some[0]] <= best:
            break
        norms[some] = np.linalg.norm(values[some], ord=2, axis=(1, 2))
        best = max(best, float(norms[some].max()))
    return norms


def spectral_of_each(values: Any) -> Floats:
    """Return the spectral norm of each of some real or complex matrices [P n n]."""
    return np.linalg.norm(values, ord=2, axis=(1, 2))
