"""Norms of derivatives of body points at the centres of a motion's cells.

X(q) has the positions of the points (body_points.py), and `Y = ∂X/∂q` is their Jacobian. Joint vectors have norms in
the metric of the nominal inertia matrix M0 at the centre: `‖x‖² = xᵀ M0 x`.
"""

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
    """Norms of derivatives of points X at the centres, with norms of joint vectors in the metric of M0 there.

    Y is the Jacobian ∂X/∂q, and ∂_j the derivative by q_j. M0 is the nominal inertia matrix.

    - `size`, `first`, `second`: norms of Y, Ẏ and Ÿ [cells].
    - `coriolis`, `coriolis_rate`: norms of `2 YᵀẎ` and of its rate [cells].
    - `slopes`, `turning`: Frobenius norms of `∂_j Y` and `Yᵀ ∂_j Y` for each joint j [cells n].
    - `slopes_norm`, `turning_norm`: bounds of `‖Σ_j v_j ∂_j Y‖` and `‖Σ_j v_j Yᵀ ∂_j Y‖` over all v of norm 1 [cells].
    - `outer`: for each joint k, a bound of ‖Y_k x‖ over ‖x‖ = 1 [cells n]. Y_k has the columns of Y for k and for the
      joints that k carries, and is 0 elsewhere.
    - `own`: ‖∂_k X‖ of each joint k [cells n].
    - `force`, `bend`: norms of `Ẍ - g` and of `X⃛ - Y q⃛` over the points of each body [cells n].
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
    def of(cls, path: Path, points: PointMotion, moments: PointMoments, *, cover: bool = False) -> PointNorms:
        """Compute the norms at the centres of a path's cells.

        - `path`: the motion's cells. `points`: motion of the points. `moments`: inner products for the same points.
        - `cover`: True for the points of a cover, which bound errors `-C <= ΔJ <= C` of pseudo-inertias. Then each
          norm of a product is replaced by the product of the norms, since inner products with ΔJ may exceed those with
          C.
        """
        root, pairs = path.root, path.pairs
        y = points.columns[0]
        unit, unit1, unit2 = (part @ root for part in points.columns)
        before = path.bodies.before
        behind = before[None, :, :, None] & before[None, :, None, :]
        parts = np.where(behind, gram(y, y)[:, None], 0.0)
        size, first, second = spectral_norm(unit), spectral_norm(unit1), spectral_norm(unit2)
        slopes, slopes_norm = moments.slopes(pairs, path.inverse, root)
        if cover:
            coriolis, rate = size * first, first**2 + size * second
            turning, turning_norm = size[:, None] * slopes, size * slopes_norm
        else:
            coriolis = spectral_norm(gram(unit, unit1))
            rate = spectral_norm(gram(unit1, unit1) + gram(unit, unit2))
            turning, turning_norm = moments.turning(pairs, path.inverse, root)
        return cls(
            size=size,
            first=first,
            second=second,
            coriolis=2.0 * coriolis,
            coriolis_rate=2.0 * rate,
            slopes=slopes,
            turning=turning,
            slopes_norm=slopes_norm,
            turning_norm=turning_norm,
            outer=np.sqrt(np.maximum(np.einsum("nkij,nij->nk", parts, path.inverse), 0.0)),
            own=np.sqrt(np.einsum("ndk,ndk->nk", y, y)),
            force=by_body(points.acceleration),
            bend=by_body(points.jerk - np.einsum("ndk,nk->nd", y, path.cells.dddq)),
        )


def by_body(points: Floats) -> Floats:
    """Return for each body the norm of the values at its four points [cells n ...].

    - `points`: values for the D = 12 n coordinates of all points [cells D ...].
    """
    bodies = points.reshape(len(points), -1, 12, *points.shape[2:])
    return np.asarray(np.linalg.norm(bodies, axis=2))


def gram(a: Floats, b: Floats) -> Floats:
    """Return `aᵀ b` of each cell [cells n n], from matrices [cells D n]."""
    return np.asarray(a.swapaxes(1, 2) @ b)


def spectral_norm(a: Floats) -> Floats:
    """Return the spectral norm of each cell's matrix [cells]."""
    return np.sqrt(np.maximum(np.linalg.eigvalsh(gram(a, a))[:, -1], 0.0))


@dataclass(frozen=True, eq=False)
class JointPairs:
    """Pairs (j, k) of joints, for the second derivatives `∂_j∂_k X` of points X by joint positions.

    If one joint is or carries the other, `∂_j∂_k X = z_inner × ∂_outer X`, with the joints' axes z. Otherwise it is 0.

    - `inner`, `outer`: the smaller and the larger index of each pair; a joint has a larger index than those that carry
      it [n n].
    - `known`: 1 where one joint is or carries the other, else 0 [n n].
    """

    inner: NDArray[np.intp]
    outer: NDArray[np.intp]
    known: Floats

    @classmethod
    def of(cls, before: NDArray[np.bool_]) -> JointPairs:
        """Return the pairs of an arm's joints.

        - `before`: as in `BodyPoints`: True where the row's joint is or carries the column's joint [n n].
        """
        pairs = np.sort(np.indices(before.shape), axis=0)
        inner, outer = pairs[0], pairs[1]
        return cls(inner, outer, np.where(before[inner, outer], 1.0, 0.0))


