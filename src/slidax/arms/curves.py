"""Curves of tool poses, with exact derivatives as truncated Taylor series."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from math import comb
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Series: TypeAlias = list[Any]
"""Coefficients of a truncated Taylor series, from order 0 on; None for a coefficient that is 0."""


def constant(value: Array, orders: int) -> Series:
    """Return the series of a constant, with `orders` coefficients."""
    return [value, *[None] * (orders - 1)]


def sum_series(*terms: Series) -> Series:
    """Return the sum of Taylor series with the same number of coefficients."""
    return [_sum([term[k] for term in terms]) for k in range(len(terms[0]))]


def scale_series(series: Series, factor: Any) -> Series:
    """Return a Taylor series times a constant number or array."""
    return [None if coefficient is None else factor * coefficient for coefficient in series]


def product(a: Series, b: Series, bilinear: Callable[[Any, Any], Any] = np.multiply) -> Series:
    """Return the product of two Taylor series, truncated to the coefficients of `a`.

    - `bilinear`: product of two coefficients, such as `cross` for vectors.
    """
    coefficients: Series = []
    for k in range(len(a)):
        parts = [(a[i], b[k - i]) for i in range(k + 1)]
        coefficients.append(_sum([bilinear(x, y) for x, y in parts if x is not None and y is not None]))
    return coefficients


def cosine_and_sine(angle: Series) -> tuple[Series, Series]:
    """Return cosine and sine of an angle [rad], a Taylor series with at most three coefficients."""
    c, s = np.cos(angle[0]), np.sin(angle[0])
    first, second = (*angle[1:], None, None)[:2]
    cosine: Series = [c, None if first is None else -s * first]
    sine: Series = [s, None if first is None else c * first]
    square = None if first is None else 0.5 * first * first
    cosine.append(_sum([None if second is None else -s * second, None if square is None else -c * square]))
    sine.append(_sum([None if second is None else c * second, None if square is None else -s * square]))
    return cosine[: len(angle)], sine[: len(angle)]


def inverse_root(series: Series) -> Series:
    """Return `x^(-1/2)` of a Taylor series x > 0 with at most three coefficients."""
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
    # Twice as fast as `np.cross` for a few vectors.
    x, y = a[..., [1, 2, 0]], b[..., [2, 0, 1]]
    return x * y - a[..., [2, 0, 1]] * b[..., [1, 2, 0]]


def dot(a: Array, b: Array) -> Array:
    """Return `a · b` in the last axis."""
    return np.sum(a * b, axis=-1)


def scale_vectors(a: Array, b: Array) -> Array:
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


class TargetPose(NamedTuple):
    """Target pose of the tool: axes x, y, z and position, Taylor series of vectors [... 3]."""

    x: Series
    y: Series
    z: Series
    position: Series


class AbstractCurve:
    """A smooth curve of poses."""

    @abstractmethod
    def aim(self, s: Series) -> TargetPose:
        """Return the target pose at the curve parameter s in [0, 1], a Taylor series of numbers [...]."""

    def at(self, s: Array | float) -> tuple[Array, Array]:
        """Return orientation [... 3 3] and position [... 3], m, at the curve parameter s in [0, 1]."""
        aim = self.aim([np.asarray(s, float)])
        return np.stack([aim.x[0], aim.y[0], aim.z[0]], axis=-1), aim.position[0]


@dataclass(frozen=True, kw_only=True, eq=False)
class Helix(AbstractCurve):
    """`p(s) = c + R(a, s φ) (p_0 - c) + s d`, with the axes `R(b, s ψ) R_0`: a line, an arc or a screw.

    s is the curve parameter in [0, 1], and R(a, x) the rotation about a by the angle x.

    - `rotation`, `position`: the pose at s = 0, R_0 [3 3] and p_0 [3], m.
    - `shift`: d [3], m.
    - `center`: c, a point on the axis of the rotation by φ [3], m.
    - `axis`, `angle`: unit vector a [3], and φ, rad.
    - `spin_axis`, `spin`: unit vector b [3], and ψ, rad.
    """

    rotation: Array
    position: Array
    center: Array
    shift: Array
    axis: Array
    angle: float = 0.0
    spin_axis: Array
    spin: float = 0.0

    def aim(self, s: Series) -> TargetPose:
        arm = _rotate(self.axis, scale_series(s, self.angle), self.position - self.center)
        shift = [None if coefficient is None else coefficient[..., None] * self.shift for coefficient in s]
        position = sum_series(constant(self.center, len(s)), arm, shift)
        x, y, z = (_rotate(self.spin_axis, scale_series(s, self.spin), column) for column in self.rotation.T)
        return TargetPose(x, y, z, position)


@dataclass(frozen=True, kw_only=True, eq=False)
class Spline(AbstractCurve):
    """Polynomials for the position and for a quaternion, which is then normalised.

    - `knots`: curve parameters, increasing from 0 to 1 [k].
    - `coefficients`: position [m] and quaternion in powers of `s - knots[i]`, highest first [powers k-1 7].
    """

    knots: Array
    coefficients: Array

    def aim(self, s: Series) -> TargetPose:
        piece = np.clip(np.searchsorted(self.knots, s[0], side="right") - 1, 0, self.coefficients.shape[1] - 1)
        into = s[0] - self.knots[piece]
        powers = self.coefficients[::-1][:, piece]
        own = [
            sum(comb(k, order) * into[..., None] ** (k - order) * powers[k] for k in range(order, len(powers)))
            for order in range(len(s))
        ]
        value: Series = [own[0]]
        if len(s) > 1:
            value.append(None if s[1] is None else own[1] * s[1][..., None])
        if len(s) > 2:
            bent = None if s[1] is None else own[2] * (s[1] ** 2)[..., None]
            more = None if s[2] is None else own[1] * s[2][..., None]
            value.append(bent if more is None else more if bent is None else bent + more)
        position = [None if value is None else value[..., :3] for value in value]
        size = product(value, value, lambda a, b: np.sum(a[..., 3:] * b[..., 3:], axis=-1))
        unit = product(inverse_root(size), value, lambda a, b: a[..., None] * b[..., 3:])
        x, y, z = _axes(unit)
        return TargetPose(x, y, z, position)


def constant_pose(rotation: Array, position: Array) -> Helix:
    """Return the curve that stays at a pose, [3 3] and [3], m."""
    still = np.zeros(3)
    up = np.array([0.0, 0.0, 1.0])
    return Helix(rotation=rotation, position=position, center=position, shift=still, axis=up, spin_axis=up)


def _rotate(axis: Array, angle: Series, vector: Array) -> Series:
    """Rotate a vector about an axis by an angle, a series, with Rodrigues' formula."""
    cosine, sine = cosine_and_sine(angle)
    crossed = cross(axis, vector)
    again = cross(axis, crossed)
    versine = sum_series(constant(np.ones_like(angle[0]), len(angle)), scale_series(cosine, -1.0))
    still = constant(np.broadcast_to(vector, (*angle[0].shape, 3)), len(angle))
    along = constant(crossed, len(angle))
    return sum_series(
        still, product(sine, along, scale_vectors), product(versine, constant(again, len(angle)), scale_vectors)
    )


def _axes(quaternion: Series) -> tuple[Series, Series, Series]:
    """Return the columns of a unit quaternion's rotation matrix, Taylor series of vectors."""

    def columns(a: Array, b: Array) -> Array:
        w, x, y, z = (a[..., k] for k in range(4))
        v, i, j, k = (b[..., m] for m in range(4))
        return np.stack(
            [
                np.stack([w * v + x * i - y * j - z * k, 2 * (x * j + w * k), 2 * (x * k - w * j)], axis=-1),
                np.stack([2 * (x * j - w * k), w * v - x * i + y * j - z * k, 2 * (y * k + w * i)], axis=-1),
                np.stack([2 * (x * k + w * j), 2 * (y * k - w * i), w * v - x * i - y * j + z * k], axis=-1),
            ],
            axis=0,
        )

    matrix = product(quaternion, quaternion, columns)
    x, y, z = ([None if value is None else value[k] for value in matrix] for k in range(3))
    return x, y, z
