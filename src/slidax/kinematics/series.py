"""Truncated Taylor series of arrays, for exact derivatives along a curve without compilation.

A series is a list of coefficients by power, the value first; None stands for zero.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Series: TypeAlias = list[Any]


def constant(value: Array, orders: int) -> Series:
    """Return the series of a constant, with `orders` coefficients."""
    return [value, *[None] * (orders - 1)]


def total(*terms: Series) -> Series:
    """Return the sum of series with equally many coefficients."""
    return [_sum([term[k] for term in terms]) for k in range(len(terms[0]))]


def scaled(series: Series, factor: Any) -> Series:
    """Return a series times a constant number or array."""
    return [None if coefficient is None else factor * coefficient for coefficient in series]


def product(a: Series, b: Series, bilinear: Callable[[Any, Any], Any] = np.multiply) -> Series:
    """Return the product of two series, by a bilinear product of their coefficients."""
    coefficients: Series = []
    for k in range(len(a)):
        parts = [(a[i], b[k - i]) for i in range(k + 1)]
        coefficients.append(_sum([bilinear(x, y) for x, y in parts if x is not None and y is not None]))
    return coefficients


def cosine_and_sine(angle: Series) -> tuple[Series, Series]:
    """Return cosine and sine of an angle [rad] with at most three coefficients."""
    c, s = np.cos(angle[0]), np.sin(angle[0])
    first, second = (*angle[1:], None, None)[:2]
    cosine: Series = [c, None if first is None else -s * first]
    sine: Series = [s, None if first is None else c * first]
    square = None if first is None else 0.5 * first * first
    cosine.append(_sum([None if second is None else -s * second, None if square is None else -c * square]))
    sine.append(_sum([None if second is None else c * second, None if square is None else -s * square]))
    return cosine[: len(angle)], sine[: len(angle)]


def inverse_root(series: Series) -> Series:
    """Return `x^(-1/2)` for x > 0 with at most three coefficients."""
    x = series[0]
    root = x**-0.5
    first, second = (*series[1:], None, None)[:2]
    coefficients: Series = [root, None if first is None else -0.5 * root / x * first]
    coefficients.append(
        _sum(
            [
                None if second is None else -0.5 * root / x * second,
                None if first is None else 0.375 * root / x**2 * first * first,
            ]
        )
    )
    return coefficients[: len(series)]


def cross(a: Array, b: Array) -> Array:
    """Return `a × b` in the last axis, [... 3]."""
    # Twice as fast as NumPy's own for few vectors.
    x, y = a[..., [1, 2, 0]], b[..., [2, 0, 1]]
    return x * y - a[..., [2, 0, 1]] * b[..., [1, 2, 0]]


def dot(a: Array, b: Array) -> Array:
    """Return `a · b` in the last axis."""
    return np.sum(a * b, axis=-1)


def wide(a: Array, b: Array) -> Array:
    """Return numbers [...] times vectors [... 3]."""
    return a[..., None] * b


def _sum(terms: list[Any]) -> Any:
    known = [term for term in terms if term is not None]
    if not known:
        return None
    result = known[0]
    for term in known[1:]:
        result = result + term
    return result