@dataclass(frozen=True, eq=False)
class PointMoments:
    """Inner products of the vectors `z_a × ∂_k X` over all points X, with the axis z_a of each joint a.

    - `slopes_products`: `(z_a × ∂_k X) · (z_b × ∂_l X)` [cells a k b l].
    - `slopes_columns`: `(z_a × ∂_k X) · ∂_l X` [cells a k l].
    """

    slopes_products: Floats
    slopes_columns: Floats

    @classmethod
    def of(cls, y: Floats, axes: Floats) -> PointMoments:
        """Compute the products from `Σ ∂_k X ∂_l Xᵀ`, a 3 × 3 matrix of each pair of joints.

        - `y`: `Y = ∂X/∂q` [cells D n]. `axes`: the joints' axes z, 0 for a prismatic joint [cells n 3].
        """
        count, n = axes.shape[:2]
        stacked = y.reshape(count, -1, 3 * n)
        moments = (stacked.swapaxes(1, 2) @ stacked).reshape(count, 3, n, 3, n)
        # (a × u)·(b × v) = (a·b)(u·v) - (a·v)(b·u).
        along = moments.swapaxes(3, 4).reshape(count, -1, 3) @ axes.swapaxes(1, 2)
        both = (axes @ along.reshape(count, 3, -1)).reshape(count, n, n, n, n)
        sums = np.trace(moments, axis1=1, axis2=3)
        angles = axes @ axes.swapaxes(1, 2)
        products = angles[:, :, None, :, None] * sums[:, None, :, None] - both.transpose(0, 4, 2, 1, 3)
        crossed = [moments[:, i, :, j] - moments[:, j, :, i] for i, j in ((1, 2), (2, 0), (0, 1))]
        columns = (axes @ np.stack(crossed, axis=1).reshape(count, 3, -1)).reshape(count, n, n, n)
        return cls(products, columns)

    def slopes(self, pairs: JointPairs, inverse: Floats, root: Floats) -> tuple[Floats, Floats]:
        """Return the Frobenius norms of `∂_j Y`, and a bound of `‖Σ_j v_j ∂_j Y‖` over v of norm 1.

        `Y = ∂X/∂q` is the Jacobian of the points X; joint vectors have norms in the metric of M0. Returns [cells n] and
        [cells].

        - `pairs`: tables of the pairs of joints. `inverse`: M0⁻¹ [cells n n].
        - `root`: `G⁻ᵀ` with `M0 = G Gᵀ` [cells n n].
        """
        count, n = inverse.shape[:2]
        j, i, k, l = np.indices((n, n, n, n))
        places = np.ravel_multi_index(
            (pairs.inner[j, k], pairs.outer[j, k], pairs.inner[i, l], pairs.outer[i, l]), (n, n, n, n)
        )
        products = self.slopes_products.reshape(count, -1)[:, places.reshape(n * n, n * n)]
        products = products * (pairs.known[j, k] * pairs.known[i, l]).reshape(n * n, n * n)
        each = (products[:, :: n + 1] @ inverse.reshape(count, -1, 1))[..., 0]
        square = (inverse.reshape(count, 1, -1) @ products).reshape(count, n, n)
        return _sizes(each, square, root)

    def turning(self, pairs: JointPairs, inverse: Floats, root: Floats) -> tuple[Floats, Floats]:
        """Return the Frobenius norms of `Yᵀ ∂_j Y`, and a bound of `‖Σ_j v_j Yᵀ ∂_j Y‖` over v of norm 1.

        `Y = ∂X/∂q` is the Jacobian of the points X; joint vectors have norms in the metric of M0. Returns [cells n] and
        [cells].

        - `pairs`: tables of the pairs of joints. `inverse`: M0⁻¹ [cells n n].
        - `root`: `G⁻ᵀ` with `M0 = G Gᵀ` [cells n n].
        """
        count, n = inverse.shape[:2]
        columns = self.slopes_columns[:, pairs.inner, pairs.outer] * pairs.known[..., None]
        columns = (columns.reshape(count, n * n, n) @ root).reshape(count, n, n, n)
        # Symmetric in the first two joints.
        turned = (inverse @ columns.reshape(count, n, -1)).reshape(columns.shape)
        each = np.sum((inverse[:, None] @ columns) * columns, axis=(2, 3))
        square = columns.reshape(count, n, -1) @ turned.swapaxes(1, 2).reshape(count, n, -1).swapaxes(1, 2)
        return _sizes(each, square, root)


def _sizes(each: Floats, square: Floats, root: Floats) -> tuple[Floats, Floats]:
    """Return the square roots of `each` [cells n], and of the largest eigenvalue of `square` in the metric [cells].

    - `each`: squared norms [cells n]. `square`: a quadratic form [cells n n]. `root`: as in `PointMoments.slopes`.
    """
    values = np.linalg.eigvalsh(root.swapaxes(1, 2) @ square @ root)[:, -1]
    return np.sqrt(np.maximum(each, 0.0)), np.sqrt(np.maximum(values, 0.0))


def size_in(x: Floats, inertia: Floats) -> Floats:
    """Return `√(xᵀ |M| x)` [cells], a bound of the norm `√(yᵀ M y)` of each vector y with |y_i| <= x_i.

    - `x`: bounds of the entries [cells n]. `inertia`: |M| by element [cells n n].
    """
    return np.sqrt(np.einsum("ni,nij,nj->n", x, inertia, x))
