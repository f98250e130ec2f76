"""Suprema over a parameter region at the centres of a motion's cells.

With T the torque `E q̈ + Δn` of an error of the parameters, linear in it: over the ellipsoid a torque is `T = A ξ`, and
`|T|_i <= |A_i|`, `‖M0⁻¹ T‖ <= ‖Gᵀ A‖` with `M0⁻¹ = G Gᵀ`; for a matrix `Σ ξ_r B_r` the norm is at most that of all B_r
next to each other. Over the cover, T is at most `Σ_b ‖Y_b x‖ ‖F_b‖` in the direction x. The smaller of both counts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .path_norms import by_body, frobenius, joint_norm, spectral_norm

if TYPE_CHECKING:
    from .path import Path

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RegionNorms:
    """Suprema at the centres, norms in the metric of M0 there.

    - `torque`, `joints`: |T|_i and |M0⁻¹ T|_i [N n]; `force`: norm of M0⁻¹ T [N].
    - `rate`: norm of M0⁻¹ times the rate of T without `E q⃛` [N].
    - `coriolis`: norm of `∂T/∂q̇` [N]; `stiffness`: norms of the columns of `∂T/∂q` [N n].
    - `growth`: norm of Ė [N].
    - `relative_slopes`: of the cover's ∂_j Y but for a common rotation [N n]; `relative_norm`: of their sum over j, per
      norm of the velocities [N].
    """

    torque: Floats
    joints: Floats
    force: Floats
    rate: Floats
    coriolis: Floats
    stiffness: Floats
    growth: Floats
    relative_slopes: Floats
    relative_norm: Floats

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
        y, _, y2 = points.columns
        rotors = np.sqrt(path.region.rotors)
        force = np.concatenate([at.force, rotors * np.abs(cells.ddq)], axis=1)
        size = np.linalg.norm(force, axis=1)
        # The rotors are further points of Y.
        bound = spectral_norm(np.concatenate([y @ root, rotors[:, None] * root], axis=1))
        arms = np.concatenate([by_body(y), np.broadcast_to(np.diag(rotors), root.shape)], axis=1)
        levers = np.concatenate([by_body(y @ path.inverse), rotors[:, None] * np.abs(path.inverse)], axis=1)
        slopes = _relative_slopes(path)
        relative = spectral_norm(np.einsum("njdl,nj->ndl", slopes, cells.dq))
        whole, pushed = (np.linalg.norm(part, axis=1) for part in (at.force, at.bend))
        return cls(
            torque=np.einsum("nbi,nb->ni", arms, force),
            joints=np.einsum("nbi,nb->ni", levers, force),
            force=bound * size,
            rate=at.first * whole + at.size * pushed,
            coriolis=2.0 * at.size * at.first,
            stiffness=at.slopes * whole[:, None] + at.size[:, None] * np.linalg.norm(y2, axis=1),
            growth=2.0 * at.size * np.minimum(at.first, relative),
            relative_slopes=frobenius(slopes),
            relative_norm=joint_norm(slopes, root),
        )


def over_ellipsoid(path: Path) -> dict[str, Floats]:
    """Return the suprema over the ellipsoid, by the names of `RegionNorms`."""
    frames, region, cells, root = path.frames, path.region, path.cells, path.root
    count, n = cells.q.shape
    weights = region.deviations.reshape(len(region.deviations), -1).T

    def contracted(a: Floats, b: Floats) -> Floats:
        """`Σ_b tr(a_b J_r b_bᵀ)` for each r, [... r] from [... n 4 3]."""
        moments = a @ b.swapaxes(-1, -2)
        return np.asarray(moments.reshape(*moments.shape[:-3], -1) @ weights)

    def largest(columns: Floats) -> Floats:
        return spectral_norm(columns.swapaxes(1, 2))

    y, y1, y2 = frames.columns
    force = frames.acceleration[:, None]
    bend = (frames.jerk - np.einsum("nkbpi,nk->nbpi", y, cells.dddq))[:, None]
    torque = contracted(y, force) + cells.ddq[..., None] * region.rotor_deviations.T
    rate = contracted(y1, force) + contracted(y, bend)
    transposed = root.swapaxes(1, 2)
    coriolis = 2.0 * contracted(y[:, :, None], y1[:, None])
    coriolis = np.einsum("nkl,nlmr,nmj->nkjr", transposed, coriolis, root, optimize=True)
    growth = 0.5 * (coriolis + coriolis.swapaxes(1, 2))
    stiffness = contracted(frames.slopes, force[:, None]) + contracted(y2[:, :, None], y[:, None])
    stiffness = transposed[:, None] @ stiffness
    return {
        "torque": np.linalg.norm(torque, axis=2),
        "joints": np.linalg.norm(path.inverse @ torque, axis=2),
        "force": largest(transposed @ torque),
        "rate": largest(transposed @ rate),
        "coriolis": np.minimum(
            largest(coriolis.reshape(count, n, -1)), largest(coriolis.swapaxes(1, 2).reshape(count, n, -1))
        ),
        "stiffness": largest(stiffness.reshape(count * n, n, -1)).reshape(count, n),
        "growth": largest(growth.reshape(count, n, -1)),
    }


def _relative_slopes(path: Path) -> Floats:
    """`∂_j Y` of the cover in the metric, less a common rotation about joint j's axis where that leaves less [N n D n].

    A common rotation of all bodies changes no inner product.
    """
    unit = path.cover.columns[0] @ path.root
    count, _, n = unit.shape
    slopes = np.moveaxis(path.cover.slopes, 3, 1) @ path.root[:, None]
    turned = np.cross(path.frames.axes[:, :, None, None], unit.reshape(count, -1, 3, n).swapaxes(2, 3)[:, None])
    rest = slopes - turned.swapaxes(3, 4).reshape(slopes.shape)
    return np.where((frobenius(rest) < frobenius(slopes))[..., None, None], rest, slopes)
