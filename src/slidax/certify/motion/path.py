"""Inertia of the nominal arm along a motion, and the region of parameters that contains the true arm."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .body_points import BodyPoints, FrameMotion, PointMotion, frame_motion
from .parameter_region import ParameterRegion
from .path_cells import PathCells
from .path_norms import JointPairs, PointMoments, PointNorms, gram, spectral_norm
from .region_norms import RegionNorms

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Path:
    """The nominal arm at the centre of each time cell of a motion, and the region of the true arm's parameters.

    All values are for the motion itself, without deviations from it. X has the positions of body points, whose Jacobian
    is `Y = ∂X/∂q` (body_points.py).

    - `bodies`: the nominal arm. `region`: region of the inertial parameters. `cells`: the motion.
    - `frames`: motion of the joints' frames at the centres.
    """

    bodies: BodyPoints
    region: ParameterRegion
    cells: PathCells
    frames: FrameMotion = field(repr=False)

    @classmethod
    def of(cls, bodies: BodyPoints, region: ParameterRegion, cells: PathCells) -> Path:
        """Return the arm at the centres of a motion's cells; the arguments are the fields."""
        return cls(bodies, region, cells, frame_motion(bodies, cells.q, cells.dq, cells.ddq, cells.dddq))

    @cached_property
    def points(self) -> PointMotion:
        """Motion of the nominal bodies' points."""
        return self.frames.of(self.bodies.points)

    @cached_property
    def cover(self) -> PointMotion:
        """Motion of the points of the region's cover, which bounds the errors ΔJ of the bodies' pseudo-inertias."""
        return self.frames.of(self.region.points)

    @cached_property
    def mass(self) -> Floats:
        """M0, the nominal inertia matrix, at the centres [cells n n]."""
        y = self.points.columns[0]
        return gram(y, y) + np.diag(self.bodies.rotors)

    @cached_property
    def root(self) -> Floats:
        """`G⁻ᵀ` with `M0 = G Gᵀ` [cells n n]; its columns are orthonormal in the metric of M0."""
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.mass)).swapaxes(1, 2))

    @cached_property
    def inverse(self) -> Floats:
        """M0⁻¹ at the centres [cells n n]."""
        return np.asarray(self.root @ self.root.swapaxes(1, 2))

    @cached_property
    def change(self) -> Floats:
        """Norm of `M0⁻¹ Ṁ0` in the metric of M0, `‖x‖² = xᵀ M0 x`, at the centres [cells], 1/s."""
        return spectral_norm(self.root.swapaxes(1, 2) @ self.rate @ self.root)

    @cached_property
    def coriolis(self) -> Floats:
        """`2 C(q, q̇)` with the Coriolis matrix C of the nominal arm, at the centres [cells n n]."""
        y, y1, _ = self.points.columns
        return 2.0 * gram(y, y1)

    @cached_property
    def rate(self) -> Floats:
        """Ṁ0 at the centres, the symmetric part of `2 C` [cells n n]."""
        return np.asarray(0.5 * (self.coriolis + self.coriolis.swapaxes(1, 2)))

    @cached_property
    def torques(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Largest `(A x)_i` over all x with `xᵀ M0 x = 1`, for the matrices A = 2 C, the rate of 2 C, Ṁ0 and M̈0.

        Each is for the centres [cells n].
        """
        y, y1, y2 = self.points.columns
        turn = 2.0 * (gram(y1, y1) + gram(y, y2))
        forms = self.coriolis, turn, self.rate, 0.5 * (turn + turn.swapaxes(1, 2))
        return tuple(np.linalg.norm(form @ self.root, axis=2) for form in forms)  # type: ignore[return-value]

    @cached_property
    def stiffness(self) -> Floats:
        """P, the derivative of the nominal inverse dynamics by q, at the centres [cells n n]."""
        y, _, y2 = self.points.columns
        (count, _, n), pairs = y.shape, self.pairs
        force = np.cross(y.swapaxes(1, 2).reshape(count, n, -1, 3), self.points.acceleration.reshape(count, 1, -1, 3))
        turned = self.frames.axes @ force.sum(axis=2).swapaxes(1, 2)
        return np.asarray(pairs.known * turned[:, pairs.inner, pairs.outer] + gram(y, y2))

    @cached_property
    def pairs(self) -> JointPairs:
        """Tables of the pairs of joints, for second derivatives of X."""
        return JointPairs.of(self.bodies.before)

    @cached_property
    def cover_moments(self) -> PointMoments:
        """Inner products of derivatives of the cover's points at the centres."""
        return PointMoments.of(self.cover.columns[0], self.frames.axes)

    @cached_property
    def norms(self) -> PointNorms:
        """Norms of derivatives of the nominal bodies' points at the centres."""
        return PointNorms.of(self, self.points, PointMoments.of(self.points.columns[0], self.frames.axes))

    @cached_property
    def cover_norms(self) -> PointNorms:
        """Norms of derivatives of the cover's points at the centres; they bound products with errors ΔJ, too."""
        return PointNorms.of(self, self.cover, self.cover_moments, cover=True)

    @cached_property
    def region_norms(self) -> RegionNorms:
        """Upper bounds over all arms of the parameter region, at the centres."""
        return RegionNorms.of(self)
