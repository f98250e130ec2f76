"""Bounds over a parameter region at the centres of a motion's cells.

M0 and n0 are the nominal inertia matrix and Coriolis torque with gravity; `E = M - M0` and `Δn = n - n0` are the
errors. The torque error `T = E q̈ + Δn` is linear in the error of the parameters. The smaller of two bounds is used, for
the two descriptions of a region (parameter_region.py):

- Over the ellipsoid `T = A ξ` with |ξ| <= 1. So `|T|_i <= |A_i|`, and `‖M0⁻¹ T‖ <= ‖Gᵀ A‖` with `M0⁻¹ = G Gᵀ`. A matrix
  `Σ ξ_r B_r` has at most the norm of all B_r side by side.
- Over the cover `|xᵀ T| <= Σ_b ‖Y_b x‖ ‖F_b‖`. For body b's points in the cover, Y_b is their Jacobian, and F_b their
  acceleration less gravity.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .path_norms import by_body, spectral_norm

if TYPE_CHECKING:
    from .path import Path

Floats = NDArray[np.float64]


CHUNK = 32
"""Cells that are computed at once: so few that their matrices fit in the CPU's cache."""


@dataclass(frozen=True, eq=False)
class RegionNorms:
    """Upper bounds over all arms of a parameter region, at the centres of cells; norms are in the metric of M0 there.

    The symbols are those of the module's docstring; T is taken along the motion.

    - `torque`, `joints`: |T|_i and |M0⁻¹ T|_i [cells n]; `force`: norm of M0⁻¹ T [cells].
    - `rate`: norm of M0⁻¹ times the rate of T without `E q⃛` [cells]; `torque_rate`: that rate per joint [cells n].
    - `coriolis`: norm of `∂T/∂q̇` [cells]; `stiffness`: norms of the columns of `∂T/∂q` [cells n].
    - `growth`: norm of Ė [cells]; `slopes`: norms of ∂_j E [cells n].
    - `error`, `relative`: |E|_ij and |M0⁻¹ E|_ij by element [cells n n]; `error_rows`, `error_rates`: largest of
      `(E x)_i` and `(Ė x)_i` over all x of norm 1 [cells n].
    """

    torque: Floats
    joints: Floats
    force: Floats
    rate: Floats
    torque_rate: Floats
    coriolis: Floats
    stiffness: Floats
    growth: Floats
    slopes: Floats
    error: Floats
    error_rows: Floats
    error_rates: Floats
    relative: Floats

    @classmethod
    def of(cls, path: Path) -> RegionNorms:
        """Compute the bounds at the centres of a path's cells."""
        cover = cls._over_cover(path)
        if not path.region.has_ellipsoid:
            return cover
        exact = over_ellipsoid(path)
        return replace(cover, **{name: np.minimum(getattr(cover, name), value) for name, value in exact.items()})

    @classmethod
    def _over_cover(cls, path: Path) -> RegionNorms:
        at, points, root, cells = path.cover_norms, path.cover, path.root, path.cells
        y, y1, y2 = points.columns
        rotors = np.sqrt(path.region.rotors)
        force = np.concatenate([at.force, rotors * np.abs(cells.ddq)], axis=1)
        size = np.linalg.norm(force, axis=1)
        # The rotors are further points of Y.
        bound = spectral_norm(np.concatenate([y @ root, rotors[:, None] * root], axis=1))
        arms = np.concatenate([by_body(y), np.broadcast_to(np.diag(rotors), root.shape)], axis=1)
        levers = np.concatenate([by_body(y @ path.inverse), rotors[:, None] * np.abs(path.inverse)], axis=1)
        slopes, relative = _relative_slopes(path)
        whole, pushed = (np.linalg.norm(part, axis=1) for part in (at.force, at.bend))
        return cls(
            torque=np.einsum("nbi,nb->ni", arms, force),
            joints=np.einsum("nbi,nb->ni", levers, force),
            force=bound * size,
            rate=at.first * whole + at.size * pushed,
            torque_rate=np.einsum("nbi,nb->ni", by_body(y1), at.force) + np.einsum("nbi,nb->ni", by_body(y), at.bend),
            coriolis=2.0 * at.size * at.first,
            stiffness=at.slopes * whole[:, None] + at.size[:, None] * np.linalg.norm(y2, axis=1),
            growth=2.0 * at.size * np.minimum(at.first, relative),
            slopes=2.0 * at.size[:, None] * slopes,
            error=arms.swapaxes(1, 2) @ arms,
            error_rows=np.linalg.norm(arms, axis=1) * bound[:, None],
            error_rates=np.linalg.norm(y1, axis=1) * at.size[:, None] + np.linalg.norm(y, axis=1) * at.first[:, None],
            relative=levers.swapaxes(1, 2) @ arms,
        )


