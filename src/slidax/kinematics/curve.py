"""Curves of tool poses, with the parameter s from 0 to 1."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from math import comb
from typing import NamedTuple

import numpy as np

from .series import Array, Series, constant, cosine_and_sine, cross, inverse_root, product, scaled, total, wide


class Aim(NamedTuple):
    """Target of the tool: its axes x, y, z and its position, series of vectors [... 3]."""

    x: Series
    y: Series
    z: Series
    place: Series


class AbstractCurve:
    """A smooth curve of poses."""

    @abstractmethod
    def aim(self, s: Series) -> Aim:
        """Return the target at s in [0, 1], a series of numbers [...]."""

    def at(self, s: Array | float) -> tuple[Array, Array]:
        """Return orientation [... 3 3] and position [... 3], m, at s in [0, 1]."""
        aim = self.aim([np.asarray(s, float)])
        return np.stack([aim.x[0], aim.y[0], aim.z[0]], axis=-1), aim.place[0]


@dataclass(frozen=True, kw_only=True, eq=False)
class Helix(AbstractCurve):
    """`p(s) = c + R(a, s φ) (p_0 - c) + s d`, rotated by `R(b, s ψ) R_0`: a line, an arc or a screw.

    - `rotation`, `place`: R_0 [3 3] and p_0 [3], m.
    - `shift`: d [3], m.
    - `center`: c, a point of the axis [3], m.
    - `axis`, `angle`: unit vector a [3], and φ, rad.
    - `spin_axis`, `spin`: unit vector b [3], and ψ, rad.
    """

    rotation: Array
    place: Array
    center: Array
    shift: Array
    axis: Array
    angle: float = 0.0
    spin_axis: Array
    spin: float = 0.0

    def aim(self, s: Series) -> Aim:
        arm = _turned(self.axis, scaled(s, self.angle), self.place - self.center)
        shift = [None if coefficient is None else coefficient[..., None] * self.shift for coefficient in s]
        place = total(constant(self.center, len(s)), arm, shift)
        x, y, z = (_turned(self.spin_axis, scaled(s, self.spin), column) for column in self.rotation.T)
        return Aim(x, y, z, place)


@dataclass(frozen=True, kw_only=True, eq=False)
class Spline(AbstractCurve):
    """Polynomials for the position and for a quaternion, which is then normalised.

    - `knots`: from 0 to 1 [k].
    - `coefficients`: position and quaternion in powers of `s - knots[i]`, highest first [powers k-1 7].
    """

    knots: Array
    coefficients: Array

    def aim(self, s: Series) -> Aim:
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
        place = [None if value is None else value[..., :3] for value in value]
        size = product(value, value, lambda a, b: np.sum(a[..., 3:] * b[..., 3:], axis=-1))
        unit = product(inverse_root(size), value, lambda a, b: a[..., None] * b[..., 3:])
        x, y, z = _axes(unit)
        return Aim(x, y, z, place)


def standing(rotation: Array, place: Array) -> Helix:
    """Return the curve that stays at a pose, [3 3] and [3], m."""
    still = np.zeros(3)
    up = np.array([0.0, 0.0, 1.0])
    return Helix(rotation=rotation, place=place, center=place, shift=still, axis=up, spin_axis=up)


def _turned(axis: Array, angle: Series, vector: Array) -> Series:
    """Rotate a vector about an axis, by Rodrigues' formula."""
    cosine, sine = cosine_and_sine(angle)
    crossed = cross(axis, vector)
    again = cross(axis, crossed)
    versine = total(constant(np.ones_like(angle[0]), len(angle)), scaled(cosine, -1.0))
    still = constant(np.broadcast_to(vector, (*angle[0].shape, 3)), len(angle))
    along = constant(crossed, len(angle))
    return total(still, product(sine, along, wide), product(versine, constant(again, len(angle)), wide))


def _axes(quaternion: Series) -> tuple[Series, Series, Series]:
    """Columns of the rotation matrix of a quaternion."""

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
