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

from .path_norms import by_body, frobenius, spectral_norm

if TYPE_CHECKING:
    from .path import Path

Floats = NDArray[np.float64]


CHUNK = 128
"""Cells whose matrices are held at once."""


@dataclass(frozen=True, eq=False)
class RegionNorms:
    """Suprema at the centres, norms in the metric of M0 there.

    - `torque`, `joints`: |T|_i and |M0⁻¹ T|_i [N n]; `force`: norm of M0⁻¹ T [N].
    - `rate`: norm of M0⁻¹ times the rate of T without `E q⃛` [N].
    - `coriolis`: norm of `∂T/∂q̇` [N]; `stiffness`: norms of the columns of `∂T/∂q` [N n].
    - `growth`: norm of Ė [N]; `slopes`: norms of ∂_j E [N n].
    """

    torque: Floats
    joints: Floats
    force: Floats
    rate: Floats
    coriolis: Floats
    stiffness: Floats
    growth: Floats
    slopes: Floats

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
            slopes=2.0 * at.size[:, None] * frobenius(slopes),
        )


def over_ellipsoid(path: Path) -> dict[str, Floats]:
    """Return the suprema over the ellipsoid, by the names of `RegionNorms`."""
    parts = [_over_ellipsoid(path, slice(start, start + CHUNK)) for start in range(0, len(path.cells.q), CHUNK)]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _over_ellipsoid(path: Path, some: slice) -> dict[str, Floats]:
    """The suprema in some cells."""
    frames, region, root = path.frames, path.region, path.root[some]
    ddq, dddq = path.cells.ddq[some], path.cells.dddq[some]
    count, n = ddq.shape
    transposed = root.swapaxes(1, 2)
    weights = region.deviations.reshape(len(region.deviations), n, 16).transpose(1, 2, 0)

    def contracted(a: Floats, b: Floats, bodies: NDArray[np.intp] | slice = slice(None)) -> Floats:
        """`Σ_b tr(a_b J_r b_bᵀ)` for each r, [... r] from [... b 4 3]."""
        moments = a @ b.swapaxes(-1, -2)
        chosen = weights[bodies]
        return np.asarray(moments.reshape(*moments.shape[:-3], -1) @ chosen.reshape(-1, chosen.shape[2]))

    def scaled(matrices: Floats) -> Floats:
        """`Gᵀ B_r G`, [N n n r]."""
        left = (transposed @ matrices.reshape(count, n, -1)).reshape(matrices.shape)
        return np.asarray(transposed[:, None] @ left)

    def largest(columns: Floats) -> Floats:
        """The largest norm of the columns' combinations: of all of them next to each other [N]."""
        return spectral_norm(columns.reshape(len(columns), n, -1).swapaxes(1, 2))

    y, y1, y2 = (part[some] for part in frames.columns)
    slopes, force = frames.slopes[some], frames.acceleration[some, None]
    bend = frames.jerk[some, None] - np.einsum("nkbpi,nk->nbpi", y, dddq)[:, None]
    torque = contracted(y, force) + ddq[..., None] * region.rotor_deviations.T
    rate = contracted(y1, force) + contracted(y, bend)
    coriolis = scaled(2.0 * contracted(y[:, :, None], y1[:, None]))
    stiffness = contracted(slopes, force[:, None]) + contracted(y2[:, :, None], y[:, None])
    by_joint = []
    for j, before in enumerate(path.bodies.before):
        behind = np.flatnonzero(before)
        slope = contracted(slopes[:, j][:, :, None, behind], y[:, None][..., behind, :, :], behind)
        by_joint.append(largest(scaled(slope + slope.swapaxes(1, 2))))
    return {
        "torque": np.linalg.norm(torque, axis=2),
        "joints": np.linalg.norm(path.inverse[some] @ torque, axis=2),
        "force": largest(transposed @ torque),
        "rate": largest(transposed @ rate),
        "coriolis": np.minimum(largest(coriolis), largest(coriolis.swapaxes(1, 2))),
        "stiffness": largest((transposed[:, None] @ stiffness).reshape(count * n, n, -1)).reshape(count, n),
        "growth": largest(0.5 * (coriolis + coriolis.swapaxes(1, 2))),
        "slopes": np.stack(by_joint, axis=1),
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