def over_ellipsoid(path: Path) -> dict[str, Floats]:
    """Return the bounds over the ellipsoid of the path's region, by field name of `RegionNorms`."""
    # All cells at rest after the motion have the same suprema.
    cells, count = path.cells, path.cells.moving + 1
    parts = [_over_ellipsoid(path, slice(start, min(start + CHUNK, count))) for start in range(0, count, CHUNK)]
    which = np.minimum(np.arange(len(cells.q)), count - 1)
    return {name: np.concatenate([part[name] for part in parts])[which] for name in parts[0]}


def _over_ellipsoid(path: Path, some: slice) -> dict[str, Floats]:
    """Return the suprema over the ellipsoid in the cells `some`, by field name of `RegionNorms`.

    With `Γ_ijk = ∂_iX · ∂_j∂_kX` for each axis of the ellipsoid: `∂_j E = Γ_·j· + Γ_·j·ᵀ`, and `C = Σ_k Γ_··k q̇_k`.
    """
    region, root, inverse, pairs = path.region, path.root[some], path.inverse[some], path.pairs
    dq, ddq, axes = path.cells.dq[some], path.cells.ddq[some], path.frames.axes[some]
    (count, n), transposed = ddq.shape, root.swapaxes(1, 2)
    products = _products(path, some)
    torque = products.force + ddq[..., None] * region.rotor_deviations.T
    error = products.inertia
    error[:, range(n), range(n)] += region.rotor_deviations.T
    relative = (inverse @ error.reshape(count, n, -1)).reshape(error.shape)
    turned = (axes @ products.turned.reshape(count, 3, -1)).reshape(count, n, n, n, -1)
    bent = (axes @ products.bent.reshape(count, 3, -1)).reshape(count, n, n, -1)
    bent = bent[:, pairs.inner, pairs.outer] * pairs.known[..., None]
    rate = (dq[:, None, None] @ bent)[:, :, 0] + products.bend
    stiffness = bent + products.second

    def largest(columns: Floats) -> Floats:
        """Return the largest norm of a combination `A ξ` with |ξ| <= 1 [cells], from the columns of A."""
        return spectral_norm(columns.reshape(len(columns), n, -1).swapaxes(1, 2))

    def largest_form(forms: Floats) -> Floats:
        """Return a bound of the norm of `Σ ξ_r Gᵀ B_r G` [cells] for |ξ| <= 1, from B_r [cells n n r].

        The bound is the root of the norm of `Gᵀ (Σ B_r M0⁻¹ B_rᵀ) G`.
        """
        right = (inverse[:, None] @ forms).reshape(count, n, -1)
        square = transposed @ (forms.reshape(count, n, -1) @ right.swapaxes(1, 2)) @ root
        return np.sqrt(np.maximum(np.linalg.eigvalsh(square)[:, -1], 0.0))

    def largest_rows(rows: Floats) -> Floats:
        """Return `largest` for each joint's matrix, [cells n] from [cells n n r]."""
        return largest((transposed[:, None] @ rows).reshape(count * n, n, -1)).reshape(count, n)

    coriolis, slopes = np.zeros_like(error), []
    for j in range(n):
        # Γ_ijk in the order (k, i).
        slope = turned[:, pairs.inner[j], pairs.outer[j]] * pairs.known[j][:, None, None]
        coriolis[:, :, j] = (dq[:, None] @ slope.reshape(count, n, -1)).reshape(count, n, -1)
        slopes.append(largest_form(slope + slope.swapaxes(1, 2)))
    turn = 2.0 * np.minimum(largest_form(coriolis), largest_form(coriolis.swapaxes(1, 2)))
    coriolis = coriolis + coriolis.swapaxes(1, 2)
    return {
        "torque": np.linalg.norm(torque, axis=2),
        "joints": np.linalg.norm(inverse @ torque, axis=2),
        "force": largest(transposed @ torque),
        "rate": largest(transposed @ rate),
        "torque_rate": np.linalg.norm(rate, axis=2),
        "coriolis": turn,
        "stiffness": largest_rows(stiffness),
        "growth": largest_form(coriolis),
        "slopes": np.stack(slopes, axis=1),
        "error": np.linalg.norm(error, axis=3),
        "error_rows": largest_rows(error),
        "error_rates": np.linalg.norm(transposed[:, None] @ coriolis, axis=(2, 3)),
        "relative": np.linalg.norm(relative, axis=3),
    }


@dataclass(frozen=True, eq=False)
class _Products:
    """Inner products of fields for each of the r axes of an ellipsoid; F is `Ẍ - g`.

    - `inertia`: `∂_jX · ∂_kX`; `second`: `∂_jẌ · ∂_kX` [cells n n r].
    - `turned`: `Σ ∂_kX × ∂_iX` [cells 3 n n r]; its product with an axis z is `(z × ∂_kX) · ∂_iX`.
    - `bent`: `Σ ∂_kX × F` [cells 3 n r].
    - `force`, `bend`: `∂_jX` times F, and times the rate of F without the jerk [cells n r].
    """

    inertia: Floats
    second: Floats
    turned: Floats
    bent: Floats
    force: Floats
    bend: Floats


