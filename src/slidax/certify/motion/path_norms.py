"""Norms of points at the centres of a motion's cells, in the metric of the nominal inertia there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .body_points import PointMotion

if TYPE_CHECKING:
    from .path import Path

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PointNorms:
    """Norms of a set of points at the centres, in the metric there.

    - `size`, `first`, `second`: of Y, Ẏ and Ÿ [N].
    - `coriolis`, `coriolis_rate`: of `2 YᵀẎ` and of its rate [N].
    - `slopes`, `turning`: of `∂_j Y` and `Yᵀ ∂_j Y` [N n]; `slopes_norm`, `turning_norm`: of their sums over j, per
      norm of the velocities [N].
    - `outer`: ‖Y x‖ of joints from k on, for ‖x‖ = 1 [N n]; `own`: ‖∂_k X‖ [N n].
    - `force`, `bend`: of `Ẍ - g` and of `X⃛` without its share of the jerk, per body [N n].
    """

    size: Floats
    first: Floats
    second: Floats
    coriolis: Floats
    coriolis_rate: Floats
    slopes: Floats
    turning: Floats
    slopes_norm: Floats
    turning_norm: Floats
    outer: Floats
    own: Floats
    force: Floats
    bend: Floats

    @classmethod
    def of(cls, path: Path, points: PointMotion) -> PointNorms:
        """Compute the norms at the centres of a path's cells."""
        root = path.root
        y = points.columns[0]
        unit, unit1, unit2 = (part @ root for part in points.columns)
        slopes = np.moveaxis(points.slopes, 1, 3).reshape(len(y), -1, y.shape[1])
        turning = slopes @ unit
        before = path.bodies.before
        behind = before[None, :, :, None] & before[None, :, None, :]
        parts = np.where(behind, gram(y, y)[:, None], 0.0)
        slopes_each, slopes_norm = slope_norms(slopes, root)
        turning_each, turning_norm = slope_norms(turning, root)
        return cls(
            size=spectral_norm(unit),
            first=spectral_norm(unit1),
            second=spectral_norm(unit2),
            coriolis=2.0 * spectral_norm(gram(unit, unit1)),
            coriolis_rate=2.0 * spectral_norm(gram(unit1, unit1) + gram(unit, unit2)),
            slopes=slopes_each,
            turning=turning_each,
            slopes_norm=slopes_norm,
            turning_norm=turning_norm,
            outer=np.sqrt(np.maximum(np.einsum("nkij,nij->nk", parts, path.inverse), 0.0)),
            own=np.sqrt(np.einsum("ndk,ndk->nk", y, y)),
            force=by_body(points.acceleration),
            bend=by_body(points.jerk - np.einsum("ndk,nk->nd", y, path.cells.dddq)),
        )


def by_body(points: Floats) -> Floats:
    """Return the size of each body's points [N n ...] from [N D ...]."""
    bodies = points.reshape(len(points), -1, 12, *points.shape[2:])
    return np.asarray(np.linalg.norm(bodies, axis=2))


def gram(a: Floats, b: Floats) -> Floats:
    """Return `aᵀ b` [N n n]."""
    return np.asarray(a.swapaxes(1, 2) @ b)


def spectral_norm(a: Floats) -> Floats:
    """Return spectral norms [N]."""
    return np.sqrt(np.maximum(np.linalg.eigvalsh(gram(a, a))[:, -1], 0.0))


def slope_norms(slopes: Floats, root: Floats) -> tuple[Floats, Floats]:
    """Return the norms of `∂_j Y` [N n], and a bound of the norm of `Σ_j v_j ∂_j Y` for all v of norm 1 [N].

    - `slopes`: `∂_j Y_k` [N n² D] in the order (j, k).
    """
    n = root.shape[1]
    products = (slopes @ slopes.swapaxes(1, 2)).reshape(-1, n, n, n, n)
    inverse = root @ root.swapaxes(1, 2)
    each = np.einsum("njkjl,nkl->nj", products, inverse)
    square = root.swapaxes(1, 2) @ np.einsum("njkil,nji->nkl", products, inverse) @ root
    both = np.sqrt(np.maximum(each, 0.0)), np.sqrt(np.maximum(np.linalg.eigvalsh(square)[:, -1], 0.0))
    return both


def size_in(x: Floats, inertia: Floats) -> Floats:
    """Return `√(|x|ᵀ |M| |x|)` [N], the largest norm of a vector whose entries have these sizes."""
    return np.sqrt(np.einsum("ni,nij,nj->n", x, inertia, x))
