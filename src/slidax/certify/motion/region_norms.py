"""Suprema over a parameter region at the centres of a motion's cells.

With T the torque `E q̈ + Δn` of an error of the parameters, linear in it: over the ellipsoid a torque is `T = A ξ`, and
`|T|_i <= |A_i|`, `‖M0⁻¹ T‖ <= ‖Gᵀ A‖` with `M0⁻¹ = G Gᵀ`; for a matrix `Σ ξ_r B_r` the norm is at most that of all B_r
next to each other. Over the cover, T is at most `Σ_b ‖Y_b x‖ ‖F_b‖` in the direction x. The smaller of both counts.
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
"""Cells whose matrices are held at once: so few that they stay in the cache."""


@dataclass(frozen=True, eq=False)
class RegionNorms:
    """Suprema at the centres, norms in the metric of M0 there.

    - `torque`, `joints`: |T|_i and |M0⁻¹ T|_i [N n]; `force`: norm of M0⁻¹ T [N].
    - `rate`: norm of M0⁻¹ times the rate of T without `E q⃛` [N]; `torque_rate`: that rate per joint [N n].
    - `coriolis`: norm of `∂T/∂q̇` [N]; `stiffness`: norms of the columns of `∂T/∂q` [N n].
    - `growth`: norm of Ė [N]; `slopes`: norms of ∂_j E [N n].
    - `error`, `relative`: |E|_ij and |M0⁻¹ E|_ij by element [N n n]; `error_rows`, `error_rates`: largest of
      `(E x)_i` and `(Ė x)_i` over all x of norm 1 [N n].
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
        """Compute the suprema at the centres of a path's cells."""
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
    """Return the suprema over the ellipsoid, by the names of `RegionNorms`."""
    # The arm at rest after the motion is the same in all cells.
    cells, count = path.cells, path.cells.moving + 1
    parts = [_over_ellipsoid(path, slice(start, min(start + CHUNK, count))) for start in range(0, count, CHUNK)]
    which = np.minimum(np.arange(len(cells.q)), count - 1)
    return {name: np.concatenate([part[name] for part in parts])[which] for name in parts[0]}


def _over_ellipsoid(path: Path, some: slice) -> dict[str, Floats]:
    """The suprema in some cells.

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
        """The largest norm of the columns' combinations: of all of them next to each other [N]."""
        return spectral_norm(columns.reshape(len(columns), n, -1).swapaxes(1, 2))

    def largest_form(forms: Floats) -> Floats:
        """The same for `Gᵀ B_r G`, from B_r [N n n r]: the root of the norm of `Gᵀ (Σ B_r M0⁻¹ B_rᵀ) G`."""
        right = (inverse[:, None] @ forms).reshape(count, n, -1)
        square = transposed @ (forms.reshape(count, n, -1) @ right.swapaxes(1, 2)) @ root
        return np.sqrt(np.maximum(np.linalg.eigvalsh(square)[:, -1], 0.0))

    def largest_rows(rows: Floats) -> Floats:
        """The same for the torques of each joint, [N n] from [N n n r]."""
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

    - `inertia`: `∂_jX · ∂_kX`; `second`: `∂_jẌ · ∂_kX` [N n n r].
    - `turned`: `Σ ∂_kX × ∂_iX` [N 3 n n r], of which `(z × ∂_kX) · ∂_iX` is the product with z; `bent`: `Σ ∂_kX × F`
      [N 3 n r].
    - `force`, `bend`: `∂_jX` times F, and times the rate of F without the jerk [N n r].
    """

    inertia: Floats
    second: Floats
    turned: Floats
    bent: Floats
    force: Floats
    bend: Floats


def _products(path: Path, some: slice) -> _Products:
    """The products in some cells. A product of derivatives needs only the bodies behind their outermost joint c."""
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
    """The products `v × e` of a field's vectors [... 3] with the three units e."""
    x, y, z = np.moveaxis(field, -1, 0)
    nothing = np.zeros_like(x)
    return [np.stack(parts, axis=-1) for parts in ((nothing, z, -y), (-z, nothing, x), (y, -x, nothing))]


@dataclass(frozen=True, eq=False)
class _Contraction:
    """Inner products of fields on some bodies, for each axis of an ellipsoid: `weights` [(bodies 4 4) r]."""

    bodies: NDArray[np.intp]
    weights: Floats

    def __call__(self, field: Floats, others: Sequence[Floats]) -> Floats:
        """Return `Σ_b tr(a_b J_r b_bᵀ)` for a field a [N n 4 3] and all others b [N . n 4 3], as [N b r]."""
        right = np.concatenate([other[:, :, self.bodies] for other in others], axis=1)
        moments = field[:, None, self.bodies] @ right.swapaxes(-1, -2)
        return np.asarray(moments.reshape(*moments.shape[:2], -1) @ self.weights)


def _relative_slopes(path: Path) -> tuple[Floats, Floats]:
    """Norms of `∂_j Y` of the cover [N n], and of `Σ_j q̇_j ∂_j Y` [N], less common rotations where that leaves less.

    A common rotation of all bodies about joint j's axis z changes no inner product.
    """
    pairs, y, y1 = path.pairs, path.cover.columns[0], path.cover.columns[1]
    products = path.cover_moments.slopes_products
    (count, _, n), known = y.shape, pairs.known
    least = np.empty((count, n))
    for j in range(n):
        # Of ∂_j∂_k X and of z_j × ∂_k X.
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