def _products(path: Path, some: slice) -> _Products:
    """Return the products in the cells `some`. Of two joints, the outer one is c; only bodies that c carries count."""
    frames, deviations, before = path.frames, path.region.deviations, path.bodies.before
    y, _, y2 = (part[some] for part in frames.columns)
    force = frames.acceleration[some, None]
    bend = frames.jerk[some, None] - np.einsum("nkbpi,nk->nbpi", y, path.cells.dddq[some])[:, None]
    # u · (v × e) = e · (u × v).
    across, bowed = _crossed(y), _crossed(force)
    count, n, axes = len(y), y.shape[1], len(deviations)
    result = _Products(*(np.zeros((count, *shape, axes)) for shape in ((n, n), (n, n), (3, n, n), (3, n), (n,), (n,))))
    for c in range(n):
        behind, upto = np.flatnonzero(before[c]), np.flatnonzero(before[:, c])
        size, contracted = len(upto), _Contraction(behind, deviations[:, behind].reshape(axes, -1).T)
        others = [y[:, upto], y2[:, upto], *(part[:, upto] for part in across), *bowed, force, bend]
        own = contracted(y[:, c], others)
        result.inertia[:, upto, c] = result.inertia[:, c, upto] = own[:, :size]
        result.second[:, upto, c] = own[:, size : 2 * size]
        result.second[:, c, upto] = contracted(y2[:, c], [y[:, upto]])
        for x in range(3):
            result.turned[:, x, c, upto] = own[:, (2 + x) * size : (3 + x) * size]
            result.turned[:, x, upto, c] = -result.turned[:, x, c, upto]
            result.bent[:, x, c] = own[:, x - 5]
        result.force[:, c], result.bend[:, c] = own[:, -2], own[:, -1]
    return result


def _crossed(field: Floats) -> list[Floats]:
    """The cross products `v × e` of a field's vectors v [... 3] with the unit vectors e of x, y and z."""
    x, y, z = np.moveaxis(field, -1, 0)
    nothing = np.zeros_like(x)
    return [np.stack(parts, axis=-1) for parts in ((nothing, z, -y), (-z, nothing, x), (y, -x, nothing))]


@dataclass(frozen=True, eq=False)
class _Contraction:
    """Inner products of fields on some bodies, for each axis of an ellipsoid: `weights` [(bodies 4 4) r]."""

    bodies: NDArray[np.intp]
    weights: Floats

    def __call__(self, field: Floats, others: Sequence[Floats]) -> Floats:
        """Return `Σ_b tr(a_b J_r c_bᵀ)` [cells others r] over bodies b, for a field a and each of the other fields c.

        - `field`: a [cells n 4 3]. `others`: the other fields, in parts [cells parts n 4 3].
        """
        right = np.concatenate([other[:, :, self.bodies] for other in others], axis=1)
        moments = field[:, None, self.bodies] @ right.swapaxes(-1, -2)
        return np.asarray(moments.reshape(*moments.shape[:2], -1) @ self.weights)


def _relative_slopes(path: Path) -> tuple[Floats, Floats]:
    """Return the norms of `∂_j Y` [cells n] and `Σ_j q̇_j ∂_j Y` [cells] for the cover, less common rotations.

    A common rotation of all bodies about joint j's axis z changes no inner product. It is subtracted where this makes
    the norm smaller.
    """
    pairs, y, y1 = path.pairs, path.cover.columns[0], path.cover.columns[1]
    products = path.cover_moments.slopes_products
    (count, _, n), known = y.shape, pairs.known
    least = np.empty((count, n))
    for j in range(n):
        # Squared norm of ∂_j∂_k X - z_j × ∂_k X, from the products of the two.
        own = products[:, pairs.inner[j], pairs.outer[j]] * known[j][:, None, None]
        both, common = own[:, :, j], products[:, j, :, j]
        square = own[:, :, pairs.inner[j], pairs.outer[j]] * known[j] - both - both.swapaxes(1, 2) + common
        least[:, j] = np.sum(square * path.inverse, axis=(1, 2))
    least = np.sqrt(np.maximum(least, 0.0))
    turned = np.where(least < path.cover_norms.slopes, path.cells.dq, 0.0)
    spin = np.einsum("nj,njx->nx", turned, path.frames.axes)
    # ∂_j Y q̇_j summed over all joints is Ẏ.
    common = np.cross(spin[:, None], y.swapaxes(1, 2).reshape(count, -1, 3)).reshape(count, n, -1).swapaxes(1, 2)
    return np.minimum(least, path.cover_norms.slopes), spectral_norm((y1 - common) @ path.root)
