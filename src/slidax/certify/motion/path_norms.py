"""The nominal arm at the centres of a motion's cells, as norms in the metric of its inertia."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .body_points import BodyPoints, PointMotion, point_motion
from .path_cells import PathCells

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Path:
    """The nominal arm along a motion: everything that does not depend on the tube."""

    bodies: BodyPoints
    cells: PathCells
    points: PointMotion = field(repr=False)

    @classmethod
    def of(cls, bodies: BodyPoints, cells: PathCells) -> Path:
        """Return the arm at the centres of the cells."""
        return cls(bodies, cells, point_motion(bodies, cells.q, cells.dq, cells.ddq, cells.dddq))

    @cached_property
    def mass(self) -> Floats:
        """M0 at the centres [N n n]."""
        y = self.points.columns[0]
        return _gram(y, y) + np.diag(self.bodies.rotors)

    @cached_property
    def root(self) -> Floats:
        """`G⁻ᵀ` with `M0 = G Gᵀ` [N n n]: its columns are orthonormal in the metric."""
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.mass)).swapaxes(1, 2))

    @cached_property
    def inverse(self) -> Floats:
        """M0⁻¹ at the centres [N n n]."""
        return np.asarray(self.root @ self.root.swapaxes(1, 2))

    @cached_property
    def norms(self) -> Norms:
        """Norms at the centres."""
        return Norms.of(self)


@dataclass(frozen=True, eq=False)
class Norms:
    """Norms at the centres, in the metric there.

    - `first`, `second`: of Ẏ and Ÿ [N]; `relative`: of Ẏ but for a common rotation [N].
    - `change`, `coriolis`, `coriolis_rate`: of Ṁ, of `2 C` and of its rate [N].
    - `slopes`, `turning`, `relative_slopes`: of `∂_j Y`, of `Yᵀ ∂_j Y`, and of ∂_j Y but for a common rotation [N n];
      `slopes_norm`, `turning_norm`, `relative_norm`: of their sums over j, per norm of the velocities [N].
    - `outer`: ‖Y x‖ of joints from k on, for ‖x‖ = 1 [N n]; `own`: ‖∂_k X‖ [N n].
    - `force`, `bend`: of `Ẍ - g` per body, and of `X⃛` without its share of the jerk [N m].
    - `lever`: `‖Y_b M0⁻¹ e_i‖` for each joint and body, and `arms`: ‖Y_b e_i‖ [N n m].
    - `coriolis_matrix`, `stiffness_matrix`: `2 C` and the derivative P of the inverse dynamics by q [N n n].
    """

    first: Floats
    second: Floats
    relative: Floats
    change: Floats
    coriolis: Floats
    coriolis_rate: Floats
    slopes: Floats
    turning: Floats
    relative_slopes: Floats
    slopes_norm: Floats
    turning_norm: Floats
    relative_norm: Floats
    outer: Floats
    own: Floats
    force: Floats
    bend: Floats
    lever: Floats
    arms: Floats
    coriolis_matrix: Floats
    stiffness_matrix: Floats

    @classmethod
    def of(cls, path: Path) -> Norms:
        """Compute the norms at the centres of a path's cells."""
        bodies, points, root = path.bodies, path.points, path.root
        y, y1, y2 = points.columns
        count, n = path.cells.q.shape
        unit, unit1, unit2 = y @ root, y1 @ root, y2 @ root
        slopes = np.moveaxis(points.slopes, 3, 1) @ root[:, None]
        turning = unit.swapaxes(1, 2)[:, None] @ slopes
        # A common rotation of all bodies changes no inner product: take it where that leaves less.
        spun = np.cross(points.axes[:, :, None, None], unit.reshape(count, -1, 3, n).swapaxes(2, 3)[:, None])
        spun = spun.swapaxes(3, 4).reshape(slopes.shape)
        whole, rest = _sizes(slopes), _sizes(slopes - spun)
        turns = rest < whole
        relative_slopes = np.where(turns[..., None, None], slopes - spun, slopes)
        relative = np.einsum("njdl,nj->ndl", relative_slopes, path.cells.dq)
        stiffness = np.einsum("ndjk,nd->nkj", points.slopes, points.acceleration) + _gram(y, y2)
        behind = bodies.before[None, :, :, None] & bodies.before[None, :, None, :]
        parts = np.where(behind, _gram(y, y)[:, None], 0.0)
        shape = (count, len(bodies.carrier), 12)
        lever = (y @ path.inverse).swapaxes(1, 2).reshape(count, n, *shape[1:])
        jerked = points.jerk - np.einsum("ndk,nk->nd", y, path.cells.dddq)
        return cls(
            first=spectral_norm(unit1),
            second=spectral_norm(unit2),
            relative=spectral_norm(relative),
            change=spectral_norm(_gram(unit, unit1) + _gram(unit1, unit)),
            coriolis=2.0 * spectral_norm(_gram(unit, unit1)),
            coriolis_rate=2.0 * spectral_norm(_gram(unit1, unit1) + _gram(unit, unit2)),
            slopes=whole,
            turning=_sizes(turning),
            relative_slopes=np.minimum(whole, rest),
            slopes_norm=_joint_norm(slopes, root),
            turning_norm=_joint_norm(turning, root),
            relative_norm=_joint_norm(relative_slopes, root),
            outer=np.sqrt(np.maximum(np.einsum("nkij,nij->nk", parts, path.inverse), 0.0)),
            own=np.sqrt(np.einsum("ndk,ndk->nk", y, y)),
            force=np.linalg.norm(points.acceleration.reshape(shape), axis=2),
            bend=np.linalg.norm(jerked.reshape(shape), axis=2),
            lever=np.linalg.norm(lever, axis=3),
            arms=np.linalg.norm(y.swapaxes(1, 2).reshape(count, n, *shape[1:]), axis=3),
            coriolis_matrix=2.0 * _gram(y, y1),
            stiffness_matrix=stiffness,
        )


def _gram(a: Floats, b: Floats) -> Floats:
    return np.asarray(a.swapaxes(1, 2) @ b)


def spectral_norm(a: Floats) -> Floats:
    """Return spectral norms [N]."""
    return np.sqrt(np.maximum(np.linalg.eigvalsh(_gram(a, a))[:, -1], 0.0))


def _sizes(a: Floats) -> Floats:
    """Frobenius norms of the last two axes."""
    return np.asarray(np.sqrt(np.sum(a * a, axis=(-2, -1))))


def _joint_norm(slopes: Floats, root: Floats) -> Floats:
    """Bound of `‖Σ_j v_j slopes_j‖` for all v of norm 1 [N]."""
    inverse = root @ root.swapaxes(1, 2)
    weighted = np.einsum("njdk,nji->nidk", slopes, inverse)
    square = np.einsum("njdk,njdl->nkl", weighted, slopes, optimize=True)
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(square)[:, -1], 0.0)))


def size_in(x: Floats, inertia: Floats) -> Floats:
    """Return `√(|x|ᵀ |M| |x|)` [N], the largest norm of a vector whose entries have these sizes."""
    return np.sqrt(np.einsum("ni,nij,nj->n", x, inertia, x))
